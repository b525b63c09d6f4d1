"""Segmentation by colours: the choice among several objects, and warnings."""

import numpy as np
import pytest

from psgn_jax.data import masks

pytest.importorskip("cv2")
from psgn_jax.data import segmentation


def room(size=(240, 320)):
    """A wall over a floor, uint8 [h, w, 3], with some noise."""
    rng = np.random.default_rng(0)
    image = np.empty((*size, 3))
    image[: size[0] // 2] = (170, 180, 190)
    image[size[0] // 2 :] = (140, 110, 80)
    image *= np.linspace(0.85, 1.1, size[1])[None, :, None]
    return (image + rng.normal(0, 5, image.shape)).clip(0, 255).astype(np.uint8)


def overlap(one, other):
    return (one & other).sum() / (one | other).sum()


def test_a_second_object_at_the_side_stays_out():
    image = room()
    rows, columns = np.mgrid[:240, :320]
    mask = ((rows - 125) / 60) ** 2 + ((columns - 170) / 70) ** 2 < 1
    image[mask] = image[mask] * 0.2 + [140, 20, 20]
    image[60:180, 12:40] = (190, 40, 30)
    found = masks.find_mask(image)
    assert found.method == "grabcut"
    assert found.mask.shape == mask.shape
    assert overlap(found.mask, mask) > 0.9
    again = masks.find_mask(image)
    np.testing.assert_array_equal(found.mask, again.mask)
    assert found.doubt == again.doubt == ""


def test_an_image_without_an_object_is_in_doubt():
    rng = np.random.default_rng(0)
    coarse = rng.integers(0, 255, (12, 16, 3)).repeat(20, 0).repeat(20, 1)
    image = (coarse + rng.normal(0, 30, coarse.shape)).clip(0, 255).astype(np.uint8)
    found = masks.find_mask(image)
    assert "--mask" in found.doubt


@pytest.mark.parametrize("size", [(16, 16), (17, 900), (700, 40)])
def test_any_shape_of_image(size):
    image = room(size)
    height, width = size
    image[height // 4 : -height // 4, width // 4 : -width // 4] = (30, 160, 40)
    assert masks.find_mask(image, method="grabcut").mask.shape == size


def test_barrier_distance_is_the_range_on_the_best_path():
    """A ring surrounds a plateau, so every path to the middle crosses the ring."""
    values = np.zeros((30, 30, 1), np.float32)
    values[8:22, 8:22] = 10
    values[12:18, 12:18] = 4
    distance = segmentation._barrier_distance(np.repeat(values, 3, axis=2)) / 3
    assert distance[0].max() == 0
    assert distance[3, 15] < 1
    assert distance[15, 15] == pytest.approx(10, abs=1.5)

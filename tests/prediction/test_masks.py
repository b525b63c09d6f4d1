"""Masks that are found: by the background, and by the network of the package."""

import io

import numpy as np
import pytest
from helpers.commands import PHOTOS
from PIL import Image

from psgn_jax.data import photo
from psgn_jax.prediction import masks


def test_alpha_and_a_plain_background_come_before_the_network():
    rows, columns = np.mgrid[:180, :240]
    away = (rows - 90) ** 2 + (columns - 120) ** 2
    mask = (away < 50**2) & (away > 15**2)  # the background is visible through a hole
    image = np.full((180, 240, 3), 255, np.uint8)
    image[mask] = (150, 30, 40)
    found, how, _ = masks.find_mask(image)
    assert how == "plain"
    np.testing.assert_array_equal(found, mask)
    stream = io.BytesIO()
    Image.fromarray(image).save(stream, "JPEG", quality=75)
    found, how, _ = masks.find_mask(np.asarray(Image.open(stream)))
    assert how == "plain"
    assert masks.mask_iou(found, mask) > 0.9
    found, how, _ = masks.find_mask(image, np.uint8(255) * (away < 100))
    assert how == "alpha"
    np.testing.assert_array_equal(found, away < 100)


def test_the_network_finds_objects_or_a_mask_is_asked_for(rng):
    for name in ("bottle", "cup", "pan"):
        read = photo.read_photo(PHOTOS / f"{name}.jpg")
        given = photo.read_mask(PHOTOS / f"{name}_mask.png", read)
        found, how, _ = masks.find_mask(read.image)
        assert how.startswith("network, ")
        assert masks.mask_iou(found, given) > 0.85
    for image in (np.full((64, 64, 3), 90, np.uint8), rng.integers(0, 255, (64, 90, 3), np.uint8)):
        with pytest.raises(photo.PhotoError, match=r"not certain|no object found"):
            masks.find_mask(image)
    with pytest.raises(photo.PhotoError, match="mask_from=plain expects a background of one"):
        masks.find_mask(rng.integers(0, 255, (64, 64, 3), np.uint8), method="plain")
    with pytest.raises(ValueError, match="accepted: auto, alpha, plain, network"):
        masks.find_mask(np.zeros((64, 64, 3), np.uint8), method="magic")


@pytest.mark.parametrize(
    ("p", "in_the_middle", "warns"), [(0.853, 255, True), (0.953, 255, False), (0.953, 180, True)]
)
def test_a_doubtful_mask_is_used_with_a_warning(monkeypatch, p, in_the_middle, warns):
    """One is less certain, one is not found again in the middle of the photo."""

    def found_in(image):
        level = in_the_middle if len(image) < 100 else 255
        return np.where(image[..., 0] >= level, np.float32(0), np.float32(p))

    image = np.full((100, 100, 3), 255, np.uint8)
    image[20:80, 20:80] = 180
    monkeypatch.setattr(masks, "probabilities", found_in)
    found = masks.find_mask(image, method="network")
    np.testing.assert_array_equal(found.mask, image[..., 0] == 180)
    assert found.method == f"network, {100 * p:.0f}% certain"
    assert bool(found.warnings) == warns
    assert all("look at NAME_view.png" in warning for warning in found.warnings)

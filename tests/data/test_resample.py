import numpy as np
import pytest

from psgn_jax.data import resample


@pytest.mark.parametrize("factor", [0.71, 0.9, 1.0, 1.22])
def test_the_surroundings_of_the_object_are_enough(rng, factor):
    """The results for the window are those for the whole image, except for ties of rounding."""
    image = np.full((40, 56, 3), 191, np.uint8)
    mask = np.zeros((40, 56), np.bool_)
    mask[9:26, 12:31] = rng.random((17, 19)) < 0.8
    image[9:26, 12:31] = rng.integers(0, 256, (17, 19, 3))
    other = image.copy()
    other[4, 4] = 190  # with another pixel than grey, the whole image is computed
    source = 27.3 + (np.arange(56) + 0.5 - 27.3) / factor
    for function, *arguments in (resample.stretch, source), (resample.recrop, factor, (-0.6, 2.9)):
        got, want = (function(picture, mask, *arguments) for picture in (image, other))
        np.testing.assert_array_equal(got[1], want[1])
        difference = np.abs(got[0].astype(int) - want[0])
        assert difference.max() <= 1
        assert (difference > 0).mean() < 0.005


def test_images_are_averaged_by_area_and_masks_by_majority(rng):
    image = rng.integers(0, 256, (6, 9, 3), np.uint8)
    fine = np.repeat(np.repeat(image, 4, 0), 4, 1).astype(float)  # 24 x 36 -> 4 x 4 by 6 x 9
    want = fine.reshape(4, 6, 4, 9, 3).mean(axis=(1, 3))
    assert np.abs(resample.resize_image(image, (4, 4)) - want).max() <= 0.5 + 1e-4
    mask = np.zeros((3, 4), np.bool_)
    mask[:, 0] = mask[0, 2] = True
    # New cells are 1.5 x 2 old ones. The left cells are half covered; the right ones 1/3 and 0.
    assert resample.resize_mask(mask, (2, 2)).tolist() == [[True, False], [True, False]]


def test_depth_is_never_averaged_and_holes_stay_holes(rng):
    mask = np.zeros((32, 48), np.bool_)
    mask[8:28, 10:40] = True
    depth = np.where(mask, rng.uniform(3, 4, mask.shape), 0).astype(np.float32)
    depth[12:20, 20:28] = 0  # wider than a new pixel
    depth[24, 14] = 0  # narrower than a new pixel
    depth[26:28, 30:34] = 0
    small = resample.resize_mask(mask, (16, 24))
    got = resample.resize_depth(depth, small)
    hole = np.zeros_like(small)
    hole[6:10, 10:14] = True
    hole[13, 15:17] = True
    np.testing.assert_array_equal(got > 0, small & ~hole)
    assert set(got[got > 0]) <= set(depth[depth > 0])

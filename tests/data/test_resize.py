import numpy as np

from psgn_jax.data import resize


def test_images_are_averaged_by_area_and_masks_by_majority(rng):
    image = rng.integers(0, 256, (6, 9, 3), np.uint8)
    fine = np.repeat(np.repeat(image, 4, 0), 4, 1).astype(float)  # 24 x 36 -> 4 x 4 by 6 x 9
    want = fine.reshape(4, 6, 4, 9, 3).mean(axis=(1, 3))
    assert np.abs(resize.resize_image(image, (4, 4)) - want).max() <= 0.5 + 1e-4
    mask = np.zeros((3, 4), np.bool_)
    mask[:, 0] = mask[0, 2] = True
    # New cells are 1.5 x 2 old ones. The left cells are half covered; the right ones 1/3 and 0.
    assert resize.resize_mask(mask, (2, 2)).tolist() == [[True, False], [True, False]]


def test_depth_is_never_averaged_and_holes_stay_holes(rng):
    mask = np.zeros((32, 48), np.bool_)
    mask[8:28, 10:40] = True
    depth = np.where(mask, rng.uniform(3, 4, mask.shape), 0).astype(np.float32)
    depth[12:20, 20:28] = 0  # wider than a new pixel
    depth[24, 14] = np.nan  # narrower than a new pixel
    depth[26:28, 30:34] = np.inf
    small = resize.resize_mask(mask, (16, 24))
    got = resize.resize_depth(depth, small)
    assert np.isfinite(got).all()
    hole = np.zeros_like(small)
    hole[6:10, 10:14] = True
    hole[13, 15:17] = True
    np.testing.assert_array_equal(got > 0, small & ~hole)
    assert set(got[got > 0]) <= set(depth[np.isfinite(depth) & (depth > 0)])

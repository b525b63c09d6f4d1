import numpy as np

from psgn_jax.data import camera


def test_inside_mask():
    mask = np.zeros((10, 12), np.bool_)
    mask[4, 5] = True
    pixels = [[5, 4], [5.99, 4.99], [6, 4.5], [4.99, 4.5], [7.9, 6.9], [8.1, 4.5], [np.nan, 4]]
    pixels = np.array(pixels)
    assert camera.inside_mask(pixels, mask).tolist() == [True, True] + [False] * 5
    assert camera.inside_mask(pixels, mask, 2).tolist() == [True] * 5 + [False] * 2
    outside = np.array([[-1e30, 4.5], [1e30, 4.5], [5.5, -np.inf]])
    assert not camera.inside_mask(outside, np.ones_like(mask), 2).any()

import numpy as np
from scipy.spatial.transform import Rotation

from psgn_jax.data import camera, schema


def test_default_camera_is_the_authors(rng):
    """The formulas of their data: tilt, 400 px, distance 3.6, 0.252 down."""
    intrinsics, extrinsics = camera.default_camera()
    schema.check_camera(intrinsics, extrinsics)
    points = rng.uniform(-1, 1, (50, 3))
    tilt = Rotation.from_euler("y", -20, degrees=True).as_matrix()
    q = np.stack([-points[:, 2], points[:, 1], points[:, 0]], axis=1) @ tilt
    pixels, depth = camera.project(points, intrinsics, extrinsics)
    np.testing.assert_allclose(depth, 3.6 - q[:, 2], atol=1e-6)
    np.testing.assert_allclose(pixels[:, 0], 128 + 400 * q[:, 1] / depth, atol=1e-4)
    np.testing.assert_allclose(pixels[:, 1], 96 + 400 * (q[:, 0] + 0.252) / depth, atol=1e-4)


def test_inside_mask():
    mask = np.zeros((10, 12), np.bool_)
    mask[4, 5] = True
    pixels = [[5, 4], [5.99, 4.99], [6, 4.5], [4.99, 4.5], [7.9, 6.9], [8.1, 4.5], [np.nan, 4]]
    pixels = np.array(pixels)
    assert camera.inside_mask(pixels, mask).tolist() == [True, True] + [False] * 5
    assert camera.inside_mask(pixels, mask, 2).tolist() == [True] * 5 + [False] * 2
    outside = np.array([[-1e30, 4.5], [1e30, 4.5], [5.5, -np.inf]])
    assert not camera.inside_mask(outside, np.ones_like(mask), 2).any()

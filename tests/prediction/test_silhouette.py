import jax
import numpy as np
import pytest
from scipy.spatial import cKDTree

from psgn_jax.data import camera
from psgn_jax.prediction.silhouette import into_silhouette

SIZE = (48, 64)
INTRINSICS, EXTRINSICS = camera.default_camera(SIZE)


@pytest.fixture
def mask():
    mask = np.zeros(SIZE, bool)
    mask[10:30, 20:40] = mask[25:28, 40:60] = True
    mask[15:20, 25:30] = False
    return mask


def moved(points, mask):
    return np.asarray(jax.jit(into_silhouette)(points, mask, INTRINSICS, EXTRINSICS))


def test_points_outside_move_at_their_depth_to_the_nearest_pixel(mask):
    points = np.random.default_rng(0).uniform(-0.4, 0.4, (500, 3)).astype("f4")
    points[..., 2] += 0.3
    result = moved(points, mask)
    before, depth = camera.project(points, INTRINSICS, EXTRINSICS)
    after, depth_after = camera.project(result, INTRINSICS, EXTRINSICS)
    inside = camera.inside_mask(before, mask)
    assert 250 < inside.sum() < 450
    np.testing.assert_array_equal(result[inside], points[inside])
    np.testing.assert_allclose(depth_after, depth, atol=1e-5)
    assert camera.inside_mask(after, mask).all()
    # The distance between pixels is exact; within its pixel, a point is nearest to where it was.
    tree = cKDTree(np.argwhere(mask)[:, ::-1])
    expected, _ = tree.query(np.floor(before[~inside]))
    cells = np.floor(after[~inside]) - np.floor(before[~inside])
    np.testing.assert_allclose(np.hypot(*cells.T), expected, atol=1e-6)
    assert (np.abs(after - before)[~inside] <= np.abs(cells) + 1).all()


@pytest.mark.parametrize("outside", [9, 11])
def test_a_limit_of_a_tenth(mask, outside):
    rng = np.random.default_rng(2)
    points = rng.uniform(-0.4, 0.4, (2000, 3)).astype("f4") + np.float32([0, 0, 0.3])
    pixels, _ = camera.project(points, INTRINSICS, EXTRINSICS)
    inside = camera.inside_mask(pixels, mask)
    points = np.concatenate([points[~inside][:outside], points[inside][: 100 - outside]])
    result = np.asarray(into_silhouette(points, mask, INTRINSICS, EXTRINSICS, 0.1))
    assert (result != points).any(axis=1).sum() == (outside if outside < 10 else 0)


def test_nothing_moves_if_the_mask_or_the_camera_is_wrong(mask):
    points = np.random.default_rng(1).uniform(-1, 1, (50, 3)).astype("f4")
    np.testing.assert_array_equal(moved(points, np.zeros_like(mask)), points)
    corner = np.zeros_like(mask)
    corner[0, 0] = True
    np.testing.assert_array_equal(moved(points, corner), points)
    behind = points + np.array([9, 0, 4], "f4")
    np.testing.assert_array_equal(moved(behind, mask), behind)

import jax
import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import cKDTree

from psgn_jax.data import camera
from psgn_jax.prediction import silhouette

SIZE = (96, 128)
VIEW = camera.default_camera(SIZE)
fit = jax.jit(silhouette.fit, static_argnames="placed")


@pytest.fixture
def mask():
    mask = np.zeros(SIZE, bool)
    mask[30:70, 40:80] = mask[62:66, 80:110] = True
    mask[40:50, 50:60] = False
    return mask


def cloud(rng, count=400):
    """Points of a ball in front of the mask."""
    points = rng.normal(size=(count, 3)).astype(np.float32)
    points /= np.linalg.norm(points, axis=1, keepdims=True) / 0.35
    return points + np.float32([0, -0.05, 0.25])


def distances(points, mask, view=VIEW):
    """Of each pixel of the mask to the nearest point, and of each point to the mask."""
    pixels, depth = camera.project(points, *view)
    inside = np.argwhere(mask)[:, ::-1] + 0.5
    return cKDTree(pixels).query(inside)[0], cKDTree(inside).query(pixels)[0], depth


def test_nearest_pixels_are_those_of_the_distance_transform(rng):
    for share in (0.001, 0.1):
        mask = rng.random((37, 53)) < share
        mask[5, 7] = True
        row, column = np.divmod(np.asarray(jax.jit(silhouette.nearest_pixels)(mask)), 53)
        assert mask[row, column].all()
        rows, columns = np.indices(mask.shape)
        expected = ndimage.distance_transform_edt(~mask)
        np.testing.assert_allclose(np.hypot(row - rows, column - columns), expected, atol=1e-5)


def test_a_fitted_cloud_covers_the_mask_and_nothing_else(rng, mask):
    points = cloud(rng)
    before = distances(points, mask)
    result = np.asarray(fit(points[None], mask, *VIEW).points[0])
    after = distances(result, mask)
    assert before[0].max() > 25  # the bar at the right was empty
    assert after[0].max() < 6
    assert (before[1] > 1).mean() > 0.05
    assert after[1].max() < 1
    # Depths stay within those of the cloud.
    assert after[2].min() >= before[2].min() - 1e-5
    assert after[2].max() <= before[2].max() + 1e-5


def test_programs_that_enable_64_bits_fit_clouds_too(rng, mask):
    points = cloud(rng)[None]
    want = fit(points, mask, *VIEW).points
    with jax.enable_x64(True):
        np.testing.assert_allclose(fit(points, mask, *VIEW).points, want, atol=1e-4)


def test_points_that_stand_apart_in_depth_join_their_neighbours(rng, mask):
    points = cloud(rng)
    ray = points[0] - -VIEW[1][:, :3].T @ VIEW[1][:, 3]
    apart = points.copy()
    apart[0] += 0.3 * ray  # far behind the others, on the same pixel
    depth = distances(np.asarray(fit(apart[None], mask, *VIEW).points[0]), mask)[2]
    others = distances(points, mask)[2]
    assert distances(apart, mask)[2][0] > others.max() + 0.3
    assert depth[0] <= others.max() + 1e-4


def test_a_cloud_stays_if_the_mask_or_the_camera_is_wrong(rng, mask):
    points = cloud(rng)
    behind = points + np.float32([9, 0, 4])
    aside = points + np.float32([0, 0.8, 0])
    for case, where in ((points, np.zeros_like(mask)), (behind, mask), (aside, mask)):
        np.testing.assert_array_equal(fit(case[None], where, *VIEW).points[0], case)


@pytest.mark.parametrize("elevation", [0, 10, 40])
def test_the_camera_of_a_photo_is_found(rng, elevation):
    # A flat box: its height in the image depends on the elevation.
    points = rng.uniform(-1, 1, (3000, 3)).astype(np.float32) * np.float32([0.5, 0.4, 0.04])
    seen = camera.default_camera(SIZE, tilt_degrees=elevation)
    pixels, _ = camera.project(points * np.float32(1.1), *seen)
    mask = np.zeros(SIZE, bool)
    mask[tuple(pixels.astype(int).T[::-1])] = True
    mask = ndimage.binary_closing(mask, iterations=2)
    found = fit(points[None, :1024], mask, *VIEW, placed=True)
    np.testing.assert_allclose(np.rad2deg(np.arcsin(-found.extrinsics[2, 2])), elevation, atol=0.1)
    assert distances(points, mask, (VIEW[0], np.asarray(found.extrinsics)))[1].mean() < 0.7


def test_a_large_mask_is_fitted_at_a_smaller_size(rng, mask):
    points = cloud(rng)
    large = mask.repeat(2, axis=0).repeat(2, axis=1)
    found = fit(points[None], large, *camera.default_camera((192, 256))).points
    np.testing.assert_allclose(found, fit(points[None], mask, *VIEW).points, atol=1e-5)


def test_thin_parts_of_a_placed_photo_become_thin(rng):
    # A pole seen as two pixels wide, which the network predicts as a slab along the ray.
    mask = np.zeros(SIZE, bool)
    mask[20:70, 63:65] = True
    points = rng.uniform((-0.3, -0.02, 0), (0.3, 0.02, 0.8), (600, 3)).astype(np.float32)
    kept, placed = (fit(points[None], mask, *VIEW, placed=p).points[0] for p in (False, True))
    kept, placed = (distances(np.asarray(x), mask)[2].std() for x in (kept, placed))
    assert placed < kept / 2

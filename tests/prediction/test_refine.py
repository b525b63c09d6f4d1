"""Clouds averaged with those of the mirror image, and moved into the mask."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import cKDTree

from psgn_jax.data import camera
from psgn_jax.losses.emd import emd_exact
from psgn_jax.prediction.refine import into_silhouette, refined

SIZE = (48, 64)
INTRINSICS, EXTRINSICS = camera.default_camera(SIZE)
MIRROR = np.array([1, -1, 1], np.float32)
move = jax.jit(into_silhouette)


@pytest.fixture
def batch(rng):
    mask = np.zeros((2, *SIZE), bool)
    mask[:, 10:40, 15:45] = True
    return {
        "image": rng.integers(0, 255, (2, *SIZE, 3)).astype(np.uint8),
        "mask": mask,
        "intrinsics": np.stack([INTRINSICS] * 2),
        "extrinsics": np.stack([EXTRINSICS] * 2),
    }


@jax.jit
def predict(batch, r):
    """A cloud that depends on where the image is bright; one for each row of r."""
    columns = batch["image"].astype(jnp.float32).mean(axis=(1, 3))[:, :40, None] / 255
    cloud = jnp.sin(columns * jnp.array([[[1.0, 2.0, 3.0]]]) * 9) * 0.3
    return cloud if r is None else cloud[:, None] + r[..., None]


def test_a_mirrored_image_has_the_mirrored_cloud(batch):
    flipped = {**batch, "image": batch["image"][:, :, ::-1], "mask": batch["mask"][:, :, ::-1]}
    run = jax.jit(lambda batch: refined(predict, batch, None))
    one, other = np.asarray(run(batch)), np.asarray(run(flipped)) * MIRROR
    plain, back = np.asarray(predict(batch, None)), np.asarray(predict(flipped, None)) * MIRROR
    for i in range(2):
        assert emd_exact(one[i], other[i]).cost / 40 < 1e-3
        middle = (plain[i] + back[i][emd_exact(plain[i], back[i]).index]) / 2
        want = np.asarray(move(middle, *(x[i] for x in cameras(batch))))
        assert emd_exact(one[i], want).cost / 40 < 1e-3


def cameras(batch):
    return batch["mask"], batch["intrinsics"], batch["extrinsics"]


def test_samples_of_a_random_input_are_not_averaged(batch, rng):
    r = (rng.normal(size=(2, 3, 1)) * 0.05).astype(np.float32)
    found = jax.jit(lambda batch, r: refined(predict, batch, r))(batch, r)
    plain = np.asarray(predict(batch, r))
    assert found.shape == (2, 3, 40, 3)
    for i in range(2):
        for k in range(3):
            want = move(plain[i, k], *(x[i] for x in cameras(batch)))
            np.testing.assert_allclose(found[i, k], want, atol=1e-6)


@pytest.fixture
def mask():
    mask = np.zeros(SIZE, bool)
    mask[10:30, 20:40] = mask[25:28, 40:60] = True
    mask[15:20, 25:30] = False
    return mask


def moved(points, mask):
    return np.asarray(move(points, mask, INTRINSICS, EXTRINSICS))


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


def test_nothing_moves_if_the_mask_or_the_camera_is_wrong(mask):
    points = np.random.default_rng(1).uniform(-1, 1, (500, 3)).astype("f4")
    np.testing.assert_array_equal(moved(points, np.zeros_like(mask)), points)
    behind = points + np.array([9, 0, 4], "f4")
    np.testing.assert_array_equal(moved(behind, mask), behind)

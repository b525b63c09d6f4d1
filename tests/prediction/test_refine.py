"""Clouds averaged with those of the mirror image, and fitted to the mask."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from psgn_jax.data import camera
from psgn_jax.losses.emd import emd_exact
from psgn_jax.prediction.refine import refined
from psgn_jax.prediction.silhouette import fit

SIZE = (48, 64)
INTRINSICS, EXTRINSICS = camera.default_camera(SIZE)
MIRROR = np.array([1, -1, 1], np.float32)
fitted = jax.jit(lambda *case: fit(*case).points)


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
    batch["mask"][:] = False  # so that the clouds are not fitted
    flipped = {**batch, "image": batch["image"][:, :, ::-1], "mask": batch["mask"][:, :, ::-1]}
    run = jax.jit(lambda batch: refined(predict, batch, None).points)
    one, other = np.asarray(run(batch)), np.asarray(run(flipped)) * MIRROR
    plain, back = np.asarray(predict(batch, None)), np.asarray(predict(flipped, None)) * MIRROR
    for i in range(2):
        assert emd_exact(one[i], other[i]).cost / 40 < 1e-3
        middle = (plain[i] + back[i][emd_exact(plain[i], back[i]).index]) / 2
        assert emd_exact(one[i], middle).cost / 40 < 1e-3


def cameras(batch):
    return batch["mask"], batch["intrinsics"], batch["extrinsics"]


def test_samples_of_a_random_input_are_not_averaged(batch, rng):
    r = (rng.normal(size=(2, 3, 1)) * 0.05).astype(np.float32)
    found = jax.jit(lambda batch, r: refined(predict, batch, r).points)(batch, r)
    plain = np.asarray(predict(batch, r))
    assert found.shape == (2, 3, 40, 3)
    for i in range(2):
        want = fitted(plain[i], *(x[i] for x in cameras(batch)))
        np.testing.assert_allclose(found[i], want, atol=1e-6)

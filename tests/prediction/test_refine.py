import jax
import jax.numpy as jnp
import numpy as np
import pytest

from psgn_jax.data import camera
from psgn_jax.losses.emd import emd_exact
from psgn_jax.models import networks
from psgn_jax.prediction.refine import predicted
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


def predict(config, model, params, batch, r):
    """Three clouds of each image, which depend on where it is bright."""
    columns = batch["image"].astype(jnp.float32).mean(axis=(1, 3))[:, :40, None] / 255
    cloud = jnp.sin(columns * jnp.array([[[1.0, 2.0, 3.0]]]) * 9) * 0.3
    return jnp.stack([cloud, 0.9 * cloud, cloud + 0.1], axis=1)


@pytest.fixture
def refine(monkeypatch):
    """The refined clouds of a batch [2, 3, 40, 3], and those of the network."""
    monkeypatch.setattr(networks, "predict", predict)

    @jax.jit
    def run(batch):
        fitted, clouds = predicted(None, None, None, batch, jnp.zeros((2, 3, 1)), samples=3)
        return fitted.points, clouds

    return lambda batch: map(np.asarray, run(batch))


def test_a_mirrored_image_has_the_mirrored_cloud(batch, refine):
    batch["mask"][:] = False  # so that the clouds are not fitted
    flipped = {**batch, "image": batch["image"][:, :, ::-1], "mask": batch["mask"][:, :, ::-1]}
    one, plain = (clouds[:, 0] for clouds in refine(batch))
    other, back = (clouds[:, 0] * MIRROR for clouds in refine(flipped))
    for i in range(2):
        assert emd_exact(one[i], other[i]).cost / 40 < 1e-3
        middle = (plain[i] + back[i][emd_exact(plain[i], back[i]).index]) / 2
        assert emd_exact(one[i], middle).cost / 40 < 1e-3


def test_all_clouds_are_fitted_and_only_the_first_is_averaged(batch, refine):
    found, plain = refine(batch)
    for i in range(2):
        case = (batch[name][i] for name in ("mask", "intrinsics", "extrinsics"))
        want = fitted(plain[i], *case)
        np.testing.assert_allclose(found[i, 1:], want[1:], atol=1e-6)
        assert np.abs(found[i, 0] - want[0]).max() > 0.01

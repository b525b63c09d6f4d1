import jax
import jax.numpy as jnp
import numpy as np
import pytest

from psgn_jax.models.inputs import network_input


@pytest.fixture
def sample(rng):
    image = rng.integers(0, 256, (6, 8, 3), dtype=np.uint8)
    mask = rng.random((6, 8)) < 0.5
    depth = np.where(mask, rng.uniform(2.6, 4.6, (6, 8)), 0).astype(np.float32)
    return image, mask, depth


def test_rgb_and_background_mask(sample):
    image, mask, _ = sample
    x = np.asarray(network_input(image, mask, None, channels=("rgb", "mask")))
    assert x.shape == (6, 8, 4)
    assert x.dtype == np.float32
    np.testing.assert_allclose(x[mask][:, :3], image[mask] / 255, atol=1e-7)
    np.testing.assert_array_equal(x[~mask][:, :3], np.float32(191 / 255))
    np.testing.assert_array_equal(x[..., 3], ~mask)


def test_depth_is_the_authors_16_bits(sample):
    image, mask, _ = sample
    stored = np.arange(48, dtype=np.float32).reshape(6, 8) * 1000 + 1
    metric = 1.8 * (3 - 2 * stored / 65535)
    x = network_input(image, mask, metric, channels=("depth",))
    np.testing.assert_allclose(x[..., 0], np.where(mask, stored / 65535, 0), atol=1e-6)


def test_depth_not_measured_on_the_object_is_zero(sample):
    image, _, _ = sample
    x = network_input(
        image, np.ones((6, 8), bool), np.zeros((6, 8), np.float32), channels=("depth",)
    )
    assert not x.any()


def test_channels_keep_the_given_order(sample):
    x = network_input(*sample, channels=("rgb", "mask", "depth"))
    y = network_input(*sample, channels=("depth", "mask", "rgb"))
    assert x.shape[-1] == y.shape[-1] == 5
    np.testing.assert_array_equal(x, y[..., [2, 3, 4, 1, 0]])


def test_leading_axes_and_jit(sample):
    batch = [np.stack([np.stack([a, a[::-1]])] * 3) for a in sample]
    channels = ("rgb", "mask", "depth")
    x = jax.jit(lambda *a: network_input(*a, channels=channels))(*batch)
    assert x.shape == (3, 2, 6, 8, 5)
    np.testing.assert_allclose(x[2, 0], network_input(*sample, channels=channels), atol=1e-7)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"channels": ("rgb", "alpha")}, "channels=.*'rgb', 'mask', 'depth'"),
        ({"channels": ("rgb", "rgb")}, "each once"),
        ({"channels": ()}, "channels="),
        ({"image": np.zeros((6, 8, 3), np.float32)}, "uint8"),
        ({"image": np.zeros((6, 8, 4), np.uint8)}, "uint8 .*3"),
        ({"mask": np.zeros((6, 7), bool)}, "mask is bool .6, 7.*6, 8"),
        ({"mask": np.zeros((6, 8), np.uint8)}, "mask is uint8"),
        ({"depth": None}, "depth=None"),
        ({"depth": jnp.zeros((8, 6))}, "depth has the shape .8, 6.*6, 8"),
    ],
)
@pytest.mark.usefixtures("unchecked_annotations")
def test_wrong_arguments(sample, change, message):
    image, mask, depth = sample
    arrays = {"image": image, "mask": mask, "depth": depth}
    arguments = arrays | {"channels": ("rgb", "depth")} | change
    with pytest.raises(ValueError, match=message):
        network_input(**arguments)

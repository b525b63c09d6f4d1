import jax
import jax.numpy as jnp
import numpy as np
import pytest

from psgn_jax.models.cpu_convolution import conv3d
from psgn_jax.models.layers import Conv3D


def xla(x, kernel):
    return jax.lax.conv_general_dilated(
        x, kernel, (1, 1, 1), "SAME", dimension_numbers=("NDHWC", "DHWIO", "NDHWC")
    )


@pytest.mark.parametrize(
    ("shape", "size", "c_out"),
    [((2, 5, 6, 7, 3), 3, 4), ((1, 4, 4, 4, 20), 3, 18), ((2, 3, 4, 5, 2), 1, 3),
     ((1, 6, 5, 7, 1), 5, 2)],
)  # fmt: skip
def test_value_and_gradients_are_xlas(rng, shape, size, c_out):
    x = rng.normal(size=shape).astype(np.float32)
    kernel = rng.normal(size=(size, size, size, shape[-1], c_out)).astype(np.float32)
    pull = rng.normal(size=(*shape[:-1], c_out)).astype(np.float32)
    got, got_vjp = jax.vjp(conv3d, x, kernel)
    want, want_vjp = jax.vjp(xla, x, kernel)
    np.testing.assert_allclose(got, want, atol=1e-4)
    for a, b in zip(got_vjp(pull), want_vjp(pull), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-3)


def test_layer_adds_its_bias():
    layer = Conv3D(2, bias_init=lambda key, shape, dtype: jnp.array([1.0, 2.0], dtype))
    x = jnp.zeros((1, 3, 3, 3, 4))
    params = layer.init(jax.random.key(0), x)
    assert params["params"]["kernel"].shape == (3, 3, 3, 4, 2)
    np.testing.assert_array_equal(layer.apply(params, x)[0, 0, 0, 0], [1, 2])

"""Layers of the networks (convolution, transposed convolution, dense) and their initial values.

XLA computes the convolutions, or on a CPU `cpu_convolution`, which is faster and agrees up to
rounding. If you copy a network, leave it out. Every layer has float32 parameters named `kernel` and
`bias`, and computes in `dtype`.

Initial values (**ours**: the paper gives none). The networks have no normalisation layers, so the
initial kernels must keep the scale of the activations over some twenty layers (He et al. 2015,
"Delving deep into rectifiers", section 2.2):

- `RELU`: variance 2 / fan_in, for a layer followed by a ReLU.
- `SUMMED`: variance 1 / fan_in, for each of two linear layers whose sum goes through a ReLU.
- The fan-in of a transposed convolution of stride s is k * k * c_in / s^2: an output is a sum of so
  many products, because the other inputs are inserted zeros.
- Biases start at zero, except in the output layers (`cloud_bias`).
"""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from jax import lax

from psgn_jax.array_types import Array, Float, PRNGKey
from psgn_jax.models import cpu_convolution

Initializer = Callable[[PRNGKey, Sequence[int], Any], jax.Array]

RELU: Initializer = nn.initializers.variance_scaling(2.0, "fan_in", "truncated_normal")
SUMMED: Initializer = nn.initializers.variance_scaling(1.0, "fan_in", "truncated_normal")

Dense = functools.partial(nn.Dense, kernel_init=RELU, dtype=jnp.float32)

# Rounded mean and standard deviation of the ground-truth points in 384 samples of the authors'
# batches (mean -.002, .008, .324; standard deviations .33, .33, .26), in the project's frame.
CLOUD_CENTRE = (0.0, 0.0, 0.32)
CLOUD_SPREAD = 0.3

_LAYOUT: dict[int, Any] = {4: ("NHWC", "HWIO", "NHWC"), 5: ("NDHWC", "DHWIO", "NDHWC")}


def convolve(
    x: Float[Array, "b *size c_in"], kernel: Float[Array, "*taps c_in c_out"], stride: int = 1
) -> Float[Array, "b *out c_out"]:
    """Convolution (cross-correlation) of images or volumes, SAME padding of TensorFlow.

    The output has `ceil(size / stride)` cells along each axis.
    """
    if (y := cpu_convolution.convolve(x, kernel, stride)) is not None:
        return y
    strides, layout = (stride,) * (x.ndim - 2), _LAYOUT[x.ndim]
    return lax.conv_general_dilated(x, kernel, strides, "SAME", dimension_numbers=layout)


def convolve_transposed(
    x: Float[Array, "b h w c_in"], kernel: Float[Array, "kh kw c_in c_out"], stride: int = 2
) -> Float[Array, "b ho wo c_out"]:
    """Transposed convolution of images, SAME padding: the output is `stride` times as large."""
    if (y := cpu_convolution.convolve_transposed(x, kernel, stride)) is not None:
        return y
    return lax.conv_transpose(x, kernel, (stride,) * 2, "SAME", dimension_numbers=_LAYOUT[4])


class Conv(nn.Module):
    """`convolve(x, kernel, stride) + bias`."""

    features: int
    kernel_size: int = 3
    stride: int = 1
    kernel_init: Initializer = RELU
    bias_init: Initializer = nn.initializers.zeros_init()
    dtype: Any = jnp.float32
    ndim: int = 2

    @nn.compact
    def __call__(self, x: Float[Array, "b *size c_in"]) -> Float[Array, "b *out c_out"]:
        shape = (*(self.kernel_size,) * self.ndim, x.shape[-1], self.features)
        kernel = self.param("kernel", self.kernel_init, shape, jnp.float32)
        y = convolve(x.astype(self.dtype), kernel.astype(self.dtype), self.stride)
        return _add_bias(self, y)


Conv3D = functools.partial(Conv, ndim=3)  # for volumes


class ConvTranspose(nn.Module):
    """`convolve_transposed(x, kernel) + bias`, with a 5x5 kernel and stride 2."""

    features: int
    bias_init: Initializer = nn.initializers.zeros_init()
    dtype: Any = jnp.float32

    @nn.compact
    def __call__(self, x: Float[Array, "b h w c_in"]) -> Float[Array, "b ho wo c_out"]:
        def init(key: PRNGKey, shape: Sequence[int], dtype: Any) -> jax.Array:
            return 2 * SUMMED(key, shape, dtype)

        kernel = self.param("kernel", init, (5, 5, x.shape[-1], self.features), jnp.float32)
        y = convolve_transposed(x.astype(self.dtype), kernel.astype(self.dtype))
        return _add_bias(self, y)


def _add_bias(layer: Any, y: Array) -> Array:
    bias = layer.param("bias", layer.bias_init, (layer.features,), jnp.float32)
    return y + bias.astype(layer.dtype).reshape((1,) * (y.ndim - 1) + (-1,))


def cloud_bias(spread: float) -> Initializer:
    """Initial bias of an output layer: coordinates xyz, xyz, ... near the middle of an object.

    This is **ours**. A dense output layer has a bias for each point. We spread them with the
    standard deviation `spread` (units), so that most points soon are the nearest to some part of
    the surface. A convolution has one bias for all cells (spread 0) and a `grid_offset`.
    """

    def init(key: PRNGKey, shape: Sequence[int], dtype: Any = jnp.float32) -> jax.Array:
        (size,) = shape
        centre = jnp.tile(jnp.asarray(CLOUD_CENTRE, dtype), size // 3)
        return centre + spread * jax.random.normal(key, (size,), dtype)

    return init


def grid_offset(height: int, width: int, points_per_cell: int) -> np.ndarray:
    """Constant that the deconv branch adds to its linear output: [height, width, 3 * points].

    This is **ours**. The cells form a grid in the plane x = 0, oriented like the image, over +-.57
    units along y and +-.45 along z: uniform distributions with the standard deviations of the
    ground truth. Without the offset, all cells start near one point, because they have the same
    kernel and bias (`authors_small_cd.py` after 600 steps: CD .0150 without, .0135 with).
    """
    y = np.linspace(-1, 1, width) * np.sqrt(3) * 0.33
    z = np.linspace(1, -1, height) * np.sqrt(3) * 0.26
    offset = np.zeros((height, width, points_per_cell, 3), np.float32)
    offset[..., 1], offset[..., 2] = y[None, :, None], z[:, None, None]
    return offset.reshape(height, width, 3 * points_per_cell)


def small(spread: float) -> Initializer:
    """Initial kernel of a linear output layer that scales its inputs by about `spread`."""
    return nn.initializers.variance_scaling(spread**2, "fan_in", "truncated_normal")

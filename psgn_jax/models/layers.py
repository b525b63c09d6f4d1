"""Layers of the networks: convolution, transposed convolution, dense; and how they start.

Every layer keeps float32 parameters named `kernel` and `bias`, in the plain form of
`models.cpu_convolution`, and computes in its `dtype`: input, kernel and bias are cast to it.

Initial values (**ours**; the paper names none). The networks have no normalisation, so the size of
the activations must survive some twenty layers by the choice of variances alone (He et al. 2015,
"Delving deep into rectifiers", section 2.2):

- `RELU`: variance 2 / fan_in, for a layer followed by a ReLU.
- `SUMMED`: variance 1 / fan_in, for each of two linear layers whose sum goes through a ReLU (the
  skip connections): the sum then has the variance of one `RELU` layer.
- The fan-in of a transposed convolution of stride s is k * k * c_in / s^2: that many products add
  up in one output, the others fall on the zeros in between.
- Biases start at zero, those of the output layers at the middle of an object (`cloud_bias`); the
  points of a deconv branch start on a plane that faces the camera (`grid_offset`).
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn

from psgn_jax.models import cpu_convolution
from psgn_jax.types import Array, Float, PRNGKey

Initializer = Callable[[PRNGKey, Sequence[int], Any], jax.Array]

DTYPES = {"float32": jnp.float32, "bfloat16": jnp.bfloat16}
"""Of `model.compute_dtype`."""

RELU: Initializer = nn.initializers.variance_scaling(2.0, "fan_in", "truncated_normal")
SUMMED: Initializer = nn.initializers.variance_scaling(1.0, "fan_in", "truncated_normal")

# Middle of the ground-truth points over 384 samples of the authors' batches (mean -.002, .008,
# .324; standard deviations .33, .33, .26), in the project's frame and unit.
CLOUD_CENTRE = (0.0, 0.0, 0.32)
CLOUD_SPREAD = 0.3


class Conv(nn.Module):
    """`conv2d(x, kernel) + bias`, SAME padding.

    Attributes:
      features: output channels.
      kernel_size: side of the square kernel.
      stride: step in both directions; the output has `ceil(size / stride)` rows and columns.
      kernel_init, bias_init: initial values.
      dtype: of the arithmetic and the output.
    """

    features: int
    kernel_size: int = 3
    stride: int = 1
    kernel_init: Initializer = RELU
    bias_init: Initializer = nn.initializers.zeros_init()
    dtype: Any = jnp.float32

    @nn.compact
    def __call__(self, x: Float[Array, "b h w c_in"]) -> Float[Array, "b ho wo c_out"]:
        """Maps a batch of feature maps."""
        shape = (self.kernel_size, self.kernel_size, x.shape[-1], self.features)
        kernel = self.param("kernel", self.kernel_init, shape, jnp.float32)
        bias = self.param("bias", self.bias_init, (self.features,), jnp.float32)
        y = cpu_convolution.conv2d(
            x.astype(self.dtype), kernel.astype(self.dtype), stride=self.stride
        )
        return y + bias.astype(self.dtype)[None, None, None, :]


class Conv3D(nn.Module):
    """`conv3d(x, kernel, stride=stride) + bias`.

    Attributes:
      features: output channels.
      kernel_size: edge of the cubic kernel.
      stride: step in all directions.
      use_bias: whether to add one.
      kernel_init, bias_init: initial values.
      dtype: of the arithmetic and the output.
    """

    features: int
    kernel_size: int = 3
    stride: int = 1
    use_bias: bool = True
    kernel_init: Initializer = RELU
    bias_init: Initializer = nn.initializers.zeros_init()
    dtype: Any = jnp.float32

    @nn.compact
    def __call__(self, x: Float[Array, "b x y z c_in"]) -> Float[Array, "b xo yo zo c_out"]:
        """Maps a batch of volumes."""
        shape = (*(self.kernel_size,) * 3, x.shape[-1], self.features)
        kernel = self.param("kernel", self.kernel_init, shape, jnp.float32)
        y = cpu_convolution.conv3d(
            x.astype(self.dtype), kernel.astype(self.dtype), stride=self.stride
        )
        if self.use_bias:
            bias = self.param("bias", self.bias_init, (self.features,), jnp.float32)
            y = y + bias.astype(self.dtype)[None, None, None, None, :]
        return y


class ConvTranspose(nn.Module):
    """`conv2d_transpose(x, kernel) + bias`, SAME padding: the output is `stride` times as large.

    Attributes:
      features: output channels.
      kernel_size: side of the square kernel.
      stride: factor of both sizes.
      kernel_init: initial values; their variance is multiplied by stride^2 (see the module).
      dtype: of the arithmetic and the output.
    """

    features: int
    kernel_size: int = 5
    stride: int = 2
    kernel_init: Initializer = SUMMED
    dtype: Any = jnp.float32

    @nn.compact
    def __call__(self, x: Float[Array, "b h w c_in"]) -> Float[Array, "b ho wo c_out"]:
        """Maps a batch of feature maps."""

        def init(key: PRNGKey, shape: Sequence[int], dtype: Any) -> jax.Array:
            return self.stride * self.kernel_init(key, shape, dtype)

        shape = (self.kernel_size, self.kernel_size, x.shape[-1], self.features)
        kernel = self.param("kernel", init, shape, jnp.float32)
        bias = self.param("bias", nn.initializers.zeros_init(), (self.features,), jnp.float32)
        y = cpu_convolution.conv2d_transpose(
            x.astype(self.dtype), kernel.astype(self.dtype), stride=self.stride
        )
        return y + bias.astype(self.dtype)[None, None, None, :]


class Dense(nn.Module):
    """`x @ kernel + bias`.

    Attributes:
      features: size of the output.
      use_bias: whether to add one.
      kernel_init, bias_init: initial values.
      dtype: of the arithmetic and the output.
    """

    features: int
    use_bias: bool = True
    kernel_init: Initializer = RELU
    bias_init: Initializer = nn.initializers.zeros_init()
    dtype: Any = jnp.float32

    @nn.compact
    def __call__(self, x: Float[Array, "b n_in"]) -> Float[Array, "b n_out"]:
        """Maps a batch of vectors."""
        shape = (x.shape[-1], self.features)
        kernel = self.param("kernel", self.kernel_init, shape, jnp.float32)
        y = x.astype(self.dtype) @ kernel.astype(self.dtype)
        if self.use_bias:
            bias = self.param("bias", self.bias_init, (self.features,), jnp.float32)
            y = y + bias.astype(self.dtype)[None, :]
        return y


def cloud_bias(spread: float) -> Initializer:
    """Bias of an output layer: xyz, xyz, ... around the middle of an object (**ours**).

    Args:
      spread: standard deviation of each coordinate in units. A fully connected output has a bias
        of its own for each point, so its cloud can start spread over the object, where most points
        are soon the nearest of some part of the surface; the bias of a convolution is shared by all
        cells, so it is given no spread; `grid_offset` takes its place.
    """

    def init(key: PRNGKey, shape: Sequence[int], dtype: Any = jnp.float32) -> jax.Array:
        (size,) = shape
        centre = jnp.tile(jnp.asarray(CLOUD_CENTRE, dtype), size // 3)
        return centre + spread * jax.random.normal(key, (size,), dtype)

    return init


def grid_offset(height: int, width: int, points_per_cell: int) -> np.ndarray:
    """What the deconv branch adds to its linear output (**ours**): [height, width, 3 * points].

    A constant: the grid laid over the middle of an object like the image that the network sees,
    y from left to right, z from top to bottom, x = 0; along both as wide as a uniform distribution
    with the standard deviation of the ground truth, +-.57 and +-.45 units.

    Without it all cells start at one point: they share kernel and bias, and those on the background
    see the same features. Short trainings then leave most of them in a knot (`authors_small.py`
    after 600 steps: CD .0150 without, .0135 with).
    """
    y = np.linspace(-1, 1, width) * np.sqrt(3) * 0.33
    z = np.linspace(1, -1, height) * np.sqrt(3) * 0.26
    offset = np.zeros((height, width, points_per_cell, 3), np.float32)
    offset[..., 1], offset[..., 2] = y[None, :, None], z[:, None, None]
    return offset.reshape(height, width, 3 * points_per_cell)


def small(spread: float) -> Initializer:
    """Kernel of a linear output layer: outputs of about `spread` times the size of the input."""
    return nn.initializers.variance_scaling(spread**2, "fan_in", "truncated_normal")

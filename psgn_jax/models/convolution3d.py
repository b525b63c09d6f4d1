"""Convolution of volumes, as a pure function and as a layer.

On a GPU or TPU it is XLA's convolution. On a CPU XLA's routine for three dimensions is some ten
times slower than its two-dimensional one, so there a volume is a batch of slices: three
neighbouring slices side by side are the channels of one `convolution.conv2d`, with that function's
gradients. CPU seconds for two volumes of 32^3, 3x3x3, value and then value with both gradients
(`tests/bench/convolution3d.py`): 16 to 16 channels .017 and .094 instead of .27 and .96; 1 to 16
.025 and .045 instead of .10 and .34. Four of 32^3, 16 to 1: .027 and .12 instead of .56 and 1.41;
four of 8^3, 128 to 128: .026 and .077 instead of .064 and .29. To put the three depths beside each
other in the output channels instead is faster forward at 32^3 and mostly slower backward.
"""

from typing import Any

import jax
import jax.numpy as jnp
from flax import linen as nn

from psgn_jax.models import blocks, convolution
from psgn_jax.types import Array, Float

_LAYOUT = ("NDHWC", "DHWIO", "NDHWC")


def conv3d(
    x: Float[Array, "b x y z c_in"], kernel: Float[Array, "kx ky kz c_in c_out"]
) -> Float[Array, "b x y z c_out"]:
    """Convolution (correlation) of stride 1 without bias; zeros outside, the size is kept.

    Args:
      x: a batch of volumes.
      kernel: the weights, of odd sizes.
    """
    if jax.default_backend() != "cpu":
        return jax.lax.conv_general_dilated(x, kernel, (1, 1, 1), "SAME", dimension_numbers=_LAYOUT)
    b, n, height, width, c_in = x.shape
    depth, kh, kw, _, c_out = kernel.shape
    reach = depth // 2
    padded = jnp.pad(x, ((0, 0), (reach, reach), (0, 0), (0, 0), (0, 0)))
    slices = jnp.concatenate([padded[:, i : i + n] for i in range(depth)], axis=-1)
    flat = kernel.transpose(1, 2, 0, 3, 4).reshape(kh, kw, depth * c_in, c_out)
    y = convolution.conv2d(slices.reshape(b * n, height, width, depth * c_in), flat)
    return y.reshape(b, n, height, width, c_out)


class Conv3D(nn.Module):
    """`conv3d(x, kernel) + bias`.

    Attributes:
      features: output channels.
      kernel_size: edge of the cubic kernel, odd.
      use_bias: whether to add one.
      kernel_init, bias_init: initial values.
      dtype: of the arithmetic and the output.
    """

    features: int
    kernel_size: int = 3
    use_bias: bool = True
    kernel_init: blocks.Initializer = blocks.RELU
    bias_init: blocks.Initializer = nn.initializers.zeros_init()
    dtype: Any = jnp.float32

    @nn.compact
    def __call__(self, x: Float[Array, "b x y z c_in"]) -> Float[Array, "b x y z c_out"]:
        """Maps a batch of volumes."""
        shape = (*(self.kernel_size,) * 3, x.shape[-1], self.features)
        kernel = self.param("kernel", self.kernel_init, shape, jnp.float32)
        y = conv3d(x.astype(self.dtype), kernel.astype(self.dtype))
        if self.use_bias:
            bias = self.param("bias", self.bias_init, (self.features,), jnp.float32)
            y = y + bias.astype(self.dtype)[None, None, None, None, :]
        return y

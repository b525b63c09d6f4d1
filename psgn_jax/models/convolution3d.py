"""Convolution of volumes, as a pure function and as a layer.

On a GPU or TPU it is XLA's convolution. On a CPU XLA's routine for three dimensions is some ten
times slower than its two-dimensional one, so there a volume is a batch of slices: the
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
    x: Float[Array, "b x y z c_in"], kernel: Float[Array, "kx ky kz c_in c_out"], *, stride: int = 1
) -> Float[Array, "b xo yo zo c_out"]:
    """Convolution (correlation) of volumes without bias, SAME padding as in `convolution.conv2d`.

    Args:
      x: a batch of volumes.
      kernel: the weights.
      stride: step in all directions.
    """
    if jax.default_backend() != "cpu":
        return jax.lax.conv_general_dilated(
            x, kernel, (stride,) * 3, "SAME", dimension_numbers=_LAYOUT
        )
    b, depth, height, width, c_in = x.shape
    kd, kh, kw, _, c_out = kernel.shape
    planes = -(-depth // stride)
    total = max(0, (planes - 1) * stride + kd - depth)
    low = total // 2
    x = jnp.pad(x, ((0, 0), (low, total - low), (0, 0), (0, 0), (0, 0)))
    shifted = [x[:, tap : tap + (planes - 1) * stride + 1 : stride] for tap in range(kd)]
    slices = jnp.concatenate(shifted, axis=-1).reshape(-1, height, width, kd * c_in)
    flat = kernel.transpose(1, 2, 0, 3, 4).reshape(kh, kw, kd * c_in, c_out)
    y = convolution.conv2d(slices, flat, stride=stride)
    return y.reshape(b, planes, *y.shape[1:])


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
    kernel_init: blocks.Initializer = blocks.RELU
    bias_init: blocks.Initializer = nn.initializers.zeros_init()
    dtype: Any = jnp.float32

    @nn.compact
    def __call__(self, x: Float[Array, "b x y z c_in"]) -> Float[Array, "b xo yo zo c_out"]:
        """Maps a batch of volumes."""
        shape = (*(self.kernel_size,) * 3, x.shape[-1], self.features)
        kernel = self.param("kernel", self.kernel_init, shape, jnp.float32)
        y = conv3d(x.astype(self.dtype), kernel.astype(self.dtype), stride=self.stride)
        if self.use_bias:
            bias = self.param("bias", self.bias_init, (self.features,), jnp.float32)
            y = y + bias.astype(self.dtype)[None, None, None, None, :]
        return y

"""The two linear maps that the networks consist of, as pure functions.

Kernels have the plain form `[kh, kw, c_in, c_out]` whatever formulation computes the map, so that
checkpoints do not depend on it. Arithmetic happens in the dtype of the arguments.
"""

import jax

from psgn_jax.types import Array, Float

_LAYOUT = ("NHWC", "HWIO", "NHWC")


def conv2d(
    x: Float[Array, "b h w c_in"], kernel: Float[Array, "kh kw c_in c_out"], *, stride: int = 1
) -> Float[Array, "b ho wo c_out"]:
    """Convolution (correlation) without bias, TensorFlow's SAME padding: `ho = ceil(h / stride)`.

    Args:
      x: a batch of feature maps.
      kernel: the weights.
      stride: step in both directions.
    """
    return jax.lax.conv_general_dilated(
        x, kernel, (stride, stride), "SAME", dimension_numbers=_LAYOUT
    )


def conv2d_transpose(
    x: Float[Array, "b h w c_in"], kernel: Float[Array, "kh kw c_in c_out"], *, stride: int = 2
) -> Float[Array, "b ho wo c_out"]:
    """Transposed convolution without bias, the map of `jax.lax.conv_transpose(..., "SAME")`.

    Args:
      x: a batch of feature maps.
      kernel: the weights, in the orientation of `conv2d` (no swapped channels).
      stride: `ho = stride * h`.
    """
    return jax.lax.conv_transpose(
        x, kernel, (stride, stride), "SAME", dimension_numbers=_LAYOUT
    )

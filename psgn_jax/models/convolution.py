"""Convolutions of batches as pure functions; kernels have the axes [..., c_in, c_out].

They are XLA's, unless `cpu_convolution` has a faster way on a CPU; results agree up to rounding, so
that checkpoints do not depend on what computes. Who copies a network leaves out `cpu_convolution`.
"""

from typing import Any

from jax import lax

from psgn_jax.array_types import Array, Float
from psgn_jax.models import cpu_convolution

_LAYOUT: dict[int, Any] = {4: ("NHWC", "HWIO", "NHWC"), 5: ("NDHWC", "DHWIO", "NDHWC")}


def convolve(
    x: Float[Array, "b *size c_in"], kernel: Float[Array, "*taps c_in c_out"], stride: int = 1
) -> Float[Array, "b *out c_out"]:
    """Convolution (cross-correlation) of images or volumes, SAME padding of TensorFlow.

    The output has `ceil(size / stride)` cells along each axis.
    """
    if (y := cpu_convolution.convolve(x, kernel, stride, transposed=False)) is not None:
        return y
    strides, layout = (stride,) * (x.ndim - 2), _LAYOUT[x.ndim]
    return lax.conv_general_dilated(x, kernel, strides, "SAME", dimension_numbers=layout)


def convolve_transposed(
    x: Float[Array, "b h w c_in"], kernel: Float[Array, "kh kw c_in c_out"], stride: int = 2
) -> Float[Array, "b ho wo c_out"]:
    """Transposed convolution of images, SAME padding: the output is `stride` times as large."""
    if (y := cpu_convolution.convolve(x, kernel, stride, transposed=True)) is not None:
        return y
    return lax.conv_transpose(x, kernel, (stride,) * 2, "SAME", dimension_numbers=_LAYOUT[4])


def convolve_depthwise(
    x: Float[Array, "b h w c"], kernel: Float[Array, "kh kw 1 c"], stride: int = 1
) -> Float[Array, "b ho wo c"]:
    """Convolution of each channel by itself, SAME padding of TensorFlow."""
    if (y := cpu_convolution.convolve(x, kernel, stride, transposed=False)) is not None:
        return y
    groups, strides = x.shape[-1], (stride,) * 2
    return lax.conv_general_dilated(
        x, kernel, strides, "SAME", dimension_numbers=_LAYOUT[4], feature_group_count=groups
    )

"""The two linear maps that the networks consist of, as pure functions.

Kernels have the plain form `[kh, kw, c_in, c_out]` whatever formulation computes the map, so that
checkpoints do not depend on it. Arithmetic happens in the dtype of the arguments.

On a CPU, XLA's convolutions are fast at stride 1 and many times slower where they contain a
dilation: in a transposed convolution and in the gradients of a strided one. There the same maps are
computed by a convolution of stride 1 between pixels gathered into channels (`_space_to_depth`).
"""

import jax
import jax.numpy as jnp

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
    if stride > 1 and kernel.shape[0] > 3 and jax.default_backend() == "cpu":
        return _conv_by_space_to_depth(x, kernel, stride)
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
    if jax.default_backend() == "cpu":
        return _conv_transpose_by_depth_to_space(x, kernel, stride)
    return jax.lax.conv_transpose(x, kernel, (stride, stride), "SAME", dimension_numbers=_LAYOUT)


def _conv_by_space_to_depth(x: Array, kernel: Array, stride: int) -> Array:
    """Strided convolution as one of stride 1 on an image of `stride^2` times the channels.

    Tap t of output o reads pixel `stride * o + t - low`: pixel r of cell o + d, where
    `t - low = stride * d + r`.
    """
    size = x.shape[1:3]
    taps = kernel.shape[:2]
    low, cells = [], []
    for n, k in zip(size, taps, strict=True):
        out = -(-n // stride)
        low.append(max(0, (out - 1) * stride + k - n) // 2)
        cells.append(out)
    # The cells that the taps reach: from -before to after, relative to the output's.
    before = [-(-a // stride) for a in low]
    after = [(k - 1 - a) // stride for k, a in zip(taps, low, strict=True)]
    # A tap of the first cell that a kernel does not use is a row of zeros in front.
    front = [stride * b - a for b, a in zip(before, low, strict=True)]
    reach = [b + a + 1 for b, a in zip(before, after, strict=True)]
    kernel = jnp.pad(
        kernel,
        [(f, stride * n - f - k) for f, n, k in zip(front, reach, taps, strict=True)]
        + [(0, 0), (0, 0)],
    )
    kernel = kernel.reshape(reach[0], stride, reach[1], stride, *kernel.shape[2:])
    kernel = kernel.transpose(0, 2, 1, 3, 4, 5).reshape(*reach, -1, kernel.shape[-1])
    x = jnp.pad(
        x,
        [(0, 0), *((0, stride * c - n) for c, n in zip(cells, size, strict=True)), (0, 0)],
    )
    return jax.lax.conv_general_dilated(
        _space_to_depth(x, stride),
        kernel,
        (1, 1),
        list(zip(before, after, strict=True)),
        dimension_numbers=_LAYOUT,
    )


def _conv_transpose_by_depth_to_space(x: Array, kernel: Array, stride: int) -> Array:
    """Transposed convolution as one of stride 1 that computes the `stride^2` pixels of each cell.

    Pixel r of cell q reads input q + d through tap `t = stride * d - r + low`.
    """
    taps = kernel.shape[:2]
    # As `jax.lax.conv_transpose` pads for SAME.
    low = [k - 1 if stride > k - 1 else -(-(k + stride - 2) // 2) for k in taps]
    before = [a // stride for a in low]
    after = [(k - 1 - a + stride - 1) // stride for k, a in zip(taps, low, strict=True)]
    reach = [b + a + 1 for b, a in zip(before, after, strict=True)]
    # The first tap of the window is that of d = -before, r = stride - 1.
    front = [stride * b + stride - 1 - a for b, a in zip(before, low, strict=True)]
    kernel = jnp.pad(
        kernel,
        [(f, stride * n - f - k) for f, n, k in zip(front, reach, taps, strict=True)]
        + [(0, 0), (0, 0)],
    )
    kernel = kernel.reshape(reach[0], stride, reach[1], stride, *kernel.shape[2:])
    kernel = jnp.flip(kernel, (1, 3)).transpose(0, 2, 4, 1, 3, 5)
    kernel = kernel.reshape(*reach, x.shape[-1], -1)
    cells = jax.lax.conv_general_dilated(
        x, kernel, (1, 1), list(zip(before, after, strict=True)), dimension_numbers=_LAYOUT
    )
    return _depth_to_space(cells, stride)


def _space_to_depth(x: Array, size: int) -> Array:
    """Gathers cells of size x size pixels into channels: [b, h, w, c] to [b, h/s, w/s, s*s*c]."""
    b, h, w, c = x.shape
    x = x.reshape(b, h // size, size, w // size, size, c)
    return x.transpose(0, 1, 3, 2, 4, 5).reshape(b, h // size, w // size, size * size * c)


def _depth_to_space(x: Array, size: int) -> Array:
    """The inverse of `_space_to_depth`."""
    b, h, w, c = x.shape
    x = x.reshape(b, h, w, size, size, c // size**2)
    return x.transpose(0, 1, 3, 2, 4, 5).reshape(b, h * size, w * size, c // size**2)

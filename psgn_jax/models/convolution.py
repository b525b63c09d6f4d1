"""The two linear maps that the networks consist of, as pure functions.

Kernels have the plain form `[kh, kw, c_in, c_out]` whatever formulation computes the map, so that
checkpoints do not depend on it. Arithmetic happens in the dtype of the arguments.

On a GPU or TPU these are XLA's convolutions. On a CPU, XLA is good at one thing, convolutions of
stride 1 with enough channels, and several times slower at everything else, so that there

- strided and transposed convolutions become convolutions of stride 1 between cells of
  `stride x stride` pixels, gathered into channels (`_conv_by_cells`, `_conv_transpose_by_cells`):
  XLA's own contain dilations, forward or in their gradients;
- the gradient with respect to the kernel is a product of two matrices, of which one holds the
  horizontally and the other the vertically shifted pixels (`_kernel_gradient`); a usual im2col
  would hold `kh * kw` shifted copies of the input, this one holds `kw` copies of the input and
  `kh` of the output's gradient, and a few rows of the image at a time stay in the cache;
- an input of few channels is computed two pixels at a time (`_conv_by_pairs`).

The rates behind the rules are printed by `tests/bench/step.py --layers`. Formulations agree up to
rounding, and each is deterministic. The backend is asked when a function is traced. The CPU's
versions have no forward-mode derivative.
"""

import functools

import jax
import jax.numpy as jnp

from psgn_jax.types import Array, Float

_LAYOUT = ("NHWC", "HWIO", "NHWC")
_Padding = tuple[tuple[int, int], tuple[int, int]]

# Fewest channels that XLA's convolution reads efficiently on a CPU: one vector of AVX-512.
_VECTOR = 16
# Fewest columns of the matrices in `_kernel_gradient`, and fewest rows of a block of them.
_GRADIENT_CHANNELS = 64
_GRADIENT_PIXELS = 1024


def conv2d(
    x: Float[Array, "b h w c_in"], kernel: Float[Array, "kh kw c_in c_out"], *, stride: int = 1
) -> Float[Array, "b ho wo c_out"]:
    """Convolution (correlation) without bias, TensorFlow's SAME padding: `ho = ceil(h / stride)`.

    Args:
      x: a batch of feature maps.
      kernel: the weights.
      stride: step in both directions.
    """
    if jax.default_backend() != "cpu":
        return jax.lax.conv_general_dilated(
            x, kernel, (stride, stride), "SAME", dimension_numbers=_LAYOUT
        )
    if stride == 1:
        (kh, kw) = kernel.shape[:2]
        return _conv(x, kernel, (((kh - 1) // 2, kh // 2), ((kw - 1) // 2, kw // 2)))
    return _conv_by_cells(x, kernel, stride)


def conv2d_transpose(
    x: Float[Array, "b h w c_in"], kernel: Float[Array, "kh kw c_in c_out"], *, stride: int = 2
) -> Float[Array, "b ho wo c_out"]:
    """Transposed convolution without bias, the map of `jax.lax.conv_transpose(..., "SAME")`.

    Args:
      x: a batch of feature maps.
      kernel: the weights, in the orientation of `conv2d` (no swapped channels).
      stride: `ho = stride * h`.
    """
    if jax.default_backend() != "cpu":
        return jax.lax.conv_transpose(
            x, kernel, (stride, stride), "SAME", dimension_numbers=_LAYOUT
        )
    return _conv_transpose_by_cells(x, kernel, stride)


@functools.partial(jax.custom_vjp, nondiff_argnums=(2,))
def _conv(x: Array, kernel: Array, padding: _Padding) -> Array:
    """Convolution of stride 1; the padding of each direction adds up to the kernel's size - 1."""
    if x.shape[-1] < _VECTOR and x.shape[2] % 2 == 0:
        return _conv_by_pairs(x, kernel, padding)
    return jax.lax.conv_general_dilated(x, kernel, (1, 1), padding, dimension_numbers=_LAYOUT)


def _conv_forward(x: Array, kernel: Array, padding: _Padding) -> tuple[Array, tuple[Array, Array]]:
    return _conv(x, kernel, padding), (x, kernel)


def _conv_backward(padding: _Padding, saved: tuple[Array, Array], dy: Array) -> tuple[Array, Array]:
    """The gradient of the input is the convolution with the flipped kernel."""
    x, kernel = saved
    flipped = jnp.flip(kernel, (0, 1)).swapaxes(2, 3)
    (top, bottom), (left, right) = padding
    dx = _conv(dy, flipped, ((bottom, top), (right, left)))
    return dx, _kernel_gradient(x, dy, kernel.shape[:2], padding)


_conv.defvjp(_conv_forward, _conv_backward)


def _conv_by_pairs(x: Array, kernel: Array, padding: _Padding) -> Array:
    """`_conv` of which each position computes two neighbouring pixels of an even width.

    Their windows, side by side, are one of `kw + 1` pixels; in it, the kernel of the first pixel
    has zeros at the end, that of the second at the start.
    """
    b, h, w, _ = x.shape
    kh, kw, c_in, c_out = kernel.shape
    windows = _windows(x, padding[1], kw, 2)
    both = jnp.stack(
        [jnp.pad(kernel, ((0, 0), (q, 1 - q), (0, 0), (0, 0))) for q in (0, 1)], axis=3
    )
    y = jax.lax.conv_general_dilated(
        windows,
        both.reshape(kh, 1, (kw + 1) * c_in, 2 * c_out),
        (1, 1),
        (padding[0], (0, 0)),
        dimension_numbers=_LAYOUT,
    )
    return y.reshape(b, h, w, c_out)


def _windows(x: Array, padding: tuple[int, int], kw: int, fold: int) -> Array:
    """The pixels that `fold` neighbouring outputs read: [b, h, w / fold, (fold + kw - 1) * c]."""
    b, h, w, c = x.shape
    left, _ = padding
    span = fold + kw - 1
    # Groups of `fold` pixels; a window is some whole groups and the start of another.
    groups = w // fold + -(-span // fold) - 1
    x = jnp.pad(x, ((0, 0), (0, 0), (left, groups * fold - w - left), (0, 0)))
    x = x.reshape(b, h, groups, fold * c)
    pieces = [
        x[:, :, start // fold : start // fold + w // fold, : min(fold, span - start) * c]
        for start in range(0, span, fold)
    ]
    return jnp.concatenate(pieces, axis=-1)


def _kernel_gradient(x: Array, dy: Array, size: tuple[int, int], padding: _Padding) -> Array:
    """Gradient of a convolution of stride 1 with respect to the kernel.

    `dk[i, j] = sum over b, y, x of x[b, y + i - top, x + j - left]^T dy[b, y, x]`. Row y of the
    input meets rows `y + top - i` of `dy`: their product with i as a part of the columns, and the
    horizontal shift j as a part of the rows, holds all of dk. With few channels, `fold`
    neighbouring pixels make wider matrices; dk then is the sum of a block's diagonals.
    """
    (kh, kw), (b, h, w, c_in), c_out = size, x.shape, dy.shape[-1]
    (top, bottom), horizontal = padding
    fold = 2 if min(c_in, c_out) < _GRADIENT_CHANNELS and w % 2 == 0 else 1
    span, sum_dtype = fold + kw - 1, jnp.promote_types(x.dtype, jnp.float32)
    dy = jnp.pad(dy, ((0, 0), (bottom, top), (0, 0), (0, 0)))
    dy = dy.reshape(b, h + kh - 1, w // fold, fold * c_out)

    def block(first: Array | int, rows: int) -> Array:
        windows = _windows(
            jax.lax.dynamic_slice_in_dim(x, first, rows, axis=1), horizontal, kw, fold
        )
        near = jax.lax.dynamic_slice_in_dim(dy, first, rows + kh - 1, axis=1)
        shifted = jnp.concatenate([near[:, i : i + rows] for i in range(kh)], axis=-1)
        return jnp.matmul(
            windows.reshape(-1, span * c_in).T,
            shifted.reshape(-1, kh * fold * c_out),
            preferred_element_type=sum_dtype,
        )

    rows = _rows_of_block(b, h, w)
    if rows == h:
        product = block(0, h)
    else:
        product = jax.lax.fori_loop(
            0,
            h // rows,
            lambda i, total: total + block(i * rows, rows),
            jnp.zeros((span * c_in, kh * fold * c_out), sum_dtype),
        )
    # Slot v of `shifted` is row y + v - bottom, so tap i = kh - 1 - v.
    product = product.reshape(span, c_in, kh, fold, c_out)[:, :, ::-1]
    gradient = sum(product[q : q + kw, :, :, q] for q in range(fold))
    return gradient.transpose(2, 0, 1, 3).astype(x.dtype)


def _rows_of_block(b: int, h: int, w: int) -> int:
    """Rows of the image that `_kernel_gradient` takes at a time: the fewest that are enough work.

    All of them where there are several devices: a loop would sum over them in every round.
    """
    if jax.device_count() > 1:
        return h
    return next(
        r for r in range(1, h + 1) if h % r == 0 and (r == h or b * r * w >= _GRADIENT_PIXELS)
    )


def _conv_by_cells(x: Array, kernel: Array, stride: int) -> Array:
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
    return _conv(_space_to_depth(x, stride), kernel, tuple(zip(before, after, strict=True)))


def _conv_transpose_by_cells(x: Array, kernel: Array, stride: int) -> Array:
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
    cells = _conv(x, kernel, tuple(zip(before, after, strict=True)))
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

"""Convolutions on a CPU by oneDNN, with their gradients; elsewhere and otherwise XLA's.

XLA is up to a hundred times slower than PyTorch where a dilation appears: in transposed
convolutions and in the input gradients of strided ones. With oneDNN, whose kernels PyTorch uses, a
training step takes about half as long.

The environment variable `PSGN_CONVOLUTIONS` selects `onednn` (an error where it is missing) or
`xla`; it is read when a function is traced. With oneDNN there is no forward-mode derivative, and
`jax.export` needs `plain_convolutions` or `xla`.
"""

import contextlib
import contextvars
import functools
import os
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from psgn_jax.array_types import Array
from psgn_jax.models import onednn

_plain: contextvars.ContextVar[bool] = contextvars.ContextVar("plain_convolutions", default=False)


@contextlib.contextmanager
def plain_convolutions() -> Iterator[None]:
    """Context in which XLA's own convolutions are traced: with oneDNN, nothing can be exported."""
    token = _plain.set(True)
    try:
        yield
    finally:
        _plain.reset(token)


def convolve(x: Array, kernel: Array, stride: int, groups: int) -> Array | None:
    """`layers.convolve`, if there is a faster way than XLA's; `groups` is 1 or the channels."""
    if groups > 1:
        return _convolve_depthwise(x, kernel, stride) if _on_cpu() else None
    if not _uses_onednn():
        return None
    return (_convolve_images if x.ndim == 4 else _convolve_volumes)(x, kernel, stride)


def _on_cpu() -> bool:
    return not _plain.get() and jax.default_backend() == "cpu"


def _uses_onednn() -> bool:
    """Whether oneDNN computes; it computes on one device.

    If XLA may split a batch over several devices, it would have to collect it on each of them.
    """
    if not _on_cpu():
        return False
    asked = os.environ.get("PSGN_CONVOLUTIONS", "")
    if asked not in ("", "onednn", "xla"):
        raise ValueError(f"PSGN_CONVOLUTIONS={asked!r}: accepted: onednn, xla, or unset")
    if asked == "xla" or jax.local_device_count() > 1:
        return False
    library, why_not = onednn.library()
    if asked and library is None:
        raise ValueError(f"PSGN_CONVOLUTIONS=onednn: it was not found: {why_not}")
    if library is None:
        return False
    return jax.device_count() == 1 or bool(jax.sharding.get_abstract_mesh().manual_axes)


def _convolve_depthwise(x: Array, kernel: Array, stride: int) -> Array:
    """A sum of shifted images, one for each tap; 5 to 60 times as fast as XLA's loop."""
    (h, w), (kh, kw) = x.shape[1:3], kernel.shape[:2]
    rows, columns = -(-h // stride), -(-w // stride)
    x = jnp.pad(x, ((0, 0), _same_padding(h, kh, stride), _same_padding(w, kw, stride), (0, 0)))
    total = jnp.zeros((), x.dtype)
    for i in range(kh):
        for j in range(kw):
            bottom, right = i + (rows - 1) * stride + 1, j + (columns - 1) * stride + 1
            total = total + x[:, i:bottom:stride, j:right:stride] * kernel[i, j][None, None]
    return total


def _same_padding(n: int, k: int, stride: int) -> tuple[int, int]:
    total = (-(-n // stride) - 1) * stride + k - n
    low = max(0, total) // 2
    return low, total - low


class _Geometry(NamedTuple):
    """Stride and padding ((top, bottom), (left, right)).

    The padded size is `(out - 1) * stride + k`. Padding is negative on a side where the convolution
    does not read the outermost pixels.
    """

    stride: int
    padding: tuple[tuple[int, int], tuple[int, int]]


def _convolve_images(x: Array, kernel: Array, stride: int) -> Array:
    (h, w), (kh, kw) = x.shape[1:3], kernel.shape[:2]
    padding = _same_padding(h, kh, stride), _same_padding(w, kw, stride)
    return _conv(x, kernel, _Geometry(stride, padding))


def convolve_transposed(x: Array, kernel: Array, stride: int) -> Array | None:
    """`layers.convolve_transposed`, if there is a faster way than XLA's."""
    if not _uses_onednn():
        return None

    def padding(k: int) -> tuple[int, int]:
        # `jax.lax.conv_transpose` pads the dilated input by `before`; this is the corresponding
        # padding of the output.
        before = k - 1 if stride > k - 1 else -(-(k + stride - 2) // 2)
        low = k - 1 - before
        return low, k - stride - low

    geometry = _Geometry(stride, (padding(kernel.shape[0]), padding(kernel.shape[1])))
    size = (stride * x.shape[1], stride * x.shape[2])
    return _conv_adjoint(x, jnp.flip(kernel, (0, 1)).swapaxes(2, 3), geometry, size)


def _convolve_volumes(x: Array, kernel: Array, stride: int) -> Array:
    """A volume as a batch of slices: the neighbours of a slice are channels of one convolution."""
    _, depth, height, width, c_in = x.shape
    kd, kh, kw, _, c_out = kernel.shape
    planes = -(-depth // stride)
    total = max(0, (planes - 1) * stride + kd - depth)
    low = total // 2
    x = jnp.pad(x, ((0, 0), (low, total - low), (0, 0), (0, 0), (0, 0)))
    shifted = [x[:, tap : tap + (planes - 1) * stride + 1 : stride] for tap in range(kd)]
    slices = jnp.concatenate(shifted, axis=-1).reshape(-1, height, width, kd * c_in)
    flat = kernel.transpose(1, 2, 0, 3, 4).reshape(kh, kw, kd * c_in, c_out)
    y = _convolve_images(slices, flat, stride)
    return y.reshape(-1, planes, *y.shape[1:])


@functools.partial(jax.custom_vjp, nondiff_argnums=(2,))
def _conv(x: Array, kernel: Array, geometry: _Geometry) -> Array:
    """`y[o] = sum over taps t of x[stride * o + t - low] kernel[t]`; o, t have two components."""
    sizes = (
        (n + low + high - k) // geometry.stride + 1
        for n, (low, high), k in zip(x.shape[1:3], geometry.padding, kernel.shape[:2], strict=True)
    )
    shape = (x.shape[0], *sizes, kernel.shape[3])
    described = onednn.Convolution(x.shape, kernel.shape, shape, *geometry, x.dtype.name)
    y = onednn.compute("forward", x, kernel, described)
    return _xla(x, kernel, geometry) if y is None else y


@functools.partial(jax.custom_vjp, nondiff_argnums=(2, 3))
def _conv_adjoint(y: Array, kernel: Array, geometry: _Geometry, size: tuple[int, int]) -> Array:
    """The adjoint of `_conv` with respect to its first argument; returns images of `size`."""
    shape = (y.shape[0], *size, kernel.shape[2])
    described = onednn.Convolution(shape, kernel.shape, y.shape, *geometry, y.dtype.name)
    x = onednn.compute("input_gradient", y, kernel, described)
    if x is not None:
        return x
    image = jax.ShapeDtypeStruct(shape, y.dtype)
    return jax.linear_transpose(lambda x: _xla(x, kernel, geometry), image)(y)[0]


@functools.partial(jax.custom_vjp, nondiff_argnums=(2, 3))
def _kernel_gradient(x: Array, dy: Array, geometry: _Geometry, shape: tuple[int, ...]) -> Array:
    """The adjoint of `_conv` with respect to the kernel, of that shape."""
    described = onednn.Convolution(x.shape, shape, dy.shape, *geometry, x.dtype.name)
    gradient = onednn.compute("kernel_gradient", x, dy, described)
    if gradient is not None:
        return gradient
    kernel = jax.ShapeDtypeStruct(shape, x.dtype)
    return jax.linear_transpose(lambda k: _xla(x, k, geometry), kernel)(dy)[0]


def _xla(x: Array, kernel: Array, geometry: _Geometry) -> Array:
    """`_conv` where oneDNN has no fast routine."""
    strides = (geometry.stride,) * 2
    layout = ("NHWC", "HWIO", "NHWC")
    return lax.conv_general_dilated(x, kernel, strides, geometry.padding, dimension_numbers=layout)


def _conv_vjp(geometry: _Geometry, saved: tuple[Array, Array], dy: Array) -> tuple[Array, Array]:
    x, kernel = saved
    dx = _conv_adjoint(dy, kernel, geometry, (x.shape[1], x.shape[2]))
    return dx, _kernel_gradient(x, dy, geometry, kernel.shape)


def _conv_adjoint_vjp(
    geometry: _Geometry, _: tuple[int, int], saved: tuple[Array, Array], dx: Array
) -> tuple[Array, Array]:
    y, kernel = saved
    return _conv(dx, kernel, geometry), _kernel_gradient(dx, y, geometry, kernel.shape)


def _kernel_gradient_vjp(
    geometry: _Geometry, _: tuple[int, ...], saved: tuple[Array, Array], dkernel: Array
) -> tuple[Array, Array]:
    x, dy = saved
    dx = _conv_adjoint(dy, dkernel, geometry, (x.shape[1], x.shape[2]))
    return dx, _conv(x, dkernel, geometry)


# The functions are linear in both arguments, and the gradients of each are the two others.
def _saving(function: Callable[..., Array]) -> Callable[..., Any]:
    return lambda first, second, *static: (function(first, second, *static), (first, second))


_conv.defvjp(_saving(_conv), _conv_vjp)
_conv_adjoint.defvjp(_saving(_conv_adjoint), _conv_adjoint_vjp)
_kernel_gradient.defvjp(_saving(_kernel_gradient), _kernel_gradient_vjp)

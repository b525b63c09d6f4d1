"""Convolutions on a CPU by oneDNN, with their gradients; elsewhere and otherwise XLA's.

XLA is up to a hundred times slower than PyTorch where a dilation appears: in transposed
convolutions and in the input gradients of strided ones. With oneDNN, whose kernels PyTorch uses, a
training step takes about half as long.

The environment variable `PSGN_CONVOLUTIONS` selects `onednn` (an error where it is missing) or
`xla`; it is read when a function is traced. With oneDNN there is no forward-mode derivative.
`jax.export` needs `plain_convolutions` or `xla`; gradients in `jax.shard_map` need
`check_vma=False`.
"""

import contextlib
import contextvars
import functools
import os
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from psgn_jax.array_types import Array
from psgn_jax.models import onednn
from psgn_jax.models.onednn import Convolution

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
    """`layers.convolve` if there is a faster way than XLA's; `groups` is 1 or the channels of x."""
    if groups > 1:
        return _convolve_depthwise(x, kernel, stride) if _on_cpu() else None
    if not _uses_onednn():
        return None
    return (_convolve_images if x.ndim == 4 else _convolve_volumes)(x, kernel, stride)


def _on_cpu() -> bool:
    return not _plain.get() and jax.default_backend() == "cpu"


def _uses_onednn() -> bool:
    """Whether oneDNN computes: on one device, or on each device's share under `jax.shard_map`.

    Otherwise, if XLA may split a batch over several devices, it would have to collect it on each.
    """
    if not _on_cpu():
        return False
    asked = os.environ.get("PSGN_CONVOLUTIONS", "")
    if asked not in ("", "onednn", "xla"):
        raise ValueError(f"PSGN_CONVOLUTIONS={asked!r}: accepted: onednn, xla, or unset")
    if asked == "xla":
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


def _convolve_images(x: Array, kernel: Array, stride: int) -> Array:
    (h, w), (kh, kw) = x.shape[1:3], kernel.shape[:2]
    padding = _same_padding(h, kh, stride), _same_padding(w, kw, stride)
    y = x.shape[0], -(-h // stride), -(-w // stride), kernel.shape[3]
    described = Convolution(x.shape, kernel.shape, y, stride, padding, x.dtype.name)
    return _part("forward", x, kernel, described)


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

    kernel = jnp.flip(kernel, (0, 1)).swapaxes(2, 3)
    both = padding(kernel.shape[0]), padding(kernel.shape[1])
    larger = x.shape[0], stride * x.shape[1], stride * x.shape[2], kernel.shape[2]
    described = Convolution(larger, kernel.shape, x.shape, stride, both, x.dtype.name)
    return _part("input_gradient", x, kernel, described)


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


@functools.partial(jax.custom_vjp, nondiff_argnums=(0, 3))
def _part(part: onednn.Part, first: Array, second: Array, convolution: Convolution) -> Array:
    """`onednn.compute`, or XLA where oneDNN has no fast routine."""
    result = onednn.compute(part, first, second, convolution)
    if result is not None:
        return result

    def forward(x: Array, kernel: Array) -> Array:
        strides, layout = (convolution.stride,) * 2, ("NHWC", "HWIO", "NHWC")
        padding = convolution.padding
        return lax.conv_general_dilated(x, kernel, strides, padding, dimension_numbers=layout)

    if part == "forward":
        return forward(first, second)
    if part == "input_gradient":
        x = jax.ShapeDtypeStruct(convolution.x, first.dtype)
        return jax.linear_transpose(lambda x: forward(x, second), x)(first)[0]
    kernel = jax.ShapeDtypeStruct(convolution.kernel, first.dtype)
    return jax.linear_transpose(lambda kernel: forward(first, kernel), kernel)(second)[0]


def _forward(part: onednn.Part, first: Array, second: Array, convolution: Convolution) -> Any:
    return _part(part, first, second, convolution), (first, second)


def _backward(
    part: onednn.Part, convolution: Convolution, saved: tuple[Array, Array], change: Array
) -> tuple[Array, Array]:
    """The parts are linear in both arguments, and the gradients of each are the two others."""
    first, second = saved

    def other(part: onednn.Part, first: Array, second: Array) -> Array:
        return _part(part, first, second, convolution)

    if part == "forward":
        return other("input_gradient", change, second), other("kernel_gradient", first, change)
    if part == "input_gradient":
        return other("forward", change, second), other("kernel_gradient", change, first)
    return other("input_gradient", second, change), other("forward", first, change)


_part.defvjp(_forward, _backward)

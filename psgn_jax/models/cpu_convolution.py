"""Convolutions on a CPU and their gradients: by oneDNN, or by XLA without dilation.

XLA is up to a hundred times slower than PyTorch for dilated convolutions: transposed convolutions
and the input gradients of strided convolutions. With oneDNN, whose kernels PyTorch uses, a training
step takes about half as long. Without it, XLA convolves blocks of pixels, without dilation.

The environment variable `PSGN_CONVOLUTIONS` selects `onednn` (an error if it is missing) or `xla`;
it is read when a function is traced. oneDNN has no forward-mode derivatives. `jax.export` needs
`convolutions_for("export")` or `xla`; gradients in `jax.shard_map` need `check_vma=False`.
"""

import contextlib
import contextvars
import functools
import os
from collections.abc import Iterator
from typing import Any, Literal

import jax
import jax.numpy as jnp
from jax import lax

from psgn_jax.array_types import Array
from psgn_jax.models import onednn
from psgn_jax.models.onednn import Convolution
from psgn_jax.system.errors import UserError

_purpose = contextvars.ContextVar("convolutions_for", default="speed")


@contextlib.contextmanager
def convolutions_for(purpose: Literal["speed", "storing", "export"]) -> Iterator[None]:
    """Context in which convolutions are traced for a purpose.

    - "speed", also outside of any context: oneDNN if possible, else blocks.
    - "storing": blocks, unless `PSGN_CONVOLUTIONS` asks for oneDNN. JAX keeps a compiled program on
      the disk only if it does not call back into Python, as oneDNN does. A first prediction then
      takes 2.8 instead of 7.2 s of CPU time.
    - "export": XLA's own convolutions.
    """
    token = _purpose.set(purpose)
    try:
        yield
    finally:
        _purpose.reset(token)


def _on_cpu() -> bool:
    return _purpose.get() != "export" and jax.default_backend() == "cpu"


def convolve(x: Array, kernel: Array, stride: int) -> Array | None:
    """`layers.convolve` on a CPU."""
    if not _on_cpu():
        return None
    return (_convolve_images if x.ndim == 4 else _convolve_volumes)(x, kernel, stride)


def convolve_transposed(x: Array, kernel: Array, stride: int) -> Array | None:
    """`layers.convolve_transposed` on a CPU: the input gradient of a strided convolution."""
    if not _on_cpu():
        return None

    def padding(k: int) -> tuple[int, int]:
        # `before` pads the dilated input in `jax.lax.conv_transpose`; we pad the output.
        before = k - 1 if stride > k - 1 else -(-(k + stride - 2) // 2)
        low = k - 1 - before
        return low, k - stride - low

    kernel = jnp.flip(kernel, (0, 1)).swapaxes(2, 3)
    both = padding(kernel.shape[0]), padding(kernel.shape[1])
    larger = x.shape[0], stride * x.shape[1], stride * x.shape[2], kernel.shape[2]
    convolution = Convolution(larger, kernel.shape, x.shape, stride, both, x.dtype.name)
    compute = _by_onednn if _uses_onednn(convolution) else _by_xla
    return compute("input_gradient", x, kernel, convolution)


def _uses_onednn(convolution: Convolution) -> bool:
    """Whether oneDNN computes: on a single device, or on a device's share under `jax.shard_map`.

    If XLA splits a batch over several devices, it would have to gather the batch on each device.
    """
    asked = os.environ.get("PSGN_CONVOLUTIONS", "")
    if asked not in ("", "onednn", "xla"):
        raise UserError(f"PSGN_CONVOLUTIONS={asked}: accepted: onednn, xla, or unset")
    if asked == "xla" or (not asked and _purpose.get() == "storing"):
        return False
    library, why_not = onednn.library()
    if asked and library is None:
        raise UserError(f"PSGN_CONVOLUTIONS=onednn: it was not found: {why_not}")
    if library is None:
        return False
    one = jax.device_count() == 1 or bool(jax.sharding.get_abstract_mesh().manual_axes)
    return one and onednn.computes(convolution)


def _same_padding(n: int, k: int, stride: int) -> tuple[int, int]:
    total = max(0, (-(-n // stride) - 1) * stride + k - n)
    return total // 2, total - total // 2


def _convolve_images(x: Array, kernel: Array, stride: int) -> Array:
    (h, w), (kh, kw) = x.shape[1:3], kernel.shape[:2]
    padding = _same_padding(h, kh, stride), _same_padding(w, kw, stride)
    y = x.shape[0], -(-h // stride), -(-w // stride), kernel.shape[3]
    convolution = Convolution(x.shape, kernel.shape, y, stride, padding, x.dtype.name)
    compute = _by_onednn if _uses_onednn(convolution) else _by_xla
    return compute("forward", x, kernel, convolution)


def _convolve_volumes(x: Array, kernel: Array, stride: int) -> Array:
    """Convolves a volume as a batch of slices, whose neighbouring slices are channels."""
    _, depth, height, width, c_in = x.shape
    kd, kh, kw, _, c_out = kernel.shape
    planes = -(-depth // stride)
    x = jnp.pad(x, ((0, 0), _same_padding(depth, kd, stride), (0, 0), (0, 0), (0, 0)))
    shifted = [x[:, tap : tap + (planes - 1) * stride + 1 : stride] for tap in range(kd)]
    slices = jnp.concatenate(shifted, axis=-1).reshape(-1, height, width, kd * c_in)
    flat = kernel.transpose(1, 2, 0, 3, 4).reshape(kh, kw, kd * c_in, c_out)
    y = _convolve_images(slices, flat, stride)
    return y.reshape(-1, planes, *y.shape[1:])


def _by_xla(part: onednn.Part, first: Array, kernel: Array, convolution: Convolution) -> Array:
    """Stride s as stride 1 over blocks, whose s x s pixels become channels (space to depth)."""
    s, (b, *size, c), (_, *out, c_out) = convolution.stride, convolution.x, convolution.y
    low = [-(-before // s) for before, _ in convolution.padding]  # blocks of padding
    first_tap = [s * i - before for i, (before, _) in zip(low, convolution.padding, strict=True)]
    (m, n) = many = [-(-(i + k) // s) for i, k in zip(first_tap, kernel.shape, strict=False)]
    (h, w) = blocks = [-(-i // s) for i in size]
    taps = [(i, s * k - i - j) for i, j, k in zip(first_tap, kernel.shape, many, strict=False)]
    kernel = jnp.pad(kernel, [*taps, (0, 0), (0, 0)]).reshape(m, s, n, s, c, c_out)
    kernel = kernel.transpose(0, 2, 1, 3, 4, 5).reshape(m, n, s * s * c, c_out)

    def convolved(x: Array, kernel: Array, low: list[int], sizes: list[int]) -> Array:
        """Stride 1; the result has `sizes`."""
        rest = zip(low, sizes, x.shape[1:], many, strict=False)
        around = [(i, o - 1 + k - i - n) for i, o, n, k in rest]
        layout = ("NHWC", "HWIO", "NHWC")
        return lax.conv_general_dilated(x, kernel, (1, 1), around, dimension_numbers=layout)

    if part == "forward":
        x = jnp.pad(first, ((0, 0), (0, s * h - size[0]), (0, s * w - size[1]), (0, 0)))
        x = x.reshape(b, h, s, w, s, c).transpose(0, 1, 3, 2, 4, 5).reshape(b, h, w, s * s * c)
        return convolved(x, kernel, low, out)
    kernel = jnp.flip(kernel, (0, 1)).swapaxes(2, 3)
    x = convolved(first, kernel, [k - 1 - i for i, k in zip(low, many, strict=True)], blocks)
    x = x.reshape(b, h, w, s, s, c).transpose(0, 1, 3, 2, 4, 5)
    return x.reshape(b, s * h, s * w, c)[:, : size[0], : size[1]]


@functools.partial(jax.custom_vjp, nondiff_argnums=(0, 3))
def _by_onednn(part: onednn.Part, first: Array, second: Array, convolution: Convolution) -> Array:
    return onednn.compute(part, first, second, convolution)


def _forward(part: onednn.Part, first: Array, second: Array, convolution: Convolution) -> Any:
    return _by_onednn(part, first, second, convolution), (first, second)


def _backward(
    part: onednn.Part, convolution: Convolution, saved: tuple[Array, Array], change: Array
) -> tuple[Array, Array]:
    """Each part is linear in both arguments; its gradients are the two other parts."""
    first, second = saved

    def other(part: onednn.Part, first: Array, second: Array) -> Array:
        return _by_onednn(part, first, second, convolution)

    if part == "forward":
        return other("input_gradient", change, second), other("kernel_gradient", first, change)
    if part == "input_gradient":
        return other("forward", change, second), other("kernel_gradient", change, first)
    return other("input_gradient", second, change), other("forward", first, change)


_by_onednn.defvjp(_forward, _backward)

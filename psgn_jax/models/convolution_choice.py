"""What computes convolutions: XLA, oneDNN, or the formulations of `models.cpu_convolution`.

On a CPU, the environment variable `PSGN_CONVOLUTIONS` selects `onednn`, `jax` (the formulations of
`cpu_convolution`) or `xla` (XLA's own convolutions, as within `plain_convolutions()`). Platform and
variable are read when a function is traced. Later changes have no effect on functions that
`jax.jit` has already traced.
"""

import contextlib
import contextvars
import os
from collections.abc import Iterator

import jax

from psgn_jax.models import onednn

_CHOICES = ("", "onednn", "jax", "xla")

_plain: contextvars.ContextVar[bool] = contextvars.ContextVar("plain_convolutions", default=False)


@contextlib.contextmanager
def plain_convolutions() -> Iterator[None]:
    """Context in which XLA's own convolutions are traced on every platform.

    It is for exported programs, which run on other machines. Programs that call oneDNN cannot be
    exported. It has no effect on functions that `jax.jit` has already traced.
    """
    token = _plain.set(True)
    try:
        yield
    finally:
        _plain.reset(token)


def uses_xla() -> bool:
    """Returns whether to use XLA's convolutions: always on GPU and TPU, on a CPU on request.

    They are requested by `PSGN_CONVOLUTIONS=xla` in the environment or by `plain_convolutions`.
    """
    asked = _asked() == "xla"
    return asked or _plain.get() or jax.default_backend() != "cpu"


def _asked() -> str:
    asked = os.environ.get("PSGN_CONVOLUTIONS", "")
    if asked not in _CHOICES:
        known = ", ".join(filter(None, _CHOICES))
        raise ValueError(f"PSGN_CONVOLUTIONS={asked!r}: accepted: {known}, or unset")
    return asked


def uses_onednn(batch: int) -> bool:
    """Returns whether to ask `models.onednn` first.

    It computes on one device, so it is never used with several devices in one process. If XLA may
    split the batch over several devices, it would have to collect the batch on each of them. For a
    single image, the calls through Python cost more than oneDNN saves: 5.4 ms instead of 4.3 for
    the network of `authors_small.py`.
    """
    asked = _asked()
    if asked == "jax" or jax.local_device_count() > 1 or (batch == 1 and asked != "onednn"):
        return False  # without loading the library
    if onednn.library() is None:
        if asked == "onednn":
            raise ValueError(
                f"PSGN_CONVOLUTIONS=onednn: the library was not found: {onednn.why_not()}; "
                "install it, or unset the variable"
            )
        return False
    return jax.device_count() == 1 or bool(jax.sharding.get_abstract_mesh().manual_axes)

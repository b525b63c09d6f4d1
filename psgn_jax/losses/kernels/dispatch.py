"""Chooses between the Pallas kernels of the losses and the plain XLA path.

The environment variable `PSGN_KERNELS` decides:

- `auto` (default): do not use the kernels, because they have not been tested on a GPU yet
  (`tests/bench/gpu.py --parts b` tests them). On a GPU this choice is logged once.
- `on`: use the kernels in functions that are lowered for CUDA.
- `off`: never use the kernels.

The plain XLA path works on every platform. With `on`, functions that are lowered for other
platforms use it too.
"""

import functools
import os
from collections.abc import Callable
from typing import Any

import jax
from absl import logging

from psgn_jax.types import Array

_VARIABLE = "PSGN_KERNELS"


def use_kernels(force: bool | None = None) -> bool:
    """Returns whether to trace a Pallas kernel for CUDA in addition to the plain path.

    Args:
      force: overrides the environment variable: True is `on`, False is `off`.

    Raises:
      ValueError: `PSGN_KERNELS` is not one of auto, on, off.
    """
    mode = os.environ.get(_VARIABLE, "auto") if force is None else "on" if force else "off"
    if mode not in ("auto", "on", "off"):
        raise ValueError(f"{_VARIABLE}: got {mode!r}, accepted: auto, on, off")
    if mode == "auto" and jax.default_backend() == "gpu":
        _say_plain()
    return mode == "on"


@functools.cache
def _say_plain() -> None:
    logging.info("losses use the plain XLA path; %s=on selects the Pallas kernels", _VARIABLE)


def select(kernel: Callable, plain: Callable, *arguments: Array) -> Any:
    """`kernel(*arguments)` if lowered for CUDA, else `plain(*arguments)`."""
    return jax.lax.platform_dependent(*arguments, cuda=kernel, default=plain)


def varying_like(shape: tuple[int, ...], dtype: Any, *arguments: Array) -> jax.ShapeDtypeStruct:
    """Shape and dtype of a kernel's output that varies along the same mesh axes as its inputs.

    Pallas needs this inside `shard_map`.
    """
    # jax 0.8 and 0.9 store the set of axes as `vma`; from 0.10 on it is part of a larger type.
    for name, axes_of in (("manual_axis_type", lambda kind: kind.varying), ("vma", frozenset)):
        kinds = [getattr(jax.typeof(argument), name, None) for argument in arguments]
        if known := [kind for kind in kinds if kind is not None]:
            most = max(known, key=lambda kind: len(axes_of(kind)))
            return jax.ShapeDtypeStruct(shape, dtype, **{name: most} if axes_of(most) else {})
    return jax.ShapeDtypeStruct(shape, dtype)

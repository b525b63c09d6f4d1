"""Whether the losses run their Pallas kernels: on a GPU, where these compile, unless forbidden.

`PSGN_KERNELS` in the environment decides: `auto` (the default) takes the kernels where JAX's
default backend is a CUDA GPU and a small trial gave the right answer; `on` traces them without a
trial, for whatever is lowered for CUDA; `off` never does. Everything else, and whatever is lowered
for another platform in the same process, runs the plain XLA path, which works everywhere.
"""

import functools
import os
from collections.abc import Callable
from typing import Any

import jax
from absl import logging

from psgn_jax.types import Array

_VARIABLE = "PSGN_KERNELS"


def use_kernels(trial: Callable[[], bool], force: bool | None = None) -> bool:
    """Says whether to trace a Pallas kernel for CUDA beside the plain path.

    Args:
      trial: runs the kernel on a small problem and says whether the answer is right. Called once
        in a process, and only in mode `auto` on a GPU; if it raises or denies, a warning is logged
        and the plain path is taken from then on.
      force: True or False decides in place of the environment.

    Raises:
      ValueError: `PSGN_KERNELS` is not one of auto, on, off.
    """
    mode = os.environ.get(_VARIABLE, "auto") if force is None else "on" if force else "off"
    if mode not in ("auto", "on", "off"):
        raise ValueError(f"{_VARIABLE}: got {mode!r}, accepted: auto, on, off")
    if mode == "auto":
        return jax.default_backend() == "gpu" and _passes(trial)
    return mode == "on"


@functools.cache
def _passes(trial: Callable[[], bool]) -> bool:
    name = trial.__module__
    try:
        # The losses are traced when this is asked: the trial must run now all the same.
        with jax.ensure_compile_time_eval():
            passed = trial()
    except Exception as error:  # whatever a compiler may raise: the plain path remains
        logging.warning("%s: kernel not usable here, plain path taken: %s", name, error)
        return False
    if not passed:
        logging.warning("%s: kernel gave a wrong answer here, plain path taken", name)
    return passed


def select(kernel: Callable, plain: Callable, *arguments: Array) -> Any:
    """`kernel(*arguments)` in what is lowered for CUDA, else `plain(*arguments)`."""
    return jax.lax.platform_dependent(*arguments, cuda=kernel, default=plain)


def varying_like(shape: tuple[int, ...], dtype: Any, *arguments: Array) -> jax.ShapeDtypeStruct:
    """An output of a kernel that, inside `shard_map`, varies along the axes its inputs vary on."""
    # jax 0.8 and 0.9 call the set of those axes vma; from 0.10 on it is part of a larger type.
    for name, axes_of in (("manual_axis_type", lambda kind: kind.varying), ("vma", frozenset)):
        kinds = [getattr(jax.typeof(argument), name, None) for argument in arguments]
        if known := [kind for kind in kinds if kind is not None]:
            most = max(known, key=lambda kind: len(axes_of(kind)))
            return jax.ShapeDtypeStruct(shape, dtype, **{name: most} if axes_of(most) else {})
    return jax.ShapeDtypeStruct(shape, dtype)

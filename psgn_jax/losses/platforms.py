"""Different programs for a CPU and for an accelerator."""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from psgn_jax.array_types import Array


def per_platform(cpu: Callable[..., Any], other: Callable[..., Any], *arrays: Array) -> Any:
    """`cpu(*arrays)` on a CPU, `other(*arrays)` on an accelerator.

    Inside `jit`, both are traced, and XLA compiles the program for its device. Only `cpu` is traced
    where JAX computes on a CPU by default; `jax.export` writes a program for a CPU there.
    """
    if jax.default_backend() == "cpu":
        return cpu(*arrays)
    if any(isinstance(x, jax.core.Tracer) for x in arrays):
        return jax.lax.platform_dependent(*arrays, cpu=cpu, default=other)
    placed = [x for x in arrays if isinstance(x, jax.Array)] or [jnp.zeros(())]
    platforms = {device.platform for x in placed for device in x.devices()}
    return (cpu if platforms == {"cpu"} else other)(*arrays)

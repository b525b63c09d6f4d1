"""Hints for the XLA compiler. None of them changes a value. Each docstring gives the reason.

Functions of `jax.experimental` may disappear in a new version of JAX. If one is missing, the losses
still work, but slower.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import sequential_vmap

try:
    from jax.experimental.xla_metadata import set_xla_metadata
except ImportError:  # `as_one_function` then has no effect
    set_xla_metadata = None  # type: ignore[assignment]

from psgn_jax.types import Array

one_pair_at_a_time = sequential_vmap
"""Decorator: under `vmap` the function runs in a loop over the batch.

A batched `while_loop` runs in lock step: every pair takes as long as the slowest one, and every
step copies the state of all pairs. For the auction on a CPU, a loop over the pairs is faster.
"""


def write_once(x: Array) -> Array:
    """Returns `x` and makes XLA write it to memory once instead of recomputing it at every use.

    Used for arrays that are read twice: the tile of distances in `chamfer`, and a bidder's sums of
    distance and price in `auction`.
    """
    return lax.optimization_barrier(x)


def vary_with(value: Any, data: Array) -> Array:
    """Broadcasts `value` to the shape of `data`, as a computed array instead of a constant.

    Inside `jax.shard_map` a constant does not vary along the axes of the mesh, but the state of a
    loop over sharded data must. XLA optimises the `where` away.
    """
    return jnp.where(data == data, value, value)


def as_one_function(function: Callable[..., Any]) -> Callable[..., Any]:
    """Makes XLA's CPU compiler emit `function` as a single function.

    Otherwise the operations are launched one by one. One bid of the auction is a dozen small
    operations that take a microsecond together; launched one by one, they take 1.4 to 2.2 times as
    long.
    """
    if set_xla_metadata is None:
        return function

    def call(*arguments: Any) -> Any:
        with set_xla_metadata(xla_cpu_small_call="true", inlineable="false"):
            return jax.jit(function)(*arguments)

    return call

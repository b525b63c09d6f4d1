"""Instructions to XLA's compiler. None of them changes a value; each names what it gains.

Functions of `jax.experimental` may disappear with a new version of JAX. Where one is missing the
losses still work, slower.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import sequential_vmap

try:
    from jax.experimental.xla_metadata import set_xla_metadata
except ImportError:  # `as_one_function` then compiles as usual
    set_xla_metadata = None  # type: ignore[assignment]

from psgn_jax.types import Array

one_pair_at_a_time = sequential_vmap
"""Under `vmap`, a loop over the batch.

A `while_loop` of a batch runs in lock step: all pairs take as long as the slowest one, and every
step copies the state of all. For the auction on a CPU a loop over the pairs is faster.
"""


def write_once(x: Array) -> Array:
    """`x`, written to memory once, where XLA would compute it again for every use.

    Chamfer: the tile of distances is read by two minima. Auction: the prices seen by a bidder.
    """
    return lax.optimization_barrier(x)


def vary_with(value: Any, data: Array) -> Array:
    """`value`, broadcast to `data`, as a computed array instead of a constant.

    Inside `jax.shard_map` a constant does not vary along the axes of the mesh, and a loop refuses
    to carry it beside data that do. XLA removes the selection.
    """
    return jnp.where(data == data, value, value)


def as_one_function(function: Callable[..., Any]) -> Callable[..., Any]:
    """`function`, emitted by XLA's CPU compiler as one function.

    Its operations are not launched one by one. For the bids of the auction, each a microsecond of
    arithmetic in a dozen small operations, launching took 1.4 to 2.2 times as long.
    """
    if set_xla_metadata is None:
        return function

    def call(*arguments: Any) -> Any:
        with set_xla_metadata(xla_cpu_small_call="true", inlineable="false"):
            return jax.jit(function)(*arguments)

    return call

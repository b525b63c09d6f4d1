"""A function of one pair of clouds, applied to a batch of pairs."""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np

from psgn_jax.array_types import Array
from psgn_jax.losses.numeric import per_platform


def map_pairs(function: Callable[..., Any]) -> Callable[..., Any]:
    """Maps a function of one pair over a batch of pairs.

    `function` maps (pred [n, 3], gt [m, 3]) to any pytree of arrays, the result (pred [B, n, 3],
    gt [B, m, 3]) to the pytree with a leading axis B on every array. Further arguments need the
    same leading axis. ValueError if the batches differ in size, or for a single pair of clouds.

    A CPU processes the pairs one after another (`jax.lax.scan`), so that a pair's data stay in the
    cache: the CD of 32 pairs of 1024 x 1024 points with gradient takes .033 s on one core, with
    `vmap` .051 s. Only several CPU devices process parts of a batch at the same time. Accelerators
    process all pairs together (`jax.vmap`). The results agree up to rounding.
    """

    # Not defined in `over_batch`: every call must pass the same function to `scan`, so that JAX
    # compiles it only once, even without an enclosing `jit`.
    def one_pair(_: None, arrays: tuple[Array, ...]) -> tuple[None, Any]:
        return None, function(*arrays)

    def over_batch(pred: Array, gt: Array, *others: Array) -> Any:
        arrays, size = (pred, gt, *others), len(pred)
        if all(np.ndim(a) == 2 and np.shape(a)[1] == 3 for a in (pred, gt)):
            raise ValueError(
                f"map_pairs: got one pair of clouds, {list(np.shape(pred))} and "
                f"{list(np.shape(gt))}, expected batches [B, n, 3]; call the function itself for "
                "one pair"
            )
        if {len(a) for a in arrays} != {size}:
            sizes = ", ".join(str(len(a)) for a in arrays)
            raise ValueError(f"map_pairs: got batches of {sizes} pairs, expected the same number")
        return per_platform(in_turn, jax.vmap(function), *arrays)

    def in_turn(*arrays: Array) -> Any:
        return jax.lax.scan(one_pair, None, arrays)[1]

    return over_batch

"""Batches split over devices by a mesh with explicit axes, the default of `jax.make_mesh`."""

from collections.abc import Callable, Sequence
from typing import Any

import jax

from psgn_jax.array_types import Array


def on_each_device(
    function: Callable[..., Any], arrays: Sequence[Array], split: Sequence[bool]
) -> Any:
    """`function(*arrays)`; if a mesh splits the batch explicitly, each device computes its part.

    `split` says which arrays have the batch axis.
    """
    batch = next(x for x, has_axis in zip(arrays, split, strict=True) if has_axis)
    sharding = jax.typeof(batch).sharding
    if not any(sharding.spec):
        return function(*arrays)
    part = jax.P(sharding.spec[0])
    specs = tuple(part if has_axis else jax.P() for has_axis in split)
    return jax.shard_map(function, mesh=sharding.mesh, in_specs=specs, out_specs=part)(*arrays)

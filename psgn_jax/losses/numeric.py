"""Common parts of the losses: checks of clouds, roots, minima, loops, programs by platform."""

import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.experimental.xla_metadata import set_xla_metadata

from psgn_jax.array_types import Array, Float

INFINITE = 0x7F800000  # the bits of infinity


def check_points(points: Float[Array, "n 3"], name: str) -> Float[Array, "n 3"]:
    """One cloud, n >= 1, as float32 (or float64); ValueError for another type, shape or dtype.

    Outside `jit`, `vmap` and `grad`, where the values are known, they must be finite.
    """
    if isinstance(points, np.ndarray):  # JAX accepts the machine's byte order only
        points = points.astype(points.dtype.newbyteorder("="), copy=False)
    is_array = isinstance(points, jax.Array | np.ndarray)
    is_cloud = is_array and points.ndim == 2 and points.shape[1] == 3 and len(points) > 0
    if not is_cloud or not jnp.issubdtype(points.dtype, jnp.floating):
        got = f"{points.dtype}{list(points.shape)}" if is_array else type(points).__name__
        raise ValueError(
            f"{name}: got {got}, expected an array [n, 3] of floats with n >= 1"
            " (one cloud; use jax.vmap or losses.map_pairs for a batch)"
        )
    if not isinstance(points, jax.core.Tracer) and getattr(points, "is_fully_addressable", True):
        dtype = jax.dtypes.canonicalize_dtype(jnp.promote_types(points.dtype, jnp.float32))
        with np.errstate(over="ignore"):  # float64 beyond the range of float32
            bad = np.flatnonzero(~np.isfinite(np.asarray(points, dtype)).all(axis=-1))
        if len(bad):
            raise ValueError(
                f"{name}: point {bad[0]} of {len(points)} is {np.asarray(points[bad[0]]).tolist()},"
                f" expected finite coordinates ({len(bad)} points are not)"
            )
    array = jnp.asarray(points)
    return array.astype(jnp.promote_types(array.dtype, jnp.float32))


def safe_sqrt(x: Float[Array, "..."]) -> Float[Array, "..."]:
    """sqrt(x) for x >= 0, with gradient 0 instead of infinity at x = 0; NaN stays NaN."""
    is_zero = x == 0
    return jnp.where(is_zero, 0, jnp.sqrt(jnp.where(is_zero, 1, x)))


def distance(x: tuple[Array, ...], y: tuple[Array, ...]) -> Array:
    """Euclidean distances between points x and y, each given as three arrays of coordinates."""
    return jnp.sqrt(sum(jnp.square(s - t) for s, t in zip(x, y, strict=True)))


def ordered_ints(x: Array) -> Array:
    """Float32 numbers >= 0 as integers in the same order; XLA vectorises minima of integers."""
    return lax.bitcast_convert_type(x, jnp.int32)


def floats(x: Array) -> Array:
    """The inverse of `ordered_ints`."""
    return lax.bitcast_convert_type(x, jnp.float32)


def min_of_rows(x: Array) -> Array:
    """Minimum over the first axis of `ordered_ints`."""
    return lax.reduce(x, jnp.int32(INFINITE), lax.min, (0,))


def min_of_lanes(x: Array) -> Array:
    """`min_of_rows` of `num_lanes(n)` numbers, for use in `as_one_function`."""
    return min_of_rows(jax.jit(lambda x: min_of_rows(x.reshape(-1, 8)))(x))


def read(x: Array, i: Array) -> Array:
    """x[i] for 0 <= i < len(x)."""
    return lax.dynamic_slice(x, (i, *[jnp.int32(0)] * (x.ndim - 1)), (1, *x.shape[1:]))[0]


def write(x: Array, i: Array, value: Array) -> Array:
    """Returns x [n] with x[i] = value; XLA updates it in place."""
    return lax.dynamic_update_slice(x, value[None], (i,))


def as_one_function(loop: Callable[..., Any], *arguments: Any) -> Any:
    """`loop(*arguments)`, compiled for a CPU as a single function.

    Otherwise XLA launches the dozen operations of a loop iteration one by one. Inner functions
    under `jax.jit` stay separate: XLA does not fuse them with other operations or compute them
    twice, and vectorises minima over an axis. XLA aborts if the loop does not need an argument.
    """
    with set_xla_metadata(xla_cpu_small_call="true", inlineable="false"):
        return jax.jit(loop)(*arguments)


def vary_with(value: Any, data: Array) -> Array:
    """`value` with the shape of `data`, formally computed from it, at no cost.

    In `jax.shard_map`, the state of a loop over sharded data must vary along the mesh's axes.
    """
    return jnp.where(data == data, value, value)


def num_lanes(n: int) -> int:
    """Columns of the [rows, lanes] array into which n numbers are folded: 8 k, at least sqrt(n)."""
    return (math.isqrt(n - 1) // 8 + 1) * 8


def padded_size(n: int) -> int:
    """The size of this array, the least multiple of `num_lanes(n)` that is at least n."""
    return -(-n // num_lanes(n)) * num_lanes(n)


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

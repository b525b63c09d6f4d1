"""A proven bound on how far a bijection between two clouds is from optimal.

Notation: see `auction`. By linear programming duality, for any prices p_j of the points of b, and
any u with u_i <= c_ij + p_j for all i and j, every bijection t costs at least

    sum_i c_{i,t(i)} >= sum_i (u_i - p_{t(i)}) = sum_i u_i - sum_j p_j.

The cost P of a bijection s therefore exceeds OPT by at most the sum of its slacks:

    P - OPT <= sum_i (c_{i,s(i)} + p_{s(i)} - u_i)

`gap` is this bound divided by a lower bound on OPT. It includes all float32 rounding errors, so it
is never too small. Up to 1,024 points, we compute all distances once (4 MB). Beyond, we compute
them when we need them, so memory is linear in n.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from psgn_jax.array_types import Array
from psgn_jax.losses.numeric import (
    as_one_function,
    distance,
    floats,
    min_of_lanes,
    min_of_rows,
    num_lanes,
    ordered_ints,
    padded_size,
    read,
    vary_with,
    write,
)

_MOST_IN_TABLE = 1024  # points; larger tables of distances do not fit in the cache
_UNIT = 2.0**-24  # unit roundoff of float32

# The terms of a slack c + p - u are bounded by 2 extents plus the largest price. The error of the
# slack is below 24 unit roundoffs times that bound: counting operations gives 18, if a square root
# is accurate to 2 units in the last place.
_ROUNDING = 24 * _UNIT


class Problem(NamedTuple):
    """A pair of clouds, scaled (`exact_*`), and scaled and centred (`a`, `b`); extents <= 1."""

    exact_a: Array
    exact_b: Array
    a: Array
    b: Array
    # With b padded to m = padded_size(n) points: the distances [n, m], or a and three arrays [m].
    rows: tuple[Array, ...]
    unit: Array  # of the scaled distances, in the caller's unit
    finite: Array


def prepare(a: Array, b: Array) -> Problem:
    """Scales a pair of clouds exactly, by a power of two, to extents of at most 1."""
    finite = jnp.isfinite(a).all() & jnp.isfinite(b).all()
    a, b = jnp.where(finite, a, 0), jnp.where(finite, b, 0)
    low = jnp.minimum(a.min(axis=0), b.min(axis=0))
    high = jnp.maximum(a.max(axis=0), b.max(axis=0))
    extent = (high - low).max()
    finite &= jnp.isfinite(extent)
    # If the extent underflows although the points differ, the distances 0 prove nothing.
    finite &= (extent > 0) | (low == high).all()
    extent = jnp.where(finite, extent, 0)
    _, exponent = jnp.frexp(jnp.where(extent > 0, extent, 1))
    middle = low + (high - low) / 2

    def scale(x: Array) -> Array:
        return jnp.ldexp(x, -exponent)

    n, exact = len(a), (scale(a), scale(b))
    a, b = (scale(x - middle[None]).astype(jnp.float32) for x in (a, b))
    columns = tuple(jnp.pad(x, (0, padded_size(n) - n), mode="edge") for x in b.T)
    # The barrier: XLA computes the points once, and distances have the same bits in every program.
    rows: tuple[Array, ...] = lax.optimization_barrier((a, *columns))
    if n <= _MOST_IN_TABLE:
        rows = (distance(tuple(rows[0].T[:, :, None]), tuple(x[None] for x in rows[1:])),)
    unit = jnp.ldexp(jnp.ones((), jnp.float32), exponent)
    return Problem(*exact, a, b, rows, unit, finite)


def row(rows: tuple[Array, ...], i: Array) -> tuple[Array, Array]:
    """A table with the distances of point i of a, and the number of their row."""
    if len(rows) == 1:
        return rows[0], i
    compute = jax.jit(lambda a, *columns: distance(tuple(read(a, i)), columns))
    return compute(*rows)[None], jnp.int32(0)


def lanes(table: Array, i: Array, prices: Array) -> Array:
    """`ordered_ints` of the minimum of distance plus price over each lane, for row i of a table."""
    return min_of_rows(ordered_ints(read(table, i) + prices).reshape(-1, num_lanes(len(prices))))


def _sweep(rows: tuple[Array, ...], n: int, prices: Array) -> tuple[Array, Array]:
    """u_i = min_j (c_ij + p_j), the largest u for the prices, and new p_j = max_i (u_i - c_ij)."""

    def loop(rows: Any, prices: Array, u: Array, lowest: Array) -> tuple[Array, Array]:
        def step(i: Any, state: tuple[Array, Array]) -> tuple[Array, Array]:
            u, lowest = state
            table, place = row(rows, i)
            value = floats(min_of_lanes(jax.jit(lanes)(table, place, prices)))
            price = value - read(table, place)
            return write(u, i, value), lax.select(lowest < price, price, lowest)

        return lax.fori_loop(jnp.int32(0), jnp.int32(len(u)), step, (u, lowest))

    start = vary_with(jnp.float32(-jnp.inf), prices)
    return as_one_function(loop, rows, prices, start[:n], start)


def accurate_sum(x: Array) -> Array:
    """The sum of n terms >= 0, with a relative error below `sum_rounding(n)`."""
    width = num_lanes(len(x))
    return jnp.pad(x, (0, -len(x) % width)).reshape(-1, width).sum(axis=0).sum()


def sum_rounding(n: int) -> float:
    """Bound on the relative error of `accurate_sum`."""
    width = num_lanes(n)
    return (-(-n // width) + width) * _UNIT


class DualBound(NamedTuple):
    """Cost of a bijection, lower bound on OPT, and prices (infinite for padding) and slacks."""

    cost: Array
    lower: Array
    prices: Array
    slack: Array


def dual_bound(problem: Problem, index: Array, prices: Array) -> DualBound:
    """The cost of the bijection i -> index[i], and the lower bound on OPT that prices prove."""
    a, b, n = problem.a, problem.b, len(index)
    # The largest u for these prices, then the lowest prices for this u, p_j = max_i (u_i - c_ij),
    # which improve the bound. A common shift of u and p changes nothing.
    u, prices = _sweep(problem.rows, n, prices)
    top = u.max()
    prices = jnp.where(lax.iota(jnp.int32, len(prices)) < n, prices, jnp.inf)
    lowest = prices.min()
    prices, u = prices - lowest, u - lowest
    # Coordinates before centring: an error of a few roundings; coincident points cost exactly 0.
    difference = (problem.exact_a - problem.exact_b[index]).astype(jnp.float32)
    cost = accurate_sum(jnp.sqrt(jnp.square(difference).sum(axis=-1)))
    matched = jnp.sqrt(jnp.square(a - b[index]).sum(axis=-1))
    slack = jnp.maximum(matched + prices[index] - u, 0)
    doubt = _ROUNDING * (2 + top + jnp.abs(lowest))
    relative = sum_rounding(n) + 8 * _UNIT
    lower = cost * (1 - relative) - accurate_sum(slack + doubt) * (1 + relative)
    return DualBound(cost, lower, prices, slack)


def gap_of(cost: Array, lower: Array, n: int) -> Array:
    """Proven bound on (cost - OPT) / OPT; infinite unless the lower bound is positive."""
    upper = cost * (1 + sum_rounding(n) + 10 * _UNIT)
    gap = jnp.where(lower > 0, (upper - lower) / jnp.where(lower > 0, lower, 1), jnp.inf)
    return jnp.where(cost == 0, 0.0, gap)

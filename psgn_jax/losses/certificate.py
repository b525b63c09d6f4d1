"""A proven bound on how far a bijection between two clouds is from optimal.

The notation is that of `auction`. By linear programming duality, for any prices p_j of the points
of b, and any u with u_i <= c_ij + p_j for all i and j, every bijection t costs at least

    sum_i c_{i,t(i)} >= sum_i (u_i - p_{t(i)}) = sum_i u_i - sum_j p_j.

The cost P of a bijection s therefore exceeds OPT by at most the sum of its slacks:

    P - OPT <= sum_i (c_{i,s(i)} + p_{s(i)} - u_i)

`gap` is this bound divided by a lower bound on OPT. It includes all float32 rounding errors, so it
is never too small. Memory is linear in n: distances are computed when they are needed.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jax import lax

from psgn_jax.array_types import Array
from psgn_jax.losses.numeric import bits, distance, least, num_lanes, vary_with

_TILE = 32  # targets per step of a pass over all distances
_UNIT = 2.0**-24  # unit roundoff of float32

# The terms of a slack c + p - u are bounded by 2 extents plus the largest price. The error of the
# slack is below 24 unit roundoffs times that bound: counting operations gives 18, if a square root
# is accurate to 2 units in the last place.
_ROUNDING = 24 * _UNIT


class Problem(NamedTuple):
    """One pair of clouds: scaled (`exact_*`), and scaled and centred (`a`, `b`); extents <= 1."""

    exact_a: Array
    exact_b: Array
    a: Array
    b: Array
    unit: Array  # a distance here times `unit` is a distance in the caller's unit
    finite: Array


def prepare(a: Array, b: Array) -> Problem:
    """Scales a pair of clouds by a power of two, which is exact, to extents of at most 1."""
    finite = jnp.isfinite(a).all() & jnp.isfinite(b).all()
    a, b = jnp.where(finite, a, 0), jnp.where(finite, b, 0)
    low = jnp.minimum(a.min(axis=0), b.min(axis=0))
    high = jnp.maximum(a.max(axis=0), b.max(axis=0))
    extent = (high - low).max()
    finite &= jnp.isfinite(extent)
    # If the extent underflows although the points differ, all distances are 0 and prove nothing.
    finite &= (extent > 0) | (low == high).all()
    extent = jnp.where(finite, extent, 0)
    _, exponent = jnp.frexp(jnp.where(extent > 0, extent, 1))
    middle = low + (high - low) / 2

    def scale(x: Array) -> Array:
        return jnp.ldexp(x, -exponent)

    centred = [scale(x - middle[None]).astype(jnp.float32) for x in (a, b)]
    unit = jnp.ldexp(jnp.ones((), jnp.float32), exponent)
    return Problem(scale(a), scale(b), centred[0], centred[1], unit, finite)


def cheapest(points: Array, targets: Array, prices: Array) -> Array:
    """min_j (|points_i - targets_j| + prices_j) for every i, in tiles of targets; prices >= 0."""
    padding = -len(targets) % _TILE
    tiles = jnp.pad(targets, ((0, padding), (0, 0)), mode="edge").reshape(-1, _TILE, 3)
    prices = jnp.pad(prices, (0, padding), constant_values=jnp.inf).reshape(-1, _TILE)
    rows = tuple(points[None, :, k] for k in range(3))

    def step(best: Array, tile: tuple[Array, Array]) -> tuple[Array, None]:
        target, price = tile
        value = distance(rows, tuple(target[:, k, None] for k in range(3))) + price[:, None]
        return lax.min(best, least(bits(value))), None

    start = bits(vary_with(jnp.float32(jnp.inf), points[:, 0] == targets[0, 0]))
    return lax.bitcast_convert_type(lax.scan(step, start, (tiles, prices))[0], jnp.float32)


def accurate_sum(x: Array) -> Array:
    """The sum of n terms >= 0, with a relative error below `sum_rounding(n)`."""
    width = num_lanes(len(x))
    return jnp.pad(x, (0, -len(x) % width)).reshape(-1, width).sum(axis=0).sum()


def sum_rounding(n: int) -> float:
    """Bound on the relative error of `accurate_sum`."""
    width = num_lanes(n)
    return (-(-n // width) + width) * _UNIT


class DualBound(NamedTuple):
    """Cost of a bijection, lower bound on OPT, prices and slacks after the backward sweep."""

    cost: Array
    lower: Array
    prices: Array
    slack: Array


def dual_bound(problem: Problem, index: Array, prices: Array) -> DualBound:
    """The cost of the bijection i -> index[i], and the lower bound on OPT that prices prove."""
    a, b, n = problem.a, problem.b, len(index)
    # The largest u for these prices. Then, with u fixed, the lowest prices, p_j = max_i (u_i -
    # c_ij): this backward sweep improves the bound. A common shift of u and p changes nothing.
    u = cheapest(a, b, prices)
    top = u.max()
    prices = top - cheapest(b, a, top - u)
    lowest = prices.min()
    prices, u = prices - lowest, u - lowest
    # The cost uses the coordinates before centring: its relative error is a few roundings at any
    # offset, and coincident points cost exactly 0.
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

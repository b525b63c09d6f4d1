"""Bertsekas' auction: a nearly optimal bijection between two clouds, with a proven gap.

The problem, for clouds a and b of n points each and Euclidean costs c_ij = |a_i - b_j|:

    OPT = min over bijections s of sum_i c_{i, s(i)}

Every point of a is a bidder, every point of b an object with a price p_j. A bidder without an
object takes the cheapest object, j = argmin_j (c_ij + p_j), and raises its price by epsilon plus
the margin to the second cheapest. A displaced bidder must bid again. When every bidder has an
object, all pairs satisfy epsilon-complementary slackness:
c_{i,s(i)} + p_{s(i)} <= min_j (c_ij + p_j) + epsilon.

With a large epsilon the auction ends fast, with a small epsilon near the optimum. It therefore runs
in phases with decreasing epsilon (epsilon scaling). A phase starts from the prices of the previous
phase and from the pairs that satisfy the slackness for the new epsilon. Between phases,
`certificate.dual_bound` bounds how far the bijection is from the optimum and improves the prices.

Sources: Bertsekas, "A Distributed Algorithm for the Assignment Problem", MIT LIDS working paper,
1979; Bertsekas, "Auction Algorithms for Network Flow Problems: A Tutorial Introduction",
Computational Optimization and Applications 1, 1992 (epsilon scaling, reverse auctions).
"""

import concurrent.futures
import functools
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.custom_batching import custom_vmap, sequential_vmap

from psgn_jax.array_types import Array, Bool, Float, Int
from psgn_jax.losses.certificate import DualBound, dual_bound, gap_of, lanes, prepare, row
from psgn_jax.losses.numeric import (
    INFINITE,
    as_one_function,
    check_points,
    floats,
    min_of_lanes,
    min_of_rows,
    num_lanes,
    ordered_ints,
    padded_size,
    per_platform,
    read,
    vary_with,
    write,
)
from psgn_jax.system.cores import num_cores

# The paper (section "Distance Metric between Point Sets") reports an error of about 1 %.
TOLERANCE = 0.01
# Default budget, in bids per point. For a gap of 1 %, 1,024 points of the authors' need 5 to 40.
BIDS_PER_POINT = 2000

_MOST_BIDS = 2**31 - 1  # bids are counted in int32
_START = 0.1  # first epsilon; the extent of the scaled clouds is 0.5 to 1
_FACTOR = 8.0  # epsilon is divided by at most this from phase to phase
_AIM = 0.8  # epsilon is chosen so that the next gap is about _AIM times the tolerance
_FLOOR = 2.0**-20  # smallest epsilon: a few units in the last place of the prices
_RAISE = 4.0  # epsilon is multiplied by this when half of the budget is spent,
_RAISES = 16  # at most this often


class _Bidding(NamedTuple):
    """State of the loop over bids."""

    prices: Array  # [padded_size(n)] prices of the objects, infinite for padding
    owner: Array  # [n] bidder of every object, -1 if it has none
    stack: Array  # [n] its first `waiting` entries are the bidders without an object
    waiting: Array
    bids: Array


def _first(x: Array, value: Array) -> Array:
    """Index of the first element of x that equals `value`."""
    places = lax.iota(jnp.int32, len(x))
    return min_of_rows(lax.select(x == value, places, jnp.full_like(x, len(x))))


def _bid(rows: Any, epsilon: Array, state: _Bidding) -> _Bidding:
    """The bid of the bidder on top of the stack, which a displaced bidder replaces there."""
    top, width = state.waiting - 1, num_lanes(len(state.owner))
    get = jax.jit(read)  # so that XLA reads an array before it writes to it
    bidder = get(state.stack, top)
    table, place = row(rows, bidder)
    # The cheapest object: the minimum of each lane, the best lane, the row in that lane.
    by_lane = jax.jit(lanes)(table, place, state.prices)
    best = min_of_lanes(by_lane)
    lane = _first(by_lane, best)

    def column(x: Array, i: Array) -> Array:
        x = x.reshape(-1, len(state.prices) // width, width)
        return lax.dynamic_slice(x, (i, jnp.int32(0), lane), (1, x.shape[1], 1)).reshape(-1)

    in_lane = ordered_ints(column(table, place) + column(state.prices, jnp.int32(0)))
    in_lane = lax.pad(in_lane, jnp.int32(INFINITE), [(0, width - len(in_lane), 0)])
    line = _first(in_lane, best)
    # The second best is the minimum over the other objects, so an exact tie has margin 0.
    places, infinite = lax.iota(jnp.int32, width), jnp.full(width, INFINITE, jnp.int32)
    others = lax.select(places == lane, infinite, by_lane)
    second = min_of_rows(lax.min(others, lax.select(places == line, infinite, in_lane)))
    margin = lax.select(second == infinite[0], jnp.float32(0), floats(second) - floats(best))
    chosen = line * width + lane
    displaced = get(state.owner, chosen)
    free = displaced < 0
    return _Bidding(
        write(state.prices, chosen, read(state.prices, chosen) + margin + epsilon),
        # No number is below -1; `select` makes XLA read `displaced` before it writes the bidder. An
        # optimization barrier does so, too, but is a tenth slower.
        write(state.owner, chosen, lax.select(displaced < -1, displaced, bidder)),
        write(state.stack, top, lax.select(free, bidder, displaced)),
        lax.select(free, top, state.waiting),
        state.bids + 1,
    )


def _bid_all(rows: tuple[Array, ...], epsilon: Array, limit: Array, state: _Bidding) -> _Bidding:
    """Bids until every bidder has an object or the total of bids reaches `limit`."""

    def loop(rows: Any, epsilon: Array, limit: Array, state: _Bidding) -> _Bidding:
        return lax.while_loop(
            lambda s: (s.waiting > 0) & (s.bids < limit), lambda s: _bid(rows, epsilon, s), state
        )

    return as_one_function(loop, rows, epsilon, limit, state)


def _begin(bound: DualBound, index: Array, epsilon: Array, bids: Array) -> _Bidding:
    """The start of a phase: keeps the pairs that satisfy the slackness for `epsilon`."""

    def loop(keep: Array, index: Array) -> tuple[Array, ...]:
        def step(i: Any, state: tuple[Array, ...]) -> tuple[Array, ...]:
            owner, stack, waiting = state
            keeps = read(keep, i)
            owner = write(owner, read(index, i), lax.select(keeps, i, jnp.int32(-1)))
            return owner, write(stack, waiting, i), lax.select(keeps, waiting, waiting + 1)

        start = index, index, vary_with(jnp.int32(0), index[0])
        return lax.fori_loop(jnp.int32(0), jnp.int32(len(index)), step, start)

    owner, stack, waiting = as_one_function(loop, bound.slack <= epsilon, index)
    return _Bidding(bound.prices, owner, stack, waiting, bids)


def _bijection(s: _Bidding) -> Array:
    """The bijection bidder -> object; objects without an owner get the waiting bidders."""

    def loop(owner: Array, stack: Array) -> Array:
        def step(i: Any, state: tuple[Array, Array]) -> tuple[Array, Array]:
            index, used = state
            bidder = read(owner, i)
            free = bidder < 0
            bidder = lax.select(free, read(stack, used), bidder)
            return write(index, bidder, i), lax.select(free, used + 1, used)

        start = owner, vary_with(jnp.int32(0), owner[0])
        return lax.fori_loop(jnp.int32(0), jnp.int32(len(owner)), step, start)[0]

    return as_one_function(loop, s.owner, s.stack)


class _Phase(NamedTuple):
    """State of the loop over phases."""

    bidding: _Bidding
    epsilon: Array
    done: Array
    index: Array  # type: ignore[assignment]  # [n] the cheapest bijection so far
    cost: Array  # of `index`
    proof: Array  # the prices that prove `lower`
    lower: Array  # the highest lower bound so far
    gap: Array


@jax.jit  # compiled once per size
def _solve(a: Array, b: Array, tolerance: Array, max_bids: Array) -> tuple[Array, ...]:
    """Runs the phases for one pair on a CPU; returns index, prices, bids and gap."""
    problem, n = prepare(a, b), len(a)
    prices = jnp.where(lax.iota(jnp.int32, padded_size(n)) < n, 0, jnp.float32(jnp.inf))
    start = [lax.iota(jnp.int32, n), prices, jnp.float32(_START), jnp.int32(0)]
    index, prices, epsilon, bids = (vary_with(x, problem.finite) for x in start)
    if n == 1:  # there is nothing to solve
        return index, 0 * prices[:n], bids, jnp.where(problem.finite, jnp.float32(0), jnp.nan)
    first = dual_bound(problem, index, prices)
    # Half of the budget is for reaching the tolerance. Later, a phase without a complete matching
    # is followed by a phase with a larger epsilon.
    half = max_bids - max_bids // 2
    patience = jnp.maximum(max_bids // 2 // _RAISES, 1)

    def phase(s: _Phase) -> _Phase:
        limit = jnp.minimum(jnp.maximum(half, s.bidding.bids + patience), max_bids)
        bidding = _bid_all(problem.rows, s.epsilon, limit, s.bidding)
        index = _bijection(bidding)
        new = dual_bound(problem, index, bidding.prices)
        better, higher = new.cost < s.cost, new.lower > s.lower
        cost = jnp.where(better, new.cost, s.cost)
        lower = jnp.where(higher, new.lower, s.lower)
        gap = gap_of(cost, lower, n)
        # Near the end, aim a little below the tolerance, with a bounded change of epsilon.
        aim = jnp.where(jnp.isfinite(gap), _AIM * tolerance / gap, 0)
        epsilon = s.epsilon * jnp.clip(aim, 1 / _FACTOR, 0.7)
        floor = _FLOOR * (1 + new.prices[:n].max())
        complete = bidding.waiting == 0
        done = (gap <= tolerance) | (complete & (s.epsilon <= floor))
        done |= bidding.bids >= max_bids
        epsilon = jnp.where(complete, jnp.maximum(epsilon, floor), _RAISE * s.epsilon)
        best = jnp.where(better, index, s.index), cost
        proof = jnp.where(higher, new.prices, s.proof), lower
        bidding = _begin(new, index, epsilon, bidding.bids)
        return _Phase(bidding, epsilon, done, *best, *proof, gap)

    gap = gap_of(first.cost, first.lower, n)
    done = ~problem.finite | (gap <= tolerance) | (max_bids <= 0)
    best = index, first.cost, first.prices, first.lower
    state = _Phase(_begin(first, index, epsilon, bids), epsilon, done, *best, gap)
    state = lax.while_loop(lambda s: ~s.done, phase, state)
    gap = jnp.where(problem.finite, state.gap, jnp.nan)
    return state.index, state.proof[:n] * problem.unit, state.bidding.bids, gap


@functools.cache
def _threads() -> concurrent.futures.ThreadPoolExecutor:
    return concurrent.futures.ThreadPoolExecutor(num_cores(), "auction")


def _solve_all(*pairs: Array) -> tuple[np.ndarray, ...]:
    """`_solve` on the host's cores, for arrays with any leading axes."""
    arrays, axes = [np.asarray(x) for x in pairs], pairs[-1].shape
    cloud, cpu = axes + arrays[0].shape[-2:-1], jax.local_devices(backend="cpu")[0]
    shapes = (cloud, np.int32), (cloud, np.float32), (axes, np.int32), (axes, np.float32)
    results = tuple(np.empty(*shape) for shape in shapes)

    def solve(place: tuple[int, ...]) -> None:
        with jax.enable_x64(arrays[0].dtype == np.float64), jax.default_device(cpu):
            for result, value in zip(results, _solve(*(x[place] for x in arrays)), strict=True):
                result[place] = value

    list(_threads().map(solve, np.ndindex(axes)))  # reading the results raises the errors
    return results


def _on_host(*pair: Array) -> Any:
    shapes = jax.eval_shape(_solve, *pair)
    shapes = [jax.ShapeDtypeStruct(x.shape, x.dtype) for x in shapes]
    results = jax.pure_callback(_solve_all, shapes, *pair, vmap_method="broadcast_all")
    # In `jax.shard_map`, the results of both programs must vary along the same axes of the mesh.
    a, b, tolerance, budget = pair
    varies = a[0, 0] + b[0, 0] + tolerance + budget
    return tuple(vary_with(x, varies) for x in results)


# An accelerator would launch several kernels for each of some ten thousand bids. So the host solves
# all pairs of a batch in one callback. On a CPU, we solve the pairs one after another, under `vmap`
# too: in lockstep, each pair would take as long as the slowest, and each bid copy all states.
@custom_vmap
def _solve_anywhere(*pair: Array) -> Any:
    return per_platform(_solve, _on_host, *pair)


@_solve_anywhere.def_vmap
def _solve_batch(size: int, mapped: Sequence[bool], *arrays: Array) -> Any:
    axes = [0 if has_axis else None for has_axis in mapped]
    in_turn = jax.vmap(sequential_vmap(_solve_anywhere), axes)
    return per_platform(in_turn, jax.vmap(_on_host, axes), *arrays), (True,) * 4


def _check_number(value: Any, name: str, expected: str, most_whole: float | int = math.inf) -> None:
    """Raises ValueError unless an untraced value is a number >= 0, or an integer up to a limit."""
    if not isinstance(value, jax.core.Tracer):
        x = np.asarray(value)
        fits = not x.ndim and x.dtype.kind in "iuf" and 0 <= x <= most_whole
        if not fits or (math.isfinite(most_whole) and x != np.floor(x)):
            raise ValueError(f"{name}: got {value}, expected {expected}")


class Assignment(NamedTuple):
    """A bijection, pred[i] with gt[index[i]], its certificate, and its `iterations` (bids).

    `prices` are dual prices of the points of gt, in the unit of the clouds; the smallest is 0. They
    prove `gap`, a bound on (cost - OPT) / OPT, which is infinite without a positive lower bound on
    OPT. `converged` is gap <= tolerance.
    """

    index: Int[Array, " n"]  # type: ignore[assignment]  # hides tuple.index
    prices: Float[Array, " n"]
    converged: Bool[Array, ""]
    iterations: Int[Array, ""]
    gap: Float[Array, ""]


def assign(
    pred: Float[Array, "n 3"],
    gt: Float[Array, "n 3"],
    *,
    tolerance: float | Array = TOLERANCE,
    max_bids: int | Array | None = None,
) -> Assignment:
    """A bijection of pred and gt with a nearly minimal sum of Euclidean distances, and its gap.

    The solver stops after the first phase with `gap` <= tolerance. When half of the budget is
    spent, epsilon grows until a phase ends with a complete matching, as in the paper, and falls
    again while budget is left. The result is always a bijection, and `gap` always holds for it. It
    has no gradient (`emd` has one). The host's cores solve clouds on an accelerator, the pairs of a
    `vmap` in parallel; an exception there ends the calling program.

    Args:
      pred: [n, 3], n >= 1, a floating dtype, any unit; solved in float32.
      gt: [n, 3].
      tolerance: >= 0, accepted (cost - OPT) / OPT. Float32 cannot prove gaps below about 1e-4.
      max_bids: the budget, an integer from 0 to 2**31 - 1; None: 2000 n. A bid is a pass over the n
        distances of a point.

    Raises:
      ValueError: wrong shape or dtype, unequal sizes, a wrong tolerance or budget, or (called
        directly) a non-finite coordinate. Inside `jit`, `vmap` and `grad`, such a coordinate, or an
        extent in (0, 1e-38), gives the bijection i -> i, `converged` False and a NaN gap.
    """
    a, b = check_points(pred, "pred"), check_points(gt, "gt")
    if len(a) != len(b):
        raise ValueError(
            f"gt: got {len(b)} points, expected as many as pred has ({len(a)}): a bijection needs"
            " equal sizes (take a subset, or use a Chamfer distance)"
        )
    if max_bids is None:
        max_bids = min(BIDS_PER_POINT * len(a), 2**30)
    _check_number(tolerance, "tolerance", "a number >= 0")
    _check_number(max_bids, "max_bids", f"an integer from 0 to {_MOST_BIDS}", _MOST_BIDS)
    dtype = jnp.promote_types(a.dtype, b.dtype)
    a, b = (lax.stop_gradient(x.astype(dtype)) for x in (a, b))
    tolerance, budget = jnp.asarray(tolerance, jnp.float32), jnp.asarray(max_bids, jnp.int32)
    index, prices, bids, gap = _solve_anywhere(a, b, tolerance, budget)
    return Assignment(index, prices, gap <= tolerance, bids, gap)

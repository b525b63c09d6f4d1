"""Bertsekas' auction algorithm for the assignment problem of two clouds, in plain JAX.

The problem, for clouds a and b of n points each and Euclidean costs c_ij = |a_i - b_j|:

    OPT = min over bijections s of sum_i c_{i, s(i)}

Every point of a is a bidder, every point of b an object with a price p_j. A bidder without an
object takes the object that is cheapest for it, j = argmin_j (c_ij + p_j). It raises the price of j
by the margin to its second cheapest object plus epsilon. The bidder it displaces must bid again.
When every bidder has an object, all pairs satisfy epsilon-complementary slackness:
c_{i,s(i)} + p_{s(i)} <= min_j (c_ij + p_j) + epsilon.

With a large epsilon the auction ends fast, with a small one it ends near the optimum. It therefore
runs in phases with decreasing epsilon (epsilon scaling). A phase starts from the prices of the
previous phase and from the pairs that already satisfy the slackness condition of the new epsilon.

The module `certificate` bounds how far the cost of the result is above the optimum. It also
improves the prices between phases.

Sources: Bertsekas, "A Distributed Algorithm for the Assignment Problem", MIT LIDS working paper,
1979; Bertsekas, "Auction Algorithms for Network Flow Problems: A Tutorial Introduction",
Computational Optimization and Applications 1, 1992 (epsilon scaling, reverse auctions). Fan, Su and
Guibas, CVPR 2017, section "Distance Metric between Point Sets", use the auction with a fixed time
per instance; they raise the accepted error step by step, so that the auction ends.
"""

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from psgn_jax.losses.certificate import (
    Judged,
    bijection,
    bits,
    distance,
    front,
    gap_of,
    judge,
    least,
    num_lanes,
    prepare,
)
from psgn_jax.losses.xla import as_one_function, one_pair_at_a_time, vary_with, write_once
from psgn_jax.types import Array

_FACTOR = 8.0  # epsilon is divided by at most this from phase to phase
_AIM = 0.8  # epsilon is chosen so that the next gap is about _AIM times the tolerance
_RAISE = 4.0  # epsilon is multiplied by this when half of the budget is spent,
_RAISES = 16  # at most this often
_START = 0.1  # first epsilon, relative to the extent of the clouds
_FLOOR = 2.0**-20  # smallest epsilon: a few units in the last place of the prices

# The later CUDA kernel of the paper's group: epsilon 1e-4, multiplied by 100 after every 40 n bids,
# at most 1.
_AUTHORS_START, _AUTHORS_RAISE, _AUTHORS_BIDS, _AUTHORS_CAP = 1e-4, 100.0, 40, 1.0


class _Bidding(NamedTuple):
    """State of the loop over bids."""

    prices: Array  # [R, L] prices of the objects, infinite for padding
    owner: Array  # [R L] bidder of every object, -1 if it has none
    stack: Array  # [n] the first `waiting` entries are the bidders without an object
    waiting: Array
    bids: Array


class _Phase(NamedTuple):
    """State of the loop over phases."""

    epsilon: Array
    prices: Array  # [n]
    owner: Array  # [n]
    waiting: Array  # number of bidders without an object; > 0 at the end: the budget ran out
    stack: Array
    bids: Array
    raises: Array
    index: Array  # type: ignore[assignment]  # [n] the cheapest bijection so far
    cost: Array  # cost of `index`
    proof: Array  # [n] the prices that prove `lower`
    lower: Array  # the best lower bound so far
    gap: Array


def _take(x: Array, i: Array) -> Array:
    return lax.dynamic_slice(x, (i,), (1,))[0]


def _put(x: Array, i: Array, value: Array) -> Array:
    return lax.dynamic_update_slice(x, value[None], (i,))


def _bid(a: Array, columns: tuple[Array, ...], epsilon: Array, state: _Bidding) -> _Bidding:
    """Lets the bidder on top of the stack bid; a bidder that it displaces replaces it there."""
    top = state.waiting - 1
    bidder = _take(state.stack, top)
    point = lax.dynamic_slice(a, (bidder, 0), (1, 3))[0]
    height, width = columns[0].shape
    value = distance(columns, tuple(point[k] for k in range(3))) + state.prices
    value = write_once(bits(value))
    lanes, rows = lax.iota(jnp.int32, width), lax.iota(jnp.int32, height)
    by_lane = write_once(least(value))
    best = least(by_lane)
    lane = least(jnp.where(by_lane == best, lanes, width))
    column = lax.dynamic_slice(value, (0, lane), (height, 1))[:, 0]
    row = least(jnp.where(column == best, rows, height))
    # The second best is taken over all objects but the chosen one, so an exact tie has margin 0.
    infinite = jnp.int32(0x7F800000)
    second = lax.min(
        least(jnp.where(lanes == lane, infinite, by_lane)),
        least(jnp.where(rows == row, infinite, column)),
    )
    first, other = (lax.bitcast_convert_type(x, jnp.float32) for x in (best, second))
    margin = jnp.where(second == infinite, 0.0, other - first)
    price = lax.dynamic_slice(state.prices, (row, lane), (1, 1)) + margin + epsilon
    chosen = row * width + lane
    displaced = _take(state.owner, chosen)
    free = displaced < 0
    return _Bidding(
        lax.dynamic_update_slice(state.prices, price, (row, lane)),
        _put(state.owner, chosen, bidder),
        _put(state.stack, top, jnp.where(free, bidder, displaced)),
        jnp.where(free, top, state.waiting),
        state.bids + 1,
    )


def _bid_all(
    a: Array, b: Array, epsilon: Array, limit: Array, state: _Bidding, *, fused: bool
) -> _Bidding:
    """Bids until every bidder has an object or `limit` bids have been made in total."""
    n, width = len(a), num_lanes(len(a))
    padding = -n % width
    columns = tuple(
        jnp.pad(b[:, k], (0, padding), mode="edge").reshape(-1, width) for k in (0, 1, 2)
    )

    def loop(a: Array, columns: Any, epsilon: Array, limit: Array, state: _Bidding) -> _Bidding:
        return lax.while_loop(
            lambda s: (s.waiting > 0) & (s.bids < limit),
            lambda s: _bid(a, columns, epsilon, s),
            state,
        )

    state = state._replace(
        prices=jnp.pad(state.prices, (0, padding), constant_values=jnp.inf).reshape(-1, width),
        owner=jnp.pad(state.owner, (0, padding), constant_values=-1),
    )
    if fused:
        loop = as_one_function(loop)
    state = loop(a, columns, epsilon, limit, state)
    return state._replace(prices=state.prices.reshape(-1)[:n], owner=state.owner[:n])


def _owners(index: Array, kept: Array) -> Array:
    n = len(index)
    bidders = lax.iota(jnp.int32, n)
    return jnp.full_like(index, -1).at[jnp.where(kept, index, n)].set(bidders, mode="drop")


def _solve(
    a: Array, b: Array, tolerance: Array, max_bids: Array, *, authors: bool, fused: bool
) -> tuple[Array, Array, Array, Array]:
    """Runs the phases for one pair; returns index, prices, bids and gap.

    Deliberately one function: all parts of the loop use the problem, the budget and the
    schedule.
    """
    n = len(a)
    problem = prepare(a, b)
    numbers = lax.iota(jnp.int32, n)
    here = problem.finite
    zero = vary_with(0, here)
    index = vary_with(numbers, here)
    first = judge(problem, index, vary_with(jnp.zeros(n), here))

    start: Array
    quiet: Array  # number of bids before epsilon is raised for the first time
    patience: Array  # number of bids between later raises
    if authors:
        # The authors' numbers are in the unit of their clouds.
        start, cap = _AUTHORS_START / problem.unit, _AUTHORS_CAP / problem.unit
        raise_by, start_prices = _AUTHORS_RAISE, jnp.zeros_like(first.prices)
        quiet = patience = jnp.int32(_AUTHORS_BIDS * n)
    else:
        start, cap = vary_with(_START, here), vary_with(jnp.inf, here)
        raise_by, start_prices = _RAISE, first.prices
        # Half of the budget is for reaching the tolerance, half for completing the matching.
        quiet = max_bids - max_bids // 2
        patience = jnp.maximum(max_bids // 2 // _RAISES, 1)
    keep = first.slack <= start if not authors else vary_with(jnp.zeros(n, bool), here)

    def begin(judged: Judged, index: Array, keep: Array) -> tuple[Array, Array, Array]:
        free = ~keep
        return _owners(index, keep), free.sum(dtype=jnp.int32), front(free)

    owner, waiting, stack = begin(first, index, keep)
    state = _Phase(
        epsilon=start,
        prices=start_prices,
        owner=owner,
        waiting=waiting,
        stack=stack,
        bids=zero,
        raises=zero,
        index=index,
        cost=first.cost,
        proof=first.prices,
        lower=first.lower,
        gap=gap_of(first.cost, first.lower, n),
    )

    def unfinished(s: _Phase) -> Array:
        if authors:
            unfinished = (s.waiting > 0) & (s.raises < 3)
        else:
            # A complete matching is final if the phase with the smallest epsilon is done
            # (`end_phase` then sets epsilon to 0), or if epsilon was raised.
            unfinished = (s.waiting > 0) | ((s.raises == 0) & (s.epsilon > 0))
        return (s.gap > tolerance) & unfinished & (s.bids < max_bids) & problem.finite

    def end_phase(s: _Phase) -> _Phase:
        index = bijection(s.owner)
        new = judge(problem, index, s.prices)
        better, higher = new.cost < s.cost, new.lower > s.lower
        s = s._replace(
            index=jnp.where(better, index, s.index),
            cost=jnp.where(better, new.cost, s.cost),
            proof=jnp.where(higher, new.prices, s.proof),
            lower=jnp.where(higher, new.lower, s.lower),
            prices=new.prices,
        )
        gap = gap_of(s.cost, s.lower, n)
        if authors:
            return s._replace(gap=gap)
        # Near the end aim a little below the tolerance, but change epsilon neither too little nor
        # too much.
        aim = jnp.where(jnp.isfinite(gap), _AIM * tolerance / gap, 0)
        epsilon = s.epsilon * jnp.clip(aim, 1 / _FACTOR, 0.7)
        floor = _FLOOR * (1 + s.prices.max())
        last = s.epsilon <= floor
        epsilon = jnp.maximum(epsilon, floor)
        done = last | (gap <= tolerance) | (s.raises > 0)
        owner, waiting, stack = begin(new, index, new.slack <= epsilon)
        return s._replace(
            gap=gap,
            # Epsilon 0 marks the end.
            epsilon=jnp.where(done, 0.0, epsilon),
            owner=jnp.where(done, s.owner, owner),
            waiting=jnp.where(done, 0, waiting),
            stack=jnp.where(done, s.stack, stack),
        )

    def hurry(s: _Phase) -> _Phase:
        return s._replace(epsilon=jnp.minimum(s.epsilon * raise_by, cap), raises=s.raises + 1)

    def phase(s: _Phase) -> _Phase:
        limit = jnp.minimum(quiet + patience * s.raises, max_bids)
        state = _Bidding(s.prices, s.owner, s.stack, s.waiting, s.bids)
        state = _bid_all(problem.a, problem.b, s.epsilon, limit, state, fused=fused)
        s = s._replace(**state._asdict())
        return lax.cond(s.waiting == 0, end_phase, hurry, s)

    state = lax.while_loop(unfinished, phase, state)
    # If the budget ran out within a phase, the matching is incomplete. `end_phase` completes it and
    # keeps the result if it is better than the best bijection so far.
    state = lax.cond(state.waiting > 0, end_phase, lambda s: s, state)
    gap = jnp.where(problem.finite, state.gap, jnp.nan)
    return state.index, state.proof * problem.unit, state.bids, gap


def _solver(authors: bool) -> Any:
    # Compiled once per size, even if the caller does not use `jit`.
    solve = jax.jit(functools.partial(_solve, authors=authors), static_argnames="fused")

    # On a CPU the pairs of a batch are solved one after another. In lock step every pair would take
    # as long as the slowest one, and every bid would copy the state of all pairs.
    @one_pair_at_a_time
    def cpu(a: Array, b: Array, tolerance: Array, max_bids: Array) -> Any:
        return solve(a, b, tolerance, max_bids, fused=True)

    def default(a: Array, b: Array, tolerance: Array, max_bids: Array) -> Any:
        return solve(a, b, tolerance, max_bids, fused=False)

    return cpu, default


SOLVERS = {authors: _solver(authors) for authors in (False, True)}
"""Key: whether the schedule is "authors". Value: the solvers for a CPU and for other devices."""

"""The auction on a GPU: a Pallas kernel (Triton) that solves one pair of clouds per program.

The algorithm is that of `losses.auction`: Bertsekas' auction with epsilon scaling. A phase keeps
the pairs of the previous one that still satisfy epsilon-complementary slackness. Here the whole
solve is one launch instead of several launches per bid. The coordinates, prices and owners of the
objects are in the registers of one program (4 warps for 1,024 points, 8 objects per thread). The
coordinates of the bidders are in the first-level cache. Under `vmap` the batch is an axis of the
launch, with one program per pair; the programs end independently.

In a round of bids, each of K lanes holds one bidder without an object. The tile [K, n] of distances
is computed from coordinates. Each lane computes the minimum of distance plus price, the first
object that attains it, and the minimum over all other objects (so an exact tie has margin 0). If
several lanes choose the same object, the highest bid wins; among equal bids, the lowest lane wins.
Bids are compared in the registers in which they were computed; none is computed a second time for
the comparison, where it could be rounded differently. An object therefore has exactly one winner,
and the owners remain a matching. A lane continues with the bidder it displaced. If the object was
free, the lane takes the next bidder from the list of those still without an object in this phase. K
decreases from 8 to 2 to 1 as the list runs out: few bidders are left at the end of a phase, so most
lanes of a wide tile would be idle.

Cost of a round at 1,024 points and 4 warps, from the machine code of Triton 3.6 for sm_90: 2,630
instructions per warp for K = 8, 641 for K = 2, 340 for K = 1, and 12 to 16 barriers, without spills
inside the rounds. With one warp per scheduler at most one instruction is issued per cycle. Four
reductions across the program depend on each other and take about 150 cycles each. A round therefore
takes about 3,400, 1,500 and 1,100 cycles for K = 8, 2 and 1. Pairs of 1,024 points at 1 % took, in
interpret mode, 2,500 to 3,600 rounds with K = 8, 300 to 1,400 with K = 2 and 700 to 4,600 with
K = 1, in 6 or 7 phases. The passes over all distances at the start of each phase add 128 steps of
1,900 instructions each. The total is 10 to 18 million cycles, which is 6 to 10 ms at 1.75 GHz. All
pairs of a batch take this time together if the GPU has at least as many multiprocessors. These are
estimates: the kernel has not been run on a GPU yet.

The kernel returns a matching and prices, from which the module `certificate` computes the
bijection, its cost and the proven gap. The proof does not depend on how they were computed.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jax.experimental import pallas as pl
from jax.experimental.pallas import triton as plgpu

from psgn_jax.losses import certificate
from psgn_jax.losses.kernels.dispatch import varying_like
from psgn_jax.types import Array

# 16 warps with 8 objects per thread; more points do not fit in the registers.
MAX_POINTS = 4096

_LANES = (8, 2, 1)  # K, in the order of use
_FACTOR = 5.0  # epsilon is divided by at most this from phase to phase
_START = 0.1  # first epsilon, relative to the largest distance
_SAFETY = 0.85  # the phases aim at this fraction of the tolerance; the rest is for rounding errors
_FLOOR = 2.0**-20  # smallest epsilon (clouds of extent 1): a few units in the last place of a price
_RAISES = 16  # after half of the budget epsilon is multiplied by 4, at most this often
_TINY = 1e-37  # smaller squared distances count as zero


class Matching(NamedTuple):
    """The owner of each object, and prices that bound the optimum from below.

    `owner[j]` is the bidder of object j, or -1 if the budget ran out before it had one. No bidder
    owns two objects. The optimum is at least sum_i min_j (c_ij + prices_j) - sum_j prices_j.
    """

    owner: Array
    prices: Array
    bids: Array


class _Rounds(NamedTuple):
    prices: Array  # [1, size], infinite for padding
    owner: Array  # [1, size]
    who: Array  # [K] bidder of each lane, -1 if none
    head: Array  # number of bidders taken from the list so far
    active: Array  # number of lanes with a bidder
    bids: Array


class _Phases(NamedTuple):
    prices: Array
    owner: Array
    epsilon: Array
    bound: Array  # the highest lower bound of the optimum so far
    done: Array
    bids: Array


def _kernel(  # type: ignore[no-untyped-def]
    x_ref,
    y_ref,
    tolerance_ref,
    budget_ref,
    prices_ref,
    owner_ref,
    bids_ref,
    object_ref,
    list_ref,
    slack_ref,
    *,
    n: int,
    barrier: Callable[[], Any],
) -> None:
    """The program for one pair, described in the module docstring.

    Deliberately one function: a kernel is traced as a whole and its parts use the same references.
    """
    # object_ref, list_ref and slack_ref are working memory. They are outputs, because Pallas has no
    # scratch memory for Triton. Masked stores go to the entry after the last one: `nowhere`.
    size = nowhere = prices_ref.shape[1]
    wide = _LANES[0]
    tolerance, budget = tolerance_ref[0], budget_ref[0]
    objects = lax.broadcasted_iota(jnp.int32, (1, size), 1)
    real = objects < n
    columns = [y_ref[axis, :][None, :] for axis in range(3)]
    zero = jnp.int32(0)

    def distances(who: Array) -> Array:
        x, y, z = (x_ref[axis, who][:, None] - columns[axis] for axis in range(3))
        square = x * x + y * y + z * z
        return square * lax.rsqrt(jnp.maximum(square, _TINY))

    def over_bidders(step: Callable, *start: Array) -> tuple[Array, ...]:
        def body(block: Array, carry: tuple[Array, ...]) -> tuple[Array, ...]:
            rows = block * wide + lax.iota(jnp.int32, wide)
            return step(rows, rows < n, distances(rows), *carry)

        return lax.fori_loop(zero, jnp.int32(-(-n // wide)), body, start)

    def count(condition: Array) -> Array:
        return jnp.sum(condition.astype(jnp.int32), dtype=jnp.int32)

    def places(condition: Array, axis: int) -> Array:
        # The positions to which the chosen entries are moved: the front of the list, in order.
        place = jnp.cumsum(condition.astype(jnp.int32), axis=axis, dtype=jnp.int32) - 1
        return jnp.where(condition, place, nowhere)

    def opening(rows, live, cost, column, row_sum, widest):  # type: ignore[no-untyped-def]
        known = live[:, None] & real
        cost = jnp.where(known, cost, jnp.inf)
        column = jnp.minimum(column, jnp.min(cost, axis=0)[None, :])
        row_sum = row_sum + jnp.where(live, jnp.min(cost, axis=1), 0.0)
        widest = jnp.maximum(widest, jnp.max(jnp.where(known, cost, 0.0), axis=1))
        return column, row_sum, widest

    def measure(rows, live, cost, slack_sum, primal, prices):  # type: ignore[no-untyped-def]
        worth = cost + prices
        mine = objects == object_ref[rows][:, None]
        slack = jnp.sum(jnp.where(mine, worth, 0.0), axis=1) - jnp.min(worth, axis=1)
        slack = jnp.where(live, slack, 0.0)
        cost = jnp.where(live, jnp.sum(jnp.where(mine, cost, 0.0), axis=1), 0.0)
        slack_ref[rows] = slack
        return slack_sum + slack, primal + cost, prices

    def bid_all(
        lanes: int, until: int, state: _Phases, waiting: Array, epsilon: Array
    ) -> tuple[_Phases, Array]:
        lane = lax.broadcasted_iota(jnp.int32, (lanes, 1), 0)
        quiet = budget - budget // 2
        patience = jnp.maximum(budget // 2 // _RAISES, 1)

        def unfinished(s: _Rounds) -> Array:
            return ((s.head < waiting) | (s.active > until)) & (s.bids < budget)

        def round_of_bids(s: _Rounds) -> _Rounds:
            place = s.head + jnp.cumsum((s.who < 0).astype(jnp.int32), dtype=jnp.int32) - 1
            draw = (s.who < 0) & (place < waiting)
            drawn = plgpu.load(list_ref.at[jnp.where(draw, place, nowhere)], mask=draw, other=-1)
            who = jnp.where(draw, drawn, s.who)
            live = who >= 0
            raises = jnp.where(s.bids < quiet, 0, 1 + (s.bids - quiet) // patience)
            worth = distances(jnp.maximum(who, 0)) + s.prices
            first = jnp.min(worth, axis=1)
            best = jnp.min(jnp.where(worth == first[:, None], objects, nowhere), axis=1)
            chosen = (objects == best[:, None]) & live[:, None]
            second = jnp.min(jnp.where(chosen, jnp.inf, worth), axis=1)
            bid = second - first + epsilon * jnp.exp2(2.0 * raises.astype(jnp.float32))
            bid = jnp.where(chosen, bid[:, None], 0.0)
            highest = jnp.max(bid, axis=0)[None, :]
            winner = jnp.min(jnp.where(chosen & (bid == highest), lane, lanes), axis=0)[None, :]
            won = chosen & (lane == winner)
            # -2: the lane was outbid by another lane. -1: the object was free.
            displaced = jnp.max(jnp.where(won, s.owner, -2), axis=1)
            taker = jnp.max(jnp.where(won, who[:, None], -1), axis=0)[None, :]
            who = jnp.where(displaced == -2, who, displaced)
            return _Rounds(
                s.prices + highest,
                jnp.where(taker >= 0, taker, s.owner),
                who,
                s.head + count(draw),
                count(who >= 0),
                s.bids + count(live),
            )

        nobody = jnp.full((lanes,), -1, jnp.int32)
        end = lax.while_loop(
            unfinished,
            round_of_bids,
            _Rounds(state.prices, state.owner, nobody, zero, zero, state.bids),
        )
        # The remaining bidders become the list of the next rounds, which have fewer lanes.
        barrier()
        left = end.who >= 0
        plgpu.store(list_ref.at[places(left, 0)], end.who, mask=left)
        barrier()
        state = state._replace(prices=end.prices, owner=end.owner, bids=end.bids)
        return state, end.active

    def begin(state: _Phases) -> tuple[_Phases, Array]:
        """Measures a complete matching and frees the objects of pairs with too much slack."""
        barrier()
        object_ref[state.owner] = objects
        barrier()
        nothing = jnp.zeros((wide,), jnp.float32)
        slack, primal, _ = over_bidders(measure, nothing, nothing, state.prices)
        slack, primal = jnp.sum(slack), jnp.sum(primal)
        barrier()
        # Return the prices with the highest lower bound.
        dual = primal - slack
        prices_ref[...] = jnp.where(dual > state.bound, state.prices, prices_ref[...])
        bound = jnp.maximum(state.bound, dual)
        aim = _SAFETY * tolerance * bound
        # After the smallest epsilon, or after epsilon was raised, the matching cannot improve.
        last = (state.epsilon <= _FLOOR) | (state.bids > budget - budget // 2)
        # Negated so that a NaN ends the loop.
        done = jnp.logical_not(primal - bound > aim) | last
        goal = aim / n
        lower = state.epsilon / _FACTOR
        epsilon = jnp.where(state.epsilon > goal, jnp.maximum(lower, goal), lower)
        epsilon = jnp.maximum(epsilon, _FLOOR)
        slack = plgpu.load(slack_ref.at[state.owner], mask=real, other=0.0)
        drop = (slack > epsilon) & jnp.logical_not(done)
        plgpu.store(list_ref.at[places(drop, 1)], state.owner, mask=drop)
        owner = jnp.where(drop, -1, state.owner)
        barrier()
        done = done.astype(jnp.int32)
        state = state._replace(owner=owner, epsilon=epsilon, bound=bound, done=done)
        return state, count(drop)

    def phase(state: _Phases) -> _Phases:
        state, waiting = begin(state)
        for lanes, until in zip(_LANES, (*_LANES[1:], 0), strict=True):
            state, waiting = bid_all(lanes, until, state, waiting, state.epsilon)
        return state

    # `row_sum` sums the distances from the bidders to their nearest objects, `column_sum` those
    # from the objects to their nearest bidders. Both are lower bounds. The prices -column have a
    # dual value of at least `column_sum`.
    nothing = jnp.zeros((wide,), jnp.float32)
    column, row_sum, widest = over_bidders(
        opening, jnp.full((1, size), jnp.inf, jnp.float32), nothing, nothing
    )
    row_sum, column_sum = jnp.sum(row_sum), jnp.sum(jnp.where(real, column, 0.0))
    prices_ref[...] = jnp.where(real & (column_sum > row_sum), -column, 0.0)
    state = _Phases(
        prices=jnp.where(real, -column, jnp.inf),
        owner=objects,
        # `begin` divides it by _FACTOR before it is used.
        epsilon=jnp.max(widest) * (_START * _FACTOR),
        bound=jnp.maximum(row_sum, column_sum),
        done=zero,
        bids=zero,
    )
    state = lax.while_loop(lambda s: (s.done == 0) & (s.bids < budget), phase, state)
    owner_ref[...] = state.owner
    bids_ref[0] = state.bids


def solve(
    a: Array,
    b: Array,
    tolerance: float | Array,
    max_bids: int | Array,
    *,
    interpret: bool = False,
) -> Matching:
    """Bids until the matching is within about `tolerance`, or `max_bids` bids have been made.

    Args:
      a: [n, 3] float32, finite, 1 <= n <= MAX_POINTS. The extent should be about 1, because the
        smallest epsilon and the smallest distance that differs from zero (3e-19) assume this.
      b: [n, 3] likewise.
      tolerance: scalar, accepted (cost - optimum) / optimum.
      max_bids: scalar; with 0 the matching is i -> i. After half of it epsilon is raised, so that
        the matching becomes complete.
      interpret: run it as plain JAX, on any platform.

    Raises:
      ValueError: n > MAX_POINTS.
    """
    n = len(a)
    if n > MAX_POINTS:
        raise ValueError(f"a: got {n} points, expected at most {MAX_POINTS} for the kernel")
    if n == 1:  # with one object there is no second best
        return Matching(jnp.zeros_like(a[:, 0], jnp.int32), jnp.zeros_like(a[:, 0]), jnp.int32(0))
    size = max(pl.next_power_of_2(n), 32)
    inputs = tuple(jnp.pad(x.astype(jnp.float32), ((0, size - n), (0, 0))).T for x in (a, b))
    inputs += (
        jnp.asarray(tolerance, jnp.float32).reshape(1),
        jnp.asarray(max_bids, jnp.int32).reshape(1),
    )
    shapes = (
        ((1, size), jnp.float32),
        ((1, size), jnp.int32),
        ((1,), jnp.int32),
        ((size + 1,), jnp.int32),
        ((size + 1,), jnp.int32),
        ((size,), jnp.float32),
    )
    prices, owner, bids, *_ = pl.pallas_call(
        functools.partial(_kernel, n=n, barrier=_no_barrier if interpret else plgpu.debug_barrier),
        out_shape=tuple(varying_like(shape, dtype, *inputs) for shape, dtype in shapes),
        # 8 objects per thread.
        compiler_params=plgpu.CompilerParams(num_warps=max(size // 256, 1), num_stages=1),
        interpret=interpret,
        name="auction",
    )(*inputs)
    return Matching(owner[0, :n], prices[0, :n], bids[0])


def _no_barrier() -> None:
    pass


def solve_pair(
    a: Array,
    b: Array,
    tolerance: float | Array,
    max_bids: int | Array,
    *,
    interpret: bool = False,
) -> tuple[Array, Array, Array, Array]:
    """Index, prices, bids and proven gap of one pair, like the solvers of `losses.auction`.

    The kernel computes a matching and prices; `certificate` computes the bijection, its cost and
    the gap from them. Non-finite coordinates give the bijection i -> i and a NaN gap.
    """
    problem = certificate.prepare(a, b)
    budget = jnp.where(problem.finite, max_bids, 0)
    matching = solve(problem.a, problem.b, tolerance, budget, interpret=interpret)
    index = certificate.bijection(matching.owner)
    # `judge` expects prices >= 0.
    judged = certificate.judge(problem, index, matching.prices - matching.prices.min())
    gap = certificate.gap_of(judged.cost, judged.lower, len(a))
    gap = jnp.where(problem.finite, gap, jnp.nan)
    return index, judged.prices * problem.unit, matching.bids, gap


def trial() -> bool:
    """Returns whether the compiled kernel solves a small problem, on the default device."""
    rng = np.random.default_rng(0)
    b = rng.normal(size=(200, 3)).astype(np.float32)
    order = rng.permutation(len(b))
    a = b[order]
    got = (
        jax.jit(solve)
        .lower(a, b, np.float32(0.01), np.int32(10**6))
        .compile()(a, b, np.float32(0.01), np.int32(10**6))
    )
    return bool(np.array_equal(order[np.asarray(got.owner)], np.arange(len(b))))

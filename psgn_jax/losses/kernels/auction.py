"""The auction on a GPU: a Pallas kernel (Triton) that solves one pair of clouds per program.

The algorithm is that of `losses.auction` (Bertsekas, epsilon scaling, phases that keep the pairs
which still satisfy epsilon-complementary slackness), laid out for a GPU: the whole solve is one
launch, not one per bid. The objects' coordinates, prices and owners live in the registers of one
program (4 warps for 1,024 points, 8 objects a thread), the bidders' coordinates in the first-level
cache; under `vmap` the batch becomes an axis of the launch, one program a pair, each ending on its
own.

A round. Each of K lanes holds a bidder without object. Over the tile [K, n] of distances, computed
from coordinates: the least of distance plus price, the first object that attains it, the least of
all others (an exact tie counts as second best). Of the lanes that chose the same object the highest
bid wins, of equal bids the lowest lane: both are maxima and minima of the same registers, no float
is computed twice and compared, so an object has one winner and the owners stay a matching. A lane
goes on with the bidder it displaced; one that took a free object draws the next from the list of
bidders the phase has yet to place. K falls from 8 over 2 to 1 as the list runs out: the tail of a
phase is serial, and the tile should not be wider than it.

Cost of a round at 1,024 points and 4 warps, from the machine code of Triton 3.6 for sm_90: 2,630
instructions a warp for K = 8, 641 for K = 2, 340 for K = 1, and 12 to 16 barriers, no spills inside
the rounds. A warp per scheduler issues at best one a cycle, and four reductions across the program
depend on each other (some 150 cycles each): about 3,400, 1,500 and 1,100 cycles. Real pairs of
1,024 points at 1 % took (interpreted) 2,500 to 3,600 rounds of 8, 300 to 1,400 of 2 and 700 to
4,600 of 1, in 6 or 7 phases, whose sweeps over all distances add 128 steps of 1,900 instructions
each. That is 10 to 18 million cycles: 6 to 10 ms at 1.75 GHz, all pairs at once on a GPU with as
many multiprocessors. An estimate: it has not been run on a GPU so far.

What the kernel returns is a matching and prices; the bijection, the cost and the proven gap come
from `certificate`, which trusts nothing that was computed here.
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

# Registers end here: 16 warps with 8 objects a thread.
MAX_POINTS = 4096

_LANES = (8, 2, 1)  # K, in the order of use
_FACTOR = 5.0  # epsilon falls by it from phase to phase
_START = 0.1  # first epsilon, in the largest distance
_SAFETY = 0.85  # of the tolerance: what the bids aim at; the rest is for roundings
_FLOOR = 2.0**-20  # last epsilon, for clouds of extent 1: a few units in the last place of a price
_RAISES = 16  # beyond half of the budget epsilon rises, by 4 at a time, this often at most
_TINY = 1e-37  # below it a squared distance counts as zero


class Matching(NamedTuple):
    """Who has which object, and prices that bound the optimum from below.

    `owner[j]` is the bidder of object j, -1 if none (the budget ran out); no bidder has two.
    The optimum is at least sum_i min_j (c_ij + prices_j) - sum_j prices_j.
    """

    owner: Array
    prices: Array
    bids: Array


class _Rounds(NamedTuple):
    prices: Array  # [1, size], infinite for padding
    owner: Array  # [1, size]
    who: Array  # [K] bidder of each lane, -1 if none
    head: Array  # how many of the list were drawn
    active: Array  # lanes with a bidder
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
    """The program of one pair, see the module.

    One function: a kernel is traced as a whole, and its parts read the same references.
    """
    # object_ref, list_ref and slack_ref are working memory (Pallas has none for Triton but its
    # outputs). Stores that are masked off go to the entry after the last: `nowhere`.
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
        # Where the chosen entries go if they are moved to the front, in order.
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
            # -2: outbid by another lane. -1: the object was free.
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
        # Whoever is left becomes the list of the next, narrower rounds.
        barrier()
        left = end.who >= 0
        plgpu.store(list_ref.at[places(left, 0)], end.who, mask=left)
        barrier()
        state = state._replace(prices=end.prices, owner=end.owner, bids=end.bids)
        return state, end.active

    def begin(state: _Phases) -> tuple[_Phases, Array]:
        """Judges a complete matching and takes the objects from those with too much slack."""
        barrier()
        object_ref[state.owner] = objects
        barrier()
        nothing = jnp.zeros((wide,), jnp.float32)
        slack, primal, _ = over_bidders(measure, nothing, nothing, state.prices)
        slack, primal = jnp.sum(slack), jnp.sum(primal)
        barrier()
        # The prices to return are those that prove the most.
        dual = primal - slack
        prices_ref[...] = jnp.where(dual > state.bound, state.prices, prices_ref[...])
        bound = jnp.maximum(state.bound, dual)
        aim = _SAFETY * tolerance * bound
        # At the last epsilon, or once it had to be raised, nothing better comes.
        last = (state.epsilon <= _FLOOR) | (state.bids > budget - budget // 2)
        # Written so that NaN ends it.
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

    # Both sums over nearest neighbours are lower bounds; and lowering every price by the distance
    # of the nearest bidder makes the second of them the dual value to begin with.
    nothing = jnp.zeros((wide,), jnp.float32)
    column, row_sum, widest = over_bidders(
        opening, jnp.full((1, size), jnp.inf, jnp.float32), nothing, nothing
    )
    row_sum, column_sum = jnp.sum(row_sum), jnp.sum(jnp.where(real, column, 0.0))
    prices_ref[...] = jnp.where(real & (column_sum > row_sum), -column, 0.0)
    state = _Phases(
        prices=jnp.where(real, -column, jnp.inf),
        owner=objects,
        # Divided by the factor before it is used.
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
    """Bids until the matching is within about `tolerance`, or `max_bids` bids were made.

    Args:
      a: [n, 3] float32, finite, 1 <= n <= MAX_POINTS, best of extent 1 (the last epsilon and the
        smallest distance told from zero, 3e-19, are meant so).
      b: [n, 3] likewise.
      tolerance: scalar, accepted (cost - optimum) / optimum.
      max_bids: scalar; with 0 the matching is i -> i. Beyond half of it epsilon rises, so that the
        matching becomes complete at least.
      interpret: run it as plain JAX, on any platform.

    Raises:
      ValueError: n > MAX_POINTS.
    """
    n = len(a)
    if n > MAX_POINTS:
        raise ValueError(f"a: got {n} points, expected at most {MAX_POINTS} for the kernel")
    if n == 1:  # a single object has no second best
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
        # 8 objects a thread.
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
    """index, prices, bids and proven gap of one pair, as a solver of `losses.auction` does.

    The bijection, its cost and the certificate come from `certificate`, from the matching
    and the prices found here. Non-finite coordinates: i -> i and a NaN gap.
    """
    problem = certificate.prepare(a, b)
    budget = jnp.where(problem.finite, max_bids, 0)
    found = solve(problem.a, problem.b, tolerance, budget, interpret=interpret)
    index = certificate.bijection(found.owner)
    # There the least price is zero.
    judged = certificate.judge(problem, index, found.prices - found.prices.min())
    gap = certificate.gap_of(judged.cost, judged.lower, len(a))
    gap = jnp.where(problem.finite, gap, jnp.nan)
    return index, judged.prices * problem.unit, found.bids, gap


def trial() -> bool:
    """Whether the compiled kernel finds the optimum of a small problem, on the default device."""
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

"""Bertsekas' auction: a bijection of two point clouds and a proof of how good it is.

The problem, for clouds a and b of n points each and Euclidean costs c_ij = |a_i - b_j|:

    OPT = min over bijections s of sum_i c_{i, s(i)}

Every point of a is a bidder, every point of b an object with a price p_j. A bidder without object
takes the one that is cheapest for it, j = argmin_j (c_ij + p_j), raises its price by the margin to
the second cheapest plus epsilon, and the bidder it displaces bids again. Once everybody has an
object, every pair satisfies epsilon-complementary slackness: c_{i,s(i)} + p_{s(i)} <=
min_j (c_ij + p_j) + epsilon. Large epsilons end fast, small ones end near the optimum: the auction
runs in phases of falling epsilon that start from the prices of the phase before and from those
pairs that satisfy the new slackness already.

The certificate (linear programming duality). For any prices p, and any u with
u_i <= c_ij + p_j for all i and j, every bijection t costs at least

    sum_i c_{i,t(i)} >= sum_i (u_i - p_{t(i)}) = sum_i u_i - sum_j p_j.

So OPT lies below the cost P of the bijection found by at most the sum of its slacks,

    P - OPT <= sum_i (c_{i,s(i)} + p_{s(i)} - u_i),

whatever has led to those prices. Between phases u_i = min_j (c_ij + p_j), and then, with u fixed,
every price is lowered as far as it goes, p_j = max_i (u_i - c_ij): a sweep back over the matrix
that makes the bound, and the prices, better at the cost of one pass. `gap` is that bound over the
lower end of OPT, with every rounding of float32 counted against it (`_ROUNDING`).

Memory is linear in n: distances are computed from coordinates when they are needed.

Sources: Bertsekas, "A Distributed Algorithm for the Assignment Problem", MIT LIDS working paper,
1979; Bertsekas, "Auction Algorithms for Network Flow Problems: A Tutorial Introduction",
Computational Optimization and Applications 1, 1992 (epsilon scaling, reverse auctions). Fan, Su,
Guibas, CVPR 2017, section 4.2 use it with a fixed time per instance, the error ratio raised until
it ends.
"""

import functools
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.custom_batching import sequential_vmap
from jax.experimental.xla_metadata import set_xla_metadata

from psgn_jax.losses.distances import check_points
from psgn_jax.losses.kernels.dispatch import select, use_kernels
from psgn_jax.types import Array, Bool, Float, Int

Schedule = Literal["scaling", "authors"]

# The paper (section 4.2) reports an error of about 1 %.
TOLERANCE = 0.01
# Bids a point at most. Real pairs of 1,024 points need 5 to 40 of them at 1 %.
BIDS_PER_POINT = 2000

_FACTOR = 8.0  # epsilon falls by it from phase to phase
_AIM = 0.8  # or less, when this part of the tolerance seems in reach
_RAISE = 4.0  # and rises by it when the budget runs out, _RAISES times at most
_RAISES = 16
_START = 0.1  # first epsilon, in extents of the clouds
_FLOOR = 2.0**-20  # last one: a few units in the last place of the prices
_TILE = 32  # targets a step of a pass over all distances
_UNIT = 2.0**-24  # unit roundoff of float32

# A slack c + p - u is made of numbers below 2 extents + the largest price; with centring, casting,
# differences, squares, sums, roots, the sweep back and its shift it is wrong by less than 24 times
# the unit roundoff of their sum (18 by a count of operations with a root good to 2 units).
_ROUNDING = 24 * _UNIT

# The later kernel of the paper's group: tolerance 1e-4, times 100 after every 40 n bids, at most 1.
_AUTHORS_START, _AUTHORS_RAISE, _AUTHORS_BIDS, _AUTHORS_CAP = 1e-4, 100.0, 40, 1.0


class Assignment(NamedTuple):
    """A bijection of two clouds, the prices that prove it good, and how it was reached.

    `a[i]` is matched with `b[index[i]]`. `prices` are those of the points of b (unit, least 0).
    `gap` >= (cost - OPT) / OPT, proven; infinite where no positive lower bound is known.
    `converged` says gap <= tolerance. `iterations` counts bids.
    """

    index: Int[Array, " n"]  # type: ignore[assignment]  # hides tuple.index
    prices: Float[Array, " n"]
    converged: Bool[Array, ""]
    iterations: Int[Array, ""]
    gap: Float[Array, ""]


class _Bidding(NamedTuple):
    """State of the loop over bids."""

    prices: Array  # [R, L] of the objects, infinite where there is none (padding)
    owner: Array  # [R L] bidder of every object, -1 where there is none
    stack: Array  # [n] its first `waiting` entries are the bidders without object
    waiting: Array
    bids: Array


class _Phase(NamedTuple):
    """State of the loop over phases."""

    epsilon: Array
    prices: Array  # [n]
    owner: Array  # [n]
    waiting: Array  # bidders without object: 0 between phases, else the budget ran out
    stack: Array
    bids: Array
    raises: Array
    index: Array  # type: ignore[assignment]  # [n] the cheapest bijection so far
    cost: Array  # and its cost
    proof: Array  # [n] prices of the best lower bound
    lower: Array  # and the bound
    gap: Array


def _bits(x: Array) -> Array:
    # Non-negative floats are ordered as their bits are, and integers reduce in vector registers.
    return lax.bitcast_convert_type(x, jnp.int32)


def _least(x: Array, axes: tuple[int, ...] = (0,)) -> Array:
    return lax.reduce(x, jnp.int32(0x7F800000), lax.min, axes)  # bits of infinity


def _take(x: Array, i: Array) -> Array:
    return lax.dynamic_slice(x, (i,), (1,))[0]


def _put(x: Array, i: Array, value: Array) -> Array:
    return lax.dynamic_update_slice(x, value[None], (i,))


def _distance(x: tuple[Array, ...], y: tuple[Array, ...]) -> Array:
    return jnp.sqrt(sum(jnp.square(s - t) for s, t in zip(x, y, strict=True)))


def _cheapest(points: Array, targets: Array, prices: Array) -> Array:
    """min_j |points_i - targets_j| + prices_j for every i, in tiles of targets; prices >= 0."""
    padding = -len(targets) % _TILE
    tiles = jnp.pad(targets, ((0, padding), (0, 0)), mode="edge").reshape(-1, _TILE, 3)
    prices = jnp.pad(prices, (0, padding), constant_values=jnp.inf).reshape(-1, _TILE)
    rows = tuple(points[None, :, k] for k in range(3))

    def step(best: Array, tile: tuple[Array, Array]) -> tuple[Array, None]:
        target, price = tile
        value = _distance(rows, tuple(target[:, k, None] for k in range(3))) + price[:, None]
        return lax.min(best, _least(_bits(value))), None

    start = _bits(jnp.where(points[:, 0] == targets[0, 0], jnp.inf, jnp.inf))
    return lax.bitcast_convert_type(lax.scan(step, start, (tiles, prices))[0], jnp.float32)


def _width(n: int) -> int:
    """Lanes L of the [R, L] arrangement of n objects: a search is one pass, then R + L steps."""
    return 16 if n <= 256 else 32 if n <= 2048 else 64 if n <= 8192 else 128


def _bid(a: Array, columns: tuple[Array, ...], epsilon: Array, state: _Bidding) -> _Bidding:
    """The bidder on top of the stack bids; whom it displaces takes its place there."""
    top = state.waiting - 1
    bidder = _take(state.stack, top)
    point = lax.dynamic_slice(a, (bidder, 0), (1, 3))[0]
    height, width = columns[0].shape
    value = _distance(columns, tuple(point[k] for k in range(3))) + state.prices
    value = lax.optimization_barrier(_bits(value))
    lanes, rows = lax.iota(jnp.int32, width), lax.iota(jnp.int32, height)
    by_lane = lax.optimization_barrier(_least(value))
    best = _least(by_lane)
    lane = _least(jnp.where(by_lane == best, lanes, width))
    column = lax.dynamic_slice(value, (0, lane), (height, 1))[:, 0]
    row = _least(jnp.where(column == best, rows, height))
    # Exact ties count as second best: everything but the one object chosen.
    infinite = jnp.int32(0x7F800000)
    second = lax.min(
        _least(jnp.where(lanes == lane, infinite, by_lane)),
        _least(jnp.where(rows == row, infinite, column)),
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
    """Bids until everybody has an object or `limit` bids were made in total."""
    n, width = len(a), _width(len(a))
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
        # A bid is a microsecond of arithmetic in a dozen small operations. The attributes make
        # XLA's CPU compiler emit the loop as one function, instead of launching them one by one,
        # which took 1.4 to 2.2 times as long.
        with set_xla_metadata(xla_cpu_small_call="true", inlineable="false"):
            state = jax.jit(loop)(a, columns, epsilon, limit, state)
    else:
        state = loop(a, columns, epsilon, limit, state)
    return state._replace(prices=state.prices.reshape(-1)[:n], owner=state.owner[:n])


def _sum(x: Array) -> Array:
    """The sum of n terms >= 0, wrong by less than `_sum_rounding(n)` of itself."""
    width = _width(len(x))
    return jnp.pad(x, (0, -len(x) % width)).reshape(-1, width).sum(axis=0).sum()


def _sum_rounding(n: int) -> float:
    width = _width(n)
    return (-(-n // width) + width) * _UNIT


def _owners(index: Array, kept: Array) -> Array:
    n = len(index)
    bidders = lax.iota(jnp.int32, n)
    return jnp.full_like(index, -1).at[jnp.where(kept, index, n)].set(bidders, mode="drop")


def _front(chosen: Array) -> Array:
    """The numbers of the chosen entries, in order, at the front of an array [n]."""
    n = len(chosen)
    place = jnp.where(chosen, jnp.cumsum(chosen.astype(jnp.int32)) - 1, n)
    numbers = lax.iota(jnp.int32, n)
    return jnp.zeros_like(place).at[place].set(numbers, mode="drop")


def _index(owner: Array) -> Array:
    """The bijection of the owners; bidders and objects left over are matched in order."""
    n = len(owner)
    numbers = lax.iota(jnp.int32, n)
    free = owner < 0
    index = jnp.full_like(owner, -1).at[jnp.where(free, n, owner)].set(numbers, mode="drop")
    without = index < 0
    rank = jnp.cumsum(without.astype(jnp.int32)) - 1
    return jnp.where(without, _front(free)[rank], index)


class _Problem(NamedTuple):
    """One pair: as given, scaled, and centred besides; all extents of the latter at most 1."""

    exact_a: Array
    exact_b: Array
    a: Array
    b: Array
    unit: Array  # a distance here times `unit` is one of the caller's
    finite: Array


def _prepare(a: Array, b: Array) -> _Problem:
    finite = jnp.isfinite(a).all() & jnp.isfinite(b).all()
    a, b = jnp.where(finite, a, 0), jnp.where(finite, b, 0)
    low = jnp.minimum(a.min(axis=0), b.min(axis=0))
    high = jnp.maximum(a.max(axis=0), b.max(axis=0))
    # A power of two: scaling is exact.
    extent = (high - low).max()
    finite &= jnp.isfinite(extent)
    # Extents that underflow: there is nothing to tell the points apart by, and nothing is proven.
    finite &= (extent > 0) | (low == high).all()
    extent = jnp.where(finite, extent, 0)
    _, exponent = jnp.frexp(jnp.where(extent > 0, extent, 1))
    middle = low + (high - low) / 2

    def scale(x: Array) -> Array:
        return jnp.ldexp(x, -exponent)

    centred = [scale(x - middle[None]).astype(jnp.float32) for x in (a, b)]
    unit = jnp.ldexp(jnp.ones((), jnp.float32), exponent)
    return _Problem(scale(a), scale(b), centred[0], centred[1], unit, finite)


def _cost(problem: _Problem, index: Array) -> Array:
    # From the coordinates as given: the relative error is a few roundings at any offset, and
    # coincident points cost exactly nothing.
    difference = (problem.exact_a - problem.exact_b[index]).astype(jnp.float32)
    return _sum(jnp.sqrt(jnp.square(difference).sum(axis=-1)))


class _Judged(NamedTuple):
    cost: Array
    lower: Array
    prices: Array
    slack: Array


def _judge(problem: _Problem, index: Array, prices: Array) -> _Judged:
    """Cost of a bijection, the lower bound its prices prove, and the prices after the sweep."""
    a, b, n = problem.a, problem.b, len(index)
    u = _cheapest(a, b, prices)
    top = u.max()
    prices = top - _cheapest(b, a, top - u)
    least = prices.min()
    prices, u = prices - least, u - least
    cost = _cost(problem, index)
    matched = jnp.sqrt(jnp.square(a - b[index]).sum(axis=-1))
    slack = jnp.maximum(matched + prices[index] - u, 0)
    doubt = _ROUNDING * (2 + top + jnp.abs(least))
    relative = _sum_rounding(n) + 8 * _UNIT
    lower = cost * (1 - relative) - _sum(slack + doubt) * (1 + relative)
    return _Judged(cost, lower, prices, slack)


def _gap(cost: Array, lower: Array, n: int) -> Array:
    upper = cost * (1 + _sum_rounding(n) + 10 * _UNIT)
    gap = jnp.where(lower > 0, (upper - lower) / jnp.where(lower > 0, lower, 1), jnp.inf)
    return jnp.where(cost == 0, 0.0, gap)


def _solve(
    a: Array, b: Array, tolerance: Array, max_bids: Array, *, authors: bool, fused: bool
) -> tuple[Array, Array, Array, Array]:
    """index, prices, bids, gap of one pair; the loops around the bids."""
    n = len(a)
    problem = _prepare(a, b)
    numbers = lax.iota(jnp.int32, n)
    # Constants written with the data: inside shard_map they vary along the same axes.
    here = problem.finite | ~problem.finite
    zero = jnp.where(here, 0, 0)
    index = jnp.where(here, numbers, 0)
    first = _judge(problem, index, jnp.where(here, jnp.zeros(n), 0))

    start: Array
    quiet: Array  # bids before epsilon is raised for the first time
    patience: Array  # and from then on between raises
    if authors:
        # Their numbers are in the unit of their clouds.
        start, cap = _AUTHORS_START / problem.unit, _AUTHORS_CAP / problem.unit
        raise_by, start_prices = _AUTHORS_RAISE, jnp.zeros_like(first.prices)
        quiet = patience = jnp.int32(_AUTHORS_BIDS * n)
    else:
        start, cap = jnp.where(here, _START, 0.0), jnp.where(here, jnp.inf, jnp.inf)
        raise_by, start_prices = _RAISE, first.prices
        # Half of the budget for the tolerance, half to come to an end.
        quiet = max_bids - max_bids // 2
        patience = jnp.maximum(max_bids // 2 // _RAISES, 1)
    keep = first.slack <= start if not authors else jnp.zeros(n, bool) & here

    def begin(judged: _Judged, index: Array, keep: Array) -> tuple[Array, Array, Array]:
        free = ~keep
        return _owners(index, keep), free.sum(dtype=jnp.int32), _front(free)

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
        gap=_gap(first.cost, first.lower, n),
    )

    def unfinished(s: _Phase) -> Array:
        if authors:
            more = (s.waiting > 0) & (s.raises < 3)
        else:
            # Complete at the last epsilon, or only because epsilon was raised: no better comes.
            more = (s.waiting > 0) | ((s.raises == 0) & (s.epsilon > 0))
        return (s.gap > tolerance) & more & (s.bids < max_bids) & problem.finite

    def judge(s: _Phase) -> _Phase:
        index = _index(s.owner)
        new = _judge(problem, index, s.prices)
        better, higher = new.cost < s.cost, new.lower > s.lower
        s = s._replace(
            index=jnp.where(better, index, s.index),
            cost=jnp.where(better, new.cost, s.cost),
            proof=jnp.where(higher, new.prices, s.proof),
            lower=jnp.where(higher, new.lower, s.lower),
            prices=new.prices,
        )
        gap = _gap(s.cost, s.lower, n)
        if authors:
            return s._replace(gap=gap)
        # Aim a little below the tolerance once it is near; never crawl, never jump.
        aim = jnp.where(jnp.isfinite(gap), _AIM * tolerance / gap, 0)
        epsilon = s.epsilon * jnp.clip(aim, 1 / _FACTOR, 0.7)
        floor = _FLOOR * (1 + s.prices.max())
        last = s.epsilon <= floor
        epsilon = jnp.maximum(epsilon, floor)
        done = last | (gap <= tolerance) | (s.raises > 0)
        owner, waiting, stack = begin(new, index, new.slack <= epsilon)
        return s._replace(
            gap=gap,
            # Zero says that there is nothing left to do.
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
        return lax.cond(s.waiting == 0, judge, hurry, s)

    state = lax.while_loop(unfinished, phase, state)
    # Cut short: whatever is complete now may still be better than the bijection before.
    state = lax.cond(state.waiting > 0, judge, lambda s: s, state)
    gap = jnp.where(problem.finite, state.gap, jnp.nan)
    return state.index, state.proof * problem.unit, state.bids, gap


def _solver(authors: bool) -> Any:
    # Compiled once for a size, also where the caller does not use `jit`.
    solve = jax.jit(functools.partial(_solve, authors=authors), static_argnames="fused")

    # In lock step the pairs of a batch would all take as long as the slowest, and every bid would
    # copy the state of all: on a CPU a batch is solved one pair after the other.
    @sequential_vmap
    def cpu(a: Array, b: Array, tolerance: Array, max_bids: Array) -> Any:
        return solve(a, b, tolerance, max_bids, fused=True)

    def default(a: Array, b: Array, tolerance: Array, max_bids: Array) -> Any:
        return solve(a, b, tolerance, max_bids, fused=False)

    return cpu, default


_SOLVERS = {authors: _solver(authors) for authors in (False, True)}


def _trial() -> bool:
    from psgn_jax.losses.kernels import auction as auction_kernel

    return auction_kernel.trial()


def _for_platform(solver: Any, n: int, schedule: Schedule) -> Any:
    """The solver in one launch for CUDA, where there is one and it works; else the given one."""
    if schedule != "scaling" or not use_kernels(_trial):
        return solver
    # Imported where it is used: Pallas takes a while, and a CPU has no need of it.
    from psgn_jax.losses.kernels import auction as auction_kernel

    if n > auction_kernel.MAX_POINTS:
        return solver
    if jax.default_backend() == "gpu":
        return auction_kernel.solve_pair
    return functools.partial(select, auction_kernel.solve_pair, solver)


def assign(
    a: Float[Array, "n 3"],
    b: Float[Array, "n 3"],
    *,
    tolerance: float | Array = TOLERANCE,
    max_bids: int | Array | None = None,
    schedule: Schedule = "scaling",
    names: tuple[str, str] = ("a", "b"),
) -> Assignment:
    """A bijection of a and b of nearly the least sum of Euclidean distances, with its proof.

    See the module's docstring for the algorithm. It ends as soon as `gap` <= tolerance. Half of
    the budget is for that; when it is spent, epsilon is raised by and by (the paper's "error ratio
    raised until it ends"). Whatever happens the result is a bijection and `gap` is true of it.

    Nothing here is differentiable: see `emd` for the distance and its gradient.

    Where it runs: on a CPU pairs are solved one after the other, also under `vmap`. On a CUDA GPU
    up to 4,096 points are solved by one launch (`auction_kernel`); more points, and the schedule
    "authors", take the plain path there, which launches kernels for every bid and is slow.

    Args:
      a: [n, 3], 1 <= n, a floating dtype, any unit; solved in float32.
      b: [n, 3].
      tolerance: >= 0, accepted (cost - OPT) / OPT. Float32 proves about 1e-4, no less.
      max_bids: >= 0, the budget; None: 2000 n. One bid is a pass over the n distances of a point.
      schedule: "scaling", or "authors" for the later kernel of the paper's group: no phases,
        epsilon 1e-4 (in the unit of the clouds), times 100 after every 40 n bids, at most 1; it
        stops after 40 n bids with that. Its result may be far from the tolerance; `gap` tells.
      names: what the caller calls a and b, for the error messages.

    Raises:
      ValueError: wrong shape or dtype, unequal sizes, a negative tolerance or budget, an unknown
        schedule; non-finite coordinates outside `jit`. Inside, they give the bijection i -> i,
        `converged` False and a NaN gap; so do clouds whose extent float32 cannot hold (1e-38).
    """
    a, b = check_points(a, names[0]), check_points(b, names[1])
    if len(a) != len(b):
        raise ValueError(
            f"{names[1]}: got {len(b)} points, expected as many as {names[0]} has ({len(a)}): a"
            " bijection needs equal sizes (draw a subset, or use a Chamfer distance)"
        )
    if schedule not in ("scaling", "authors"):
        raise ValueError(f"schedule: got {schedule!r}, accepted: 'scaling', 'authors'")
    if max_bids is None:
        max_bids = min(BIDS_PER_POINT * len(a), 2**30)
    for name, value in (("tolerance", tolerance), ("max_bids", max_bids)):
        if isinstance(value, int | float) and not value >= 0:
            raise ValueError(f"{name}: got {value}, expected >= 0")
    dtype = jnp.promote_types(a.dtype, b.dtype)
    a, b = (lax.stop_gradient(x.astype(dtype)) for x in (a, b))
    cpu, other = _SOLVERS[schedule == "authors"]
    # Written with the data: under vmap inside shard_map they vary along the axes it does.
    here = a[0, 0] == b[0, 0]
    limits = jnp.asarray(tolerance, jnp.float32), jnp.asarray(max_bids, jnp.int32)
    tolerance, budget = (jnp.where(here, x, x) for x in limits)
    solver = cpu if jax.default_backend() == "cpu" else other
    index, prices, bids, gap = _for_platform(solver, len(a), schedule)(a, b, tolerance, budget)
    return Assignment(index, prices, gap <= tolerance, bids, gap)

"""Finds a nearly optimal bijection between two clouds, with a proven gap; chooses the solver."""

import functools
from typing import Any, Literal, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax

from psgn_jax.losses import auction
from psgn_jax.losses.distances import check_points
from psgn_jax.losses.kernels.dispatch import select, use_kernels
from psgn_jax.losses.xla import vary_with
from psgn_jax.types import Array, Bool, Float, Int

Schedule = Literal["scaling", "authors"]

# The paper (section "Distance Metric between Point Sets") reports an error of about 1 %.
TOLERANCE = 0.01
# Default budget, in bids per point. Clouds of 1,024 points from the authors' data need 5 to 40 bids
# per point for a gap of 1 %.
BIDS_PER_POINT = 2000


class Assignment(NamedTuple):
    """A bijection between two clouds, its certificate, and the statistics of the solver.

    `a[i]` is matched with `b[index[i]]`. `prices` are dual prices of the points of b, in the unit
    of the clouds; the smallest is 0. They prove the gap. `gap` is a proven bound on
    (cost - OPT) / OPT; it is infinite if no positive lower bound on OPT is known. `converged` is
    gap <= tolerance. `iterations` is the number of bids.
    """

    index: Int[Array, " n"]  # type: ignore[assignment]  # hides tuple.index
    prices: Float[Array, " n"]
    converged: Bool[Array, ""]
    iterations: Int[Array, ""]
    gap: Float[Array, ""]


def _for_platform(solver: Any, n: int, schedule: Schedule) -> Any:
    """The Pallas kernel if it is enabled and accepts the problem, else `solver`.

    It is enabled by `PSGN_KERNELS=on` (`kernels.dispatch`) and is used on CUDA only. It accepts the
    schedule "scaling" and up to `MAX_POINTS` points.
    """
    if schedule != "scaling" or not use_kernels():
        return solver
    # Imported here because Pallas is slow to import and not needed on a CPU.
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
    """A bijection between a and b with a nearly minimal sum of Euclidean distances, and its gap.

    The algorithm is described in `auction`, the proof of the gap in `certificate`. The solver stops
    as soon as `gap` <= tolerance. When half of the budget is spent, it raises epsilon step by step,
    so that the auction ends. The paper does this too. The result is always a bijection, and
    `gap` is always valid for it.

    The result has no gradient; the module `emd` has the distance and its gradient.

    Devices: on a CPU, pairs are solved one after another, under `vmap` too. On a GPU the auction
    launches several kernels for every bid and is slow. With `PSGN_KERNELS=on`, a CUDA GPU solves
    pairs of up to 4,096 points by one kernel launch (`kernels.auction`), except with the schedule
    "authors".

    Args:
      a: [n, 3], n >= 1, a floating dtype, any unit; solved in float32.
      b: [n, 3].
      tolerance: >= 0, accepted (cost - OPT) / OPT. In float32 gaps below about 1e-4 cannot be
        proven.
      max_bids: >= 0, the budget; None: 2000 n. One bid is a pass over the n distances of a point.
      schedule: "scaling", or "authors", the schedule of a later CUDA kernel of the paper's group.
        "authors" has no phases: epsilon starts at 1e-4 (unit of the clouds) and is multiplied by
        100 after every 40 n bids, up to 1. It stops after 40 n bids at epsilon 1. Its `gap` may
        exceed the tolerance by far.
      names: the caller's names for a and b, used in error messages.

    Raises:
      ValueError: wrong shape or dtype, unequal sizes, a negative tolerance or budget, an unknown
        schedule, or (outside `jit`) a non-finite coordinate. Inside `jit`, a non-finite coordinate
        gives the bijection i -> i, `converged` False and a NaN gap. So does an extent that is
        positive but below the smallest normal float32 (1e-38).
    """
    a, b = check_points(a, names[0]), check_points(b, names[1])
    if len(a) != len(b):
        raise ValueError(
            f"{names[1]}: got {len(b)} points, expected as many as {names[0]} has ({len(a)}): a"
            " bijection needs equal sizes (take a subset, or use a Chamfer distance)"
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
    cpu, other = auction.SOLVERS[schedule == "authors"]
    here = a[0, 0] == b[0, 0]
    tolerance = vary_with(jnp.asarray(tolerance, jnp.float32), here)
    budget = vary_with(jnp.asarray(max_bids, jnp.int32), here)
    solver = cpu if jax.default_backend() == "cpu" else other
    index, prices, bids, gap = _for_platform(solver, len(a), schedule)(a, b, tolerance, budget)
    return Assignment(index, prices, gap <= tolerance, bids, gap)

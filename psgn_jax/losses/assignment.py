"""A nearly optimal bijection of two clouds with a proven gap; chooses the solver for the device."""

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

# The paper (section 4.2) reports an error of about 1 %.
TOLERANCE = 0.01
# Default budget, in bids per point. Real pairs of 1,024 points need 5 to 40 bids per point at 1 %.
BIDS_PER_POINT = 2000


class Assignment(NamedTuple):
    """A bijection of two clouds, its certificate, and the statistics of the solver.

    `a[i]` is matched with `b[index[i]]`. `prices` are the dual prices of the points of b that prove
    the gap (unit; the smallest is 0). `gap` is a proven bound on (cost - OPT) / OPT; it is infinite
    if no positive lower bound on OPT is known. `converged` is gap <= tolerance. `iterations` is the
    number of bids.
    """

    index: Int[Array, " n"]  # type: ignore[assignment]  # hides tuple.index
    prices: Float[Array, " n"]
    converged: Bool[Array, ""]
    iterations: Int[Array, ""]
    gap: Float[Array, ""]


def _for_platform(solver: Any, n: int, schedule: Schedule) -> Any:
    """The Pallas kernel where it applies (CUDA, "scaling", few enough points), else `solver`."""
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
    """A bijection of a and b whose sum of Euclidean distances is nearly minimal, with its proof.

    The algorithm is described in `auction`, the proof in `certificate`. The solver stops as soon as
    `gap` <= tolerance. When half of the budget is spent, it raises epsilon step by step (the
    paper's "error ratio raised until it ends"). The result is always a bijection, and `gap` is
    always valid for it.

    It has no gradient; `emd` has the distance and its gradient.

    Devices: on a CPU, pairs are solved one after another, under `vmap` too. On a CUDA GPU, pairs of
    up to 4,096 points are solved by one kernel launch (`kernels.auction`). Larger clouds and the
    schedule "authors" use the plain path there, which launches kernels for every bid and is slow.

    Args:
      a: [n, 3], n >= 1, a floating dtype, any unit; solved in float32.
      b: [n, 3].
      tolerance: >= 0, accepted (cost - OPT) / OPT. In float32 gaps below about 1e-4 cannot be
        proven.
      max_bids: >= 0, the budget; None: 2000 n. One bid is a pass over the n distances of a point.
      schedule: "scaling", or "authors" for the later kernel of the paper's group: no phases;
        epsilon starts at 1e-4 (unit of the clouds) and is multiplied by 100 after every 40 n bids,
        up to 1. It stops after 40 n bids at epsilon 1. Its `gap` may exceed the tolerance by far.
      names: the caller's names for a and b, used in error messages.

    Raises:
      ValueError: wrong shape or dtype, unequal sizes, a negative tolerance or budget, an unknown
        schedule, or (outside `jit`) a non-finite coordinate. Inside `jit`, a non-finite coordinate
        gives the bijection i -> i, `converged` False and a NaN gap. So does an extent below the
        smallest normal float32 (1e-38).
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

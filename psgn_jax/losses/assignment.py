"""A bijection of two clouds with its proof, by the solver that is fastest on the device."""

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
# Bids a point at most. Real pairs of 1,024 points need 5 to 40 of them at 1 %.
BIDS_PER_POINT = 2000


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

    The algorithm is described in `auction`, the proof in `certificate`. It ends as soon as `gap` <=
    tolerance. Half of the budget is for that; when it is spent, epsilon is raised by and by (the
    paper's "error ratio raised until it ends"). Whatever happens the result is a bijection and
    `gap` is true of it.

    Nothing here is differentiable: see `emd` for the distance and its gradient.

    Where it runs: on a CPU pairs are solved one after the other, also under `vmap`. On a CUDA GPU
    up to 4,096 points are solved by one launch (`kernels.auction`); more points, and the schedule
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
    cpu, other = auction.SOLVERS[schedule == "authors"]
    here = a[0, 0] == b[0, 0]
    tolerance = vary_with(jnp.asarray(tolerance, jnp.float32), here)
    budget = vary_with(jnp.asarray(max_bids, jnp.int32), here)
    solver = cpu if jax.default_backend() == "cpu" else other
    index, prices, bids, gap = _for_platform(solver, len(a), schedule)(a, b, tolerance, budget)
    return Assignment(index, prices, gap <= tolerance, bids, gap)

"""Earth mover's distance of two clouds of n points: by auction with a certificate, or exact.

    EMD(a, b) = min over bijections s of sum_i |a_i - b_{s(i)}|

with the Euclidean, not the squared, distance: Fan, Su, Guibas, "A Point Set Generation Network for
3D Object Reconstruction from a Single Image", CVPR 2017, section 4.2. Everything takes one pair,
`pred` and `gt` [n, 3]; callers batch with `losses.map_pairs`.

Units: that of the caller's clouds. `emd_sum` is the paper's sum, `emd_mean` the sum over n: the
mean distance a point travels, which does not depend on the number of points. Distances are roots of
float32 squares: steps below 1e-19 count as none, and from 1e19 on they overflow.

The first call for a number of points compiles: 3 to 4 seconds on a CPU; later ones do not, with or
without `jax.jit` around.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from psgn_jax.losses.assignment import TOLERANCE, Assignment, Schedule, assign
from psgn_jax.losses.distances import check_points, safe_sqrt
from psgn_jax.types import Array, Float, Int

_PAIR = ("pred", "gt")


class MatchedDistances(NamedTuple):
    """Distance (unit) of every point of pred to its partner, and the assignment."""

    distance: Float[Array, " n"]
    assignment: Assignment


def matched_distances(
    pred: Float[Array, "n 3"],
    gt: Float[Array, "n 3"],
    *,
    tolerance: float | Array = TOLERANCE,
    max_bids: int | Array | None = None,
    schedule: Schedule = "scaling",
) -> MatchedDistances:
    """|pred_i - gt_{s(i)}| for a nearly optimal bijection s, and the assignment with its proof.

    Gradient, at the fixed bijection (at almost every pair of clouds the optimal one does not
    change nearby, so for it this is the gradient of the EMD): the unit vector from gt_{s(i)} to
    pred_i for pred_i, its negative for gt_{s(i)}, and zero where the two coincide.

    Args:
      pred: [n, 3].
      gt: [n, 3].
      tolerance: as for `assign`, like the other arguments.
      max_bids: the budget.
      schedule: "scaling" or "authors".

    Raises:
      ValueError: as `assign`. Inside `jit`, and under `grad` and `vmap`, a non-finite coordinate
        makes all distances of its pair NaN, and their gradients.

    Examples:
      >>> import jax.numpy as jnp
      >>> from psgn_jax import losses
      >>> pred = jnp.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0]])
      >>> gt = jnp.array([[4.0, 0.0, 1.0], [0.0, 2.0, 0.0]])
      >>> distance, assignment = losses.matched_distances(pred, gt)
      >>> assignment.index.tolist(), distance.tolist()
      ([1, 0], [2.0, 1.0])
      >>> bool(assignment.converged)  # the proven relative error, `assignment.gap`, is at most .01
      True
    """
    found = assign(pred, gt, tolerance=tolerance, max_bids=max_bids, schedule=schedule, names=_PAIR)
    pred, gt = check_points(pred, "pred"), check_points(gt, "gt")
    square = jnp.square(pred - gt[found.index]).sum(axis=-1)
    # A factor, not a choice: the gradient of a broken pair is NaN as its distances are.
    healthy = jnp.where(jnp.isnan(found.gap), jnp.nan, 1.0)
    return MatchedDistances(safe_sqrt(square) * healthy, found)


def emd_sum(
    pred: Float[Array, "n 3"],
    gt: Float[Array, "n 3"],
    *,
    tolerance: float | Array = TOLERANCE,
    max_bids: int | Array | None = None,
    schedule: Schedule = "scaling",
) -> Float[Array, ""]:
    """The paper's EMD (unit): the sum of n matched distances; arguments: `matched_distances`.

    sum_i |pred_i - gt_{s(i)}|, at most (1 + tolerance) times the least of all bijections s where
    the auction converged (`matched_distances` tells).
    """
    return matched_distances(
        pred, gt, tolerance=tolerance, max_bids=max_bids, schedule=schedule
    ).distance.sum()


def emd_mean(
    pred: Float[Array, "n 3"],
    gt: Float[Array, "n 3"],
    *,
    tolerance: float | Array = TOLERANCE,
    max_bids: int | Array | None = None,
    schedule: Schedule = "scaling",
) -> Float[Array, ""]:
    """1/n times `emd_sum` (unit): how far a point travels on average.

    Examples:
      >>> import jax.numpy as jnp
      >>> from psgn_jax import losses
      >>> pred = jnp.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0]])
      >>> gt = jnp.array([[4.0, 0.0, 1.0], [0.0, 2.0, 0.0]])
      >>> float(losses.emd_mean(pred, gt))  # (2 + 1) / 2
      1.5
    """
    return matched_distances(
        pred, gt, tolerance=tolerance, max_bids=max_bids, schedule=schedule
    ).distance.mean()


class ExactAssignment(NamedTuple):
    """An optimal bijection: `pred[i]` with `gt[index[i]]`, and its sum of distances (unit)."""

    index: Int[np.ndarray, " n"]  # type: ignore[assignment]  # hides tuple.index
    cost: float


def emd_exact(pred: Float[Array, "n 3"], gt: Float[Array, "n 3"]) -> ExactAssignment:
    """The optimum, in float64 by scipy's `linear_sum_assignment` on the host: for evaluation.

    Not for `jit`, no gradient. It needs SciPy, which JAX requires, 8 n^2 bytes and time that
    grows like n^3: about .1 to 1 s at 1,024 points. `cost` is right to about 1e-12 of the extent.

    Raises:
      ValueError: as `assign`; or the clouds are traced.

    Examples:
      >>> import jax.numpy as jnp
      >>> from psgn_jax import losses
      >>> pred = jnp.array([[0.0, 0.0, 0.0], [4.0, 0.0, 0.0]])
      >>> gt = jnp.array([[4.0, 0.0, 1.0], [0.0, 2.0, 0.0]])
      >>> exact = losses.emd_exact(pred, gt)
      >>> exact.index.tolist(), exact.cost
      ([1, 0], 3.0)
    """
    if isinstance(pred, jax.core.Tracer) or isinstance(gt, jax.core.Tracer):
        raise ValueError("emd_exact: got traced clouds, expected arrays (it runs on the host)")
    for cloud, name in ((pred, "pred"), (gt, "gt")):
        check_points(cloud, name)
    if len(pred) != len(gt):
        raise ValueError(f"gt: got {len(gt)} points, expected as many as pred has ({len(pred)})")
    from scipy.optimize import linear_sum_assignment

    x, y = np.asarray(pred, np.float64), np.asarray(gt, np.float64)
    costs = np.zeros((len(x), len(y)))
    for axis in range(3):
        costs += np.square(x[:, None, axis] - y[None, :, axis])
    np.sqrt(costs, out=costs)
    row, col = linear_sum_assignment(costs)
    return ExactAssignment(col.astype(np.int32), float(costs[row, col].sum()))

"""Other forms of the Chamfer distance; errors and gradient are those of `chamfer.nearest_both`."""

from psgn_jax.array_types import Array, Float
from psgn_jax.losses.chamfer import nearest_both
from psgn_jax.losses.numeric import safe_sqrt


def chamfer_l1_mean(pred: Float[Array, "n 3"], gt: Float[Array, "m 3"]) -> Float[Array, ""]:
    """1/2 (1/n sum_i min_j |pred_i - gt_j| + 1/m sum_j min_i |pred_i - gt_j|), in unit.

    Known as "Chamfer-L1", although the norm is Euclidean. The gradient is 0 where two points
    coincide. Source: Mescheder et al., "Occupancy Networks", CVPR 2019, section 4, where the unit
    is 1/10 of the longest edge of the object's bounding box.
    """
    to_gt, to_pred = nearest_both(pred, gt)
    return 0.5 * (safe_sqrt(to_gt.distance_sq).mean() + safe_sqrt(to_pred.distance_sq).mean())


def chamfer_authors(pred: Float[Array, "n 3"], gt: Float[Array, "m 3"]) -> Float[Array, ""]:
    """10^4 (1/m sum_j min_i |pred_i - gt_j|^2 + 1/2 1/n sum_i min_j |pred_i - gt_j|^2), unit^2.

    The training loss in the authors' published code; not for comparisons.
    """
    to_gt, to_pred = nearest_both(pred, gt)
    return 1e4 * (to_pred.distance_sq.mean() + 0.5 * to_gt.distance_sq.mean())

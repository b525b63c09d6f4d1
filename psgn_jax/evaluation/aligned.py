"""Metrics of one pair of clouds after the best scale and shift of the prediction.

An image shows neither the size of an object nor its distance from the camera. So these metrics
ignore errors of the position, and of the size by a factor of up to 1.25:

    aligned CD  = min over s in [0.8, 1.25] and t of CD(s pred + t, gt)

CD is the squared Chamfer distance `losses.chamfer_sq_mean`, in the unit of gt. There is no
rotation. `align` finds a local minimum, starting at s = 1 and t = 0. The aligned EMD is the EMD
after the same s and t. If a distance is smaller without alignment, we report the smaller value.
"""

from typing import Any

import jax
import jax.numpy as jnp

from psgn_jax.array_types import Array, Float
from psgn_jax.evaluation.clouds import emd, subset
from psgn_jax.losses.chamfer import chamfer_sq_mean, nearest_both
from psgn_jax.losses.numeric import check_points

LEAST_SCALE, LARGEST_SCALE = 0.8, 1.25

ITERATIONS = 30
_MOST_POINTS = 1024  # of gt in the iterations, unless pred has more; metrics use all points


def align(
    pred: Float[Array, "n 3"], gt: Float[Array, "m 3"]
) -> tuple[Float[Array, ""], Float[Array, "3"]]:
    """The scale in [0.8, 1.25] and the shift of pred that minimise the distance to gt.

    Iterated nearest neighbours (Besl, McKay, "A Method for Registration of 3-D Shapes", PAMI 1992)
    in both directions, without rotation. Each iteration pairs every point of pred (weight 1/n) and
    of gt (weight 1/m) with the nearest point of the other, then solves least squares:

        s = clip(sum w (p - mean p) . (g - mean g) / sum w |p - mean p|^2),  t = mean g - s mean p

    At most max(n, 1024) points of gt are used. The CD to these points never increases.
    """
    pred, gt = check_points(pred, "pred"), check_points(gt, "gt")
    gt = subset(gt, max(len(pred), _MOST_POINTS))

    def step(_: Any, current: tuple[Array, Array]) -> tuple[Array, Array]:
        to_gt, to_pred = nearest_both(current[0] * pred + current[1][None], gt)
        sides = ((pred, gt[to_gt.index]), (pred[to_pred.index], gt))
        mean_p = (sides[0][0].mean(axis=0) + sides[1][0].mean(axis=0)) / 2
        mean_g = (sides[0][1].mean(axis=0) + sides[1][1].mean(axis=0)) / 2
        products = sum(
            ((p - mean_p[None]) * (g - mean_g[None])).sum(axis=1).mean() for p, g in sides
        )
        squares = sum(jnp.square(p - mean_p[None]).sum(axis=1).mean() for p, _ in sides)
        ratio = products / jnp.where(squares > 0, squares, 1)
        scale = jnp.clip(jnp.where(squares > 0, ratio, 1), LEAST_SCALE, LARGEST_SCALE)
        # If a point is not finite, the distances are NaN, and this term makes the scale NaN.
        scale = scale + 0 * to_gt.distance_sq.sum()
        return scale, mean_g - scale * mean_p

    start = jnp.ones((), pred.dtype), jnp.zeros(3, pred.dtype)
    return jax.lax.fori_loop(0, ITERATIONS, step, start)


def aligned_metrics(
    pred: Float[Array, "n 3"],
    gt: Float[Array, "m 3"],
    *,
    emd_tolerance: float | None = None,
    known_emd: Float[Array, ""] | None = None,
) -> dict[str, Float[Array, ""]]:
    """Aligned CD and EMD of a pair, as defined above.

    The result has `aligned_cd_sq_radius2` (unit^2), `aligned_scale` (s, or 1 if alignment does not
    reduce the CD) and, with `emd_tolerance` (its relative error), `aligned_emd_radius` (unit, mean
    over the points). `known_emd`, the EMD without alignment, saves an auction.
    """
    scale, shift = align(pred, gt)
    moved = scale * pred + shift[None]
    before, after = chamfer_sq_mean(pred, gt), chamfer_sq_mean(moved, gt)
    metrics = {
        "aligned_cd_sq_radius2": jnp.minimum(before, after),
        "aligned_scale": jnp.where(after < before, scale, 1),
    }
    if emd_tolerance is not None:
        if known_emd is None:
            known_emd = emd(pred, gt, tolerance=emd_tolerance).emd
        after = emd(moved, gt, tolerance=emd_tolerance).emd
        metrics["aligned_emd_radius"] = jnp.minimum(known_emd, after)
    return metrics

"""Evaluation metrics of one pair of clouds.

The clouds `pred` [n, 3] and `gt` [m, 3], n, m >= 1, are in the same frame. Distances are in the
unit of the coordinates: in the project's frame the radius of the object's bounding hemisphere,
hence the suffix `_radius`. The other metrics are fractions. Batch the functions by
`losses.map_pairs`. `prediction.draws` has metrics of several predictions of one image.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp

from psgn_jax.array_types import Array, Bool, Float
from psgn_jax.losses.chamfer import Nearest, nearest_both
from psgn_jax.losses.emd import matched_distances
from psgn_jax.losses.numeric import check_points, safe_sqrt

FSCORE_THRESHOLD = 0.01

VISIBILITY = ("visible", "hidden")  # classes of true points, as in the names of metrics


class Emd(NamedTuple):
    """Mean distance of matched points (unit), and the proven bound on its relative error."""

    emd: Float[Array, ""]
    gap: Float[Array, ""]


def emd(
    pred: Float[Array, "n 3"], gt: Float[Array, "m 3"], *, tolerance: float | Array = 0.01
) -> Emd:
    """Earth mover's distance per point (unit): `losses.emd_mean` with its certificate.

    If gt has more than n points, we use n of them (`subset`). Then even a perfect prediction has a
    positive EMD, the distance between two random samples of the object. It depends on n, so report
    n. `gap` bounds (emd - optimum) / optimum. It is at most `tolerance`, unless the auction used up
    its budget. Errors: `losses.assign`, and ValueError if pred has more points than gt.
    """
    pred, gt = check_points(pred, "pred"), check_points(gt, "gt")
    if (n := len(pred)) > len(gt):
        raise ValueError(f"gt: got {len(gt)} points, expected at least as many as pred has ({n})")
    matched = matched_distances(pred, subset(gt, len(pred)), tolerance=tolerance)
    return Emd(matched.distance.mean(), matched.assignment.gap)


def subset(gt: Float[Array, "m 3"], count: int) -> Float[Array, "n 3"]:
    """At most `count` points of gt, a fixed choice for each m and count."""
    if len(gt) <= count:
        return gt
    return gt[jax.random.permutation(jax.random.key(0), len(gt))[:count]]


def _near(distance_sq: Array, threshold: float | Array) -> Array:
    """1 where a distance is at most the threshold, else 0; NaN stays NaN."""
    limit_sq = jnp.square(jnp.asarray(threshold, distance_sq.dtype))
    near = (distance_sq <= limit_sq).astype(distance_sq.dtype)
    return jnp.where(jnp.isnan(distance_sq), distance_sq, near)


def fscore(to_gt_sq: Array, to_pred_sq: Array, threshold: float | Array) -> Float[Array, ""]:
    """2 precision recall / (precision + recall) from squared nearest distances (unit^2)."""
    precision, recall = _near(to_gt_sq, threshold).mean(), _near(to_pred_sq, threshold).mean()
    total = precision + recall
    return 2 * precision * recall / jnp.where(total == 0, 1, total)


def _cd_l1(to_gt: Nearest, to_pred: Nearest, _: float | Array) -> Array:
    return (safe_sqrt(to_gt.distance_sq).mean() + safe_sqrt(to_pred.distance_sq).mean()) / 2


class Metric(NamedTuple):
    """The column of a metric in printed tables, and how a pair's nearest neighbours give it.

    `title` ends with the unit; fractions with "[%]" are printed as percentages. Without a title,
    only CSV and JSON have the metric. `of` is a function of the nearest neighbours of pred in gt
    and of gt in pred, and a threshold; None = computed elsewhere.
    """

    title: str = ""
    of: Callable[[Nearest, Nearest, float | Array], Array] | None = None


METRICS = {
    "cd_sq_radius2": Metric(
        "CD squared [radius^2]",
        lambda to_gt, to_pred, _: to_gt.distance_sq.mean() + to_pred.distance_sq.mean(),
    ),
    "cd_sq_pred_to_gt_radius2": Metric("", lambda to_gt, to_pred, _: to_gt.distance_sq.mean()),
    "cd_sq_gt_to_pred_radius2": Metric("", lambda to_gt, to_pred, _: to_pred.distance_sq.mean()),
    "cd_l1_radius": Metric("CD-L1 [radius]", _cd_l1),
    "emd_radius": Metric("EMD [radius]"),
    "fscore": Metric(
        "F-score at {threshold:g} radius [%]",
        lambda to_gt, to_pred, at: fscore(to_gt.distance_sq, to_pred.distance_sq, at),
    ),
    "precision": Metric("", lambda to_gt, to_pred, at: _near(to_gt.distance_sq, at).mean()),
    "recall": Metric("", lambda to_gt, to_pred, at: _near(to_pred.distance_sq, at).mean()),
    "cd_sq_gt_to_pred_visible_radius2": Metric("visible truth to pred [radius^2]"),
    "cd_sq_gt_to_pred_hidden_radius2": Metric("hidden [radius^2]"),
    "visible_share": Metric("visible [%]"),
    "aligned_cd_sq_radius2": Metric("aligned CD squared [radius^2]"),
    "aligned_emd_radius": Metric("aligned EMD [radius]"),
    "total_mutual_difference_radius2": Metric("total mutual difference [radius^2]"),
    "log_volume_abs_error": Metric("|log predicted - log true volume|"),
}
"""Metric -> its column and function, in the order of the columns."""


def by_visibility(
    distance_sq: Float[Array, " m"], visible: Bool[Array, " m"], threshold: float | Array
) -> dict[str, Float[Array, ""]]:
    """Means over the visible and over the hidden true points (`data.visibility`); NaN without any.

    `distance_sq` are from every true point to the nearest predicted point, unit^2. The result has
    `visible_share`, the fraction of true points that are visible, and for each class C of
    `VISIBILITY`: `cd_sq_gt_to_pred_C_radius2` (unit^2), `cd_l1_gt_to_pred_C_radius` (unit), and
    `recall_C`, the fraction within the threshold (unit).
    """
    visible = jnp.asarray(visible)
    metrics = {"visible_share": visible.astype(distance_sq.dtype).mean()}
    for name, members in zip(VISIBILITY, (visible, ~visible), strict=True):
        count = members.sum()

        def mean(values: Array, members: Array = members, count: Array = count) -> Array:
            total = jnp.where(members, values, 0).sum()
            return jnp.where(count > 0, total / jnp.maximum(count, 1), jnp.nan)

        metrics[f"cd_sq_gt_to_pred_{name}_radius2"] = mean(distance_sq)
        metrics[f"cd_l1_gt_to_pred_{name}_radius"] = mean(safe_sqrt(distance_sq))
        metrics[f"recall_{name}"] = mean(_near(distance_sq, threshold))
    return metrics


def evaluate_pair(
    pred: Float[Array, "n 3"],
    gt: Float[Array, "m 3"],
    visible: Bool[Array, " m"] | None = None,
    *,
    threshold: float | Array = FSCORE_THRESHOLD,
    emd_tolerance: float | None = None,
) -> dict[str, Float[Array, ""]]:
    """All metrics of one pair from one nearest-neighbour search.

    The F-score is 2 precision recall / (precision + recall), or 0 if both are 0 (Knapitsch et al.,
    "Tanks and Temples", ACM TOG 2017, section 4). It depends strongly on the number of points, so
    report this number. The default threshold is 1 % of the radius of the bounding hemisphere. In
    Tatarchenko et al., "What Do Single-view 3D Reconstruction Networks Learn?", CVPR 2019, it is
    1 % of the side of the reconstructed volume: pass 0.02 for an object 2 units wide.

    Args:
      visible: which points of gt the depth image shows; adds the metrics of `by_visibility`.
      threshold: largest distance of a correct point, in the unit of the coordinates, > 0.
      emd_tolerance: adds `emd` with this relative error; 2 to 3 ms of a core for n = 1,024 and 1 %.

    Returns:
      the metrics of `METRICS` that have a function, with units in their names (`radius2`: unit^2).
      `precision` is the share of pred with a distance to gt <= threshold, `recall` the share of gt
      near pred. With `emd_tolerance`: `emd_radius` (unit, mean over the points) and `emd_gap`, the
      bound on its relative error.

    Raises:
      ValueError: a threshold (a plain number) is not > 0; or as `losses.nearest_both` and `emd`.
    """
    if isinstance(threshold, int | float) and not 0 < threshold < float("inf"):
        raise ValueError(f"threshold: got {threshold}, expected a finite distance > 0")
    to_gt, to_pred = nearest_both(pred, gt)
    metrics = {
        name: metric.of(to_gt, to_pred, threshold) for name, metric in METRICS.items() if metric.of
    }
    if visible is not None:
        metrics |= by_visibility(to_pred.distance_sq, visible, threshold)
    if emd_tolerance is not None:
        result = emd(pred, gt, tolerance=emd_tolerance)
        metrics |= {"emd_radius": result.emd, "emd_gap": result.gap}
    return metrics

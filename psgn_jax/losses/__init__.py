"""Distances between point clouds, pure functions of one pair; batch by `map_pairs` or `vmap`."""

from collections.abc import Callable
from typing import Any

from psgn_jax.losses.auction import Assignment, assign
from psgn_jax.losses.chamfer import (
    Nearest,
    chamfer_authors,
    chamfer_l1_mean,
    chamfer_sq,
    chamfer_sq_mean,
    nearest_both,
)
from psgn_jax.losses.emd import (
    ExactAssignment,
    MatchedDistances,
    emd_exact,
    emd_mean,
    emd_sum,
    matched_distances,
)
from psgn_jax.losses.farthest_points import farthest_point_indices, farthest_points
from psgn_jax.losses.iou import iou, iou_sweep, soft_iou, soft_iou_loss
from psgn_jax.losses.mapping import map_pairs
from psgn_jax.losses.min_of_n import MinOfN, min_of_n

LOSSES: dict[str, Callable[..., Any]] = {
    "chamfer_sq": chamfer_sq,
    "chamfer_sq_mean": chamfer_sq_mean,
    "chamfer_l1_mean": chamfer_l1_mean,
    "chamfer_authors": chamfer_authors,
    "emd_sum": emd_sum,
    "emd_mean": emd_mean,
}
"""Losses for configurations: name -> function of one pair, (pred [n,3], gt [m,3]) -> scalar."""

__all__ = [
    "LOSSES", "Assignment", "ExactAssignment", "MatchedDistances", "MinOfN", "Nearest", "assign",
    "chamfer_authors", "chamfer_l1_mean", "chamfer_sq", "chamfer_sq_mean", "emd_exact", "emd_mean",
    "emd_sum", "farthest_point_indices", "farthest_points", "iou", "iou_sweep", "map_pairs",
    "matched_distances", "min_of_n", "nearest_both", "soft_iou", "soft_iou_loss",
]  # fmt: skip

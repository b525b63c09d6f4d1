"""Distances between point clouds: pure functions on one pair; callers vmap (or use `batched`)."""

from psgn_jax.losses.chamfer import (
    Nearest,
    batched,
    chamfer_authors,
    chamfer_l1_mean,
    chamfer_sq,
    chamfer_sq_gt_to_pred_mean,
    chamfer_sq_mean,
    chamfer_sq_pred_to_gt_mean,
    nearest,
    nearest_both,
)

__all__ = [
    "Nearest",
    "batched",
    "chamfer_authors",
    "chamfer_l1_mean",
    "chamfer_sq",
    "chamfer_sq_gt_to_pred_mean",
    "chamfer_sq_mean",
    "chamfer_sq_pred_to_gt_mean",
    "nearest",
    "nearest_both",
]

"""Intersection over union of two volumes: soft for training, at a threshold for evaluation.

Volumes are occupancies in [0, 1] or bool, on the same grid of any shape; other shapes and dtypes
raise a ValueError. All functions take one pair. IoU has no unit.
"""

import jax.numpy as jnp

from psgn_jax.array_types import Array, Bool, Float

PREDICTION_THRESHOLDS = tuple(round(0.05 * i, 2) for i in range(1, 20))
"""Default thresholds of `iou_sweep`: .05 to .95."""


def soft_iou(pred: Float[Array, "*cells"], gt: Float[Array, "*cells"]) -> Float[Array, ""]:
    """IoU of probabilities: sum(p g) / sum(p + g - p g), or 1 if both volumes are empty.

    Equal to `iou` if all values are 0 or 1. Differentiable everywhere. Source: Rahman and Wang,
    "Optimizing Intersection-Over-Union in Deep Neural Networks for Image Segmentation", ISVC 2016.
    The paper says only that its post-processing network "is trained by IoU" (implementation
    details); this form is **ours**.
    """
    # Sums over a grid exceed the range of float16.
    pred, gt = (v.astype(jnp.promote_types(v.dtype, "float32")) for v in _volumes(pred, gt))
    both = (pred * gt).sum()
    either = pred.sum() + gt.sum() - both
    empty = either == 0
    return jnp.where(empty, 1.0, both / jnp.where(empty, 1, either))


def soft_iou_loss(pred: Float[Array, "*cells"], gt: Float[Array, "*cells"]) -> Float[Array, ""]:
    """1 - `soft_iou`."""
    return 1 - soft_iou(pred, gt)


def iou(
    pred: Float[Array, "*cells"], gt: Bool[Array, "*cells"], threshold: float | Array = 0.5
) -> Float[Array, ""]:
    """|P and G| / |P or G| with P = (pred >= threshold), or 1 if both volumes are empty.

    NaN if a predicted value is NaN. Source: Choy et al., "3D-R2N2", ECCV 2016, section 5.1 (its
    code compares with >= and uses the threshold .4).
    """
    return iou_sweep(pred, gt, jnp.asarray(threshold)[None])[0]


def iou_sweep(
    pred: Float[Array, "*cells"],
    gt: Bool[Array, "*cells"],
    thresholds: Float[Array, " t"] | tuple[float, ...] = PREDICTION_THRESHOLDS,
) -> Float[Array, " t"]:
    """`iou` at each threshold."""
    pred, gt = (volume.reshape(1, -1) for volume in _volumes(pred, gt))
    if gt.dtype != bool:
        raise ValueError(f"gt: got {gt.dtype}, expected bool")
    inside = pred >= jnp.asarray(thresholds, pred.dtype)[:, None]
    both = (inside & gt).sum(axis=1)
    either = (inside | gt).sum(axis=1)
    score = jnp.where(either == 0, 1.0, both / jnp.where(either == 0, 1, either))
    # NaN >= threshold is False, so NaN would count as an empty cell.
    return jnp.where(jnp.isnan(pred).any(), jnp.nan, score)


def _volumes(pred: Array, gt: Array) -> tuple[Array, Array]:
    """Both volumes as arrays; ValueError for different shapes or wrong dtypes."""
    volumes = jnp.asarray(pred), jnp.asarray(gt)
    shape, other = (volume.shape for volume in volumes)
    if shape != other:
        raise ValueError(f"pred has the shape {shape}, gt {other}: expected the same grid")
    for name, volume in zip(("pred", "gt"), volumes, strict=True):
        if volume.dtype != bool and not jnp.issubdtype(volume.dtype, jnp.floating):
            raise ValueError(f"{name}: got {volume.dtype}, expected floats in [0, 1] or bool")
    return volumes

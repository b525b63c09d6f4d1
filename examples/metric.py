"""A metric of a pair of clouds: the Hausdorff distance."""

import jax.numpy as jnp

from psgn_jax.array_types import Array
from psgn_jax.evaluation.clouds import METRICS, Metric
from psgn_jax.losses import Nearest


def hausdorff(to_gt: Nearest, to_pred: Nearest, threshold: float | Array) -> Array:
    """The largest distance of a point to the nearest one of the other cloud [radius]."""
    return jnp.sqrt(jnp.maximum(to_gt.distance_sq.max(), to_pred.distance_sq.max()))


METRICS["hausdorff_radius"] = Metric("Hausdorff [radius]", hausdorff)

"""A loss: the Chamfer distance by a pseudo-Huber function, which weighs far points less."""

import jax.numpy as jnp

from psgn_jax import losses
from psgn_jax.array_types import Array, Float


def chamfer_huber_mean(pred: Float[Array, "n 3"], gt: Float[Array, "m 3"]) -> Float[Array, ""]:
    """The means of h(d) = 2 s^2 (sqrt(1 + d^2 / s^2) - 1), s = .1, both directions added [unit^2].

    For d far below s, h is d^2, and the loss is `chamfer_sq_mean`.
    """
    means = [huber(nearest.distance_sq).mean() for nearest in losses.nearest_both(pred, gt)]
    return means[0] + means[1]


def huber(distance_sq: Array, scale: float = 0.1) -> Array:
    return 2 * scale**2 * (jnp.sqrt(1 + distance_sq / scale**2) - 1)


losses.LOSSES["chamfer_huber_mean"] = chamfer_huber_mean

"""Metrics of several predictions for one image, compared with one or several true shapes.

"Draws" are the predictions for one image with different random inputs. A `Distance` is a function
of one pair of clouds from `losses` or `evaluation.clouds`. An argument `distances` is a matrix from
`prediction.sampling.cross_distances`. Results are in the unit of the distance.
"""

import jax.numpy as jnp

from psgn_jax.array_types import Array, Float
from psgn_jax.prediction.sampling import Distance, cross_distances


def coverage(distances: Float[Array, "k t"]) -> Float[Array, ""]:
    """Fraction of the true shapes that are the nearest true shape of some draw.

    If several true shapes are equally near, the first one counts. Coverage measures whether the
    draws reach all true shapes, not how near they come. If each of K draws equals one of T true
    shapes chosen at random, the expected coverage is 1 - (1 - 1/T)^K: .66 for K = T = 8.

    Source: Achlioptas et al., "Learning Representations and Generative Models for 3D Point Clouds",
    ICML 2018, section 2.2.
    """
    nearest = jnp.argmin(distances, axis=1)
    hit = jnp.zeros(distances.shape[1], bool).at[nearest].set(True)
    return hit.mean()


def total_mutual_difference(distances: Float[Array, "k k"]) -> Float[Array, ""]:
    """Total mutual difference of K > 1 draws of one image.

    TMD = sum over i of 1 / (K - 1) * sum over j != i of d(draw_i, draw_j)

    It grows with K. Source: Wu et al., "Multimodal Shape Completion via Conditional Generative
    Adversarial Networks", ECCV 2020, section 4 (there K = 10 and the Chamfer distance).
    """
    off = distances * (1 - jnp.eye(len(distances), dtype=distances.dtype))
    return off.sum() / (len(distances) - 1)


def summarise_draws(
    draws: Float[Array, "k n 3"], gt: Float[Array, "m 3"], distances: dict[str, Distance]
) -> dict[str, Array]:
    """Minimum and mean over i of d(draw_i, gt), for each named distance d.

    The best of K measures how near the draws come to the truth if the best one can be chosen. It
    decreases or stays the same as K grows, so K must be reported. The mean is the expected distance
    of one draw.

    Source: paper, equation of the MoN loss, here used as a metric.

    Returns:
      `<name>_best_of_<K>` and `<name>_mean_of_<K>`.
    """
    metrics: dict[str, Array] = {}
    for name, distance in distances.items():
        each = cross_distances(draws, gt[None], distance)[:, 0]
        metrics[f"{name}_best_of_{len(draws)}"] = each.min()
        metrics[f"{name}_mean_of_{len(draws)}"] = each.mean()
    return metrics

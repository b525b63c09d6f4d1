"""Metrics of several predictions for one image, compared with one or several true shapes.

In this module, "samples" or "draws" are the predictions for one image with different random inputs.
An argument `distance` is a function of one pair of clouds from `losses` or `evaluation.clouds`. An
argument `distances` is a matrix from `prediction.sampling.cross_distances`. Results are in the unit
of the distance.
"""

import jax.numpy as jnp
import numpy as np

from psgn_jax.array_types import Array, Float
from psgn_jax.prediction.sampling import Distance, cross_distances


def minimum_matching_distance(distances: Float[Array, "k t"]) -> Float[Array, ""]:
    """Minimum matching distance: mean over the true shapes of the distance to the nearest sample.

    MMD = mean over j of min over i of d(draw_i, truth_j)

    It is small if every true shape is near some sample.

    Source: Achlioptas et al., "Learning Representations and Generative Models for 3D Point Clouds",
    ICML 2018, section 2.2. There the mean is over all shapes of a category, here over the true
    shapes that fit one image.
    """
    return distances.min(axis=0).mean()


def coverage(distances: Float[Array, "k t"]) -> Float[Array, ""]:
    """Fraction of the true shapes that are the nearest true shape of some sample.

    If several true shapes are equally near, the first one counts. Coverage measures whether the
    samples reach all true shapes, not how near they come. If each of K samples equals one of T true
    shapes chosen at random, the expected coverage is 1 - (1 - 1/T)^K: .66 for K = T = 8.

    Source: Achlioptas et al. 2018, section 2.2.
    """
    nearest = jnp.argmin(distances, axis=1)
    hit = jnp.zeros(distances.shape[1], bool).at[nearest].set(True)
    return hit.mean()


def total_mutual_difference(distances: Float[Array, "k k"]) -> Float[Array, ""]:
    """Total mutual difference of K samples of one image.

    TMD = sum over i of 1 / (K - 1) * sum over j != i of d(draw_i, draw_j)

    It grows with K. Source: Wu et al., "Multimodal Shape Completion via Conditional Generative
    Adversarial Networks", ECCV 2020, section 4 (there K = 10 and the Chamfer distance).

    Raises:
      ValueError: `distances` is not a square matrix of at least two samples.
    """
    k = len(distances)
    if distances.shape != (k, k) or k < 2:
        raise ValueError(
            f"distances: got shape {tuple(distances.shape)}, expected [k, k] with k >= 2"
        )
    off = distances * (1 - jnp.eye(k, dtype=distances.dtype))
    return off.sum() / (k - 1)


def wasserstein_1(drawn: Float[np.ndarray, " k"], true: Float[np.ndarray, " t"]) -> float:
    """Wasserstein-1 distance of two sets of numbers: the integral of |F - G|, in their unit.

    F and G are the empirical distribution functions. Even for K exact samples of the true
    distribution, the result is not 0 but of the order of the distribution's width / sqrt(K).

    Source: Vallender, Theory of Probability 18(4), 1974.

    Raises:
      ValueError: a set is empty or has numbers that are not finite.
    """
    samples = [np.sort(np.asarray(s, np.float64).reshape(-1)) for s in (drawn, true)]
    for name, values in zip(("drawn", "true"), samples, strict=True):
        if not len(values) or not np.isfinite(values).all():
            raise ValueError(f"{name}: got {values[:4]}, expected finite numbers, at least one")
    edges = np.sort(np.concatenate(samples))
    below = [np.searchsorted(s, edges[:-1], side="right") / len(s) for s in samples]
    return float(np.sum(np.abs(below[0] - below[1]) * np.diff(edges)))


def range_coverage(drawn: Float[np.ndarray, " k"], low: float, high: float) -> float:
    """Fraction of the range [low, high] that lies between the smallest and largest sampled number.

    K uniform samples of that range cover (K - 1) / (K + 1) of it on average.

    Raises:
      ValueError: `low` is not below `high`, or there are no samples.
    """
    if not low < high or not np.size(drawn):
        raise ValueError(
            f"range {low} to {high} of {np.size(drawn)} numbers: expected low < high and at least"
            " one number"
        )
    inside = min(float(np.max(drawn)), high) - max(float(np.min(drawn)), low)
    return max(0.0, inside) / (high - low)


def summarise_draws(
    draws: Float[Array, "k n 3"], gt: Float[Array, "m 3"], distances: dict[str, Distance]
) -> dict[str, Array]:
    """Minimum and mean over i of d(draw_i, gt), for each named distance d.

    The best of K measures how near the samples come to the truth if the best one can be chosen. It
    decreases or stays the same as K grows, so K must be reported. The mean is the expected distance
    of one sample.

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

"""Metrics of several predictions for one image, compared with one or several true shapes.

In this module, "samples" or "draws" are the predictions for one image with different random inputs.
An argument `distance` is a function of one pair of clouds from `losses` or `metrics.clouds`. An
argument `distances` is a matrix from `cross_distances`. Results are in the unit of the distance.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from psgn_jax.losses.distances import map_pairs
from psgn_jax.types import Array, Float

Distance = Callable[[Array, Array], Array]


class BestAndMean(NamedTuple):
    """Minimum and mean of the distances of K samples to one ground truth, and all K distances."""

    best: Float[Array, ""]
    mean: Float[Array, ""]
    each: Float[Array, " k"]


def cross_distances(
    a: Float[Array, "k n 3"], b: Float[Array, "t m 3"], distance: Distance
) -> Float[Array, "k t"]:
    """Distances between all clouds of `a` and all clouds of `b`: entry (i, j) is d(a_i, b_j)."""
    k, t = len(a), len(b)
    pairs = map_pairs(distance)(jnp.repeat(a, t, axis=0), jnp.tile(b, (k, 1, 1)))
    return pairs.reshape(k, t)


def best_and_mean(
    draws: Float[Array, "k n 3"], gt: Float[Array, "m 3"], distance: Distance
) -> BestAndMean:
    """Best-of-K and mean-of-K: min and mean over i of d(draw_i, gt).

    The best of K measures how near the samples come to the truth if the best one can be chosen. It
    decreases or stays the same as K grows, so K must be reported. The mean is the expected distance
    of one sample.

    Source: paper, equation of the MoN loss, here used as a metric.
    """
    each = cross_distances(draws, gt[None], distance)[:, 0]
    return BestAndMean(each.min(), each.mean(), each)


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


def mutual_distances(draws: Float[Array, "k n 3"], distance: Distance) -> Float[Array, "k k"]:
    """`cross_distances(draws, draws, distance)` for a symmetric distance; computes each pair once.

    The diagonal is 0.
    """
    first, second = np.triu_indices(len(draws), 1)
    matrix = jnp.zeros((len(draws), len(draws)), draws.dtype)
    if not len(first):
        return matrix
    values = map_pairs(distance)(draws[first], draws[second])
    return matrix.at[first, second].set(values).at[second, first].set(values)


class Spread(NamedTuple):
    """Standard deviation over samples of the position of each output point (unit).

    Attributes:
      by_axis: along x, y, z.
      total: square root of the sum of the three variances.
    """

    by_axis: Float[Array, "n 3"]
    total: Float[Array, " n"]


def spread(draws: Float[Array, "k n 3"]) -> Spread:
    """Standard deviation of each output point over the samples of one image.

    Points with the same index correspond, because one network predicts all samples and a small
    change of its random input moves a point only a little. Points of which the network is certain
    should have a small spread, and the others a larger one along the directions of ambiguity.

    Source: paper, section "Predicting Multiple Plausible Shapes".
    """
    variance = jnp.var(draws, axis=0)
    return Spread(jnp.sqrt(variance), jnp.sqrt(variance.sum(axis=-1)))


def marginal_spread(draws: Float[Array, "k n 3"]) -> Float[Array, "3"]:
    """How much the samples differ along each axis, independently of the order of their points.

    The coordinates of each sample along an axis are sorted. The result is the square root of the
    mean over ranks of the variance over samples, in the unit of the points. Unlike `spread`, it
    does not increase if points exchange their positions.

    This is **ours**: the standard deviation of the samples in the Wasserstein-2 metric of their
    marginals.
    """
    return jnp.sqrt(jnp.var(jnp.sort(draws, axis=1), axis=0).mean(axis=0))


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
    """Best-of-K and mean-of-K for each named distance, without gradients.

    Returns:
      `<name>_best_of_<K>` and `<name>_mean_of_<K>`.
    """
    metrics: dict[str, Array] = {}
    for name, distance in distances.items():
        result = best_and_mean(draws, gt, distance)
        metrics[f"{name}_best_of_{len(draws)}"] = result.best
        metrics[f"{name}_mean_of_{len(draws)}"] = result.mean
    return jax.tree.map(jax.lax.stop_gradient, metrics)

"""Metrics of a sampler: several predictions for one image, set against one truth or several.

Distances between clouds are `losses`' or `metrics.clouds`' own, of one pair; a matrix of them is
made by `cross_distances`, and the metrics of sets read that matrix. Units are those of the
distance.
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
    """The least and the mean of the distances of K draws from one truth, and all of them."""

    best: Float[Array, ""]
    mean: Float[Array, ""]
    each: Float[Array, " k"]


def cross_distances(
    a: Float[Array, "k n 3"], b: Float[Array, "t m 3"], distance: Distance
) -> Float[Array, "k t"]:
    """The distance of every cloud of `a` from every cloud of `b`: entry (i, j) is d(a_i, b_j)."""
    k, t = len(a), len(b)
    pairs = map_pairs(distance)(jnp.repeat(a, t, axis=0), jnp.tile(b, (k, 1, 1)))
    return pairs.reshape(k, t)


def best_and_mean(
    draws: Float[Array, "k n 3"], gt: Float[Array, "m 3"], distance: Distance
) -> BestAndMean:
    """Best-of-K and mean-of-K: min and mean over i of d(draw_i, gt).

    The best of K says how near a sampler comes if something else picks the draw; it never grows
    with K, so K has to be stated. The mean is what one draw can be expected to have.
    Source: paper, equation of the MoN loss, as a metric.
    """
    each = cross_distances(draws, gt[None], distance)[:, 0]
    return BestAndMean(each.min(), each.mean(), each)


def minimum_matching_distance(distances: Float[Array, "k t"]) -> Float[Array, ""]:
    """Mean over the true shapes that share an image of the distance to the nearest draw.

    MMD = mean over j of min over i of d(draw_i, truth_j): small where each truth has a good draw.

    Source: Achlioptas et al., "Learning Representations and Generative Models for 3D Point Clouds",
    ICML 2018, section 2.2; there over all shapes of a category, here over those of one image.
    """
    return distances.min(axis=0).mean()


def coverage(distances: Float[Array, "k t"]) -> Float[Array, ""]:
    """Share of the true shapes that are the nearest one of some draw (the first, in a tie).

    It says whether the draws go everywhere, not how near they come. T truths hit by K random draws
    of their own kind are covered to 1 - (1 - 1/T)^K: .66 at K = T = 8.

    Source: Achlioptas et al. 2018, section 2.2.
    """
    nearest = jnp.argmin(distances, axis=1)
    hit = jnp.zeros(distances.shape[1], bool).at[nearest].set(True)
    return hit.mean()


def total_mutual_difference(distances: Float[Array, "k k"]) -> Float[Array, ""]:
    """How much K draws of one image differ: sum over i of the mean distance to the others.

    TMD = sum over i of 1 / (K - 1) * sum over j != i of d(draw_i, draw_j).

    Source: Wu et al., "Multimodal Shape Completion via Conditional Generative Adversarial
    Networks", ECCV 2020, section 4 (there K = 10 and the Chamfer distance). It grows with K.

    Raises:
      ValueError: not a square matrix of at least two draws.
    """
    k = len(distances)
    if distances.shape != (k, k) or k < 2:
        raise ValueError(
            f"distances: got shape {tuple(distances.shape)}, expected [k, k] with k >= 2"
        )
    off = distances * (1 - jnp.eye(k, dtype=distances.dtype))
    return off.sum() / (k - 1)


def mutual_distances(draws: Float[Array, "k n 3"], distance: Distance) -> Float[Array, "k k"]:
    """`cross_distances(draws, draws, distance)` of a symmetric distance, each pair once."""
    first, second = np.triu_indices(len(draws), 1)
    matrix = jnp.zeros((len(draws), len(draws)), draws.dtype)
    if not len(first):
        return matrix
    values = map_pairs(distance)(draws[first], draws[second])
    return matrix.at[first, second].set(values).at[second, first].set(values)


class Spread(NamedTuple):
    """Standard deviation over draws of each output point's place (unit).

    Attributes:
      by_axis: along x, y, z.
      total: Euclidean, the root of the sum of their squares.
    """

    by_axis: Float[Array, "n 3"]
    total: Float[Array, " n"]


def spread(draws: Float[Array, "k n 3"]) -> Spread:
    """How far each output point moves between draws of one image.

    Draws correspond by the index of the point: one network makes them all, and a small
    change of its random input moves a point a little. Source: paper, section "Predicting Multiple
    Plausible Shapes": certain points move little, along the direction of ambiguity they move more.
    """
    variance = jnp.var(draws, axis=0)
    return Spread(jnp.sqrt(variance), jnp.sqrt(variance.sum(axis=-1)))


def marginal_spread(draws: Float[Array, "k n 3"]) -> Float[Array, "3"]:
    """How much the draws differ along each axis, whatever the order of their points.

    The coordinates of each draw along an axis are sorted; the result is the root of the mean over
    ranks of the variance over draws, in the unit of the points. Points that only change places, or
    slide so that others fill their gaps, count in `spread` and not here.

    Source: the draws' variance in the Wasserstein-2 metric of their marginals, **ours**.
    """
    return jnp.sqrt(jnp.var(jnp.sort(draws, axis=1), axis=0).mean(axis=0))


def wasserstein_1(drawn: Float[np.ndarray, " k"], true: Float[np.ndarray, " t"]) -> float:
    """Wasserstein-1 distance of two samples of one number: the integral of |F - G|, in its unit.

    For K exact draws of the true distribution it is not 0 but of the order of its width / sqrt(K):
    compare with that floor. Source: Vallender, Theory of Probability 18(4), 1974.

    Raises:
      ValueError: an empty sample, or one that is not finite.
    """
    samples = [np.sort(np.asarray(s, np.float64).reshape(-1)) for s in (drawn, true)]
    for name, values in zip(("drawn", "true"), samples, strict=True):
        if not len(values) or not np.isfinite(values).all():
            raise ValueError(f"{name}: got {values[:4]}, expected finite numbers, at least one")
    edges = np.sort(np.concatenate(samples))
    below = [np.searchsorted(s, edges[:-1], side="right") / len(s) for s in samples]
    return float(np.sum(np.abs(below[0] - below[1]) * np.diff(edges)))


def range_coverage(drawn: Float[np.ndarray, " k"], low: float, high: float) -> float:
    """Share of the true range [low, high] between the least and the greatest drawn number.

    K uniform draws of that range cover (K - 1) / (K + 1) of it on average.

    Raises:
      ValueError: not low < high, or nothing drawn.
    """
    if not low < high or not np.size(drawn):
        raise ValueError(f"range {low} to {high} of {np.size(drawn)} numbers: expected low < high")
    inside = min(float(np.max(drawn)), high) - max(float(np.min(drawn)), low)
    return max(0.0, inside) / (high - low)


def summarise_draws(
    draws: Float[Array, "k n 3"], gt: Float[Array, "m 3"], distances: dict[str, Distance]
) -> dict[str, Array]:
    """Best-of-K and mean-of-K under each named distance, for a table.

    Returns:
      `<name>_best_of_<K>` and `<name>_mean_of_<K>`.
    """
    found: dict[str, Array] = {}
    for name, distance in distances.items():
        of = best_and_mean(draws, gt, distance)
        found[f"{name}_best_of_{len(draws)}"] = of.best
        found[f"{name}_mean_of_{len(draws)}"] = of.mean
    return jax.tree.map(jax.lax.stop_gradient, found)

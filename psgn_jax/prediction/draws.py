"""Draws: clouds of a network with a random input, which of them are shown, and their metrics.

The random input is the r of a network trained with Min-of-N, or the latent variable z of a
variational autoencoder. Both are N(0, I) (paper, section "Predicting Multiple Plausible Shapes").
A draw is the prediction for one r. The first cloud is the prediction for r = 0, the most probable
r, or the mean of the draws; `ranked` chooses further clouds. This choice is **ours**; the paper
shows draws as they come.
"""

import functools
from collections.abc import Callable
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np

from psgn_jax.array_types import Array, Float, Int
from psgn_jax.config.experiment import Config
from psgn_jax.losses.auction import assign
from psgn_jax.losses.by_name import chosen_points
from psgn_jax.losses.chamfer import chamfer_sq_mean
from psgn_jax.losses.mapping import map_pairs
from psgn_jax.models.networks import random_key

First = Literal["zero", "mean"]
FIRST: tuple[First, ...] = ("zero", "mean")

_FEW = 256  # points of each cloud that are compared: 16 draws take 11 ms of a core
# Accepted relative error of the bijections between clouds. 15 of them take 115 ms of a core; with
# 1 % they take 150 ms, and the spreads have a correlation of .975 with these.
_TOLERANCE = 0.05

Distance = Callable[[Array, Array], Array]
"""A distance of one pair of clouds, as in `losses`."""


@functools.partial(jax.jit, static_argnums=(0, 2, 3))
def sample_latents(
    config: Config, first: Array | int, batch_size: int, num_draws: int, seed: Array | int
) -> Float[Array, "b k size"]:
    """Random inputs of the samples `first`, `first` + 1, ...

    Each depends only on the seed and the numbers of the sample and of the draw, not on the batch or
    on `num_draws`. Training and evaluation steps use `models.networks.random_input` instead.
    """
    key = random_key(0, seed, train=False)

    def one(sample: Array, draw: Array) -> Array:
        own = jax.random.fold_in(jax.random.fold_in(key, sample), draw)
        return jax.random.normal(own, (config.model.random_size,))

    over_draws = jax.vmap(one, (None, 0))
    return jax.vmap(over_draws, (0, None))(first + jnp.arange(batch_size), jnp.arange(num_draws))


def image_latents(config: Config, num_draws: int, seed: int) -> Float[np.ndarray, "1+k size"]:
    """Random inputs of predictions: 0, then those of `num_draws` draws; the same for every image.

    So the clouds of an image do not depend on the other images, nor a draw on the number of draws.
    NumPy draws them, because a program for them would have to be compiled.
    """
    rng = np.random.default_rng(seed & 0xFFFFFFFF)
    draws = rng.standard_normal((num_draws, config.model.random_size), np.float32)
    return np.pad(draws, ((1, 0), (0, 0)))


def num_draws(samples: int) -> int:
    """Draws for so many clouds: 16, or twice as many as clouds, so that half of them suffice."""
    return max(16, 2 * samples)


def compared_points(num_points: int) -> np.ndarray:
    """Numbers of the points that `ranked` compares, int [256], or all if there are fewer."""
    numbers: Any = np.arange(num_points)
    return np.asarray(chosen_points(numbers, min(_FEW, num_points)))


def ranked(clouds: Float[Array, "k n 3"], samples: int) -> Int[Array, " k"]:
    """Numbers of the clouds: the first, `samples` - 1 draws that differ, then the other draws.

    Each of those that differ is the farthest from the clouds before it (by the Chamfer distance to
    the nearest of them), among the half of the draws with the smallest sums of distances to all
    clouds. The others are in the order of their sums.
    """
    k = len(clouds)
    few = clouds[:, compared_points(clouds.shape[1])]
    a, b = np.triu_indices(k, 1)
    upper = map_pairs(chamfer_sq_mean)(few[a], few[b])
    distances = jnp.zeros((k, k)).at[a, b].set(upper)
    distances += distances.T
    order = jnp.argsort(distances.sum(axis=0).at[0].set(-1))
    distances = distances[order][:, order]
    left = jnp.arange(k) <= max((k - 1) // 2, samples - 1)
    shown, nearest = [jnp.int32(0)], distances[0]
    for _ in range(samples - 1):
        left = left.at[shown[-1]].set(False)
        shown.append(jnp.argmax(jnp.where(left, nearest, -1)).astype(jnp.int32))
        nearest = jnp.minimum(nearest, distances[shown[-1]])
    first_ones = jnp.stack(shown)
    others = jnp.ones(k, bool).at[first_ones].set(False)
    rest = jnp.nonzero(others, size=k - samples)[0].astype(jnp.int32)
    return order[jnp.concatenate([first_ones, rest])].astype(jnp.int32)


def with_first(clouds: Float[Array, "b k n 3"], first: First = "zero") -> Float[Array, "b k n 3"]:
    """The clouds of r = 0 and of draws; with `first` = "mean", the mean of the draws comes first.

    The mean is taken over points with the same number. They correspond, because a small change of
    the random input moves a point only a little.
    """
    return clouds if first == "zero" else clouds.at[:, 0].set(clouds[:, 1:].mean(axis=1))


def matched(clouds: Float[Array, "k n 3"]) -> tuple[Int[Array, "k-1 n"], Float[Array, "k-1 n 3"]]:
    """In each other cloud, numbers and places of the EMD's partners of the first cloud's points."""

    def index_of(first: Array, other: Array) -> Array:
        return assign(first, other, tolerance=_TOLERANCE).index

    index = map_pairs(index_of)(jnp.broadcast_to(clouds[:1], clouds[1:].shape), clouds[1:])
    return index, jnp.take_along_axis(clouds[1:], index[..., None], axis=1)


@functools.partial(jax.jit, static_argnames="samples")
def spread(clouds: Float[Array, "k n 3"], samples: int = 1) -> Float[Array, "samples n"]:
    """How far the points of the first `samples` clouds vary (unit): little where they are certain.

    For a point of the first cloud it is the mean distance to its partners in the other clouds; the
    partners in other clouds have the same value.
    """
    index, partners = matched(clouds)
    first = jnp.linalg.norm(partners - clouds[:1], axis=-1).mean(axis=0)
    others = jax.vmap(lambda own: jnp.zeros_like(first).at[own].set(first))(index[: samples - 1])
    return jnp.concatenate([first[None], others])


# --- metrics ------------------------------------------------------------------------------------


def cross_distances(
    a: Float[Array, "k n 3"], b: Float[Array, "t m 3"], distance: Distance
) -> Float[Array, "k t"]:
    """Distances between all clouds of `a` and all clouds of `b`: entry (i, j) is d(a_i, b_j)."""
    k, t = len(a), len(b)
    pairs = map_pairs(distance)(jnp.repeat(a, t, axis=0), jnp.tile(b, (k, 1, 1)))
    return pairs.reshape(k, t)


def coverage(distances: Float[Array, "k t"]) -> Float[Array, ""]:
    """Fraction of the true shapes that are the nearest true shape of some draw.

    `distances` are `cross_distances` of draws and true shapes. Coverage measures whether the draws
    reach all true shapes, not how near they come. If each of K draws equals one of T true shapes
    chosen at random, we expect 1 - (1 - 1/T)^K: .66 for K = T = 8. Exact draws of a continuous
    distribution reach less: we measure .54 +- .02 for the cabinets of `studies.ambiguity`.

    Source: Achlioptas et al., "Learning Representations and Generative Models for 3D Point Clouds",
    ICML 2018, section 2.2.
    """
    nearest = jnp.argmin(distances, axis=1)
    hit = jnp.zeros(distances.shape[1], bool).at[nearest].set(True)
    return hit.mean()


def total_mutual_difference(draws: Float[Array, "k n 3"]) -> Float[Array, ""]:
    """Total mutual difference of K > 1 draws of one image (unit^2), with `chamfer_sq_mean` as d.

    TMD = sum over i of 1 / (K - 1) * sum over j != i of d(draw_i, draw_j)

    It grows with K. Source: Wu et al., "Multimodal Shape Completion via Conditional Generative
    Adversarial Networks", ECCV 2020, section 4 (there K = 10).
    """
    first, second = np.triu_indices(len(draws), 1)
    distances = map_pairs(chamfer_sq_mean)(draws[first], draws[second])
    return 2 * distances.sum() / (len(draws) - 1)


def summarise_draws(
    draws: Float[Array, "k n 3"], gt: Float[Array, "m 3"], distances: dict[str, Distance]
) -> dict[str, Array]:
    """Minimum and mean over i of d(draw_i, gt): `<name>_best_of_<K>` and `<name>_mean_of_<K>`.

    The best of K says how near the draws come to the truth if the best one can be chosen. It does
    not increase with K, so report K. The mean is the expected distance of one draw.

    Source: paper, equation of the MoN loss, here used as a metric.
    """
    metrics: dict[str, Array] = {}
    for name, distance in distances.items():
        each = cross_distances(draws, gt[None], distance)[:, 0]
        metrics[f"{name}_best_of_{len(draws)}"] = each.min()
        metrics[f"{name}_mean_of_{len(draws)}"] = each.mean()
    return metrics

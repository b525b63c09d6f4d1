"""Several predictions ("draws") for one image, by sampling the random input, and their metrics.

The random input is the r of a network trained with Min-of-N, or the latent variable z of a
variational autoencoder, sampled from the prior. Both are N(0, I) (paper, section "Predicting
Multiple Plausible Shapes").
"""

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

from psgn_jax.array_types import Array, Float
from psgn_jax.config.experiment import Config
from psgn_jax.losses.chamfer import chamfer_sq_mean
from psgn_jax.losses.mapping import map_pairs
from psgn_jax.models.networks import random_key

Distance = Callable[[Array, Array], Array]
"""A distance of one pair of clouds, as in `losses`."""


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

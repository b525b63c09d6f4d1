"""Several predictions for one image, by sampling the random input.

For a network trained with Min-of-N, the random input r is sampled as in training. For a variational
autoencoder, it is the latent variable z and is sampled from the prior. Both distributions are
N(0, I) (paper, section "Predicting Multiple Plausible Shapes").
"""

import functools
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn

from psgn_jax.array_types import Array, Float
from psgn_jax.config.experiment import Config, ConfigError
from psgn_jax.losses.batches import map_pairs
from psgn_jax.losses.chamfer import chamfer_sq_mean
from psgn_jax.models import networks
from psgn_jax.models.networks import random_key

Distance = Callable[[Array, Array], Array]
"""A distance of one pair of clouds, such as those of `losses`."""


def cross_distances(
    a: Float[Array, "k n 3"], b: Float[Array, "t m 3"], distance: Distance
) -> Float[Array, "k t"]:
    """Distances between all clouds of `a` and all clouds of `b`: entry (i, j) is d(a_i, b_j)."""
    k, t = len(a), len(b)
    pairs = map_pairs(distance)(jnp.repeat(a, t, axis=0), jnp.tile(b, (k, 1, 1)))
    return pairs.reshape(k, t)


def mutual_distances(draws: Float[Array, "k n 3"]) -> Float[Array, "k k"]:
    """`chamfer_sq_mean` between all clouds; computes each pair once, the diagonal is 0."""
    first, second = np.triu_indices(len(draws), 1)
    matrix = jnp.zeros((len(draws), len(draws)), draws.dtype)
    if not len(first):
        return matrix
    values = map_pairs(chamfer_sq_mean)(draws[first], draws[second])
    return matrix.at[first, second].set(values).at[second, first].set(values)


@functools.partial(jax.jit, static_argnums=(0, 2, 3))
def sample_latents(
    config: Config, first: Array | int, batch_size: int, num_draws: int, seed: Array | int
) -> Float[Array, "b k size"]:
    """Random inputs of the samples `first`, `first` + 1, ...

    Each random input depends only on the seed, the number of the sample and the number of the draw.
    It does not depend on the batch or on `num_draws`. The training step and the evaluation step do
    not use this function: they use `models.networks.random_input`.
    """
    key = random_key(0, seed, train=False)

    def one(sample: Array, draw: Array) -> Array:
        own = jax.random.fold_in(jax.random.fold_in(key, sample), draw)
        return jax.random.normal(own, (config.model.random_size,))

    over_draws = jax.vmap(one, (None, 0))
    return jax.vmap(over_draws, (0, None))(first + jnp.arange(batch_size), jnp.arange(num_draws))


@functools.lru_cache(maxsize=8)
def sampler(
    config: Config, model: nn.Module, num_draws: int
) -> Callable[[Any, Mapping[str, Any], Any, Any], Float[Array, "b k n 3"]]:
    """Compiled `(params, batch, seed, first) -> points`: K predictions for each image of a batch.

    Points with the same index correspond, because one network predicts all samples and a small
    change of its random input moves a point only a little. `batch` is that of `networks.predict`;
    `first` is the number of samples in earlier batches. Batches with the same `first` get the same
    random inputs. The encoder runs once per image.

    Raises:
      ConfigError: the network has no random input.
      ValueError: `num_draws` is not positive.
    """
    if not config.model.random_size:
        raise ConfigError(
            "model.random_size=0: this network gives one prediction per image; accepted: a network "
            "trained with a random input, such as configs/mo2_cd.py"
        )
    if num_draws < 1:
        raise ValueError(f"num_draws: got {num_draws}, expected 1 or more")

    @jax.jit
    def of_batch(params: Any, batch: Mapping[str, Any], seed: Array, first: Array) -> Any:
        r = sample_latents(config, first, len(batch["image"]), num_draws, seed)
        return networks.predict(config, model, params, batch, r)

    keys = [key for key in networks.input_keys(config) if key != "points"]

    def run(params: Any, batch: Mapping[str, Any], seed: Any, first: Any) -> Any:
        return of_batch(params, {k: batch[k] for k in keys}, np.int32(seed), np.int32(first))

    return run

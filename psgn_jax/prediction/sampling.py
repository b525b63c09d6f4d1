"""Several predictions for one image, by sampling the random input.

For a network trained with Min-of-N, the random input r is sampled as in training. For a variational
autoencoder, it is the latent variable z and is sampled from the prior. Both distributions are
N(0, I) (paper, section "Predicting Multiple Plausible Shapes").
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn

from psgn_jax.config import Config, ConfigError
from psgn_jax.losses.chamfer import chamfer_sq_mean
from psgn_jax.metrics import samples as sample_metrics
from psgn_jax.training import step as step_lib
from psgn_jax.training.state import random_key
from psgn_jax.types import Array, Float


class PredictedSamples(NamedTuple):
    """K predictions for each image of a batch; points with the same index correspond.

    Attributes:
      points: in the project's frame, unit = radius of the bounding hemisphere.
      spread: standard deviation over the K predictions of each point along x, y, z (unit).
      mutual: `chamfer_sq_mean` between all pairs of predictions of an image (unit^2).
    """

    points: Float[Array, "b k n 3"]
    spread: Float[Array, "b n 3"]
    mutual: Float[Array, "b k k"]


@functools.partial(jax.jit, static_argnums=(0, 2, 3))
def sample_latents(
    config: Config, first: Array | int, batch_size: int, num_draws: int, seed: Array | int
) -> Float[Array, "b k size"]:
    """Random inputs of the samples `first`, `first` + 1, ...

    Each random input depends only on the seed, the number of the sample and the number of the draw.
    It does not depend on the batch or on `num_draws`. The training step and the evaluation step do
    not use this function: they use `training.step.sample_step_latents`.
    """
    key = random_key(0, seed, train=False)

    def one(sample: Array, draw: Array) -> Array:
        own = jax.random.fold_in(jax.random.fold_in(key, sample), draw)
        return jax.random.normal(own, (config.model.random_size,))

    over_draws = jax.vmap(one, (None, 0))
    return jax.vmap(over_draws, (0, None))(first + jnp.arange(batch_size), jnp.arange(num_draws))


@functools.lru_cache(maxsize=8)
def compile_predict_samples(
    config: Config, model: nn.Module, num_draws: int
) -> Callable[[Any, step_lib.Batch, Any, Any], PredictedSamples]:
    """Compiled `(params, batch, seed, first) -> PredictedSamples`, see `predict_samples`.

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

    def of_batch(params: Any, batch: step_lib.Batch, seed: Array, first: Array) -> PredictedSamples:
        r = sample_latents(config, first, len(batch["image"]), num_draws, seed)
        points = step_lib.predict(config, model, params, batch, r)
        mutual = jax.lax.map(lambda d: sample_metrics.mutual_distances(d, chamfer_sq_mean), points)
        by_axis = jax.vmap(lambda d: sample_metrics.spread(d).by_axis)(points)
        return PredictedSamples(points, by_axis, mutual)

    compiled = jax.jit(of_batch)
    keys = [key for key in step_lib.input_keys(config) if key != "points"]

    def run(params: Any, batch: step_lib.Batch, seed: Any, first: Any) -> PredictedSamples:
        return compiled(params, {k: batch[k] for k in keys}, np.int32(seed), np.int32(first))

    return run


def predict_samples(
    config: Config,
    model: nn.Module,
    params: Any,
    batch: step_lib.Batch,
    num_draws: int,
    seed: int = 0,
    *,
    first: int = 0,
) -> PredictedSamples:
    """Several predictions for each image of a batch; the encoder runs once per image.

    Args:
      config: configuration of the run.
      model: the network, from `point_out_net.build`.
      params: parameters of the network.
      batch: image uint8 [B,H,W,3], mask bool [B,H,W]; depth and extrinsics if depth is an input.
      num_draws: K, the number of predictions per image.
      seed: seed of the random inputs.
      first: index of the batch's first sample, which is the number of samples in earlier batches.
        Batches with the same `first` get the same random inputs.

    Raises:
      ConfigError: the network has no random input.
      ValueError: `num_draws` is not positive.
    """
    return compile_predict_samples(config, model, num_draws)(params, batch, seed, first)

"""What `psgn predict` does to the clouds of a network: mean with the mirror image, fit to the mask.

The world mirrored at y = 0 has the mirrored image, so a network has two predictions of each image.
Their mean has a smaller error: on the authors' 64 validation samples, the CD squared of `small-3`
falls from .0078 to .0073 (journal, 2026-11-23). The order of the points differs, so we match the
two clouds by the auction of the EMD first. `prediction.silhouette` fits the result to the mask.
"""

import functools
from collections.abc import Callable, Mapping
from typing import Any

import jax.numpy as jnp

from psgn_jax.array_types import Array, Float
from psgn_jax.config.experiment import Config
from psgn_jax.losses.auction import assign
from psgn_jax.losses.mapping import map_pairs
from psgn_jax.models import networks
from psgn_jax.prediction import draws, sampling
from psgn_jax.prediction.silhouette import Fit, fit

# Less than the auction can prove in float32, so it goes on to its last epsilon. On docs/photos it
# finds the optimal bijection, in 5 % more time than with a tolerance of .001.
_TOLERANCE = 5e-5


def mean_of_matched(a: Float[Array, "n 3"], b: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """The mean of each point of a and the point of b that the EMD matches with it."""
    return (a + b[assign(a, b, tolerance=_TOLERANCE).index]) / 2


def refined(
    predict: Callable[[Mapping[str, Any]], Float[Array, "b k n 3"]],
    batch: Mapping[str, Any],
    clouds: Float[Array, "b k n 3"],
    *,
    placed: bool = False,
) -> Fit:
    """Clouds [b, k, n, 3] of the network, the first one averaged, all fitted, with their cameras.

    We average the first cloud of an image with the first cloud of the mirror image. The others are
    draws, each a shape that the network finds possible. Clouds of a network with depth are only
    fitted, because the camera of the depth image would have to be mirrored.

    Args:
      predict: maps a batch to clouds, of which the first one is used.
      batch: `image`, `mask`, `intrinsics` (for images of the size of the mask) and `extrinsics`,
        each with the leading axis b; `depth` if it is an input.
      clouds: `predict(batch)`, or the first k clouds of it.
      placed: whether the images were placed, see `silhouette.fit`.
    """
    if "depth" not in batch:
        mirrored = {**batch, "image": batch["image"][:, :, ::-1], "mask": batch["mask"][:, :, ::-1]}
        other = predict(mirrored)[:, 0] * jnp.array([[[1, -1, 1]]], clouds.dtype)
        clouds = clouds.at[:, 0].set(map_pairs(mean_of_matched)(clouds[:, 0], other))
    camera = batch["mask"], batch["intrinsics"], batch["extrinsics"]
    return map_pairs(functools.partial(fit, placed=placed))(clouds, *camera)


def first_clouds(
    config: Config, model: Any, params: Any, batch: Mapping[str, Any], *, placed: bool = False
) -> tuple[Float[Array, "b n 3"], Float[Array, "b n 3"]]:
    """The first cloud that a prediction shows of each image, by the network and refined."""
    r = None
    if config.model.random_size:
        r = sampling.image_latents(config, len(batch["image"]), draws.num_draws(1))

    def predict(batch: Mapping[str, Any]) -> Array:
        return draws.chosen_clouds(networks.predict(config, model, params, batch, r))

    clouds = predict(batch)[:, :1]
    return clouds[:, 0], refined(predict, batch, clouds, placed=placed).points[:, 0]

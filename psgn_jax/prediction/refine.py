"""What `psgn predict` does to the clouds of a network: mean with the mirror image, fit to the mask.

The world mirrored at y = 0 has the mirrored image, so a network has two predictions of each image.
Their mean has a smaller error: on the authors' 64 validation samples, the CD squared of `small-3`
falls from .0078 to .0073 (journal, 2026-11-23). The order of the points differs, so we match the
two clouds by the auction of the EMD first. `prediction.silhouette` fits the result to the mask.
"""

import functools
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from psgn_jax.array_types import Array, Float
from psgn_jax.config.experiment import Config
from psgn_jax.losses.auction import assign
from psgn_jax.losses.mapping import map_pairs
from psgn_jax.models import networks
from psgn_jax.prediction import draws
from psgn_jax.prediction.silhouette import Fit, fit

# Less than the auction can prove in float32, so it goes on to its last epsilon. On docs/photos it
# finds the optimal bijection, in 5 % more time than with a tolerance of .001.
_TOLERANCE = 5e-5


def mean_of_matched(a: Float[Array, "n 3"], b: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """The mean of each point of a and the point of b that the EMD matches with it."""
    return (a + b[assign(a, b, tolerance=_TOLERANCE).index]) / 2


def predicted(
    config: Config,
    model: Any,
    params: Any,
    batch: Mapping[str, Any],
    r: Any = None,
    *,
    samples: int = 1,
    first: draws.First = "zero",
    refine: bool = True,
    placed: bool = False,
) -> tuple[Fit, Float[Array, "b k n 3"]]:
    """The first `samples` clouds of each image, with their cameras; and all clouds of the network.

    With `refine`, the first cloud is averaged with that of the mirror image, and all are fitted.
    Further clouds are draws, each a shape that the network finds possible. Clouds of a network with
    depth are only fitted, because the camera of the depth image would have to be mirrored.

    Args:
      batch: `image`, `mask`, `intrinsics` (for images of the size of the mask) and `extrinsics`,
        each with the leading axis b; `depth` if it is an input.
      r: [b, k, size], `draws.image_latents` of a network with a random input.
      samples, first: see `prediction.draws`.
      placed: whether the images were placed, see `silhouette.fit`.
    """
    views, mirror = batch, refine and "depth" not in batch
    if mirror:
        two = {name: batch[name] for name in ("image", "mask")}
        views = {name: jnp.concatenate([x, x[:, :, ::-1]]) for name, x in two.items()}
        r = None if r is None else jnp.concatenate([r, r])
    points = networks.predict(config, model, params, views, r)
    points = points[:, None] if r is None else draws.with_first(points, first)
    of_images, of_mirrored = points[: len(batch["mask"])], points[len(batch["mask"]) :, 0]
    if samples > 1:
        order = jax.lax.map(functools.partial(draws.ranked, samples=samples), of_images)
        of_images = jnp.take_along_axis(of_images, order[..., None, None], axis=1)
    clouds = of_images[:, :samples]
    if not refine:
        return Fit(clouds, batch["extrinsics"]), of_images
    if mirror:
        other = of_mirrored * jnp.array([[[1, -1, 1]]], points.dtype)
        clouds = clouds.at[:, 0].set(map_pairs(mean_of_matched)(clouds[:, 0], other))
    camera = batch["mask"], batch["intrinsics"], batch["extrinsics"]
    return map_pairs(functools.partial(fit, placed=placed))(clouds, *camera), of_images


def first_clouds(
    config: Config, model: Any, params: Any, batch: Mapping[str, Any], *, placed: bool = False
) -> tuple[Float[Array, "b n 3"], Float[Array, "b n 3"]]:
    """The first cloud that a prediction shows of each image, by the network and refined."""
    size = config.model.random_size
    r = np.zeros((len(batch["mask"]), 1, size), np.float32) if size else None
    fitted, clouds = predicted(config, model, params, batch, r, placed=placed)
    return clouds[:, 0], fitted.points[:, 0]

"""The network that finds the mask of the object in a photo.

A decoder on the maps of EfficientNet-Lite0, as in feature pyramid networks (Lin et al. 2017): from
the coarsest map to the finest, each level adds a projection of its map to the enlarged result of
the level before. Widths and the channels of position are **ours**.
"""

import jax.numpy as jnp
from flax import linen as nn

from psgn_jax.array_types import Array, Float
from psgn_jax.models import efficientnet, layers

WIDTHS = {32: 96, 16: 96, 8: 64, 4: 32, 2: 16}
"""Number of channels by stride."""
CONVOLUTIONS = {32: 2, 16: 2, 8: 2, 4: 1, 2: 1}
"""Number of 3x3 convolutions by stride."""


def positions(height: int, width: int) -> Float[Array, "1 h w 3"]:
    """Row, column and squared distance from the middle of the cells; rows and columns in +-1."""
    rows, columns = jnp.meshgrid(
        (jnp.arange(height) + 0.5) * 2 / height - 1,
        (jnp.arange(width) + 0.5) * 2 / width - 1,
        indexing="ij",
    )
    return jnp.stack([rows, columns, rows**2 + columns**2], axis=-1)[None]


class MaskDecoder(nn.Module):
    """Logits of the object's mask from the maps of `efficientnet.EfficientNetLite0`."""

    @nn.compact
    def __call__(self, maps: list[Float[Array, "b _ _ _"]]) -> Float[Array, "b h2 w2"]:
        *finer, coarse = maps
        where = jnp.broadcast_to(positions(*coarse.shape[1:3]), (*coarse.shape[:3], 3))
        x = jnp.concatenate([coarse, where], axis=-1)
        for stride, width in WIDTHS.items():
            x = layers.Conv(width, 1, name=f"project{stride}")(x)
            if stride < 32:
                x = x.repeat(2, axis=1).repeat(2, axis=2)
                x = x + layers.Conv(width, 1, name=f"skip{stride}")(finer.pop())
            x = nn.relu(x)
            for i in range(CONVOLUTIONS[stride]):
                x = nn.relu(layers.Conv(width, name=f"conv{stride}_{i}")(x))
        return layers.Conv(1, name="logits")(x)[..., 0]


class MaskNet(nn.Module):
    """Probabilities of the object, at half the size of RGB images in [0, 1].

    Height and width of the images are multiples of 32.
    """

    @nn.compact
    def __call__(self, image: Float[Array, "b h w 3"]) -> Float[Array, "b h2 w2"]:
        maps = efficientnet.EfficientNetLite0(name=efficientnet.NAME)(image)
        return nn.sigmoid(MaskDecoder(name="decoder")(maps))

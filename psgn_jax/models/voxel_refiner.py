"""From a cloud to a volume: splat, then a small 3D network; and a network of the object's volume.

Source: paper, implementation details, "Post processing": the cloud is "registered into the
32x32x32 grid with bilinear interpolation", as if the points were 1x1x1 cubes (`splat`); "6 layers
of 3x3x3 convolutions" look at local neighbourhoods, "trained by IoU" (`VoxelRefiner` with
`losses.soft_iou_loss`); "another network to predict the object's volume", whose answer "is
concatenated with the registered occupancy" (`VolumeNet`); the best result of the paper feeds the
predictions of a network trained by CD and of one trained by EMD together: one channel for each.

**Ours**, where the paper is silent: the sum of the intersections is clipped to [0, 1]; widths of
the hidden layers, ReLU, a sigmoid at the end; the volume enters as its logarithm, the same number
in every cell.

Frame: the schema's grid, indexed [x, y, z], over [-1, 1] x [-1, 1] x [0, 2].
"""

from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
from flax import linen as nn

from psgn_jax.config import ModelConfig
from psgn_jax.data.schema import OCCUPANCY_SIZE
from psgn_jax.models import layers, point_layout, point_out_net
from psgn_jax.models.layers import Conv3D, Dense
from psgn_jax.types import Array, Bool, Float

GRID_ORIGIN = (-1.0, -1.0, 0.0)
GRID_EDGE = 2.0

# A first answer of about a tenth of the hemisphere's bounding box; any start would do.
_LOG_VOLUME = -1.0
# Few cells are occupied: a first answer of 5 % everywhere.
_FIRST_LOGIT = -3.0


def splat(
    points: Float[Array, "n 3"], size: int = OCCUPANCY_SIZE
) -> Float[Array, "size size size"]:
    """Volume of the intersection of each cell with the points' unit cubes, clipped to [0, 1].

    grid[c] = min(1, sum_i prod_axis max(0, 1 - |u_i - (c + 1/2)|)),   u = (p - origin) size / 2

    A point at the centre of a cell fills it; elsewhere its cube, as large as a cell, is shared out
    among up to eight. What lies outside the grid is lost. Differentiable in the points, with
    gradient 0 from cells that are full. A coordinate that is not finite makes everything NaN.

    Args:
      points: [n, 3] in the project's frame.
      size: cells along an edge of the grid (static).
    """
    points = jnp.asarray(points)
    u = (points - jnp.asarray(GRID_ORIGIN, points.dtype)[None]) * (size / GRID_EDGE) - 0.5
    low = jnp.floor(u)
    share = u - low
    first = jnp.clip(low, -2, size).astype(jnp.int32)
    grid = jnp.zeros((size,) * 3, points.dtype)
    for corner in range(8):
        step = [corner >> axis & 1 for axis in range(3)]
        cell = first + jnp.asarray(step)[None]
        weight = jnp.where(jnp.asarray(step)[None] == 1, share, 1 - share).prod(axis=1)
        # Negative indices would count from the end: everything outside goes beyond it.
        cell = jnp.where(cell < 0, size, cell)
        grid = grid.at[cell[:, 0], cell[:, 1], cell[:, 2]].add(weight, mode="drop")
    grid = jnp.minimum(grid, 1)
    return jnp.where(jnp.isfinite(points).all(), grid, jnp.nan)


def splat_clouds(clouds: Sequence[Float[Array, "_ 3"]]) -> Float[Array, "s s s c"]:
    """`splat` of each cloud, in channels: the input of `VoxelRefiner` for one sample."""
    return jnp.stack([splat(cloud) for cloud in clouds], axis=-1)


def log_volume(occupancy: Bool[Array, "s s s"]) -> Float[Array, ""]:
    """Natural logarithm of the occupied volume in unit^3; that of one cell where it is empty."""
    occupancy = jnp.asarray(occupancy)
    cell = (GRID_EDGE / occupancy.shape[0]) ** 3
    return jnp.log(jnp.maximum(occupancy.sum(), 1) * cell)


class VoxelRefiner(nn.Module):
    """Splats (and a volume) to the probability that each cell is occupied.

    Six 3x3x3 convolutions, ReLU between them, a sigmoid at the end: each answer sees 13 cells
    along each axis. Works at any grid size.

    Attributes:
      num_clouds: channels of the input; 1, or 2 for CD-trained and EMD-trained clouds.
      with_volume: whether it is given log-volumes too.
      widths: of the five hidden layers.
      dtype: of the arithmetic; the last layer computes in float32.
    """

    num_clouds: int = 1
    with_volume: bool = False
    widths: tuple[int, ...] = (16, 16, 16, 16, 16)
    dtype: Any = jnp.float32

    @nn.compact
    def __call__(
        self,
        splats: Float[Array, "b x y z c"],
        log_volumes: Float[Array, " b"] | None = None,
    ) -> Float[Array, "b x y z"]:
        """Probabilities in [0, 1].

        Args:
          splats: of `splat_clouds`.
          log_volumes: of the objects, predicted or true, if `with_volume`.

        Raises:
          ValueError: for other than `num_clouds` channels, or log-volumes missing or not wanted.
        """
        if splats.shape[-1] != self.num_clouds:
            raise ValueError(
                f"splats has {splats.shape[-1]} channels, expected num_clouds={self.num_clouds}"
            )
        if (log_volumes is not None) != self.with_volume:
            given = "None" if log_volumes is None else "an array"
            raise ValueError(f"log_volumes is {given}, but with_volume={self.with_volume}")
        x = splats
        if log_volumes is not None:
            channel = jnp.broadcast_to(
                log_volumes[:, None, None, None, None].astype(x.dtype), (*x.shape[:-1], 1)
            )
            x = jnp.concatenate([x, channel], axis=-1)
        for i, width in enumerate(self.widths):
            x = nn.relu(Conv3D(width, dtype=self.dtype, name=f"conv{i}")(x))
        last = Conv3D(
            1,
            kernel_init=layers.small(1.0),
            bias_init=nn.initializers.constant(_FIRST_LOGIT),
            name="occupancy",
        )
        return nn.sigmoid(last(x)[..., 0])


class VolumeNet(nn.Module):
    """Image to the logarithm of the object's volume in unit^3.

    The encoder of `PointOutNet`, a dense layer with ReLU, a number. Train it on the squared error
    to `log_volume` (**ours**).

    Attributes:
      widths: feature maps per level, see `point_out_net.Encoder`.
      hidden: width of the dense layer.
      dtype: of the arithmetic; the last layer computes in float32.
    """

    widths: tuple[int, ...]
    hidden: int = 512
    dtype: Any = jnp.float32

    @nn.compact
    def __call__(self, images: Float[Array, "b h w c"]) -> Float[Array, " b"]:
        """Log-volumes of a batch of images, of sides that are multiples of 2^(levels - 1)."""
        encoder = point_out_net.Encoder(self.widths, 1, self.dtype, name="encoder")
        _, x = encoder(images.astype(self.dtype), None)
        x = x.reshape(x.shape[0], -1)
        x = nn.relu(Dense(self.hidden, dtype=self.dtype, name="dense")(x))
        last = Dense(
            1,
            kernel_init=layers.small(0.3),
            bias_init=nn.initializers.constant(_LOG_VOLUME),
            name="log_volume",
        )
        return last(x)[:, 0]


def build_volume_net(config: ModelConfig) -> VolumeNet:
    """The volume network with the encoder widths of a configuration."""
    widths = point_layout.scaled_widths(config.widths, config.width_multiplier)
    hidden = point_layout.scaled_widths((512,), config.width_multiplier)[0]
    return VolumeNet(widths, hidden, layers.DTYPES[config.compute_dtype])

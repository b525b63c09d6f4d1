"""Turns clouds into occupancy grids with a small 3D network, and predicts the volume of an object.

Source: paper, implementation details, "Post processing":

- `splat`: the cloud is "registered into the 32x32x32 grid with bilinear interpolation", as if each
  point were a cube of the size of a cell.
- `VoxelRefiner`: "6 layers of 3x3x3 convolutions" over local neighbourhoods, "trained by IoU"
  (`losses.soft_iou_loss`). The best result of the paper uses two input channels: the cloud of a
  network trained by CD and the cloud of a network trained by EMD.
- `VolumeNet`: "another network to predict the object's volume", a further input of the refiner.

**Ours**, because the paper does not say: a splat is clipped to [0, 1]. The refiner has hidden
layers of 16 channels, ReLUs, a final sigmoid, and a constant channel for the volume's logarithm.

Frame: the grid of `data.schema`, indexed [x, y, z], over [-1, 1] x [-1, 1] x [0, 2].
"""

from typing import Any

import jax.numpy as jnp
from flax import linen as nn

from psgn_jax.array_types import Array, Bool, Float
from psgn_jax.data.schema import OCCUPANCY_SIZE
from psgn_jax.models import layers, point_out_net
from psgn_jax.models.layers import Conv3D, Dense

GRID = (OCCUPANCY_SIZE,) * 3
GRID_ORIGIN = (-1.0, -1.0, 0.0)
GRID_EDGE = 2.0

# Initial bias of `VolumeNet`: e^-1 = .37 unit^3, about a tenth of the hemisphere's bounding box.
_LOG_VOLUME = -1.0
# Initial bias of `VoxelRefiner`: a probability of 5 % everywhere, because few cells are occupied.
_FIRST_LOGIT = -3.0


def splat(
    points: Float[Array, "n 3"], size: int = OCCUPANCY_SIZE
) -> Float[Array, "size size size"]:
    """Volume of the intersection of each cell with cubes around the points, clipped to [0, 1].

    grid[c] = min(1, sum_i prod_axis max(0, 1 - |u_i - (c + 1/2)|)),   u = (p - origin) size / 2

    The points are in the project's frame. A cube is as large as a cell; its parts outside the grid
    are ignored. The gradient of clipped cells is 0. A non-finite coordinate makes the grid NaN.
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
        # Negative indices would count from the end; indices beyond the end are dropped.
        cell = jnp.where(cell < 0, size, cell)
        grid = grid.at[cell[:, 0], cell[:, 1], cell[:, 2]].add(weight, mode="drop")
    grid = jnp.minimum(grid, 1)
    return jnp.where(jnp.isfinite(points).all(), grid, jnp.nan)


def log_volume(occupancy: Bool[Array, "s s s"]) -> Float[Array, ""]:
    """Natural logarithm of the occupied volume in unit^3; an empty grid counts as one cell."""
    occupancy = jnp.asarray(occupancy)
    cell = (GRID_EDGE / occupancy.shape[0]) ** 3
    return jnp.log(jnp.maximum(occupancy.sum(), 1) * cell)


class VoxelRefiner(nn.Module):
    """Maps splats of clouds, one a channel, and optionally log-volumes to probabilities of cells.

    Six 3x3x3 convolutions with ReLUs between them, and a sigmoid in float32, for any grid size.
    """

    widths: tuple[int, ...] = (16, 16, 16, 16, 16)
    dtype: Any = jnp.float32

    @nn.compact
    def __call__(
        self, splats: Float[Array, "b x y z c"], log_volumes: Float[Array, " b"] | None = None
    ) -> Float[Array, "b x y z"]:
        x = splats
        if log_volumes is not None:
            channel = log_volumes[:, None, None, None, None].astype(x.dtype)
            x = jnp.concatenate([x, jnp.broadcast_to(channel, (*x.shape[:-1], 1))], axis=-1)
        for i, width in enumerate(self.widths):
            x = nn.relu(Conv3D(width, dtype=self.dtype, name=f"conv{i}")(x))
        bias = nn.initializers.constant(_FIRST_LOGIT)
        last = Conv3D(1, kernel_init=layers.small(1.0), bias_init=bias, name="occupancy")
        return nn.sigmoid(last(x)[..., 0])


class VolumeNet(nn.Module):
    """Maps images, whose sides are multiples of 2^(levels - 1), to the `log_volume` of the object.

    **Ours**: the encoder of `PointOutNet`, a dense layer with ReLU, a linear layer in float32.
    """

    widths: tuple[int, ...]
    hidden: int = 512
    dtype: Any = jnp.float32

    @nn.compact
    def __call__(self, images: Float[Array, "b h w c"]) -> Float[Array, " b"]:
        encoder = point_out_net.Encoder(self.widths, 1, self.dtype, name="encoder")
        _, x = encoder(images.astype(self.dtype), None)
        x = x.reshape(x.shape[0], -1)
        x = nn.relu(Dense(self.hidden, dtype=self.dtype, name="dense")(x))
        bias = nn.initializers.constant(_LOG_VOLUME)
        last = Dense(1, kernel_init=layers.small(0.3), bias_init=bias, name="log_volume")
        return last(x)[:, 0]

"""PointOutNet: predicts a point cloud from one image, in three versions.

Sources: the paper, section "Point Set Prediction Network" and figure "PointOutNet structure"; the
layers in the authors' published code (github.com/fanhqme/PointSetGeneration). Sizes below are those
of the default configuration: images of 192x256 pixels, and widths 16, 32, 64, 128, 256, 512, 512 at
levels 0 to 6. Level l has 1 / 2^l of the image size; the last level, 3x4, is the bottleneck. Layers
are 3x3 convolutions with ReLU unless stated otherwise.

- `vanilla`: `Encoder`, flatten, dense 2048 and 1024 (ReLU), then 3 numbers per point (linear).
- `two_branch`: the same for 256 points (fc branch), and in parallel a deconv branch: a `Merge` at
  each level from the bottleneck up to 24x32, another convolution, and a linear convolution to the
  coordinates of each cell's points.
- `hourglass`: encode, decode up to 96x128, encode again, decode to 24x32, then as `two_branch`. The
  fc branch reads both bottlenecks: the first through a dense layer of 2048 with ReLU and a linear
  layer of 2048 (`carry`), the second through another linear layer of 2048; then a ReLU of the sum.

Output of linear layers: first the fc points, then the deconv points row by row, cell by cell.

**Ours**, because the sources leave it open or disagree:

- Strided kernels are 3x3, except 5x5 into the bottleneck (`vanilla`, `two_branch`) or at the last
  three levels (`hourglass`). These are the published sizes; we count levels from the bottleneck, so
  that the rule also applies to fewer levels.
- The last transposed convolution is linear. In the authors' two-branch network a ReLU follows it,
  in their hourglass it does not.
- The authors never published `vanilla`. Ours is `two_branch` without the deconv branch, so it
  predicts only `fc_points` points.
- Between its two passes the hourglass goes up to level 1, or to level 0 if `deconv_level` is 0.
- The random input r: a dense layer without bias, one for each pass, maps r to the shape of the
  bottleneck and is added before its ReLU. With several r per image, the layers before r, and the
  skip convolutions that read them, are computed once per image.
- If a side of the image is not a multiple of 2^(levels - 1), we pad it to the next multiple with
  copies of border pixels, half on each side (an odd pixel at the bottom or right).
- The output layers compute in float32, because bfloat16 numbers near 1 have steps of .008.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
from flax import linen as nn

from psgn_jax.array_types import Array, Float
from psgn_jax.models import layers
from psgn_jax.models.layers import SUMMED, Conv, ConvTranspose, Dense


class OutputGrid(NamedTuple):
    """Size of the deconv branch's grid of points, (0, 0, 0) without this branch."""

    height: int
    width: int
    points_per_cell: int


class Branches(NamedTuple):
    """Indices of each branch's points."""

    fc: range
    deconv: range


def _add(x: Array, per_image: Array) -> Array:
    """`x + per_image`; x may have several consecutive rows for each row of `per_image`."""
    if x.shape == per_image.shape:
        return x + per_image
    # `shape[0]`, not `len`: the number of images may be symbolic (`psgn_jax.portable`).
    grouped = x.reshape(per_image.shape[0], -1, *per_image.shape[1:])
    return (grouped + per_image[:, None]).reshape(x.shape)


def _plus_random(x: Array, r: Array | None) -> Array:
    """Shifts each feature of x by a linear function of r that is initially zero."""
    if r is None:
        return x
    y = Dense(x.shape[-1], False, kernel_init=nn.initializers.zeros, name="random")(r)
    return x + y.reshape(y.shape[0], *(1,) * (x.ndim - 2), -1)


class Bottleneck(nn.Module):
    """ReLU(5x5 convolution of stride 2 + dense(r)); r has one row per image and sample."""

    width: int
    dtype: Any

    @nn.compact
    def __call__(self, x: Array, r: Array | None) -> Array:
        x = Conv(self.width, 5, stride=2, dtype=self.dtype, name="down")(x)
        if r is not None:
            dense = Dense(x[0].size, False, kernel_init=SUMMED, dtype=self.dtype, name="random")
            x = _add(dense(r).reshape(-1, *x.shape[1:]), x)
        return nn.relu(x)


class Encoder(nn.Module):
    """Two convolutions at full size; at each further level a strided convolution, then two more.

    The level above the bottleneck has three more. Returns the bottleneck and, before it, the
    features of the other levels, full size first.
    """

    widths: tuple[int, ...]  # feature maps per level, full size first
    num_wide: int  # number of last levels with a strided 5x5 kernel
    dtype: Any

    @nn.compact
    def __call__(self, x: Array, r: Array | None) -> tuple[list[Array], Array]:
        last, features = len(self.widths) - 1, []
        for level, width in enumerate(self.widths[:-1]):
            if level > 0:
                size = 5 if level > last - self.num_wide else 3
                down = Conv(width, size, stride=2, dtype=self.dtype, name=f"level{level}_down")
                x = nn.relu(down(x))
            for i in range(3 if level == last - 1 else 2):
                x = nn.relu(Conv(width, dtype=self.dtype, name=f"level{level}_conv{i}")(x))
            features.append(x)
        return features, Bottleneck(self.widths[-1], self.dtype, name="bottleneck")(x, r)


class Merge(nn.Module):
    """ReLU(resampled x + 3x3 convolution of the skip), then a convolution with ReLU.

    x is resampled to the size of `skip` by a linear 5x5 transposed convolution of stride 2 or, if
    `down_size` is not 0, by a linear strided convolution with this kernel size.
    """

    level_width: int  # feature maps of the encoder's level; a merge has half as many
    down_size: int
    dtype: Any

    @nn.compact
    def __call__(self, x: Array, skip: Array, r: Array | None = None) -> Array:
        width = max(1, self.level_width // 2)
        linear: Any = {"kernel_init": SUMMED, "dtype": self.dtype}
        if self.down_size:
            x = Conv(width, self.down_size, stride=2, name="down", **linear)(x)
        else:
            x = ConvTranspose(width, dtype=self.dtype, name="up")(x)
        x = nn.relu(_plus_random(_add(x, Conv(width, name="skip", **linear)(skip)), r))
        return nn.relu(Conv(width, dtype=self.dtype, name="conv")(x))


class Decoder(nn.Module):
    """Upsamples from the bottleneck; returns `features` with new levels >= `top`."""

    widths: tuple[int, ...]
    top: int
    dtype: Any

    @nn.compact
    def __call__(self, x: Array, features: list[Array], r: Array | None = None) -> list[Array]:
        features = list(features)
        for level in reversed(range(self.top, len(features))):
            merge = Merge(self.widths[level], 0, self.dtype, name=f"level{level}")
            x = features[level] = merge(x, features[level], r)
        return features


class Reencoder(nn.Module):
    """The second downsampling pass of the hourglass, from level `top` to the bottleneck.

    Returns `features` with new levels > `top`, and the bottleneck.
    """

    widths: tuple[int, ...]
    top: int
    num_wide: int
    dtype: Any

    @nn.compact
    def __call__(self, features: list[Array], r: Array | None) -> tuple[list[Array], Array]:
        features, last = list(features), len(self.widths) - 1
        x = features[self.top]
        for level in range(self.top + 1, last):
            size = 5 if level > last - self.num_wide else 3
            merge = Merge(self.widths[level], size, self.dtype, name=f"level{level}")
            x = features[level] = merge(x, features[level])
        return features, Bottleneck(self.widths[-1], self.dtype, name="bottleneck")(x, r)


class FullyConnected(nn.Module):
    """The fc branch: from the bottlenecks of one or two passes to points [b, num_points, 3]."""

    num_points: int
    widths: tuple[int, ...]
    dtype: Any

    @nn.compact
    def __call__(self, bottlenecks: list[Array], r: Array | None = None) -> Array:
        *first, last = [x.reshape(x.shape[0], -1) for x in bottlenecks]
        hidden, dtype = self.widths[0], self.dtype
        init = SUMMED if first else layers.RELU
        x = Dense(hidden, kernel_init=init, dtype=dtype, name="hidden0")(last)
        for flat in first:
            y = nn.relu(Dense(hidden, dtype=dtype, name="first_pass")(flat))
            x = x + Dense(hidden, kernel_init=SUMMED, dtype=dtype, name="carry")(y)
        x = nn.relu(_plus_random(x, r))
        for i, width in enumerate(self.widths[1:], start=1):
            x = nn.relu(Dense(width, dtype=dtype, name=f"hidden{i}")(x))
        bias, kernel = layers.cloud_bias(layers.CLOUD_SPREAD), layers.small(0.1)
        x = Dense(3 * self.num_points, kernel_init=kernel, bias_init=bias, name="points")(x)
        return x.reshape(x.shape[0], self.num_points, 3)


class CloudNetwork(nn.Module):
    """A network that predicts clouds; it is called like `PointOutNet`."""

    @property
    def num_points(self) -> int:
        """Number of points of one prediction."""
        raise NotImplementedError

    @property
    def branches(self) -> Branches:
        """The points of each branch; by default all are fc points."""
        return Branches(range(self.num_points), range(self.num_points, self.num_points))


class PointOutNet(CloudNetwork):
    """Maps one image, and optionally a random vector r, to a point cloud."""

    version: str  # "vanilla", "two_branch" or "hourglass"
    image_size: tuple[int, int]  # (height, width) in pixels, before padding
    in_channels: int  # of the images
    widths: tuple[int, ...]  # feature maps per level, full size first
    fc_points: int  # points of the fc branch
    fc_widths: tuple[int, ...]  # its hidden widths
    deconv_level: int  # last level of the deconv branch
    deconv_channels: int  # its output channels, 3 per point of a cell
    random_size: int = 0  # components of r; 0 = no random input
    random_at: str = "bottleneck"  # or "all": also before the ReLUs of the two branches
    dtype: Any = jnp.float32  # of hidden layers; parameters and points are float32

    @property
    def padded_size(self) -> tuple[int, int]:
        """(height, width) of the images after padding."""
        unit = 2 ** (len(self.widths) - 1)
        return -(-self.image_size[0] // unit) * unit, -(-self.image_size[1] // unit) * unit

    @property
    def grid(self) -> OutputGrid:
        """The grid of the deconv branch, by default 24 rows, 32 columns, 1 point per cell."""
        if self.version == "vanilla":
            return OutputGrid(0, 0, 0)
        height, width = (side >> self.deconv_level for side in self.padded_size)
        return OutputGrid(height, width, self.deconv_channels // 3)

    @property
    def branches(self) -> Branches:
        """The points of each branch, by default fc 0 to 255, deconv 256 to 1,023."""
        height, width, points = self.grid
        first = self.fc_points
        return Branches(range(first), range(first, first + height * width * points))

    @property
    def num_points(self) -> int:
        """Number of points of one prediction, 1,024 by default."""
        return self.branches.deconv.stop

    @nn.compact
    def __call__(
        self, x: Float[Array, "b h w c"], r: Float[Array, "b *draws k"] | None = None
    ) -> Float[Array, "b *draws n 3"]:
        """Points float32 in the project's frame, unit = radius of the bounding hemisphere.

        Args:
          x: images from `networks.stack_channels`.
          r: standard normal numbers [b, random_size], or [b, draws, random_size] for several clouds
            per image; None if and only if `random_size` is 0.

        Raises:
          ValueError: the shape of an argument does not match the network.
        """
        expected, components = (*self.image_size, self.in_channels), 0 if r is None else r.shape[-1]
        if x.shape[1:] != expected:
            raise ValueError(f"x has the shape {x.shape}: accepted: (batch, *{expected})")
        if components != self.random_size or (r is not None and r.shape[0] != x.shape[0]):
            accepted = (x.shape[0], "draws", self.random_size) if self.random_size else None
            given = "None" if r is None else f"of the shape {r.shape}"
            raise ValueError(f"r is {given}: accepted: {accepted}")
        batch_shape = x.shape[:1] if r is None else r.shape[:-1]
        r = None if r is None else r.reshape(-1, self.random_size)
        extra = [new - old for new, old in zip(self.padded_size, self.image_size, strict=True)]
        if any(extra):
            x = jnp.pad(x, [(0, 0), *((e // 2, e - e // 2) for e in extra), (0, 0)], mode="edge")
        widths, dtype = self.widths, self.dtype
        num_wide = 3 if self.version == "hourglass" else 1
        features, x = Encoder(widths, num_wide, dtype, name="encoder")(x, r)
        bottlenecks, later = [x], r if self.random_at == "all" else None
        if self.version == "hourglass":
            top = min(1, self.deconv_level)
            features = Decoder(widths, top, dtype, name="first_decoder")(x, features)
            features, x = Reencoder(widths, top, num_wide, dtype, name="reencoder")(features, r)
            bottlenecks.append(x)
        clouds = []
        if self.fc_points:
            fc = FullyConnected(self.fc_points, self.fc_widths, dtype, name="fc")
            clouds.append(fc(bottlenecks, later))
        if self.version != "vanilla":
            decoder = Decoder(widths, self.deconv_level, dtype, name="decoder")
            x = decoder(x, features, later)[self.deconv_level]
            x = nn.relu(Conv(x.shape[-1], dtype=dtype, name="deconv_conv")(x))
            init, bias = layers.small(layers.CLOUD_SPREAD), layers.cloud_bias(0.0)
            out = Conv(self.deconv_channels, kernel_init=init, bias_init=bias, name="deconv_points")
            points = out(x) + layers.grid_offset(*self.grid)[None]
            clouds.append(points.reshape(points.shape[0], -1, 3))
        cloud = jnp.concatenate(clouds, axis=1)
        return cloud.reshape(*batch_shape, *cloud.shape[1:])

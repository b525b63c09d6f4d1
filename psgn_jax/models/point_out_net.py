"""PointOutNet: from one image to a cloud of points, in three versions.

Source: paper, section 3.2 and its figure "PointOutNet structure"; the layer list
of the authors' published code (github.com/fanhqme/PointSetGeneration). Sizes below are those of the
default configuration: 192x256 pixels, widths 16, 32, 64, 128, 256, 512, 512 at levels 0 to 6 (level
l has 1 / 2^l of the image's size; the last level, 3x4, is the bottleneck). Layers are 3x3
convolutions with ReLU unless said otherwise.

- `Encoder`: two convolutions at full size; then per level a strided one, followed by two (three
  at the last level before the bottleneck, none at the bottleneck).
- `vanilla`: encoder; flatten, dense 2048, 1024 (ReLU), then 3 numbers for each point (linear).
- `two_branch`: the same for 256 points, beside a deconv branch: per level, from the bottleneck up
  to 24x32, a `Merge`; then one more convolution and a linear one to the coordinates of each cell.
- `hourglass`: encode, decode up to 96x128, encode again, decode to 24x32, then as `two_branch`.
  The dense 2048 of the first bottleneck goes through a linear 2048 and is added to a linear 2048
  of the second bottleneck before the ReLU.
- `Merge`: ReLU(resampled + skip), then a convolution. Resampled is a linear 5x5 transposed
  convolution of stride 2 (up) or a linear strided one (down); skip is a linear 3x3 convolution of
  the newest features stored at that level. The width is half the encoder's at that level.

Output: the fc points first, then the deconv points, row by row; the points of one cell together.
Both are linear, so that coordinates can be negative.

Choices that are **ours**, because the sources leave them open or disagree:

- Strided kernels: 3x3, but 5x5 into the bottleneck (`vanilla`, `two_branch`) or at the last three
  levels (`hourglass`); this is what the authors published for each, given for fewer levels too.
- Their published two-branch network has a ReLU after the last transposed convolution too; their
  hourglass has none. Here it is linear everywhere.
- `vanilla` was never published; it is the two-branch network without its deconv branch, and all of
  its points are `fc_points` (set it to 1024 for as many as the others predict).
- With fewer levels the rules above apply counted from the bottleneck. The hourglass goes up to
  level 1 between its passes, or to level 0 if `deconv_level` is 0.
- The random input r: a dense layer without bias maps it to the bottleneck's shape, and the result
  is added before the bottleneck's ReLU, in each pass with a layer of its own; or, with `random_at`
  "fc", to the first hidden layer of the fc branch, before its ReLU: then the points of the deconv
  branch are those of the image alone, and all but the fc branch is shared. With several draws of
  r for each image, what comes before (in `vanilla` and `two_branch` the whole encoder, in
  `hourglass` that of the first pass) and the skip convolutions that read it are computed once; the
  rest sees a batch of b * draws, the draws of one image together.
- `width_multiplier` scales all hidden widths, convolutions and dense, rounded to multiples of 8,
  at least 8.
- Padding: an image whose sides are no multiples of 2^(levels - 1) is enlarged to the next ones
  by repeating its border pixels, half on each side (the odd pixel at the bottom and right). Where
  the object does not touch the border, this is background in every channel.
- Initial values, and a constant that spreads the deconv points over the image: see `blocks`.
- The output layers compute in float32 whatever `compute_dtype` is: a bfloat16 coordinate near 1 has
  steps of .008.

Parameters, for rules that depend on the type of a layer (such as the authors' L2 terms): kernels of
convolutions have four axes, those of dense layers two; the hourglass's linear layer after the
first pass, to which the authors give a weight of its own, is `params["fc"]["carry"]`.
"""

from typing import Any

import jax.numpy as jnp
from flax import linen as nn

from psgn_jax.config import ModelConfig
from psgn_jax.models import layers
from psgn_jax.models.layers import DTYPES, Conv, ConvTranspose, Dense
from psgn_jax.models.point_layout import (
    RANDOM_AT,
    num_points,
    padded_size,
    scaled_widths,
    wrong_field,
)
from psgn_jax.types import Array, Float


class Encoder(nn.Module):
    """Image to the features of each level and the bottleneck.

    Attributes:
      widths: feature maps per level; the last is the bottleneck's.
      num_wide: at how many levels, counted from the bottleneck, the strided kernel is 5x5.
      dtype: of the arithmetic.
    """

    widths: tuple[int, ...]
    num_wide: int
    dtype: Any

    @nn.compact
    def __call__(self, x: Array, r: Array | None) -> tuple[list[Array], Array]:
        """Returns the features of all levels but the last, full size first, and the bottleneck."""
        last = len(self.widths) - 1
        features = []
        for level, width in enumerate(self.widths[:-1]):
            if level > 0:
                size = 5 if level > last - self.num_wide else 3
                down = Conv(width, size, stride=2, dtype=self.dtype, name=f"level{level}_down")
                x = nn.relu(down(x))
            for i in range(3 if level == last - 1 else 2):
                x = nn.relu(Conv(width, dtype=self.dtype, name=f"level{level}_conv{i}")(x))
            features.append(x)
        return features, Bottleneck(self.widths[-1], self.dtype, name="bottleneck")(x, r)


class Bottleneck(nn.Module):
    """ReLU(5x5 convolution of stride 2 + dense(r))."""

    width: int
    dtype: Any

    @nn.compact
    def __call__(self, x: Array, r: Array | None) -> Array:
        """Halves the size; `r` is one vector for each sample, or for each draw of each, or None."""
        x = Conv(self.width, 5, stride=2, dtype=self.dtype, name="down")(x)
        if r is not None:
            dense = Dense(
                x[0].size,
                use_bias=False,
                kernel_init=layers.SUMMED,
                dtype=self.dtype,
                name="random",
            )
            x = _add(dense(r).reshape(-1, *x.shape[1:]), x)
        return nn.relu(x)


class Merge(nn.Module):
    """ReLU(resample(x) + conv(skip)), then a convolution with ReLU.

    Attributes:
      width: feature maps of the output.
      down_size: kernel of the strided convolution down to the size of `skip`; 0 = go up instead, by
        a 5x5 transposed convolution.
      dtype: of the arithmetic.
    """

    width: int
    down_size: int
    dtype: Any

    @nn.compact
    def __call__(self, x: Array, skip: Array) -> Array:
        """Returns features of the size of `skip`, which may be shared by several draws of x."""
        init, dtype = layers.SUMMED, self.dtype
        if self.down_size:
            x = Conv(
                self.width, self.down_size, stride=2, kernel_init=init, dtype=dtype, name="down"
            )(x)
        else:
            x = ConvTranspose(self.width, kernel_init=init, dtype=dtype, name="up")(x)
        x = nn.relu(_add(x, Conv(self.width, kernel_init=init, dtype=dtype, name="skip")(skip)))
        return nn.relu(Conv(self.width, dtype=dtype, name="conv")(x))


class Decoder(nn.Module):
    """From the bottleneck up to a level.

    Attributes:
      widths: the encoder's, per level; a decoder has half of each.
      top: level at which to stop.
      dtype: of the arithmetic.
    """

    widths: tuple[int, ...]
    top: int
    dtype: Any

    @nn.compact
    def __call__(self, x: Array, features: list[Array]) -> list[Array]:
        """Returns `features` with the levels from `top` on replaced by the decoded ones."""
        features = list(features)
        for level in reversed(range(self.top, len(features))):
            width = max(1, self.widths[level] // 2)
            x = Merge(width, 0, self.dtype, name=f"level{level}")(x, features[level])
            features[level] = x
        return features


class Reencoder(nn.Module):
    """The hourglass's second way down, from a level to the bottleneck.

    Attributes:
      widths: the encoder's, per level; half of each here, but for the bottleneck.
      top: level to start from.
      num_wide: as in `Encoder`.
      dtype: of the arithmetic.
    """

    widths: tuple[int, ...]
    top: int
    num_wide: int
    dtype: Any

    @nn.compact
    def __call__(self, features: list[Array], r: Array | None) -> tuple[list[Array], Array]:
        """Returns `features` with the levels below `top` replaced, and the bottleneck."""
        features, last = list(features), len(self.widths) - 1
        x = features[self.top]
        for level in range(self.top + 1, last):
            size = 5 if level > last - self.num_wide else 3
            width = max(1, self.widths[level] // 2)
            x = Merge(width, size, self.dtype, name=f"level{level}")(x, features[level])
            features[level] = x
        return features, Bottleneck(self.widths[-1], self.dtype, name="bottleneck")(x, r)


class FullyConnected(nn.Module):
    """The fc branch: bottleneck features to points.

    Attributes:
      num_points: how many.
      widths: hidden widths; the first layer takes the bottleneck of each pass.
      dtype: of the arithmetic in the hidden layers.
    """

    num_points: int
    widths: tuple[int, ...]
    dtype: Any

    @nn.compact
    def __call__(self, bottlenecks: list[Array], r: Array | None) -> Array:
        """Maps the bottleneck of the only pass, or of both, to points [b, num_points, 3].

        `r` is None unless it enters here; else b is that of its draws.
        """
        *first, last = [x.reshape(x.shape[0], -1) for x in bottlenecks]
        hidden, dtype = self.widths[0], self.dtype
        init = layers.SUMMED if first else layers.RELU
        x = Dense(hidden, kernel_init=init, dtype=dtype, name="hidden0")(last)
        for flat in first:
            y = nn.relu(Dense(hidden, dtype=dtype, name="first_pass")(flat))
            x = x + Dense(hidden, kernel_init=layers.SUMMED, dtype=dtype, name="carry")(y)
        if r is not None:
            dense = Dense(
                hidden, use_bias=False, kernel_init=layers.SUMMED, dtype=dtype, name="random"
            )
            x = _add(dense(r), x)
        x = nn.relu(x)
        for i, width in enumerate(self.widths[1:], start=1):
            x = nn.relu(Dense(width, dtype=dtype, name=f"hidden{i}")(x))
        points = Dense(
            3 * self.num_points,
            kernel_init=layers.small(0.1),
            bias_init=layers.cloud_bias(layers.CLOUD_SPREAD),
            name="points",
        )(x)
        return points.reshape(points.shape[0], self.num_points, 3)


class PointOutNet(nn.Module):
    """One image, and a random vector if the network has that input, to a cloud (see the module).

    Usually made by `build`, which checks the fields.

    Attributes:
      version: "vanilla", "two_branch" or "hourglass".
      image_size: (height, width) of the images in pixels, before padding.
      in_channels: channels of the images.
      widths: feature maps per level, full size first.
      fc_points, fc_widths: points and hidden widths of the fc branch.
      deconv_level, deconv_channels: where the deconv branch ends; 3 channels per point of a cell.
      random_size: components of r; 0 = none.
      random_at: where r enters, "bottleneck" or "fc".
      dtype: of the arithmetic in the hidden layers; parameters and points are float32.
    """

    version: str
    image_size: tuple[int, int]
    in_channels: int
    widths: tuple[int, ...]
    fc_points: int
    fc_widths: tuple[int, ...]
    deconv_level: int
    deconv_channels: int
    random_size: int = 0
    random_at: str = "bottleneck"
    dtype: Any = jnp.float32

    @nn.compact
    def __call__(
        self, x: Float[Array, "b h w c"], r: Float[Array, "b *draws k"] | None = None
    ) -> Float[Array, "b *draws n 3"]:
        """Predicts the clouds of a batch.

        Args:
          x: from `inputs.stack_channels`.
          r: standard normal numbers, [b, random_size], or [b, draws, random_size] for several
            clouds of each image, at the cost of one encoder; None exactly if `random_size` is 0.

        Returns:
          Points in the project's frame, unit = radius of the bounding hemisphere; float32;
          [b, n, 3], or [b, draws, n, 3].

        Raises:
          ValueError: for an argument whose shape the network was not built for.
        """
        self._check_shapes(x, r)
        batch_shape = x.shape[:1] if r is None else r.shape[:-1]
        r = None if r is None else r.reshape(-1, self.random_size)
        x = _pad(x, padded_size(self.image_size, len(self.widths)))
        widths, dtype = self.widths, self.dtype
        num_wide = 3 if self.version == "hourglass" else 1
        early, late = (r, None) if self.random_at == "bottleneck" else (None, r)
        features, x = Encoder(widths, num_wide, dtype, name="encoder")(x, early)
        bottlenecks = [x]
        if self.version == "hourglass":
            top = min(1, self.deconv_level)
            features = Decoder(widths, top, dtype, name="first_decoder")(x, features)
            features, x = Reencoder(widths, top, num_wide, dtype, name="reencoder")(features, early)
            bottlenecks.append(x)
        clouds = []
        if self.fc_points:
            fc = FullyConnected(self.fc_points, self.fc_widths, dtype, name="fc")
            clouds.append(fc(bottlenecks, late))
        if self.version != "vanilla":
            features = Decoder(widths, self.deconv_level, dtype, name="decoder")(x, features)
            x = features[self.deconv_level]
            x = nn.relu(Conv(x.shape[-1], dtype=dtype, name="deconv_conv")(x))
            points = Conv(
                self.deconv_channels,
                kernel_init=layers.small(layers.CLOUD_SPREAD),
                bias_init=layers.cloud_bias(0.0),
                name="deconv_points",
            )(x)
            height, width, channels = points.shape[1:]
            points = points + layers.grid_offset(height, width, channels // 3)[None]
            points = points.reshape(points.shape[0], -1, 3)
            if late is not None:  # the same points in every draw
                points = jnp.repeat(points, len(late) // len(points), axis=0)
            clouds.append(points)
        cloud = jnp.concatenate(clouds, axis=1)
        return cloud.reshape(*batch_shape, *cloud.shape[1:])

    def _check_shapes(self, x: Array, r: Array | None) -> None:
        expected = (*self.image_size, self.in_channels)
        if x.ndim != 4 or x.shape[1:] != expected:
            raise ValueError(f"x has the shape {x.shape}: accepted: (batch, *{expected})")
        if r is None and self.random_size:
            raise ValueError(
                f"r=None: accepted: an array of the shape {(x.shape[0], self.random_size)}, "
                "since the network has a random input"
            )
        if r is not None and not self.random_size:
            raise ValueError(f"r has the shape {r.shape}: accepted: None, since random_size is 0")
        if r is not None and (
            r.ndim not in (2, 3) or (r.shape[0], r.shape[-1]) != (x.shape[0], self.random_size)
        ):
            raise ValueError(
                f"r has the shape {r.shape}: accepted: {(x.shape[0], self.random_size)}, or "
                f"({x.shape[0]}, draws, {self.random_size})"
            )


def build(config: ModelConfig) -> PointOutNet:
    """The network of a configuration; nothing is computed yet.

    Raises:
      ValueError: for a field out of range or an image size that does not fit, see `padded_size`.
    """
    num_points(config)
    if config.compute_dtype not in DTYPES:
        raise wrong_field("compute_dtype", config.compute_dtype, f"one of {tuple(DTYPES)}")
    if config.in_channels < 1:
        raise wrong_field("in_channels", config.in_channels, "at least 1; 3 to 5 with `inputs`")
    if config.fc_points and not config.fc_widths:
        raise wrong_field("fc_widths", config.fc_widths, "at least one width")
    if config.random_size < 0:
        raise wrong_field("random_size", config.random_size, "0 (none) or more")
    if config.random_at not in RANDOM_AT:
        raise wrong_field("random_at", config.random_at, f"one of {RANDOM_AT}")
    if config.random_size and config.random_at == "fc" and not config.fc_points:
        raise wrong_field("random_at", "fc", "'bottleneck', as fc_points=0 leaves no fc branch")
    return PointOutNet(
        version=config.name,
        image_size=config.image_size,
        in_channels=config.in_channels,
        widths=scaled_widths(config.widths, config.width_multiplier),
        fc_points=config.fc_points,
        fc_widths=scaled_widths(config.fc_widths, config.width_multiplier),
        deconv_level=config.deconv_level,
        deconv_channels=config.deconv_channels,
        random_size=config.random_size,
        random_at=config.random_at,
        dtype=DTYPES[config.compute_dtype],
    )


def _pad(x: Array, size: tuple[int, int]) -> Array:
    """Repeats the border pixels until the image has the size, the odd pixel bottom and right."""
    extra = [target - side for target, side in zip(size, x.shape[1:3], strict=True)]
    if not any(extra):
        return x
    amounts = [(e // 2, e - e // 2) for e in extra]
    return jnp.pad(x, [(0, 0), *amounts, (0, 0)], mode="edge")


def _add(x: Array, shared: Array) -> Array:
    """Sum; x may hold several draws of each sample of `shared`, one after another."""
    grouped = x.reshape(len(shared), -1, *shared.shape[1:])
    return (grouped + shared[:, None]).reshape(x.shape)

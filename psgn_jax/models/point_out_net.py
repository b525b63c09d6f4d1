"""PointOutNet: predicts a point cloud from one image, in three versions.

Sources: the paper, section "Point Set Prediction Network" and figure "PointOutNet structure"; the
layers in the authors' published code (github.com/fanhqme/PointSetGeneration). The sizes below are
those of the default configuration: images of 192x256 pixels and widths 16, 32, 64, 128, 256, 512,
512 at levels 0 to 6. Level l has 1 / 2^l of the image size; the last level, 3x4, is the bottleneck.
Layers are 3x3 convolutions with ReLU unless stated otherwise.

- `Encoder`: two convolutions at full size; then at each level a strided convolution, followed by
  two convolutions of stride 1 (three at the last level before the bottleneck, none at the
  bottleneck).
- `vanilla`: encoder, flatten, dense 2048 and 1024 (ReLU), then 3 numbers per point (linear).
- `two_branch`: the same for 256 points (fc branch), and in parallel a deconv branch: a `Merge` at
  each level from the bottleneck up to 24x32, one more convolution, and a linear convolution to the
  coordinates of the points of each cell.
- `hourglass`: encode, decode up to 96x128, encode again, decode to 24x32, then as `two_branch`. The
  fc branch reads both bottlenecks. The first one goes through a dense layer of 2048 with ReLU and a
  linear layer of 2048 (`carry`), the second one through another linear layer of 2048. The two
  results are added; a ReLU follows.
- `Merge`: ReLU(resampled + skip), then a convolution. "Resampled" is a linear 5x5 transposed
  convolution of stride 2 (up) or a linear strided convolution (down). "Skip" is a linear 3x3
  convolution of the latest features of that level. The width is half of the encoder's width at
  that level.

Output: first the fc points, then the deconv points row by row, with the points of one cell next to
each other. Both output layers are linear, so that coordinates can be negative.

Choices of this implementation (marked **ours** elsewhere), because the sources leave them open or
disagree:

- Strided kernels are 3x3, except 5x5 into the bottleneck (`vanilla`, `two_branch`) or at the last
  three levels (`hourglass`). The authors published these sizes; we count the levels from the
  bottleneck, so that the rule also applies to fewer levels.
- In the authors' two-branch network a ReLU follows the last transposed convolution, in their
  hourglass it does not. Here that layer is linear in both networks.
- The authors never published `vanilla`. Here it is the two-branch network without the deconv
  branch, so it predicts only `fc_points` points; set this field to 1024 to get as many points as
  from the other versions.
- Between its two passes the hourglass goes up to level 1, or to level 0 if `deconv_level` is 0.
- The random input r: with `random_at` "bottleneck", a dense layer without bias maps r to the shape
  of the bottleneck, and the result is added before the ReLU of the bottleneck; each pass has its
  own dense layer. With `random_at` "fc", r is added to the first hidden layer of the fc branch,
  before its ReLU; the points of the deconv branch then depend only on the image.
- Several samples of r per image: the layers before r, and the skip convolutions that read them, are
  computed once per image. The layers before r are the encoder up to the bottleneck (`vanilla`,
  `two_branch`), the encoder of the first pass (`hourglass`), or everything but the fc branch
  (`random_at` "fc"). The other layers have a batch of b * draws, in which the samples of one image
  are next to each other.
- `width_multiplier` scales all hidden widths, of convolutions and of dense layers. Scaled widths
  are rounded to multiples of 8 and are at least 8.
- Padding: if a side of the image is not a multiple of 2^(levels - 1), it is padded to the next one
  by repeating border pixels, half on each side (an odd pixel at the bottom or right). If the object
  does not touch the border, the padding is background in every channel.
- Initial values, and a constant that spreads the deconv points over the image, are described in
  `layers`.
- The output layers compute in float32 for every `compute_dtype`, because bfloat16 numbers near 1
  have steps of .008.

Parameters, for rules that depend on the type of a layer (such as the authors' L2 terms): kernels of
convolutions have four axes, kernels of dense layers two. The linear layer after the first pass of
the hourglass, for which the authors use a separate L2 weight, is `params["fc"]["carry"]`.
"""

from typing import Any

import jax.numpy as jnp
from flax import linen as nn

from psgn_jax.config import ModelConfig, has_deconv_branch
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
    """Maps an image to the features of each level and the bottleneck.

    Attributes:
      widths: feature maps per level; the last entry is the bottleneck.
      num_wide: number of levels, counted from the bottleneck, with a strided 5x5 kernel.
      dtype: dtype of the arithmetic.
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
        """Halves the size; `r` is None or has one row per image and sample, [b * draws, k]."""
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
      down_size: kernel size of the strided convolution down to the size of `skip`; 0 = upsample by
        a 5x5 transposed convolution instead.
      dtype: dtype of the arithmetic.
    """

    width: int
    down_size: int
    dtype: Any

    @nn.compact
    def __call__(self, x: Array, skip: Array) -> Array:
        """Returns features of the size of `skip`; x may have several samples for each image."""
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
    """Upsamples from the bottleneck to the level `top`.

    Attributes:
      widths: widths of the encoder per level; the decoder has half of each.
      top: level at which to stop.
      dtype: dtype of the arithmetic.
    """

    widths: tuple[int, ...]
    top: int
    dtype: Any

    @nn.compact
    def __call__(self, x: Array, features: list[Array]) -> list[Array]:
        """Returns `features` with the levels >= `top` replaced by decoded features."""
        features = list(features)
        for level in reversed(range(self.top, len(features))):
            width = max(1, self.widths[level] // 2)
            x = Merge(width, 0, self.dtype, name=f"level{level}")(x, features[level])
            features[level] = x
        return features


class Reencoder(nn.Module):
    """The second downsampling pass of the hourglass, from the level `top` to the bottleneck.

    Attributes:
      widths: widths of the encoder per level; this pass has half of each, except the bottleneck.
      top: level to start from.
      num_wide: number of levels, counted from the bottleneck, with a strided 5x5 kernel.
      dtype: dtype of the arithmetic.
    """

    widths: tuple[int, ...]
    top: int
    num_wide: int
    dtype: Any

    @nn.compact
    def __call__(self, features: list[Array], r: Array | None) -> tuple[list[Array], Array]:
        """Returns `features` with the levels > `top` replaced, and the bottleneck."""
        features, last = list(features), len(self.widths) - 1
        x = features[self.top]
        for level in range(self.top + 1, last):
            size = 5 if level > last - self.num_wide else 3
            width = max(1, self.widths[level] // 2)
            x = Merge(width, size, self.dtype, name=f"level{level}")(x, features[level])
            features[level] = x
        return features, Bottleneck(self.widths[-1], self.dtype, name="bottleneck")(x, r)


class FullyConnected(nn.Module):
    """The fc branch: maps bottleneck features to points.

    Attributes:
      num_points: number of points.
      widths: hidden widths; the first layer reads the bottleneck of each pass.
      dtype: dtype of the arithmetic in the hidden layers.
    """

    num_points: int
    widths: tuple[int, ...]
    dtype: Any

    @nn.compact
    def __call__(self, bottlenecks: list[Array], r: Array | None) -> Array:
        """Maps the bottlenecks of one or two passes to points [b, num_points, 3].

        `r` is None unless `random_at` is "fc". With r, b is the number of rows of r.
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
    """Maps one image, and optionally a random vector r, to a point cloud.

    The architecture is described in the module's docstring. To create a network, use `build`, which
    validates the fields.

    Attributes:
      version: "vanilla", "two_branch" or "hourglass".
      image_size: (height, width) of the images in pixels, before padding.
      in_channels: channels of the images.
      widths: feature maps per level, full size first.
      fc_points, fc_widths: number of points and hidden widths of the fc branch.
      deconv_level, deconv_channels: last level of the deconv branch, and its output channels (3 per
        point of a cell).
      random_size: components of r; 0 = no random input.
      random_at: where r is added, "bottleneck" or "fc".
      dtype: dtype of the arithmetic in the hidden layers; parameters and points are float32.
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
          x: images, as returned by `inputs.stack_channels`.
          r: standard normal numbers: [b, random_size], or [b, draws, random_size] for several
            clouds per image, for which the encoder runs once. None if and only if `random_size` is
            0.

        Returns:
          Points in the project's frame, unit = radius of the bounding hemisphere; float32;
          [b, n, 3], or [b, draws, n, 3].

        Raises:
          ValueError: the shape of an argument does not match the network.
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
        if has_deconv_branch(self.version):
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
            if late is not None:  # these points do not depend on r
                draws = late.shape[0] // points.shape[0]
                points = jnp.repeat(points[:, None], draws, axis=1).reshape(-1, *points.shape[1:])
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
    """Builds the network of a configuration, without parameters.

    Raises:
      ValueError: a field is out of range, or the image is too small (see `padded_size`).
    """
    num_points(config)
    if config.compute_dtype not in DTYPES:
        raise wrong_field("compute_dtype", config.compute_dtype, f"one of {tuple(DTYPES)}")
    if config.in_channels < 1:
        raise wrong_field(
            "in_channels", config.in_channels, "at least 1 (`data.inputs` gives 3 to 6)"
        )
    if config.fc_points and not config.fc_widths:
        raise wrong_field("fc_widths", config.fc_widths, "at least one width")
    if config.random_size < 0:
        raise wrong_field("random_size", config.random_size, "0 (none) or more")
    if config.random_at not in RANDOM_AT:
        raise wrong_field("random_at", config.random_at, f"one of {RANDOM_AT}")
    if config.random_size and config.random_at == "fc" and not config.fc_points:
        raise wrong_field("random_at", "fc", "'bottleneck', because fc_points=0 has no fc branch")
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
    """Pads images to `size` with their border pixels; an odd pixel is added at bottom or right."""
    extra = [target - side for target, side in zip(size, x.shape[1:3], strict=True)]
    if not any(extra):
        return x
    amounts = [(e // 2, e - e // 2) for e in extra]
    return jnp.pad(x, [(0, 0), *amounts, (0, 0)], mode="edge")


def _add(x: Array, per_image: Array) -> Array:
    """`x + per_image`; x may have several rows for each row of `per_image`, next to each other."""
    if x.shape == per_image.shape:
        return x + per_image
    # `shape[0]`, not `len`: the number of images may be symbolic (`psgn_jax.portable`).
    grouped = x.reshape(per_image.shape[0], -1, *per_image.shape[1:])
    return (grouped + per_image[:, None]).reshape(x.shape)

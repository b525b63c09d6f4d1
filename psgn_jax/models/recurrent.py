"""3D-R2N2, the baseline of the paper: predicts an occupancy grid from one or more images.

Source: Choy et al., "3D-R2N2: A Unified Approach for Single and Multi-view 3D Object
Reconstruction", ECCV 2016, with the sizes of its published code
(github.com/chrischoy/3D-R2N2, `models/res_gru_net.py`):

- `ImageEncoder`, for each view: six levels with 96, 128, 256, 256, 256, 256 feature maps. Each
  level has two 3x3 convolutions (the first of all is 7x7) and a 2x2 max pooling with a padding of
  one pixel: 127 pixels become 64, 33, 17, 9, 5, 3. A dense layer of 1024 follows. Shortcuts: levels
  2, 3 and 5 add a 1x1 convolution of their input, level 6 adds its input.
- `VolumeCell`: a GRU on a grid of 4^3 cells with 128 numbers each,
  `h = u h + (1 - u) tanh(W x + U (r h) + b)`. U is a 3x3x3 convolution over the cells; W is a dense
  layer that reads the view, with separate weights for each cell.
- `VolumeDecoder`: three levels with 128, 128 and 64 feature maps. Each level unpools (`unpool`),
  applies two 3x3x3 convolutions and adds the unpooled volume (at 64 feature maps through a 1x1x1
  convolution). At 32^3 two convolutions with 32 feature maps follow; a third reads the output of
  the first and is added to the second. A last convolution has 2 outputs per cell.

The network has 35,968,706 parameters for images of 127 or 128 pixels. A leaky ReLU (.01) follows
every convolution of the encoder and decoder, except shortcuts and the last convolution. The loss is
the softmax cross-entropy, averaged over the cells.

**Ours**: He initialisation of all kernels, with the mean of fan-in and fan-out (in the published
code, the dense layers of `VolumeCell` start larger), and a grid indexed [x, y, z] (`data.schema`).
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
from flax import linen as nn

from psgn_jax.array_types import Array, Bool, Float
from psgn_jax.models.layers import Conv, Conv3D, Dense

CONV_WIDTHS = (96, 128, 256, 256, 256, 256)
DENSE_WIDTH = 1024
HIDDEN_WIDTH = 128
DECODER_WIDTHS = (128, 128, 64, 32)
HIDDEN_SIZE = 4

_LEAK = 0.01
_INITIAL: dict[str, Any] = {
    "kernel_init": nn.initializers.variance_scaling(2.0, "fan_avg", "normal"),
    "bias_init": nn.initializers.constant(0.1),
}
_Conv: Any = functools.partial(Conv, **_INITIAL)
_Conv3D: Any = functools.partial(Conv3D, **_INITIAL)
_Dense: Any = functools.partial(Dense, **_INITIAL)


def _leaky(x: Array) -> Array:
    return nn.leaky_relu(x, _LEAK)


class ImageEncoder(nn.Module):
    """Maps images to vectors."""

    widths: tuple[int, ...]
    dense: int
    dtype: Any

    @nn.compact
    def __call__(self, x: Float[Array, "b h w c"]) -> Float[Array, "b n"]:
        conv = functools.partial(_Conv, dtype=self.dtype)
        for level, width in enumerate(self.widths, start=1):
            shortcut: Array | None = None
            if level in (2, 3, 5):
                shortcut = conv(width, 1, name=f"level{level}_shortcut")(x)
            elif level == 6:
                shortcut = x
            y = _leaky(conv(width, 7 if level == 1 else 3, name=f"level{level}_conv0")(x))
            y = _leaky(conv(width, 3, name=f"level{level}_conv1")(y))
            x = y if shortcut is None else y + shortcut
            x = nn.max_pool(x, (2, 2), (2, 2), ((1, 1), (1, 1)))
        x = x.reshape(x.shape[0], -1)
        return _leaky(_Dense(self.dense, dtype=self.dtype, name="dense")(x))


class _Gate(nn.Module):
    """`W x + U * h + b`, with a dense layer W for each cell and a convolution U over the cells."""

    dtype: Any

    @nn.compact
    def __call__(self, x: Array, h: Array) -> Array:
        size = h[0].size
        dense = _Dense(size, use_bias=False, dtype=self.dtype, name="view")
        grid = _Conv3D(h.shape[-1], dtype=self.dtype, name="grid")
        return dense(x).reshape(h.shape) + grid(h)


class VolumeCell(nn.Module):
    """The recurrent unit; returns the hidden state after one more view."""

    dtype: Any

    @nn.compact
    def __call__(
        self, x: Float[Array, "b n"], hidden: Float[Array, "b 4 4 4 c"]
    ) -> Float[Array, "b 4 4 4 c"]:
        update = nn.sigmoid(_Gate(self.dtype, name="update")(x, hidden))
        reset = nn.sigmoid(_Gate(self.dtype, name="reset")(x, hidden))
        new = jnp.tanh(_Gate(self.dtype, name="candidate")(x, reset * hidden))
        return update * hidden + (1 - update) * new


class VolumeDecoder(nn.Module):
    """Maps a grid of 4^3 cells to one of 32^3 with two numbers per cell (see the module)."""

    widths: tuple[int, ...]
    dtype: Any

    @nn.compact
    def __call__(self, x: Float[Array, "b n n n c"]) -> Float[Array, "b m m m 2"]:
        *unpooled_widths, last_width = self.widths
        conv = functools.partial(_Conv3D, dtype=self.dtype)
        for level, width in enumerate(unpooled_widths):
            x = unpool(x)
            y = _leaky(conv(width, 3, name=f"level{level}_conv0")(x))
            y = _leaky(conv(width, 3, name=f"level{level}_conv1")(y))
            if width != x.shape[-1] or level == len(unpooled_widths) - 1:
                x = conv(width, 1, name=f"level{level}_shortcut")(x)
            x = x + y
        x = _leaky(conv(last_width, 3, name="last_conv0")(x))
        y = _leaky(conv(last_width, 3, name="last_conv1")(x))
        x = y + conv(last_width, 3, name="last_shortcut")(x)
        return _Conv3D(2, name="logits")(x)


class RecurrentVolume(nn.Module):
    """Maps v >= 1 views of an object to the logits (empty, occupied) of 32^3 cells.

    Views are for example RGB in [0, 1] with 127x127 pixels. The parameters do not depend on v.
    """

    width_multiplier: float = 1.0  # of the published widths; the products are multiples of 8
    dtype: Any = jnp.float32

    def scaled(self, *widths: int) -> tuple[int, ...]:
        return tuple(max(8, 8 * round(width * self.width_multiplier / 8)) for width in widths)

    @nn.compact
    def __call__(self, views: Float[Array, "b v h w c"]) -> Float[Array, "b x y z 2"]:
        batch, count = views.shape[:2]
        dense, width = self.scaled(DENSE_WIDTH, HIDDEN_WIDTH)
        encoder = ImageEncoder(self.scaled(*CONV_WIDTHS), dense, self.dtype, name="encoder")
        codes = encoder(views.reshape(batch * count, *views.shape[2:]).astype(self.dtype))
        codes = codes.reshape(batch, count, -1)
        cell = VolumeCell(self.dtype, name="cell")
        hidden = jnp.zeros((batch, *(HIDDEN_SIZE,) * 3, width), self.dtype)
        for view in range(count):
            hidden = cell(codes[:, view], hidden)
        decoder = VolumeDecoder(self.scaled(*DECODER_WIDTHS), self.dtype, name="decoder")
        return decoder(hidden)


def unpool(x: Float[Array, "b n n n c"]) -> Float[Array, "b m m m c"]:
    """Doubles each axis: a value goes to the lowest corner of 2^3 cells, the others are 0."""
    twice = [(0, 1, 1)] * 3
    return jax.lax.pad(x, jnp.zeros((), x.dtype), [(0, 0, 0), *twice, (0, 0, 0)])


def voxel_cross_entropy(
    logits: Float[Array, "x y z 2"], gt: Bool[Array, "x y z"]
) -> Float[Array, ""]:
    """Mean over the cells of -log softmax(logits)[gt], with the natural logarithm."""
    gt = jnp.asarray(gt)
    # For two classes, -log(probability) is softplus(other logit - this logit).
    lead = logits[..., 1] - logits[..., 0]
    return nn.softplus(jnp.where(gt, -lead, lead)).mean()


def occupancy(logits: Float[Array, "*cells 2"]) -> Float[Array, "*cells"]:
    """Probability that a cell is occupied: the second component of the softmax."""
    return nn.sigmoid(logits[..., 1] - logits[..., 0])

"""EfficientNet-Lite0: features of an image by a network that was trained on photographs.

Sources: Tan and Le 2019, "EfficientNet"; the Lite variants of github.com/tensorflow/tpu, which have
ReLU6 and no squeeze-and-excitation. The published parameters were trained on ImageNet. Batch
normalisation is folded into kernels and biases, and the head of the classifier is left out:
2.9 M parameters remain. `recipes/encoder.py` converts them.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
from flax import linen as nn
from jax import lax

from psgn_jax.array_types import Array, Float
from psgn_jax.models import layers
from psgn_jax.models.point_out_net import Bottleneck

NAME = "lite0"
"""Name of the module, and of its parameters, in a network that contains it."""

STEM = 32


class Shape(NamedTuple):
    """Shape of a block; `map_stride` is the stride of its result with respect to the image."""

    kernel_size: int
    stride: int
    expansion: int
    features: int
    map_stride: int
    residual: bool


# A stage has equal blocks, but only its first one has the stride, and the others are residual.
BLOCKS = tuple(
    Shape(kernel_size, 1 if i else stride, expansion, features, map_stride, residual=i > 0)
    for blocks, kernel_size, stride, expansion, features, map_stride in (
        (1, 3, 1, 1, 16, 2),
        (2, 3, 2, 6, 24, 4),
        (2, 5, 2, 6, 40, 8),
        (3, 3, 2, 6, 80, 16),
        (3, 5, 1, 6, 112, 16),
        (4, 5, 2, 6, 192, 32),
        (1, 3, 1, 6, 320, 32),
    )
    for i in range(blocks)
)
SCALES = {2: 0.25, 4: 0.15, 8: 0.15, 16: 0.2, 32: 0.4}
"""Factor of the feature map of each stride, so that its values have a standard deviation near 1."""


class Block(nn.Module):
    """An inverted residual: 1x1 expansion, depthwise convolution, linear 1x1 projection."""

    shape: Shape

    @nn.compact
    def __call__(self, x: Float[Array, "b h w c_in"]) -> Float[Array, "b ho wo c_out"]:
        y, shape = x, self.shape
        if shape.expansion > 1:
            y = nn.relu6(layers.Conv(x.shape[-1] * shape.expansion, 1, name="expand")(y))
        depthwise = layers.Conv(
            y.shape[-1], shape.kernel_size, shape.stride, depthwise=True, name="depthwise"
        )
        y = nn.relu6(depthwise(y))
        y = layers.Conv(shape.features, 1, name="project")(y)
        return x + y if shape.residual else y


class EfficientNetLite0(nn.Module):
    """Maps RGB images with values in [0, 1] to five maps, of strides 2, 4, 8, 16 and 32.

    The map of a stride is the last one of that size, a linear projection, times `SCALES`.
    """

    trained: int = 0  # blocks, counted from the last one, that get a gradient

    @nn.compact
    def __call__(self, image: Float[Array, "b h w 3"]) -> list[Float[Array, "b hs ws c"]]:
        x = nn.relu6(layers.Conv(STEM, 3, stride=2, name="stem")((255 * image - 127) / 128))
        features: dict[int, Array] = {}
        for number, shape in enumerate(BLOCKS):
            if number == len(BLOCKS) - self.trained:
                x, features = lax.stop_gradient((x, features))
            x = features[shape.map_stride] = Block(shape, name=f"block{number}")(x)
        if not self.trained:
            features = lax.stop_gradient(features)
        return [SCALES[stride] * x for stride, x in features.items()]


class PhotoEncoder(nn.Module):
    """An encoder for `PointOutNet`: EfficientNet-Lite0, and a bottleneck below its last map.

    It is **ours**. The features of EfficientNet-Lite0 take the place of the encoder's levels 1 to 5
    of `two_branch`; the bottleneck is level 6. The maps that the branches read also have the other
    inputs (mask, depth) as channels, averaged over their cells.
    """

    width: int  # feature maps of the bottleneck
    trained: int
    dtype: Any

    @nn.compact
    def __call__(self, x: Array, r: Array | None) -> tuple[list[Array], Array]:
        features, others = [x], x[..., 3:]
        for maps in EfficientNetLite0(self.trained, name=NAME)(x[..., :3]):
            others = nn.avg_pool(others, (2, 2), (2, 2))
            features.append(jnp.concatenate([maps, others], axis=-1))
        return features, Bottleneck(self.width, self.dtype, name="bottleneck")(features[-1], r)

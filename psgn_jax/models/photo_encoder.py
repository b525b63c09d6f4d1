"""An encoder for `PointOutNet` that was trained on photographs: the networks named `lite0`.

It is **ours**. The features of EfficientNet-Lite0 take the place of the encoder's levels 1 to 5 of
`two_branch`; the bottleneck is level 6. The maps that the branches read also have the other inputs
(mask, depth) as channels, averaged over their cells.
"""

from typing import Any

import jax.numpy as jnp
from flax import linen as nn

from psgn_jax.array_types import Array
from psgn_jax.models import efficientnet
from psgn_jax.models.point_out_net import Bottleneck


class PhotoEncoder(nn.Module):
    """EfficientNet-Lite0, and a bottleneck below its last map.

    Attributes:
      width: feature maps of the bottleneck.
      trained: blocks of the EfficientNet that training changes, see there.
    """

    width: int
    trained: int
    dtype: Any

    @nn.compact
    def __call__(self, x: Array, r: Array | None) -> tuple[list[Array], Array]:
        """Returns the input and five feature maps, and the bottleneck, like `Encoder`."""
        features, others = [x], x[..., 3:]
        for maps in efficientnet.EfficientNetLite0(self.trained, name=efficientnet.NAME)(
            x[..., :3]
        ):
            others = nn.avg_pool(others, (2, 2), (2, 2))
            features.append(jnp.concatenate([maps, others], axis=-1))
        return features, Bottleneck(self.width, self.dtype, name="bottleneck")(features[-1], r)

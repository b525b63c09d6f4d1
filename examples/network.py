"""A network that predicts clouds: a perceptron on an image of a few pixels."""

import jax
from flax import linen as nn

from psgn_jax.array_types import Array, Float
from psgn_jax.models.networks import NETWORKS
from psgn_jax.models.point_out_net import CloudNetwork


class Perceptron(CloudNetwork):
    """Averages squares of pixels, then two dense layers."""

    points: int
    width: int
    square: int = 8  # side in pixels

    @property
    def num_points(self) -> int:
        return self.points

    @nn.compact  # `x.shape[0]`, not `len(x)`: in an export, it is the symbol of any number
    def __call__(self, x: Float[Array, "b h w c"], r: None = None) -> Float[Array, "b n 3"]:
        small = nn.avg_pool(x, (self.square, self.square), (self.square, self.square))
        hidden = nn.relu(nn.Dense(self.width)(small.reshape(x.shape[0], -1)))
        cloud = nn.Dense(3 * self.points, bias_init=jax.nn.initializers.normal(0.3))(hidden)
        return cloud.reshape(x.shape[0], self.points, 3)


NETWORKS["perceptron"] = lambda model: Perceptron(model.fc_points, model.fc_widths[0])

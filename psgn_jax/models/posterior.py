"""The posterior network of a conditional variational autoencoder: from the true shape to z.

Source: paper, section "Generation of Multiple Plausible Shapes" and its figure on the conditional
variational autoencoder (after Doersch, "Tutorial on Variational Autoencoders", 2016, section 3).
During training, a 3D convolutional network Q maps the volume Y of the true shape to a normal
distribution of z, and the generator G maps the image and a sample of z to a cloud. With the ground
truth S and a distance d between clouds, the loss is

    E over z ~ Q(z | Y) of d(G(image, z), S)  +  weight * KL(Q(z | Y) || N(0, I)).

At test time z is sampled from N(0, I). The generator is a `point_out_net` with z as its input r.

The authors published no code for this version, and the paper gives no sizes; it refers to VoxNet
(Maturana and Scherer, IROS 2015). The following is **ours**:

- All convolutions have stride 2 and a ReLU (three by default: 5^3, 3^3, 3^3). A dense layer of 128
  with ReLU and a linear layer to mean and log-variance follow. VoxNet has one stride and a pooling.
- The volume consists of the cells with ground-truth points of the sample (`occupied`), VoxNet's
  "hit grid", not of the solid cells in the records. So it follows augmentations (flip, stretch) and
  exists for all data sets.
- The last layer has small initial values, so that Q starts near N(0, I) and the divergence near 0.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from flax import linen as nn

from psgn_jax.array_types import Array, Float
from psgn_jax.data.schema import OCCUPANCY_SIZE
from psgn_jax.models import layers
from psgn_jax.models.layers import Conv3D, Dense
from psgn_jax.models.volumes import GRID, GRID_EDGE, GRID_ORIGIN

NAME = "posterior"  # name of the posterior network's parameters beside the generator's

ACTIVE = 0.01  # A dimension of z is active if its mean divergence over samples (nats) exceeds this


class Gaussian(NamedTuple):
    """Means and log-variances of independent normal distributions."""

    mean: Float[Array, "b k"]
    log_variance: Float[Array, "b k"]


class Posterior(nn.Module):
    """Maps volumes from `occupied` to distributions of z, in float32."""

    widths: tuple[int, ...]  # feature maps of the convolutions
    hidden: int  # width of the dense layer
    size: int  # components of z

    @nn.compact
    def __call__(self, volume: Float[Array, "b x y z"]) -> Gaussian:
        x = volume[..., None]
        for i, width in enumerate(self.widths):
            x = nn.relu(Conv3D(width, 3 if i else 5, stride=2, name=f"conv{i}")(x))
        x = x.reshape(x.shape[0], -1)
        x = nn.relu(Dense(self.hidden, name="hidden")(x))
        x = Dense(2 * self.size, kernel_init=layers.small(0.1), name="gaussian")(x)
        return Gaussian(x[:, : self.size], x[:, self.size :])


def occupied(points: Float[Array, "n 3"]) -> Float[Array, "32 32 32"]:
    """1 in the cells of `volumes.GRID` that contain a point, 0 elsewhere, without gradient.

    Points outside the grid, for instance after stretching, belong to the nearest cell.
    """
    origin = jnp.asarray(GRID_ORIGIN, points.dtype)[None]
    place = (points - origin) / (GRID_EDGE / OCCUPANCY_SIZE)
    cell = jnp.clip(jnp.floor(place), 0, OCCUPANCY_SIZE - 1).astype(jnp.int32)
    volume = jnp.zeros(GRID, jnp.float32).at[cell[:, 0], cell[:, 1], cell[:, 2]].set(1.0)
    return jax.lax.stop_gradient(volume)


def reparameterise(q: Gaussian, noise: Float[Array, "b k"]) -> Float[Array, "b k"]:
    """A sample of Q: mean + standard deviation * noise, for noise ~ N(0, I).

    Source: Kingma and Welling, "Auto-Encoding Variational Bayes", ICLR 2014, section 2.4.
    """
    return q.mean + jnp.exp(0.5 * q.log_variance) * noise


def kl_of_dims(q: Gaussian) -> Float[Array, "b k"]:
    """KL(Q || N(0, I)) of each dimension, in nats: (mean^2 + variance - 1 - log variance) / 2.

    Source: Kingma and Welling 2014, appendix B. We compute "variance - 1" by `expm1` of the
    log-variance, to avoid cancellation near the prior.
    """
    return 0.5 * (jnp.square(q.mean) + jnp.expm1(q.log_variance) - q.log_variance)

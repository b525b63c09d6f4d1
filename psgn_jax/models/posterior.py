"""The posterior of a conditional variational autoencoder: a network from true shape to z.

Source: paper, section "Generation of Multiple Plausible Shapes" and its figure on the conditional
variational autoencoder (after Doersch, "Tutorial on Variational Autoencoders", 2016, section 3).
While training, a 3D convolutional network Q reads the volume Y of the true shape and gives a normal
distribution of z; the generator turns the image and a draw of z into a cloud; minimised is

    E over z ~ Q(z | Y) of d(G(I, z), S)  +  weight * KL(Q(z | Y) || N(0, I)).

When only an image is at hand, z is drawn from N(0, I). z takes the place of the random input r: the
generator is the one of `point_out_net`, entry point included.

The code of the paper's version was never published and its text names no sizes. **Ours**, with
VoxNet (Maturana and Scherer, IROS 2015) as the paper's pointer:

- VoxNet's is 5^3 convolution of stride 2, 3^3 convolution, pooling, dense 128. Here convolutions of
  stride 2 (5^3, then 3^3) take the place of pooling, as in the paper's image network, each with
  ReLU; then dense 128 with ReLU, and a linear layer to mean and log-variance.
- The volume is made of the sample's ground-truth points while training (`occupied`), not read from
  the records' solid occupancy: so it follows every change of the sample (mirrored, stretched) and
  needs no field that some data sets (the authors' batches) lack.
  It is VoxNet's "hit grid" of the surface: the network sees the cells through which it passes.
- The last layer starts small, so that Q starts near N(0, I) and the divergence near zero.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from flax import linen as nn

from psgn_jax.config import ModelConfig
from psgn_jax.data.schema import OCCUPANCY_SIZE
from psgn_jax.models import layers
from psgn_jax.models.layers import Conv3D, Dense
from psgn_jax.types import Array, Float

NAME = "posterior"
"""Where the parameters are, beside those of the generator."""

GRID = (OCCUPANCY_SIZE,) * 3
"""Cells of the volume along x, y, z; it covers [-1, 1] x [-1, 1] x [0, 2] as `data.schema` says."""

ACTIVE = 0.01
"""A dimension of z whose divergence exceeds this (nats, mean over samples) counts as in use."""

_LOW = (-1.0, -1.0, 0.0)
_CELL = 2 / OCCUPANCY_SIZE


class Gaussian(NamedTuple):
    """Independent normal distributions: means and logarithms of the variances."""

    mean: Float[Array, "b k"]
    log_variance: Float[Array, "b k"]


class Posterior(nn.Module):
    """Volumes to the distributions of z (see the module).

    Attributes:
      widths: feature maps of the convolutions.
      hidden: width of the dense layer.
      size: components of z.
    """

    widths: tuple[int, ...]
    hidden: int
    size: int

    @nn.compact
    def __call__(self, volume: Float[Array, "b x y z"]) -> Gaussian:
        """Reads a batch of volumes (`occupied`), float32 throughout."""
        x = volume[..., None]
        for i, width in enumerate(self.widths):
            x = nn.relu(Conv3D(width, 3 if i else 5, stride=2, name=f"conv{i}")(x))
        x = x.reshape(x.shape[0], -1)
        x = nn.relu(Dense(self.hidden, name="hidden")(x))
        x = Dense(2 * self.size, kernel_init=layers.small(0.1), name="gaussian")(x)
        return Gaussian(x[:, : self.size], x[:, self.size :])


def build(config: ModelConfig) -> Posterior:
    """The network of a configuration that has `posterior`."""
    return Posterior(
        widths=tuple(config.posterior_widths),
        hidden=config.posterior_hidden,
        size=config.random_size,
    )


def occupied(points: Float[Array, "n 3"]) -> Float[Array, "32 32 32"]:
    """1 in the cells of the `GRID` that hold a point, 0 in the others; no gradient.

    Points outside (a stretched sample may be wider than the grid) count for the nearest cell.
    Setting ones, unlike adding, gives the same bits in any order of the points.
    """
    place = (points - jnp.asarray(_LOW, points.dtype)[None, :]) / _CELL
    cell = jnp.clip(jnp.floor(place), 0, OCCUPANCY_SIZE - 1).astype(jnp.int32)
    volume = jnp.zeros(GRID, jnp.float32).at[cell[:, 0], cell[:, 1], cell[:, 2]].set(1.0)
    return jax.lax.stop_gradient(volume)


def reparameterise(q: Gaussian, noise: Float[Array, "b k"]) -> Float[Array, "b k"]:
    """A draw, mean + standard deviation * noise, of Q for noise ~ N(0, I).

    Source: Kingma and Welling, "Auto-Encoding Variational Bayes", ICLR 2014, section 2.4.
    """
    return q.mean + jnp.exp(0.5 * q.log_variance) * noise


def kl_of_dims(q: Gaussian) -> Float[Array, "b k"]:
    """KL(Q || N(0, I)) of each dimension, in nats: (mean^2 + variance - 1 - log variance) / 2.

    Source: Kingma and Welling 2014, appendix B. Variance - 1 is computed by `expm1`: near the prior
    the difference would be all rounding.
    """
    return 0.5 * (jnp.square(q.mean) + jnp.expm1(q.log_variance) - q.log_variance)

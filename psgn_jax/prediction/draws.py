"""Which clouds of a network with a random input r are shown, and how far each point varies.

The first cloud is the prediction for r = 0, the most probable r, or the mean of the draws. A draw
is the prediction for an r of N(0, I). `ranked` chooses further clouds. This is **ours**; the paper
shows draws as they come (section "Predicting Multiple Plausible Shapes").
"""

import functools
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np

from psgn_jax.array_types import Array, Float, Int
from psgn_jax.losses.auction import assign
from psgn_jax.losses.by_name import chosen_points
from psgn_jax.losses.chamfer import chamfer_sq_mean
from psgn_jax.losses.mapping import map_pairs

First = Literal["zero", "mean"]
FIRST: tuple[First, ...] = ("zero", "mean")

_FEW = 256  # points of each cloud that are compared: 16 draws take 11 ms of a core
# Accepted relative error of the bijections between clouds. 15 of them take 115 ms of a core; with
# 1 % they take 150 ms, and the spreads have a correlation of .975 with these.
_TOLERANCE = 0.05


def num_draws(samples: int) -> int:
    """Draws for so many clouds: 16, or twice as many as clouds, so that half of them suffice."""
    return max(16, 2 * samples)


def compared_points(num_points: int) -> np.ndarray:
    """Numbers of the points that `ranked` compares, int [256], or all if there are fewer."""
    numbers: Any = np.arange(num_points)
    return np.asarray(chosen_points(numbers, min(_FEW, num_points)))


def ranked(clouds: Float[Array, "k n 3"], samples: int) -> Int[Array, " k"]:
    """Numbers of the clouds: the first, `samples` - 1 draws that differ, then the other draws.

    Each of those that differ is the farthest from the clouds before it (by the Chamfer distance to
    the nearest of them), among the half of the draws with the smallest sums of distances to all
    clouds. The others are in the order of their sums.
    """
    k = len(clouds)
    few = clouds[:, compared_points(clouds.shape[1])]
    a, b = np.triu_indices(k, 1)
    upper = map_pairs(chamfer_sq_mean)(few[a], few[b])
    distances = jnp.zeros((k, k)).at[a, b].set(upper)
    distances += distances.T
    order = jnp.argsort(distances.sum(axis=0).at[0].set(-1))
    distances = distances[order][:, order]
    left = jnp.arange(k) <= max((k - 1) // 2, samples - 1)
    shown, nearest = [jnp.int32(0)], distances[0]
    for _ in range(samples - 1):
        left = left.at[shown[-1]].set(False)
        shown.append(jnp.argmax(jnp.where(left, nearest, -1)).astype(jnp.int32))
        nearest = jnp.minimum(nearest, distances[shown[-1]])
    first_ones = jnp.stack(shown)
    others = jnp.ones(k, bool).at[first_ones].set(False)
    rest = jnp.nonzero(others, size=k - samples)[0].astype(jnp.int32)
    return order[jnp.concatenate([first_ones, rest])].astype(jnp.int32)


def with_first(clouds: Float[Array, "b k n 3"], first: First = "zero") -> Float[Array, "b k n 3"]:
    """The clouds of r = 0 and of draws; with `first` = "mean", the mean of the draws comes first.

    The mean is taken over points with the same number. They correspond, because a small change of
    the random input moves a point only a little.
    """
    return clouds if first == "zero" else clouds.at[:, 0].set(clouds[:, 1:].mean(axis=1))


def matched(
    clouds: Float[Array, "k n 3"],
) -> tuple[Int[Array, "k-1 n"], Float[Array, "k-1 n 3"]]:
    """In each other cloud, numbers and places of the EMD's partners of the first cloud's points."""

    def index_of(first: Array, other: Array) -> Array:
        return assign(first, other, tolerance=_TOLERANCE).index

    index = map_pairs(index_of)(jnp.broadcast_to(clouds[:1], clouds[1:].shape), clouds[1:])
    return index, jnp.take_along_axis(clouds[1:], index[..., None], axis=1)


@functools.partial(jax.jit, static_argnames="samples")
def spread(clouds: Float[Array, "k n 3"], samples: int = 1) -> Float[Array, "samples n"]:
    """How far the points of the first `samples` clouds vary (unit): little where they are certain.

    For a point of the first cloud it is the mean distance to its partners in the other clouds; the
    partners in other clouds have the same value.
    """
    index, partners = matched(clouds)
    first = jnp.linalg.norm(partners - clouds[:1], axis=-1).mean(axis=0)
    others = jax.vmap(lambda own: jnp.zeros_like(first).at[own].set(first))(index[: samples - 1])
    return jnp.concatenate([first[None], others])

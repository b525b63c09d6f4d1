"""Which of a network's draws are shown, in which order, and how far each point varies.

A draw is the cloud that a network with a random input predicts for one r. The first cloud shown is
the medoid of the draws, or their mean. Further ones differ most from those before, among the more
plausible half: the draws that are nearer to the others than the rest are. This is **ours**; the
paper shows draws as they come (section "Predicting Multiple Plausible Shapes").
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

First = Literal["medoid", "mean"]
FIRST: tuple[First, ...] = ("medoid", "mean")

_FEW = 256  # points of each cloud that are compared: 16 draws take 11 ms of a core
# Accepted relative error of the bijections between draws. 15 of them take 115 ms of a core; with
# 1 % they take 150 ms, and the spreads have a correlation of .975 with these.
_TOLERANCE = 0.05


def num_draws(samples: int) -> int:
    """Draws for so many clouds: 16, or twice as many as clouds, so that half of them suffice."""
    return max(16, 2 * samples)


def compared_points(num_points: int) -> np.ndarray:
    """Numbers of the points that `ranked` compares, int [256], or all if there are fewer."""
    numbers: Any = np.arange(num_points)
    return np.asarray(chosen_points(numbers, min(_FEW, num_points)))


def ranked(draws: Float[Array, "k n 3"], samples: int = 1) -> Int[Array, " k"]:
    """Numbers of the draws: the medoid, `samples` - 1 that differ, then the others.

    The medoid has the smallest sum of Chamfer distances to the others. Each of those that differ is
    the farthest from those before it (by the distance to the nearest of them), among the half of
    the draws with the smallest sums. The others are in the order of their sums.
    """
    k = len(draws)
    few = draws[:, compared_points(draws.shape[1])]
    first, second = np.triu_indices(k, 1)
    upper = map_pairs(chamfer_sq_mean)(few[first], few[second])
    distances = jnp.zeros((k, k)).at[first, second].set(upper)
    distances += distances.T
    order = jnp.argsort(distances.sum(axis=0))
    distances = distances[order][:, order]
    left = jnp.arange(k) < max(k // 2, samples)
    shown, nearest = [jnp.int32(0)], distances[0]
    for _ in range(samples - 1):
        left = left.at[shown[-1]].set(False)
        shown.append(jnp.argmax(jnp.where(left, nearest, -1)).astype(jnp.int32))
        nearest = jnp.minimum(nearest, distances[shown[-1]])
    first_ones = jnp.stack(shown)
    others = jnp.ones(k, bool).at[first_ones].set(False)
    rest = jnp.nonzero(others, size=k - samples)[0].astype(jnp.int32)
    return order[jnp.concatenate([first_ones, rest])].astype(jnp.int32)


def chosen_first(
    draws: Float[Array, "k n 3"], samples: int = 1, first: First = "medoid"
) -> Float[Array, "k n 3"]:
    """The draws in the order of `ranked`; with `first` = "mean", their mean is the first.

    The mean is taken over each point of the medoid and its partners in the other draws.
    """
    draws = jnp.asarray(draws)[ranked(draws, samples)]
    if first == "medoid":
        return draws
    _, partners = matched(draws)
    return draws.at[0].set((draws[0] + partners.sum(axis=0)) / len(draws))


def chosen_clouds(
    points: Float[Array, "b n 3"] | Float[Array, "b k n 3"], **choice: Any
) -> Float[Array, "b k n 3"]:
    """`chosen_first` for each image of a batch; without draws, [b, n, 3] becomes [b, 1, n, 3]."""
    if points.ndim == 3:
        return points[:, None]
    return jax.lax.map(functools.partial(chosen_first, **choice), points)


def matched(
    draws: Float[Array, "k n 3"],
) -> tuple[Int[Array, "k-1 n"], Float[Array, "k-1 n 3"]]:
    """In each other draw, numbers and places of the EMD's partners of the first draw's points."""

    def index_of(first: Array, draw: Array) -> Array:
        return assign(first, draw, tolerance=_TOLERANCE).index

    index = map_pairs(index_of)(jnp.broadcast_to(draws[:1], draws[1:].shape), draws[1:])
    return index, jnp.take_along_axis(draws[1:], index[..., None], axis=1)


@functools.partial(jax.jit, static_argnames="samples")
def spread(draws: Float[Array, "k n 3"], samples: int = 1) -> Float[Array, "samples n"]:
    """How far the points of the first `samples` clouds vary (unit): little where they are certain.

    For a point of the first cloud it is the mean distance to its partners in the other draws; the
    partners in other clouds have the same value.
    """
    index, partners = matched(draws)
    first = jnp.linalg.norm(partners - draws[:1], axis=-1).mean(axis=0)
    others = jax.vmap(lambda own: jnp.zeros_like(first).at[own].set(first))(index[: samples - 1])
    return jnp.concatenate([first[None], others])

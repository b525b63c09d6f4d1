"""What `psgn predict` does to the clouds of a network: mean with the mirror image, silhouette.

The world mirrored at y = 0 has the mirrored image, so a network has two predictions of each image.
Their mean has a smaller error: on the authors' 64 validation samples, the CD squared of `small-3`
falls from .0078 to .0073 (journal, 2026-11-23). The order of the points differs, so we match the
two clouds by the auction of the EMD first.
"""

import functools
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp

from psgn_jax.array_types import Array, Bool, Float
from psgn_jax.losses.auction import assign
from psgn_jax.losses.mapping import map_pairs

# Less than the auction can prove in float32, so it goes on to its last epsilon. On docs/photos it
# finds the optimal bijection, in 5 % more time than with a tolerance of .001.
_TOLERANCE = 5e-5

MOST_OUTSIDE = 0.5
_FAR = 1 << 14  # pixels; larger than any image, and its square fits into 32 bits
_HALF = 0.49  # of a pixel; a point moves to within this distance of a pixel's centre


def mean_of_matched(a: Float[Array, "n 3"], b: Float[Array, "n 3"]) -> Float[Array, "n 3"]:
    """The mean of each point of a and the point of b that the EMD matches with it."""
    return (a + b[assign(a, b, tolerance=_TOLERANCE).index]) / 2


def refined(
    predict: Callable[[Mapping[str, Any], Array | None], Array],
    batch: Mapping[str, Any],
    r: Array | None,
    points: Array | None = None,
    most_outside: float | Array = MOST_OUTSIDE,
) -> Array:
    """Points [B, N, 3], or [B, draws, N, 3], with the mirror image and moved into the mask.

    A network with a random input or with depth only gets the second step: each of its samples is a
    shape of its own, and the camera of a depth image would have to be mirrored.

    Args:
      predict: maps a batch and r to the points of the network.
      batch: `image`, `mask`, `intrinsics` (for images of the size of the mask) and `extrinsics`,
        each with the leading axis B; `depth` if it is an input.
      r: random input, or None.
      points: `predict(batch, r)` if it is known.
      most_outside: see `into_silhouette`.
    """
    points = predict(batch, r) if points is None else points
    if r is None and "depth" not in batch:
        mirrored = {**batch, "image": batch["image"][:, :, ::-1], "mask": batch["mask"][:, :, ::-1]}
        other = predict(mirrored, r) * jnp.array([[[1, -1, 1]]], points.dtype)
        points = map_pairs(mean_of_matched)(points, other)
    clouds = points.reshape(len(points), -1, *points.shape[-2:])
    camera = batch["mask"], batch["intrinsics"], batch["extrinsics"]
    move = functools.partial(into_silhouette, most_outside=most_outside)
    moved = jax.vmap(jax.vmap(move, (0, None, None, None)))(clouds, *camera)
    return moved.reshape(points.shape)


def largest_share(placed: bool) -> float:
    """`most_outside` of `into_silhouette`: .5, for a placed image .1.

    The camera of a placed photo may have another elevation than the authors'. Then more points are
    outside, and moving them makes the cloud worse: on photo-like renders, limits of 0, .1 and .5
    have an aligned EMD of .1250, .1247 and .1261 (journal, 2026-11-24).
    """
    return 0.1 if placed else MOST_OUTSIDE


def into_silhouette(
    points: Float[Array, "n 3"],
    mask: Bool[Array, "h w"],
    intrinsics: Float[Array, "3 3"],
    extrinsics: Float[Array, "3 4"],
    most_outside: float | Float[Array, ""] = MOST_OUTSIDE,
) -> Float[Array, "n 3"]:
    """Moves the points outside the mask, at their depth, into the nearest pixel of the mask.

    Points at or behind the camera stay. All points stay if the mask is empty, or if more than the
    fraction `most_outside` is outside: then the mask or the camera is wrong.

    Args:
      points: in the project's frame, unit = radius of the bounding hemisphere.
      mask: True on the object.
      intrinsics: for images of the size of the mask; extrinsics: see `data.schema`.
    """
    mask = jnp.asarray(mask, bool)
    camera = points @ extrinsics[:, :3].T + extrinsics[:, 3][None]
    depth = camera[:, 2]
    in_front = depth > 1e-3
    pixels = (camera @ intrinsics[:2].T) / jnp.where(in_front, depth, 1)[:, None]
    cells = jnp.floor(jnp.clip(pixels, -_FAR / 4, _FAR / 4)).astype(jnp.int32)
    nearest = _nearest_cells(cells, mask)
    centres = nearest + 0.5
    moved = jnp.clip(pixels, centres - _HALF, centres + _HALF)
    outside = (nearest != cells).any(axis=1) & in_front
    outside &= mask.any() & (outside.mean() <= most_outside)
    shift = jnp.pad((moved - pixels) * depth[:, None], ((0, 0), (0, 1)))
    to_world = jnp.linalg.inv(intrinsics @ extrinsics[:, :3])
    return jnp.where(outside[:, None], points + shift @ to_world.T, points)


def _nearest_cells(cells: Array, mask: Array) -> Array:
    """(column, row) of the pixel of the mask nearest to each of `cells` [n, 2].

    Of several, we take the one in the first row, and there the left one.
    """
    height, width = mask.shape
    columns = jnp.arange(width, dtype=jnp.int32)[None]
    left = jax.lax.cummax(jnp.where(mask, columns, -_FAR), axis=1)
    right = jax.lax.cummin(jnp.where(mask, columns, _FAR), axis=1, reverse=True)
    beside = jnp.where(columns - left <= right - columns, left, right)
    per_row = beside[:, jnp.clip(cells[:, 0], 0, width - 1)].T  # [n, h]
    rows = jnp.arange(height, dtype=jnp.int32)[None]
    squared = (per_row - cells[:, :1]) ** 2 + (rows - cells[:, 1:]) ** 2
    best = jnp.argmin(squared, axis=1)
    return jnp.stack([jnp.take_along_axis(per_row, best[:, None], 1)[:, 0], best], axis=1)

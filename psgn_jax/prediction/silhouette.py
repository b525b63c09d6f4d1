"""A cloud fitted to the mask of its image.

A network leaves parts of the mask empty, and projects points outside it. `fit` changes a cloud in
three steps (**ours**; docs/journal.md, 2026-11-27, has the measurements):

1. Points outside the mask move, at their depth, into the nearest pixel of the mask.
2. Pixels of the mask that are far from every projected point pull the nearest one toward them, at
   its depth, `ROUNDS` times.
3. Of the points within `NEIGHBOURHOOD` pixels of a point in the image, the frontmost and the
   rearmost `TAIL` are tails. A point in front of or behind all its neighbours that are not tails
   moves along its ray to the nearest of them.

The depths of steps 1 and 2 are those that the network predicts. For a placed photo, whose camera is
not known, `camera_of` first finds the elevation, size and position from which the cloud covers the
mask best. Its thin parts become thin in depth, too: before step 3, a point's depth is limited to
`DEEPEST` half widths of the mask there from the mean of its neighbours, as it is for 95 % of the
surface points of training objects.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from psgn_jax.array_types import Array, Bool, Float, Int

MOST_OUTSIDE = 0.5
"""A cloud with a larger part of its points outside the mask is left alone: mask or camera is wrong,
or the mask shows little of the object, such as a plate seen edge-on."""

COLUMNS = 128
"""We fit to a mask of at most about this width: 1,024 points do not resolve a finer one."""

FAR = 1.05
"""A pixel's centre is far from a point beyond this many pixels, and beyond the side of the square
that each point would have if all points shared the mask evenly."""

ROUNDS, STEP = 16, 0.4
"""A round moves a point by `STEP` of the way to the mean of the pixels that pull it."""

NEIGHBOURHOOD, TAIL = 8.0, 0.015
DEEPEST, NARROWEST = 3.0, 3.0
"""`DEEPEST`: see the module. Neighbours there are those within the half width of the mask, at least
`NARROWEST` pixels."""

ELEVATIONS = [-20, -10, 0, 10, 20]
"""Degrees that `camera_of` adds to the camera's elevation."""

SAMPLES = 96
"""Pixels of the mask that `camera_of` compares."""
HALF = 0.49
"""A point moves to within this distance of a pixel's centre, in pixels."""


class Fit(NamedTuple):
    """Fitted clouds [k, n, 3], and the camera [3, 4] that sees them."""

    points: Float[Array, "k n 3"]
    extrinsics: Float[Array, "3 4"]


def fit(
    clouds: Float[Array, "k n 3"],
    mask: Bool[Array, "h w"],
    intrinsics: Float[Array, "3 3"],
    extrinsics: Float[Array, "3 4"],
    *,
    placed: bool = False,
) -> Fit:
    """Clouds of one image, fitted to its mask as the module states.

    Points that are not in front of the camera stay, and a cloud stays if its points or the mask
    do not allow a fit (`MOST_OUTSIDE`).

    Args:
      clouds: in the project's frame, unit = radius of the bounding hemisphere.
      mask: True on the object.
      intrinsics: for images of the size of the mask; extrinsics: see `data.schema`.
      placed: whether the image is a photo that was placed (`framing.place`): the camera is that of
        `camera_of` the first cloud, and thin parts are made thin.
    """
    stride = max(1, mask.shape[1] // COLUMNS)
    mask = jnp.asarray(mask, bool)[stride // 2 :: stride, stride // 2 :: stride]
    intrinsics = intrinsics * jnp.array([[1 / stride], [1 / stride], [1]], intrinsics.dtype)
    nearest = nearest_pixels(mask)
    half_widths = _half_widths(mask)
    if placed:
        extrinsics = camera_of(clouds[0], mask, intrinsics, extrinsics)

    def one(points: Array) -> Array:
        pixels, depth = _project(points, intrinsics, extrinsics)
        in_front = depth > 1e-3
        inside = _into_mask(pixels, nearest)
        outside = (inside != pixels).any(axis=1) & in_front
        fits = mask.any() & (outside.mean() <= MOST_OUTSIDE) & jnp.isfinite(points).all()
        moved = _cover(inside, mask)
        layers = _thinned(moved, depth, half_widths, intrinsics[0, 0]) if placed else depth
        fitted = _back(moved, _without_tails(moved, layers), intrinsics, extrinsics)
        return jnp.where((fits & in_front)[:, None], fitted, points)

    return Fit(jax.lax.map(one, clouds), extrinsics)


def camera_of(
    points: Float[Array, "n 3"],
    mask: Bool[Array, "h w"],
    intrinsics: Float[Array, "3 3"],
    extrinsics: Float[Array, "3 4"],
) -> Float[Array, "3 4"]:
    """The camera, of other elevations about the cloud's centre, from which it fits the mask best.

    For each of `ELEVATIONS`, size and position follow by least squares over pairs of each projected
    point with the nearest pixel of the mask, and of pixels of the mask with the nearest projected
    point. The elevation with the least sum of both mean squared distances gets two more rounds.
    """
    nearest = nearest_pixels(mask)
    rank = jnp.cumsum(mask.ravel())
    wanted = (jnp.arange(SAMPLES) + 0.5) / SAMPLES * rank[-1]
    pixels = _centres(jnp.searchsorted(rank, wanted), mask.shape[1])
    centre, focal = points.mean(axis=0), intrinsics[0, 0]
    seen = extrinsics[:, :3] @ centre + extrinsics[:, 3]

    def pairs(camera: Array) -> tuple[Array, Array, Array, Array]:
        projected, _ = _project(points, intrinsics, camera)
        target = _into_mask(projected, nearest)
        squared = jnp.square(pixels[:, None] - projected[None]).sum(axis=-1)
        return projected, target, projected[jnp.argmin(squared, axis=1)], squared.min(axis=1)

    def resized(camera: Array) -> Array:
        projected, target, partner, _ = pairs(camera)
        mean_from = (projected.mean(axis=0) + partner.mean(axis=0)) / 2
        mean_to = (target.mean(axis=0) + pixels.mean(axis=0)) / 2
        product = square = jnp.float32(0)
        for a, b in ((projected, target), (partner, pixels)):
            product += ((a - mean_from[None]) * (b - mean_to[None])).sum(axis=1).mean()
            square += jnp.square(a - mean_from[None]).sum(axis=1).mean()
        scale = jnp.clip(product / jnp.maximum(square, 1e-6), 0.8, 1.25)
        # The centre's pixel moves with the similarity, and its depth is divided by the scale.
        now = camera[:, :3] @ centre + camera[:, 3]
        pixel = scale * (intrinsics[:2] @ now / now[2] - mean_from) + mean_to
        depth = now[2] / scale
        moved = jnp.append((pixel - intrinsics[:2, 2]) / focal * depth, depth)
        return camera.at[:, 3].add(moved - now)

    def tried(turn: Array) -> tuple[Array, Array]:
        rotation = turn @ extrinsics[:, :3]
        camera = jnp.column_stack([rotation, seen - rotation @ centre])
        camera = resized(camera)
        projected, target, _, squared = pairs(camera)
        return jnp.square(target - projected).sum(axis=1).mean() + squared.mean(), camera

    angle = np.deg2rad(ELEVATIONS)
    turns = np.tile(np.eye(3, dtype=np.float32), (len(angle), 1, 1))
    turns[:, 1, 1] = turns[:, 2, 2] = np.cos(angle)
    turns[:, 1, 2], turns[:, 2, 1] = -np.sin(angle), np.sin(angle)
    costs, cameras = jax.lax.map(tried, jnp.asarray(turns))
    found = resized(resized(cameras[jnp.argmin(costs)]))
    return jnp.where(mask.any() & jnp.isfinite(costs).all(), found, extrinsics)


def nearest_pixels(mask: Bool[Array, "h w"]) -> Int[Array, "h w"]:
    """Index (row * w + column) of the pixel of the mask nearest to each pixel; 0 if it is empty."""
    height, width = mask.shape
    none = 2 * (height + width)
    rows, columns = jnp.mgrid[:height, :width].astype(jnp.int32)
    left = jax.lax.cummax(jnp.where(mask, columns, -none), axis=1)
    right = jax.lax.cummin(jnp.where(mask, columns, none), axis=1, reverse=True)
    beside = jnp.where(columns - left <= right - columns, left, right)  # in the same row
    between = jnp.square(rows[:, :1] - rows[:, :1].T)
    squared = jnp.square(beside - columns)[:, None] + between[..., None]
    # The row in the last digit: one minimum finds distance and row. XLA's argmin takes longer.
    row = (squared * height + rows[:, None, :1]).min(axis=0) % height
    found = row * width + jnp.take_along_axis(beside, row, axis=0)
    return jnp.where(mask.any(), found, 0)


def _project(points: Array, intrinsics: Array, extrinsics: Array) -> tuple[Array, Array]:
    camera = points @ extrinsics[:, :3].T + extrinsics[:, 3][None]
    depth = camera[:, 2]
    return (camera @ intrinsics[:2].T) / jnp.where(depth > 1e-3, depth, 1)[:, None], depth


def _back(pixels: Array, depth: Array, intrinsics: Array, extrinsics: Array) -> Array:
    """Points of the project's frame from pixels and depths."""
    homogeneous = jnp.pad(pixels, ((0, 0), (0, 1)), constant_values=1) * depth[:, None]
    camera = homogeneous @ jnp.linalg.inv(intrinsics).T
    return (camera - extrinsics[:, 3][None]) @ extrinsics[:, :3]


def _centres(index: Array, width: int) -> Array:
    """(column, row) of the centres of pixels."""
    return jnp.stack([index % width, index // width], axis=-1).astype(jnp.float32) + 0.5


def _cells(pixels: Array, height: int, width: int) -> tuple[Array, Array]:
    """The index of each pixel, of the nearest one in the image, and whether it is that one."""
    size = jnp.array([[width, height]], pixels.dtype)
    clipped = jnp.clip(jnp.floor(pixels), 0, size - 1).astype(jnp.int32)
    inside = ((pixels >= 0) & (pixels < size)).all(axis=1)
    return clipped[:, 1] * width + clipped[:, 0], inside


def _into_mask(pixels: Array, nearest: Int[Array, "h w"]) -> Array:
    """Pixels [n, 2]; those outside the mask in the nearest pixel of the mask."""
    cell, within = _cells(pixels, *nearest.shape)
    target = nearest.ravel()[cell]
    centre = _centres(target, nearest.shape[1])
    outside = (target != cell) | ~within
    return jnp.where(outside[:, None], jnp.clip(pixels, centre - HALF, centre + HALF), pixels)


def _cover(pixels: Float[Array, "n 2"], mask: Bool[Array, "h w"]) -> Float[Array, "n 2"]:
    """Step 2 of the module."""
    count, (height, width) = len(pixels), mask.shape
    centres = _centres(jnp.arange(height * width), width)
    far = jnp.maximum(FAR, jnp.sqrt(mask.sum() / count))
    numbers = jnp.arange(count, dtype=jnp.int32)
    nothing = jnp.zeros((count, 3), pixels.dtype)

    def pull(_: int, pixels: Array) -> Array:
        cell, within = _cells(pixels, height, width)
        at = jnp.where(within, cell, height * width)
        # Of several points in a pixel, the last one counts.
        owner = jnp.full(height * width + 1, -1, jnp.int32).at[at].max(numbers)[:-1]
        occupied = (owner >= 0).reshape(mask.shape)
        point = owner[nearest_pixels(occupied).ravel()]
        squared = jnp.square(pixels[point] - centres).sum(axis=1)
        pulls = mask.ravel() & (squared > jnp.square(far))
        weighted = jnp.pad(centres, ((0, 0), (0, 1)), constant_values=1)
        total = nothing.at[point].add(jnp.where(pulls[:, None], weighted, 0))
        mean = total[:, :2] / jnp.maximum(total[:, 2:], 1)
        return pixels + STEP * jnp.where(total[:, 2:] > 0, mean - pixels, 0)

    return jax.lax.fori_loop(0, ROUNDS, pull, pixels)


def _half_widths(mask: Bool[Array, "h w"]) -> Float[Array, "h w"]:
    """The largest distance to a pixel outside the mask, over 5x5 pixels around each pixel."""
    rows, columns = jnp.mgrid[: mask.shape[0], : mask.shape[1]]
    outside = nearest_pixels(~mask)
    gap = jnp.hypot(outside // mask.shape[1] - rows, outside % mask.shape[1] - columns)
    return jax.lax.reduce_window(gap, -jnp.inf, jax.lax.max, (5, 5), (1, 1), "SAME")


def _thinned(
    pixels: Float[Array, "n 2"], depth: Float[Array, " n"], half_widths: Array, focal: Array
) -> Float[Array, " n"]:
    """Depths near the mean of their neighbours, by the rule of the module for placed photos."""
    half = half_widths.ravel()[_cells(pixels, *half_widths.shape)[0]]
    reach = jnp.maximum(NARROWEST, half)[:, None]
    near = jnp.square(pixels[:, None] - pixels[None]).sum(axis=-1) <= jnp.square(reach)
    middle = jnp.where(near, depth[None], 0).sum(axis=1) / near.sum(axis=1)
    most = DEEPEST * half * middle / focal
    return jnp.clip(depth, middle - most, middle + most)


def _without_tails(pixels: Float[Array, "n 2"], depth: Float[Array, " n"]) -> Float[Array, " n"]:
    """Depths after step 3 of the module."""
    near = jnp.square(pixels[:, None] - pixels[None]).sum(axis=-1) < NEIGHBOURHOOD**2
    few = TAIL * near.sum(axis=1)
    before = (near & (depth[None] < depth[:, None])).sum(axis=1)
    behind = (near & (depth[None] > depth[:, None])).sum(axis=1)
    kept = near & ((before >= few) & (behind >= few))[None]
    least = jnp.where(kept, depth[None], jnp.inf).min(axis=1)
    most = jnp.where(kept, depth[None], -jnp.inf).max(axis=1)
    return jnp.where(kept.any(axis=1), jnp.clip(depth, least, most), depth)

"""Resampling of images (uint8 [h, w, 3]), masks (bool [h, w]) and depth maps on the host.

`resize_image`, `resize_mask` and `resize_depth` change the size. For augmentations, `stretch` and
`recrop` resample an image with its mask. If the background is plain grey, we compute only the
object's box, which is faster: masks are the same, colours may differ by 1 at rounding ties.
"""

import functools
import math
from typing import Any

import numpy as np
from PIL import Image

from psgn_jax.data import schema

# Distance from the mask, in pixels, within which interpolated colours may show the object.
_EDGE = 2
_NEAREST, _BILINEAR = Image.Resampling.NEAREST, Image.Resampling.BILINEAR
_GREY = (schema.BACKGROUND_GREY,) * 3


def box_of(mask: np.ndarray) -> tuple[int, int, int, int]:
    """Box (top, bottom, left, right) of a non-empty mask; bottom and right are exclusive."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1


def on_mask(mask: np.ndarray, image: np.ndarray, other: np.ndarray | np.uint8) -> np.ndarray:
    """`image` [h, w, 3] on the mask [h, w], `other` elsewhere."""
    # With one value for each byte, NumPy takes a quarter of the time of `image[~mask] = other`.
    return np.where(mask.repeat(3, axis=1).reshape(image.shape), image, other)


@functools.lru_cache(maxsize=16)
def _area_weights(old: int, new: int) -> np.ndarray:
    """Matrix [new, old] with the fraction of each new cell that each old cell covers."""
    edges = np.arange(new + 1) * (old / new)
    cells = np.arange(old)
    overlap = np.minimum(edges[1:, None], cells + 1) - np.maximum(edges[:-1, None], cells)
    return (np.maximum(overlap, 0) * (new / old)).astype(np.float32)


def _whole_factors(old: tuple[int, ...], new: tuple[int, int]) -> tuple[int, int] | None:
    down, across = old[0] // new[0], old[1] // new[1]
    return (down, across) if (down * new[0], across * new[1]) == old[:2] else None


def _area_average(array: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Averages [H, W, ...] over the areas of the new cells, in float32, for any scale factors."""
    rows = _area_weights(array.shape[0], size[0])
    columns = _area_weights(array.shape[1], size[1])
    down = np.tensordot(rows, array.astype(np.float32), 1)
    return np.swapaxes(np.tensordot(columns, down, ((1,), (1,))), 0, 1)


def resize_image(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Resizes uint8 [H, W, 3] to `size` (H', W') by area averaging."""
    if image.shape[:2] == tuple(size):
        return image
    if factors := _whole_factors(image.shape, size):
        return np.asarray(Image.fromarray(image).reduce(factors[::-1]))
    return np.rint(_area_average(image, size)).astype(np.uint8)


def resize_mask(mask: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Resizes bool [H, W] to `size` (H', W') by the majority of the area; a tie gives True."""
    if mask.shape == tuple(size):
        return mask
    if factors := _whole_factors(mask.shape, size):
        levels = Image.fromarray(mask.astype(np.uint8) * np.uint8(255)).reduce(factors[::-1])
        return np.asarray(levels) > 127  # a tie, 127.5, is rounded up
    return _area_average(mask, size) > 0.5 - 1e-6


def smooth_mask(mask: np.ndarray, size: tuple[int, ...]) -> np.ndarray:
    """Resizes a photo's mask, bool or probabilities [h, w], by a bilinear filter; True from .5."""
    is_mask = mask.dtype == np.bool_
    if is_mask and mask.shape == tuple(size):
        return mask
    scaled = mask * np.uint8(255) if is_mask else np.rint(255 * mask)
    levels = Image.fromarray(scaled.astype(np.uint8))
    return np.asarray(levels.resize((size[1], size[0]), _BILINEAR)) > 127


def resize_depth(depth: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Resizes a depth map [H, W] (0 = none) to the size of a resized mask.

    Depths are not averaged, because averages across an edge are wrong. A new pixel takes the depth
    at its centre, or else the first depth at the centres of its four quarters, which fills holes
    narrower than a new pixel. The result is 0 outside the mask.
    """
    if depth.shape == mask.shape:
        return np.where(mask, depth, np.float32(0))
    out = np.zeros(mask.shape, np.float32)
    for y, x in ((0.5, 0.5), (0.25, 0.25), (0.25, 0.75), (0.75, 0.25), (0.75, 0.75)):
        rows = ((np.arange(mask.shape[0]) + y) * depth.shape[0] / mask.shape[0]).astype(np.intp)
        columns = ((np.arange(mask.shape[1]) + x) * depth.shape[1] / mask.shape[1]).astype(np.intp)
        out = np.where(out > 0, out, depth[rows[:, None], columns])
    return np.where(mask, out, np.float32(0))


def stretch(
    image: np.ndarray, mask: np.ndarray, source: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Image and mask of `augment.stretch`; `source` has the ascending coordinates of new columns.

    The centre of column i is i + 0.5. Interpolation weights are rounded to 1/256.
    """
    rows, part = slice(None), slice(None)
    if window := _window(image, mask):
        first, last = np.searchsorted(source, (window[1].start - 0.5, window[1].stop + 0.5))
        rows, part = window[0], slice(first, last)
    new, moved = np.full_like(image, schema.BACKGROUND_GREY), np.zeros_like(mask)
    source = source[part]
    moved[rows, part], vacated = take_nearest(mask[rows], source)
    new[rows, part] = _columns(image[rows], source)
    new[:, part][:, vacated] = schema.BACKGROUND_GREY
    return new, moved


def take_nearest(plane: np.ndarray, source: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The columns of a plane [h, w] nearest to `source`, 0 outside; and which are outside."""
    nearest = np.floor(source).astype(np.intp)
    outside = (nearest < 0) | (nearest >= plane.shape[1])
    taken = plane.take(np.clip(nearest, 0, plane.shape[1] - 1), axis=1)
    taken[:, outside] = 0
    return taken, outside


def recrop(
    image: np.ndarray, mask: np.ndarray, factor: float, offset: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Image and mask of `augment.recrop`: row i moves to `factor * i + offset[0]`.

    The object must stay inside the image.
    """
    size = mask.shape
    moved = resample(mask.astype(np.uint8), size, factor, offset).astype(np.bool_)
    if window := _window(image, mask):
        return _recrop_window(image, window, factor, offset), moved
    return resample(image, size, factor, offset, _BILINEAR, _GREY), moved


def resample(
    plane: np.ndarray,
    size: tuple[int, ...],
    factor: float,
    offset: tuple[float, float],
    how: Image.Resampling = _NEAREST,
    fill: Any = 0,
) -> np.ndarray:
    """Resamples a plane to `size`: pixel i moves to `factor * i + offset` (down, right)."""
    down, right = offset
    inverse = (1 / factor, 0, -right / factor, 0, 1 / factor, -down / factor)
    picture = Image.fromarray(plane).transform(
        (size[1], size[0]), Image.Transform.AFFINE, inverse, how, fillcolor=fill
    )
    return np.asarray(picture)


def _recrop_window(
    image: np.ndarray, window: tuple[slice, slice], factor: float, offset: tuple[float, float]
) -> np.ndarray:
    """The image of `recrop`, from the window and one pixel around it."""
    sources, targets, moves = [], [], []
    for part, side, move in zip(window, image.shape[:2], offset, strict=True):
        low = factor * (part.start - 1) + move
        begin = max(0, math.floor(low))
        sources.append(slice(part.start - 1, part.stop + 1))
        targets.append(slice(begin, min(side, math.ceil(factor * (part.stop + 1) + move))))
        moves.append(low - begin)
    source, target, (down, right) = tuple(sources), tuple(targets), moves
    new = np.full_like(image, schema.BACKGROUND_GREY)
    size = new[target].shape[:2]
    new[target] = resample(image[source], size, factor, (down, right), _BILINEAR, _GREY)
    return new


def _window(image: np.ndarray, mask: np.ndarray) -> tuple[slice, slice] | None:
    """Rows and columns of the object with its edge, if all other pixels are plain grey.

    None if they are not, or if the window would touch the border of the image.
    """
    if not mask.any():
        return None
    top, bottom, left, right = box_of(mask)
    top, bottom, left, right = top - _EDGE, bottom + _EDGE, left - _EDGE, right + _EDGE
    if top < 1 or left < 1 or bottom >= mask.shape[0] or right >= mask.shape[1]:
        return None
    middle = image[top:bottom]
    for part in (image[:top], image[bottom:], middle[:, :left], middle[:, right:]):
        if (part != schema.BACKGROUND_GREY).any():
            return None
    return slice(top, bottom), slice(left, right)


def _columns(image: np.ndarray, source: np.ndarray) -> np.ndarray:
    """Colours interpolated at the column coordinates `source`; the edge is repeated outside."""
    left = np.floor(source - 0.5).astype(np.intp)
    weight = np.rint((source - 0.5 - left) * 256).astype(np.uint16).repeat(3)
    # Gathering single bytes is several times faster than gathering triples.
    flat = image.reshape(len(image), -1)
    lower = _take_columns(flat, left).astype(np.uint16)
    upper = _take_columns(flat, left + 1).astype(np.uint16)
    lower *= 256 - weight
    upper *= weight
    lower += upper
    lower += 128
    lower >>= 8
    return lower.astype(np.uint8).reshape(len(image), len(source), 3)


def _take_columns(flat: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """Columns of an image [h, w * 3]; the edge is repeated outside."""
    columns = np.clip(columns, 0, flat.shape[1] // 3 - 1)
    return flat.take((columns[:, None] * 3 + np.arange(3)).reshape(-1), axis=1)

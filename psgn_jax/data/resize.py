"""Resizing of images, masks and depth maps on the host."""

import functools

import numpy as np
from PIL import Image


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
    """Resizes a photo's mask, bool [h, w], by a bilinear filter: smooth edges when enlarging."""
    if mask.shape == tuple(size):
        return mask
    levels = Image.fromarray(mask.astype(np.uint8) * np.uint8(255))
    return np.asarray(levels.resize((size[1], size[0]), Image.Resampling.BILINEAR)) > 127


def resize_depth(depth: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Resizes a depth map [H, W] (0 or non-finite = none) to a mask that is already resized.

    Depths are not averaged, because an average across an edge is wrong. Each new pixel takes the
    depth of the old pixel at its centre, or else the first one at the centres of its four quarters,
    which fills holes narrower than a new pixel. The result is 0 outside the mask.
    """
    depth = np.where(np.isfinite(depth), depth, np.float32(0))
    if depth.shape == mask.shape:
        return np.where(mask, depth, np.float32(0))
    out = np.zeros(mask.shape, np.float32)
    for y, x in ((0.5, 0.5), (0.25, 0.25), (0.25, 0.75), (0.75, 0.25), (0.75, 0.75)):
        rows = ((np.arange(mask.shape[0]) + y) * depth.shape[0] / mask.shape[0]).astype(np.intp)
        columns = ((np.arange(mask.shape[1]) + x) * depth.shape[1] / mask.shape[1]).astype(np.intp)
        out = np.where(out > 0, out, depth[rows[:, None], columns])
    return np.where(mask, out, np.float32(0))

"""Resizing of images, masks and depth maps on the host."""

import numpy as np
from PIL import Image


def _area_average(picture: Image.Image, size: tuple[int, int]) -> np.ndarray:
    height, width = size
    across, across_rest = divmod(picture.width, width)
    down, down_rest = divmod(picture.height, height)
    if not across_rest and not down_rest:
        return np.asarray(picture.reduce((across, down)))
    return np.asarray(picture.resize((width, height), Image.Resampling.BOX))


def resize_image(image: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Resizes uint8 [H, W, 3] to `size` (H', W') by area averaging (repeats pixels to enlarge)."""
    if image.shape[:2] == tuple(size):
        return image
    return _area_average(Image.fromarray(image), size)


def resize_mask(mask: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Resizes bool [H, W] to `size` (H', W') by majority of the area; a tie counts as object."""
    if mask.shape == tuple(size):
        return mask
    coverage = _area_average(Image.fromarray(mask.view(np.uint8) * np.uint8(255)), size)
    return coverage >= 127  # 127.5 is the tie, whichever way it was rounded


def resize_depth(depth: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Resizes a depth map [H, W] (0 = none) to the size of an already resized mask.

    Depths are never averaged across an edge: each pixel takes the depth nearest to its centre, or
    where that is background, the first depth found at the centres of its four quarters. Outside
    `mask` the result is 0; inside it may be 0 where all five places lack a depth.

    Args:
      depth: float32 [H, W].
      mask: bool [H', W'].

    Returns:
      float32 [H', W'].
    """
    if depth.shape == mask.shape:
        return np.where(mask, depth, np.float32(0))
    out = np.zeros(mask.shape, np.float32)
    for y, x in ((0.5, 0.5), (0.25, 0.25), (0.25, 0.75), (0.75, 0.25), (0.75, 0.75)):
        rows = ((np.arange(mask.shape[0]) + y) * depth.shape[0] / mask.shape[0]).astype(np.intp)
        columns = ((np.arange(mask.shape[1]) + x) * depth.shape[1] / mask.shape[1]).astype(np.intp)
        out = np.where(out > 0, out, depth[rows[:, None], columns])
    return np.where(mask, out, np.float32(0))

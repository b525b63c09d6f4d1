"""Finds the mask of the object in a photo.

There are three methods; "auto" tries them in this order:

- `alpha`: the alpha channel of the file.
- `plain`: a background of one colour, as in the renderings for training and in product photos. If
  the background is shaded and OpenCV is installed, `grabcut` comes first, unless its result is
  doubtful.
- `grabcut`: the best of several GrabCuts by OpenCV (extra `photo`), see `data.segmentation`. It
  warns if its result is doubtful.
"""

import importlib.util
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageFilter
from scipy import ndimage

from psgn_jax.data.photo import PhotoError
from psgn_jax.data.resize import smooth_mask

METHODS = ("auto", "alpha", "plain", "grabcut")

DOUBT = (
    "the mask was guessed from the photo's colours and is doubtful (estimated overlap with the "
    "object {:.0%}): correct it with the brush of the demo, or give one with --mask"
)

# `plain` searches a shaded or lossy image on a copy with at most this many pixels per side.
_SEARCH_SIDE = 512
# `plain`: the fraction of the border that must be background, and the maximum deviation from the
# background colour.
_BORDER_SHARE, _LARGEST_DEVIATION = 0.97, 24
# `plain`: the deviation from the background that JPEG causes near an object, and the threshold for
# lossy images. The number of pixels with a deviation of 1 or 2 is divided by the number of pixels
# of the outline. The image is lossy if this ratio exceeds the threshold. It is below .31 on 100
# lossless renderings and above .98 on 30 JPEGs (quality 70 to 95).
_JPEG_DEVIATION, _JPEG_SHARE = 12, 0.6
_EXACT = 1  # `plain`: the largest deviation of the border of an unshaded background
_AGREEMENT = 0.7  # the least IoU of the masks of two methods that agree
_SMALLEST, _LARGEST = 0.0005, 0.97  # fraction of the image that an object may cover


class FoundMask(NamedTuple):
    """The mask of an object.

    Attributes:
      mask: bool [h, w].
      method: one of `METHODS`.
      doubt: why the mask is probably wrong, and what to do, in one line; "" if it is not in doubt.
    """

    mask: np.ndarray
    method: str
    doubt: str = ""


def find_mask(
    image: np.ndarray, alpha: np.ndarray | None = None, method: str = "auto"
) -> FoundMask:
    """Finds the object.

    Args:
      image: uint8 [h, w, 3] RGB.
      alpha: uint8 [h, w] or None, see `photo.useful_alpha`.
      method: one of `METHODS`.

    Raises:
      PhotoError: no object was found; the message says what the user can do.
      ValueError: an unknown method.
    """
    if method not in METHODS:
        raise ValueError(f"method={method!r}: accepted: {', '.join(METHODS)}")
    if alpha is not None and method in ("auto", "alpha"):
        if (alpha > 127).mean() < _SMALLEST:
            raise PhotoError("the image is transparent all over, expected an object")
        return FoundMask(alpha > 127, "alpha")
    has_opencv = _has_opencv()
    mask = plain(image) if method in ("auto", "plain") else None
    cut = None
    if mask is not None and not _SMALLEST <= mask.mean() <= _LARGEST:
        mask = None
    if has_opencv and method != "plain" and (mask is None or _is_shaded(image)):
        cut = _by_colours(image)
    if mask is not None:
        if cut is None:
            return FoundMask(mask, "plain")
        if cut.doubt:
            agree = mask_iou(mask, cut.mask) >= _AGREEMENT
            return FoundMask(mask, "plain", "" if agree else cut.doubt)
    if cut is not None:
        return cut
    remedy = "give a mask"
    if not has_opencv and method == "auto":
        remedy += ", or pip install 'psgn-jax[photo]' for GrabCut"
    elif not has_opencv and method == "grabcut":
        remedy = "grabcut needs the extra 'photo'"
    raise PhotoError(f"no object found ({method}); {remedy}")


def _has_opencv() -> bool:
    return importlib.util.find_spec("cv2") is not None


def looks_inverted(mask: np.ndarray) -> bool:
    """Whether a mask [h, w] looks inverted: it covers the border but not the middle.

    The mask contains at least 90 % of the border, and less than half of the middle ninth.
    """
    height, width = mask.shape
    middle = mask[height // 3 : -(height // 3) or None, width // 3 : -(width // 3) or None]
    return bool(_border(mask).mean() >= 0.9 and middle.mean() < 0.5)


def plain(image: np.ndarray) -> np.ndarray | None:
    """The pixels that differ from a background of one colour, or None without such a background."""
    colour, spread = _background(image)
    if spread > _LARGEST_DEVIATION / 2:
        return None
    limit = min(2 * spread + 4, _LARGEST_DEVIATION)
    if spread <= _EXACT:
        deviation = _deviation(image, colour)
        mask = deviation > 2
        weak = int(((deviation > 0) & (deviation <= 2)).sum())
        if weak <= _JPEG_SHARE * int((mask & ~_eroded(mask, 3)).sum()):
            return mask  # lossless: all pixels of another colour show the object
        limit = _JPEG_DEVIATION
    factor = -(-max(image.shape[:2]) // _SEARCH_SIDE)
    small = image if factor == 1 else np.asarray(Image.fromarray(image).reduce(factor))
    deviation = _deviation(small, colour)
    near = deviation <= limit
    outside = near.copy()
    outside[1:-1, 1:-1] = False
    if spread <= _EXACT:  # the background is visible through holes
        outside |= _eroded(deviation <= 2, 5)
    mask = ~ndimage.binary_propagation(outside & near, mask=near)
    # A 3x3 majority filter removes specks and keeps edges.
    count = ndimage.correlate(mask.astype(np.uint8), np.ones((3, 3), np.uint8), mode="nearest")
    return smooth_mask(count > 4, image.shape[:2])


def _border(plane: np.ndarray) -> np.ndarray:
    return np.concatenate([plane[0], plane[-1], plane[1:-1, 0], plane[1:-1, -1]])


def _background(image: np.ndarray) -> tuple[np.ndarray, float]:
    """The colour of the border, and the deviation from it that 97 % of the border do not exceed."""
    border = _border(image).astype(int)
    colour = np.median(border, axis=0).astype(int)
    deviation = np.abs(border - colour).max(axis=1)
    return colour, float(np.quantile(deviation, _BORDER_SHARE))


def _is_shaded(image: np.ndarray) -> bool:
    return _background(image)[1] > _EXACT


def _eroded(mask: np.ndarray, side: int) -> np.ndarray:
    """The pixels whose square of this side is on the mask."""
    levels = Image.fromarray(mask.astype(np.uint8)).filter(ImageFilter.MinFilter(side))
    return np.asarray(levels) > 0


def _deviation(image: np.ndarray, colour: np.ndarray) -> np.ndarray:
    """The largest difference of a channel from `colour`, at each pixel."""
    return np.abs(image.astype(np.int16) - colour.astype(np.int16)).max(axis=2)


def mask_iou(one: np.ndarray, other: np.ndarray) -> float:
    """Intersection over union of two masks, bool [h, w]; 0 if both are empty."""
    return float((one & other).sum() / max((one | other).sum(), 1))


def _by_colours(image: np.ndarray) -> FoundMask | None:
    """The mask from the colours, None without an object. Needs OpenCV."""
    from psgn_jax.data import segmentation

    found = segmentation.segment(image)
    if found is None:
        return None
    mask = smooth_mask(found.mask, image.shape[:2])
    if not _SMALLEST <= mask.mean() <= _LARGEST:
        return None
    doubt = DOUBT.format(found.score) if found.score < segmentation.DOUBTFUL else ""
    return FoundMask(mask, "grabcut", doubt)

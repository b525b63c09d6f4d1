"""Finds the mask of the object in a photo. Only this file imports rembg (extra `photo`).

There are four methods; "auto" tries them in this order:

- `alpha`: the alpha channel of the file.
- `plain`: a background of one colour, as in the renderings for training and in product photos. If
  the background is shaded and OpenCV is installed, `grabcut` comes first, unless its result is
  doubtful.
- `rembg`: a segmentation network, if the package and its weights are installed. Weights are never
  downloaded here.
- `grabcut`: the best of several GrabCuts by OpenCV, see `data.segmentation`. It warns if its result
  is doubtful.
"""

import importlib.util
import os
import pathlib
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageFilter

from psgn_jax.data.photo import PhotoError, resize_mask

METHODS = ("auto", "alpha", "plain", "rembg", "grabcut")

DOUBT = (
    "the mask was guessed from the photo's colours and is doubtful (estimated overlap with the "
    "object {:.0%}): correct it with the brush of the demo, give one with --mask, or install rembg"
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
_WEIGHTS = "u2net"


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
      alpha: uint8 [h, w] or None.
      method: one of `METHODS`.

    Raises:
      PhotoError: no object was found; the message says what the user can do.
      ValueError: an unknown method.
    """
    if method not in METHODS:
        raise ValueError(f"method={method!r}: accepted: {', '.join(METHODS)}")
    missing: list[str] = []
    for name in METHODS[1:]:
        if method not in ("auto", name):
            continue
        doubt = ""
        if name == "alpha":
            mask = None if alpha is None else alpha > 127
        elif name == "plain":
            mask = plain(image)
            if mask is not None and method == "auto" and _is_shaded(image) and _has_opencv():
                found = _by_colours(image)
                if found is not None and not found.doubt:
                    return found
                if found is not None and mask_iou(mask, found.mask) < _AGREEMENT:
                    doubt = found.doubt
        elif name == "rembg":
            if not has_rembg():
                missing.append(name)
                continue
            mask = _rembg(image)
        else:
            if not _has_opencv():
                missing.append(name)
                continue
            found = _by_colours(image)
            mask, doubt = (None, "") if found is None else (found.mask, found.doubt)
        if (
            mask is not None
            and mask.mean() >= _SMALLEST
            and (mask.mean() <= _LARGEST or name == "alpha")
        ):
            return FoundMask(mask, name, doubt)
        if mask is not None and name == "alpha":
            raise PhotoError("the image is transparent all over, expected an object")
    if method == "auto" and "grabcut" in missing:
        remedy = "give a mask, or pip install 'psgn-jax[photo]' for GrabCut"
    elif method in missing:
        remedy = f"{method} needs the extra 'photo'" + (
            f" and its weights in {_rembg_weights()}" if method == "rembg" else ""
        )
    else:
        remedy = "give a mask"
    raise PhotoError(f"no object found ({method}); {remedy}")


def looks_inverted(mask: np.ndarray) -> bool:
    """Whether a mask [h, w] looks inverted: it covers the border but not the middle.

    The mask contains at least 90 % of the border, and less than half of the middle ninth.
    """
    border = np.concatenate([mask[0], mask[-1], mask[1:-1, 0], mask[1:-1, -1]])
    height, width = mask.shape
    middle = mask[height // 3 : -(height // 3) or None, width // 3 : -(width // 3) or None]
    return bool(border.mean() >= 0.9 and middle.mean() < 0.5)


def plain(image: np.ndarray) -> np.ndarray | None:
    """The pixels that differ from a background of one colour, or None without such a background."""
    colour, spread = _background(image)
    if spread > _LARGEST_DEVIATION / 2:
        return None
    limit = min(2 * spread + 4, _LARGEST_DEVIATION)
    if spread <= _EXACT:
        deviation = _deviation(image, colour)
        mask = deviation > 2
        if not _is_lossy(deviation, mask):  # all pixels of another colour show the object
            return mask
        limit = _JPEG_DEVIATION
    deviation = _deviation(_small(image), colour)
    near = deviation <= limit
    outside = near.copy()
    outside[1:-1, 1:-1] = False
    if spread <= _EXACT:  # the background is visible through holes
        outside |= _eroded(deviation <= 2, 5)
    mask = ~_flood(outside, near)
    return resize_mask(_majority(mask), image.shape[:2])


def _background(image: np.ndarray) -> tuple[np.ndarray, float]:
    """The colour of the border, and the deviation from it that 97 % of the border do not exceed."""
    border = np.concatenate([image[0], image[-1], image[1:-1, 0], image[1:-1, -1]]).astype(int)
    colour = np.median(border, axis=0).astype(int)
    deviation = np.abs(border - colour).max(axis=1)
    return colour, float(np.quantile(deviation, _BORDER_SHARE))


def _is_shaded(image: np.ndarray) -> bool:
    return _background(image)[1] > _EXACT


def _is_lossy(deviation: np.ndarray, mask: np.ndarray) -> bool:
    """Whether the background near an object deviates from its colour as it does in a JPEG."""
    weak = int(((deviation > 0) & (deviation <= 2)).sum())
    return weak > _JPEG_SHARE * int((mask & ~_eroded(mask, 3)).sum())


def _eroded(mask: np.ndarray, side: int) -> np.ndarray:
    """The pixels whose square of this side is on the mask."""
    levels = Image.fromarray(mask.astype(np.uint8)).filter(ImageFilter.MinFilter(side))
    return np.asarray(levels) > 0


def mask_iou(one: np.ndarray, other: np.ndarray) -> float:
    """Intersection over union of two masks, bool [h, w]; 0 if both are empty."""
    return float((one & other).sum() / max((one | other).sum(), 1))


def grabcut(image: np.ndarray) -> np.ndarray | None:
    """The mask from the colours (`data.segmentation`), None without an object. Needs OpenCV."""
    found = _by_colours(image)
    return None if found is None else found.mask


def _by_colours(image: np.ndarray) -> FoundMask | None:
    from psgn_jax.data import segmentation

    found = segmentation.segment(image)
    if found is None:
        return None
    doubt = DOUBT.format(found.score) if found.score < segmentation.DOUBTFUL else ""
    return FoundMask(resize_mask(found.mask, image.shape[:2]), "grabcut", doubt)


def _has_opencv() -> bool:
    return importlib.util.find_spec("cv2") is not None


def has_rembg() -> bool:
    """Returns whether rembg and its weights are installed."""
    return importlib.util.find_spec("rembg") is not None and _rembg_weights().is_file()


def _rembg_weights() -> pathlib.Path:
    home = os.environ.get("U2NET_HOME") or str(pathlib.Path.home() / ".u2net")
    return pathlib.Path(home) / f"{_WEIGHTS}.onnx"


def _rembg(image: np.ndarray) -> np.ndarray:
    import rembg

    levels = rembg.remove(image, session=rembg.new_session(_WEIGHTS), only_mask=True)
    return np.asarray(levels) > 127


def _deviation(image: np.ndarray, colour: np.ndarray) -> np.ndarray:
    """The largest difference of a channel from `colour`, at each pixel."""
    planes = [np.abs(image[..., i].astype(np.int16) - np.int16(colour[i])) for i in range(3)]
    return np.maximum(np.maximum(planes[0], planes[1]), planes[2])


def _small(image: np.ndarray) -> np.ndarray:
    factor = -(-max(image.shape[:2]) // _SEARCH_SIDE)
    return image if factor == 1 else np.asarray(Image.fromarray(image).reduce(factor))


def _flood(start: np.ndarray, passable: np.ndarray) -> np.ndarray:
    """The pixels that are connected to `start` through `passable` pixels (4-neighbours)."""
    reached = start & passable
    while True:
        before = int(reached.sum())
        # Sweeps in four directions; each propagates along whole rows or columns.
        for array, free in ((reached, passable), (reached.T, passable.T)):
            for lines in (range(1, len(array)), range(len(array) - 2, -1, -1)):
                step = 1 if lines.step > 0 else -1
                for i in lines:
                    array[i] |= array[i - step] & free[i]
        if int(reached.sum()) == before:
            return reached


def _majority(mask: np.ndarray) -> np.ndarray:
    """3x3 majority filter: removes specks and keeps edges."""
    padded = np.pad(mask, 1, mode="edge").astype(np.uint8)
    height, width = mask.shape
    count = sum(padded[i : i + height, j : j + width] for i in range(3) for j in range(3))
    return np.asarray(count) > 4

"""Finds the mask of the object in a photo.

Without a mask `NAME_mask.*` beside `NAME.jpg`, "auto" tries three methods in this order:

- `alpha`: the alpha channel of the file.
- `plain`: a background of exactly one colour, as in renderings and product photos.
- `network`: `models.mask_net`, with the parameters of the package. Of several objects, it shows the
  one nearest to the middle. It fails if it is not certain.
"""

import functools
import io
import pathlib
import zlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from PIL import Image, ImageFilter, PngImagePlugin
from scipy import ndimage

from psgn_jax.data import photo
from psgn_jax.data.framing import box_of
from psgn_jax.data.photo import PhotoError
from psgn_jax.data.resize import smooth_mask
from psgn_jax.models.mask_net import MaskNet
from psgn_jax.system.untrusted import kind_of
from psgn_jax.weights.mask import read_mask_network

METHODS = ("auto", "alpha", "plain", "network")

SIDE = 256
"""Height and width of the photo that the mask network sees, whatever its proportions."""
LEAST_CERTAINTY = 0.8
"""`certainty` below which the network's mask is not used (**ours**): 5 to 10 % of the masks, see
docs/journal.md, 2026-11-26."""
DOUBTFUL_BELOW = 0.9
"""`certainty` below which a warning says that the mask may be wrong."""
_DOUBTFUL = (
    "the mask may be wrong: look at NAME_view.png (in Python: cloud.mask); if it is, put your own, "
    "NAME_mask.png, beside the photo"
)
# A mask is doubtful, too, if it differs from the one that the network finds in this middle part of
# the photo. Where something else than the object was found, less of it is found again.
MIDDLE, LEAST_AGREEMENT = 0.85, 0.9

# `plain`: a lossy image is searched on a copy with at most this many pixels per side.
_SEARCH_SIDE = 512
# `plain`: the fraction of the border that must be background, up to this deviation.
_BORDER_SHARE, _EXACT = 0.97, 1
# `plain`: the deviation that JPEG causes near an object. An image is lossy if it has more pixels
# with a deviation of 1 or 2 than this share of the pixels of the outline: less than .31 on 100
# lossless renderings, more than .98 on 30 JPEGs (quality 70 to 95).
_JPEG_DEVIATION, _JPEG_SHARE = 12, 0.6
_SMALLEST, _LARGEST = 0.0005, 0.97  # fraction of the image that an object may cover
_INVERTED = 0.9  # fraction of the border that an inverted mask covers
# A border cuts an object off if this fraction of the longer side of its box is there. A part is
# large if it has this fraction of the largest one's pixels.
_CUT_OFF, _LARGE_PART = 0.1, 0.25
_NOTE = "psgn_jax result"  # key of a text in PNG files
_CLEARLY_BETTER = 0.2  # of an intersection over union


class FoundMask(NamedTuple):
    """The mask of an object, bool [h, w], where it is from, and warnings, a line each."""

    mask: np.ndarray
    method: str
    warnings: tuple[str, ...] = ()


class UncertainMaskError(PhotoError):
    """The network is not certain; `mask`, bool [h, w], is its proposal."""

    def __init__(self, message: str, mask: np.ndarray):
        super().__init__(message)
        self.mask = mask


def mask_of(
    read: photo.Photo,
    mask: photo.Source | None = None,
    method: str = "auto",
    *,
    invert: bool | None = None,
    accept: bool = False,
    label: int | Sequence[int] | None = None,
) -> FoundMask:
    """The mask of a photo: the given one; else with "auto" `NAME_mask.*` beside it; else found.

    Warnings say if the photo's border cuts the object off, and if the mask has two large parts.

    Args:
      mask: see `photo.read_mask`, also for `label`; None = automatic.
      method: see `find_mask`, also for `accept` and errors.
      invert: whether a given mask is white outside the object; None = if it covers the border.

    Raises:
      PhotoError: the mask cannot be used.
      ValueError: `invert` or `label` without a mask.
    """
    found = _given_or_found(read, mask, method, invert, accept, label)
    return found._replace(warnings=(*found.warnings, *_doubts(found)))


def _given_or_found(
    read: photo.Photo,
    mask: photo.Source | None,
    method: str,
    invert: bool | None,
    accept: bool,
    label: int | Sequence[int] | None,
) -> FoundMask:
    name, hint = "given", ""
    if mask is None and method == "auto" and read.path is not None:
        # A result that nobody has changed is not used.
        files = list(images_named(read.path.parent, f"{read.path.stem}_mask"))
        mask = next((file for file in files if not is_result(file)), None)
        name = mask.name if mask else name
        if files:
            hint = f"; {files[0].name}, beside the photo, is an unchanged proposal"
    if mask is None:
        for option, value in (("invert_mask", invert), ("mask_label", label)):
            if value is not None:
                raise ValueError(f"{option}: accepted only with a given mask")
        try:
            return find_mask(read.image, read.alpha, method, accept=accept)
        except UncertainMaskError as error:
            raise UncertainMaskError(f"{error}{hint}", error.mask) from None
    pixels, notes = photo.open_mask(mask, read, label)
    warnings = list(notes)
    if inverted := invert is None and label is None and _border(pixels).mean() >= _INVERTED:
        warnings.append("the mask covers the border: it was inverted")
    if invert or inverted:
        pixels = ~pixels
    if read.orientation > 1 and _fits_better_turned(read.image, pixels, read.orientation):
        pixels = photo.turned(pixels, read.orientation)
        warnings.append("the mask was turned as EXIF turns the photo, because it fits better so")
    return FoundMask(pixels, name, tuple(warnings))


def images_named(folder: pathlib.Path, stem: str) -> Iterator[pathlib.Path]:
    """The image files `stem.*` in a folder; HEIC last, which cannot be read."""
    for suffix in (*sorted(photo.SUFFIXES), *sorted(photo.HEIC)):
        for file in (folder / f"{stem}{suffix}", folder / f"{stem}{suffix.upper()}"):
            if file.is_file():
                yield file


def result_png(picture: np.ndarray) -> bytes:
    """A PNG file that `is_result` recognises."""
    stream, note = io.BytesIO(), PngImagePlugin.PngInfo()
    note.add_text(_NOTE, str(zlib.crc32(picture.tobytes())))
    Image.fromarray(picture).save(stream, "png", pnginfo=note, compress_level=1)
    return stream.getvalue()


def is_result(path: pathlib.Path) -> bool:
    """Whether a file was written as a result, and its pixels were not changed since."""
    try:
        if kind_of(path) is not None:
            return False
        with Image.open(path, formats=["PNG"]) as file:
            note = file.info.get(_NOTE)
            return note is not None and note == str(zlib.crc32(file.tobytes()))
    except Exception:  # whatever it is, it is no result
        return False


def find_mask(
    image: np.ndarray,
    alpha: np.ndarray | None = None,
    method: str = "auto",
    *,
    accept: bool = False,
) -> FoundMask:
    """Finds the object in an image, uint8 [h, w, 3] RGB.

    Args:
      alpha: uint8 [h, w], see `photo.useful_alpha`.
      method: one of `METHODS`.
      accept: whether the network's mask is returned even if it is not certain.

    Raises:
      UncertainMaskError: the network is not certain.
      PhotoError: no object was found.
      ValueError: an unknown method.
    """
    if method not in METHODS:
        raise ValueError(f"mask_from={method!r}: accepted: {', '.join(METHODS)}")
    if alpha is not None and method in ("auto", "alpha"):
        if (alpha > 127).mean() < _SMALLEST:
            raise PhotoError("the image is transparent all over, expected an object")
        return FoundMask(alpha > 127, "alpha")
    if method in ("auto", "plain"):
        mask = plain(image)
        if mask is not None and _SMALLEST <= mask.mean() <= _LARGEST:
            return FoundMask(mask, "plain")
    if method not in ("auto", "network"):
        lacking = {"alpha": "a transparent background", "plain": "a background of one colour"}
        raise PhotoError(f"no object found; mask_from={method} expects {lacking[method]}")
    p = probabilities(image)
    mask, certain = enlarged(p, image.shape[:2]), certainty(p)
    if not _SMALLEST <= mask.mean() <= _LARGEST:
        why = f"the network's mask covers {mask.mean():.3%} of the image"
        raise PhotoError(f"no object found: {why} (expected {_SMALLEST:.2%} to {_LARGEST:.0%})")
    percent = int(100 * certain)  # rounded down: what is refused never reads like what is accepted
    if certain < LEAST_CERTAINTY and not accept:
        raise UncertainMaskError(
            f"it is not certain which part is the object ({percent}%, expected at least "
            f"{LEAST_CERTAINTY:.0%}); give its mask, or set accept_mask",
            mask,
        )
    doubtful = certain < DOUBTFUL_BELOW or _in_the_middle(image, mask) < LEAST_AGREEMENT
    return FoundMask(mask, f"network, {percent}% certain", (_DOUBTFUL,) * doubtful)


def with_mask(image: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The image, grey and blue outside the mask."""
    grey = image.mean(axis=2, keepdims=True)
    return np.where(mask[..., None], image, 0.25 * grey + [60, 90, 160]).astype(np.uint8)


def _fits_better_turned(image: np.ndarray, mask: np.ndarray, orientation: int) -> bool:
    """Whether a mask fits the image better after it was turned as EXIF turns the photo.

    Programs that ignore EXIF make masks of the photo as it is stored. Of the same proportions, only
    the mask network tells them from masks of the upright photo.
    """
    other = photo.turned(mask, orientation)
    if other.shape != mask.shape or (other == mask).all():
        return False
    seen = enlarged(probabilities(image), mask.shape)
    return mask_iou(other, seen) > mask_iou(mask, seen) + _CLEARLY_BETTER


def probabilities(image: np.ndarray) -> np.ndarray:
    """The mask network's probabilities of the object, float32 [SIDE / 2, SIDE / 2].

    The image, uint8 [h, w, 3], is resized to `SIDE` x `SIDE`. We average with its mirror image.
    """
    picture = Image.fromarray(image)
    small = np.asarray(picture.resize((SIDE, SIDE), Image.Resampling.BILINEAR, reducing_gap=2))
    network, params = _network()
    one, other = (np.asarray(network(params, x)) for x in (small, small[:, ::-1]))
    return (one + other[:, ::-1]) / 2


def certainty(p: np.ndarray) -> float:
    """Expected intersection over union of the mask, p > .5, and the object; 0 without a mask.

    It is sum(p[p > .5]) / (count(p > .5) + sum(p[p <= .5])).
    """
    inside = p > 0.5
    return float(p[inside].sum() / (inside.sum() + p[~inside].sum() + 1e-9))


def _in_the_middle(image: np.ndarray, mask: np.ndarray) -> float:
    """IoU of the mask with the one that the network finds in the middle of the photo, there."""
    rows, columns = (slice(m := int((1 - MIDDLE) / 2 * n), n - m) for n in mask.shape)
    inner = image[rows, columns]
    return mask_iou(enlarged(probabilities(inner), inner.shape[:2]), mask[rows, columns])


def enlarged(p: np.ndarray, size: tuple[int, ...]) -> np.ndarray:
    """Where bilinearly resized probabilities exceed .5, bool [h, w]."""
    levels = Image.fromarray(np.rint(255 * p).astype(np.uint8))
    return np.asarray(levels.resize((size[1], size[0]), Image.Resampling.BILINEAR)) > 127


@functools.cache
def _network() -> tuple[Callable[..., jax.Array], Any]:
    params, _ = read_mask_network()

    def run(params: Any, image: jax.Array) -> jax.Array:
        return MaskNet().apply({"params": params}, image[None] / np.float32(255))[0]

    return jax.jit(run), jax.device_put(params)


def _doubts(found: FoundMask) -> Iterator[str]:
    """Warnings about a mask that shows a part of an object, or two objects."""
    mask = found.mask
    if not mask.any():
        return  # refused later
    sides = {"top": mask[0], "bottom": mask[-1], "left": mask[:, 0], "right": mask[:, -1]}
    top, bottom, left, right = box_of(mask)
    least = _CUT_OFF * max(bottom - top, right - left)
    cut = [side for side, line in sides.items() if line.sum() >= least]
    cropped = found.method == "alpha" and all(line.any() for line in sides.values())
    if cut and not cropped:  # a cut-out is often cropped to its object
        yield f"the photo's border cuts the object off ({', '.join(cut)}); expected all of it"
    parts, number = ndimage.label(mask, np.ones((3, 3)))
    if number > 1:
        *_, second, first = np.sort(np.bincount(parts.ravel())[1:])
        if second >= _LARGE_PART * first:
            yield "the mask has two large parts; expected those of one object"


def plain(image: np.ndarray) -> np.ndarray | None:
    """The pixels that differ from a background of one colour, or None without such a background."""
    border = _border(image).astype(int)
    colour = np.median(border, axis=0).astype(int)
    if np.quantile(np.abs(border - colour).max(axis=1), _BORDER_SHARE) > _EXACT:
        return None
    deviation = _deviation(image, colour)
    mask = deviation > 2
    weak = int(((deviation > 0) & (deviation <= 2)).sum())
    if weak <= _JPEG_SHARE * int((mask & ~_eroded(mask, 3)).sum()):
        return mask  # lossless: all pixels of another colour show the object
    factor = -(-max(image.shape[:2]) // _SEARCH_SIDE)
    small = image if factor == 1 else np.asarray(Image.fromarray(image).reduce(factor))
    deviation = _deviation(small, colour)
    near = deviation <= _JPEG_DEVIATION
    outside = near.copy()
    outside[1:-1, 1:-1] = False
    outside |= _eroded(deviation <= 2, 5)  # the background is visible through holes
    mask = ~ndimage.binary_propagation(outside & near, mask=near)
    # A 3x3 majority filter removes specks and keeps edges.
    count = ndimage.correlate(mask.astype(np.uint8), np.ones((3, 3), np.uint8), mode="nearest")
    return smooth_mask(count > 4, image.shape[:2])


def _border(plane: np.ndarray) -> np.ndarray:
    return np.concatenate([plane[0], plane[-1], plane[1:-1, 0], plane[1:-1, -1]])


def _eroded(mask: np.ndarray, side: int) -> np.ndarray:
    """The pixels whose square of this side is on the mask."""
    levels = Image.fromarray(mask.astype(np.uint8)).filter(ImageFilter.MinFilter(side))
    return np.asarray(levels) > 0


def _deviation(image: np.ndarray, colour: np.ndarray) -> np.ndarray:
    """Largest difference of a channel from `colour`, at each pixel."""
    return np.abs(image.astype(np.int16) - colour.astype(np.int16)).max(axis=2)


def mask_iou(one: np.ndarray, other: np.ndarray) -> float:
    """Intersection over union of two masks, bool [h, w]; 0 if both are empty."""
    return float((one & other).sum() / max((one | other).sum(), 1))

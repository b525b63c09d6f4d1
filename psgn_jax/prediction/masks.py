"""Finds the mask of the object in a photo.

Without a mask `NAME_mask.*` beside `NAME.jpg`, "auto" tries three methods in this order:

- `alpha`: the alpha channel of the file.
- `plain`: a background of exactly one colour, as in renderings and product photos.
- `network`: U2-Netp (`prediction.mask_networks`). It fails if it is not certain.

`rembg` is a model of the package rembg. Of several parts that a network finds, we take the one
nearest to the middle. A box or a point in the photo chooses another one.
"""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple, TypedDict, Unpack

import numpy as np
from PIL import Image, ImageFilter
from scipy import ndimage

from psgn_jax.config.experiment import ConfigError
from psgn_jax.data import photo
from psgn_jax.data.photo import PhotoError
from psgn_jax.data.resample import box_of, smooth_mask
from psgn_jax.prediction import mask_networks
from psgn_jax.prediction.photo_files import images_named, is_result

METHODS = ("auto", "alpha", "plain", "network", "rembg")
"""Also `rembg:MODEL`."""

LEAST_CERTAINTY, LEAST_IN_BOX = 0.8, 0.5
"""`certainty` below which U2-Netp's mask is not used (**ours**, see docs/journal.md). In a box, we
use a doubtful one with a warning: the user has chosen the object."""
DOUBTFUL_BELOW = 0.945
"""`certainty` below which a warning says that the mask may be wrong."""
BORDER = 0.02
"""It also says so if nobody has chosen the object, and the mask is at most this fraction of the
photo's larger side away from its border, as things behind the object often are."""
_HINTS = {"box": "box=x0,y0,x1,y1", "point": "point=x,y"}
# Pixels that are connected by probabilities above the first value belong to one part. Parts smaller
# than this fraction of the largest one are not taken for the object.
JOINED, LEAST_PART = 0.1, 0.1
# A part is under a point if it is at most this fraction of the larger side away from it.
REACH = 0.02
# The network sees the box of the object and these fractions of its larger side around it, each as
# it is and mirrored. We take the mask of which it is more certain.
MARGINS = (0.0, 0.2)
# Windows around a point that has no part under it, as fractions of the photo's sides.
WINDOWS = (0.6, 0.36)

# `alpha`: an object is translucent if less than this share of the pixels above `_FAINT` is opaque.
_FAINT, _OPAQUE_SHARE = 25, 0.2
# `plain`: a lossy image is searched on a copy with at most this many pixels per side.
_SEARCH_SIDE = 512
# `plain`: the fraction of the border that must be background, up to this deviation.
_BORDER_SHARE, _EXACT = 0.97, 1
# `plain`: the deviation that JPEG causes near an object. An image is lossy if it has more pixels
# with a deviation of 1 or 2 than this share of the pixels of the outline: less than .31 on 100
# lossless renderings, more than .98 on 30 JPEGs (quality 70 to 95).
_JPEG_DEVIATION, _JPEG_SHARE = 12, 0.6
_SMALLEST, _LARGEST = 0.0005, 0.97  # fraction of the image that an object may cover
_INVERTED = 0.9  # fraction of the border that an inverted mask covers, or
_INVERTED_WITHIN = 0.85  # of the photo, and half of the border: the object is small
# A border cuts an object off if this fraction of the longer side of its box is there. A part is
# large if it has this fraction of the largest one's pixels.
_CUT_OFF, _LARGE_PART = 0.1, 0.25
_REMBG = "u2net"  # rembg's own default
_CLEARLY_BETTER = 0.2  # of an intersection over union

Box = tuple[int, int, int, int]  # left, top, right, bottom


class FoundMask(NamedTuple):
    """The mask of an object, bool [h, w], where it is from, and warnings, a line each.

    `doubtful`: a network found it and is not certain.
    """

    mask: np.ndarray
    method: str
    warnings: tuple[str, ...] = ()
    doubtful: bool = False


class _Hints(NamedTuple):
    inside: np.ndarray  # pixels in the box, bool [h, w]
    crops: list[Box]  # what the network sees
    at: np.ndarray | None  # (row, column) of the point
    given: set[str]  # "box", "point"


class MaskOptions(TypedDict, total=False):
    """How a mask is read or found.

    Attributes:
      mask_from: a method of `METHODS`, or `rembg:MODEL`, if no mask is given.
      invert_mask: whether a given mask is dark on the object; default: if it covers the border.
      accept_mask: whether to use the mask network's mask even if it is not certain.
      mask_label: the object's label in a given mask with several, see `photo.read_mask`.
      box: left, top, right and bottom of a box around the object, in pixels of the upright photo
        in its full size.
      point: column and row of a pixel of the object, likewise.
    """

    mask_from: str
    invert_mask: bool | None
    accept_mask: bool
    mask_label: int | Sequence[int] | None
    box: Sequence[float] | None
    point: Sequence[float] | None


class UncertainMaskError(PhotoError):
    """The network is not certain; `mask`, bool [h, w], is its proposal."""

    def __init__(self, message: str, mask: np.ndarray):
        super().__init__(message)
        self.mask = mask


def find_mask(
    image: photo.Source | photo.Photo,
    mask: photo.Source | None = None,
    **options: Unpack[MaskOptions],
) -> FoundMask:
    """The mask of a photo: `mask`; without it, for "auto", `NAME_mask.*` beside it; else found.

    Warnings say if the mask may be wrong, if the photo's border cuts the object off, and if the
    mask has two large parts. With a box or a point, a mask beside the photo is not used.

    Raises:
      PhotoError: the photo or the mask cannot be used, or no object was found.
      UncertainMaskError: the network is not certain.
      ConfigError: an option is wrong or has no effect, or rembg cannot load its model.
    """
    read, name, note = photo.read_photo(image), "given", ""
    given: Any = {key: value for key, value in options.items() if value is not None}
    method = given.get("mask_from", "auto")
    check_method(method)
    for key in ("invert_mask", "accept_mask"):
        if not isinstance(given.get(key, False), bool | np.bool_):
            raise ConfigError(f"{key}={given[key]!r}: accepted: True or False")
    hint = next((key for key in ("box", "point") if key in given), None)
    if mask is not None and hint:
        raise ConfigError(f"{hint}: accepted only without a mask")
    if mask is None and method == "auto" and read.path is not None and not hint:
        # A result that nobody has changed is not used.
        files = images_named(read.path.parent, f"{read.path.stem}_mask")
        mask = next((file for file in files if not is_result(file)), None)
        name = mask.name if mask else name
        note = f"; {files[0].name}, beside the photo, is an unchanged proposal" if files else ""
    if mask is not None:
        found = _given(read, mask, name, given.get("invert_mask"), given.get("mask_label"))
    elif wrong := next((key for key in ("invert_mask", "mask_label") if key in given), None):
        raise ConfigError(f"{wrong}: accepted only with a given mask")
    else:
        hints, accept = _hints(read, given), given.get("accept_mask", False)
        seen = _by_background(read, method, hints)
        found = seen or _by_network(read, method, hints, accept, note)
    return found._replace(warnings=(*found.warnings, *_doubts(found)))


def _given(
    read: photo.Photo, mask: photo.Source, name: str, invert: bool | None, label: Any
) -> FoundMask:
    """A given mask, inverted or turned if it has to be."""
    pixels, warnings = photo.read_mask(mask, read, label), []
    if inverted := invert is None and label is None and _looks_inverted(pixels):
        warnings.append("the mask covers the border: it was inverted")
    if invert or inverted:
        pixels = ~pixels
    if read.orientation > 1 and _fits_better_turned(read.image, pixels, read.orientation):
        pixels = photo.turned(pixels, read.orientation)
        warnings.append("the mask was turned as EXIF turns the photo, because it fits better so")
    return FoundMask(pixels, name, tuple(warnings))


def check_method(method: str) -> None:
    """Raises `ConfigError` for an unknown method or a missing rembg."""
    name, colon, model = str(method).partition(":")
    if name not in METHODS or (colon and (name != "rembg" or not model)):
        raise ConfigError(f"mask_from={method!r}: accepted: {', '.join(METHODS)}, rembg:MODEL")
    if name == "rembg":
        mask_networks.rembg_session(model or _REMBG)


def _by_background(read: photo.Photo, method: str, hints: _Hints) -> FoundMask | None:
    """The mask by transparency or by a background of one colour; None if a network looks for it."""
    if read.alpha is not None and method in ("auto", "alpha"):
        mask = _chosen(visible(read.alpha), hints)
        if mask.mean() < _SMALLEST:
            raise PhotoError("the image is transparent all over, expected an object")
        return FoundMask(mask, "alpha")
    if method in ("auto", "plain") and (found := plain(read.image)) is not None:
        mask = _chosen(found, hints)
        if _SMALLEST <= mask.mean() <= _LARGEST:
            return FoundMask(mask, "plain")
    lacking = {"alpha": "a transparent background", "plain": "a background of one colour"}
    if method in lacking:
        raise PhotoError(
            f"no object found; mask_from={method} expects {lacking[method]}; try mask_from=auto"
        )
    return None


def visible(alpha: np.ndarray) -> np.ndarray:
    """The object in an alpha channel [h, w]: what is opaque or, of a glass, also what is faint."""
    opaque, faint = alpha > 127, alpha > _FAINT
    return faint if opaque.sum() < _OPAQUE_SHARE * faint.sum() else opaque


def _by_network(
    read: photo.Photo, method: str, hints: _Hints, accept: bool, note: str
) -> FoundMask:
    """The mask of one part that a network finds, where it is most certain.

    It looks at the crops that a box gives and, if no part is under a point, at smaller windows.
    """
    certain, mask = -1.0, hints.inside
    for crop in (*hints.crops, *_windows(hints)):
        if crop in hints.crops or certain <= 0:
            found = _in_crop(read.image, method, hints, crop)
            certain, mask = max((certain, mask), found, key=lambda each: each[0])
    if not _SMALLEST <= mask.mean() <= _LARGEST:
        raise PhotoError(
            f"no object found: the network's mask covers {mask.mean():.3%} of the image (expected "
            f"{_SMALLEST:.2%} to {_LARGEST:.0%}); give the object's mask, or another box or point"
        )
    if method.startswith("rembg"):
        return FoundMask(mask, method)
    percent = int(100 * certain)  # rounded down, so that a refused mask never prints 80 %
    others = [how for key, how in _HINTS.items() if key not in hints.given]
    least = LEAST_IN_BOX if "box" in hints.given else LEAST_CERTAINTY
    if certain < least and not accept:
        raise UncertainMaskError(
            f"it is not certain which part is the object ({percent}%, expected at least "
            f"{least:.0%}); give {', '.join([*others, 'its mask'])}, or accept this one "
            f"(accept_mask){note}",
            mask,
        )
    (height, width), (top, bottom, left, right) = mask.shape, box_of(mask)
    gap = min(top, left, height - bottom, width - right)
    unsure, near = certain < DOUBTFUL_BELOW, gap <= BORDER * max(mask.shape)
    why = "not certain" if unsure else "it nearly touches the border"
    give = f"give {' or '.join(others)}, or " if others else ""
    warning = (
        f"the mask may be wrong ({why}): look at the result *_overlay.png (in Python: cloud.mask); "
        f"if it is, {give}mend the result *_mask.png and put it beside the photo"
    )
    told = unsure or (near and not hints.given)
    return FoundMask(mask, f"network, {percent}% certain", (warning,) * told, unsure or near)


def _in_crop(image: np.ndarray, method: str, hints: _Hints, crop: Box) -> tuple[float, np.ndarray]:
    """`certainty` and mask, bool [h, w], of one part that a network finds in a crop of an image."""
    left, top, right, bottom = crop
    region, at = np.s_[top:bottom, left:right], hints.at
    if method.startswith("rembg"):
        model = method.partition(":")[2] or _REMBG
        p = mask_networks.by_rembg(np.ascontiguousarray(image[region]), model)
    else:
        p = mask_networks.probabilities(image, crop, both_ways="box" in hints.given)
    p = np.where(smooth_mask(hints.inside[region], p.shape), p, np.float32(0))
    scale = np.divide(p.shape, (bottom - top, right - left))
    part = part_of(p, None if at is None else (at - (top, left)) * scale)
    mask = np.zeros(image.shape[:2], bool)
    mask[region] = smooth_mask(np.where(part, p, 0), mask[region].shape)
    return certainty(p if at is None else np.where(part, p, 0), part), mask


def part_of(p: np.ndarray, at: Sequence[float] | np.ndarray | None = None) -> np.ndarray:
    """The part nearest to the middle of probabilities [h, w], or the one at (row, column): bool.

    A part consists of connected pixels above `JOINED`, and has a pixel above .5. The result is
    empty if there is none, or none at most `REACH` from `at`.
    """
    parts, count = ndimage.label(p > JOINED, np.ones((3, 3)))
    rows, columns = np.nonzero(p > 0.5)
    number = parts[rows, columns]
    areas = np.bincount(number, minlength=count + 1)
    middle = (np.array(p.shape) - 1) / 2 if at is None else np.asarray(at) - 0.5
    distance = np.hypot(rows - middle[0], columns - middle[1])
    if at is None:
        allowed = areas[number] >= LEAST_PART * areas.max()
    else:
        allowed = distance <= REACH * max(p.shape)
    if not allowed.any():
        return np.zeros(p.shape, bool)
    return parts == number[np.argmin(np.where(allowed, distance, np.inf))]


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
    height, width = mask.shape
    seen = smooth_mask(mask_networks.probabilities(image, (0, 0, width, height)), mask.shape)
    return mask_iou(other, seen) > mask_iou(mask, seen) + _CLEARLY_BETTER


def certainty(p: np.ndarray, part: np.ndarray) -> float:
    """Expected intersection over union of the mask and the object; 0 without a mask.

    The mask is p > .5 in the part. If each other pixel showed the object with its probability, the
    expectation were sum(p in the mask) / (area of the mask + sum(p elsewhere)).
    """
    inside = part & (p > 0.5)
    return float(p[inside].sum() / (inside.sum() + p[~inside].sum() + 1e-9))


def _hints(read: photo.Photo, options: MaskOptions) -> _Hints:
    size = width, height = read.image.shape[1::-1]
    scale = np.divide(size, read.size[::-1])
    inside, crops, at = np.ones((height, width), bool), [(0, 0, width, height)], None
    if (point := options.get("point")) is not None:
        x, y = _numbers("point", point, "x,y") * scale
        if not (0 <= x < width and 0 <= y < height):
            raise ConfigError(f"point={_shown(point)}: accepted: a place in the image")
        at = np.array([y, x])
    if (box := options.get("box")) is not None:
        corners = _numbers("box", box, "x0,y0,x1,y1").reshape(2, 2) * scale
        beyond = np.maximum(-corners, corners - size).max()
        low = np.clip(np.floor(corners[0]), 0, size).astype(int)
        high = np.clip(np.ceil(corners[1]), 0, size).astype(int)
        if min(high - low) < photo.MIN_SIDE or beyond > BORDER * max(size):
            raise ConfigError(
                f"box={_shown(box)}: accepted: x0,y0,x1,y1 in the image of {read.size[1]}x"
                f"{read.size[0]}, with at least {photo.MIN_SIDE} pixels a side"
            )
        inside[:] = False
        inside[low[1] : high[1], low[0] : high[0]] = True
        crops = []
        for margin in (round(share * int(max(high - low))) for share in MARGINS):
            (left, top), (right, bottom) = np.maximum(low - margin, 0), high + margin
            crops.append((int(left), int(top), min(width, int(right)), min(height, int(bottom))))
    return _Hints(inside, crops, at, _HINTS.keys() & options.keys())


def _numbers(name: str, hint: Sequence[float], form: str) -> np.ndarray:
    numbers = np.asarray(hint, float)
    if numbers.shape != (form.count(",") + 1,) or not np.isfinite(numbers).all():
        raise ConfigError(f"{name}={_shown(numbers)}: accepted: {form} in pixels of the photo")
    return numbers


def _shown(numbers: Sequence[float] | np.ndarray) -> str:
    return ",".join(f"{value:g}" for value in np.ravel(numbers))


def _windows(hints: _Hints) -> Iterator[Box]:
    """Smaller crops around a point, within the last one."""
    at = hints.at
    if at is None:
        return
    left, top, right, bottom = hints.crops[-1]
    for share in WINDOWS:
        wide, high = round(share * (right - left)), round(share * (bottom - top))
        x = int(np.clip(round(at[1] - wide / 2), left, right - wide))
        y = int(np.clip(round(at[0] - high / 2), top, bottom - high))
        yield x, y, x + wide, y + high


def _chosen(mask: np.ndarray, hints: _Hints) -> np.ndarray:
    """The mask in the box; of this the part at the point."""
    mask = mask & hints.inside
    return mask if hints.at is None else part_of(mask.astype(np.float32), hints.at)


def _looks_inverted(mask: np.ndarray) -> bool:
    border = _border(mask).mean()
    return bool(border >= _INVERTED or (border >= 0.5 and mask.mean() >= _INVERTED_WITHIN))


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

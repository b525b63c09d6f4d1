"""A photo becomes what a network was trained on: read from any file, object cropped and placed.

**Where training objects sit.** The authors scale an object to a bounding hemisphere of radius 1 and
look at it with one camera, so its place in the image follows from its proportions. In their 1,504
images (192x256) the mask's box, `h` x `w` pixels, keeps near the curve

    (w / 223)^4 + (h / 124)^4 = 1

(standard deviation of the scale about it 12 %): wide objects are some 220 pixels wide, tall ones
some 125 high. The box's middle lies at column 128 (sd 11) and at row 63 + 0.224 w (sd 14): a tall
object stands on the ground, whose origin is at row 124; of a wide one some lies nearer than that.
`place` puts an object's box onto that curve and that middle. Fitted by `((1.8 h)^4 + w^4)^(1/4)`
and least squares to the images that show at least 20 pixels of both sides.
"""

import dataclasses
import math
import os
import pathlib
import warnings
from typing import Any

import numpy as np
from PIL import Image, UnidentifiedImageError

from psgn_jax.config import UserError
from psgn_jax.data import camera, schema

VIEW_SIZE = (192, 256)
BOX_WIDTH, BOX_HEIGHT, BOX_POWER = 223.0, 124.0, 4
MIDDLE_COLUMN, MIDDLE_ROW, MIDDLE_ROW_PER_WIDTH = 128.0, 63.0, 0.224

MAX_PIXELS = 150_000_000
"""Larger images are refused before they are decoded: a small file may hold gigabytes."""

MAX_SIDE = 2048
"""A photo is reduced by a whole factor until its longer side is below twice this."""

MIN_SIDE = 16

_FORMATS = ("PNG", "JPEG", "MPO", "GIF", "BMP", "TIFF", "WEBP", "PPM", "TGA", "JPEG2000", "AVIF")
SUFFIXES = frozenset(
    f".{name}"
    for name in (
        *("png", "jpg", "jpeg", "gif", "bmp", "tif", "tiff", "webp", "ppm", "pgm", "tga", "jp2"),
        "avif",
    )
)
"""Names of the files that are taken from a folder."""
_ORIENTATION = 0x0112  # of EXIF
_TURNED = (5, 6, 7, 8)  # orientations that exchange width and height
_TRAINING_SPREAD = 1  # how far the border of a training rendering may be from its grey


class PhotoError(UserError):
    """An image or mask that cannot be used; one line says why."""


@dataclasses.dataclass(frozen=True, eq=False)
class Photo:
    """An image as read, upright.

    Attributes:
      image: uint8 [h, w, 3] RGB, possibly reduced.
      alpha: uint8 [h, w], or None where the file has none or it is opaque everywhere.
      size: (H, W) in the file, upright; `image` may be smaller.
      orientation: EXIF's number, 1 = as stored.
    """

    image: np.ndarray
    alpha: np.ndarray | None
    size: tuple[int, int]
    orientation: int


@dataclasses.dataclass(frozen=True, eq=False)
class View:
    """What a network sees of a photo, with its camera.

    Attributes:
      image: uint8 [192, 256, 3], grey 191 outside the mask.
      mask: bool [192, 256].
      intrinsics, extrinsics: the authors' camera for this view (`schema`: conventions).
      to_view: float64 [3, 3], homogeneous (column, row) of the array that was placed to those of
        the view. `inv(to_view) @ intrinsics` is the camera of that array.
      placed: False where the array was taken as framed.
    """

    image: np.ndarray
    mask: np.ndarray
    intrinsics: np.ndarray
    extrinsics: np.ndarray
    to_view: np.ndarray
    placed: bool


def read_photo(path: str | os.PathLike[str]) -> Photo:
    """Reads an image file of any usual format: the first frame, upright, as 8-bit RGB.

    EXIF's orientation is honoured; CMYK, palettes, grey and 16 bits are converted.

    Raises:
      PhotoError: no file, no image, damaged, larger than 150 million pixels or smaller than 16x16.
    """
    stored, orientation, size = _decode(path)
    picture, alpha = _to_rgb(stored)
    if alpha is not None and alpha.min() == 255:
        alpha = None
    upright = _turn(picture, orientation)
    return Photo(
        np.asarray(upright),
        None if alpha is None else np.asarray(_turn(Image.fromarray(alpha), orientation)),
        size[::-1] if orientation in _TURNED else size,
        orientation,
    )


def read_mask(path: str | os.PathLike[str], photo: Photo) -> np.ndarray:
    """Reads the mask of a photo: bool [h, w] of `photo.image`'s shape, True on the object.

    What is brighter than half of the largest value is object, so 0/1 serves as well as 0/255; of a
    file with transparency, what is not transparent. The mask may have another size in the same
    proportions. One of the size that the photo has before EXIF turns it is turned too.

    Raises:
      PhotoError: as `read_photo`; other proportions than the photo's; no object in it.
    """
    stored, orientation, size = _decode(path)
    picture, alpha = _to_rgb(stored)
    grey = np.asarray(picture.convert("L"))
    if alpha is not None and alpha.min() < 255:
        grey = alpha
    turn = orientation
    as_stored = photo.size[::-1] if photo.orientation in _TURNED else photo.size
    if orientation == 1 and photo.size != as_stored and _like(size, as_stored):
        turn = photo.orientation
    levels = np.asarray(_turn(Image.fromarray(grey), turn))
    upright = size[::-1] if turn in _TURNED else size
    if not _like(upright, photo.size):
        raise PhotoError(
            f"mask {path} is {upright[1]}x{upright[0]}: accepted: the image's "
            f"{photo.size[1]}x{photo.size[0]} or the same proportions"
        )
    if not levels.max():
        raise PhotoError(f"mask {path} is empty: no pixel of it is object")
    mask = levels > levels.max() / 2
    return resize_mask(mask, photo.image.shape[:2])


def resize_mask(mask: np.ndarray, size: tuple[int, ...]) -> np.ndarray:
    """Resizes bool [h, w] to `size`; smooth where it grows."""
    if mask.shape == tuple(size):
        return mask
    levels = Image.fromarray(mask.view(np.uint8) * np.uint8(255))
    return np.asarray(levels.resize((size[1], size[0]), Image.Resampling.BILINEAR)) > 127


def is_framed(image: np.ndarray) -> bool:
    """Whether an image is framed as those of the training: 4:3, on grey 191 all around."""
    if not _like(image.shape[:2], VIEW_SIZE):
        return False
    border = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]]).astype(int)
    near = np.abs(border - schema.BACKGROUND_GREY).max(axis=1) <= _TRAINING_SPREAD
    return bool(near.mean() > 0.97)


def place(image: np.ndarray, mask: np.ndarray, *, move: bool = True) -> View:
    """Crops and scales an object to where training objects sit (the module's rule).

    Args:
      image: uint8 [h, w, 3] RGB.
      mask: bool [h, w], True on the object.
      move: False takes the whole image as the frame; it must be 4:3.

    Raises:
      PhotoError: no object in the mask, too little of it, or a frame that is not 4:3.
      ValueError: arrays of another dtype or shape.
    """
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3:
        raise ValueError(f"image is {image.dtype} {list(image.shape)}: accepted: uint8 [h, w, 3]")
    if mask.dtype != np.bool_ or mask.shape != image.shape[:2]:
        raise ValueError(
            f"mask is {mask.dtype} {list(mask.shape)}: accepted: bool {list(image.shape[:2])}"
        )
    if not mask.any():
        raise PhotoError("the mask is empty: no pixel of it is object")
    height, width = VIEW_SIZE
    if move:
        top, bottom, left, right = _box(mask)
        wide, high = right - left, bottom - top
        if max(wide, high) < 8:
            raise PhotoError(f"the object is {wide}x{high} pixels: accepted: 8 or more")
        relative = (wide / BOX_WIDTH) ** BOX_POWER + (high / BOX_HEIGHT) ** BOX_POWER
        scale = relative ** (-1 / BOX_POWER)
        row = MIDDLE_ROW + MIDDLE_ROW_PER_WIDTH * wide * scale
        across = MIDDLE_COLUMN - scale * (left + right) / 2
        down = row - scale * (top + bottom) / 2
        to_view = np.array([[scale, 0, across], [0, scale, down], [0, 0, 1.0]])
    else:
        if not _like(image.shape[:2], VIEW_SIZE):
            raise PhotoError(
                f"the image is {image.shape[1]}x{image.shape[0]}: accepted as framed: 4:3, "
                f"such as {width}x{height}"
            )
        to_view = np.diag([width / image.shape[1], height / image.shape[0], 1.0])
    colours, inside = _resample(image, mask, to_view)
    if not inside.any():
        raise PhotoError("nothing of the object is left at the network's size")
    colours[~inside] = schema.BACKGROUND_GREY
    return View(colours, inside, *camera.default_camera(VIEW_SIZE), to_view, placed=move)


def _resample(
    image: np.ndarray, mask: np.ndarray, to_view: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Image and mask as the view sees them; each view pixel averages what it covers."""
    # Corners of the view in the array; the region is cut out with grey where the array ends.
    factors = 1 / np.diag(to_view)[:2]
    low = -to_view[:2, 2] * factors
    high = (np.array(VIEW_SIZE[::-1]) - to_view[:2, 2]) * factors
    first = np.floor(low).astype(int)
    last = np.ceil(high).astype(int)
    canvas = np.full((last[1] - first[1], last[0] - first[0], 3), schema.BACKGROUND_GREY, np.uint8)
    levels = np.zeros(canvas.shape[:2], np.uint8)
    begin = np.maximum(first, 0)
    end = np.minimum(last, image.shape[1::-1])
    source = np.s_[begin[1] : end[1], begin[0] : end[0]]
    target = np.s_[begin[1] - first[1] : end[1] - first[1], begin[0] - first[0] : end[0] - first[0]]
    levels[target] = mask[source].view(np.uint8) * np.uint8(255)
    # What is behind the object must not bleed into its edge: colours are weighted by the mask.
    rgba = np.dstack([canvas, levels])
    rgba[target][..., :3] = image[source]
    box = (*(low - first).tolist(), *(high - first).tolist())
    small = Image.fromarray(rgba).resize(VIEW_SIZE[::-1], Image.Resampling.BILINEAR, box=box)
    result = np.array(small)
    return result[..., :3].copy(), result[..., 3] > 127


def _box(mask: np.ndarray) -> tuple[int, int, int, int]:
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1


def _like(size: tuple[int, ...], other: tuple[int, ...]) -> bool:
    """Whether two (H, W) have the same proportions, but for a pixel or 1 %."""
    height = size[1] * other[0] / other[1]
    return abs(height - size[0]) <= max(1.0, 0.01 * size[0])


def _decode(path: str | os.PathLike[str]) -> tuple[Image.Image, int, tuple[int, int]]:
    """First frame as stored, EXIF's orientation, and (H, W) in the file."""
    if not pathlib.Path(path).is_file():
        raise PhotoError(f"{path}: no such file")
    Image.init()
    formats = [name for name in _FORMATS if name in Image.OPEN]
    try:
        # Pillow warns of odd metadata and of sizes that are bounded here.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with Image.open(path, formats=formats) as file:
                width, height = file.size
                if width * height > MAX_PIXELS:
                    raise PhotoError(
                        f"{path} is {width}x{height}: accepted: up to {MAX_PIXELS:,} pixels"
                    )
                if min(width, height) < MIN_SIDE:
                    raise PhotoError(
                        f"{path} is {width}x{height}: accepted: at least {MIN_SIDE} pixels a side"
                    )
                orientation = int(file.getexif().get(_ORIENTATION, 1) or 1)
                file.draft(file.mode, (MAX_SIDE, MAX_SIDE))  # a JPEG can be decoded smaller
                file.load()
                return file.copy(), orientation, (height, width)
    except PhotoError:
        raise
    except UnidentifiedImageError:
        raise PhotoError(f"{path} is no image of a known format") from None
    except Image.DecompressionBombError:
        raise PhotoError(f"{path} is too large: accepted: up to {MAX_PIXELS:,} pixels") from None
    except MemoryError:
        raise PhotoError(f"{path}: not enough memory to decode it") from None
    except Exception as error:  # decoders raise anything for damaged files
        why = " ".join(str(error).split())[:160] or type(error).__name__
        raise PhotoError(f"{path} is damaged or unreadable: {why}") from None


def _to_rgb(picture: Image.Image) -> tuple[Image.Image, np.ndarray | None]:
    """RGB and alpha, reduced until the longer side is below twice `MAX_SIDE`."""
    if picture.mode.startswith(("I", "F")):
        picture = Image.fromarray(_to_bytes(np.asarray(picture)))
    elif picture.has_transparency_data:
        picture = picture.convert("RGBA")
    elif picture.mode != "RGB":
        picture = picture.convert("RGB")
    factor = max(picture.size) // MAX_SIDE
    if factor > 1:
        # Never below the least side: an image may be a ribbon.
        picture = picture.reduce(max(1, min(factor, min(picture.size) // MIN_SIDE)))
    alpha = np.asarray(picture.getchannel("A")) if picture.mode == "RGBA" else None
    return picture.convert("RGB"), alpha


def _to_bytes(values: np.ndarray) -> np.ndarray:
    """Grey of 16 or 32 bits, or float, as 8 bits: 16 bits by their range, others by their own."""
    values = np.nan_to_num(values.astype(np.float64))
    top = values.max()
    if top <= 1:
        full = 1.0
    elif top <= 255:
        full = 255.0
    else:
        full = 65535.0 if top <= 65535 else top
    return np.rint(np.clip(values / full, 0, 1) * 255).astype(np.uint8)


def _turn(picture: Image.Image, orientation: int) -> Image.Image:
    """The picture upright, as EXIF's orientation says."""
    transpose = Image.Transpose
    method: Any = {
        2: transpose.FLIP_LEFT_RIGHT,
        3: transpose.ROTATE_180,
        4: transpose.FLIP_TOP_BOTTOM,
        5: transpose.TRANSPOSE,
        6: transpose.ROTATE_270,
        7: transpose.TRANSVERSE,
        8: transpose.ROTATE_90,
    }.get(orientation)
    return picture if method is None else picture.transpose(method)


def as_rgb_and_alpha(array: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
    """An image array of a notebook: uint8 [h, w], [h, w, 3] or [h, w, 4] to RGB and alpha.

    Raises:
      ValueError: any other dtype or shape.
    """
    if (
        array.dtype != np.uint8
        or array.ndim not in (2, 3)
        or array.shape[2:] not in ((), (3,), (4,))
    ):
        raise ValueError(
            f"image is {array.dtype} {list(array.shape)}: accepted: uint8 [h, w], [h, w, 3] (RGB) "
            "or [h, w, 4] (RGBA)"
        )
    if min(array.shape[:2]) < MIN_SIDE or math.prod(array.shape[:2]) > MAX_PIXELS:
        raise PhotoError(
            f"the image is {array.shape[1]}x{array.shape[0]}: accepted: at least {MIN_SIDE} pixels "
            f"a side and up to {MAX_PIXELS:,} in all"
        )
    if array.ndim == 2:
        return np.repeat(array[..., None], 3, axis=2), None
    alpha = array[..., 3] if array.shape[2] == 4 else None
    return array[..., :3], None if alpha is None or alpha.min() == 255 else alpha

"""Reads photos and their masks from files of any common format.

`psgn_jax.data.framing` describes how the object is placed in the input of the network.
"""

import contextlib
import dataclasses
import math
import os
import warnings
from collections.abc import Iterator

import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from psgn_jax.data import resize
from psgn_jax.system.errors import UserError
from psgn_jax.system.untrusted import brief, kind_of, one_line

MAX_PIXELS = 150_000_000
"""Larger images are refused before they are decoded: a small file can decode to gigabytes."""

MAX_SIDE = 2048
"""A photo is reduced by an integer factor, so that its longer side is below twice this, unless its
shorter side would fall below `MIN_SIDE`."""

MIN_SIDE = 16

_FORMATS = ("PNG", "JPEG", "MPO", "GIF", "BMP", "TIFF", "WEBP", "PPM", "TGA", "JPEG2000", "AVIF")
SUFFIXES = frozenset(
    (".png", ".jpg", ".jpeg", ".gif", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm", ".tga",
     ".jp2", ".avif")
)  # fmt: skip
"""Suffixes of the files that are read from a folder."""
_ORIENTATION = 0x0112  # of EXIF
_LEAST_TRANSPARENT = 0.005


class PhotoError(UserError):
    """An image or mask that cannot be used; the message is one line."""


@dataclasses.dataclass(frozen=True, eq=False)
class Photo:
    """An image as read, upright.

    Attributes:
      image: uint8 [h, w, 3] RGB, possibly reduced.
      alpha: uint8 [h, w], or None if there is none or it is no mask, see `useful_alpha`.
      size: (H, W) in the file, upright; `image` may be smaller.
      orientation: EXIF's number, 1 = as stored.
    """

    image: np.ndarray
    alpha: np.ndarray | None
    size: tuple[int, int]
    orientation: int


def read_photo(path: str | os.PathLike[str]) -> Photo:
    """Reads an image file of any common format: the first frame, upright, as 8-bit RGB.

    EXIF's orientation is honoured; CMYK, palettes, grey and 16 bits are converted.

    Raises:
      PhotoError: the path is not a file or not an image, or the image is damaged, larger than 150
        million pixels or smaller than 16x16.
    """
    stored = _decode(path)
    return _turned(stored, stored.orientation)


def read_mask(path: str | os.PathLike[str], photo: Photo) -> np.ndarray:
    """Reads the mask of a photo: bool [h, w] of `photo.image`'s shape, True on the object.

    Pixels brighter than half of the largest value belong to the object, so masks with 0/1 and with
    0/255 both work. In a file with transparency, alpha is used instead of brightness. The mask may
    have another size in the same proportions. If EXIF rotates the photo, and the mask has the
    proportions of the unrotated photo, the mask is rotated too.

    Raises:
      PhotoError: as `read_photo`; or the mask has other proportions than the photo, or is empty.
    """
    stored = _decode(path)
    turn, as_stored = stored.orientation, _upright_size(photo.size, photo.orientation)
    if turn == 1 and photo.size != as_stored and same_proportions(stored.size, as_stored):
        turn = photo.orientation
    upright = _turned(stored, turn)
    if not same_proportions(upright.size, photo.size):
        raise PhotoError(
            f"mask {path} is {upright.size[1]}x{upright.size[0]}: accepted: the image's "
            f"{photo.size[1]}x{photo.size[0]} or the same proportions"
        )
    levels = upright.alpha
    if levels is None:
        levels = np.asarray(Image.fromarray(upright.image).convert("L"))
    return resize.smooth_mask(_bright(levels, f"mask {path}"), photo.image.shape[:2])


def _bright(levels: np.ndarray, name: str) -> np.ndarray:
    """The pixels above half of the largest value; `PhotoError` if they are none or all."""
    if not levels.max() > 0:
        raise PhotoError(f"{name} is empty: no pixel shows the object")
    mask = levels > levels.max() / 2
    if mask.all():
        raise PhotoError(f"{name} covers the whole image: expected a background without it")
    return mask


def useful_alpha(alpha: np.ndarray | None) -> np.ndarray | None:
    """The alpha channel [h, w], or None if it is not the mask of an object.

    At least .5 % of the pixels of a mask are transparent. Some programs leave a few pixels of an
    ordinary photo not fully opaque.
    """
    return None if alpha is None or (alpha < 128).mean() < _LEAST_TRANSPARENT else alpha


def same_proportions(size: tuple[int, ...], other: tuple[int, ...]) -> bool:
    """Whether two (H, W) have the same proportions, up to a pixel or 1 %."""
    height = size[1] * other[0] / other[1]
    return abs(height - size[0]) <= max(1.0, 0.01 * size[0])


def decoded_pixels(path: str | os.PathLike[str]) -> int:
    """The number of pixels that `read_photo` decodes, from the header of the file.

    For a large JPEG it is smaller than the number of pixels in the file.

    Raises:
      PhotoError: as `read_photo`.
    """
    with _opened(path) as (file, _):
        return math.prod(file.size)


def _decode(path: str | os.PathLike[str]) -> Photo:
    """The first frame as stored, with EXIF's orientation."""
    with _opened(path) as (file, size):
        orientation = int(file.getexif().get(_ORIENTATION, 1) or 1)
        file.load()
        picture, alpha = _to_rgb(file.copy())
    return Photo(np.asarray(picture), useful_alpha(alpha), size, orientation)


def _turned(stored: Photo, orientation: int) -> Photo:
    """A photo upright, if it is stored with this orientation of EXIF."""
    if not 1 < orientation <= 8:
        return stored

    def turned(plane: np.ndarray) -> np.ndarray:
        picture = Image.fromarray(plane)
        picture.getexif()[_ORIENTATION] = orientation
        return np.asarray(ImageOps.exif_transpose(picture))

    alpha = None if stored.alpha is None else turned(stored.alpha)
    size = _upright_size(stored.size, orientation)
    return Photo(turned(stored.image), alpha, size, orientation)


@contextlib.contextmanager
def _opened(path: str | os.PathLike[str]) -> Iterator[tuple[Image.Image, tuple[int, int]]]:
    """Context with an opened file and its (H, W); errors in the block become `PhotoError`."""
    shown = one_line(path)
    try:
        kind = kind_of(path)
    except (OSError, ValueError):
        raise PhotoError(f"{shown}: no such file") from None
    if kind is not None:
        raise PhotoError(f"{shown} is {kind}, expected a file")
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
                        f"{shown} is {width}x{height}: accepted: up to {MAX_PIXELS:,} pixels"
                    )
                if min(width, height) < MIN_SIDE:
                    raise PhotoError(
                        f"{shown} is {width}x{height}: accepted: at least {MIN_SIDE} pixels a side"
                    )
                file.draft(file.mode, (MAX_SIDE, MAX_SIDE))  # a JPEG can be decoded smaller
                yield file, (height, width)
    except PhotoError:
        raise
    except UnidentifiedImageError:
        raise PhotoError(f"{shown} is not an image of a known format") from None
    except Image.DecompressionBombError:
        raise PhotoError(f"{shown} is too large: accepted: up to {MAX_PIXELS:,} pixels") from None
    except MemoryError:
        raise PhotoError(f"{shown}: not enough memory to decode it") from None
    except Exception as error:  # decoders raise any type of error for damaged files
        why = brief(error) or type(error).__name__
        raise PhotoError(f"{shown} is damaged or unreadable: {why}") from None


def _to_rgb(picture: Image.Image) -> tuple[Image.Image, np.ndarray | None]:
    """RGB and alpha, reduced as described at `MAX_SIDE`."""
    if picture.mode.startswith(("I", "F")):
        picture = Image.fromarray(_to_bytes(np.asarray(picture)))
    elif picture.has_transparency_data:
        picture = picture.convert("RGBA")
    elif picture.mode != "RGB":
        picture = picture.convert("RGB")
    factor = max(picture.size) // MAX_SIDE
    if factor > 1:
        # A long and narrow image is reduced less, so that its shorter side stays at least MIN_SIDE.
        picture = picture.reduce(max(1, min(factor, min(picture.size) // MIN_SIDE)))
    alpha = np.asarray(picture.getchannel("A")) if picture.mode == "RGBA" else None
    return picture.convert("RGB"), alpha


def _to_bytes(values: np.ndarray) -> np.ndarray:
    """Grey values as 8 bits; full scale is 1, 255 or 65535, or the largest value beyond that.

    Floats may exceed the full scale by a tenth, as they do after resampling.
    """
    slack = 1.1 if values.dtype.kind == "f" else 1
    top = values.max(initial=0, where=np.isfinite(values))
    full = next((scale for scale in (1.0, 255.0, 65535.0) if top <= slack * scale), top)
    levels = np.clip(values / np.float64(full), 0, 1)
    return np.rint(np.nan_to_num(levels) * 255).astype(np.uint8)


def _upright_size(size: tuple[int, int], orientation: int) -> tuple[int, int]:
    return size[::-1] if 5 <= orientation <= 8 else size


def as_photo(image: str | os.PathLike[str] | Image.Image | np.ndarray | Photo) -> Photo:
    """A photo from a file, a PIL image, or an array uint8 [h, w], [h, w, 3] or [h, w, 4].

    EXIF's orientation of a PIL image is honoured. A `Photo` is returned as it is.

    Raises:
      PhotoError: the image is too small or too large, or see `read_photo`.
      ValueError: an array of another shape or dtype.
    """
    if isinstance(image, str | os.PathLike):
        return read_photo(image)
    if isinstance(image, Photo):
        return image
    if isinstance(image, Image.Image):
        upright = ImageOps.exif_transpose(image)
        size = upright.height, upright.width
        picture, alpha = _to_rgb(upright)
        array = np.asarray(picture)
    else:
        array, alpha = np.asarray(image), None
        if array.dtype != np.uint8 or array.ndim < 2 or array.shape[2:] not in ((), (3,), (4,)):
            raise ValueError(
                f"image is {array.dtype} {list(array.shape)}: accepted: uint8 [h, w], [h, w, 3] "
                "(RGB) or [h, w, 4] (RGBA)"
            )
        if array.ndim == 2:
            array = np.repeat(array[..., None], 3, axis=2)
        array, alpha = array[..., :3], array[..., 3] if array.shape[2] == 4 else None
        size = array.shape[0], array.shape[1]
    if min(size) < MIN_SIDE or math.prod(size) > MAX_PIXELS:
        raise PhotoError(
            f"the image is {size[1]}x{size[0]}: accepted: at least {MIN_SIDE} pixels a side and up "
            f"to {MAX_PIXELS:,} in all"
        )
    return Photo(array, useful_alpha(alpha), size, 1)


def as_mask(mask: str | os.PathLike[str] | Image.Image | np.ndarray, photo: Photo) -> np.ndarray:
    """The mask of a photo, bool [h, w] as `photo.image`, from a file, a PIL image or an array.

    A PIL image or an array has the size of `photo.size` or of `photo.image`. Pixels above half of
    the largest value belong to the object, whatever the dtype.

    Raises:
      PhotoError: see `read_mask`.
    """
    if isinstance(mask, str | os.PathLike):
        return read_mask(mask, photo)
    if isinstance(mask, Image.Image):
        mask = ImageOps.exif_transpose(mask).convert("L")
    levels, size = np.asarray(mask), photo.image.shape[:2]
    if levels.shape not in (size, photo.size):
        raise PhotoError(
            f"the mask is {list(levels.shape)}: accepted: {list(photo.size)}, as the image"
        )
    return resize.smooth_mask(_bright(levels.astype(np.float32), "the mask"), size)

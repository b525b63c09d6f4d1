"""Reads photos and their masks from files of any common format.

`psgn_jax.data.framing` describes how the object is placed in the input of the network.
"""

import contextlib
import dataclasses
import io
import math
import os
import pathlib
import re
import warnings
from collections.abc import Iterator, Sequence
from typing import IO, Any

import numpy as np
from PIL import Image, ImageCms, UnidentifiedImageError

from psgn_jax.data import mask_levels, resample
from psgn_jax.system.errors import UserError
from psgn_jax.system.untrusted import brief, kind_of, one_line

MAX_PIXELS = 150_000_000
"""Larger images are refused before they are decoded: a small file can decode to gigabytes."""

MAX_SIDE = 2048
"""A photo is reduced by an integer factor so that its longer side is below twice this, but the
shorter side stays at least `MIN_SIDE`."""

MIN_SIDE = 16

_FORMATS = ("PNG", "JPEG", "MPO", "GIF", "BMP", "TIFF", "WEBP", "PPM", "TGA", "JPEG2000", "AVIF")
SUFFIXES = frozenset(
    (".png", ".jpg", ".jpeg", ".gif", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm", ".tga",
     ".jp2", ".avif")
)  # fmt: skip
"""Suffixes of the images in a folder."""
HEIC = frozenset((".heic", ".heif"))
"""Suffixes of images that Pillow cannot read."""
_ADVICE = (
    "accepted: PNG, JPEG, GIF, BMP, TIFF, WebP, PPM, TGA, JPEG 2000 or AVIF; convert others, such "
    "as HEIC, to PNG or JPEG"
)
_ORIENTATION, _EXIF, _FOCAL_35MM = 0x0112, 0x8769, 0xA405  # tags of EXIF
_LEAST_TRANSPARENT = 0.005
_OF_PROFILES = {"GRAY": "L", "CMYK": "CMYK"}  # kind of an ICC profile -> Pillow's mode
_TURNS = {
    2: Image.Transpose.FLIP_LEFT_RIGHT, 3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM, 5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_270, 7: Image.Transpose.TRANSVERSE, 8: Image.Transpose.ROTATE_90,
}  # fmt: skip
"""EXIF's orientation -> how to turn the picture upright."""


class PhotoError(UserError):
    """An image or a mask cannot be used; the message is one line."""


@dataclasses.dataclass(frozen=True, eq=False)
class Photo:
    """An image as read, upright."""

    image: np.ndarray  # uint8 [h, w, 3] RGB, possibly reduced
    alpha: np.ndarray | None  # uint8 [h, w], if it can be the mask (`useful_alpha`)
    size: tuple[int, int]  # (H, W) in the file, upright; `image` may be smaller
    orientation: int = 1  # EXIF's number, 1 = as stored
    focal: float | None = None  # in pixels of `size`, from EXIF's focal length for 35 mm film
    path: pathlib.Path | None = None  # None if the photo was not read from a path
    warnings: tuple[str, ...] = ()


Source = str | os.PathLike[str] | IO[bytes] | Image.Image | np.ndarray
"""A path, an open file, a PIL image, or an array (also of other libraries)."""


def read_photo(image: Source | Photo) -> Photo:
    """Reads an image of any common format: the first frame, upright, as 8-bit sRGB.

    Colours with an embedded ICC profile are converted; a warning says if that fails.

    Args:
      image: a path, a binary file such as `io.BytesIO`, a PIL image, or an array of NumPy or JAX,
        uint8 [h, w], [h, w, 3] or [h, w, 4]. A `Photo` is returned unchanged.

    Raises:
      PhotoError: the file is missing, damaged or no image, or the image has more than 150 million
        pixels or less than 16 a side.
      ValueError: a list, or an array of another shape or dtype.
    """
    if isinstance(image, Photo):
        return image
    image = _with_numpy(image, "the image")
    if isinstance(image, np.ndarray):
        return _from_array(image)
    with _opened(image, "the image") as (file, size):
        file.load()
        path = pathlib.Path(image) if isinstance(image, str | os.PathLike) else None
        return dataclasses.replace(_from_picture(file, size), path=path)


def read_mask(mask: Source, photo: Photo, label: int | Sequence[int] | None = None) -> np.ndarray:
    """Reads the mask of a photo: bool [h, w] of `photo.image`'s shape, True on the object.

    The brighter of the mask's two levels shows the object, in files and in arrays of any dtype;
    the edges may be soft. In a file with transparency, alpha replaces brightness. The mask may have
    another size in the photo's proportions. If EXIF rotates the photo, a mask with the proportions
    of the unrotated photo is rotated too.

    Args:
      label: the object's label in a mask of several labels: a grey level, a palette index, or a
        colour (r, g, b).

    Raises:
      PhotoError: as `read_photo`; or the mask has other proportions than the photo, is empty or
        full, has more than two levels, or is a photograph (`data.mask_levels`).
    """
    name = f"mask {one_line(mask)}" if isinstance(mask, str | os.PathLike) else "the mask"
    ids: np.ndarray | None = None
    mask, bound = _with_numpy(mask, "the mask"), max(photo.image.shape)
    if isinstance(mask, np.ndarray):
        values = mask[..., 0] if mask.shape[2:] == (1,) else mask
        if values.dtype.kind not in "biuf":
            raise PhotoError(f"{name} is an array of {mask.dtype}; expected numbers")
        if values.dtype == np.bool_:
            values = values.view(np.uint8) != 0  # in Pillow's arrays, True is the byte 255
        size = values.shape
    else:
        picture, size, orientation = _mask_picture(mask, bound)
        as_stored = _upright_size(photo.size, photo.orientation)
        if orientation == 1 and photo.size != as_stored and same_proportions(size, as_stored):
            orientation = photo.orientation
        picture, size = _transposed(picture, orientation), _upright_size(size, orientation)
        values, ids = _levels_of(picture)
    if len(size) != 2:
        raise PhotoError(f"{name} is an array of the shape {size}; expected (height, width)")
    if not same_proportions(size, photo.size):
        raise PhotoError(
            f"{name} is {size[1]}x{size[0]} (width x height): accepted: the image's "
            f"{photo.size[1]}x{photo.size[0]} or the same proportions"
        )
    if values.dtype.kind == "f" and (bad := int((~np.isfinite(values)).sum())):
        raise PhotoError(f"{name} has {bad} values that are not finite; expected finite levels")
    try:
        inside = mask_levels.object_in(values, ids, label)
    except ValueError as error:
        raise PhotoError(f"{name} {error}") from None
    return resample.smooth_mask(inside, photo.image.shape[:2])


def _mask_picture(mask: Source, bound: int) -> tuple[Image.Image, tuple[int, int], int]:
    """A mask as stored, reduced to at most `bound` pixels a side; its (H, W); its orientation."""
    with _opened(mask, "the mask") as (file, size):
        file.load()
        factor, orientation = max(file.size) / bound, _orientation_of(file)
        if factor <= 1:
            return file.copy(), size, orientation
        # Nearest pixels, because averages would be new levels.
        width, height = (max(1, round(side / factor)) for side in file.size)
        return file.resize((width, height), Image.Resampling.NEAREST), size, orientation


def _levels_of(picture: Image.Image) -> tuple[np.ndarray, np.ndarray | None]:
    """The levels of a mask, numbers [h, w] or colours [h, w, 3], and any palette indices."""
    ids = np.asarray(picture) if picture.mode == "P" else None
    if picture.mode.startswith(("I", "F", "1", "L")) and not picture.has_transparency_data:
        return np.asarray(picture), None
    rgba = np.asarray(picture.convert("RGBA"))
    colours, alpha = rgba[..., :3], useful_alpha(rgba[..., 3])
    if alpha is not None:
        shown = mask_levels.sample(rgba)
        opaque = shown[shown[..., 3] > 127, :3]
        if 1 < mask_levels.count(opaque) <= mask_levels.FEW and opaque.any(axis=1).all():
            return np.where(alpha[..., None] > 127, colours, np.uint8(0)), ids
        return alpha, None
    if ids is not None:
        small = [mask_levels.sample(np.atleast_3d(each)) for each in (ids, colours)]
        if mask_levels.count(small[0]) > mask_levels.count(small[1]):
            return ids, None  # several labels have one colour
    grey = (colours == colours[..., :1]).all()
    return (colours[..., 0] if grey else colours), ids


def useful_alpha(alpha: np.ndarray | None) -> np.ndarray | None:
    """The alpha channel [h, w]; None if fewer than .5 % of its pixels are transparent.

    Some programs make a few pixels of an ordinary photo transparent.
    """
    return None if alpha is None or (alpha < 128).mean() < _LEAST_TRANSPARENT else alpha


def same_proportions(size: tuple[int, ...], other: tuple[int, ...]) -> bool:
    """Whether two (H, W) have the same proportions, up to a pixel or 1 %."""
    height = size[1] * other[0] / other[1]
    return abs(height - size[0]) <= max(1.0, 0.01 * size[0])


def _with_numpy(image: Source, noun: str) -> Source:
    """Converts arrays of other libraries to NumPy; ValueError for a list."""
    if isinstance(image, list | tuple):
        raise ValueError(f"{noun} is a list: accepted: one image; use a loop for several")
    if isinstance(image, np.ndarray | Image.Image) or not hasattr(image, "__array__"):
        return image
    return np.asarray(image)


def _from_array(image: np.ndarray) -> Photo:
    if image.dtype != np.uint8 or image.ndim < 2 or image.shape[2:] not in ((), (3,), (4,)):
        raise ValueError(
            f"image is {image.dtype} {list(image.shape)}: accepted: uint8 [h, w], [h, w, 3] (RGB) "
            "or [h, w, 4] (RGBA)"
        )
    size = image.shape[0], image.shape[1]
    _check_size("the image", size)
    colours = image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)
    alpha = colours[..., 3] if colours.shape[2] == 4 else None
    return Photo(colours[..., :3], useful_alpha(alpha), size)


def _check_size(shown: str, size: tuple[int, int]) -> None:
    if min(size) < MIN_SIDE or math.prod(size) > MAX_PIXELS:
        raise PhotoError(
            f"{shown} is {size[1]}x{size[0]}: accepted: at least {MIN_SIDE} pixels a side and up "
            f"to {MAX_PIXELS:,} in all"
        )


def _from_picture(picture: Image.Image, size: tuple[int, int]) -> Photo:
    orientation = _orientation_of(picture)
    # EXIF's focal length gives the photo's diagonal field of view on film of 36 x 24 mm.
    focal = None
    with contextlib.suppress(Exception):  # of damaged metadata
        film = float(picture.getexif().get_ifd(_EXIF).get(_FOCAL_35MM, 0))
        focal = film * math.hypot(*size) / math.hypot(36, 24) if 0 < film < 1e4 else None
    colours, alpha, doubts = _to_rgb(picture)
    image, size = np.asarray(_transposed(colours, orientation)), _upright_size(size, orientation)
    alpha = None if alpha is None else turned(alpha, orientation)
    return Photo(image, useful_alpha(alpha), size, orientation, focal, warnings=doubts)


def turned(plane: np.ndarray, orientation: int) -> np.ndarray:
    """An image or mask that is stored with an EXIF orientation, turned upright."""
    return np.asarray(_transposed(Image.fromarray(plane), orientation))


def _transposed(picture: Image.Image, orientation: int) -> Image.Image:
    turn = _TURNS.get(orientation)
    return picture if turn is None else picture.transpose(turn)


def _orientation_of(picture: Image.Image) -> int:
    """EXIF's orientation, 2 to 8; 1 (upright) if it is missing or invalid."""
    with contextlib.suppress(Exception):  # of damaged metadata
        value = picture.getexif().get(_ORIENTATION)
        if isinstance(value, int) and value in _TURNS:
            return value
    return 1


@contextlib.contextmanager
def _opened(path: Any, noun: str) -> Iterator[tuple[Image.Image, tuple[int, int]]]:
    """Context that opens a picture; its value is the picture and its (H, W).

    Errors become `PhotoError`. Pillow's warnings about metadata and large sizes are not shown.
    """
    shown = noun
    if isinstance(path, str | os.PathLike):
        shown = one_line(path)
        try:
            kind = kind_of(path)
        except (OSError, ValueError):
            raise PhotoError(f"{shown}: no such file") from None
        if kind is not None:
            raise PhotoError(f"{shown} is {kind}, expected a file")
    elif isinstance(path, Image.Image):
        pass
    elif hasattr(path, "seek") and not isinstance(path, io.TextIOBase):
        shown = one_line(getattr(path, "name", noun))
        path.seek(0)
    else:
        raise ValueError(
            f"{noun} is {type(path).__name__}: accepted: a path, a file open as binary, a PIL "
            "image or an array"
        )
    Image.init()
    formats = [name for name in _FORMATS if name in Image.OPEN]
    given = isinstance(path, Image.Image)
    try:
        with (
            warnings.catch_warnings(action="ignore"),
            contextlib.nullcontext(path) if given else Image.open(path, formats=formats) as file,
        ):
            width, height = file.size
            _check_size(shown, (height, width))
            if not given:
                file.draft(file.mode, (MAX_SIDE, MAX_SIDE))  # a JPEG can be decoded smaller
            yield file, (height, width)
    except PhotoError:
        raise
    except UnidentifiedImageError:
        raise PhotoError(f"{shown} {_other_than_image(path)}") from None
    except Image.DecompressionBombError:
        raise PhotoError(f"{shown} is too large: accepted: up to {MAX_PIXELS:,} pixels") from None
    except MemoryError:
        raise PhotoError(f"{shown}: not enough memory to decode it") from None
    except Exception as error:  # damaged files raise errors of any type
        why = brief(error) or type(error).__name__
        raise PhotoError(f"{shown} is damaged or unreadable: {why}") from None


def _other_than_image(path: Any) -> str:
    """What a file is that is not an image; the sentence follows its name."""
    opened = contextlib.nullcontext(path) if hasattr(path, "seek") else open(path, "rb")  # noqa: SIM115
    with opened as file:
        file.seek(0)
        start = file.read(512)
    if start.startswith(b"version https://git-lfs"):
        return "is a Git LFS pointer, not an image; expected the file that `git lfs pull` fetches"
    if re.match(rb"\s*<(!doctype html|html)", start, re.IGNORECASE):
        return "is a web page, not an image; expected the image that the page shows"
    return f"is not an image of a known format; {_ADVICE}"


def _to_rgb(picture: Image.Image) -> tuple[Image.Image, np.ndarray | None, tuple[str, ...]]:
    """Colours in sRGB and alpha, reduced as described at `MAX_SIDE`, and warnings."""
    profile = picture.info.get("icc_profile")
    if picture.mode.startswith(("I", "F")):
        picture = Image.fromarray(_to_bytes(np.asarray(picture)))
    elif picture.has_transparency_data:
        picture = picture if picture.mode == "RGBA" else picture.convert("RGBA")
    elif picture.mode != "RGB" and not (profile and picture.mode in _OF_PROFILES.values()):
        picture = picture.convert("RGB")
    factor = max(picture.size) // MAX_SIDE
    if factor > 1:
        picture = picture.reduce(max(1, min(factor, min(picture.size) // MIN_SIDE)))
    alpha = np.asarray(picture.getchannel("A")) if picture.mode == "RGBA" else None
    try:
        return _in_srgb(picture, profile), alpha, ()
    except (ImageCms.PyCMSError, OSError, TypeError, ValueError) as error:
        why = f"its colour profile cannot be used ({brief(error)}); colours are read as sRGB"
        return picture.convert("RGB"), alpha, (why,)


def _in_srgb(picture: Image.Image, profile: bytes | None) -> Image.Image:
    """A picture with an ICC profile or None, in RGB."""
    source = ImageCms.ImageCmsProfile(io.BytesIO(profile)) if profile else None
    if source is None or "sRGB" in ImageCms.getProfileDescription(source):
        return picture.convert("RGB")
    given = picture.convert(_OF_PROFILES.get(source.profile.xcolor_space.strip(), "RGB"))
    goal = ImageCms.createProfile("sRGB")
    converted = ImageCms.profileToProfile(given, source, goal, outputMode="RGB")
    return converted or given


def _to_bytes(values: np.ndarray) -> np.ndarray:
    """Grey values as 8 bits; the full scale is 1, 255, 65535 or, beyond these, the maximum."""
    slack = 1.1 if values.dtype.kind == "f" else 1  # resampled floats overshoot
    top = values.max(initial=0, where=np.isfinite(values))
    full = next((scale for scale in (1.0, 255.0, 65535.0) if top <= slack * scale), top)
    levels = np.empty(values.shape, np.uint8)
    for row, result in zip(values, levels, strict=True):
        result[:] = np.rint(np.nan_to_num(np.clip(row / np.float64(full), 0, 1)) * 255)
    return levels


def _upright_size(size: tuple[int, int], orientation: int) -> tuple[int, int]:
    return size[::-1] if 5 <= orientation <= 8 else size

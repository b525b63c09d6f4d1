"""Textures, decoded within limits; the files and the warnings of a model."""

import dataclasses
import io
import posixpath
import struct
import warnings as python_warnings
from collections.abc import Callable, Sequence

import numpy as np
from PIL import Image, UnidentifiedImageError

from data_gen.mesh import MAX_FACES, Material
from data_gen.readers.model_files import Budget, Files, OverBudgetError, reason
from psgn_jax.system.untrusted import one_line

MAX_DECODED_PIXELS = 40_000_000
"""Largest accepted number of pixels of an image; of a JPEG, after its decoder has reduced it."""

TEXTURE_SIDE = 1024
"""Largest number of pixels along a side of a texture; we reduce larger images."""

# Warnings of several readers.
TRAILING = "lines or bytes after the data not read"
TWO_COLOURS = "colours of faces beside colours of vertices not read"
NO_COORDINATES = "texture coordinates missing, 0 is used"
MISSING_TEXTURE = "textures missing, the plain colour is used"
BROKEN_TEXTURE = "textures not readable, the plain colour is used"

_MAX_TEXELS = 1 << 24  # of all textures of a model, 64 MB
_MOST_DETAILS = 1000  # for each kind of warning
_MOST_TILES = 4  # repeats of a texture that is clamped; we clip coordinates to them
_MOST_TEXELS_ALONG = 4096  # of a clamped texture

_PICTURE_FORMATS = ("PNG", "JPEG", "BMP", "TGA", "GIF", "WEBP", "TIFF", "PPM", "DDS", "SGI")


def decode_texture(data: bytes, budget: Budget, side: int = TEXTURE_SIDE) -> np.ndarray:
    """An image as uint8 [H, W, 4] RGBA, with at most `side` pixels along a side.

    Raises:
      OverBudgetError: see `model_files.Budget`.
      ValueError: it is not an image, damaged, or larger than `MAX_DECODED_PIXELS`.
    """
    with python_warnings.catch_warnings():
        # Pillow warns of sizes, which we check below, and of palettes and metadata.
        python_warnings.simplefilter("ignore")
        try:
            picture: Image.Image = Image.open(io.BytesIO(data), formats=_PICTURE_FORMATS)
            width, height = picture.size
            factor = side / max(width, height)
            # The decoder of JPEG can reduce an image, by a factor of up to 8.
            picture.draft(None, (round(width * factor) or 1, round(height * factor) or 1))
            if picture.width * picture.height > MAX_DECODED_PIXELS:
                raise Image.DecompressionBombError
            # The pixels, and four copies of the texture.
            pixels = picture.width * picture.height
            budget.charge(made=4 * pixels + 16 * min(pixels, side**2))
            # Palettes and 16-bit values cannot be averaged. The pixels are few enough for a copy.
            if picture.mode in ("P", "1"):
                picture = picture.convert("RGBA" if "transparency" in picture.info else "RGB")
            elif picture.mode.startswith(("I", "F")):
                values = np.asarray(picture, np.float32)
                values /= 65535 if picture.mode != "F" else max(values.max(), 1e-30)
                picture = Image.fromarray((255 * values.clip(0, 1)).astype(np.uint8))
            picture.thumbnail((side, side), Image.Resampling.BOX, reducing_gap=None)
            return np.asarray(picture.convert("RGBA"))
        except Image.DecompressionBombError:
            raise ValueError(f"more pixels than the limit of {MAX_DECODED_PIXELS}") from None
        except UnidentifiedImageError as error:
            raise ValueError(reason(data) or "not an image of a known format") from error
        except (OSError, SyntaxError, struct.error, EOFError) as error:
            raise ValueError("the image is damaged or cut off") from error


def repeated(
    texture: np.ndarray, uv: np.ndarray, wraps: tuple[str, str]
) -> tuple[np.ndarray, np.ndarray]:
    """A texture that repeats, with coordinates, and looks like `texture` with `wraps`.

    For "mirror", it has the texture and its mirror image. For "clamp", it has a margin as wide as
    the coordinates need, up to `_MOST_TILES` times the size of the texture.
    """
    texture, uv = texture[::-1], uv.copy()  # now the first row is at v = 0
    for axis, wrap in enumerate(wraps):
        side, values = 1 - axis, uv[..., axis]
        if wrap == "mirror":
            texture = np.concatenate([texture, np.flip(texture, side)], axis=side)
            uv[..., axis] = values / 2
        elif wrap == "clamp":
            values = values.clip(-_MOST_TILES, 1 + _MOST_TILES)
            low, high = min(values.min(), 0.0), max(values.max(), 1.0)
            if (low, high) == (0, 1):
                uv[..., axis] = values.clip(0, 1 - 1e-6)  # 1 would repeat the other end
                continue
            while texture.shape[side] * (high - low) > _MOST_TEXELS_ALONG:
                texture = texture[:, ::2] if side else texture[::2]
            size, margin = texture.shape[side], [(0, 0)] * 3
            margin[side] = int(np.ceil(-low * size)) + 1, int(np.ceil((high - 1) * size)) + 1
            texture = np.pad(texture, margin, mode="edge")
            uv[..., axis] = (values * size + margin[side][0]) / texture.shape[side]
    return np.ascontiguousarray(texture[::-1]), uv


class Assets:
    """The files that the model `path` refers to, its budget and its warnings."""

    def __init__(self, files: Files, path: str = "", max_faces: int = MAX_FACES) -> None:
        self.files, self.budget = files, Budget(max_faces)
        self.base, self.name = posixpath.split(path)
        self._kinds: dict[str, dict[str, None]] = {}
        self._textures: dict[tuple[object, object], np.ndarray | None] = {}

    def open(self, name: str, folder: str = "") -> bytes:
        """The content of a file in the `folder` below `base`, or in `base`; see `Files.open`.

        Models of robots have textures in `materials/textures` beside their folder `meshes`.
        """
        self.budget.charge(visits=10)  # a name stands for up to fifty paths
        beside = posixpath.join(self.base, "../materials/textures")
        data = self.files.open(name, posixpath.join(self.base, folder), self.base, beside)
        self.budget.charge(made=len(data))
        return data

    def warn(self, kind: str, what: object = "") -> None:
        """Adds a warning about a feature of the file that we do not read.

        Args:
          kind: a fixed text without ": ", such as "textures missing, the plain colour is used".
          what: a name in the file, or a number.
        """
        details = self._kinds.setdefault(kind, {})
        if what != "" and len(details) < _MOST_DETAILS:
            details[one_line(what)[:160]] = None

    @property
    def warnings(self) -> list[str]:
        """A line for each kind, `KIND: WHAT, WHAT and 3 more`; see `mesh.kind_of_warning`."""
        lines = []
        for kind, details in self._kinds.items():
            rest = f" and {len(details) - 3} more" if len(details) > 3 else ""
            shown = ", ".join(list(details)[:3]) + rest
            lines.append(f"{kind}: {shown}" if shown else kind)
        return lines

    def texture(self, name: str, folder: str = "") -> np.ndarray | None:
        """The texture in a file of `open`, decoded once; None and a warning if it fails."""
        key = folder, name
        is_new = key not in self._textures
        picture = self.decoded(key, repr(name), lambda: self.open(name, folder))
        if is_new and picture is not None and not picture[..., 3].any():
            self.warn("alpha 0 in a whole texture, opaque is used", repr(name))
            opaque = np.full(picture.shape[:2], 255, np.uint8)
            self._textures[key] = picture = self.with_alpha(picture, opaque)
        return picture

    def decoded(
        self, key: tuple[object, object], label: str, load: Callable[[], bytes]
    ) -> np.ndarray | None:
        """The texture in the bytes of `load`, once per key; None and a warning if it fails."""
        if key not in self._textures:
            self._textures[key] = None
            try:
                self._textures[key] = decode_texture(load(), self.budget)
            except OverBudgetError:
                raise
            except FileNotFoundError:
                self.warn(MISSING_TEXTURE, label)
            except (ValueError, OSError) as error:
                self.warn(BROKEN_TEXTURE, f"{label} ({error})")
        return self._textures[key]

    def with_alpha(self, texture: np.ndarray | None, alpha: np.ndarray) -> np.ndarray:
        """The texture (None = white) with another alpha, uint8 [H, W]."""
        if texture is None:
            texture = np.full((*alpha.shape, 4), 255, np.uint8)
        self.budget.charge(made=2 * texture.nbytes)
        if alpha.shape != texture.shape[:2]:
            height, width = texture.shape[:2]
            alpha = np.asarray(Image.fromarray(alpha).resize((width, height)))
        return np.concatenate([texture[..., :3], alpha[..., None]], axis=2)

    def bounded(self, materials: Sequence[Material]) -> tuple[Material, ...]:
        """The materials. We halve the largest textures until all are within `_MAX_TEXELS`.

        A texture of several materials counts once.
        """
        distinct = {id(m.texture): m.texture for m in materials if m.texture is not None}

        def size(key: int) -> int:
            return distinct[key].shape[0] * distinct[key].shape[1]

        while sum(map(size, distinct)) > _MAX_TEXELS:
            self.warn(f"textures reduced to {_MAX_TEXELS} pixels in all")
            largest = max(distinct, key=size)
            distinct[largest] = np.asarray(Image.fromarray(distinct[largest]).reduce(2))
        return tuple(
            m if m.texture is None else dataclasses.replace(m, texture=distinct[id(m.texture)])
            for m in materials
        )

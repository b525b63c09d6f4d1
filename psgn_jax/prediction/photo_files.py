"""The files of a photo: images with its name, and pictures that are marked as its results."""

import contextlib
import io
import os
import pathlib
import warnings
import zlib

import numpy as np
from PIL import Image, PngImagePlugin

from psgn_jax.data import photo
from psgn_jax.system.files import same_name
from psgn_jax.system.untrusted import kind_of

_NOTE, _OF = "psgn_jax result", "psgn_jax photo"  # keys of texts in PNG files


def images_named(folder: pathlib.Path, stem: str) -> list[pathlib.Path]:
    """The image files `stem.*` in a folder; HEIC last, which cannot be read.

    Upper and lower case are equal, and so are the Unicode forms of a name, because programs and
    systems change them; a file of the very same name comes first.
    """
    wanted, order = same_name(stem), (*sorted(photo.SUFFIXES), *sorted(photo.HEIC))
    found = []
    with contextlib.suppress(OSError):
        for name in os.listdir(folder):
            start, suffix = os.path.splitext(name)
            if same_name(start) == wanted and suffix.lower() in order:
                found.append((start != stem, order.index(suffix.lower()), name))
    return [file for *_, name in sorted(found) if (file := folder / name).is_file()]


def result_png(picture: np.ndarray, of: pathlib.Path | None) -> bytes:
    """A PNG file that `is_result` recognises, made from the photo `of`."""
    stream, note = io.BytesIO(), PngImagePlugin.PngInfo()
    note.add_text(_NOTE, str(zlib.crc32(picture.tobytes())))
    if of is not None:
        note.add_text(_OF, _number(of))
    Image.fromarray(picture).save(stream, "png", pnginfo=note, compress_level=1)
    return stream.getvalue()


def _number(path: pathlib.Path) -> str:
    # The path itself would tell others about this machine.
    return str(zlib.crc32(os.fsencode(os.path.abspath(path))))


def is_result(path: pathlib.Path, other_than: pathlib.Path | None = None) -> bool:
    """Whether a file was written as a result, and its pixels were not changed since.

    With `other_than`, whether it is a result of another photo.
    """
    try:
        if kind_of(path) is not None:
            return False
        with (
            warnings.catch_warnings(action="ignore"),  # of large images
            Image.open(path, formats=["PNG"]) as file,
        ):
            note, of = file.info.get(_NOTE), file.info.get(_OF)
            if note is None or (other_than and of in (None, _number(other_than))):
                return False
            return bool(note == str(zlib.crc32(file.tobytes())))
    except Exception:  # whatever it is, it is no result
        return False

"""Reads a model with the reader of its format, and normalises it."""

import gzip
import io
import os
import pathlib
import posixpath
import zlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from data_gen.frame import normalize, orient
from data_gen.mesh import MAX_FACES, Model, UnreadableModelError, UnusableModelError, build_model
from data_gen.readers.collada import read_collada, read_zae
from data_gen.readers.gltf import read_gltf
from data_gen.readers.model_files import (
    MAX_FILE_BYTES,
    DamagedError,
    Files,
    FolderFiles,
    check_size,
    reason,
)
from data_gen.readers.obj import read_obj
from data_gen.readers.off import read_off
from data_gen.readers.parts import Part, joined
from data_gen.readers.ply import read_ply
from data_gen.readers.stl import read_stl
from data_gen.readers.textures import Assets
from data_gen.readers.three_mf import read_3mf
from psgn_jax.system.untrusted import one_line

READERS: dict[str, Callable[[bytes, Assets], list[Part]]] = {
    "obj": read_obj, "ply": read_ply, "off": read_off, "stl": read_stl, "dae": read_collada,
    "zae": read_zae, "3mf": read_3mf,
    "glb": read_gltf, "gltf": read_gltf,
}  # fmt: skip
"""Suffixes of the formats that can be read; `.gz` may follow them."""


def load_model(
    name: str | os.PathLike[str],
    files: Files | None = None,
    *,
    up: str = "+y",
    front: str = "+z",
    max_faces: int = MAX_FACES,
    turn: Callable[[Model], Model] = lambda model: model,
    parameters: Mapping[str, Any] | None = None,
) -> Model:
    """Reads a model from a file and normalises it to the project's frame.

    Args:
      name: path of the file; with `files`, its name in them.
      files: contain the file and the files that it refers to; None = the folder of `name`.
      up, front: axes of the file, see `frame.orient`.
      max_faces: largest accepted number of faces.
      turn: transforms the model in the axes of the file.
      parameters: of the model.

    Raises:
      UnusableModelError: the file is missing, damaged, empty or too large; the message says which.
    """
    name = os.fspath(name)
    if files is None:
        path = pathlib.Path(name)
        if path.is_symlink():  # the caller has named it, so it may lead anywhere
            path = path.resolve()
        files, name = FolderFiles(path.parent), path.name
    place = files.find(name)
    if place is None:
        raise files.refusal(f"file {name!r} {files.why_not(name)}")
    assets = Assets(files, name.removesuffix(".gz"), max_faces)
    try:
        with np.errstate(over="ignore", invalid="ignore"):  # `normalize` refuses infinite values
            arrays = _read(name, files.read(place), assets)
            model = build_model(**arrays, parameters=parameters, warnings=assets.warnings)
            return normalize(orient(turn(model), up, front))
    except FileNotFoundError as error:
        raise files.refusal(f"its file {str(error)[:100]!r} is missing") from None
    except OSError as error:
        file, why = os.path.basename(error.filename or name), error.strerror or error
        raise UnreadableModelError(f"file {file!r} is not readable: {why}") from error


def _read(name: str, data: bytes, assets: Assets) -> dict[str, Any]:
    """The arguments of `mesh.build_model` from a file."""
    stem, ending = posixpath.splitext(name.lower())
    if ending == ".gz":
        ending = posixpath.splitext(stem)[1]
        data = _unpacked(data)
    kind = ending.lstrip(".")
    if kind not in READERS:
        raise UnusableModelError(f"format {kind!r}: expected one of {sorted(READERS)}")
    title = {"glb": "glTF", "gltf": "glTF", "dae": "COLLADA"}.get(kind, kind.upper())
    is_archive = kind in ("zae", "3mf") and data.startswith(b"PK")
    try:
        if (why := reason(data)) and not is_archive:
            raise DamagedError(why)
        return joined(READERS[kind](data, assets), assets)
    except (UnusableModelError, MemoryError, OSError):
        raise
    except Exception as error:  # others come from parsers that met unexpected damage
        why = one_line(error) if isinstance(error, DamagedError) else "the file is damaged"
        raise UnusableModelError(f"not readable as {title}: {why}"[:200]) from error


def _unpacked(data: bytes) -> bytes:
    """The content of a gzip file, which may have several members."""
    try:
        with gzip.open(io.BytesIO(data)) as stream:
            content = stream.read(MAX_FILE_BYTES + 1)
    except EOFError as error:
        raise UnusableModelError("the file is cut off: its compression does not end") from error
    except (OSError, zlib.error) as error:
        raise UnusableModelError("not readable as gzip: the file is damaged") from error
    check_size("the content of the gzip file", len(content), MAX_FILE_BYTES)
    return content

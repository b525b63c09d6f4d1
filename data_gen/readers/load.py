"""Loads a model from a file, with the reader of its format, and normalises it."""

import os
import pathlib
import posixpath
from collections.abc import Callable
from typing import Any

import numpy as np

from data_gen.frame import normalize, orient
from data_gen.mesh import MAX_FACES, Model, UnreadableModelError, build_model
from data_gen.readers.by_trimesh import read_trimesh
from data_gen.readers.gltf import read_gltf
from data_gen.readers.model_files import Files, FolderFiles
from data_gen.readers.obj import read_obj
from data_gen.readers.textures import Assets


def load_model(
    name: str | os.PathLike[str],
    files: Files | None = None,
    *,
    up: str = "+y",
    front: str = "+z",
    model_id: str = "",
    max_faces: int = MAX_FACES,
    turn: Callable[[Model], Model] = lambda model: model,
    **about: Any,
) -> Model:
    """Reads a model from a file and normalises it to the project's frame.

    Args:
      name: path of the file; with `files`, its name there.
      files: the file and the files that it refers to; None = the folder of `name`.
      up, front: see `frame.orient`.
      model_id: name of the object; empty = the name of the file.
      max_faces: largest accepted number of faces.
      turn: a change of the model in the axes of the file.
      **about: `category` and `parameters` of the model.

    Raises:
      UnusableModelError: the file is missing, damaged, empty or too large; the message says which.
    """
    if files is None:
        path = pathlib.Path(name)
        model_id = model_id or path.name
        if path.is_symlink():  # named by the caller: it may lead anywhere
            path = path.resolve()
        files, name = FolderFiles(path.parent), path.name
    name = str(name)
    assets = Assets(files, posixpath.dirname(name), max_faces)
    kind = posixpath.splitext(name)[1].lstrip(".").lower()
    stored = files.find(name)
    if stored is None:
        raise files.refusal(f"file {name!r} {files.why_not(name)}")
    try:
        data = files.read(stored)
    except OSError as error:
        raise UnreadableModelError(f"file {name!r} is not readable: {error}"[:200]) from error
    with np.errstate(over="ignore", invalid="ignore"):  # `normalize` refuses what overflows
        if kind in ("glb", "gltf"):
            arrays = read_gltf(data, assets)
        else:
            arrays = read_obj(data, assets) if kind == "obj" else read_trimesh(data, kind, assets)
        del data
        about["model_id"] = model_id or name
        model = build_model(**arrays, **about, warnings=assets.warnings, max_faces=max_faces)
        return normalize(orient(turn(model), up, front))

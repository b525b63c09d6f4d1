"""A model from a file, normalised: the entry to all readers."""

import os
import pathlib
import posixpath
from collections.abc import Callable, Mapping
from typing import Any

from data_gen.frame import normalize, orient
from data_gen.mesh import CREASE_DEGREES, MAX_FACES, Model, UnusableModelError, build_model
from data_gen.readers.by_trimesh import read_trimesh
from data_gen.readers.files import Files, FolderFiles
from data_gen.readers.notes import Notes
from data_gen.readers.obj import read_obj
from data_gen.readers.textures import TEXTURE_SIDE

Reader = Callable[[bytes, Files, str, int, int, Notes], dict[str, Any]]
"""Makes arrays for `mesh.build_model` of: the file's bytes, the files that it may refer to, its
folder there, the limits of the textures' sides and of the faces, and a place for warnings."""


def load_model(
    name: str | os.PathLike[str],
    files: Files | None = None,
    *,
    up: str = "+y",
    front: str = "+z",
    category: str = "",
    model_id: str = "",
    parameters: Mapping[str, Any] | None = None,
    texture_side: int = TEXTURE_SIDE,
    max_faces: int = MAX_FACES,
    crease_degrees: float = CREASE_DEGREES,
    turn: Callable[[Model], Model] = lambda model: model,
    reader: Reader | None = None,
) -> Model:
    """Reads a model from a file and brings it to the project's frame, normalised.

    Args:
      name: path; with `files`, a name there.
      files: where the file and what it refers to lie; None = the folder of `name`.
      up: the file's axis that points up, see `frame.orient`.
      front: the file's axis that the object's front points to.
      category: of the object.
      model_id: of the object; empty = the file's name.
      parameters: for the model.
      texture_side: see `TEXTURE_SIDE`.
      max_faces: more are refused.
      crease_degrees: see `mesh.crease_normals`.
      turn: applied in the file's axes, before `up` and `front`.
      reader: of the file's format; None = by the ending of its name.

    Raises:
      UnusableModelError: the file is missing, damaged, empty or too large; the message says what.
    """
    if files is None:
        path = pathlib.Path(name)
        model_id = model_id or path.name
        if path.is_symlink():  # named by the caller: it may lead anywhere
            path = path.resolve()
        files, name = FolderFiles(path.parent), path.name
    name = str(name)
    model_id = model_id or name
    notes = Notes()
    base = posixpath.dirname(name)
    kind = posixpath.splitext(name)[1].lstrip(".").lower()
    found = files.find(name)
    if found is None:
        raise UnusableModelError(f"file {name!r} {files.why_not(name)}")
    try:
        data = files.read(found)
    except OSError as error:
        raise UnusableModelError(f"file {name!r} is not readable: {error}"[:200]) from error
    reader = reader or (read_obj if kind == "obj" else None)
    arrays = (
        reader(data, files, base, texture_side, max_faces, notes)
        if reader
        else read_trimesh(data, kind, files, base, texture_side, max_faces, notes)
    )
    del data
    model = build_model(
        **arrays,
        category=category,
        model_id=model_id,
        parameters=parameters,
        warnings=notes.lines,
        crease_degrees=crease_degrees,
        max_faces=max_faces,
    )
    return normalize(orient(turn(model), up, front))

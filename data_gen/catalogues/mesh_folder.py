"""Catalogue of a folder of meshes in any readable format."""

import functools
import os
import pathlib

from absl import logging

from data_gen.catalogues.entry import FRACTIONS, Catalogue, Entry, split_of
from data_gen.frame import axis_vector
from data_gen.mesh import MAX_FACES
from data_gen.readers.load import load_model
from data_gen.readers.model_files import FolderFiles

# Formats in which z usually points up; in the others it is y.
_Z_UP = (".stl", ".ply", ".off", ".3mf")

# Formats that cannot be read here, or only with further packages (3MF: lxml and networkx).
_OTHERS = {".3mf", ".3ds", ".blend", ".fbx", ".step", ".stp", ".usd", ".usdz", ".wrl", ".x3d",
           ".sh3f"}  # fmt: skip


def extensions() -> set[str]:
    """Suffixes of the mesh files that can be read."""
    import trimesh

    not_meshes = {"dxf", "svg", "xyz", "binvox", "zip", "bz2", "tar.bz2", "tar.gz", "stl_ascii"}
    return {f".{kind}" for kind in {*trimesh.available_formats(), "obj"} - not_meshes}


def find_meshes(source: str | os.PathLike[str]) -> list[str]:
    """The mesh files below a folder, sorted; ValueError if there are none."""
    root = pathlib.Path(source)
    if not root.is_dir():
        raise ValueError(f"source {str(source)!r}: expected a folder of meshes")
    endings = extensions()
    meshes: list[str] = []
    left: list[str] = []
    for place, folders, files in os.walk(root):
        folders[:] = sorted(f for f in folders if not f.startswith("."))
        for file in files:
            ending = pathlib.Path(file).suffix.lower()
            if not file.startswith(".") and ending in endings | _OTHERS:
                name = (pathlib.Path(place) / file).relative_to(root).as_posix()
                (meshes if ending in endings else left).append(name)
    other = "; catalogue sh3f reads .sh3f files" * any(n.lower().endswith(".sh3f") for n in left)
    if not meshes:
        expected = f"expected files with one of the suffixes {sorted(endings)}{other}"
        raise ValueError(f"source {str(source)!r}: it contains no mesh, {expected}")
    if left:
        what = "%d files that look like models but cannot be read here, such as %s: left out%s"
        logging.warning(what, len(left), min(left), other)
    return sorted(meshes)


def folder(
    source: str | os.PathLike[str],
    *,
    up: str = "auto",
    front: str = "auto",
    fractions: tuple[float, float, float] = FRACTIONS,
    max_faces: int = MAX_FACES,
) -> Catalogue:
    """All mesh files below a folder.

    `chairs/red.obj` is the model "chairs/red.obj" with the category "chairs". Files directly in the
    folder have no category. Files that a mesh refers to must be below the folder.

    Args:
      source: the folder.
      up: axis of the files that points up (`frame.AXES`), or "auto": +z for STL, PLY, OFF and
        3MF, +y for all others. Reading turns COLLADA files that state Z_UP to +y.
      front: axis of the files toward which the fronts of the objects point, or "auto": +z if y is
        up, -y if z is up.
      fractions: fractions of the models for training, validation and test, see `split_of`.
      max_faces: models with more faces are refused.

    Raises:
      ValueError: the folder is missing or contains no mesh, or an axis is wrong.
    """
    for axis in {up, front} - {"auto"}:
        axis_vector(axis)
    if up != "auto" and up[1] == front[1]:
        raise ValueError(f"front {front!r}: expected a direction perpendicular to up {up!r}")
    files = FolderFiles(source)
    entries = []
    for file in find_meshes(source):
        category = file.split("/")[0] if "/" in file else ""
        z_up = pathlib.PurePosixPath(file).suffix.lower() in _Z_UP
        here = ("+z" if z_up else "+y") if up == "auto" else up
        toward = ("-y" if here[1] == "z" else "+z") if front == "auto" else front
        load = functools.partial(
            load_model, file, files, up=here, front=toward, category=category, max_faces=max_faces,
        )  # fmt: skip
        find = functools.partial(files.path_of, file)
        entries.append(Entry(file, category, split_of(file, fractions), load, find_file=find))
    return Catalogue("folder", entries, fractions)

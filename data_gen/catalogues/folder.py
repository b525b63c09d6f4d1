"""Catalogues of folders: of meshes in any readable format, and of AC3D files."""

import functools
import os
import pathlib
from typing import Any

from absl import logging

from data_gen.catalogues import non_objects
from data_gen.catalogues.entry import FRACTIONS, Catalogue, Entry, split_of
from data_gen.frame import axis_vector
from data_gen.mesh import MAX_FACES
from data_gen.readers.ac3d import check_assimp, read_ac3d
from data_gen.readers.files import FolderFiles
from data_gen.readers.load import load_model

# Formats in which z usually points up; in the others it is y.
_Z_UP = (".stl", ".ply", ".off", ".3mf", ".xyz")

# Formats of models that cannot be read, or only with further packages (3MF: lxml and networkx).
_OTHERS = {".3mf", ".3ds", ".blend", ".fbx", ".step", ".stp", ".usd", ".usdz", ".wrl", ".x3d"}

# Catalogues that read the files which this catalogue cannot read.
_CATALOGUES = {".ac": "ac3d", ".acc": "ac3d", ".sh3f": "sh3f"}


def extensions() -> set[str]:
    """Suffixes of the mesh files that can be read, in lower case with the dot."""
    import trimesh

    not_meshes = {"dxf", "svg", "xyz", "binvox", "zip", "bz2", "tar.bz2", "tar.gz", "stl_ascii"}
    return {f".{kind}" for kind in {*trimesh.available_formats(), "obj"} - not_meshes}


def find_meshes(source: str | os.PathLike[str], endings: set[str]) -> list[str]:
    """The files below a folder with one of the suffixes (lower case), sorted, without hidden files.

    Raises:
      ValueError: the folder is missing or contains no such file.
    """
    root = pathlib.Path(source)
    if not root.is_dir():
        raise ValueError(f"source {str(source)!r}: expected a folder of meshes")
    meshes: list[str] = []
    left: list[str] = []
    for place, folders, files in os.walk(root):
        folders[:] = sorted(f for f in folders if not f.startswith("."))
        for file in files:
            ending = pathlib.Path(file).suffix.lower()
            if not file.startswith(".") and ending in endings | _OTHERS | set(_CATALOGUES):
                name = (pathlib.Path(place) / file).relative_to(root).as_posix()
                (meshes if ending in endings else left).append(name)
    suffixes = {pathlib.PurePosixPath(name).suffix.lower() for name in left} & set(_CATALOGUES)
    other = ", ".join(f"--catalogue={_CATALOGUES[s]} reads {s} files" for s in sorted(suffixes))
    if not meshes:
        raise ValueError(
            f"source {str(source)!r}: it contains no mesh, expected files with one of the suffixes "
            f"{sorted(endings)}{other and f'; {other}'}"
        )
    if left:
        logging.warning(
            "%d files that look like models but cannot be read here, such as %s: left out%s",
            len(left), min(left), f" ({other})" if other else "",
        )  # fmt: skip
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
    folder have no category. Files that a mesh refers to may be anywhere below the folder, but not
    outside.

    Args:
      source: the folder.
      up: axis of the files that points up (`frame.AXES`), or "auto": +z for STL, PLY, OFF and
        3MF, +y for all others.
      front: axis of the files toward which the fronts of the objects point, or "auto": +z if y is
        up, -y if z is up.
      fractions: fractions of the models for training, validation and test, see `split_of`.
      max_faces: models with more faces are refused.

    Raises:
      ValueError: the folder is missing or contains no mesh, or an axis is unknown.
    """
    names = find_meshes(source, extensions())
    return _meshes("folder", source, names, up, front, fractions, max_faces=max_faces)


def ac3d(
    source: str | os.PathLike[str],
    *,
    up: str = "+y",
    front: str = "-x",
    fractions: tuple[float, float, float] = FRACTIONS,
) -> Catalogue:
    """All AC3D files below a folder, the models of flight and racing simulators.

    `Maritime/Civilian/ferry.ac` is a model with this name and the category "Maritime". Files
    directly in the folder have no category. Textures may be anywhere below the folder, but not
    outside. Files without an object (`non_objects`) are refused, and those in FlightGear's folders
    of clouds, the sky, lights and smoke are left out.

    Args:
      source: the folder.
      up: axis of the files that points up (`frame.AXES`).
      front: axis of the files toward which the fronts of the objects point. The default is that of
        FlightGear's models; for the cars of TORCS it is +x.
      fractions: fractions of the models for training, validation and test, see `split_of`.

    Raises:
      ValueError: the folder is missing or contains no such file, an axis is unknown, or assimp is
        not installed.
    """
    check_assimp("ac3d")
    names = find_meshes(source, {".ac", ".acc"})
    kept = [n for n in names if not set(n.split("/")[:-1]) & set(non_objects.FOLDERS)]
    if len(kept) < len(names):
        folders = ", ".join(non_objects.FOLDERS)
        logging.info("%d files in folders named %s: left out", len(names) - len(kept), folders)
    return _meshes("ac3d", source, kept, up, front, fractions, reader=read_ac3d,
                   objection=non_objects.objection)  # fmt: skip


def _meshes(
    name: str,
    source: str | os.PathLike[str],
    files: list[str],
    up: str,
    front: str,
    fractions: tuple[float, float, float],
    **options: Any,
) -> Catalogue:
    for axis in {up, front} - {"auto"}:
        axis_vector(axis)
    root = FolderFiles(source)
    entries = []
    for file in files:
        category = file.split("/")[0] if "/" in file else ""
        z_up = pathlib.PurePosixPath(file).suffix.lower() in _Z_UP
        here = ("+z" if z_up else "+y") if up == "auto" else up
        toward = ("-y" if here[1] == "z" else "+z") if front == "auto" else front
        load = functools.partial(
            load_model, file, root, up=here, front=toward, category=category, **options,
        )  # fmt: skip
        entries.append(Entry(file, category, split_of(file, fractions), load))
    return Catalogue(name, entries, fractions)

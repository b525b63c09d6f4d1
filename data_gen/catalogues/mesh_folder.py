"""Catalogue of a folder of meshes in any readable format."""

import functools
import os
import pathlib

from absl import logging

from data_gen.catalogues.entry import FRACTIONS, Catalogue, Entry, split_of
from data_gen.frame import axis_vector
from data_gen.mesh import MAX_FACES
from data_gen.readers.load import READERS, load_model
from data_gen.readers.model_files import FolderFiles

# Formats in which z usually points up. In other formats, y does.
_Z_UP = (".stl", ".ply", ".off", ".3mf")

# Formats that we cannot read.
_OTHERS = {".3ds", ".blend", ".fbx", ".step", ".stp", ".usd", ".usdz", ".wrl", ".x3d",
           ".sh3f"}  # fmt: skip


_ARCHIVES = (".zip", ".7z", ".rar", ".tar", ".tgz", ".gz", ".bz2", ".xz", ".zst")


def _ending(name: str) -> str:
    """The suffix of a file's format, without `.gz`."""
    return pathlib.PurePosixPath(name.lower().removesuffix(".gz")).suffix


def find_meshes(source: str | os.PathLike[str]) -> tuple[list[str], list[str]]:
    """The mesh files below a folder, sorted, and the folders outside of it to which links lead.

    We follow links to folders, and enter each folder once.

    Raises:
      ValueError: there are no mesh files.
    """
    root = pathlib.Path(source)
    if not root.is_dir():
        raise ValueError(f"source {str(source)!r}: expected a folder of meshes")
    top = root.resolve()
    seen, linked = {top}, []

    def is_new(path: pathlib.Path) -> bool:
        real = path.resolve()
        if real in seen or (path.is_symlink() and real.is_relative_to(top)):
            return False
        seen.add(real)
        if path.is_symlink():
            linked.append(str(real))
        return True

    endings = {f".{kind}" for kind in READERS}
    found: dict[str, list[str]] = {"meshes": [], "others": [], "archives": []}
    for path, folders, files in os.walk(root, followlinks=True):
        here = pathlib.Path(path)
        folders[:] = sorted(f for f in folders if not f.startswith(".") and is_new(here / f))
        for file in files:
            ending = _ending(file)
            kind = "meshes" if ending in endings else "others" if ending in _OTHERS else ""
            kind = kind or "archives" * file.lower().endswith(_ARCHIVES)
            if kind and not file.startswith("."):
                found[kind].append((here / file).relative_to(root).as_posix())
    left, archives = found["others"], found["archives"]
    other = "; catalogue sh3f reads .sh3f files" * any(n.lower().endswith(".sh3f") for n in left)
    packed = f"; {len(archives)} archives, such as {min(archives or ' ')}: unpack them"
    packed *= bool(archives)
    if not found["meshes"]:
        expected = f"expected files with one of the suffixes {sorted(endings)}{other}{packed}"
        raise ValueError(f"source {str(source)!r}: it contains no mesh, {expected}")
    if left:
        other = f"; {len(left)} that look like models, such as {min(left)}{other}"
    if left or archives:
        logging.warning("files that cannot be read here are left out%s%s", other, packed)
    return sorted(found["meshes"]), linked


def folder(
    source: str | os.PathLike[str],
    *,
    up: str = "auto",
    front: str = "auto",
    fractions: tuple[float, float, float] = FRACTIONS,
    max_faces: int = MAX_FACES,
) -> Catalogue:
    """All mesh files below a folder.

    `chairs/red.obj` is the model "chairs/red.obj" with the category "chairs"; files that are not in
    a subfolder have no category. Files that a mesh refers to must be below the folder, or below a
    folder to which a link in it leads.

    Args:
      source: the folder.
      up: axis of the files that points up (`frame.AXES`), or "auto": +z for STL, PLY, OFF and
        3MF, otherwise +y. The reader turns COLLADA files that state Z_UP to +y.
      front: axis of the files toward the fronts of the objects, or "auto": +z if y is up, -y if z
        is up.
      fractions: fractions of the models for training, validation and test, see `split_of`.
      max_faces: largest accepted number of faces of a model.

    Raises:
      ValueError: the folder is missing or contains no mesh, or an axis is wrong.
    """
    for axis in {up, front} - {"auto"}:
        axis_vector(axis)
    if up != "auto" and up[1] == front[1]:
        raise ValueError(f"front {front!r}: expected a direction perpendicular to up {up!r}")
    meshes, linked = find_meshes(source)
    files = FolderFiles(source, linked)
    entries = []
    for file in meshes:
        category = file.split("/")[0] if "/" in file else ""
        z_up = _ending(file) in _Z_UP
        here = ("+z" if z_up else "+y") if up == "auto" else up
        toward = ("-y" if here[1] == "z" else "+z") if front == "auto" else front
        load = functools.partial(
            load_model, file, files, up=here, front=toward, category=category, max_faces=max_faces,
        )  # fmt: skip
        find = functools.partial(files.find, file)
        entries.append(Entry(file, category, split_of(file, fractions), load, find_file=find))
    return Catalogue("folder", entries, fractions)

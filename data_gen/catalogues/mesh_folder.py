"""Catalogue of a folder of meshes in any readable format."""

import collections
import functools
import os
import pathlib
from collections.abc import Sequence

from absl import logging

from data_gen.catalogues.entry import FRACTIONS, Catalogue, Entry, split_of
from data_gen.frame import axis_vector
from data_gen.mesh import MAX_FACES
from data_gen.readers.load import READERS, load_model
from data_gen.readers.model_files import FolderFiles
from psgn_jax.system.untrusted import message_line, one_line

# Formats in which z usually points up. In other formats, y does.
_Z_UP = (".stl", ".ply", ".off", ".3mf")

# Formats that we cannot read, and archives.
_OTHERS = {".3ds", ".blend", ".fbx", ".step", ".stp", ".usd", ".usdz", ".wrl", ".x3d", ".sh3f",
           ".zip", ".7z", ".rar", ".tar", ".tgz", ".bz2", ".xz", ".zst"}  # fmt: skip


def _ending(name: str) -> str:
    """The suffix of a file's format, without `.gz`."""
    return pathlib.PurePosixPath(name.lower().removesuffix(".gz")).suffix


def find_meshes(source: str | os.PathLike[str], linked: Sequence[str] = ()) -> list[str]:
    """The mesh files below a folder, sorted; a warning names what we leave out.

    We follow a link to a folder below the source or below one of the folders `linked`, and enter
    each folder once.

    Raises:
      ValueError: there are no mesh files.
    """
    root = pathlib.Path(source)
    if not root.is_dir():
        raise ValueError(f"source {str(source)!r}: expected a folder of meshes")
    top = root.resolve()
    homes = [pathlib.Path(folder).resolve() for folder in linked]
    seen, outside = {top}, []

    def is_new(path: pathlib.Path) -> bool:
        real = path.resolve()
        if real in seen or (path.is_symlink() and real.is_relative_to(top)):
            return False
        if path.is_symlink() and not any(real.is_relative_to(home) for home in homes):
            outside.append(f"{path.relative_to(root)} -> {real}")
            return False
        seen.add(real)
        return True

    meshes: list[str] = []
    left: collections.Counter[str] = collections.Counter()
    closed: list[OSError] = []
    for path, folders, files in os.walk(root, onerror=closed.append, followlinks=True):
        here = pathlib.Path(path)
        folders[:] = sorted(f for f in folders if not f.startswith(".") and is_new(here / f))
        for file in files:
            ending = _ending(file)
            if ending[1:] in READERS and not file.startswith("."):
                meshes.append((here / file).relative_to(root).as_posix())
            elif ending in _OTHERS:
                left[ending] += 1
    for error in closed:
        logging.warning("a folder that cannot be listed is left out: %s", message_line(error))
    if outside:
        what = "links out of the source are left out; linked=FOLDER follows those into FOLDER: %s"
        logging.warning(what, one_line(", ".join(sorted(outside)[:9])))
    counts = ", ".join(f"{count} {ending}" for ending, count in sorted(left.items()))
    counts += " (unpack archives; catalogue sh3f reads .sh3f)"
    if not meshes:
        expected = f"expected files with one of the suffixes {sorted(READERS)}"
        there = f"; it has {counts}" * bool(left)
        raise ValueError(f"source {str(source)!r}: it contains no mesh, {expected}{there}")
    if left:
        logging.warning("files that cannot be read here are left out: %s", counts)
    return sorted(meshes)


def folder(
    source: str | os.PathLike[str],
    *,
    up: str = "auto",
    front: str = "auto",
    fractions: tuple[float, float, float] = FRACTIONS,
    max_faces: int = MAX_FACES,
    linked: tuple[str, ...] = (),
) -> Catalogue:
    """All mesh files below a folder.

    `chairs/red.obj` is the model "chairs/red.obj" with the category "chairs"; files that are not in
    a subfolder have no category. Files that a mesh refers to must be below the folder.

    Args:
      source: the folder.
      up: axis of the files that points up (`frame.AXES`), or "auto": +z for STL, PLY, OFF and
        3MF, otherwise +y. The reader turns COLLADA files that state Z_UP to +y.
      front: axis of the files toward the fronts of the objects, or "auto": +z if y is up, -y if z
        is up.
      fractions: fractions of the models for training, validation and test, see `split_of`.
      max_faces: largest accepted number of faces of a model.
      linked: folders outside of the source that links in it may lead to.

    Raises:
      ValueError: the folder is missing or contains no mesh, or an axis is wrong.
    """
    for axis in {up, front} - {"auto"}:
        axis_vector(axis)
    if up != "auto" and up[1] == front[1]:
        raise ValueError(f"front {front!r}: expected a direction perpendicular to up {up!r}")
    files = FolderFiles(source, linked)
    entries = []
    meshes = find_meshes(source, linked)
    names = collections.Counter(os.path.splitext(file.removesuffix(".gz"))[0] for file in meshes)
    if twice := sorted(name for name, count in names.items() if count > 1):
        what = "%d objects are there in several formats, perhaps in several splits: %s"
        logging.warning(what, len(twice), one_line(", ".join(twice[:9])))
    for file in meshes:
        category = file.split("/")[0] if "/" in file else ""
        z_up = _ending(file) in _Z_UP
        here = ("+z" if z_up else "+y") if up == "auto" else up
        toward = ("-y" if here[1] == "z" else "+z") if front == "auto" else front
        load = functools.partial(
            load_model, file, files, up=here, front=toward, max_faces=max_faces
        )
        find = functools.partial(files.find, file)
        entries.append(Entry(file, category, split_of(file, fractions), load, find))
    return Catalogue("folder", entries, fractions)

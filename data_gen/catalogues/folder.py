"""Catalogue of a folder of meshes in any readable format; subfolders are the categories."""

import os
import pathlib
from collections.abc import Callable, Iterator, Sequence

from absl import logging

from data_gen.catalogues.entry import FRACTIONS, Entry, loader, split_of
from data_gen.frame import axis_vector
from data_gen.mesh import MAX_FACES, Model, UnusableModelError
from data_gen.readers.files import FolderFiles
from data_gen.readers.load import Reader, load_model

# Formats in which z usually points up; in the others it is y.
_Z_UP = (".stl", ".ply", ".off", ".3mf", ".xyz")

# Formats of models that cannot be read, or only with further packages (3MF: lxml and networkx).
_OTHERS = {
    ".3mf",
    ".3ds",
    ".ac",
    ".blend",
    ".fbx",
    ".step",
    ".stp",
    ".usd",
    ".usdz",
    ".wrl",
    ".x3d",
}

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
            if file.startswith("."):
                continue
            ending = pathlib.Path(file).suffix.lower()
            if ending in endings | _OTHERS | set(_CATALOGUES):
                name = (pathlib.Path(place) / file).relative_to(root).as_posix()
                (meshes if ending in endings else left).append(name)
    other = _other_catalogue(left)
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


def _other_catalogue(names: list[str]) -> str:
    """A hint at the catalogues that can read the files; "" = none."""
    suffixes = {pathlib.PurePosixPath(name).suffix.lower() for name in names} & set(_CATALOGUES)
    return ", ".join(
        f"--catalogue={_CATALOGUES[ending]} reads {ending} files" for ending in sorted(suffixes)
    )


def _load(
    root: str,
    name: str,
    category: str,
    up: str,
    front: str,
    max_faces: int,
    reader: Reader | None,
    objection: Callable[[str, Model], str] | None,
) -> Model:
    model = load_model(
        name,
        FolderFiles(root),
        up=up,
        front=front,
        category=category,
        model_id=name,
        max_faces=max_faces,
        reader=reader,
    )
    reason = objection(name, model) if objection else ""
    if reason:
        raise UnusableModelError(reason)
    return model


class FolderCatalogue:
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
      fractions: fractions of the models for training, validation and test, see
        `catalogues.entry.split_of`.
      max_faces: models with more faces are refused.
      leave_out: names of folders at any depth whose files are left out.

    Raises:
      ValueError: the folder is missing or contains no mesh, or an axis is unknown.
    """

    name = "folder"
    _reader: Reader | None = None  # None = chosen by the suffix
    _objection: Callable[[str, Model], str] | None = None

    def __init__(
        self,
        source: str | os.PathLike[str],
        *,
        up: str = "auto",
        front: str = "auto",
        fractions: tuple[float, float, float] = FRACTIONS,
        max_faces: int = MAX_FACES,
        leave_out: Sequence[str] = (),
    ) -> None:
        self.root = pathlib.Path(source)
        for axis in {up, front} - {"auto"}:
            axis_vector(axis)
        self._up, self._front, self._fractions, self._max_faces = up, front, fractions, max_faces
        names = find_meshes(source, self._endings())
        self._names = [n for n in names if not set(n.split("/")[:-1]) & set(leave_out)]
        if not self._names:
            raise ValueError(
                f"source {str(source)!r}: all of its {len(names)} meshes are in folders that are "
                f"left out (leave_out={','.join(leave_out)}), expected at least one mesh elsewhere"
            )
        if len(self._names) < len(names):
            logging.info(
                "%d files in folders named %s: left out, see the option leave_out",
                len(names) - len(self._names), ", ".join(leave_out),
            )  # fmt: skip

    def _endings(self) -> set[str]:
        return extensions()

    def __len__(self) -> int:
        """Number of mesh files."""
        return len(self._names)

    def entries(self) -> Iterator[Entry]:
        """The files, sorted by name."""
        for name in self._names:
            category = name.split("/")[0] if "/" in name else ""
            z_up = pathlib.PurePosixPath(name).suffix.lower() in _Z_UP
            up = ("+z" if z_up else "+y") if self._up == "auto" else self._up
            front = ("-y" if up[1] == "z" else "+z") if self._front == "auto" else self._front
            yield Entry(
                name,
                category,
                split_of(name, self._fractions),
                loader(
                    _load,
                    str(self.root),
                    name,
                    category,
                    up,
                    front,
                    self._max_faces,
                    self._reader,
                    self._objection,
                ),
            )

"""Sweet Home 3D furniture libraries: `.sh3f` files, zip archives with a catalogue inside.

`PluginFurnitureCatalog.properties` names each model, its category, its size in centimetres and the
rotation of its file. The archives are read in place: nothing is ever unpacked to disk, no name in
an archive can lead out of it, and what is read of a member is bounded whatever its header says.
"""

import dataclasses
import functools
import os
import pathlib
import re
import zipfile
import zlib
from collections.abc import Iterator

import numpy as np
from absl import logging

from data_gen import catalogues, loading, meshes
from data_gen.catalogues import Entry
from data_gen.meshes import Model, UnusableModelError

PROPERTIES = "PluginFurnitureCatalog.properties"

_MAX_MEMBERS = 200_000
_MAX_PROPERTIES_BYTES = 16 << 20
# Text of meshes shrinks by 3 to 10; a member above this ratio is made to exhaust memory. Small
# ones are let through: a picture of one colour shrinks by a thousand.
_MAX_RATIO = 200
_RATIO_FROM = 8 << 20


class ZipFiles(loading.Files):
    """Members of a zip archive."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._archive = zipfile.ZipFile(path)
        members = self._archive.infolist()
        if len(members) > _MAX_MEMBERS:
            raise ValueError(f"{len(members)} members are more than the limit of {_MAX_MEMBERS}")
        self._members = {m.filename.replace("\\", "/"): m for m in members if not m.is_dir()}
        self._folded = {name.casefold(): name for name in self._members}

    def find(self, name: str) -> str | None:
        """See `loading.Files`; nothing but names in the archive is ever looked up."""
        return name if name in self._members else self._folded.get(name.casefold())

    def read(self, name: str, limit: int = loading.MAX_FILE_BYTES) -> bytes:
        """See `loading.Files`.

        Raises:
          UnusableModelError: the member is too large, damaged or compressed like a bomb.
        """
        member = self._members[name]
        if member.file_size > limit:
            raise UnusableModelError(
                f"{name!r} has {member.file_size} bytes, more than the limit of {limit}"
            )
        ratio = member.file_size / max(member.compress_size, 1)
        if member.file_size > _RATIO_FROM and ratio > _MAX_RATIO:
            raise UnusableModelError(f"{name!r} shrank by {ratio:.0f}: a zip bomb is not opened")
        try:
            with self._archive.open(member) as stream:
                data = stream.read(limit + 1)
        except (zipfile.BadZipFile, zlib.error, OSError, RuntimeError, EOFError,
                NotImplementedError) as error:  # fmt: skip
            raise UnusableModelError(f"{name!r} is damaged: {error}"[:200]) from error
        if len(data) > limit:
            raise UnusableModelError(f"{name!r} has more bytes than the limit of {limit}")
        return data


@functools.lru_cache(maxsize=8)
def _archive(path: str, _modified: int) -> ZipFiles:
    return ZipFiles(path)


def _files(path: str) -> ZipFiles:
    """The archive, kept open between the models that a process loads."""
    return _archive(path, os.stat(path).st_mtime_ns)


def parse_properties(text: str) -> dict[str, str]:
    r"""Keys and values of a Java properties file, whose characters are read as Latin-1.

    Comments (`#`, `!`), the separators `=`, `:` and blank, lines that go on after a backslash, and
    the escapes `\\uXXXX`, `\\t`, `\\n` are understood.
    """
    escape = re.compile(r"\\(?:u([0-9a-fA-F]{4})|(.))", re.DOTALL)

    def plain(match: re.Match[str]) -> str:
        if match[1]:
            return chr(int(match[1], 16))
        return {"t": "\t", "n": "\n", "r": "\r", "f": "\f"}.get(match[2], match[2])

    result: dict[str, str] = {}
    pending = ""
    for raw in re.split(r"\r\n|\r|\n", text):
        line = pending + raw.lstrip(" \t\f")
        if not pending and (not line or line[0] in "#!"):
            continue
        if (len(line) - len(line.rstrip("\\"))) % 2:
            pending = line[:-1]
            continue
        pending = ""
        match = re.match(r"((?:\\.|[^\\=: \t\f])*)[ \t\f]*[=:]?[ \t\f]*(.*)", line, re.DOTALL)
        assert match is not None  # both parts may be empty
        result[escape.sub(plain, match[1])] = escape.sub(plain, match[2])
    return result


@dataclasses.dataclass(frozen=True)
class Furniture:
    """One piece of a library: its identity, file, size (width, depth, height) and rotation."""

    model_id: str
    name: str
    category: str
    file: str
    size: tuple[float, float, float]
    rotation: tuple[float, ...]


def _numbers(text: str, count: int) -> tuple[float, ...]:
    """`count` finite numbers, or none."""
    try:
        values = tuple(float(w) for w in text.split())
    except ValueError:
        return ()
    return values if len(values) == count and np.isfinite(values).all() else ()


def read_library(path: str | os.PathLike[str]) -> list[Furniture]:
    """The pieces of a library in its order.

    Raises:
      ValueError: the file is no such library; names it and says why.
    """
    try:
        files = ZipFiles(path)
        found = files.find(PROPERTIES)
        if found is None:
            raise ValueError(f"it has no {PROPERTIES}")
        table = parse_properties(files.read(found, _MAX_PROPERTIES_BYTES).decode("latin-1"))
    except (zipfile.BadZipFile, OSError, ValueError, NotImplementedError) as error:
        raise ValueError(f"library {str(path)!r} cannot be read: {error}") from error
    numbers = sorted(
        int(key.partition("#")[2])
        for key in table
        if key.startswith("model#") and re.fullmatch(r"[0-9]{1,9}", key.partition("#")[2])
    )
    pieces = []
    stem = pathlib.Path(path).stem
    for n in numbers:
        name = table.get(f"name#{n}", "")
        identity = table.get(f"id#{n}") or name or str(n)
        size = tuple(
            (_numbers(table.get(f"{key}#{n}", ""), 1) or (0.0,))[0]
            for key in ("width", "depth", "height")
        )
        pieces.append(
            Furniture(
                model_id=f"{stem}/{identity}",
                name=name,
                category=table.get(f"category#{n}", ""),
                file=table[f"model#{n}"].lstrip("/"),
                size=(size[0], size[1], size[2]),
                rotation=_numbers(table.get(f"modelRotation#{n}", ""), 9),
            )
        )
    return pieces


def _place(model: Model, rotation: tuple[float, ...], size: tuple[float, float, float]) -> Model:
    """Turns and stretches a model as the program does that the library is made for."""
    matrix = np.eye(3)
    if rotation:
        given = np.array(rotation).reshape(3, 3)
        if abs(abs(np.linalg.det(given)) - 1) < 0.1:
            matrix = given
    turned = model.vertices @ matrix.T
    extent = np.ptp(turned, axis=0)
    target = np.array([size[0], size[2], size[1]])  # width, height, depth: x, y, z of the file
    known = (target > 0) & (extent > 1e-6 * extent.max())
    if known.any():
        scale = np.where(known, target / np.where(known, extent, 1), 0)
        # A direction without extent or size takes part in none of the stretching.
        scale = np.where(known, scale, scale[known].mean())
        # What would be stretched beyond recognition has a wrong size in the catalogue.
        if scale.max() < 20 * scale.min():
            matrix = scale[:, None] * matrix
    return model.transformed(np.concatenate([matrix, np.zeros((3, 1))], axis=1))


def _load(path: str, piece: Furniture, max_faces: int) -> Model:
    try:
        files = _files(path)
    except (zipfile.BadZipFile, OSError, ValueError) as error:
        raise UnusableModelError(f"library {path!r} cannot be read: {error}"[:200]) from error
    return loading.load(
        piece.file,
        files,
        up="+y",
        front="+z",
        category=piece.category,
        model_id=piece.model_id,
        parameters={"name": piece.name, "size_cm": piece.size},
        max_faces=max_faces,
        turn=functools.partial(_place, rotation=piece.rotation, size=piece.size),
    )


class SweetHomeCatalogue:
    """The pieces of one `.sh3f` library, or of all in a folder.

    A model is named `<library>/<id of the piece>`; its category is the library's, such as
    "Living room".

    Args:
      source: the file or folder.
      fractions: of models for training, validation and test, see `catalogues.split_of`.
      max_faces: models with more are refused.

    Raises:
      ValueError: no library there, or none that can be read; others are left out with a warning.
    """

    name = "sh3f"

    def __init__(
        self,
        source: str | os.PathLike[str],
        *,
        fractions: tuple[float, float, float] = catalogues.FRACTIONS,
        max_faces: int = meshes.MAX_FACES,
    ) -> None:
        path = pathlib.Path(source)
        libraries = sorted(path.rglob("*.sh3f")) if path.is_dir() else [path]
        if not libraries or not libraries[0].is_file():
            raise ValueError(f"source {str(source)!r}: expected a .sh3f file or a folder with some")
        self._fractions, self._max_faces = fractions, max_faces
        pieces, problems = [], []
        for library in libraries:
            try:
                pieces += [(str(library), piece) for piece in read_library(library)]
            except ValueError as error:
                problems.append(str(error))
        if not pieces and problems:
            raise ValueError("; ".join(problems))
        for problem in problems:
            logging.warning("left out: %s", problem)
        names = catalogues.unique_names([piece.model_id for _, piece in pieces])
        self._pieces = [
            (library, dataclasses.replace(piece, model_id=name))
            for (library, piece), name in zip(pieces, names, strict=True)
        ]

    def __len__(self) -> int:
        """Number of pieces."""
        return len(self._pieces)

    def entries(self) -> Iterator[Entry]:
        """The pieces, library after library."""
        for library, piece in self._pieces:
            yield Entry(
                piece.model_id,
                piece.category,
                catalogues.split_of(piece.model_id, self._fractions),
                catalogues.loader(_load, library, piece, self._max_faces),
            )

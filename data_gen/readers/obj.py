"""Reader of Wavefront OBJ files.

Two large collections of training shapes, ShapeNet and Sweet Home 3D, are OBJ files. They contain
many features that other readers ignore silently: missing and negative indices, several material
files, options before the names of textures, alpha maps, missing images, concave polygons. Therefore
this project has its own reader.
"""

import posixpath
import warnings as python_warnings
from collections.abc import Iterator
from typing import Any

import numpy as np

from data_gen.mesh import Material, UnusableModelError
from data_gen.polygons import triangles
from data_gen.readers.files import Files
from data_gen.readers.mtl import read_mtl
from data_gen.readers.notes import Notes
from data_gen.readers.textures import Textures, bounded


def _blocks(data: bytes, size: int = 1 << 22) -> Iterator[bytes]:
    """Splits a text into blocks of whole lines; continued lines (backslash) are joined."""
    start = 0
    while start < len(data):
        stop = data.find(b"\n", min(start + size, len(data)))
        while stop != -1 and data[max(stop - 2, 0) : stop].rstrip(b"\r").endswith(b"\\"):
            stop = data.find(b"\n", stop + 1)
        stop = len(data) if stop == -1 else stop + 1
        block = data[start:stop]
        if b"\\" in block:
            block = block.replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
        yield block
        start = stop


_V, _VT, _VN, _F, _OTHER = range(5)

_SPACE = 32

_MOST_LIBRARIES = 1000  # largest number of material files of a model; others are ignored


class _Lines:
    """The lines of a block of an OBJ file, classified by their statements.

    Everything is computed with arrays over bytes, words or lines, without a Python loop over the
    lines. Unusual lines are handled by slower code with the same result.

    Args:
      block: whole lines.
    """

    def __init__(self, block: bytes) -> None:
        self._bytes = np.frombuffer(block + b"\n\n\n\n", np.uint8).copy()
        space = self._bytes <= _SPACE
        begins = ~space
        begins[1:] &= space[:-1]
        self._word = np.flatnonzero(begins)
        ends = np.flatnonzero(self._bytes == ord("\n"))
        self._length = np.diff(ends, prepend=-1)
        line_of_word = np.searchsorted(ends, self._word)
        words = np.bincount(line_of_word, minlength=len(ends))
        full = np.flatnonzero(words)
        first = self._word[(np.cumsum(words) - words)[full]]
        one, two, three = (self._bytes[first + k] for k in range(3))
        kind = np.full(len(full), _OTHER)
        kind[(one == ord("v")) & (two <= _SPACE)] = _V
        kind[(one == ord("v")) & (two == ord("t")) & (three <= _SPACE)] = _VT
        kind[(one == ord("v")) & (two == ord("n")) & (three <= _SPACE)] = _VN
        kind[(one == ord("f")) & (two <= _SPACE)] = _F
        kind[(words[full] < 2) & (kind != _OTHER)] = -1  # a statement without arguments
        self.kind = np.full(len(ends), -1)
        self.kind[full] = kind
        self.words = words - 1  # without the keyword
        self._ends = ends
        # The keywords are replaced by blanks, so that only numbers are left.
        numbers = kind != _OTHER
        self._bytes[first[numbers]] = _SPACE
        double = first[(kind == _VT) | (kind == _VN)] + 1
        self._bytes[double] = _SPACE

    def numbers(self, kind: int) -> bytes:
        """The arguments of all lines of a kind."""
        return self._bytes[np.repeat(self.kind == kind, self._length)[: len(self._bytes)]].tobytes()

    def text(self, line: int | np.integer[Any]) -> str:
        """The text of a line."""
        stop = self._ends[line]
        return (
            self._bytes[stop + 1 - self._length[line] : stop].tobytes().decode("utf-8", "replace")
        )

    def rows(self, kind: int, columns: int) -> np.ndarray:
        """The numbers of the lines of a kind; short lines are padded with 0, long lines cut.

        Raises:
          ValueError: a word is not a number.
        """
        counts = self.words[self.kind == kind]
        values = _parsed(self.numbers(kind), np.float64)
        if len(values) != counts.sum():
            fill = ["0"] * columns
            lines = [self.text(i).split() for i in np.flatnonzero(self.kind == kind)]
            return np.array([[*words, *fill][:columns] for words in lines], np.float64)
        if len(counts) and (counts == counts[0]).all() and counts[0] >= columns:
            return values.reshape(len(counts), -1)[:, :columns]
        column = np.arange(columns)
        place = (np.cumsum(counts) - counts)[:, None] + column
        there = column < counts[:, None]
        padded = np.append(values, 0.0)
        return np.where(there, padded[np.where(there, place, 0)], 0.0)

    def corners(self) -> tuple[np.ndarray, np.ndarray]:
        """Corners [n, 3] of the face lines as written, 0 = not given, and their number per line.

        Raises:
          ValueError: a word is not a corner.
        """
        counts = self.words[self.kind == _F]
        text = self.numbers(_F)
        if b"#" in text:
            lines = [self.text(i).split("#")[0].split() for i in np.flatnonzero(self.kind == _F)]
            return _indices([w for words in lines for w in words]), np.array(
                [len(words) for words in lines]
            )
        total = int(counts.sum())
        values = self._uniform(text, total)
        if values is None:
            values = _indices(text.decode("utf-8", "replace").split())
        return values, counts

    @staticmethod
    def _uniform(text: bytes, total: int) -> np.ndarray | None:
        """The corners, if all are written in the same form; otherwise None."""
        if not total:
            return np.zeros((0, 3), np.int64)
        text = text.replace(b"//", b"/0/")
        letters = np.frombuffer(text + b"\n", np.uint8)
        slash = np.flatnonzero(letters == ord("/"))
        space = letters <= _SPACE
        begins = ~space
        begins[1:] &= space[:-1]
        word = np.flatnonzero(begins)
        number = np.bincount(np.searchsorted(word, slash, side="right") - 1, minlength=total)
        if len(number) != total or (number != number[0]).any() or number[0] > 2:
            return None
        if space[slash + 1].any() or begins[slash].any():
            return None
        columns = int(number[0]) + 1
        text = text.replace(b"/", b" ")
        values = _parsed(text, np.int64)
        if len(values) != total * columns or np.abs(values).max() > 1 << 60:
            return None
        result = np.zeros((total, 3), np.int64)
        result[:, :columns] = values.reshape(total, columns)
        return result


def _parsed(text: bytes, kind: type) -> np.ndarray:
    """Numbers separated by blanks; the result is shorter if a word is not a number."""
    with python_warnings.catch_warnings():
        python_warnings.simplefilter("error", DeprecationWarning)  # raised by older numpy releases
        try:
            return np.fromstring(text, kind, sep=" ")
        except (ValueError, DeprecationWarning):
            return np.zeros(0, kind)


def _indices(tokens: list[str]) -> np.ndarray:
    """`a`, `a/b`, `a//c` and `a/b/c` as int64 [n, 3]; 0 = not given."""
    parts = [p or "0" for t in tokens for p in [*t.split("/"), "0", "0"][:3]]
    return np.array(parts, str).astype(np.int64).reshape(-1, 3)


def _resolve(index: np.ndarray, count: np.ndarray | int) -> np.ndarray:
    """OBJ indices (from 1, negative = from the end) to indices from 0; -1 = none."""
    return np.where(index > 0, index - 1, np.where(index < 0, index + count, -1))


def read_obj(
    data: bytes, files: Files, base: str, side: int, max_faces: int, notes: Notes
) -> dict[str, Any]:
    """Arrays of an OBJ file for `mesh.build_model`.

    Deliberately one function: one pass over the blocks of the file, with counts that continue from
    block to block.
    """
    columns = {_V: 3, _VT: 2, _VN: 3}
    rows: dict[int, list[np.ndarray]] = {kind: [np.zeros((0, n))] for kind, n in columns.items()}
    read = dict.fromkeys(columns, 0)
    textures = Textures(files, base, side, notes)
    materials: dict[str, Material] = {}
    names: dict[str, int] = {}
    libraries: set[str] = set()
    owner = -1
    owner_blocks: list[np.ndarray] = []
    count_blocks: list[np.ndarray] = []
    corner_blocks: list[np.ndarray] = []
    total = broken = 0
    for block in _blocks(data):
        lines = _Lines(block)
        # The material of each face of the block. Faces before its first `usemtl` have the last
        # material of the previous block.
        changes, owners_here = [-1], [owner]
        for index in np.flatnonzero(lines.kind == _OTHER):
            words = lines.text(index).split(None, 1)
            if len(words) < 2:
                continue
            key, rest = words
            if key == "usemtl":
                owner = names.setdefault(rest.strip(), len(names))
                changes.append(int(index))
                owners_here.append(owner)
            elif key == "mtllib" and len(libraries) < _MOST_LIBRARIES:
                # Either one name, which may contain spaces, or several names.
                for name in [rest.strip()] if _exists(files, base, rest) else rest.split():
                    if name in libraries or len(libraries) == _MOST_LIBRARIES:
                        continue
                    libraries.add(name)
                    try:
                        text = files.open(base, name).decode("utf-8", "replace")
                        materials.update(read_mtl(text, textures))
                    except FileNotFoundError:
                        notes.add(f"material file {name!r} is missing; grey is used instead")
        try:
            fresh = {kind: lines.rows(kind, n) for kind, n in columns.items()}
            corner, counts = lines.corners()
        except (ValueError, OverflowError) as error:
            raise UnusableModelError(f"not readable as OBJ: {error}"[:200]) from error
        at = np.flatnonzero(lines.kind == _F)
        if len(at):
            enough = counts >= 3
            broken += int((~enough).sum())
            total += int((counts[enough] - 2).sum())
            if total > max_faces:
                raise UnusableModelError(f"more than the limit of {max_faces} faces")
            which = np.searchsorted(changes, at, side="right") - 1
            if (corner < 0).any():
                # Negative indices count back from the rows read before the face.
                seen = np.stack(
                    [read[kind] + np.cumsum(lines.kind == kind)[at] for kind in columns], axis=1
                )
                corner = _resolve(corner, np.repeat(seen, counts, axis=0))
            else:
                corner = corner - 1
            corner_blocks.append(corner[np.repeat(enough, counts)])
            owner_blocks.append(np.array(owners_here)[which][enough])
            count_blocks.append(counts[enough])
        for kind, values in fresh.items():
            rows[kind].append(values)
            read[kind] += len(values)
    if broken:
        notes.add(f"{broken} faces with less than three corners dropped")
    if not total:
        raise UnusableModelError("the mesh is empty: no faces, expected at least one")

    vertices, texture, normal = (np.concatenate(rows[kind]) for kind in (_V, _VT, _VN))
    corners = np.concatenate(corner_blocks)
    counts = np.concatenate(count_blocks)
    owners = np.concatenate(owner_blocks)
    exists = (corners[:, 0] >= 0) & (corners[:, 0] < len(vertices))
    whole = np.logical_and.reduceat(exists, np.cumsum(counts) - counts)
    if not whole.all():
        notes.add(f"{int((~whole).sum())} faces with missing vertices dropped")
        corners = corners[np.repeat(whole, counts)]
    counts, owners = counts[whole], owners[whole]
    if not len(counts):
        raise UnusableModelError("the mesh is empty: all faces have missing vertices")
    if not np.isfinite(vertices[corners[:, 0]]).all():
        raise UnusableModelError("vertices have coordinates that are not finite")
    triangle, polygon = triangles(counts, corners[:, 0], vertices)

    def of_corners(values: np.ndarray, column: int) -> np.ndarray | None:
        index = corners[triangle, column]
        good = (index >= 0) & (index < len(values))
        if not good.any():
            return None
        return np.where(good[..., None], values[np.where(good, index, 0)], 0)

    used = list(names)
    for name in used:
        if name not in materials and materials:
            notes.add(f"material {name!r} is missing; grey is used instead")
    table = [materials.get(name, Material(name=name)) for name in used]
    if (owners == -1).any():
        owners = np.where(owners == -1, len(table), owners)
        table.append(Material())
    return {
        "vertices": vertices,
        "faces": corners[triangle, 0],
        "normals": of_corners(normal, 2),
        "uv": of_corners(texture, 1),
        "materials": bounded(table, notes),
        "face_material": owners[polygon],
    }


def _exists(files: Files, base: str, name: str) -> bool:
    path = posixpath.normpath(posixpath.join(base, name.strip()))
    return not path.startswith(("/", "..")) and files.find(path) is not None

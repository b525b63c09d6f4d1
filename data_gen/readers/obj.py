"""Reader of Wavefront OBJ files.

ShapeNet and Sweet Home 3D have many features that other readers ignore silently: missing and
negative indices, several material files, options before the names of textures, alpha maps, missing
images, concave polygons.
"""

import posixpath
import warnings as python_warnings
from collections.abc import Iterator
from typing import Any

import numpy as np

from data_gen.mesh import Material, UnusableModelError
from data_gen.polygons import triangles
from data_gen.readers.mtl import read_mtl
from data_gen.readers.textures import Assets


def _blocks(data: bytes, size: int = 1 << 22) -> Iterator[bytes]:
    """Splits a text into blocks of whole lines; continued lines (backslash) are joined."""
    start = 3 * data.startswith(b"\xef\xbb\xbf")  # a byte-order mark
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


_MOST_LIBRARIES = 1000  # largest number of material files of a model; others are ignored

_COLUMNS = {"v": 3, "vt": 2, "vn": 3}


def _rows(lines: list[list[str]], columns: int) -> np.ndarray:
    """The words of lines as numbers [n, columns]; short lines are padded with 0."""
    if any(len(words) < columns for words in lines):
        lines = [[*words, "0", "0", "0"][:columns] for words in lines]
    return np.array(lines, np.float64).reshape(-1, columns)


def _indices(tokens: list[str]) -> np.ndarray:
    """`a`, `a/b`, `a//c` and `a/b/c` as int64 [n, 3]; 0 = not given."""
    slashes = {token.count("/") for token in tokens}
    columns = max(slashes, default=0) + 1
    if len(slashes) == 1 and columns <= 3:  # fast, as nearly all files have one form
        with python_warnings.catch_warnings():
            python_warnings.simplefilter("ignore", DeprecationWarning)  # the array is then shorter
            text = " ".join(tokens).replace("//", "/0/").replace("/", " ")
            values = np.fromstring(text, np.int64, sep=" ")
        if len(values) == columns * len(tokens) and np.abs(values).max() < 1 << 60:
            return np.pad(values.reshape(-1, columns), ((0, 0), (0, 3 - columns)))
    parts = [p or "0" for t in tokens for p in [*t.split("/"), "0", "0"][:3]]
    return np.array([int(p) for p in parts], np.int64).reshape(-1, 3)


def read_obj(data: bytes, assets: Assets) -> dict[str, Any]:
    """Arrays of an OBJ file for `mesh.build_model`, read in blocks so that memory is bounded."""
    rows = {key: [np.zeros((0, columns))] for key, columns in _COLUMNS.items()}
    read = dict.fromkeys(_COLUMNS, 0)  # number of rows of each kind so far
    materials: dict[str, Material] = {}
    names: dict[str, int] = {}
    libraries: set[str] = set()
    owner = -1
    owners_of_faces: list[int] = []
    sizes: list[int] = []
    corner_blocks: list[np.ndarray] = []
    total = broken = 0
    for block in _blocks(data):
        fresh: dict[str, list[list[str]]] = {key: [] for key in _COLUMNS}
        tokens: list[str] = []
        seen: list[tuple[int, int, int]] = []  # number of rows before each corner
        for line in block.decode("utf-8", "replace").split("\n"):
            key, *words = line.split() or [""]
            if not words:
                continue
            if key in ("v", "vt", "vn", "f") and "#" in line:
                words = line.split("#")[0].split()[1:]
            if key in fresh:
                fresh[key].append(words[: _COLUMNS[key]])
                read[key] += 1
            elif key == "f" and len(words) < 3:
                broken += 1
            elif key == "f":
                total += len(words) - 2
                tokens += words
                seen += [(read["v"], read["vt"], read["vn"])] * len(words)
                sizes.append(len(words))
                owners_of_faces.append(owner)
            elif key == "usemtl":
                owner = names.setdefault(line.split(None, 1)[1].strip(), len(names))
            elif key == "mtllib" and len(libraries) < _MOST_LIBRARIES:
                # Either one name, which may contain spaces, or several names.
                rest = line.split(None, 1)[1].strip().strip('"').replace("\\", "/")
                path = posixpath.normpath(posixpath.join(assets.base, rest))
                inside = not path.startswith(("/", ".."))
                for name in [rest] if inside and assets.files.find(path) else rest.split():
                    if name in libraries or len(libraries) == _MOST_LIBRARIES:
                        continue
                    libraries.add(name)
                    try:
                        text = assets.files.open(assets.base, name).decode("utf-8-sig", "replace")
                        materials.update(read_mtl(text, assets, posixpath.dirname(name)))
                    except FileNotFoundError:
                        assets.warn("material files missing, grey is used", repr(name))
        if total > assets.max_faces:
            raise UnusableModelError(f"more than the limit of {assets.max_faces} faces")
        try:
            for key, lines in fresh.items():
                rows[key].append(_rows(lines, _COLUMNS[key]))
            corners = _indices(tokens)
        except (ValueError, OverflowError) as error:
            raise UnusableModelError(f"not readable as OBJ: {error}"[:200]) from error
        if (corners < 0).any():  # counted back from the rows before the face
            corners += np.where(corners < 0, np.array(seen) + 1, 0)
        corner_blocks.append(corners - 1)  # from 0, and negative = none
    if broken:
        assets.warn("faces with less than three corners dropped", broken)
    if not total:
        raise UnusableModelError("the mesh is empty: no faces, expected at least one")

    vertices, texture, normal = (np.concatenate(blocks) for blocks in rows.values())
    corners, counts = np.concatenate(corner_blocks), np.array(sizes)
    owners = np.array(owners_of_faces)
    exists = (corners[:, 0] >= 0) & (corners[:, 0] < len(vertices))
    whole = np.logical_and.reduceat(exists, np.cumsum(counts) - counts)
    if not whole.all():
        assets.warn("faces with missing vertices dropped", int((~whole).sum()))
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

    for name in names:
        if name not in materials and materials:
            assets.warn("materials missing, grey is used", repr(name))
    table = [materials.get(name, Material(name=name)) for name in names]
    if (owners == -1).any():
        owners = np.where(owners == -1, len(table), owners)
        table.append(Material())
    return {
        "vertices": vertices,
        "faces": corners[triangle, 0],
        "normals": of_corners(normal, 2),
        "uv": of_corners(texture, 1),
        "materials": assets.bounded(table),
        "face_material": owners[polygon],
    }

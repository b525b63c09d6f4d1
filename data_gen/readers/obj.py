"""Reader of Wavefront OBJ files.

ShapeNet and Sweet Home 3D have many features that other readers ignore silently: missing and
negative indices, several material files, options before the names of textures, alpha maps, missing
images, concave polygons.
"""

import collections
import contextlib
import posixpath
import re
import warnings as python_warnings
from collections.abc import Iterator

import numpy as np

from data_gen.mesh import Material, UnusableModelError
from data_gen.readers.model_files import DamagedError, numbers, reason, whole_lines
from data_gen.readers.mtl import floats, read_mtl
from data_gen.readers.parts import Look, Part, picked, rgba
from data_gen.readers.textures import NO_COORDINATES, Assets
from psgn_jax.system.untrusted import one_line


def _blocks(data: bytes, size: int = 1 << 22) -> Iterator[bytes]:
    """Splits a text into blocks of whole lines."""
    start = 0
    while start < len(data):
        stop = data.find(b"\n", min(start + size, len(data))) + 1 or len(data)
        yield data[start:stop]
        start = stop


_MOST_LIBRARIES = 1000  # largest number of material files of a model; others are ignored

_COLUMNS = {"v": 3, "vt": 2, "vn": 3}

_UNREAD = {
    "v": "weights of vertices not read",
    "l": "lines and points not read", "p": "lines and points not read",
    "curv": "curves and surfaces not read", "curv2": "curves and surfaces not read",
    "surf": "curves and surfaces not read", "call": "files that OBJ calls not read",
    "#MRGB": "colours of ZBrush (#MRGB) not read",
}  # fmt: skip


def _rows(lines: list[list[str]], columns: int) -> np.ndarray:
    """The words of lines as numbers [n, columns]; short lines are padded with 0."""
    if any(len(words) < columns for words in lines):
        lines = [[*words, "0", "0", "0"][:columns] for words in lines]
    return numbers(lines).reshape(-1, columns)


def _indices(tokens: list[str]) -> np.ndarray:
    """`a`, `a/b`, `a//c` and `a/b/c` as int64 [n, 3]; 0 = not given."""
    slashes = {token.count("/") for token in tokens}
    columns = max(slashes, default=0) + 1
    if len(slashes) == 1 and columns <= 3:  # fast, as nearly all files have one form
        with contextlib.suppress(ValueError), python_warnings.catch_warnings():
            python_warnings.simplefilter("ignore", DeprecationWarning)  # the array is then shorter
            text = " ".join(tokens).replace("//", "/0/").replace("/", " ")
            values = np.fromstring(text, np.int64, sep=" ")
            if len(values) == columns * len(tokens) and np.abs(values).max() < 1 << 60:
                return np.pad(values.reshape(-1, columns), ((0, 0), (0, 3 - columns)))
    words = [word or "0" for token in tokens for word in [*token.split("/"), "0", "0"][:3]]
    return numbers(words, np.int64).reshape(-1, 3)


def _short(name: str) -> str:
    """A name without the comment after it."""
    return re.split(r"\s#", name)[0].strip()


def _read_libraries(line: str, assets: Assets, seen: set[str]) -> dict[str, Look]:
    """The materials of the files that a line `mtllib` names, except those already `seen`."""
    # Either one name, which may contain spaces, or several names.
    rest = line.split(None, 1)[1].strip().strip('"').replace("\\", "/")
    path = posixpath.normpath(posixpath.join(assets.base, rest))
    inside = not path.startswith(("/", ".."))
    looks: dict[str, Look] = {}
    for name in [rest] if inside and assets.files.find(path) else _short(rest).split():
        if name in seen or len(seen) == _MOST_LIBRARIES:
            continue
        seen.add(name)
        try:
            library = assets.files.open(assets.base, name)
            if why := reason(library):
                assets.warn("material files not readable", f"{name!r} ({why})")
            looks |= read_mtl(library, assets, posixpath.dirname(name))
        except FileNotFoundError:
            assets.warn("material files missing, grey is used", repr(name))
    return looks


def read_obj(data: bytes, assets: Assets) -> list[Part]:
    """The polygons of an OBJ file, read in blocks so that memory is bounded."""
    rows = {key: [np.zeros((0, columns))] for key, columns in _COLUMNS.items()}
    read = dict.fromkeys(_COLUMNS, 0)  # number of rows of each kind so far
    looks: dict[str, Look] = {}
    names: dict[str, int] = {}
    libraries: set[str] = set()
    owner = -1
    owners: list[int] = []
    sizes: list[int] = []
    corner_blocks: list[np.ndarray] = []
    painted: list[int] = []
    paint: list[list[str]] = []
    unread: collections.Counter[str] = collections.Counter()
    for block in _blocks(whole_lines(data)):
        fresh: dict[str, list[list[str]]] = {key: [] for key in _COLUMNS}
        tokens: list[str] = []
        seen: list[tuple[int, int, int]] = []  # number of rows before each corner
        # Bytes that are not UTF-8, such as names in Latin-1 or GBK, stay distinct.
        for line in block.decode("utf-8", "surrogateescape").split("\n"):
            key, *words = line.split() or [""]
            if not words:
                continue
            if key in ("v", "vt", "vn", "f", "fo") and "#" in line:
                words = line.split("#")[0].split()[1:]
            if key in fresh:
                if key == "v" and len(words) > 5:  # with a colour
                    painted.append(read["v"])
                    paint.append(words[3:6])
                elif key == "v" and len(words) > 3 and floats(words[3:], 1) != [1.0]:
                    unread["v"] += 1
                fresh[key].append(words[: _COLUMNS[key]])
                read[key] += 1
            elif key in ("f", "fo"):
                assets.add_faces(max(len(words) - 2, 0))
                tokens += words
                seen += [(read["v"], read["vt"], read["vn"])] * len(words)
                sizes.append(len(words))
                owners.append(owner)
            elif key == "usemtl":
                owner = names.setdefault(line.split(None, 1)[1].strip(), len(names))
            elif key == "mtllib" and len(libraries) < _MOST_LIBRARIES:
                looks |= _read_libraries(line, assets, libraries)
            elif key in _UNREAD:
                unread[key] += 1
        for key, lines in fresh.items():
            rows[key].append(_rows(lines, _COLUMNS[key]))
        corners = _indices(tokens)
        if (corners[:, 0] == 0).any():
            raise DamagedError("a face has index 0, but 1 is the first")
        if (corners < 0).any():  # counted back from the rows before the face
            corners += np.where(corners < 0, np.array(seen) + 1, 0)
        corner_blocks.append(corners - 1)  # from 0, and negative = none
    for key, number in unread.items():
        assets.warn(_UNREAD[key], number)
    vertices, texture, normal = (np.concatenate(blocks) for blocks in rows.values())
    if not sizes:
        what = f"{len(vertices)} points and {unread['l'] + unread['p']} lines, but no faces"
        raise UnusableModelError(f"the mesh is empty: {what}")
    corners, counts = np.concatenate(corner_blocks), np.array(sizes)

    by_short_name = {_short(name): look for name, look in reversed(looks.items())}
    table: list[Look | None] = []
    owner_of_corners, no_uv = np.repeat(np.array(owners), counts), corners[:, 1] < 0
    for index, name in enumerate(names):
        look = looks.get(name) or by_short_name.get(_short(name))
        if look is None:
            assets.warn("materials missing, grey is used", repr(name))
            look = None if paint else Look(Material(name=one_line(name)))
        elif look.material.texture is not None and no_uv[owner_of_corners == index].any():
            assets.warn(NO_COORDINATES, repr(name))
        table.append(look)
    colours = None
    if paint:
        of_vertices = np.ones((len(vertices), 4))
        of_vertices[painted] = rgba(numbers(paint), assets)
        colours = picked(of_vertices, corners[:, 0])
    table.append(None)  # of faces before the first `usemtl`
    uv, normals = picked(texture, corners[:, 1]), picked(normal, corners[:, 2])
    return [Part(vertices, counts, corners[:, 0], table, np.array(owners), uv, normals, colours)]

"""Reader of Wavefront OBJ files.

ShapeNet and Sweet Home 3D have many features that other readers ignore silently: missing and
negative indices, several material files, options before the names of textures, alpha maps, missing
images, concave polygons.
"""

import collections
import posixpath
import re
import warnings as python_warnings
from collections.abc import Iterator
from typing import Any

import numpy as np

from data_gen.mesh import Material, UnusableModelError, check_face_count
from data_gen.parts import Part, picked, rgba
from data_gen.readers.model_files import reason, whole_lines
from data_gen.readers.mtl import Look, floats, read_mtl
from data_gen.readers.textures import NO_COORDINATES, NOT_REPEATED, Assets
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


def _short(name: str) -> str:
    """A name without the comment after it."""
    return re.split(r"\s#", name)[0].strip()


def read_obj(data: bytes, assets: Assets) -> dict[str, Any]:
    """Arrays of an OBJ file for `mesh.build_model`, read in blocks so that memory is bounded."""
    rows = {key: [np.zeros((0, columns))] for key, columns in _COLUMNS.items()}
    read = dict.fromkeys(_COLUMNS, 0)  # number of rows of each kind so far
    looks: dict[str, Look] = {}
    names: dict[str, int] = {}
    libraries: set[str] = set()
    owner = -1
    owners_of_faces: list[int] = []
    sizes: list[int] = []
    corner_blocks: list[np.ndarray] = []
    painted: list[int] = []
    paint: list[list[str]] = []
    unread: collections.Counter[str] = collections.Counter()
    total = 0
    for block in _blocks(whole_lines(data)):
        fresh: dict[str, list[list[str]]] = {key: [] for key in _COLUMNS}
        tokens: list[str] = []
        seen: list[tuple[int, int, int]] = []  # number of rows before each corner
        # Bytes that are not UTF-8, such as those of names in Latin-1 or GBK, stay distinct.
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
                total += max(len(words) - 2, 0)
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
                for name in [rest] if inside and assets.files.find(path) else _short(rest).split():
                    if name in libraries or len(libraries) == _MOST_LIBRARIES:
                        continue
                    libraries.add(name)
                    try:
                        library = assets.files.open(assets.base, name)
                        if why := reason(library):
                            assets.warn("material files not readable", f"{name!r} ({why})")
                        looks |= read_mtl(library, assets, posixpath.dirname(name))
                    except FileNotFoundError:
                        assets.warn("material files missing, grey is used", repr(name))
            elif key in _UNREAD:
                unread[key] += 1
        check_face_count(total, assets.max_faces)
        try:
            for key, lines in fresh.items():
                rows[key].append(_rows(lines, _COLUMNS[key]))
            corners = _indices(tokens)
        except (ValueError, OverflowError) as error:
            what = "a word that is not a number, or not a whole one in a face"
            raise UnusableModelError(f"not readable as OBJ: {what}") from error
        if (corners[:, 0] == 0).any():
            raise UnusableModelError("not readable as OBJ: a face has index 0, but 1 is the first")
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
    table: list[Material | None] = []
    owner_of_corners = np.repeat(np.array(owners_of_faces), counts)
    uv = picked(texture, corners[:, 1])
    for index, name in enumerate(names):
        look = looks.get(name) or by_short_name.get(_short(name))
        if look is None:
            assets.warn("materials missing, grey is used", repr(name))
            table.append(None if paint else Material(name=one_line(name)))
            continue
        table.append(look.material)
        if look.material.texture is not None and (corners[owner_of_corners == index, 1] < 0).any():
            assets.warn(NO_COORDINATES, repr(name))
        if uv is not None and look != Look(look.material):
            chosen = owner_of_corners == index
            uv[chosen] = uv[chosen] * look.scale + look.offset
            if look.clamped and ((uv[chosen] < 0) | (uv[chosen] > 1)).any():
                assets.warn(NOT_REPEATED, "-clamp")
    colours = None
    if paint:
        try:
            rgb = np.array(paint, np.float64)
        except ValueError as error:
            raise UnusableModelError("not readable as OBJ: a colour that is not numbers") from error
        of_vertices = np.ones((len(vertices), 4))
        of_vertices[painted] = rgba(rgb)
        colours = picked(of_vertices, corners[:, 0])
    owners = np.array(owners_of_faces)
    if (owners < 0).any():
        owners = np.where(owners < 0, len(table), owners)
        table.append(None)
    normals = picked(normal, corners[:, 2])
    part = Part(vertices, counts, corners[:, 0], table, owners, uv, normals, colours)
    return assets.arrays([part])

"""Reader of PLY files, binary and text."""

import itertools
import math
import re
from collections.abc import Iterator

import numpy as np

from data_gen.mesh import Material, UnusableModelError
from data_gen.readers.model_files import DamagedError, check_announced, numbers
from data_gen.readers.parts import Look, Part, picked, rgba
from data_gen.readers.textures import TRAILING, TWO_COLOURS, Assets

_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4",
          "float": "f4", "double": "f8", "int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2",
          "int32": "i4", "uint32": "u4", "float32": "f4", "float64": "f8"}  # fmt: skip

_TEXTURE = re.compile(r"(?:comment|obj_info)\s+texturefile\s+(.+)", re.IGNORECASE)

# Names of properties; we take the first that exists.
_UV = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("s0", "t0"))
_COLOURS = (("red", "green", "blue", "alpha"), ("r", "g", "b", "a"),
            ("diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"))  # fmt: skip

_UNUSED = ("camera", "range_grid")  # elements without effect on the surface

# For each property: the lengths [n] of its lists (None: it has no lists), and all numbers.
_Rows = dict[str, tuple[np.ndarray | None, np.ndarray]]

_Property = tuple[str, str, str]  # name, type of the numbers, type of a list's length or ""


def read_ply(data: bytes, assets: Assets) -> list[Part]:
    elements, images = _elements(data, assets)
    for name in elements.keys() - {"vertex", "face", "tristrips", *_UNUSED}:
        assets.warn("elements of PLY not read", repr(name))
    vertex, faces, strips = (elements.get(name, {}) for name in ("vertex", "face", "tristrips"))
    vertices = _columns(vertex, ("x", "y", "z"))
    if vertices is None:
        raise DamagedError("it has no vertices with x, y and z")
    counts, corners = _lists(faces, "vertex_indices", "vertex_index")
    triangles = _from_strips(_lists(strips, "vertex_indices", "vertex_index")[1], assets)
    if not len(counts) + len(triangles):
        raise UnusableModelError(f"it has {len(vertices)} points, but no faces")
    uv = next((c for names in _UV if (c := _columns(vertex, names)) is not None), None)
    sizes, wedges = _lists(faces, "texcoord")
    looks: list[Look | None] = []
    if images and uv is None and not len(wedges):
        assets.warn("textures without texture coordinates not read", len(images))
    elif images:
        textures = [assets.texture(name) for name in images]
        looks = [
            None if t is None else Look(Material((1.0, 1.0, 1.0), texture=t)) for t in textures
        ]
    colours, painted = _colours(vertex, assets), _colours(faces, assets)
    normals = _columns(vertex, ("nx", "ny", "nz"))

    def part(counts: np.ndarray, corners: np.ndarray, owner: np.ndarray) -> Part:
        """Polygons with the values of their vertices; `owner` [P] is the texture, -1 = none."""
        of_corners = (picked(values, corners) for values in (uv, normals, colours))
        return Part(vertices, counts, corners, [*looks, None], owner, *of_corners)

    owner = np.zeros(len(counts), np.int64)
    if (number := _columns(faces, ("texnumber",))) is not None:
        owner = number[:, 0].astype(np.int64)
        missing = (owner < 0) | (owner >= len(looks))
        if looks and (owner[missing] != -1).any():  # -1 means none
            assets.warn("texnumber of missing textures, the plain colour is used")
        owner[missing] = -1
    elif len(looks) > 1:
        assets.warn("no texnumber, only the first texture is used", len(images))
    polygons = part(counts, corners.astype(np.int64), owner)
    if len(wedges):
        whole = sizes == 2 * counts
        if (sizes[~whole] > 0).any():
            assets.warn("texcoord without two numbers for each corner not read")
        polygons.uv = np.zeros((len(corners), 2))
        polygons.uv[np.repeat(whole, counts)] = wedges[np.repeat(whole, sizes)].reshape(-1, 2)
        owner[~whole] = -1
    if colours is None and painted is not None:
        polygons.colours = np.repeat(painted, counts, axis=0)
    elif painted is not None:
        assets.warn(TWO_COLOURS)
    count = len(triangles) // 3
    owner = np.full(count, 0 if uv is not None else -1)
    return [polygons, part(np.full(count, 3), triangles, owner)]


def _elements(data: bytes, assets: Assets) -> tuple[dict[str, _Rows], list[str]]:
    """The rows of each element that is not empty, and the names of the images."""
    data = data.removeprefix(b"\xef\xbb\xbf")
    first = re.match(rb"ply[ \t]*(\r\n|\r|\n)", data)
    if not first:
        raise DamagedError("it does not begin with a line 'ply'")
    # If lines end with a carriage return, binary data may begin with the byte of a line feed.
    stop = rb"[\r\n][ \t]*end_header[ \t]*" + (rb"\r" if first[1] == b"\r" else rb"\r?\n")
    last = re.search(stop, data[: 1 << 20])
    if not last:
        raise DamagedError("the header has no line 'end_header'")
    form = here = ""
    images: list[str] = []
    counts: dict[str, int] = {}
    properties: dict[str, list[_Property]] = {}
    text = data[first.end() : last.start()].decode("utf-8", "surrogateescape")
    for line in filter(None, map(str.strip, re.split(r"[\r\n]+", text))):
        match line.split():
            case ["format", form, "1.0"] if form in _ORDERS:
                pass
            case ["element", here, number] if number.isdecimal() and here not in counts:
                counts[here], properties[here] = int(number), []
            case ["property", kind, name] if here and kind in _TYPES:
                properties[here].append((name, _TYPES[kind], ""))
            case ["property", "list", length, kind, name] if here and {kind, length} <= {*_TYPES}:
                properties[here].append((name, _TYPES[kind], _TYPES[length]))
            case ["property" | "element" | "format", *_]:
                raise DamagedError(f"line {line[:80]!r} of the header")
            case ["comment" | "obj_info", *_]:
                images += _TEXTURE.findall(line)
            case _:
                assets.warn("lines of the header not read", repr(line))
    if not form:
        raise DamagedError("the header has no line 'format'")
    assets.budget.charge(faces=counts.get("face", 0))
    body, lines = data[last.end() :], None
    if form == "ascii":  # each line is a row
        lines = [words for line in body.splitlines() if (words := line.split())]
        used = itertools.chain(*lines[: sum(counts.values())])
        body = numbers(list(used)).tobytes()
    result: dict[str, _Rows] = {}
    at = 0
    for name, count in counts.items():
        if not count or not properties[name]:
            continue
        runs = list(_runs(properties[name], _ORDERS[form], count, body, at, assets))
        at += sum(run.nbytes for run in runs)
        done = sum(map(len, runs))
        if lines is not None:
            widths = [run.itemsize // 8 for run in runs for _ in run]
            if widths != [len(words) for words in lines[:done]]:
                raise DamagedError(f"lines of element {name!r} have too few or too many words")
            lines = lines[done:]
        check_announced(f"rows of element {name!r}", count, done)
        result[name] = {}
        for key, (own, kind, length) in enumerate(properties[name]):
            sizes = [run[f"n{key}"] for run in runs if length]
            values = np.concatenate([run[f"{key}"].ravel() for run in runs])
            typed = values.astype(kind)
            if kind[0] != "f" and (typed != values).any():
                raise DamagedError(f"a number of {own!r} that does not fit its type")
            result[name][own] = np.concatenate(sizes).astype(np.int64) if sizes else None, typed
    if left := len(body) - at if lines is None else len(lines):
        assets.warn(TRAILING, left)
    return result, images


def _runs(
    properties: list[_Property], order: str, count: int, data: bytes, at: int, assets: Assets
) -> Iterator[np.ndarray]:
    """Arrays of rows with lists of equal lengths, up to the end of the data.

    Field `2` has the third property, `n2` the length of its list. Text (`order` "") has doubles.
    """
    most = count
    while count:
        fields: list[tuple[str, np.dtype, tuple[int, ...]]] = []
        stop = at
        for key, (_, kind, length) in enumerate(properties):
            shape: tuple[int, ...] = ()
            if length:
                stored = np.dtype(order + length if order else "f8")
                if stop + stored.itemsize > len(data):
                    return
                given = np.frombuffer(data, stored, 1, stop)[0]
                if not 0 <= given <= len(data) or given % 1:
                    raise DamagedError(f"a list of {given} numbers")
                shape = (int(given),)
                fields.append((f"n{key}", stored, ()))
                stop += stored.itemsize
            fields.append((f"{key}", np.dtype(order + kind if order else "f8"), shape))
            stop += math.prod(shape) * fields[-1][1].itemsize
        there = min(most, count, (len(data) - at) // (stop - at))
        if not there:
            return
        rows = np.frombuffer(data, np.dtype(fields), there, at)
        same = np.ones(there, bool)
        for name in [name for name, _, _ in fields if name[0] == "n"]:
            same &= rows[name] == rows[name][0]
        found = there if same.all() else int(same.argmin())
        assets.budget.charge(made=2048 * len(fields))  # an array for each field
        yield rows[:found]
        at, count = at + found * rows.itemsize, count - found
        most = 4 * found  # short runs need not compare all rows that follow


def _columns(rows: _Rows, names: tuple[str, ...]) -> np.ndarray | None:
    """Properties without lists as [n, len(names)]; None if a property is missing."""
    found = [rows[name][1] for name in names if name in rows and rows[name][0] is None]
    return np.stack(found, axis=1).astype(np.float64) if len(found) == len(names) else None


def _lists(rows: _Rows, *names: str) -> tuple[np.ndarray, np.ndarray]:
    """The lengths of the lists of the first property that exists, and all numbers."""
    for sizes, values in (rows[name] for name in names if name in rows):
        if sizes is not None:
            return sizes, values
    return np.zeros(0, np.int64), np.zeros(0, np.int64)


def _from_strips(corners: np.ndarray, assets: Assets) -> np.ndarray:
    """The corners of the triangles of strips. A strip ends with -1."""
    place = np.arange(len(corners))
    start = np.maximum.accumulate(np.where(corners == -1, place + 1, 0))
    first = place[:-2][(place - start)[2:] >= 2]  # of three corners of the same strip
    assets.budget.charge(faces=len(first))
    odd = (first - start[first]) % 2
    order = np.stack([first + odd, first + 1 - odd, first + 2], axis=1)
    return corners[order.ravel()].astype(np.int64)


def _fractions(rows: _Rows, names: tuple[str, ...]) -> np.ndarray | None:
    """Colours; whole numbers are divided by their largest value."""
    values = _columns(rows, names)
    if values is not None and rows[names[0]][1].dtype.kind != "f":
        values /= 65535 if values.max(initial=0) > 255 else 255
    return values


def _colours(rows: _Rows, assets: Assets) -> np.ndarray | None:
    """Display RGBA [n, 4] in [0, 1]; None if the element has no colours."""
    for names in _COLOURS:
        if (rgb := _fractions(rows, names[:3])) is not None:
            alpha = _fractions(rows, names[3:])
            return rgba(rgb if alpha is None else np.hstack([rgb, alpha]), assets)
    return None

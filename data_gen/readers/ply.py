"""Reader of PLY files, over plyfile, which gets a header without what it does not accept."""

import io
import re
import tempfile
import warnings
from typing import Any

import numpy as np

from data_gen.mesh import Material, UnusableModelError, check_face_count
from data_gen.parts import Part, rgba
from data_gen.polygons import strip
from data_gen.readers.textures import TRAILING, TWO_COLOURS, Assets

_TEXTURE = re.compile(r"(?:comment|obj_info)\s+texturefile\s+(.+)", re.IGNORECASE)

# Names of properties, in the order of preference.
_UV = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"), ("s0", "t0"))
_COLOURS = (("red", "green", "blue", "alpha"), ("r", "g", "b", "a"),
            ("diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"))  # fmt: skip

_UNUSED = ("camera", "range_grid")  # elements that say nothing about the surface


def read_ply(data: bytes, assets: Assets) -> dict[str, Any]:
    """Arrays of a PLY file for `mesh.build_model`."""
    header, body, images = _split(data, assets)
    elements = _elements(header, body, assets)
    for name, rows in elements.items():
        if len(rows) and name not in ("vertex", "face", "tristrips", *_UNUSED):
            assets.warn("elements of PLY not read", repr(name))
    vertex, faces, strips = (
        elements.get(name, np.zeros(0)) for name in ("vertex", "face", "tristrips")
    )
    vertices = _columns(vertex, ("x", "y", "z"))
    if vertices is None:
        raise UnusableModelError("not readable as PLY: the vertices have no x, y and z")
    counts, corners = _polygons(faces)
    triangles = _from_strips(_polygons(strips)[1])
    if not len(counts) + len(triangles):
        raise UnusableModelError(f"it has {len(vertices)} points, but no faces")
    own, counts = counts, np.append(counts, np.full(len(triangles) // 3, 3))
    corners = np.append(corners, triangles)
    index = np.where((corners >= 0) & (corners < len(vertices)), corners, -1)

    uv = next((c[index] for names in _UV if (c := _columns(vertex, names)) is not None), None)
    sizes, wedges = _lists(faces, "texcoord")
    placed = np.ones(len(counts), bool)  # the polygons with texture coordinates
    if len(wedges):
        placed = np.append(sizes == 2 * own, np.zeros(len(counts) - len(own), bool))
        if (sizes[~placed[: len(own)]] > 0).any():
            assets.warn("texcoord without two numbers for each corner not read")
        uv = np.zeros((len(corners), 2))
        uv[np.repeat(placed, counts)] = wedges[np.repeat(placed[: len(own)], sizes)].reshape(-1, 2)
    if uv is None and images:
        assets.warn("textures without texture coordinates not read", len(images))
    materials: list[Material | None] = [None]
    owner = np.zeros(len(counts), np.int64)
    if uv is not None and images:
        textures = [assets.texture(name) for name in images]
        white = (1.0, 1.0, 1.0)
        materials = [None if t is None else Material(white, texture=t) for t in textures]
        number = _columns(faces, ("texnumber",))
        if number is not None:
            inside = (number[:, 0] >= 0) & (number[:, 0] < len(materials))
            owner[: len(own)] = np.where(inside, number[:, 0], len(materials))
            if (number[~inside, 0] != -1).any():  # which means none
                assets.warn("texnumber of missing textures, the plain colour is used")
        elif len(materials) > 1:
            assets.warn("no texnumber, only the first texture is used", len(materials))
        owner[~placed] = len(materials)
        materials.append(None)

    normals = _columns(vertex, ("nx", "ny", "nz"))
    colours, painted = _colours(vertex), _colours(faces)
    if colours is not None:
        colours = colours[index]
        if painted is not None:
            assets.warn(TWO_COLOURS)
    elif painted is not None and not len(triangles):
        colours = np.repeat(painted, counts, axis=0)
    part = Part(
        vertices, counts, corners, materials, owner, uv,
        None if normals is None else normals[index], colours,
    )  # fmt: skip
    return assets.arrays([part])


def _split(data: bytes, assets: Assets) -> tuple[list[list[str]], bytes, list[str]]:
    """The words of the header's lines without comments, the data, the names of the images."""
    data = data.removeprefix(b"\xef\xbb\xbf")
    first = re.match(rb"ply[ \t]*(\r\n|\r|\n)", data)
    if not first:
        raise UnusableModelError("not readable as PLY: it does not begin with a line 'ply'")
    # After a single carriage return, data may begin with the byte of a line feed.
    stop = rb"[\r\n][ \t]*end_header[ \t]*" + (rb"\r" if first[1] == b"\r" else rb"\r?\n")
    last = re.search(stop, data[: 1 << 20])
    if not last:
        raise UnusableModelError("not readable as PLY: the header has no line 'end_header'")
    header, images = [], []
    for line in re.split(r"[\r\n]+", data[: last.start()].decode("utf-8", "surrogateescape")):
        words = line.split()
        if found := _TEXTURE.match(line.strip()):
            images.append(found[1])
        elif words and words[0] in ("ply", "format", "element", "property"):
            header.append(words)
        elif words and words[0] not in ("comment", "obj_info"):
            assets.warn("lines of the header not read", repr(line))
    body = data[last.end() :]
    if ["format", "ascii", "1.0"] in header:
        lines = body.replace(b"\r", b"\n").split(b"\n")
        body = b"\n".join(line for line in lines if line.strip()) + b"\n"
    return header, body, images


def _elements(header: list[list[str]], body: bytes, assets: Assets) -> dict[str, np.ndarray]:
    """The rows of each element."""
    import plyfile

    lists: dict[str, dict[str, int]] = {}
    here = ""
    for words in header:
        if words[:2] == ["element", "face"] and words[-1].isdecimal():
            check_face_count(int(words[-1]), assets.max_faces)
    for words in header:
        if words[0] == "element":
            here = words[1] if len(words) == 3 else ""
            count = int(words[2]) if len(words) == 3 and words[2].isdecimal() else -1
            if not 0 <= count <= len(body):
                what = f"element {' '.join(words[1:])!r} in {len(body)} bytes"
                raise UnusableModelError(f"the file is cut off or damaged: {what}")
        elif words[:2] == ["property", "list"]:
            lists.setdefault(here, {})[words[-1]] = 6 if words[-1] == "texcoord" else 3
    text = "".join(" ".join(words) + "\n" for words in [*header, ["end_header"]])
    form = io.BytesIO if ["format", "ascii", "1.0"] in header else tempfile.TemporaryFile
    # From a file, plyfile reads binary lists of one length at once.
    for known in ({},) if form is io.BytesIO else (lists, {}):
        with form() as stream:
            stream.write(text.encode("ascii", "replace") + body)
            stream.seek(0)
            try:
                with warnings.catch_warnings(action="ignore"):  # about empty lists
                    read = plyfile.PlyData.read(stream, known_list_len=known)
            except plyfile.PlyElementParseError as error:
                if known:
                    continue
                where = f"element {error.element.name!r}: {len(error.element)} announced"
                what = f"not readable as PLY: {where}, row {error.row}: {error.message}"
                if "early end-of-file" in error.message:
                    what = f"the file is cut off: {where}, {error.row} there"
                raise UnusableModelError(what) from error
            except (plyfile.PlyParseError, OverflowError, UnicodeDecodeError) as error:
                what = str(error) if isinstance(error, plyfile.PlyParseError) else "strange values"
                raise UnusableModelError(f"not readable as PLY: {what}"[:200]) from error
            rows = {element.name: np.array(element.data) for element in read}
            left = len(body) + len(text) - (0 if read.text else stream.tell())
            break
    if read.text:
        left = body.count(b"\n") - sum(map(len, rows.values()))
    if left > 0:
        assets.warn(TRAILING, left)
    return rows


def _columns(rows: np.ndarray, names: tuple[str, ...]) -> np.ndarray | None:
    """Properties with one number as [n, len(names)], None if one is missing."""
    if not set(names) <= set(rows.dtype.names or ()) or any(rows[n].dtype == object for n in names):
        return None
    return np.stack([rows[name].astype(np.float64) for name in names], axis=1)


def _lists(rows: np.ndarray, name: str) -> tuple[np.ndarray, np.ndarray]:
    """The lengths of the lists of a property, and their numbers one after the other."""
    given = len(rows) and name in (rows.dtype.names or ())
    if not given or (rows[name].dtype != object and rows[name].ndim < 2):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    values = rows[name]
    return np.array([len(v) for v in values]), np.concatenate(list(values))


def _polygons(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    name = "vertex_indices" if "vertex_indices" in (rows.dtype.names or ()) else "vertex_index"
    counts, corners = _lists(rows, name)
    return counts, corners.astype(np.int64)


def _from_strips(corners: np.ndarray) -> np.ndarray:
    """The corners of the triangles of strips, each of which ends with -1."""
    strips = np.split(corners, np.flatnonzero(corners == -1) + 1)
    strips = [one[one != -1] for one in strips]
    return np.concatenate([one[strip(len(one)).ravel()] for one in strips])


def _colours(rows: np.ndarray) -> np.ndarray | None:
    """Display RGBA [n, 4] in [0, 1] of a property's integers or floats; None if there are none."""
    for names in _COLOURS:
        if (rgb := _columns(rows, names[:3])) is None or not len(rgb):
            continue
        kind = rows[names[0]].dtype
        white = 0 if kind.kind == "f" else 65535 if kind.itemsize == 2 else 255
        alpha = _columns(rows, names[3:])
        return rgba(rgb if alpha is None else np.hstack([rgb, alpha]), white)
    return None

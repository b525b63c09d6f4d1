"""Reading models from files: own reader for Wavefront OBJ with MTL, trimesh for all other formats.

OBJ is read here because the two large collections of training shapes are OBJ and full of what
lenient readers lose in silence: missing and negative indices, several material files, textures
with options in front of their name, alpha maps, missing pictures, concave polygons.

Nothing outside of the `Files` handed over is opened, and what is read is bounded: bytes of a file,
faces (counted before they are built wherever the format permits), pixels decoded and kept.
"""

import abc
import dataclasses
import io
import json
import os
import pathlib
import posixpath
import struct
import warnings as python_warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from PIL import Image, UnidentifiedImageError

from data_gen import meshes
from data_gen.meshes import Material, Model, UnusableModelError

MAX_FILE_BYTES = 256 << 20
"""Largest file that is read, meshes and pictures alike."""

MAX_DECODED_PIXELS = 40_000_000
"""Pictures with more pixels are not decoded (JPEG: after its reduction while decoding)."""

TEXTURE_SIDE = 1024
"""Textures are reduced to this many pixels on the longer side."""

_MAX_TEXELS = 1 << 24  # of all textures of one model, 64 MB
_MAX_XML_BYTES = 64 << 20
_PICTURE_FORMATS = ("PNG", "JPEG", "BMP", "TGA", "GIF", "WEBP", "TIFF", "PPM", "DDS", "SGI")
_GREY = (0.6, 0.6, 0.6)
_ARCHIVES = {"zip", "bz2", "tar.bz2", "tar.gz"}


# --- Where files come from --------------------------------------------------------------------


class Files(abc.ABC):
    """The files that a model may refer to, by names relative to a root."""

    @abc.abstractmethod
    def find(self, name: str) -> str | None:
        """The stored name of a file asked for by `name`, in its spelling but for case; or None."""

    @abc.abstractmethod
    def read(self, name: str) -> bytes:
        """Contents of a file that `find` named."""

    def open(self, base: str, name: str) -> bytes:
        """Contents of the file that a file in the folder `base` calls `name`.

        Backslashes, quotes and wrong case are forgiven. Where there is no such file, one of the
        same name in `base` itself will do: references often carry the author's own folders. A
        path that leads out of the root is looked up by its last part alone.

        Raises:
          FileNotFoundError: there is none.
        """
        clean = name.strip().strip('"').replace("\\", "/")
        joined = posixpath.normpath(posixpath.join(base, clean))
        alone = posixpath.normpath(posixpath.join(base, posixpath.basename(clean)))
        for path in (joined, alone):
            if path.startswith(("/", "../")) or path in ("", ".", "..") or ":" in path:
                continue
            found = self.find(path)
            if found is not None:
                return self.read(found)
        raise FileNotFoundError(name)


class FolderFiles(Files):
    """Files below a folder."""

    def __init__(self, root: str | os.PathLike[str]) -> None:
        self.root = pathlib.Path(root)

    def find(self, name: str) -> str | None:
        """See `Files`."""
        path = self.root
        for part in posixpath.normpath(name).split("/"):
            if part == "..":
                return None
            following = path / part
            if not following.exists():
                try:
                    entries = sorted(os.listdir(path))
                except OSError:
                    return None
                alike = [e for e in entries if e.casefold() == part.casefold()]
                if not alike:
                    return None
                following = path / alike[0]
            path = following
        return str(path.relative_to(self.root)) if path.is_file() else None

    def read(self, name: str) -> bytes:
        """See `Files`.

        Raises:
          UnusableModelError: the file is larger than `MAX_FILE_BYTES`.
        """
        path = self.root / name
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            raise UnusableModelError(
                f"{path.name} has {size} bytes, more than the limit of {MAX_FILE_BYTES}"
            )
        return path.read_bytes()


# --- Textures ---------------------------------------------------------------------------------


class Notes:
    """Warnings in order, each once."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def add(self, line: str) -> None:
        """Appends a warning."""
        line = line if len(line) <= 300 else line[:297] + "..."
        if line not in self.lines and len(self.lines) < 100:
            self.lines.append(line)


def decode_texture(data: bytes | Image.Image, side: int = TEXTURE_SIDE) -> np.ndarray:
    """A picture as uint8 [H, W, 4] RGBA, reduced to `side` pixels on its longer side.

    The size is read from the header before anything is decoded; a JPEG is reduced by up to 8
    while it is decoded.

    Raises:
      ValueError: it is no picture, damaged, or has more than `MAX_DECODED_PIXELS` pixels.
    """
    with python_warnings.catch_warnings():
        # Pillow warns at a size that is checked below, and of odd palettes and metadata.
        python_warnings.simplefilter("ignore")
        try:
            # A picture above twice this is refused by Pillow itself, before a JPEG can be reduced.
            before, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
            try:
                picture = (
                    data
                    if isinstance(data, Image.Image)
                    else Image.open(io.BytesIO(data), formats=_PICTURE_FORMATS)
                )
            finally:
                Image.MAX_IMAGE_PIXELS = before
            full = picture.size
            reduce_to = side / max(full)
            picture.draft(None, (round(full[0] * reduce_to) or 1, round(full[1] * reduce_to) or 1))
            if picture.width * picture.height > MAX_DECODED_PIXELS:
                raise ValueError(
                    f"{full[0]} x {full[1]} pixels are more than the limit of {MAX_DECODED_PIXELS}"
                )
            if max(picture.size) > side:
                picture = _small(picture, side)
            if picture.mode in ("I;16", "I", "F"):
                values = np.asarray(picture, np.float64)
                top = 65535 if picture.mode != "F" else max(values.max(), 1e-30)
                picture = Image.fromarray((255 * np.clip(values / top, 0, 1)).astype(np.uint8))
            return np.asarray(picture.convert("RGBA"))
        except (UnidentifiedImageError, OSError, SyntaxError, struct.error, EOFError) as error:
            raise ValueError(f"not readable as a picture ({error})"[:200]) from error


def _small(picture: Image.Image, side: int) -> Image.Image:
    """The picture with `side` pixels on its longer side; no copy at full size but its own."""
    if picture.mode in ("P", "1"):
        # A palette cannot be averaged; its pixels are one byte, so the copy is bounded.
        picture = picture.convert("RGBA" if "transparency" in picture.info else "RGB")
    factor = side / max(picture.size)
    size = tuple(max(1, round(factor * n)) for n in picture.size)
    if picture.mode.startswith("I;16"):
        return picture.resize((size[0], size[1]), Image.Resampling.NEAREST)
    return picture.resize((size[0], size[1]), Image.Resampling.BOX)


def _with_alpha_map(texture: np.ndarray | None, alpha_map: np.ndarray) -> np.ndarray:
    """The texture (None = white) with an alpha map's brightness, or its own alpha, as alpha."""
    if (alpha_map[..., 3] < 255).any():
        alpha = alpha_map[..., 3]
    else:
        alpha = alpha_map[..., :3].mean(axis=2).round().astype(np.uint8)
    if texture is None:
        texture = np.full((*alpha.shape, 4), 255, np.uint8)
    if alpha.shape != texture.shape[:2]:
        height, width = texture.shape[:2]
        alpha = np.asarray(Image.fromarray(alpha).resize((width, height)))
    return np.concatenate([texture[..., :3], alpha[..., None]], axis=2)


def bounded(materials: Sequence[Material], notes: Notes) -> tuple[Material, ...]:
    """The materials with the largest textures halved until all together fit."""
    result = list(materials)
    # Materials may share a texture, which then counts once and is halved for all of them.
    distinct = {id(m.texture): m.texture for m in result if m.texture is not None}

    def size(key: int) -> int:
        return distinct[key].shape[0] * distinct[key].shape[1]

    while sum(map(size, distinct)) > _MAX_TEXELS:
        notes.add(f"textures reduced: together they have more than {_MAX_TEXELS} pixels")
        largest = max(distinct, key=size)
        half = np.asarray(Image.fromarray(distinct[largest]).reduce(2))
        distinct[largest] = half
    result = [
        m if m.texture is None else dataclasses.replace(m, texture=distinct[id(m.texture)])
        for m in result
    ]
    return tuple(result)


# --- Wavefront --------------------------------------------------------------------------------


def _floats(words: Sequence[str], count: int) -> list[float] | None:
    try:
        values = [float(w) for w in words[:count]]
    except ValueError:
        return None
    return values if len(values) == count and np.isfinite(values).all() else None


def _colour(words: Sequence[str]) -> tuple[float, float, float] | None:
    values = _floats(words, 3) or _floats(list(words[:1]) * 3, 3)
    if values is None:
        return None
    red, green, blue = (min(max(v, 0.0), 1.0) for v in values)
    return red, green, blue


# Options of a map statement and how many words each takes, from the MTL specification; those
# that take up to three numbers take as many as there are.
_MAP_OPTIONS = {"-blendu": 1, "-blendv": 1, "-cc": 1, "-clamp": 1, "-texres": 1, "-imfchan": 1,
                "-type": 1, "-bm": 1, "-boost": 1, "-mm": 2}  # fmt: skip
_MAP_VECTORS = ("-o", "-s", "-t")


def _map_name(rest: str) -> str:
    """The file name of a map statement, which may hold spaces, without the options before it."""
    words = rest.split()
    start = 0
    while start < len(words) and words[start].lower() in {*_MAP_OPTIONS, *_MAP_VECTORS}:
        option = words[start].lower()
        start += 1
        if option in _MAP_OPTIONS:
            start += _MAP_OPTIONS[option]
        else:
            taken = 0
            while start < len(words) - 1 and taken < 3 and _floats([words[start]], 1):
                start, taken = start + 1, taken + 1
    return rest.strip() if start == 0 else " ".join(words[start:])


class Textures:
    """Pictures of one model, each decoded once."""

    def __init__(self, files: Files, base: str, side: int, notes: Notes) -> None:
        self._files, self._base, self._side, self._notes = files, base, side, notes
        self._cache: dict[str, np.ndarray | None] = {}

    def get(self, name: str) -> np.ndarray | None:
        """The texture, or None with a warning."""
        if name not in self._cache:
            self._cache[name] = None
            try:
                self._cache[name] = decode_texture(self._files.open(self._base, name), self._side)
            except FileNotFoundError:
                self._notes.add(f"texture {name!r} is missing; the plain colour stands in")
            except (ValueError, OSError) as error:
                self._notes.add(f"texture {name!r}: {error}; the plain colour stands in")
        return self._cache[name]


def read_mtl(text: str, textures: Textures) -> dict[str, Material]:
    """Materials of an MTL file, by name.

    Read: Kd, Ks, Ns, d, Tr, illum (2 and above have a highlight), map_Kd, map_d. A black Kd with a
    texture counts as white: many exporters write that and mean the texture alone.
    """
    statements: dict[str, dict[str, str]] = {}
    current: dict[str, str] = {}
    for line in text.splitlines():
        words = line.strip().split(None, 1)
        if not words or words[0].startswith("#"):
            continue
        rest = words[1].strip() if len(words) > 1 else ""
        if words[0].lower() == "newmtl":
            current = statements.setdefault(rest, {})
        else:
            current[words[0].lower()] = rest
    result = {}
    for name, lines in statements.items():
        texture = textures.get(_map_name(lines["map_kd"])) if lines.get("map_kd") else None
        alpha_map = textures.get(_map_name(lines["map_d"])) if lines.get("map_d") else None
        if alpha_map is not None:
            texture = _with_alpha_map(texture, alpha_map)
        diffuse = _colour(lines.get("kd", "").split())
        if diffuse is None or ("map_kd" in lines and max(diffuse) < 0.02):
            diffuse = (1.0, 1.0, 1.0) if texture is not None else _GREY
        opacity = _floats(lines.get("d", "").replace("-halo", "").split(), 1)
        if opacity is None:
            clear = _floats(lines.get("tr", "").split(), 1)
            opacity = [1.0] if clear is None else [1 - clear[0]]
        specular = _colour(lines.get("ks", "").split()) or (0.0, 0.0, 0.0)
        if lines.get("illum", "2").strip() in ("0", "1"):
            specular = (0.0, 0.0, 0.0)
        shininess = (_floats(lines.get("ns", "").split(), 1) or [20.0])[0]
        result[name] = Material(
            diffuse=diffuse,
            specular=specular,
            shininess=min(max(shininess, 1.0), 1000.0),
            opacity=min(max(opacity[0], 0.0), 1.0),
            texture=texture,
            name=name,
        )
    return result


def _blocks(data: bytes, size: int = 1 << 22) -> Iterator[bytes]:
    """A text in parts of whole lines; lines that end with a backslash are joined to the next."""
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


class _Lines:
    """The lines of a block of an OBJ file by their statements.

    All of it is arrays over the block's bytes, words or lines, so that no line costs a step of the
    interpreter. What looks unusual is left to slower code of the same meaning.

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
        kind[(words[full] < 2) & (kind != _OTHER)] = -1  # a statement without anything
        self.kind = np.full(len(ends), -1)
        self.kind[full] = kind
        self.words = words - 1  # without the statement's own
        self._ends = ends
        # The statements' own words are blanked, so that only numbers are left.
        numbers = kind != _OTHER
        self._bytes[first[numbers]] = _SPACE
        double = first[(kind == _VT) | (kind == _VN)] + 1
        self._bytes[double] = _SPACE

    def numbers(self, kind: int) -> bytes:
        """All that stands in the lines of a kind."""
        return self._bytes[np.repeat(self.kind == kind, self._length)[: len(self._bytes)]].tobytes()

    def text(self, line: int | np.integer[Any]) -> str:
        """A line."""
        stop = self._ends[line]
        return (
            self._bytes[stop + 1 - self._length[line] : stop].tobytes().decode("utf-8", "replace")
        )

    def rows(self, kind: int, columns: int) -> np.ndarray:
        """The numbers of the lines of a kind: short lines are filled with 0, long ones cut.

        Raises:
          ValueError: a word is no number.
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
        """Corners [n, 3] of the faces' lines as written, 0 = not given; and how many a line has.

        Raises:
          ValueError: a word is no corner.
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
        """Corners that are all written in one way; None where they are not."""
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
    """Numbers with blanks between them; none or fewer where a word is no number."""
    with python_warnings.catch_warnings():
        python_warnings.simplefilter("error", DeprecationWarning)  # older releases' way to say so
        try:
            return np.fromstring(text, kind, sep=" ")
        except (ValueError, DeprecationWarning):
            return np.zeros(0, kind)


def _indices(tokens: list[str]) -> np.ndarray:
    """`a`, `a/b`, `a//c` and `a/b/c` as int64 [n, 3]; 0 = not given."""
    parts = [p or "0" for t in tokens for p in [*t.split("/"), "0", "0"][:3]]
    return np.array(parts, str).astype(np.int64).reshape(-1, 3)


def triangles(
    counts: np.ndarray, corners: np.ndarray, vertices: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Polygons to triangles.

    Args:
      counts: corners [P] of each polygon, 3 and above.
      corners: vertex index of each corner, polygon after polygon.
      vertices: [V, 3].

    Returns:
      positions [T, 3] in `corners`, and the polygon [T] of each triangle.
    """
    start = np.cumsum(counts) - counts
    polygon = np.repeat(np.arange(len(counts)), counts - 2)
    number = np.arange(len(polygon)) - np.repeat(np.cumsum(counts - 2) - (counts - 2), counts - 2)
    first = start[polygon]
    result = np.stack([first, first + number + 1, first + number + 2], axis=1)
    # A fan is right for convex polygons. Where its triangles do not all face one way, ears are
    # cut instead; above some hundred corners that is too slow and the fan stays.
    if (counts > 3).any():
        a, b, c = (vertices[corners[result[:, k]]] for k in range(3))
        normal = np.cross(b - a, c - a)
        total = np.stack(
            [np.bincount(polygon, normal[:, k], len(counts)) for k in range(3)], axis=1
        )
        turned = (normal * total[polygon]).sum(axis=1) < 0
        for index in np.unique(polygon[turned]):
            if counts[index] > 200:
                continue
            span = np.arange(start[index], start[index] + counts[index])
            axis = int(np.abs(total[index]).argmax())
            flat = np.delete(vertices[corners[span]], axis, axis=1)
            # Dropping an axis keeps or turns the orientation.
            if (total[index, axis] > 0) == (axis == 1):
                flat = flat[:, ::-1]
            result[polygon == index] = span[meshes.cut_ears(flat)]
    return result, polygon


def _resolve(index: np.ndarray, count: np.ndarray | int) -> np.ndarray:
    """OBJ indices (from 1, negative = from the end) to indices from 0; -1 = none."""
    return np.where(index > 0, index - 1, np.where(index < 0, index + count, -1))


def _read_obj(
    data: bytes, files: Files, base: str, side: int, max_faces: int, notes: Notes
) -> dict[str, Any]:
    """Arrays of an OBJ file for `meshes.build`."""
    columns = {_V: 3, _VT: 2, _VN: 3}
    rows: dict[int, list[np.ndarray]] = {kind: [np.zeros((0, n))] for kind, n in columns.items()}
    read = dict.fromkeys(columns, 0)
    textures = Textures(files, base, side, notes)
    materials: dict[str, Material] = {}
    names: dict[str, int] = {}
    owner = -1
    owner_blocks: list[np.ndarray] = []
    count_blocks: list[np.ndarray] = []
    corner_blocks: list[np.ndarray] = []
    total = broken = 0
    for block in _blocks(data):
        lines = _Lines(block)
        # Owners of the block's faces: those before the first `usemtl` keep the last one's.
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
            elif key == "mtllib":
                # The name may hold spaces; else there may be several.
                for name in [rest.strip()] if _exists(files, base, rest) else rest.split():
                    try:
                        text = files.open(base, name).decode("utf-8", "replace")
                        materials.update(read_mtl(text, textures))
                    except FileNotFoundError:
                        notes.add(f"material file {name!r} is missing; grey stands in")
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
                # Negative indices count from the rows read before the face.
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
        raise UnusableModelError("the mesh is empty: the file has no faces")

    vertices, texture, normal = (np.concatenate(rows[kind]) for kind in (_V, _VT, _VN))
    corners = np.concatenate(corner_blocks)
    counts = np.concatenate(count_blocks)
    owners = np.concatenate(owner_blocks)
    exists = (corners[:, 0] >= 0) & (corners[:, 0] < len(vertices))
    whole = np.logical_and.reduceat(exists, np.cumsum(counts) - counts)
    if not whole.all():
        notes.add(f"{int((~whole).sum())} faces with vertices that do not exist dropped")
        corners = corners[np.repeat(whole, counts)]
    counts, owners = counts[whole], owners[whole]
    if not len(counts):
        raise UnusableModelError("the mesh is empty: no face has its vertices")
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
            notes.add(f"material {name!r} is missing; grey stands in")
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
    found = posixpath.normpath(posixpath.join(base, name.strip()))
    return not found.startswith(("/", "..")) and files.find(found) is not None


# --- All other formats, by trimesh ------------------------------------------------------------


def _faces_in_header(data: bytes, kind: str) -> int:
    """Number of faces that the file announces, 0 where its format does not say."""
    head = data[:4096]
    try:
        if kind == "stl" and not (head.lstrip().startswith(b"solid") and b"facet" in head):
            return struct.unpack("<I", data[80:84])[0]
        if kind in ("stl", "stl_ascii"):
            return data.count(b"endfacet")
        if kind == "ply":
            for line in head.split(b"end_header")[0].splitlines():
                if line.startswith(b"element face"):
                    return int(line.split()[2])
        if kind == "off":
            words = [w for ln in head.splitlines() for w in ln.split(b"#")[0].split()]
            words = words[1:] if words and words[0].upper().endswith(b"OFF") else words
            return int(words[1]) if len(words) > 1 else 0
        if kind in ("glb", "gltf"):
            length = struct.unpack("<I", data[12:16])[0]
            tree = json.loads(data[20 : 20 + length] if kind == "glb" else data)
            uses: dict[int, int] = {}
            for node in tree.get("nodes", []):
                if "mesh" in node:
                    uses[node["mesh"]] = uses.get(node["mesh"], 0) + 1
            corners = 0
            for index, mesh in enumerate(tree.get("meshes", [])):
                for part in mesh.get("primitives", []):
                    accessor = part.get("indices", part.get("attributes", {}).get("POSITION"))
                    count = tree["accessors"][accessor]["count"] if accessor is not None else 0
                    corners += count * uses.get(index, 1)
            return corners // 3
    except (struct.error, ValueError, KeyError, IndexError, TypeError, AttributeError) as error:
        raise UnusableModelError(f"not readable as {kind}: {error}"[:200]) from error
    return 0


def _resolver(files: Files, base: str, notes: Notes) -> Any:
    """`files` in the form in which trimesh asks for the files that a model refers to."""
    import trimesh

    class Resolver(trimesh.resolvers.Resolver):
        def __init__(self) -> None:
            pass

        def get(self, key: str) -> bytes:
            try:
                return files.open(base, key)
            except FileNotFoundError:
                notes.add(f"file {key!r} is missing")
                raise

        def write(self, name: str, data: Any) -> None:
            raise OSError(f"{name}: read only")

        def namespaced(self, namespace: str) -> Any:
            return _resolver(files, posixpath.join(base, namespace), notes)

        def keys(self) -> list[str]:
            return []

    return Resolver()


def _srgb(linear: float) -> float:
    return float(min(max(linear, 0.0), 1.0) ** (1 / 2.2))


def _from_trimesh_material(material: Any, side: int, notes: Notes) -> Material:
    """One of trimesh's materials (simple or physically based) as Blinn-Phong."""
    name = str(getattr(material, "name", "") or "")

    def texture_of(picture: Any) -> np.ndarray | None:
        if picture is None:
            return None
        try:
            return decode_texture(picture, side)
        except ValueError as error:
            notes.add(f"texture of {name!r}: {error}; the plain colour stands in")
            return None

    def rgba(values: Any, fallback: tuple[float, ...]) -> list[float]:
        if values is None:
            return list(fallback)
        raw = np.asarray(values)
        scaled = raw / 255 if raw.dtype.kind in "ui" else raw
        return [*np.clip(scaled.astype(float).ravel(), 0, 1), 1.0, 1.0, 1.0, 1.0][:4]

    if hasattr(material, "baseColorFactor"):
        texture = texture_of(material.baseColorTexture)
        plain = (1.0, 1.0, 1.0, 1.0) if texture is not None else (*_GREY, 1.0)
        base = rgba(material.baseColorFactor, plain)
        if material.baseColorFactor is not None:
            base = [*(_srgb(v) for v in base[:3]), base[3]]  # glTF's factors are linear
        mode = str(material.alphaMode or "OPAQUE").upper()
        if texture is not None and mode != "BLEND" and (texture[..., 3] < 255).any():
            cutoff = 0.5 if material.alphaCutoff is None else float(material.alphaCutoff)
            solid = (texture[..., 3] >= 255 * cutoff) | (mode == "OPAQUE")
            texture = np.dstack([texture[..., :3], np.where(solid, 255, 0).astype(np.uint8)])
        rough = 0.8 if material.roughnessFactor is None else float(material.roughnessFactor)
        metal = 0.0 if material.metallicFactor is None else float(material.metallicFactor)
        if material.metallicRoughnessTexture is not None:
            metal = min(metal, 0.5)
        # The exponent whose lobe has the width of a microfacet lobe of that roughness.
        shininess = min(max(2 / max(rough, 0.05) ** 4 - 2, 1.0), 1000.0)
        strength = 1 - rough
        return Material(
            diffuse=(base[0], base[1], base[2]),
            specular=tuple(strength * ((1 - metal) * 0.2 + metal * v) for v in base[:3]),  # type: ignore[arg-type]
            shininess=shininess,
            opacity=1.0 if mode == "OPAQUE" else base[3],
            texture=texture,
            name=name,
        )
    texture = texture_of(getattr(material, "image", None))
    plain = (1.0, 1.0, 1.0, 1.0) if texture is not None else (*_GREY, 1.0)
    base = rgba(getattr(material, "diffuse", None), plain)
    high = rgba(getattr(material, "specular", None), (0.0, 0.0, 0.0, 1.0))
    gloss = _floats([str(getattr(material, "glossiness", None) or 20.0)], 1) or [20.0]
    return Material(
        diffuse=(base[0], base[1], base[2]),
        specular=(high[0], high[1], high[2]),
        shininess=min(max(gloss[0], 1.0), 1000.0),
        opacity=base[3],
        texture=texture,
        name=name,
    )


def _palette(colours: np.ndarray) -> tuple[Material, np.ndarray]:
    """A material and uv [F, 3, 2] that give each face its own colour, uint8 [F, 4].

    Colours are rounded to 5 bits; each distinct one is one texel.
    """
    key = (colours.astype(np.int64) >> 3) @ np.array([1 << 15, 1 << 10, 1 << 5, 1])
    distinct, first, index = np.unique(key, return_index=True, return_inverse=True)
    width = int(np.ceil(np.sqrt(len(distinct))))
    texture = np.zeros((width * width, 4), np.uint8)
    texture[: len(distinct)] = colours[first]
    column, row = index % width, index // width
    uv = np.stack([(column + 0.5) / width, 1 - (row + 0.5) / width], axis=1)
    return (
        Material(diffuse=(1.0, 1.0, 1.0), texture=texture.reshape(width, width, 4), name="colours"),
        np.repeat(uv[:, None], 3, axis=1),
    )


def _read_trimesh(
    data: bytes, kind: str, files: Files, base: str, side: int, max_faces: int, notes: Notes
) -> dict[str, Any]:
    """Arrays of a file of any format that the installed trimesh reads, for `meshes.build`."""
    import trimesh

    formats = trimesh.available_formats() - _ARCHIVES
    if kind not in formats:
        raise UnusableModelError(f"format {kind!r}: expected one of {sorted(formats)}")
    meshes.check_face_count(_faces_in_header(data, kind), max_faces)
    if kind in ("dae", "zae", "3mf", "xaml", "3dxml"):
        if len(data) > _MAX_XML_BYTES:
            raise UnusableModelError(f"{len(data)} bytes of {kind}: more than {_MAX_XML_BYTES}")
        if b"<!ENTITY" in data:
            raise UnusableModelError("XML entities are refused")
    try:
        with python_warnings.catch_warnings():
            python_warnings.simplefilter("ignore")
            scene = trimesh.load_scene(
                io.BytesIO(data),
                file_type=kind,
                resolver=_resolver(files, base, notes),
                process=False,
            )
            names = [scene.graph[node] for node in scene.graph.nodes_geometry]
    except Exception as error:
        # A damaged file surfaces as any exception at all in a third-party reader.
        what = f"{type(error).__name__}: {error}".splitlines()[0]
        raise UnusableModelError(f"not readable as {kind}: {what}"[:200]) from error
    vertices: list[np.ndarray] = []
    faces: list[np.ndarray] = []
    normals: list[np.ndarray] = []
    uvs: list[np.ndarray] = []
    owners: list[np.ndarray] = []
    materials: list[Material] = []
    known: dict[int, int] = {}
    offset = total = 0
    for matrix, name in names:
        mesh = scene.geometry[name]
        if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
            continue
        total += len(mesh.faces)
        meshes.check_face_count(total, max_faces)
        corner = np.asarray(mesh.faces, np.int64)
        if corner.min() < 0 or corner.max() >= len(mesh.vertices):
            raise UnusableModelError(
                f"not readable as {kind}: faces with vertices that do not exist"
            )
        linear = np.asarray(matrix, np.float64)[:3, :3]
        vertices.append(np.asarray(mesh.vertices, np.float64) @ linear.T + matrix[:3, 3])
        # Normals are kept where the file had them: only then are they in the cache already.
        given = mesh._cache.cache.get("vertex_normals")
        if given is not None and len(given) == len(mesh.vertices) and np.linalg.det(linear):
            turned = np.asarray(given) @ np.linalg.inv(linear)
            normals.append(turned[corner])
        else:
            normals.append(np.zeros((len(corner), 3, 3)))
        if np.linalg.det(linear) < 0:
            corner = corner[:, ::-1]
            normals[-1] = normals[-1][:, ::-1]
        visual: Any = mesh.visual
        uv = np.zeros((len(corner), 3, 2))
        if visual.kind == "texture":
            coordinates = getattr(visual, "uv", None)
            if coordinates is not None and len(coordinates) == len(mesh.vertices):
                uv = np.asarray(coordinates, np.float64)[:, :2][corner]
            key = id(visual.material)
            if key not in known:
                known[key] = len(materials)
                materials.append(_from_trimesh_material(visual.material, side, notes))
            owner = known[key]
        elif visual.kind in ("vertex", "face"):
            colours = np.asarray(
                visual.face_colors
                if visual.kind == "face"
                else visual.vertex_colors[corner].mean(axis=1)
            )
            material, uv = _palette(colours.round().astype(np.uint8))
            owner = len(materials)
            materials.append(material)
        else:
            owner = len(materials)
            materials.append(Material())
        faces.append(corner + offset)
        uvs.append(uv)
        owners.append(np.full(len(corner), owner))
        offset += len(mesh.vertices)
    if not faces:
        raise UnusableModelError("the mesh is empty: the file has no faces")
    normal = np.concatenate(normals)
    return {
        "vertices": np.concatenate(vertices),
        "faces": np.concatenate(faces),
        "normals": normal if normal.any() else None,
        "uv": np.concatenate(uvs),
        "materials": bounded(materials, notes),
        "face_material": np.concatenate(owners),
    }


Reader = Callable[[bytes, Files, str, int, int, Notes], dict[str, Any]]
"""Makes arrays for `meshes.build` of: the file's bytes, the files that it may refer to, its folder
there, the limits of the textures' sides and of the faces, and a place for warnings."""


# --- The entry --------------------------------------------------------------------------------


def load(
    name: str | os.PathLike[str],
    files: Files | None = None,
    *,
    up: str = "+y",
    front: str = "+z",
    category: str = "",
    model_id: str = "",
    parameters: Mapping[str, Any] | None = None,
    texture_side: int = TEXTURE_SIDE,
    max_faces: int = meshes.MAX_FACES,
    crease_degrees: float = meshes.CREASE_DEGREES,
    turn: Callable[[Model], Model] = lambda model: model,
    reader: Reader | None = None,
) -> Model:
    """Reads a model from a file and brings it to the project's frame, normalised.

    Args:
      name: path; with `files`, a name there.
      files: where the file and what it refers to lie; None = the folder of `name`.
      up: the file's axis that points up, see `meshes.orient`.
      front: the file's axis that the object's front points to.
      category: of the object.
      model_id: of the object; empty = the file's name.
      parameters: for the model.
      texture_side: see `TEXTURE_SIDE`.
      max_faces: more are refused.
      crease_degrees: see `meshes.crease_normals`.
      turn: applied in the file's axes, before `up` and `front`.
      reader: of the file's format; None = by the ending of its name.

    Raises:
      UnusableModelError: the file is missing, damaged, empty or too large; the message says what.
    """
    if files is None:
        path = pathlib.Path(name)
        files, name = FolderFiles(path.parent), path.name
    name = str(name)
    model_id = model_id or name
    notes = Notes()
    base = posixpath.dirname(name)
    kind = posixpath.splitext(name)[1].lstrip(".").lower()
    found = files.find(name)
    if found is None:
        raise UnusableModelError(f"file {name!r} is missing")
    try:
        data = files.read(found)
    except OSError as error:
        raise UnusableModelError(f"file {name!r} is not readable: {error}"[:200]) from error
    reader = reader or (_read_obj if kind == "obj" else None)
    arrays = (
        reader(data, files, base, texture_side, max_faces, notes)
        if reader
        else _read_trimesh(data, kind, files, base, texture_side, max_faces, notes)
    )
    del data
    model = meshes.build(
        **arrays,
        category=category,
        model_id=model_id,
        parameters=parameters,
        warnings=notes.lines,
        crease_degrees=crease_degrees,
        max_faces=max_faces,
    )
    return meshes.normalize(meshes.orient(turn(model), up, front))

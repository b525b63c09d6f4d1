"""Reader of Wavefront OBJ files and their materials, MTL files.

Files of ShapeNet and Sweet Home 3D have features that other readers ignore: missing and negative
indices, several material files, options before the names of textures, alpha maps, missing images,
concave polygons.
"""

import collections
import contextlib
import dataclasses
import itertools
import posixpath
import re
import warnings as python_warnings
from collections.abc import Iterator, Sequence

import numpy as np

from data_gen.mesh import GREY, Material, UnusableModelError
from data_gen.readers.model_files import DamagedError, numbers, reason, whole_lines
from data_gen.readers.parts import Look, Part, material, picked, rgba
from data_gen.readers.textures import NO_COORDINATES, Assets
from psgn_jax.system.untrusted import one_line


def _blocks(data: bytes, size: int = 1 << 22) -> Iterator[bytes]:
    """The text in blocks of whole lines."""
    start = 0
    while start < len(data):
        stop = data.find(b"\n", min(start + size, len(data))) + 1 or len(data)
        yield data[start:stop]
        start = stop


_COMMENT = re.compile("#(?!IND|INF|QNAN|SNAN)", re.IGNORECASE)  # not that of 1.#QNAN
_COLUMNS = {"v": 3, "vt": 2, "vn": 3}

_UNREAD = {
    "v": "weights of vertices not read",
    "l": "lines and points not read", "p": "lines and points not read",
    "curv": "curves and surfaces not read", "curv2": "curves and surfaces not read",
    "surf": "curves and surfaces not read", "call": "files that OBJ calls not read",
    "#MRGB": "colours of ZBrush (#MRGB) not read",
}  # fmt: skip


def _rows(lines: list[list[str]], columns: int) -> np.ndarray:
    """Words as numbers [n, columns]; we pad short lines with 0."""
    if any(len(words) < columns for words in lines):
        lines = [[*words, "0", "0", "0"][:columns] for words in lines]
    return numbers(lines).reshape(-1, columns)


def _indices(tokens: list[str]) -> np.ndarray:
    """`a`, `a/b`, `a//c` and `a/b/c` as int64 [n, 3]; 0 = missing."""
    slashes = {token.count("/") for token in tokens}
    columns = max(slashes, default=0) + 1
    if len(slashes) == 1 and columns <= 3:  # as in nearly all files; this is fast
        with contextlib.suppress(ValueError), python_warnings.catch_warnings():
            python_warnings.simplefilter("ignore", DeprecationWarning)  # of a text with other words
            text = " ".join(tokens).replace("//", "/0/").replace("/", " ")
            values = np.fromstring(text, np.int64, sep=" ")
            if len(values) == columns * len(tokens) and np.abs(values).max() < 1 << 60:
                return np.pad(values.reshape(-1, columns), ((0, 0), (0, 3 - columns)))
    words = [word or "0" for token in tokens for word in [*token.split("/"), "0", "0"][:3]]
    return numbers(words, np.int64).reshape(-1, 3)


def _short(name: str) -> str:
    """A name without a comment at its end."""
    return re.split(r"\s#", name)[0].strip()


def _read_libraries(line: str, assets: Assets, seen: set[str]) -> dict[str, Look]:
    """The materials of the files in a line `mtllib`, except files in `seen`."""
    # The line has a name, which may contain spaces, or several names.
    rest = line.split(None, 1)[1].strip().strip('"').replace("\\", "/")
    path = posixpath.normpath(posixpath.join(assets.base, rest))
    inside = not path.startswith(("/", ".."))
    looks: dict[str, Look] = {}
    for name in [rest] if inside and assets.files.find(path) else _short(rest).split():
        if name in seen:
            continue
        seen.add(name)
        try:
            library = assets.open(name)
            if why := reason(library):
                assets.warn("material files not readable", f"{name!r} ({why})")
            looks |= read_mtl(library, assets, posixpath.dirname(name))
        except FileNotFoundError:
            assets.warn("material files missing, grey is used", repr(name))
    return looks


def read_obj(data: bytes, assets: Assets) -> list[Part]:
    """The polygons of an OBJ file. We read it in blocks, which bounds the memory."""
    rows = {key: [np.zeros((0, columns))] for key, columns in _COLUMNS.items()}
    read = dict.fromkeys(_COLUMNS, 0)  # number of rows so far
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
        before = len(sizes)
        seen: list[tuple[int, int, int]] = []  # number of rows before the corner
        # Other bytes than UTF-8, such as names in Latin-1 or GBK, stay distinct.
        for line in block.decode("utf-8", "surrogateescape").split("\n"):
            key, *words = line.split() or [""]
            if not words and key != "usemtl":
                continue
            if key in ("v", "vt", "vn", "f", "fo") and "#" in line:
                words = _COMMENT.split(line)[0].split()[1:]
            if key in fresh:
                if key == "v" and len(words) > 5:  # with a colour
                    painted.append(read["v"])
                    paint.append(words[3:6])
                elif key == "v" and len(words) > 3 and floats(words[3:], 1) != [1.0]:
                    unread["v"] += 1
                fresh[key].append(words[: _COLUMNS[key]])
                read[key] += 1
            elif key in ("f", "fo"):
                tokens += words
                seen += [(read["v"], read["vt"], read["vn"])] * len(words)
                sizes.append(len(words))
                owners.append(owner)
            elif key == "usemtl":
                owner = names.setdefault(line.strip()[6:].strip(), len(names))
            elif key == "mtllib":
                looks |= _read_libraries(line, assets, libraries)
            elif key in _UNREAD:
                unread[key] += 1
        # Also lines with fewer corners take memory.
        assets.budget.charge(faces=np.maximum(np.array(sizes[before:]) - 2, 1).sum())
        for key, lines in fresh.items():
            rows[key].append(_rows(lines, _COLUMNS[key]))
        corners = _indices(tokens)
        if (corners[:, 0] == 0).any():
            raise DamagedError("a face has index 0, but 1 is the first")
        if (corners < 0).any():  # they count back from the last row before the face
            corners += np.where(corners < 0, np.array(seen) + 1, 0)
        corner_blocks.append(corners - 1)  # from 0; negative = missing
    for key, number in unread.items():
        assets.warn(_UNREAD[key], number)
    vertices, texture, normal = (np.concatenate(blocks) for blocks in rows.values())
    if not sizes:
        what = f"{len(vertices)} points and {unread['l'] + unread['p']} lines, but no faces"
        raise UnusableModelError(f"the mesh is empty: {what}")
    corners, counts = np.concatenate(corner_blocks), np.array(sizes)

    by_short_name = {_short(name): look for name, look in reversed(looks.items())}
    table: list[Look | None] = []
    no_uv = set(np.repeat(np.array(owners), counts)[corners[:, 1] < 0].tolist())
    for index, name in enumerate(names):
        look = looks.get(name) or by_short_name.get(_short(name))
        if look is None and name:  # without a name, there is no material
            assets.warn("materials missing, grey is used", repr(name))
            look = None if paint else Look(Material(name=one_line(name)))
        elif look is not None and look.material.texture is not None and index in no_uv:
            assets.warn(NO_COORDINATES, repr(name))
        table.append(look)
    used = [table[owner] if owner >= 0 else None for owner in set(owners)]
    if all(look is not None and look.material.opacity == 0 for look in used):
        assets.warn("opacity 0 of all materials, opaque is used")  # old exporters write it
        opaque = {k: dataclasses.replace(k.material, opacity=1.0) for k in table if k}
        table = [k and dataclasses.replace(k, material=opaque[k]) for k in table]
    colours = None
    if paint:
        of_vertices = np.ones((len(vertices), 4))
        of_vertices[painted] = rgba(numbers(paint), assets)
        colours = picked(of_vertices, corners[:, 0])
    table.append(None)  # of faces before the first `usemtl`
    uv, normals = picked(texture, corners[:, 1], assets), picked(normal, corners[:, 2], assets)
    return [Part(vertices, counts, corners[:, 0], table, np.array(owners), uv, normals, colours)]


# --- Materials ----------------------------------------------------------------------------------


def floats(words: Sequence[str], count: int) -> list[float] | None:
    """The first `count` words as numbers; None if they are fewer or not finite numbers."""
    try:
        values = [float(w) for w in words[:count]]
    except ValueError:
        return None
    return values if len(values) == count and np.isfinite(values).all() else None


# Options of a map statement and their number of arguments, from the MTL specification; 0 = one to
# three numbers.
_MAP_OPTIONS = {"-blendu": 1, "-blendv": 1, "-cc": 1, "-clamp": 1, "-texres": 1, "-imfchan": 1,
                "-type": 1, "-bm": 1, "-boost": 1, "-mm": 2, "-o": 0, "-s": 0, "-t": 0}  # fmt: skip


def _map_name(rest: str) -> tuple[str, dict[str, list[str]]]:
    """The file name in a map statement, which may contain spaces, and the options before it."""
    words, at = rest.split(), 0  # an index: copies of the rest would take quadratic time
    options: dict[str, list[str]] = {}
    while at < len(words) and (
        (option := words[at].lower()) in _MAP_OPTIONS
        or (len(words) - at > 2 and re.fullmatch("-[a-z]+", option))  # such as -colorspace sRGB
    ):
        following = words[at + 1 : min(at + 4, len(words) - 1)]
        values = itertools.takewhile(lambda word: floats([word], 1), following)
        count = _MAP_OPTIONS.get(option, 1) or len(list(values))
        options[option] = words[at + 1 : at + 1 + count]
        at += 1 + count
    return (" ".join(words[at:]) if options else rest), options


def read_mtl(data: bytes, assets: Assets, folder: str = "") -> dict[str, Look]:
    """The materials of an MTL file by name; `folder` is its place below the model's folder.

    We read Kd, Ks, Ns, d, Tr, illum (2 and above have a highlight), map_Kd and map_d with the
    options -s, -o, -clamp, -mm and -imfchan, and map_Ka if map_Kd is missing. We read black Kd with
    a texture as white: many exporters write black and mean the texture alone.
    """
    statements: dict[str, dict[str, str]] = {}
    current: dict[str, str] = {}
    assets.budget.charge(made=16 * len(data))
    text = whole_lines(data).decode("utf-8", "surrogateescape")
    for line in text.split("\n"):
        words = line.strip().split(None, 1)
        if not words or words[0].startswith("#"):
            continue
        rest = words[1].strip() if len(words) > 1 else ""
        if words[0].lower() == "newmtl":
            current = statements.setdefault(rest, {})
            assets.budget.charge(visits=1)
        else:
            current[words[0].lower()] = rest
    return {name: _look(name, lines, assets, folder) for name, lines in statements.items()}


def _look(name: str, lines: dict[str, str], assets: Assets, folder: str) -> Look:
    """The material that the statements of `lines` describe."""

    def number(key: str, default: float) -> float:
        values = floats(lines.get(key, "").replace("-halo", "").split(), 1)
        return values[0] if values else default

    def colour(key: str) -> list[float] | None:
        words = lines.get(key, "").split()
        return floats(words, 3) or floats(words[:1] * 3, 3)

    if "map_kd" not in lines and "map_ka" in lines:
        lines = {**lines, "map_kd": lines["map_ka"]}
    for key, rest in lines.items():
        others = key.startswith("map_") and key not in ("map_kd", "map_ka", "map_d")
        if rest and (others or key in ("bump", "disp", "norm", "refl", "decal")):
            assets.warn("maps of MTL not read", key)
    if max(colour("ke") or (0,)) > 0.02:
        assets.warn("emission not read", repr(name))
    (file, options), (alpha_file, of_alpha) = (
        _map_name(lines.get(key, "")) for key in ("map_kd", "map_d")
    )
    texture = assets.texture(file, folder) if file else None
    gain = floats(options.get("-mm", ()), 2)
    if texture is not None and gain:
        assets.budget.charge(made=4 * texture.nbytes)
        rgb = (255 * gain[0] + gain[1] * texture[..., :3]).clip(0, 255).round().astype(np.uint8)
        texture = np.dstack([rgb, texture[..., 3]])
    alpha_map = assets.texture(alpha_file, folder) if alpha_file else None
    if alpha_map is not None:
        channel = "rgbm".find("".join(of_alpha.get("-imfchan", ())).lower() or "none")
        alpha = alpha_map[..., channel]
        if channel < 0 and (alpha == 255).all() and alpha_file != file:
            alpha = alpha_map[..., :3].mean(axis=2).round().astype(np.uint8)
        texture = assets.with_alpha(texture, alpha)
    diffuse = colour("kd")
    if diffuse is None and lines.get("kd"):
        assets.warn("colours of MTL that are not RGB not read", lines["kd"])
    if diffuse is None or ("map_kd" in lines and max(diffuse) < 0.02):
        diffuse = [1.0] * 3 if texture is not None else list(GREY)
    opacity = number("d", 1 - number("tr", 0.0))
    specular = colour("ks") or [0.0] * 3
    if lines.get("illum", "2").split()[:1] in (["0"], ["1"]):
        specular = [0.0] * 3
    made = material(diffuse, specular, number("ns", 20.0), opacity, texture, name)
    if texture is None:
        return Look(made)
    if any(float(word) for word in options.get("-t", ())):
        assets.warn("turbulence (-t) of textures not read", file)
    used = options if file else of_alpha
    scale, offset = (
        [*map(float, used.get(key, ())), default, default][:2]
        for key, default in (("-s", 1.0), ("-o", 0.0))
    )
    wrap = "clamp" if used.get("-clamp") == ["on"] else "repeat"
    return Look(made, np.column_stack([np.diag(scale), offset]), (wrap, wrap))

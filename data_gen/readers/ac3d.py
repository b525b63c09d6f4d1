"""Reader of AC3D files (`.ac`), the models of flight and racing simulators.

Assimp reads surfaces, materials and textures. This module calls only functions of its C interface
that exchange bytes: it passes the contents of the file and gets assimp's JSON. The only struct
layout that it relies on is the first two fields of the export blob.

Before that, this module reads the hierarchy of the file (objects, positions, counts), for two
reasons. First, the counts are bounded and compared with the contents before any C++ code reads the
file. Second, assimp places objects incorrectly: it rotates the vertices of an object after the
translation, applies the transformation of a parent only if the parent is a group, and drops the
crease angle.
"""

import ctypes
import ctypes.util
import dataclasses
import functools
import importlib.util
import json
import pathlib
import re
from collections.abc import Iterator
from typing import Any

import numpy as np

from data_gen.mesh import (
    CREASE_DEGREES,
    MAX_FACES,
    Material,
    UnusableModelError,
    check_face_count,
    crease_normals,
)
from data_gen.polygons import triangles
from data_gen.readers.textures import Assets

NO_ASSIMP = (
    "assimp is not installed: `pip install 'psgn-jax[render]'`, or the system's own (on Debian "
    "`apt-get install libassimp5`)"
)

_MAX_OBJECTS = 50_000

_MAX_DEPTH = 100  # assimp reads nested objects by recursion

_TWO_SIDED = 0x20

_STATEMENT = re.compile(
    rb"^[ \t]*(OBJECT|kids|numvert|numsurf|SURF|refs|loc|rot|crease|data)\b[ \t]*([^\r\n]*)",
    re.MULTILINE,
)

# Objects that are not part of the model: wakes and shadows.
_NO_PARTS = re.compile(r"wake([\W_0-9]|$)|sillage|shadow", re.IGNORECASE)

_NO_PART = "a ship's wake or a painted shadow left out"

_SURFACE = re.compile(rb"^([ \t]*SURF[ \t]+0[xX])([0-9a-fA-F]{1,8})", re.MULTILINE)


@dataclasses.dataclass
class Object:
    """An object of a file: its transformation, and the number of its parent or -1.

    A vertex v of the object is at `rotation @ v + location` in the frame of the parent.
    """

    parent: int
    location: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(3))
    rotation: np.ndarray = dataclasses.field(default_factory=lambda: np.eye(3))
    crease: float = CREASE_DEGREES
    kids: int | None = None
    surfaces: int = 0
    surfaces_read: int = 0


def _count(words: bytes, what: str, limit: int) -> int:
    text = words.split()[0] if words.split() else b""
    if not re.fullmatch(rb"[0-9]{1,18}", text):
        raise UnusableModelError(f"not readable as AC3D: {what} {text[:40]!r}")
    if int(text) > limit:
        raise UnusableModelError(
            f"not readable as AC3D: {what} {int(text)}, more than the file's length permits"
        )
    return int(text)


def _numbers(words: bytes, count: int, what: str) -> np.ndarray:
    try:
        values = np.array(words.split()[:count], np.float64)
    except ValueError as error:
        raise UnusableModelError(f"not readable as AC3D: {what}: {error}"[:200]) from error
    if len(values) < count:
        raise UnusableModelError(
            f"not readable as AC3D: {what}: {len(values)} numbers, expected {count}"
        )
    if not np.isfinite(values).all():
        raise UnusableModelError(f"{what} has coordinates that are not finite")
    return values


def read_outline(data: bytes, assets: Assets | None = None) -> list[Object]:
    """The objects of a file in order. All counts in the file are compared with its contents.

    Some exporters count objects that they do not write. If `assets` is given, such a file is
    accepted with a warning, provided that its last object is complete and fewer objects are missing
    than present.

    Raises:
      UnusableModelError: this is not an AC3D file, it is truncated, or it has too many faces or
        objects.
    """
    if not re.match(rb"AC3D[0-9a-f]", data):
        raise UnusableModelError("not readable as AC3D: it does not begin with AC3D")
    size = len(data)
    objects: list[Object] = []
    open_: list[tuple[int, int]] = []  # index of an object, number of its children that follow
    faces = skip = 0
    statements = list(_STATEMENT.finditer(data))
    for number, match in enumerate(statements):
        if match.start() < skip:
            continue
        key, rest = match[1], match[2]
        if key == b"data":
            skip = match.end() + _count(rest, "data", size)
            continue
        if key == b"OBJECT":
            if objects and objects[-1].kids is None:
                raise UnusableModelError("not readable as AC3D: an object without a kids line")
            while open_ and open_[-1][1] == 0:
                open_.pop()
            if open_:
                open_[-1] = (open_[-1][0], open_[-1][1] - 1)
            if len(open_) > _MAX_DEPTH or len(objects) >= _MAX_OBJECTS:
                raise UnusableModelError(
                    f"more than {_MAX_OBJECTS} objects or more than {_MAX_DEPTH} levels"
                )
            objects.append(Object(open_[-1][0] if open_ else -1))
            continue
        if not objects:
            continue
        here = objects[-1]
        if key == b"kids":
            here.kids = _count(rest, "kids", size // 8)
            if here.kids:
                open_.append((len(objects) - 1, here.kids))
        elif key == b"numvert":
            count = _count(rest, "numvert", size // 6)
            stop = statements[number + 1].start() if number + 1 < len(statements) else size
            _numbers(data[match.end() : stop], 3 * count, "numvert")
        elif key == b"numsurf":
            here.surfaces = _count(rest, "numsurf", size // 8)
        elif key == b"SURF":
            here.surfaces_read += 1
        elif key == b"refs":
            count = _count(rest, "refs", size // 4)
            faces += max(count - 2, 0)
            check_face_count(faces, assets.max_faces if assets else MAX_FACES)
        elif key == b"loc":
            here.location = _numbers(rest, 3, "loc")
        elif key == b"rot":
            here.rotation = _numbers(rest, 9, "rot").reshape(3, 3)
        elif key == b"crease":
            here.crease = float(np.clip(_numbers(rest, 1, "crease")[0], 0, 180))
    if not objects:
        raise UnusableModelError("the mesh is empty: no objects, expected at least one")
    missing = sum(left for _, left in open_)
    if objects[-1].kids is None or (missing and (assets is None or missing >= len(objects))):
        raise UnusableModelError("not readable as AC3D: the file is truncated: objects are missing")
    if missing and assets is not None:
        assets.warn(f"{missing} objects are missing, compared with the counts in the file")
    if any(o.surfaces_read != o.surfaces for o in objects):
        raise UnusableModelError(
            "not readable as AC3D: the file is truncated: surfaces are missing"
        )
    return objects


def _places(objects: list[Object]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Rotation and location of each object in the frame of the file."""
    done: list[tuple[np.ndarray, np.ndarray]] = []
    for each in objects:
        turn, move = each.rotation, each.location
        if each.parent >= 0:
            outer, shift = done[each.parent]
            turn, move = outer @ turn, outer @ move + shift
        done.append((turn, move))
    yield from done


class _Blob(ctypes.Structure):
    """The first fields of assimp's aiExportDataBlob."""

    _fields_ = (("size", ctypes.c_size_t), ("data", ctypes.c_void_p))


def find_assimp() -> str:
    """Path or name of the assimp library; the Python package is preferred. "" = none."""
    package = importlib.util.find_spec("cmeel")
    for place in (package and package.submodule_search_locations) or ():
        root = pathlib.Path(place).parent / "cmeel.prefix" / "lib"
        for name in ("libassimp.so", "libassimp.dylib"):
            if (root / name).exists():
                return str(root / name)
    return ctypes.util.find_library("assimp") or ""


def check_assimp(catalogue: str) -> None:
    """Raises ValueError, with the name of the catalogue that needs it, if assimp is missing."""
    if not find_assimp():
        raise ValueError(f"catalogue {catalogue!r}: {NO_ASSIMP}")


@functools.lru_cache(maxsize=1)
def _assimp() -> Any:
    name = find_assimp()
    if not name:
        raise UnusableModelError(NO_ASSIMP)
    library = ctypes.CDLL(name)
    library.aiImportFileFromMemory.restype = ctypes.c_void_p
    library.aiImportFileFromMemory.argtypes = [
        ctypes.c_char_p, ctypes.c_uint, ctypes.c_uint, ctypes.c_char_p,
    ]  # fmt: skip
    library.aiExportSceneToBlob.restype = ctypes.POINTER(_Blob)
    library.aiExportSceneToBlob.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_uint]
    library.aiGetErrorString.restype = ctypes.c_char_p
    library.aiReleaseImport.argtypes = [ctypes.c_void_p]
    library.aiReleaseExportBlob.argtypes = [ctypes.POINTER(_Blob)]
    return library


def _read_scene(data: bytes) -> dict[str, Any]:
    """The scene that assimp reads from a file, in the form of its JSON.

    Raises:
      UnusableModelError: assimp cannot read it.
    """
    library = _assimp()

    def assimp_error() -> str:
        return (library.aiGetErrorString() or b"").decode("utf-8", "replace")[:150]

    scene = library.aiImportFileFromMemory(data, len(data), 0, b"ac")
    if not scene:
        raise UnusableModelError(f"not readable as AC3D: {assimp_error()}")
    try:
        blob = library.aiExportSceneToBlob(scene, b"assjson", 0)
        if not blob:
            raise UnusableModelError(f"not readable as AC3D: {assimp_error()}")
        try:
            text = ctypes.string_at(blob.contents.data, blob.contents.size)
        finally:
            library.aiReleaseExportBlob(blob)
    finally:
        library.aiReleaseImport(scene)
    try:
        result: dict[str, Any] = json.loads(text.decode("utf-8", "replace"), strict=False)
    except (ValueError, RecursionError) as error:
        raise UnusableModelError(f"not readable as AC3D: {error}"[:200]) from error
    return result


def _nodes(node: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """A node and all nodes below it, in the order of the file."""
    stack = [node]
    while stack:
        here = stack.pop()
        yield here
        stack += reversed(here.get("children", []))


def _material(properties: list[dict[str, Any]], assets: Assets) -> tuple[Material, Any]:
    """A material, and the scale and offset still to be applied to the texture coordinates."""
    value = {p["key"]: p["value"] for p in properties}
    name = value.get("$tex.file")

    def colour(key: str) -> tuple[float, float, float]:
        red, green, blue = (min(max(float(v), 0.0), 1.0) for v in value.get(key, (0.6,) * 3)[:3])
        return red, green, blue

    material = Material(
        diffuse=colour("$clr.diffuse"),
        specular=colour("$clr.specular"),
        shininess=min(max(float(value.get("$mat.shininess", 20.0)), 1.0), 1000.0),
        opacity=min(max(float(value.get("$mat.opacity", 1.0)), 0.0), 1.0),
        texture=assets.texture(name) if name else None,
        name=str(value.get("?mat.name", "")),
    )
    return material, value.get("$tex.uvtrafo", (0.0, 0.0, 1.0, 1.0, 0.0))


def _is_wake(properties: list[dict[str, Any]]) -> bool:
    """Whether the texture of a material shows a wake or a shadow."""
    name = next((str(p["value"]) for p in properties if p["key"] == "$tex.file"), "")
    return bool(_NO_PARTS.match(re.split(r"[/\\]", name)[-1]))


def read_ac3d(data: bytes, assets: Assets) -> dict[str, Any]:
    """Arrays of an AC3D file for `mesh.build_model`; a reader for `readers.load.load_model`.

    Raises:
      UnusableModelError: this is not an AC3D file, it is truncated, too large or empty, or assimp
        is not installed.
    """
    objects = read_outline(data, assets)

    # Assimp would write the back sides of two-sided surfaces as separate faces.
    def one_sided(match: re.Match[bytes]) -> bytes:
        return match[1] + b"%x" % (int(match[2], 16) & ~_TWO_SIDED)

    tree = _read_scene(_SURFACE.sub(one_sided, data))
    nodes = list(_nodes(tree["rootnode"]))
    if len(nodes) == len(objects) + 1:  # assimp adds a root above several objects
        nodes = nodes[1:]
    if len(nodes) != len(objects):
        raise UnusableModelError(
            f"not readable as AC3D: assimp read {len(nodes)} objects, expected {len(objects)}"
        )
    looks = [_material(m["properties"], assets) for m in tree.get("materials", [])]
    no_parts = {i for i, m in enumerate(tree.get("materials", [])) if _is_wake(m["properties"])}
    parts: dict[str, list[np.ndarray]] = {k: [] for k in ("faces", "vertices", "uv", "owner")}
    normals = []
    offset = 0
    for node, each, (turn, move) in zip(nodes, objects, _places(objects), strict=True):
        if _NO_PARTS.match(str(node.get("name", ""))):
            assets.warn(_NO_PART)
            continue
        begin = len(parts["faces"])
        start = offset
        for index in node.get("meshes", []):
            mesh = tree["meshes"][index]
            polygons = [f for f in mesh.get("faces", []) if len(f) >= 3]
            if not polygons:
                continue
            if mesh["materialindex"] in no_parts:
                assets.warn(_NO_PART)
                continue
            # Assimp has applied the translation already; it belongs after the rotation.
            local = np.array(mesh["vertices"], np.float64).reshape(-1, 3) - each.location
            corners = np.array([i for f in polygons for i in f])
            triangle, _ = triangles(np.array([len(f) for f in polygons]), corners, local)
            _, (du, dv, su, sv, _) = looks[mesh["materialindex"]]
            uv = np.zeros((len(local), 2))
            if mesh.get("texturecoords"):
                raw = np.array(mesh["texturecoords"][0], np.float64)
                uv = raw.reshape(len(local), -1)[:, :2] * [su, sv] + [du, dv]
            parts["vertices"].append(local @ turn.T + move)
            parts["faces"].append(corners[triangle] + offset)
            parts["uv"].append(uv[corners[triangle]])
            parts["owner"].append(np.full(len(triangle), mesh["materialindex"]))
            offset += len(local)
        if len(parts["faces"]) > begin:
            faces = np.concatenate(parts["faces"][begin:])
            vertices = np.concatenate([np.zeros((0, 3)), *parts["vertices"][begin:]])
            normals.append(crease_normals(vertices, faces - start, each.crease))
            if np.linalg.det(turn) < 0:
                assets.warn("faces of mirrored objects reversed")
                parts["faces"][begin:] = [f[:, ::-1] for f in parts["faces"][begin:]]
                parts["uv"][begin:] = [u[:, ::-1] for u in parts["uv"][begin:]]
                normals[-1] = -normals[-1][:, ::-1]
    if not parts["faces"]:
        raise UnusableModelError("the mesh is empty: no faces, expected at least one")
    return {
        "vertices": np.concatenate(parts["vertices"]),
        "faces": np.concatenate(parts["faces"]),
        "normals": np.concatenate(normals),
        "uv": np.concatenate(parts["uv"]),
        "materials": assets.bounded([material for material, _ in looks]),
        "face_material": np.concatenate(parts["owner"]),
    }

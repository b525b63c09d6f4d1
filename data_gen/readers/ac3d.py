"""AC3D: folders of `.ac` files, the models of flight and racing simulators.

Assimp reads surfaces, materials and textures. It is called through the few functions of its C
interface that take and give plain bytes, so that no layout of its structures is assumed: the file
goes in from memory, assimp's own JSON comes out.

The outline of a file (objects, their places, counts) is read here first, for two reasons. What a
file announces is bounded and compared with what it holds before a line of C++ sees it. And assimp
misplaces objects: it turns an object's vertices after it has moved them, lets only groups hand
their place on to the objects in them, and drops the crease angle.
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
from data_gen.readers.files import Files
from data_gen.readers.notes import Notes
from data_gen.readers.textures import Textures, bounded

NO_ASSIMP = (
    "assimp is not installed: `pip install 'psgn-jax[render]'`, or the system's own (on Debian "
    "`apt-get install libassimp5`)"
)

_MAX_OBJECTS = 50_000

_MAX_DEPTH = 100  # assimp reads objects in objects by recursion

_TWO_SIDED = 0x20

_STATEMENT = re.compile(
    rb"^[ \t]*(OBJECT|kids|numvert|numsurf|SURF|refs|loc|rot|crease|data)\b[ \t]*([^\r\n]*)",
    re.MULTILINE,
)

# Objects that are no part of the thing: water and shade that move with it.
_NO_PARTS = re.compile(r"wake([\W_0-9]|$)|sillage|shadow", re.IGNORECASE)

_NO_PART = "a ship's wake or a painted shadow left out"

_SURFACE = re.compile(rb"^([ \t]*SURF[ \t]+0[xX])([0-9a-fA-F]{1,8})", re.MULTILINE)


@dataclasses.dataclass
class Object:
    """One object of a file: its place in its parent, and its parent's number or -1.

    A vertex v of the object is at `rotation @ v + location` in its parent.
    """

    parent: int
    location: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(3))
    rotation: np.ndarray = dataclasses.field(default_factory=lambda: np.eye(3))
    crease: float = CREASE_DEGREES
    kids: int | None = None
    surfaces: int = 0
    found: int = 0


def _count(words: bytes, what: str, limit: int) -> int:
    text = words.split()[0] if words.split() else b""
    if not re.fullmatch(rb"[0-9]{1,18}", text):
        raise UnusableModelError(f"not readable as AC3D: {what} {text[:40]!r}")
    if int(text) > limit:
        raise UnusableModelError(
            f"not readable as AC3D: it announces {what} {int(text)}, which cannot be in it"
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


def read_outline(
    data: bytes, max_faces: int = MAX_FACES, notes: Notes | None = None
) -> list[Object]:
    """The objects of a file in its order, after all that it announces has been compared with it.

    One function: a branch for each statement of the format.

    Some exporters count objects that they leave out. With `notes`, a file that ends with a whole
    object and has more than are missing is read all the same, and they say how many are missing.

    Raises:
      UnusableModelError: it is no AC3D file, torn, or has too many faces or objects.
    """
    if not re.match(rb"AC3D[0-9a-f]", data):
        raise UnusableModelError("not readable as AC3D: it does not begin with AC3D")
    size = len(data)
    objects: list[Object] = []
    open_: list[tuple[int, int]] = []  # objects whose kids are to come, and how many
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
                raise UnusableModelError("not readable as AC3D: an object without its kids line")
            while open_ and open_[-1][1] == 0:
                open_.pop()
            if open_:
                open_[-1] = (open_[-1][0], open_[-1][1] - 1)
            if len(open_) > _MAX_DEPTH or len(objects) >= _MAX_OBJECTS:
                raise UnusableModelError(
                    f"more than {_MAX_OBJECTS} objects, or {_MAX_DEPTH} of them in each other"
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
            here.found += 1
        elif key == b"refs":
            count = _count(rest, "refs", size // 4)
            faces += max(count - 2, 0)
            check_face_count(faces, max_faces)
        elif key == b"loc":
            here.location = _numbers(rest, 3, "loc")
        elif key == b"rot":
            here.rotation = _numbers(rest, 9, "rot").reshape(3, 3)
        elif key == b"crease":
            here.crease = float(np.clip(_numbers(rest, 1, "crease")[0], 0, 180))
    if not objects:
        raise UnusableModelError("the mesh is empty: the file has no objects")
    missing = sum(left for _, left in open_)
    if objects[-1].kids is None or (missing and (notes is None or missing >= len(objects))):
        raise UnusableModelError("not readable as AC3D: it is torn: objects are missing")
    if missing and notes is not None:
        notes.add(f"{missing} objects that the file announces are missing")
    if any(o.found != o.surfaces for o in objects):
        raise UnusableModelError("not readable as AC3D: it is torn: surfaces are missing")
    return objects


def _places(objects: list[Object]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Rotation and location of each object in the whole."""
    done: list[tuple[np.ndarray, np.ndarray]] = []
    for each in objects:
        turn, move = each.rotation, each.location
        if each.parent >= 0:
            outer, shift = done[each.parent]
            turn, move = outer @ turn, outer @ move + shift
        done.append((turn, move))
    yield from done


class _Blob(ctypes.Structure):
    """The beginning of assimp's aiExportDataBlob."""

    _fields_ = (("size", ctypes.c_size_t), ("data", ctypes.c_void_p))


def find_assimp() -> str:
    """Path or name of the assimp library, that of the package before the system's; "" = none."""
    package = importlib.util.find_spec("cmeel")
    for place in (package and package.submodule_search_locations) or ():
        root = pathlib.Path(place).parent / "cmeel.prefix" / "lib"
        for name in ("libassimp.so", "libassimp.dylib"):
            if (root / name).exists():
                return str(root / name)
    return ctypes.util.find_library("assimp") or ""


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
    """What assimp makes of a file, as its JSON has it.

    Raises:
      UnusableModelError: assimp cannot read it.
    """
    library = _assimp()

    def said() -> str:
        return (library.aiGetErrorString() or b"").decode("utf-8", "replace")[:150]

    scene = library.aiImportFileFromMemory(data, len(data), 0, b"ac")
    if not scene:
        raise UnusableModelError(f"not readable as AC3D: {said()}")
    try:
        blob = library.aiExportSceneToBlob(scene, b"assjson", 0)
        if not blob:
            raise UnusableModelError(f"not readable as AC3D: {said()}")
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
    """A node and all below it, in the file's order."""
    stack = [node]
    while stack:
        here = stack.pop()
        yield here
        stack += reversed(here.get("children", []))


def _material(properties: list[dict[str, Any]], textures: Textures) -> tuple[Material, Any]:
    """A material, and the scale and offset that are not yet in its texture coordinates."""
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
        texture=textures.get(name) if name else None,
        name=str(value.get("?mat.name", "")),
    )
    return material, value.get("$tex.uvtrafo", (0.0, 0.0, 1.0, 1.0, 0.0))


def _is_wake(properties: list[dict[str, Any]]) -> bool:
    """Whether a material's picture is that of a wake or a shadow."""
    name = next((str(p["value"]) for p in properties if p["key"] == "$tex.file"), "")
    return bool(_NO_PARTS.match(re.split(r"[/\\]", name)[-1]))


def read_ac3d(
    data: bytes, files: Files, base: str, side: int, max_faces: int, notes: Notes
) -> dict[str, Any]:
    """Arrays of an AC3D file for `mesh.build_model`; a reader for `readers.load.load_model`.

    One function: assimp's nodes and the file's objects are walked side by side.

    Raises:
      UnusableModelError: it is torn, no AC3D file, too large or empty, or assimp is missing.
    """
    objects = read_outline(data, max_faces, notes)

    # Assimp would write the backs of two-sided surfaces as faces of their own.
    def one_sided(match: re.Match[bytes]) -> bytes:
        return match[1] + b"%x" % (int(match[2], 16) & ~_TWO_SIDED)

    tree = _read_scene(_SURFACE.sub(one_sided, data))
    nodes = list(_nodes(tree["rootnode"]))
    if len(nodes) == len(objects) + 1:  # a root is put above several objects
        nodes = nodes[1:]
    if len(nodes) != len(objects):
        raise UnusableModelError(
            f"not readable as AC3D: {len(nodes)} objects understood of {len(objects)}"
        )
    textures = Textures(files, base, side, notes)
    looks = [_material(m["properties"], textures) for m in tree.get("materials", [])]
    no_parts = {i for i, m in enumerate(tree.get("materials", [])) if _is_wake(m["properties"])}
    parts: dict[str, list[np.ndarray]] = {k: [] for k in ("faces", "vertices", "uv", "owner")}
    normals = []
    offset = 0
    for node, each, (turn, move) in zip(nodes, objects, _places(objects), strict=True):
        if _NO_PARTS.match(str(node.get("name", ""))):
            notes.add(_NO_PART)
            continue
        begin = len(parts["faces"])
        start = offset
        for index in node.get("meshes", []):
            mesh = tree["meshes"][index]
            polygons = [f for f in mesh.get("faces", []) if len(f) >= 3]
            if not polygons:
                continue
            if mesh["materialindex"] in no_parts:
                notes.add(_NO_PART)
                continue
            # Assimp has moved them already; it must come after the turning.
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
                notes.add("mirrored objects turned over")
                parts["faces"][begin:] = [f[:, ::-1] for f in parts["faces"][begin:]]
                parts["uv"][begin:] = [u[:, ::-1] for u in parts["uv"][begin:]]
                normals[-1] = -normals[-1][:, ::-1]
    if not parts["faces"]:
        raise UnusableModelError("the mesh is empty: the file has no faces")
    return {
        "vertices": np.concatenate(parts["vertices"]),
        "faces": np.concatenate(parts["faces"]),
        "normals": np.concatenate(normals),
        "uv": np.concatenate(parts["uv"]),
        "materials": bounded([material for material, _ in looks], notes),
        "face_material": np.concatenate(parts["owner"]),
    }

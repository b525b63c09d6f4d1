"""Reads formats other than Wavefront OBJ with trimesh."""

import collections
import contextlib
import io
import logging
import re
import struct
import warnings as python_warnings
import zipfile
from collections.abc import Iterator
from typing import Any

import numpy as np

from data_gen.mesh import Material, UnusableModelError, check_face_count
from data_gen.readers.mtl import GREY, floats
from data_gen.readers.textures import BROKEN_TEXTURE, Assets, decode_texture
from psgn_jax.system.untrusted import one_line, parse_json

_MAX_XML = 64 << 20

_ARCHIVES = {"zip", "bz2", "tar.bz2", "tar.gz"}
_GLTF = ("glb", "gltf")
_ZIPPED = ("zae", "3mf", "3dxml")  # formats that are zip archives of XML files

# Turns +z into +y, and -y into +z.
_Z_TO_Y = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


def _faces_in_header(data: bytes, kind: str) -> int:
    """The number of faces in the header of the file, 0 if the format has none."""
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
        if kind in _GLTF:
            length = struct.unpack("<I", data[12:16])[0]
            tree = parse_json(data[20 : 20 + length] if kind == "glb" else data, max_depth=64)
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


def _resolver(assets: Assets) -> Any:
    """The files as the resolver that trimesh uses for files that a model refers to."""
    import trimesh

    class Resolver(trimesh.resolvers.Resolver):
        def __init__(self) -> None:
            pass

        def get(self, key: str) -> bytes:
            try:
                return assets.files.open(assets.base, key)
            except FileNotFoundError:
                assets.warn("files missing", repr(key))
                raise

        def write(self, name: str, data: Any) -> None:
            raise OSError(f"{name}: read only")

        def namespaced(self, namespace: str) -> Any:
            raise NotImplementedError

        def keys(self) -> list[str]:
            return []

    return Resolver()


def _from_trimesh_material(
    material: Any, assets: Assets, painted: np.ndarray | None = None
) -> Material:
    """A material of trimesh (simple or physically based) as a Blinn-Phong material.

    `painted` is the texture of a material that has none.
    """
    import trimesh

    name = str(getattr(material, "name", "") or "")

    def texture_of(picture: Any) -> np.ndarray | None:
        if picture is None:
            return None
        try:
            return decode_texture(picture)
        except ValueError as error:
            assets.warn(BROKEN_TEXTURE, f"that of {name!r} ({error})")
            return None

    def rgba(values: Any, fallback: tuple[float, ...]) -> list[float]:
        if values is None:
            return list(fallback)
        raw = np.asarray(values)
        scaled = raw / 255 if raw.dtype.kind in "ui" else raw
        return [*np.clip(scaled.astype(float).ravel(), 0, 1), 1.0, 1.0, 1.0, 1.0][:4]

    physical = hasattr(material, "baseColorFactor")
    texture = texture_of(getattr(material, "baseColorTexture" if physical else "image", None))
    texture = painted if texture is None else texture
    plain = (1.0, 1.0, 1.0, 1.0) if texture is not None else (*GREY, 1.0)
    if physical:
        base = rgba(material.baseColorFactor, plain)
        if material.baseColorFactor is not None:
            base[:3] = (float(v ** (1 / 2.2)) for v in base[:3])  # factors of glTF are linear
        mode = str(material.alphaMode or "OPAQUE").upper()
        if texture is not None and mode != "BLEND" and (texture[..., 3] < 255).any():
            cutoff = 0.5 if material.alphaCutoff is None else float(material.alphaCutoff)
            solid = (texture[..., 3] >= 255 * cutoff) | (mode == "OPAQUE")
            texture = np.dstack([texture[..., :3], np.where(solid, 255, 0).astype(np.uint8)])
        rough = 0.8 if material.roughnessFactor is None else float(material.roughnessFactor)
        metal = 0.0 if material.metallicFactor is None else float(material.metallicFactor)
        if material.metallicRoughnessTexture is not None:
            metal = min(metal, 0.5)
        # The exponent whose lobe is as wide as the microfacet lobe with this roughness.
        gloss = 2 / max(rough, 0.05) ** 4 - 2
        high = [(1 - rough) * ((1 - metal) * 0.2 + metal * v) for v in base[:3]]
        base[3] = 1.0 if mode == "OPAQUE" else base[3]
    else:
        given: list[Any] = [getattr(material, key, None) for key in ("diffuse", "specular")]
        if all(np.array_equal(value, trimesh.visual.DEFAULT_COLOR) for value in given):
            given = [None, None]  # the file has no colours
        base, high = rgba(given[0], plain), rgba(given[1], (0.0, 0.0, 0.0, 1.0))
        gloss = (floats([str(getattr(material, "glossiness", None) or 20.0)], 1) or [20.0])[0]
    diffuse, specular = (base[0], base[1], base[2]), (high[0], high[1], high[2])
    gloss = min(max(gloss, 1.0), 1000.0)
    return Material(diffuse, specular, gloss, base[3], texture, name)


def palette(colours: np.ndarray) -> tuple[Material, np.ndarray]:
    """A material and uv [F, 3, 2] that give each face its colour, uint8 [F, 4] to 5 bits."""
    key = (colours.astype(np.int64) >> 3) @ np.array([1 << 15, 1 << 10, 1 << 5, 1])
    distinct, first, index = np.unique(key, return_index=True, return_inverse=True)
    width = int(np.ceil(np.sqrt(len(distinct))))
    # Unused texels repeat the last colour: an opaque palette has no alpha, which is slow to handle.
    texture = np.pad(colours[first], ((0, width * width - len(distinct)), (0, 0)), mode="edge")
    column, row = index % width, index // width
    uv = np.stack([(column + 0.5) / width, 1 - (row + 0.5) / width], axis=1)
    return (
        Material(diffuse=(1.0, 1.0, 1.0), texture=texture.reshape(width, width, 4), name="colours"),
        np.repeat(uv[:, None], 3, axis=1),
    )


def _displayed(linear: np.ndarray) -> np.ndarray:
    """The uint8 RGBA [F, 4] of linear RGB or RGBA [F, 3 or 4], 1 = white."""
    colours = np.ones((len(linear), 4))
    colours[:, : linear.shape[1]] = np.nan_to_num(linear).clip(0, 1)
    colours[:, :3] **= 1 / 2.2
    result: np.ndarray = (255 * colours).round().astype(np.uint8)
    return result


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Hides warnings and tracebacks of trimesh; `Assets` notes what is missing."""
    log = logging.getLogger("trimesh.util")  # which all its modules use
    before, log.disabled = log.disabled, True
    try:
        with python_warnings.catch_warnings(action="ignore"):
            yield
    finally:
        log.disabled = before


def read_trimesh(data: bytes, kind: str, assets: Assets) -> dict[str, Any]:
    """Arrays of a file in any format that the installed trimesh reads, for `mesh.build_model`.

    Raises:
      UnusableModelError: the file is damaged, of an unknown format or too large.
    """
    try:
        return _read(data, kind, assets)
    except UnusableModelError:
        raise
    except Exception as error:
        # A third-party reader may raise any exception for a damaged file.
        what = one_line(f"{type(error).__name__}: {error}")
        missing = isinstance(error, FileNotFoundError)  # a file to which this one refers
        refusal = assets.files.refusal if missing else UnusableModelError
        raise refusal(f"not readable as {kind}: {what}"[:200]) from error


def _read(data: bytes, kind: str, assets: Assets) -> dict[str, Any]:
    import trimesh

    formats = trimesh.available_formats() - _ARCHIVES
    if kind not in formats:
        raise UnusableModelError(f"format {kind!r}: expected one of {sorted(formats)}")
    check_face_count(_faces_in_header(data, kind), assets.max_faces)
    z_up = False
    if kind in ("dae", "xaml", *_ZIPPED):
        with (
            zipfile.ZipFile(io.BytesIO(data)) if kind in _ZIPPED else contextlib.nullcontext() as z
        ):
            size = sum(member.file_size for member in z.infolist()) if z else len(data)
            if size > _MAX_XML:
                raise UnusableModelError(f"{size} bytes of {kind}, more than the limit {_MAX_XML}")
            texts = [z.read(name) for name in z.namelist()] if z else [data]
        texts = [text.replace(b"\0", b"") for text in texts]  # as UTF-16 has them
        z_up = any(re.search(rb"<up_axis>\s*Z_UP", text) for text in texts)  # of COLLADA
        if any(b"<!ENTITY" in text for text in texts):
            raise UnusableModelError("XML entities are refused")
    with _quiet():
        scene = trimesh.load_scene(
            io.BytesIO(data), file_type=kind, resolver=_resolver(assets), process=False
        )
        names = [scene.graph[node] for node in scene.graph.nodes_geometry]
    parts: dict[str, list[np.ndarray]] = collections.defaultdict(list)
    materials: list[Material] = []
    known: dict[int, int] = {}
    offset = total = 0
    for matrix, name in names:
        mesh = scene.geometry[name]
        if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
            continue
        total += len(mesh.faces)
        check_face_count(total, assets.max_faces)
        corner = np.asarray(mesh.faces, np.int64)
        if corner.min() < 0 or corner.max() >= len(mesh.vertices):
            raise UnusableModelError(f"not readable as {kind}: faces have missing vertices")
        matrix = _Z_TO_Y @ matrix if z_up else np.asarray(matrix, np.float64)
        linear = matrix[:3, :3]
        vertices = np.asarray(mesh.vertices, np.float64) @ linear.T + matrix[:3, 3]
        normals = np.zeros((len(corner), 3, 3))
        # trimesh's cache contains normals only if they come from the file; others are not used.
        given = mesh._cache.cache.get("vertex_normals")
        if given is not None and len(given) == len(mesh.vertices) and np.linalg.det(linear):
            normals = (np.asarray(given) @ np.linalg.inv(linear))[corner]
        if np.linalg.det(linear) < 0:
            corner, normals = corner[:, ::-1], normals[:, ::-1]
        visual: Any = mesh.visual
        uv = np.zeros((len(corner), 3, 2))
        if visual.kind == "texture":
            coordinates = getattr(visual, "uv", None)
            if coordinates is not None and len(coordinates) == len(mesh.vertices):
                uv = np.asarray(coordinates, np.float64)[:, :2][corner]
            key = id(visual.material)
            if key not in known:
                known[key] = len(materials)
                materials.append(_from_trimesh_material(visual.material, assets))
            owner = known[key]
            paint = visual.vertex_attributes.get("color") if kind in _GLTF else None
            if paint is not None:
                white = 1 if paint.dtype.kind == "f" else np.iinfo(paint.dtype).max
                colours = _displayed(paint[corner].mean(axis=1) / white)
                if materials[owner].texture is None:
                    owner = len(materials)
                    painted, uv = palette(colours)
                    material = _from_trimesh_material(visual.material, assets, painted.texture)
                    materials.append(material)
                elif (colours[:, :3] < 255).any():
                    assets.warn("vertex colours of faces with a texture are not used")
        else:
            owner, material = len(materials), Material()
            if visual.kind in ("vertex", "face"):
                whole = visual.kind == "face"
                colours = visual.face_colors if whole else visual.vertex_colors[corner].mean(axis=1)
                colours = np.asarray(colours)
                if kind in _GLTF:  # linear, like its factors
                    colours = _displayed(colours / 255)
                material, uv = palette(colours.round().astype(np.uint8))
            materials.append(material)
        part = {"vertices": vertices, "faces": corner + offset, "normals": normals, "uv": uv,
                "face_material": np.full(len(corner), owner)}  # fmt: skip
        for field, values in part.items():
            parts[field].append(values)
        offset += len(mesh.vertices)
    if not parts:
        raise UnusableModelError("the mesh is empty: no faces, expected at least one")
    arrays: dict[str, Any] = {key: np.concatenate(values) for key, values in parts.items()}
    if not arrays["normals"].any():
        arrays["normals"] = None
    return {**arrays, "materials": assets.bounded(materials)}

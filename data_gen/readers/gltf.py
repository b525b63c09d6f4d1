"""Reader of glTF 2.0 files (`.gltf`, `.glb`): their JSON, buffers and images.

We read the default scene as it stands in the file: skins in the pose of their joints, morph targets
with their default weights. What we do not read is in a warning, or the file is refused.
"""

import binascii
import json
import re
import struct
import urllib.parse
from collections.abc import Sequence
from typing import Any

import numpy as np

from data_gen.mesh import UnreadableModelError, UnusableModelError, check_face_count
from data_gen.polygons import fan, strip
from data_gen.readers.gltf_compressed import DRACO, MESHOPT, by_draco, by_meshopt
from data_gen.readers.gltf_json import Object, damaged
from data_gen.readers.gltf_materials import Looks
from data_gen.readers.textures import NO_COORDINATES, Assets
from psgn_jax.system.untrusted import parse_json

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}

_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}

_INSTANCES = "EXT_mesh_gpu_instancing"

_READ = {
    DRACO, *MESHOPT, _INSTANCES, "EXT_texture_webp", "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_unlit", "KHR_mesh_quantization", "KHR_texture_transform", "MSFT_texture_dds",
}  # fmt: skip

# Without these extensions, a model has the right surface in plainer colours.
_APPEARANCE = re.compile(r"KHR_materials_|[A-Z]+_texture_")

_PLACE = {"translation": [0.0, 0, 0], "rotation": [0.0, 0, 0, 1], "scale": [1.0, 1, 1]}

_MAX_BYTES = 512 << 20  # of all buffers of a file, and of an array that the file need not contain


def read_gltf(data: bytes, assets: Assets) -> dict[str, Any]:
    """Arrays of a glTF or GLB file for `mesh.build_model`.

    Raises:
      UnusableModelError: the file is damaged or too large, or needs an extension that we do not
        read. The status is "unreadable" if a buffer is missing.
    """
    return _File(data, assets).model()


def _json_and_chunk(data: bytes) -> tuple[Any, memoryview | None]:
    """The JSON of a file, and the binary chunk of a GLB. What follows them is ignored."""
    text, chunk = memoryview(data), None
    if data[:4] == b"glTF":
        version, length, kind = struct.unpack("<4xI4xI4s", data[:20].ljust(20))
        if version != 2:
            raise damaged(f"glTF {version}, expected 2.0")
        if kind != b"JSON":
            raise damaged("its first chunk is not JSON")
        text, rest = text[20 : 20 + length], text[20 + length :]
        cut = len(text) < length
        if rest[4:8] == b"BIN\0":
            (length,) = struct.unpack("<I", rest[:4])
            chunk = rest[8 : 8 + length]
            cut = len(chunk) < length
        if cut:
            raise damaged(f"the file is cut: a chunk ends after the last of its {len(data)} bytes")
    try:
        letters = bytes(text).rstrip(b"\0").decode("utf-8-sig", "replace")  # some pad with zeros
        return parse_json(letters, max_depth=64), chunk
    except json.JSONDecodeError as error:
        where = f"line {error.lineno}, column {error.colno}"
        raise damaged(f"its JSON is damaged in {where}") from None
    except ValueError as error:
        raise damaged(f"its JSON: {error}") from None


def _triangles(mode: int, corners: np.ndarray) -> np.ndarray:
    """The triangles [f, 3] of a list (4), a strip (5) or a fan (6)."""
    if mode == 4:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    faces = corners[(strip if mode == 5 else fan)(len(corners))]
    # A strip that goes on elsewhere repeats corners in between.
    return faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]


def _matrices(move: np.ndarray, turn: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Matrices [n, 4, 4] of translations, rotations (quaternions x, y, z, w) and scales."""
    length = np.linalg.norm(turn, axis=1, keepdims=True)
    x, y, z, w = (turn / np.where(length == 0, 1, length)).T
    result = np.tile(np.eye(4), (len(move), 1, 1))
    result[:, :3, 3] = move
    result[:, :3, :3] = scale[:, None] * np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]).transpose(2, 0, 1)  # fmt: skip
    return result


def _of_normals(linear: np.ndarray) -> np.ndarray:
    """Matrices [n, 3, 3] for normals, whose length they change; `linear` may be singular."""
    a, b, c = np.moveaxis(linear, 2, 0)
    cofactors = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=2)
    result: np.ndarray = cofactors * np.where(np.linalg.det(linear) < 0, -1, 1)[:, None, None]
    return result


def _as_floats(numbers: np.ndarray, normalised: bool) -> np.ndarray:
    """Numbers as float64; normalised integers from -1 or 0 to 1."""
    result = numbers.astype(np.float64)
    if normalised and numbers.dtype.kind != "f":
        result = np.maximum(result / np.iinfo(numbers.dtype).max, -1)
    return result


def _blended(joints: np.ndarray, index: np.ndarray, share: np.ndarray) -> np.ndarray:
    """The matrices [v, 4, 4] of vertices, from those of the joints with numbers `index` [v, k]."""
    share = np.nan_to_num(share).clip(0)
    share[share.sum(axis=1) == 0, 0] = 1
    index = np.where(share > 0, index, 0).astype(np.int64)
    if index.min() < 0 or index.max() >= len(joints):
        raise damaged(f"vertices have joints beyond the {len(joints)} of their skin")
    share /= share.sum(axis=1, keepdims=True)
    result = np.zeros((len(index), 4, 4))
    for k in range(index.shape[1]):
        result += share[:, k, None, None] * joints[index[:, k]]
    return result


class _File:
    """A glTF file: its JSON, and its buffers, which are loaded when they are needed."""

    def __init__(self, data: bytes, assets: Assets) -> None:
        tree, self.chunk = _json_and_chunk(data)
        self.root, self.assets = Object(tree, ""), assets
        version = self.root.object("asset").text("version", "without asset.version")
        if version.split(".")[0] != "2":
            raise damaged(f"glTF {version}, expected 2.0")
        self.buffers: dict[int, memoryview] = {}
        self.parts: list[dict[str, Any]] = []
        self.faces = self.vertices = 0
        self.looks = Looks(self.root, assets, self.image)
        required = self.root.texts("extensionsRequired")
        for name in dict.fromkeys(required + self.root.texts("extensionsUsed")):
            if name not in _READ:
                if name in required and not _APPEARANCE.match(name):
                    raise damaged(f"it needs the extension {name!r}, which is not read")
                assets.warn("extensions not read", repr(name))
        if animations := self.root.objects("animations"):
            assets.warn("animations not read, the pose of the nodes is taken", len(animations))

    # --- Bytes and numbers ----------------------------------------------------------------------

    def contents(self, uri: str) -> bytes:
        """What a URI stands for: its own data, or a file."""
        head, comma, text = uri.partition(",")
        if comma and head[:5].lower() == "data:":
            raw = urllib.parse.unquote_to_bytes(text)
            try:
                return binascii.a2b_base64(raw + b"==") if head.lower().endswith(";base64") else raw
            except binascii.Error:
                raise damaged("the base64 text of a data URI is damaged") from None
        try:
            return self.assets.files.open(self.assets.base, uri)
        except FileNotFoundError:  # with a query, as in addresses of web pages
            return self.assets.files.open(self.assets.base, re.split("[?#]", uri)[0])

    def buffer(self, index: int) -> memoryview:
        fields = self.root.item("buffers", index)
        if index not in self.buffers and "uri" not in fields:
            if index or self.chunk is None:
                raise damaged(f"{fields.path} has neither a uri nor a binary chunk")
            self.buffers[index] = self.chunk
        elif index not in self.buffers:
            uri = fields.text("uri")
            try:
                self.buffers[index] = memoryview(self.contents(uri))
            except FileNotFoundError:
                what = f"not readable as glTF: its file {uri[:100]!r} is missing"
                raise self.assets.files.refusal(what) from None
            except OSError as error:
                what = f"its file {uri[:100]!r} is not readable: {error.strerror}"
                raise UnreadableModelError(what) from error
            if sum(map(len, self.buffers.values())) > _MAX_BYTES:
                raise damaged(f"its buffers have more bytes than the limit of {_MAX_BYTES}")
        return self.buffers[index]

    def view(self, index: int) -> memoryview:
        """The bytes of a buffer view, decompressed."""
        fields = self.root.item("bufferViews", index)
        packed = next((x for x in map(fields.extension, MESHOPT) if x), None)
        number = fields.whole("buffer")
        if "uri" in self.root.item("buffers", number) or (number == 0 and self.chunk is not None):
            packed = None  # there is an uncompressed copy
        place = packed or fields
        data, start = self.buffer(place.whole("buffer")), place.whole("byteOffset", 0)
        stop = start + place.whole("byteLength")
        if stop > len(data):
            raise damaged(f"{place.path} ends at byte {stop} of a buffer of {len(data)}")
        found = data[start:stop]
        return memoryview(by_meshopt(packed, found, _MAX_BYTES)) if packed else found

    def image(self, fields: Object) -> bytes:
        """The file of an image."""
        if "bufferView" in fields:
            return bytes(self.view(fields.whole("bufferView")))
        return self.contents(fields.text("uri"))

    def rows(
        self, place: Object, kind: Object, columns: int, count: int, stride: int = 0
    ) -> np.ndarray:
        """Rows [count, columns] of the buffer view and at the offset of `place`."""
        code = _COMPONENTS.get(kind.whole("componentType"))
        if code is None:
            raise damaged(f"{kind.path} has an unknown componentType")
        dtype = np.dtype(code)
        size = dtype.itemsize * columns
        if "bufferView" not in place:
            if count * size > _MAX_BYTES:
                raise damaged(f"{place.path} has {count} rows without data")
            return np.zeros((count, columns), dtype)
        data, start = self.view(place.whole("bufferView")), place.whole("byteOffset", 0)
        stride = stride or size
        if count and (stride < size or start + stride * (count - 1) + size > len(data)):
            raise damaged(f"{place.path} has more numbers than its buffer view")
        start = start if count else 0
        return np.ndarray((count, columns), dtype, data, start, (stride, dtype.itemsize))

    def accessor(self, index: int, *widths: int) -> tuple[np.ndarray, bool]:
        """The numbers [count, columns] of an accessor, and whether they are normalised."""
        fields = self.root.item("accessors", index)
        columns, count = _COLUMNS.get(fields.text("type"), 0), fields.whole("count")
        if columns not in widths:
            raise damaged(f"{fields.path} has the wrong type {fields.text('type')[:20]!r}")
        stride = 0
        if "bufferView" in fields:
            view = self.root.item("bufferViews", fields.whole("bufferView"))
            stride = view.whole("byteStride", 0)
        values = self.rows(fields, fields, columns, count, stride)
        if "sparse" in fields:
            sparse = fields.object("sparse")
            at, own = sparse.object("indices"), sparse.whole("count")
            changed = self.rows(at, at, 1, own)[:, 0]
            if changed.dtype.kind != "u" or (own and changed.max() >= count):
                raise damaged(f"{at.path} has rows that the accessor lacks")
            values = values.copy()
            values[changed] = self.rows(sparse.object("values"), fields, columns, own)
        return values, bool(fields.fields.get("normalized"))

    # --- Nodes ----------------------------------------------------------------------------------

    def nodes(self) -> tuple[list[Object], np.ndarray, np.ndarray]:
        """The nodes, their matrices [n, 4, 4] in the scene, and which of them are in it [n]."""
        nodes = self.root.objects("nodes")
        children = [node.wholes("children") for node in nodes]
        world = np.tile(np.eye(4), (len(nodes), 1, 1))
        parent = np.full(len(nodes), -1)
        for number, node in enumerate(nodes):
            if "matrix" in node:
                world[number] = node.numbers("matrix", [0] * 16).reshape(4, 4).T
            elif any(key in node for key in _PLACE):
                values = [node.numbers(key, plain)[None] for key, plain in _PLACE.items()]
                world[number] = _matrices(*values)[0]
            for child in children[number]:
                if parent[self.root.item("nodes", child).index] >= 0:
                    raise damaged(f"nodes[{child}] has several parents")
                parent[child] = number
        shown = order = np.flatnonzero(parent < 0).tolist()
        if scenes := self.root.objects("scenes"):
            shown = self.root.item("scenes", self.root.whole("scene", 0)).wholes("nodes")
            if len(scenes) > 1:
                self.assets.warn("scenes other than the default one not read", len(scenes) - 1)
        inside = np.zeros(len(nodes), bool)
        inside[[self.root.item("nodes", number).index for number in shown]] = True
        for number in order:  # a list that grows: parents come first
            if parent[number] >= 0:
                world[number] = world[parent[number]] @ world[number]
                inside[number] |= inside[parent[number]]
            order += children[number]
        if len(order) < len(nodes):
            raise damaged("its nodes form a cycle")
        return nodes, world, inside

    def model(self) -> dict[str, Any]:
        """The arrays of all meshes of the scene."""
        nodes, world, inside = self.nodes()
        uses: dict[tuple[int, int, tuple[float, ...]], list[np.ndarray]] = {}
        for number in np.flatnonzero(inside).tolist():
            node, own = nodes[number], world[number, None]
            if "mesh" not in node:
                continue
            if instances := node.extension(_INSTANCES):
                own = own @ self.instances(instances.object("attributes"))
            mesh = self.root.item("meshes", node.whole("mesh"))
            weights = (node if "weights" in node else mesh).numbers("weights").tolist()
            skin = node.whole("skin") if "skin" in node else -1
            uses.setdefault((mesh.index, skin, tuple(weights)), []).append(own)
        for (index, skin, weights), placed in uses.items():
            joints = None if skin < 0 else self.joints(skin, world)
            for part in self.root.item("meshes", index).objects("primitives"):
                self.primitive(part, weights, np.concatenate(placed), joints)
        if not self.parts:
            raise UnusableModelError("the mesh is empty: no faces, expected at least one")
        keys = self.parts[0]
        return self.looks.applied({k: np.concatenate([p[k] for p in self.parts]) for k in keys})

    def instances(self, attributes: Object) -> np.ndarray:
        """The matrices [n, 4, 4] of EXT_mesh_gpu_instancing."""
        values = []
        for key, plain in _PLACE.items():
            index = attributes.whole(key.upper()) if key.upper() in attributes else None
            found = None if index is None else _as_floats(*self.accessor(index, len(plain)))
            values.append(np.array([plain]) if found is None else found)
        count = max(map(len, values))
        check_face_count(count, self.assets.max_faces)
        if any(len(value) not in (1, count) for value in values):
            raise damaged(f"{attributes.path} have different counts")
        return _matrices(*(np.broadcast_to(v, (count, v.shape[1])) for v in values))

    def joints(self, index: int, world: np.ndarray) -> np.ndarray:
        """The matrices [j, 4, 4] of a skin's joints, from the bind pose to that of the nodes."""
        skin = self.root.item("skins", index)
        result = world[[self.root.item("nodes", joint).index for joint in skin.wholes("joints")]]
        if "inverseBindMatrices" in skin:
            bind = _as_floats(*self.accessor(skin.whole("inverseBindMatrices"), 16))
            if len(bind) < len(result):
                raise damaged(f"{skin.path} has {len(bind)} matrices for {len(result)} joints")
            result = result @ bind[: len(result)].reshape(-1, 4, 4).transpose(0, 2, 1)
        return result

    # --- Meshes ---------------------------------------------------------------------------------

    def primitive(
        self, part: Object, weights: Sequence[float], placed: np.ndarray, joints: np.ndarray | None
    ) -> None:
        """Appends the faces of a primitive, once for each of the matrices `placed` [n, 4, 4]."""
        mode, attributes = part.whole("mode", 4), part.object("attributes")
        if mode < 4 or mode > 6 or "POSITION" not in attributes:
            what = "without positions" if 4 <= mode <= 6 else f"of mode {mode}"
            self.assets.warn("lines, points and primitives without positions dropped", what)
            return
        owner = part.whole("material") if "material" in part else -1
        look = self.looks.look(owner)
        widths = {"POSITION": (3,), "NORMAL": (3,), "COLOR_0": (3, 4)}
        skinned = [k for k in "01" if joints is not None and f"JOINTS_{k}" in attributes]
        widths |= {f"{name}_{k}": (4,) for k in skinned for name in ("JOINTS", "WEIGHTS")}
        coordinates = f"TEXCOORD_{look.uv_set}"
        if look.image >= 0:
            widths[coordinates] = (2,)
            if coordinates not in attributes:
                self.assets.warn(NO_COORDINATES, coordinates)
        given = {name: self.accessor(attributes.whole(name), *width)
                 for name, width in widths.items() if name in attributes}  # fmt: skip
        corners: np.ndarray | None = None
        packed = part.extension(DRACO)
        if packed and "bufferView" not in self.root.item("accessors", attributes.whole("POSITION")):
            corners, found = by_draco(packed, self.view(packed.whole("bufferView")))
            mode = 4
            for name in given.keys() & found.keys():
                if found[name].shape[1:] not in [(width,) for width in widths[name]]:
                    raise damaged(f"{packed.path}.attributes.{name} has the wrong type")
                given[name] = found[name], given[name][1]
        elif "indices" in part:
            corners = self.accessor(part.whole("indices"), 1)[0][:, 0]
            if corners.dtype.kind != "u":
                raise damaged(f"{part.path}.indices have the wrong componentType")
        total = len(given["POSITION"][0])
        count = total if corners is None else len(corners)
        self.faces += (count // 3 if mode == 4 else max(count - 2, 0)) * len(placed)
        check_face_count(self.faces, self.assets.max_faces)
        if mode == 4 and count % 3:
            self.assets.warn("corners after the last whole triangle dropped", count % 3)
        corners = np.arange(count) if corners is None else corners.astype(np.int64)
        faces = _triangles(mode, corners)
        if not len(faces):
            return
        if faces.min() < 0 or faces.max() >= total:
            raise damaged(f"{part.path}: faces have missing vertices")
        rows: Any = slice(None)
        if total > faces.size:  # of arrays that many primitives share
            rows, flat = np.unique(faces, return_inverse=True)
            faces = flat.reshape(-1, 3)
        targets = [(t, w) for t, w in zip(part.objects("targets"), weights, strict=False) if w]

        def values(name: str, *, fractions: bool = False) -> np.ndarray:
            """An attribute of the vertices, with its morph targets."""
            if name not in given:
                raise damaged(f"{part.path} has no {name}")
            width = given[name][0].shape[1]
            layers = [(1.0, *given[name])]
            layers += [(w, *self.accessor(t.whole(name), width)) for t, w in targets if name in t]
            if any(len(numbers) != total for _, numbers, _ in layers):
                raise damaged(f"{part.path}: {name} and POSITION have different counts")
            changes = [w * _as_floats(n[rows], normal or fractions) for w, n, normal in layers]
            return np.sum(changes, axis=0)

        positions = values("POSITION")
        size = len(positions)
        if joints is not None and skinned:
            index = np.concatenate([values(f"JOINTS_{k}") for k in skinned], axis=1)
            share = np.concatenate(
                [values(f"WEIGHTS_{k}", fractions=True) for k in skinned], axis=1
            )
            placed = _blended(joints, index, share)
        linear, move = placed[:, :3, :3], placed[:, :3, 3]
        # Each vertex has its matrix, or each of n copies of the vertices.
        product = "vij,vj->vi" if skinned else "nij,vj->nvi"
        vertices = np.einsum(product, linear, positions) + (move if skinned else move[:, None])
        vertices = vertices.reshape(-1, size, 3)
        mirrored = np.linalg.det(linear) < 0
        turned = mirrored[faces].all(axis=1)[None, :, None] if skinned else mirrored[:, None, None]
        local = np.where(turned, faces[:, ::-1], faces) if turned.any() else faces  # [n, f, 3]
        local = np.broadcast_to(local, (len(vertices), *faces.shape))
        copy = np.arange(len(vertices))[:, None, None]
        normals = np.zeros((*local.shape, 3))
        if "NORMAL" in given:
            normals = np.einsum(product, _of_normals(linear), values("NORMAL"))
            normals = normals.reshape(-1, size, 3)[copy, local]
        colours = np.broadcast_to(1.0, (*local.shape[:2], 4))
        if "COLOR_0" in given:
            paint = np.nan_to_num(values("COLOR_0", fractions=True)).clip(0, 1)
            colours = colours.copy()
            colours[..., : paint.shape[1]] = paint[faces].mean(axis=1)
        uv = values(coordinates) if coordinates in given else np.zeros((size, 2))
        self.parts.append({
            "vertices": vertices.reshape(-1, 3),
            "faces": (local + size * copy + self.vertices).reshape(-1, 3),
            "normals": normals.reshape(-1, 3, 3),
            "uv": uv[local].reshape(-1, 3, 2),
            "colours": colours.reshape(-1, 4),
            "face_material": np.full(local.size // 3, owner),
        })  # fmt: skip
        self.vertices += vertices.size // 3

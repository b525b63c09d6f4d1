"""Reader of glTF 2.0 files (`.gltf`, `.glb`).

We read the default scene: skins in the pose of their joints, morph targets with their default
weights. A warning names what we do not read, or the file is refused.
"""

import re
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from data_gen.polygons import fan, strip
from data_gen.readers.gltf_file import DRACO, MESHOPT, Document, Object, as_floats, by_draco
from data_gen.readers.model_files import DamagedError
from data_gen.readers.parts import Look, Part, material, transformed
from data_gen.readers.textures import BROKEN_TEXTURE, NO_COORDINATES, Assets

_INSTANCES = "EXT_mesh_gpu_instancing"

_READ = {
    DRACO, *MESHOPT, _INSTANCES, "EXT_texture_webp", "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_unlit", "KHR_mesh_quantization", "KHR_texture_transform",
}  # fmt: skip

# Without these extensions, the surface is right and the colours are plainer.
_APPEARANCE = re.compile(r"KHR_materials_|[A-Z]+_texture_")
_POSE = {"translation": [0.0, 0, 0], "rotation": [0.0, 0, 0, 1], "scale": [1.0, 1, 1]}

_UNREAD = ("normalTexture", "occlusionTexture", "emissiveTexture", "emissiveFactor",
           "metallicRoughnessTexture", "specularGlossinessTexture")  # fmt: skip

_WRAPS = {10497: "repeat", 33071: "clamp", 33648: "mirror"}


def read_gltf(data: bytes, assets: Assets) -> list[Part]:
    return list(_Scene(Document(data, assets)).parts())


class _GltfLook(NamedTuple):
    """A material of glTF.

    Attributes:
      uv_set: number of the set of texture coordinates.
      least: the surface is opaque where the alpha of texture and vertices is at least this, and
        absent elsewhere; None = alpha is the opacity.
    """

    look: Look
    uv_set: int
    least: float | None

    def colours(self, linear: np.ndarray) -> np.ndarray:
        """Display RGBA of linear colours [n, 3 or 4] of faces."""
        result = np.ones((len(linear), 4))
        result[:, : linear.shape[1]] = linear
        result[:, :3] **= 1 / 2.2
        if self.least is not None:
            result[:, 3] = result[:, 3] >= self.least
        return result


def _matrices(move: np.ndarray, turn: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Matrices [n, 4, 4] of translations, rotations (quaternions x, y, z, w) and scales."""
    still = np.linalg.norm(turn, axis=1, keepdims=True) == 0
    result = np.tile(np.eye(4), (len(move), 1, 1))
    result[:, :3, :3] = Rotation.from_quat(np.where(still, [0, 0, 0, 1], turn)).as_matrix()
    result[:, :3, :3] *= scale[:, None]
    result[:, :3, 3] = move
    return result


def _triangles(mode: int, corners: np.ndarray) -> np.ndarray:
    """The triangles [f, 3] of a list (4), a strip (5) or a fan (6)."""
    if mode == 4:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    faces = corners[(strip if mode == 5 else fan)(len(corners))]
    # Repeated corners join two strips to one.
    return faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]


def _skinning(joints: np.ndarray, index: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Matrices [v, 4, 4]: means of the joints `index` with the weights `share`, both [v, k]."""
    share = np.nan_to_num(share).clip(0)
    share[share.sum(axis=1) == 0, 0] = 1
    index = np.where(share > 0, index, 0).astype(np.int64)
    if index.min() < 0 or index.max() >= len(joints):
        raise DamagedError(f"vertices have joints beyond the {len(joints)} of their skin")
    share /= share.sum(axis=1, keepdims=True)
    result = np.zeros((len(index), 4, 4))
    for k in range(index.shape[1]):
        result += share[:, k, None, None] * joints[index[:, k]]
    return result


class _Scene:
    """The nodes and materials of a file."""

    def __init__(self, file: Document) -> None:
        self.file, self.root, self.assets = file, file.root, file.assets
        self.looks: dict[int, _GltfLook] = {}
        self.pictures: dict[tuple[int, float], np.ndarray] = {}
        required = self.root.values("extensionsRequired", str)
        for name in dict.fromkeys(required + self.root.values("extensionsUsed", str)):
            if name not in _READ:
                if name in required and not _APPEARANCE.match(name):
                    raise DamagedError(f"it needs the extension {name!r}, which is not read")
                self.assets.warn("extensions not read", repr(name))
        if animations := self.root.items("animations"):
            what = "animations not read, the pose of the nodes is taken"
            self.assets.warn(what, len(animations))

    # --- Nodes ----------------------------------------------------------------------------------

    def nodes(self) -> tuple[list[Object], np.ndarray, np.ndarray]:
        """The nodes, their matrices [n, 4, 4] in the scene, and which of them are in it [n]."""
        nodes = self.root.items("nodes")
        children = [node.values("children", int) for node in nodes]
        world = np.tile(np.eye(4), (len(nodes), 1, 1))
        parent = np.full(len(nodes), -1)
        for number, node in enumerate(nodes):
            if "matrix" in node:
                world[number] = node.numbers("matrix", [0] * 16).reshape(4, 4).T
            elif any(key in node for key in _POSE):
                pose = (node.numbers(key, default)[None] for key, default in _POSE.items())
                world[number] = _matrices(*pose)[0]
            for child in children[number]:
                if parent[self.root.item("nodes", child).index] >= 0:
                    raise DamagedError(f"nodes[{child}] has several parents")
                parent[child] = number
        shown = order = np.flatnonzero(parent < 0).tolist()
        if scenes := self.root.items("scenes"):
            shown = self.root.item("scenes", self.root.get("scene", 0)).values("nodes", int)
            if len(scenes) > 1:
                self.assets.warn("scenes other than the default one not read", len(scenes) - 1)
        inside = np.zeros(len(nodes), bool)
        inside[[self.root.item("nodes", number).index for number in shown]] = True
        for number in order:  # the list grows; parents precede their children
            if parent[number] >= 0:
                world[number] = world[parent[number]] @ world[number]
                inside[number] |= inside[parent[number]]
            order += children[number]
        if len(order) < len(nodes):
            raise DamagedError("its nodes form a cycle")
        return nodes, world, inside

    def parts(self) -> Iterator[Part]:
        """The meshes of the scene; all instances of a mesh are together."""
        nodes, world, inside = self.nodes()
        uses: dict[tuple[int, int, tuple[float, ...]], list[np.ndarray]] = {}
        for number in np.flatnonzero(inside).tolist():
            node, matrices = nodes[number], world[number, None]
            if "mesh" not in node:
                continue
            if instances := node.extension(_INSTANCES):
                matrices = matrices @ self.instances(instances.object("attributes"))
            mesh = self.root.item("meshes", node.get("mesh", int))
            weights = (node if "weights" in node else mesh).values("weights", float)
            key = mesh.index, node.get("skin", -1), tuple(weights)
            uses.setdefault(key, []).append(matrices)
        for (index, skin, morph), places in uses.items():
            joints = None if skin < 0 else self.joints(skin, world)
            for primitive in self.root.item("meshes", index).items("primitives"):
                yield from self.primitive(primitive, morph, np.concatenate(places), joints)

    def instances(self, attributes: Object) -> np.ndarray:
        """The matrices [n, 4, 4] of EXT_mesh_gpu_instancing."""
        pose = []
        for key, default in _POSE.items():
            index = attributes.get(key.upper(), -1)
            found = None if index < 0 else as_floats(*self.file.accessor(index, len(default)))
            pose.append(np.array([default]) if found is None else found)
        count = max(map(len, pose))
        self.assets.budget.charge(made=512 * count)
        if any(len(values) not in (1, count) for values in pose):
            raise DamagedError(f"{attributes.path} have different counts")
        return _matrices(*(np.broadcast_to(v, (count, v.shape[1])) for v in pose))

    def joints(self, index: int, world: np.ndarray) -> np.ndarray:
        """The matrices [j, 4, 4] of a skin's joints, from the bind pose to the nodes' pose."""
        skin = self.root.item("skins", index)
        numbers = skin.values("joints", int)
        self.assets.budget.charge(visits=1 + len(numbers) // 16)
        result = world[[self.root.item("nodes", number).index for number in numbers]]
        if "inverseBindMatrices" in skin:
            bind = as_floats(*self.file.accessor(skin.get("inverseBindMatrices", int), 16))
            if len(bind) < len(result):
                raise DamagedError(f"{skin.path} has {len(bind)} matrices for {len(result)} joints")
            result = result @ bind[: len(result)].reshape(-1, 4, 4).transpose(0, 2, 1)
        return result

    # --- Meshes ---------------------------------------------------------------------------------

    def primitive(
        self, part: Object, weights: Sequence[float], matrices: np.ndarray,
        joints: np.ndarray | None,
    ) -> Iterator[Part]:  # fmt: skip
        """The faces of a primitive: a copy under each of the matrices [n, 4, 4], or a skin."""
        self.assets.budget.charge(visits=len(matrices) + len(part.get("targets", [])) // 16)
        targets = list(zip(part.items("targets"), weights, strict=False))
        mode, attributes = part.get("mode", 4), part.object("attributes")
        if mode < 4 or mode > 6 or "POSITION" not in attributes:
            what = "without positions" if 4 <= mode <= 6 else f"of mode {mode}"
            self.assets.warn("lines, points and primitives without positions dropped", what)
            return
        own = self.look(part.get("material", -1))
        widths = {"POSITION": (3,), "NORMAL": (3,), "COLOR_0": (3, 4)}
        skinned = [k for k in "01" if joints is not None and f"JOINTS_{k}" in attributes]
        widths |= {f"{name}_{k}": (4,) for k in skinned for name in ("JOINTS", "WEIGHTS")}
        coordinates = f"TEXCOORD_{own.uv_set}"
        if own.look.material.texture is not None:
            widths[coordinates] = (2,)
            if coordinates not in attributes:
                self.assets.warn(NO_COORDINATES, coordinates)
        arrays = {name: self.file.accessor(attributes.get(name, int), *width)
                  for name, width in widths.items() if name in attributes}  # fmt: skip
        corners: np.ndarray | None = None
        packed = part.extension(DRACO)
        position = self.root.item("accessors", attributes.get("POSITION", int))
        if packed and "bufferView" not in position:
            corners, found = by_draco(packed, self.file.view(packed.get("bufferView", int)))
            mode = 4
            for name in arrays.keys() & found.keys():
                if found[name].shape[1:] not in [(width,) for width in widths[name]]:
                    raise DamagedError(f"{packed.path}.attributes.{name} has the wrong type")
                arrays[name] = found[name], arrays[name][1]
        elif "indices" in part:
            corners = self.file.accessor(part.get("indices", int), 1)[0][:, 0]
            if corners.dtype.kind != "u":
                raise DamagedError(f"{part.path}.indices have the wrong componentType")
        total = len(arrays["POSITION"][0])
        count = total if corners is None else len(corners)
        copies = 1 if skinned else len(matrices)
        self.assets.budget.charge(faces=(count // 3 if mode == 4 else max(count - 2, 0)) * copies)
        if mode == 4 and count % 3:
            self.assets.warn("corners after the last whole triangle dropped", count % 3)
        faces = _triangles(mode, np.arange(count) if corners is None else corners.astype(np.int64))
        if not len(faces):
            return
        if faces.min() < 0 or faces.max() >= total:
            raise DamagedError(f"{part.path}: faces have missing vertices")
        rows: Any = slice(None)
        if total > faces.size:  # many primitives may share these arrays
            rows, flat = np.unique(faces, return_inverse=True)
            faces = flat.reshape(-1, 3)

        def values(name: str, *, fractions: bool = False) -> np.ndarray:
            """An attribute of the vertices, with the morph targets added."""
            if name not in arrays:
                raise DamagedError(f"{part.path} has no {name}")
            width = arrays[name][0].shape[1]
            layers = [(1.0, *arrays[name])]
            layers += [(weight, *self.file.accessor(target.get(name, int), width))
                       for target, weight in targets if weight and name in target]  # fmt: skip
            if any(len(numbers) != total for _, numbers, _ in layers):
                raise DamagedError(f"{part.path}: {name} and POSITION have different counts")
            self.assets.budget.charge(made=16 * len(layers) * width * min(total, faces.size))
            changes = [w * as_floats(n[rows], normal or fractions) for w, n, normal in layers]
            return np.sum(changes, axis=0)

        colours, corners = None, faces.ravel()
        if "COLOR_0" in arrays:
            linear = np.nan_to_num(values("COLOR_0", fractions=True)).clip(0, 1)
            colours = np.repeat(own.colours(linear[faces].mean(axis=1)), 3, axis=0)
        uv = (values(coordinates) * [1, -1] + [0, 1])[corners] if coordinates in arrays else None
        normals = values("NORMAL")[corners] if "NORMAL" in arrays else None
        result = Part(values("POSITION"), np.full(len(faces), 3), corners, (own.look,),
                      uv=uv, normals=normals, colours=colours)  # fmt: skip
        if joints is not None and skinned:
            index = np.concatenate([values(f"JOINTS_{k}") for k in skinned], axis=1)
            share = [values(f"WEIGHTS_{k}", fractions=True) for k in skinned]
            yield transformed(result, _skinning(joints, index, np.concatenate(share, axis=1)))
        else:
            yield from (transformed(result, matrix[None]) for matrix in matrices)

    # --- Materials ------------------------------------------------------------------------------

    def look(self, index: int) -> _GltfLook:
        """A material; -1 = the default material."""
        if index in self.looks:
            return self.looks[index]
        fields = Object({}) if index < 0 else self.root.item("materials", index)
        glossy = fields.extension("KHR_materials_pbrSpecularGlossiness")
        source = glossy or fields.object("pbrMetallicRoughness")
        glows = fields.numbers("emissiveFactor", [0, 0, 0]).any()
        for key in _UNREAD:
            if (key in fields or key in source) and (key != "emissiveFactor" or glows):
                self.assets.warn("parts of materials not read", key)
        slot = "diffuse" if glossy else "baseColor"
        colour = source.numbers(f"{slot}Factor", [1, 1, 1, 1]).clip(0, 1)
        diffuse = colour[:3] ** (1 / 2.2)  # factors of glTF are linear

        def fraction(key: str) -> float:
            return min(max(source.get(key, 1.0), 0.0), 1.0)

        if glossy:
            rough = 1 - fraction("glossinessFactor")
            specular = source.numbers("specularFactor", [1, 1, 1]).clip(0, 1) ** (1 / 2.2)
            if "specularGlossinessTexture" in source:
                rough, specular = 0.5, np.full(3, 0.2)  # as plastic
        else:
            rough, metal = fraction("roughnessFactor"), fraction("metallicFactor")
            if "metallicRoughnessTexture" in source:
                metal = min(metal, 0.5)
            specular = (1 - metal) * 0.2 + metal * diffuse
        shine = 0 if fields.extension("KHR_materials_unlit") else 1 - rough
        mode, alpha = fields.get("alphaMode", "OPAQUE").upper(), float(colour[3])
        least = None if mode == "BLEND" else 0.0
        if mode == "MASK":
            least = fields.get("alphaCutoff", 0.5) / max(alpha, 1e-3)
        opacity = alpha if least is None else float(least <= 1)
        # The exponent whose lobe is as wide as the microfacet lobe with this roughness.
        shininess = 2 / max(rough, 0.05) ** 4 - 2
        texture, uv_matrix, wraps, uv_set = self.texture(source, f"{slot}Texture", least)
        name = fields.get("name", "")
        made = material(diffuse, shine * specular, shininess, opacity, texture, name)
        look = Look(made, uv_matrix, wraps, tinted=True)
        return self.looks.setdefault(index, _GltfLook(look, uv_set, least))

    def texture(
        self, of_material: Object, slot: str, least: float | None
    ) -> tuple[np.ndarray | None, np.ndarray | None, tuple[str, str], int]:
        """A texture, its `Look.uv_matrix` and `wraps`, and the number of its set of coordinates."""
        nothing = None, None, ("repeat", "repeat"), 0
        if slot not in of_material:
            return nothing
        fields = of_material.object(slot)
        texture = self.root.item("textures", fields.get("index", int))
        webp = texture.extension("EXT_texture_webp")
        source = webp if webp and "source" in webp else texture
        if "source" not in source:
            what = ", ".join(texture.object("extensions").fields) or "no source"
            self.assets.warn(BROKEN_TEXTURE, f"{texture.path} ({what})")
            return nothing
        sampler = Object({})
        if "sampler" in texture:
            sampler = self.root.item("samplers", texture.get("sampler", int))
        wraps = [_WRAPS.get(sampler.get(key, 10497)) for key in ("wrapS", "wrapT")]
        if wraps[0] is None or wraps[1] is None:
            raise DamagedError(f"{sampler.path} has an unknown way to wrap")
        moved, matrix = fields.extension("KHR_texture_transform"), None
        uv_set = fields.get("texCoord", 0)
        if moved is not None:
            uv_set = moved.get("texCoord", uv_set)
            (a, b), (x, y) = moved.numbers("scale", [1, 1]), moved.numbers("offset", [0, 0])
            sine, cosine = np.sin(turn := moved.get("rotation", 0.0)), np.cos(turn)
            # For (u, 1 - v), because images of glTF begin at v = 0.
            matrix = np.array([[cosine * a, -sine * b, sine * b + x],
                               [sine * a, cosine * b, 1 - cosine * b - y]])  # fmt: skip
        return self.picture(source.get("source", int), least), matrix, (wraps[0], wraps[1]), uv_set

    def picture(self, index: int, least: float | None) -> np.ndarray | None:
        """An image with the alpha of `_GltfLook.least`: 0 or 1, or unchanged if that is None."""
        fields = self.root.item("images", index)
        picture = self.assets.decoded(
            ("image", index), fields.path, lambda: self.file.image(fields)
        )
        if picture is None or least is None or (picture[..., 3] == 255).all():
            return picture
        if (index, least) not in self.pictures:
            alpha = np.where(picture[..., 3] >= 255 * least, 255, 0).astype(np.uint8)
            self.pictures[index, least] = self.assets.with_alpha(picture, alpha)
        return self.pictures[index, least]

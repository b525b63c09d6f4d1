"""Materials of glTF files as Blinn-Phong materials."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from data_gen.mesh import Material
from data_gen.parts import palette
from data_gen.readers.gltf_json import Object, damaged
from data_gen.readers.textures import BROKEN_TEXTURE, Assets

_WRAPS = {10497: "repeat", 33071: "clamp", 33648: "mirror"}
_MOST_TILES = 4  # beyond, coordinates of a texture that does not repeat are cut off
_SIDE = 4096  # largest side of a texture with a margin


@dataclasses.dataclass(frozen=True)
class Look:
    """A material: linear RGBA, the number of its image (-1 = none), how coordinates reach it."""

    colour: np.ndarray
    image: int
    wraps: tuple[str, str]
    uv_set: int
    uv_matrix: np.ndarray  # [2, 3]
    mode: str
    cutoff: float
    specular: tuple[float, float, float]
    shininess: float
    name: str


class Looks:
    """The materials of a file."""

    def __init__(self, root: Object, assets: Assets, read: Callable[[Object], bytes]) -> None:
        self.root, self.assets, self.read = root, assets, read
        self._looks: dict[int, Look] = {}
        self._cut: dict[tuple[int, float], np.ndarray] = {}

    def look(self, index: int) -> Look:
        """A material; -1 is that of primitives without one."""
        if index not in self._looks:
            self._looks[index] = self._read_look(index)
        return self._looks[index]

    def _read_look(self, index: int) -> Look:
        fields = Object({}, "") if index < 0 else self.root.item("materials", index)
        physical = fields.object("pbrMetallicRoughness")
        glossy = fields.extension("KHR_materials_pbrSpecularGlossiness")
        unread = [key for key in ("normalTexture", "occlusionTexture", "emissiveTexture")
                  if key in fields]  # fmt: skip
        unread += ["emissiveFactor"] * bool(fields.numbers("emissiveFactor", [0, 0, 0]).any())
        if glossy is None:
            colour = physical.numbers("baseColorFactor", [1, 1, 1, 1]).clip(0, 1)
            slot = "baseColorTexture"
            rough = min(max(physical.number("roughnessFactor", 1.0), 0.0), 1.0)
            metal = min(max(physical.number("metallicFactor", 1.0), 0.0), 1.0)
            if "metallicRoughnessTexture" in physical:
                unread.append("metallicRoughnessTexture")
                metal = min(metal, 0.5)
            high = (1 - rough) * ((1 - metal) * 0.2 + metal * colour[:3] ** (1 / 2.2))
        else:
            colour = glossy.numbers("diffuseFactor", [1, 1, 1, 1]).clip(0, 1)
            slot, physical = "diffuseTexture", glossy
            rough = 1 - min(max(glossy.number("glossinessFactor", 1.0), 0.0), 1.0)
            high = (1 - rough) * glossy.numbers("specularFactor", [1, 1, 1]).clip(0, 1) ** (1 / 2.2)
            if "specularGlossinessTexture" in glossy:
                unread.append("specularGlossinessTexture")
                rough, high = 0.5, np.full(3, 0.1)  # as plastic
        if fields.extension("KHR_materials_unlit") is not None:
            high = np.zeros(3)
        for name in unread:
            self.assets.warn("parts of materials not read", name)
        image, wraps, uv_set, matrix = self._texture(physical, slot)
        return Look(
            colour, image, wraps, uv_set, matrix, fields.text("alphaMode", "OPAQUE").upper(),
            fields.number("alphaCutoff", 0.5), (float(high[0]), float(high[1]), float(high[2])),
            # The exponent whose lobe is as wide as the microfacet lobe with this roughness.
            min(max(2 / max(rough, 0.05) ** 4 - 2, 1.0), 1000.0), fields.text("name", ""),
        )  # fmt: skip

    def _texture(self, material: Object, slot: str) -> tuple[int, tuple[str, str], int, np.ndarray]:
        """Number of the image, wraps, set of coordinates and their matrix [2, 3]."""
        plain = (-1, ("repeat", "repeat"), 0, np.eye(2, 3))
        if slot not in material:
            return plain
        fields = material.object(slot)
        moved = fields.extension("KHR_texture_transform") or Object({}, fields.path)
        turn, scale = moved.number("rotation", 0.0), moved.numbers("scale", [1, 1])
        sine, cosine = np.sin(turn), np.cos(turn)
        matrix = np.empty((2, 3))
        matrix[:, :2] = np.array([[cosine, sine], [-sine, cosine]]) * scale
        matrix[:, 2] = moved.numbers("offset", [0, 0])
        texture = self.root.item("textures", fields.whole("index"))
        found = [texture.extension(f"{name}_texture_{kind}")
                 for name, kind in (("EXT", "webp"), ("MSFT", "dds"))]  # fmt: skip
        source = next((x for x in [*found, texture] if x is not None and "source" in x), None)
        if source is None:
            what = ", ".join(texture.object("extensions").fields) or "no source"
            self.assets.warn(BROKEN_TEXTURE, f"{texture.path} ({what})")
            return plain
        sampler = Object({}, "")
        if "sampler" in texture:
            sampler = self.root.item("samplers", texture.whole("sampler"))
        wraps = [_WRAPS.get(sampler.whole(key, 10497)) for key in ("wrapS", "wrapT")]
        if wraps[0] is None or wraps[1] is None:
            raise damaged(f"{sampler.path} has an unknown way to wrap")
        uv_set = moved.whole("texCoord", fields.whole("texCoord", 0))
        return source.whole("source"), (wraps[0], wraps[1]), uv_set, matrix

    def _picture(self, look: Look) -> np.ndarray | None:
        """The texture, with the alpha of the material's mode."""
        fields = self.root.item("images", look.image)
        picture = self.assets.decoded(("image", look.image), fields.path, lambda: self.read(fields))
        if picture is None or look.mode == "BLEND" or (picture[..., 3] == 255).all():
            return picture
        least = 0.0 if look.mode != "MASK" else 255 * look.cutoff / max(look.colour[3], 1e-3)
        key = look.image, least
        if key not in self._cut:
            alpha = np.where(picture[..., 3] >= least, 255, 0).astype(np.uint8)
            self._cut[key] = np.dstack([picture[..., :3], alpha])
        return self._cut[key]

    def applied(self, arrays: dict[str, Any]) -> dict[str, Any]:
        """Arrays for `mesh.build_model` from those of the file.

        `face_material` has numbers of the file, `colours` [F, 4] linear RGBA of the faces.
        """
        owner, uv, colours = arrays["face_material"], arrays["uv"], arrays.pop("colours")
        table: list[Material] = []
        result = np.empty_like(owner)
        for index in np.flatnonzero(np.bincount(owner + 1)).tolist():
            index -= 1
            look, own = self.look(index), np.flatnonzero(owner == index)
            texture = None if look.image < 0 else self._picture(look)
            if texture is not None:
                places = np.nan_to_num(uv[own] @ look.uv_matrix[:, :2].T + look.uv_matrix[:, 2])
                texture, uv[own] = wrapped(texture, places, look.wraps)
            paint = colours[own]
            shown = (paint if (paint != 1).any() else np.ones((1, 4))) * look.colour
            shown[:, :3] **= 1 / 2.2  # factors of glTF are linear
            if look.mode != "BLEND":
                shown[:, 3] = (look.mode != "MASK") | (shown[:, 3] >= look.cutoff)
            material = Material(specular=look.specular, shininess=look.shininess, name=look.name)
            if texture is None and np.ptp(shown, axis=0).any():
                painted, uv[own] = palette((255 * shown).round().astype(np.uint8))
                texture, shown = painted.texture, np.ones((len(own), 4))
            distinct, group = shown[:1], np.zeros(1, np.int64)
            if np.ptp(shown, axis=0).any():  # the colours of faces with a texture, in 16 steps
                distinct, group = np.unique(np.round(15 * shown), axis=0, return_inverse=True)
                distinct = distinct / 15
            result[own] = group.ravel() + len(table)
            table += [
                dataclasses.replace(material, diffuse=(r, g, b), opacity=a, texture=texture)
                for r, g, b, a in distinct.tolist()
            ]
        normals = arrays["normals"] if arrays["normals"].any() else None
        materials = self.assets.bounded(table)
        return {**arrays, "materials": materials, "face_material": result, "normals": normals}


def wrapped(
    texture: np.ndarray, uv: np.ndarray, wraps: tuple[str, str]
) -> tuple[np.ndarray, np.ndarray]:
    """A texture that repeats, with coordinates from the lower left, for one that may not.

    A mirrored texture is as large again, a clamped one has a margin as wide as the coordinates
    need, up to `_MOST_TILES` times its size.
    """
    uv = uv.copy()
    for axis, wrap in enumerate(wraps):
        side, places = 1 - axis, uv[..., axis]
        if wrap == "mirror":
            texture = np.concatenate([texture, np.flip(texture, side)], axis=side)
            uv[..., axis] = places / 2
        elif wrap == "clamp":
            places = places.clip(-_MOST_TILES, 1 + _MOST_TILES)
            low, high = min(places.min(), 0.0), max(places.max(), 1.0)
            if (low, high) == (0, 1):
                uv[..., axis] = places.clip(0, 1 - 1e-6)  # 1 would be 0 again
                continue
            while texture.shape[side] * (high - low) > _SIDE:
                texture = texture[:, ::2] if side else texture[::2]
            size = texture.shape[side]
            margin = [(0, 0)] * 3
            margin[side] = int(np.ceil(-low * size)) + 1, int(np.ceil((high - 1) * size)) + 1
            texture = np.pad(texture, margin, mode="edge")
            uv[..., axis] = (places * size + margin[side][0]) / texture.shape[side]
    uv[..., 1] = 1 - uv[..., 1]
    return texture, uv

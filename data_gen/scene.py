"""The scene of an image as arrays: the surfaces of a model, and a view's camera and lights."""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt32

from data_gen.cameras import Camera
from data_gen.lights import Lights
from data_gen.mesh import EXISTS, Model, face_normals
from psgn_jax.data import schema

BACKGROUND = schema.BACKGROUND_GREY / 255
"""Grey of the background, as in the authors' images."""


@dataclasses.dataclass(frozen=True, eq=False)
class ModelArrays:
    """The arrays of a model's v vertices, f faces and m materials, in the model's frame.

    `corners`, `normals` and `uv` belong to the corners of faces. `texels` are the RGBA values of
    all textures in row-major order, four uint8 as a uint32. The first texel is white, for materials
    without a texture. A material's texture starts at `texture_start`; its size is (height, width).
    """

    vertices: Float[np.ndarray, "v 3"]
    corners: Float[np.ndarray, "f 3 3"]
    normals: Float[np.ndarray, "f 3 3"]
    face_normals: Float[np.ndarray, "f 3"]
    uv: Float[np.ndarray, "f 3 2"]
    material: Int[np.ndarray, " f"]
    diffuse: Float[np.ndarray, "m 3"]
    specular: Float[np.ndarray, "m 3"]
    shininess: Float[np.ndarray, " m"]
    opacity: Float[np.ndarray, " m"]
    texels: UInt32[np.ndarray, " t"]
    texture_start: Int[np.ndarray, " m"]
    texture_size: Int[np.ndarray, "m 2"]
    opaque: bool


@dataclasses.dataclass(frozen=True, eq=False)
class Scene:
    """The input of local shading."""

    arrays: ModelArrays
    camera: Camera
    lights: Lights


def flatten(model: Model) -> ModelArrays:
    """The arrays of a model."""
    # The white texel, and each texture once: materials may share a texture.
    textures = {id(m.texture): m.texture for m in model.materials if m.texture is not None}
    parts = [np.full((1, 4), 255, np.uint8), *(t.reshape(-1, 4) for t in textures.values())]
    first = np.cumsum([len(part) for part in parts])[:-1]
    start = dict(zip(textures, first.tolist(), strict=True))
    starts = [start.get(id(m.texture), 0) for m in model.materials]
    sizes = [(1, 1) if m.texture is None else m.texture.shape[:2] for m in model.materials]
    opacity = np.array([m.opacity for m in model.materials], np.float32)
    seen = [model.materials[i] for i in np.unique(model.face_material)]
    opaque = all(np.float32(m.opacity) >= 0.99 and not m.has_alpha for m in seen)
    return ModelArrays(
        vertices=model.vertices.astype(np.float32),
        corners=model.corners().astype(np.float32),
        normals=np.ascontiguousarray(model.normals, np.float32),
        face_normals=face_normals(model.vertices, model.faces).astype(np.float32),
        uv=np.ascontiguousarray(model.uv, np.float32),
        material=model.face_material.astype(np.int32),
        diffuse=np.array([m.diffuse for m in model.materials], np.float32),
        specular=np.array([m.specular for m in model.materials], np.float32),
        shininess=np.array([m.shininess for m in model.materials], np.float32),
        opacity=np.where(opacity < EXISTS, 0, opacity),
        texels=np.concatenate(parts).view(np.uint32).reshape(-1),
        texture_start=np.array(starts, np.int64),
        texture_size=np.array(sizes, np.int32),
        opaque=opaque,
    )


class RayHits(NamedTuple):
    """Intersections of rays with the mesh: face (-1 = none), barycentric weights, parameter t."""

    face: Int[np.ndarray, " n"]
    weights: Float[np.ndarray, "n 3"]
    t: Float[np.ndarray, " n"]

"""Images of scenes with local shading: Blinn-Phong under directional lights.

As in the paper's images, there are no shadows and no interreflection. We compute with display
values (sRGB), without a transfer curve. Mitsuba intersects rays with a single mesh, so it compiles
nothing for another model. We compute the colours with numpy, equal for both variants of Mitsuba.
"""

import dataclasses
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8, UInt32

from data_gen import cameras, engine
from data_gen.cameras import Camera
from data_gen.lights import Lights
from data_gen.mesh import EXISTS, Model, face_normals
from psgn_jax.data import schema

BACKGROUND = schema.BACKGROUND_GREY / 255
"""Grey of the background, as in the authors' images."""

_MAX_LAYERS = 8  # largest number of surfaces that a ray passes (holes and glass)
_OPAQUE = 0.98  # a ray ends at this accumulated opacity
_BEHIND = 2e-4  # a ray continues at this distance behind a hit

# A sample is on another surface if the cosine between its normal and the centre's is smaller.
_SAME_SURFACE = float(np.cos(np.deg2rad(30.0)))


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


def flatten(model: Model) -> ModelArrays:
    # The white texel, and each texture once: materials may share a texture.
    textures = {id(m.texture): m.texture for m in model.materials if m.texture is not None}
    parts = [np.full((1, 4), 255, np.uint8), *(t.reshape(-1, 4) for t in textures.values())]
    first = np.cumsum([len(part) for part in parts])[:-1]
    start = dict(zip(textures, first.tolist(), strict=True))
    starts = [start.get(id(m.texture), 0) for m in model.materials]
    sizes = [(1, 1) if m.texture is None else m.texture.shape[:2] for m in model.materials]
    opacity = np.array([m.opacity for m in model.materials], np.float32)
    seen = np.unique(model.face_material)
    opaque = (opacity[seen] >= np.float32(0.99)).all() and not model.has_alpha[seen].any()
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

    def rows(self, index: Int[np.ndarray, " m"]) -> "RayHits":
        return RayHits(*(values[index] for values in self))


class Mesh:
    """The arrays of a model, and the search structure of its faces for ray intersection."""

    def __init__(self, model: Model) -> None:
        self.arrays = flatten(model)
        corners = self.arrays.corners
        # So the texture coordinates of a hit are its barycentric coordinates.
        uv = np.tile(np.array([[0, 0], [1, 0], [0, 1]], np.float32), (len(corners), 1, 1))
        self._scene = engine.mi.load_dict({"type": "scene", "model": engine.mesh(corners, uv)})

    def cast(
        self, origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]
    ) -> RayHits:
        """The first hit of each ray; `t` is in units of the length of its direction."""
        count = len(directions)
        if not count:
            return RayHits(np.zeros(0, np.int64), np.zeros((0, 3), np.float32), np.zeros(0))
        if engine.mi.variant().startswith("scalar"):
            face = np.full(count, -1, np.int64)
            one, two = np.zeros((2, count), np.float32)
            t = np.full(count, np.inf, np.float32)
            meet, ray_of = self._scene.ray_intersect_preliminary, engine.mi.Ray3f
            rays = zip(origins.tolist(), directions.tolist(), strict=True)
            for number, (origin, direction) in enumerate(rays):
                hit = meet(ray_of(origin, direction), coherent=True)
                if hit.is_valid():
                    face[number], t[number] = hit.prim_index, hit.t
                    one[number], two[number] = hit.prim_uv
        else:
            columns = [np.ascontiguousarray(a[:, k], np.float32) for a in (origins, directions)
                       for k in range(3)]  # fmt: skip
            ray = engine.mi.Ray3f(
                engine.mi.Point3f(*(engine.mi.Float(c) for c in columns[:3])),
                engine.mi.Vector3f(*(engine.mi.Float(c) for c in columns[3:])),
            )
            hits = self._scene.ray_intersect_preliminary(ray, coherent=True)
            engine.dr.eval(hits.t, hits.prim_index, hits.prim_uv)
            t = np.array(hits.t, np.float32)
            face = np.where(np.isfinite(t), np.array(hits.prim_index).astype(np.int64), -1)
            # Rays without a hit have arbitrary values.
            one, two = np.where(face >= 0, np.array(hits.prim_uv, np.float32).reshape(2, count), 0)
        return RayHits(face, np.stack([1 - one - two, one, two], axis=1), t)


@dataclasses.dataclass(frozen=True, eq=False)
class Scene:
    """What both renderers show. Only local shading uses the lights."""

    mesh: Mesh
    camera: Camera
    lights: Lights


def window_of(arrays: ModelArrays, camera: Camera) -> tuple[slice, slice]:
    """The rows and columns of all vertices and a border of a pixel."""
    pixels, _ = cameras.project(arrays.vertices @ camera.rotation.T, camera)
    height, width = camera.image_size
    low = np.floor(np.nanmin(pixels, axis=0)).astype(int) - 1
    high = np.ceil(np.nanmax(pixels, axis=0)).astype(int) + 1
    left, right = np.clip([low[0], high[0]], 0, width)
    top, bottom = np.clip([low[1], high[1]], 0, height)
    rows = slice(int(top), int(max(bottom, top + 1)))
    return rows, slice(int(left), int(max(right, left + 1)))


def sample_rays(
    camera: Camera, window: tuple[slice, slice], side: int, chosen: np.ndarray | slice = slice(None)
) -> Float[np.ndarray, "n 3"]:
    """Rays through `side` x `side` points of each chosen pixel of a window, pixel after pixel.

    Directions in the view-aligned frame, with depth 1 along the optical axis.
    """
    rows, columns = np.mgrid[window].reshape(2, -1)[:, chosen]
    offsets = (np.arange(side) + 0.5) / side
    k = camera.intrinsics
    rows = (rows[:, None, None] + offsets[:, None]).repeat(side, 2).ravel()
    columns = (columns[:, None, None] + offsets).repeat(side, 1).ravel()
    y = (rows - k[1, 2]) / k[1, 1]
    x = (columns - k[0, 2] - k[0, 1] * y) / k[0, 0]
    rays = np.stack([x, y, np.ones_like(x)], axis=1) @ camera.extrinsics[:, :3]
    return rays.astype(np.float32)


def look_up(
    arrays: ModelArrays, hits: RayHits
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Diffuse colour and opacity at hits; opacities below `EXISTS` become 0.

    We read the nearest texel, because samples within a pixel antialias textures.
    """
    owner = arrays.material[hits.face]
    colour = arrays.diffuse[owner]
    opacity = arrays.opacity[owner]
    textured = np.flatnonzero(arrays.texture_start[owner])
    if len(textured):
        which = owner[textured]
        uv = np.einsum("nk,nkd->nd", hits.weights[textured], arrays.uv[hits.face[textured]])
        uv -= np.floor(uv)
        height, width = arrays.texture_size[which].T
        column = np.minimum((uv[:, 0] * width).astype(np.int64), width - 1)
        row = np.minimum(((1 - uv[:, 1]) * height).astype(np.int64), height - 1)
        index = arrays.texture_start[which] + row * width + column
        texel = arrays.texels[index].view(np.uint8).reshape(-1, 4).astype(np.float32) / 255
        colour[textured] *= texel[:, :3]
        opacity[textured] *= texel[:, 3]
    return colour, np.where(opacity < EXISTS, 0, opacity)


def shading_normals(
    scene: Scene, hits: RayHits, rays: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Unit normals of hits on the viewer's side, in the view-aligned frame, as the rays."""
    arrays, turn = scene.mesh.arrays, scene.camera.rotation.astype(np.float32).T
    normal = np.einsum("nk,nkd->nd", hits.weights, arrays.normals[hits.face]) @ turn
    flat = arrays.face_normals[hits.face] @ turn
    # We shade both sides of a face, with the normal of the visible side.
    away = np.einsum("nd,nd->n", flat, rays) > 0
    normal = np.where(away[:, None], -normal, normal)
    length = np.sqrt(np.einsum("nd,nd->n", normal, normal))
    bad = length < 1e-6
    if bad.any():
        normal[bad] = np.where(away[bad, None], -flat[bad], flat[bad])
        length[bad] = 1
    return normal / length[:, None]


def blinn_phong(
    arrays: ModelArrays,
    lights: Lights,
    owner: Int[np.ndarray, " n"],
    colour: Float[np.ndarray, "n 3"],
    normal: Float[np.ndarray, "n 3"],
    view: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "n 3"]:
    """Display colours in [0, 1] of points with materials `owner` and diffuse colours `colour`.

    `c = d (a(n) + sum_i L_i max(n l_i, 0)) + s sum_i L_i max(n h_i, 0)^e [n l_i > 0]`, with the
    diffuse colour d, the ambient light a interpolated between ground and sky, the specular colour
    s with exponent e, and h_i halfway between the light l_i and the viewer (Blinn 1977).
    """
    rise = (normal[:, 2:3] + 1) / 2
    light = lights.ground * (1 - rise) + lights.sky * rise
    facing = np.maximum(normal @ lights.directions.T, 0)
    result = np.maximum(colour, lights.darkest) * (light + facing @ lights.colours)
    # Table look-ups and matrix products are faster than sums over axes of length 3.
    lit = facing @ np.ones(len(lights.directions), np.float32) > 0
    glossy: np.ndarray = np.any(arrays.specular > 1e-3, axis=1)
    shiny = np.flatnonzero(glossy[owner] & lit)
    if lights.specular > 0 and len(shiny):
        which = owner[shiny]
        exponent = arrays.shininess[which]
        gloss = np.zeros((len(shiny), 3), np.float32)
        for direction, strength, share in zip(
            lights.directions, lights.colours, facing[shiny].T, strict=True
        ):
            half = view[shiny] + direction
            cosine = np.einsum("nd,nd->n", normal[shiny], half) / np.sqrt(
                np.maximum(np.einsum("nd,nd->n", half, half), 1e-12)
            )
            glint = np.where(share > 0, np.maximum(cosine, 0) ** exponent, 0)
            gloss += glint[:, None] * strength
        result[shiny] += lights.specular * arrays.specular[which] * gloss
    return np.clip(result, 0, 1)


class _Samples(NamedTuple):
    """Results of rays: colour, transmittance to the background, and the first surface."""

    colour: Float[np.ndarray, "n 3"]
    through: Float[np.ndarray, " n"]
    hit: Bool[np.ndarray, " n"]
    owner: Int[np.ndarray, " n"]
    normal: Float[np.ndarray, "n 3"]
    z: Float[np.ndarray, " n"]


def _follow_rays(scene: Scene, rays: np.ndarray) -> _Samples:
    """Casts rays from the camera, also through holes and glass."""
    mesh, arrays, camera = scene.mesh, scene.mesh.arrays, scene.camera
    count = len(rays)
    colour, normals = np.zeros((2, count, 3), np.float32)
    through, z = np.ones(count, np.float32), np.zeros(count, np.float32)
    hit, owner = np.zeros(count, np.bool_), np.full(count, -1, np.int64)
    turn = camera.rotation.astype(np.float32)
    start = np.broadcast_to((camera.position @ camera.rotation).astype(np.float32), rays.shape)
    hits = mesh.cast(start, rays @ turn)
    origin = camera.position.astype(np.float32) @ turn
    index = np.flatnonzero(hits.face >= 0)
    hits = hits.rows(index)
    for layer in range(_MAX_LAYERS):
        if not len(index):
            break
        ray = rays[index]
        diffuse, opacity = look_up(arrays, hits)
        exists = np.flatnonzero(opacity > 0)
        at, seen = index[exists], hits.rows(exists)
        of_seen = arrays.material[seen.face]
        normal = shading_normals(scene, seen, ray[exists])
        view = -ray[exists] / np.linalg.norm(ray[exists], axis=1, keepdims=True)
        lit = blinn_phong(arrays, scene.lights, of_seen, diffuse[exists], normal, view)
        colour[at] += (through[at] * opacity[exists])[:, None] * lit
        fresh = ~hit[at]
        first = at[fresh]
        hit[first], owner[first], normals[first] = True, of_seen[fresh], normal[fresh]
        z[first] = seen.t[fresh]
        through[index] *= 1 - opacity
        if arrays.opaque or layer == _MAX_LAYERS - 1:
            break
        on = np.flatnonzero(through[index] > 1 - _OPAQUE)
        index, t = index[on], hits.t[on] + _BEHIND
        start = origin + t[:, None] * (rays[index] @ turn)
        following = mesh.cast(start, rays[index] @ turn)
        met = np.flatnonzero(following.face >= 0)
        index, hits = index[met], following._replace(t=t + following.t).rows(met)
    if arrays.opaque:
        through[hit] = 0
    return _Samples(colour, through, hit, owner, normals, z)


class Picture(NamedTuple):
    """A rendered view.

    Attributes:
      image: uint8 [H, W, 3].
      mask: bool [H, W], pixels whose centre shows the object.
      depth: float32 [H, W], along the optical axis, at the centres of the pixels; 0 = background.
    """

    image: UInt8[np.ndarray, "h w 3"]
    mask: Bool[np.ndarray, "h w"]
    depth: Float[np.ndarray, "h w"]


def render(scene: Scene, *, side: int = 4, soft_edges: bool = False) -> Picture:
    """Renders a view of a scene with local shading.

    Mask and depth are those at the centres of the pixels. The colour is a mean over `side` x `side`
    samples, 0 = the centre. Without soft edges, as in the authors' images, we use samples with the
    material and orientation of the centre only. This smooths textures and leaves edges hard.
    """
    arrays, camera = scene.mesh.arrays, scene.camera
    window = window_of(arrays, camera)
    centre = _follow_rays(scene, sample_rays(camera, window, 1))
    # Premultiplied colour, and opacity.
    total = np.concatenate([centre.colour, 1 - centre.through[:, None]], axis=1)
    if side > 0 and (soft_edges or arrays.texture_start.any()):
        # Without soft edges, a pixel with a centre outside the object is background, and a pixel
        # on a surface without texture has the centre's colour.
        textured = arrays.texture_start[centre.owner] > 0
        chosen = np.flatnonzero(soft_edges | (centre.hit & textured))
        seen = _follow_rays(scene, sample_rays(camera, window, side, chosen))
        colour = np.concatenate([seen.colour, 1 - seen.through[:, None]], axis=1)
        colour = colour.reshape(-1, side * side, 4)
        if soft_edges:
            total = colour.mean(axis=1)
        else:
            normals = seen.normal.reshape(-1, side * side, 3)
            cosine = np.einsum("pkd,pd->pk", normals, centre.normal[chosen])
            alike = seen.owner.reshape(-1, side * side) == centre.owner[chosen, None]
            alike &= cosine > _SAME_SURFACE
            summed = total[chosen] + np.einsum("pkd,pk->pd", colour, alike.astype(np.float32))
            total[chosen] = summed / (1 + alike.sum(axis=1))[:, None]

    def whole(values: np.ndarray) -> np.ndarray:
        result = np.zeros((*camera.image_size, *values.shape[1:]), values.dtype)
        result[window] = values.reshape(result[window].shape)
        return result

    premultiplied = whole(total)
    colour = premultiplied[..., :3] + (1 - premultiplied[..., 3:]) * BACKGROUND
    return Picture(
        image=np.rint(255 * np.clip(colour, 0, 1)).astype(np.uint8),
        mask=whole(centre.hit),
        depth=whole(np.where(centre.hit, centre.z, 0)),
    )

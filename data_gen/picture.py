"""Images of scenes with local shading.

Mitsuba intersects the rays with the mesh; `shading` computes the colours, with the same arithmetic
for both variants of Mitsuba.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from data_gen import engine, shading
from data_gen.ray_mesh import Mesh, camera_rays, window_of
from data_gen.scene import RayHits, Scene

# Largest number of surfaces that a ray passes through (holes and glass).
_MAX_LAYERS = 8

# A ray ends when its accumulated opacity reaches this.
_OPAQUE = 0.98

# Distance behind a hit at which a ray continues, in units of the frame.
_BEHIND = 2e-4

# Samples of a pixel whose normal deviates more than this from that of the centre are on another
# surface.
_SAME_SURFACE = float(np.cos(np.deg2rad(30.0)))


class _Samples(NamedTuple):
    """Result of rays: colour, transmittance to the background, and the first surface."""

    colour: Float[np.ndarray, "n 3"]
    through: Float[np.ndarray, " n"]
    hit: Bool[np.ndarray, " n"]
    owner: Int[np.ndarray, " n"]
    normal: Float[np.ndarray, "n 3"]
    z: Float[np.ndarray, " n"]


Shade = Callable[..., tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]]
"""Computes colours of hits in place of local shading; see `photo.photograph`."""


def follow_rays(
    mesh: Mesh, scene: Scene, rays: np.ndarray, first: RayHits, shade: Shade | None = None
) -> _Samples:
    """Follows rays from the camera through holes and glass, given their first hits.

    The colours are computed by local shading, or by `shade` if it is given.
    """
    surfaces, camera = scene.surfaces, scene.camera
    count = len(rays)
    colour = np.zeros((count, 3), np.float32)
    through = np.ones(count, np.float32)
    hit = np.zeros(count, np.bool_)
    owner = np.full(count, -1, np.int64)
    normals = np.zeros((count, 3), np.float32)
    z = np.zeros(count, np.float32)
    turn = camera.rotation.astype(np.float32)
    origin = camera.position.astype(np.float32) @ turn
    index = np.flatnonzero(first.face >= 0)
    face, weights, t = first.face[index], first.weights[index], first.t[index]
    for layer in range(_MAX_LAYERS):
        if not len(index):
            break
        ray = rays[index]
        diffuse, opacity = shading.look_up(surfaces, face, weights)
        exists = np.flatnonzero(opacity > 0)
        at, one = index[exists], face[exists]
        normal = shading.shading_normals(
            surfaces, one, weights[exists], camera.rotation, ray[exists]
        )
        view = -ray[exists] / np.linalg.norm(ray[exists], axis=1, keepdims=True)
        fresh = ~hit[at]
        if shade is None:
            lit = shading.blinn_phong(
                surfaces, scene.lights, surfaces.material[one], diffuse[exists], normal, view
            )
            colour[at] += (through[at] * opacity[exists])[:, None] * lit
        else:
            place = camera.position.astype(np.float32) + t[exists, None] * ray[exists]
            lit, mirrored = shade(
                at, fresh, place, normal, view, surfaces.material[one], diffuse[exists]
            )
            colour[at] += through[at, None] * (opacity[exists, None] * lit + mirrored)
        hit[at[fresh]] = True
        owner[at[fresh]] = surfaces.material[one[fresh]]
        normals[at[fresh]] = normal[fresh]
        z[at[fresh]] = t[exists[fresh]]
        through[index] *= 1 - opacity
        if surfaces.opaque or layer == _MAX_LAYERS - 1:
            break
        on = np.flatnonzero(through[index] > 1 - _OPAQUE)
        index, t = index[on], t[on] + _BEHIND
        # Continue from behind the hit.
        start = origin + t[:, None] * (rays[index] @ turn)
        following = mesh.cast(start, rays[index] @ turn)
        met = np.flatnonzero(following.face >= 0)
        index, face, weights = index[met], following.face[met], following.weights[met]
        t = t[met] + following.t[met]
    if surfaces.opaque:
        through[hit] = 0
    return _Samples(colour, through, hit, owner, normals, z)


class Picture(NamedTuple):
    """One rendered view.

    Attributes:
      image: uint8 [H, W, 3].
      mask: bool [H, W], pixels whose centre shows the object.
      depth: float32 [H, W], along the optical axis, at the centres of the pixels; 0 = background.
      normals: float32 [H, W, 3], shading normals on the viewer's side in the view-aligned frame, at
        the centres of the pixels; 0 = background.
      opacity: float32 [H, W], opacity of the object in each pixel.
    """

    image: UInt8[np.ndarray, "h w 3"]
    mask: Bool[np.ndarray, "h w"]
    depth: Float[np.ndarray, "h w"]
    normals: Float[np.ndarray, "h w 3"]
    opacity: Float[np.ndarray, "h w"]


def compose(
    premultiplied: Float[np.ndarray, "h w 4"], background: Float[np.ndarray, "..."] | float
) -> UInt8[np.ndarray, "h w 3"]:
    """Premultiplied colours over a background in [0, 1], as an 8-bit image."""
    full = premultiplied[..., :3] + (1 - premultiplied[..., 3:]) * background
    return np.rint(255 * np.clip(full, 0, 1)).astype(np.uint8)


def render(mesh: Mesh, scene: Scene, *, side: int = 4, soft_edges: bool = False) -> Picture:
    """Renders a view with local shading.

    Mask, depth and normals are sampled at the centres of the pixels. The colour is a mean over
    `side` x `side` samples. With soft edges, all samples of the pixel count. Without (as in the
    authors' images), only samples with the material and orientation of the centre count: textures
    are smoothed, as by mipmaps, but edges stay hard.

    Args:
      mesh: the mesh of `scene.surfaces.corners`.
      scene: the scene.
      side: samples along the edge of a pixel, 0 = only its centre.
      soft_edges: whether edges are smoothed as well.
    """
    camera = scene.camera
    height, width = camera.image_size
    window = window_of(scene.surfaces, camera)
    rows, columns = np.mgrid[window.slices].reshape(2, -1)
    scalar = engine.mi.variant().startswith("scalar")
    turn = camera.rotation.astype(np.float32)
    origin = (camera.position @ camera.rotation).astype(np.float32)

    def cast(rays: np.ndarray) -> RayHits:
        return mesh.cast(np.broadcast_to(origin, rays.shape), rays @ turn)

    rays = camera_rays(camera, columns + 0.5, rows + 0.5)
    first = mesh.cast_grid(camera, window, 1) if scalar else cast(rays)
    centre = follow_rays(mesh, scene, rays, first)
    # Premultiplied colour, and opacity.
    total = np.concatenate([centre.colour, 1 - centre.through[:, None]], axis=1)
    if side > 0 and (soft_edges or scene.surfaces.texture_start.any()):
        # Without soft edges, a pixel whose centre misses the object is background, and a pixel on
        # an untextured surface has one colour.
        textured = scene.surfaces.texture_start[centre.owner] > 0
        chosen = np.arange(len(rows)) if soft_edges else np.flatnonzero(centre.hit & textured)
        offsets = (np.arange(side) + 0.5) / side
        fine_rows = (rows[chosen, None, None] + offsets[:, None]).repeat(side, 2)
        fine_columns = (columns[chosen, None, None] + offsets).repeat(side, 1)
        rays = camera_rays(camera, fine_columns.ravel(), fine_rows.ravel())
        if scalar:
            whole = mesh.cast_grid(camera, window, side)
            cells = np.arange(len(whole.face)).reshape(window.height, side, window.width, side)
            number = cells.transpose(0, 2, 1, 3).reshape(-1, side * side)[chosen].ravel()
            first = RayHits(whole.face[number], whole.weights[number], whole.t[number])
        else:
            first = cast(rays)
        seen = follow_rays(mesh, scene, rays, first)
        colour = np.concatenate([seen.colour, 1 - seen.through[:, None]], axis=1)
        colour = colour.reshape(-1, side * side, 4)
        if soft_edges:
            total = colour.mean(axis=1)
        else:
            alike = (seen.owner.reshape(-1, side * side) == centre.owner[chosen, None]) & (
                np.einsum("pkd,pd->pk", seen.normal.reshape(-1, side * side, 3),
                          centre.normal[chosen])
                > _SAME_SURFACE
            )  # fmt: skip
            own = total[chosen]
            summed = own + np.einsum("pkd,pk->pd", colour, alike.astype(np.float32))
            total[chosen] = summed / (1 + alike.sum(axis=1))[:, None]
    premultiplied = np.zeros((height, width, 4), np.float32)
    premultiplied[window.slices] = total.reshape(window.height, window.width, 4)
    result = Picture(
        image=compose(premultiplied, scene.background),
        mask=np.zeros((height, width), np.bool_),
        depth=np.zeros((height, width), np.float32),
        normals=np.zeros((height, width, 3), np.float32),
        opacity=premultiplied[..., 3],
    )
    shape = (window.height, window.width)
    result.mask[window.slices] = centre.hit.reshape(shape)
    result.depth[window.slices] = np.where(centre.hit, centre.z, 0).reshape(shape)
    result.normals[window.slices] = centre.normal.reshape(*shape, 3)
    return result

"""Pictures of scenes with Mitsuba: rays, hits, local shading; path tracing as an option.

With `worker.py` the only importer of Mitsuba. A process calls `start` once, which fixes the
variant: `llvm_ad_rgb` is the fast one, `scalar_rgb` needs no LLVM. A model is one merged mesh, and
all that differs between models is data, so nothing is compiled anew from scene to scene. Rays hit
the mesh in Mitsuba; colours are `shading`'s, the same arithmetic for both variants.
"""

import contextlib
import dataclasses
import os
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from data_gen import cameras, photo, shading
from data_gen.cameras import Camera
from data_gen.grounds import Ground
from data_gen.lights import MAP_SIZE, shrink
from data_gen.photo import RayHits as Hits
from data_gen.scene import Scene, Surfaces
from data_gen.surroundings import Surroundings

VARIANTS = ("llvm_ad_rgb", "scalar_rgb")

# Surfaces that a ray passes through at most, holes and glass.
_MAX_LAYERS = 8

# What still shines through after this is not looked for.
_OPAQUE = 0.98

# How far behind a hit a ray goes on, unit of the frame.
_BEHIND = 2e-4

# Samples of a pixel that look further from its centre's normal than this are another surface.
_SAME_SURFACE = float(np.cos(np.deg2rad(30.0)))

_mi: Any = None
_dr: Any = None


def start(variant: str, libllvm: str = "", *, shrink_threads: bool = True) -> None:
    """Loads Mitsuba in one variant, with one thread; once in a process.

    Args:
      variant: one of `VARIANTS`.
      libllvm: path of the LLVM library; "" = Mitsuba looks for one.
      shrink_threads: one thread alone; not for `load_map`.

    Raises:
      ValueError: an unknown variant.
      RuntimeError: another variant was started before.
    """
    global _mi, _dr
    if variant not in VARIANTS:
        raise ValueError(f"variant {variant!r}: expected one of {list(VARIANTS)}")
    if _mi is not None:
        if _mi.variant() != variant:
            raise RuntimeError(f"Mitsuba runs as {_mi.variant()} in this process already")
        return
    if libllvm:
        os.environ["DRJIT_LIBLLVM_PATH"] = libllvm
    import drjit
    import mitsuba

    mitsuba.set_variant(variant)
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    if shrink_threads and not variant.startswith("scalar"):
        drjit.set_thread_count(1)
    _mi, _dr = mitsuba, drjit


class Mesh:
    """A mesh that rays can be sent to."""

    def __init__(self, corners: Float[np.ndarray, "f 3 3"]) -> None:
        """Builds the search structure for triangles of any frame."""
        count = len(corners)
        mesh = _mi.Mesh("model", 3 * count, count, has_vertex_texcoords=True)
        values = _mi.traverse(mesh)
        values["vertex_positions"] = np.ascontiguousarray(corners, np.float32).ravel()
        values["faces"] = np.arange(3 * count, dtype=np.uint32)
        # These make a hit's texture coordinates its barycentric ones.
        values["vertex_texcoords"] = np.tile(np.array([0, 0, 1, 0, 0, 1], np.float32), count)
        values.update()
        self._corners = corners
        self._scene = _mi.load_dict({"type": "scene", "model": mesh})

    def cast(self, origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]) -> Hits:
        """The first hit of each ray; `t` counts in lengths of its direction."""
        count = len(directions)
        if not count:
            return Hits(np.zeros(0, np.int64), np.zeros((0, 3), np.float32), np.zeros(0))
        if _mi.variant().startswith("scalar"):
            return self._cast_one_by_one(origins, directions)
        columns = [np.ascontiguousarray(a[:, k], np.float32) for a in (origins, directions)
                   for k in range(3)]  # fmt: skip
        ray = _mi.Ray3f(
            _mi.Point3f(*(_mi.Float(c) for c in columns[:3])),
            _mi.Vector3f(*(_mi.Float(c) for c in columns[3:])),
        )
        found = self._scene.ray_intersect_preliminary(ray, coherent=True)
        _dr.eval(found.t, found.prim_index, found.prim_uv)
        t = np.array(found.t, np.float32)
        face = np.where(np.isfinite(t), np.array(found.prim_index).astype(np.int64), -1)
        # Rays that hit nothing have any numbers here.
        one, two = np.where(face >= 0, np.array(found.prim_uv, np.float32).reshape(2, count), 0)
        return Hits(face, np.stack([1 - one - two, one, two], axis=1), t)

    def _cast_one_by_one(self, origins: np.ndarray, directions: np.ndarray) -> Hits:
        face = np.full(len(directions), -1, np.int64)
        uv = np.zeros((len(directions), 2), np.float32)
        t = np.full(len(directions), np.inf, np.float32)
        scene, ray_of = self._scene, _mi.Ray3f
        for number, (origin, direction) in enumerate(
            zip(origins.tolist(), directions.tolist(), strict=True)
        ):
            found = scene.ray_intersect_preliminary(ray_of(origin, direction), coherent=True)
            if found.is_valid():
                face[number] = found.prim_index
                uv[number] = found.prim_uv
                t[number] = found.t
        return Hits(face, np.stack([1 - uv.sum(axis=1), uv[:, 0], uv[:, 1]], axis=1), t)

    def cast_grid(self, camera: Camera, window: "Window", side: int) -> Hits:
        """The first hits of all samples of a window, through the film: the fast way if scalar."""
        height, width = camera.image_size
        to_model = np.eye(4)
        to_model[:3, :3] = (camera.extrinsics[:, :3] @ camera.rotation).T @ np.diag([-1, -1, 1])
        to_model[:3, 3] = camera.rotation.T @ camera.position
        sensor = _mi.load_dict(
            {
                "type": "perspective",
                "fov": float(2 * np.rad2deg(np.arctan(width / 2 / camera.intrinsics[0, 0]))),
                "fov_axis": "x",
                "near_clip": 1e-3,
                "far_clip": 1e4,
                "to_world": _mi.ScalarTransform4f(to_model),
                "film": {
                    "type": "hdrfilm",
                    "width": width * side,
                    "height": height * side,
                    "crop_offset_x": window.left * side,
                    "crop_offset_y": window.top * side,
                    "crop_width": window.width * side,
                    "crop_height": window.height * side,
                    "component_format": "float32",
                    "rfilter": {"type": "box"},
                },
                "sampler": {"type": "stratified", "sample_count": 1, "jitter": False},
            }
        )
        integrator = _mi.load_dict({"type": "aov", "aovs": "p:position,i:prim_index,b:uv"})
        integrator.render(self._scene, sensor, 0, 1)
        values = np.array(sensor.film().bitmap(), np.float32)[..., -6:].reshape(-1, 6)
        place, uv = values[:, :3].astype(np.float64), values[:, 4:6]
        hit = np.abs(values).max(axis=1) > 0
        t = (place @ camera.rotation.T) @ camera.extrinsics[2, :3] + camera.extrinsics[2, 3]
        return Hits(
            np.where(hit, values[:, 3].round().astype(np.int64), -1),
            np.stack([1 - uv.sum(axis=1), uv[:, 0], uv[:, 1]], axis=1),
            np.where(hit, t, np.inf).astype(np.float32),
        )


@dataclasses.dataclass(frozen=True)
class Window:
    """A part of the image: all that the object can be in."""

    top: int
    left: int
    height: int
    width: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Of the image's rows and columns."""
        return slice(self.top, self.top + self.height), slice(self.left, self.left + self.width)


def window_of(surfaces: Surfaces, camera: Camera) -> Window:
    """The smallest window with all vertices, and a pixel around it."""
    points = surfaces.vertices @ camera.rotation.T
    pixels, _ = cameras.project(points, camera)
    height, width = camera.image_size
    low = np.floor(np.nanmin(pixels, axis=0)).astype(int) - 1
    high = np.ceil(np.nanmax(pixels, axis=0)).astype(int) + 1
    left, right = np.clip([low[0], high[0]], 0, width)
    top, bottom = np.clip([low[1], high[1]], 0, height)
    return Window(int(top), int(left), max(int(bottom - top), 1), max(int(right - left), 1))


def _rays(camera: Camera, columns: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Directions in the view-aligned frame, z = 1 along the optical axis, float32 [n, 3]."""
    k = camera.intrinsics
    y = (rows - k[1, 2]) / k[1, 1]
    x = (columns - k[0, 2] - k[0, 1] * y) / k[0, 0]
    rays = np.stack([x, y, np.ones_like(x)], axis=1) @ camera.extrinsics[:, :3]
    return rays.astype(np.float32)


class _Samples(NamedTuple):
    """What rays see: colour, how much of the background shines through, the first surface."""

    colour: Float[np.ndarray, "n 3"]
    through: Float[np.ndarray, " n"]
    hit: Bool[np.ndarray, " n"]
    owner: Int[np.ndarray, " n"]
    normal: Float[np.ndarray, "n 3"]
    z: Float[np.ndarray, " n"]


def _see(
    mesh: Mesh, scene: Scene, rays: np.ndarray, first: Hits, shade: "_Shade | None" = None
) -> _Samples:
    """Follows rays from the camera, given their first hits, through holes and glass.

    Colours are those of local shading, or of `shade`.
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
        # From behind the hit, with the face's index at hand again if it is met once more.
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
      mask: bool [H, W], pixels whose centre sees the object.
      depth: float32 [H, W] along the optical axis at the pixels' centres, 0 = background.
      normals: float32 [H, W, 3] in the view-aligned frame at the pixels' centres, shading normals
        on the viewer's side, 0 = background.
      opacity: float32 [H, W], how much of each pixel the object hides of what is behind it.
    """

    image: UInt8[np.ndarray, "h w 3"]
    mask: Bool[np.ndarray, "h w"]
    depth: Float[np.ndarray, "h w"]
    normals: Float[np.ndarray, "h w 3"]
    opacity: Float[np.ndarray, "h w"]


def compose(
    premultiplied: Float[np.ndarray, "h w 4"], background: Float[np.ndarray, "..."] | float
) -> UInt8[np.ndarray, "h w 3"]:
    """Colours (already multiplied by their opacity) over a background in [0, 1], as an image."""
    full = premultiplied[..., :3] + (1 - premultiplied[..., 3:]) * background
    return np.rint(255 * np.clip(full, 0, 1)).astype(np.uint8)


def render(mesh: Mesh, scene: Scene, *, side: int = 4, soft_edges: bool = False) -> Picture:
    """Renders a view with local shading.

    Mask, depth and normals are those of the pixels' centres. The colour is a mean over `side` x
    `side` samples: with soft edges over all of the pixel; without (the authors' images) over those
    that see the same material and orientation as the centre, which smooths textures (as mipmaps
    do) and leaves the edges of surfaces and of the object hard.

    Args:
      mesh: of `scene.surfaces.corners`.
      scene: what is seen.
      side: samples along a pixel's edge, 0 = its centre alone.
      soft_edges: whether edges are smoothed, too.
    """
    camera = scene.camera
    height, width = camera.image_size
    window = window_of(scene.surfaces, camera)
    rows, columns = np.mgrid[window.slices].reshape(2, -1)
    scalar = _mi.variant().startswith("scalar")
    turn = camera.rotation.astype(np.float32)
    origin = (camera.position @ camera.rotation).astype(np.float32)

    def cast(rays: np.ndarray) -> Hits:
        return mesh.cast(np.broadcast_to(origin, rays.shape), rays @ turn)

    rays = _rays(camera, columns + 0.5, rows + 0.5)
    first = mesh.cast_grid(camera, window, 1) if scalar else cast(rays)
    centre = _see(mesh, scene, rays, first)
    # Colour, already multiplied by its opacity, and opacity.
    total = np.concatenate([centre.colour, 1 - centre.through[:, None]], axis=1)
    if side > 0 and (soft_edges or scene.surfaces.texture_start.any()):
        # Without soft edges, a pixel off the object is background whatever else it sees, and one
        # on a surface without a texture has one colour.
        textured = scene.surfaces.texture_start[centre.owner] > 0
        chosen = np.arange(len(rows)) if soft_edges else np.flatnonzero(centre.hit & textured)
        offsets = (np.arange(side) + 0.5) / side
        fine_rows = (rows[chosen, None, None] + offsets[:, None]).repeat(side, 2)
        fine_columns = (columns[chosen, None, None] + offsets).repeat(side, 1)
        rays = _rays(camera, fine_columns.ravel(), fine_rows.ravel())
        if scalar:
            whole = mesh.cast_grid(camera, window, side)
            cells = np.arange(len(whole.face)).reshape(window.height, side, window.width, side)
            number = cells.transpose(0, 2, 1, 3).reshape(-1, side * side)[chosen].ravel()
            first = Hits(whole.face[number], whole.weights[number], whole.t[number])
        else:
            first = cast(rays)
        seen = _see(mesh, scene, rays, first)
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


# --- Photographs ------------------------------------------------------------------------------


class _Shade:
    """Colours of hits in linear light: that of the pixels' centres, and more where they differ."""

    def __init__(self, light: photo.Light, scene: Scene, picture: Picture, window: Window) -> None:
        """Finds the light at the centres of the object's pixels."""
        self._light, self._scene = light, scene
        camera = scene.camera
        self._size = (window.height + 2, window.width + 2)
        shape = (*self._size, 3)
        inner = (slice(1, -1), slice(1, -1))
        mask = np.zeros(self._size, np.bool_)
        normal, place = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
        mask[inner] = picture.mask[window.slices]
        normal[inner] = picture.normals[window.slices]
        rows, columns = np.mgrid[window.slices]
        rays = _rays(camera, columns.ravel() + 0.5, rows.ravel() + 0.5)
        depth = picture.depth[window.slices].reshape(-1, 1)
        seen = camera.position.astype(np.float32) + rays * depth
        place[inner] = seen.reshape(window.height, window.width, 3)
        pixel = np.float32(camera.distance / camera.intrinsics[0, 0])
        self._near = 3 * pixel
        at = np.nonzero(mask)
        found = np.zeros(shape, np.float32)
        found[at] = light.gather(place[at], normal[at], at[0] % 4 * 4 + at[1] % 4)
        off = np.full((*self._size, 1), 1.5 * pixel, np.float32)
        guides = np.concatenate([normal, place, off], axis=-1)
        for step in (1, 2):
            found = photo.smooth(found, mask, guides, step=step)
        self._mask, self._found = mask.ravel(), found.reshape(-1, 3)
        self._normal, self._place = normal.reshape(-1, 3), place.reshape(-1, 3)
        self.pixels: Int[np.ndarray, " n"] = np.zeros(0, np.int64)
        """The rays' pixels, as indices of the window grown by a pixel."""

    def pixels_of(self, rows: np.ndarray, columns: np.ndarray) -> Int[np.ndarray, " n"]:
        """Indices of the window's pixels."""
        return (rows + 1) * self._size[1] + columns + 1

    def __call__(
        self,
        at: Int[np.ndarray, " n"],
        fresh: Bool[np.ndarray, " n"],
        place: Float[np.ndarray, "n 3"],
        normal: Float[np.ndarray, "n 3"],
        view: Float[np.ndarray, "n 3"],
        owner: Int[np.ndarray, " n"],
        diffuse: Float[np.ndarray, "n 3"],
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """What the surfaces send to the camera: by their colour, and as mirrors."""
        light = np.zeros((len(at), 3), np.float32)
        pixel = self.pixels[at]
        open_still = np.flatnonzero(fresh)
        for offset in (0, 1, -1, self._size[1], -self._size[1]):
            if not len(open_still):
                break
            of = pixel[open_still] + offset
            off = np.einsum("nd,nd->n", normal[open_still], self._place[of] - place[open_still])
            alike = (
                self._mask[of]
                & (np.einsum("nd,nd->n", normal[open_still], self._normal[of]) > 0.85)
                & (np.abs(off) < self._near)
            )
            light[open_still[alike]] = self._found[of[alike]]
            open_still = open_still[~alike]
        rest = np.ones(len(at), np.bool_)
        rest[fresh] = False
        rest[open_still] = True
        own = np.flatnonzero(rest)
        if len(own):
            # Samples of one pixel that look the same way share their light.
            signs = (normal[own] > 0) @ np.array([1, 2, 4])
            _, some, which = np.unique(
                pixel[own] * 8 + signs, return_index=True, return_inverse=True
            )
            some = own[some]
            pattern = pixel[some] * 7 % photo.PATTERNS
            light[own] = self._light.gather(place[some], normal[some], pattern)[which]
        surfaces, strength = self._scene.surfaces, self._scene.lights.specular
        straight, blur = photo.mirror_of(surfaces, owner, strength)
        glossy = np.flatnonzero(straight.max(axis=1) > 0.002)
        mirrored = np.zeros((len(at), 3), np.float32)
        colour = photo.linear(diffuse)
        if len(glossy):
            cosine = np.einsum("nd,nd->n", normal[glossy], view[glossy])
            part = photo.fresnel(straight[glossy], cosine, blur[glossy])
            mirrored[glossy] = part * self._light.reflect(
                place[glossy], normal[glossy], view[glossy], blur[glossy]
            )
            colour[glossy] *= 1 - straight[glossy]
        return colour * light, mirrored


def photograph(
    mesh: Mesh,
    scene: Scene,
    picture: Picture,
    around: Surroundings,
    ground: Ground | None,
    *,
    film: photo.FilmSettings,
    side: int,
    soft_edges: bool,
    rays: int,
    show_surroundings: bool,
    rng: np.random.Generator,
) -> UInt8[np.ndarray, "h w 3"]:
    """The image of a view with the light of its surroundings, see `data_gen.photo`.

    Args:
      mesh: of `scene.surfaces.corners`.
      scene: what is seen; its directional lights play no part.
      picture: the view as `render` shows it: its mask, depth and normals are used.
      around: the surroundings.
      ground: under the object; None = there is none.
      film: how light becomes an image.
      side: samples along a pixel's edge, 0 = its centre alone.
      soft_edges: whether edges are smoothed.
      rays: that light is looked for with at each pixel.
      show_surroundings: whether they are the background; the scene's background is not needed then.
      rng: of directions, blur and noise.
    """
    camera = scene.camera
    height, width = camera.image_size
    window = window_of(scene.surfaces, camera)
    turn = camera.rotation.astype(np.float32)
    light_rng, film_rng = rng.spawn(2)

    def cast(origins: np.ndarray, directions: np.ndarray) -> Hits:
        return mesh.cast(origins @ turn, directions @ turn)

    light = photo.Light(
        around, ground, scene.surfaces, camera.rotation, cast, rays=rays, rng=light_rng
    )
    shade = _Shade(light, scene, picture, window)
    side = max(side, 1)
    rows, columns = np.mgrid[: window.height, : window.width].reshape(2, -1)
    offsets = (np.arange(side) + 0.5) / side
    fine_rows = (rows[:, None, None] + offsets[:, None]).repeat(side, 2).ravel()
    fine_columns = (columns[:, None, None] + offsets).repeat(side, 1).ravel()
    sent = _rays(camera, fine_columns + window.left, fine_rows + window.top)
    shade.pixels = shade.pixels_of(rows, columns).repeat(side * side)
    if _mi.variant().startswith("scalar"):
        whole = mesh.cast_grid(camera, window, side)
        cells = np.arange(len(whole.face)).reshape(window.height, side, window.width, side)
        number = cells.transpose(0, 2, 1, 3).ravel()
        first = Hits(whole.face[number], whole.weights[number], whole.t[number])
    else:
        origin = camera.position.astype(np.float32)
        first = cast(np.broadcast_to(origin, sent.shape), sent)
    seen = _see(mesh, scene, sent, first, shade)
    colour = np.concatenate([seen.colour, 1 - seen.through[:, None]], axis=1)
    colour = colour.reshape(-1, side * side, 4)
    hit = seen.hit.reshape(-1, side * side)
    if soft_edges:
        total = colour.mean(axis=1)
    else:
        # As the mask has it: the pixel is the object's, as far as its samples are, or not at all.
        count = np.maximum(hit.sum(axis=1), 1)[:, None]
        total = np.where(picture.mask[window.slices].reshape(-1, 1), colour.sum(axis=1) / count, 0)
    full = np.zeros((height, width, 4), np.float32)
    full[window.slices] = total.reshape(window.height, window.width, 4)
    hidden = full[..., 3] > 0.995
    if show_surroundings or ground is not None:
        all_rows, all_columns = np.mgrid[:height, :width].reshape(2, -1)
        rays_of_all = _rays(camera, all_columns + 0.5, all_rows + 0.5)
        behind = photo.backdrop(
            light, around, ground, camera, rays_of_all, hidden,
            blur=float(light_rng.uniform(0, 0.03)),
        )  # fmt: skip
    else:
        level = light.in_the_open(np.array([[1.0, 0, 0]], np.float32))[0].mean()
        behind = photo.linear(np.asarray(scene.background, np.float32)) * level
    image = full[..., :3] + (1 - full[..., 3:]) * behind
    weight = 0.3 + 2.0 * picture.mask * (height * width / max(picture.mask.sum(), 1)) * 0.3
    illuminant = light.in_the_open(np.array([[0.5, 0, 0.866]], np.float32))[0]
    return photo.develop(image, weight, film, film_rng, illuminant=illuminant)


# --- Environment maps -------------------------------------------------------------------------


def load_map(
    path: str | os.PathLike[str], size: tuple[int, int] = MAP_SIZE
) -> Float[np.ndarray, "h w 3"]:
    """An environment map from an .hdr or .exr file, reduced to a size.

    Call it only in a process whose thread pool has not been shrunk: with a single thread, reading
    an EXR never ends. `worker.load_maps` does that.

    Raises:
      ValueError: the file cannot be read, or is not twice as wide as high.
    """
    try:
        bitmap = _mi.Bitmap(str(path)).convert(
            _mi.Bitmap.PixelFormat.RGB, _mi.Struct.Type.Float32, srgb_gamma=False
        )
    except Exception as error:
        raise ValueError(f"environment map {str(path)!r}: {error}"[:300]) from error
    pixels = np.array(bitmap)
    height, width = pixels.shape[:2]
    # Folders of maps often hold pictures of lit balls, too, which would pass for odd surroundings.
    if not 1.8 < width / height < 2.2:
        raise ValueError(
            f"environment map {str(path)!r}: {width} x {height} pixels, expected it twice as wide "
            "as high (latitude and longitude)"
        )
    return shrink(pixels, size)


def sunsky_map(
    turbidity: float,
    sun_elevation_degrees: float,
    albedo: float,
    size: tuple[int, int] = MAP_SIZE,
) -> Float[np.ndarray, "h w 3"]:
    """Mitsuba's model of sun and sky as a map of a size, on grey ground.

    Args:
      turbidity: 1 (clear) to 10 (hazy).
      sun_elevation_degrees: of the sun above the horizon.
      albedo: of the ground.
      size: of the map.
    """
    from data_gen import lights

    elevation = np.deg2rad(sun_elevation_degrees)
    emitter = {
        "type": "sunsky",
        "sun_direction": [float(np.cos(elevation)), 0.0, float(np.sin(elevation))],
        "turbidity": float(turbidity),
        "albedo": float(albedo),
        "sun_scale": 0.0,
        "complex_sun": False,
    }
    scene = _mi.load_dict({"type": "scene", "sky": emitter})
    sky = scene.emitters()[0]
    toward = lights.directions_of(size).reshape(-1, 3)
    values = np.zeros((len(toward), 3))
    above = toward[:, 2] > 0

    def evaluate(away: list[Any]) -> np.ndarray:
        hit = _dr.zeros(_mi.SurfaceInteraction3f)
        hit.wi = _mi.Vector3f(*away)
        return np.array(sky.eval(hit), np.float64)

    if _mi.variant().startswith("scalar"):
        values[above] = [evaluate((-d).tolist()) for d in toward[above]]
    else:
        columns = (-toward[above]).T.astype(np.float32)
        values[above] = evaluate([_mi.Float(np.ascontiguousarray(c)) for c in columns]).T
    grid = values.reshape(*size, 3)
    angles = lights.solid_angles(size)[..., None]
    # The sun is half a degree wide: no map this small holds it. It is added with the energy that
    # makes direct light about four times the sky's on a clear day, less in haze.
    energy = (grid * angles).sum(axis=(0, 1))
    row = int((90 - sun_elevation_degrees) / 180 * size[0])
    warm = np.array([1.0, 0.95, 0.85])
    grid[row, 0] += energy.mean() * warm * 4 / np.sqrt(turbidity) / angles[row, 0]
    below = lights.directions_of(size)[..., 2] <= 0
    grid[below] = albedo * (grid * angles).sum(axis=(0, 1)) / (2 * np.pi) / 2
    return grid


# --- Path tracing -----------------------------------------------------------------------------


def path_trace(
    scene: Scene, radiance: Float[np.ndarray, "h w 3"], *, samples: int, seed: int
) -> Float[np.ndarray, "h w 4"]:
    """Colours with shadows and interreflection, multiplied by their opacity, and opacity.

    Each material becomes one of Mitsuba's, so scenes compile anew: some seconds a model.

    Args:
      scene: what is seen; its directional lights play no part.
      radiance: the environment map, in the view-aligned frame.
      samples: per pixel.
      seed: of the samples.
    """
    surfaces, camera = scene.surfaces, scene.camera
    parts: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": 6, "hide_emitters": True},
    }
    corners = surfaces.corners @ camera.rotation.T.astype(np.float32)
    normals = surfaces.normals @ camera.rotation.T.astype(np.float32)
    for number in np.unique(surfaces.material):
        own = np.flatnonzero(surfaces.material == number)
        height, width = (int(s) for s in surfaces.texture_size[number])
        begin = int(surfaces.texture_start[number])
        texels = surfaces.texels[begin : begin + height * width].view(np.uint8)
        texture = texels.reshape(height, width, 4).astype(np.float32) / 255
        # Mitsuba computes in linear light.
        linear = (texture[..., :3] * surfaces.diffuse[number]) ** 2.2
        alpha = texture[..., 3:] * surfaces.opacity[number]

        def bitmap(values: np.ndarray) -> dict[str, Any]:
            return {
                "type": "bitmap",
                "bitmap": _mi.Bitmap(np.ascontiguousarray(values, np.float32)),
                "raw": True,
                "filter_type": "nearest" if values.size < 16 else "bilinear",
            }

        strength = float(np.clip(surfaces.specular[number].mean() * scene.lights.specular, 0, 1))
        bsdf = {
            "type": "principled",
            "base_color": bitmap(linear),
            "roughness": float(np.clip((2 / (surfaces.shininess[number] + 2)) ** 0.25, 0.1, 1)),
            "specular": strength,
        }
        mesh = _mi.Mesh(
            f"part{number}", 3 * len(own), len(own), has_vertex_normals=True,
            has_vertex_texcoords=True,
            props=_properties({"type": "mask", "opacity": bitmap(alpha),
                               "bsdf": {"type": "twosided", "bsdf": bsdf}}),
        )  # fmt: skip
        values = _mi.traverse(mesh)
        values["vertex_positions"] = np.ascontiguousarray(corners[own]).ravel()
        values["vertex_normals"] = np.ascontiguousarray(normals[own]).ravel()
        # Mitsuba's v runs down from an image's first row, ours up from its last.
        uv = surfaces.uv[own] * np.array([1, -1], np.float32) + np.array([0, 1], np.float32)
        values["vertex_texcoords"] = np.ascontiguousarray(uv, np.float32).ravel()
        values["faces"] = np.arange(3 * len(own), dtype=np.uint32)
        values.update()
        parts[f"part{number}"] = mesh
    # Mitsuba's column u belongs to the direction with atan2(x, -z) = 2 pi u, +y up. Reversed in
    # order, ours belong to its (-y, z, -x); this takes that back to (x, y, z).
    turn = np.eye(4)
    turn[:3, :3] = [[0, 0, -1], [-1, 0, 0], [0, 1, 0]]
    parts["light"] = {
        "type": "envmap",
        "bitmap": _mi.Bitmap(np.ascontiguousarray(radiance[:, ::-1], np.float32)),
        "to_world": _mi.ScalarTransform4f(turn),
    }
    height, width = camera.image_size
    to_world = np.eye(4)
    to_world[:3, :3] = camera.extrinsics[:, :3].T @ np.diag([-1, -1, 1])
    to_world[:3, 3] = camera.position
    sensor = _mi.load_dict(
        {
            "type": "perspective",
            "fov": float(2 * np.rad2deg(np.arctan(width / 2 / camera.intrinsics[0, 0]))),
            "fov_axis": "x",
            "to_world": _mi.ScalarTransform4f(to_world),
            "film": {
                "type": "hdrfilm",
                "width": width,
                "height": height,
                "pixel_format": "rgba",
                "rfilter": {"type": "box"},
            },
            "sampler": {"type": "independent", "sample_count": samples},
        }
    )
    image = _mi.render(_mi.load_dict(parts), sensor=sensor, spp=samples, seed=seed)
    values = np.nan_to_num(np.array(image, np.float32))
    opacity = np.clip(values[..., 3:], 0, 1)
    linear = values[..., :3] / np.maximum(opacity, 1e-3)
    return np.concatenate([np.clip(linear, 0, 1) ** (1 / 2.2) * opacity, opacity], axis=-1)


def _properties(bsdf: dict[str, Any]) -> Any:
    properties = _mi.Properties()
    properties["mesh_bsdf"] = _mi.load_dict(bsdf)
    return properties


def release() -> None:
    """Frees what earlier scenes have left behind."""
    if _dr is not None and not _mi.variant().startswith("scalar"):
        with contextlib.suppress(Exception):
            _dr.flush_malloc_cache()

"""Renders a scene as a photograph, lit by its surroundings."""

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from data_gen import engine
from data_gen.grounds import Ground
from data_gen.photo.backdrop import backdrop
from data_gen.photo.film import FilmSettings, develop
from data_gen.photo.light import PATTERNS, Light, fresnel, linear, mirror_of
from data_gen.photo.smoothing import smooth
from data_gen.picture import Picture, follow_rays
from data_gen.ray_mesh import Mesh, Window, camera_rays, window_of
from data_gen.scene import RayHits, Scene
from data_gen.surroundings import Surroundings


class _Shade:
    """Linear colours of hits. Irradiance is computed at the centres of pixels and reused.

    A sample that hits a different surface than the centre of its pixel gets its own estimate.
    """

    def __init__(self, light: Light, scene: Scene, picture: Picture, window: Window) -> None:
        """Computes the irradiance at the centres of the object's pixels."""
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
        rays = camera_rays(camera, columns.ravel() + 0.5, rows.ravel() + 0.5)
        depth = picture.depth[window.slices].reshape(-1, 1)
        seen = camera.position.astype(np.float32) + rays * depth
        place[inner] = seen.reshape(window.height, window.width, 3)
        pixel = np.float32(camera.distance / camera.intrinsics[0, 0])
        self._near = 3 * pixel
        at = np.nonzero(mask)
        light_at = np.zeros(shape, np.float32)
        light_at[at] = light.gather(place[at], normal[at], at[0] % 4 * 4 + at[1] % 4)
        off = np.full((*self._size, 1), 1.5 * pixel, np.float32)
        guides = np.concatenate([normal, place, off], axis=-1)
        for step in (1, 2):
            light_at = smooth(light_at, mask, guides, step=step)
        self._mask, self._light_at = mask.ravel(), light_at.reshape(-1, 3)
        self._normal, self._place = normal.reshape(-1, 3), place.reshape(-1, 3)
        self.pixels: Int[np.ndarray, " n"] = np.zeros(0, np.int64)
        """The pixels of the rays, as indices of the window padded by one pixel."""

    def pixels_of(self, rows: np.ndarray, columns: np.ndarray) -> Int[np.ndarray, " n"]:
        """Indices of pixels of the window."""
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
        """Radiance toward the camera: diffuse, and reflected."""
        light = np.zeros((len(at), 3), np.float32)
        pixel = self.pixels[at]
        open_still = np.flatnonzero(fresh)
        for offset in (0, 1, -1, self._size[1], -self._size[1]):
            if not len(open_still):
                break
            neighbour = pixel[open_still] + offset
            off = np.einsum(
                "nd,nd->n", normal[open_still], self._place[neighbour] - place[open_still]
            )
            alike = (
                self._mask[neighbour]
                & (np.einsum("nd,nd->n", normal[open_still], self._normal[neighbour]) > 0.85)
                & (np.abs(off) < self._near)
            )
            light[open_still[alike]] = self._light_at[neighbour[alike]]
            open_still = open_still[~alike]
        rest = np.ones(len(at), np.bool_)
        rest[fresh] = False
        rest[open_still] = True
        own = np.flatnonzero(rest)
        if len(own):
            # Samples of a pixel whose normals are in the same octant share their irradiance.
            signs = (normal[own] > 0) @ np.array([1, 2, 4])
            _, some, which = np.unique(
                pixel[own] * 8 + signs, return_index=True, return_inverse=True
            )
            some = own[some]
            pattern = pixel[some] * 7 % PATTERNS
            light[own] = self._light.gather(place[some], normal[some], pattern)[which]
        surfaces, strength = self._scene.surfaces, self._scene.lights.specular
        straight, blur = mirror_of(surfaces, owner, strength)
        glossy = np.flatnonzero(straight.max(axis=1) > 0.002)
        mirrored = np.zeros((len(at), 3), np.float32)
        colour = linear(diffuse)
        if len(glossy):
            cosine = np.einsum("nd,nd->n", normal[glossy], view[glossy])
            part = fresnel(straight[glossy], cosine, blur[glossy])
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
    film: FilmSettings,
    side: int,
    soft_edges: bool,
    rays: int,
    show_surroundings: bool,
    rng: np.random.Generator,
) -> UInt8[np.ndarray, "h w 3"]:
    """The image of a view lit by its surroundings, see `data_gen.photo`.

    Args:
      mesh: the mesh of `scene.surfaces.corners`.
      scene: the scene; its directional lights are ignored.
      picture: the view as rendered by `render`: its mask, depth and normals are used.
      around: the surroundings.
      ground: the ground under the object; None = there is none.
      film: the response of the camera.
      side: samples along the edge of a pixel, 0 = only its centre.
      soft_edges: whether edges are antialiased.
      rays: number of rays per pixel that sample the light.
      show_surroundings: whether the surroundings replace the background of the scene.
      rng: generator of directions, blur and noise.
    """
    camera = scene.camera
    height, width = camera.image_size
    window = window_of(scene.surfaces, camera)
    turn = camera.rotation.astype(np.float32)
    light_rng, film_rng = rng.spawn(2)

    def cast(origins: np.ndarray, directions: np.ndarray) -> RayHits:
        return mesh.cast(origins @ turn, directions @ turn)

    light = Light(around, ground, scene.surfaces, camera.rotation, cast, rays=rays, rng=light_rng)
    shade = _Shade(light, scene, picture, window)
    side = max(side, 1)
    rows, columns = np.mgrid[: window.height, : window.width].reshape(2, -1)
    offsets = (np.arange(side) + 0.5) / side
    fine_rows = (rows[:, None, None] + offsets[:, None]).repeat(side, 2).ravel()
    fine_columns = (columns[:, None, None] + offsets).repeat(side, 1).ravel()
    sent = camera_rays(camera, fine_columns + window.left, fine_rows + window.top)
    shade.pixels = shade.pixels_of(rows, columns).repeat(side * side)
    if engine.mi.variant().startswith("scalar"):
        whole = mesh.cast_grid(camera, window, side)
        cells = np.arange(len(whole.face)).reshape(window.height, side, window.width, side)
        number = cells.transpose(0, 2, 1, 3).ravel()
        first = RayHits(whole.face[number], whole.weights[number], whole.t[number])
    else:
        origin = camera.position.astype(np.float32)
        first = cast(np.broadcast_to(origin, sent.shape), sent)
    seen = follow_rays(mesh, scene, sent, first, shade)
    colour = np.concatenate([seen.colour, 1 - seen.through[:, None]], axis=1)
    colour = colour.reshape(-1, side * side, 4)
    hit = seen.hit.reshape(-1, side * side)
    if soft_edges:
        total = colour.mean(axis=1)
    else:
        # Hard edges: a pixel outside the mask shows only the background.
        count = np.maximum(hit.sum(axis=1), 1)[:, None]
        total = np.where(picture.mask[window.slices].reshape(-1, 1), colour.sum(axis=1) / count, 0)
    full = np.zeros((height, width, 4), np.float32)
    full[window.slices] = total.reshape(window.height, window.width, 4)
    hidden = full[..., 3] > 0.995
    if show_surroundings or ground is not None:
        all_rows, all_columns = np.mgrid[:height, :width].reshape(2, -1)
        rays_of_all = camera_rays(camera, all_columns + 0.5, all_rows + 0.5)
        behind = backdrop(
            light, around, ground, camera, rays_of_all, hidden,
            blur=float(light_rng.uniform(0, 0.03)),
        )  # fmt: skip
    else:
        level = light.in_the_open(np.array([[1.0, 0, 0]], np.float32))[0].mean()
        behind = linear(np.asarray(scene.background, np.float32)) * level
    image = full[..., :3] + (1 - full[..., 3:]) * behind
    weight = 0.3 + 2.0 * picture.mask * (height * width / max(picture.mask.sum(), 1)) * 0.3
    illuminant = light.in_the_open(np.array([[0.5, 0, 0.866]], np.float32))[0]
    return develop(image, weight, film, film_rng, illuminant=illuminant)

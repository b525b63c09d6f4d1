"""Images that look like photographs: Mitsuba traces a few paths, a filter removes the noise.

Colours are linear until `develop`. Positions are in the view-aligned frame.
"""

import dataclasses
from typing import Any

import numpy as np
import scipy.ndimage
from jaxtyping import Bool, Float, UInt8

from data_gen import engine, lights
from data_gen.cameras import Camera, turn_about_vertical
from data_gen.picture import BACKGROUND, Picture, Scene, render, sample_rays
from data_gen.settings import FilmSettings, Settings
from data_gen.surroundings import TEXELS, Ground, Surroundings, draw_ground

_BRIGHTEST = 6.0  # multiple of white at which we clip before the lens blur
_DARKEST = 0.03  # smallest reflectance by which we divide colours


def photograph(
    scene: Scene, around: Surroundings, settings: Settings, rng: np.random.Generator
) -> Picture:
    """Renders a view of a scene, lit by its surroundings; see `picture.render`."""
    image, picture, ground = settings.image, render(scene, side=0), None
    if image.ground != "none" and scene.camera.position[2] >= 0.03:  # the camera is above it
        ground = draw_ground(rng, image.ground, around)
    visible = image.background == "surroundings"
    seed, blur = int(rng.integers(1 << 31)), float(rng.uniform(0, 0.03))
    light, opacity = trace(scene, picture, around, ground, image.rays, seed)
    mask = picture.mask
    weight = mask + 1e-6  # of pixels, in the exposure
    if visible:
        weight = 0.3 + 0.6 * mask * mask.size / max(mask.sum(), 1)
        light = light + (1 - opacity) * backdrop(around.radiance, scene.camera, blur)
    up = np.maximum(lights.directions_of(around.radiance.shape[:2])[..., 2:], 0)
    illuminant = (around.radiance * up).mean(axis=(0, 1))
    taken = develop(light, weight, settings.film, rng, illuminant=illuminant)
    if not visible:
        taken = np.rint(taken * opacity + 255 * BACKGROUND * (1 - opacity)).astype(np.uint8)
    return picture._replace(image=taken)


def backdrop(
    radiance: Float[np.ndarray, "h w 3"], camera: Camera, blur: float
) -> Float[np.ndarray, "h w 3"]:
    """The image of the surroundings without object and ground, blurred by an angle [rad]."""
    height, width = camera.image_size
    rays = sample_rays(camera, (slice(0, height), slice(0, width)), 1).reshape(height, width, 3)
    up = rays[..., 2] / np.linalg.norm(rays, axis=-1)
    turns = np.arctan2(rays[..., 1], rays[..., 0]) / (2 * np.pi) % 1
    spread = (blur / np.pi * len(radiance),) * 2
    smoothed = scipy.ndimage.gaussian_filter(radiance, (*spread, 0), mode="wrap")
    at = [np.arccos(up) / np.pi * len(radiance) - 0.5, turns * radiance.shape[1] - 0.5]
    channels = np.moveaxis(smoothed, 2, 0)
    values = [scipy.ndimage.map_coordinates(c, at, order=1, mode="grid-wrap") for c in channels]
    return np.stack(values, axis=-1).astype(np.float32)


def trace(
    scene: Scene, view: Picture, around: Surroundings, ground: Ground | None, rays: int, seed: int
) -> tuple[Float[np.ndarray, "h w 3"], Float[np.ndarray, "h w 1"]]:
    """Radiance of object and ground times their opacity, and the opacity.

    All light comes from the surroundings. We trace `rays` paths per pixel. `view` is the result of
    `picture.render`.
    """
    mi, camera = engine.mi, scene.camera
    # In Mitsuba's maps +y is up, and column u shows the direction with atan2(x, -z) = 2 pi u. With
    # reversed columns of our map, our direction (x, y, z) is Mitsuba's direction (-y, z, -x); this
    # rotation reverts that.
    to_map, to_world = np.eye(4), np.eye(4)
    to_map[:3, :3] = [[0, 0, -1], [-1, 0, 0], [0, 1, 0]]
    to_world[:3, :3] = camera.extrinsics[:, :3].T @ np.diag([-1, -1, 1])
    to_world[:3, 3] = camera.position
    height, width = camera.image_size
    parts = {
        "type": "scene",
        "integrator": {
            "type": "aov", "aovs": "a:albedo,n:sh_normal,p:position",
            "colour": {"type": "path", "max_depth": 5, "hide_emitters": True},
        },
        "light": {
            "type": "envmap",
            "bitmap": mi.Bitmap(np.ascontiguousarray(around.radiance[:, ::-1], np.float32)),
            "to_world": mi.ScalarTransform4f(to_map),
        },
        "camera": {
            "type": "perspective",
            "fov": float(2 * np.rad2deg(np.arctan(width / 2 / camera.intrinsics[0, 0]))),
            "fov_axis": "x",
            "to_world": mi.ScalarTransform4f(to_world),
            "film": {"type": "hdrfilm", "width": width, "height": height, "pixel_format": "rgba",
                     "rfilter": {"type": "box"}},
            "sampler": {"type": "independent"},
        },
        "object": _object(scene),
    }  # fmt: skip
    if ground is not None:
        parts["ground"] = _strip(ground)
    values = np.array(mi.render(mi.load_dict(parts), spp=rays, seed=seed), np.float32)
    values = np.nan_to_num(values, posinf=0, neginf=0)
    colour, opacity, albedo, normal, position = np.split(values, [3, 4, 7, 10], axis=-1)
    # A pixel is whole if it shows a single surface, and nothing through a hole of a texture.
    whole = np.linalg.norm(normal, axis=-1) > 0.8
    depth = position @ camera.extrinsics[2, :3] + camera.extrinsics[2, 3]
    ours = (np.linalg.norm(position, axis=-1) < 1.05) & (position[..., 2] > 1e-3)
    hole = ours & whole & (depth < np.where(view.mask, view.depth, np.inf) - 0.02)
    hole &= not scene.mesh.arrays.opaque
    whole &= ~hole
    # We filter light in place of colours, so that textures stay sharp. The few paths that meet a
    # bright reflection would be white pixels.
    bounded = np.maximum(albedo, _DARKEST)
    light = colour / bounded
    light = np.minimum(light, 3 * scipy.ndimage.median_filter(light, (3, 3, 1)) + 1e-3)
    # At edges, a pixel shows the light of several surfaces.
    edge = ~whole & ~hole & (opacity[..., 0] > 0)
    mixed = smooth(light * bounded, edge) / np.maximum(smooth(albedo, edge), 1e-3)
    off = np.full((*whole.shape, 1), 2 * camera.distance / camera.intrinsics[0, 0], np.float32)
    guides = np.concatenate([normal, position, off], axis=-1)
    for step in (1, 2):
        light = smooth(light, whole, guides, step=step)
    result = np.where(whole[..., None], light * bounded, mixed * albedo)
    return np.where(hole[..., None], colour, result), np.clip(opacity, 0, 1)


def _bitmap(values: np.ndarray) -> dict[str, Any]:
    bitmap = engine.mi.Bitmap(np.ascontiguousarray(values, np.float32))
    return {"type": "bitmap", "bitmap": bitmap, "raw": True, "filter_type": "nearest"}


def _object(scene: Scene) -> Any:
    """The object as a mesh of Mitsuba. Its texture is the stack of the materials' textures.

    For each number of meshes in a scene, Mitsuba compiles again.
    """
    arrays = scene.mesh.arrays
    uv = arrays.uv.copy()
    uv[..., 1] -= np.floor(uv[..., 1].min(axis=1, keepdims=True))
    used = np.unique(arrays.material)
    side = TEXELS if (arrays.texture_start[used] > 0).sum() <= 4 else TEXELS // 2
    metal, rough = np.zeros((2, len(arrays.material)), np.float32)
    stack, start = [], 0
    for number in used:
        own = arrays.material == number
        size, begin = arrays.texture_size[number], arrays.texture_start[number]
        texels = arrays.texels[begin : begin + size.prod()].view(np.uint8)
        height = side if begin else 1
        # Along columns, Mitsuba repeats the stack; along rows, the stack contains the repetitions.
        repeats = np.clip(np.ceil(uv[own, :, 1].max()), 1, 16)
        rows = (np.arange(height) * repeats * size[0] / height).astype(int) % size[0]
        columns = np.arange(side) * size[1] // side
        texture = texels.reshape(*size, 4)[rows[:, None], columns].astype(np.float32) / 255
        down = np.clip(1 - uv[own, :, 1] / repeats, 0, 1) if begin else 0.5
        uv[own, :, 1] = start + 0.01 + down * (height - 0.02)
        start += height
        # A material is metal if its specular colour is stronger than its diffuse colour.
        specular = np.clip(arrays.specular[number] * scene.lights.specular, 0, 1)
        bright, diffuse = specular.mean(), arrays.diffuse[number]
        metal[own] = share = np.clip(2 * bright - 1.5 * diffuse.mean(), 0, 1)
        width = (2 / (arrays.shininess[number] + 2)) ** 0.25
        rough[own] = np.clip(max(width, 1 - 2.5 * bright), 0.2, 1)
        # No material is black or white.
        colour = np.maximum(0.82 * (texture[..., :3] * diffuse) ** 2.2, 0.015)
        colour = (1 - share) * colour + share * 0.8 * specular
        stack.append(np.dstack([colour, texture[..., 3] * arrays.opacity[number]]))
    uv[..., 1] /= start
    values = np.concatenate(stack)
    bsdf = {"type": "twosided", "bsdf": {
        "type": "principled", "base_color": _bitmap(values[..., :3]), "specular": 0.4,
        "roughness": {"type": "mesh_attribute", "name": "face_roughness"},
        "metallic": {"type": "mesh_attribute", "name": "face_metallic"},
    }}  # fmt: skip
    if not arrays.opaque:
        bsdf = {"type": "mask", "opacity": _bitmap(values[..., 3:]), "bsdf": bsdf}
    turn = scene.camera.rotation.T.astype(np.float32)
    mesh = engine.mesh(arrays.corners @ turn, uv, arrays.normals @ turn, bsdf)
    mesh.add_attribute("face_roughness", 1, rough)
    mesh.add_attribute("face_metallic", 1, metal)
    return mesh


def _strip(ground: Ground) -> Any:
    """The ground as a mesh of Mitsuba."""
    x, z = ground.profile.T
    along = np.concatenate([[0], np.hypot(np.diff(x), np.diff(z)).cumsum()]) + x[0]
    edge = np.stack(np.broadcast_arrays(x[:, None], [-ground.half_width, ground.half_width],
                                        z[:, None]), axis=-1)  # fmt: skip
    uv = np.stack(np.broadcast_arrays(along[:, None], edge[..., 1]), axis=-1) / ground.size
    tangent = np.gradient(ground.profile, axis=0)
    normal = np.stack([-tangent[:, 1], 0 * x, tangent[:, 0]], axis=1)
    normal = np.repeat((normal / np.linalg.norm(normal, axis=1, keepdims=True))[:, None], 2, axis=1)
    turn = turn_about_vertical(ground.turn).T
    bsdf = {
        "type": "principled", "base_color": _bitmap(ground.texture), "roughness": 0.45,
        "specular": max(ground.gloss, 0.01),
    }  # fmt: skip

    def faces(values: np.ndarray) -> np.ndarray:
        one = np.stack([values[:-1, 0], values[1:, 0], values[1:, 1]], axis=1)
        two = np.stack([values[:-1, 0], values[1:, 1], values[:-1, 1]], axis=1)
        return np.concatenate([one, two])

    return engine.mesh(faces(edge @ turn), faces(uv), faces(normal @ turn), bsdf)


def smooth(
    values: Float[np.ndarray, "h w 3"],
    valid: Bool[np.ndarray, "h w"],
    guides: Float[np.ndarray, "h w 7"] | None = None,
    *,
    step: int = 1,
) -> Float[np.ndarray, "h w 3"]:
    """Weighted means over 5 x 5 pixels of the same surface, `step` apart.

    `guides` has for each pixel a normal n, a position p and a tolerance: another pixel is on the
    same surface if its normal is similar, and its distance to the plane through p with normal n is
    below `step` times the tolerance.
    """
    for axis in (0, 1):
        size = valid.shape[axis]
        total, weight = np.zeros_like(values), np.zeros((*valid.shape, 1), np.float32)
        for offset, share in zip((-2, -1, 0, 1, 2), (0.5, 1, 1, 1, 0.5), strict=True):
            here, there = [slice(None)] * 2, [slice(None)] * 2
            move = offset * step
            here[axis] = slice(max(0, -move), min(size, size - move))
            there[axis] = slice(max(0, move), min(size, size + move))
            at, source = tuple(here), tuple(there)
            part = share * (valid[at] & valid[source]).astype(np.float32)
            if guides is not None and offset:
                mine, its = guides[at], guides[source]
                normal = mine[..., :3]
                same = np.einsum("hwd,hwd->hw", normal, its[..., :3])
                off = np.abs(np.einsum("hwd,hwd->hw", normal, mine[..., 3:6] - its[..., 3:6]))
                part = part * np.clip(10 * same - 8.5, 0, 1) * (off < mine[..., 6] * step)
            total[at] += part[..., None] * values[source]
            weight[at] += part[..., None]
        values = total / np.maximum(weight, 1e-6)
    return values


def develop(
    light: Float[np.ndarray, "h w 3"],
    weight: Float[np.ndarray, "h w"],
    settings: FilmSettings,
    rng: np.random.Generator,
    *,
    illuminant: Float[np.ndarray, " 3"],
) -> UInt8[np.ndarray, "h w 3"]:
    """The image that a camera takes of linear radiance; `illuminant` is the colour of the light.

    `weight` is the weight of each pixel in the exposure.
    """
    height, width = weight.shape
    ranges = dataclasses.asdict(settings).items()
    draw = {name: float(rng.uniform(*between)) for name, between in ranges}
    shift = 1 + 0.02 * rng.standard_normal(3)
    balance = (illuminant.mean() / np.maximum(illuminant, 1e-6)) ** draw["white_balance"] * shift
    values = light * balance.astype(np.float32)
    grey = values.mean(axis=-1)
    middle = np.exp((np.log(grey + 1e-4 * grey.max() + 1e-9) * weight).sum() / weight.sum())
    gain = 0.2 * 2 ** draw["exposure"] / middle
    # A large fraction of the image must not be white.
    bright = max(float(np.quantile(grey, 0.93)), 1e-9)
    gain = min(gain, 1.4 * 2 ** max(draw["exposure"], 0) / bright)
    values = np.clip(values * np.float32(gain), 0, _BRIGHTEST)
    rows, columns = np.mgrid[:height, :width]
    away = np.hypot(rows / height - 0.5, columns / width - 0.5)[..., None]
    values = values * (1 - draw["vignette"] * 2 * away**2).astype(np.float32)
    values = scipy.ndimage.gaussian_filter(values, (draw["blur"], draw["blur"], 0))
    # Shot noise grows with the square root of the light; read noise is constant.
    spread = draw["grain"] * np.sqrt(0.05 + values / 0.2).astype(np.float32) * 0.4
    values = np.maximum(values + spread * rng.standard_normal(values.shape, np.float32), 0)
    # A linear curve with a soft shoulder, and a film curve (Narkowicz 2015).
    plain = np.where(values < 0.6, values, 1 - 0.4 * np.exp(-(values - 0.6) / 0.4))
    x = values * np.float32(0.75)
    film = x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)
    mixed = plain + draw["contrast"] * (film - plain)
    grey = mixed.mean(axis=-1, keepdims=True)
    mixed = grey + np.float32(draw["saturation"]) * (mixed - grey)
    return np.rint(255 * np.clip(mixed, 0, 1) ** (1 / 2.2)).astype(np.uint8)

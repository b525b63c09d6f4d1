"""The image behind the object: ground, shadow and surroundings."""

import numpy as np
from jaxtyping import Bool, Float

from data_gen import grounds
from data_gen.cameras import Camera
from data_gen.grounds import Ground
from data_gen.photo.light import Light, blurred, fresnel, look_around
from data_gen.photo.smoothing import smooth
from data_gen.surroundings import Surroundings


def backdrop(
    light: Light,
    around: Surroundings,
    ground: Ground | None,
    camera: Camera,
    rays: Float[np.ndarray, "n 3"],
    hidden: Bool[np.ndarray, "h w"],
    *,
    blur: float,
) -> Float[np.ndarray, "h w 3"]:
    """The image of ground and surroundings without the object but with its shadow.

    Deliberately one function: each step handles pixels that the earlier steps have not set.

    Args:
      light: light of the scene.
      around: the surroundings.
      ground: the ground; None = there is none.
      camera: camera of the view.
      rays: rays through the centres of the pixels, z = 1 along the optical axis.
      hidden: pixels that the object hides; their values are arbitrary.
      blur: blur of distant surroundings, in radians.
    """
    height, width = camera.image_size
    origin = camera.position.astype(np.float32)
    length = np.linalg.norm(rays, axis=1)
    along = rays / length[:, None]
    beyond = along
    if around.room is not None:
        beyond = _on_walls(around, origin, along)
    radiance = around.radiance
    if blur > 0:
        radiance = blurred(radiance, blur)
    result = look_around(radiance, beyond)
    if ground is None:
        return result.reshape(height, width, 3)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(along[:, 2] < -1e-4, -origin[2] / along[:, 2], np.inf)
    down = np.flatnonzero(np.isfinite(reach) & (reach < 400))
    t = reach[down]
    place = origin[:2] + t[:, None] * along[down, :2]
    held = ground.holds(place)
    # Antialiased edges: the coverage of a pixel is the mean over nine points in it.
    share = np.ones(len(down), np.float32)
    focal = np.float32(camera.intrinsics[0, 0])
    grazing = np.maximum(-along[down, 2], 0.01)
    if np.isfinite(ground.half).any():
        share[:] = 0
        side = np.cross(along[down], [0, 0, 1.0])[:, :2]
        front = np.stack([side[:, 1], -side[:, 0]], axis=1)
        for a in (-1, 0, 1):
            for b in (-1, 0, 1):
                moved = place + (a * side + b * front / grazing[:, None]) * (t / focal / 3)[:, None]
                share += ground.holds(moved) / np.float32(9)
        held = share > 0
    down, t, place, share, grazing = (a[held] for a in (down, t, place, share, grazing))
    points = np.concatenate([place, np.zeros((len(place), 1))], axis=1).astype(np.float32)
    rows, columns = np.divmod(down, width)
    up = np.broadcast_to(np.array([0, 0, 1], np.float32), points.shape)
    lit = np.tile(light.open_ground, (len(points), 1))
    near = np.flatnonzero((np.linalg.norm(place, axis=1) < 4.0) & ~hidden.ravel()[down])
    pattern = (rows % 4 * 4 + columns % 4)[near]
    lit[near] = light.gather(points[near], up[near], pattern, far=True)
    colour = ground.colour(place.astype(np.float32), t / focal / np.sqrt(grazing))
    seen = np.zeros((height * width, 3), np.float32)
    valid = np.zeros(height * width, np.bool_)
    seen[down], valid[down] = lit, True
    valid &= ~hidden.ravel()
    lit_image = smooth(seen.reshape(height, width, 3), valid.reshape(height, width), None)
    lit = lit_image.reshape(-1, 3)[down]
    value = colour * lit
    if ground.gloss > 0:
        view = -along[down]
        # Floors are worn: reflections are blurred, and more so if the object is far from the floor.
        rough = np.full(len(down), 0.25, np.float32)
        mirror = fresnel(np.full((len(down), 3), ground.gloss, np.float32), view[:, 2], rough)
        uneven = up + light.spread[rows % 4 * 4 + columns % 4] * np.float32(0.06)
        uneven /= np.linalg.norm(uneven, axis=1, keepdims=True)
        seen[:], valid[:] = 0, False
        seen[down], valid[down] = 0.6 * mirror * light.reflect(points, uneven, view, rough), True
        seen_image = smooth(seen.reshape(height, width, 3), valid.reshape(height, width), None)
        value += seen_image.reshape(-1, 3)[down]
    if ground.sweep > 0:
        # Paper that curves upward behind the object, lit like a surface that faces the camera.
        wall = ground.mean * light.in_the_open(np.array([[1.0, 0.0, 0.0]], np.float32))
        bend = np.clip((-place[:, 0] - ground.sweep) / (2 * ground.sweep), 0, 1)[:, None]
        value = value * (1 - bend**2 * (3 - 2 * bend)) + wall * bend**2 * (3 - 2 * bend)
        rise = np.clip(along[:, 2:3] * 1.5, 0, 0.4)
        result = np.broadcast_to(wall, result.shape) * (1 - rise)
    elif not np.isfinite(ground.half).any():
        haze = (1 - np.exp(-((t / 80) ** 2)))[:, None]
        middle = len(radiance) // 2
        level = np.median(radiance[middle - max(middle // 30, 1) : middle], axis=(0, 1))
        value = value * (1 - haze) + haze * level
    result[down] += share[:, None] * (value - result[down])
    return result.reshape(height, width, 3)


def _on_walls(around: Surroundings, origin: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Directions from the object to the points where rays from another origin meet the walls."""
    room = around.room
    assert room is not None
    angle = np.deg2rad(room.turn)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0],
                     [0, 0, 1]], np.float32)  # fmt: skip
    start, ray = origin @ turn, along @ turn
    high = np.array([*room.half, room.ceiling], np.float32)
    low = np.array([-room.half[0], -room.half[1], min(room.floor, -1e-3)], np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        leave = np.fmax((low - start) / ray, (high - start) / ray).min(axis=1)
    place = start + np.maximum(leave, 1e-3)[:, None] * ray
    place = place @ turn.T
    result: np.ndarray = place / np.maximum(np.linalg.norm(place, axis=1, keepdims=True), 1e-6)
    return result.astype(np.float32)


def draw_ground(
    rng: np.random.Generator, kind: str, around: Surroundings, camera: Camera
) -> Ground | None:
    """The ground of a view; None if the kind is "none" or the camera is below the ground."""
    if kind == "none" or camera.position[2] < 0.03:
        return None
    return grounds.draw(rng, kind, around)

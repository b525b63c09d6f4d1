"""Samples for tests: analytic solids on the ground, drawn with plain numpy in milliseconds.

Boxes, ellipsoids, cylinders, cones and tori of random proportions and poses, seen by the authors'
camera (`camera.default_camera`) on their grey background, with exact depth, mask, surface points
and normals.
"""

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from psgn_jax.data import augment, camera, schema

DEFAULT_IMAGE_SIZE = (192, 256)
NUM_POINTS = 4096

_MISS = np.inf


class Solid(NamedTuple):
    """A solid around the origin; its axis is z."""

    category: str
    height: float  # along z
    sample: Callable  # (rng, n) -> points [n, 3] uniform on the surface
    # (origin [3], directions [n, 3]) -> parameter t [n] of the first hit at origin + t * direction
    # (inf = none), and outward normals [n, 3] there. The origin is outside.
    cast: Callable


def _unit(v: np.ndarray) -> np.ndarray:
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12)


def _smaller_root(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """First root of a t^2 + 2 b t + c with a > 0; inf where there is none or it is behind."""
    discriminant = b * b - a * c
    root = (-b - np.sqrt(np.maximum(discriminant, 0))) / np.maximum(a, 1e-12)
    return np.where((discriminant > 0) & (root > 0), root, _MISS)


def _disc(rng: np.random.Generator, n: int) -> np.ndarray:
    """Uniform points [n, 2] in the unit disc."""
    angle, radius = rng.uniform(0, 2 * np.pi, n), np.sqrt(rng.random(n))
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def box(half: np.ndarray) -> Solid:
    """A box of half extents `half` [3]."""

    def sample(rng: np.random.Generator, n: int) -> np.ndarray:
        areas = np.array([half[1] * half[2], half[0] * half[2], half[0] * half[1]])
        axis = rng.choice(3, n, p=areas / areas.sum())
        sign = rng.choice([-1.0, 1.0], n)
        points = rng.uniform(-1, 1, (n, 3)) * half
        points[np.arange(n), axis] = sign * half[axis]
        return points

    def cast(origin: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        safe = np.where(np.abs(directions) < 1e-12, 1e-12, directions)
        ends = (np.stack([-half, half])[:, None] - origin) / safe
        near, far = ends.min(axis=0), ends.max(axis=0)
        axis = near.argmax(axis=1)
        t = near.max(axis=1)
        hit = (t <= far.min(axis=1)) & (t > 0)
        normals = np.zeros_like(directions)
        rows = np.arange(len(directions))
        normals[rows, axis] = -np.sign(directions[rows, axis])
        return np.where(hit, t, _MISS), normals

    return Solid("box", 2 * float(half[2]), sample, cast)


def ellipsoid(half: np.ndarray) -> Solid:
    """An ellipsoid of half axes `half` [3]."""

    def sample(rng: np.random.Generator, n: int) -> np.ndarray:
        # The map from the unit sphere scales the area around u by abc |u / half|. Points are
        # accepted with a probability proportional to this factor.
        kept: list[np.ndarray] = []
        while sum(map(len, kept)) < n:
            u = _unit(rng.normal(size=(2 * n, 3)))
            accept = rng.random(2 * n) < np.linalg.norm(u / half, axis=1) * half.min()
            kept.append(u[accept])
        u = np.concatenate(kept)[:n]
        return u * half

    def cast(origin: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        o, d = origin / half, directions / half
        t = _smaller_root((d * d).sum(axis=1), d @ o, np.asarray(o @ o - 1))
        where = np.where(np.isfinite(t), t, 0)[:, None]
        return t, _unit((o + where * d) / half)

    return Solid("ellipsoid", 2 * float(half[2]), sample, cast)


def _cap(origin: np.ndarray, directions: np.ndarray, height: float, radius: float) -> np.ndarray:
    """Hits of the horizontal disc of `radius` at z = `height`."""
    down = np.where(np.abs(directions[:, 2]) < 1e-12, 1e-12, directions[:, 2])
    t = (height - origin[2]) / down
    across = origin[:2] + t[:, None] * directions[:, :2]
    hit = ((across**2).sum(axis=1) <= radius**2) & (t > 0)
    return np.where(hit, t, _MISS)


def cylinder(radius: float, height: float) -> Solid:
    """A closed cylinder."""
    up = np.array([0.0, 0, 1])

    def sample(rng: np.random.Generator, n: int) -> np.ndarray:
        on_side = rng.random(n) < height / (height + radius)
        angle = rng.uniform(0, 2 * np.pi, n)
        ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        top = rng.choice([-1.0, 1.0], n)
        side = np.concatenate([radius * ring, rng.uniform(-0.5, 0.5, (n, 1)) * height], axis=1)
        cap = np.concatenate([radius * _disc(rng, n), top[:, None] * height / 2], axis=1)
        return np.where(on_side[:, None], side, cap)

    def cast(origin: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        o, d = origin[:2], directions[:, :2]
        side = _smaller_root((d * d).sum(axis=1), d @ o, np.asarray(o @ o - radius**2))
        z = origin[2] + np.where(np.isfinite(side), side, 0) * directions[:, 2]
        side = np.where(np.abs(z) <= height / 2, side, _MISS)
        top = _cap(origin, directions, height / 2, radius)
        bottom = _cap(origin, directions, -height / 2, radius)
        t = np.minimum(side, np.minimum(top, bottom))
        where = origin + np.where(np.isfinite(t), t, 0)[:, None] * directions
        normals = _unit(where * [1, 1, 0])
        normals[t == bottom] = -up
        normals[t == top] = up
        normals[t == side] = _unit(where * [1, 1, 0])[t == side]
        return t, normals

    return Solid("cylinder", height, sample, cast)


def cone(radius: float, height: float) -> Solid:
    """A closed cone, its tip up."""
    slope = radius / height
    slant = np.hypot(radius, height)

    def sample(rng: np.random.Generator, n: int) -> np.ndarray:
        on_side = rng.random(n) < slant / (slant + radius)
        disc = _disc(rng, n)  # uniform points of the side are uniform on the ground as well
        reach = np.linalg.norm(disc, axis=1)
        z = np.where(on_side, height / 2 - reach * height, -height / 2)
        return np.concatenate([radius * disc, z[:, None]], axis=1)

    def cast(origin: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # x^2 + y^2 = slope^2 (z - tip)^2 is a double cone; only its lower half counts.
        o = origin - [0, 0, height / 2]
        metric = np.array([1, 1, -(slope**2)])
        a, b = (directions**2) @ metric, directions @ (metric * o)
        c = float((o**2) @ metric)
        root = np.sqrt(np.maximum(b * b - a * c, 0))
        safe = np.where(np.abs(a) < 1e-12, 1e-12, a)
        side = np.full(len(directions), _MISS)
        for t in ((-b - root) / safe, (-b + root) / safe):
            z = o[2] + t * directions[:, 2]
            hit = (b * b > a * c) & (z <= 0) & (z >= -height) & (t > 0)
            side = np.where(hit, np.minimum(side, t), side)
        base = _cap(origin, directions, -height / 2, radius)
        t = np.minimum(side, base)
        where = origin + np.where(np.isfinite(t), t, 0)[:, None] * directions
        normals = _unit(np.concatenate([_unit(where[:, :2]), np.full((len(t), 1), slope)], axis=1))
        normals[base < side] = [0, 0, -1]
        return t, normals

    return Solid("cone", height, sample, cast)


def torus(ring: float, tube: float) -> Solid:
    """A torus: distance `ring` from the axis to the tube's centre, `tube` its radius."""

    def towards(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Offset [n, 3] from the tube's centre line, and its length."""
        across = np.hypot(p[:, 0], p[:, 1])
        offset = p - p * [1, 1, 0] * (ring / np.maximum(across, 1e-12))[:, None]
        return offset, np.linalg.norm(offset, axis=1)

    def sample(rng: np.random.Generator, n: int) -> np.ndarray:
        around = rng.uniform(0, 2 * np.pi, 4 * n)
        accept = rng.random(4 * n) < (ring + tube * np.cos(around)) / (ring + tube)
        around = around[accept][:n]
        along = rng.uniform(0, 2 * np.pi, n)
        out, up = np.cos(around), np.sin(around)
        outward = np.stack([out * np.cos(along), out * np.sin(along), up], axis=1)
        centre = np.stack([np.cos(along), np.sin(along), np.zeros(n)], axis=1)
        return ring * centre + tube * outward

    def cast(origin: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # Sphere tracing: each step is as long as the exact distance to the surface.
        speed = np.linalg.norm(directions, axis=1)
        start = max(float(np.linalg.norm(origin)) - ring - tube, 0) / speed
        end = (np.linalg.norm(origin) + ring + tube) / speed
        result = np.full(len(directions), _MISS)
        active = np.arange(len(directions))
        t = start.copy()
        for _ in range(400):  # rays that graze the surface approach it slowly
            where = origin + t[active, None] * directions[active]
            distance = towards(where)[1] - tube
            t[active] += distance / speed[active]
            found = distance < 1e-5
            result[active[found]] = t[active[found]]
            active = active[~found & (t[active] < end[active])]
            if not len(active):
                break
        where = origin + np.where(np.isfinite(result), result, 0)[:, None] * directions
        return result, _unit(towards(where)[0])

    return Solid("torus", 2 * tube, sample, cast)


RANDOM = {
    "box": lambda rng: box(rng.uniform(0.25, 1.0, 3)),
    "cone": lambda rng: cone(rng.uniform(0.3, 1.0), rng.uniform(0.5, 2.0)),
    "cylinder": lambda rng: cylinder(rng.uniform(0.2, 1.0), rng.uniform(0.4, 2.0)),
    "ellipsoid": lambda rng: ellipsoid(rng.uniform(0.3, 1.0, 3)),
    "torus": lambda rng: torus(1.0, rng.uniform(0.12, 0.45)),
}
"""Category -> a solid of random proportions; `draw` normalises its size."""


def _window(
    points: np.ndarray, intrinsics: np.ndarray, extrinsics: np.ndarray, size: tuple[int, int]
) -> tuple[slice, slice]:
    """Rows and columns of the projection of a cloud's bounding box, enlarged by a tenth."""
    low, high = points.min(axis=0), points.max(axis=0)
    margin = 0.05 * (high - low) + 0.01
    ends = np.stack([low - margin, high + margin])
    corners = np.stack(np.meshgrid(*ends.T), axis=-1).reshape(-1, 3)
    pixels, _ = camera.project(corners, intrinsics, extrinsics)
    first = np.clip(np.floor(pixels.min(axis=0)).astype(int), 0, [size[1] - 1, size[0] - 1])
    last = np.clip(np.ceil(pixels.max(axis=0)).astype(int), first + 1, [size[1], size[0]])
    return slice(first[1], last[1]), slice(first[0], last[0])


def draw(
    solid: Solid,
    rng: np.random.Generator,
    *,
    image_size: tuple[int, int] = DEFAULT_IMAGE_SIZE,
    num_points: int = NUM_POINTS,
    model_id: str = "",
) -> schema.Sample:
    """One sample: the solid on the ground, upright or lying, rotated, lit from a random side.

    Lambert shading without shadows: colour = albedo * (0.35 + 0.65 max(n . l, 0)). The unit is the
    distance from the origin to the farthest of the sampled points.
    """
    turn = rng.uniform(0, 2 * np.pi)
    cosine, sine = np.cos(turn), np.sin(turn)
    rotation = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    points = solid.sample(rng, num_points)
    # A lying cone would have to be tilted to rest on its side.
    if solid.category != "cone" and rng.random() < 0.3:
        rotation = rotation @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
        # Half the extent along the solid's y axis, which becomes vertical. All solids are symmetric
        # along y.
        lift = float(np.abs(points[:, 1]).max())
    else:
        lift = solid.height / 2
    world = points @ rotation.T + [0, 0, lift]
    scale = 1 / float(np.linalg.norm(world, axis=1).max())

    intrinsics, extrinsics = camera.default_camera(image_size)
    height, width = image_size
    window = _window(world * scale, intrinsics, extrinsics, image_size)
    rows, columns = np.mgrid[window]
    pixels = np.stack([columns + 0.5, rows + 0.5, np.ones(rows.shape)], axis=-1)
    # Directions have a component of 1 along the optical axis, so the ray's parameter is the depth.
    in_camera = pixels.reshape(-1, 3) @ np.linalg.inv(intrinsics.astype(np.float64)).T
    turned = extrinsics[:, :3].astype(np.float64)
    directions = in_camera @ turned
    eye = -turned.T @ extrinsics[:, 3]
    reach, facing = solid.cast((eye / scale - [0, 0, lift]) @ rotation, directions @ rotation)
    hit = np.isfinite(reach)

    light = _unit(np.array([rng.uniform(0.2, 1), rng.uniform(-1, 1), rng.uniform(0.3, 1)]))
    albedo = rng.uniform(0.25, 0.95, 3)
    shade = 0.35 + 0.65 * np.maximum(facing @ (light @ rotation), 0)
    colour = np.rint(255 * albedo * shade[:, None])
    image = np.full((height, width, 3), schema.BACKGROUND_GREY, np.uint8)
    depth = np.zeros((height, width), np.float32)
    image[window][hit.reshape(rows.shape)] = colour[hit]
    depth[window][hit.reshape(rows.shape)] = scale * reach[hit]
    return schema.Sample(
        image=image,
        mask=depth > 0,
        depth=depth,
        points=(world * scale).astype(np.float32),
        intrinsics=intrinsics,
        extrinsics=extrinsics,
        category=solid.category,
        model_id=model_id,
        source="solids",
    )


def samples(
    count: int, *, seed: int, image_size: tuple[int, int] = DEFAULT_IMAGE_SIZE
) -> Iterator[schema.Sample]:
    """`count` samples with alternating categories; the same seed gives the same samples."""
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        category = list(RANDOM)[number % len(RANDOM)]
        name = f"{category}-{seed}-{number:05d}"
        yield draw(RANDOM[category](rng), rng, image_size=image_size, model_id=name)


def view_of(category: str, image_size: tuple[int, int], seed: int = 0) -> augment.View:
    """A random solid of a category, as the augmentations take it."""
    rng = np.random.default_rng(seed)
    s = draw(RANDOM[category](rng), rng, image_size=image_size)
    return augment.View(s.image, s.mask, s.depth, s.points, s.intrinsics, s.extrinsics)

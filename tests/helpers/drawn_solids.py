"""Samples for tests: convex solids on the ground, drawn with plain numpy in milliseconds.

Solids of random proportions and poses, seen by the authors' camera (`camera.default_camera`) on
their grey background, with exact depth, mask and surface points.
"""

import numpy as np
import scipy.spatial

from psgn_jax.data import augment, camera, schema


class Solid:
    """The convex hull of points around the origin; its axis is z."""

    def __init__(self, category, vertices):
        hull = scipy.spatial.ConvexHull(vertices)
        self.category = category
        self.vertices = vertices
        self.triangles = vertices[hull.simplices]
        # Inside, normal . x + shift <= 0 for each plane.
        planes = np.unique(hull.equations.round(9), axis=0)
        self.normals, self.shifts = planes[:, :3], planes[:, 3]

    def sample(self, rng, n):
        """Points [n, 3], uniform on the surface."""
        a, b, c = self.triangles.transpose(1, 0, 2)
        areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        face = rng.choice(len(areas), n, p=areas / areas.sum())
        u, v = np.sort(rng.random((2, n)), axis=0)
        weights = np.stack([u, v - u, 1 - v], axis=1)
        return (weights[..., None] * self.triangles[face]).sum(axis=1)

    def cast(self, origin, directions):
        """Parameters [n] of the first hits (inf = none) of rays from outside, and normals."""
        slope = directions @ self.normals.T
        slope = np.where(np.abs(slope) < 1e-12, 1e-12, slope)
        t = -(self.normals @ origin + self.shifts) / slope
        enters = np.where(slope < 0, t, -np.inf)
        first = enters.max(axis=1)
        hit = first <= np.where(slope < 0, np.inf, t).min(axis=1)
        return np.where(hit, first, np.inf), self.normals[enters.argmax(axis=1)]


def box(half):
    """A box of half extents `half` [3]."""
    return Solid("box", half * np.stack(np.meshgrid(*[[-1, 1]] * 3), axis=-1).reshape(-1, 3))


def frustum(category, bottom, top, height, sides=32):
    """Two regular polygons of given radii, one above the other."""
    angle = np.arange(sides) * 2 * np.pi / sides
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    up = np.array([0, 0, height / 2])
    return Solid(category, np.concatenate([bottom * ring - up, (top * ring + up)]))


def ellipsoid(half):
    """An ellipsoid of half axes `half` [3]; a hundred points of it are its corners."""
    z = np.linspace(-1, 1, 100)
    angle, radius = np.arange(100) * np.pi * (3 - 5**0.5), np.sqrt(1 - z**2)
    corners = np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
    return Solid("ellipsoid", half * corners)


def torus_points(rng, ring, tube, n):
    """Points [n, 3], uniform on a torus; `ring` is the distance from its axis to the tube."""
    around = rng.uniform(0, 2 * np.pi, 4 * n)
    accept = rng.random(4 * n) < (ring + tube * np.cos(around)) / (ring + tube)
    around, along = around[accept][:n], rng.uniform(0, 2 * np.pi, n)
    radius = ring + tube * np.cos(around)
    return np.stack([radius * np.cos(along), radius * np.sin(along), tube * np.sin(around)], axis=1)


RANDOM = {
    "box": lambda rng: box(rng.uniform(0.25, 1.0, 3)),
    "cone": lambda rng: frustum("cone", rng.uniform(0.3, 1.0), 0.0, rng.uniform(0.5, 2.0)),
    "cylinder": lambda rng: frustum("cylinder", *[rng.uniform(0.2, 1.0)] * 2, rng.uniform(0.4, 2)),
    "ellipsoid": lambda rng: ellipsoid(rng.uniform(0.3, 1.0, 3)),
    "prism": lambda rng: frustum("prism", *rng.uniform(0.4, 1.0, 2), rng.uniform(0.3, 1.5), 3),
}
"""Category -> a solid of random proportions; `draw` normalises its size."""


def draw(solid, rng, *, image_size=(192, 256), num_points=4096, model_id=""):
    """One sample: the solid on the ground, upright or lying, rotated, lit from a random side.

    Lambert shading without shadows: colour = albedo * (0.35 + 0.65 max(n . l, 0)). The unit is the
    distance from the origin to the farthest of the sampled points.
    """
    turn = rng.uniform(0, 2 * np.pi)
    cosine, sine = np.cos(turn), np.sin(turn)
    rotation = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    # A lying cone would have to be tilted to rest on its side.
    if solid.category != "cone" and rng.random() < 0.3:
        rotation = rotation @ np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    corners = solid.vertices @ rotation.T
    lift = np.array([0, 0, -corners[:, 2].min()])
    world = solid.sample(rng, num_points) @ rotation.T + lift
    scale = 1 / float(np.linalg.norm(world, axis=1).max())

    intrinsics, extrinsics = camera.default_camera(image_size)
    height, width = image_size
    seen, _ = camera.project((corners + lift) * scale, intrinsics, extrinsics)
    first = np.clip(np.floor(seen.min(axis=0)).astype(int), 0, [width, height])
    last = np.clip(np.ceil(seen.max(axis=0)).astype(int), 0, [width, height])
    window = slice(first[1], last[1]), slice(first[0], last[0])
    rows, columns = np.mgrid[window]
    pixels = np.stack([columns + 0.5, rows + 0.5, np.ones(rows.shape)], axis=-1)
    # Directions have a component of 1 along the optical axis, so the ray's parameter is the depth.
    in_camera = pixels.reshape(-1, 3) @ np.linalg.inv(intrinsics.astype(np.float64)).T
    turned = extrinsics[:, :3].astype(np.float64)
    directions = in_camera @ turned
    eye = -turned.T @ extrinsics[:, 3]
    reach, facing = solid.cast((eye / scale - lift) @ rotation, directions @ rotation)
    hit = np.isfinite(reach)

    light = rng.uniform([0.2, -1, 0.3], 1)
    light /= np.linalg.norm(light)
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


def samples(count, *, seed, image_size=(192, 256)):
    """`count` samples with alternating categories; the same seed gives the same samples."""
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        category = list(RANDOM)[number % len(RANDOM)]
        name = f"{category}-{seed}-{number:05d}"
        yield draw(RANDOM[category](rng), rng, image_size=image_size, model_id=name)


def view_of(category, image_size, seed=0):
    """A random solid of a category, as the augmentations take it."""
    rng = np.random.default_rng(seed)
    s = draw(RANDOM[category](rng), rng, image_size=image_size)
    return augment.View(s.image, s.mask, s.depth, s.points, s.intrinsics, s.extrinsics)

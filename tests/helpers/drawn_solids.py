"""Samples for tests: solids on the ground, drawn with plain numpy in milliseconds.

Boxes, ellipsoids, cylinders, cones and tori of random proportions and poses, seen by the authors'
camera (`camera.default_camera`) on their grey background, with exact points and normals. Each is a
function (rng, n) -> points [n, 3] uniform on the surface, outward normals [n, 3].
"""

import numpy as np

from psgn_jax.data import augment, camera, schema

LYING = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


def _unit(v):
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12)


def _disc(rng, n):
    """Uniform points [n, 2] in the unit disc."""
    angle, radius = rng.uniform(0, 2 * np.pi, n), np.sqrt(rng.random(n))
    return radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])


def box(half):
    """A box of half extents `half` [3]."""

    def sample(rng, n):
        normals = np.zeros((n, 3))
        axis = rng.choice(3, n, p=1 / half / sum(1 / half))  # areas are proportional to 1 / half
        normals[np.arange(n), axis] = rng.choice([-1.0, 1.0], n)
        return np.where(normals, normals, rng.uniform(-1, 1, (n, 3))) * half, normals

    return sample


def ellipsoid(half):
    """An ellipsoid of half axes `half` [3]."""

    def sample(rng, n):
        # The map from the unit sphere scales the area around u by abc |u / half|. Points are
        # accepted with a probability proportional to this factor.
        u = _unit(rng.normal(size=(4 * n, 3)))
        u = u[rng.random(4 * n) < np.linalg.norm(u / half, axis=1) * half.min()][:n]
        return u * half, _unit(u / half)

    return sample


def cylinder(radius, height):
    """A closed cylinder; its axis is z, as those of cones and tori."""

    def sample(rng, n):
        on_side = (rng.random(n) < height / (height + radius))[:, None]
        disc, z = _disc(rng, n), rng.uniform(-1, 1, n)
        ring, end = _unit(disc), np.sign(z)
        points = np.where(on_side, np.column_stack([ring, z]), np.column_stack([disc, end]))
        outward, up = np.column_stack([ring, 0 * z]), np.column_stack([0 * disc, end])
        return points * [radius, radius, height / 2], np.where(on_side, outward, up)

    return sample


def cone(radius, height):
    """A closed cone, its tip up."""

    def sample(rng, n):
        slant = np.hypot(radius, height)
        on_side = rng.random(n) < slant / (slant + radius)
        disc = _disc(rng, n)  # uniform points of the side are uniform on the ground as well
        z = height * np.where(on_side, 1 - np.linalg.norm(disc, axis=1), 0)
        outward = _unit(np.column_stack([_unit(disc), np.full(n, radius / height)]))
        return np.column_stack([radius * disc, z]), np.where(on_side[:, None], outward, [0, 0, -1])

    return sample


def torus(ring, tube):
    """A torus: distance `ring` from the axis to the tube's centre, `tube` its radius."""

    def sample(rng, n):
        around = rng.uniform(0, 2 * np.pi, 4 * n)
        accepted = rng.random(4 * n) < (ring + tube * np.cos(around)) / (ring + tube)
        around, along = around[accepted][:n, None], rng.uniform(0, 2 * np.pi, n)
        centre = np.column_stack([np.cos(along), np.sin(along), 0 * along])
        normals = np.cos(around) * centre + np.sin(around) * [0, 0, 1]
        return ring * centre + tube * normals, normals

    return sample


RANDOM = {
    "box": lambda rng: box(rng.uniform(0.25, 1.0, 3)),
    "cone": lambda rng: cone(rng.uniform(0.3, 1.0), rng.uniform(0.5, 2.0)),
    "cylinder": lambda rng: cylinder(rng.uniform(0.2, 1.0), rng.uniform(0.4, 2.0)),
    "ellipsoid": lambda rng: ellipsoid(rng.uniform(0.3, 1.0, 3)),
    "torus": lambda rng: torus(1.0, rng.uniform(0.12, 0.45)),
}
"""Category -> a solid of random proportions; `draw` normalises its size."""


def draw(solid, rng, *, image_size=(192, 256), num_points=4096, **names):
    """One sample: the solid on the ground, upright or lying, rotated, lit from a random side.

    Lambert shading without shadows: colour = albedo * (0.35 + 0.65 max(n . l, 0)). The unit is the
    distance from the origin to the farthest point. Each pixel shows the nearest of many points.
    """
    angle, (height, width) = rng.uniform(0, 2 * np.pi), image_size
    cosine, sine = np.cos(angle), np.sin(angle)
    rotation = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    rotation = rotation @ LYING if rng.random() < 0.3 else rotation
    points, normals = (x @ rotation.T for x in solid(rng, num_points + 8 * height * width))
    points[:, 2] -= points[:, 2].min()
    points /= np.linalg.norm(points, axis=1).max()
    light = _unit(rng.uniform([0.2, -1, 0.3], 1))
    shade = 0.35 + 0.65 * np.maximum(normals @ light, 0)
    colours = np.rint(255 * rng.uniform(0.25, 0.95, 3) * shade[:, None])

    view = camera.default_camera(image_size)
    pixels, z = camera.project(points, *view)
    column, row = np.floor(pixels).astype(int).T
    order = np.argsort(-z)  # the nearest one is drawn last
    order = order[((pixels >= 0) & (pixels < [width, height])).all(axis=1)[order]]
    image = np.full((height, width, 3), schema.BACKGROUND_GREY, np.uint8)
    depth = np.zeros((height, width), np.float32)
    image[row[order], column[order]], depth[row[order], column[order]] = colours[order], z[order]
    points, normals = (x[:num_points].astype(np.float32) for x in (points, normals))
    fields = {"depth": depth, "normals": normals, "source": "solids", **names}
    return schema.Sample(image, depth > 0, points, *view, **fields)


def samples(count, *, seed, image_size=(192, 256)):
    """`count` samples with alternating categories; the same seed gives the same samples."""
    for number in range(count):
        rng, category = np.random.default_rng([seed, number]), list(RANDOM)[number % len(RANDOM)]
        names = {"category": category, "model_id": f"{category}-{seed}-{number:05d}"}
        yield draw(RANDOM[category](rng), rng, image_size=image_size, **names)


def view_of(category, image_size, seed=0):
    """A random solid of a category, as the augmentations take it."""
    rng = np.random.default_rng(seed)
    s = draw(RANDOM[category](rng), rng, image_size=image_size)
    return augment.View(s.image, s.mask, s.depth, s.points, s.intrinsics, s.extrinsics)

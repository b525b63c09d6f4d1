"""Moves models to the project's frame (`psgn_jax.data.schema`).

+z is up, +x is the front, and the origin is on the ground under the object. The unit is the radius
of the bounding hemisphere.

Surfaces may be transparent in part. A texel or a point *exists* if its opacity is at least
`mesh.EXISTS`.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from data_gen import mesh
from data_gen.mesh import EXISTS, Material, Model, UnusableModelError, faces_with_alpha, opacity_at

AXES = ("+x", "-x", "+y", "-y", "+z", "-z")


def axis_vector(name: str) -> Float[np.ndarray, " 3"]:
    """The unit vector of one of `AXES`; ValueError for another name."""
    if name not in AXES:
        raise ValueError(f"axis {name!r}: expected one of {list(AXES)}")
    vector = np.zeros(3)
    vector["xyz".index(name[1])] = 1 if name[0] == "+" else -1
    return vector


def orient(model: Model, up: str = "+y", front: str = "+z") -> Model:
    """Rotates a model: its axis `up` becomes +z, its axis `front` +x.

    Both are names in `AXES`, perpendicular to each other. In OBJ and glTF files, +y is up.
    """
    upward, forward = axis_vector(up), axis_vector(front)
    if upward @ forward != 0:
        raise ValueError(f"front {front!r}: expected a direction perpendicular to up {up!r}")
    return model.transformed(np.stack([forward, np.cross(upward, forward), upward]))


# We do not divide parts of faces that are smaller than this fraction of the extent.
_SMALL = 0.001

# Of more faces, we divide those that may reach farthest: holes may be finer than `_SMALL`.
_MOST_DIVIDED = 1 << 15


def _texel_sums(material: Material) -> Int[np.ndarray, "h w"]:
    """Summed-area table of the texels that exist."""
    texture = np.full((1, 1, 4), 255) if material.texture is None else material.texture
    exists = texture[..., 3] * (material.opacity / 255.0) >= EXISTS
    return np.pad(exists.cumsum(axis=0, dtype=np.int32).cumsum(axis=1), ((1, 0), (1, 0)))


def _existing_share(
    sums: Int[np.ndarray, "h w"], uv: Float[np.ndarray, "n 3 2"]
) -> Float[np.ndarray, " n"]:
    """The fraction of existing texels in the bounding box of each triangle in the texture."""
    size = np.array(sums.shape[::-1]) - 1
    texels = uv * [1, -1] * size
    first = np.floor(texels.min(axis=1) + 1e-4).astype(np.int64)
    count = np.ceil(texels.max(axis=1) - 1e-4).astype(np.int64) - first
    count = np.clip(count, 1, size)
    first %= size

    def before(corner: np.ndarray) -> np.ndarray:
        # The texture repeats.
        (columns, rows), (column, row) = (corner // size).T, (corner % size).T
        return (
            rows * columns * sums[-1, -1] + rows * sums[-1, column]
            + columns * sums[row, -1] + sums[row, column]
        )  # fmt: skip

    along, down = count * [1, 0], count * [0, 1]
    existing = before(first + count) - before(first + along) - before(first + down) + before(first)
    return existing / count.prod(axis=1)


def _existing_extremes(
    model: Model,
    faces: Int[np.ndarray, " n"],
    measure: Callable[[np.ndarray], np.ndarray],
    best: Float[np.ndarray, " k"],
) -> Float[np.ndarray, "m 3"]:
    """For each convex measure, the existing point of the faces with the largest value above `best`.

    We divide a face into four parts, recursively, if it exists in part and may contain a larger
    value. Of parts smaller than `_SMALL` times the extent, we examine the corners alone.
    """
    extent = float(np.ptp(model.vertices, axis=0).max())
    best, chosen = best.copy(), np.full((len(best), 3), np.nan)
    weights = np.tile(np.eye(3), (len(faces), 1, 1))
    sums: dict[tuple[int, float], np.ndarray] = {}
    # From the corners of a triangle to the corners of its four parts.
    corner = np.eye(3)
    middle = (corner + np.roll(corner, -1, axis=0)) / 2  # of the edges 0-1, 1-2, 2-0
    halves = np.array([
        [corner[0], middle[0], middle[2]], [middle[0], corner[1], middle[1]],
        [middle[2], middle[1], corner[2]], [middle[1], middle[2], middle[0]],
    ])  # fmt: skip

    def reach(at: np.ndarray, points: np.ndarray, values: np.ndarray) -> None:
        reached = np.where(at.reshape(-1, 1), values.reshape(-1, len(best)), -np.inf)
        index = reached.argmax(axis=0)
        value = reached[index, np.arange(len(best))]
        better = value > best
        best[better] = value[better]
        chosen[better] = points.reshape(-1, 3)[index[better]]

    for _ in range(16):
        if not len(faces):
            break
        points = weights @ model.vertices[model.faces[faces]]
        values = measure(points.reshape(-1, 3)).reshape(len(faces), 3, -1)
        corner_exists = opacity_at(model, np.repeat(faces, 3), weights.reshape(-1, 3)) >= EXISTS
        reach(corner_exists, points, values)
        kept = (values.max(axis=1) > best + _SMALL / 2 * extent).any(axis=1)
        if not kept.any():
            break
        faces, weights, points, values = faces[kept], weights[kept], points[kept], values[kept]
        uv = weights @ model.uv[faces].astype(np.float64)
        share = np.zeros(len(faces))
        owner = model.face_material[faces]
        for number in np.unique(owner):
            material, own = model.materials[number], owner == number
            key = (id(material.texture), material.opacity)
            if key not in sums:
                sums[key] = _texel_sums(material)
            share[own] = _existing_share(sums[key], uv[own])
        reach(np.repeat(share == 1, 3), points, values)
        size = np.linalg.norm(points - np.roll(points, 1, axis=1), axis=2).max(axis=1)
        divided = np.flatnonzero((share > 0) & (share < 1) & (size > _SMALL * extent))
        over = (values[divided] - best).max(axis=(1, 2))
        divided = np.sort(divided[np.argsort(-over, kind="stable")[:_MOST_DIVIDED]])
        faces = np.repeat(faces[divided], 4)
        weights = np.einsum("pij,njk->npik", halves, weights[divided]).reshape(-1, 3, 3)
    return np.unique(chosen[np.isfinite(chosen[:, 0])], axis=0)


def outline(
    model: Model, measure: Callable[[np.ndarray], np.ndarray] | None = None
) -> Float[np.ndarray, "n 3"]:
    """Points with the same extent as the visible surface.

    Without alpha textures, these are all vertices. With them, these are the vertices of the faces
    without alpha, and for each measure that is larger on a face with alpha, the existing point with
    the largest value. Measures are k convex functions of points, [n, 3] to [n, k]; None = the
    extent in 260 directions, including the axes.
    """
    faces = faces_with_alpha(model)
    if not len(faces):
        return model.vertices
    if measure is None:
        turn = np.pi * (3 - np.sqrt(5)) * np.arange(254)
        height = (np.arange(254) + 0.5) / 127 - 1
        ring = np.sqrt(1 - height**2)
        spread = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=1)
        directions = np.concatenate([np.eye(3), -np.eye(3), spread]).T
        measure = lambda points: points @ directions  # noqa: E731
    whole = np.ones(len(model.faces), bool)
    whole[faces] = False
    points = model.vertices[np.unique(model.faces[whole])]
    best = np.full(measure(model.vertices[:1]).shape[1], -np.inf)
    if len(points):
        best = measure(points).max(axis=0)
    return np.concatenate([points, _existing_extremes(model, faces, measure, best)])


# We refuse a model with a gap above `_STRAY_GAP` along an axis, if both parts beside the gap are at
# most `_STRAY_SIZE` large. Both numbers are fractions of the extent. Of 82 models of Sweet Home 3D,
# none has a gap above 0.12; of 494 game models, a single one has a gap above 0.45: 0.93.
_STRAY_GAP, _STRAY_SIZE = 0.6, 0.15


def _check_strays(model: Model) -> None:
    """Refuses models whose parts are far apart; the message names the smaller part."""
    corners = model.corners()
    low, high = corners.min(axis=1), corners.max(axis=1)
    extent = float((high.max(axis=0) - low.min(axis=0)).max())
    for axis in range(3):
        order = np.argsort(low[:, axis], kind="stable")
        reached = np.maximum.accumulate(high[order, axis])
        gaps = low[order[1:], axis] - reached[:-1]
        if not len(gaps) or gaps.max() <= _STRAY_GAP * extent:
            continue
        sides = np.split(order, [int(gaps.argmax()) + 1])
        size = max(np.ptp(corners[s].reshape(-1, 3), axis=0).max() for s in sides)
        if size > _STRAY_SIZE * extent:
            continue
        part = min(sides, key=lambda s: mesh.face_areas(model.vertices, model.faces[s]).sum())
        names = sorted({model.materials[i].name for i in model.face_material[part]} - {""})
        centre = ", ".join(f"{c:.3g}" for c in corners[part].mean(axis=(0, 1)))
        raise UnusableModelError(
            f"a stray part of {len(part)} faces"
            + (f" (material {', '.join(names[:3])})" if names else "")
            + f" around ({centre}): the gap between it and the other part is "
            f"{gaps.max() / extent:.0%} of the model's extent, expected at most {_STRAY_GAP:.0%}"
        )


def normalize(model: Model) -> Model:
    """Moves and scales a model, whose axes are correct (`orient`), to the project's frame.

    The lowest point of the visible surface moves to z = 0, the centre of its bounding box to
    x = y = 0, and we scale the farthest point to distance 1 from the origin. With alpha textures,
    the bounds are exact to 0.002 of the extent.

    Raises:
      UnusableModelError: the extent is zero or infinite, or a part is so far away that the object
        would be tiny.
    """
    _check_strays(model)
    points = outline(model, lambda points: np.concatenate([points, -points], axis=1))
    if not len(points):
        raise UnusableModelError("the model is transparent, expected a visible surface")
    low, high = points.min(axis=0), points.max(axis=0)
    return _with_origin(model, np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]]))


def recentre(model: Model, centre: str) -> Model:
    """A model of `normalize` with another point at x = y = 0, scaled to radius 1 again.

    "bounds" is the centre of the bounding box, as in `model`. "vertices" is the mean of the
    vertices, which is near dense parts of the mesh, such as the back of a chair. It seems to be the
    authors' centre: the centre of the bounding box is more than 0.1 away from the origin in 26 % of
    their samples. Of furniture and procedural models, it is in 18 to 23 % with "vertices", in 1 to
    6 % with "bounds".

    Raises:
      UnusableModelError: the extent is zero or infinite.
    """
    if centre == "bounds":
        return model
    used = np.unique(model.vertices[np.unique(model.faces)], axis=0)
    return _with_origin(model, np.append(used[:, :2].mean(axis=0), 0.0))


def _with_origin(model: Model, origin: Float[np.ndarray, " 3"]) -> Model:
    """Moves `origin` to (0, 0, 0) and scales the visible surface to radius 1."""

    def distance(points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points - origin, axis=1, keepdims=True)

    with np.errstate(over="ignore"):
        radius = float(distance(outline(model, distance)).max())
    if not (np.isfinite(radius) and radius > 0):
        raise UnusableModelError(f"the model's radius is {radius:g}, expected a positive number")
    return dataclasses.replace(model, vertices=(model.vertices - origin) / radius)

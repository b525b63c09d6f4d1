"""Models in the project's frame (`psgn_jax.data.schema`), where `normalize` brings them.

+z is up, +x the front, the origin on the ground under the object; the unit is the radius of the
bounding hemisphere.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from data_gen.mesh import (
    EXISTS,
    Material,
    Model,
    UnusableModelError,
    face_areas,
    faces_with_alpha,
    opacity_at,
)

AXES = ("+x", "-x", "+y", "-y", "+z", "-z")
"""Names of directions, for `orient`."""


def axis_vector(name: str) -> Float[np.ndarray, " 3"]:
    """The unit vector of a direction of `AXES`.

    Raises:
      ValueError: there is no such direction.
    """
    if name not in AXES:
        raise ValueError(f"axis {name!r}: expected one of {list(AXES)}")
    vector = np.zeros(3)
    vector["xyz".index(name[1])] = 1 if name[0] == "+" else -1
    return vector


def orient(model: Model, up: str = "+y", front: str = "+z") -> Model:
    """Turns a model so that its `up` is +z and its `front` +x.

    Args:
      model: in its file's axes.
      up: one of `AXES`; +y is what OBJ and glTF mean.
      front: one of `AXES`, at right angles to `up`.
    """
    upward, forward = axis_vector(up), axis_vector(front)
    if upward @ forward != 0:
        raise ValueError(f"front {front!r}: expected a direction at right angles to up {up!r}")
    rotation = np.stack([forward, np.cross(upward, forward), upward])
    return model.transformed(np.concatenate([rotation, np.zeros((3, 1))], axis=1))


# Parts of faces smaller than this part of the extent are not divided further.
_SMALL = 0.001


def _texel_sums(material: Material) -> Int[np.ndarray, "h w"]:
    """How many texels above and left of each place exist."""
    texture = np.full((1, 1, 4), 255) if material.texture is None else material.texture
    exists = texture[..., 3] * (material.opacity / 255.0) >= EXISTS
    return np.pad(exists.cumsum(axis=0, dtype=np.int32).cumsum(axis=1), ((1, 0), (1, 0)))


def _existing_share(
    sums: Int[np.ndarray, "h w"], uv: Float[np.ndarray, "n 3 2"]
) -> Float[np.ndarray, " n"]:
    """Part of the texels that exist, of those in the bounding boxes of triangles."""
    size = np.array(sums.shape[::-1]) - 1
    places = uv * [1, -1] * size
    first = np.floor(places.min(axis=1) + 1e-4).astype(np.int64)
    count = np.ceil(places.max(axis=1) - 1e-4).astype(np.int64) - first
    count = np.clip(count, 1, size)
    first %= size

    def before(place: np.ndarray) -> np.ndarray:
        # Textures repeat.
        (columns, rows), (column, row) = (place // size).T, (place % size).T
        return (
            rows * columns * sums[-1, -1] + rows * sums[-1, column]
            + columns * sums[row, -1] + sums[row, column]
        )  # fmt: skip

    along, down = count * [1, 0], count * [0, 1]
    found = before(first + count) - before(first + along) - before(first + down) + before(first)
    return found / count.prod(axis=1)


def _existing_extremes(
    model: Model,
    faces: Int[np.ndarray, " n"],
    measure: Callable[[np.ndarray], np.ndarray],
    best: Float[np.ndarray, " k"],
) -> Float[np.ndarray, "m 3"]:
    """Existing points of faces at which measures exceed `best`: for each, the largest value.

    Faces are divided into four, again and again, where they exist in part and may hold a larger
    value. A divided part that is as small as `_SMALL` of the extent counts by its corners alone.

    Args:
      model: any.
      faces: that may have holes.
      measure: convex functions of points: [n, 3] to [n, k].
      best: values that are reached elsewhere.
    """
    extent = float(np.ptp(model.vertices, axis=0).max())
    best, chosen = best.copy(), np.full((len(best), 3), np.nan)
    weights = np.tile(np.eye(3), (len(faces), 1, 1))
    sums: dict[tuple[int, float], np.ndarray] = {}
    # From the corners of a triangle to those of its four parts.
    halves = (
        np.array(
            [
                [[2, 0, 0], [1, 1, 0], [1, 0, 1]],
                [[1, 1, 0], [0, 2, 0], [0, 1, 1]],
                [[1, 0, 1], [0, 1, 1], [0, 0, 2]],
                [[0, 1, 1], [1, 0, 1], [1, 1, 0]],
            ]
        )
        / 2
    )

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
        divided = (share > 0) & (share < 1) & (size > _SMALL * extent)
        faces = np.repeat(faces[divided], 4)
        weights = np.einsum("pij,njk->npik", halves, weights[divided]).reshape(-1, 3, 3)
    return np.unique(chosen[np.isfinite(chosen[:, 0])], axis=0)


def outline(
    model: Model, measure: Callable[[np.ndarray], np.ndarray] | None = None
) -> Float[np.ndarray, "n 3"]:
    """Points that stick out as far as what is drawn: all vertices, if no texture has alpha.

    With such textures, the vertices of the faces without them, and of the others the existing
    points with the largest measures.

    Args:
      model: any.
      measure: convex functions of points, [n, 3] to [n, k]; None = the extent in 260 directions,
        those of the axes among them.
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


# A model is in stray parts if an empty gap takes this part of its extent, and what lies on either
# side is smaller than that. Of FlightGear's 494 models that load, one has a gap of over 0.6 (0.93;
# the next have 0.45 and 0.25), of 82 pieces of Sweet Home 3D none has more than 0.12.
_STRAY_GAP, _STRAY_SIZE = 0.6, 0.15


def _check_strays(model: Model) -> None:
    """Refuses models that consist of parts far from one another.

    Raises:
      UnusableModelError: names the smaller part.
    """
    corners = model.corners()
    low, high = corners.min(axis=1), corners.max(axis=1)
    extent = float((high.max(axis=0) - low.min(axis=0)).max())
    for axis in range(3):
        order = np.argsort(low[:, axis], kind="stable")
        reached = np.maximum.accumulate(high[order, axis])
        gaps = low[order[1:], axis] - reached[:-1]
        if not len(gaps) or gaps.max() <= _STRAY_GAP * extent:
            continue
        index = int(gaps.argmax()) + 1
        sizes = [
            np.ptp(corners[side].reshape(-1, 3), axis=0).max()
            for side in (order[:index], order[index:])
        ]
        if max(sizes) > _STRAY_SIZE * extent:
            continue
        sides = sorted((order[:index], order[index:]), key=lambda s: face_areas(
            model.vertices, model.faces[s]).sum())  # fmt: skip
        names = sorted({model.materials[i].name for i in model.face_material[sides[0]]} - {""})
        centre = ", ".join(f"{c:.3g}" for c in corners[sides[0]].mean(axis=(0, 1)))
        raise UnusableModelError(
            f"a stray part of {len(sides[0])} faces"
            + (f" (material {', '.join(names[:3])})" if names else "")
            + f" around ({centre}): {gaps.max() / extent:.0%} of the model's extent are empty "
            "between it and the rest"
        )


CENTRES = ("bounds", "vertices")
"""What of a model comes to x = y = 0, for `normalize` and `recentre`."""


def normalize(model: Model) -> Model:
    """Moves and scales a model to the project's frame; its axes must be right already (`orient`).

    The lowest point comes to z = 0, the centre of the bounding box to x = y = 0, the farthest
    point to distance 1 from the origin: the radius of the bounding hemisphere is 1. Only what is
    drawn counts: what an alpha texture hides may lie outside. With alpha textures, the bounds are
    exact to 0.002 of the extent.

    Raises:
      UnusableModelError: the model has no extent, or one that overflows; or it has stray parts
        far away, beside which the object would be a dot.
    """
    _check_strays(model)
    points = outline(model, lambda points: np.concatenate([points, -points], axis=1))
    if not len(points):
        raise UnusableModelError("nothing of the surface exists: its textures are transparent")
    low, high = points.min(axis=0), points.max(axis=0)
    return _with_origin(model, np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]]))


def recentre(model: Model, centre: str) -> Model:
    """A model of `normalize` with another point at x = y = 0, scaled to radius 1 again.

    "bounds" is the centre of the bounding box, which changes nothing. "vertices" is the mean of the
    vertices, each counted once. It lies where the mesh is dense: at the head of a guitar, towards
    the back of a chair. The authors' objects stand like this. The centre of their bounding boxes is
    more than 0.1 from the origin in 26 % of the samples and in 18 to 23 % of furniture and
    procedural models centred on their vertices, against 1 to 6 % of those centred on their bounds.

    Args:
      model: in the project's frame.
      centre: one of `CENTRES`.

    Raises:
      UnusableModelError: as `normalize`.
    """
    if centre not in CENTRES:
        raise ValueError(f"centre {centre!r}: expected one of {list(CENTRES)}")
    if centre == "bounds":
        return model
    used = np.unique(model.vertices[np.unique(model.faces)], axis=0)
    return _with_origin(model, np.append(used[:, :2].mean(axis=0), 0.0))


def _with_origin(model: Model, origin: Float[np.ndarray, " 3"]) -> Model:
    """Moves `origin` to (0, 0, 0) and scales the drawn surface to radius 1."""

    def distance(points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points - origin, axis=1, keepdims=True)

    with np.errstate(over="ignore"):
        radius = float(distance(outline(model, distance)).max())
    if not (np.isfinite(radius) and radius > 0):
        raise UnusableModelError(f"the model's radius is {radius:g}")
    return dataclasses.replace(model, vertices=(model.vertices - origin) / radius)

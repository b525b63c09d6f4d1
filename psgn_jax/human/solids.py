"""Primitives as meshes, equal to those that `static/geometry.js` builds in the page.

A part is a primitive inside the cube of edge 1 about the origin, scaled by its size, rotated and
moved into the object's frame. There it may have copies mirrored across x = 0 and y = 0. The
object's frame is the project's frame, rotated about the vertical and moved along the ground.
"""

import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

ROUND, RINGS = 32, 16
"""Corners of a circle; rings of a sphere from pole to pole."""

_FLAT = 1e-12

Polygon = Sequence[tuple[float, float]]


class Mesh(NamedTuple):
    """A closed surface; faces are counter-clockwise seen from outside."""

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]


class Solid(NamedTuple):
    """A part, or a symmetric copy of one, in the project's frame.

    Attributes:
      part: the part, see `answers.Part`.
      mesh: its surface.
      linear: x = linear @ u + shift maps a point u of the unit primitive to the frame.
      shift: see `linear`.
    """

    part: Any
    mesh: Mesh
    linear: Float[np.ndarray, "3 3"]
    shift: Float[np.ndarray, "3"]


# --- polygons ---------------------------------------------------------------------------------


def _cross(a: Sequence[float], b: Sequence[float], c: Sequence[float]) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def area(polygon: Polygon) -> float:
    """Area of a polygon, positive if its corners are in counter-clockwise order."""
    ends = [*polygon[1:], polygon[0]]
    return sum(p[0] * q[1] - p[1] * q[0] for p, q in zip(polygon, ends, strict=True)) / 2


def crosses_itself(polygon: Polygon) -> bool:
    """Whether two edges that are not neighbours cross or touch."""
    n = len(polygon)
    for i in range(n):
        for j in range(i + 2, n - (i == 0)):
            a, b, c, d = polygon[i], polygon[i + 1], polygon[j], polygon[(j + 1) % n]
            apart = _cross(a, b, c) * _cross(a, b, d) > 0 or _cross(c, d, a) * _cross(c, d, b) > 0
            if not apart:
                return True
    return False


def triangulate(polygon: Polygon) -> list[tuple[int, int, int]] | None:
    """Triangles of a simple polygon in counter-clockwise order, by ear clipping.

    None if no ear is found: the polygon crosses itself or is in clockwise order.
    """
    left, faces = list(range(len(polygon))), []
    while len(left) > 2:
        triples = [(left[k - 1], left[k], left[(k + 1) % len(left)]) for k in range(len(left))]
        at = next((k for k, t in enumerate(triples) if _is_ear(polygon, left, t)), None)
        if at is not None:
            faces.append(triples[at])
        else:
            at = next(
                (k for k, t in enumerate(triples)
                 if abs(_cross(*(polygon[i] for i in t))) <= _FLAT), None
            )  # fmt: skip
        if at is None:
            return None
        del left[at]
    return faces


def _is_ear(polygon: Polygon, left: Sequence[int], triple: tuple[int, int, int]) -> bool:
    a, b, c = (polygon[i] for i in triple)
    if not _cross(a, b, c) > _FLAT:
        return False
    return all(
        i in triple
        or _cross(a, b, polygon[i]) < 0
        or _cross(b, c, polygon[i]) < 0
        or _cross(c, a, polygon[i]) < 0
        for i in left
    )


def cross_section(part: Any) -> list[tuple[float, float]]:
    """The polygon that a part extrudes, in [-1/2, 1/2] x [-1/2, 1/2]; not for spheres."""
    if part.kind == "box":
        return [(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]
    if part.kind == "outline":
        return list(part.outline)
    sides = part.sides if part.kind == "prism" else ROUND
    angles = np.pi / 2 + 2 * np.pi * np.arange(sides) / sides
    corners = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    low, high = corners.min(axis=0), corners.max(axis=0)
    return [(float(x), float(y)) for x, y in (corners - low) / (high - low) - 0.5]


# --- primitives -------------------------------------------------------------------------------


def unit_mesh(part: Any) -> Mesh:
    """The primitive of a part inside the cube of edge 1 about the origin."""
    if part.kind == "sphere":
        return _ball()
    polygon = cross_section(part)
    n, caps, tip = len(polygon), triangulate(polygon) or [], part.taper == 0
    vertices = [(x, y, -0.5) for x, y in polygon]
    vertices += (
        [(0.0, 0.0, 0.5)] if tip else [(x * part.taper, y * part.taper, 0.5) for x, y in polygon]
    )
    faces = [(a, c, b) for a, b, c in caps]
    for i in range(n):
        j = (i + 1) % n
        faces += [(i, j, n)] if tip else [(i, j, n + j), (i, n + j, n + i)]
    if not tip:
        faces += [(n + a, n + b, n + c) for a, b, c in caps]
    return Mesh(np.array(vertices, np.float64), np.array(faces, np.int64))


@functools.cache
def _ball() -> Mesh:
    polar = np.pi * np.arange(1, RINGS)[:, None] / RINGS - np.pi / 2
    angle = 2 * np.pi * np.arange(ROUND)[None] / ROUND
    rings = 0.5 * np.stack(
        [np.cos(polar) * np.cos(angle), np.cos(polar) * np.sin(angle), np.sin(polar) + 0 * angle],
        axis=-1,
    )
    vertices = np.concatenate([[[0, 0, -0.5]], rings.reshape(-1, 3), [[0, 0, 0.5]]])

    def at(i: int, j: int) -> int:
        return 1 + (i - 1) * ROUND + j % ROUND

    faces = []
    for j in range(ROUND):
        faces.append((0, at(1, j + 1), at(1, j)))
        for i in range(1, RINGS - 1):
            faces.append((at(i, j), at(i, j + 1), at(i + 1, j + 1)))
            faces.append((at(i, j), at(i + 1, j + 1), at(i + 1, j)))
        faces.append((at(RINGS - 1, j), at(RINGS - 1, j + 1), len(vertices) - 1))
    return Mesh(vertices, np.array(faces, np.int64))


@functools.cache
def _half_spaces_of_ball() -> tuple[Float[np.ndarray, "f 3"], Float[np.ndarray, " f"]]:
    """Normals n and offsets d of the ball's faces; inside, n . u < d for all of them."""
    mesh = _ball()
    a, b, c = np.moveaxis(mesh.vertices[mesh.faces], 1, 0)
    normals = np.cross(b - a, c - a)
    return normals, np.einsum("fk,fk->f", normals, a)


def rotation(degrees: Sequence[float]) -> Float[np.ndarray, "3 3"]:
    """Rz(c) Ry(b) Rx(a) of the angles a, b, c."""
    (ca, cb, cc), (sa, sb, sc) = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    about_x = np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]])
    about_y = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
    about_z = np.array([[cc, -sc, 0], [sc, cc, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def solids_of(answer: Any) -> list[Solid]:
    """All parts of an `answers.Answer` with their symmetric copies, in the project's frame."""
    turn, middle = rotation((0, 0, answer.turn)), np.array([answer.x, answer.y, 0.0])
    solids = []
    for part in answer.parts:
        mesh = unit_mesh(part)
        own = rotation(part.turn) * np.array(part.size)
        for y in (1, -1) if "y" in part.mirror else (1,):
            for x in (1, -1) if "x" in part.mirror else (1,):
                copy = turn @ np.diag([x, y, 1.0])
                linear, shift = copy @ own, copy @ np.array(part.at) + middle
                faces = mesh.faces if x * y > 0 else mesh.faces[:, [0, 2, 1]]
                placed = Mesh(mesh.vertices @ linear.T + shift, faces)
                solids.append(Solid(part, placed, linear, shift))
    return solids


def inside(solid: Solid, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """Which points are inside a solid; on its surface either answer is possible."""
    unit = np.linalg.solve(solid.linear, (points - solid.shift).T).T
    if solid.part.kind == "sphere":
        normals, offsets = _half_spaces_of_ball()
        return np.asarray((unit @ normals.T < offsets).all(axis=1))
    within = np.abs(unit[:, 2]) < 0.5
    scale = 1 + (solid.part.taper - 1) * (unit[:, 2] + 0.5)
    return within & _in_polygon(unit[:, :2] / np.maximum(scale, 1e-9)[:, None], solid.part)


def _in_polygon(points: Float[np.ndarray, "n 2"], part: Any) -> Bool[np.ndarray, " n"]:
    """Which points are inside: those whose ray to the right crosses an odd number of edges."""
    starts = np.array(cross_section(part))
    ends = np.roll(starts, -1, axis=0)
    odd = np.zeros(len(points), bool)
    for (x0, y0), (x1, y1) in zip(starts, ends, strict=True):
        spans = (y0 > points[:, 1]) != (y1 > points[:, 1])
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = x0 + (points[:, 1] - y0) * (x1 - x0) / (y1 - y0)
        odd ^= spans & (points[:, 0] < crossing)
    return odd


# --- surface of the union ---------------------------------------------------------------------

_NUDGE = 1e-5
_ROUNDS = 400
"""Maximum number of rounds of sampling; each round replaces the hidden points of the previous one.

A model is refused if less than about 2 % of its surface is visible."""


class HiddenSurfaceError(ValueError):
    """Almost all of the surface is inside other parts."""


def sample_union(solids: Sequence[Solid], count: int, seed: int) -> Float[np.ndarray, "n 3"]:
    """Points uniform by area on the surface of the union of solids.

    A point of a solid's surface is left out if it is inside another solid or on a face where two
    solids touch. Where faces of two solids coincide and point to the same side, only the points of
    the first solid are kept.

    Args:
      solids: at least one.
      count: number of points.
      seed: the same seed gives the same points.

    Raises:
      HiddenSurfaceError: too little of the surface is visible.
    """
    rng = np.random.default_rng(seed)
    corners = np.concatenate([s.mesh.vertices[s.mesh.faces] for s in solids])
    owner = np.repeat(np.arange(len(solids)), [len(s.mesh.faces) for s in solids])
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double = np.linalg.norm(cross, axis=1)
    normals = cross / np.maximum(double, 1e-300)[:, None]
    cumulated = np.cumsum(double)
    kept: list[np.ndarray] = []
    missing = count
    for _ in range(_ROUNDS):
        level = (np.arange(missing) + rng.random(missing)) / missing * cumulated[-1]
        face = np.minimum(np.searchsorted(cumulated, level, side="right"), len(double) - 1)
        # The square root makes the points uniform in the triangle.
        root, other = np.sqrt(rng.random(missing)), rng.random(missing)
        weights = np.stack([1 - root, root * (1 - other), root * other], axis=1)
        points = np.einsum("nk,nkd->nd", weights, corners[face])
        visible = _on_union(solids, points, normals[face], owner[face])
        kept.append(points[visible])
        missing -= int(visible.sum())
        if not missing:
            return np.concatenate(kept).astype(np.float32)
    raise HiddenSurfaceError("almost all of its surface is inside other parts")


def _on_union(
    solids: Sequence[Solid], points: np.ndarray, normals: np.ndarray, owner: np.ndarray
) -> np.ndarray:
    out, back = points + _NUDGE * normals, points - _NUDGE * normals
    visible = np.ones(len(points), bool)
    for number, solid in enumerate(solids):
        low, high = solid.mesh.vertices.min(axis=0), solid.mesh.vertices.max(axis=0)
        near = ((points > low - 2 * _NUDGE) & (points < high + 2 * _NUDGE)).all(axis=1)
        rows = np.flatnonzero(near & visible & (owner != number))
        hidden = inside(solid, out[rows])
        hidden |= (number < owner[rows]) & inside(solid, back[rows])
        visible[rows[hidden]] = False
    return visible

"""Parts of procedural models: closed surfaces of few triangles.

Faces are counter-clockwise seen from outside, and +z is up.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy.interpolate
from numpy.typing import ArrayLike

from data_gen.mesh import unit_vectors
from data_gen.polygons import cut_ears


class Solid(NamedTuple):
    """A closed surface: vertices [V, 3] and faces [F, 3]."""

    vertices: np.ndarray
    faces: np.ndarray

    def at(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "Solid":
        return Solid(self.vertices + np.array([x, y, z]), self.faces)

    def turned(self, axis: str, degrees: float) -> "Solid":
        """The part, rotated about a coordinate axis; positive angles are counter-clockwise."""
        a, b = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
        cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        vertices = self.vertices.copy()
        vertices[:, a] = cosine * self.vertices[:, a] - sine * self.vertices[:, b]
        vertices[:, b] = sine * self.vertices[:, a] + cosine * self.vertices[:, b]
        return Solid(vertices, self.faces)

    def scaled(self, x: float, y: float, z: float) -> "Solid":
        """The scaled part; an odd number of negative factors mirrors it."""
        faces = self.faces[:, ::-1] if x * y * z < 0 else self.faces
        return Solid(self.vertices * [x, y, z], faces)

    def bent(self, shape: Callable[[np.ndarray], np.ndarray]) -> "Solid":
        """The part with vertices mapped by `shape`, [V, 3] to [V, 3]."""
        return Solid(shape(self.vertices.copy()), self.faces)


def _outward(vertices: np.ndarray, faces: np.ndarray) -> Solid:
    """Reverses all faces if the surface encloses a negative volume."""
    a, b, c = (vertices[faces[:, k]] - vertices.mean(axis=0) for k in range(3))
    volume = (np.cross(a, b) * c).sum()
    return Solid(vertices, faces[:, ::-1] if volume < 0 else faces)


def loft(rings: ArrayLike, loop: bool = False) -> Solid:
    """The surface through rings [K, N, 3], with caps, or closed from the last to the first ring."""
    points = np.asarray(rings, np.float64)
    count, size = points.shape[:2]
    i, j = np.mgrid[: count if loop else count - 1, :size]
    here, right = i * size + j, i * size + (j + 1) % size
    above, diagonal = (here + size) % (count * size), (right + size) % (count * size)
    quads = np.stack([here, right, diagonal, here, diagonal, above], axis=-1)
    faces = [quads.reshape(-1, 3)]
    vertices = [points.reshape(-1, 3)]
    extra = count * size
    for ring, flip in () if loop else ((0, True), (count - 1, False)):
        if np.ptp(points[ring], axis=0).max() < 1e-9:
            continue  # the ring is a point
        cap = _cap(points[ring])
        if cap is None:
            around = np.arange(size)
            cap = np.stack([around, np.roll(around, -1), 0 * around + extra - ring * size], axis=1)
            vertices.append(points[ring].mean(axis=0)[None])
            extra += 1
        cap = cap + ring * size
        faces.append(cap[:, ::-1] if flip else cap)
    return _outward(np.concatenate(vertices), np.concatenate(faces))


def _cap(ring: np.ndarray) -> np.ndarray | None:
    """Triangles between the points of a ring; None = use a fan around the centre."""
    following = np.roll(ring, -1, axis=0)
    total = np.cross(ring, following).sum(axis=0)
    axis = int(np.abs(total).argmax())
    flat = np.delete(ring, axis, axis=1)
    if (total[axis] > 0) == (axis == 1):
        flat = flat[:, ::-1]
    edge = np.roll(flat, -1, axis=0) - flat
    after = np.roll(edge, -1, axis=0)
    if (edge[:, 0] * after[:, 1] - edge[:, 1] * after[:, 0] >= -1e-12).all():
        if len(ring) > 4:
            return None
        second = np.arange(1, len(ring) - 1)
        return np.stack([0 * second, second, second + 1], axis=1)
    triangles = cut_ears(flat[None])[0]
    return triangles if total[axis] != 0 else None


def box(x: float, y: float, z: float, bevel: float = 0.0) -> Solid:
    """A box around the origin, with edges bevelled by at most a fifth of its lengths."""
    half = np.array([x, y, z]) / 2
    cut = min(bevel, 0.4 * half.min())
    if cut <= 0:
        outline = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * half[:2]
        return stack([(outline, -half[2]), (outline, half[2])])
    # The inner outline has sharp corners, so that no face at a corner is flat enough for smoothing.
    inner, outer = rounded(x - 2 * cut, y - 2 * cut, 0.0, 1), rounded(x, y, cut, 1)
    return stack(
        [(inner, -half[2]), (outer, cut - half[2]), (outer, half[2] - cut), (inner, half[2])]
    )


def block(
    x: tuple[float, float],
    y: tuple[float, float],
    z: tuple[float, float],
    bevel: float = 0.0,
    shape: Callable[..., Solid] = box,
) -> Solid:
    """A box, or a `pillow`, between two limits along each axis."""
    spans = np.array([x, y, z])
    return shape(*np.ptp(spans, axis=1), bevel).at(*spans.mean(axis=1))


def stack(levels: Sequence[tuple[np.ndarray, float]]) -> Solid:
    """The surface through horizontal outlines [N, 2], each with its height."""
    return loft([np.column_stack([outline, np.full(len(outline), z)]) for outline, z in levels])


def rounded(x: float, y: float, radius: float, steps: int = 3) -> np.ndarray:
    """Outline [4 (steps + 1), 2] of a rectangle with round corners."""
    radius = min(radius, x / 2, y / 2)
    angle = np.linspace(0, np.pi / 2, steps + 1)
    arc = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    a, b = x / 2 - radius, y / 2 - radius
    corners = []
    for quarter, (dx, dy) in enumerate(((a, b), (-a, b), (-a, -b), (a, -b))):
        cosine, sine = (1, 0, -1, 0)[quarter], (0, 1, 0, -1)[quarter]
        corners.append(arc @ np.array([[cosine, sine], [-sine, cosine]]) + [dx, dy])
    return np.concatenate(corners)


def pillow(x: float, y: float, z: float, radius: float, steps: int = 3) -> Solid:
    """A box around the origin with all edges round, for upholstery."""
    radius = min(radius, x / 2, y / 2, z / 2) * 0.999
    levels = []
    for a in np.linspace(0, np.pi / 2, steps + 1):
        pull = 2 * radius * (1 - np.sin(a))
        levels.append((rounded(x - pull, y - pull, radius, steps), radius - radius * np.cos(a)))
    for a in np.linspace(0, np.pi / 2, steps + 1):
        pull = 2 * radius * (1 - np.cos(a))
        levels.append((rounded(x - pull, y - pull, radius, steps), z - radius + radius * np.sin(a)))
    return stack(levels).at(z=-z / 2)


def lathe(profile: ArrayLike, sides: int = 24, loop: bool = False, smooth: int = 1) -> Solid:
    """The surface of revolution of a profile of (radius, z); with a `loop`, it has a hole."""
    points = np.asarray(profile, np.float64)
    if smooth > 1:
        points = smooth_path(np.insert(points, 1, 0.0, axis=1), smooth)[:, [0, 2]]
    angle = np.arange(sides) / sides * 2 * np.pi
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    return loft([circle * max(r, 0.0) + np.array([0, 0, z]) for r, z in points], loop)


def cylinder(radius: float, height: float, sides: int = 20, bevel: float = 0.0) -> Solid:
    """A cylinder around the origin along z."""
    half, cut = height / 2, min(bevel, 0.4 * radius, 0.4 * height)
    if cut <= 0:
        return lathe([(radius, -half), (radius, half)], sides)
    cap = radius - cut
    return lathe([(cap, -half), (radius, cut - half), (radius, half - cut), (cap, half)], sides)


def rod(start: ArrayLike, end: ArrayLike, radius: float, sides: int = 8) -> Solid:
    return tube(np.array([start, end]), radius, sides)


def ball(x: float, y: float, z: float, sides: int = 16) -> Solid:
    """An ellipsoid with these diameters around the origin."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, sides // 2 + 1)
    return lathe(
        [(0.0 if abs(a) > 1.57 else float(np.cos(a)), float(np.sin(a))) for a in angle], sides
    ).scaled(x / 2, y / 2, z / 2)


def upright(outline: np.ndarray, back: float, front: float, bevel: float = 0.0) -> Solid:
    """A plate with an outline of (z, y), from x = `back` to `front`."""
    small = inset(outline, bevel) if bevel else outline
    part = stack([(small, back), (outline, back + bevel), (outline, front - bevel), (small, front)])
    return Solid(part.vertices[:, [2, 1, 0]], part.faces[:, ::-1])


def prism(outline: ArrayLike, thickness: float, bevel: float = 0.0) -> Solid:
    """A side profile of (x, z), extruded along y, centred at y = 0."""
    flat = np.asarray(outline, np.float64)
    half, cut = thickness / 2, min(bevel, 0.4 * thickness)

    def ring(points: np.ndarray, y: float) -> np.ndarray:
        return np.stack([points[:, 0], np.full(len(points), y), points[:, 1]], axis=1)

    if cut <= 0:
        return loft([ring(flat, -half), ring(flat, half)])
    inner = inset(flat, cut)
    return loft(
        [ring(inner, -half), ring(flat, cut - half), ring(flat, half - cut), ring(inner, half)]
    )


def inset(outline: np.ndarray, distance: float) -> np.ndarray:
    """A polygon [N, 2] with its edges moved inward by a small distance."""
    before, after = outline - np.roll(outline, 1, axis=0), np.roll(outline, -1, axis=0) - outline
    (x, y), (u, v) = outline.T, np.roll(outline, -1, axis=0).T
    area = (x * v - y * u).sum()
    turn = np.array([[0.0, 1.0], [-1.0, 0.0]]) * np.sign(area)
    a, b = unit_vectors(before) @ turn, unit_vectors(after) @ turn
    middle = (a + b) / np.maximum(1 + (a * b).sum(axis=1, keepdims=True), 0.35)
    return outline + distance * middle


def smooth_path(points: ArrayLike, steps: int = 6) -> np.ndarray:
    """A Catmull-Rom curve [M, 3] through the points, for points at similar distances."""
    p = np.asarray(points, np.float64)
    p = np.concatenate([[2 * p[0] - p[1]], p, [2 * p[-1] - p[-2]]])
    t = (np.arange(steps) / steps)[:, None]
    a, b, c, d = (p[k : len(p) - 3 + k, None] for k in range(4))
    squared, cubed = 2 * a - 5 * b + 4 * c - d, 3 * b - a - 3 * c + d
    pieces = 0.5 * (2 * b + (c - a) * t + squared * t**2 + cubed * t**3)
    return np.concatenate([pieces.reshape(-1, p.shape[1]), p[-2:-1]])


def superellipse(x: float, y: float, power: float = 2.0, sides: int = 32) -> np.ndarray:
    """Outline [sides, 2] with |2u/x|^power + |2v/y|^power = 1; power 2 is an ellipse."""
    angle = np.arange(sides) / sides * 2 * np.pi
    flat = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.sign(flat) * np.abs(flat) ** (2 / power) * [x / 2, y / 2]


def hull(
    stations: Sequence[Sequence[float]], power: float = 2.0, steps: int = 3, sides: int = 24
) -> Solid:
    """A smooth body through superellipses perpendicular to the x axis.

    `stations` are rows of x, half width, half height and z of the centre. Between two rows are
    `steps` sections of `sides` points.
    """
    table = np.array(sorted(map(tuple, stations)))
    knots = np.arange(len(table))
    stations_x = np.interp(np.arange((len(table) - 1) * steps + 1) / steps, knots, table[:, 0])
    rows = scipy.interpolate.PchipInterpolator(table[:, 0], table[:, 1:])(stations_x)
    rings = []
    for x, row in zip(stations_x, rows, strict=True):
        outline = superellipse(2 * row[0], 2 * row[1], power, sides)
        rings.append(np.column_stack([np.full(sides, x), outline[:, 0], outline[:, 1] + row[2]]))
    return loft(rings)


_AEROFOIL = np.array(
    [(1, 0.04), (0.8, 0.4), (0.55, 0.78), (0.3, 1), (0.12, 0.8), (0.03, 0.42), (0, 0),
     (0.03, -0.3), (0.12, -0.5), (0.3, -0.6), (0.55, -0.45), (0.8, -0.2)]
)  # fmt: skip


def wing(sections: Sequence[Sequence[float]], thickness: float = 0.1, fin: bool = False) -> Solid:
    """A wing through aerofoils from the root to the tip, with the leading edge toward +x.

    `sections` are rows of x, y, z of the leading edge, and the chord. `thickness`, relative to the
    chord, is along z; along y for a `fin`.
    """
    rings = []
    for x, y, z, chord in sections:
        flat = np.stack([x - chord * _AEROFOIL[:, 0], np.full(12, y), np.full(12, z)], axis=1)
        flat[:, 1 if fin else 2] += thickness * chord * _AEROFOIL[:, 1]
        rings.append(flat)
    return loft(rings)


def sheet(grid: np.ndarray, thickness: float) -> Solid:
    """A curved panel of constant thickness, centred on the surface through a grid [K, N, 3]."""
    points = np.asarray(grid, np.float64)
    normal = unit_vectors(np.cross(np.gradient(points, axis=0), np.gradient(points, axis=1)))
    rows, columns = points.shape[:2]
    count = rows * columns
    index = np.arange(count).reshape(rows, columns)

    def quads(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
        return np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)

    front = quads(index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])
    border = np.concatenate([index[0, :-1], index[:-1, -1], index[-1, :0:-1], index[:0:-1, 0]])
    after = np.roll(border, -1)
    rim = quads(border, after, after + count, border + count)
    vertices = np.concatenate([points + normal * thickness / 2, points - normal * thickness / 2])
    faces = np.concatenate([front, front[:, ::-1] + count, rim])
    return _outward(vertices.reshape(-1, 3), faces)


def tube(path: ArrayLike, radius: ArrayLike, sides: int = 8) -> Solid:
    """A round bar along a path [M, 3]; `radius` is a number, or a number for each point."""
    points = np.asarray(path, np.float64)
    radii = np.broadcast_to(np.asarray(radius, np.float64), (len(points),))
    tangent = unit_vectors(np.gradient(points, axis=0))
    # Parallel transport of the frame, so that it does not twist.
    normal = np.cross(tangent[0], np.eye(3)[np.abs(tangent[0]).argmin()])
    rings = []
    angle = np.arange(sides) / sides * 2 * np.pi
    for point, t, r in zip(points, tangent, radii, strict=True):
        normal = normal - t * (normal @ t)
        normal = normal / max(float(np.linalg.norm(normal)), 1e-12)
        side = np.cross(t, normal)
        rings.append(point + r * (np.cos(angle)[:, None] * normal + np.sin(angle)[:, None] * side))
    return loft(rings)

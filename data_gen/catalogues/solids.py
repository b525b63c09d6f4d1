"""Parts of procedural models: closed surfaces of few triangles.

A part is `(vertices [V, 3], faces [F, 3])`, with faces counter-clockwise seen from outside. Sizes
are in the unit in which the model is built; +z is up. The normals of the finished model are
computed by `mesh.crease_normals`.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from data_gen.polygons import cut_ears


class Solid(NamedTuple):
    """A closed surface."""

    vertices: np.ndarray
    faces: np.ndarray

    def at(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "Solid":
        """The part, translated."""
        return Solid(self.vertices + np.array([x, y, z]), self.faces)

    def turned(self, axis: str, degrees: float) -> "Solid":
        """The part, rotated about a coordinate axis, counter-clockwise seen from its tip."""
        a, b = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
        cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        vertices = self.vertices.copy()
        vertices[:, a] = cosine * self.vertices[:, a] - sine * self.vertices[:, b]
        vertices[:, b] = sine * self.vertices[:, a] + cosine * self.vertices[:, b]
        return Solid(vertices, self.faces)

    def scaled(self, x: float, y: float, z: float) -> "Solid":
        """The part, scaled along the axes; an odd number of negative factors mirrors it."""
        faces = self.faces[:, ::-1] if x * y * z < 0 else self.faces
        return Solid(self.vertices * [x, y, z], faces)

    def mirrored(self) -> "Solid":
        """The part, mirrored: y becomes -y."""
        return self.scaled(1, -1, 1)

    def bent(self, shape: Callable[[np.ndarray], np.ndarray]) -> "Solid":
        """The part with its vertices mapped by `shape`, [V, 3] to [V, 3]."""
        return Solid(shape(self.vertices.copy()), self.faces)


def _outward(vertices: np.ndarray, faces: np.ndarray) -> Solid:
    """Reverses all faces if the surface encloses a negative volume."""
    a, b, c = (vertices[faces[:, k]] - vertices.mean(axis=0) for k in range(3))
    volume = (np.cross(a, b) * c).sum()
    return Solid(vertices, faces[:, ::-1] if volume < 0 else faces)


def loft(rings: np.ndarray | Sequence[np.ndarray], loop: bool = False) -> Solid:
    """The surface through rings [K, N, 3], with a cap on the first and the last ring.

    With `loop`, the last ring is joined to the first one, and there are no caps.

    The faces between the rings i and i + 1 at point j have the numbers 2 (i N + j) and
    2 (i N + j) + 1.
    """
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
            cap = np.stack(
                [around, (around + 1) % size, np.full(size, extra - ring * size)], axis=1
            )
            vertices.append(points[ring].mean(axis=0)[None])
            extra += 1
        cap = cap + ring * size
        faces.append(cap[:, ::-1] if flip else cap)
    return _outward(np.concatenate(vertices), np.concatenate(faces))


def _cap(ring: np.ndarray) -> np.ndarray | None:
    """Triangles between the points of a ring; None if a fan around its centre is used instead."""
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
    inner, outer = rounded(x - 2 * cut, y - 2 * cut, cut, 1), rounded(x, y, cut, 1)
    return stack(
        [(inner, -half[2]), (outer, cut - half[2]), (outer, half[2] - cut), (inner, half[2])]
    )


def stack(levels: Sequence[tuple[np.ndarray, float]]) -> Solid:
    """The surface through horizontal outlines [N, 2] at the given heights."""
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


def tray(
    outline: Callable[[float], np.ndarray], height: float, wall: float, recess: float
) -> Solid:
    """A slab from z = 0 to `height` with a recess in its underside.

    Args:
      outline: returns the outline [N, 2], moved inward by its argument.
      height: height of the slab.
      wall: thickness of the rim.
      recess: height of the recess, in [0, height).
    """
    edge, inner = outline(0.0), outline(wall)
    bevel = min(0.12 * height, wall / 2)
    top = [(edge, height - bevel), (outline(bevel), height)]
    depth = min(max(recess, 0.01 * height), 0.95 * height)
    return stack([(inner, depth), (inner, 0.0), (edge, 0.0), *top])


def lathe(profile: Sequence[tuple[float, float]], sides: int = 24, loop: bool = False) -> Solid:
    """The surface of revolution of a profile of (radius, z); a `loop` makes a ring with a hole."""
    angle = np.arange(sides) / sides * 2 * np.pi
    circle = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    return loft([circle * max(r, 0.0) + np.array([0, 0, z]) for r, z in profile], loop)


def cylinder(radius: float, height: float, sides: int = 20, bevel: float = 0.0) -> Solid:
    """A cylinder around the origin along z."""
    half, cut = height / 2, min(bevel, 0.4 * radius, 0.4 * height)
    if cut <= 0:
        return lathe([(radius, -half), (radius, half)], sides)
    return lathe(
        [(radius - cut, -half), (radius, cut - half), (radius, half - cut), (radius - cut, half)],
        sides,
    )


def rod(start: Sequence[float], end: Sequence[float], radius: float, sides: int = 8) -> Solid:
    """A straight round bar."""
    return tube([start, end], radius, sides)


def ball(x: float, y: float, z: float, sides: int = 16) -> Solid:
    """An ellipsoid with these diameters around the origin."""
    angle = np.linspace(-np.pi / 2, np.pi / 2, sides // 2 + 1)
    return lathe(
        [(0.0 if abs(a) > 1.57 else float(np.cos(a)), float(np.sin(a))) for a in angle], sides
    ).scaled(x / 2, y / 2, z / 2)


def prism(
    outline: np.ndarray | Sequence[Sequence[float]], thickness: float, bevel: float = 0.0
) -> Solid:
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
    area = (
        outline[:, 0] * np.roll(outline[:, 1], -1) - outline[:, 1] * np.roll(outline[:, 0], -1)
    ).sum()
    turn = np.array([[0.0, 1.0], [-1.0, 0.0]]) * np.sign(area)
    a = before / np.maximum(np.linalg.norm(before, axis=1, keepdims=True), 1e-12) @ turn
    b = after / np.maximum(np.linalg.norm(after, axis=1, keepdims=True), 1e-12) @ turn
    middle = (a + b) / np.maximum(1 + (a * b).sum(axis=1, keepdims=True), 0.35)
    return outline + distance * middle


def smooth_path(points: np.ndarray | Sequence[Sequence[float]], steps: int = 6) -> np.ndarray:
    """A Catmull-Rom curve [M, 3] through the points, for points at similar distances."""
    p = np.asarray(points, np.float64)
    p = np.concatenate([[2 * p[0] - p[1]], p, [2 * p[-1] - p[-2]]])
    t = (np.arange(steps) / steps)[:, None]
    pieces = [
        0.5
        * (
            2 * b
            + (c - a) * t
            + (2 * a - 5 * b + 4 * c - d) * t**2
            + (3 * b - a - 3 * c + d) * t**3
        )
        for a, b, c, d in zip(p[:-3], p[1:-2], p[2:-1], p[3:], strict=True)
    ]
    return np.concatenate([*pieces, p[-2:-1]])


# --- Cushions, sweeps and tubes ---------------------------------------------------------------


def superellipse(x: float, y: float, power: float = 2.0, sides: int = 32) -> np.ndarray:
    """Outline [sides, 2] with |2u/x|^power + |2v/y|^power = 1; power 2 is an ellipse."""
    angle = np.arange(sides) / sides * 2 * np.pi
    flat = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.sign(flat) * np.abs(flat) ** (2 / power) * [x / 2, y / 2]


def cushion(
    x: float, y: float, z: float, corner: float = 5.0, edge: float = 2.5, sides: int = 28
) -> Solid:
    """A superellipsoid around the origin, for cushions.

    Args:
      x: length.
      y: width.
      z: height.
      corner: power of the outline seen from above; 2 = round, large = square.
      edge: power of the outline seen from the side; 1 = sharp seams, 2 = round, large = a slab.
      sides: number of points around the outline.
    """
    flat = superellipse(x, y, corner, sides)
    latitude = np.linspace(-np.pi / 2, np.pi / 2, 11)
    radius = np.abs(np.cos(latitude)) ** (2 / edge)
    height = np.sign(latitude) * np.abs(np.sin(latitude)) ** (2 / edge) * z / 2
    radius[[0, -1]] = 0.0
    return stack([(flat * r, float(h)) for r, h in zip(radius, height, strict=True)])


def smooth_profile(points: Sequence[Sequence[float]], steps: int = 4) -> list[tuple[float, float]]:
    """A smooth curve of (radius, z) through the points, for `lathe`; radii stay at least 0."""
    curve = smooth_path([(r, 0.0, z) for r, z in points], steps)
    return [(max(float(r), 0.0), float(z)) for r, _, z in curve]


def sweep(
    section: np.ndarray,
    path: np.ndarray | Sequence[Sequence[float]],
    across: Sequence[float],
    scale: float | np.ndarray | Sequence[float] = 1.0,
    loop: bool = False,
) -> Solid:
    """A section swept along a path in a plane.

    Args:
      section: outline [N, 2]; its first axis is `across`, its second is in the plane of the path.
      path: [M, 3].
      across: the normal of the plane of the path.
      scale: scale of the section, one number or one for each point.
      loop: whether the path is closed.
    """
    points = np.asarray(path, np.float64)
    side = np.asarray(across, np.float64) / np.linalg.norm(across)
    if loop:
        step = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    else:
        step = np.gradient(points, axis=0)
    normal = np.cross(step, side)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    size = np.broadcast_to(np.asarray(scale, np.float64), (len(points),))[:, None, None]
    rings = section[None, :, :1] * side + section[None, :, 1:] * normal[:, None]
    return loft(points[:, None] + size * rings, loop)


def _grid_normals(points: np.ndarray) -> np.ndarray:
    """Unit normals [K, N, 3] of the surface through a grid of points."""
    normal = np.cross(np.gradient(points, axis=0), np.gradient(points, axis=1))
    return normal / np.maximum(np.linalg.norm(normal, axis=2, keepdims=True), 1e-12)


def sheet(grid: np.ndarray, thickness: float) -> Solid:
    """A curved panel of constant thickness, centred on the surface through a grid [K, N, 3]."""
    points = np.asarray(grid, np.float64)
    normal = _grid_normals(points)
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


def rise(path: Callable[[float], Sequence[float]], steps: int) -> np.ndarray:
    """The curve [steps + 1, 3] of a function of t in [0, 1]."""
    return np.array([path(float(t)) for t in np.linspace(0, 1, steps + 1)], np.float64)


def tube(
    path: np.ndarray | Sequence[Sequence[float]],
    radius: float | np.ndarray | Sequence[float],
    sides: int = 8,
) -> Solid:
    """A round bar along a path [M, 3]; `radius` is one number or one for each point."""
    points = np.asarray(path, np.float64)
    radii = np.broadcast_to(np.asarray(radius, np.float64), (len(points),))
    step = np.gradient(points, axis=0)
    tangent = step / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-12)
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


def pane(grid: np.ndarray, thickness: float) -> Solid:
    """Like `sheet`, but the surface through the points is the outer side of the panel."""
    points = np.asarray(grid, np.float64)
    return sheet(points - thickness / 2 * _grid_normals(points), thickness)


def split(solid: Solid, chosen: np.ndarray) -> tuple[Solid, Solid]:
    """Two solids: the chosen faces (bool [F]) and the other faces. Both are open at the cut."""
    return Solid(solid.vertices, solid.faces[chosen]), Solid(solid.vertices, solid.faces[~chosen])

"""Triangulation of polygons."""

from collections.abc import Callable, Sequence

import numpy as np

MOST_CORNERS = 4000
"""Largest number of corners of a polygon from which we cut ears; larger ones become fans."""


def cut_ears(outlines: np.ndarray) -> np.ndarray:
    """Triangulates simple polygons, counter-clockwise [p, n, 2], by cutting ears: [p, n - 2, 3].

    An ear is a convex corner whose triangle contains no other corner. We cut the first ear of each
    polygon, then the first ear of the rest, and so on. Corners at the position of a corner of the
    ear do not count, because a bridge to a hole has both ends twice. A corner that repeats the one
    before it is an ear without area. The triangles of a polygon that intersects itself may overlap.
    """
    points, (count, size) = outlines, outlines.shape[:2]
    rows, left = np.arange(count), np.tile(np.arange(size), (count, 1))
    convex, inside = np.zeros((count, size), bool), np.zeros((count, size), np.int64)
    repeats = (points == np.roll(points, 1, axis=1)).all(axis=2)

    def measure(column: np.ndarray) -> None:
        """For a corner of each polygon: is it convex, and how many corners are in its triangle?"""
        a, b, c = (points[rows, (column + k) % size][:, None] for k in (-1, 0, 1))
        again = repeats[rows, left[rows, column]] & (a == b).all(axis=(1, 2))
        convex[rows, column] = again | (_cross(a, b, c)[:, 0] > 0)
        inside[rows, column] = np.where(again, 0, _contains(a, b, c, points).sum(axis=1))

    with np.errstate(over="ignore", invalid="ignore"):
        for column in range(size):
            measure(np.full(count, column))
        result = []
        while size > 3:
            ear = (convex & (inside <= 0)).argmax(axis=1)  # the first corner if there is no ear
            result.append(np.stack([left[rows, (ear + k) % size] for k in (-1, 0, 1)], axis=1))
            a, b, c = (np.roll(points, shift, axis=1) for shift in (1, 0, -1))
            inside -= _contains(a, b, c, points[rows, ear][:, None])
            kept = np.arange(size) != ear[:, None]
            size -= 1
            points, left, convex, inside = (
                values[kept].reshape(count, size, *values.shape[2:])
                for values in (points, left, convex, inside)
            )
            measure((ear - 1) % size)
            measure(ear % size)
    return np.stack([*result, left], axis=1)


def _contains(a: np.ndarray, b: np.ndarray, c: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether triangles a, b, c contain points other than their corners."""
    result: np.ndarray = (_cross(a, b, points) >= 0) & (_cross(b, c, points) >= 0)
    result &= _cross(c, a, points) >= 0
    for corner in (a, b, c):
        result &= (points != corner).any(axis=-1)
    return result


def strip(count: int) -> np.ndarray:
    """The corners [T, 3] of the triangles of a strip with `count` corners."""
    first = np.arange(max(count - 2, 0))
    odd = first % 2
    return np.stack([first + odd, first + 1 - odd, first + 2], axis=1)


def fan(count: int) -> np.ndarray:
    """The corners [T, 3] of the triangles of a fan with `count` corners."""
    first = np.arange(max(count - 2, 0))
    return np.stack([0 * first, first + 1, first + 2], axis=1)


def with_holes(points: np.ndarray, sizes: Sequence[int]) -> np.ndarray:
    """The corners of a polygon around an outline and its holes, as indices of `points`.

    A bridge, passed twice, connects each hole to the nearest corner of what precedes it.

    Args:
      points: [n, 3], the corners of the outline, then of each hole.
      sizes: number of corners of the outline and of each hole.
    """
    order, *holes = np.split(np.arange(len(points)), np.cumsum(sizes)[:-1])

    def normal(corners: np.ndarray) -> np.ndarray:
        return np.cross(points[corners], points[np.roll(corners, -1)]).sum(axis=0)

    outward = normal(order)
    for hole in holes:
        if not len(hole):
            continue
        if normal(hole) @ outward > 0:
            hole = hole[::-1]
        apart = ((points[order][:, None] - points[hole]) ** 2).sum(axis=2)
        one, two = np.unravel_index(apart.argmin(), apart.shape)
        around = np.roll(hole, -two)
        order = np.concatenate([order[: one + 1], around, around[:1], order[one:]])
    return order


def _cross(o: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Twice the area of the triangles o, a, b, positive counter-clockwise."""
    result: np.ndarray = (a[..., 0] - o[..., 0]) * (b[..., 1] - o[..., 1]) - (
        a[..., 1] - o[..., 1]
    ) * (b[..., 0] - o[..., 0])
    return result


def triangles(
    counts: np.ndarray, corners: np.ndarray, vertices: np.ndarray, charge: Callable[..., object]
) -> tuple[np.ndarray, np.ndarray]:
    """Triangulates polygons with `counts` [P] corners. `corners` [C] are indices of vertices.

    `charge(made=BYTES)` may refuse the work of concave polygons, see `model_files.Budget`.

    Returns:
      Indices [T, 3] of `corners`, and the polygon of each triangle [T].
    """
    start, own = (np.cumsum(n) - n for n in (counts, counts - 2))
    polygon = np.repeat(np.arange(len(counts)), counts - 2)
    number = np.arange(len(polygon)) - own[polygon]
    first = start[polygon]
    result = np.stack([first, first + number + 1, first + number + 2], axis=1)
    # A fan is correct for convex polygons. If its triangles differ in orientation, we cut ears,
    # which would be too slow with thousands of corners.
    if (counts > 3).any():
        a, b, c = (vertices[corners[result[:, k]]] for k in range(3))
        normal = np.cross(b - a, c - a)
        total = np.stack([np.bincount(polygon, n, len(counts)) for n in normal.T], axis=1)
        turned = (normal * total[polygon]).sum(axis=1) < 0
        concave = np.unique(polygon[turned])
        size = counts[concave].astype(np.float64)
        charge(made=64 * (size[size <= MOST_CORNERS] ** 2).sum())
        for size in np.unique(counts[concave]):
            if size > MOST_CORNERS:
                break
            chosen = concave[counts[concave] == size]
            span = start[chosen, None] + np.arange(size)
            axis = np.abs(total[chosen]).argmax(axis=1)
            kept = np.array([[1, 2], [0, 2], [0, 1]])[axis]
            flat = np.take_along_axis(vertices[corners[span]], kept[:, None], axis=2)
            # Without this axis, the orientation is the same or reversed.
            over = (total[chosen, axis] > 0) == (axis == 1)
            flat[over] = flat[over][..., ::-1]
            ears = cut_ears(flat)
            result[own[chosen, None] + np.arange(size - 2)] = np.take_along_axis(
                span[:, None], ears.reshape(len(chosen), 1, -1), axis=2
            ).reshape(ears.shape)
    return result, polygon

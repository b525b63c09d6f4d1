"""Triangulation of polygons."""

import numpy as np


def cut_ears(outline: np.ndarray) -> np.ndarray:
    """Triangulates a simple polygon [n, 2], counter-clockwise, by cutting ears: int [n - 2, 3].

    For a polygon that intersects itself the number of triangles is the same, but they may overlap.
    """
    rest = list(range(len(outline)))
    result = []

    def cross(o: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
        return float((a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]))

    while len(rest) > 3:
        best = 0
        for k in range(len(rest)):
            before, here, after = rest[k - 1], rest[k], rest[(k + 1) % len(rest)]
            a, b, c = outline[before], outline[here], outline[after]
            if cross(a, b, c) <= 0:
                continue
            others = [i for i in rest if i not in (before, here, after)]
            if not any(
                cross(a, b, p) >= 0 and cross(b, c, p) >= 0 and cross(c, a, p) >= 0
                for p in outline[others]
            ):
                best = k
                break
        result.append((rest[best - 1], rest[best], rest[(best + 1) % len(rest)]))
        del rest[best]
    return np.array([*result, tuple(rest)])


def triangles(
    counts: np.ndarray, corners: np.ndarray, vertices: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Triangulates polygons.

    Args:
      counts: number of corners [P] of each polygon, at least 3.
      corners: vertex index of each corner, polygon after polygon.
      vertices: [V, 3].

    Returns:
      Positions [T, 3] in `corners`, and the polygon [T] of each triangle.
    """
    start = np.cumsum(counts) - counts
    polygon = np.repeat(np.arange(len(counts)), counts - 2)
    number = np.arange(len(polygon)) - np.repeat(np.cumsum(counts - 2) - (counts - 2), counts - 2)
    first = start[polygon]
    result = np.stack([first, first + number + 1, first + number + 2], axis=1)
    # A fan is correct for convex polygons. If its triangles do not all have the same orientation,
    # ears are cut instead, except for polygons of several hundred corners: that is too slow.
    if (counts > 3).any():
        a, b, c = (vertices[corners[result[:, k]]] for k in range(3))
        normal = np.cross(b - a, c - a)
        total = np.stack(
            [np.bincount(polygon, normal[:, k], len(counts)) for k in range(3)], axis=1
        )
        turned = (normal * total[polygon]).sum(axis=1) < 0
        for index in np.unique(polygon[turned]):
            if counts[index] > 200:
                continue
            span = np.arange(start[index], start[index] + counts[index])
            axis = int(np.abs(total[index]).argmax())
            flat = np.delete(vertices[corners[span]], axis, axis=1)
            # Dropping an axis keeps or reverses the orientation.
            if (total[index, axis] > 0) == (axis == 1):
                flat = flat[:, ::-1]
            result[polygon == index] = span[cut_ears(flat)]
    return result, polygon

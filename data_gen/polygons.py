"""Triangulation of polygons."""

import numpy as np

MOST_CORNERS = 200
"""Largest number of corners of a polygon that is triangulated by cutting ears; others use a fan."""

_BLOCK = 1 << 22  # triples of corners that are compared at a time, one byte each


def cut_ears(outlines: np.ndarray) -> np.ndarray:
    """Triangulates simple polygons by cutting ears: int [p, n - 2, 3].

    A corner is an ear if its triangle is convex and contains no other corner. In each polygon the
    first ear is cut, then the first ear of the remaining polygon, and so on, one step at a time for
    all polygons. When an ear is cut, the triangles of its two neighbours change and are tested
    again. The triangles of all other corners stay the same, but the cut corner is no longer
    considered for them. If a polygon intersects itself, the number of triangles is the same, but
    they may overlap.

    Args:
      outlines: float [p, n, 2], the corners of p polygons, counter-clockwise.
    """
    blocks = -(-outlines.shape[0] * outlines.shape[1] ** 2 // _BLOCK)
    if blocks > 1 and len(outlines) > 1:
        return np.concatenate([cut_ears(part) for part in np.array_split(outlines, blocks)])
    count, corners = outlines.shape[:2]
    rows = np.arange(count)
    before = np.tile(np.roll(np.arange(corners), 1), (count, 1))
    after = np.tile(np.roll(np.arange(corners), -1), (count, 1))
    left = np.ones((count, corners), np.bool_)
    convex = np.zeros((count, corners), np.bool_)
    holds = np.zeros((count, corners, corners), np.bool_)

    def look_at(corner: np.ndarray) -> None:
        own = before[rows, corner], corner, after[rows, corner]
        a, b, c = (outlines[rows, index][:, None] for index in own)
        convex[rows, corner] = (_cross(a, b, c) > 0)[:, 0]
        inside = left & (_cross(a, b, outlines) >= 0)
        inside &= _cross(b, c, outlines) >= 0
        inside &= _cross(c, a, outlines) >= 0
        for index in own:
            inside[rows, index] = False
        holds[rows, corner] = inside

    with np.errstate(over="ignore", invalid="ignore"):
        for corner in range(corners):
            look_at(np.full(count, corner))
        held = holds.sum(axis=2)
        result = np.empty((count, corners - 2, 3), np.int64)
        for number in range(corners - 3):
            ears = left & convex & (held == 0)
            ear = np.where(ears.any(axis=1), ears.argmax(axis=1), left.argmax(axis=1))
            one, two = before[rows, ear], after[rows, ear]
            result[:, number] = np.stack([one, ear, two], axis=1)
            left[rows, ear] = False
            after[rows, one], before[rows, two] = two, one
            held -= holds[rows, :, ear]
            for corner in (one, two):
                look_at(corner)
                held[rows, corner] = holds[rows, corner].sum(axis=1)
        result[:, -1] = np.nonzero(left)[1].reshape(count, 3)
    return result


def _cross(o: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Twice the area of the triangles o, a, b, positive counter-clockwise."""
    result: np.ndarray = (a[..., 0] - o[..., 0]) * (b[..., 1] - o[..., 1]) - (
        a[..., 1] - o[..., 1]
    ) * (b[..., 0] - o[..., 0])
    return result


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
    # ears are cut instead. For polygons with several hundred corners this would be too slow.
    if (counts > 3).any():
        a, b, c = (vertices[corners[result[:, k]]] for k in range(3))
        normal = np.cross(b - a, c - a)
        total = np.stack(
            [np.bincount(polygon, normal[:, k], len(counts)) for k in range(3)], axis=1
        )
        turned = (normal * total[polygon]).sum(axis=1) < 0
        concave = np.unique(polygon[turned])
        own = np.cumsum(counts - 2) - (counts - 2)
        for size in np.unique(counts[concave]):
            if size > MOST_CORNERS:
                break
            chosen = concave[counts[concave] == size]
            span = start[chosen, None] + np.arange(size)
            axis = np.abs(total[chosen]).argmax(axis=1)
            kept = np.array([[1, 2], [0, 2], [0, 1]])[axis]
            flat = np.take_along_axis(vertices[corners[span]], kept[:, None], axis=2)
            # Dropping an axis keeps or reverses the orientation.
            over = (total[chosen, axis] > 0) == (axis == 1)
            flat[over] = flat[over][..., ::-1]
            ears = cut_ears(flat)
            result[own[chosen, None] + np.arange(size - 2)] = np.take_along_axis(
                span[:, None], ears.reshape(len(chosen), 1, -1), axis=2
            ).reshape(ears.shape)
    return result, polygon

"""Triangulation of polygons."""

from collections.abc import Sequence

import numpy as np

MOST_CORNERS = 4000
"""Largest number of corners of a polygon that is triangulated by cutting ears; others use a fan."""

_AT_ONCE = 100  # polygons with more corners are cut one by one

_BLOCK = 1 << 22  # triples of corners that are compared at a time, one byte each


def cut_ears(outlines: np.ndarray) -> np.ndarray:
    """Triangulates simple polygons, counter-clockwise [p, n, 2], by cutting ears: [p, n - 2, 3].

    An ear is a corner whose triangle is convex and contains no other corner. We cut the first ear
    of each polygon, then the first ear of the rest, and so on. Corners at the same place do not
    count: a bridge to a hole has its two ends twice. A polygon that intersects itself has as many
    triangles, but they may overlap.
    """
    count, size = outlines.shape[:2]
    if size > _AT_ONCE:
        return np.stack([_cut_ears_of_one(outline) for outline in outlines])
    parts = -(-count * size**2 // _BLOCK)
    if parts > 1 and count > 1:
        return np.concatenate([cut_ears(part) for part in np.array_split(outlines, parts)])
    rows = np.arange(count)
    left = np.tile(np.arange(size), (count, 1))
    result = []
    while size > 3:
        points = np.take_along_axis(outlines, left[..., None], axis=1)
        a, b, c = (np.roll(points, shift, axis=1)[:, :, None] for shift in (1, 0, -1))
        others = points[:, None]
        with np.errstate(over="ignore", invalid="ignore"):
            convex = _cross(a, b, c)[..., 0] > 0
            inside = _cross(a, b, others) >= 0
            inside &= _cross(b, c, others) >= 0
            inside &= _cross(c, a, others) >= 0
        for corner in (a, b, c):
            inside &= (others != corner).any(axis=-1)
        own = (np.arange(size)[:, None] - np.arange(size)) % size
        ears = convex & ~(inside & ~np.isin(own, [0, 1, size - 1])).any(axis=2)
        ear = ears.argmax(axis=1)  # the first corner if there is none
        result.append(np.stack([left[rows, (ear + k) % size] for k in (-1, 0, 1)], axis=1))
        left = left[np.arange(size) != ear[:, None]].reshape(count, size - 1)
        size -= 1
    return np.stack([*result, left], axis=1)


def _cut_ears_of_one(outline: np.ndarray) -> np.ndarray:
    """`cut_ears` for one polygon [n, 2]: only the neighbours of a cut ear are compared again."""
    size = len(outline)
    before, after = np.arange(-1, size - 1) % size, np.arange(1, size + 1) % size
    left = np.ones(size, bool)

    def is_ear(corner: int) -> bool:
        a, b, c = outline[before[corner]], outline[corner], outline[after[corner]]
        if _cross(a, b, c) <= 0:
            return False
        others = outline[left]
        inside = _cross(a, b, others) >= 0
        inside &= (_cross(b, c, others) >= 0) & (_cross(c, a, others) >= 0)
        for own in (a, b, c):
            inside &= (others != own).any(axis=1)
        return not inside.any()

    ears = np.array([is_ear(corner) for corner in range(size)])
    result = []
    for _ in range(size - 2):
        if not (ears & left).any():  # a corner that was in the way may be gone
            ears = np.array([there and is_ear(corner) for corner, there in enumerate(left)])
        corner = int((ears & left if (ears & left).any() else left).argmax())
        one, two = before[corner], after[corner]
        result.append((one, corner, two))
        left[corner], after[one], before[two] = False, two, one
        ears[one], ears[two] = is_ear(one), is_ear(two)
    return np.array(result)


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
    """The order of corners of one polygon that goes around an outline and around its holes.

    Args:
      points: [n, 3], the corners of the outline, then those of each hole.
      sizes: their numbers.

    A bridge, which is passed twice, connects each hole to the nearest corner before it.
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
    counts: np.ndarray, corners: np.ndarray, vertices: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Triangulates polygons with `counts` [P] corners, whose vertices are `corners` in order.

    It returns positions [T, 3] in `corners`, and the polygon [T] of each triangle.
    """
    start, own = (np.cumsum(n) - n for n in (counts, counts - 2))
    polygon = np.repeat(np.arange(len(counts)), counts - 2)
    number = np.arange(len(polygon)) - own[polygon]
    first = start[polygon]
    result = np.stack([first, first + number + 1, first + number + 2], axis=1)
    # A fan is correct for convex polygons. If its triangles do not all have the same orientation,
    # ears are cut instead. For polygons with thousands of corners this would be too slow.
    if (counts > 3).any():
        a, b, c = (vertices[corners[result[:, k]]] for k in range(3))
        normal = np.cross(b - a, c - a)
        total = np.stack([np.bincount(polygon, n, len(counts)) for n in normal.T], axis=1)
        turned = (normal * total[polygon]).sum(axis=1) < 0
        concave = np.unique(polygon[turned])
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

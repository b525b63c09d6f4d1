"""Solid occupancy of a model on a grid."""

from collections.abc import Iterator, Sequence

import numpy as np
import scipy.ndimage
import scipy.sparse
from jaxtyping import Bool, Float, Int

from data_gen.mesh import Model, UnusableModelError
from psgn_jax.data import schema

# Number of small cells along the edge of a cell. As it is odd, a cell counts as half full if the
# surface reaches its middle. With an even number, flat objects would be too thick.
_FINE = 3

# Tolerance at the border of a triangle, in small cells: much more than the rounding of coordinates,
# so that no line passes between two triangles with a common edge.
_TOLERANCE = 1e-6

# Largest number of intersections with the lines along an axis. They take seconds, and only
# pathological models have more.
_MAX_POINTS = 10_000_000

_COST_AT_ONCE = 1_000_000  # intersections; this bounds the memory
_SPACING = 0.7  # distance between the sample points on an edge, in small cells


def repeat_numbers(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Owner and number (from 0) of each item, if owner i has `counts[i]` items."""
    owner = np.repeat(np.arange(len(counts)), counts)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)


def in_parts(counts: np.ndarray, costs: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Parts of `repeat_numbers(counts)`; the owners of a part cost about `_COST_AT_ONCE`."""
    group = np.floor(np.cumsum(costs) / _COST_AT_ONCE).astype(np.int64)
    for part in np.split(np.arange(len(counts)), np.flatnonzero(np.diff(group)) + 1):
        owner, number = repeat_numbers(counts[part])
        yield part[owner], number


def _centres_between(low: np.ndarray, high: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """The first cell of the grid with its centre in [low, high], and the number of these cells."""
    first = np.maximum(np.ceil(low - (0.5 + _TOLERANCE)), 0)
    last = np.minimum(np.floor(high + (_TOLERANCE - 0.5)), size - 1)
    return first, np.maximum(last - first + 1, 0).astype(np.int64)


def _bounds(values: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Minimum and maximum of the three values of each face; faster than over an axis."""
    a, b, c = (values[column] for column in faces.T)
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def _line_hits(
    corners: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], axis: int, size: int
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Intersections of triangles with the lines along an axis through the centres of cells.

    For each triangle, we go through the lines row by row. A triangle contains its border, so a line
    through a common edge of two triangles intersects at least one of the triangles.

    Yields:
      The cell of the line along each of the next two axes (in cyclic order), and the position on
      the line.
    """
    u, v, w = (np.ascontiguousarray(corners[:, (axis + k) % 3]) for k in (1, 2, 0))
    first, rows = _centres_between(*_bounds(v, faces), size)
    rows *= _centres_between(*_bounds(u, faces), size)[1] > 0
    kept = np.flatnonzero(rows)
    faces, first, rows = faces[kept], first[kept], rows[kept]
    if not len(faces):
        return
    faces = np.take_along_axis(faces, v[faces].argsort(axis=1, kind="stable"), axis=1)
    low, middle, high = faces.T
    width = _centres_between(*_bounds(u, faces), size)[1]
    # On average, the rows of a triangle are half as long as its width.
    bound = rows * (width / 2 + 1)
    if bound.sum() > _MAX_POINTS:
        count = f"{bound.sum():.2g} intersections with lines of cells"
        raise UnusableModelError(f"{count}, more than the limit of {_MAX_POINTS:.2g}")
    for owner, number in in_parts(rows, bound):
        row = first[owner] + number
        # Both ends of the row: the first on the two shorter edges along v, the second on the edge
        # from the lowest corner to the highest.
        at = row + 0.5
        lower = at <= v[middle[owner]]
        begin = np.where(lower, low[owner], middle[owner])
        end = np.where(lower, middle[owner], high[owner])
        span = v[end] - v[begin]
        along = np.clip((at - v[begin]) / np.where(span > 0, span, 1), 0, 1)
        along = np.where(span > 0, along, lower)
        one_u, one_w = (c[begin] + along * (c[end] - c[begin]) for c in (u, w))
        begin, end = low[owner], high[owner]
        along = np.clip((at - v[begin]) / np.maximum(v[end] - v[begin], 1e-300), 0, 1)
        two_u, two_w = (c[begin] + along * (c[end] - c[begin]) for c in (u, w))
        over = one_u > two_u
        one_u, two_u = np.where(over, two_u, one_u), np.where(over, one_u, two_u)
        one_w, two_w = np.where(over, two_w, one_w), np.where(over, one_w, two_w)
        start, columns = _centres_between(one_u, two_u, size)
        slope = (two_w - one_w) / np.maximum(two_u - one_u, 1e-300)
        owner, number = repeat_numbers(columns)
        column = start[owner] + number
        position = np.clip(
            one_w[owner] + (column + 0.5 - one_u[owner]) * slope[owner],
            np.minimum(one_w, two_w)[owner],
            np.maximum(one_w, two_w)[owner],
        )
        yield column.astype(np.int64), row[owner].astype(np.int64), position


def _edge_points(corners: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Points [n, 3] on edges [E, 2], at most `_SPACING` apart, and all corners."""
    along = corners[edges[:, 1]] - corners[edges[:, 0]]
    steps = np.ceil(np.sqrt(np.einsum("nd,nd->n", along, along)) / _SPACING).astype(np.int64)
    inner = np.flatnonzero(steps > 1)
    owner, number = repeat_numbers(steps[inner] - 1)
    owner = inner[owner]
    part = (number + 1) / steps[owner]
    return np.concatenate([corners, corners[edges[owner, 0]] + part[:, None] * along[owner]])


def mark_surface(
    corners: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    edges: Int[np.ndarray, "e 2"],
    size: int,
) -> tuple[Bool[np.ndarray, "n n n"], list[Bool[np.ndarray, "n n n"]]]:
    """Marks the cells of a surface, so that a flood fill of unmarked cells does not cross it.

    We mark a cell if it contains
      - an intersection of the surface with a line along an axis through the centres of cells, or
      - a point of an edge or a corner of a triangle, to keep parts thinner than a cell.

    There is no leak. If the surface intersects the segment between the centres of two neighbouring
    cells, we mark the cell with the intersection. (A segment in the plane of a triangle also
    touches the border of another triangle, if it enters a closed surface.) Both cells would be
    unmarked only if rounding moved the intersection by half a cell.

    The grid spans [0, size] on each axis, in units of a cell. `faces` and their `edges` are indices
    of `corners`.

    Returns:
      The marked cells; and for each axis, whether the surface is between the centres of a cell and
      of the next cell.
    """
    marked = np.zeros((size, size, size), bool)
    crossed = []
    strides = size ** np.arange(2, -1, -1)
    for axis in range(3):
        between = np.zeros((size, size, size), bool)
        step = strides[axis]
        for column, row, position in _line_hits(corners, faces, axis, size):
            line = column * strides[(axis + 1) % 3] + row * strides[(axis + 2) % 3]
            # A point on the border of the grid belongs to the cell inside.
            cell = np.floor(position).astype(np.int64)
            cell[(position > -_TOLERANCE) & (position < 0)] = 0
            cell[(position >= size) & (position < size + _TOLERANCE)] = size - 1
            here = (cell >= 0) & (cell < size)
            marked.reshape(-1)[line[here] + cell[here] * step] = True
            cell = np.floor(position - 0.5).astype(np.int64)
            here = (cell >= 0) & (cell < size - 1)
            between.reshape(-1)[line[here] + cell[here] * step] = True
        crossed.append(between)
    cell = np.floor(_edge_points(corners, edges)).astype(np.int64)
    cell -= cell == size
    cell = cell[((cell >= 0) & (cell < size)).all(axis=1)]
    marked.reshape(-1)[cell @ strides] = True
    return marked, crossed


def outside_cells(blocked: np.ndarray) -> np.ndarray:
    """Cells that a flood fill reaches from the sides and the top of the grid, not from below."""
    padded = np.pad(~blocked, ((1, 1), (1, 1), (0, 1)), constant_values=True)
    label, _ = scipy.ndimage.label(padded)
    return (label == label[0, 0, -1])[1:-1, 1:-1, :-1]


def _with_border(
    outside: np.ndarray, marked: np.ndarray, crossed: Sequence[np.ndarray]
) -> np.ndarray:
    """The outside cells, and marked cells with their centre outside.

    A centre is outside if a neighbouring centre is outside and the surface is not between the two.
    Two steps suffice, because cells farther inside have marked neighbours only.
    """
    for _ in range(2):
        reached = np.zeros_like(outside)
        for axis, between in enumerate(crossed):
            first = tuple(slice(None, -1) if k == axis else slice(None) for k in range(3))
            second = tuple(slice(1, None) if k == axis else slice(None) for k in range(3))
            free = ~between[first]
            reached[first] |= outside[second] & free
            reached[second] |= outside[first] & free
        outside = outside | (marked & reached)
    return outside


def _in_cells(fine: np.ndarray) -> np.ndarray:
    """The number of true small cells in each large cell [x, y, z]."""
    counts = fine.view(np.uint8)
    # Sums of slices, axis by axis, are fifty times as fast as a sum over three axes.
    for axis in range(3):
        first, *others = (counts[*[slice(None)] * axis, start::_FINE] for start in range(_FINE))
        counts = first.copy()
        for part in others:
            counts += part
    return counts


# The 26 neighbours of a cell: offsets, which neighbours touch each other or share a face, and which
# are the 6 and the 18 nearest.
_OFFSETS = np.array([o for o in np.ndindex(3, 3, 3) if o != (1, 1, 1)]) - 1
_APART = np.abs(_OFFSETS[:, None] - _OFFSETS)
_TOUCHING = (_APART.max(axis=2) <= 1).astype(np.float32)
_ADJACENT = (_APART.sum(axis=2) <= 1).astype(np.float32)
_NEAREST_6, _NEAREST_18 = (np.abs(_OFFSETS).sum(axis=1) <= k for k in (1, 2))


def _one_piece(
    present: Bool[np.ndarray, "n 26"], wanted: Bool[np.ndarray, " 26"], links: np.ndarray
) -> Bool[np.ndarray, " n"]:
    """Whether wanted neighbours are present, and `links` through present neighbours join them."""
    ends = present & wanted
    reached = np.zeros_like(present)
    reached[np.arange(len(ends)), ends.argmax(axis=1)] = ends.any(axis=1)
    count = 0
    while reached.sum() > count:
        count = reached.sum()
        reached = (reached @ links > 0) & present
    result: np.ndarray = ends.any(axis=1) & ~(ends & ~reached).any(axis=1)
    return result


def peel(
    cells: Bool[np.ndarray, "x y z"], loose: Bool[np.ndarray, "x y z"]
) -> Bool[np.ndarray, "x y z"]:
    """Removes loose cells without changing the numbers of parts, holes and cavities.

    We remove a cell if it is simple (Bertrand and Malandain 1994): its occupied neighbours of 26
    are connected, and its empty neighbours of 6 are connected within the 18. Cells with coordinates
    of the same parity do not affect each other, so we remove them together.
    """
    result = np.pad(cells, 1)
    flat = result.reshape(-1)
    strides = np.array([result.shape[1] * result.shape[2], result.shape[2], 1])
    steps = _OFFSETS @ strides
    indices = np.argwhere(np.pad(cells & loose, 1))
    index, parity = indices @ strides, indices % 2 @ [4, 2, 1]
    groups = [index[parity == k] for k in range(8)]
    # Two rounds remove the skin of thick parts. More rounds would open slits between a sheet and a
    # wall, from the rim of the sheet.
    for _ in range(2):
        for number, group in enumerate(groups):
            around = flat[group[:, None] + steps]
            simple = _one_piece(~around & _NEAREST_18, _NEAREST_6, _ADJACENT)
            simple[simple] = _one_piece(around[simple], np.ones(26, bool), _TOUCHING)
            flat[group[simple]] = False
            groups[number] = group[~simple]
    return result[1:-1, 1:-1, 1:-1]


def solid_occupancy(model: Model, rotation: Float[np.ndarray, "3 3"]) -> Bool[np.ndarray, "n n n"]:
    """Solid voxels of a model, which need not be watertight.

    Indexed [x, y, z], the grid covers [-1, 1] x [-1, 1] x [0, 2] of the rotated frame.

      1. We mark the surface without gaps in small cells, a third of a cell wide.
      2. A flood fill from the sides and the top reaches the outside, so an object without a bottom
         is solid. A marked small cell belongs to the side of its centre.
      3. The same with the cells of the grid makes parts with cracks and gaps smaller than a cell
         solid, too.
      4. A cell is occupied if at least half of its small cells are inside.
      5. We keep thin parts: a cell with marked or inside small cells is also occupied, unless one
         of its 26 neighbours is occupied by rule 3 or 4 and `peel` removes it. So sheets and bars
         are one cell thick, or two where they pass from one layer of cells to the next. A solid has
         at most as many 26-connected components as the cells of its surface.

    Args:
      model: the model in the project's frame. We ignore parts outside the grid.
      rotation: from there to the frame of the grid.

    Raises:
      UnusableModelError: the area is so large that this would take minutes.
    """
    fine = schema.OCCUPANCY_SIZE * _FINE
    corners = (model.vertices @ np.asarray(rotation, np.float64).T + [1, 1, 0]) * (fine / 2)
    marked, crossed = mark_surface(corners, model.faces, model.edges, fine)
    touched = _in_cells(marked) > 0
    # The flood fill runs in the bounding box of the object with a margin of empty cells.
    if not touched.any():
        return touched
    large = [slice(int(i.min()), int(i.max()) + 1) for i in np.nonzero(touched)]
    large[2] = slice(0, large[2].stop)
    x, y, z = (slice(s.start * _FINE, s.stop * _FINE) for s in large)
    marked = marked[x, y, z]
    outside = outside_cells(marked)
    inside = ~_with_border(outside, marked, [c[x, y, z] for c in crossed])
    thick = ~outside_cells(touched) & ~touched
    thick[*large] |= _in_cells(inside) >= _FINE**3 // 2 + 1
    occupied = thick.copy()
    occupied[*large] |= _in_cells(~outside) > 0
    near = scipy.ndimage.maximum_filter(thick, size=3)
    return peel(occupied, near & ~thick)

"""Solid cells by winding numbers, counted independently of `meshes.solid_occupancy`."""

import numpy as np
import scipy.ndimage
import scipy.sparse
import scipy.sparse.csgraph

SIDE = 5  # points along the edge of a cell


def is_watertight(model):
    """Whether every edge (by position) is walked as often in one direction as in the other."""
    _, corner = np.unique(np.round(model.vertices, 6), axis=0, return_inverse=True)
    faces = corner.reshape(-1)[model.faces].astype(np.int64)
    pairs = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    key = pairs.min(axis=1) * len(model.vertices) + pairs.max(axis=1)
    _, index = np.unique(key, return_inverse=True)
    return not np.bincount(index, np.where(pairs[:, 0] < pairs[:, 1], 1, -1)).any()


# Of the points off the centres of their cells: what no model has in its coordinates.
_SHIFT = np.array([0.01234567, 0.00765432, 0.01012345])


def _meetings(corners, axis, fine):
    """Where triangles [F, 3, 3] meet the lines through the points along an axis.

    Returns:
      Steps of the winding number and whether a face lies there, both for the gap in front of each
      point and the one behind the last: fine + 1 entries along the axis, fine along the others.
    """
    a, b, c = np.moveaxis(np.roll(corners, -1 - axis, axis=2), 1, 0)  # the axis is the last
    b, c = b - a, c - a
    low = np.ceil(np.minimum(np.minimum(b, c), 0) + a - 0.5).astype(int).clip(0)
    high = np.floor(np.maximum(np.maximum(b, c), 0) + a + 0.5).astype(int).clip(None, fine)
    det = b[:, 0] * c[:, 1] - c[:, 0] * b[:, 1]
    steps = np.zeros((fine, fine, fine + 1), np.int16)
    met = np.zeros((fine, fine, fine + 1), bool)
    for i in np.flatnonzero((low < high)[:, :2].all(axis=1) & (det != 0)):
        column, row = (g.ravel() for g in np.mgrid[low[i, 0] : high[i, 0], low[i, 1] : high[i, 1]])
        x, y = column + 0.5 - a[i, 0], row + 0.5 - a[i, 1]
        s = (x * c[i, 1] - c[i, 0] * y) / det[i]
        t = (b[i, 0] * y - x * b[i, 1]) / det[i]
        hit = (s >= 0) & (t >= 0) & (s + t <= 1)
        place = a[i, 2] + s[hit] * b[i, 2] + t[hit] * c[i, 2]
        # The points in front of it are those with an index under this.
        index = np.ceil(place - 0.5).astype(int).clip(0, fine)
        line = (column[hit], row[hit], index)
        np.add.at(steps, line, 1 if det[i] > 0 else -1)
        met[line] = True
    return tuple(np.moveaxis(x, (0, 1, 2), np.roll((0, 1, 2), -1 - axis)) for x in (steps, met))


def _reached(air, met):
    """Points of air that air reaches from the sides and above, with no face between two points."""
    window = tuple(slice(int(i.min()), int(i.max()) + 1) for i in np.nonzero(~air | _beside(met)))
    window = (*window[:2], slice(0, window[2].stop))
    part = np.pad(air[window], ((1, 1), (1, 1), (0, 1)), constant_values=True)
    number = np.arange(part.size).reshape(part.shape)
    rows, columns = [], []
    for axis, between in enumerate(met):
        lead = tuple(slice(None, -1) if k == axis else slice(None) for k in range(3))
        next_ = tuple(slice(1, None) if k == axis else slice(None) for k in range(3))
        free = part[lead] & part[next_]
        # All gaps within the window, and those at its ends; around it there is no face.
        gaps = tuple(slice(s.start, s.stop + 1) if k == axis else s for k, s in enumerate(window))
        inner = tuple(slice(None) if k == axis else slice(0 if k == 2 else 1, -1) for k in range(3))
        blocked = between[gaps]
        if axis == 2:
            blocked = blocked[..., 1:]  # not through the ground
        free[inner] &= ~blocked
        rows.append(number[lead][free])
        columns.append(number[next_][free])
    rows, columns = np.concatenate(rows), np.concatenate(columns)
    graph = scipy.sparse.coo_array(
        (np.ones(len(rows), np.int8), (rows, columns)), shape=(part.size, part.size)
    )
    _, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    result = np.ones_like(air)
    label = label.reshape(part.shape)
    result[window] = (label == label[0, 0, -1])[1:-1, 1:-1, :-1]
    return result


def _beside(met):
    """Points next to a face, along any axis."""
    lead, behind = slice(None, -1), slice(1, None)
    x, y, z = met
    return x[lead] | x[behind] | y[:, lead] | y[:, behind] | z[..., lead] | z[..., behind]


def fields(model, rotation, size=32):
    """Points of the grid, 5 x 5 x 5 a cell: which are inside, and which are next to a face.

    The winding number of a point is that of the faces above it whose front is up, less those whose
    back is. Inside is where it is not 0. Air that is closed in, or between the object and the
    ground, counts as inside, even where the walls are thinner than the distance of the points.
    """
    fine = size * SIDE
    corners = ((model.vertices @ rotation.T + [1, 1, 0]) * (fine / 2) - _SHIFT)[model.faces]
    steps, met = zip(*(_meetings(corners, axis, fine) for axis in range(3)), strict=True)
    winding = steps[2][..., ::-1].cumsum(axis=2, dtype=np.int16)[..., ::-1][..., 1:]
    return ~_reached(winding == 0, met), _beside(met)


def inside(model, rotation, size=32):
    """The first of the `fields`."""
    return fields(model, rotation, size)[0]


def occupancy(points):
    """Cells of which at least half of the points of `inside` are inside."""
    size = len(points) // SIDE
    return points.reshape(size, SIDE, size, SIDE, size, SIDE).sum(axis=(1, 3, 5)) * 2 >= SIDE**3


def thick_parts(points, cells=3.0):
    """Points of parts that hold a ball of this diameter, in cells, and those half a cell around.

    The rest is thin: sheets, bars, edges.
    """
    radius = SIDE * cells / 2
    near = np.zeros_like(points)
    if points.any():
        # What is off the object does not matter; a margin keeps what lies around the parts.
        margin = SIDE
        window = tuple(
            slice(max(int(i.min()) - margin, 0), int(i.max()) + 1 + margin)
            for i in np.nonzero(points)
        )
        core = scipy.ndimage.distance_transform_edt(np.pad(points[window], 1)) >= radius
        if core.any():
            gap = scipy.ndimage.distance_transform_edt(~core)[1:-1, 1:-1, 1:-1]
            near[window] = gap <= radius + SIDE / 2
    return near


def cells_of(points, turn):
    """Cells of a grid whose centres are in `points`, a field of a grid turned by `turn` less."""
    size = len(points) // SIDE
    centre = (np.moveaxis(np.indices([size] * 3), 0, -1) + 0.5) / size * 2 - [1, 1, 0]
    index = np.floor((centre @ turn + [1, 1, 0]) * len(points) / 2).astype(int)
    kept = ((index >= 0) & (index < len(points))).all(axis=-1)
    return kept & points[tuple(np.moveaxis(index.clip(0, len(points) - 1), -1, 0))]


def sheltered(points, beside):
    """Points of air that only gaps of 2 points (0.4 cells) or less let in; of both `fields`.

    Voxels this large close such gaps, as between a drawer and its cabinet: what lies behind is
    solid to them.
    """
    # A gap of 2 points has a face next to either of them.
    wide = np.pad(~(points | beside), ((1, 1), (1, 1), (0, 1)), constant_values=True)
    label, _ = scipy.ndimage.label(wide)
    reached = scipy.ndimage.binary_dilation(label == label[0, 0, -1], np.ones((3, 3, 3), bool))
    return ~points & ~reached[1:-1, 1:-1, :-1]

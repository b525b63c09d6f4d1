"""Solid cells by winding numbers, counted independently of `voxelise.solid_occupancy`."""

import numpy as np
import scipy.ndimage

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


def inside(model, rotation, size=32):
    """Points of the grid, 5 x 5 x 5 a cell, with a winding number other than 0; [n, n, n].

    The number of a point is that of the faces above it whose front is up, less those whose back
    is. Air that is closed in, or between the object and the ground, counts as inside.
    """
    fine = size * SIDE
    # Off the centres by what no model has in its coordinates.
    shift = np.array([0.01234567, 0.00765432])
    corners = (model.vertices @ rotation.T + [1, 1, 0]) * (fine / 2)
    steps = np.zeros((fine, fine, fine + 1), np.int16)
    for a, b, c in corners[model.faces]:
        low = np.ceil(np.minimum(np.minimum(a, b), c)[:2] - 0.5 - shift).astype(int).clip(0)
        high = np.floor(np.maximum(np.maximum(a, b), c)[:2] - 0.5 - shift).astype(int) + 1
        high = high.clip(0, fine)
        det = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        if (low >= high).any() or det == 0:
            continue
        column, row = (g.ravel() for g in np.mgrid[low[0] : high[0], low[1] : high[1]])
        x, y = column + 0.5 + shift[0] - a[0], row + 0.5 + shift[1] - a[1]
        s = (x * (c[1] - a[1]) - (c[0] - a[0]) * y) / det
        t = ((b[0] - a[0]) * y - x * (b[1] - a[1])) / det
        hit = (s >= 0) & (t >= 0) & (s + t <= 1)
        z = a[2] + s[hit] * (b[2] - a[2]) + t[hit] * (c[2] - a[2])
        # The points below are those with an index under this.
        index = np.ceil(z - 0.5).astype(int).clip(0, fine)
        np.add.at(steps, (column[hit], row[hit], index), 1 if det > 0 else -1)
    winding = steps[..., ::-1].cumsum(axis=2, dtype=np.int16)[..., ::-1][..., 1:]
    air, _ = scipy.ndimage.label(
        np.pad(winding == 0, ((1, 1), (1, 1), (0, 1)), constant_values=True)
    )
    return (air != air[0, 0, -1])[1:-1, 1:-1, :-1]


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


def sheltered_cells(points):
    """Cells at least half of whose points are air that gaps of 2 points (0.4 cells) let in alone.

    Voxels this large close such gaps, as between a drawer and its cabinet: what lies behind is
    solid to them.
    """
    cube = np.ones((3, 3, 3), bool)
    air = np.pad(~points, ((2, 2), (2, 2), (0, 2)), constant_values=True)
    open_, _ = scipy.ndimage.label(scipy.ndimage.binary_erosion(air, cube, border_value=1))
    reached = scipy.ndimage.binary_dilation(open_ == open_[0, 0, -1], cube)
    return occupancy((air & ~reached)[2:-2, 2:-2, :-2])

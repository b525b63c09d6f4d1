"""Points on the surface of a model, uniform by area, with normals that point outward."""

from typing import NamedTuple

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
from jaxtyping import Bool, Float, Int

from data_gen.mesh import (
    EXISTS,
    Model,
    UnusableModelError,
    face_areas,
    face_normals,
    faces_with_alpha,
    opacity_at,
    row_dots,
    unit_vectors,
    weld,
)
from data_gen.solid import in_parts, mark_surface, outside_cells, repeat_numbers


class SurfaceSample(NamedTuple):
    """Points on a surface: positions, unit normals, and indices of their faces."""

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    face: Int[np.ndarray, " n"]


# Number of cells along the extent of the model in the search for the outside.
_AIR_CELLS = 96

# Parallel surfaces nearer than this fraction of the extent coincide.
_COINCIDENT = 1e-4

_PARALLEL = float(np.cos(np.radians(2.0)))

# Number of steps of each component of the quantised direction of a plane.
_DIRECTIONS = 10

# Largest number of entries of the grid; we use a coarser grid if there would be more.
_MAX_BINNED = 3_000_000


class _Twins:
    """Finds coincident faces by the cell of a grid and the direction of their plane."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._has_alpha = len(faces_with_alpha(model)) > 0
        corners = model.corners()
        # For each face, affine functions of a point: distance from the plane of the face, and the
        # second and third barycentric coordinates.
        origin, one, two = np.moveaxis(corners, 1, 0)
        one, two = one - origin, two - origin
        cross = np.cross(one, two)
        square = np.maximum(row_dots(cross, cross), 1e-300)[:, None]
        normal = cross / np.sqrt(square)
        self._forms = np.stack(
            [normal, np.cross(two, cross) / square, np.cross(cross, one) / square], axis=1
        )
        self._offsets = -np.einsum("nij,nj->ni", self._forms, origin)
        low, high = corners.min(axis=1), corners.max(axis=1)
        self._low = low.min(axis=0)
        extent = float((high.max(axis=0) - self._low).max())
        self._tolerance = _COINCIDENT * extent
        for self._bins in (32, 16, 8, 4, 2, 1):
            self._scale = self._bins / (extent * (1 + 1e-9))
            first = self._cell(low - self._tolerance)
            size = self._cell(high + self._tolerance) - first + 1
            count = size.prod(axis=1)
            if count.sum() <= _MAX_BINNED:
                break
        # Few planes have a direction at the threshold between two steps.
        turned = np.where(normal @ [0.3713, 0.6137, 0.6969] < 0, -1, 1)[:, None] * normal
        step = np.floor((turned + 1) * (_DIRECTIONS / 2) + 0.371).astype(np.int64)
        self._direction = step @ ((_DIRECTIONS + 1) ** np.arange(3))
        # The faces of each cell and direction, concatenated.
        owner, number = repeat_numbers(count)
        x, rest = np.divmod(number, (size[:, 1] * size[:, 2])[owner])
        cell = first[owner] + np.stack([x, *np.divmod(rest, size[owner, 2])], axis=1)
        key = self._key(cell, owner)
        order = np.argsort(key, kind="stable")
        self._faces, key = owner[order], key[order]
        begin = np.flatnonzero(np.diff(key, prepend=-1))
        # Faces that are alone in their cell and direction have no coincident face.
        length = np.diff(begin, append=len(key))
        self._keys, self._start, self._count = (a[length > 1] for a in (key[begin], begin, length))

    def _cell(self, points: np.ndarray) -> np.ndarray:
        scaled = np.floor((points - self._low) * self._scale).astype(np.int64)
        return scaled.clip(0, self._bins - 1)

    def _key(self, cell: np.ndarray, face: np.ndarray) -> np.ndarray:
        number = cell @ (self._bins ** np.arange(2, -1, -1))
        result: np.ndarray = number * (_DIRECTIONS + 1) ** 3 + self._direction[face]
        return result

    def first(
        self, points: Float[np.ndarray, "n 3"], face: Int[np.ndarray, " n"]
    ) -> tuple[Int[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
        """The first visible face at points of faces, and whether there is a face in reverse."""
        result, both = face.copy(), np.zeros(len(face), bool)
        if not len(self._keys):
            return result, both
        key = self._key(self._cell(points), face)
        index = np.searchsorted(self._keys, key).clip(0, len(self._keys) - 1)
        count = np.where(self._keys[index] == key, self._count[index], 0)
        start = self._start[index]
        for owner, number in in_parts(count, count):
            other = self._faces[start[owner] + number]
            kept = other != face[owner]
            owner, other = owner[kept], other[kept]
            away, s, t = (
                np.einsum("nij,nj->in", self._forms[other], points[owner], optimize=False)
                + self._offsets[other].T
            )
            cosine = row_dots(self._forms[other, 0], self._forms[face[owner], 0])
            here = (np.abs(away) <= self._tolerance) & (np.minimum(s, t) >= 0) & (s + t <= 1)
            here &= np.abs(cosine) > _PARALLEL
            if self._has_alpha:
                weights = np.stack([1 - s - t, s, t], axis=1)
                here[here] = opacity_at(self._model, other[here], weights[here]) >= EXISTS
            owner, other, cosine = owner[here], other[here], cosine[here]
            np.minimum.at(result, owner, other)
            both[owner[cosine < 0]] = True
        return result, both


def _toward_air(
    model: Model, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
) -> Int[np.ndarray, " n"]:
    """1 if the front of a surface is outside and its back inside, -1 if reversed, else 0.

    We find the outside as in `solid_occupancy`. On each side, the first cell along the normal
    without surface counts, at distances of 1 to 3.25 cells.
    """
    size = _AIR_CELLS
    low = model.vertices.min(axis=0)
    # The model fills the grid except for a margin.
    scale = (size - 4) / float(np.ptp(model.vertices, axis=0).max())
    corners = (model.vertices - low) * scale + [2, 2, 0]
    marked, _ = mark_surface(corners, model.faces, model.edges, size)
    outside = np.pad(outside_cells(marked), 4, constant_values=True)
    marked = np.pad(marked, 4)
    sides = []
    for sign in (1, -1):
        side = np.zeros(len(points), np.int64)
        for distance in (1.0, 1.75, 2.5, 3.25):
            point = (points - low) * scale + [2, 2, 0] + sign * distance * normals
            cell = tuple((np.floor(point).astype(np.int64) + 4).clip(0, size + 7).T)
            side = np.where((side == 0) & ~marked[cell], np.where(outside[cell], 1, -1), side)
        sides.append(side)
    return np.sign(sides[0] - sides[1]) * (sides[0] * sides[1] == -1)


def sample_surface(model: Model, n: int, seed: int) -> SurfaceSample:
    """Samples `n` points uniformly by area on the visible surface, with interpolated normals.

    We replace points with an opacity below `EXISTS`, such as points in the holes of an alpha map.
    The sampling is stratified by cumulative area, which covers the faces more evenly than
    independent points. The same seed gives the same points.

    Coincident faces count once: we replace a point if its face is not the first face that contains
    the point. If coincident faces point in opposite directions and exactly one side is outside, the
    normal points outside. We reverse the normals of a connected part if we know the outside for at
    least half of its points, and the normals of at least nine tenths of these point inward.

    Raises:
      UnusableModelError: almost no surface is visible.
    """
    rng = np.random.default_rng(seed)
    cumulated = np.cumsum(face_areas(model.vertices, model.faces))
    has_alpha = len(faces_with_alpha(model)) > 0
    twins = _Twins(model)
    faces, weights, two_sided, count = [], [], [], 0
    for _ in range(200):
        missing = n - count
        at = (np.arange(missing) + rng.random(missing)) / missing * cumulated[-1]
        face = np.minimum(np.searchsorted(cumulated, at, side="right"), len(cumulated) - 1)
        # The square root makes the points uniform in the triangle.
        root, other = np.sqrt(rng.random(missing)), rng.random(missing)
        weight = np.stack([1 - root, root * (1 - other), root * other], axis=1)
        if has_alpha:
            exists = opacity_at(model, face, weight) >= EXISTS
            face, weight = face[exists], weight[exists]
        points = np.einsum("nk,nkd->nd", weight, model.vertices[model.faces[face]])
        first, both = twins.first(points, face)
        kept = first == face
        faces.append(face[kept])
        weights.append(weight[kept])
        two_sided.append(both[kept])
        count += int(kept.sum())
        if count == n:
            break
    else:
        raise UnusableModelError("almost all of the model is transparent")
    face, weight = np.concatenate(faces), np.concatenate(weights)
    points = np.einsum("nk,nkd->nd", weight, model.vertices[model.faces[face]])
    normals = unit_vectors(np.einsum("nk,nkd->nd", weight, model.normals[face].astype(np.float64)))
    lost = (normals == 0).all(axis=1)
    flat = face_normals(model.vertices, model.faces[face])
    normals[lost] = flat[lost]
    normals[_inward(model, points, flat, face, np.concatenate(two_sided))] *= -1
    return SurfaceSample(points.astype(np.float32), normals.astype(np.float32), face)


def _inward(
    model: Model,
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    face: Int[np.ndarray, " n"],
    two_sided: Bool[np.ndarray, " n"],
) -> Bool[np.ndarray, " n"]:
    """Which normals point inward, by the rules of `sample_surface`."""
    parts, open_ = _parts(model)
    a, b, c = np.moveaxis(model.vertices[model.faces] - model.vertices.mean(axis=0), 1, 0)
    volume = np.bincount(parts, row_dots(a, np.cross(b, c)))
    # Closed parts with a positive volume are correct.
    uncertain = two_sided | (open_ | (volume < 0))[parts[face]]
    result = np.zeros(len(face), bool)
    if not uncertain.any():
        return result
    index = np.flatnonzero(uncertain)
    side = _toward_air(model, points[index], normals[index])
    part, both = parts[face[index]], two_sided[index]
    inward = np.bincount(part[~both], side[~both] == -1, len(open_))
    decided = np.bincount(part[~both], side[~both] != 0, len(open_))
    whole = np.bincount(part[~both], minlength=len(open_))
    over = (inward >= 0.9 * decided) & (decided >= 0.5 * whole) & (decided > 0)
    result[index] = np.where(both, side == -1, over[part])
    return result


def _parts(model: Model) -> tuple[Int[np.ndarray, " f"], Bool[np.ndarray, " p"]]:
    """The number of each face's part, and which parts are open.

    Faces that traverse a common edge in opposite directions belong to a part. A part is open if its
    faces traverse an edge in a single direction.
    """
    corner = weld(model.vertices)[model.faces].astype(np.int64)
    start, end = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
    span = int(corner.max()) + 1
    forward, back = start * span + end, end * span + start
    order = np.argsort(forward, kind="stable")
    index = np.searchsorted(forward[order], back).clip(0, len(order) - 1)
    met = forward[order[index]] == back
    owner = np.repeat(np.arange(len(model.faces)), 3)
    graph = scipy.sparse.coo_array(
        (np.ones(int(met.sum()), np.int8), (owner[met], order[index][met] // 3)),
        shape=(len(model.faces), len(model.faces)),
    )
    number, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    return label, np.bincount(label[owner], ~met, number) > 0

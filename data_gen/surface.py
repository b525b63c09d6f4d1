"""Points on the surface of a model, uniform by area."""

import numpy as np
from jaxtyping import Bool, Float, Int

from data_gen import mesh
from data_gen.mesh import EXISTS, Model, UnusableModelError
from data_gen.solid import in_parts, repeat_numbers

# Parallel surfaces nearer than this fraction of the extent coincide.
_COINCIDENT = 1e-4

_PARALLEL = float(np.cos(np.radians(2.0)))

# Number of steps of each component of the quantised direction of a plane.
_DIRECTIONS = 10

# Largest number of entries of the grid; we use a coarser grid if there would be more.
_MAX_BINNED = 3_000_000


class _Coincident:
    """Finds coincident faces by the cell of a grid and the direction of their plane."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self.has_alpha = len(mesh.faces_with_alpha(model)) > 0
        corners = model.corners()
        # For each face, affine functions of a point: distance from the plane of the face, and the
        # second and third barycentric coordinates.
        origin, one, two = np.moveaxis(corners, 1, 0)
        one, two = one - origin, two - origin
        cross = np.cross(one, two)
        square = np.maximum(np.einsum("nd,nd->n", cross, cross), 1e-300)[:, None]
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
        # The faces of each cell and direction.
        owner, number = repeat_numbers(count)
        x, rest = np.divmod(number, (size[:, 1] * size[:, 2])[owner])
        cell = first[owner] + np.stack([x, *np.divmod(rest, size[owner, 2])], axis=1)
        self._keys = np.sort(self._key(cell, owner) + owner)

    def _cell(self, points: np.ndarray) -> np.ndarray:
        scaled = np.floor((points - self._low) * self._scale).astype(np.int64)
        return scaled.clip(0, self._bins - 1)

    def _key(self, cell: np.ndarray, face: np.ndarray) -> np.ndarray:
        """The first key of the faces in a cell that have the direction of a face."""
        number = cell @ (self._bins ** np.arange(2, -1, -1))
        bucket: np.ndarray = number * (_DIRECTIONS + 1) ** 3 + self._direction[face]
        return bucket * len(self._direction)

    def covered(
        self, points: Float[np.ndarray, "n 3"], face: Int[np.ndarray, " n"]
    ) -> Bool[np.ndarray, " n"]:
        """Whether a visible face that precedes `face` contains the point of `face`, too."""
        key, result = self._key(self._cell(points), face), np.zeros(len(face), bool)
        start = np.searchsorted(self._keys, key)
        count = np.searchsorted(self._keys, key + face) - start
        for owner, number in in_parts(count, count):
            other = self._keys[start[owner] + number] - key[owner]
            away, s, t = (
                np.einsum("nij,nj->in", self._forms[other], points[owner], optimize=False)
                + self._offsets[other].T
            )
            own = self._forms[face[owner], 0]
            cosine = np.einsum("nd,nd->n", self._forms[other, 0], own)
            here = (np.abs(away) <= self._tolerance) & (np.minimum(s, t) >= 0) & (s + t <= 1)
            here &= np.abs(cosine) > _PARALLEL
            if self.has_alpha:
                weights = np.stack([1 - s - t, s, t], axis=1)
                here[here] = mesh.opacity_at(self._model, other[here], weights[here]) >= EXISTS
            result[owner[here]] = True
        return result


def sample_surface(model: Model, n: int, seed: int) -> Float[np.ndarray, "n 3"]:
    """Samples `n` points uniformly by area on the visible surface, as float32.

    We replace points with an opacity below `EXISTS`, such as points in the holes of an alpha map.
    The sampling is stratified by cumulative area, which covers the faces more evenly than
    independent points. The same seed gives the same points.

    Coincident faces count once: we replace a point if its face is not the first face that contains
    the point.

    Raises:
      UnusableModelError: almost no surface is visible.
    """
    rng = np.random.default_rng(seed)
    cumulated = np.cumsum(mesh.face_areas(model.vertices, model.faces))
    coincident = _Coincident(model)
    found, missing = [], n
    for _ in range(200):
        at = (np.arange(missing) + rng.random(missing)) / missing * cumulated[-1]
        face = np.minimum(np.searchsorted(cumulated, at, side="right"), len(cumulated) - 1)
        # The square root makes the points uniform in the triangle.
        root, other = np.sqrt(rng.random(missing)), rng.random(missing)
        weight = np.stack([1 - root, root * (1 - other), root * other], axis=1)
        if coincident.has_alpha:
            exists = mesh.opacity_at(model, face, weight) >= EXISTS
            face, weight = face[exists], weight[exists]
        points = np.einsum("nk,nkd->nd", weight, model.vertices[model.faces[face]])
        found.append(points[~coincident.covered(points, face)])
        missing -= len(found[-1])
        if not missing:
            return np.concatenate(found).astype(np.float32)
    raise UnusableModelError("almost all of the model is transparent")

"""The union of convex solids, and points on its surface."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import ConvexHull

_NUDGE = 1e-5
_ROUNDS = 400
"""Maximum number of rounds of sampling; each round replaces the hidden points of the previous one.

A model is refused if less than about 2 % of its surface is visible."""


def inside(solid: ConvexHull, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """Which points are inside a solid; on its surface either answer is possible."""
    normals, offsets = solid.equations[:, :3], solid.equations[:, 3]
    return np.asarray((points @ normals.T + offsets < 0).all(axis=1))


def sample_union(solids: Sequence[ConvexHull], count: int, seed: int) -> Float[np.ndarray, "n 3"]:
    """Points uniform by area on the surface of the union of solids.

    A point of a solid's surface is left out if it is inside another solid or on a face where two
    solids touch. Where faces of two solids coincide and point to the same side, only the points of
    the first solid are kept.

    Args:
      solids: at least one.
      count: number of points.
      seed: the same seed gives the same points.

    Raises:
      ValueError: too little of the surface is visible.
    """
    rng = np.random.default_rng(seed)
    corners = np.concatenate([s.points[s.simplices] for s in solids])
    normals = np.concatenate([s.equations[:, :3] for s in solids])
    owner = np.repeat(np.arange(len(solids)), [len(s.simplices) for s in solids])
    edges = corners[:, 1:] - corners[:, :1]
    double = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    cumulated = np.cumsum(double)
    kept: list[np.ndarray] = []
    missing = count
    for _ in range(_ROUNDS):
        level = (np.arange(missing) + rng.random(missing)) / missing * cumulated[-1]
        face = np.minimum(np.searchsorted(cumulated, level, side="right"), len(double) - 1)
        # The square root makes the points uniform in the triangle.
        root, other = np.sqrt(rng.random(missing)), rng.random(missing)
        weights = np.stack([1 - root, root * (1 - other), root * other], axis=1)
        points = np.einsum("nk,nkd->nd", weights, corners[face])
        out, back = points + _NUDGE * normals[face], points - _NUDGE * normals[face]
        visible = np.ones(missing, bool)
        for number, solid in enumerate(solids):
            hidden = inside(solid, out) | ((number < owner[face]) & inside(solid, back))
            visible &= ~hidden | (owner[face] == number)
        kept.append(points[visible])
        missing -= int(visible.sum())
        if not missing:
            return np.concatenate(kept).astype(np.float32)
    raise ValueError("almost all of its surface is inside other parts")

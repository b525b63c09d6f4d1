"""Random changes of an object's proportions: longer legs, a deeper seat, a lower roof.

The axes are the vertical and both sides of the smallest rectangle around the footprint. Along each
axis, an increasing, piecewise linear function maps the coordinate. Along the two horizontal axes,
the function is odd about the middle of the rectangle. So faces perpendicular to an axis stay plane,
and an object that is symmetric about an axis of the rectangle stays symmetric.
"""

import dataclasses
import hashlib
from collections.abc import Callable

import numpy as np
import scipy.spatial
from jaxtyping import Float

from data_gen.frame import normalize
from data_gen.mesh import Model, UnusableModelError, unit_vectors

DEVIATION = 0.25
"""Default of `deviation`."""

_PIECES = 3  # linear pieces of each function


def random_proportions(
    points: Float[np.ndarray, "n 3"], name: str, deviation: float
) -> tuple[Callable[[np.ndarray], np.ndarray], Float[np.ndarray, "2 2"]]:
    """A random change of proportions, and unit vectors along the sides of the footprint.

    The change maps points [n, 3], the lowest one to z = 0; the middle of the footprint stays.
    The slope of a piece is exp(a + b), with a random `a` for each axis and a random `b` for each
    piece, from a normal distribution with standard deviation `deviation`, clipped at twice this
    value. The inner knots are uniform in the middle 80 % of each axis. The seed is a hash of
    `name`.

    Raises:
      UnusableModelError: the points lie in a vertical plane.
    """
    seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:8], "big")
    rng = np.random.default_rng(seed)
    axes, middle, half = footprint(points[:, :2])
    low, high = points[:, 2].min(), points[:, 2].max()
    extents = np.array([*half, high - low])
    inner = np.sort(rng.uniform(0.1, 0.9, (3, _PIECES - 1)), axis=1)
    shares = np.concatenate([np.zeros((3, 1)), inner, np.ones((3, 1))], axis=1)
    drawn = rng.standard_normal((3, _PIECES + 1)).clip(-2, 2) * deviation
    slopes = np.exp(drawn[:, :1] + drawn[:, 1:])
    # Distances from the middle along the horizontal axes, and heights, before and after.
    knots = shares * extents[:, None]
    values = np.cumsum(slopes * np.diff(knots, axis=1), axis=1)
    values = np.concatenate([np.zeros((3, 1)), values], axis=1)

    def change(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        across = points[:, :2] @ axes.T - middle
        for axis in range(2):
            distance = np.interp(np.abs(across[:, axis]), knots[axis], values[axis])
            across[:, axis] = np.sign(across[:, axis]) * distance
        height = np.interp(points[:, 2] - low, knots[2], values[2])
        return np.column_stack([(across + middle) @ axes, height])

    return change, axes


def vary(load: Callable[[], Model], name: str, deviation: float) -> Model:
    """The model of `load` with random proportions, normalised again; `name` is the variant's.

    We divide normals by the mean stretch of their face along each axis.
    """
    model = load()
    change, axes = random_proportions(model.vertices, name, deviation)
    turn = np.eye(3)
    turn[:2, :2] = axes
    vertices = change(model.vertices)
    before, after = ((v @ turn.T)[model.faces] for v in (model.vertices, vertices))
    span = np.ptp(before, axis=1)
    flat = span < 1e-9  # the face is perpendicular to this axis
    stretch = np.where(flat, 1.0, np.ptp(after, axis=1) / np.where(flat, 1.0, span))
    normals = unit_vectors(model.normals @ turn.T / stretch[:, None] @ turn).astype(np.float32)
    return normalize(dataclasses.replace(model, vertices=vertices, normals=normals))


def footprint(flat: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Axes [2, 2], middle and half sides [2] of the smallest rectangle around points [n, 2].

    A side of this rectangle is along an edge of the convex hull.
    """
    spread = np.linalg.svd(flat - flat.mean(axis=0), compute_uv=False)
    if not spread[1] > 1e-3 * spread[0]:
        raise UnusableModelError("the points lie in a vertical plane, expected a volume")
    hull = flat[scipy.spatial.ConvexHull(flat).vertices]
    along = np.roll(hull, -1, axis=0) - hull
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    axes = np.stack([along, np.stack([-along[:, 1], along[:, 0]], axis=1)], axis=1)  # [h, 2, 2]
    inside = np.einsum("hij,nj->hin", axes, hull)
    low, high = inside.min(axis=2), inside.max(axis=2)
    best = int(np.prod(high - low, axis=1).argmin())
    return axes[best], (low[best] + high[best]) / 2, (high[best] - low[best]) / 2

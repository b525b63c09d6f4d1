"""Primitives as convex solids, equal to those that `static/page.js` draws, and their union.

A part is a primitive inside the cube of edge 1 about the origin, scaled by its size, rotated and
moved into the object's frame. There it may have copies mirrored across x = 0 and y = 0. The
object's frame is the project's frame, rotated about the vertical and moved along the ground.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import ConvexHull

ROUND, RINGS = 24, 12
"""Corners of a circle; rings of a sphere from pole to pole."""

_NUDGE = 1e-5
_ROUNDS = 400
"""Maximum number of rounds of sampling; each round replaces the hidden points of the previous one.

A model is refused if less than about 2 % of its surface is visible."""


class HiddenSurfaceError(ValueError):
    """Almost all of the surface is inside other parts."""


def unit_corners(part: Any) -> Float[np.ndarray, "v 3"]:
    """Corners of the primitive of an `answers.Part`, inside the cube of edge 1."""
    if part.kind == "sphere":
        polar = np.pi * np.arange(RINGS + 1) / RINGS
        angle = 2 * np.pi * np.arange(ROUND) / ROUND
        rings = [np.outer(np.sin(polar), f(angle)) for f in (np.cos, np.sin)]
        height = np.broadcast_to(np.cos(polar)[:, None], rings[0].shape)
        return 0.5 * np.stack([*rings, height], axis=-1).reshape(-1, 3)
    if part.kind == "box":
        section = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
    else:
        sides = part.sides if part.kind == "prism" else ROUND
        angle = np.pi / 2 + 2 * np.pi * np.arange(sides) / sides
        section = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        low, high = section.min(axis=0), section.max(axis=0)
        section = (section - low) / (high - low) - 0.5
    return np.concatenate(
        [np.insert(section, 2, -0.5, axis=1), np.insert(part.taper * section, 2, 0.5, axis=1)]
    )


def rotation(degrees: Sequence[float]) -> Float[np.ndarray, "3 3"]:
    """Rz(c) Ry(b) Rx(a) of the angles a, b, c."""
    (ca, cb, cc), (sa, sb, sc) = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    about_x = np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]])
    about_y = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
    about_z = np.array([[cc, -sc, 0], [sc, cc, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x


def solids_of(answer: Any) -> list[ConvexHull]:
    """All parts of an `answers.Answer` with their symmetric copies, in the project's frame."""
    turn, middle = rotation((0, 0, answer.turn)), np.array([answer.x, answer.y, 0.0])
    solids = []
    for part in answer.parts:
        corners = unit_corners(part) * np.array(part.size) @ rotation(part.turn).T
        corners += np.array(part.at)
        for y in (1, -1) if "y" in part.mirror else (1,):
            for x in (1, -1) if "x" in part.mirror else (1,):
                solids.append(ConvexHull(corners * (x, y, 1) @ turn.T + middle))
    return solids


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
      HiddenSurfaceError: too little of the surface is visible.
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
    raise HiddenSurfaceError("almost all of its surface is inside other parts")

"""Joins parts of two similar objects to a new one, such as the back of a chair and another's legs.

An object's box is the smallest rectangle around its footprint, times its height. Coordinates in the
box are from -1 to 1 along the sides of the rectangle, and from 0 to 1 along the vertical. The
similarity of two objects is the Bhattacharyya coefficient of the histograms of their points in
their boxes, minus .15 times the largest difference between the logarithms of the sizes of their
boxes. The second object may be turned by quarter turns about the vertical, and mirrored.

A hybrid is cut by a plane that is horizontal or perpendicular to the longer side of the rectangle.
On one side of the plane is the first object, on the other side the second object, stretched to the
box of the first one. The parts need not fit at the plane; the more similar the objects are, the
better they do.
"""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from data_gen.catalogues.proportions import footprint

NEIGHBOURS = 12
"""Number of similar objects that an object is joined with."""

_CELLS = 10  # of the histograms along each axis
_STRETCH_COST = 0.15  # similarity that a difference of 1 between the logarithms of sizes costs
_LEVEL = 0.6  # share of the horizontal planes
_HEIGHTS = 0.2, 0.8  # of the horizontal planes, in the box
_PLACES = -0.5, 0.5  # of the other planes
_LEAST = 0.01  # share of an object's points that must be on its side of the plane
_BLOCK = 256  # objects that are compared with all others at once

# Whether the sides of the rectangle change places, and then the signs along both.
_TURNS = tuple(itertools.product((False, True), (1.0, -1.0), (1.0, -1.0)))


class Box(NamedTuple):
    """The smallest upright box around points."""

    axes: np.ndarray  # [3, 3], rows: along both sides of the rectangle, and upwards
    origin: np.ndarray  # [3], middle of the rectangle, and lowest point
    size: np.ndarray  # [3], half sides of the rectangle, and height

    @classmethod
    def around(cls, points: Float[np.ndarray, "n 3"]) -> "Box":
        """The box of points that do not lie in a vertical plane.

        Raises:
          UnusableModelError: they do.
        """
        sides, middle, half = footprint(points[:, :2])
        axes = np.eye(3)
        axes[:2, :2] = sides
        low = points[:, 2].min()
        size = np.array([*half, np.ptp(points[:, 2])])
        return cls(axes, np.array([*middle, low]), np.maximum(size, 1e-3))

    def coordinates(self, points: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
        """The coordinates in the box of positions in the frame of the object."""
        return (points @ self.axes.T - self.origin) / self.size

    def positions(self, points: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
        """The inverse of `coordinates`."""
        return (points * self.size + self.origin) @ self.axes


class Shape(NamedTuple):
    """What two objects are compared by."""

    box: Box
    histogram: np.ndarray  # [cells, cells, cells], square roots of the shares of points in cells

    @classmethod
    def of(cls, points: Float[np.ndarray, "n 3"]) -> "Shape":
        """The shape of points.

        Raises:
          UnusableModelError: they lie in a vertical plane.
        """
        box = Box.around(points)
        ends = ((-1, 1), (-1, 1), (0, 1))
        counts, _ = np.histogramdd(box.coordinates(points), bins=(_CELLS,) * 3, range=ends)
        return cls(box, np.sqrt(counts / len(points)).astype(np.float32))


def turned(points: Float[np.ndarray, "... 3"], turn: int) -> Float[np.ndarray, "... 3"]:
    """Coordinates in a box, turned or mirrored about the vertical; `turn` is from 0 to 7."""
    swap, along, across = _TURNS[turn]
    return (points[..., [1, 0, 2]] if swap else points) * [along, across, 1]


def most_similar(
    shapes: Sequence[Shape], neighbours: int = NEIGHBOURS
) -> tuple[Int[np.ndarray, "n k"], Int[np.ndarray, "n k"]]:
    """Finds the most similar others of each object.

    Args:
      shapes: the objects.
      neighbours: number of others; if there are fewer, all of them.

    Returns:
      The indices of the others, most similar first, and how each is turned.
    """
    sizes = np.log([shape.box.size for shape in shapes])
    grids = np.stack([shape.histogram for shape in shapes])
    flat = grids.reshape(len(shapes), -1)
    neighbours = min(neighbours, len(shapes) - 1)
    index = np.empty((len(shapes), neighbours), int)
    turn = np.empty((len(shapes), neighbours), int)
    for start in range(0, len(shapes), _BLOCK):
        rows = slice(start, start + _BLOCK)
        found = np.empty((len(_TURNS), len(flat[rows]), len(shapes)), np.float32)
        for number, (swap, along, across) in enumerate(_TURNS):
            # The rows are turned back instead of all objects being turned.
            grid, size = grids[rows, :: int(along), :: int(across)], sizes[rows]
            if swap:
                grid, size = grid.transpose(0, 2, 1, 3), size[:, [1, 0, 2]]
            cost = np.abs(size[:, None] - sizes).max(axis=2)
            found[number] = grid.reshape(len(size), -1) @ flat.T - _STRETCH_COST * cost
        best = found.max(axis=0)
        best[np.arange(len(best)), np.arange(start, start + len(best))] = -np.inf
        index[rows] = np.argsort(-best, axis=1, kind="stable")[:, :neighbours]
        turn[rows] = np.take_along_axis(found.argmax(axis=0), index[rows], axis=1)
    return index, turn


class Cut(NamedTuple):
    """How two objects are joined."""

    first: np.ndarray  # bool [n], points of the first object that are kept
    second: np.ndarray  # bool [m], points of the second object that are kept
    boxes: tuple[Box, Box]
    turn: int

    def moved(self, points: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
        """Positions of the second object, in the frame of the first."""
        first, second = self.boxes
        return first.positions(turned(second.coordinates(points), self.turn))


def random_cut(
    first: Float[np.ndarray, "n 3"],
    second: Float[np.ndarray, "m 3"],
    boxes: tuple[Box, Box],
    turn: int,
    rng: np.random.Generator,
) -> Cut | None:
    """A random cut of two objects; None if it leaves too little of one of them.

    Args:
      first: points of the first object.
      second: points of the second object.
      boxes: their boxes.
      turn: how the second is turned, from `most_similar`.
      rng: source of the plane and of the sides.
    """
    level = rng.random() < _LEVEL
    axis = 2 if level else int(boxes[0].size[1] > boxes[0].size[0])
    place = rng.uniform(*(_HEIGHTS if level else _PLACES))
    above = rng.random() < 0.5  # whether the first object is above the plane
    keep_first = (boxes[0].coordinates(first)[:, axis] > place) == above
    keep_second = (turned(boxes[1].coordinates(second), turn)[:, axis] > place) != above
    if min(keep_first.mean(), keep_second.mean()) < _LEAST:
        return None
    return Cut(keep_first, keep_second, boxes, turn)

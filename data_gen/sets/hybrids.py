"""Joins parts of two similar objects to a new one, such as the back of a chair and another's legs.

An object's box is the smallest rectangle around its footprint, times its height. Coordinates in the
box are from -1 to 1 along the sides of the rectangle, and from 0 to 1 along the vertical. The
similarity of two objects is the Bhattacharyya coefficient of the histograms of their points in
their boxes, minus a part of the difference between the proportions of the boxes. The second object
may be turned by quarter turns about the vertical, and mirrored.

A hybrid is cut by a plane that is horizontal or perpendicular to the longer side of the rectangle.
On one side of the plane is the first object, on the other side the second object, stretched to the
box of the first one. The parts need not fit at the plane; the more similar the objects are, the
better they do.
"""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from data_gen.catalogues.proportions import footprint

NEIGHBOURS = 12
"""Number of similar objects that an object is joined with."""

_CELLS = 10  # of the histograms along each axis
_STRETCH_COST = 0.15  # similarity that a difference of 1 between the logarithms of sizes costs
_LEVEL = 0.6  # share of the horizontal planes
_HEIGHTS = 0.2, 0.8  # of the horizontal planes, in the box
_PLACES = -0.5, 0.5  # of the other planes
_FEWEST = 150  # points on each side of the plane
_BLOCK = 256  # objects that are compared with all others at once

Turn = tuple[bool, float, float]
"""Whether the sides of a rectangle change places, and then the signs along both."""

_TURNS: tuple[Turn, ...] = tuple(itertools.product((False, True), (1.0, -1.0), (1.0, -1.0)))


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

    def inside(self, points: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
        """Coordinates in the box of points in the frame of the object."""
        return (points @ self.axes.T - self.origin) / self.size

    def outside(self, points: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
        """The inverse of `inside`."""
        return (points * self.size + self.origin) @ self.axes


@dataclasses.dataclass(frozen=True)
class Similar:
    """For each object, the most similar others and how they are turned."""

    index: np.ndarray  # [objects, neighbours]
    turn: np.ndarray  # [objects, neighbours], into `_TURNS`


def turned(points: Float[np.ndarray, "... 3"], turn: Turn) -> Float[np.ndarray, "... 3"]:
    """Coordinates in a box, turned or mirrored about the vertical through its middle."""
    swap, along, across = turn
    return (points[..., [1, 0, 2]] if swap else points) * [along, across, 1]


def similar(clouds: Sequence[Float[np.ndarray, "n 3"]], neighbours: int = NEIGHBOURS) -> Similar:
    """Finds the most similar others of each object.

    Args:
      clouds: the points of each object.
      neighbours: number of others; fewer if there are fewer objects.

    Raises:
      UnusableModelError: the points of an object lie in a vertical plane.
    """
    boxes = [Box.around(cloud) for cloud in clouds]
    sizes = np.log([box.size for box in boxes])
    grids = np.stack([_histogram(b.inside(c)) for b, c in zip(boxes, clouds, strict=True)])
    flat = grids.reshape(len(clouds), -1)
    neighbours = min(neighbours, len(clouds) - 1)
    index = np.zeros((len(clouds), neighbours), int)
    turn = np.zeros((len(clouds), neighbours), int)
    for start in range(0, len(clouds), _BLOCK):
        rows = slice(start, start + _BLOCK)
        found = np.full((len(_TURNS), len(flat[rows]), len(clouds)), -np.inf, np.float32)
        for number, (swap, along, across) in enumerate(_TURNS):
            # The rows are turned back instead of all objects being turned.
            grid, size = grids[rows], sizes[rows]
            grid = grid[:, :: int(along), :: int(across)]
            if swap:
                grid, size = grid.transpose(0, 2, 1, 3), size[:, [1, 0, 2]]
            cost = np.abs(size[:, None] - sizes).max(axis=2)
            found[number] = grid.reshape(len(size), -1) @ flat.T - _STRETCH_COST * cost
        best = found.max(axis=0)
        best[np.arange(len(best)), np.arange(start, start + len(best))] = -np.inf
        index[rows] = np.argsort(-best, axis=1, kind="stable")[:, :neighbours]
        turn[rows] = np.take_along_axis(found.argmax(axis=0), index[rows], axis=1)
    return Similar(index, turn)


def _histogram(points: np.ndarray) -> np.ndarray:
    """Square roots of the shares of points in the cells of the box."""
    ends = ((-1, 1), (-1, 1), (0, 1))
    counts, _ = np.histogramdd(points, bins=(_CELLS,) * 3, range=ends)
    return np.sqrt(counts / len(points)).astype(np.float32)


class Cut(NamedTuple):
    """How two objects are joined."""

    first: np.ndarray  # bool [n], points of the first object that are kept
    second: np.ndarray  # bool [m], points of the second object that are kept
    boxes: tuple[Box, Box]
    turn: Turn

    def moved(self, points: Float[np.ndarray, "... 3"]) -> Float[np.ndarray, "... 3"]:
        """Points of the second object, in the frame of the first."""
        first, second = self.boxes
        return first.outside(turned(second.inside(points), self.turn))


def cut(
    first: Float[np.ndarray, "n 3"],
    second: Float[np.ndarray, "m 3"],
    turn: int,
    rng: np.random.Generator,
) -> Cut | None:
    """A random cut of two objects, or None if it leaves too little of one of them.

    Raises:
      UnusableModelError: the points of one of them lie in a vertical plane.
    """
    boxes = Box.around(first), Box.around(second)
    level = rng.random() < _LEVEL
    axis = 2 if level else int(boxes[0].size[1] > boxes[0].size[0])
    place = rng.uniform(*(_HEIGHTS if level else _PLACES))
    above = rng.random() < 0.5  # whether the first object is above the plane
    keep_first = (boxes[0].inside(first)[:, axis] > place) == above
    keep_second = (turned(boxes[1].inside(second), _TURNS[turn])[:, axis] > place) != above
    if min(keep_first.sum(), keep_second.sum()) < _FEWEST:
        return None
    return Cut(keep_first, keep_second, boxes, _TURNS[turn])

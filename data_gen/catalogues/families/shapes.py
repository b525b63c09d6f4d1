"""Shapes that several of the extra families use."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.solids import Solid, lathe, smooth_path, stack, tube


def oval(x: float, y: float, sides: int = 20) -> np.ndarray:
    """Outline [sides, 2] of an ellipse with these diameters."""
    angle = np.arange(sides) / sides * 2 * np.pi
    return np.stack([x / 2 * np.cos(angle), y / 2 * np.sin(angle)], axis=1)


def curve(points: Sequence[tuple[float, float]], steps: int = 5) -> list[tuple[float, float]]:
    """A smooth profile of (radius, z) through points; radii below 0 become 0."""
    path = smooth_path([(r, 0.0, z) for r, z in points], steps)
    return [(max(float(r), 0.0), float(z)) for r, z in path[:, [0, 2]]]


def vessel(
    outside: Sequence[tuple[float, float]], wall: float, floor: float, sides: int = 28
) -> Solid:
    """A round vessel, open at the top.

    Args:
      outside: profile (radius, z) from the foot to the rim.
      wall: thickness of the wall.
      floor: height of the inner bottom.
      sides: number of sides of the circle.
    """
    inside = [(max(r - wall, 0.002), z) for r, z in outside if z > floor][::-1]
    last = inside[-1][0] if inside else 0.002
    return lathe([(0.0, outside[0][1]), *outside, *inside, (last, floor), (0.0, floor)], sides)


def swept(points: Sequence[Any], radii: Sequence[float], sides: int = 10) -> Solid:
    """A limb: a round bar of varying radius along a smooth curve through points."""
    path = smooth_path(points, 4)
    place = np.linspace(0, len(radii) - 1, len(path))
    return tube(path, np.interp(place, np.arange(len(radii)), radii).tolist(), sides)


def bar(start: Any, end: Any, radius: float, sides: int = 8) -> Solid:
    """`solids.rod` between points given as any sequence."""
    return tube(np.asarray([start, end], float), radius, sides)


def trunk(sections: Sequence[tuple[float, float, float, float]], sides: int = 16) -> Solid:
    """A body along x through sections of (x, z of the centre, width along y, height along z)."""
    path = smooth_path([s[:3] for s in sections], 3)
    high = np.interp(
        np.linspace(0, 1, len(path)), np.linspace(0, 1, len(sections)), [s[3] for s in sections]
    )
    angle = np.arange(sides) / sides * 2 * np.pi
    rings = [
        np.stack(
            [
                np.full(sides, x),
                max(w, 0.002) / 2 * np.cos(angle),
                z + max(h, 0.002) / 2 * np.sin(angle),
            ],
            axis=1,
        )
        for (x, z, w), h in zip(path, high, strict=True)
    ]
    return solids.loft(rings)


def upright(sections: Sequence[tuple[float, float, float]], sides: int = 18) -> Solid:
    """A body along z through oval sections of (z, length along x, width along y)."""
    path = smooth_path(sections, 3)
    return stack([(oval(max(x, 0.002), max(y, 0.002), sides), z) for z, x, y in path])


def gable(x: float, y: float, height: float, overhang: float, thick: float) -> tuple[Solid, Solid]:
    """The two sides of a gable roof with its ridge along x and its eaves at z = 0."""
    slope = height / (y / 2)
    edge = y / 2 + overhang
    outline = [
        (0.0, height),
        (edge, height - slope * edge),
        (edge, height - slope * edge + thick),
        (0.0, height + thick),
    ]
    side = solids.prism(outline, x + 2 * overhang).turned("z", 90)
    return side, side.turned("z", 180)


def heap(
    rng: np.random.Generator, count: int, length: float, wide: float, curl: float
) -> list[Solid]:
    """Leaves that arch outward from the origin, each a closed thin strip.

    Args:
      rng: generator of directions and sizes.
      count: number of leaves.
      length: length of the longest leaf.
      wide: width of a leaf at its middle.
      curl: downward bend, 0 = straight.
    """
    result = []
    t = np.linspace(0, 1, 8)
    for k in range(count):
        long = length * rng.uniform(0.6, 1.0)
        rise = rng.uniform(0.35, 1.35)
        out = long * np.cos(rise) * t + long * curl * 0.3 * t**2
        up = long * np.sin(rise) * t - long * curl * t**2
        half = wide / 2 * np.sin(np.pi * (0.12 + 0.86 * t)) * rng.uniform(0.7, 1.2)
        rings = [
            np.array([(x, -h, z), (x, 0, z - 0.25 * h), (x, h, z), (x, 0, z + 0.012 * length)])
            for x, z, h in zip(out, up, half, strict=True)
        ]
        angle = 360 * (k + rng.uniform(-0.3, 0.3)) / count * 2.4
        result.append(solids.loft(rings).turned("z", angle))
    return result


def blob(
    rng: np.random.Generator, x: float, y: float, z: float, rough: float = 0.18, sides: int = 14
) -> Solid:
    """An irregular ellipsoid, for the crown of a tree."""
    ball = solids.ball(1, 1, 1, sides)
    waves = rng.normal(0, 3.2, (5, 3))
    phase = rng.uniform(0, 2 * np.pi, 5)

    def swell(v: np.ndarray) -> np.ndarray:
        bump = np.sin(2 * v @ waves.T + phase).mean(axis=1)
        return v * (1 + 2 * rough * bump)[:, None] * [x, y, z]

    return ball.bent(swell)

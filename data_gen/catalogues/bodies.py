"""Bodies of vehicles: lofted cross sections, and wings."""

from collections.abc import Sequence

import numpy as np
import scipy.interpolate

from data_gen.catalogues.solids import Solid, loft, superellipse


def through(table: Sequence[Sequence[float]], places: np.ndarray) -> np.ndarray:
    """Smooth interpolation of the rows of a table, without overshoot.

    Args:
      table: [K, C + 1]; each row has a position and the values there. Positions are strictly
        ascending or descending.
      places: positions [N]; beyond the ends the values of the nearest row are used.

    Returns:
      The values [N, C].
    """
    rows = np.asarray(table, np.float64)
    if rows[0, 0] > rows[-1, 0]:
        rows = rows[::-1]
    inside = np.clip(places, rows[0, 0], rows[-1, 0])
    if len(rows) == 2:
        share = ((inside - rows[0, 0]) / (rows[1, 0] - rows[0, 0]))[:, None]
        return np.asarray((1 - share) * rows[0, 1:] + share * rows[1, 1:])
    return np.asarray(scipy.interpolate.PchipInterpolator(rows[:, 0], rows[:, 1:])(inside))


def between(places: Sequence[float], steps: int) -> np.ndarray:
    """The positions, with each interval between neighbours divided into `steps` equal parts."""
    knots = np.asarray(places, np.float64)
    return np.interp(np.arange((len(knots) - 1) * steps + 1) / steps, np.arange(len(knots)), knots)


def body(
    stations: Sequence[Sequence[float]], power: float = 2.0, steps: int = 3, sides: int = 24
) -> Solid:
    """A smooth surface through superellipses perpendicular to the x axis.

    Args:
      stations: rows of x, half width, half height and z of the centre; an optional fifth number is
        the power there, in place of `power`.
      power: power of the superellipses.
      steps: number of sections for each interval between stations.
      sides: number of points of a section.
    """
    places = between([s[0] for s in stations], steps)
    rows = through(stations, places)
    rings = []
    for x, row in zip(places, rows, strict=True):
        w, h, z = max(row[0], 0.0), max(row[1], 0.0), row[2]
        outline = superellipse(2 * w, 2 * h, row[3] if len(row) > 3 else power, sides)
        rings.append(np.column_stack([np.full(sides, x), outline[:, 0], outline[:, 1] + z]))
    return loft(rings)


AEROFOIL = np.array(
    [(1, 0.04), (0.8, 0.4), (0.55, 0.78), (0.3, 1), (0.12, 0.8), (0.03, 0.42), (0, 0),
     (0.03, -0.3), (0.12, -0.5), (0.3, -0.6), (0.55, -0.45), (0.8, -0.2)]
)  # fmt: skip
"""Distance behind the leading edge / chord, and height / thickness."""


def wing(
    sections: Sequence[Sequence[float]], thickness: float = 0.1, steps: int = 1, fin: bool = False
) -> Solid:
    """A wing through aerofoils from the root to the tip, with the leading edge toward +x.

    Args:
      sections: rows of x, y, z of the leading edge and the chord; an optional fifth number is the
        thickness / chord there, in place of `thickness`.
      thickness: thickness / chord.
      steps: number of sections for each interval; with 2 or more the outline is smooth.
      fin: whether the thickness is along y (and symmetrical) instead of along z.
    """
    table = [(float(k), *row) for k, row in enumerate(sections)]
    rings = []
    for row in through(table, between(range(len(table)), steps)) if steps > 1 else sections:
        x, y, z, chord = row[:4]
        high = (row[4] if len(row) > 4 else thickness) * chord * AEROFOIL[:, 1]
        if fin:
            high = np.where(high < 0, high / 0.6, high) / 2
        flat = np.stack([x - chord * AEROFOIL[:, 0], np.full(12, y), np.full(12, z)], axis=1)
        flat[:, 1 if fin else 2] += high
        rings.append(flat)
    return loft(rings)

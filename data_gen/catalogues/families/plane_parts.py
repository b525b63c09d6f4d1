"""Parts of planes. Lengths in metres, the nose toward +x."""

from collections.abc import Sequence

import numpy as np

from data_gen.catalogues import bodies, solids
from data_gen.catalogues.bodies import body, through, wing
from data_gen.catalogues.families.kit import BLACK, CHROME, DARK_GLASS, Kit, around
from data_gen.catalogues.families.wheels import small_wheel
from data_gen.catalogues.solids import box, lathe, loft, pane, rod
from data_gen.mesh import Material

# fmt: off
# Formatted by hand: the formatter would put every coordinate on a line of its own.

Station = tuple[float, float, float, float]
"""x, half width, half height, z of the centre."""


def add_fuselage(
    kit: Kit, skin: Material, stations: Sequence[Station], power: float = 2.0
) -> None:
    """A smooth body. Hidden: the depth of the bay in its belly."""
    depth = kit.hide("bay_depth", 0.05, 0.9)
    sides, places = 24, bodies.between([s[0] for s in stations], 4)
    rows = through(stations, places)
    middle = stations[0][0] + 0.5 * (stations[-1][0] - stations[0][0])
    reach = 0.16 * abs(stations[0][0] - stations[-1][0])
    # Where the belly rises, a camera in front of or behind the plane would see into the bay.
    rise = np.abs(np.diff(rows[:, 2] - rows[:, 1]) / np.diff(places))
    rise = np.maximum(np.append(rise, np.inf), np.append(np.inf, rise))
    inside = (np.abs(places - middle) < reach) & (rise < 0.12)
    if not inside.any():
        inside = rise <= max(rise.min(), 0.12)
    rings = []
    for x, (w, h, z), here in zip(places, rows, inside, strict=True):
        outline = solids.superellipse(2 * w, 2 * h, power, sides)
        # The two corners beside the keel are doubled. Raising the inner copies, together with the
        # keel, gives the bay vertical walls.
        bay = np.repeat(outline, [2 if k in (17, 19) else 1 for k in range(sides)], axis=0)
        bay[18:21, 1] += depth * h * here
        rings.append(np.column_stack([np.full(len(bay), x), bay[:, 0], bay[:, 1] + z]))
    kit.add(skin, loft(np.array(rings)))


def cigar_stations(long: float, wide: float, high: float, z: float, nose: float, tail: float,
                   lift: float) -> list[Station]:
    """Stations of a fuselage: a round nose, a straight middle, a tail that rises.

    Args:
      long: total length, centred at x = 0.
      wide: half width.
      high: half height.
      z: height of the axis.
      nose: length of the nose.
      tail: length of the tail.
      lift: rise of the end of the tail, in half heights.
    """
    front, rear = long / 2, -long / 2
    tip = [(1.0, 0.02, -0.25), (0.97, 0.28, -0.24), (0.85, 0.57, -0.18), (0.6, 0.82, -0.08),
           (0.3, 0.96, -0.02)]
    return [
        *((front - nose * (1 - t), wide * s, high * s, z + high * d) for t, s, d in tip),
        (front - nose, wide, high, z),
        (rear + tail, wide, high, z),
        (rear + tail * 0.6, wide * 0.82, high * 0.86, z + lift * high * 0.16),
        (rear + tail * 0.25, wide * 0.45, high * 0.5, z + lift * high * 0.6),
        (rear, wide * 0.1, high * 0.1 * 1.3, z + lift * high),
    ]


def add_wings(kit: Kit, skin: Material, at: Sequence[float], half_span: float, chord: float, *,
              taper: float = 0.5, sweep: float = 0.0, dihedral: float = 0.0, thick: float = 0.11,
              kink: float = 0.0, elliptic: bool = False) -> np.ndarray:
    """Adds a pair of wings; returns leading edge and chords [N, 4], from root to tip, on +y.

    Args:
      kit: the model.
      skin: material.
      at: x, y, z of the leading edge at the root.
      half_span: distance from y = 0 to the tip.
      chord: chord at the root.
      taper: chord of the tip / of the root.
      sweep: sweep of the leading edge, degrees.
      dihedral: dihedral angle, degrees.
      thick: thickness / chord.
      kink: relative increase of the root chord over the straight taper; the outline bends at 35 %
        of the way from root to tip.
      elliptic: whether the outline is elliptic.
    """
    share = np.array([0, 0.2, 0.35, 0.55, 0.75, 0.9, 0.97, 1.0] if elliptic
                     else [0, 0.35, 0.97, 1.0])
    y = at[1] + share * (half_span - at[1])
    run = y - at[1]
    if elliptic:
        chords = chord * np.sqrt(np.maximum(1 - 0.985 * share**2.4, 0))
        x = at[0] - 0.35 * (chord - chords) - run * np.tan(np.radians(sweep))
    else:
        chords = chord * (1 - share * (1 - taper))
        chords[0] *= 1 + kink
        x = at[0] + np.array([kink * chord, 0, 0, 0]) * 0.3 - run * np.tan(np.radians(sweep))
        chords[-1] *= 0.72
        x[-1] -= 0.2 * chord * taper
    z = at[2] + run * np.tan(np.radians(dihedral))
    table = np.stack([x, y, z, chords], axis=1)
    kit.both(skin, wing(table.tolist(), thick))
    return table


def add_fin(kit: Kit, skin: Material, x: float, z: float, high: float, chord: float, *,
            taper: float = 0.5, sweep: float = 35.0, y: float = 0.0, cant: float = 0.0) -> None:
    """A vertical fin, or two (y > 0) canted outward."""
    lean, back = high * np.tan(np.radians(cant)), high * np.tan(np.radians(sweep))
    rows = [(x, y, z, chord), (x - 0.95 * back, y + 0.95 * lean, z + 0.95 * high, chord * taper),
            (x - back - 0.15 * chord * taper, y + lean, z + high, chord * taper * 0.75)]
    part = wing(rows, 0.1, fin=True)
    if y > 0:
        kit.both(skin, part)
    else:
        kit.add(skin, part)


def add_nacelle(kit: Kit, skin: Material, x: float, y: float, z: float, radius: float,
                long: float) -> None:
    """A jet engine with its intake at x; one on each side if y > 0."""
    profile = [(0.92, 0), (1.0, -0.04), (1.05, -0.25), (0.95, -0.7), (0.72, -1.0), (0.6, -1.0),
               (0.5, -0.8), (0.2, -0.12), (0.78, -0.1), (0.84, -0.04)]
    shell = lathe([(r * radius, p * long) for r, p in profile], 20, loop=True)
    cone = lathe([(0.0, 0.12 * long), (0.3 * radius, -0.02 * long), (0.79 * radius, -0.09 * long)],
                 16)
    for s in (-1, 1) if y else (0,):
        kit.add(skin, shell.turned("y", 90).at(x, s * y, z))
        kit.add(BLACK, cone.turned("y", 90).at(x - 0.02 * long, s * y, z))


def add_propeller(kit: Kit, accent: Material, x: float, y: float, z: float, radius: float,
                  hub: float, blades: int, back: bool = False) -> None:
    """A spinner with blades in front of or behind x."""
    turn = kit.rng.uniform(0, 180)
    way = -1 if back else 1
    spinner = lathe([(hub, 0), (hub * 0.85, hub * 0.6), (hub * 0.45, hub * 1.3), (0.0, hub * 1.6)],
                    14)
    kit.add(accent, spinner.turned("y", 90 * way).at(x, y, z))
    blade = wing([(0.06 * radius, 0, 0, 0.12 * radius),
                  (0.09 * radius, 0, 0.5 * radius, 0.17 * radius),
                  (0.05 * radius, 0, radius, 0.08 * radius)], 0.16, fin=True).turned("z", 60)
    for angle in around(blades, turn):
        kit.add(BLACK, blade.turned("x", angle).at(x + 0.5 * hub * way, y, z))


def add_gear(kit: Kit, spots: Sequence[tuple[float, float, float]], radius: float,
             twin: bool = False) -> None:
    """Landing gear from (x, y, z) down to wheels on z = 0; on both sides if y > 0."""
    strut = CHROME
    for x, y, z in spots:
        parts = [(strut, rod((x, y, radius), (x, y, z), 0.28 * radius, 6))]
        for dy in (-0.5, 0.5) if twin else (0.0,):
            parts += [(m, p.at(x, y + dy * radius, radius)) for m, p in
                      small_wheel(radius, 0.6 * radius, strut)]
        for material, part in parts:
            if y > 0:
                kit.both(material, part)
            else:
                kit.add(material, part)


def add_canopy(kit: Kit, x: float, long: float, wide: float, high: float, z: float) -> None:
    """A bubble canopy, steeper in front, partly inside the body, at height z."""
    stations = [(x + 0.5 * long, 0.02, 0.02, z), (x + 0.42 * long, wide * 0.5, high * 0.42, z),
                (x + 0.2 * long, wide * 0.92, high * 0.93, z), (x, wide, high, z),
                (x - 0.3 * long, wide * 0.75, high * 0.72, z),
                (x - 0.5 * long, wide * 0.1, 0.05, z)]
    kit.add(DARK_GLASS, body(stations, 2.2, 2, 18))


def add_cockpit_band(kit: Kit, stations: Sequence[Station], start: float, end: float) -> None:
    """Cockpit windows around the upper half of the nose, from 20 to 160 degrees."""
    angle = np.radians(np.linspace(20, 160, 11))
    rows = through(stations, np.linspace(start, end, 3))
    grid = [np.column_stack([np.full(11, x), 1.02 * w * np.cos(angle),
                             z + 1.02 * h * np.sin(angle)])
            for x, (w, h, z) in zip(np.linspace(start, end, 3), rows, strict=True)]
    kit.add(DARK_GLASS, pane(np.array(grid), 0.1 * stations[5][2]))


def add_windows(kit: Kit, start: float, end: float, pitch: float, y: float, z: float,
                size: float) -> None:
    """A row of windows on each side."""
    for x in np.arange(min(start, end), max(start, end), pitch):
        kit.both(DARK_GLASS, box(size, 0.05 * y, size * 1.3).at(x, y * 0.965, z))

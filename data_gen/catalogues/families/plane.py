"""Planes and helicopters. Lengths in metres, the nose toward +x."""

from collections.abc import Sequence

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    DARK_GLASS,
    RED_LIGHT,
    WHITE,
    Kit,
    around,
    fabric,
    metal,
    paint,
    pick,
)
from data_gen.catalogues.families.wheels import small_wheel
from data_gen.catalogues.solids import ball, body, box, lathe, loft, rod, sheet, through, tube, wing
from data_gen.meshes import Material

Station = tuple[float, float, float, float]
"""x, half width, half height, z of the centre."""

# --- Pieces -----------------------------------------------------------------------------------


def _fuselage(
    kit: Kit, skin: Material, stations: Sequence[Station], power: float = 2.0, steps: int = 4
) -> None:
    """A body of smooth sections. Hidden: how deep the bay in its belly is."""
    depth = kit.hide("bay_depth", 0.05, 0.9)
    sides, places = 24, solids.between([s[0] for s in stations], steps)
    rows = through(stations, places)
    middle = stations[0][0] + 0.5 * (stations[-1][0] - stations[0][0])
    reach = 0.16 * abs(stations[0][0] - stations[-1][0])
    rings = []
    for x, (w, h, z) in zip(places, rows, strict=True):
        outline = solids.superellipse(2 * w, 2 * h, power, sides)
        # Doubled corners beside the keel are the bay's walls.
        bay = np.repeat(outline, [2 if k in (17, 19) else 1 for k in range(sides)], axis=0)
        bay[18:21, 1] += depth * h if abs(x - middle) < reach else 0.0
        rings.append(np.column_stack([np.full(len(bay), x), bay[:, 0], bay[:, 1] + z]))
    kit.add(skin, loft(np.array(rings)))


def _cigar(long: float, wide: float, high: float, z: float, nose: float, tail: float,
           lift: float, end: float = 0.1) -> list[Station]:  # fmt: skip
    """Stations of a fuselage: a round nose, a straight middle, a tail that rises.

    Args:
      long: of the whole, around x = 0.
      wide: half width.
      high: half height.
      z: height of the axis.
      nose: length of the nose.
      tail: length of the tail.
      lift: how far the tail's end is raised, in half heights.
      end: size of the tail's end.
    """
    front, rear = long / 2, -long / 2
    tip = [(1.0, 0.02, -0.25), (0.97, 0.28, -0.24), (0.85, 0.57, -0.18), (0.6, 0.82, -0.08),
           (0.3, 0.96, -0.02)]  # fmt: skip
    return [
        *((front - nose * (1 - t), wide * s, high * s, z + high * d) for t, s, d in tip),
        (front - nose, wide, high, z),
        (rear + tail, wide, high, z),
        (rear + tail * 0.6, wide * 0.82, high * 0.86, z + lift * high * 0.16),
        (rear + tail * 0.25, wide * 0.45, high * 0.5, z + lift * high * 0.6),
        (rear, wide * end, high * end * 1.3, z + lift * high),
    ]


def _wings(kit: Kit, skin: Material, at: Sequence[float], half_span: float, chord: float, *,
           taper: float = 0.5, sweep: float = 0.0, dihedral: float = 0.0, thick: float = 0.11,
           kink: float = 0.0, elliptic: bool = False) -> np.ndarray:  # fmt: skip
    """A pair of wings; returns the leading edge [N, 4] with the chords, root to tip, on +y.

    Args:
      kit: what they are added to.
      skin: their material.
      at: leading edge of the root: x, y, z.
      half_span: from y = 0 to the tip.
      chord: at the root.
      taper: chord of the tip / of the root.
      sweep: of the leading edge, degrees.
      dihedral: degrees.
      thick: thickness / chord.
      kink: how much deeper the chord is at the root than the straight line from 35 % outward.
      elliptic: a round outline.
    """
    share = np.array([0, 0.2, 0.35, 0.55, 0.75, 0.9, 0.97, 1.0] if elliptic else [0, 0.35, 0.97, 1.0])
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
    kit.both(skin, wing(table, thick))
    return table


def _fin(kit: Kit, skin: Material, x: float, z: float, high: float, chord: float, *,
         taper: float = 0.5, sweep: float = 35.0, y: float = 0.0, cant: float = 0.0) -> None:  # fmt: skip
    """An upright fin, or two (y > 0), canted outward by degrees."""
    lean, back = high * np.tan(np.radians(cant)), high * np.tan(np.radians(sweep))
    rows = [(x, y, z, chord), (x - 0.95 * back, y + 0.95 * lean, z + 0.95 * high, chord * taper),
            (x - back - 0.15 * chord * taper, y + lean, z + high, chord * taper * 0.75)]  # fmt: skip
    part = wing(rows, 0.1, fin=True)
    if y > 0:
        kit.both(skin, part)
    else:
        kit.add(skin, part)


def _nacelle(kit: Kit, skin: Material, x: float, y: float, z: float, radius: float, long: float) -> None:
    """A jet engine whose intake is at x; one on each side if y > 0."""
    profile = [(0.92, 0), (1.0, -0.04), (1.05, -0.25), (0.95, -0.7), (0.72, -1.0), (0.6, -1.0),
               (0.5, -0.8), (0.2, -0.12), (0.78, -0.1), (0.84, -0.04)]  # fmt: skip
    shell = lathe([(r * radius, p * long) for r, p in profile], 20, loop=True)
    cone = lathe([(0.0, 0.12 * long), (0.3 * radius, -0.02 * long), (0.79 * radius, -0.09 * long)], 16)
    for s in (-1, 1) if y else (0,):
        kit.add(skin, shell.turned("y", 90).at(x, s * y, z))
        kit.add(BLACK, cone.turned("y", 90).at(x - 0.02 * long, s * y, z))


def _propeller(kit: Kit, accent: Material, x: float, y: float, z: float, radius: float,
               hub: float, blades: int, back: bool = False) -> None:  # fmt: skip
    """A spinner with blades in front of x (or behind)."""
    turn = kit.rng.uniform(0, 180)
    way = -1 if back else 1
    spinner = lathe([(hub, 0), (hub * 0.85, hub * 0.6), (hub * 0.45, hub * 1.3), (0.0, hub * 1.6)], 14)
    kit.add(accent, spinner.turned("y", 90 * way).at(x, y, z))
    blade = wing([(0.06 * radius, 0, 0, 0.12 * radius), (0.09 * radius, 0, 0.5 * radius, 0.17 * radius),
                  (0.05 * radius, 0, radius, 0.08 * radius)], 0.16, fin=True).turned("z", 60)  # fmt: skip
    for angle in around(blades, turn):
        kit.add(BLACK, blade.turned("x", angle).at(x + 0.5 * hub * way, y, z))


def _gear(kit: Kit, spots: Sequence[tuple[float, float, float]], radius: float, twin: bool = False) -> None:
    """Legs down to wheels on z = 0 from (x, y, z); those with y > 0 on both sides."""
    strut = CHROME
    for x, y, z in spots:
        parts = [(strut, rod((x, y, radius), (x, y, z), 0.28 * radius, 6))]
        for dy in (-0.5, 0.5) if twin else (0.0,):
            parts += [(m, p.at(x, y + dy * radius, radius)) for m, p in
                      small_wheel(radius, 0.6 * radius, strut)]  # fmt: skip
        for material, part in parts:
            if y > 0:
                kit.both(material, part)
            else:
                kit.add(material, part)


def _canopy(kit: Kit, x: float, long: float, wide: float, high: float, z: float) -> None:
    """A bubble of glass, steeper in front, sunk into the body at z."""
    stations = [(x + 0.5 * long, 0.02, 0.02, z), (x + 0.42 * long, wide * 0.5, high * 0.42, z),
                (x + 0.2 * long, wide * 0.92, high * 0.93, z), (x, wide, high, z),
                (x - 0.3 * long, wide * 0.75, high * 0.72, z), (x - 0.5 * long, wide * 0.1, 0.05, z)]  # fmt: skip
    kit.add(DARK_GLASS, body(stations, 2.2, 2, 18))


def _cockpit_band(kit: Kit, stations: Sequence[Station], start: float, end: float) -> None:
    """Panes around the upper half of the nose, from 20 to 160 degrees."""
    angle = np.radians(np.linspace(20, 160, 11))
    rows = through(stations, np.linspace(start, end, 3))
    grid = [np.column_stack([np.full(11, x), 1.02 * w * np.cos(angle), z + 1.02 * h * np.sin(angle)])
            for x, (w, h, z) in zip(np.linspace(start, end, 3), rows, strict=True)]  # fmt: skip
    kit.add(DARK_GLASS, sheet(np.array(grid), 0.1 * stations[5][2]))


def _windows(kit: Kit, start: float, end: float, pitch: float, y: float, z: float, size: float) -> None:
    for x in np.arange(min(start, end), max(start, end), pitch):
        kit.both(DARK_GLASS, box(size, 0.05 * y, size * 1.3).at(x, y * 0.965, z))


# --- Sub-types --------------------------------------------------------------------------------


def _airliner(kit: Kit, skin: Material, accent: Material) -> None:
    layout = kit.choose("layout", "twin", "twin", "four", "rear", "three", "jumbo")
    wide = 3.0 if layout == "jumbo" else kit.uniform("radius", 1.5, 2.8)
    high = wide * (1.25 if layout == "jumbo" else kit.uniform("oval", 1.0, 1.1))
    long = wide * kit.uniform("slenderness", 16.0, 26.0) * (0.8 if layout == "jumbo" else 1)
    z = high + 0.1 * long * (0.45 if layout == "rear" else 0.6)
    stations = _cigar(long, wide, high, z, 1.7 * 2 * high * 0.8, 0.32 * long, 0.62)
    _fuselage(kit, skin, stations)
    span, chord = long * kit.uniform("span", 0.4, 0.56), long * kit.uniform("chord", 0.13, 0.17)
    sweep = kit.uniform("sweep", 18, 38)
    root = kit.uniform("root", 0.03, 0.13) * long - (0.1 * long if layout == "rear" else 0)
    edge = _wings(kit, skin, (root + chord * 0.4, wide * 0.4, z - high * 0.6), span, chord,
                  taper=0.28, sweep=sweep, dihedral=kit.uniform("dihedral", 2, 8), kink=0.45)  # fmt: skip
    if kit.chance("winglets", 0.5):
        x, y, up, c = edge[2]
        _fin(kit, accent, x - 0.1 * c, up, kit.uniform("winglet", 0.6, 1.4) * c, c * 0.8, y=y, cant=15, taper=0.4)
    rear, top = -long / 2, z + high * 0.55
    fin = long * kit.uniform("fin", 0.13, 0.19)
    _fin(kit, accent, rear + 1.35 * fin, top, fin, fin * 1.05, taper=0.36, sweep=38)
    t_tail = layout == "rear" or kit.chance("t_tail", 0.12)
    tail = (rear + 1.35 * fin - fin * 0.78 + 0.1 * fin, 0.0, top + fin * 0.95) if t_tail else (
        rear + 1.05 * fin, wide * 0.15, z + high * 0.5)  # fmt: skip
    _wings(kit, skin, tail, fin * kit.uniform("stabiliser", 0.95, 1.25), fin * 0.72, taper=0.4,
           sweep=32, dihedral=0 if t_tail else 6, thick=0.09)  # fmt: skip
    radius = wide * kit.uniform("engine", 0.42, 0.68)
    places = {"twin": (0.33,), "jumbo": (0.36, 0.66), "four": (0.33, 0.62), "three": (0.33,)}
    for share in places.get(layout, ()):
        k = share * (len(edge) - 1) / 1.0
        x, y, up, c = (np.interp(share, [0, 0.35, 0.97], edge[:3, col]) for col in range(4))
        _nacelle(kit, skin, x + 0.32 * c + radius, y, up - radius * 1.15, radius, radius * 3.4)
        kit.both(skin, box(c * 0.8, radius * 0.2, radius * 1.2).at(x - 0.1 * c, y, up - radius * 0.4))
        kit.visible["engine_place"] = float(k)
    if layout == "rear":
        x = rear + 0.3 * long
        _nacelle(kit, skin, x, wide + radius * 0.8, z + high * 0.4, radius * 0.9, radius * 4)
        kit.both(skin, box(radius * 2, wide, radius * 0.3).at(x - 1.7 * radius, wide * 0.7, z + high * 0.4))
    if layout == "three":
        _nacelle(kit, skin, rear + 1.5 * fin, 0, z + high * 0.95 + radius * 0.5, radius * 0.85, fin * 1.1)
    _cockpit_band(kit, stations, long / 2 - 0.42 * high * 2, long / 2 - 0.72 * high * 2)
    _windows(kit, rear + 0.3 * long, long / 2 - 2.2 * high, 0.022 * long, wide, z + high * 0.22, 0.009 * long)
    if layout == "jumbo":
        kit.add(skin, body([(long * 0.46, 0.1, 0.1, z + high * 0.6), (long * 0.36, wide * 0.6, high * 0.42, z + high * 0.72),
                            (long * 0.2, wide * 0.6, high * 0.4, z + high * 0.72), (long * 0.06, 0.1, 0.1, z + high * 0.8)]))  # fmt: skip
    if kit.chance("stripe", 0.4):
        kit.both(accent, box(0.6 * long, 0.04 * wide, 0.3 * high).at(0, wide * 0.97, z - 0.1 * high))
    if kit.chance("gear", 0.6):
        under = root + chord * 0.4 - chord * 0.75
        _gear(kit, [(long * 0.38, 0.0, z - 0.5 * high), (under, wide * 0.95, z - 0.5 * high)], 0.013 * long, True)


def _business(kit: Kit, skin: Material, accent: Material) -> None:
    long, wide = kit.uniform("length", 10, 20), kit.uniform("radius", 0.75, 1.1)
    z = wide + 1.0
    stations = _cigar(long, wide, wide * 1.05, z, 3.4, 0.42 * long, 0.5)
    _fuselage(kit, skin, stations)
    span, sweep = long * kit.uniform("span", 0.42, 0.58), kit.uniform("sweep", 5, 34)
    edge = _wings(kit, skin, (0.06 * long, 0.0, z - 0.8 * wide), span, 0.17 * long, taper=0.36,
                  sweep=sweep, dihedral=4)  # fmt: skip
    if kit.chance("winglets", 0.6):
        _fin(kit, accent, edge[2, 0], edge[2, 2], 0.9, edge[2, 3] * 0.8, y=edge[2, 1], cant=12)
    rear, fin = -long / 2, long * kit.uniform("fin", 0.15, 0.2)
    _fin(kit, accent, rear + 1.2 * fin, z + 0.5 * wide, fin, fin, taper=0.55, sweep=42)
    _wings(kit, skin, (rear + 0.35 * fin, 0, z + 0.5 * wide + fin * 0.95), 0.18 * long, 0.6 * fin,
           taper=0.5, sweep=28, thick=0.08)  # fmt: skip
    radius = wide * kit.uniform("engine", 0.48, 0.66)
    _nacelle(kit, skin, rear + 0.36 * long, wide + radius * 0.75, z + 0.45 * wide, radius, radius * 4)
    kit.both(skin, box(radius * 2, wide, 0.2).at(rear + 0.28 * long, wide * 0.8, z + 0.45 * wide))
    _cockpit_band(kit, stations, long / 2 - 1.3, long / 2 - 2.2)
    _windows(kit, -0.12 * long, long / 2 - 3.6, 0.9, wide, z + 0.25 * wide, 0.42)
    _gear(kit, [(long * 0.36, 0, z - 0.5), (-0.04 * long, wide * 1.4, z - 0.8)], 0.32, True)


def _turboprop(kit: Kit, skin: Material, accent: Material) -> None:
    """High-winged transports and commuters, two or four engines."""
    long, wide = kit.uniform("length", 14, 34), kit.uniform("radius", 0.055, 0.075)
    wide *= long
    z = wide * 1.35
    ramp = kit.chance("cargo", 0.45)
    stations = _cigar(long, wide, wide * (1.0 if ramp else 1.05), z, 2.2 * wide, 0.42 * long, 0.95 if ramp else 0.6)
    _fuselage(kit, skin, stations, 2.4)
    span, chord = long * kit.uniform("span", 0.5, 0.68), long * kit.uniform("chord", 0.1, 0.13)
    up = z + wide * 0.92
    edge = _wings(kit, skin, (0.12 * long, 0.0, up), span, chord, taper=0.5, sweep=3, thick=0.14)
    engines, radius = kit.choose("engines", 2, 2, 4), chord * 0.24
    for share in (0.3,) if engines == 2 else (0.27, 0.52):
        x, y = edge[0, 0], share * span
        pod = [(chord * 0.45, radius * 0.6, radius * 0.7, 0), (chord * 0.3, radius, radius * 1.1, -0.1 * radius),
               (-chord * 0.4, radius, radius * 1.1, -0.1 * radius), (-chord * 1.1, radius * 0.2, radius * 0.3, 0.2 * radius)]  # fmt: skip
        kit.both(skin, body(pod).at(x, y, up - 0.3 * radius))
        for s in (-1, 1):
            _propeller(kit, accent, x + chord * 0.45, s * y, up - 0.3 * radius, 0.065 * long, radius * 0.6, kit.choose("blades", 4, 6))
    rear, fin = -long / 2, long * kit.uniform("fin", 0.16, 0.21)
    _fin(kit, accent, rear + 1.1 * fin, z + 0.75 * wide, fin, fin * 0.95, taper=0.55, sweep=25)
    if kit.chance("t_tail", 0.5):
        _wings(kit, skin, (rear + 0.62 * fin, 0, z + 0.72 * wide + fin), 0.2 * long, 0.55 * fin, taper=0.6, sweep=8)
    else:
        _wings(kit, skin, (rear + 0.8 * fin, 0, z + 0.8 * wide), 0.24 * long, 0.65 * fin, taper=0.6, sweep=10)
    _cockpit_band(kit, stations, long / 2 - 0.9 * wide, long / 2 - 1.6 * wide)
    if not ramp:
        _windows(kit, rear + 0.35 * long, long / 2 - 2.8 * wide, 0.045 * long, wide, z + 0.3 * wide, 0.014 * long)
    kit.both(skin, body([(0.12 * long, 0.1, 0.1, 0), (0.05 * long, 0.4 * wide, 0.4 * wide, 0), (-0.1 * long, 0.4 * wide, 0.4 * wide, 0),
                         (-0.16 * long, 0.1, 0.1, 0)]).at(0, wide * 0.95, z - 0.7 * wide))  # fmt: skip
    _gear(kit, [(0.36 * long, 0, z - 0.7 * wide), (0.0, wide * 1.1, z - 0.7 * wide)], 0.03 * long * 0.6, True)


def _light(kit: Kit, skin: Material, accent: Material) -> None:
    """Propeller planes for two to six: wing high, low or parasol; on wheels or floats."""
    place = kit.choose("wing", "high", "low", "high", "low", "parasol")
    floats = kit.chance("floats", 0.3 if place == "high" else 0.08)
    long, wide = kit.uniform("length", 6.0, 9.5), kit.uniform("radius", 0.5, 0.65)
    z, front = 1.35 + (0.9 if floats else 0), 0.4 * long
    rear = front - long
    high = wide * kit.uniform("depth", 1.0, 1.25)
    stations: list[Station] = [(front, 0.3, 0.33, z - 0.05), (front - 0.1, 0.45 * wide / 0.6, 0.45, z - 0.05),
                (front - 0.22 * long, wide, high * 0.85, z), (front - 0.42 * long, wide, high, z),
                (front - 0.62 * long, wide * 0.7, high * 0.72, z + 0.04), (rear, 0.06, 0.16, z + 0.22)]  # fmt: skip
    _fuselage(kit, skin, stations, 2.8)
    span, chord = long * kit.uniform("span", 0.5, 0.75), kit.uniform("chord", 1.2, 1.7)
    up = {"high": z + high * 1.35, "low": z - high * 0.75, "parasol": z + high * 1.9}[place]
    _wings(kit, skin, (front - 0.2 * long, 0.0, up), span, chord, taper=kit.uniform("taper", 0.55, 1.0),
           dihedral=kit.uniform("dihedral", 0.5, 6), thick=0.13, elliptic=kit.chance("round_tips", 0.25))  # fmt: skip
    cabin = front - 0.24 * long
    if place == "high":
        frame = [(cabin + 0.45, wide * 0.7, 0.1, z + high * 0.75), (cabin, wide * 0.93, high * 0.52, z + high * 0.85),
                 (cabin - 1.5, wide * 0.88, high * 0.5, z + high * 0.85), (cabin - 2.4, wide * 0.5, 0.1, z + high * 0.7)]  # fmt: skip
        kit.add(DARK_GLASS, body(frame, 3.2, 3, 20))
        for x in (cabin - 0.1, cabin - 1.4):
            kit.both(skin, rod((x, wide * 0.88, z + high * 0.6), (x - 0.05, wide * 0.8, up + 0.02), 0.05, 6))
        if kit.chance("struts", 0.75):
            kit.both(accent, rod((front - 0.33 * long, wide * 0.9, z - high * 0.6), (front - 0.32 * long, span * 0.5, up + 0.02), 0.045, 6))
    elif place == "low":
        _canopy(kit, cabin - 0.7, kit.uniform("canopy", 2.2, 3.4), wide * 0.9, high * 0.95, z + high * 0.55)
    else:
        kit.both(accent, *(rod((front - t * long, wide * 0.8, z + high * 0.7), (front - t * long - 0.1, wide * 0.8, up), 0.04, 6) for t in (0.24, 0.36)))
        kit.add(BLACK, ball(0.9, wide * 1.3, 0.3, 14).at(cabin - 1.6, 0, z + high * 0.82))
    fin = kit.uniform("fin", 1.2, 1.6)
    _fin(kit, accent, rear + 1.0, z + 0.1, fin, fin * 0.8, taper=0.55, sweep=kit.uniform("fin_sweep", 10, 42))
    t_tail = kit.chance("t_tail", 0.15)
    _wings(kit, skin, (rear + (0.5 if t_tail else 1.0), 0.0, z + 0.1 + fin if t_tail else z + 0.22), 0.2 * long, 0.85, taper=0.65, sweep=8)
    _propeller(kit, accent, front, 0, z - 0.05, kit.uniform("propeller", 0.85, 1.1), 0.17, kit.choose("blades", 2, 3, 3, 4))
    if floats:
        kit.both(skin, body([(front - 0.1, 0.05, 0.1, 0.5), (front - 0.6, 0.3, 0.3, 0.36), (0.0, 0.36, 0.36, 0.36), (rear + 0.3 * long, 0.08, 0.1, 0.5)], 2.6).at(0, 1.25, 0))
        for x in (front - 0.15 * long, front - 0.45 * long):
            kit.both(CHROME, rod((x, wide * 0.7, z - high * 0.6), (x, 1.2, 0.6), 0.05, 6), rod((x, 0, 0.6), (x, 1.2, 0.6), 0.04, 6))
    elif kit.chance("tail_wheel", 0.4):
        kit.both(CHROME, rod((front - 0.2 * long, 0.3, z - high * 0.6), (front - 0.17 * long, 0.95, 0.3), 0.05, 6))
        for material, part in small_wheel(0.3, 0.18, CHROME):
            kit.both(material, part.at(front - 0.17 * long, 1.03, 0.3))
        kit.add(CHROME, rod((rear + 0.3, 0, z + 0.1), (rear + 0.15, 0, z - 0.75), 0.03, 6))
        kit.add(BLACK, ball(0.24, 0.1, 0.24, 12).at(rear + 0.15, 0, z - 0.75))
    else:
        _gear(kit, [(front - 0.35, 0, z - 0.3), (front - 0.42 * long, 1.1, z - (high * 0.75 if place == "low" else 0.9))], 0.25)
        if place != "low":
            kit.both(CHROME, rod((front - 0.42 * long, 0.2, z - high * 0.8), (front - 0.42 * long, 1.1, 0.25), 0.05, 6))


def _biplane(kit: Kit, skin: Material, accent: Material) -> None:
    """Two wings or three, open cockpit, struts and wires; now and then on one long float."""
    decks = kit.choose("decks", 2, 2, 2, 3)
    long, wide = kit.uniform("length", 5.6, 8.0), kit.uniform("radius", 0.4, 0.52)
    z, front = 1.45, 0.36 * long
    rear = front - long
    square = kit.uniform("square", 2.2, 5.0)
    _fuselage(kit, skin, [(front, wide * 0.75, wide * 0.85, z), (front - 0.15, wide, wide * 1.1, z), (front - 0.35 * long, wide, wide * 1.2, z),
                          (front - 0.6 * long, wide * 0.7, wide * 0.85, z + 0.05), (rear, 0.05, 0.2, z + 0.15)], square)  # fmt: skip
    kit.add(metal(kit.rng), body([(front + 0.12, wide * 0.6, wide * 0.6, z), (front, wide * 0.85, wide * 0.95, z), (front - 0.4, wide * 1.05, wide * 1.15, z)]))
    span, chord = long * kit.uniform("span", 0.52, 0.75), kit.uniform("chord", 1.0, 1.5)
    gap, stagger = kit.uniform("gap", 1.3, 1.7) * (0.7 if decks == 3 else 1), kit.uniform("stagger", 0.0, 0.6)
    low, x = z - wide * 1.0, front - 0.16 * long
    for k in range(decks):
        size = 1.0 if k == decks - 1 else kit.uniform(f"wing_{k}", 0.8, 1.0)
        _wings(kit, skin, (x - stagger * (1 - k), 0, low + gap * k), span * size, chord, taper=0.92, dihedral=2.0, thick=0.07)
    top = low + gap * (decks - 1)
    for share in (0.45, 0.78) if span > 4.5 else (0.68,):
        for dx in (0.15, 0.75):
            kit.both(accent, rod((x - stagger - dx * chord, span * share * 0.9, low), (x - stagger * (2 - decks) - dx * chord, span * share * 0.95, top + 0.05), 0.04, 6))
        kit.both(BLACK, rod((x - 0.3 * chord, wide, z), (x - 0.3 * chord, span * share, top), 0.015, 5),
                 rod((x - 0.3 * chord, wide, top), (x - stagger - 0.3 * chord, span * share, low), 0.015, 5))  # fmt: skip
    for dx in (0.2, 0.7):
        kit.both(accent, rod((x - dx * chord, wide * 0.8, z + wide), (x - dx * chord, wide * 1.1, top), 0.035, 6))
    for k in range(kit.choose("cockpits", 1, 2)):
        cx = front - 0.42 * long - 0.95 * k
        kit.add(BLACK, ball(0.75, wide * 1.4, 0.25, 14).at(cx, 0, z + wide * (1.1 - 0.12 * k)))
        kit.add(DARK_GLASS, sheet(np.array([[(cx + 0.4 - 0.1 * t, y, z + wide + 0.05 + 0.3 * t) for y in np.linspace(-0.3, 0.3, 5)] for t in (0, 1)]), 0.02))
    fin = kit.uniform("fin", 0.9, 1.3)
    _fin(kit, accent, rear + 0.8, z + 0.1, fin, 0.95, taper=0.6, sweep=20)
    _wings(kit, skin, (rear + 0.85, 0, z + 0.15), 0.19 * long, 0.85, taper=0.8, sweep=10, elliptic=True)
    _propeller(kit, accent, front + 0.1, 0, z, 1.1, 0.16, kit.choose("blades", 2, 2, 3))
    gx = front - 0.12 * long
    for dx in (-0.25, 0.25):
        kit.both(accent, rod((gx + dx, wide * 0.7, z - wide), (gx, 0.85, 0.36), 0.04, 6))
    kit.add(accent, rod((gx, -0.85, 0.36), (gx, 0.85, 0.36), 0.04, 6))
    for material, part in small_wheel(0.36, 0.13, skin):
        kit.both(material, part.at(gx, 0.9, 0.36))
    kit.add(BLACK, rod((rear + 0.5, 0, z), (rear + 0.25, 0, z - 0.75), 0.04, 6))


def _glider(kit: Kit, skin: Material, accent: Material) -> None:
    """Sailplane, now and then with a propeller behind; very long wings."""
    long, z = kit.uniform("length", 6.2, 8.2), 0.75
    front = 0.42 * long
    rear = front - long
    pod = kit.uniform("pod", 0.3, 0.38)
    _fuselage(kit, skin, [(front, 0.03, 0.03, z - 0.1), (front - 0.25, pod * 0.5, pod * 0.6, z - 0.06), (front - 0.9, pod * 0.92, pod * 1.1, z),
                          (front - 1.9, pod, pod * 1.25, z), (front - 3.2, pod * 0.5, pod * 0.6, z + 0.08), (rear + 1.2, 0.14, 0.16, z + 0.12), (rear, 0.07, 0.1, z + 0.15)])  # fmt: skip
    kit.add(DARK_GLASS, body([(front - 0.5, 0.05, 0.05, z + 0.2), (front - 1.1, pod * 0.85, pod * 0.9, z + 0.2), (front - 1.7, pod * 0.85, pod * 0.95, z + 0.22), (front - 2.3, 0.06, 0.05, z + 0.25)], 2, 3, 18))
    span = kit.uniform("span", 6.0, 11.0)
    edge = _wings(kit, skin, (front - 1.9, 0, z + pod * 0.75), span, kit.uniform("chord", 0.75, 1.1), taper=0.4, dihedral=kit.uniform("dihedral", 1.5, 5), thick=0.13, elliptic=kit.chance("elliptic", 0.5))
    if kit.chance("winglets", 0.5):
        _fin(kit, accent, edge[-1, 0], edge[-1, 2], 0.45, 0.25, y=edge[-1, 1], cant=20)
    tail = kit.choose("tail", "t", "t", "v", "cross")
    if tail == "v":
        _fin(kit, skin, rear + 0.7, z + 0.1, 0.95, 0.65, y=0.03, cant=48, sweep=15)
    else:
        _fin(kit, skin, rear + 0.85, z + 0.05, 1.25, 0.9, taper=0.7, sweep=14)
        _wings(kit, skin, (rear + 0.6, 0, z + (1.28 if tail == "t" else 0.45)), 1.35, 0.5, taper=0.55, sweep=5)
    _gear(kit, [(front - 1.8, 0, z - 0.2)], 0.2)
    kit.add(BLACK, ball(0.2, 0.08, 0.2, 12).at(rear + 0.4, 0, z - 0.02))


def _fighter(kit: Kit, skin: Material, accent: Material) -> None:
    """Jets: delta, swept, trapezoid, forward-swept wings; one or two fins and engines."""
    form = kit.choose("planform", "delta", "swept", "trapezoid", "cropped_delta", "forward", "straight")
    long, wide = kit.uniform("length", 12, 20), kit.uniform("radius", 0.06, 0.085)
    wide *= long * 0.75
    z, front, rear = 2.1, long / 2, -long / 2
    flat = kit.uniform("flatness", 0.6, 1.0)
    twin = kit.chance("twin_engines", 0.5)
    tail = wide * (1.25 if twin else 0.8)
    round_nose = kit.chance("nose_intake", 0.2)
    stations: list[Station] = [(front, 0.03, 0.03, z), (front - 0.1 * long, wide * 0.36, wide * 0.4, z), (front - 0.25 * long, wide * 0.68, wide * 0.74, z + 0.05),
                (front - 0.42 * long, wide * (1.3 if twin else 1.05), wide * 0.95 * flat, z), (-0.1 * long, wide * (1.5 if twin else 1.1), wide * 0.95 * flat, z),
                (rear + 0.2 * long, tail * 1.05, wide * 0.82 * flat, z), (rear + 0.03 * long, tail * 0.8, wide * 0.6 * flat, z)]  # fmt: skip
    if round_nose:
        stations[:2] = [(front - 0.06 * long, wide * 0.6, wide * 0.62, z), (front - 0.09 * long, wide * 0.66, wide * 0.68, z)]
        kit.add(BLACK, ball(0.06 * long, wide * 0.8, wide * 0.8, 14).at(front - 0.065 * long, 0, z))
    else:
        kit.add(BLACK, rod((front, 0, z), (front + 0.05 * long, 0, z), 0.05, 6))
    _fuselage(kit, skin, stations, kit.uniform("power", 2.0, 3.2))
    wing_z = z + kit.uniform("wing_height", -0.35, 0.5) * wide
    root, span_, sweep, taper = {"delta": (0.48, 0.3, 56, 0.06), "cropped_delta": (0.36, 0.3, 48, 0.22), "swept": (0.24, 0.36, 38, 0.45),
                                 "trapezoid": (0.28, 0.32, 30, 0.32), "forward": (0.26, 0.36, -24, 0.4), "straight": (0.2, 0.4, 6, 0.6)}[form]  # fmt: skip
    span, chord = span_ * long * kit.uniform("span", 0.9, 1.15), root * long * kit.uniform("chord", 0.9, 1.1)
    x = rear + {"delta": 0.62, "cropped_delta": 0.54, "forward": 0.36, "straight": 0.54}.get(form, 0.52) * long
    edge = _wings(kit, skin, (x, wide * 0.6, wing_z), span, chord, taper=taper, sweep=sweep, dihedral=kit.uniform("dihedral", -5, 3), thick=0.045)
    if kit.chance("strakes", 0.5) and form in ("trapezoid", "swept", "cropped_delta"):
        kit.both(skin, wing([(x + 0.2 * long, wide * 0.4, wing_z, 0.22 * long), (x, wide * 1.7, wing_z, 0.02 * long)], 0.03))
    canard = form in ("delta", "forward") and kit.chance("canards", 0.65)
    if canard:
        _wings(kit, skin, (front - 0.24 * long, wide * 0.5, wing_z + 0.3), wide + 0.1 * long, 0.1 * long, taper=0.35, sweep=45, thick=0.05)
    elif form != "delta":
        _wings(kit, skin, (rear + 0.17 * long, tail * 0.6, z), 0.55 * span + tail, 0.14 * long, taper=0.4, sweep=40, thick=0.05)
    fin = kit.uniform("fin", 0.13, 0.19) * long
    if kit.chance("twin_fins", 0.45):
        _fin(kit, skin, rear + 0.24 * long, z + 0.4 * wide, fin * 0.9, fin, y=tail * 0.85, cant=kit.uniform("cant", 0, 28), taper=0.4, sweep=40)
    else:
        _fin(kit, accent if kit.rng.random() < 0.3 else skin, rear + 0.28 * long, z + 0.4 * wide, fin * 1.1, fin * 1.35, taper=0.35, sweep=45)
    _canopy(kit, front - 0.27 * long, 0.2 * long, wide * 0.52, wide * 0.75, z + wide * 0.5)
    if not round_nose:
        kit.both(skin, box(0.22 * long, wide * 0.6, wide * 1.1, 0.1).at(-0.0 * long, wide * 1.25, z - 0.1))
        kit.both(BLACK, box(0.01, wide * 0.5, wide * 0.9).at(0.11 * long, wide * 1.25, z - 0.1))
    for s in (-1, 1) if twin else (0,):
        r = wide * (0.48 if twin else 0.62)
        nozzle = lathe([(r, 0.04 * long), (r, 0), (r * 0.78, -0.035 * long), (r * 0.68, -0.035 * long), (r * 0.6, 0.02 * long)], 18, loop=True)
        kit.add(Material((0.22, 0.21, 0.2), (0.3,) * 3, 30.0, name="nozzle"), nozzle.turned("y", 90).at(rear + 0.03 * long, s * tail * 0.5, z))
    for k in range(kit.choose("stores", 0, 1, 2, 3)):
        share = 0.35 + 0.22 * k
        sx, sy, sz, c = (np.interp(share, [0, 0.35, 0.97], edge[:3, col]) for col in range(4))
        r = 0.12 + 0.12 * (k == 0)
        store = body([(2.0, 0.02, 0.02, 0), (1.5, r, r, 0), (-1.2, r, r, 0), (-1.6, r * 0.5, r * 0.5, 0)], 2, 2, 12)
        kit.both(WHITE, store.at(sx - 0.4 * c, sy, sz - 0.42 - r))
        kit.both(skin, box(0.9, 0.08, 0.5).at(sx - 0.45 * c, sy, sz - 0.22))
    if kit.chance("gear", 0.5):
        _gear(kit, [(front - 0.3 * long, 0, z - 0.3), (rear + 0.38 * long, wide * 1.2, z - 0.3)], 0.36)


def _warbird(kit: Kit, skin: Material, accent: Material) -> None:
    """Fighters and bombers with pistons: one, two or four engines, twin booms, gull wings."""
    form = kit.choose("layout", "fighter", "fighter", "radial", "twin", "bomber", "booms")
    engines = {"fighter": 1, "radial": 1, "twin": 2, "booms": 2, "bomber": 4}[form]
    long = kit.uniform("length", 8.5, 11) * (1 + 0.35 * (engines - 1) * (form != "booms"))
    wide = (0.065 if form == "radial" else 0.05) * long * kit.uniform("fatness", 0.9, 1.2)
    z, front = 2.0 + 0.1 * engines, 0.38 * long
    rear = front - long if form != "booms" else -0.12 * long
    nose = 0.75 if engines == 1 else 0.15
    stations: list[Station] = [(front, wide * nose * 0.8, wide * nose * 0.8, z), (front - 0.03 * long, wide * max(nose, 0.45), wide * max(nose, 0.5), z),
                (front - 0.14 * long, wide * 0.95, wide * 1.15, z), (front - 0.4 * (front - rear), wide, wide * 1.3, z),
                (front - 0.65 * (front - rear), wide * 0.7, wide * 0.95, z + 0.08), (rear, 0.06, 0.12, z + 0.2)]  # fmt: skip
    _fuselage(kit, skin, stations)
    span, chord = long * kit.uniform("span", 0.5, 0.64), long * kit.uniform("chord", 0.2, 0.26) * (0.75 if engines > 1 else 1)
    x, low = front - 0.22 * long, z - wide * kit.uniform("wing_height", 0.3, 0.9)
    edge = _wings(kit, skin, (x, 0, low), span, chord, taper=0.5, sweep=kit.uniform("sweep", 0, 6), dihedral=kit.uniform("dihedral", 2, 7), thick=0.13, elliptic=kit.chance("elliptic", 0.4))
    radius, blades = 0.14 * long if engines == 1 else 0.1 * long, kit.choose("blades", 3, 3, 4)
    boom = 0.28 * span
    if engines == 1:
        _propeller(kit, accent, front, 0, z, radius, wide * 0.55, blades)
    for share in (() if engines == 1 else (0.28,) if engines == 2 else (0.27, 0.52)):
        y, r = share * span, wide * 0.62
        up = float(np.interp(y, edge[:, 1], edge[:, 2]))
        end = -2.1 * chord if form != "booms" else -0.62 * long
        pod = [(0.5 * chord, r * 0.7, r * 0.7, 0.0), (0.4 * chord, r, r, 0), (-0.4 * chord, r, r, 0), (0.5 * end - 0.3 * chord, r * 0.6, r * 0.7, 0), (end, 0.1, 0.14, 0.1)]
        kit.both(skin, body(pod).at(x, y, up))
        for s in (-1, 1):
            _propeller(kit, accent, x + 0.5 * chord, s * y, up, radius, r * 0.5, blades)
    fin = kit.uniform("fin", 0.12, 0.16) * long
    tail = rear if form != "booms" else x - 0.62 * long
    if form == "booms":
        _fin(kit, skin, tail + 0.8 * fin, low, fin, 0.9 * fin, y=boom, taper=0.6, sweep=15)
        kit.add(skin, wing([(tail + 0.7 * fin, -boom - 0.3, low + 0.25, 0.75 * fin), (tail + 0.7 * fin, boom + 0.3, low + 0.25, 0.75 * fin)], 0.1))
    else:
        pair = engines > 1 and kit.chance("twin_fins", 0.5)
        half = 0.19 * long
        if pair:
            _fin(kit, accent, tail + 0.95 * fin, z + 0.0, 0.8 * fin, 0.8 * fin, y=half * 0.95, taper=0.6, sweep=10)
        else:
            _fin(kit, accent, tail + 1.1 * fin, z + 0.15, fin, 1.0 * fin, taper=0.5, sweep=22)
        _wings(kit, skin, (tail + fin, 0, z + 0.2), half, 0.75 * fin, taper=0.6, sweep=8)
    if engines == 4 or form == "twin":
        kit.add(DARK_GLASS, ball(0.12 * long, wide * 1.4, wide * 1.5, 16).at(front - 0.02 * long, 0, z))
        for at in kit.choose("turrets", (-0.1,), (0.0, -0.25)):
            kit.add(DARK_GLASS, ball(0.06 * long, wide * 1.0, wide * 1.0, 14).at(at * long, 0, z + wide * 1.1))
    _canopy(kit, front - (0.3 if engines == 1 else 0.17) * long, 0.2 * long if engines == 1 else 0.13 * long, wide * 0.72, wide * 1.1, z + wide * 0.9)
    if kit.chance("gear", 0.6):
        gy = 0.28 * span if engines > 1 else 0.2 * span
        _gear(kit, [(x + 0.02 * long, gy, low), (tail + 0.12 * long if form != "booms" else front - 0.05 * long, 0, z)][: 1 if form == "booms" else 2][:1], 0.045 * long)
        kit.add(BLACK, rod((tail + 1.4, 0, z), (tail + 1.2, 0, z - 0.9), 0.06, 6)) if form != "booms" else _gear(kit, [(front - 0.08 * long, 0, z - 0.2)], 0.035 * long)


def _flying_wing(kit: Kit, skin: Material, accent: Material) -> None:
    """All wing: bombers, drones; a hang glider's sail with its pilot."""
    span, sweep = kit.uniform("span", 9, 24), kit.uniform("sweep", 22, 42)
    root = span * kit.uniform("root", 0.42, 0.62)
    z = 2.0
    edge = _wings(kit, skin, (0.5 * root, 0, z), span, root, taper=kit.uniform("taper", 0.12, 0.3), sweep=sweep, thick=0.11, kink=kit.uniform("kink", 0.05, 0.3))
    fat = 0.1 * root
    _fuselage(kit, skin, [(0.62 * root, 0.05, 0.05, z), (0.45 * root, fat * 1.1, fat * 0.75, z), (0.15 * root, fat * 1.5, fat * 1.25, z + 0.1),
                          (-0.25 * root, fat * 1.3, fat * 0.8, z), (-0.5 * root, 0.2, 0.1, z)], 2.2)  # fmt: skip
    _canopy(kit, 0.25 * root, 0.26 * root, fat * 0.7, fat * 0.8, z + fat * 0.6)
    for s in (-1, 1):
        kit.add(skin, body([(0.2 * root, fat * 0.6, 0.1, z + 0.1), (0.05 * root, fat * 0.8, fat * 0.7, z + 0.15), (-0.4 * root, fat * 0.5, 0.1, z)], 2.6).at(0, s * fat * 2.4, 0))
        kit.add(BLACK, box(0.02 * root, fat, fat * 0.45).at(0.15 * root, s * fat * 2.4, z + fat * 0.25))
    fins = kit.choose("fins", "none", "none", "tips", "inner")
    if fins == "tips":
        _fin(kit, accent, edge[2, 0] + 0.2, edge[2, 2], 0.15 * span, edge[2, 3], y=edge[2, 1], taper=0.5)
    elif fins == "inner":
        _fin(kit, accent, -0.1 * root, z, 0.14 * span, 0.2 * root, y=fat * 3, cant=10, taper=0.5)
    if kit.chance("gear", 0.6):
        _gear(kit, [(0.4 * root, 0, z), (-0.1 * root, 2.6 * fat, z)], 0.4, True)


def _supersonic(kit: Kit, skin: Material, accent: Material) -> None:
    """Needle with an ogee delta, or a stubby space glider."""
    if kit.chance("shuttle", 0.35):
        long, wide, z = 30.0, kit.uniform("radius", 2.4, 3.2), 4.2
        stations: list[Station] = [(15, 0.1, 0.1, z - 1), (14.3, wide * 0.5, wide * 0.5, z - 0.8), (11, wide * 0.9, wide * 0.9, z - 0.2), (7, wide, wide * 1.1, z), (-12, wide, wide * 1.1, z), (-14, wide * 1.1, wide, z)]
        _fuselage(kit, skin, stations, 2.8)
        kit.both(skin, wing([(9, wide * 0.8, z - wide * 0.8, 21), (-1, wide * 1.3, z - wide * 0.8, 11.5), (-9, 12 * kit.uniform("span", 0.85, 1.1), z - wide * 0.7, 3.4)], 0.05))
        _fin(kit, skin, -7.5, z + wide * 0.9, 7.5, 6.5, taper=0.5, sweep=45)
        kit.both(skin, body([(-8, 0.3, 0.3, 0), (-10.5, 1.3, 1.3, 0), (-14, 1.3, 1.2, 0)]).at(0, wide * 0.7, z + wide * 0.8))
        for y, up in ((0, 1.6), (1.4, -0.6), (-1.4, -0.6)):
            kit.add(BLACK, lathe([(1.2, 0), (0.5, 2.0)], 18).turned("y", 90).at(-15.5, y, z + up))
        _cockpit_band(kit, stations, 13.3, 11.8)
        _gear(kit, [(10, 0, z - 1), (-8, 3, z - wide * 0.8)], 0.6, True)
        return
    long, wide = kit.uniform("length", 45, 62), kit.uniform("radius", 1.2, 1.7)
    z, front, rear = 4.6, long / 2, -long / 2
    droop = kit.uniform("droop", 0.0, 1.5)
    _fuselage(kit, skin, [(front, 0.05, 0.05, z - droop), (front - 0.06 * long, wide * 0.5, wide * 0.5, z - droop * 0.4), (front - 0.14 * long, wide, wide * 1.05, z),
                          (rear + 0.3 * long, wide, wide * 1.05, z), (rear, 0.1, 0.15, z + 0.5)])  # fmt: skip
    span = long * kit.uniform("span", 0.18, 0.25)
    x = rear + 0.62 * long
    sections = [(x, wide * 0.6, z - 0.7, 0.5 * long), (x - 0.13 * long, wide + 0.18 * span, z - 0.7, 0.37 * long), (x - 0.26 * long, wide + 0.45 * span, z - 0.6, 0.23 * long),
                (x - 0.42 * long, wide + 0.9 * span, z - 0.5, 0.06 * long)]  # fmt: skip
    kit.both(skin, wing(sections, 0.03, steps=2))
    _fin(kit, accent, rear + 0.24 * long, z + 0.8, 0.11 * long, 0.2 * long, taper=0.25, sweep=52)
    for y in (0.3, 0.48):
        kit.both(skin, box(0.17 * long, 1.9, 1.7, 0.2).at(rear + 0.21 * long, wide + y * span, z - 1.7))
        kit.both(BLACK, box(0.1, 1.5, 1.3).at(rear + 0.296 * long, wide + y * span, z - 1.7))
    _windows(kit, rear + 0.3 * long, front - 0.2 * long, 1.3, wide, z + 0.3, 0.35)
    kit.add(DARK_GLASS, body([(front - 0.075 * long, 0.1, 0.1, z + 0.1), (front - 0.1 * long, 0.7, 0.5, z + 0.55), (front - 0.14 * long, 0.5, 0.2, z + 0.9)], 2, 2, 14))
    _gear(kit, [(front - 0.25 * long, 0, z - 1), (rear + 0.34 * long, wide * 2.4, z - 1)], 0.6, True)


def _flying_boat(kit: Kit, skin: Material, accent: Material) -> None:
    """A hull with a step, a high wing, engines on it or above it."""
    long, wide = kit.uniform("length", 9, 28), kit.uniform("radius", 0.06, 0.085)
    wide *= long
    z = wide * 1.25
    _fuselage(kit, skin, [(0.45 * long, 0.05, 0.1, z + 0.35 * wide), (0.41 * long, wide * 0.5, wide * 0.6, z + 0.2 * wide), (0.3 * long, wide * 0.95, wide * 1.05, z), (0.02 * long, wide, wide * 1.25, z),
                          (-0.02 * long, wide * 0.95, wide * 1.0, z + 0.25 * wide), (-0.3 * long, wide * 0.5, wide * 0.65, z + 0.6 * wide), (-0.55 * long, 0.1, 0.2, z + 1.1 * wide)], 2.5)  # fmt: skip
    span, chord, parasol = long * kit.uniform("span", 0.55, 0.75), long * 0.15, kit.chance("parasol", 0.4)
    up = z + wide * (2.3 if parasol else 1.15)
    _wings(kit, skin, (0.12 * long, 0, up), span, chord, taper=0.55, sweep=2, dihedral=1, thick=0.14)
    if parasol:
        kit.add(skin, wing([(0.11 * long, 0, z + 0.8 * wide, 0.12 * long), (0.1 * long, 0, up, 0.1 * long)], 0.3, fin=True))
        kit.both(CHROME, rod((0.05 * long, wide * 0.9, z), (0.05 * long, 0.45 * span, up), 0.012 * long, 6))
    engines, r = kit.choose("engines", 1, 2, 2, 4), 0.2 * chord
    for share in {1: (0.0,), 2: (0.22,), 4: (0.2, 0.42)}[engines]:
        ez = up + (2.4 * r if engines == 1 else 0.5 * r)
        pod = body([(0.4 * chord, r * 0.8, r * 0.8, 0), (0.3 * chord, r, r, 0), (-0.3 * chord, r, r, 0), (-0.9 * chord, 0.1 * r, 0.1 * r, 0)])
        for s in (-1, 1) if share else (1,):
            kit.add(skin, pod.at(0.12 * long, s * share * span, ez))
            _propeller(kit, accent, 0.12 * long + 0.4 * chord, s * share * span, ez, 0.075 * long, r * 0.6, 3)
        if not share:
            kit.both(CHROME, rod((0.06 * long, 0.3, up), (0.06 * long, 0.1, ez), 0.01 * long, 6))
    fin = 0.17 * long
    _fin(kit, accent, -0.55 * long + 1.1 * fin, z + 0.9 * wide, fin, fin, taper=0.55, sweep=28)
    _wings(kit, skin, (-0.55 * long + 0.8 * fin, 0, z + 0.9 * wide + 0.4 * fin), 0.2 * long, 0.65 * fin, taper=0.6, sweep=8)
    kit.both(skin, body([(0.08 * long, 0.02, 0.02, 0), (0.03 * long, 0.2 * wide, 0.22 * wide, 0), (-0.08 * long, 0.05, 0.05, 0.05)], 2, 3, 14).at(0.06 * long, 0.72 * span, z * 0.85))
    kit.both(CHROME, rod((0.07 * long, 0.72 * span, z * 0.85), (0.07 * long, 0.72 * span, up), 0.008 * long, 6))
    kit.add(DARK_GLASS, body([(0.36 * long, 0.1, 0.05, z + 0.7 * wide), (0.31 * long, wide * 0.7, wide * 0.5, z + 0.85 * wide), (0.22 * long, wide * 0.6, wide * 0.4, z + 0.9 * wide), (0.17 * long, 0.1, 0.05, z + wide)], 2.5, 3, 16))


def _helicopter(kit: Kit, skin: Material, accent: Material) -> None:
    """A cabin under a rotor, or between two."""
    form = kit.choose("layout", "single", "single", "bubble", "tandem", "attack")
    long, z = kit.uniform("cabin", 3.0, 5.0), kit.uniform("height", 1.5, 1.9)
    wide = {"attack": 0.55, "bubble": 0.75}.get(form, kit.uniform("width", 0.85, 1.1))
    high = wide * kit.uniform("depth", 0.95, 1.2) * (1.4 if form == "attack" else 1)
    rotor, blades = long * kit.uniform("rotor", 1.15, 1.5), kit.choose("blades", 2, 3, 4, 5)
    if form == "tandem":
        long *= 2.2
        rotor = 0.52 * long
    front, rear = 0.5 * long, -0.5 * long
    stations: list[Station] = [(front, 0.05, 0.05, z - 0.3 * high), (front - 0.05 * long, wide * 0.5, high * 0.45, z - 0.25 * high), (front - 0.25 * long, wide * 0.95, high * 0.9, z),
                (0, wide, high, z), (rear + 0.2 * long, wide * 0.9, high * 0.85, z + 0.1), (rear, wide * 0.35, high * 0.35, z + 0.4 * high)]  # fmt: skip
    _fuselage(kit, skin, stations, 2.6)
    glass = DARK_GLASS
    kit.add(glass, body([(front - 0.005 * long, 0.03, 0.03, z - 0.1 * high), (front - 0.06 * long, wide * 0.55, high * 0.55, z - 0.08 * high), (front - 0.24 * long, wide * 0.98, high * 0.85, z + 0.12 * high), (front - 0.4 * long, wide * 0.9, high * 0.6, z + 0.2 * high)], 2.5, 3, 20))
    kit.both(glass, box(0.2 * long, 0.06, high * 0.6, 0.02).at(-0.12 * long, wide * 0.98, z + 0.2 * high))
    mast = z + high * 1.5
    spots = [(-0.02 * long, mast)]
    if form == "tandem":
        spots = [(0.34 * long, mast), (-0.4 * long, mast + high)]
        kit.add(skin, wing([(-0.25 * long, 0, z + 0.5 * high, 0.3 * long), (-0.3 * long, 0, mast + 0.9 * high, 0.2 * long)], 0.3, fin=True))
        kit.add(skin, body([(0.45 * long, 0.1, 0.1, z + high * 0.8), (0.36 * long, wide * 0.6, high * 0.5, z + high), (0.2 * long, 0.1, 0.1, z + 0.9 * high)]))
    else:
        boom = long * kit.uniform("boom", 0.95, 1.3)
        end = rear - boom
        lift = kit.uniform("lift", 0.3, 0.6) * high
        kit.add(skin, body([(rear + 0.1 * long, wide * 0.42, high * 0.42, z + 0.4 * high), (rear - 0.3 * boom, wide * 0.24, high * 0.24, z + 0.42 * high), (end, 0.1, 0.14, z + 0.4 * high + lift)]))
        _fin(kit, accent, end + 0.45, z + 0.2 * high + lift, 1.25, 0.7, taper=0.55, sweep=kit.uniform("fin_sweep", 15, 45))
        _wings(kit, accent, (end + 0.28 * boom, 0, z + 0.42 * high + 0.7 * lift), 0.85, 0.42, taper=0.8)
        tail_rotor = 0.2 * rotor
        for angle in around(kit.choose("tail_blades", 2, 3, 4), kit.rng.uniform(0, 90)):
            kit.add(BLACK, box(0.14, 0.03, tail_rotor).at(z=tail_rotor / 2).turned("y", angle).at(end + 0.1, 0.16, z + 0.9 * high + lift))
        kit.add(BLACK, rod((end + 0.1, 0, z + 0.9 * high + lift), (end + 0.1, 0.2, z + 0.9 * high + lift), 0.06, 8))
        kit.add(skin, body([(0.3 * long, 0.1, 0.1, z + 0.85 * high), (0.08 * long, wide * 0.55, high * 0.4, z + high), (rear + 0.25 * long, wide * 0.5, high * 0.35, z + 0.95 * high), (rear, 0.1, 0.1, z + 0.6 * high)], 2.6))
    if form == "attack":
        _wings(kit, skin, (0.08 * long, wide * 0.5, z), wide + 1.3, 0.7, taper=0.8, dihedral=-4)
        kit.both(BLACK, body([(0.7, 0.2, 0.2, 0), (-0.8, 0.2, 0.2, 0)], 2, 2, 14).at(-0.05 * long, wide + 0.9, z - 0.3))
        kit.add(BLACK, rod((front - 0.2 * long, 0, z - high * 0.9), (front + 0.4, 0, z - high), 0.06, 8))
    for turn, (x, up) in enumerate(spots):
        kit.add(BLACK, rod((x, 0, z + 0.6 * high), (x, 0, up + 0.06), 0.09, 10), ball(0.5, 0.5, 0.2, 14).at(x, 0, up))
        blade = wing([(0.1, 0.1, 0, 0.24), (0.1, rotor, 0, 0.24)], 0.1)
        for angle in around(blades, kit.rng.uniform(0, 90) + 60 * turn):
            kit.add(BLACK, blade.turned("z", angle).at(x, 0, up))
    if form in ("tandem", "attack") or kit.chance("wheels", 0.3):
        _gear(kit, [(front - 0.25 * long, 0.0 if form == "attack" else wide * 0.7, z - 0.5 * high), (rear + 0.2 * long, wide, z - 0.5 * high)], 0.25)
    else:
        y = wide * 1.15
        skid = [(front - 0.02 * long, y, 0.35), (front - 0.12 * long, y, 0.06), (rear + 0.1 * long, y, 0.06)]
        kit.both(CHROME, tube(skid, 0.055, 6))
        for x in (front - 0.3 * long, rear + 0.28 * long):
            kit.add(CHROME, tube([(x, -y, 0.08), (x, -y * 0.6, z - 0.8 * high), (x, y * 0.6, z - 0.8 * high), (x, y, 0.08)], 0.05, 6))
    kit.add(RED_LIGHT, ball(0.14, 0.14, 0.14, 8).at(-0.3 * long, 0, z + high * 0.95))


def _ultralight(kit: Kit, skin: Material, accent: Material) -> None:
    """A fabric sail on tubes: a trike with a propeller behind."""
    span, z = kit.uniform("span", 4.2, 5.4), kit.uniform("mast", 2.4, 3.0)
    nose, sweep = 1.5, kit.uniform("sweep", 22, 34)
    back = span * np.tan(np.radians(sweep))
    lift = kit.uniform("billow", 0.1, 0.45)
    for s in (-1, 1):
        us = np.linspace(0, 1, 9)
        grid = np.array([[(nose - u * back - c * (2.2 - 1.2 * u), s * u * span, z + lift * np.sin(np.pi * u) * (0.3 + c) + 0.12 * u) for u in us] for c in (0, 0.3, 0.65, 1.0)])
        kit.add(skin if s > 0 or kit.rng.random() < 0.7 else accent, sheet(grid, 0.03))
        kit.add(CHROME, rod((nose, 0, z), (nose - back, s * span, z + 0.12), 0.04, 6), rod((0.2, 0, z + 0.9), (0.1 - 0.5 * back, s * span * 0.5, z + lift), 0.012, 4),
                rod((0.75, s * 0.75, z - 1.5), (0.1 - 0.5 * back, s * span * 0.5, z), 0.012, 4), rod((0.1, 0, z), (0.75, s * 0.75, z - 1.5), 0.03, 6))  # fmt: skip
    kit.add(CHROME, rod((nose, 0, z), (-1.0, 0, z), 0.04, 6), rod((0.2, 0, z), (0.2, 0, z + 0.9), 0.03, 6), rod((0.75, -0.75, z - 1.5), (0.75, 0.75, z - 1.5), 0.03, 6), rod((0, 0, z), (-0.4, 0, 0.5), 0.05, 6))
    _fuselage(kit, accent, [(1.45, 0.03, 0.03, 0.62), (1.25, 0.2, 0.2, 0.62), (0.5, 0.36, 0.33, 0.62), (-0.5, 0.3, 0.28, 0.62), (-1.0, 0.12, 0.15, 0.7)], 2.4)
    leather = fabric(kit.rng)
    for x in (0.25, -0.4):
        kit.add(leather, ball(0.5, 0.5, 0.9, 12).at(x, 0, 1.15), ball(0.28, 0.25, 0.3, 12).at(x + 0.02, 0, 1.75))
    kit.add(metal(kit.rng), box(0.45, 0.35, 0.45, 0.04).at(-0.85, 0, 1.0))
    _propeller(kit, accent, -1.1, 0, 1.0, 0.85, 0.09, kit.choose("blades", 2, 3), back=True)
    _gear(kit, [(1.2, 0, 0.6), (-0.55, 0.8, 0.5)], 0.22)
    kit.both(CHROME, rod((-0.4, 0, 0.5), (-0.55, 0.8, 0.24), 0.035, 6))


KINDS = {
    "airliner": _airliner, "business": _business, "turboprop": _turboprop, "light": _light,
    "biplane": _biplane, "glider": _glider, "fighter": _fighter, "warbird": _warbird,
    "flying_wing": _flying_wing, "supersonic": _supersonic, "flying_boat": _flying_boat,
    "helicopter": _helicopter, "ultralight": _ultralight,
}  # fmt: skip
GREYS = ((0.42, 0.45, 0.36), (0.36, 0.38, 0.3), (0.5, 0.52, 0.55), (0.62, 0.64, 0.68), (0.3, 0.32, 0.34), (0.55, 0.5, 0.4))
"""Service paints."""


def plane(kit: Kit) -> None:
    """Planes of 13 kinds. Hidden: the depth of a bay in the belly."""
    kind = kit.choose("subtype", "airliner", "airliner", "fighter", "fighter", "light", "warbird", *KINDS)
    grey = Material(pick(kit.rng, GREYS), (0.15,) * 3, 20.0, name="service paint")
    civil = paint(kit.rng) if kind not in ("airliner", "business", "glider") or kit.rng.random() < 0.2 else WHITE
    service = {"fighter": 0.85, "warbird": 0.75, "flying_wing": 0.85, "helicopter": 0.3}.get(kind, 0.05)
    skin = grey if kit.rng.random() < service else WHITE if kit.rng.random() < 0.25 else civil
    KINDS[kind](kit, skin, paint(kit.rng))

"""Planes, cars and watercraft. Lengths in metres, the front toward +x."""
# fmt: off
# We format by hand, because the formatter would put each coordinate in a line.

import numpy as np

from data_gen.catalogues.families import materials as m
from data_gen.catalogues.families.kit import Kit, wheels
from data_gen.catalogues.shapes import (
    Solid,
    ball,
    block,
    box,
    cylinder,
    hull,
    lathe,
    loft,
    pillow,
    prism,
    rod,
    rounded,
    sheet,
    stack,
    tube,
    wing,
)
from data_gen.mesh import Material

PLANES = ("airliner", "airliner", "airliner", "fighter", "fighter", "fighter", "business",
          "propeller", "propeller", "transport", "biplane", "glider")


def _wings(kit: Kit, skin: Material, root: tuple[float, float, float], span: float, chord: float,
           taper: float, sweep: float, dihedral: float, thick: float = 0.1) -> np.ndarray:
    """A pair of wings whose leading edge begins at `root`; returns the leading edge of the tip."""
    slopes = np.tan(np.radians([sweep, dihedral]))
    tip = np.array(root) + span * np.array([-slopes[0], 1, slopes[1]])
    middle = 0.6 * np.array(root) + 0.4 * tip
    wide = chord * (0.6 * kit.choose(1.0, 0.85) + 0.4 * taper)
    kit.both(skin, wing([(*root, chord), (*middle, wide), (*tip, chord * taper)], thick))
    return tip


def _fin(kit: Kit, skin: Material, x: float, y: float, z: float, high: float, sweep: float) -> None:
    """A vertical fin with its leading edge from (x, y, z)."""
    shift = high * np.tan(np.radians(sweep))
    kit.add(skin, wing([(x, y, z, high), (x - shift, y, z + high, 0.45 * high)], 0.1, fin=True))


def _engine(kit: Kit, skin: Material, x: float, y: float, z: float, radius: float) -> None:
    """A pair of jet engines with their intakes at x."""
    profile = [(0, -0.3), (0.82, -0.3), (0.9, 0), (1.0, -0.25), (1.0, -1.4), (0.6, -3.1), (0, -2.8)]
    cowling = lathe([(r * radius, h * radius) for r, h in profile], 20).turned("y", 90)
    kit.both(skin, cowling.at(x, y, z))
    fan = cylinder(0.8 * radius, 0.1 * radius).turned("y", 90)
    kit.both(m.BLACK, fan.at(x - 0.28 * radius, y, z))


def _propeller(kit: Kit, x: float, y: float, z: float, radius: float) -> None:
    hub = lathe([(0.13, -0.13), (0.12, 0), (0.07, 0.12), (0, 0.17)], 14).turned("y", 90)
    kit.add(kit.choose(m.BLACK, m.CHROME), hub.scaled(radius, radius, radius).at(x, y, z))
    blade = prism([(-0.03, 0), (0.03, 0), (0.07, 0.5), (0.03, 1), (-0.02, 1), (-0.05, 0.5)], 0.03)
    count, start = kit.choose(2, 3, 3, 4), kit.uniform(0, 90)
    for angle in start + np.arange(count) * 360 / count:
        part = blade.scaled(radius, radius, radius).turned("z", 70).turned("x", angle)
        kit.add(m.BLACK, part.at(x, y, z))


def plane(kit: Kit, kind: str) -> None:
    """Airliners, fighters, business jets, propeller planes, biplanes, gliders."""
    skin = m.plain(m.grey(kit.rng), 0.4, 60.0) if kit.chance(0.5) else kit.draw(m.paint)
    accent = skin if kit.chance(0.4) else kit.draw(m.paint)
    spans = {"airliner": (30, 70, 0.04, 0.058), "transport": (25, 50, 0.055, 0.075),
             "business": (11, 20, 0.05, 0.065), "fighter": (13, 20, 0.035, 0.06),
             "glider": (6, 9, 0.035, 0.05)}.get(kind, (6.5, 11, 0.055, 0.08))
    long, slim = kit.uniform(*spans[:2]), kit.uniform(*spans[2:])
    wide, front, rear = long * slim, long / 2, -long / 2
    high, blunt, end = wide * kit.uniform(0.95, 1.2), kit.uniform(0.03, 0.08), 0.08
    if kind == "fighter":
        blunt, end = kit.uniform(0.15, 0.3), 0.6
    lift, back = high * (0.35 if end < 0.5 else 0.0), rear + kit.uniform(0.25, 0.4) * long
    body = [(front, 0.03 * wide, 0.03 * high, -0.15 * high),
            (front - 0.3 * blunt * long, 0.5 * wide, 0.5 * high, -0.1 * high),
            (front - 1.3 * blunt * long, 0.92 * wide, 0.93 * high, 0),
            (front - 2.2 * blunt * long, wide, high, 0),
            (back, wide, high, 0), (rear, end * wide, end * high, lift)]
    kit.add(skin, hull(body, kit.choose(2.0, 2.0, 2.6)))
    x, fin, gear = kit.uniform(-0.02, 0.14) * long, long * kit.uniform(0.12, 0.18), kit.chance(0.3)
    canopy = (0.3, 0.35, 0.42, 0.75)  # places of its ends and its height, relative to the body
    if kind in ("airliner", "transport", "business"):
        above, chord = kind == "transport" or kit.chance(0.1), long * kit.uniform(0.13, 0.19)
        behind = kind == "business" or kit.chance(0.15)
        root = (0.4 * chord + (0.02 * long if behind else x + 0.06 * long), 0.3 * wide,
                (0.8 if above else -0.65) * high)
        tip = _wings(kit, skin, root, long * kit.uniform(0.38, 0.52), chord, kit.uniform(0.22, 0.4),
                     kit.uniform(2 if kind == "transport" else 18, 36),
                     -2 if above else kit.uniform(3, 8))
        radius = wide * kit.uniform(0.38, 0.65)
        for share in () if behind else kit.choose((0.33,), (0.33,), (0.3, 0.6)):
            at = np.array(root) * (1 - share) + tip * share - [0, 0, 0.9 * radius]
            _engine(kit, skin, at[0] + 1.5 * radius, at[1], at[2], radius)
            kit.both(skin, box(1.8 * radius, 0.2 * radius, radius)
                     .at(at[0] - 0.5 * radius, at[1], at[2] + 0.6 * radius))
        if behind:
            _engine(kit, skin, rear + 0.3 * long, wide + 0.7 * radius, 0.4 * high, 0.9 * radius)
            pylon = box(1.6 * radius, 0.9 * wide, 0.25 * radius)
            kit.both(skin, pylon.at(rear + 0.3 * long - 1.6 * radius, 0.9 * wide, 0.4 * high))
        _fin(kit, accent, rear + 1.25 * fin, 0, 0.5 * high, fin, kit.uniform(25, 42))
        place = (rear + 0.95 * fin, 0, lift)
        if above or behind:
            place = (rear + 0.45 * fin, 0, 0.5 * high + 0.93 * fin)
        _wings(kit, skin, place, fin * kit.uniform(0.9, 1.2), 0.62 * fin, 0.45, 28, 5)
        kit.both(m.DARK_GLASS, block((rear + 0.3 * long, front - 0.16 * long),
                                     (0.93 * wide, 0.995 * wide), (0.2 * high, 0.29 * high)))
        canopy = (0.4 * blunt, 0.8 * blunt, 1.15 * blunt, 0.5)
    elif kind == "fighter":
        form = kit.choose("delta", "swept", "trapezoid")
        sweep = kit.uniform(*{"delta": (48, 62), "swept": (35, 48), "trapezoid": (25, 40)}[form])
        chord = long * kit.uniform(*(0.4, 0.55) if form == "delta" else (0.22, 0.32))
        span = long * kit.uniform(0.22, 0.36)
        if form == "delta":
            span = min(span, 0.95 * chord / np.tan(np.radians(sweep)))
        x, twin = rear + chord + kit.uniform(0.06, 0.2) * long, kit.chance(0.45)
        _wings(kit, skin, (x, 0.5 * wide, 0), span, chord, kit.uniform(0.05, 0.3), sweep,
               kit.uniform(-4, 2), 0.05)
        for y in (-0.85, 0.85) if twin else (0.0,):
            _fin(kit, accent, rear + 1.5 * fin, y * wide, (0.2 if twin else 0.6) * high, fin,
                 kit.uniform(30, 50))
        if form != "delta" or kit.chance(0.4):
            at, size = rear + fin, 0.8 * fin
            if form == "delta":
                at, size = front - 0.28 * long, 0.08 * long
            _wings(kit, skin, (at, 0.4 * wide, 0), size, 0.9 * size, 0.35, 40, 0, 0.06)
        if kit.chance(0.7):
            kit.both(skin, hull([(0.12 * long, 0.4 * wide, 0.75 * high, 0),
                                 (0, 0.5 * wide, 0.8 * high, 0),
                                 (rear + 0.05 * long, 0.45 * wide, 0.55 * high, 0)],
                                 4).at(y=0.95 * wide))
        for y in (-0.4, 0.4) if twin else (0.0,):
            kit.add(m.BLACK, lathe([(0.5 * wide, 0), (0.36 * wide, 0.4 * wide)], 18)
                    .turned("y", -90).at(rear + 0.1 * wide, y * wide))
        canopy = (0.14, 0.23, 0.36, 0.75)
    else:
        chord, span = long * kit.uniform(0.16, 0.22), long * kit.uniform(0.5, 0.7)
        if kind == "glider":
            chord, span = 0.6 * chord, 2 * span
        levels = (-0.75, 1.5) if kind == "biplane" else kit.choose((-0.6,), (0.85,))
        for level in levels:
            _wings(kit, skin, (x + 0.3 * chord, 0, level * high), span, chord,
                   kit.choose(1.0, kit.uniform(0.4, 0.8)), kit.uniform(0, 4), kit.uniform(1, 5))
        if kind == "biplane":
            for y in (0.25, 0.8):
                kit.both(accent, *(rod((x + s * chord, y * span, -0.72 * high),
                                       (x + s * chord, y * span, 1.6 * high + 0.03 * span),
                                       0.03) for s in (0.15, -0.3)))
            kit.both(accent, rod((x, 0.3 * wide, 0.8 * high), (x, 0.3 * wide, 1.55 * high), 0.03))
        _fin(kit, accent, rear + 0.95 * fin, 0, lift, fin, kit.uniform(5, 35))
        tail = lift + (0.9 * fin if kind == "glider" else 0)
        _wings(kit, accent, (rear + 0.7 * fin, 0, tail), fin * kit.uniform(0.9, 1.3), 0.65 * fin,
               0.6, kit.uniform(0, 15), 0)
        if kind != "glider":
            _propeller(kit, front + 0.01 * long, 0, -0.15 * high, long * kit.uniform(0.11, 0.15))
            gear = True
        share = 0.5 - x / long
        canopy = (share - 0.13, share - 0.02, share + 0.12, 0.8)
    first, middle, last = front - long * np.array(canopy[:3])
    kit.add(m.DARK_GLASS, hull([(first, 0.15 * wide, 0.1 * high, 0.8 * canopy[3] * high),
                                (middle, 0.7 * wide, 0.55 * high * canopy[3], canopy[3] * high),
                                (last, 0.3 * wide, 0.15 * high, canopy[3] * high)], 2.5))
    if gear:
        drop, r = high * kit.uniform(1.4, 1.9), 0.25 * high
        tyre = lathe([(0.3 * r, -0.35 * r), (r, -0.3 * r), (r, 0.3 * r), (0.3 * r, 0.35 * r)],
                     16).turned("x", 90)
        for at, y in ((x, max(wide, 0.3 * drop)), (x, -max(wide, 0.3 * drop)),
                      (front - 0.17 * long, 0)):
            kit.add(m.BLACK, tyre.at(at, y, -drop))
            kit.add(m.CHROME, rod((at, y, -drop), (at, 0.4 * y, -0.6 * high), 0.05 * high + 0.02))


CARS = ("saloon", "saloon", "saloon", "hatchback", "hatchback", "estate", "coupe", "coupe",
        "roadster", "suv", "suv", "pickup", "van", "bus", "lorry", "jeep")

_CARS = {
    # Ranges of length, width, height, hood and boot (fractions of the length); wheel radius.
    "saloon": ((4.2, 5.2), (1.7, 1.9), (1.38, 1.5), (0.24, 0.3), (0.12, 0.18), 0.32),
    "hatchback": ((3.2, 4.2), (1.6, 1.8), (1.4, 1.6), (0.16, 0.25), (0.0, 0.03), 0.31),
    "estate": ((4.4, 5.1), (1.7, 1.9), (1.42, 1.6), (0.22, 0.28), (0.0, 0.02), 0.32),
    "coupe": ((3.9, 4.8), (1.75, 2.05), (1.08, 1.35), (0.26, 0.38), (0.05, 0.2), 0.33),
    "roadster": ((3.5, 4.5), (1.6, 1.9), (1.15, 1.3), (0.3, 0.42), (0.15, 0.24), 0.32),
    "suv": ((4.1, 5.2), (1.8, 2.05), (1.62, 1.95), (0.2, 0.27), (0.0, 0.02), 0.38),
    "pickup": ((4.7, 5.9), (1.75, 2.05), (1.65, 1.95), (0.2, 0.28), (0.3, 0.42), 0.38),
    "van": ((4.2, 6.6), (1.8, 2.1), (1.85, 2.7), (0.08, 0.16), (0.0, 0.01), 0.33),
    "bus": ((7.0, 13.0), (2.35, 2.55), (2.8, 4.3), (0.005, 0.01), (0.0, 0.005), 0.48),
    "jeep": ((3.2, 4.2), (1.55, 1.85), (1.65, 1.95), (0.3, 0.38), (0.0, 0.02), 0.4),
}


def _lorry(kit: Kit, skin: Material) -> None:
    """A cab in front of a box, a flat bed, a tank or a tipper."""
    half, bed = kit.uniform(1.05, 1.25), kit.uniform(0.95, 1.15)
    cab, roof, long = kit.uniform(1.6, 2.4), kit.uniform(2.4, 3.4), kit.uniform(3.0, 9.0)
    nose, load = kit.choose(0.0, 0.0, kit.uniform(0.7, 1.3)), kit.draw(m.paint, m.lacquer)
    shape = rounded(cab, 2 * half, 0.12) + [cab / 2, 0]
    lean = shape * [1, 0.94] - [kit.uniform(0, 0.3), 0] * (shape[:, :1] > cab / 2)
    kit.add(skin, stack([(shape, 0.45), (shape, 0.55 * roof), (lean, roof)]))
    if nose:
        kit.add(skin, hull([(cab + nose, 0.75 * half, 0.4, 1.0),
                            (cab - 0.1, 0.85 * half, 0.55, 1.05)], 6))
    kit.add(m.DARK_GLASS, block((cab - 0.2, cab + 0.01), (-0.8 * half, 0.8 * half),
                                (0.58 * roof, 0.8 * roof)),
            block((0.35 * cab, 0.85 * cab), (-1.002 * half, 1.002 * half),
                  (0.58 * roof, 0.8 * roof)))
    kit.add(m.BLACK, block((-long, cab + nose - 0.3), (-0.45, 0.45), (0.45, bed)))
    bumper = block((cab + nose - 0.15, cab + nose + 0.06), (-half, half), (0.4, 0.65), 0.03)
    kit.add(kit.choose(m.CHROME, m.BLACK, skin), bumper)
    kit.both(m.LIGHT, box(0.1, 0.25, 0.16, 0.02).at(cab + nose, 0.75 * half, 0.75))
    box_, sides = (-long, -0.1), (-half, half)
    kit.add(load, *kit.choose(
        (block(box_, sides, (bed - 0.01, kit.uniform(1.0, 1.35) * roof), 0.03),),
        (block(box_, sides, (bed - 0.01, bed + 0.12)), block((-0.25, -0.1), sides,
            (bed, bed + 0.7))),
        (lathe([(0.8 * half, 0.02), (half, 0.25), (half, long - 0.4),
                (0.8 * half, long - 0.1)]).turned("y", -90).at(-0.1, 0, bed + 0.9 * half),),
        (prism([(-0.95 * long, bed - 0.01), (-0.15, bed - 0.01), (-0.05, bed + 1.2),
                (-long - 0.1, bed + 0.9)], 2 * half),)))
    wheels(kit, kit.draw(m.metal), kit.uniform(0.42, 0.52), 0.3, half - 0.13,
           (0.62 * cab + 0.6 * nose, -long + 0.9, -long + 2.0)[: 2 + (long > 5)])


def car(kit: Kit, kind: str) -> None:
    """Cars, vans, buses, lorries: a lofted body, a cabin of glass, wheels."""
    if kit.chance(0.7):
        skin = m.plain((m.lively if kit.chance(0.4) else m.grey)(kit.rng), 0.45, 70.0)
    else:
        skin = kit.draw(m.paint)
    if kind == "lorry":
        _lorry(kit, skin)
        return
    *spans, r = _CARS[kind]
    long, wide, high, hood, boot = (kit.uniform(*span) for span in spans)
    half, front, rear, r = wide / 2, long / 2, -long / 2, r * kit.uniform(0.93, 1.08)
    tall, low = kind in ("van", "bus"), r * kit.uniform(0.5, 0.7)
    belt = high * (kit.uniform(0.42, 0.5) if tall else kit.uniform(0.57, 0.65))
    screen, back = front - hood * long, rear + boot * long
    rakes = {"van": (0.4, 0.9), "bus": (0.02, 0.3), "jeep": (0.1, 0.2)}
    rake = kit.uniform(*rakes.get(kind, (0.5, 0.95)))
    slant = kit.uniform(*{"saloon": (0.5, 0.9), "coupe": (0.7, 1.4)}.get(kind, (0.05, 0.4)))
    top_front, top_rear = screen - rake * (high - belt) / 0.55, back + slant * (high - belt) / 0.55
    top_front = max(top_front, top_rear + 0.5)
    nose = kit.uniform(*((0.88, 1.0) if tall or kind in ("jeep", "suv") else (0.72, 0.95))) * belt
    tail = kit.uniform(0.88, 1.02) * belt if boot > 0.04 else belt
    corner = kit.uniform(0.01, 0.05) * long
    stations = [(front, 0.85, low + 0.12, nose - 0.1), (front - corner, 0.97, low, nose),
                (screen, 1, low, belt),
                ((screen + back) / 2, 1, low, belt), (min(back, rear + 0.25 * long), 1, low, tail),
                (rear + 0.5 * corner, 0.97, low, tail), (rear, 0.88, low + 0.12, tail - 0.08)]
    kit.add(skin, hull([(x, w * half, (b - a) / 2, (a + b) / 2) for x, w, a, b in stations],
                       14 if kind == "bus" else kit.uniform(5, 9), 2, 32))
    tumble = (kit.uniform(0.92, 0.98) if tall or kind == "jeep" else kit.uniform(0.78, 0.9)) * half

    def outline(x0: float, x1: float, w: float) -> np.ndarray:
        return rounded(x1 - x0, 2 * w, 0.12, 3) + [(x0 + x1) / 2, 0]

    if kind == "roadster" or (kind == "jeep" and kit.chance(0.4)):
        kit.add(m.BLACK, block((back + 0.1, screen - 0.2), (0.15 - half, half - 0.15),
                               (belt - 0.1, belt + 0.008)))
        kit.both(kit.choose(m.BLACK, m.RED_LIGHT, m.WHITE),
                 pillow(0.18, 0.5 * half, 0.5, 0.06).at(back + 0.45, 0.45 * half, belt + 0.1))
        pane = np.array([(screen, -0.85 * half, belt - 0.03), (screen, 0.85 * half, belt - 0.03),
                         (screen - 0.35, 0.8 * half, belt + 0.36),
                         (screen - 0.35, -0.8 * half, belt + 0.36)])
        kit.add(m.DARK_GLASS, loft([pane, pane - [0.03, 0, 0]]))
        kit.add(m.BLACK, tube(pane[[0, 3, 2, 1]] - [0.015, 0, 0], 0.025))
    else:
        head = outline(top_rear, top_front, tumble)
        kit.add(m.DARK_GLASS, stack([(outline(back, screen, 0.95 * half), belt - 0.06),
                                     (head, high - 0.05)]))
        roof, small = head * [1, 1.01], outline(top_rear + 0.1, top_front - 0.1, 0.9 * tumble)
        kit.add(skin, stack([(roof, high - 0.09), (roof, high - 0.04), (small, high)]))
        for share in np.linspace(0, 1, {"bus": 8, "van": 4, "estate": 4, "suv": 4}.get(kind, 3)):
            foot = back + 0.06 + share * (screen - back - 0.12)
            tip = top_rear + 0.05 + share * (top_front - top_rear - 0.1)
            kit.both(skin, rod((foot, 0.935 * half, belt - 0.05),
                               (tip, 0.985 * tumble, high - 0.06), 0.045, 6))
        if kind == "van" and kit.chance(0.6):  # no windows in the rear
            kit.add(skin, stack([(outline(back - 0.003, top_front - 0.2, 0.957 * half),
                                  belt - 0.05),
                                 (outline(top_rear - 0.003, top_front - 0.7, 1.006 * tumble),
                                  high - 0.03)]))
    if kind == "pickup":
        kit.add(m.BLACK, block((rear + 0.08, back - 0.05), (0.08 - half, half - 0.08),
                               (tail - 0.05, tail + 0.006)))
    places = [front - kit.uniform(0.15, 0.2) * long, rear + kit.uniform(0.17, 0.23) * long]
    for x in places:
        kit.both(m.BLACK, cylinder(1.16 * r, 0.1, 24).turned("x", 90).at(x, half - 0.042, r * 1.05))
    wheels(kit, kit.draw(m.metal, m.metal, m.lacquer), r, 0.24, half - 0.09, places)
    z = low + 0.6 * (nose - low)
    kit.both(m.LIGHT, ball(0.16, 0.3, 0.16, 12).at(front - 0.06 - 0.4 * corner, 0.68 * half, z))
    kit.both(m.RED_LIGHT, block((rear - 0.002, rear + 0.1), (0.6 * half, 0.84 * half),
                                (low + 0.55 * (tail - low), low + 0.75 * (tail - low))))
    kit.both(skin, pillow(0.12, 0.18, 0.12, 0.04).at(screen - 0.3, half + 0.03, belt + 0.03))
    kit.add(m.BLACK, block((front - 0.06, front + 0.012), (-0.4 * half, 0.4 * half),
                           (low + 0.17, z + 0.04)))
    bumper = pillow(0.16, 1.86 * half, 0.14, 0.05)
    kit.add(kit.choose(m.BLACK, m.CHROME, skin), bumper.at(front - 0.05, 0, low + 0.13),
            bumper.at(rear + 0.05, 0, low + 0.13))


_SHIPS = {
    # Ranges of width and height / length; power of the bow, width of the stern / width, power of
    # the section, rise of the deck at the ends / height.
    "yacht": ((0.2, 0.28), (0.08, 0.12), 1.7, 0.85, 2.2, 0.25),
    "cargo": ((0.13, 0.18), (0.06, 0.1), 2.6, 0.8, 6, 0.1),
    "tanker": ((0.14, 0.18), (0.05, 0.08), 3.0, 0.8, 6, 0.06),
    "cruise": ((0.11, 0.16), (0.05, 0.08), 2.0, 0.8, 5, 0.15),
    "warship": ((0.09, 0.13), (0.045, 0.065), 1.4, 0.7, 3, 0.25),
    "tug": ((0.3, 0.38), (0.12, 0.16), 2.4, 0.8, 3, 0.4),
    "fishing": ((0.24, 0.32), (0.1, 0.15), 2.0, 0.7, 2.5, 0.5),
    "speedboat": ((0.28, 0.36), (0.09, 0.13), 1.6, 0.95, 1.6, 0.15),
    "sail": ((0.22, 0.36), (0.1, 0.15), 1.9, 0.6, 2, 0.35),
    "galleon": ((0.22, 0.32), (0.13, 0.19), 1.9, 0.7, 2.2, 0.5),
    "rowing": ((0.14, 0.42), (0.09, 0.13), 1.7, 0.5, 2.6, 0.35),
}
WATERCRAFT = (*_SHIPS, "sail", "yacht", "cargo", "warship")


def _hull(length: float, beam: float, depth: float, bow: float, stern: float, belly: float,
          sheer: float, rake: float, wall: float) -> Solid:
    """The hull of a ship from z = 0, described in `_SHIPS`; `wall` > 0 makes an open boat."""
    rings, t = [], np.linspace(0, 1, 8)
    for s in np.linspace(-1, 1, 21):
        share = (1 - 0.999 * s**2) ** (1 / bow) if s > 0 else 1 - (1 - stern) * abs(s) ** 2.5
        half = beam / 2 * share
        top = depth * (1 + sheer * (s**2 if s > 0 else 0.5 * s**2))
        y = half * t ** (1 / belly + max(0, 2 * (s - 0.6)))
        z = np.maximum(top * t, 0.4 * depth * max(0, abs(s) - 0.7))
        x = s * length / 2 * (1 - rake * (1 - z / depth))
        side = np.stack([x, y, z], axis=1)
        ring = [*side[::-1], *(side[1:] * [1, -1, 1])]
        if wall:
            inner = np.stack([x, np.maximum(y - min(wall, 0.45 * half + 1e-4), 0),
                              np.minimum(z + wall * (1 - t), top)], axis=1)
            ring += [*(inner[::-1] * [1, -1, 1]), *inner[1:]]
        rings.append(np.array(ring))
    return loft(rings)


def _house(kit: Kit, wall: Material, x: tuple[float, float], wide: float, z: float, high: float,
           floors: int, shrink: float) -> float:
    """A superstructure of several floors with rows of windows; returns the height of its top."""
    for floor in range(floors):
        share = shrink * floor
        x0, x1 = x[0] + 0.3 * share * (x[1] - x[0]), x[1] - share * (x[1] - x[0])
        for material, low, top, more in ((wall, -0.02, 1.0, 0.0),
            (m.DARK_GLASS, 0.45, 0.75, 0.003 * (x1 - x0))):
            shape = rounded(x1 - x0 + more, wide * (1 - 0.6 * share) + more, 0.12 * wide, 2)
            shape += [(x0 + x1) / 2, 0]
            kit.add(material, stack([(shape, z + (floor + low) * high),
                                     (shape, z + (floor + top) * high)]))
    return z + floors * high


def _rig(kit: Kit, kind: str, deck: Material, beam: float, depth: float) -> None:
    """Masts with sails, on a ship of length 100."""
    cloth = kit.choose(m.WHITE, m.WHITE, m.plain((0.88, 0.84, 0.74), 0.0),
                       m.plain(m.lively(kit.rng), 0.0))
    square, furled, side = kind == "galleon", kit.chance(0.2), kit.uniform(-6, 6)
    masts = kit.choose(*(((25, -2, -32), (18, -20), (28, 5, -18, -38)) if square else
                         ((8,), (8,), (20, -28))))
    t, s = np.mgrid[0:1:9j, 0:1:7j]
    for at in masts:
        tall = kit.uniform(70, 95) if square else kit.uniform(90, 135)
        kit.add(deck, rod((at, 0, 0.5 * depth), (at, 0, depth + tall), 0.6))
        if square:
            for level, share in ((0.2, 1.0), (0.5, 0.8), (0.75, 0.6)):
                wide, z = share * beam * kit.uniform(1.1, 1.4), depth + level * tall
                kit.add(deck, rod((at + 0.9, -0.55 * wide, z + 0.24 * tall),
                                  (at + 0.9, 0.55 * wide, z + 0.24 * tall), 0.4))
                grid = [at + 1.2 + 0.05 * tall * np.sin(np.pi * t) * (1 - 2 * (s - 0.5) ** 2),
                        (s - 0.5) * wide, z + 0.24 * tall * t]
                kit.add(cloth, *([] if furled else [sheet(np.stack(grid, axis=-1), 0.5)]))
            continue
        boom = min(42, at + 45) * (0.9 if len(masts) == 1 else 0.7)
        kit.add(deck, rod((at, 0, 1.5 * depth), (at - boom, 0, 1.5 * depth),
                          0.5 if not furled else 1.5))
        luff = np.stack([at - s * boom * ((1 - t) ** 0.8 + 0.02),
                         side * np.sin(np.pi * s) * (1 - 0.5 * t),
                         1.52 * depth + t * (0.9 * tall - depth)], axis=-1)
        stay = np.stack([49 * (1 - t) + at * t - s * ((44 - at) * (1 - t) + 0.3),
                         side * np.sin(np.pi * s) * (1 - t),
                         depth * 1.2 * (1 - t) + t * (depth + 0.85 * tall)], axis=-1)
        if not furled:
            kit.add(cloth, sheet(luff, 0.5), *[sheet(stay, 0.4)] * (at == masts[0]))


def watercraft(kit: Kit, kind: str) -> None:
    """Boats and ships of length 100: a hull, houses, masts, sails."""
    skin, deck = kit.draw(m.paint, m.paint, m.lacquer), kit.draw(m.wood, m.lacquer)
    wall = skin
    if not kit.chance(0.3):
        wall = m.plain((0.9, 0.9, 0.88) if kit.chance(0.6) else m.muted(kit.rng))
    *spans, bow, stern, belly, sheer = _SHIPS[kind]
    beam, depth = (100 * kit.uniform(*span) for span in spans)
    if kind in ("rowing", "galleon") and kit.chance(0.6):
        skin = kit.draw(m.wood)
    bow, stern = bow * kit.uniform(0.85, 1.15), stern * kit.uniform(0.6, 1.05)
    sheer, rake = sheer * kit.uniform(0.6, 1.3), kit.uniform(0.02, 0.12)
    wall_of_boat = 1.0 if kind == "rowing" else 0.0
    kit.add(skin, _hull(100, beam, depth, bow, stern, belly, sheer, rake, wall_of_boat))
    if kind == "rowing":
        for x in kit.choose((-25, 2), (-25, 2, 28), (-30, -10, 10, 30)):
            half = 0.5 * beam * (0.9 - 1.2 * (x / 100) ** 2)
            kit.add(deck, block((x - 2.5, x + 2.5), (-half, half), (0.68 * depth, 0.76 * depth)))
        if kit.chance(0.5):
            kit.both(deck, rod((0, 0.3 * beam, depth), (-10, 0.5 * beam + 30, 0.5 * depth), 0.7),
                     box(3.5, 9, 0.8).at(-11, 0.5 * beam + 33, 0.46 * depth))
        return
    base, at, top = 0.98 * depth, 0.0, depth
    if kind == "galleon":
        kit.add(skin, block((-48, -25), (-0.36 * beam, 0.36 * beam), (base, depth * 1.7), 0.5),
                block((22, 38), (-0.25 * beam, 0.25 * beam), (base, 1.4 * depth), 0.5))
        kit.add(deck, rod((40, 0, 1.1 * depth), (68, 0, 1.7 * depth), 0.8))
    elif kind == "sail":
        kit.add(wall, hull([(20, 0.1 * beam, 0.1 * depth, depth),
                            (10, 0.3 * beam, 0.35 * depth, depth),
                            (-20, 0.3 * beam, 0.35 * depth, depth)], 4))
        if kit.chance(0.5):
            kit.add(skin, wing([(8, 0, 0.2 * depth, 20), (4, 0, -1.3 * depth, 14)], 0.12, fin=True),
                    wing([(-40, 0, 0.3 * depth, 8), (-41, 0, -0.9 * depth, 6)], 0.12, fin=True))
    elif kind == "yacht":
        at = -9.0
        top = _house(kit, wall, (-kit.uniform(20, 42), kit.uniform(8, 25)), 0.75 * beam, base,
                     kit.uniform(4.5, 6.5), kit.choose(1, 2, 2, 3), kit.uniform(0.12, 0.25))
    elif kind == "speedboat":
        pane = np.array([(8, -0.38 * beam, base), (8, 0.38 * beam, base),
                         (-2, 0.34 * beam, depth + 7), (-2, -0.34 * beam, depth + 7)])
        kit.add(m.DARK_GLASS, loft([pane, pane - [1.5, 0, 0]]))
        kit.add(m.BLACK, block((-40, 4), (-0.33 * beam, 0.33 * beam), (0.9 * depth, depth + 0.4)),
                pillow(8, 7, 9, 2).at(-52, 0, depth + 3), box(3, 2, depth).at(-53, 0, 0.55 * depth))
        kit.both(wall, *(pillow(7, 0.25 * beam, 10, 2).at(x, 0.17 * beam, depth + 3)
                         for x in (-8, -28)))
    elif kind in ("cargo", "tanker"):
        at = -kit.uniform(34, 42) if kit.chance(0.85) else 30.0
        top = _house(kit, wall, (at - 4, at + kit.uniform(5, 9)), 0.8 * beam, base,
                     kit.uniform(2, 3.2), kit.choose(2, 3, 4), 0.04)
        first, last = (at + 12, 40.0) if at < 0 else (-45.0, at - 8)
        step = kit.uniform(5, 10)
        loads = [m.plain(m.lively(kit.rng), 0.1) for _ in range(4)] if kit.chance(0.6) else [deck]
        for x in np.arange(first, last - step, step) if kind == "cargo" else ():
            room = beam * (0.86 if x < 25 else 0.55)
            for y in np.linspace(-0.5, 0.5, len(loads) + 1)[:-1] * room:
                load = kit.choose(*loads)
                high = depth + kit.choose(1, 2, 3, 4) * 2.2 / (5 - len(loads))
                kit.add(load, block((x, x + 0.95 * step), (y, y + 0.98 * room / len(loads)),
                                    (base, high)))
        if kind == "tanker":
            kit.add(deck, *(rod((first, y, depth + 1), (last, y, depth + 1), 1.1)
                            for y in (-1.5, 1.5)))
    elif kind == "cruise":
        top = _house(kit, wall, (-45, kit.uniform(25, 36)), 0.92 * beam, base,
                     kit.uniform(1.5, 2.2), kit.choose(3, 4, 5, 6), 0.05)
        kit.add(skin, *(cylinder(2, 6, 16).turned("y", -12).at(x, 0, top + 2)
                        for x in np.linspace(-25, 10, kit.choose(1, 1, 2, 3))))
    elif kind == "warship":
        top = _house(kit, skin, (-8, 14), 0.62 * beam, base, 2.6, kit.choose(2, 3), 0.16)
        second = _house(kit, skin, (-30, -14), 0.55 * beam, base, 2.6, kit.choose(1, 2), 0.1)
        kit.add(m.BLACK, cylinder(1.6, 5, 14).at(-20, 0, second + 1))
        for x in (24, 33, -38)[: kit.choose(1, 2, 3)]:
            kit.add(skin, pillow(5.5, 4, 3, 0.8, 2).at(x, 0, depth + 1.2),
                    *(rod((x, y, depth + 1.7), (x + 7 * np.sign(x), y, depth + 2.7),
                          0.32) for y in (-0.8, 0.8)))
    else:  # a tug or a fishing boat
        at = kit.choose(kit.uniform(0, 20), -25)
        top = _house(kit, wall, (at - 17, at + 10), 0.55 * beam, base, 8, kit.choose(1, 2), 0.2)
        kit.add(deck, rod((at + 22, 0, base), (at + 22, 0, depth + 26), 0.9),
                rod((at + 22, 0, depth + 4), (at + 38, 0, depth + 20), 0.6))
        if kind == "tug":
            kit.add(skin, cylinder(3, 12, 16).at(at - 12, 0, top + 4))
    if kind in ("sail", "galleon"):
        _rig(kit, kind, deck, beam, depth)
    elif kind != "speedboat":
        tall = kit.uniform(6, 18)
        kit.add(m.BLACK, rod((at, 0, top - 1.5), (at, 0, top + tall), 0.5),
                rod((at, -0.2 * tall, top + 0.6 * tall), (at, 0.2 * tall, top + 0.6 * tall), 0.3))

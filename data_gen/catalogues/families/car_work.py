"""Lorries, single-seaters, cars of the 1920s, buggies. Lengths in metres, front toward +x."""

import numpy as np

from data_gen.catalogues import bodies, solids
from data_gen.catalogues.bodies import body
from data_gen.catalogues.families import materials
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    DARK_GLASS,
    LIGHT,
    RED_LIGHT,
    WHITE,
    Kit,
    pick,
    rect,
)
from data_gen.catalogues.families.wheels import wheel
from data_gen.catalogues.solids import (
    ball,
    box,
    cylinder,
    pane,
    pillow,
    prism,
    rod,
    smooth_path,
    tube,
)
from data_gen.mesh import Material

# fmt: off
# Formatted by hand: the formatter would put every coordinate on a line of its own.

def _underside(kit: Kit, long: float, wide: float, low: float, high: float, material: Material,
               x: float = 0.0) -> None:
    """A chassis with a recess in its underside. Hidden: the depth of the recess."""
    share = kit.hide("chassis_recess", 0.02, 0.6)
    tray = solids.tray(rect(long, wide, 0.02), high - low, 0.06, share * (high - low))
    kit.add(material, tray.at(x, 0, low))


def lorry(kit: Kit, skin: Material) -> None:
    """A cab on a chassis with a box, a flat bed, a tank, a tipper or a semi-trailer."""
    length, half = kit.uniform("length", 5.5, 11.0), kit.uniform("width", 2.1, 2.55) / 2
    radius = kit.uniform("wheel", 0.4, 0.54)
    load = kit.choose("load", "box", "box", "flatbed", "tank", "tipper", "mixer", "semitrailer",
                      "none")
    if load == "semitrailer":
        length = kit.uniform("trailer_length", 12.0, 16.5)
    frame, front, rear = 2.1 * radius, length / 2, -length / 2
    hooded = kit.chance("hooded", 0.35)
    hood = kit.uniform("hood", 0.9, 1.6) if hooded else 0.0
    cab, tall = kit.uniform("cab", 1.5, 2.4), kit.uniform("height", 2.4, 3.7)
    chassis = Material((0.13, 0.13, 0.14), (0.2,) * 3, 20.0, name="chassis")
    _underside(kit, length - 0.3, half * 0.9, radius * 1.2, frame, chassis)
    # Cab: side profile, extruded; sloping windscreen.
    low, back = radius * 0.9, front - hood - cab
    waist, rake = frame + (tall - frame) * 0.38, kit.uniform("rake", 0.05, 0.4)
    kit.add(skin, prism([(front, low), (front, waist * 0.92), (front - hood, waist),
                         (front - hood - rake, tall), (back, tall), (back, low * 1.3),
                         (front - hood - 1.2 * radius, low * 1.3)] if not hooded else
                        [(front, low), (front, waist * 0.86), (front - 0.15, waist * 0.92),
                         (front - hood, waist), (front - hood - rake, tall), (back, tall),
                         (back, low * 1.3)], 2 * half * (0.94 if not hooded else 0.86), 0.08))
    z, high = (waist + tall) / 2, (tall - waist) * 0.66
    lean = np.degrees(np.arctan2(rake, tall - waist))
    wide = 2 * half * (0.8 if not hooded else 0.72)
    kit.add(DARK_GLASS, box(0.06, wide, high, 0.02).turned("y", -lean).at(front - hood - rake / 2,
                                                                          0, z))
    side = half * (0.94 if not hooded else 0.86)
    kit.both(DARK_GLASS, box(cab * 0.42, 0.03, high * 0.9).at(front - hood - cab * 0.42, side, z))
    kit.add(CHROME if kit.rng.random() < 0.5 else BLACK,
            box(0.06, half, (waist - low) * 0.45, 0.02).at(front + 0.005, 0,
                                                           low + 0.55 * (waist - low)),
            box(0.16, half * 1.9, 0.3, 0.04).at(front, 0, low))
    kit.both(LIGHT, cylinder(0.13, 0.1, 14, 0.02).turned("y", 90).at(front - 0.01, half * 0.75,
                                                                     low + 0.35))
    kit.both(BLACK, box(0.08, 0.22, 0.5, 0.02).at(front - hood - 0.7 * rake - 0.12, half + 0.08, z),
             rod((front - hood - 0.7 * rake - 0.12, side - 0.06, z + 0.1),
                 (front - hood - 0.7 * rake - 0.12, half + 0.1, z + 0.1), 0.03, 6))
    if kit.chance("spoiler", 0.4) and load in ("box", "semitrailer"):
        kit.add(skin, prism([(front - hood - rake, tall - 0.02), (back, tall - 0.02),
                             (back, tall + 0.6)],
                            half * 1.5, 0.05))
    if kit.chance("stack", 0.3):
        kit.both(CHROME, rod((back - 0.12, half * 0.8, frame),
                             (back - 0.12, half * 0.8, tall + 0.4), 0.09, 10))
    start = back - 0.25
    long, middle = start - rear, (start + rear) / 2
    cover = pick(kit.rng, (materials.paint, lambda _: WHITE, lambda _: WHITE,
                           materials.metal))(kit.rng)
    deck = frame + 0.12
    if load != "none":
        kit.add(chassis, box(long, half * 0.8, 0.2).at(middle, 0, frame + 0.05))
    if load in ("box", "semitrailer"):
        if load == "semitrailer" and kit.chance("trailer_tank", 0.35):
            r = kit.uniform("tank", 0.8, 1.15)
            kit.add(cover, cylinder(r, long - 0.3, 28, 0.25).turned("y", 90).scaled(1,
                half / r * 0.96, 1)
                    .at(middle, 0, deck + r))
        else:
            high = kit.uniform("box_height", 1.5, 4.1 - deck)
            kit.add(cover, box(long, 2 * half, high, 0.05).at(middle, 0, deck + high / 2))
            for x in np.linspace(rear + 0.3, start - 0.3, int(kit.choose("ribs", 2, 6, 12))):
                kit.both(cover, box(0.07, 0.04, high - 0.1).at(x, half + 0.015, deck + high / 2))
    elif load == "flatbed":
        kit.add(materials.wood(kit.rng), box(long, 2 * half, 0.14, 0.02).at(middle, 0, deck))
        side_height = kit.uniform("sides", 0.15, 0.6)
        kit.both(cover, box(long, 0.06, side_height, 0.01).at(middle, half - 0.03,
                                                              deck + side_height / 2))
        kit.add(cover, box(0.06, 2 * half, side_height * 1.6).at(start - 0.03, 0,
                                                                 deck + side_height * 0.8))
        timber = materials.wood(kit.rng)
        for k in range(kit.choose("logs", 0, 0, 3, 6)):
            y, up = ((k % 3) - 1) * 0.62 * half, 0.32 + 0.5 * (k // 3)
            kit.add(timber, cylinder(0.28, long * 0.9, 14).turned("y", 90).at(middle, y, deck + up))
    elif load == "tank":
        r = kit.uniform("tank", 0.75, 1.15)
        kit.add(cover, body([(rear, r * 0.6, r * 0.6, deck + r), (rear + 0.3, r, r, deck + r),
                             (start - 0.3, r, r, deck + r), (start, r * 0.6, r * 0.6, deck + r)],
                            2.0, 4, 28).scaled(1, half / r * 0.97, 1))
        for x in (0.25, 0.5, 0.75):
            kit.add(BLACK, cylinder(0.25, 0.2, 14).at(rear + x * long, 0, deck + 2 * r))
        kit.both(chassis, box(long * 0.8, 0.3, 0.3).at(middle, half * 0.55, deck + 0.05))
    elif load == "tipper":
        high = kit.uniform("tipper", 0.8, 1.4)
        rise = kit.choose("tipped", 0, 0, 30) * 1.0
        outline = [rect(long, 2 * half * 0.98), rect(long * 0.92, 2 * half * 0.84)]
        tub = solids.stack([(outline[1](0.0), 0.0), (outline[0](0.0), high),
                            (outline[0](0.08), high),
                            (outline[1](0.08), 0.12)]).at(long / 2)
        kit.add(cover, tub.turned("y", -rise).at(rear, 0, deck))
    elif load == "mixer":
        drum = [(0, 0.35, 0.35, 0.5), (0.25 * long, 0.9, 0.9, 0.25), (0.65 * long, 1.05, 1.05, 0.1),
                (0.95 * long, 0.5, 0.5, 0)]
        kit.add(cover, body(drum, 2.0, 3, 24).at(rear + 0.05, 0, deck + 1.15))
        kit.add(BLACK, box(0.3, half, 1.0).at(start - 0.15, 0, deck + 0.5),
                box(0.2, half, 1.2).at(rear + 0.4, 0, deck + 0.55))
    hub = pick(kit.rng, (CHROME, materials.metal(kit.rng), BLACK))
    axles = [front - (1.3 if not hooded else 0.9) - 0.3 * radius]
    rows = kit.choose("rear_axles", 1, 2) if length < 8 else kit.choose("rear_axles", 2, 3)
    axles += [rear + 1.3 * radius + 0.05 + k * 2.25 * radius for k in range(rows)]
    if load == "semitrailer":
        axles += [back - 0.2, back - 0.2 - 2.2 * radius]
    for k, x in enumerate(axles):
        for material, part in wheel(radius, 0.32 if k == 0 else 0.5, 6, hub):
            kit.both(material, part.at(x, half - (0.18 if k == 0 else 0.27), radius))
        kit.add(chassis, rod((x, 0.2 - half, radius), (x, half - 0.2, radius), 0.09, 8),
                box(0.16, 0.7 * half, radius * 0.5).at(x, 0, radius * 1.2))
    kit.add(RED_LIGHT, *(box(0.05, 0.3, 0.12).at(rear + 0.16, s * half * 0.4, frame - 0.1)
                         for s in (-1, 1)))
    kit.both(chassis, box(0.9, 0.4, 0.5, 0.05).at(back - 0.7, half * 0.65, frame - 0.35))


def formula(kit: Kit, skin: Material, accent: Material) -> None:
    """A single-seater: slim body, wings, free wheels."""
    length, half = kit.uniform("length", 4.2, 5.6), kit.uniform("width", 1.6, 2.0) / 2
    front, rear = length / 2, -length / 2
    old = kit.chance("old", 0.35)  # a cigar-shaped body without wings
    radius = kit.uniform("wheel", 0.3, 0.36)
    wide, high = kit.uniform("body", 0.3, 0.42), kit.uniform("height", 0.26, 0.36)
    z = high + 0.1
    nose = 0.12 if not old else 0.3
    fat = wide * (1.0 if old else kit.uniform("pods", 1.7, 2.1))
    stations = [(front - 0.25, 0.04, 0.04 + 0.3 * (nose - 0.1), z - 0.05 + (0.1 if old else -0.08)),
                (front - 0.5, nose * 0.8, nose, z - 0.05),
                (front - 1.3, wide * 0.75, high * 0.8, z - 0.03),
                (front - 0.4 * length, wide, high, z), (0.0, fat, high * 0.92, z - 0.02),
                (-0.2 * length, fat * 0.9, high * 0.95, z), (rear + 0.6, wide * 0.5, high * 0.8, z),
                (rear + 0.3, wide * 0.3, high * 0.6, z)]
    kit.add(skin, body(stations, 2.8 if not old else 2.0, 3, 20))
    seat = 0.08 * length
    kit.add(BLACK, pillow(0.9, wide * 1.3, 0.2, 0.1, 2).at(seat, 0, z + high * 0.93))
    kit.add(accent, ball(0.28, 0.26, 0.3, 14).at(seat - 0.05, 0, z + high + 0.18))
    kit.add(DARK_GLASS, ball(0.2, 0.24, 0.09, 12).at(seat + 0.03, 0, z + high + 0.19))
    if not old:
        kit.add(skin, body([(seat - 0.3, 0.12, 0.16, z + high + 0.25),
                            (seat - 0.8, 0.13, 0.2, z + high + 0.1),
                            (rear + 0.7, 0.05, 0.1, z + 0.6 * high)], 2.2, 3, 14))
        kit.add(BLACK, ball(0.1, 0.18, 0.2, 12).at(seat - 0.3, 0, z + high + 0.27))
        for x, chord, up, span in ((front, 0.45, 0.14, 0.96), (rear + 0.4, 0.42, 0.85, 0.6)):
            for k in range(2):
                kit.add(accent, bodies.wing([(x - 0.24 * k, -half * span, up + 0.08 * k,
                                              chord * (1 - 0.3 * k)),
                                             (x - 0.24 * k, half * span, up + 0.08 * k,
                                              chord * (1 - 0.3 * k))],
                                            0.09).at())
            kit.both(accent, box(chord * 1.3, 0.025, 0.3).at(x - chord * 0.6, half * span,
                                                             up + 0.06))
        kit.add(BLACK, box(0.2, 0.06, 0.6).at(rear + 0.25, 0, 0.6))
        kit.add(skin, box(0.3, 0.12, 0.12).at(front - 0.3, 0, 0.2))
        if kit.chance("halo", 0.5):
            bow = [(seat + 0.75, 0, z + high * 0.8), (seat + 0.6, 0, z + high + 0.3)]
            ring = [(seat - 0.3, -0.3, z + high * 0.9), (seat, -0.3, z + high + 0.3),
                    (seat + 0.6, 0, z + high + 0.32),
                    (seat, 0.3, z + high + 0.3), (seat - 0.3, 0.3, z + high * 0.9)]
            kit.add(BLACK, tube(bow, 0.035, 6), tube(smooth_path(ring, 4), 0.035, 6))
    else:
        kit.both(CHROME, tube(smooth_path([(0, wide, z), (-0.3, wide + 0.12, z - 0.05),
                                           (rear + 0.3, wide + 0.05, z - 0.05)], 4), 0.05, 8))
    hub = pick(kit.rng, (CHROME, BLACK, materials.metal(kit.rng)))
    for x, tyre, r in ((front - 0.95, 0.28 if not old else 0.16, radius),
                       (rear + 0.55, 0.38 if not old else 0.18, radius * 1.08)):
        for material, part in wheel(r, tyre, 10 if old else 5, hub):
            kit.both(material, part.at(x, half - tyre / 2, r))
        for dx in (-0.15, 0.15):
            kit.both(BLACK, rod((x + 2 * dx, wide * 0.3, z), (x, half - tyre * 0.8, r + 0.05),
                                0.025, 6),
                     rod((x + 2 * dx, wide * 0.3, z - 0.12), (x, half - tyre * 0.8, r - 0.08),
                         0.025, 6))
    kit.both(BLACK, rod((rear + 0.6, 0, radius), (rear + 0.55, half - 0.2, radius), 0.03, 6))
    _underside(kit, length * 0.55, wide * 1.2, 0.08, z - high * 0.6, BLACK, -0.1)


def vintage(kit: Kit, skin: Material, accent: Material) -> None:
    """A car of the 1920s: long hood, upright cabin or open seats, mudguards, running boards."""
    length, half = kit.uniform("length", 3.3, 5.0), kit.uniform("width", 1.35, 1.75) / 2
    front, rear = length / 2, -length / 2
    radius = kit.uniform("wheel", 0.34, 0.46)
    frame, belt = radius * 1.0, radius * 1.0 + kit.uniform("belt", 0.55, 0.7)
    axle, back_axle = front - radius * 1.05, rear + radius * 1.4
    narrow = half * 0.62
    cabin = front - length * kit.uniform("hood", 0.36, 0.5)
    _underside(kit, length * 0.92, narrow * 1.5, frame * 0.75, frame + 0.05, BLACK)
    # The hood becomes higher toward the cabin.
    hood = [(axle + 0.25, narrow * 0.52, (belt - frame) * 0.46, (belt + frame) / 2),
            (axle + 0.1, narrow * 0.58, (belt - frame) * 0.5, (belt + frame) / 2),
            (cabin, narrow, (belt - frame) * 0.52, (belt + frame) / 2)]
    kit.add(skin, body(hood, 4.0, 3, 20))
    kit.add(CHROME, body([(axle + 0.33, narrow * 0.5, (belt - frame) * 0.5, (belt + frame) / 2),
                          (axle + 0.24, narrow * 0.56, (belt - frame) * 0.55, (belt + frame) / 2)],
                         3.0, 1, 20))
    kind = kit.choose("cabin", "closed", "closed", "open", "half")
    tail = rear + length * kit.uniform("tail", 0.06, 0.2)
    wide = half * 0.8
    tub = [(cabin, narrow, (belt - frame) * 0.5), (cabin - 0.35, wide, (belt - frame) * 0.52),
           (tail + 0.5, wide, (belt - frame) * 0.52), (tail, wide * 0.8, (belt - frame) * 0.4)]
    kit.add(skin, body([(x, w, h, (belt + frame) / 2) for x, w, h in tub], 5.0, 3, 20))
    high = kit.uniform("cabin_height", 0.55, 0.8)
    end = tail + 0.15 if kind != "half" else (cabin + tail) / 2
    if kind == "open":
        leather = materials.fabric(kit.rng)
        for x in (cabin - 0.75, tail + 0.55):
            kit.add(leather, pillow(0.2, wide * 1.6, 0.5, 0.08, 2).turned("y", -10).at(x - 0.2, 0,
                                                                                       belt + 0.12),
                    pillow(0.5, wide * 1.6, 0.2, 0.08, 2).at(x, 0, belt))
        kit.add(DARK_GLASS, box(0.03, wide * 1.6, 0.4).turned("y", -8).at(cabin - 0.1, 0,
                                                                          belt + 0.2))
        if kit.chance("hood_up", 0.4):
            kit.add(leather, pillow(1.2, wide * 1.9, 0.12, 0.05, 2).at(tail + 0.7, 0, belt + high))
            kit.both(BLACK, rod((tail + 0.2, wide, belt - 0.05),
                                (tail + 0.3, wide * 0.9, belt + high), 0.025, 6),
                     rod((cabin - 0.1, wide * 0.8, belt - 0.05),
                         (tail + 1.2, wide * 0.9, belt + high), 0.025, 6))
    else:
        x, long = (cabin - 0.12 + end) / 2, cabin - 0.12 - end
        kit.add(DARK_GLASS, box(long - 0.1, wide * 1.84, high, 0.02).at(x, 0,
                                                                        belt + high / 2 - 0.02))
        kit.add(accent, pillow(long + 0.16, wide * 2.02, 0.18, 0.07, 2).at(x, 0, belt + high))
        for t in (-0.5, 0.02, 0.5):
            kit.both(skin, box(0.12 if t else 0.09, 0.09, high).at(x + t * (long - 0.12),
                wide * 0.92, belt + high / 2 - 0.02))
        kit.add(skin, box(0.08, wide * 1.7, high * 0.5).at(end + 0.04, 0, belt + high * 0.2))
        if kind == "half" and kit.chance("dickey_seat", 0.5):
            kit.add(materials.fabric(kit.rng),
                    pillow(0.2, wide * 1.4, 0.45, 0.08, 2).at(tail + 0.35, 0, belt + 0.15))
    # Mudguards: sheets around the wheels, joined by the running board.
    for x, reach in ((axle, (150, -5)), (back_axle, (185, 30))):
        angles = np.radians(np.linspace(*reach, 10))
        arc = np.stack([x + radius * 1.2 * np.cos(angles), 0 * angles,
                        radius + radius * 1.2 * np.sin(angles)], 1)
        arc = arc if x == axle else arc[::-1]
        grid = np.stack([arc + np.array([0, half - 0.3 + 0.3 * t, -0.05 * (2 * t - 1) ** 2])
                         for t in np.linspace(0, 1, 4)], 1)
        kit.both(accent, pane(grid, 0.03))
    kit.both(accent, box(axle - back_axle - 1.8 * radius, 0.32, 0.05,
                         0.01).at((axle + back_axle) / 2, half - 0.15, radius * 0.85))
    kit.both(BLACK, box(0.1, half - narrow * 0.6, 0.06).at(axle - radius,
                                                           (half + narrow) / 2 * 0.8, radius))
    hub = pick(kit.rng, (materials.wood(kit.rng), CHROME, skin))
    for x in (axle, back_axle):
        for material, part in wheel(radius, 0.15, 12, hub):
            kit.both(material, part.at(x, half - 0.13, radius))
        kit.add(BLACK, rod((x, -half + 0.2, radius), (x, half - 0.2, radius), 0.04, 8))
    kit.both(CHROME, ball(0.2, 0.26, 0.26, 14).at(axle + 0.15, narrow * 0.95, belt * 0.88),
             rod((axle + 0.12, narrow * 0.3, frame + 0.1),
                 (axle + 0.12, narrow * 0.95, belt * 0.84), 0.02, 6))
    kit.both(LIGHT, cylinder(0.11, 0.02, 14).turned("y", 90).at(axle + 0.245, narrow * 0.95,
                                                                belt * 0.88))
    kit.add(CHROME, tube(smooth_path([(front - 0.05, -half * 0.9, radius),
                                      (front + 0.02, 0, radius),
                                      (front - 0.05, half * 0.9, radius)], 4), 0.035, 6))
    kit.both(CHROME, rod((axle + 0.1, narrow * 0.5, frame), (front, narrow * 0.5, radius), 0.04, 6))
    if kit.chance("spare_wheel", 0.5):
        for material, part in wheel(radius, 0.15, 12, hub):
            kit.add(material, part.turned("z", 80).at(tail - 0.12, 0, frame + radius * 0.9))


def buggy(kit: Kit, skin: Material, accent: Material) -> None:
    """A frame of tubes with an engine behind the seats, or a small kart without the frame."""
    kart = kit.chance("kart", 0.3)
    length, half = kit.uniform("length", 2.8, 3.8), kit.uniform("width", 1.6, 2.0) / 2
    if kart:
        length, half = length * 0.55, half * 0.7
    front, rear, radius = length / 2, -length / 2, 0.16 if kart else kit.uniform("wheel", 0.33,
                                                                                 0.45)
    floor = radius * 0.6 if kart else radius * 1.1
    roof = floor + (0.3 if kart else kit.uniform("height", 1.05, 1.3))
    wide = half * 0.55
    _underside(kit, length * 0.72, wide * 2, floor - 0.05, floor + 0.05, BLACK)
    leather = materials.fabric(kit.rng)
    for y in ((0,) if kart else (-wide * 0.5, wide * 0.5)):
        kit.add(leather, pillow(0.45, wide * 0.85, 0.16, 0.06, 2).at(-0.05, y, floor + 0.12),
                pillow(0.14, wide * 0.85, 0.62 if not kart else 0.45, 0.06, 2).turned("y",
                    -15).at(-0.32, y, floor + 0.35))
    if kart:
        kit.add(skin, pillow(0.35, wide * 1.4, 0.16, 0.07, 2).at(front - 0.2, 0, floor + 0.12),
                box(0.1, half * 1.5, 0.12, 0.03).at(front, 0, floor + 0.02))
        kit.both(skin, pillow(0.6, 0.14, 0.16, 0.06, 2).at(0, half * 0.8, floor + 0.08))
        kit.both(BLACK, rod((0, wide, floor), (0, half * 0.8, floor + 0.05), 0.02, 6))
    else:
        for s in (-1, 1):
            y = s * wide
            hoop = [(front - 0.1, y * 0.5, floor + 0.15), (front * 0.45, y, floor + 0.45),
                    (front * 0.15, y * 0.92, roof - 0.04),
                    (-0.3, y * 0.92, roof), (rear + 0.6, y, floor + 0.6),
                    (rear + 0.1, y * 0.7, floor + 0.25)]
            kit.add(skin, tube(hoop, 0.035, 6),
                    tube([(front - 0.1, y * 0.5, floor + 0.15), (front * 0.45, y, floor),
                          (rear + 0.1, y * 0.7, floor + 0.25)], 0.035, 6))
            kit.add(skin, rod((-0.3, y * 0.92, roof), (-0.35, y, floor), 0.03, 6),
                    rod((front * 0.45, y, floor + 0.45), (front * 0.45, y, floor), 0.03, 6))
        for x, z, share in ((front * 0.15, roof - 0.04, 0.92), (-0.3, roof, 0.92),
                            (rear + 0.1, floor + 0.25, 0.7), (front - 0.1, floor + 0.15, 0.5)):
            kit.add(skin, rod((x, -wide * share, z), (x, wide * share, z), 0.03, 6))
        kit.add(accent, body([(front - 0.05, wide * 0.45, 0.1, floor + 0.16),
                              (front * 0.42, wide * 0.95, 0.26, floor + 0.24)], 4.0, 3, 16))
        if kit.chance("roof_panel", 0.5):
            kit.add(accent, box(front * 0.15 + 0.3, wide * 1.8, 0.03).at((front * 0.15 - 0.3) / 2,
                                                                         0, roof))
        kit.both(LIGHT, ball(0.1, 0.2, 0.2, 12).at(front * 0.62, wide * 0.75, floor + 0.48))
    metal_ = materials.metal(kit.rng)
    kit.add(metal_, box(0.5, wide * 1.1, 0.4 if not kart else 0.2,
                        0.05).at(rear + (0.45 if not kart else 0.3), 0, floor + 0.22),
            cylinder(0.16 if not kart else 0.08, 0.3, 14).at(rear + 0.4, 0,
                floor + 0.5 if not kart else floor + 0.3))
    kit.add(BLACK, rod((0.5 if not kart else 0.2, 0, floor), (0.3, 0, floor + 0.4), 0.02, 6),
            cylinder(0.16, 0.03, 14).turned("y", 60).at(0.3, 0, floor + 0.42))
    hub = pick(kit.rng, (CHROME, BLACK, skin))
    for x, tyre in ((front - radius * 0.8, radius * 0.6), (rear + radius * 0.95, radius * 0.85)):
        for material, part in wheel(radius, tyre, 5, hub):
            kit.both(material, part.at(x, half - tyre / 2, radius))
        kit.both(metal_, rod((x - 0.1, wide * 0.5, floor + 0.05), (x, half - 0.6 * tyre, radius),
                             0.03, 6),
                 rod((x + 0.1, wide * 0.5, floor + 0.05), (x, half - 0.6 * tyre, radius), 0.03, 6))

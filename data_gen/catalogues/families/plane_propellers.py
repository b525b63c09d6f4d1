"""Propeller planes, gliders, helicopters. Lengths in metres, the nose toward +x."""

import numpy as np

from data_gen.catalogues.bodies import body, wing
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    DARK_GLASS,
    RED_LIGHT,
    Kit,
    around,
    fabric,
    metal,
)
from data_gen.catalogues.families.plane_parts import (
    Station,
    add_canopy,
    add_cockpit_band,
    add_fin,
    add_fuselage,
    add_gear,
    add_propeller,
    add_windows,
    add_wings,
    cigar_stations,
)
from data_gen.catalogues.families.wheels import small_wheel
from data_gen.catalogues.solids import ball, box, pane, rod, tube
from data_gen.mesh import Material

# fmt: off
# Formatted by hand: the formatter would put every coordinate on a line of its own.

def turboprop(kit: Kit, skin: Material, accent: Material) -> None:
    """High-wing transports and commuters, two or four engines."""
    long, wide = kit.uniform("length", 14, 34), kit.uniform("radius", 0.055, 0.075)
    wide *= long
    z = wide * 1.35
    ramp = kit.chance("cargo", 0.45)
    stations = cigar_stations(long, wide, wide * (1.0 if ramp else 1.05), z, 2.2 * wide,
                              0.42 * long, 0.95 if ramp else 0.6)
    add_fuselage(kit, skin, stations, 2.4)
    span, chord = long * kit.uniform("span", 0.5, 0.68), long * kit.uniform("chord", 0.1, 0.13)
    up = z + wide * 0.92
    edge = add_wings(kit, skin, (0.12 * long, 0.0, up), span, chord, taper=0.5, sweep=3, thick=0.14)
    engines, radius = kit.choose("engines", 2, 2, 4), chord * 0.24
    for share in (0.3,) if engines == 2 else (0.27, 0.52):
        x, y = edge[0, 0], share * span
        pod = [(chord * 0.45, radius * 0.6, radius * 0.7, 0),
               (chord * 0.3, radius, radius * 1.1, -0.1 * radius),
               (-chord * 0.4, radius, radius * 1.1, -0.1 * radius),
               (-chord * 1.1, radius * 0.2, radius * 0.3, 0.2 * radius)]
        kit.both(skin, body(pod).at(x, y, up - 0.3 * radius))
        for s in (-1, 1):
            add_propeller(kit, accent, x + chord * 0.45, s * y, up - 0.3 * radius, 0.065 * long,
                          radius * 0.6, kit.choose("blades", 4, 6))
    rear, fin = -long / 2, long * kit.uniform("fin", 0.16, 0.21)
    add_fin(kit, accent, rear + 1.1 * fin, z + 0.75 * wide, fin, fin * 0.95, taper=0.55, sweep=25)
    if kit.chance("t_tail", 0.5):
        add_wings(kit, skin, (rear + 0.62 * fin, 0, z + 0.72 * wide + fin), 0.2 * long, 0.55 * fin,
                  taper=0.6, sweep=8)
    else:
        add_wings(kit, skin, (rear + 0.8 * fin, 0, z + 0.8 * wide), 0.24 * long, 0.65 * fin,
                  taper=0.6, sweep=10)
    add_cockpit_band(kit, stations, long / 2 - 0.9 * wide, long / 2 - 1.6 * wide)
    if not ramp:
        add_windows(kit, rear + 0.35 * long, long / 2 - 2.8 * wide, 0.045 * long, wide,
                    z + 0.3 * wide, 0.014 * long)
    kit.both(skin, body([(0.12 * long, 0.1, 0.1, 0), (0.05 * long, 0.4 * wide, 0.4 * wide, 0),
                         (-0.1 * long, 0.4 * wide, 0.4 * wide, 0),
                         (-0.16 * long, 0.1, 0.1, 0)]).at(0, wide * 0.95, z - 0.7 * wide))
    add_gear(kit, [(0.36 * long, 0, z - 0.7 * wide), (0.0, wide * 1.1, z - 0.7 * wide)],
             0.03 * long * 0.6, True)


def light(kit: Kit, skin: Material, accent: Material) -> None:
    """Light propeller planes with a high, low or parasol wing, on wheels or floats."""
    place = kit.choose("wing", "high", "low", "high", "low", "parasol")
    floats = kit.chance("floats", 0.3 if place == "high" else 0.08)
    long, wide = kit.uniform("length", 6.0, 9.5), kit.uniform("radius", 0.5, 0.65)
    z, front = 1.35 + (0.9 if floats else 0), 0.4 * long
    rear = front - long
    high = wide * kit.uniform("depth", 1.0, 1.25)
    stations: list[Station] = [(front, 0.3, 0.33, z - 0.05),
                               (front - 0.1, 0.45 * wide / 0.6, 0.45, z - 0.05),
                (front - 0.22 * long, wide, high * 0.85, z), (front - 0.42 * long, wide, high, z),
                               (front - 0.62 * long, wide * 0.7, high * 0.72, z + 0.04),
                               (rear, 0.06, 0.16, z + 0.22)]
    add_fuselage(kit, skin, stations, 2.8)
    span, chord = long * kit.uniform("span", 0.5, 0.75), kit.uniform("chord", 1.2, 1.7)
    up = {"high": z + high * 1.35, "low": z - high * 0.75, "parasol": z + high * 1.9}[place]
    add_wings(kit, skin, (front - 0.2 * long, 0.0, up), span, chord,
              taper=kit.uniform("taper", 0.55, 1.0),
              dihedral=kit.uniform("dihedral", 0.5, 6), thick=0.13,
              elliptic=kit.chance("round_tips", 0.25))
    cabin = front - 0.24 * long
    if place == "high":
        frame = [(cabin + 0.45, wide * 0.7, 0.1, z + high * 0.75),
                 (cabin, wide * 0.93, high * 0.52, z + high * 0.85),
                 (cabin - 1.5, wide * 0.88, high * 0.5, z + high * 0.85),
                 (cabin - 2.4, wide * 0.5, 0.1, z + high * 0.7)]
        kit.add(DARK_GLASS, body(frame, 3.2, 3, 20))
        for x in (cabin - 0.1, cabin - 1.4):
            kit.both(skin, rod((x, wide * 0.88, z + high * 0.6), (x - 0.05, wide * 0.8, up + 0.02),
                               0.05, 6))
        if kit.chance("struts", 0.75):
            kit.both(accent, rod((front - 0.33 * long, wide * 0.9, z - high * 0.6),
                                 (front - 0.32 * long, span * 0.5, up + 0.02), 0.045, 6))
    elif place == "low":
        add_canopy(kit, cabin - 0.7, kit.uniform("canopy", 2.2, 3.4), wide * 0.9, high * 0.95,
                   z + high * 0.55)
    else:
        kit.both(accent, *(rod((front - t * long, wide * 0.8, z + high * 0.7),
                               (front - t * long - 0.1, wide * 0.8, up), 0.04, 6)
                           for t in (0.24, 0.36)))
        kit.add(BLACK, ball(0.9, wide * 1.3, 0.3, 14).at(cabin - 1.6, 0, z + high * 0.82))
    fin = kit.uniform("fin", 1.2, 1.6)
    add_fin(kit, accent, rear + 1.0, z + 0.1, fin, fin * 0.8, taper=0.55,
            sweep=kit.uniform("fin_sweep", 10, 42))
    t_tail = kit.chance("t_tail", 0.15)
    add_wings(kit, skin, (rear + (0.5 if t_tail else 1.0), 0.0,
                          z + 0.1 + fin if t_tail else z + 0.22), 0.2 * long, 0.85, taper=0.65,
              sweep=8)
    add_propeller(kit, accent, front, 0, z - 0.05, kit.uniform("propeller", 0.85, 1.1), 0.17,
                  kit.choose("blades", 2, 3, 3, 4))
    if floats:
        kit.both(skin, body([(front - 0.1, 0.05, 0.1, 0.5), (front - 0.6, 0.3, 0.3, 0.36),
                             (0.0, 0.36, 0.36, 0.36), (rear + 0.3 * long, 0.08, 0.1, 0.5)],
                            2.6).at(0, 1.25, 0))
        for x in (front - 0.15 * long, front - 0.45 * long):
            kit.both(CHROME, rod((x, wide * 0.7, z - high * 0.6), (x, 1.2, 0.6), 0.05, 6),
                     rod((x, 0, 0.6), (x, 1.2, 0.6), 0.04, 6))
    elif kit.chance("tail_wheel", 0.4):
        kit.both(CHROME, rod((front - 0.2 * long, 0.3, z - high * 0.6),
                             (front - 0.17 * long, 0.95, 0.3), 0.05, 6))
        for material, part in small_wheel(0.3, 0.18, CHROME):
            kit.both(material, part.at(front - 0.17 * long, 1.03, 0.3))
        kit.add(CHROME, rod((rear + 0.3, 0, z + 0.1), (rear + 0.15, 0, z - 0.75), 0.03, 6))
        kit.add(BLACK, ball(0.24, 0.1, 0.24, 12).at(rear + 0.15, 0, z - 0.75))
    else:
        add_gear(kit, [(front - 0.35, 0, z - 0.3),
                       (front - 0.2 * long - 0.5 * chord, 1.1,
                        z - (high * 0.75 - 0.16 if place == "low" else 0.9))], 0.25)
        if place != "low":
            kit.both(CHROME, rod((front - 0.2 * long - 0.5 * chord, 0.2, z - high * 0.8),
                                 (front - 0.2 * long - 0.5 * chord, 1.1, 0.25), 0.05, 6))


def biplane(kit: Kit, skin: Material, accent: Material) -> None:
    """Biplanes and triplanes with open cockpits, struts and wires."""
    decks = kit.choose("decks", 2, 2, 2, 3)
    long, wide = kit.uniform("length", 5.6, 8.0), kit.uniform("radius", 0.4, 0.52)
    z, front = 1.45, 0.36 * long
    rear = front - long
    square = kit.uniform("square", 2.2, 5.0)
    add_fuselage(kit, skin, [(front, wide * 0.75, wide * 0.85, z),
                             (front - 0.15, wide, wide * 1.1, z),
                             (front - 0.35 * long, wide, wide * 1.2, z),
                             (front - 0.6 * long, wide * 0.7, wide * 0.85, z + 0.05),
                             (rear, 0.05, 0.2, z + 0.15)], square)
    kit.add(metal(kit.rng), body([(front + 0.12, wide * 0.6, wide * 0.6, z),
                                  (front, wide * 0.85, wide * 0.95, z),
                                  (front - 0.4, wide * 1.05, wide * 1.15, z)]))
    span, chord = long * kit.uniform("span", 0.52, 0.75), kit.uniform("chord", 1.0, 1.5)
    gap, stagger = kit.uniform("gap", 1.3, 1.7) * (0.7 if decks == 3
                                                   else 1), kit.uniform("stagger", 0.0, 0.6)
    low, x = z - wide * 1.0, front - 0.16 * long
    for k in range(decks):
        size = 1.0 if k == decks - 1 else kit.uniform(f"wing_{k}", 0.8, 1.0)
        add_wings(kit, skin, (x - stagger * (1 - k), 0, low + gap * k), span * size, chord,
                  taper=0.92, dihedral=2.0, thick=0.07)
    top = low + gap * (decks - 1)
    for share in (0.45, 0.78) if span > 4.5 else (0.68,):
        for dx in (0.15, 0.75):
            kit.both(accent, rod((x - stagger - dx * chord, span * share * 0.9, low),
                                 (x - stagger * (2 - decks) - dx * chord, span * share * 0.95,
                                  top + 0.05), 0.04, 6))
        kit.both(BLACK, rod((x - 0.3 * chord, wide, z), (x - 0.3 * chord, span * share, top),
                            0.015, 5),
                 rod((x - 0.3 * chord, wide, top), (x - stagger - 0.3 * chord, span * share, low),
                     0.015, 5))
    for dx in (0.2, 0.7):
        kit.both(accent, rod((x - dx * chord, wide * 0.8, z + wide),
                             (x - dx * chord, wide * 1.1, top), 0.035, 6))
    for k in range(kit.choose("cockpits", 1, 2)):
        cx = front - 0.42 * long - 0.95 * k
        kit.add(BLACK, ball(0.75, wide * 1.4, 0.25, 14).at(cx, 0, z + wide * (1.1 - 0.12 * k)))
        kit.add(DARK_GLASS, pane(np.array([[(cx + 0.4 - 0.1 * t, y, z + wide + 0.05 + 0.3 * t)
            for y in np.linspace(-0.3, 0.3, 5)] for t in (0, 1)]), 0.02))
    fin = kit.uniform("fin", 0.9, 1.3)
    add_fin(kit, accent, rear + 0.8, z + 0.1, fin, 0.95, taper=0.6, sweep=20)
    add_wings(kit, skin, (rear + 0.85, 0, z + 0.15), 0.19 * long, 0.85, taper=0.8, sweep=10,
              elliptic=True)
    add_propeller(kit, accent, front + 0.1, 0, z, 1.1, 0.16, kit.choose("blades", 2, 2, 3))
    gx = front - 0.12 * long
    for dx in (-0.25, 0.25):
        kit.both(accent, rod((gx + dx, wide * 0.7, z - wide), (gx, 0.85, 0.36), 0.04, 6))
    kit.add(accent, rod((gx, -0.85, 0.36), (gx, 0.85, 0.36), 0.04, 6))
    for material, part in small_wheel(0.36, 0.13, skin):
        kit.both(material, part.at(gx, 0.9, 0.36))
    kit.add(BLACK, rod((rear + 0.5, 0, z), (rear + 0.25, 0, z - 0.75), 0.04, 6))


def glider(kit: Kit, skin: Material, accent: Material) -> None:
    """Sailplanes with very long wings."""
    long, z = kit.uniform("length", 6.2, 8.2), 0.75
    front = 0.42 * long
    rear = front - long
    pod = kit.uniform("pod", 0.3, 0.38)
    add_fuselage(kit, skin, [(front, 0.03, 0.03, z - 0.1),
                             (front - 0.25, pod * 0.5, pod * 0.6, z - 0.06),
                             (front - 0.9, pod * 0.92, pod * 1.1, z),
                             (front - 1.9, pod, pod * 1.25, z),
                             (front - 3.2, pod * 0.5, pod * 0.6, z + 0.08),
                             (rear + 1.2, 0.14, 0.16, z + 0.12), (rear, 0.07, 0.1, z + 0.15)])
    kit.add(DARK_GLASS, body([(front - 0.5, 0.05, 0.05, z + 0.2),
                              (front - 1.1, pod * 0.85, pod * 0.9, z + 0.2),
                              (front - 1.7, pod * 0.85, pod * 0.95, z + 0.22),
                              (front - 2.3, 0.06, 0.05, z + 0.25)], 2, 3, 18))
    span = kit.uniform("span", 6.0, 11.0)
    edge = add_wings(kit, skin, (front - 1.9, 0, z + pod * 0.75), span,
                     kit.uniform("chord", 0.75, 1.1), taper=0.4,
                     dihedral=kit.uniform("dihedral", 1.5, 5), thick=0.13,
                     elliptic=kit.chance("elliptic", 0.5))
    if kit.chance("winglets", 0.5):
        add_fin(kit, accent, edge[-1, 0], edge[-1, 2], 0.45, 0.25, y=edge[-1, 1], cant=20)
    tail = kit.choose("tail", "t", "t", "v", "cross")
    if tail == "v":
        add_fin(kit, skin, rear + 0.7, z + 0.1, 0.95, 0.65, y=0.03, cant=48, sweep=15)
    else:
        add_fin(kit, skin, rear + 0.85, z + 0.05, 1.25, 0.9, taper=0.7, sweep=14)
        add_wings(kit, skin, (rear + 0.6, 0, z + (1.28 if tail == "t" else 0.45)), 1.35, 0.5,
                  taper=0.55, sweep=5)
    add_gear(kit, [(front - 1.8, 0, z - 0.2)], 0.2)
    kit.add(BLACK, ball(0.2, 0.08, 0.2, 12).at(rear + 0.4, 0, z - 0.02))


def warbird(kit: Kit, skin: Material, accent: Material) -> None:
    """Fighters and bombers with pistons: one, two or four engines; some with twin booms."""
    form = kit.choose("layout", "fighter", "fighter", "radial", "twin", "bomber", "booms")
    engines = {"fighter": 1, "radial": 1, "twin": 2, "booms": 2, "bomber": 4}[form]
    long = kit.uniform("length", 8.5, 11) * (1 + 0.35 * (engines - 1) * (form != "booms"))
    wide = (0.065 if form == "radial" else 0.05) * long * kit.uniform("fatness", 0.9, 1.2)
    z, front = 2.0 + 0.1 * engines, 0.38 * long
    rear = front - long if form != "booms" else -0.12 * long
    nose = 0.75 if engines == 1 else 0.15
    stations: list[Station] = [(front, wide * nose * 0.8, wide * nose * 0.8, z),
                               (front - 0.03 * long, wide * max(nose, 0.45), wide * max(nose, 0.5),
                                z),
                               (front - 0.14 * long, wide * 0.95, wide * 1.15, z),
                               (front - 0.4 * (front - rear), wide, wide * 1.3, z),
                               (front - 0.65 * (front - rear), wide * 0.7, wide * 0.95, z + 0.08),
                               (rear, 0.06, 0.12, z + 0.2)]
    add_fuselage(kit, skin, stations)
    span, chord = long * kit.uniform("span", 0.5, 0.64), long * kit.uniform("chord", 0.2,
        0.26) * (0.75 if engines > 1 else 1)
    x, low = front - 0.22 * long, z - wide * kit.uniform("wing_height", 0.3, 0.9)
    edge = add_wings(kit, skin, (x, 0, low), span, chord, taper=0.5,
                     sweep=kit.uniform("sweep", 0, 6), dihedral=kit.uniform("dihedral", 2, 7),
                     thick=0.13, elliptic=kit.chance("elliptic", 0.4))
    radius, blades = 0.14 * long if engines == 1 else 0.1 * long, kit.choose("blades", 3, 3, 4)
    boom = 0.28 * span
    if engines == 1:
        add_propeller(kit, accent, front, 0, z, radius, wide * 0.55, blades)
    for share in (() if engines == 1 else (0.28,) if engines == 2 else (0.27, 0.52)):
        y, r = share * span, wide * 0.62
        up = float(np.interp(y, edge[:, 1], edge[:, 2]))
        end = -2.1 * chord if form != "booms" else -0.62 * long
        pod = [(0.5 * chord, r * 0.7, r * 0.7, 0.0), (0.4 * chord, r, r, 0),
               (-0.4 * chord, r, r, 0), (0.5 * end - 0.3 * chord, r * 0.6, r * 0.7, 0),
               (end, 0.1, 0.14, 0.1)]
        kit.both(skin, body(pod).at(x, y, up))
        for s in (-1, 1):
            add_propeller(kit, accent, x + 0.5 * chord, s * y, up, radius, r * 0.5, blades)
    fin = kit.uniform("fin", 0.12, 0.16) * long
    tail = rear if form != "booms" else x - 0.62 * long
    if form == "booms":
        add_fin(kit, skin, tail + 0.8 * fin, low, fin, 0.9 * fin, y=boom, taper=0.6, sweep=15)
        kit.add(skin, wing([(tail + 0.7 * fin, -boom - 0.3, low + 0.25, 0.75 * fin),
                            (tail + 0.7 * fin, boom + 0.3, low + 0.25, 0.75 * fin)], 0.1))
    else:
        pair = engines > 1 and kit.chance("twin_fins", 0.5)
        half = 0.19 * long
        if pair:
            add_fin(kit, accent, tail + 0.95 * fin, z + 0.0, 0.8 * fin, 0.8 * fin, y=half * 0.95,
                    taper=0.6, sweep=10)
        else:
            add_fin(kit, accent, tail + 1.1 * fin, z + 0.15, fin, 1.0 * fin, taper=0.5, sweep=22)
        add_wings(kit, skin, (tail + fin, 0, z + 0.2), half, 0.75 * fin, taper=0.6, sweep=8)
    if engines == 4 or form == "twin":
        kit.add(DARK_GLASS, ball(0.12 * long, wide * 1.4, wide * 1.5, 16).at(front - 0.02 * long,
                                                                             0, z))
        for at in kit.choose("turrets", (-0.1,), (0.0, -0.25)):
            kit.add(DARK_GLASS, ball(0.06 * long, wide * 1.0, wide * 1.0, 14).at(at * long, 0,
                                                                                 z + wide * 1.1))
    add_canopy(kit, front - (0.3 if engines == 1 else 0.17) * long,
               0.2 * long if engines == 1 else 0.13 * long, wide * 0.72, wide * 1.1, z + wide * 0.9)
    if kit.chance("gear", 0.6):
        gy = 0.28 * span if engines > 1 else 0.2 * span
        add_gear(kit, [(x - 0.1 * chord, gy, float(np.interp(gy, edge[:, 1], edge[:, 2])) + 0.05)],
                 0.045 * long)
        if form == "booms":
            add_gear(kit, [(front - 0.08 * long, 0, z - 0.2)], 0.035 * long)
        else:
            kit.add(BLACK, rod((tail + 1.4, 0, z), (tail + 1.2, 0, z - 0.9), 0.06, 6))


def flying_boat(kit: Kit, skin: Material, accent: Material) -> None:
    """Flying boats: a hull with a step, a high wing, engines on it or above it."""
    long, wide = kit.uniform("length", 9, 28), kit.uniform("radius", 0.06, 0.085)
    wide *= long
    z = wide * 1.25
    add_fuselage(kit, skin, [(0.45 * long, 0.05, 0.1, z + 0.35 * wide),
                             (0.41 * long, wide * 0.5, wide * 0.6, z + 0.2 * wide),
                             (0.3 * long, wide * 0.95, wide * 1.05, z),
                             (0.02 * long, wide, wide * 1.25, z),
                             (-0.02 * long, wide * 0.95, wide * 1.0, z + 0.25 * wide),
                             (-0.3 * long, wide * 0.5, wide * 0.65, z + 0.6 * wide),
                             (-0.55 * long, 0.1, 0.2, z + 1.1 * wide)], 2.5)
    span, chord, parasol = long * kit.uniform("span", 0.55,
                                              0.75), long * 0.15, kit.chance("parasol", 0.4)
    up = z + wide * (2.3 if parasol else 1.15)
    add_wings(kit, skin, (0.12 * long, 0, up), span, chord, taper=0.55, sweep=2, dihedral=1,
              thick=0.14)
    if parasol:
        kit.add(skin, wing([(0.11 * long, 0, z + 0.8 * wide, 0.12 * long),
                            (0.1 * long, 0, up, 0.1 * long)], 0.3, fin=True))
        kit.both(CHROME, rod((0.05 * long, wide * 0.9, z), (0.05 * long, 0.45 * span, up),
                             0.012 * long, 6))
    engines, r = kit.choose("engines", 1, 2, 2, 4), 0.2 * chord
    for share in {1: (0.0,), 2: (0.22,), 4: (0.2, 0.42)}[engines]:
        ez = up + (2.4 * r if engines == 1 else 0.5 * r)
        pod = body([(0.4 * chord, r * 0.8, r * 0.8, 0), (0.3 * chord, r, r, 0),
                    (-0.3 * chord, r, r, 0), (-0.9 * chord, 0.1 * r, 0.1 * r, 0)])
        for s in (-1, 1) if share else (1,):
            kit.add(skin, pod.at(0.12 * long, s * share * span, ez))
            add_propeller(kit, accent, 0.12 * long + 0.4 * chord, s * share * span, ez,
                          0.075 * long, r * 0.6, 3)
        if not share:
            kit.both(CHROME, rod((0.06 * long, 0.3, up), (0.06 * long, 0.1, ez), 0.01 * long, 6))
    fin = 0.17 * long
    add_fin(kit, accent, -0.55 * long + 1.1 * fin, z + 0.9 * wide, fin, fin, taper=0.55, sweep=28)
    add_wings(kit, skin, (-0.55 * long + 0.8 * fin, 0, z + 0.9 * wide + 0.4 * fin), 0.2 * long,
              0.65 * fin, taper=0.6, sweep=8)
    kit.both(skin, body([(0.08 * long, 0.02, 0.02, 0), (0.03 * long, 0.2 * wide, 0.22 * wide, 0),
                         (-0.08 * long, 0.05, 0.05, 0.05)], 2, 3, 14).at(0.06 * long, 0.72 * span,
                                                                         z * 0.85))
    kit.both(CHROME, rod((0.07 * long, 0.72 * span, z * 0.85), (0.07 * long, 0.72 * span, up),
                         0.008 * long, 6))
    kit.add(DARK_GLASS, body([(0.36 * long, 0.1, 0.05, z + 0.7 * wide),
                              (0.31 * long, wide * 0.7, wide * 0.5, z + 0.85 * wide),
                              (0.22 * long, wide * 0.6, wide * 0.4, z + 0.9 * wide),
                              (0.17 * long, 0.1, 0.05, z + wide)], 2.5, 3, 16))


def helicopter(kit: Kit, skin: Material, accent: Material) -> None:
    """Helicopters with one or two rotors."""
    form = kit.choose("layout", "single", "single", "bubble", "tandem", "attack")
    long, z = kit.uniform("cabin", 3.0, 5.0), kit.uniform("height", 1.5, 1.9)
    wide = {"attack": 0.55, "bubble": 0.75}.get(form, kit.uniform("width", 0.85, 1.1))
    high = wide * kit.uniform("depth", 0.95, 1.2) * (1.4 if form == "attack" else 1)
    rotor, blades = long * kit.uniform("rotor", 1.15, 1.5), kit.choose("blades", 2, 3, 4, 5)
    if form == "tandem":
        long *= 2.2
        rotor = 0.52 * long
    front, rear = 0.5 * long, -0.5 * long
    stations: list[Station] = [(front, 0.05, 0.05, z - 0.3 * high),
                               (front - 0.05 * long, wide * 0.5, high * 0.45, z - 0.25 * high),
                               (front - 0.25 * long, wide * 0.95, high * 0.9, z),
                (0, wide, high, z), (rear + 0.2 * long, wide * 0.9, high * 0.85, z + 0.1),
                               (rear, wide * 0.35, high * 0.35, z + 0.4 * high)]
    add_fuselage(kit, skin, stations, 2.6)
    glass = DARK_GLASS
    kit.add(glass, body([(front - 0.005 * long, 0.03, 0.03, z - 0.1 * high),
                         (front - 0.06 * long, wide * 0.55, high * 0.55, z - 0.08 * high),
                         (front - 0.24 * long, wide * 0.98, high * 0.85, z + 0.12 * high),
                         (front - 0.4 * long, wide * 0.9, high * 0.6, z + 0.2 * high)], 2.5, 3, 20))
    kit.both(glass, box(0.2 * long, 0.06, high * 0.6, 0.02).at(-0.12 * long, wide * 0.98,
                                                               z + 0.2 * high))
    mast = z + high * 1.5
    spots = [(-0.02 * long, mast)]
    if form == "tandem":
        spots = [(0.34 * long, mast), (-0.4 * long, mast + high)]
        kit.add(skin, wing([(-0.25 * long, 0, z + 0.5 * high, 0.3 * long),
                            (-0.3 * long, 0, mast + 0.9 * high, 0.2 * long)], 0.3, fin=True))
        kit.add(skin, body([(0.45 * long, 0.1, 0.1, z + high * 0.8),
                            (0.36 * long, wide * 0.6, high * 0.5, z + high),
                            (0.2 * long, 0.1, 0.1, z + 0.9 * high)]))
    else:
        boom = long * kit.uniform("boom", 0.95, 1.3)
        end = rear - boom
        lift = kit.uniform("lift", 0.3, 0.6) * high
        kit.add(skin, body([(rear + 0.1 * long, wide * 0.42, high * 0.42, z + 0.4 * high),
                            (rear - 0.3 * boom, wide * 0.24, high * 0.24, z + 0.42 * high),
                            (end, 0.1, 0.14, z + 0.4 * high + lift)]))
        add_fin(kit, accent, end + 0.45, z + 0.2 * high + lift, 1.25, 0.7, taper=0.55,
                sweep=kit.uniform("fin_sweep", 15, 45))
        add_wings(kit, accent, (end + 0.28 * boom, 0, z + 0.42 * high + 0.7 * lift), 0.85, 0.42,
                  taper=0.8)
        tail_rotor = 0.2 * rotor
        for angle in around(kit.choose("tail_blades", 2, 3, 4), kit.rng.uniform(0, 90)):
            kit.add(BLACK, box(0.14, 0.03, tail_rotor).at(z=tail_rotor / 2).turned("y",
                angle).at(end + 0.1, 0.16, z + 0.9 * high + lift))
        kit.add(BLACK, rod((end + 0.1, 0, z + 0.9 * high + lift),
                           (end + 0.1, 0.2, z + 0.9 * high + lift), 0.06, 8))
        kit.add(skin, body([(0.3 * long, 0.1, 0.1, z + 0.85 * high),
                            (0.08 * long, wide * 0.55, high * 0.4, z + high),
                            (rear + 0.25 * long, wide * 0.5, high * 0.35, z + 0.95 * high),
                            (rear, 0.1, 0.1, z + 0.6 * high)], 2.6))
    if form == "attack":
        add_wings(kit, skin, (0.08 * long, wide * 0.5, z), wide + 1.3, 0.7, taper=0.8, dihedral=-4)
        kit.both(BLACK, body([(0.7, 0.2, 0.2, 0), (-0.8, 0.2, 0.2, 0)], 2, 2, 14).at(-0.05 * long,
            wide + 0.9, z - 0.3))
        kit.add(BLACK, rod((front - 0.2 * long, 0, z - high * 0.9), (front + 0.4, 0, z - high),
                           0.06, 8))
    for turn, (x, up) in enumerate(spots):
        kit.add(BLACK, rod((x, 0, z + 0.6 * high), (x, 0, up + 0.06), 0.09, 10),
                ball(0.5, 0.5, 0.2, 14).at(x, 0, up))
        blade = wing([(0.1, 0.1, 0, 0.24), (0.1, rotor, 0, 0.24)], 0.1)
        for angle in around(blades, kit.rng.uniform(0, 90) + 60 * turn):
            kit.add(BLACK, blade.turned("z", angle).at(x, 0, up))
    if form in ("tandem", "attack") or kit.chance("wheels", 0.3):
        add_gear(kit, [(front - 0.25 * long, 0.0 if form == "attack" else wide * 0.7,
                        z - 0.5 * high), (rear + 0.2 * long, wide * 0.7, z - 0.4 * high)], 0.25)
    else:
        y = wide * 1.15
        skid = [(front - 0.02 * long, y, 0.35), (front - 0.12 * long, y, 0.06),
                (rear + 0.1 * long, y, 0.06)]
        kit.both(CHROME, tube(skid, 0.055, 6))
        for x in (front - 0.3 * long, rear + 0.28 * long):
            kit.add(CHROME, tube([(x, -y, 0.08), (x, -y * 0.6, z - 0.8 * high),
                                  (x, y * 0.6, z - 0.8 * high), (x, y, 0.08)], 0.05, 6))
    kit.add(RED_LIGHT, ball(0.14, 0.14, 0.14, 8).at(-0.3 * long, 0, z + high * 0.95))


def ultralight(kit: Kit, skin: Material, accent: Material) -> None:
    """Ultralight trikes: a fabric wing on tubes, with a pusher propeller."""
    span, z = kit.uniform("span", 4.2, 5.4), kit.uniform("mast", 2.4, 3.0)
    nose, sweep = 1.5, kit.uniform("sweep", 22, 34)
    back = span * np.tan(np.radians(sweep))
    lift = kit.uniform("billow", 0.1, 0.45)
    for s in (-1, 1):
        us = np.linspace(0, 1, 9)
        grid = np.array([[(nose - u * back - c * (2.2 - 1.2 * u), s * u * span,
                           z + lift * np.sin(np.pi * u) * (0.3 + c) + 0.12 * u) for u in us]
                         for c in (0, 0.3, 0.65, 1.0)])
        kit.add(skin if s > 0 or kit.rng.random() < 0.7 else accent, pane(grid, 0.03))
        kit.add(CHROME, rod((nose, 0, z), (nose - back, s * span, z + 0.12), 0.04, 6),
                rod((0.2, 0, z + 0.9), (0.1 - 0.5 * back, s * span * 0.5, z + lift), 0.012, 4),
                rod((0.75, s * 0.75, z - 1.5), (0.1 - 0.5 * back, s * span * 0.5, z), 0.012, 4),
                rod((0.1, 0, z), (0.75, s * 0.75, z - 1.5), 0.03, 6))
    kit.add(CHROME, rod((nose, 0, z), (-1.0, 0, z), 0.04, 6),
            rod((0.2, 0, z), (0.2, 0, z + 0.9), 0.03, 6),
            rod((0.75, -0.75, z - 1.5), (0.75, 0.75, z - 1.5), 0.03, 6),
            rod((0, 0, z), (-0.4, 0, 0.5), 0.05, 6))
    add_fuselage(kit, accent, [(1.45, 0.03, 0.03, 0.62), (1.25, 0.2, 0.2, 0.62),
                               (0.5, 0.36, 0.33, 0.62), (-0.5, 0.3, 0.28, 0.62),
                               (-1.0, 0.12, 0.15, 0.7)], 2.4)
    leather = fabric(kit.rng)
    for x in (0.25, -0.4):
        kit.add(leather, ball(0.5, 0.5, 0.9, 12).at(x, 0, 1.15),
                ball(0.28, 0.25, 0.3, 12).at(x + 0.02, 0, 1.75))
    kit.add(metal(kit.rng), box(0.45, 0.35, 0.45, 0.04).at(-0.85, 0, 1.0))
    add_propeller(kit, accent, -1.1, 0, 1.0, 0.85, 0.09, kit.choose("blades", 2, 3), back=True)
    add_gear(kit, [(1.2, 0, 0.6), (-0.55, 0.8, 0.5)], 0.22)
    kit.both(CHROME, rod((-0.4, 0, 0.5), (-0.55, 0.8, 0.24), 0.035, 6))

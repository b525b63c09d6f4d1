"""Planes with jets. Lengths in metres, the nose toward +x."""

import numpy as np

from data_gen.catalogues.bodies import body, wing
from data_gen.catalogues.families.kit import BLACK, DARK_GLASS, WHITE, Kit
from data_gen.catalogues.families.plane_parts import (
    Station,
    add_canopy,
    add_cockpit_band,
    add_fin,
    add_fuselage,
    add_gear,
    add_nacelle,
    add_windows,
    add_wings,
    cigar_stations,
)
from data_gen.catalogues.solids import ball, box, lathe, rod
from data_gen.mesh import Material

# fmt: off
# Formatted by hand: the formatter would put every coordinate on a line of its own.

def airliner(kit: Kit, skin: Material, accent: Material) -> None:
    """Airliners with two to four engines, under the wings or at the tail; one or two decks."""
    layout = kit.choose("layout", "twin", "twin", "four", "rear", "three", "jumbo")
    wide = 3.0 if layout == "jumbo" else kit.uniform("radius", 1.5, 2.8)
    high = wide * (1.25 if layout == "jumbo" else kit.uniform("oval", 1.0, 1.1))
    long = wide * kit.uniform("slenderness", 16.0, 26.0) * (0.8 if layout == "jumbo" else 1)
    z = high + 0.1 * long * (0.45 if layout == "rear" else 0.6)
    stations = cigar_stations(long, wide, high, z, 1.7 * 2 * high * 0.8, 0.32 * long, 0.62)
    add_fuselage(kit, skin, stations)
    span, chord = long * kit.uniform("span", 0.4, 0.56), long * kit.uniform("chord", 0.13, 0.17)
    sweep = kit.uniform("sweep", 18, 38)
    root = kit.uniform("root", 0.03, 0.13) * long - (0.1 * long if layout == "rear" else 0)
    edge = add_wings(kit, skin, (root + chord * 0.4, wide * 0.4, z - high * 0.6), span, chord,
                     taper=0.28, sweep=sweep, dihedral=kit.uniform("dihedral", 2, 8), kink=0.45)
    if kit.chance("winglets", 0.5):
        x, y, up, c = edge[2]
        add_fin(kit, accent, x - 0.1 * c, up, kit.uniform("winglet", 0.6, 1.4) * c, c * 0.8, y=y,
                cant=15, taper=0.4)
    rear, top = -long / 2, z + high * 0.55
    fin = long * kit.uniform("fin", 0.13, 0.19)
    add_fin(kit, accent, rear + 1.35 * fin, top, fin, fin * 1.05, taper=0.36, sweep=38)
    t_tail = layout == "rear" or kit.chance("t_tail", 0.12)
    tail = (rear + 1.35 * fin - fin * 0.78 + 0.1 * fin, 0.0, top + fin * 0.95) if t_tail else (
        rear + 1.05 * fin, wide * 0.15, z + high * 0.5)
    add_wings(kit, skin, tail, fin * kit.uniform("stabiliser", 0.95, 1.25), fin * 0.72, taper=0.4,
              sweep=32, dihedral=0 if t_tail else 6, thick=0.09)
    radius = wide * kit.uniform("engine", 0.42, 0.68)
    places = {"twin": (0.33,), "jumbo": (0.36, 0.66), "four": (0.33, 0.62), "three": (0.33,)}
    for share in places.get(layout, ()):
        x, y, up, c = (np.interp(share, [0, 0.35, 0.97], edge[:3, col]) for col in range(4))
        add_nacelle(kit, skin, x + 0.32 * c + radius, y, up - radius * 1.15, radius, radius * 3.4)
        kit.both(skin, box(c * 0.8, radius * 0.2, radius * 1.2).at(x - 0.1 * c, y,
                                                                   up - radius * 0.4))
    if layout == "rear":
        x = rear + 0.3 * long
        add_nacelle(kit, skin, x, wide + radius * 0.8, z + high * 0.4, radius * 0.9, radius * 4)
        kit.both(skin, box(radius * 2, wide, radius * 0.3).at(x - 1.7 * radius, wide * 0.7,
                                                              z + high * 0.4))
    if layout == "three":
        add_nacelle(kit, skin, rear + 1.5 * fin, 0, z + high * 0.95 + radius * 0.5, radius * 0.85,
                    fin * 1.1)
    add_cockpit_band(kit, stations, long / 2 - 0.42 * high * 2, long / 2 - 0.72 * high * 2)
    add_windows(kit, rear + 0.3 * long, long / 2 - 2.2 * high, 0.022 * long, wide, z + high * 0.22,
                0.009 * long)
    if layout == "jumbo":
        kit.add(skin, body([(long * 0.46, 0.1, 0.1, z + high * 0.6),
                            (long * 0.36, wide * 0.6, high * 0.42, z + high * 0.72),
                            (long * 0.2, wide * 0.6, high * 0.4, z + high * 0.72),
                            (long * 0.06, 0.1, 0.1, z + high * 0.8)]))
    if kit.chance("stripe", 0.4):
        kit.both(accent, box(0.6 * long, 0.04 * wide, 0.3 * high).at(0, wide * 0.97,
                                                                     z - 0.1 * high))
    if kit.chance("gear", 0.6):
        under = root + chord * 0.4 - chord * 0.75
        add_gear(kit, [(long * 0.38, 0.0, z - 0.5 * high), (under, wide * 0.95, z - 0.5 * high)],
                 0.013 * long, True)


def business(kit: Kit, skin: Material, accent: Material) -> None:
    """Small jets with engines at the tail."""
    long, wide = kit.uniform("length", 10, 20), kit.uniform("radius", 0.75, 1.1)
    z = wide + 1.0
    stations = cigar_stations(long, wide, wide * 1.05, z, 3.4, 0.42 * long, 0.5)
    add_fuselage(kit, skin, stations)
    span, sweep = long * kit.uniform("span", 0.42, 0.58), kit.uniform("sweep", 5, 34)
    edge = add_wings(kit, skin, (0.06 * long, 0.0, z - 0.8 * wide), span, 0.17 * long, taper=0.36,
                     sweep=sweep, dihedral=4)
    if kit.chance("winglets", 0.6):
        add_fin(kit, accent, edge[2, 0], edge[2, 2], 0.9, edge[2, 3] * 0.8, y=edge[2, 1], cant=12)
    rear, fin = -long / 2, long * kit.uniform("fin", 0.15, 0.2)
    add_fin(kit, accent, rear + 1.2 * fin, z + 0.5 * wide, fin, fin, taper=0.55, sweep=42)
    add_wings(kit, skin, (rear + 0.35 * fin, 0, z + 0.5 * wide + fin * 0.95), 0.18 * long,
              0.6 * fin,
              taper=0.5, sweep=28, thick=0.08)
    radius = wide * kit.uniform("engine", 0.48, 0.66)
    add_nacelle(kit, skin, rear + 0.36 * long, wide + radius * 0.75, z + 0.45 * wide, radius,
                radius * 4)
    kit.both(skin, box(radius * 2, wide, 0.2).at(rear + 0.28 * long, wide * 0.8, z + 0.45 * wide))
    add_cockpit_band(kit, stations, long / 2 - 1.3, long / 2 - 2.2)
    add_windows(kit, -0.12 * long, long / 2 - 3.6, 0.9, wide, z + 0.25 * wide, 0.42)
    add_gear(kit, [(long * 0.36, 0, z - 0.5), (-0.04 * long, wide * 1.2, z - 0.8 * wide + 0.12)],
             0.32, True)


def fighter(kit: Kit, skin: Material, accent: Material) -> None:
    """Fighter jets: delta, swept, trapezoid or forward-swept wings; one or two fins and engines."""
    form = kit.choose("planform", "delta", "swept", "trapezoid", "cropped_delta", "forward",
                      "straight")
    long, wide = kit.uniform("length", 12, 20), kit.uniform("radius", 0.06, 0.085)
    wide *= long * 0.75
    z, front, rear = 2.1, long / 2, -long / 2
    flat = kit.uniform("flatness", 0.6, 1.0)
    twin = kit.chance("twin_engines", 0.5)
    tail = wide * (1.25 if twin else 0.8)
    round_nose = kit.chance("nose_intake", 0.2)
    stations: list[Station] = [(front, 0.03, 0.03, z),
                               (front - 0.1 * long, wide * 0.36, wide * 0.4, z),
                               (front - 0.25 * long, wide * 0.68, wide * 0.74, z + 0.05),
                (front - 0.42 * long, wide * (1.3 if twin else 1.05), wide * 0.95 * flat, z),
                               (-0.1 * long, wide * (1.5 if twin else 1.1), wide * 0.95 * flat, z),
                               (rear + 0.2 * long, tail * 1.05, wide * 0.82 * flat, z),
                               (rear + 0.03 * long, tail * 0.8, wide * 0.6 * flat, z)]
    if round_nose:
        stations[:2] = [(front - 0.06 * long, wide * 0.6, wide * 0.62, z),
                        (front - 0.09 * long, wide * 0.66, wide * 0.68, z)]
        kit.add(BLACK, ball(0.06 * long, wide * 0.8, wide * 0.8, 14).at(front - 0.065 * long, 0, z))
    else:
        kit.add(BLACK, rod((front, 0, z), (front + 0.05 * long, 0, z), 0.05, 6))
    add_fuselage(kit, skin, stations, kit.uniform("power", 2.0, 3.2))
    wing_z = z + kit.uniform("wing_height", -0.35, 0.5) * wide
    root, span_, sweep, taper = {"delta": (0.48, 0.3, 56, 0.06),
                                 "cropped_delta": (0.36, 0.3, 48, 0.22),
                                 "swept": (0.24, 0.36, 38, 0.45),
                                 "trapezoid": (0.28, 0.32, 30, 0.32),
                                 "forward": (0.26, 0.36, -24, 0.4),
                                 "straight": (0.2, 0.4, 6, 0.6)}[form]
    span, chord = span_ * long * kit.uniform("span", 0.9, 1.15), root * long * kit.uniform("chord",
                                                                                           0.9, 1.1)
    x = rear + {"delta": 0.62, "cropped_delta": 0.54, "forward": 0.36, "straight": 0.54}.get(form,
        0.52) * long
    edge = add_wings(kit, skin, (x, wide * 0.6, wing_z), span, chord, taper=taper, sweep=sweep,
                     dihedral=kit.uniform("dihedral", -5, 3), thick=0.045)
    if kit.chance("strakes", 0.5) and form in ("trapezoid", "swept", "cropped_delta"):
        kit.both(skin, wing([(x + 0.2 * long, wide * 0.4, wing_z, 0.22 * long),
                             (x, wide * 1.7, wing_z, 0.02 * long)], 0.03))
    canard = form in ("delta", "forward") and kit.chance("canards", 0.65)
    if canard:
        add_wings(kit, skin, (front - 0.24 * long, wide * 0.5, wing_z + 0.3), wide + 0.1 * long,
                  0.1 * long, taper=0.35, sweep=45, thick=0.05)
    elif form != "delta":
        add_wings(kit, skin, (rear + 0.17 * long, tail * 0.6, z), 0.55 * span + tail, 0.14 * long,
                  taper=0.4, sweep=40, thick=0.05)
    fin = kit.uniform("fin", 0.13, 0.19) * long
    if kit.chance("twin_fins", 0.45):
        add_fin(kit, skin, rear + 0.24 * long, z + 0.4 * wide, fin * 0.9, fin, y=tail * 0.85,
                cant=kit.uniform("cant", 0, 28), taper=0.4, sweep=40)
    else:
        add_fin(kit, accent if kit.rng.random() < 0.3 else skin, rear + 0.28 * long,
                z + 0.4 * wide, fin * 1.1, fin * 1.35, taper=0.35, sweep=45)
    add_canopy(kit, front - 0.27 * long, 0.2 * long, wide * 0.52, wide * 0.75, z + wide * 0.5)
    if not round_nose:
        kit.both(skin, box(0.22 * long, wide * 0.6, wide * 1.1, 0.1).at(-0.0 * long, wide * 1.25,
                                                                        z - 0.1))
        kit.both(BLACK, box(0.01, wide * 0.5, wide * 0.9).at(0.11 * long, wide * 1.25, z - 0.1))
    for s in (-1, 1) if twin else (0,):
        r = wide * (0.48 if twin else 0.62)
        nozzle = lathe([(r, 0.04 * long), (r, 0), (r * 0.78, -0.035 * long),
                        (r * 0.68, -0.035 * long), (r * 0.6, 0.02 * long)], 18, loop=True)
        kit.add(Material((0.22, 0.21, 0.2), (0.3,) * 3, 30.0, name="nozzle"),
                nozzle.turned("y", 90).at(rear + 0.03 * long, s * tail * 0.5, z))
    for k in range(kit.choose("stores", 0, 1, 2, 3)):
        share = 0.35 + 0.22 * k
        sx, sy, sz, c = (np.interp(share, [0, 0.35, 0.97], edge[:3, col]) for col in range(4))
        r = 0.12 + 0.12 * (k == 0)
        store = body([(2.0, 0.02, 0.02, 0), (1.5, r, r, 0), (-1.2, r, r, 0),
                      (-1.6, r * 0.5, r * 0.5, 0)], 2, 2, 12)
        kit.both(WHITE, store.at(sx - 0.4 * c, sy, sz - 0.42 - r))
        kit.both(skin, box(0.9, 0.08, 0.5).at(sx - 0.45 * c, sy, sz - 0.22))
    if kit.chance("gear", 0.5):
        add_gear(kit, [(front - 0.3 * long, 0, z - 0.3),
                       (rear + 0.38 * long, wide * 1.2, z - 0.3)], 0.36)


def flying_wing(kit: Kit, skin: Material, accent: Material) -> None:
    """Flying wings with a canopy and two engines; some with fins."""
    span, sweep = kit.uniform("span", 9, 24), kit.uniform("sweep", 22, 42)
    root = span * kit.uniform("root", 0.42, 0.62)
    z = 2.0
    edge = add_wings(kit, skin, (0.5 * root, 0, z), span, root,
                     taper=kit.uniform("taper", 0.12, 0.3), sweep=sweep, thick=0.11,
                     kink=kit.uniform("kink", 0.05, 0.3))
    fat = 0.1 * root
    add_fuselage(kit, skin, [(0.62 * root, 0.05, 0.05, z), (0.45 * root, fat * 1.1, fat * 0.75, z),
                             (0.15 * root, fat * 1.5, fat * 1.25, z + 0.1),
                          (-0.25 * root, fat * 1.3, fat * 0.8, z), (-0.5 * root, 0.2, 0.1, z)], 2.2)
    add_canopy(kit, 0.25 * root, 0.26 * root, fat * 0.7, fat * 0.8, z + fat * 0.6)
    for s in (-1, 1):
        kit.add(skin, body([(0.2 * root, fat * 0.6, 0.1, z + 0.1),
                            (0.05 * root, fat * 0.8, fat * 0.7, z + 0.15),
                            (-0.4 * root, fat * 0.5, 0.1, z)], 2.6).at(0, s * fat * 2.4, 0))
        kit.add(BLACK, box(0.02 * root, fat, fat * 0.45).at(0.15 * root, s * fat * 2.4,
                                                            z + fat * 0.25))
    fins = kit.choose("fins", "none", "none", "tips", "inner")
    if fins == "tips":
        add_fin(kit, accent, edge[2, 0] + 0.2, edge[2, 2], 0.15 * span, edge[2, 3], y=edge[2, 1],
                taper=0.5)
    elif fins == "inner":
        add_fin(kit, accent, -0.1 * root, z, 0.14 * span, 0.2 * root, y=fat * 3, cant=10, taper=0.5)
    if kit.chance("gear", 0.6):
        add_gear(kit, [(0.4 * root, 0, z), (-0.1 * root, 2.6 * fat, z)], 0.4, True)


def supersonic(kit: Kit, skin: Material, accent: Material) -> None:
    """A supersonic airliner with an ogee delta wing, or a space glider."""
    if kit.chance("shuttle", 0.35):
        long, wide, z = 30.0, kit.uniform("radius", 2.4, 3.2), 4.2
        stations: list[Station] = [(15, 0.1, 0.1, z - 1), (14.3, wide * 0.5, wide * 0.5, z - 0.8),
                                   (11, wide * 0.9, wide * 0.9, z - 0.2), (7, wide, wide * 1.1, z),
                                   (-12, wide, wide * 1.1, z), (-14, wide * 1.1, wide, z)]
        add_fuselage(kit, skin, stations, 2.8)
        kit.both(skin, wing([(9, wide * 0.8, z - wide * 0.8, 21),
                             (-1, wide * 1.3, z - wide * 0.8, 11.5),
                             (-9, 12 * kit.uniform("span", 0.85, 1.1), z - wide * 0.7, 3.4)], 0.05))
        add_fin(kit, skin, -7.5, z + wide * 0.9, 7.5, 6.5, taper=0.5, sweep=45)
        kit.both(skin, body([(-8, 0.3, 0.3, 0), (-10.5, 1.3, 1.3, 0), (-14, 1.3, 1.2, 0)]).at(0,
            wide * 0.7, z + wide * 0.8))
        for y, up in ((0, 1.6), (1.4, -0.6), (-1.4, -0.6)):
            kit.add(BLACK, lathe([(1.2, 0), (0.5, 2.0)], 18).turned("y", 90).at(-15.5, y, z + up))
        add_cockpit_band(kit, stations, 13.3, 11.8)
        add_gear(kit, [(10, 0, z - 1), (-8, 3, z - wide * 0.8)], 0.6, True)
        return
    long, wide = kit.uniform("length", 45, 62), kit.uniform("radius", 1.2, 1.7)
    z, front, rear = 4.6, long / 2, -long / 2
    droop = kit.uniform("droop", 0.0, 1.5)
    add_fuselage(kit, skin, [(front, 0.05, 0.05, z - droop),
                             (front - 0.06 * long, wide * 0.5, wide * 0.5, z - droop * 0.4),
                             (front - 0.14 * long, wide, wide * 1.05, z),
                             (rear + 0.3 * long, wide, wide * 1.05, z), (rear, 0.1, 0.15, z + 0.5)])
    span = long * kit.uniform("span", 0.18, 0.25)
    x = rear + 0.62 * long
    sections = [(x, wide * 0.6, z - 0.7, 0.5 * long),
                (x - 0.13 * long, wide + 0.18 * span, z - 0.7, 0.37 * long),
                (x - 0.26 * long, wide + 0.45 * span, z - 0.6, 0.23 * long),
                (x - 0.42 * long, wide + 0.9 * span, z - 0.5, 0.06 * long)]
    kit.both(skin, wing(sections, 0.03, steps=2))
    add_fin(kit, accent, rear + 0.24 * long, z + 0.8, 0.11 * long, 0.2 * long, taper=0.25, sweep=52)
    for y in (0.3, 0.48):
        kit.both(skin, box(0.17 * long, 1.9, 1.7, 0.2).at(rear + 0.21 * long, wide + y * span,
                                                          z - 1.7))
        kit.both(BLACK, box(0.1, 1.5, 1.3).at(rear + 0.296 * long, wide + y * span, z - 1.7))
    add_windows(kit, rear + 0.3 * long, front - 0.2 * long, 1.3, wide, z + 0.3, 0.35)
    kit.add(DARK_GLASS, body([(front - 0.075 * long, 0.1, 0.1, z + 0.1),
                              (front - 0.1 * long, 0.7, 0.5, z + 0.55),
                              (front - 0.14 * long, 0.5, 0.2, z + 0.9)], 2, 2, 14))
    add_gear(kit, [(front - 0.25 * long, 0, z - 1), (rear + 0.34 * long, wide * 2.4, z - 1)], 0.6,
             True)

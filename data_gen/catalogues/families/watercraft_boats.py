"""Boats with sails, oars and engines. Lengths in metres, the bow toward +x."""

import itertools

import numpy as np

from data_gen.catalogues import bodies, solids
from data_gen.catalogues.bodies import body
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    DARK_GLASS,
    WHITE,
    Kit,
    fabric,
    paint,
    shade_of,
    wood,
)
from data_gen.catalogues.families.watercraft_parts import (
    ROPE,
    add_house,
    add_mast,
    add_railing,
    add_sail,
    house_outline,
    make_hull,
)
from data_gen.catalogues.solids import ball, box, cylinder, pane, pillow, rod, smooth_path, tube
from data_gen.mesh import Material

# fmt: off
# Formatted by hand: the formatter would put every coordinate on a line of its own.

def _outboard(kit: Kit, x: float, y: float, z: float) -> None:
    size = max(0.12 * z, 0.3)
    kit.add(BLACK, pillow(1.2 * size, 0.7 * size, 0.9 * size, 0.25 * size, 2).at(x - 0.4 * size, y,
                                                                                 z + 0.5 * size),
            box(0.35 * size, 0.2 * size, z * 0.9, 0.03).at(x - 0.4 * size, y, z * 0.55),
            ball(0.9 * size, 0.2 * size, 0.25 * size, 12).at(x - 0.4 * size, y, 0.2 * z))


def sailing_yacht(kit: Kit, skin: Material, trim: Material) -> None:
    """Sailing yachts with one or two masts, sails set or furled; some with a fin keel."""
    rig = kit.choose("rig", "sloop", "sloop", "ketch", "cutter", "catboat", "gaff", "schooner")
    long = kit.uniform("half_length", 3.5, 9.0)
    beam, depth = long * kit.uniform("beam", 0.24, 0.38), long * kit.uniform("freeboard", 0.2, 0.3)
    keel = kit.chance("fin_keel", 0.45)
    lift = depth * kit.uniform("draught", 0.6, 1.4) if keel else 0.0
    deck = wood(kit.rng)
    hull = make_hull(kit, skin, long, beam, depth, sheer=kit.uniform("sheer", 0.1, 0.45),
                     stern=kit.uniform("stern", 0.3, 0.85), bow=kit.uniform("bow", 1.7, 2.6),
                     belly=kit.uniform("belly", 1.6, 2.6), rake=kit.uniform("rake", 0.05, 0.2),
                     rise=0.75, aft_rise=0.6, deck=deck, trim=trim)
    z = hull.deck_at(0)
    add_house(kit, skin, -0.2 * long, 0.38 * long, beam * 0.55, z - 0.02,
              z + depth * kit.uniform("cabin", 0.25, 0.5), nose=0.1 * long, lean=(0.12 * long, 0))
    kit.add(BLACK, pillow(0.42 * long, beam * 0.8, depth * 0.1, 0.03 * long, 2).at(-0.55 * long, 0,
                                                                                   z))
    mast = long * (kit.uniform("mast_place", 0.1, 0.3) + (0.4 if rig == "catboat" else 0))
    high = long * kit.uniform("mast", 1.9, 2.9)
    spar = wood(kit.rng) if rig in ("gaff", "schooner") else CHROME
    masts = [(mast, high, 0.75)]
    if rig == "ketch":
        masts.append((-0.62 * long, 0.62 * high, 0.45))
    elif rig == "schooner":
        masts = [(0.35 * long, 0.75 * high, 0.42), (-0.2 * long, 0.85 * high, 0.65)]
    up, cloth = kit.chance("sails_up", 0.65), WHITE if kit.rng.random() < 0.65 else fabric(kit.rng)
    wind = kit.uniform("wind", 0.04, 0.16) * long * kit.choose("tack", -1, 1)
    swing = np.radians(kit.uniform("swing", 3, 22)) * np.sign(wind)
    for x, tall, reach in masts:
        add_mast(kit, spar, x, z - 0.05, tall, 0.016 * long)
        boom = z + 0.28 * depth + 0.12 * long
        end = (x - reach * long * np.cos(swing), reach * long * np.sin(swing), boom)
        kit.add(spar, rod((x, 0, boom), end, 0.011 * long))
        if up:
            head = (x - 0.01 * long, 0, z + tall * (0.97 if rig not in ("gaff", "schooner")
                                                    else 0.7))
            corners = [(x - 0.02 * long, 0, boom), (end[0], end[1], boom + 0.01), head]
            if rig in ("gaff", "schooner"):
                peak = (x - 0.62 * reach * long, 0.3 * end[1], z + tall * 0.97)
                kit.add(spar, rod(head, peak, 0.01 * long))
                corners.append(peak)
            add_sail(kit, cloth, corners, wind, 0.1)
        else:
            half_way = ((x + end[0]) / 2, end[1] / 2, boom + 0.015 * long)
            kit.add(fabric(kit.rng), tube([(x, 0, boom + 0.02 * long), half_way, end],
                                          [0.035 * long, 0.03 * long, 0.015 * long], 8))
    tip = hull.rail[-1]
    if up and rig != "catboat":
        x, tall, _ = masts[0]
        for k in range(2 if rig == "cutter" else 1):
            clew = (x + (0.05 - 0.3 * kit.rng.random() * (k == 0)) * long,
                    0.2 * beam * np.sign(wind), z + 0.2 * depth)
            add_sail(kit, cloth, [(tip[0] - 0.35 * long * k, 0, tip[2]), clew,
                                  (x + 0.06 * long - 0.03 * k * long, 0,
                                   z + tall * (0.9 - 0.15 * k))], wind)
    x, tall, _ = masts[0]
    wire = 0.0035 * long
    kit.add(ROPE, rod((x, 0, z + 0.97 * tall), tuple(tip), wire, 5),
            rod((masts[-1][0], 0, z + 0.97 * masts[-1][1]), (-0.97 * long, 0, hull.rail[0, 2]),
                wire, 5))
    for x, tall, _ in masts:
        kit.both(ROPE, rod((x, 0, z + 0.85 * tall),
                           (x - 0.03 * long, hull.half_width(x) * 0.95, z), wire, 5))
        kit.both(spar, rod((x, 0, z + 0.55 * tall), (x, 0.3 * beam, z + 0.55 * tall), wire * 1.5,
                           5))
    if kit.chance("railing", 0.4):
        add_railing(kit, hull, -0.9 * long, 0.22 * depth + 0.15)
    if keel:
        root = 0.25 * long
        kit.add(BLACK, bodies.wing([(root, 0, 0.3 * depth, 0.5 * long),
                                    (root - 0.12 * long, 0, -lift, 0.3 * long)], 0.1, fin=True),
                ball(0.4 * long, 0.09 * long, 0.09 * long, 14).at(-0.02 * long, 0, -lift),
                bodies.wing([(-0.7 * long, 0, 0.7 * depth, 0.15 * long),
                             (-0.74 * long, 0, -0.6 * lift, 0.1 * long)], 0.1, fin=True))


def galleon(kit: Kit, skin: Material, trim: Material) -> None:
    """Square-rigged ships: castles at the ends or flush decks, two to four masts."""
    long = kit.uniform("half_length", 12, 22)
    castles = kit.uniform("castles", 0.0, 1.0)
    beam, depth = long * kit.uniform("beam", 0.2, 0.32), long * kit.uniform("freeboard", 0.24, 0.36)
    oak = wood(kit.rng)
    hull = make_hull(kit, oak, long, beam, depth, sheer=0.15 + 0.3 * castles, stern=0.65,
                     bow=kit.uniform("bow", 2.2, 3.6), belly=2.6, rake=0.16, rise=0.5,
                     aft_rise=0.4, aft_sheer=0.9,
                     bulwark=0.12, deck=wood(kit.rng), trim=trim)
    tall = depth * (0.15 + 0.5 * castles)
    for share, (back, front) in ((1.0, (-1.0, -0.45)), (0.9, (-1.0, -0.7)),
                                 (0.75, (0.55, 0.82)))[: 3 if castles > 0.4 else 1]:
        base = hull.deck_at((back + front) / 2 * long) + (tall if back == -1.0 and front == -0.7
                                                          else 0)
        half = min(hull.half_width(back * long), hull.half_width(front * long)) * 0.98 * share
        add_house(kit, oak, back * long, front * long, half, base - 0.05 * depth, base + tall,
                  inset=0.1, glass=None)
    kit.add(DARK_GLASS, *(box(0.1, beam * 0.16, depth * 0.16).at(-1.005 * long, y * beam,
        depth * 0.9) for y in (-0.36, -0.12, 0.12, 0.36)))
    stripe = hull.rail * [1, 1.0, 0.72]
    for k in range(kit.choose("guns", 0, 5, 8)):
        x = (-0.6 + 1.15 * k / 7) * long
        kit.both(BLACK, box(0.04 * long, 0.05 * beam, 0.06 * depth).at(x,
            np.interp(x, stripe[:, 0], stripe[:, 1]) * 0.975, 0.72 * depth))
    bowsprit = hull.rail[-1]
    tip = bowsprit + np.array([0.35 * long, 0, 0.16 * long])
    heel = bowsprit - np.array([0.2 * long, 0, 0.02 * long])
    kit.add(oak, tube([heel.tolist(), tip.tolist()], 0.016 * long))
    count, high = kit.choose("masts", 2, 3, 3, 4), long * kit.uniform("mast", 1.2, 1.7)
    up = kit.chance("sails_up", 0.75)
    cloth = WHITE if kit.rng.random() < 0.5 else Material(shade_of((0.85, 0.78, 0.62), kit.rng),
                                                          name="canvas")
    belly, turn = long * kit.uniform("belly", 0.04, 0.12), kit.uniform("brace", -30, 30)
    rows = kit.choose("rows", 2, 3, 4)
    lateen = kit.chance("lateen_mizzen", 0.6)
    last = high
    for k, x in enumerate(np.linspace(-0.66, 0.55, count) * long):
        tall = high * (0.75 if k == 0 else 1 if k < count - 1 or count == 2 else 0.88)
        z = hull.deck_at(x)
        add_mast(kit, oak, x, z - 0.1 * depth, tall, 0.018 * long)
        last = tall
        if k == 0 and lateen:
            low = (x + 0.25 * long, 0.1 * beam, z + 0.2 * tall)
            top = (x - 0.28 * long, 0.1 * beam, z + 0.95 * tall)
            kit.add(oak, rod(low, top, 0.01 * long))
            if up:
                add_sail(kit, cloth, [low, (x - 0.3 * long, 0.3 * beam, z + 0.15 * tall), top],
                         belly)
        else:
            edges = np.linspace(0.18, 0.95, rows + 1) if rows > 2 else np.array([0.2, 0.62, 0.95])
            for a, b in itertools.pairwise(edges.tolist()):
                w0, w1 = (beam * 1.75 * (1 - 0.55 * e) for e in (a, b))
                yard = rod((0.03 * long, -w1, 0), (0.03 * long, w1, 0), 0.009 * long)
                kit.add(oak, yard.turned("z", turn).at(x, 0, z + b * tall))
                if up:
                    u, v = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(0, 1, 6))
                    width = w0 * 0.95 + (w1 * 0.95 - w0 * 0.95) * v
                    grid = np.stack([0.05 * long + belly * (1 - u**2) * np.sin(np.pi * (0.1
                        + 0.85 * v)), u * width, (a + 0.02 + v * (b - a - 0.03)) * tall], -1)
                    part = pane(grid, 0.04)
                    kit.add(cloth, part.turned("z", turn).at(x, 0, z))
        if k < 3:
            kit.add(oak, cylinder(0.05 * long, 0.03 * long, 12).at(x, 0, z + 0.6 * tall))
        for dx in (-0.05, 0.0, 0.05):
            kit.both(ROPE, rod((x, 0, z + 0.6 * tall),
                               (x + (dx - 0.03) * long, hull.half_width(x) * 0.98, z),
                               0.003 * long, 4))
    x = 0.55 * long
    kit.add(ROPE, rod((x, 0, hull.deck_at(x) + 0.9 * last), tip, 0.003 * long, 4))
    if up:
        for s in (0.35, 0.95):
            add_sail(kit, cloth, [bowsprit + s * (tip - bowsprit),
                                  (x + 0.1 * long, 0, bowsprit[2] + 0.1 * high * s),
                                  (x + 0.05 * long, 0, hull.deck_at(x) + last * (0.5 + 0.35 * s))],
                     belly * 0.5)
    kit.add(trim, box(0.2 * long, 0.01 * long, 0.09 * long).at(-0.755 * long, 0,
        hull.deck_at(-0.66 * long) + 0.7 * high))


def rowing(kit: Kit, skin: Material, trim: Material) -> None:
    """Open boats: rowing boat, canoe, kayak, punt, longship, inflatable."""
    form = kit.choose("form", "dinghy", "canoe", "kayak", "longship", "punt", "inflatable")
    # half length, beam / half length, depth / half length, sheer, stern, bow, belly, rake, bulwark
    shapes = {
              "dinghy": ((1.3, 2.6), (0.32, 0.45), 0.25, 0.25, 0.7, 2.3, 2.2, 0.1, 0.72),
              "canoe": ((2.0, 3.0), (0.15, 0.2), 0.14, 0.5, 0.0, 2.6, 3.0, 0.05, 0.85),
              "kayak": ((1.6, 2.8), (0.1, 0.16), 0.11, 0.25, 0.0, 2.0, 2.4, 0.1, 0.02),
              "longship": ((8, 12), (0.17, 0.24), 0.14, 1.4, 0.0, 2.3, 1.8, 0.12, 0.7),
              "punt": ((2.0, 4.0), (0.18, 0.3), 0.13, 0.2, 0.8, 6.0, 5.0, 0.02, 0.8),
    }
    blade_wood = wood(kit.rng)
    if form == "inflatable":
        long, wide, r = kit.uniform("half_length", 1.2, 2.4), 0.0, kit.uniform("tube", 0.2, 0.28)
        wide = long * kit.uniform("beam", 0.38, 0.5)
        path = [(-long, wide, r), (0.3 * long, wide, r), (0.8 * long, wide * 0.7, r * 1.25),
                (1.05 * long, 0, r * 1.5), (0.8 * long, -wide * 0.7, r * 1.25),
                (0.3 * long, -wide, r), (-long, -wide, r)]
        line = smooth_path(path, 5)
        radii = np.full(len(line), r)
        radii[[0, -1]] = 0.3 * r
        kit.add(skin, tube(line, radii.tolist(), 14))
        hull = make_hull(kit, trim, long * 0.85, wide * 0.95, r * 1.2, sheer=0.2, stern=0.9,
                         bulwark=0.4, belly=2.0)
        kit.add(trim, box(0.08, wide * 1.9, r * 1.9).at(-0.86 * long, 0, r * 1.0))
        for x in (-0.4, 0.2):
            kit.add(blade_wood, box(0.24, wide * 1.9, 0.05).at(x * long, 0, 1.5 * r))
        if kit.chance("outboard", 0.6):
            _outboard(kit, -0.86 * long - 0.03, 0, 2.2 * r)
        return
    span, beam_, depth_, sheer, stern, bow, belly, rake, bulwark = shapes[form]
    long = kit.uniform("half_length", *span)
    beam, depth = long * kit.uniform("beam", *beam_), long * depth_ * kit.uniform("freeboard",
                                                                                  0.85, 1.2)
    hull = make_hull(kit, skin if form != "longship" else blade_wood, long, beam, depth,
                     sheer=sheer, stern=stern, bow=bow, belly=belly, rake=rake, rise=0.75,
                     aft_rise=0.75 if not stern else 0.2, aft_sheer=1.0 if not stern else 0.3,
                     bulwark=bulwark, wall=0.05, deck=wood(kit.rng), trim=trim)
    if form == "kayak":
        kit.add(BLACK, ball(0.4 * long, beam * 1.2, depth * 0.5, 16).at(-0.1 * long, 0, depth))
        kit.add(CHROME, rod((-0.05 * long, -1.1, depth * 0.9), (-0.05 * long, 1.1, depth * 1.5),
                            0.02))
        for s in (-1, 1):
            kit.add(trim, ball(0.16, 0.4, 0.05, 12).turned("x", 15).at(-0.05 * long, 1.2 * s,
                                                                       depth * (1.2 + 0.33 * s)))
        return
    for x in np.linspace(-0.6, 0.55, 3 if form != "longship" else 9) * long:
        kit.add(blade_wood, box(0.06 * min(long, 3), 1.88 * hull.half_width(x), 0.05 * depth).at(x,
            0, 0.86 * depth))
    if form == "dinghy" and kit.chance("outboard", 0.35):
        _outboard(kit, -1.0 * long, 0, depth * 1.15)
    if form == "longship":
        mast = long * kit.uniform("mast", 0.8, 1.1)
        if kit.chance("mast_up", 0.7):
            add_mast(kit, blade_wood, 0, 0.2 * depth, mast, 0.014 * long)
            if kit.chance("sail_up", 0.6):
                u, v = np.meshgrid(np.linspace(-1, 1, 9), np.linspace(0, 1, 6))
                grid = np.stack([0.1 + 0.1 * long * (1 - u**2) * np.sin(np.pi * v),
                                 u * 0.55 * long, 1.3 * depth + v * (mast - 1.25 * depth)], -1)
                kit.add(fabric(kit.rng), pane(grid, 0.04))
            kit.add(blade_wood, rod((0.1, -0.6 * long, mast + 0.1 * depth),
                                    (0.1, 0.6 * long, mast + 0.1 * depth), 0.01 * long))
        for end in (1, -1):
            tip = hull.rail[-1 if end > 0 else 0]
            curl = [(tip[0] - 0.1 * long * end, 0, tip[2] * 0.75), tuple(tip),
                    (tip[0] + 0.04 * long * end, 0, tip[2] + 0.16 * long),
                    (tip[0] - 0.03 * long * end, 0, tip[2] + 0.24 * long)]
            kit.add(blade_wood, tube(smooth_path(curl, 5), 0.02 * long, 8))
        shields = [paint(kit.rng) for _ in range(2)]
        for k, x in enumerate(np.linspace(-0.6, 0.6, 9) * long):
            disc = ball(0.09 * long, 0.03 * long, 0.09 * long, 14)
            kit.both(shields[k % 2], disc.at(x, hull.half_width(x),
                                             float(np.interp(x, hull.rail[:, 0], hull.rail[:, 2]))))
    oars = {"longship": 7, "dinghy": 1, "punt": 0, "canoe": 0}[form]
    reach = 2.2 * beam + 0.3
    for x in np.linspace(-0.45, 0.5, oars) * long if oars > 1 else [0.1 * long] * oars:
        if form == "dinghy" and kit.rng.random() < 0.3:
            continue
        size = 0.01 * long + 0.01
        oar = tube([(0, 0.3 * beam, 1.25 * depth), (0, reach, 0.35 * depth)], size, 6)
        blade = box(0.12 * beam + 0.05, 0.35 * beam, 0.02, 0.005).turned("x", -15).at(0, reach,
                                                                                      0.35 * depth)
        kit.both(blade_wood, oar.at(x), blade.at(x))


def speedboat(kit: Kit, skin: Material, trim: Material) -> None:
    """Speedboats: with a windscreen, a small cabin or a console; racing boats."""
    long = kit.uniform("half_length", 2.2, 6.0)
    beam, depth = long * kit.uniform("beam", 0.24, 0.42), long * kit.uniform("freeboard", 0.2, 0.32)
    form = kit.choose("form", "open", "open", "cuddy", "console", "racer")
    bulwark = {"racer": 0.03, "cuddy": 0.06, "open": 0.45, "console": 0.5}[form]
    hull = make_hull(kit, skin, long, beam * (0.75 if form == "racer" else 1), depth,
                     sheer=kit.uniform("sheer", -0.05, 0.25),
                     stern=kit.uniform("stern", 0.75, 0.95), bow=kit.uniform("bow", 1.6, 2.8),
                     belly=kit.uniform("belly", 1.2, 2.0), rake=kit.uniform("rake", 0.1, 0.3),
                     rise=0.7, bulwark=bulwark, wall=0.12, deck=wood(kit.rng), trim=trim)
    z, floor = depth, hull.deck_at(0)
    seats = fabric(kit.rng)
    if form in ("open", "cuddy", "racer"):
        nose = [(0.95 * long, 0.1, 0.02, z), (0.6 * long, hull.half_width(0.6 * long) * 0.85,
            0.08 * depth, z), (0.15 * long, beam * 0.9, 0.2 * depth, z)]
        if form == "cuddy":
            nose = [(0.8 * long, 0.1, 0.02, z), (0.55 * long, beam * 0.5, 0.35 * depth, z),
                    (0.1 * long, beam * 0.75, kit.uniform("cuddy", 0.5, 0.9) * depth, z)]
        kit.add(skin, body(nose, 2.4, 3, 18))
    ys = np.linspace(-1, 1, 9)
    x, rise, rake = 0.14 * long, kit.uniform("screen", 0.25, 0.6) * depth, 0.16 * long
    if form != "console":
        base = z + (0.3 if form != "cuddy" else 0.6) * 0.3 * depth
        grid = np.array([[(x - rake * t - 0.2 * long * y**2, beam * 0.78 * y * (1 - 0.1 * t),
                           base + rise * t) for y in ys] for t in (0, 0.5, 1)])
        kit.add(DARK_GLASS, pane(grid, 0.02))
        kit.add(CHROME, tube(grid[-1], 0.012 * depth + 0.01, 6))
    else:
        kit.add(skin, pillow(0.24 * long, 0.6 * beam, 1.0 * depth, 0.05 * long, 2).at(0, 0,
            floor + 0.5 * depth))
        kit.add(DARK_GLASS, box(0.02 * long, 0.55 * beam, 0.35 * depth).turned("y",
            -20).at(0.08 * long, 0, floor + 1.15 * depth))
        if kit.chance("t_top", 0.6):
            top = floor + 2.0 * depth
            kit.add(trim, pillow(0.6 * long, 1.2 * beam, 0.1 * depth, 0.04 * depth,
                                 2).at(-0.03 * long, 0, top))
            for dx in (-0.2, 0.15):
                kit.both(CHROME, rod((dx * long, 0.45 * beam, floor),
                                     (dx * long, 0.42 * beam, top), 0.012 * long, 6))
    for row in range(kit.choose("rows", 1, 2)):
        sx = -0.12 * long - 0.34 * long * row
        base = floor if bulwark > 0.3 else z - 0.1 * depth
        kit.both(seats, pillow(0.18 * long, beam * 0.62, 0.4 * depth, 0.05 * depth, 2).at(sx,
            0.4 * beam, base + 0.2 * depth),
                 pillow(0.06 * long, beam * 0.62, 0.75 * depth, 0.05 * depth,
                        2).at(sx - 0.1 * long, 0.4 * beam, base + 0.45 * depth))
    back = kit.choose("engine", "outboard", "two", "pad", "arch")
    if back in ("outboard", "two"):
        for y in (0,) if back == "outboard" else (-0.3 * beam, 0.3 * beam):
            _outboard(kit, -1.0 * long, y, 1.1 * depth)
    else:
        low = min(floor, z - 0.2 * depth)
        kit.add(seats, pillow(0.3 * long, beam * 1.3, z + 0.1 * depth - low, 0.1 * depth,
                              2).at(-0.76 * long, 0, (z + 0.1 * depth + low) / 2))
    if back == "arch":
        w = hull.half_width(-0.4 * long) * 0.92
        bow = [(-0.55 * long, -w, z * 0.95), (-0.45 * long, -w * 0.9, z + 1.1 * depth),
               (-0.4 * long, 0, z + 1.25 * depth), (-0.45 * long, w * 0.9, z + 1.1 * depth),
               (-0.55 * long, w, z * 0.95)]
        kit.add(trim, tube(smooth_path(bow, 3), 0.025 * long, 6))


def jet_ski(kit: Kit, skin: Material, trim: Material) -> None:
    """Jet skis; some with a rider."""
    long = kit.uniform("half_length", 1.2, 1.7)
    beam, depth = long * kit.uniform("beam", 0.32, 0.4), long * 0.3
    make_hull(kit, skin, long, beam, depth, sheer=0.3, stern=0.85, bow=2.3, belly=1.8, rake=0.12,
              rise=0.7, bulwark=0.1, deck=BLACK)
    kit.add(skin, body([(0.95 * long, 0.1, 0.05, depth * 1.2),
                        (0.6 * long, beam * 0.6, 0.4 * depth, depth * 1.2),
                        (0.2 * long, beam * 0.5, 0.75 * depth, depth * 1.25),
                        (0.0, beam * 0.3, 0.4 * depth, depth * 1.1)], 2.4))
    kit.add(BLACK, body([(0.05 * long, beam * 0.35, 0.5 * depth, depth * 1.1),
                         (-0.25 * long, beam * 0.5, 0.65 * depth, depth * 1.1),
                         (-0.6 * long, beam * 0.45, 0.8 * depth, depth * 1.15),
                         (-0.85 * long, beam * 0.3, 0.4 * depth, depth)], 3.0))
    kit.add(trim, body([(0.3 * long, 0.1, 0.12, depth * 2.1),
                        (0.12 * long, 0.16, 0.16, depth * 2.2)], 3.0))
    kit.add(BLACK, rod((0.15 * long, -0.42, depth * 2.3), (0.15 * long, 0.42, depth * 2.3), 0.025),
            rod((0.3 * long, 0, depth * 1.7), (0.15 * long, 0, depth * 2.3), 0.04))
    if kit.chance("rider", 0.4):
        cloth = fabric(kit.rng)
        kit.add(cloth, body([(-0.1, 0.2, 0.16, 0), (0.3, 0.25, 0.18, 0), (0.55, 0.1, 0.1, 0)],
                            2.4).turned("y", -70).at(-0.35 * long, 0, depth * 2.0),
                ball(0.25, 0.22, 0.3, 12).at(-0.24 * long, 0, depth * 2 + 0.62))
        kit.both(cloth, tube([(-0.27 * long, 0.25, depth * 2 + 0.45),
                              (-0.1 * long, 0.36, depth * 2.1 + 0.2),
                              (0.14 * long, 0.36, depth * 2.3)], 0.05, 6),
                 tube([(-0.4 * long, 0.12, depth * 2), (0.0, 0.28, depth * 1.9),
                       (-0.1 * long, 0.3, depth)], 0.08, 6))


def motor_yacht(kit: Kit, skin: Material, trim: Material) -> None:
    """Motor yachts with one to three decks."""
    long = kit.uniform("half_length", 5, 30)
    beam, depth = long * kit.uniform("beam", 0.19, 0.32), long * kit.uniform("freeboard", 0.16,
                                                                             0.28)
    hull = make_hull(kit, skin, long, beam, depth, sheer=kit.uniform("sheer", 0.1, 0.5),
                     stern=kit.uniform("stern", 0.75, 0.95), bow=kit.uniform("bow", 1.8, 3.0),
                     belly=1.9,
                 rake=kit.uniform("rake", 0.08, 0.25), rise=0.6, bulwark=0.12, deck=wood(kit.rng),
                     trim=trim)
    decks, z = kit.choose("decks", 1, 2, 2, 3), hull.deck_at(0)
    back, front, half = -kit.uniform("house_back", 0.45, 0.8) * long, kit.uniform("house_front",
        0.15, 0.55) * long, beam * kit.uniform("house", 0.7, 0.88)
    tall = depth * kit.uniform("storey", 0.45, 0.75)
    lean = kit.uniform("lean", 0.2, 1.6) * tall
    for _ in range(decks):
        half = min(half, hull.half_width(front - 0.1 * long) * 0.95)
        add_house(kit, skin, back, front, half, z - 0.03 * depth, z + tall, nose=0.5 * half,
                  lean=(lean, 0.1 * tall), inset=0.12, glass=(0.35, 0.82))
        over = 0.12 * (front - back) * kit.rng.uniform(0.3, 1.6)
        kit.add(skin, solids.stack([(house_outline(back - over, front - lean * 0.85, half * 0.98,
            0.5 * half), z + 0.93 * tall), (house_outline(back - over, front - lean * 0.85,
                half * 0.98, 0.5 * half), z + 1.06 * tall)]))
        kit.both(CHROME, rod((back - over * 0.9, half * 0.9, z),
                             (back - over * 0.9, half * 0.9, z + tall), 0.01 * long, 6))
        z, back, front, half = z + 1.05 * tall, back + 0.18 * long * kit.rng.uniform(0.3,
            1.2), front - lean - 0.12 * long * kit.rng.uniform(0.4, 1.3), half * 0.86
        if front - back < 0.25 * long:
            break
    top = kit.choose("top", "mast", "arch", "flybridge")
    if top == "arch":
        bow = [(back, -half, z - 0.1), (back + 0.1 * long, -half * 0.8, z + 0.8 * tall),
               (back + 0.1 * long, half * 0.8, z + 0.8 * tall), (back, half, z - 0.1)]
        kit.add(skin, tube(bow, 0.03 * long, 6))
        kit.add(WHITE, ball(0.1 * beam + 0.3, 0.1 * beam + 0.3, 0.4, 12).at(back + 0.1 * long, 0,
                                                                            z + 0.9 * tall))
    elif top == "mast":
        add_mast(kit, CHROME, (back + front) / 2, z - 0.1, depth * 1.1, 0.015 * long)
        kit.add(WHITE, box(0.02 * long, 0.12 * long, 0.02 * long).at((back + front) / 2, 0,
                                                                     z + 0.7 * depth))
    else:
        grid = np.array([[(front - 0.04 * long - 0.05 * long * t - 0.06 * long * y**2, half * y,
                           z - 0.02 + 0.35 * tall * t) for y in np.linspace(-1, 1, 7)]
                         for t in (0, 1)])
        kit.add(DARK_GLASS, pane(grid, 0.004 * long))
        kit.both(fabric(kit.rng), pillow(0.1 * long, half * 0.6, 0.35 * tall, 0.02 * long,
                                         2).at((back + front) / 2, half * 0.45, z + 0.12 * tall))
    kit.both(DARK_GLASS, *(ball(0.09 * long, 0.02 * beam, 0.18 * depth, 12).at(x * long,
        hull.half_width(x * long) * 0.85, depth * 0.68) for x in (-0.3, 0.0, 0.3)))
    add_railing(kit, hull, -0.1 * long, 0.25 * depth)


def catamaran(kit: Kit, skin: Material, trim: Material) -> None:
    """Catamarans and trimarans, with sails or engines."""
    long = kit.uniform("half_length", 3.5, 12)
    apart, slim = long * kit.uniform("apart", 0.38, 0.55), long * kit.uniform("slim", 0.07, 0.12)
    depth = long * kit.uniform("freeboard", 0.18, 0.26)
    tri, small = kit.chance("trimaran", 0.3), kit.chance("beach", 0.3)
    rake = kit.uniform("rake", -0.06, 0.1)
    for y in (-apart, apart):
        make_hull(kit, skin, long * (0.7 if tri else 1), slim * (0.7 if tri else 1),
                  depth * (0.7 if tri else 1), sheer=0.1, stern=0.6 if not tri else 0.0, bow=2.0,
                  belly=2.2, rake=rake, rise=0.6, aft_rise=0.4, bulwark=0.02, trim=trim, y=y)
    if tri:
        make_hull(kit, skin, long, slim * 1.6, depth, sheer=0.2, stern=0.5, bow=2.0, belly=2.2,
                  rake=0.08, rise=0.6, bulwark=0.05, trim=trim)
        for x in (0.3, -0.25):
            kit.both(skin, tube(smooth_path([(x * long, 0, depth * 0.85),
                (x * long, apart * 0.5, depth * 1.05), (x * long, apart, depth * 0.62)], 4),
                                0.035 * long, 8))
    else:
        kit.add(fabric(kit.rng) if small else skin,
                box(1.1 * long, 2 * apart, 0.12 * depth if not small else 0.02 * long,
                    0.02).at(-0.15 * long, 0, depth * 0.93))
        kit.add(CHROME, rod((0.85 * long, -apart, depth * 0.97),
                            (0.85 * long, apart, depth * 0.97), 0.015 * long))
        kit.add(trim, box(0.6 * long, 0.02 * long + 1.2 * apart, 0.01 * long).at(0.55 * long, 0,
                                                                                 depth * 0.95))
    top = depth * 1.0
    if not small and not tri:
        high = depth * kit.uniform("house", 0.55, 1.0)
        add_house(kit, skin, -0.55 * long, 0.28 * long,
                  apart * kit.uniform("house_width", 0.7, 1.05), top - 0.05, top + high,
                  nose=0.25 * long, lean=(0.25 * long * kit.rng.uniform(0.4, 1.2), 0), inset=0.15)
        kit.add(skin, box(0.7 * long, 1.5 * apart, 0.06 * depth, 0.02).at(-0.4 * long, 0,
                                                                          top + high))
    if kit.chance("sail", 0.7) or small or tri:
        mast, high = 0.15 * long, long * kit.uniform("mast", 1.7, 2.5)
        add_mast(kit, CHROME, mast, top * 0.9, high, 0.014 * long)
        boom = top + (0.3 if small or tri else 0.85) * depth + 0.05 * long
        kit.add(CHROME, rod((mast, 0, boom), (-0.7 * long, 0, boom), 0.011 * long))
        wind = kit.uniform("wind", 0.05, 0.18) * long
        if kit.chance("sails_up", 0.8):
            add_sail(kit, WHITE, [(mast - 0.02 * long, 0, boom), (-0.68 * long, 0.05 * long, boom),
                                  (mast - 0.01, 0, top + 0.88 * high)], wind, 0.18)
            add_sail(kit, trim if kit.rng.random() < 0.3 else WHITE,
                     [(0.85 * long, 0, top), (mast, 0.1 * long, top + 0.1 * high),
                      (mast + 0.03 * long, 0, top + 0.78 * high)], wind)
        kit.both(ROPE, rod((mast, 0, top + 0.8 * high),
                           (mast - 0.1 * long, apart, depth * (0.7 if tri else 1)), 0.004 * long,
                           5))
    else:
        add_mast(kit, CHROME, -0.2 * long, top, depth * 1.9, 0.012 * long)

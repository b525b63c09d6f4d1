"""Ships, submarines, hovercraft. Lengths in metres, the bow toward +x."""

import numpy as np

from data_gen.catalogues import bodies, solids
from data_gen.catalogues.bodies import body
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    DARK_GLASS,
    LIGHT,
    WHITE,
    Kit,
    around,
    fabric,
    paint,
    pick,
    shade_of,
    wood,
)
from data_gen.catalogues.families.watercraft_parts import (
    GREY,
    HULLS,
    ROPE,
    add_funnel,
    add_house,
    add_mast,
    add_railing,
    add_turret,
    house_outline,
    make_hull,
)
from data_gen.catalogues.solids import ball, box, cylinder, lathe, loft, pillow, rod, tube
from data_gen.mesh import Material

# fmt: off
# Formatted by hand: the formatter would put every coordinate on a line of its own.

def _bridge(kit: Kit, x: float, long: float, beam: float, z: float, tower: float,
            funnel: Material) -> None:
    """The superstructure of a merchant ship: bridge with wings, and funnel."""
    add_house(kit, WHITE, x - long, x + long, beam * 0.82, z, z + tower * 0.85, inset=0.02,
              glass=None)
    for k in range(1, 5):
        level = z + 0.85 * tower * k / 5
        kit.add(DARK_GLASS, box(2.02 * long, beam * 1.4, 0.05 * tower).at(x, 0, level))
    add_house(kit, WHITE, x - 0.5 * long, x + 1.1 * long, beam * 0.98, z + tower * 0.85, z + tower,
              inset=-0.02, glass=(0.4, 0.85))
    add_mast(kit, WHITE, x, z + tower, 0.35 * tower, 0.06 * long)
    add_funnel(kit, WHITE, funnel, x - 1.7 * long, 0, z, tower * 0.8, 0.32 * long, 0.0)


def submarine(kit: Kit, skin: Material, trim: Material) -> None:
    """Submarines: a round hull with a sail, or an old one with a deck and a gun."""
    long = kit.uniform("half_length", 25, 80)
    r = long * kit.uniform("radius", 0.075, 0.12)
    old = kit.chance("old", 0.4)
    dark = Material(shade_of((0.2, 0.22, 0.24), kit.rng, 0.3), (0.2,) * 3, 20.0,
                    name="dark hull") if kit.rng.random() < 0.7 else skin
    if old:
        hull = make_hull(kit, dark, long, r * 1.0, r * 1.9, sheer=0.1, stern=0.0, bow=2.4,
                         belly=2.6, rake=0.06, rise=0.45, aft_rise=0.5, bulwark=0.01)
        top = hull.deck_at(0)
        kit.both(dark, body([(0.6 * long, 0.1, 0.1, r), (0.4 * long, r * 0.5, r * 0.6, r),
                             (-0.4 * long, r * 0.5, r * 0.6, r), (-0.7 * long, 0.1, 0.1, r)]).at(0,
                                 r * 0.7, 0))
        kit.add(BLACK, rod((0.25 * long, 0, top), (0.25 * long, 0, top + 0.5 * r), 0.2 * r),
                rod((0.25 * long, 0, top + 0.5 * r), (0.36 * long, 0, top + 0.7 * r), 0.08 * r))
        kit.add(ROPE, rod((0.08 * long, 0, top + 1.5 * r),
                          (0.98 * long, 0, hull.deck_at(0.95 * long) + 0.1), 0.03 * r, 4))
    else:
        depth = kit.hide("keel_hollow", 0.02, 0.5)
        rings = []
        for t in np.linspace(-1, 1, 33):
            if t > 0.6:
                w = np.sqrt(max(1 - ((t - 0.6) / 0.4) ** 2, 0.0))
            else:
                w = 1.0 if t > -0.3 else max(1 - ((-0.3 - t) / 0.7) ** 1.7, 0.03)
            oval = solids.superellipse(2 * r * w, 2 * r * w, 2.0, 24)
            slot = np.repeat(oval, [2 if k in (17, 19) else 1 for k in range(24)], axis=0)
            slot[18:21, 1] += depth * r if abs(t) < 0.3 else 0
            rings.append(np.column_stack([np.full(len(slot), t * long), slot[:, 0],
                                          slot[:, 1] + r]))
        kit.add(dark, loft(np.array(rings)))
        top = 2 * r
        fins = kit.choose("tail", 90, 45)
        for angle in (0, 90, 180, 270):
            kit.add(dark, bodies.wing([(-0.8 * long, 0, 0.2 * r, 0.14 * long),
                                       (-0.84 * long, 0, 1.25 * r, 0.09 * long)], 0.1,
                                      fin=True).turned("x",
                                          angle + (45 if fins == 45 else 0)).at(0, 0, r))
        for angle in around(7):
            kit.add(trim, box(0.02 * long, 0.1 * r, 0.75 * r).turned("z", 35).at(0, 0,
                0.4 * r).turned("x", angle).at(-1.0 * long, 0, r))
        if kit.chance("missile_deck", 0.4):
            kit.add(dark, body([(0.05 * long, 0.1, 0.1, 1.9 * r),
                                (-0.02 * long, r * 0.7, r * 0.45, 1.85 * r),
                                (-0.4 * long, r * 0.7, r * 0.45, 1.85 * r),
                                (-0.62 * long, 0.1, 0.1, 1.6 * r)], 3.5))
    sail = kit.uniform("sail_place", -0.05, 0.4) * long
    tall = r * kit.uniform("sail", 0.9, 1.6)
    kit.add(dark, bodies.wing([(sail + 0.1 * long, 0, top - 0.3 * r, 0.24 * long, 0.3),
                               (sail + 0.09 * long, 0, top + tall, 0.2 * long, 0.26)], fin=True))
    if kit.chance("sail_planes", 0.5):
        kit.both(dark, bodies.wing([(sail + 0.06 * long, 0, top + 0.5 * tall, 0.07 * long),
                                    (sail + 0.04 * long, 1.2 * r, top + 0.5 * tall, 0.05 * long)],
                                   0.12))
    for k in range(kit.choose("masts", 1, 3)):
        x = sail + (0.04 - 0.035 * k) * long
        kit.add(CHROME, rod((x, 0, top + tall), (x, 0, top + tall + r * kit.rng.uniform(0.4, 1.2)),
                            0.07 * r))


def hovercraft(kit: Kit, skin: Material, trim: Material) -> None:
    """Hovercraft: a skirt, a cabin and fans."""
    long = kit.uniform("half_length", 3, 14)
    beam, skirt = long * kit.uniform("beam", 0.42, 0.6), long * kit.uniform("skirt", 0.12, 0.2)
    rubber = Material((0.14, 0.14, 0.15), name="skirt")
    depth = kit.hide("keel_hollow", 0.02, 0.5)

    def edge(grow: float) -> np.ndarray:
        outline = solids.rounded(2 * (long + grow), 2 * (beam + grow), 0.7 * beam, 6)
        return outline * np.where(outline[:, :1] > 0, [1.0, 1.0], [1.0, 1.0])

    kit.add(rubber, solids.stack([(edge(-0.5 * skirt), depth * skirt), (edge(-0.5 * skirt), 0.0),
                                  (edge(-0.2 * skirt), 0.0), (edge(0.1 * skirt), 0.35 * skirt),
                                  (edge(0.12 * skirt), 0.7 * skirt), (edge(-0.05 * skirt), skirt)]))
    kit.add(skin, solids.stack([(edge(-0.02 * skirt), skirt), (edge(-0.02 * skirt), 1.25 * skirt),
                                (edge(-0.25 * skirt), 1.4 * skirt)]))
    z, high = 1.35 * skirt, long * kit.uniform("house", 0.16, 0.3)
    add_house(kit, skin, -kit.uniform("house_back", 0.2, 0.6) * long, 0.6 * long,
              beam * kit.uniform("house_width", 0.5, 0.8), z, z + high, nose=0.15 * long,
              lean=(high * 0.9, 0.1 * high), inset=0.1)
    if long > 7:
        add_house(kit, skin, 0.1 * long, 0.36 * long, beam * 0.35, z + high, z + 1.5 * high,
                  lean=(0.3 * high, 0), nose=0.05 * long)
    fan = kit.uniform("fan", 0.2, 0.3) * long
    for y in (0.0,) if kit.chance("one_fan", 0.35) else (-0.48 * beam, 0.48 * beam):
        up = z + 1.08 * fan
        ring = lathe([(fan, 0.12 * long), (1.08 * fan, 0.06 * long), (1.03 * fan, -0.12 * long),
                      (0.97 * fan, -0.12 * long)], 24, loop=True)
        kit.add(trim, ring.turned("y", 90).at(-0.78 * long, y, up))
        for angle in around(4, kit.rng.uniform(0, 90)):
            kit.add(BLACK, box(0.02 * long, 0.14 * fan, 0.95 * fan).turned("z",
                35).at(z=0.47 * fan).turned("x", angle).at(-0.78 * long, y, up))
        kit.add(BLACK, cylinder(0.2 * fan, 0.25 * long, 14).turned("y", 90).at(-0.72 * long, y,
            up), box(0.06 * long, 0.12 * fan, fan).at(-0.72 * long, y, up - 0.5 * fan))
        for dy in (-0.4, 0.4):
            kit.add(skin, box(0.14 * long, 0.03 * fan, 1.7 * fan).at(-0.98 * long, y + dy * fan,
                up), box(0.1 * long, 0.03 * fan, 0.3 * fan).at(-0.9 * long, y + dy * fan,
                                                               z + 0.1 * fan))


def cargo_ship(kit: Kit, skin: Material, trim: Material) -> None:
    """Container ships, tankers, bulk carriers, gas carriers, coasters."""
    load = kit.choose("load", "containers", "containers", "tanker", "bulk", "gas", "coaster",
                      "feeder")
    long = kit.uniform("half_length", 25, 45) if load in ("coaster",
        "feeder") else kit.uniform("half_length", 60, 170)
    beam, depth = long * kit.uniform("beam", 0.13, 0.19), long * kit.uniform("freeboard", 0.1,
        0.18) * (1.5 if load == "coaster" else 1)
    paint_ = Material(pick(kit.rng, HULLS), (0.2,) * 3, 30.0, name="hull")
    floor = Material(shade_of((0.42, 0.3, 0.26), kit.rng, 0.3), name="deck")
    hull = make_hull(kit, paint_, long, beam, depth, sheer=kit.uniform("sheer", 0.1, 0.45),
                     stern=0.75, bow=kit.uniform("bow", 4.0, 8.0), belly=4.5,
                     rake=kit.uniform("rake", 0.02, 0.08), rise=0.25,
                     aft_rise=0.5, aft_sheer=0.1, bulwark=0.06, deck=floor, trim=None)
    z = hull.deck_at(0)
    tower = kit.uniform("tower", 0.14, 0.26) * long
    place = kit.choose("bridge", -0.78, -0.78, -0.55, 0.55 if load == "feeder" else -0.8) * long
    _bridge(kit, place, 0.055 * long, beam, hull.deck_at(place) - 0.02 * depth, tower, trim)
    kit.add(paint_, ball(0.12 * long, 0.5 * beam, 0.5 * beam, 14).at(0.97 * long, 0,
                                                                     0.2 * depth + 0.25 * beam))
    low, high = (-0.62 * long, 0.82 * long) if place < -0.6 * long else (-0.4 * long,
        0.82 * long) if place < 0 else (-0.92 * long, 0.4 * long)
    if load in ("containers", "feeder"):
        colours = [paint(kit.rng) for _ in range(5)]
        bays, across = kit.choose("bays", 6, 8, 10), kit.choose("across", 4, 5, 6)
        pitch, wide = (high - low) / bays, 1.84 * beam / across
        tall = 0.028 * long * kit.uniform("container", 0.8, 1.3)
        most = kit.choose("most", 2, 4, 6)
        for i in range(bays):
            x = low + pitch * (i + 0.5)
            full = kit.rng.integers(1, most + 1)
            for j in range(across):
                y = (j - (across - 1) / 2) * wide
                levels = max(0, full - int(kit.rng.integers(0, 2)))
                if levels and abs(y) + wide / 2 < hull.half_width(x + pitch / 2) * 1.01:
                    cut = int(kit.rng.integers(1, levels + 1))
                    for start, end in ((0, cut), (cut, levels)):
                        if end > start:
                            kit.add(pick(kit.rng, colours),
                                    box(0.93 * pitch, 0.95 * wide, (end - start) * tall).at(x, y,
                                        z + (start + end) / 2 * tall))
    elif load == "tanker":
        for y in (-0.25, 0, 0.25):
            kit.add(trim, rod((low, y * beam, z + 0.08 * depth),
                              (high, y * beam, z + 0.08 * depth), 0.025 * beam, 6))
        for x in np.linspace(low, high, 7)[1:-1]:
            kit.add(trim, box(0.02 * long, 1.3 * beam, 0.12 * depth).at(x, 0, z + 0.06 * depth),
                    cylinder(0.1 * beam, 0.2 * depth, 12).at(x + 0.07 * long, 0.5 * beam, z))
        for x in ((low + high) / 2,):
            kit.both(WHITE, rod((x, 0.5 * beam, z), (x, 0.5 * beam, z + 0.9 * depth), 0.04 * beam),
                     rod((x, 0.5 * beam, z + 0.7 * depth),
                         (x + 0.14 * long, 0.5 * beam, z + 0.9 * depth), 0.025 * beam))
    elif load == "gas":
        count = kit.choose("tanks", 3, 4, 5)
        size = min((high - low) / count * 0.94, 2.2 * beam)
        for x in low + (np.arange(count) + 0.5) * (high - low) / count:
            kit.add(trim, ball(size, min(size, 2 * beam), size, 22).at(x, 0, z + 0.1 * size))
    else:
        holds, crane = kit.choose("holds", 4, 5, 7), kit.chance("cranes", 0.6)
        pitch = (high - low) / holds
        for k in range(holds):
            x = low + pitch * (k + 0.5)
            kit.add(trim, box(0.68 * pitch, 1.35 * beam, 0.16 * depth, 0.02 * depth).at(x, 0,
                z + 0.06 * depth))
            if crane and k < holds - 1:
                at, up = x + 0.5 * pitch, kit.uniform("crane", 0.7, 1.1) * depth
                kit.add(WHITE, cylinder(0.12 * beam, up, 12).at(at, 0, z + up / 2),
                        box(0.25 * beam, 0.3 * beam, 0.25 * depth).at(at, 0, z + up),
                        rod((at, 0, z + up), (at + 0.9 * pitch, 0, z + 1.5 * up), 0.04 * beam))
    add_mast(kit, WHITE, 0.92 * long, hull.deck_at(0.92 * long), 0.6 * depth, 0.05 * beam)


def tug(kit: Kit, skin: Material, trim: Material) -> None:
    """Tugs and fishing boats: short and deep, with a high bow."""
    long = kit.uniform("half_length", 6, 16)
    beam, depth = long * kit.uniform("beam", 0.26, 0.4), long * kit.uniform("freeboard", 0.26, 0.4)
    paint_ = Material(pick(kit.rng, HULLS), (0.2,) * 3, 30.0,
                      name="hull") if kit.rng.random() < 0.6 else skin
    hull = make_hull(kit, paint_, long, beam, depth, sheer=kit.uniform("sheer", 0.35, 0.8),
                     stern=kit.uniform("stern", 0.55, 0.85), bow=kit.uniform("bow", 2.4, 4.0),
                     belly=2.4, rake=0.1, rise=0.4, aft_rise=0.5,
                     aft_sheer=0.25, bulwark=0.25, deck=wood(kit.rng), trim=BLACK)
    fishing = kit.chance("fishing", 0.5)
    x = kit.uniform("house_place", -0.5 if fishing else 0.0, 0.3) * long
    z, tall = hull.deck_at(x), depth * kit.uniform("storey", 0.55, 0.85)
    half = beam * kit.uniform("house", 0.5, 0.7)
    add_house(kit, WHITE, x - 0.32 * long, x + 0.22 * long, half, z - 0.05 * depth, z + tall,
              nose=0.3 * half, glass=(0.45, 0.75))
    add_house(kit, trim if kit.rng.random() < 0.5 else WHITE, x - 0.12 * long, x + 0.18 * long,
              half * 0.85, z + tall, z + 1.9 * tall, nose=0.4 * half, lean=(-0.05 * tall, 0),
              inset=-0.06, glass=(0.35, 0.85))
    kit.add(WHITE, box(0.4 * long, 1.9 * half, 0.08 * tall, 0.02).at(x + 0.02 * long, 0,
                                                                     z + 1.92 * tall))
    if fishing:
        far = -0.55 * long if x > -0.15 * long else 0.5 * long
        base = hull.deck_at(far)
        add_mast(kit, CHROME, far, base, 2.4 * depth, 0.02 * long)
        kit.add(CHROME, rod((far, 0, base + 0.5 * depth),
                            (far - np.sign(far) * 0.4 * long, 0, base + 2.0 * depth),
                            0.014 * long), rod((far, 0, base + 2.3 * depth),
                                (far - np.sign(far) * 0.4 * long, 0, base + 2.0 * depth),
                                               0.004 * long, 4))
        if kit.chance("outriggers", 0.5):
            kit.both(CHROME, rod((far, 0, base + 0.4 * depth),
                                 (far, 1.6 * beam, base + 2.4 * depth), 0.012 * long))
        kit.add(fabric(kit.rng), pillow(0.3 * long, 1.0 * beam, 0.3 * depth, 0.1 * depth,
                                        2).at(-0.75 * long, 0,
                                              hull.deck_at(-0.75 * long) + 0.15 * depth))
    else:
        add_funnel(kit, trim, BLACK, x - 0.22 * long, 0, z + tall, 1.1 * tall, 0.13 * beam + 0.2,
                   0.05 * long)
        kit.add(BLACK, cylinder(0.1 * beam, 0.5 * depth, 12).at(-0.55 * long, 0,
            hull.deck_at(-0.55 * long) + 0.2 * depth))
        rubber = hull.rail[hull.rail[:, 0] > 0.4 * long]
        kit.both(BLACK, tube(rubber * [1, 1.02, 0.96], 0.045 * long, 8))
    for tx in (-0.4, 0.0, 0.4):
        tyre = lathe([(0.04 * long, -0.02 * long), (0.07 * long, -0.02 * long),
                      (0.07 * long, 0.02 * long), (0.04 * long, 0.02 * long)], 14, loop=True)
        kit.both(BLACK, tyre.turned("x", 90).at(tx * long, hull.half_width(tx * long) * 1.02,
                                                0.72 * depth))
    add_mast(kit, CHROME, x, z + 1.9 * tall, 1.2 * depth, 0.014 * long)


def liner(kit: Kit, skin: Material, trim: Material) -> None:
    """Cruise ships, ferries, old liners, river boats with paddles."""
    form = kit.choose("form", "cruise", "ferry", "old", "paddle")
    long = kit.uniform("half_length", 20, 40) if form == "paddle" else kit.uniform("half_length",
                                                                                   45, 150)
    beam, depth = long * kit.uniform("beam", 0.13, 0.22), long * kit.uniform("freeboard", 0.1,
        0.17) * (0.6 if form == "paddle" else 1)
    dark = Material(pick(kit.rng, HULLS), (0.2,) * 3, 30.0, name="hull") if form in ("old",
        "ferry") else WHITE
    hull = make_hull(kit, dark, long, beam, depth, sheer=kit.uniform("sheer", 0.05, 0.35),
                     stern=0.3 if form == "old" else 0.85, bow=kit.uniform("bow", 2.6, 4.5),
                     belly=3.5, rake=kit.uniform("rake", 0.06, 0.16),
                     rise=0.3, aft_rise=0.3, bulwark=0.04, deck=wood(kit.rng))
    decks = kit.choose("decks", *{"cruise": (5, 7, 8), "ferry": (3, 4), "old": (3, 4),
                                  "paddle": (2, 3)}[form])
    tall = kit.uniform("storey", 0.026, 0.034) * long * {"paddle": 2.2, "ferry": 1.5}.get(form, 1.0)
    back, front = -0.92 * long, kit.uniform("house_front", 0.5, 0.72) * long
    z = hull.deck_at(0) - 0.02 * depth
    step = kit.uniform("step", 0.01, 0.06)
    half = min(hull.half_width(front - 0.12 * long), beam) * 0.97
    for _ in range(decks):
        add_house(kit, WHITE, back, front, half, z, z + 0.86 * tall, nose=0.3 * half, inset=0.0,
                  glass=(0.4, 0.75))
        kit.add(WHITE if form != "paddle" else trim,
                solids.stack([(house_outline(back - 0.01 * long, front, half * 1.04, 0.3 * half),
                               z + 0.86 * tall), (house_outline(back - 0.01 * long, front,
                                   half * 1.04, 0.3 * half), z + tall)]))
        if form == "paddle":
            for x in np.linspace(back, front - 0.3 * half, 7):
                kit.both(WHITE, rod((x, half * 1.02, z), (x, half * 1.02, z + tall), 0.006 * long,
                                    6))
            half *= 0.94
        z, back, front = z + tall, back + step * long * kit.rng.uniform(0.2,
            2), front - step * long * kit.rng.uniform(0.3, 1.6)
    if form in ("cruise", "ferry"):
        for x in np.linspace(-0.5, 0.4, kit.choose("lifeboats", 4, 6, 9)) * long:
            kit.both(Material((0.85, 0.45, 0.12), name="lifeboat"),
                     ball(0.07 * long, 0.03 * long, 0.03 * long, 12).at(x, half * 1.06,
                         hull.deck_at(0) + tall * (1.4 if form == "cruise" else 1.1)))
    count = {"old": kit.choose("funnels", 2, 3, 4), "paddle": 2}.get(form, 1)
    up = long * {"old": 0.17, "paddle": 0.28, "cruise": 0.1, "ferry": 0.1}[form]
    for k, x in enumerate(np.linspace(-0.35, 0.35, count) * long if count > 1
                          else [-kit.uniform("funnel_place", 0.1, 0.6) * long]):
        if form == "paddle":
            kit.both(BLACK, cylinder(0.03 * long, up, 14).at(0.3 * long, 0.45 * half,
                                                             z + up / 2)) if k == 0 else None
        else:
            add_funnel(kit, trim, WHITE if form != "old" else BLACK, x, 0, z, up,
                       0.022 * long if form == "old" else 0.035 * long, 0.03 * long)
    if form == "paddle":
        stern = kit.chance("stern_wheel", 0.5)
        size = depth * 1.1
        for y in (0,) if stern else (-beam * 1.1, beam * 1.1):
            x, wide = (-1.03 * long, 1.5 * beam) if stern else (-0.05 * long, 0.35 * beam)
            for angle in around(10):
                kit.add(trim, box(0.3 * size, wide, 0.05 * size).at(0.85 * size, 0, 0).turned("y",
                    angle).at(x, y, size))
            kit.add(trim, *(lathe([(0.92 * size, -0.04 * beam), (size, -0.04 * beam),
                                   (size, 0.04 * beam), (0.92 * size, 0.04 * beam)], 20,
                                  loop=True).turned("x", 90).at(x, y + s * wide / 2, size)
                            for s in (-1, 1)))
            if not stern:
                kit.add(WHITE, cylinder(1.12 * size, 0.06 * beam, 24).turned("x", 90).at(x,
                    y * 1.19, 1.15 * size))
        add_house(kit, WHITE, 0.32 * long, 0.44 * long, half * 0.45, z, z + tall, glass=(0.3, 0.8))
    else:
        add_mast(kit, WHITE, 0.3 * long if form != "old" else 0.75 * long,
                 z if form != "old" else hull.deck_at(0.7 * long),
                 0.14 * long if form != "old" else 0.35 * long, 0.006 * long)
        if form == "old":
            add_mast(kit, WHITE, -0.8 * long, hull.deck_at(-0.8 * long), 0.35 * long, 0.006 * long)


def warship(kit: Kit, skin: Material, trim: Material) -> None:
    """Destroyers, battleships, patrol boats, aircraft carriers, landing craft."""
    form = kit.choose("form", "destroyer", "battleship", "carrier", "patrol", "stealth", "landing")
    grey = Material(shade_of((0.48, 0.51, 0.54), kit.rng, 0.25), (0.1,) * 3, 20.0, name="grey")
    floor = Material(shade_of((0.32, 0.34, 0.36), kit.rng, 0.2), name="deck")
    long = {"patrol": 12.0, "landing": 12.0}.get(form, 70.0) * kit.uniform("size", 0.8, 1.4)
    slim = {"destroyer": 0.115, "battleship": 0.15, "carrier": 0.13, "patrol": 0.22,
            "stealth": 0.13, "landing": 0.26}[form]
    beam, depth = long * slim * kit.uniform("beam", 0.9,
                                            1.15), long * slim * kit.uniform("freeboard", 0.8,
                                                1.15) * (1.35 if form == "carrier" else 1)
    hull = make_hull(kit, grey, long, beam, depth,
                     sheer=kit.uniform("sheer", 0.1,
                                       0.5) * (0 if form in ("carrier", "landing") else 1),
                     stern=0.75, bow=2.2 if form not in ("carrier", "landing") else 5.0,
                 belly=2.6 if form != "stealth" else 1.3, rake=0.1 if form != "stealth" else -0.08,
                     rise=0.4, bulwark=0.03 if form != "landing" else 0.55, deck=floor)
    z = hull.deck_at(0)
    if form == "carrier":
        flare = kit.uniform("flight_deck", 1.5, 2.0)
        outline = np.array([(-1.02, 0.9), (-1.02, -0.9), (-0.3, -1.0), (0.35, -1.0), (0.75, -0.62),
                            (1.04, -0.55), (1.04, 0.5), (0.4, 0.75), (0.1, 1.35),
                            (-0.5, 1.35)]) * [long, beam * flare / 1.35]
        kit.add(floor, solids.stack([(outline * 0.97, z - 0.1 * depth), (outline, z + 0.1 * depth),
                                     (outline, z + 0.2 * depth)]))
        z += 0.2 * depth
        y, start = -beam * 0.95, kit.num_parts
        add_house(kit, grey, -0.1 * long, 0.2 * long, 0.2 * beam, z, z + 0.9 * depth,
                  glass=(0.6, 0.85))
        add_house(kit, grey, 0.0, 0.15 * long, 0.22 * beam, z + 0.9 * depth, z + 1.4 * depth,
                  glass=(0.4, 0.8))
        add_mast(kit, grey, 0.05 * long, z + 1.4 * depth, 1.0 * depth, 0.01 * long)
        kit.move_from(start, y)
        for _ in range(kit.choose("planes", 0, 4, 8)):
            px, py = kit.rng.uniform(-0.85, 0.7) * long, kit.rng.uniform(-0.1, 0.8) * beam
            size = 0.035 * long
            jet = body([(size, 0.02 * size, 0.02 * size, 0),
                        (0.4 * size, 0.13 * size, 0.13 * size, 0),
                        (-size, 0.1 * size, 0.1 * size, 0)], 2, 1, 8)
            kit.add(GREY, jet.at(px, py, z + 0.2 * size),
                    bodies.wing([(-0.9 * size, 0, 0, 0.3 * size),
                                 (-0.9 * size, 0, 0.6 * size, 0.15 * size)], 0.1,
                                fin=True).at(px + 0.5 * size, py, z + 0.2 * size),
                    *(bodies.wing([(0.3 * size, 0, 0, 0.9 * size),
                                   (-0.5 * size, s * 0.7 * size, 0, 0.2 * size)], 0.05).at(px, py,
                                       z + 0.2 * size) for s in (-1, 1)))
        return
    if form == "landing":
        add_house(kit, grey, -0.92 * long, -0.55 * long, 0.6 * beam, z, depth * 1.5,
                  glass=(0.6, 0.85))
        kit.add(grey, box(0.06 * long, 1.0 * beam, 1.1 * depth, 0.01 * long).turned("y",
            25).at(0.98 * long, 0, 0.75 * depth))
        crate = paint(kit.rng)
        for x in (-0.2, 0.3):
            if kit.rng.random() < 0.7:
                kit.add(crate, box(0.35 * long, 0.9 * beam, 0.6 * depth, 0.03).at(x * long, 0,
                    z + 0.3 * depth), box(0.15 * long, 0.7 * beam, 0.4 * depth,
                                          0.03).at((x - 0.05) * long, 0, z + 0.7 * depth))
        add_mast(kit, grey, -0.72 * long, 1.5 * depth, 0.8 * depth, 0.012 * long)
        return
    tall = depth * kit.uniform("storey", 0.4, 0.6)
    lean = 0.9 * tall if form == "stealth" else 0.15 * tall
    back, front, half = -kit.uniform("house_back", 0.3, 0.6) * long, kit.uniform("house_front",
        0.15, 0.35) * long, beam * 0.72
    for _ in range(kit.choose("levels", 2, 3, 4)):
        add_house(kit, grey, back, front, half, z - 0.03 * depth, z + tall, lean=(lean, lean),
                  inset=0.25 if form == "stealth" else 0.05, glass=None)
        z, back, front, half = z + tall, back + long * kit.rng.uniform(0.05,
            0.2), front - lean - 0.02 * long, half * 0.85
        if front - back < 0.12 * long:
            break
    back = min(back, front - 0.1 * long)
    add_house(kit, grey, front - 0.1 * long, front, half, z, z + tall, lean=(0.1 * tall, 0),
              inset=0.1, glass=(0.5, 0.8))
    tower = depth * kit.uniform("mast", 1.2, 2.6)
    if form in ("stealth", "destroyer") and kit.chance("pyramid", 0.5):
        kit.add(grey, solids.stack([(solids.superellipse(0.12 * long, 0.8 * half, 8, 16), 0.0),
                                    (solids.superellipse(0.04 * long, 0.3 * half, 8, 16),
                                     tower)]).at(front - 0.14 * long, 0, z))
    else:
        add_mast(kit, grey, front - 0.12 * long, z, tower, 0.012 * long)
        for t in (0.5, 0.75):
            kit.add(grey, box(0.015 * long, 1.3 * half * (1.2 - t),
                              0.015 * long).at(front - 0.12 * long, 0, z + t * tower))
        kit.both(grey, rod((front - 0.2 * long, 0.3 * half, z),
                           (front - 0.12 * long, 0, z + 0.7 * tower), 0.007 * long))
    if form != "stealth":
        for x in ((back + front) / 2 - 0.15 * long,
                  back - 0.02 * long)[: kit.choose("funnels", 1, 2)]:
            add_funnel(kit, grey, grey, x, 0, hull.deck_at(x), 2.2 * tall + 0.4 * depth,
                       0.17 * beam, 0.02 * long)
    size = beam * {"battleship": 0.62, "patrol": 0.3}.get(form, 0.4)
    barrels = kit.choose("barrels", 2, 3) if form == "battleship" else 1
    spots = [(0.62, 1, 0.0), (0.44, 1, 0.7), (-0.72, -1, 0.0)][: 3 if form == "battleship"
                                                               else kit.choose("turrets", 1, 2)]
    for x, aim, step in spots:
        base = hull.deck_at(x * long)
        if step and form == "battleship":
            kit.add(grey, cylinder(0.8 * size, step * size, 18).at(x * long, 0,
                                                                   base + step * size / 2))
            base += step * size
        add_turret(kit, grey, x * long, base, size, aim, barrels,
                   (2.6 if form == "battleship" else 2.0) * size)
    if form in ("destroyer", "stealth") and kit.chance("helipad", 0.6):
        kit.add(grey, box(0.2 * long, 1.4 * beam, 1.1 * tall, 0.02 * beam).at(-0.5 * long, 0,
            hull.deck_at(-0.5 * long) + 0.5 * tall))
        kit.add(WHITE, cylinder(0.5 * beam, 0.02 * depth, 20).at(-0.8 * long, 0,
            hull.deck_at(-0.8 * long) + 0.01 * depth))
    else:
        kit.both(grey, box(0.12 * long, 0.2 * beam, 0.25 * depth).turned("y", -15).at(-0.5 * long,
            0.55 * beam, hull.deck_at(-0.5 * long) + 0.2 * depth))
    add_railing(kit, hull, 0.3 * long, 0.14 * depth)
    kit.add(LIGHT, ball(0.02 * long, 0.02 * long, 0.02 * long, 8).at(front, 0, z + 1.05 * tall))

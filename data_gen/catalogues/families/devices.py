"""Monitors, speakers, cellphones and firearms. Fronts and muzzles point to +x."""
# fmt: off
# We format by hand, because the formatter would put each coordinate in a line.

import numpy as np

from data_gen.catalogues.families import materials as m
from data_gen.catalogues.families.kit import Kit
from data_gen.catalogues.shapes import (
    Solid,
    block,
    box,
    cylinder,
    lathe,
    loft,
    pillow,
    prism,
    rod,
    rounded,
    stack,
    tube,
    upright,
)
from data_gen.mesh import Material

MONITORS = ("flat", "flat", "flat", "crt", "wall", "television", "dual", "curved")


def _panel(kit: Kit, case: Material, wide: float, high: float, bend: float = 0.0) -> None:
    """A display with its middle at the origin and its front at x = 0; `bend` is its curvature."""
    rim, chin = kit.uniform(0.005, 0.035), kit.choose(0.0, 0.0, kit.uniform(0.01, 0.06))
    y = np.linspace(-0.5, 0.5, 25 if bend else 2)
    rear = -kit.uniform(0.012, 0.05)
    for material, inset, back, front in ((case, 0.0, rear, 0.0),
        (m.screen(kit.rng), rim, -0.004, 0.002)):
        low, top = inset - high / 2 + (chin if inset else 0), high / 2 - inset
        rings = [[(x + bend * s**2, s * (wide - 2 * inset), z) for x, z in
                  ((back, low), (front, low), (front, top), (back, top))] for s in y]
        kit.add(material, loft(rings))
    if not bend and kit.chance(0.5):
        kit.add(case, upright(rounded(0.6 * high, 0.6 * wide, 0.02), rear - 0.03, rear + 0.004,
                              0.003))


def monitor(kit: Kit, kind: str) -> None:
    """Displays of computers and televisions: flat, curved, with a tube; on a foot, legs, a wall."""
    case = kit.draw(m.plastic, m.plastic, m.plastic, m.metal)
    wide = kit.uniform(0.6, 1.5) if kind in ("wall", "television") else kit.uniform(0.38, 0.75)
    high = wide / kit.choose(1.25, 1.33, 1.6, 1.6, 1.78, 1.78, 2.3)
    if kind == "crt":
        wide = kit.uniform(0.35, 0.6)
        high, depth = wide * kit.uniform(0.75, 0.95), wide * kit.uniform(0.75, 1.1)
        shape, foot = rounded(high, wide, 0.02), kit.choose(0.0, kit.uniform(0.02, 0.08))
        levels = [(0.6, 0), (0.6, 0.3), (0.97, 0.7), (1, 0.8), (1, 1)]
        body = stack([(shape * kit.uniform(0.7, 1.1) ** (s < 0.9) * s, a * depth)
                      for s, a in levels])
        kit.add(case, Solid(body.vertices[:, [2, 1, 0]], body.faces[:, ::-1])
                .at(-depth, 0, high / 2 + foot))
        kit.add(m.screen(kit.rng), pillow(0.03, 0.84 * wide, 0.8 * high, 0.012)
                .at(-0.008, 0, 0.54 * high + foot))
        if foot:
            kit.add(case, lathe([(0.3, 0), (0.28, 0.02), (0.12, 0.03),
                                 (0.16, foot + 0.03)]).scaled(wide, wide, 1).at(-depth / 2))
        return
    _panel(kit, case, wide, high, kit.uniform(0.03, 0.2) * (kind == "curved"))
    if kind == "dual":
        angle = kit.uniform(0, 25)
        kit.parts = [(part.at(0, s * wide * 0.505).turned("z", -s * angle), material)
                     for s in (-1, 1) for part, material in kit.parts]
        kit.add(case, block((-0.07, -0.02), (-0.6 * wide, 0.6 * wide), (-0.03, 0.03)))
    elif kind == "wall":
        kit.add(case, block((-0.09, -0.01), (-0.15, 0.15), (-0.1, 0.1)),
                block((-0.1, -0.08), (-0.2, 0.2), (-0.13, 0.13)))
        return
    tilt, lift = kit.choose(0.0, kit.uniform(-12, 3)), high / 2 + kit.uniform(0.05, 0.18)
    kit.change(0, lambda part: part.turned("y", tilt).at(z=lift))
    stand = case if kit.chance(0.6) else kit.draw(m.metal, m.plastic)
    if kind == "television" and kit.chance(0.6):
        kit.both(stand, *(rod((-0.015, 0.33 * wide, lift - 0.48 * high), (x, 0.33 * wide, 0.006),
                              0.009) for x in (0.12, -0.14)))
        return
    foot = wide * kit.uniform(*(0.3, 0.6) if kind == "dual" else (0.2, 0.42))
    reach = kit.uniform(0.16, 0.26)
    style = kit.choose("disc", "rect", "vee")
    if style == "disc":
        kit.add(stand, lathe([(1, 0), (1, 0.008), (0.3, 0.018)], 32)
                .scaled(reach * 0.6, foot * 0.75, 1).at(-0.05))
    elif style == "rect":
        kit.add(stand, box(reach, foot, 0.016, 0.005).at(-0.05, 0, 0.008))
    else:
        kit.both(stand, rod((-0.1, 0, 0.012), (0.12, foot * 0.8, 0.012), 0.012))
    neck = kit.uniform(0.02, 0.1)
    kit.add(stand, block((-0.075, -0.05), (-neck, neck), (0.004, lift + 0.03), 0.004),
            block((-0.06, -0.005), (-0.06, 0.06), (lift - 0.06, lift + 0.05)))


SPEAKERS = ("box", "box", "tower", "tower", "subwoofer", "soundbar", "round", "pair",
            "stage", "stand")


def _cone(kit: Kit, ring: Material, radius: float, x: float, y: float, z: float) -> None:
    """A driver in a face perpendicular to x."""
    profile = [(0, -0.01), (1, -0.01), (1, 0.012), (0.9, 0.016), (0.35, -0.003), (0.3, 0.006),
               (0, 0.012)]
    edge = [(0.88, 0), (1.06, 0), (1.03, 0.016), (0.92, 0.018)]
    for material, points, loop in ((m.BLACK, profile, False), (ring, edge, True)):
        part = lathe([(r * radius, h) for r, h in points], 26, loop)
        kit.add(material, part.turned("y", 90).at(x, y, z))


def speaker(kit: Kit, kind: str) -> None:
    """Loudspeakers: boxes, towers, bars, cylinders, on stands, in pairs."""
    case, ring = kit.draw(m.wood, m.wood, m.plastic, m.lacquer), kit.draw(m.metal, m.plastic)
    cloth = kit.choose(m.BLACK, m.perforated(kit.rng), m.fabric(kit.rng))
    if kind == "round":
        radius, high, turn = kit.uniform(0.04, 0.1), kit.uniform(0.08, 0.45), kit.choose(*"zzx")
        end = radius * kit.uniform(0.8, 1.1)
        points = [(radius, 0.01), (radius * kit.uniform(0.75, 1.25), 0.5 * high),
                  (end, 0.97 * high)]
        kit.add(cloth, lathe(points, 32, smooth=6))
        kit.add(case, cylinder(end * 1.02, 0.02, 32).at(z=high),
                cylinder(radius * 1.04, 0.02, 32).at(z=0.01))
        kit.change(0, lambda part: part.turned(turn, 90))
        return
    wide, high, depth = kit.uniform(0.15, 0.3), kit.uniform(0.25, 0.45), kit.uniform(0.15, 0.32)
    if kind == "tower":
        high, depth = kit.uniform(0.8, 1.3), kit.uniform(0.2, 0.42)
    elif kind in ("subwoofer", "stage"):
        wide = kit.uniform(0.3, 0.6)
        high = wide * kit.uniform(0.85, 1.15 if kind == "subwoofer" else 1.9)
        depth = wide * kit.uniform(0.8, 1.1)
    elif kind == "soundbar":
        wide, high, depth = kit.uniform(0.4, 1.2), kit.uniform(0.06, 0.2), kit.uniform(0.07, 0.16)
    shape = rounded(high, wide, kit.choose(0.004, 0.016, 0.06))
    rear = kit.choose(1.0, 1.0, 1.0, kit.uniform(0.55, 0.9))
    body = stack([(shape * [1, rear], -depth), (shape, -0.35 * depth), (shape, 0.0)])
    kit.add(case, Solid(body.vertices[:, [2, 1, 0]], body.faces[:, ::-1]).at(z=high / 2))
    if kit.chance(0.3):
        kit.add(cloth, block((-0.012, 0.012), (-0.46 * wide, 0.46 * wide),
                             (0.04 * high, 0.96 * high), 0.006))
    elif kind == "soundbar":
        for y in np.linspace(-0.38, 0.38, kit.choose(2, 2, 3, 4)) * wide:
            _cone(kit, ring, min(0.4 * high, 0.1 * wide), 0, y, 0.5 * high)
    else:
        count = {"subwoofer": 1, "tower": kit.choose(2, 3, 4)}.get(kind, kit.choose(1, 2, 2, 3))
        z = 0.06 * high
        for k in range(count):
            room = (0.96 * high - z) / (count - k)
            _cone(kit, ring, min(0.42 * wide, 0.46 * room) * kit.uniform(0.6, 1), 0, 0,
                  z + room / 2)
            z += room
    if kind == "tower" and kit.chance(0.6):
        kit.add(ring, block((-depth * 1.02, 0.03), (-0.6 * wide, 0.6 * wide), (-0.04, 0.002),
                            0.006))
    elif kind == "stand":
        lift = kit.uniform(0.5, 0.9)
        kit.change(0, lambda part: part.at(z=lift))
        kit.add(ring, cylinder(0.03, lift, 14).at(-depth / 2, 0, lift / 2 + 0.003),
                block((-depth, 0.02), (-0.6 * wide, 0.6 * wide), (0, 0.025)))
    elif kind == "pair":
        gap = wide * kit.uniform(0.55, 1.3)
        kit.parts = [(part.at(y=s * gap), material)
                     for s in (-1, 1) for part, material in kit.parts]


CELLPHONES = ("slab", "slab", "slab", "bar", "bar", "flip", "slider", "brick", "keyboard")


def cellphone(kit: Kit, kind: str) -> None:
    """Telephones: slabs with a touch screen, with keys, folding, sliding, with an antenna."""
    case = kit.draw(m.plastic, m.plastic, m.metal)
    if kit.chance(0.15):
        case = m.plain(m.lively(kit.rng), 0.3)
    keys = kit.choose(m.BLACK, m.WHITE, kit.draw(m.plastic))
    slab = kind == "slab"
    if slab:
        high = kit.uniform(0.12, 0.165)
        wide, thick = high * kit.uniform(0.46, 0.55), kit.uniform(0.006, 0.011)
    else:
        high = kit.uniform(0.09, 0.135) * (1.4 if kind == "brick" else 1)
        wide = high * (kit.uniform(0.36, 0.5) + 0.15 * (kind == "keyboard"))
        thick = kit.uniform(0.012, 0.022) * (1.8 if kind == "brick" else 1)
    radius, border = kit.uniform(0.05, 0.25) * wide, kit.uniform(0.02, 0.08) * wide
    picture = m.screen(kit.rng)

    def body(tall: float, back: float, front: float) -> None:
        kit.add(case, upright(rounded(tall, wide, radius, 4), back, front, 0.2 * (front - back)))

    def face(low: float, top: float, x: float) -> None:
        outline = rounded(top - low, wide - 2 * border, 0.15 * radius + 0.002, 2)
        kit.add(m.DARK_GLASS, upright(outline, x - 0.002, x + 0.0006).at(z=(top + low) / 2))
        y = wide / 2 - 1.6 * border
        kit.add(picture, block((x - 0.001, x + 0.0011), (-y, y), (low + border, top - border)))

    def pad(low: float, top: float, x: float, columns: int, rows: int) -> None:
        w, h = (wide - 2.4 * border) / columns, (top - low) / rows
        key = upright(rounded(0.7 * h, 0.78 * w, 0.002, 1), x - 0.002, x + 0.002)
        kit.add(keys, *(key.at(0, (i + 0.5 - columns / 2) * w,
                               low + (j + 0.5) * h) for i in range(columns) for j in range(rows)))

    if slab:
        body(high, -thick / 2, thick / 2)
        end = kit.uniform(0.03, 0.14) * high
        face(end - high / 2, high / 2 - kit.choose(end, border), thick / 2)
        for y in kit.choose((0.0,), (-0.3,), (-0.25, 0.25)):
            kit.add(m.BLACK, cylinder(0.1 * wide, 0.004, 18).turned("y", 90)
                    .at(-thick / 2, y * wide, 0.36 * high))
    elif kind in ("flip", "slider"):
        part = high * (0.55 if kind == "flip" else 0.85)
        body(part, -thick / 2, 0)
        pad(-0.46 * part, (0.2 if kind == "flip" else -0.02) * part, 0, 3, 4)
        start = len(kit.parts)
        body(part, 0, thick / 2)
        face(-0.36 * part, 0.39 * part, thick / 2)
        shift, bend = kit.uniform(0.35, 0.5) * part, kit.uniform(5, 70)
        if kind == "slider":
            kit.change(start, lambda p: p.at(z=shift))
        else:
            kit.change(start, lambda p: p.at(-thick / 2, 0, part / 2).turned("y", bend)
                       .at(0, 0, part / 2))
            kit.add(case, cylinder(0.55 * thick, 0.9 * wide, 14).turned("x", 90)
                    .at(-0.1 * thick, 0, part / 2))
    else:
        body(high, -thick / 2, thick / 2)
        split = kit.uniform(-0.1, 0.12) * high
        face(split, high / 2 - kit.uniform(0.06, 0.14) * high, thick / 2)
        middle = split - kit.choose(0.01, 0.16) * high
        pad(-0.46 * high, middle, thick / 2, 8 if kind == "keyboard" else 3, 4)
        if kind == "brick" or kit.chance(0.25):
            long = kit.uniform(0.1, 0.6) * high if kind == "brick" else 0.12 * high
            kit.add(m.BLACK, cylinder(0.09 * wide, long, 12, 0.002).at(0, 0.33 * wide,
                high / 2 + long / 2 - 0.004))
    pose = kit.choose("standing", "standing", "standing", "lying", "sideways")
    if pose == "lying":
        kit.change(0, lambda p: p.turned("y", -90).scaled(-1, -1, 1))
    elif pose == "sideways":
        kit.change(0, lambda p: p.turned("x", 90))


FIREARMS = ("pistol", "pistol", "revolver", "rifle", "rifle", "assault", "assault", "submachine",
            "shotgun", "sniper", "machinegun")


def _pipe(x: tuple[float, float], z: float, radius: float) -> Solid:
    """A barrel with a bore at its muzzle."""
    profile = [(radius, x[0]), (radius, x[1]), (radius / 2, x[1]), (radius / 2, x[1] - 2 * radius),
               (0, x[1] - 2 * radius)]
    return lathe(profile, 14).turned("y", 90).at(z=z)


def _grip(x: float, z: float, size: float, long: float, lean: float, thick: float) -> Solid:
    """A pistol grip below (x, z)."""
    low = x - lean * long
    return prism([(x + 0.5 * size, z), (low + 0.52 * size, z - 0.6 * long),
                  (low + 0.55 * size, z - long),
                  (low - 0.6 * size, z - long), (low - 0.5 * size, z - 0.5 * long),
                  (x - 0.5 * size, z)], thick, 0.005)


def _guard(kit: Kit, steel: Material, x: float, z: float) -> None:
    """A trigger and its guard below (x, z)."""
    path = [(x + 0.022, 0, z + 0.003), (x + 0.022, 0, z - 0.014), (x, 0, z - 0.022),
            (x - 0.022, 0, z - 0.012), (x - 0.022, 0, z + 0.003)]
    kit.add(steel, tube(path, 0.0025), rod((x, 0, z + 0.003), (x + 0.006, 0, z - 0.014), 0.0025))


def firearm(kit: Kit, kind: str) -> None:
    """Hand guns, rifles, shotguns, machine guns, along x with the muzzle first."""
    steel, long, lean = m.steel(kit.rng), kit.uniform(0.1, 0.2), kit.uniform(0.1, 0.35)
    wooden = kind in ("rifle", "shotgun", "revolver", "sniper") and kit.chance(0.7)
    hold = m.wood(kit.rng) if wooden else kit.draw(m.plastic, m.steel, m.steel)
    size, grip, thick = kit.uniform(0.035, 0.05), kit.uniform(0.08, 0.12), kit.uniform(0.022, 0.03)
    if kind == "pistol":
        high = kit.uniform(0.024, 0.034)
        kit.add(steel, prism([(-0.03, 0), (long, 0), (long, 0.6 * high), (long - 0.01, high),
                              (-0.03, high), (-0.035, 0.6 * high)], thick, 0.003),
                _pipe((long - 0.02, long + kit.choose(0.004, 0.004, 0.15)), 0.5 * high,
                      0.35 * thick),
                block((long - 0.012, long - 0.005), (-0.002, 0.002), (high - 0.002, high + 0.005)))
        kit.add(hold, prism([(-0.02, 0.003), (0.95 * long, 0.003), (0.95 * long, -0.016),
                             (-0.02, -0.016)], 0.85 * thick, 0.002),
                _grip(0.0, 0.0, size, grip, lean, 0.9 * thick))
        _guard(kit, hold, 0.042, -0.012)
        return
    if kind == "revolver":
        kit.add(steel, _pipe((0.03, 0.05 + long), 0.014, kit.uniform(0.008, 0.012)),
                cylinder(kit.uniform(0.018, 0.024), 0.042, 18, 0.004).turned("y", 90)
                .at(0.03, 0, 0.004),
                prism([(-0.02, -0.03), (0.06, -0.026), (0.06, 0.026), (0.0, 0.028), (-0.035, 0.03),
                       (-0.025, 0.01)], 0.014, 0.002),
                block((0.055, 0.05 + 0.7 * long), (-0.004, 0.004), (-0.003, 0.008)),
                block((0.035 + long, 0.048 + long), (-0.002, 0.002), (0.018, 0.032)))
        kit.add(hold, _grip(-0.015, -0.01, size, grip, lean + 0.2, 0.028))
        _guard(kit, steel, 0.02, -0.025)
        return
    # Long arms: a receiver around the origin, a stock behind it, a barrel in front.
    length = {"submachine": (0.15, 0.3), "machinegun": (0.45, 0.65), "sniper": (0.5, 0.75)}
    rear, front, stock = -kit.uniform(0.08, 0.16), kit.uniform(0.08, 0.16), kit.uniform(0.2, 0.32)
    end = front + kit.uniform(*length.get(kind, (0.35, 0.6)))
    high, thick = (0.042, 0.036) if wooden else (kit.uniform(0.05, 0.075), kit.uniform(0.03, 0.042))
    top, axis = high / 2, kit.uniform(0.0, 0.3) * high
    radius, drop = kit.uniform(0.008, 0.013), kit.uniform(0.0, 0.06)
    kit.add(steel, block((rear, front), (-thick / 2, thick / 2), (-top, top), 0.006),
            _pipe((front - 0.02, end), axis, radius))
    if kind == "shotgun":
        kit.add(steel, _pipe((front - 0.02, end - 0.05), axis - 2 * radius, radius))
    elif kit.chance(0.5):
        muzzle = cylinder(radius * 1.7, 0.06, 14, 0.003).turned("y", 90)
        kit.add(steel, muzzle.at(end - 0.025, 0, axis))
    if kit.chance(0.6):
        kit.add(steel, prism([(end - 0.06, axis), (end - 0.03, axis), (end - 0.035, axis + 0.05),
                              (end - 0.045, axis + 0.05)], 0.006))
    cover, under = front + kit.uniform(0.35, 0.75) * (end - front), axis - kit.uniform(0.022, 0.04)
    kit.add(hold, prism([(front - 0.02, under), (cover, 0.6 * under + 0.4 * axis),
                         (cover, axis + 0.5 * radius),
                         (front - 0.02, axis + kit.choose(0.6 * radius, 0.02))], thick * 0.95,
                         0.005))
    style = "solid" if kind != "submachine" else kit.choose("solid", "wire", "none")
    if wooden:
        kit.add(hold, prism([(front, -top - 0.004), (front, 0), (rear, 0.4 * top),
                             (rear - 0.06, -0.2 * top - 0.3 * drop),
                             (rear - stock, 0.3 * top - drop),
                             (rear - stock - 0.005, -top - 0.09 - drop),
                             (rear - 0.06, -top - 0.035)], thick, 0.008))
    elif style == "solid":
        kit.add(hold, prism([(rear + 0.02, -0.6 * top), (rear + 0.02, 0.8 * top),
                             (rear - stock, 0.7 * top - 0.4 * drop),
                             (rear - stock, -top - 0.07), (rear - 0.8 * stock, -top - 0.07),
                             (rear - 0.3 * stock, -0.8 * top)], 0.8 * thick, 0.006))
    elif style == "wire":
        kit.add(steel, tube([(rear + 0.01, 0, 0.5 * top), (rear - stock, 0, 0.4 * top),
                             (rear - stock, 0, -top - 0.07), (rear + 0.01, 0, -0.4 * top)], 0.006))
    place = rear + 0.05
    if not wooden:
        kit.add(hold, _grip(place, -top + 0.005, 0.034, 0.1, lean, 0.8 * thick))
    _guard(kit, steel, place + 0.05, -top)
    if kind in ("assault", "submachine", "machinegun", "sniper"):
        x, deep = front - 0.03, kit.uniform(0.05, 0.2)
        t, bend = np.linspace(0, 1, 6), kit.choose(0.0, 0.0, kit.uniform(0.02, 0.08))
        half = kit.uniform(0.012, 0.03)
        curve = np.stack([x + bend * t**2, 0.005 - top - deep * t], axis=1)
        kit.add(steel, prism(np.concatenate([curve - [half, 0], curve[::-1] + [half, 0]]),
                             0.6 * thick))
    scope = kit.uniform(0.15, 0.32)
    if kind == "sniper" or kit.chance(0.25):
        profile = [(0.022, 0), (0.014, 0.25), (0.014, 0.65), (0.025, 0.85), (0.025, 1)]
        kit.add(steel, lathe([(r, z * scope) for r, z in profile], 18).turned("y", 90)
                .at(-scope / 2, 0, top + 0.04),
                *(block((s * 0.2 * scope - 0.01, s * 0.2 * scope + 0.01), (-0.008, 0.008),
                        (top - 0.005, top + 0.035)) for s in (-1, 1)))
    elif kind == "assault" and kit.chance(0.5):
        path = [(rear + 0.04, 0, top - 0.003), (rear + 0.05, 0, top + 0.03),
                (front - 0.05, 0, top + 0.035), (front - 0.03, 0, top - 0.003)]
        kit.add(steel, tube(path, 0.008))
    if kind == "machinegun" or (kind == "sniper" and kit.chance(0.6)):
        x = front + kit.uniform(0.5, 0.9) * (end - front)
        kit.both(steel, rod((x, 0.005, axis - 0.5 * radius), (x + 0.04, 0.09, axis - 0.22), 0.006))

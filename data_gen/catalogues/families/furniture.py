"""Tables, cabinets and lamps. Lengths in metres, the front toward +x."""
# fmt: off
# We format by hand, because the formatter would put each coordinate in a line.

import numpy as np

from data_gen.catalogues.families import materials as m
from data_gen.catalogues.families.kit import Kit, column, four_legs, fronts
from data_gen.catalogues.shapes import (
    ball,
    block,
    box,
    cylinder,
    lathe,
    rod,
    rounded,
    smooth_path,
    stack,
    superellipse,
    tube,
)
from data_gen.mesh import Material

TABLES = ("dining", "dining", "coffee", "coffee", "desk", "desk", "round", "pedestal", "trestle",
          "side", "console", "cross", "cube", "conference")

_TABLES = {
    # Ranges of depth, width / depth, height.
    "coffee": ((0.5, 0.9), (1.0, 2.2), (0.3, 0.5)), "side": ((0.35, 0.6), (0.8, 1.3), (0.4, 0.75)),
    "cube": ((0.35, 0.6), (0.9, 1.6), (0.3, 0.7)),
    "console": ((0.25, 0.45), (2.2, 4.5), (0.75, 0.95)),
    "round": ((0.6, 1.5), (1.0, 1.0), (0.68, 0.8)),
    "pedestal": ((0.5, 1.5), (0.8, 1.5), (0.65, 1.05)),
    "conference": ((1.0, 1.6), (2.0, 3.0), (0.7, 0.8)),
}


def table(kit: Kit, kind: str) -> None:
    """Tables and desks: tops of several outlines on legs, panels, columns, trestles or crosses."""
    sizes = _TABLES.get(kind, ((0.55, 1.1), (1.1, 2.4), (0.68, 0.8)))
    depth, ratio, high = (kit.uniform(*span) for span in sizes)
    width, thick = ratio * depth, kit.uniform(0.015, 0.07)
    frame = kit.draw(m.wood, m.wood, m.lacquer, m.metal)
    top = frame if kit.chance(0.5) else kit.draw(m.wood, m.lacquer, m.stone)
    if kind != "desk" and kit.chance(0.12):
        top = m.GLASS
    shape = "rect"
    if kind in ("round", "pedestal"):
        shape = kit.choose("oval", "oval", "super", "octagon")
    elif kind in ("coffee", "dining", "conference", "side"):
        shape = kit.choose("rect", "rect", "oval", "super", "octagon")
    flat = {"rect": rounded(depth, width, kit.choose(0.004, 0.02, 0.12)),
            "oval": superellipse(depth, width, 2, 40),
            "super": superellipse(depth, width, kit.uniform(2.5, 5), 40),
            "octagon": rounded(depth, width, kit.uniform(0.15, 0.4) * depth, 1)}[shape]
    lip = kit.choose(1.0, 1.0, 0.95, 0.85)
    kit.add(top, stack([(flat * lip, high - thick), (flat, high - 0.5 * thick), (flat, high)]))
    under = high - thick + 0.004
    inward = kit.uniform(0.75, 0.95)
    x, y = np.array([depth, width]) / 2 * inward * (0.95 if shape == "rect" else 0.74)
    if kind in ("round", "pedestal", "conference") and kit.chance(0.8):
        style, size = kit.choose("disc", "star", "drum", "feet"), min(depth, width)
        start = len(kit.parts)
        if style == "drum":
            r = size * kit.uniform(0.15, 0.38)
            kit.add(frame, lathe([(r, 0), (r * kit.uniform(0.5, 1.0), under / 2),
                                  (r * kit.uniform(0.7, 1), under)]))
        elif style == "feet":
            profile = [(0.02, 0.1), (0.07, 0.12), (0.1, 0.25), (0.05, 0.4), (0.09, 0.6),
                       (0.05, 0.85), (0.1, 1)]
            kit.add(frame, lathe([(r, z * under) for r, z in profile], 20, smooth=4))
            path = [(0, 0, 0.3 * under), (0.2 * size, 0, 0.2 * under), (0.38 * size, 0, 0.02)]
            kit.around(frame, kit.choose(3, 4), tube(smooth_path(path, 4), 0.028), start=30)
        else:
            column(kit, frame, size * kit.uniform(0.22, 0.4), under, kit.uniform(0.03, 0.09), style)
        if width > 1.7 * depth:
            kit.parts[start:] = [(part.at(y=s * 0.25 * width), material) for s in (-1, 1)
                                 for part, material in kit.parts[start:]]
    elif kind == "trestle":
        splay, side = kit.uniform(0.5, 0.9), 0.75 * y
        kit.both(frame, block((-x, x), (side - 0.05, side + 0.05), (under - 0.08, under)),
                 *(rod((0.15 * s * x, side, under - 0.03), (s * x * splay, side, 0), 0.03,
                       4) for s in (-1, 1)))
        kit.add(frame, block((-0.03, 0.03), (-side, side), (0.35 * under, 0.35 * under + 0.09)))
    elif kind == "cross":
        r, side = kit.uniform(0.02, 0.04), 0.9 * y
        kit.both(frame, rod((x, side, 0), (-x, side, under), r, 6),
                 rod((-x, side, 0), (x, side, under), r, 6))
        kit.add(frame, rod((0, -side, under / 2), (0, side, under / 2), r, 6))
    elif kind == "cube" or (kind in ("coffee", "console") and kit.chance(0.3)):
        kit.both(frame, block((-x, x), (y - kit.uniform(0.02, 0.06), y), (0, under)))
        style = kit.choose("none", "panel", "shelf", "floor")
        if style == "panel":
            kit.add(frame, block((-x, 0.03 - x), (-y, y), (0, under)))
        for z in {"shelf": (0.45 * under,), "floor": (0.02, 0.5 * under)}.get(style, ()):
            kit.add(frame, block((-x, x), (-y, y), (z, z + 0.03)))
    else:
        size = kit.uniform(0.03, 0.1)
        x, y = x - size / 2, y - size / 2
        four_legs(kit, frame, x, y, under, size)
        if top is not m.GLASS and kit.chance(0.7):
            rail = (under - kit.uniform(0.05, 0.13), under)
            kit.both(frame, block((-x, x), (y - 0.01, y + 0.01), rail))
            kit.add(frame, *(block((s * x - 0.01, s * x + 0.01), (-y, y), rail) for s in (-1, 1)))
        if kind in ("coffee", "side", "console") and kit.chance(0.55):
            z = kit.uniform(0.15, 0.45) * under
            kit.add(kit.choose(frame, top), block((-x, x), (-y, y), (z, z + 0.025)))
    if kind == "desk":
        knob = kit.draw(m.metal)
        for side in kit.choose((-1,), (1,), (-1, 1), ()):
            low, wide = kit.choose(0.0, 0.06, 0.3) * high, kit.uniform(0.3, 0.42) * min(width, 1.3)
            span = (side * y - wide, side * y) if side > 0 else (side * y, side * y + wide)
            kit.add(frame, block((-0.92 * x, 0.92 * x), span, (low, under)))
            fronts(kit, kit.choose(frame, top), knob, 0.92 * x, span, (low + 0.02, under - 0.01), 1,
                   kit.choose(1, 2, 3, 4))
        if kit.chance(0.4):
            kit.add(frame, block((-x, 0.02 - x), (-y, y), (0.3 * high, under)))


_CABINETS = {
    # Ranges of depth, width, height.
    "drawers": ((0.35, 0.55), (0.5, 1.3), (0.6, 1.4)),
    "nightstand": ((0.35, 0.5), (0.35, 0.6), (0.4, 0.75)),
    "sideboard": ((0.35, 0.55), (1.1, 2.2), (0.55, 0.95)),
    "wardrobe": ((0.5, 0.7), (0.8, 2.4), (1.7, 2.3)),
    "bookcase": ((0.22, 0.4), (0.5, 2.0), (0.9, 2.2)),
    "shelves": ((0.25, 0.4), (0.6, 1.8), (0.8, 2.1)),
    "glass": ((0.3, 0.5), (0.6, 1.4), (1.4, 2.1)), "hutch": ((0.4, 0.55), (0.8, 1.6), (1.6, 2.2)),
    "filing": ((0.45, 0.7), (0.38, 0.5), (0.6, 1.4)),
    "kitchen": ((0.5, 0.65), (0.6, 2.4), (0.8, 0.95)),
    "tv": ((0.35, 0.5), (1.1, 2.2), (0.35, 0.65)), "locker": ((0.4, 0.55), (0.3, 1.2), (1.6, 2.0)),
}
CABINETS = tuple(_CABINETS)


def _shelf(kit: Kit, material: Material, back: Material, x: tuple[float, float], y: float,
           z: tuple[float, float], columns: int, rows: int) -> None:
    """An open body with shelves and partitions."""
    kit.add(back, block((x[0], x[0] + 0.012), (-y, y), z))
    for at in np.linspace(-y, y - 0.02, columns + 1):
        kit.add(material, block(x, (at, at + 0.02), z))
    for at in np.linspace(z[0], z[1] - 0.02, rows + 1):
        kit.add(material, block((x[0], x[1] - 0.002), (0.001 - y, y - 0.001), (at, at + 0.02)))


def cabinet(kit: Kit, kind: str) -> None:
    """Cabinets, chests of drawers, wardrobes, bookcases: a body with fronts, shelves or both."""
    depth, width, high = (kit.uniform(*span) for span in _CABINETS[kind])
    iron = kind in ("filing", "locker")
    body = kit.draw(m.metal, m.lacquer) if iron else kit.draw(m.wood, m.wood, m.lacquer)
    knob = kit.draw(m.metal)
    front = body if kit.chance(0.55) else kit.draw(m.wood, m.lacquer)
    x, y = depth / 2, width / 2
    low = kit.choose(0.0, 0.0, 0.06, kit.uniform(0.08, 0.25)) * (not iron)
    if low > 0.07:
        four_legs(kit, kit.choose(body, knob), x - 0.05, y - 0.05, low + 0.01, 0.05)
    elif low:
        kit.add(kit.choose(body, m.BLACK),
                block((0.02 - x, x - 0.04), (0.03 - y, y - 0.03), (0, low + 0.01)))
    columns = max(1, round(width / kit.uniform(0.35, 0.7)))
    rows = max(2, round((high - low) / kit.uniform(0.18, 0.4)))
    split = low + kit.uniform(0.3, 0.6) * (high - low)
    if kind == "bookcase":
        _shelf(kit, body, front, (-x, x), y, (low, high), columns, rows)
        for z in np.linspace(low, high - 0.02, rows + 1)[:-1] + 0.015:
            for at in np.arange(0.03 - y, y - 0.1, 0.07)[: int(kit.uniform(-6, 16))]:
                tall = kit.uniform(0.5, 0.8) * (high - low) / rows
                kit.add(kit.draw(m.lacquer),
                        block((0.01 - x, 0.4 * x), (at, at + 0.066), (z, z + tall)))
    elif kind == "shelves":
        for z in np.linspace(low + 0.02, high, min(rows, 6)):
            kit.add(front, block((-x, x), (-y, y), (z - 0.025, z)))
        post = kit.uniform(0.025, 0.06)
        kit.four(body, block((x - post, x), (y - post, y), (0, high + 0.02)))
    elif kind in ("glass", "hutch"):
        upper = (-x, x if kind == "glass" else x * kit.uniform(0.0, 0.5))
        kit.add(body, block((-x, x), (-y, y), (low, split)))
        fronts(kit, front, knob, x, (-y, y), (low + 0.03, split - 0.03), columns,
               kit.choose(1, 1, 2))
        _shelf(kit, body, front, upper, y, (split - 0.01, high), 1, kit.choose(2, 3, 4))
        if kind == "glass":
            kit.add(m.GLASS, block((x - 0.005, x + 0.001), (-y, y), (split, high)))
    elif kind in ("tv", "nightstand") or (kind == "sideboard" and kit.chance(0.4)):
        above = kit.chance(0.5)
        closed, opened = (low, split), (split - 0.01, high)
        if not above:
            closed, opened = (split, high), (low, split + 0.01)
        _shelf(kit, body, front, (-x, x), y, opened, columns, kit.choose(1, 2))
        kit.add(body, block((-x, x), (-y, y), closed))
        fronts(kit, front, knob, x, (-y, y), (closed[0] + 0.015, closed[1] - 0.015), columns,
               kit.choose(1, 1, 2))
    else:
        kit.add(body, block((-x, x), (-y, y), (low, high), 0.006))
        edge = kit.uniform(0.01, 0.04)
        if kind in ("drawers", "filing"):
            fronts(kit, front, knob, x, (edge - y, y - edge), (low + edge, high - edge),
                   1 if kind == "filing" else kit.choose(1, 1, 2, 3), min(rows, 6))
        else:
            cut = kit.choose(low + edge, low + 0.2 * high, split, low + 0.7 * (high - low))
            fronts(kit, front, knob, x, (edge - y, y - edge), (cut, high - edge), columns, 1)
            if cut > low + edge:
                fronts(kit, front, knob, x, (edge - y, y - edge), (low + edge, cut), columns,
                       kit.choose(1, 2))
    if kind not in ("shelves", "locker", "hutch") and kit.chance(0.45):
        out, slab = kit.uniform(0.01, 0.05), (high - 0.002, high + kit.uniform(0.02, 0.06))
        kit.add(kit.draw(m.stone) if kind == "kitchen" else kit.choose(body, front),
                block((-x, x + out), (-y - out, y + out), slab, 0.008))


LAMPS = ("table", "table", "table", "floor", "floor", "tripod", "pendant", "chandelier", "desk",
         "street", "sconce")


def _shade(kit: Kit, material: Material, radius: float, tall: float, x: float, z: float) -> None:
    """A shade that hangs from z, open below, with a bulb inside."""
    top, t = kit.uniform(0.3, 0.85), np.linspace(0, 1, 8)
    share = kit.choose(top + (1 - top) * t, top + (1 - top) * t, 0 * t + 1, top + (1 - top) * t**2,
                       np.sqrt(1 - 0.98 * (1 - t) ** 2), np.sqrt(1 - 0.9 * (2 * t - 1) ** 2))
    outer = [(radius * s, -tall * a) for s, a in zip(share, t, strict=True)]
    inner = [(max(r - 0.008, 0.001), min(h, -0.008)) for r, h in outer]
    part = lathe([(0, 0), *outer, *inner[::-1], (0, -0.008)], kit.choose(30, 30, 30, 4, 6))
    bulb = min(0.7 * radius, 0.6 * tall)
    kit.add(material, part.turned("z", 45).at(x, 0, z))
    kit.add(m.LIGHT, ball(bulb, bulb, 0.6 * tall, 12).at(x, 0, z - 0.3 * tall))


def lamp(kit: Kit, kind: str) -> None:
    """Lamps on a table, on the floor, on a wall, at the ceiling and in the street."""
    frame = kit.draw(m.metal, m.metal, m.wood, m.lacquer)
    cream = m.plain((0.93, 0.89, 0.78), 0.0, name="shade")
    cover = cream if kit.chance(0.4) else kit.draw(m.fabric, m.lacquer)
    radius, tall, thin = kit.uniform(0.1, 0.24), kit.uniform(0.12, 0.32), kit.uniform(0.008, 0.02)
    if kind == "table":
        stem, body = kit.uniform(0.2, 0.5), kit.draw(m.metal, m.wood, m.lacquer, m.stone)
        style = kit.choose("profile", "profile", "profile", "balls", "block", "rod")
        wide = kit.uniform(0.06, 0.17)
        if style == "profile":
            knots = np.linspace(0, stem, kit.choose(4, 5, 6, 7))
            points = [(kit.uniform(0.2, 1) * wide, z) for z in knots[:-1]]
            kit.add(body, lathe([*points, (0.015, stem)], 28, smooth=5))
        elif style == "balls":
            count = kit.choose(1, 2, 3, 4)
            size = stem / count
            part = ball(min(size, 0.25), min(size, 0.25), 1.02 * size, 20)
            kit.add(body, *(part.at(z=(k + 0.5) * size) for k in range(count)))
        elif style == "block":
            kit.add(body, box(wide, wide * kit.uniform(0.6, 1.6), stem, 0.01).at(z=stem / 2))
        else:
            column(kit, body, wide, stem, 0.012, "disc")
        if style in ("profile", "balls"):
            kit.add(frame, cylinder(kit.uniform(0.05, 0.1), 0.02, 28).at(z=0.01))
        top = stem + kit.uniform(0.5, 0.9) * tall
        kit.add(frame, rod((0, 0, stem - 0.02), (0, 0, top), 0.006))
        _shade(kit, cover, radius, tall, 0, top)
    elif kind in ("floor", "tripod"):
        top = kit.uniform(1.2, 1.8)
        if kind == "floor":
            column(kit, frame, kit.uniform(0.1, 0.2), top, thin, "disc")
        else:
            meet = kit.uniform(0.7, 1.0) * top
            kit.around(frame, 3, rod((kit.uniform(0.2, 0.4), 0, 0), (0.02, 0, meet), thin))
            kit.add(frame, rod((0, 0, meet - 0.05), (0, 0, top), thin))
        if kit.chance(0.25):  # light upward
            bowl = [(0.02, 0), (radius, 0.7 * tall), (1.1 * radius, tall), (radius, tall),
                    (0.02, 0.05)]
            kit.add(cover, lathe([(0, 0), *bowl, (0, 0.05)], 28).at(z=top - 0.01))
        else:
            _shade(kit, cover, radius * 1.15, tall, 0, top + 0.004)
    elif kind == "desk":
        kit.add(frame, cylinder(kit.uniform(0.06, 0.1), 0.04, 28, 0.005).at(z=0.02))
        a, b = np.radians([kit.uniform(-25, 10), kit.uniform(25, 75)])
        elbow = np.array([np.sin(a), 0, np.cos(a)]) * kit.uniform(0.18, 0.4) + [0, 0, 0.04]
        tip = elbow + np.array([np.sin(b), 0, np.cos(b)]) * kit.uniform(0.15, 0.4)
        kit.add(frame, rod((0, 0, 0.03), elbow, 0.009), rod(elbow, tip, 0.009),
                ball(0.04, 0.03, 0.04, 10).at(*elbow))
        start, tilt = len(kit.parts), kit.uniform(-50, 0)
        _shade(kit, cover, kit.uniform(0.05, 0.09), kit.uniform(0.1, 0.16), 0, 0.02)
        kit.change(start, lambda part: part.turned("y", tilt).at(*tip))
    elif kind in ("pendant", "chandelier"):
        drop, size = kit.uniform(0.5, 1.3), kit.uniform(0.25, 0.5)
        kit.add(frame, cylinder(0.06, 0.03, 20).at(z=drop), rod((0, 0, 0), (0, 0, drop), 0.005))
        if kind == "pendant":
            _shade(kit, kit.choose(cover, frame), radius * 1.2, tall, 0, 0.01)
        else:
            profile = [(0.003, -0.41), (0.015, -0.4), (0.05, -0.2), (0.02, 0.05), (0.06, 0.3),
                       (0.012, 0.6)]
            kit.add(frame, lathe([(r, z * size) for r, z in profile], 20))
            path = [(0.03, 0, -0.1 * size), (0.45 * size, 0, -0.4 * size),
                    (0.9 * size, 0, -0.25 * size), (size, 0, 0)]
            cup = lathe([(0, 0), (0.02, 0), (0.3 * radius + 0.02, 0.12), (0.3 * radius, 0.12),
                         (0, 0.02)], 14)
            cup, count = cup.scaled(1, 1, kit.choose(1, 1, -1)), kit.choose(3, 5, 6, 8, 10)
            kit.around(frame, count, tube(smooth_path(path, 4), 0.01))
            kit.around(cover, count, cup.at(size))
            kit.around(m.LIGHT, count, ball(0.05, 0.05, 0.09, 10).at(size, 0, 0.01))
    elif kind == "street":
        top, reach = kit.uniform(3, 7), kit.uniform(0.4, 1.4)
        kit.add(frame, lathe([(0.16, 0), (0.16, 0.25), (0.09, 0.35), (0.07, 0.5 * top),
                              (0.05, top)], 16))
        for side in kit.choose((1,), (1, -1)):
            path = [(0, 0, top - 0.15), (0.3 * side * reach, 0, top + 0.25),
                    (side * reach, 0, top + 0.3)]
            kit.add(frame, tube(smooth_path(path, 4), 0.04),
                    box(0.6, 0.24, 0.12, 0.04).at(side * (reach + 0.2), 0, top + 0.3))
            kit.add(m.LIGHT, box(0.45, 0.18, 0.03).at(side * (reach + 0.2), 0, top + 0.235))
    else:
        kit.add(frame, box(0.02, kit.uniform(0.08, 0.2), kit.uniform(0.12, 0.3), 0.006).at(-0.01))
        reach, top = kit.uniform(0.1, 0.25), 0.04 + 0.3 * tall
        kit.add(frame, tube(smooth_path([(-0.005, 0, 0), (0.6 * reach, 0, -0.06), (reach, 0, 0.03)],
                                        4), 0.009),
                rod((reach, 0, 0), (reach, 0, top), 0.007))
        _shade(kit, cover, 0.4 * radius + 0.03, 0.6 * tall, reach, top)

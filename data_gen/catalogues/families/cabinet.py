"""Cabinets, shelves, wardrobes and chests."""

import itertools
from collections.abc import Callable

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families import hollows, legs
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    DARK_GLASS,
    GLASS,
    WHITE,
    Kit,
    case,
    lacquer,
    metal,
    paint,
    pick,
    rect,
    wood,
)
from data_gen.catalogues.solids import ball, box, cylinder, lathe, rod, tube
from data_gen.mesh import Material


class _Look:
    """Materials and style of the fronts, common to all parts of a cabinet."""

    def __init__(self, kit: Kit) -> None:
        self.body = pick(kit.rng, (wood, wood, lacquer))(kit.rng)
        same = kit.rng.random() < 0.4
        self.front = self.body if same else pick(kit.rng, (wood, lacquer))(kit.rng)
        self.knob = metal(kit.rng)
        self.handle = kit.choose("handle", "knob", "bar", "bar", "bow", "none")
        self.panel = kit.choose("panels", "flat", "inset", "raised")


def _body(
    kit: Kit, material: Material, depth: float, width: float, height: float, lift: float,
    x: float = 0.0,
) -> None:  # fmt: skip
    """A case with a recess in its underside, or one with an open back (`open_cabinet`)."""
    if kit.visible.get("open_back"):
        back = kit.hide("back_recess", 0.0, 0.8) * depth
        kit.add(material, case(depth, width, height, 0.02, back).at(x, 0, lift))
        kit.azimuth = ((-85.0, 85.0),)
        return
    outline = solids.rounded(depth, width, 0.006, 1)
    if kit.hidden:
        kit.add(material, box(depth, width, height, 0.004).at(x, 0, lift + height / 2))
        return
    levels = [(outline, 0.0), (outline, height - 0.004), (solids.inset(outline, 0.004), height)]
    kit.add(material, hollows.body(kit, levels, min(0.08, 0.5 * height)).at(x, 0, lift))


def _front(
    kit: Kit, look: _Look, x: float, y: float, z: float, w: float, h: float,
    drawer: bool = False, side: int = 1,
) -> None:  # fmt: skip
    """A door or drawer of size (w, h), centred at (y, z), in the plane at x."""
    kit.add(look.front, box(0.022, w - 0.008, h - 0.008, 0.004).at(x, y, z))
    if min(w, h) > 0.16 and look.panel != "flat":
        thick = 0.026 if look.panel == "inset" else 0.036
        material = look.body if look.panel == "inset" else look.front
        kit.add(material, box(thick, w - 0.1, h - 0.1, 0.006).at(x, y, z))
    tall = not drawer and h > 0.8 * w
    hy, face = y + (side * 0.4 * w if tall else 0.0), x + 0.011
    size = min(0.16, h * 0.5) if tall else min(0.16, w * 0.4)
    if look.handle == "knob":
        for offset in (-0.25, 0.25) if drawer and w > 0.6 else (0.0,):
            kit.add(look.knob, ball(0.035, 0.035, 0.035, 10).at(face + 0.016, hy + offset * w, z))
    elif look.handle == "bar":
        bar = box(0.02, 0.014, size, 0.004) if tall else box(0.02, size, 0.014, 0.004)
        kit.add(look.knob, bar.at(face + 0.012, hy, z))
    elif look.handle == "bow":
        bow = np.array(
            [(0, -size / 2, 0), (0.03, -size / 3, 0), (0.03, size / 3, 0), (0, size / 2, 0)]
        )
        part = tube(bow, 0.006, 6)
        kit.add(look.knob, (part.turned("x", 90) if tall else part).at(face, hy, z))


def _grid(
    kit: Kit, look: _Look, x: float, width: float, low: float, high: float, columns: int, rows: int,
    drawers: bool = False, y0: float = 0.0,
) -> None:  # fmt: skip
    w, h = (width - 0.01) / columns, (high - low - 0.01) / rows
    for i in range(columns):
        for j in range(rows):
            y, z = y0 + (i - (columns - 1) / 2) * w, low + 0.005 + (j + 0.5) * h
            _front(kit, look, x, y, z, w, h, drawers, 1 if i < columns / 2 else -1)


def _stand(kit: Kit, look: _Look, depth: float, width: float) -> float:
    """Adds feet, a plinth or legs; returns the height of the body above the ground."""
    style = kit.choose("stand", "plinth", "feet", "legs", "none")
    if style == "plinth":
        kit.add(BLACK, box(depth - 0.06, width - 0.03, 0.07).at(z=0.035))
        return 0.06
    if style == "none":
        return 0.0
    lift = kit.uniform("foot_height", 0.05, 0.14)
    if style == "legs":
        lift = kit.uniform("leg_height", 0.12, 0.35)
        legs.four(kit, depth / 2 - 0.05, width / 2 - 0.06, lift + 0.01, look.body, thick=0.05)
    else:
        legs.feet(kit, depth / 2 - 0.05, width / 2 - 0.06, lift + 0.01, look.body)
    return lift


def _top(kit: Kit, material: Material, depth: float, width: float, z: float) -> None:
    """Adds a plate or a cornice on top."""
    style = kit.choose("top", "none", "plate", "cornice", "pediment")
    if style in ("plate", "pediment"):
        kit.add(material, box(depth + 0.04, width + 0.05, 0.03, 0.006).at(0.01, 0, z + 0.014))
    if style == "cornice":
        levels = [
            (solids.rounded(depth + g, width + g, 0.01, 1), z + t)
            for g, t in ((0, 0), (0.02, 0.02), (0.09, 0.06), (0.1, 0.09))
        ]
        kit.add(material, solids.stack(levels))
    if style == "pediment":
        high = kit.uniform("pediment", 0.08, 0.25)
        t = np.linspace(-0.5, 0.5, 15)
        arch = [(float(a) * width, z + 0.02 + high * float(np.cos(a * np.pi))) for a in t]
        kit.add(material, solids.prism([*arch], 0.03).turned("z", 90).at(depth / 2 - 0.03))


def _carcass(kit: Kit, look: _Look, depth: float, width: float, height: float) -> float:
    """Adds stand, body and top; returns the height of the body above the ground."""
    lift = _stand(kit, look, depth, width)
    _body(kit, look.body, depth - 0.02, width, height - lift, lift, -0.01)
    _top(kit, look.body, depth, width, height)
    return lift


def _wardrobe(kit: Kit) -> None:
    look = _Look(kit)
    width, height = kit.uniform("width", 0.7, 2.2), kit.uniform("height", 1.6, 2.3)
    depth = kit.uniform("depth", 0.45, 0.68)
    lift = _carcass(kit, look, depth, width, height)
    doors = max(1, round(width / kit.uniform("door", 0.38, 0.6)))
    low = lift
    if kit.chance("drawers_below", 0.4):
        low = lift + kit.uniform("drawers", 0.2, 0.45)
        _grid(
            kit,
            look,
            depth / 2 - 0.011,
            width,
            lift,
            low,
            kit.choose("columns", 1, 2),
            kit.choose("rows", 1, 2),
            True,
        )
    _grid(kit, look, depth / 2 - 0.011, width, low, height, doors, 1)
    if kit.chance("mirror", 0.25):
        kit.add(
            CHROME,
            box(0.03, width / doors * 0.8, (height - low) * 0.8, 0.003).at(
                depth / 2 - 0.008, 0 if doors % 2 else width / doors / 2, (height + low) / 2
            ),
        )


def _chest(kit: Kit) -> None:
    """A chest of drawers, straight, bow-fronted or bombé."""
    look = _Look(kit)
    width, height = kit.uniform("width", 0.4, 1.5), kit.uniform("height", 0.6, 1.35)
    depth = kit.uniform("depth", 0.36, 0.56)
    lift = _stand(kit, look, depth, width)
    rows = kit.choose("drawers", 3, 4, 5, 6, 7)
    shape = kit.choose("front", "flat", "flat", "bow", "bombe")
    if kit.visible.get("open_back") or shape == "flat":
        _body(kit, look.body, depth - 0.02, width, height - lift, lift, -0.01)
        columns = 2 if width > 0.9 and kit.chance("two_columns", 0.6) else 1
        _grid(kit, look, depth / 2 - 0.011, width, lift, height, columns, rows, True)
    else:
        swell = kit.uniform("swell", 0.06, 0.16)
        t = np.linspace(-1, 1, 13)
        front = np.stack([depth / 2 + swell * (1 - t**2), t * width / 2], axis=1)
        flat = np.concatenate([front, [(-depth / 2, width / 2), (-depth / 2, -width / 2)]])
        bulge = 0.12 if shape == "bombe" else 0.0
        heights = np.linspace(lift, height, 9 if bulge else 2)
        levels = [
            (
                flat
                * (
                    1
                    + bulge * np.sin(np.pi * min((z - lift) / (height - lift) * 1.2, 1.0))
                    - bulge * 0.3
                ),
                float(z),
            )
            for z in heights
        ]
        kit.add(look.body, hollows.body(kit, levels, 0.06))
        for k in range(1, rows):
            z = lift + k * (height - lift) / rows
            s = (
                1
                + bulge * np.sin(np.pi * min((z - lift) / (height - lift) * 1.2, 1.0))
                - bulge * 0.3
            )
            line = np.column_stack([front * s + [0.001, 0], np.full(13, z)])
            kit.add(BLACK, tube(line, 0.004, 4))
        for k in range(rows):
            z = lift + (k + 0.5) * (height - lift) / rows
            s = (
                1
                + bulge * np.sin(np.pi * min((z - lift) / (height - lift) * 1.2, 1.0))
                - bulge * 0.3
            )
            for b in (-0.25, 0.25):
                x = (depth / 2 + swell * (1 - (2 * b) ** 2)) * s
                kit.add(look.knob, ball(0.04, 0.04, 0.04, 10).at(x, b * width * s, z))
    _top(kit, look.body, depth, width, height)
    if kit.chance("mirror", 0.2):
        tall = kit.uniform("mirror_height", 0.4, 0.8)
        flat = solids.superellipse(tall, width * 0.7, kit.choose("mirror_shape", 2, 10), 28)
        plate = solids.stack([(flat, 0), (flat, 0.03)]).turned("y", 90)
        kit.add(look.body, plate.at(-depth / 2 + 0.02, 0, height + tall / 2 + 0.04))
        inner = solids.stack([(flat * 0.9, 0), (flat * 0.9, 0.03)]).turned("y", 90)
        kit.add(CHROME, inner.at(-depth / 2 + 0.024, 0, height + tall / 2 + 0.04))


def _sideboard(kit: Kit) -> None:
    look = _Look(kit)
    width, height = kit.uniform("width", 1.1, 2.4), kit.uniform("height", 0.5, 0.95)
    depth = kit.uniform("depth", 0.36, 0.55)
    lift = _carcass(kit, look, depth, width, height)
    x, plan = (
        depth / 2 - 0.011,
        kit.choose("plan", "doors", "drawers_between", "drawers_above", "drawers"),
    )
    if plan == "doors":
        _grid(kit, look, x, width, lift, height, kit.choose("doors", 2, 3, 4), 1)
    elif plan == "drawers":
        _grid(
            kit,
            look,
            x,
            width,
            lift,
            height,
            kit.choose("columns", 2, 3),
            kit.choose("rows", 2, 3),
            True,
        )
    elif plan == "drawers_above":
        edge = height - kit.uniform("drawer", 0.12, 0.2)
        _grid(kit, look, x, width, lift, edge, kit.choose("doors", 2, 3, 4), 1)
        _grid(kit, look, x, width, edge, height, kit.choose("columns", 1, 2, 3), 1, True)
    else:
        third = width / 3
        for s in (-1, 1):
            _grid(kit, look, x, third, lift, height, 1, 1, False, s * third)
        _grid(kit, look, x, third, lift, height, 1, kit.choose("rows", 3, 4), True)
    if kit.chance("hutch", 0.3):
        _hutch(kit, look, depth, width, height)


def _hutch(kit: Kit, look: _Look, depth: float, width: float, base: float) -> None:
    """Open shelves on a lower cabinet."""
    tall, deep = kit.uniform("hutch_height", 0.5, 1.2), depth * 0.55
    x = -depth / 2 + deep / 2
    kit.both(look.body, box(deep, 0.025, tall).at(x, width / 2 - 0.02, base + tall / 2))
    kit.add(look.body, box(0.02, width, tall).at(-depth / 2 + 0.01, 0, base + tall / 2))
    for t in np.linspace(0, 1, kit.choose("hutch_shelves", 2, 3, 4))[1:]:
        kit.add(look.body, box(deep, width, 0.025).at(x, 0, base + t * tall))
    for _ in range(5):
        r = kit.rng.uniform(0.03, 0.07)
        y = kit.rng.uniform(-0.4, 0.4) * width
        kit.add(
            look.front, lathe([(r * 0.5, 0), (r, r), (r * 0.6, 2 * r)], 14).at(x, y, base + 0.01)
        )


def _shelves(
    kit: Kit, body: Material, depth: float, width: float, low: float, high: float, rows: int,
    back: bool, y0: float = 0.0,
) -> np.ndarray:  # fmt: skip
    """Adds side boards and shelves; returns the heights of the shelves."""
    wall = 0.024
    for s in (-1, 1):
        kit.add(
            body,
            box(depth, wall, high - low, 0.003).at(
                0, y0 + s * (width - wall) / 2, (low + high) / 2
            ),
        )
    edges = np.linspace(low + wall / 2, high - wall / 2, rows + 1)
    for z in edges:
        kit.add(body, box(depth - 0.006, width - wall, wall).at(0, y0, z))
    if back:
        kit.add(
            body,
            box(0.015, width - wall, high - low - 0.01).at(-depth / 2 + 0.01, y0, (low + high) / 2),
        )
    return edges


def _books(kit: Kit, depth: float, y0: float, y1: float, z: float, room: float) -> None:
    """A row of books from y0 to at most y1."""
    covers = [paint(kit.rng) for _ in range(3)]
    y, end = y0, y0 + (y1 - y0) * kit.rng.uniform(0.3, 1.0)
    tall, deep = room * kit.rng.uniform(0.6, 0.8), depth * kit.rng.uniform(0.45, 0.75)
    while y < end - 0.06:
        t = kit.rng.uniform(0.02, 0.055)
        high = tall * kit.rng.uniform(0.85, 1.15)
        book = box(deep, t * 0.92, high).at(-depth / 2 + 0.02 + deep / 2, y + t / 2, z + high / 2)
        kit.add(covers[int(kit.rng.integers(3))], book)
        y += t


def _bookcase(kit: Kit) -> None:
    """A bookcase: with doors below, in steps, or open on all sides."""
    look = _Look(kit)
    depth = kit.uniform("depth", 0.22, 0.42)
    width, height = kit.uniform("width", 0.5, 1.6), kit.uniform("height", 0.8, 2.2)
    plinth = 0.07
    kit.add(look.body, hollows.slab(kit, "base_recess", rect(depth, width), plinth))
    back = kit.chance("back_board", 0.75)
    low = plinth - 0.02
    if kit.chance("doors_below", 0.3) and height > 1.3:
        edge = low + height * 0.35
        kit.add(look.body, box(depth - 0.02, width, edge - low).at(-0.01, 0, (edge + low) / 2))
        _grid(kit, look, depth / 2 - 0.011, width, low, edge, 2, 1)
        low = edge - 0.02
    rows, columns = (
        max(2, round((height - low) / kit.uniform("pitch", 0.26, 0.42))),
        kit.choose("columns", 1, 1, 2, 3),
    )
    books = kit.chance("books", 0.65)
    one = width / columns
    stepped = columns > 1 and kit.chance("stepped", 0.4)
    for c in range(columns):
        count = max(1, rows - c) if stepped else rows
        top = low + (height - low) * count / rows
        y0 = (c - (columns - 1) / 2) * one
        edges = _shelves(kit, look.body, depth, one, low, top, count, back, y0)
        if books:
            for z, above in itertools.pairwise(edges):
                if kit.rng.random() < 0.75:
                    _books(
                        kit,
                        depth,
                        y0 - one / 2 + 0.03,
                        y0 + one / 2 - 0.03,
                        z + 0.012,
                        above - z - 0.03,
                    )
    if not stepped:
        _top(kit, look.body, depth, width, height)


def _ladder_shelf(kit: Kit) -> None:
    """Shelves on posts or a leaning ladder."""
    main = pick(kit.rng, (wood, lacquer))(kit.rng)
    frame = legs.metal_or(kit, main, metal)
    width, depth = kit.uniform("width", 0.5, 1.3), kit.uniform("depth", 0.28, 0.5)
    height, rows = kit.uniform("height", 0.8, 2.0), kit.choose("shelves", 3, 4, 5, 6)
    leaning = kit.chance("leaning", 0.4)
    share = kit.hide("shelf_recess", *hollows.RANGE)
    for k, z in enumerate(np.linspace(0.1, height - (0.12 if leaning else 0.0), rows)):
        deep = depth * (1 - 0.6 * k / (rows - 1)) if leaning else depth
        board = solids.tray(rect(deep, width), 0.035, 0.01, share * 0.035)
        kit.add(main, board.at((deep - depth) / 2, 0, z))
        if kit.rng.random() < 0.4:
            _books(kit, deep, -width / 2 + 0.05, width / 2 - 0.05, z + 0.035, 0.24)
    for s in (-1, 1):
        front = (
            (-depth * 0.3, s * width / 2, height)
            if leaning
            else (depth / 2 - 0.02, s * width / 2, height)
        )
        kit.add(frame, rod((depth / 2 - 0.02, s * width / 2, 0), front, 0.016, 6))
        kit.add(
            frame,
            rod(
                (-depth / 2 + 0.02, s * width / 2, 0),
                (-depth / 2 + 0.02, s * width / 2, height),
                0.016,
                6,
            ),
        )
    if kit.chance("wheels", 0.2):
        for a in (-1, 1):
            kit.both(
                BLACK,
                cylinder(0.04, 0.025, 16)
                .turned("x", 90)
                .at(a * (depth / 2 - 0.02), width / 2, -0.02),
            )


def _display(kit: Kit) -> None:
    """A glass cabinet with small objects on glass shelves."""
    look = _Look(kit)
    width, depth = kit.uniform("width", 0.45, 1.3), kit.uniform("depth", 0.35, 0.5)
    height, base = kit.uniform("height", 1.2, 2.1), kit.uniform("base", 0.1, 0.7)
    _body(kit, look.body, depth, width, base, 0.0)
    if base > 0.35:
        _grid(kit, look, depth / 2 + 0.008, width, 0.04, base - 0.02, kit.choose("doors", 1, 2), 1)
    for a in (-1, 1):
        kit.both(
            look.body,
            box(0.03, 0.03, height - base).at(
                a * (depth / 2 - 0.015), width / 2 - 0.015, (height + base) / 2
            ),
        )
    kit.add(look.body, box(depth, width, 0.05, 0.006).at(z=height))
    if kit.chance("back_board", 0.6):
        kit.add(
            look.body,
            box(0.015, width - 0.02, height - base).at(-depth / 2 + 0.01, 0, (height + base) / 2),
        )
    kit.both(
        GLASS, box(depth - 0.06, 0.005, height - base).at(0, width / 2 - 0.015, (height + base) / 2)
    )
    kit.add(
        GLASS, box(0.005, width - 0.06, height - base).at(depth / 2 - 0.015, 0, (height + base) / 2)
    )
    rows = kit.choose("shelves", 2, 3, 4)
    for z in base + (np.arange(rows) / rows) * (height - base):
        if z > base:
            kit.add(look.body, box(depth - 0.06, width - 0.06, 0.012).at(z=z))
        for _ in range(3):
            r, y = kit.rng.uniform(0.03, 0.08), kit.rng.uniform(-0.35, 0.35) * width
            profile = [(r * 0.7, 0), (r, r), (r * 0.35, 2.2 * r), (r * 0.6, 2.8 * r)]
            kit.add(look.front, lathe(solids.smooth_profile(profile, 2), 14).at(0, y, z + 0.006))


def _filing(kit: Kit) -> None:
    look = _Look(kit)
    look.body = look.front = lacquer(kit.rng)
    look.panel, look.handle = "flat", "bar"
    lockers = kit.chance("locker", 0.45)
    if lockers:
        columns, rows = kit.choose("doors", 1, 2, 3, 4, 6), kit.choose("tiers", 1, 2, 3)
        width, height, depth = (
            0.34 * columns,
            kit.uniform("height", 1.5, 1.95),
            kit.uniform("depth", 0.4, 0.55),
        )
    else:
        columns, rows = kit.choose("columns", 1, 1, 2, 3), kit.choose("drawers", 2, 3, 4, 5)
        width, height, depth = (
            kit.uniform("column", 0.38, 0.9 if columns == 1 else 0.5) * columns,
            0.32 * rows + 0.05,
            kit.uniform("depth", 0.45, 0.75),
        )
    _body(kit, look.body, depth - 0.02, width, height, 0.0, -0.01)
    _grid(kit, look, depth / 2 - 0.011, width, 0.04, height - 0.02, columns, rows, not lockers)
    for i in range(columns):
        y = (i - (columns - 1) / 2) * width / columns
        for j in range(rows):
            z = 0.04 + (j + 1) * (height - 0.06) / rows - 0.09
            if lockers:
                for k in range(3):
                    kit.add(
                        BLACK,
                        box(0.004, width / columns * 0.5, 0.008).at(
                            depth / 2 + 0.001, y, z - 0.022 * k
                        ),
                    )
            else:
                kit.add(WHITE, box(0.006, 0.09, 0.035).at(depth / 2 + 0.001, y, z + 0.02))
    if lockers and kit.chance("slanted", 0.4):
        kit.add(
            look.body,
            solids.prism([(-depth / 2, 0), (depth / 2, 0), (-depth / 2, 0.18)], width).at(z=height),
        )


def _kitchen(kit: Kit) -> None:
    """Lower cabinets with a counter, a sink or a stove, and cabinets above."""
    look = _Look(kit)
    counter = pick(kit.rng, (lacquer, wood, metal))(kit.rng)
    width, depth, height = kit.uniform("width", 1.2, 3.2), 0.6, kit.uniform("height", 0.82, 0.94)
    kit.add(BLACK, box(depth - 0.1, width - 0.04, 0.1).at(-0.04, 0, 0.05))
    _body(kit, look.body, depth - 0.02, width, height - 0.09, 0.09, -0.01)
    edge = height - 0.16
    columns = max(2, round(width / 0.5))
    _grid(kit, look, depth / 2 - 0.011, width, 0.1, edge, columns, 1)
    _grid(kit, look, depth / 2 - 0.011, width, edge, height - 0.005, columns, 1, True)
    kit.add(counter, box(depth + 0.04, width + 0.03, 0.04, 0.008).at(0.02, 0, height + 0.02))
    if kit.chance("corner", 0.4):
        arm, s = kit.uniform("arm", 0.6, 1.6), kit.choose("side", -1, 1)
        y = s * (width / 2 - depth / 2)
        kit.add(look.body, box(arm, depth, height, 0.004).at(depth / 2 + arm / 2, y, height / 2))
        kit.add(
            counter,
            box(arm + 0.02, depth + 0.03, 0.04, 0.008).at(depth / 2 + arm / 2, y, height + 0.021),
        )
    if kit.chance("upper", 0.55):
        low, high = height + 0.5, height + kit.uniform("upper_height", 0.95, 1.3)
        kit.add(look.body, box(0.33, width, high - low).at(-depth / 2 + 0.165, 0, (high + low) / 2))
        _grid(kit, look, -depth / 2 + 0.34, width, low, high, columns, 1)
        kit.add(
            counter,
            box(0.02, width, low - height + 0.02).at(-depth / 2 + 0.01, 0, (low + height) / 2),
        )
    if kit.chance("tall_unit", 0.35):
        s = kit.choose("tall_side", -1, 1)
        y = s * (width / 2 + 0.31)
        kit.add(look.front, box(depth, 0.6, 2.1, 0.006).at(0, y, 1.05))
        kit.add(
            look.knob,
            box(0.03, 0.02, 0.5).at(depth / 2 + 0.01, y - s * 0.24, 1.3),
            box(0.004, 0.58, 0.01).at(depth / 2, y, 0.9),
        )
    tool = kit.choose("tool", "sink", "stove", "both", "none")
    if tool in ("sink", "both"):
        path = solids.smooth_path(
            [
                (-0.2, 0, height),
                (-0.2, 0, height + 0.24),
                (-0.1, 0, height + 0.3),
                (-0.02, 0, height + 0.22),
            ],
            4,
        )
        kit.add(CHROME, tube(path, 0.014).at(y=-width * 0.2))
        kit.add(CHROME, box(0.36, 0.5, 0.006).at(0.02, -width * 0.2, height + 0.041))
        kit.add(BLACK, box(0.3, 0.44, 0.004).at(0.02, -width * 0.2, height + 0.0435))
    if tool in ("stove", "both"):
        kit.add(BLACK, box(0.5, 0.56, 0.01).at(0, width * 0.2, height + 0.043))
        for a in (-1, 1):
            for b in (-1, 1):
                kit.add(
                    CHROME,
                    cylinder(0.08, 0.008, 20).at(a * 0.12, width * 0.2 + b * 0.13, height + 0.05),
                )


def _corner_unit(kit: Kit) -> None:
    """A cabinet for a corner, with three or five sides."""
    look = _Look(kit)
    size, height = kit.uniform("size", 0.45, 0.8), kit.uniform("height", 0.8, 2.1)
    cut = size * kit.uniform("cut", 0.25, 0.6)
    curved = kit.chance("curved", 0.4)
    if curved:
        a = np.linspace(0, np.pi / 2, 11)
        flat = np.concatenate([[(0.0, 0.0)], size * np.stack([np.cos(a), np.sin(a)], axis=1)])
    else:
        flat = np.array([(0, 0), (size, 0), (size, size - cut), (size - cut, size), (0, size)])
    angle = np.radians(-45)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    flat = flat @ turn.T - [size / 2, 0]
    shelves = kit.chance("open", 0.5)
    if not shelves:
        levels = [(flat, 0.0), (flat, height)]
        kit.add(look.body, hollows.body(kit, levels, 0.08))
        reach = float(flat[:, 0].max())
        wide = float(np.hypot(cut, cut)) if not curved else size * 0.5
        for z0, z1 in ((0.05, height * 0.4), (height * 0.42, height - 0.04)):
            _front(kit, look, reach + 0.004, 0, (z0 + z1) / 2, wide * 0.92, z1 - z0)
        big = flat.mean(axis=0) + (flat - flat.mean(axis=0)) * 1.06
        kit.add(look.body, solids.stack([(big, height), (big, height + 0.035)]))
        return
    share = kit.hide("shelf_recess", *hollows.RANGE)
    centre = flat.mean(axis=0)
    for z in np.linspace(0.0, height, kit.choose("shelves", 4, 5, 6)):
        inner = centre + (flat - centre) * 0.85
        kit.add(
            look.body,
            solids.stack([(inner, z + 0.03 * share), (inner, z), (flat, z), (flat, z + 0.035)]),
        )
    for side in (-45, 45):
        wall = box(size, 0.015, height + 0.03).at(size / 2, 0, height / 2 + 0.015)
        kit.add(look.body, wall.turned("z", side).at(-size / 2))


def _cubes(kit: Kit) -> None:
    """A wall of square compartments, some with doors, baskets or a television."""
    look = _Look(kit)
    columns, rows = kit.choose("columns", 1, 2, 3, 4, 5), kit.choose("rows", 1, 2, 3, 4, 5)
    one, depth = kit.uniform("cell", 0.32, 0.42), kit.uniform("depth", 0.3, 0.45)
    width, height = columns * one, rows * one
    kit.add(look.body, hollows.slab(kit, "base_recess", rect(depth, width), 0.05))
    wall = 0.03
    for i in range(columns + 1):
        kit.add(
            look.body, box(depth, wall, height).at(0, (i - columns / 2) * one, height / 2 + 0.03)
        )
    for j in range(rows + 1):
        kit.add(look.body, box(depth, width + wall, wall).at(0, 0, j * one + 0.03))
    back = kit.chance("back_board", 0.5)
    if back:
        kit.add(look.body, box(0.012, width, height).at(-depth / 2 + 0.01, 0, height / 2 + 0.03))
    for i in range(columns):
        for j in range(rows):
            y, z, kind = (i - (columns - 1) / 2) * one, (j + 0.5) * one + 0.03, kit.rng.random()
            if kind < 0.25:
                kit.add(look.front, box(depth - 0.02, one - wall, one - wall).at(0, y, z))
                kit.add(
                    look.knob, ball(0.03, 0.03, 0.03, 8).at(depth / 2 + 0.005, y + one * 0.35, z)
                )
            elif kind < 0.6:
                _books(
                    kit,
                    depth,
                    y - one / 2 + 0.03,
                    y + one / 2 - 0.03,
                    z - one / 2 + 0.015,
                    one - 0.08,
                )


def _media(kit: Kit) -> None:
    """A low unit for a television, with the television or with a tower beside it."""
    look = _Look(kit)
    width, height, depth = (
        kit.uniform("width", 1.0, 2.4),
        kit.uniform("height", 0.3, 0.6),
        kit.uniform("depth", 0.38, 0.55),
    )
    lift = _stand(kit, look, depth, width)
    thick = 0.05
    top = height
    kit.add(look.body, hollows.slab(kit, "base_recess", rect(depth, width), thick).at(z=lift))
    kit.add(look.body, box(depth, width, 0.03, 0.004).at(z=top))
    columns = kit.choose("columns", 2, 3, 4)
    one = width / columns
    for i in range(columns + 1):
        kit.add(
            look.body,
            box(depth - 0.01, 0.025, top - lift).at(
                0, (i - columns / 2) * one * 0.985, (top + lift) / 2
            ),
        )
    for i in range(columns):
        y = (i - (columns - 1) / 2) * one * 0.985
        if kit.rng.random() < 0.5:
            kit.add(
                look.body, box(depth - 0.04, one, top - lift - 0.02).at(-0.01, y, (top + lift) / 2)
            )
            _front(
                kit,
                look,
                depth / 2 - 0.012,
                y,
                (top + lift + thick) / 2,
                one * 0.95,
                top - lift - thick,
            )
        else:
            kit.add(look.body, box(depth - 0.03, one, 0.02).at(0, y, (top + lift + thick) / 2))
    what = kit.choose("with", "nothing", "television", "tower", "towers", "shelf")
    if what == "television":
        w = width * kit.uniform("screen", 0.5, 0.8)
        kit.add(
            BLACK,
            box(0.06, w, w * 0.58, 0.01).at(-0.05, 0, top + w * 0.29 + 0.08),
            box(0.2, w * 0.4, 0.02).at(-0.05, 0, top + 0.02),
            box(0.04, 0.1, 0.12).at(-0.06, 0, top + 0.07),
        )
        kit.add(DARK_GLASS, box(0.006, w * 0.95, w * 0.53).at(-0.02, 0, top + w * 0.29 + 0.08))
    elif what in ("tower", "towers"):
        tall, w = kit.uniform("tower", 1.3, 2.0), kit.uniform("tower_width", 0.35, 0.55)
        for s in (-1, 1) if what == "towers" else (1,):
            y = s * (width / 2 + w / 2)
            edges = _shelves(
                kit,
                look.body,
                depth * 0.9,
                w,
                0.0,
                tall,
                kit.choose("tower_rows", 3, 4, 5),
                True,
                y,
            )
            _front(
                kit, look, depth * 0.45, y, (edges[0] + edges[1]) / 2, w - 0.02, edges[1] - edges[0]
            )
        if what == "towers":
            kit.add(look.body, box(depth * 0.7, width + w, 0.06).at(-depth * 0.1, 0, tall - 0.03))
    elif what == "shelf":
        z = top + kit.uniform("shelf", 0.6, 1.0)
        kit.add(
            look.body,
            box(0.02, width, z - top).at(-depth / 2 + 0.01, 0, (z + top) / 2),
            box(0.26, width, 0.03).at(-depth / 2 + 0.13, 0, z),
        )


def _secretary(kit: Kit) -> None:
    """A slant-front desk or a roll-top, on drawers."""
    look = _Look(kit)
    width, depth = kit.uniform("width", 0.7, 1.3), kit.uniform("depth", 0.45, 0.6)
    base = kit.uniform("base", 0.65, 0.78)
    lift = _stand(kit, look, depth, width)
    _body(kit, look.body, depth - 0.02, width, base - lift, lift, -0.01)
    _grid(kit, look, depth / 2 - 0.011, width, lift, base, kit.choose("columns", 1, 2), 3, True)
    tall = kit.uniform("slant_height", 0.25, 0.45)
    if kit.chance("roll", 0.5):
        a = np.linspace(0, np.pi / 2, 10)
        arc = [(-depth * 0.1 + depth * 0.55 * np.cos(t), base + tall * np.sin(t)) for t in a]
        shape = [(-depth / 2, base), *arc, (-depth / 2, base + tall)]
    else:
        shape = [
            (-depth / 2, base),
            (depth / 2, base),
            (depth / 2, base + 0.05),
            (-depth * 0.1, base + tall),
            (-depth / 2, base + tall),
        ]
    kit.add(look.front, solids.prism(shape, width, 0.006))
    if kit.chance("open_flap", 0.4):
        kit.add(
            look.front,
            box(depth * 0.75, width * 0.94, 0.025, 0.004).at(depth * 0.85, 0, base + 0.01),
        )
    if kit.chance("upper", 0.5):
        z0, z1 = base + tall, base + tall + kit.uniform("upper_height", 0.4, 1.1)
        deep = depth * 0.4
        kit.add(look.body, box(deep, width, z1 - z0).at(-depth / 2 + deep / 2, 0, (z0 + z1) / 2))
        kit.both(
            look.front,
            box(0.02, width * 0.46, (z1 - z0) * 0.94, 0.005).at(
                -depth / 2 + deep, width * 0.24, (z0 + z1) / 2
            ),
        )
        kit.both(
            look.knob, ball(0.03, 0.03, 0.03, 8).at(-depth / 2 + deep + 0.02, 0.04, (z0 + z1) / 2)
        )


def _trunk(kit: Kit) -> None:
    """A chest with a lid, a nightstand, a safe: small and compact."""
    look = _Look(kit)
    kind = kit.choose("kind", "trunk", "nightstand", "safe", "barrel")
    if kind == "trunk":
        width, depth, height = (
            kit.uniform("width", 0.6, 1.2),
            kit.uniform("depth", 0.35, 0.55),
            kit.uniform("height", 0.3, 0.5),
        )
        _body(kit, look.body, depth, width, height, 0.0)
        bow = kit.uniform("lid", 0.02, 0.28)
        t = np.linspace(0, np.pi, 13)
        lid = [(depth * 0.51 * np.cos(a), height + bow * np.sin(a)) for a in t]
        kit.add(look.front, solids.prism(lid, width * 1.02))
        for y in (-0.42, 0, 0.42):
            band = [(depth * 0.52 * np.cos(a), height + (bow + 0.01) * np.sin(a)) for a in t]
            kit.add(
                look.knob,
                solids.prism(band, 0.04).at(y=y * width),
                box(depth + 0.015, 0.04, height).at(0, y * width, height / 2),
            )
        kit.add(look.knob, box(0.03, 0.08, 0.1, 0.006).at(depth / 2 + 0.01, 0, height - 0.02))
        return
    if kind == "barrel":
        r, height = kit.uniform("radius", 0.22, 0.4), kit.uniform("height", 0.5, 1.0)
        flat = solids.superellipse(2 * r, 2 * r * kit.uniform("oval", 1, 1.6), 2.2, 32)
        belly = kit.uniform("belly", 0.85, 1.12)
        levels = [
            (flat * s, z * height)
            for s, z in (
                (0.9, 0),
                (0.95 * belly, 0.25),
                (belly, 0.5),
                (0.95 * belly, 0.75),
                (0.9, 1),
            )
        ]
        kit.add(look.body, hollows.body(kit, levels, 0.06))
        kit.add(look.front, solids.stack([(flat * 0.97, height), (flat * 0.97, height + 0.03)]))
        x = float(flat[:, 0].max()) * belly
        kit.add(BLACK, box(0.02, 0.006, height * 0.7).at(x, 0, height / 2))
        kit.both(look.knob, ball(0.03, 0.03, 0.03, 8).at(x + 0.01, 0.05, height / 2))
        return
    width, depth, height = (
        kit.uniform("width", 0.38, 0.6),
        kit.uniform("depth", 0.34, 0.55),
        kit.uniform("height", 0.42, 0.8),
    )
    lift = _stand(kit, look, depth, width) if kind == "nightstand" else 0.0
    _body(kit, look.body, depth - 0.02, width, height - lift, lift, -0.01)
    if kind == "nightstand":
        _grid(
            kit,
            look,
            depth / 2 - 0.011,
            width,
            lift,
            height,
            1,
            kit.choose("drawers", 1, 2, 3),
            True,
        )
        _top(kit, look.body, depth, width, height)
        return
    kit.add(look.front, box(0.04, width * 0.86, height * 0.86, 0.012).at(depth / 2, 0, height / 2))
    kit.add(
        look.knob,
        cylinder(0.05, 0.03, 24).turned("y", 90).at(depth / 2 + 0.03, 0.05, height * 0.55),
        box(0.03, 0.12, 0.02).at(depth / 2 + 0.04, -0.1, height * 0.55),
    )


KINDS: dict[str, Callable[[Kit], None]] = {
    "wardrobe": _wardrobe,
    "chest": _chest,
    "sideboard": _sideboard,
    "bookcase": _bookcase,
    "shelf": _ladder_shelf,
    "display": _display,
    "filing": _filing,
    "kitchen": _kitchen,
    "corner": _corner_unit,
    "cubes": _cubes,
    "media": _media,
    "secretary": _secretary,
    "small": _trunk,
}

_WEIGHTS = {"wardrobe": 2, "chest": 2, "sideboard": 2, "bookcase": 2}

CASES = ("wardrobe", "chest", "sideboard", "filing")
"""The subtypes that can have an open back."""


def cabinet(kit: Kit) -> None:
    """Thirteen subtypes, see `KINDS`. Hidden: the depth of the recess in the underside."""
    kit.build_subtype(KINDS, _WEIGHTS)


def open_cabinet(kit: Kit) -> None:
    """A cabinet with a recessed back panel: `CASES` of `KINDS`. Hidden: the depth of the recess."""
    kit.visible["open_back"] = True
    kit.build_subtype({name: KINDS[name] for name in CASES})

"""Tables of many kinds, with random supports and tops."""

from collections.abc import Callable

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families import hollows, legs
from data_gen.catalogues.families.kit import (
    BLACK,
    GLASS,
    GOLD,
    RUBBER,
    WHITE,
    Kit,
    around,
    disc,
    fabric,
    lacquer,
    metal,
    paint,
    pick,
    rect,
    wood,
)
from data_gen.catalogues.solids import box, cylinder, lathe, rod, tube
from data_gen.mesh import Material

Outline = Callable[[float], np.ndarray]


def _materials(kit: Kit) -> tuple[Material, Material]:
    """Materials of the top and of its supports."""
    main = pick(kit.rng, (wood, wood, lacquer))(kit.rng)
    return main, main if kit.rng.random() < 0.5 else metal(kit.rng)


def _oval(x: float, y: float, power: float = 2.0) -> Outline:
    return lambda inward: solids.superellipse(x - 2 * inward, y - 2 * inward, power, 40)


def _kidney(x: float, y: float, bite: float) -> Outline:
    """A kidney-shaped outline: an oval with an indentation at -x."""
    oval = solids.superellipse(x, y, 2.3, 48)
    dent = np.exp(-((oval[:, 1] / (0.25 * y)) ** 2)) * (oval[:, 0] < 0)
    shape = oval + np.stack([dent * bite * x, 0 * dent], axis=1)
    return lambda inward: solids.inset(shape, inward) if inward else shape


def _top(kit: Kit, material: Material, outline: Outline, thick: float, height: float) -> float:
    """Adds a top whose upper face is at `height`; returns the height of its lower face."""
    if kit.chance("glass_top", 0.2):
        pane = 0.016
        kit.add(GLASS, solids.stack([(outline(0.0), height - pane), (outline(0.0), height)]))
        rail = max(0.7 * thick, 0.02)
        inner = outline(0.1 * float(np.ptp(outline(0.0)[:, 0])))
        centre = inner.mean(axis=0)
        inside = centre + 0.9 * (inner - centre)
        # An open frame of rails, and a plate in it with a recess in its underside.
        low = height - pane - rail
        ring = [
            np.column_stack([ring_, np.full(len(ring_), z)])
            for ring_, z in ((inner, low), (inner, low + rail), (inside, low + rail), (inside, low))
        ]
        kit.add(material, solids.loft(ring, loop=True))
        cross = hollows.slab(kit, "rail_recess", rect(0.1, 1.9 * float(inside[:, 1].max())), rail)
        kit.add(material, cross.at(z=low))
        return low + 0.002
    kit.add(material, hollows.slab(kit, "top_recess", outline, thick).at(z=height - thick))
    return height - thick + 0.002


def _size(kit: Kit) -> tuple[float, float, float, float]:
    """Depth, length, height and thickness of a dining table."""
    return (
        kit.uniform("depth", 0.6, 1.1),
        kit.uniform("length", 0.8, 2.4),
        kit.uniform("height", 0.68, 0.8),
        kit.uniform("thickness", 0.03, 0.13),
    )


def _dining(kit: Kit) -> None:
    main, frame = _materials(kit)
    depth, length, height, thick = _size(kit)
    under = _top(kit, main, rect(depth, length, kit.uniform("corner", 0.004, 0.1)), thick, height)
    x, y = depth / 2 - 0.07, length / 2 - kit.uniform("leg_inset", 0.06, 0.2)
    legs.four(kit, x, y, under, frame)
    if kit.chance("apron", 0.5):
        deep = kit.uniform("apron_height", 0.05, 0.12)
        kit.both(frame, box(2 * x, 0.02, deep).at(0, y, under - deep / 2))
        for sign in (-1, 1):
            kit.add(frame, box(0.02, 2 * y, deep).at(sign * x, 0, under - deep / 2))


def _stretcher(kit: Kit) -> None:
    """A heavy table with turned or square legs and stretchers near the floor."""
    main = wood(kit.rng)
    depth, length, height, thick = _size(kit)
    under = _top(kit, main, rect(depth, length, 0.01), max(thick, 0.06), height)
    x, y = depth / 2 - 0.1, length / 2 - 0.14
    legs.four(kit, x, y, under, main, "turned", "square", thick=kit.uniform("stout", 0.07, 0.13))
    low = kit.uniform("rail_height", 0.06, 0.25) * height
    if kit.chance("middle_rail", 0.5):
        kit.both(main, box(2 * x, 0.05, 0.06, 0.006).at(0, y, low))
        kit.add(main, box(0.05, 2 * y, 0.06, 0.006).at(0, 0, low))
    else:
        for sign in (-1, 1):
            kit.add(main, box(0.05, 2 * y, 0.06, 0.006).at(sign * x, 0, low))
        kit.both(main, box(2 * x, 0.05, 0.06, 0.006).at(0, y, low))


def _trestle(kit: Kit) -> None:
    main, frame = _materials(kit)
    depth, length, height, thick = _size(kit)
    under = _top(kit, main, rect(depth, length, 0.02), thick, height)
    y = length * kit.uniform("spread", 0.28, 0.4)
    style = kit.choose("trestle", "cross", "splayed", "board", "lyre")
    if style == "board":
        shape = [
            (-0.42, 0),
            (0.42, 0),
            (0.42, 0.05),
            (0.2, 0.12),
            (0.16, 0.6),
            (0.34, 1.0),
            (-0.34, 1.0),
            (-0.16, 0.6),
            (-0.2, 0.12),
            (-0.42, 0.05),
        ]
        board = solids.prism([(a * depth, b * under) for a, b in shape], 0.06)
        kit.both(frame, board.at(y=y))
    elif style == "lyre":
        half = [(-0.4, 0), (-0.3, 0.08), (-0.1, 0.2), (-0.25, 0.5), (-0.28, 0.75), (-0.1, 1.0)]
        path = solids.smooth_path([(a * depth, y, b * under) for a, b in half], 4)
        bar = solids.sweep(solids.rounded(0.05, 0.06, 0.01, 1), path, (0, 1, 0))
        kit.both(frame, bar, bar.scaled(-1, 1, 1))
    else:
        top = 0.3 if style == "cross" else -0.08
        for sign in (-1, 1):
            kit.both(
                frame,
                rod((sign * depth * 0.4, y, 0), (-sign * depth * top, y, under), 0.028),
            )
            if style == "splayed":
                kit.both(frame, box(depth * 0.5, 0.03, 0.04).at(0, y, under * 0.3))
    kit.add(frame, box(0.04, 2 * y, 0.08).at(0, 0, under * 0.5))


def _pedestal(kit: Kit) -> None:
    """One column, on a disc, a trumpet or claws, below a round or square top."""
    main, frame = _materials(kit)
    wide = kit.uniform("diameter", 0.55, 1.4)
    height = kit.choose("level", 0.74, 0.74, 0.55, 1.05) * kit.uniform("stretch", 0.95, 1.05)
    if height > 1:
        wide = kit.uniform("diameter", 0.5, 0.75)
    outline = disc(wide / 2, 40) if kit.chance("round_top", 0.7) else rect(wide, wide, 0.1 * wide)
    under = _top(kit, main, outline, kit.uniform("thickness", 0.025, 0.08), height)
    r = kit.uniform("column", 0.03, 0.12)
    foot = kit.choose("foot", "disc", "trumpet", "claws", "drum", "cross")
    if foot == "trumpet":
        kit.add(frame, legs.trumpet(wide * 0.36, r, under, 32))
        return
    if foot == "drum":
        waist = kit.uniform("waist", 0.5, 1.1)
        profile = [(0.3, 0), (0.32 * waist, 0.5 * under), (0.34, under)]
        kit.add(frame, lathe(solids.smooth_profile([(a * wide, z) for a, z in profile], 6), 36))
        return
    number = kit.choose("turning", 0, 1, 2, 3)
    profile = [(a * 1.6 * r, 0.08 + b * (under - 0.08)) for a, b in legs.TURNED[number]]
    kit.add(frame, lathe(solids.smooth_profile(profile, 3), 24))
    if foot == "disc":
        kit.add(frame, lathe([(wide * 0.33, 0), (wide * 0.33, 0.03), (r, 0.1)], 32))
        return
    count = 4 if foot == "cross" else kit.choose("claws", 3, 4)
    reach = wide * 0.4
    for angle in around(count, 45):
        if foot == "cross":
            arm = box(reach, 0.07, 0.05, 0.01).at(reach / 2, 0, 0.035)
        else:
            way = [(0, 0, 0.24), (reach * 0.4, 0, 0.2), (reach * 0.75, 0, 0.07), (reach, 0, 0.03)]
            arm = tube(solids.smooth_path(way, 4), np.linspace(0.05, 0.025, 13), 10)
        kit.add(frame, arm.turned("z", angle))
    kit.add(frame, cylinder(r * 1.1, 0.14, 20).at(z=0.12))


def _double_pedestal(kit: Kit) -> None:
    main, frame = _materials(kit)
    depth, length = kit.uniform("depth", 0.9, 1.2), kit.uniform("length", 1.8, 3.2)
    height = kit.uniform("height", 0.7, 0.78)
    outline = pick(
        kit.rng, (rect(depth, length, 0.2), _oval(depth, length), _oval(depth, length, 4))
    )
    under = _top(kit, main, outline, kit.uniform("thickness", 0.03, 0.08), height)
    y = length * 0.26
    style = kit.choose("columns", "turned", "blocks", "tulip")
    if style == "blocks":
        kit.both(frame, box(depth * 0.5, 0.12, under, 0.01).at(0, y, under / 2))
        kit.both(frame, box(depth * 0.7, 0.3, 0.06, 0.01).at(0, y, 0.03))
    elif style == "tulip":
        kit.both(frame, legs.trumpet(depth * 0.34, 0.05, under).at(y=y))
    else:
        profile = [(a * 0.13, 0.1 + b * (under - 0.1)) for a, b in legs.TURNED[3]]
        kit.both(frame, lathe(solids.smooth_profile(profile, 3), 20).at(y=y))
        for angle in around(3, 60):
            way = [(0, 0, 0.22), (0.2, 0, 0.16), (0.36, 0, 0.03)]
            arm = tube(solids.smooth_path(way, 4), np.linspace(0.045, 0.025, 9), 10)
            kit.both(frame, arm.turned("z", angle).at(y=y))


def _freeform(kit: Kit) -> None:
    """A kidney-shaped or oval table on legs along its outline, or on crossing boards."""
    main, frame = _materials(kit)
    length = kit.uniform("length", 0.9, 1.9)
    depth = length * kit.uniform("ratio", 0.45, 0.75)
    height = kit.choose("level", 0.4, 0.74)
    if kit.chance("kidney", 0.6):
        outline = _kidney(depth, length, kit.uniform("bite", 0.15, 0.4))
    else:
        outline = _oval(depth, length, kit.uniform("power", 1.6, 3.5))
    under = _top(kit, main, outline, kit.uniform("thickness", 0.02, 0.06), height)
    style = kit.choose("support", "legs", "boards", "stones")
    if style == "legs":
        legs.four(kit, depth * 0.3, length * 0.3, under, frame, "tapered", "sabre", "hairpin")
    elif style == "boards":
        turn = kit.uniform("cross", 25, 65)
        for sign in (-1, 1):
            board = box(depth * 0.75, 0.05, under, 0.01).turned("z", sign * turn)
            kit.add(frame, board.at(z=under / 2))
    else:
        for sign in (-1, 1):
            shape = solids.superellipse(depth * 0.5, length * 0.18, 2.5, 24)
            stone = [
                (shape * s, z * under) for s, z in ((0.9, 0), (1, 0.3), (0.85, 0.7), (0.75, 1))
            ]
            kit.add(frame, solids.stack(stone).at(y=sign * length * 0.24))


def _coffee(kit: Kit) -> None:
    main, frame = _materials(kit)
    height = kit.uniform("height", 0.3, 0.48)
    depth, length = kit.uniform("depth", 0.5, 0.9), kit.uniform("length", 0.7, 1.4)
    under = _top(kit, main, rect(depth, length, kit.uniform("corner", 0.004, 0.2)), 0.05, height)
    style = kit.choose("base", "shelf", "slabs", "frame", "drum", "waterfall")
    x, y = depth / 2 - 0.05, length / 2 - 0.06
    if style == "shelf":
        legs.four(kit, x, y, under, frame)
        level = height * kit.uniform("shelf", 0.15, 0.45)
        kit.add(main, box(2 * x, 2 * y, 0.025, 0.004).at(z=level))
    elif style == "slabs":
        thick = kit.uniform("slab", 0.04, 0.14)
        kit.both(frame, box(depth * 0.8, thick, under, 0.008).at(0, y - thick / 2, under / 2))
        kit.add(main, box(depth * 0.7, 2 * y, 0.03).at(z=under * 0.3))
    elif style == "frame":
        bar = 0.025
        for sign in (-1, 1):
            kit.add(frame, box(bar, 2 * y, bar).at(sign * x, 0, bar / 2))
            kit.both(frame, box(bar, bar, under).at(sign * x, y, under / 2))
        kit.both(frame, box(2 * x, bar, bar).at(0, y, bar / 2))
    elif style == "drum":
        kit.add(frame, box(depth * 0.6, length * 0.6, under, 0.02).at(z=under / 2))
    else:
        path = solids.smooth_path(
            [
                (0, -y, 0),
                (0, -y * 0.95, under * 0.7),
                (0, -y * 0.6, under),
                (0, y * 0.6, under),
                (0, y * 0.95, under * 0.7),
                (0, y, 0),
            ],
            5,
        )
        kit.add(frame, solids.sweep(solids.rounded(depth * 0.9, 0.03, 0.005, 1), path, (1, 0, 0)))


def _side(kit: Kit) -> None:
    """A small high table, such as a plant stand or a bedside table."""
    main, frame = _materials(kit)
    wide, height = kit.uniform("width", 0.3, 0.55), kit.uniform("height", 0.45, 0.95)
    outline = disc(wide / 2, 32) if kit.chance("round", 0.4) else rect(wide, wide, 0.02)
    under = _top(kit, main, outline, kit.uniform("thickness", 0.03, 0.14), height)
    x = wide * 0.33
    if kit.chance("three", 0.25):
        for angle in around(3, 30):
            foot = rod((wide * 0.42, 0, 0), (wide * 0.12, 0, under), 0.018)
            kit.add(frame, foot.turned("z", angle))
    else:
        legs.four(kit, x, x, under, frame)
    for k in range(kit.choose("shelves", 0, 1, 2)):
        kit.add(main, box(2 * x, 2 * x, 0.02).at(z=under * (0.2 + 0.3 * k)))


def _drawers(
    kit: Kit,
    main: Material,
    knob: Material,
    x: float,
    y: float,
    size: tuple[float, float, tuple[float, float]],
    count: int,
) -> None:
    """A stack of drawers centred at (x, y), from z = size[2][0] to size[2][1]."""
    deep, wide, (low, high) = size[0], size[1], size[2]
    kit.add(main, box(deep, wide, high - low, 0.004).at(x, y, (low + high) / 2))
    pitch = (high - low) / count
    for k in range(count):
        z = low + (k + 0.5) * pitch
        kit.add(main, box(0.02, wide * 0.94, pitch * 0.88, 0.003).at(x + deep / 2, y, z))
        kit.add(knob, box(0.02, wide * 0.35, 0.014, 0.003).at(x + deep / 2 + 0.018, y, z))


def _desk(kit: Kit) -> None:
    """A writing desk: drawers at one side or both, panels or legs, perhaps a hutch."""
    main, frame = _materials(kit)
    depth, length = kit.uniform("depth", 0.55, 0.9), kit.uniform("length", 1.1, 2.0)
    height, thick = kit.uniform("height", 0.7, 0.78), kit.uniform("thickness", 0.03, 0.07)
    under = _top(kit, main, rect(depth, length, 0.01), thick, height)
    knob = metal(kit.rng)
    wide = length * kit.uniform("drawers_width", 0.2, 0.32)
    both = kit.chance("both_sides", 0.45)
    side = kit.choose("drawers_side", -1, 1)
    low = kit.choose("drawers_low", 0.04, 0.3) * under
    for s in (-1, 1):
        y = s * (length / 2 - wide / 2 - 0.03)
        if both or s == side:
            _drawers(
                kit, main, knob, 0, y, (depth * 0.9, wide, (low, under)), 4 if low < 0.1 else 2
            )
        elif kit.chance("panel", 0.5):
            kit.add(frame, box(depth * 0.9, 0.03, under).at(0, s * (length / 2 - 0.03), under / 2))
        else:
            for x in (-0.4, 0.4):
                kit.add(
                    frame,
                    box(0.045, 0.045, under).at(x * depth, s * (length / 2 - 0.05), under / 2),
                )
    if low > 0.1:
        for x in (-0.4, 0.4):
            kit.both(frame, box(0.045, 0.045, under).at(x * depth, length / 2 - 0.05, under / 2))
    if kit.chance("modesty", 0.6):
        kit.add(main, box(0.02, length - 0.08, under * 0.6).at(-depth * 0.4, 0, under * 0.65))
    extra = kit.choose("on_top", "nothing", "nothing", "hutch", "shelf", "monitor")
    if extra == "hutch":
        tall, shelf = kit.uniform("hutch", 0.35, 0.7), depth * 0.35
        x = -depth / 2 + shelf / 2
        kit.both(main, box(shelf, 0.025, tall).at(x, length / 2 - 0.02, height + tall / 2))
        kit.add(main, box(0.02, length, tall).at(-depth / 2 + 0.01, 0, height + tall / 2))
        for z in (0.5, 1.0):
            kit.add(main, box(shelf, length, 0.025).at(x, 0, height + tall * z))
        kit.both(main, box(shelf, 0.02, tall).at(x, length / 6, height + tall / 2))
    elif extra == "shelf":
        kit.both(main, box(depth * 0.3, 0.03, 0.14).at(-depth * 0.3, length * 0.4, height + 0.07))
        kit.add(main, box(depth * 0.3, length * 0.86, 0.025).at(-depth * 0.3, 0, height + 0.15))
    elif extra == "monitor":
        kit.add(BLACK, box(0.04, 0.5, 0.32, 0.01).at(-depth * 0.2, 0, height + 0.26))
        kit.add(BLACK, box(0.03, 0.06, 0.2).at(-depth * 0.22, 0, height + 0.1))
        kit.add(BLACK, box(0.2, 0.26, 0.015).at(-depth * 0.2, 0, height + 0.007))
        kit.add(WHITE, box(0.15, 0.42, 0.02, 0.005).at(depth * 0.18, 0, height + 0.01))


def _panel_desk(kit: Kit) -> None:
    """A desk with a front panel. Hidden: the drawers behind it."""
    main, frame = _materials(kit)
    depth, length, height, _ = _size(kit)
    thick = 0.06
    kit.add(
        main, hollows.slab(kit, "top_recess", rect(depth, length, 0.02), thick).at(z=height - thick)
    )
    under = height - thick + 0.002
    kit.both(frame, box(depth * 0.94, 0.03, under, 0.004).at(0, length / 2 - 0.03, under / 2))
    # Cameras are above the horizon. Parts behind the panel are therefore invisible from the front
    # if they do not extend below its edge.
    edge = under * kit.uniform("panel_edge", 0.25, 0.5)
    kit.add(main, box(0.025, length - 0.06, under - edge).at(depth * 0.36, 0, (under + edge) / 2))
    count = kit.hide_count("pedestals", 3)
    wide = kit.hide("pedestal_width", 0.18, 0.3) * length
    left = bool(kit.hide_count("left", 2))
    for k in range(count):
        s = 1 if (k == 0) == left else -1
        tall = under - edge - 0.01
        block = box(depth * 0.66, wide, tall)
        kit.add(main, block.at(-0.02, s * (length / 2 - 0.05 - wide / 2), under - tall / 2))
    kit.azimuth = ((-30.0, 30.0),)


def _corner_desk(kit: Kit) -> None:
    """Two tops that meet at a right angle."""
    main, frame = _materials(kit)
    long, short = kit.uniform("length", 1.4, 2.2), kit.uniform("return", 1.1, 1.9)
    deep, height = kit.uniform("depth", 0.5, 0.75), kit.uniform("height", 0.7, 0.78)
    thick, mirror = kit.uniform("thickness", 0.03, 0.06), kit.choose("mirror", -1, 1)
    bevel = kit.uniform("corner_cut", 0.0, 0.35)
    shape = np.array(
        [(0, 0), (deep, 0), (deep, long - deep - bevel), (deep + bevel, long - deep),
         (short, long - deep), (short, long), (0, long)]
    )  # fmt: skip
    shape = (shape - [short / 2, long / 2]) * [1, mirror]

    def outline(inward: float) -> np.ndarray:
        return solids.inset(shape, inward)

    under = height - thick + 0.002
    kit.add(main, hollows.slab(kit, "top_recess", outline, thick).at(z=height - thick))
    knob = metal(kit.rng)
    x0, y0 = short / 2, long / 2
    kit.add(
        frame, box(deep * 0.92, 0.03, under).at(-x0 + deep / 2, -mirror * (y0 - 0.03), under / 2)
    )
    kit.add(frame, box(0.03, 0.03, under).at(-x0 + 0.04, mirror * (y0 - 0.04), under / 2))
    if kit.chance("drawers", 0.6):
        size = (deep * 0.9, deep * 0.8, (0.04, under))
        _drawers(kit, main, knob, x0 - deep * 0.5, mirror * (y0 - deep * 0.45), size, 3)
    else:
        for y in (y0 - 0.04, y0 - deep + 0.04):
            kit.add(frame, rod((x0 - 0.06, mirror * y, 0), (x0 - 0.06, mirror * y, under), 0.025))
    if kit.chance("back", 0.5):
        kit.add(main, box(0.02, long * 0.96, under * 0.6).at(-x0 + 0.02, 0, under * 0.66))


def _nest(kit: Kit) -> None:
    """Two or three nested tables, pulled apart."""
    main, frame = _materials(kit)
    depth, length = kit.uniform("depth", 0.35, 0.5), kit.uniform("length", 0.5, 0.75)
    height, step = kit.uniform("height", 0.45, 0.6), kit.uniform("step", 0.2, 0.8)
    count = kit.choose("tables", 2, 3, 3)
    share = kit.hide("top_recess", 0.02, 0.92)
    style = kit.choose("sides", "boards", "rods")
    for k in range(count):
        d, w, h = depth * (1 - 0.05 * k), length - 0.13 * k, height - 0.07 * k
        x = depth * step * (k - (count - 1) / 2)
        kit.add(main, solids.tray(rect(d, w, 0.02), 0.03, 0.015, share * 0.03).at(x, 0, h - 0.03))
        y, under = w / 2 - 0.02, h - 0.03
        if style == "boards":
            kit.both(frame, box(d * 0.9, 0.025, under).at(x, y, under / 2))
        else:
            for sign in (-1, 1):
                kit.both(
                    frame, rod((x + sign * d * 0.42, y, 0), (x + sign * d * 0.42, y, under), 0.012)
                )
            kit.both(frame, rod((x - d * 0.42, y, 0.02), (x + d * 0.42, y, 0.02), 0.012))


def _picnic(kit: Kit) -> None:
    """A picnic table with two benches on a common frame."""
    main = pick(kit.rng, (wood, wood, lacquer))(kit.rng)
    frame = legs.metal_or(kit, main, metal)
    length, height = kit.uniform("length", 1.2, 2.2), kit.uniform("height", 0.7, 0.78)
    wide, seat = kit.uniform("top_width", 0.6, 0.8), kit.uniform("seat_height", 0.4, 0.48)
    reach = wide / 2 + kit.uniform("gap", 0.25, 0.4)
    kit.add(main, hollows.slab(kit, "top_recess", rect(wide, length), 0.05).at(z=height - 0.05))
    boards = kit.choose("boards", 4, 5, 6)
    for x in (np.arange(1, boards) / boards - 0.5) * wide:
        kit.add(BLACK, box(0.008, length * 0.98, 0.002).at(x, 0, height))
    y = length * 0.34
    for sign in (-1, 1):
        kit.add(main, box(0.28, length, 0.045, 0.005).at(sign * reach, 0, seat - 0.02))
        kit.both(
            frame,
            rod((sign * (reach - 0.05), y, 0), (sign * wide * 0.25, y, height - 0.04), 0.035, 4),
        )
    kit.both(frame, box(2 * reach + 0.2, 0.05, 0.08).at(0, y, seat - 0.08))


def _console(kit: Kit) -> None:
    """A console table: long, narrow and high."""
    main, frame = _materials(kit)
    length, depth = kit.uniform("length", 0.9, 1.7), kit.uniform("depth", 0.26, 0.42)
    height = kit.uniform("height", 0.72, 1.0)
    half = kit.chance("half_moon", 0.35)
    if half:
        moon = solids.superellipse(2 * depth, length, 2.2, 48)
        moon = np.column_stack([np.maximum(moon[:, 0], 0.0) - depth / 2, moon[:, 1]])
        keep = np.concatenate([moon[:13], moon[36:]])
        kit.add(main, hollows.body(kit, [(keep, height - 0.12), (keep, height)], 0.1, "top_recess"))
        for x, y in ((-0.4, -0.42), (-0.4, 0.42), (0.2, -0.3), (0.2, 0.3)):
            for part in legs.leg(
                kit.choose("legs", "tapered", "sabre", "turned"), height - 0.11, 0.045, (x, y), 1
            ):
                kit.add(frame, part.at(x * depth, y * length))
        return
    under = _top(kit, main, rect(depth, length, 0.01), kit.uniform("thickness", 0.03, 0.16), height)
    style = kit.choose("base", "legs", "boards", "scrolls")
    if style == "legs":
        legs.four(kit, depth / 2 - 0.04, length / 2 - 0.06, under, frame)
        if kit.chance("shelf", 0.6):
            kit.add(main, box(depth - 0.06, length - 0.1, 0.025).at(z=under * 0.2))
    elif style == "boards":
        kit.both(frame, box(depth * 0.9, 0.04, under).at(0, length / 2 - 0.03, under / 2))
        kit.add(
            main, box(depth * 0.8, length - 0.1, 0.03).at(z=under * kit.uniform("shelf", 0.15, 0.7))
        )
    else:
        way = [(0, 0.4, 0.01), (0, 0.33, 0.2), (0, 0.44, 0.5), (0, 0.36, 0.75), (0, 0.42, 1.0)]
        path = solids.smooth_path([(0, b * length, c * under) for _, b, c in way], 5)
        bar = solids.sweep(solids.rounded(0.03, 0.03, 0.006, 1), path, (1, 0, 0))
        for sign in (-1, 1):
            kit.both(GOLD, bar.at(x=sign * depth * 0.35))
        kit.add(GOLD, rod((0, -length * 0.33, under * 0.2), (0, length * 0.33, under * 0.2), 0.012))
        kit.both(
            GOLD,
            rod(
                (-depth * 0.35, length * 0.33, under * 0.2),
                (depth * 0.35, length * 0.33, under * 0.2),
                0.012,
            ),
        )


def _games(kit: Kit) -> None:
    """A billiard table, or a table-tennis table with its net."""
    if kit.chance("billiard", 0.6):
        main, cloth = wood(kit.rng), fabric(kit.rng)
        length = kit.uniform("length", 2.0, 2.8)
        depth, height = length * 0.55, 0.82
        rail, body = 0.12, kit.uniform("body", 0.12, 0.3)
        base = [
            (solids.rounded(depth - 0.16, length - 0.16, 0.03), height - body),
            (solids.rounded(depth, length, 0.05), height - 0.06),
            (solids.rounded(depth, length, 0.05), height - 0.04),
        ]
        kit.add(main, hollows.body(kit, base, 0.7 * body))
        kit.add(cloth, box(depth - 0.1, length - 0.1, 0.02).at(z=height - 0.035))
        kit.both(main, box(depth, rail, 0.06, 0.01).at(0, length / 2 - rail / 2, height - 0.02))
        for sign in (-1, 1):
            kit.add(
                main,
                box(rail, length, 0.06, 0.01).at(sign * (depth / 2 - rail / 2), 0, height - 0.02),
            )
            for y in (-1, 0, 1):
                x = sign * (depth / 2 - rail / 2)
                spot = cylinder(0.05, 0.01, 16).at(
                    x * 0.97, y * (length / 2 - rail * 0.7), height + 0.011
                )
                kit.add(BLACK, spot)
        legs.four(
            kit,
            depth / 2 - 0.2,
            length / 2 - 0.25,
            height - body + 0.01,
            main,
            "turned",
            "square",
            "cabriole",
            "wedge",
            thick=kit.uniform("stout", 0.1, 0.18),
        )
        return
    top, frame = paint(kit.rng), metal(kit.rng)
    length, depth, height = kit.uniform("length", 2.4, 2.8), kit.uniform("depth", 1.4, 1.6), 0.76
    kit.add(top, hollows.slab(kit, "top_recess", rect(depth, length), 0.05).at(z=height - 0.05))
    kit.add(WHITE, box(depth + 0.2, 0.006, 0.15).at(z=height + 0.08))
    kit.add(
        WHITE,
        box(0.015, length, 0.003).at(z=height),
        box(depth, 0.03, 0.003).at(0, length / 2 - 0.02, height),
    )
    for t in (-0.35, -0.08, 0.08, 0.35):
        for sign in (-1, 1):
            kit.add(
                frame,
                rod(
                    (sign * depth * 0.4, t * length, 0),
                    (sign * depth * 0.4, t * length, height - 0.04),
                    0.025,
                ),
            )
        kit.add(frame, rod((-depth * 0.4, t * length, 0.1), (depth * 0.4, t * length, 0.1), 0.02))


def _drafting(kit: Kit) -> None:
    """A drafting table with a tilted board."""
    main, frame = pick(kit.rng, (wood, lacquer))(kit.rng), metal(kit.rng)
    depth, length = kit.uniform("depth", 0.6, 0.85), kit.uniform("length", 0.9, 1.4)
    height, tip = kit.uniform("height", 0.8, 1.0), kit.uniform("tip", 15, 50)
    kit.add(
        frame, hollows.slab(kit, "shelf_recess", rect(0.3, length * 0.7), 0.04).at(-0.02, 0, 0.28)
    )
    board = box(depth, length, 0.03, 0.004)
    lip = box(0.02, length * 0.9, 0.02).at(-depth / 2 + 0.03, 0, 0.02)
    for part in (board, lip):
        kit.add(main, part.turned("y", -tip).scaled(-1, 1, 1).at(z=height))
    y = length * 0.36
    for sign in (-1, 1):
        kit.both(frame, rod((sign * depth * 0.45, y, 0.0), (0, y, height - 0.02), 0.022))
    kit.both(frame, box(depth * 0.7, 0.04, 0.04).at(0, y, 0.3))
    kit.add(frame, rod((0, -y, height * 0.7), (0, y, height * 0.7), 0.015))


def _folding(kit: Kit) -> None:
    """A folding table with crossed legs."""
    main, frame = _materials(kit)
    depth, length = kit.uniform("depth", 0.4, 0.8), kit.uniform("length", 0.6, 1.8)
    height = kit.uniform("height", 0.5, 0.76)
    thick = kit.uniform("thickness", 0.02, 0.05)
    kit.add(
        main,
        hollows.slab(kit, "top_recess", rect(depth, length, 0.04), thick, 0.015).at(
            z=height - thick
        ),
    )
    under = height - thick
    r = kit.uniform("rod", 0.01, 0.02)
    if kit.chance("across", 0.5):
        # The legs cross at both ends of the table.
        for y, flip in ((length * 0.42, 1), (length * 0.38, -1)):
            kit.both(frame, rod((-flip * depth * 0.45, y, r), (flip * depth * 0.45, y, under), r))
            kit.add(frame, rod((-flip * depth * 0.45, -y, r), (-flip * depth * 0.45, y, r), r))
    else:
        for x, flip in ((depth * 0.4, 1), (depth * 0.34, -1)):
            for s in (-1, 1):
                kit.add(
                    frame,
                    rod((s * x, -flip * length * 0.45, r), (s * x, flip * length * 0.45, under), r),
                )
            kit.add(frame, rod((-x, -flip * length * 0.45, r), (x, -flip * length * 0.45, r), r))


def _with_chairs(kit: Kit) -> None:
    """A dining table and its chairs."""
    main, frame = _materials(kit)
    round_ = kit.chance("round", 0.4)
    chairs = kit.choose("chairs", 2, 4, 4, 6, 8)
    depth = kit.uniform("depth", 0.75, 1.0)
    length = depth if round_ else depth * kit.uniform("ratio", 1.2, 2.2)
    height = 0.75
    outline = disc(depth / 2 + 0.1, 36) if round_ else rect(depth, length, 0.03)
    under = _top(kit, main, outline, 0.05, height)
    if round_:
        kit.add(frame, legs.trumpet(depth * 0.3, 0.05, under))
    else:
        legs.four(kit, depth / 2 - 0.06, length / 2 - 0.06, under, frame)
    back, push = kit.uniform("chair_back", 0.35, 0.6), kit.uniform("pulled", 0.0, 0.3)
    cover = frame if kit.chance("wooden", 0.5) else fabric(kit.rng)
    style = kit.choose("chair_legs", "square", "tapered", "sabre")
    open_back = kit.chance("open_back", 0.5)

    def seat(x: float, y: float, turn: float) -> None:
        parts = [(cover, box(0.42, 0.42, 0.05, 0.015).at(z=0.44))]
        for a in (-1, 1):
            for b in (-1, 1):
                parts += [
                    (frame, p.at(a * 0.18, b * 0.18)) for p in legs.leg(style, 0.42, 0.04, (a, b))
                ]
        if open_back:
            parts += [
                (frame, rod((-0.19, s * 0.19, 0.44), (-0.24, s * 0.19, 0.46 + back), 0.016))
                for s in (-1, 1)
            ]
            parts += [
                (frame, box(0.02, 0.4, 0.06).at(-0.2 - 0.05 * t, 0, 0.46 + back * t))
                for t in (0.4, 0.7, 0.97)
            ]
        else:
            parts.append(
                (cover, box(0.04, 0.4, back, 0.01).turned("y", -6).at(-0.22, 0, 0.46 + back / 2))
            )
        for material, part in parts:
            kit.add(material, part.turned("z", turn).at(x, y))

    if round_:
        for angle in around(chairs, 0.0):
            r = depth / 2 + 0.2 + push
            seat(r * np.cos(np.radians(angle)), r * np.sin(np.radians(angle)), 180 + angle)
        return
    ends = chairs in (2, 6, 8)
    if ends:
        for s in (-1, 1):
            seat(0, s * (length / 2 + 0.15 + push), -90 * s)
    row = (chairs - 2 * ends) // 2
    for s in (-1, 1):
        for k in range(row):
            seat(
                s * (depth / 2 + 0.15 + push),
                (k - (row - 1) / 2) * 0.8 * length / row,
                180 if s > 0 else 0,
            )


def _workbench(kit: Kit) -> None:
    """A workbench with thick top, shelf and vice, or a trolley on wheels."""
    main = wood(kit.rng)
    frame = legs.metal_or(kit, main, metal, paint)
    depth, length = kit.uniform("depth", 0.5, 0.8), kit.uniform("length", 0.8, 1.8)
    height = kit.uniform("height", 0.8, 0.95)
    kit.add(
        main, hollows.slab(kit, "top_recess", rect(depth, length, 0.01), 0.08).at(z=height - 0.08)
    )
    trolley = kit.chance("wheels", 0.4)
    low = 0.1 if trolley else 0.0
    x, y = depth / 2 - 0.05, length / 2 - 0.06
    for a in (-1, 1):
        for b in (-1, 1):
            kit.add(
                frame,
                box(0.06, 0.06, height - 0.07 - low).at(a * x, b * y, (height - 0.07 + low) / 2),
            )
            if trolley:
                kit.add(RUBBER, cylinder(0.055, 0.03, 18).turned("x", 90).at(a * x, b * y, 0.055))
    for k in range(kit.choose("shelves", 1, 2)):
        kit.add(main, box(2 * x, 2 * y, 0.03).at(z=low + 0.15 + 0.32 * k))
    if kit.chance("pegboard", 0.4):
        tall = kit.uniform("board", 0.4, 0.8)
        kit.add(main, box(0.02, length, tall).at(-depth / 2 + 0.01, 0, height + tall / 2))
    elif not trolley:
        kit.add(frame, box(0.12, 0.22, 0.12, 0.01).at(depth / 2 + 0.04, y * 0.6, height - 0.08))


KINDS: dict[str, Callable[[Kit], None]] = {
    "dining": _dining,
    "stretcher": _stretcher,
    "trestle": _trestle,
    "pedestal": _pedestal,
    "double_pedestal": _double_pedestal,
    "freeform": _freeform,
    "coffee": _coffee,
    "side": _side,
    "desk": _desk,
    "panel_desk": _panel_desk,
    "corner_desk": _corner_desk,
    "nest": _nest,
    "picnic": _picnic,
    "console": _console,
    "games": _games,
    "drafting": _drafting,
    "folding": _folding,
    "with_chairs": _with_chairs,
    "workbench": _workbench,
}

_WEIGHTS = {"dining": 4, "coffee": 2, "desk": 2, "pedestal": 2}


def table(kit: Kit) -> None:
    """Nineteen subtypes, see `KINDS`. Hidden: the recess under the top, or parts behind a panel."""
    kit.build_subtype(KINDS, _WEIGHTS)

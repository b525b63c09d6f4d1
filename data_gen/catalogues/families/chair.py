"""Chairs: dining chairs, office chairs, stools, armchairs, garden chairs."""

import itertools
from collections.abc import Callable

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families import hollows, legs
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    GOLD,
    RUBBER,
    Kit,
    around,
    disc,
    fabric,
    lacquer,
    metal,
    paint,
    pick,
    plastic,
    rect,
    wood,
)
from data_gen.catalogues.solids import (
    Solid,
    ball,
    box,
    cushion,
    cylinder,
    lathe,
    pillow,
    rod,
    sheet,
    tube,
)
from data_gen.mesh import Material

BACKS = ("solid", "padded", "slats", "ladder", "spindles", "open", "splat", "cross", "hoop", "cane")


def back(
    kit: Kit, style: str, width: float, high: float, frame: Material, cover: Material
) -> list[tuple[Material, Solid]]:
    """The upright back of a chair, centred at y = 0, from z = 0 at the seat to `high`."""
    half = width / 2 - 0.02
    parts: list[tuple[Material, Solid]] = []

    def put(material: Material, *solids_: Solid) -> None:
        parts.extend((material, part) for part in solids_)

    def posts(radius: float = 0.016) -> None:
        put(frame, *(rod((0, s * half, -0.03), (0, s * half, high), radius) for s in (-1, 1)))

    if style == "solid":
        outline = solids.rounded(width, high, kit.uniform("back_round", 0.01, 0.2), 4)
        board = solids.stack([(outline, -0.0125), (outline, 0.0125)])
        put(frame, board.turned("x", 90).turned("z", 90).at(z=high / 2))
    elif style == "padded":
        thick = kit.uniform("back_pad", 0.06, 0.14)
        low = kit.uniform("back_gap", 0.0, 0.3) * high
        pad = cushion(high - low, width, thick, kit.uniform("back_corner", 3, 9), 4.0)
        put(cover, pad.turned("y", 90).at(0.01, 0, (high + low) / 2))
        put(
            frame,
            *(
                rod((0, s * half * 0.5, -0.03), (0, s * half * 0.5, high * 0.6), 0.014)
                for s in (-1, 1)
            ),
        )
    elif style == "slats":
        posts()
        put(frame, box(0.024, width, 0.07, 0.006).at(z=high - 0.03))
        put(frame, box(0.02, width - 0.03, 0.035).at(z=0.1))
        for y in np.linspace(-half, half, kit.choose("back_slats", 3, 4, 5, 7) + 2)[1:-1]:
            put(frame, box(0.012, 0.03, high - 0.12).at(0, y, high / 2 + 0.02))
    elif style == "ladder":
        posts(0.02)
        for z in np.linspace(high * 0.25, high - 0.035, kit.choose("back_rungs", 2, 3, 4, 5)):
            rung = solids.smooth_path([(0, -half, z), (-0.03, 0, z), (0, half, z)], 5)
            put(frame, solids.sweep(solids.rounded(0.06, 0.015, 0.005, 1), rung, (0, 0, 1)))
    elif style in ("spindles", "hoop"):
        bow = [
            (0, -half, 0.0),
            (-0.01, -half * 1.05, high * 0.55),
            (-0.02, -half * 0.6, high * 0.94),
            (-0.02, 0, high),
            (-0.02, half * 0.6, high * 0.94),
            (-0.01, half * 1.05, high * 0.55),
            (0, half, 0.0),
        ]
        put(frame, tube(solids.smooth_path(bow, 5), 0.015))
        if style == "hoop":
            inner = [(x, y * 0.62, z * 0.72) for x, y, z in bow]
            put(frame, tube(solids.smooth_path(inner, 5), 0.011))
            return parts
        for y in np.linspace(-half, half, kit.choose("back_spindles", 5, 7, 9) + 2)[1:-1]:
            top = high * (0.99 - 0.13 * (y / half) ** 2)
            put(frame, rod((0, y * 0.85, 0), (-0.02, y * 0.95, top), 0.007, 6))
    elif style == "splat":
        posts()
        crest = [
            (0, -half - 0.02, high),
            (0, -half * 0.5, high + 0.02),
            (0, 0, high + 0.05),
            (0, half * 0.5, high + 0.02),
            (0, half + 0.02, high),
        ]
        put(frame, tube(solids.smooth_path(crest, 4), 0.024))
        shape = [(0.3, 0), (0.2, 0.12), (0.34, 0.35), (0.18, 0.55), (0.4, 0.8), (0.28, 1.0)]
        curve = solids.smooth_profile([(a * half, b * high) for a, b in shape], 3)
        splat = [(-a, b) for a, b in curve] + [(a, b) for a, b in reversed(curve)]
        put(frame, solids.prism(splat, 0.014).turned("z", 90))
    elif style == "cross":
        posts()
        put(
            frame,
            box(0.02, width, 0.05, 0.006).at(z=high - 0.02),
            box(0.02, width, 0.03).at(z=0.08),
        )
        for s in (-1, 1):
            put(frame, rod((0, -s * half, 0.08), (0, s * half, high - 0.04), 0.011))
    elif style == "cane":
        posts(0.014)
        put(
            frame,
            box(0.02, width, 0.03).at(z=high - 0.01),
            box(0.02, width, 0.03).at(z=high * 0.35),
        )
        for t in np.linspace(-1, 1, 9)[1:-1]:
            put(cover, rod((0, t * half, high * 0.35), (0, t * half, high), 0.004, 5))
        for t in np.linspace(0.35, 1.0, 8)[1:-1]:
            put(cover, rod((0, -half, high * t), (0, half, high * t), 0.004, 5))
    else:  # "open": a frame with one band
        loop = [
            (0, -half, 0),
            (0, -half, high * 0.75),
            (0, -half * 0.75, high),
            (0, half * 0.75, high),
            (0, half, high * 0.75),
            (0, half, 0),
        ]
        put(frame, tube(solids.smooth_path(loop, 5), 0.014))
        band = high * kit.uniform("back_band", 0.25, 0.6)
        put(cover, pillow(0.03, 2 * half, band, 0.014, 2).at(z=high - band * 0.62))
    return parts


def _add_back(
    kit: Kit, depth: float, width: float, seat: float, frame: Material, cover: Material,
    low: float = 0.32, most: float = 0.6, styles: tuple[str, ...] = BACKS,
) -> None:  # fmt: skip
    high, lean = kit.uniform("back_height", low, most), kit.uniform("back_lean", 3, 18)
    for material, part in back(kit, kit.choose("back", *styles), width, high, frame, cover):
        kit.add(material, part.turned("y", -lean).at(-depth / 2 + 0.02, 0, seat))


def _arms(
    kit: Kit, depth: float, width: float, seat: float, frame: Material, pad: Material
) -> None:
    if not kit.chance("arms", 0.4):
        return
    top, y = seat + kit.uniform("arm_height", 0.17, 0.28), width / 2 + 0.015
    style = kit.choose("arm", "posts", "loops", "swept")
    if style == "posts":
        kit.both(frame, rod((depth * 0.32, y, seat - 0.03), (depth * 0.32, y, top), 0.014))
        kit.both(pad, box(depth * 0.95, 0.06, 0.025, 0.008).at(-0.02, y, top))
        return
    way = [
        (-depth * 0.44, y, seat - 0.02),
        (-depth * 0.46, y, top - 0.03),
        (-depth * 0.3, y, top),
        (depth * 0.3, y, top),
        (depth * 0.4, y, top - 0.05),
        (depth * 0.36, y, seat - 0.02),
    ]
    if style == "swept":
        way = [
            (-depth * 0.5, y - 0.03, top + 0.06),
            (-depth * 0.2, y + 0.02, top),
            (depth * 0.2, y + 0.03, top - 0.01),
            (depth * 0.34, y + 0.02, top - 0.06),
            (depth * 0.28, y, seat - 0.02),
        ]
    kit.both(frame, tube(solids.smooth_path(way, 4), 0.017))


def _seat(kit: Kit, cover: Material, depth: float, width: float, level: float) -> float:
    """Adds a seat whose upper face is at `level`; returns the height of its lower face."""
    thick = kit.uniform("seat_thickness", 0.05, 0.09)
    shape = kit.choose("seat", "square", "round", "trapeze")
    outline = rect(depth, width, kit.uniform("seat_round", 0.01, 0.1))
    if shape == "round":
        flat = solids.superellipse(depth, width, 3.0, 28)
        outline = lambda inward: flat * (1 - 2 * inward / depth)  # noqa: E731
    elif shape == "trapeze":
        square = solids.rounded(depth, width, 0.04)
        narrow = square * np.stack(
            [np.ones(len(square)), 1 + 0.18 * square[:, 0] / depth - 0.09], axis=1
        )
        outline = lambda inward: narrow * (1 - 2 * inward / depth)  # noqa: E731
    kit.add(cover, hollows.slab(kit, "seat_recess", outline, thick, 0.025).at(z=level - thick))
    if kit.chance("cushion", 0.3):
        soft = cushion(depth * 0.95, width * 0.95, 0.09, 5.0, 2.5, 24)
        kit.add(fabric(kit.rng), soft.at(z=level + 0.02))
    return level - thick + 0.005


def _frame(kit: Kit) -> tuple[Material, Material]:
    frame = pick(kit.rng, (wood, wood, metal, lacquer))(kit.rng)
    return frame, fabric(kit.rng) if kit.rng.random() < 0.6 else frame


def _size(kit: Kit) -> tuple[float, float, float]:
    """Depth, width and height of a seat."""
    return (
        kit.uniform("depth", 0.36, 0.54),
        kit.uniform("width", 0.36, 0.56),
        kit.uniform("seat_height", 0.38, 0.5),
    )


def _dining(kit: Kit) -> None:
    frame, cover = _frame(kit)
    depth, width, seat = _size(kit)
    under = _seat(kit, cover, depth, width, seat)
    x, y = depth / 2 - 0.035, width / 2 - 0.05
    legs.four(kit, x, y, under, frame, thick=kit.uniform("thick", 0.025, 0.055))
    if kit.visible["legs"] in ("square", "turned") and kit.chance("stretchers", 0.6):
        z = under * kit.uniform("stretcher_height", 0.2, 0.45)
        kit.both(frame, rod((-x, y, z), (x, y, z), 0.01))
        kit.add(frame, rod((0, -y, z), (0, y, z), 0.01))
    _add_back(kit, depth, width, seat, frame, cover)
    _arms(kit, depth, width, seat, frame, cover)


def _high_back(kit: Kit) -> None:
    """A dining chair with a tall, narrow back."""
    frame, cover = _frame(kit)
    depth, width, seat = kit.uniform("depth", 0.38, 0.5), kit.uniform("width", 0.36, 0.46), 0.46
    under = _seat(kit, cover, depth, width, seat)
    legs.four(kit, depth / 2 - 0.03, width / 2 - 0.03, under, frame, "square", "sabre", "turned")
    _add_back(
        kit,
        depth,
        width,
        seat,
        frame,
        cover,
        0.65,
        1.1,
        ("padded", "ladder", "slats", "solid", "splat"),
    )


def _office(kit: Kit) -> None:
    frame = pick(kit.rng, (CHROME, BLACK))
    cover = fabric(kit.rng)
    depth, width = kit.uniform("depth", 0.44, 0.56), kit.uniform("width", 0.44, 0.58)
    seat = kit.uniform("seat_height", 0.42, 0.58)
    under = seat - 0.07
    kit.add(
        BLACK,
        hollows.slab(kit, "seat_recess", rect(depth * 0.8, width * 0.8, 0.06), 0.06).at(z=under),
    )
    kit.add(cover, cushion(depth, width, 0.12, kit.uniform("corner", 3, 7), 3.0).at(z=seat))
    legs.star_base(kit, kit.uniform("base_radius", 0.26, 0.36), under + 0.01, frame)
    style = kit.choose("back", "low", "tall", "mesh", "shell", "drawing")
    lean = kit.uniform("back_lean", 3, 15)
    high = (
        kit.uniform("back_height", 0.35, 0.85)
        if style != "low"
        else kit.uniform("low_back", 0.2, 0.32)
    )
    rear = -depth / 2

    def tilt(part: Solid) -> Solid:
        return part.turned("y", -lean).at(rear - 0.02, 0, seat)

    if style in ("low", "tall", "drawing"):
        gap = 0.16 if style == "low" else 0.04
        pad = cushion(high, width * kit.uniform("back_width", 0.75, 1.0), 0.11, 4.0, 3.0)
        kit.add(cover, tilt(pad.turned("y", 90).at(0.02, 0, gap + high / 2)))
        kit.add(
            frame,
            tilt(
                tube(
                    solids.smooth_path(
                        [(0.2, 0, -0.06), (-0.03, 0, -0.03), (-0.05, 0, gap + high * 0.5)], 4
                    ),
                    0.022,
                )
            ),
        )
        if style == "drawing":
            for k in range(4):
                roll = cylinder(0.055, width, 16, 0.015).turned("x", 90)
                kit.add(cover, tilt(roll.at(0.05, 0, 0.1 + k * high / 4)))
    else:
        t = np.linspace(-1, 1, 13)
        rows = [
            np.stack(
                [
                    0.09 * t**2 + 0.05 * np.sin(3 * v),
                    t * width * (0.5 - 0.08 * v),
                    0 * t + v * high + 0.03,
                ],
                axis=1,
            )
            for v in np.linspace(0, 1, 7)
        ]
        kit.add(cover, tilt(sheet(np.array(rows), 0.02 if style == "mesh" else 0.05)))
        kit.add(
            frame,
            tilt(
                tube(
                    solids.smooth_path(
                        [(0.2, 0, -0.06), (-0.03, 0, -0.03), (-0.02, 0, high * 0.5)], 4
                    ),
                    0.022,
                )
            ),
        )
    if style in ("tall", "mesh") and kit.chance("headrest", 0.4):
        kit.add(
            cover,
            tilt(
                cushion(0.14, width * 0.6, 0.08, 3.0, 2.5).turned("y", 90).at(0.03, 0, high + 0.16)
            ),
        )
        kit.add(frame, tilt(rod((-0.01, 0, high * 0.8), (-0.01, 0, high + 0.16), 0.012)))
    if kit.chance("arms", 0.65):
        top, y = seat + kit.uniform("arm_height", 0.18, 0.26), width / 2 + 0.03
        if kit.chance("arm_loops", 0.5):
            way = [
                (0.1, y - 0.08, under),
                (0.12, y, under + 0.02),
                (0.12, y, top - 0.03),
                (0.05, y, top),
                (-0.18, y, top),
            ]
            kit.both(frame, tube(solids.smooth_path(way, 4), 0.018))
        else:
            kit.both(
                frame,
                rod((0, y, under + 0.02), (0, y, top), 0.02),
                rod((0, y - 0.1, under + 0.02), (0, y, under + 0.02), 0.018),
            )
        kit.both(BLACK, cushion(0.28, 0.08, 0.04, 3.0, 3.0, 20).at(-0.03, y, top + 0.01))


def _cantilever(kit: Kit) -> None:
    """A cantilever chair on two runners."""
    frame = pick(kit.rng, (CHROME, CHROME, metal(kit.rng), paint(kit.rng)))
    cover = fabric(kit.rng)
    depth, width, seat = _size(kit)
    x, y = depth / 2, width / 2 - 0.005
    high = seat + kit.uniform("back_height", 0.35, 0.5)
    shape = kit.choose("profile", "c", "s", "loop")
    if shape == "loop":
        way = [
            (-x, y, 0.016),
            (x * 0.9, y, 0.016),
            (x, y, 0.05),
            (x, y, seat * 0.6),
            (x * 0.95, y, seat + 0.2),
            (x * 0.6, y, seat + 0.22),
            (-x, y, seat + 0.2),
        ]
    elif shape == "s":
        way = [
            (-x * 0.7, y, 0.016),
            (x * 0.8, y, 0.016),
            (x * 1.2, y, 0.12),
            (x * 1.1, y, seat * 0.6),
            (x * 0.9, y, seat - 0.02),
            (x * 0.5, y, seat - 0.04),
            (-x * 0.8, y, seat - 0.06),
            (-x * 1.05, y, seat + 0.05),
            (-x * 1.3, y, high),
        ]
    else:
        way = [
            (-x, y, 0.016),
            (x * 0.7, y, 0.016),
            (x * 0.95, y, 0.06),
            (x, y, seat * 0.6),
            (x * 0.9, y, seat - 0.04),
            (x * 0.5, y, seat - 0.03),
            (-x * 0.95, y, seat - 0.03),
            (-x * 1.02, y, seat + 0.05),
            (-x * 1.15, y, high),
        ]
    kit.both(frame, tube(solids.smooth_path(way, 4), 0.013))
    kit.add(frame, rod((way[0][0], -y, 0.016), (way[0][0], y, 0.016), 0.013))
    thick = kit.uniform("seat_thickness", 0.05, 0.08)
    kit.add(
        cover,
        hollows.slab(kit, "seat_recess", rect(depth, 2 * y, 0.03), thick, 0.02).at(
            z=seat - thick / 2
        ),
    )
    tall = kit.uniform("pad", 0.2, 0.36)
    pad = cushion(tall, 2 * y, 0.06, 5.0, 3.0).turned("y", 90).turned("y", -10)
    kit.add(cover, pad.at(-x * 1.12, 0, high - tall * 0.45))
    if shape == "loop":
        kit.both(frame, rod((-x * 1.0, y, seat), (-x * 1.12, y, high - 0.05), 0.012))
    elif kit.chance("arms", 0.5):
        arm = [
            (-x * 1.1, y, seat + 0.26),
            (0, y + 0.02, seat + 0.24),
            (x * 0.6, y + 0.02, seat + 0.23),
            (x * 0.85, y, seat + 0.1),
            (x * 0.88, y, seat - 0.04),
        ]
        kit.both(frame, tube(solids.smooth_path(arm, 4), 0.012))
    if kit.chance("sled", 0.3):
        kit.both(frame, rod((-x * 0.9, y, 0.016), (-x * 0.9, y, seat - 0.03), 0.013))


def _stool(kit: Kit) -> None:
    """A stool or bar stool, round or square, on legs or a column."""
    frame, cover = _frame(kit)
    tall = kit.chance("bar", 0.6)
    seat = kit.uniform("bar_height", 0.62, 0.82) if tall else kit.uniform("stool_height", 0.38, 0.5)
    width = kit.uniform("stool_width", 0.3, 0.44)
    thick = kit.uniform("seat_thickness", 0.045, 0.1)
    outline = (
        disc(width / 2, 28) if kit.chance("round_seat", 0.6) else rect(width, width * 0.9, 0.04)
    )
    kit.add(cover, hollows.slab(kit, "seat_recess", outline, thick, 0.025).at(z=seat - thick))
    under = seat - thick + 0.005
    base = kit.choose("base", "four", "three", "column", "star", "box", "drum")
    if base == "column":
        kit.add(CHROME, legs.trumpet(0.22, 0.025, under, 32))
        kit.add(
            CHROME,
            lathe([(0.15, 0), (0.165, 0), (0.165, 0.015), (0.15, 0.015)], 32, True).at(
                z=under * 0.4
            ),
        )
        kit.add(CHROME, rod((-0.15, 0, under * 0.41), (0.15, 0, under * 0.41), 0.009))
    elif base == "star":
        legs.star_base(kit, 0.25, under, pick(kit.rng, (CHROME, BLACK)))
    elif base == "box":
        for s in (-1, 1):
            kit.add(
                frame, box(0.03, width * 0.9, under, 0.004).at(s * (width / 2 - 0.03), 0, under / 2)
            )
        kit.add(frame, box(width * 0.86, 0.03, under * 0.3).at(z=under * 0.7))
    elif base == "drum":
        waist = kit.uniform("waist", 0.35, 1.2)
        profile = [(0.42, 0.0), (0.42 * waist, under / 2), (0.45, under)]
        kit.add(frame, lathe(solids.smooth_profile([(a * width, z) for a, z in profile], 5), 32))
    else:
        count = 3 if base == "three" else 4
        foot = width / 2 + kit.uniform("splay", -0.03, 0.08)
        for angle in around(count, 45):
            kit.add(
                frame,
                tube([(foot, 0, 0), (width * 0.32, 0, under)], [0.014, 0.019], 10).turned(
                    "z", angle
                ),
            )
        if tall or kit.chance("rungs", 0.5):
            for z in (0.3, 0.5)[: kit.choose("rung_rows", 1, 2)]:
                r = foot + (width * 0.32 - foot) * z
                ends = [
                    (r * np.cos(np.radians(a)), r * np.sin(np.radians(a)), under * z)
                    for a in (*around(count, 45), 45)
                ]
                for a, b in itertools.pairwise(ends):
                    kit.add(frame, rod(a, b, 0.009))
    if tall and kit.chance("stool_back", 0.5):
        _add_back(
            kit,
            width,
            width,
            seat,
            frame,
            cover,
            0.2,
            0.4,
            ("padded", "open", "ladder", "slats", "solid"),
        )


def _armchair(kit: Kit) -> None:
    """An armchair."""
    cover = fabric(kit.rng)
    soft = cover if kit.rng.random() < 0.6 else fabric(kit.rng)
    foot = pick(kit.rng, (wood, metal))(kit.rng)
    depth, width = kit.uniform("depth", 0.65, 0.95), kit.uniform("width", 0.62, 1.0)
    arm, thick = kit.uniform("arm_width", 0.08, 0.22), kit.uniform("back_thickness", 0.12, 0.24)
    seat, top = kit.uniform("seat_height", 0.34, 0.46), kit.uniform("height", 0.68, 1.1)
    lift = kit.uniform("leg_height", 0.04, 0.18)
    base, inner = seat - 0.14 - lift, width - 2 * arm
    base = max(base, 0.06)
    kit.add(
        cover, hollows.slab(kit, "base_recess", rect(depth, width, 0.05), base, 0.05).at(z=lift)
    )
    legs.four(
        kit,
        depth / 2 - 0.06,
        width / 2 - 0.06,
        lift + 0.02,
        foot,
        "square",
        "tapered",
        "wedge",
        "round",
    )
    kit.add(
        soft,
        cushion(depth - thick, inner, 0.2, 7.0, kit.uniform("puff", 2.5, 8)).at(
            thick / 2, 0, seat - 0.07
        ),
    )
    low = lift + base
    style = kit.choose("shape", "square", "wing", "tub", "rolled")
    rear = -depth / 2
    if style == "tub":
        angle = np.linspace(np.radians(60), np.radians(300), 25)
        x, y = np.cos(angle) * (depth / 2), np.sin(angle) * (width / 2)
        slope = kit.uniform("slope", 0.2, 0.7)
        share = 1 - slope * np.clip((np.cos(angle) + 0.7) / 1.2, 0, 1)
        rows = [
            np.stack(
                [x * (1 + 0.1 * t), y * (1 + 0.1 * t), lift + 0.03 + t * (top - lift) * share],
                axis=1,
            )
            for t in np.linspace(0, 1, 5)
        ]
        kit.add(cover, sheet(np.array(rows), max(arm * 0.7, 0.07)))
        return
    high = seat + kit.uniform("arm_height", 0.14, 0.28)
    wide = width if style == "square" and kit.chance("wide_back", 0.5) else inner + 0.02
    body = pillow(thick, wide, top - low, 0.07).turned("y", -kit.uniform("lean", 0, 12))
    kit.add(cover, body.at(rear + thick / 2, 0, (top + low) / 2))
    side = pillow(depth * 0.98, arm, high - low + 0.04, 0.05).at(
        0, width / 2 - arm / 2, (high + low) / 2 - 0.02
    )
    kit.both(cover, side)
    if style == "rolled":
        roll = cylinder(max(arm * 0.6, 0.07), depth, 20, 0.02).turned("y", 90)
        kit.both(cover, roll.at(0, width / 2 - arm / 2 + 0.02, high))
    if style == "wing":
        shape = [
            (0, high - 0.1),
            (depth * 0.45, high - 0.05),
            (depth * 0.42, high + 0.2),
            (depth * 0.3, top),
            (0, top + 0.02),
        ]
        kit.both(
            cover,
            solids.prism(solids.inset(np.array(shape), 0.0), 0.08, 0.02).at(
                rear, inner / 2 + 0.02, 0
            ),
        )
    kit.add(
        soft,
        cushion(top - seat, inner - 0.02, 0.2, 3.5, 4.0)
        .turned("y", 78)
        .at(rear + thick + 0.04, 0, (top + seat) / 2),
    )
    if kit.chance("ottoman", 0.2):
        kit.add(soft, cushion(0.45, 0.5, 0.22, 6.0, 4.0).at(depth / 2 + 0.55, 0, 0.28))
        kit.add(cover, box(0.4, 0.45, 0.15, 0.02).at(depth / 2 + 0.55, 0, 0.14))
        for s in (-1, 1):
            kit.both(foot, cylinder(0.02, 0.1, 10).at(depth / 2 + 0.55 + s * 0.16, 0.18, 0.05))


def _rocking(kit: Kit) -> None:
    frame, cover = _frame(kit)
    depth, width, seat = _size(kit)
    under = _seat(kit, cover, depth, width, seat)
    y, long = width / 2 - 0.03, kit.uniform("rocker", 0.75, 1.05)
    rise_ = kit.uniform("rocker_rise", 0.08, 0.16)
    rocker = solids.rise(
        lambda t: ((t - 0.5) * long - 0.06, y, 0.02 + rise_ * (2 * t - 1) ** 2), 16
    )
    kit.both(frame, solids.sweep(solids.rounded(0.03, 0.04, 0.006, 1), rocker, (0, 1, 0)))
    for s in (-1, 1):
        kit.both(
            frame, rod((s * depth * 0.45 - 0.03, y, 0.04), (s * depth * 0.38, y, under), 0.018)
        )
    kit.both(frame, rod((-depth * 0.4, y, under * 0.5), (depth * 0.4, y, under * 0.5), 0.01))
    _add_back(
        kit,
        depth,
        width,
        seat,
        frame,
        cover,
        0.55,
        0.85,
        ("slats", "spindles", "ladder", "padded", "cane", "splat"),
    )
    top = seat + 0.22
    kit.both(
        frame,
        box(depth * 1.05, 0.06, 0.025, 0.008).at(-0.02, y + 0.02, top),
        rod((depth * 0.36, y, under), (depth * 0.4, y + 0.02, top), 0.014),
    )


def _folding(kit: Kit) -> None:
    """A folding garden chair or director's chair."""
    frame, cover = pick(kit.rng, (wood, metal, lacquer))(kit.rng), fabric(kit.rng)
    depth, width, seat = _size(kit)
    y = width / 2
    director = kit.chance("director", 0.4)
    kit.add(
        cover,
        hollows.slab(kit, "seat_recess", rect(depth, width - 0.03, 0.01), 0.05, 0.02).at(
            z=seat - 0.05
        ),
    )
    high = seat + kit.uniform("back_height", 0.35, 0.5)
    if director:
        for x, flip in (
            (depth * 0.4, 1),
            (depth * 0.36, -1),
            (-depth * 0.4, 1),
            (-depth * 0.36, -1),
        ):
            kit.add(frame, rod((x, -flip * y, 0.03), (x, flip * y, seat - 0.03), 0.014, 6))
        kit.both(frame, rod((-depth / 2, y, 0.02), (depth / 2, y, 0.02), 0.018, 6))
        kit.both(frame, box(depth, 0.06, 0.025, 0.006).at(0, y, seat + 0.22))
        for x in (-0.42, 0.38):
            kit.both(frame, rod((x * depth, y, seat - 0.04), (x * depth, y, seat + 0.22), 0.014))
        kit.both(frame, rod((-0.42 * depth, y, seat), (-0.5 * depth, y, high), 0.014))
        kit.add(cover, box(0.02, 2 * y + 0.02, 0.18, 0.004).at(-0.49 * depth, 0, high - 0.09))
        return
    kit.both(frame, rod((depth * 0.5, y, 0), (-depth * 0.62, y, high), 0.014, 6))
    kit.both(
        frame, rod((-depth * 0.5, y - 0.02, 0), (depth * 0.42, y - 0.02, seat - 0.02), 0.014, 6)
    )
    for x, z in ((0.47, 0.05), (-0.46, 0.05)):
        kit.add(frame, rod((x * depth, -y, z), (x * depth, y, z), 0.01, 6))
    for t in np.linspace(0.62, 0.98, kit.choose("slats", 1, 2, 3)):
        x, z = depth * (0.5 - 1.12 * t), high * t
        kit.add(cover, box(0.015, 2 * y, 0.1, 0.004).turned("y", -20).at(x, 0, z))


def _lounger(kit: Kit) -> None:
    """Deck chair, Adirondack, recliner, sun lounger."""
    frame, cover = pick(kit.rng, (wood, wood, lacquer))(kit.rng), fabric(kit.rng)
    width = kit.uniform("width", 0.5, 0.68)
    y = width / 2
    style = kit.choose("style", "deck", "adirondack", "sun", "recliner")
    size, x, z = {
        "deck": ((0.07, width), -0.5, 0.0),
        "adirondack": ((0.08, width), 0.42, 0.3),
        "sun": ((1.5, width), 0.3, 0.2),
        "recliner": ((0.6, width * 0.9), -0.05, 0.03),
    }[style]
    kit.add(frame, hollows.slab(kit, "base_recess", rect(*size, 0.01), 0.06).at(x, 0, z))
    if style == "deck":
        kit.both(
            frame,
            rod((0.62, y, 0.02), (-0.55, y, 0.95), 0.018, 6),
            rod((-0.5, y - 0.03, 0.02), (0.42, y - 0.03, 0.42), 0.018, 6),
        )
        kit.add(
            frame,
            rod((-0.55, -y, 0.95), (-0.55, y, 0.95), 0.016),
            rod((0.42, -y, 0.42), (0.42, y, 0.42), 0.016),
        )
        sling = solids.smooth_path(
            [(0.42, 0, 0.42), (0.15, 0, 0.24), (-0.15, 0, 0.36), (-0.55, 0, 0.95)], 5
        )
        kit.add(cover, solids.sweep(solids.rounded(2 * y - 0.08, 0.02, 0.003, 1), sling, (0, 1, 0)))
    elif style == "adirondack":
        kit.both(
            frame,
            solids.prism([(0.42, 0), (0.5, 0), (0.5, 0.4), (0.42, 0.4)], 0.05).at(y=y),
            rod((0.45, y - 0.04, 0.36), (-0.55, y - 0.04, 0.03), 0.035, 4),
            box(0.75, 0.12, 0.03, 0.006).at(0.12, y, 0.56),
            rod((-0.22, y, 0.1), (-0.22, y, 0.56), 0.02, 4),
            rod((0.45, y, 0.36), (0.45, y, 0.56), 0.02, 4),
        )
        for t in np.linspace(0.05, 0.7, 6):
            kit.add(
                frame,
                box(0.08, 2 * y - 0.06, 0.02, 0.004)
                .turned("y", -18)
                .at(0.45 - t * 0.9, 0, 0.37 - t * 0.3),
            )
        for k, b in enumerate(np.linspace(-0.8, 0.8, 5) * y):
            tall = 0.62 + 0.12 * np.cos((k - 2) * 0.7)
            kit.add(
                frame,
                box(0.02, 0.1, tall, 0.004)
                .turned("x", -b * 20)
                .turned("y", -28)
                .at(-0.3 - 0.18, b * 1.1, 0.2 + tall / 2),
            )
    elif style == "sun":
        lift, lean = kit.uniform("level", 0.25, 0.29), kit.uniform("lean", 20, 75)
        kit.both(frame, box(1.9, 0.05, 0.05, 0.006).at(0.3, y, lift))
        for x in (-0.5, 1.1):
            kit.both(frame, box(0.05, 0.05, lift).at(x, y, lift / 2))
        kit.add(cover, cushion(1.25, 2 * y - 0.03, 0.1, 9.0, 4.0).at(0.62, 0, lift + 0.05))
        rest = cushion(0.75, 2 * y - 0.03, 0.1, 9.0, 4.0).at(-0.36).turned("y", lean)
        kit.add(cover, rest.at(0.02, 0, lift + 0.05))
    else:
        lean = kit.uniform("lean", 20, 45)
        kit.add(
            cover,
            cushion(0.55, 2 * y, 0.2, 6.0, 4.0).at(0, 0, 0.4),
            cushion(0.22, 2 * y, 0.8, 3.0, 5.0).turned("y", -lean).at(-0.45, 0, 0.75),
        )
        kit.add(
            cover,
            cushion(0.5, 2 * y, 0.14, 6.0, 4.0)
            .turned("y", kit.uniform("footrest", 0, 30))
            .at(0.52, 0, 0.34),
        )
        kit.both(cover, pillow(0.85, 0.18, 0.5, 0.07).at(-0.05, y + 0.08, 0.36))
        kit.add(cover, box(0.7, 2 * y, 0.25, 0.03).at(-0.05, 0, 0.2))


def _shell(kit: Kit) -> None:
    """A moulded seat on rods, dowels, a tulip foot or a star foot."""
    cover, frame = pick(kit.rng, (plastic, lacquer, paint, wood))(kit.rng), metal(kit.rng)
    width, depth = kit.uniform("width", 0.44, 0.7), kit.uniform("depth", 0.42, 0.55)
    seat, high = kit.uniform("seat_height", 0.36, 0.46), kit.uniform("back_height", 0.3, 0.75)
    bucket = kit.uniform("bucket", 0.0, 1.0)
    t = np.linspace(-1, 1, 15)
    path = solids.smooth_path(
        [
            (depth * 0.52, 0, -0.04),
            (depth * 0.42, 0, 0.0),
            (0, 0, -0.015),
            (-depth * 0.36, 0, 0.0),
            (-depth * 0.5, 0, 0.09),
            (-depth * 0.58, 0, high * 0.5),
            (-depth * 0.7, 0, high),
        ],
        4,
    )
    rows = []
    for k, (x, _, z) in enumerate(path):
        v = k / (len(path) - 1)
        wide = (
            width
            / 2
            * (
                0.85
                + 0.15 * np.sin(np.pi * min(v * 1.3, 1))
                - 0.35 * bucket * max(v - 0.75, 0) / 0.25
            )
        )
        curl = bucket * (0.32 * np.exp(-(((v - 0.5) / 0.22) ** 2)) + 0.04)
        rows.append(
            np.stack(
                [
                    x + bucket * 0.16 * t**4 * np.clip((v - 0.45) * 3, 0, 1),
                    t * wide,
                    z + curl * np.abs(t) ** 4,
                ],
                axis=1,
            )
        )
    kit.add(cover, sheet(np.array(rows), 0.016).at(z=seat))
    kit.add(
        BLACK,
        hollows.slab(kit, "seat_recess", rect(depth * 0.55, width * 0.5, 0.03), 0.05, 0.02).at(
            -0.02, 0, seat - 0.065
        ),
    )
    base, under = (
        kit.choose("base", "rods", "dowels", "tulip", "star", "sled", "cross"),
        seat - 0.03,
    )
    x, y = depth * 0.42, width * 0.4
    if base == "tulip":
        kit.add(cover, legs.trumpet(0.25, 0.03, under, 32))
    elif base == "star":
        legs.star_base(kit, 0.28, under, CHROME)
    elif base == "cross":
        kit.add(CHROME, cylinder(0.025, under, 14).at(z=under / 2))
        for angle in around(4, 45):
            arm = tube(
                solids.smooth_path([(0, 0, 0.09), (0.15, 0, 0.06), (0.3, 0, 0.015)], 4), 0.016
            )
            kit.add(CHROME, arm.turned("z", angle))
    elif base == "sled":
        way = [
            (-x * 0.6, y, under - 0.03),
            (-x, y, 0.05),
            (-x * 0.8, y, 0.014),
            (x * 0.8, y, 0.014),
            (x, y, 0.05),
            (x * 0.6, y, under - 0.03),
        ]
        kit.both(frame, tube(solids.smooth_path(way, 4), 0.011))
    else:
        r = 0.008 if base == "rods" else 0.018
        material = frame if base == "rods" else wood(kit.rng)
        for a in (-1, 1):
            for b in (-1, 1):
                kit.add(
                    material,
                    tube(
                        [(a * x * 1.05, b * y * 1.1, 0), (a * x * 0.5, b * y * 0.45, under - 0.02)],
                        [r * 0.8, r],
                        10,
                    ),
                )
        if base == "rods":
            kit.both(
                material,
                rod((-x * 0.8, y * 0.8, under * 0.5), (x * 0.8, -y * 0.8, under * 0.5), 0.005),
            )


def _bean_bag(kit: Kit) -> None:
    """A bean bag, a pouf, or an egg chair."""
    cover = fabric(kit.rng)
    style = kit.choose("style", "bag", "pouf", "egg")
    wide = kit.uniform("width", 0.6, 1.0)
    if style == "pouf":
        tall = kit.uniform("height", 0.3, 0.55)
        power = kit.uniform("corner", 2, 6)
        flat = solids.superellipse(wide, wide, power, 32)
        levels = [
            (flat * r, z * tall)
            for r, z in ((0.85, 0), (0.97, 0.12), (1, 0.4), (0.98, 0.8), (0.88, 0.96), (0.5, 1.0))
        ]
        kit.add(cover, hollows.body(kit, levels, 0.2 * tall))
        for angle in around(kit.choose("seams", 4, 6, 8)):
            kit.add(
                BLACK,
                rod((wide * 0.2, 0, tall), (wide * 0.44, 0, tall * 0.965), 0.006, 5).turned(
                    "z", angle
                ),
            )
        return
    if style == "bag":
        tall = kit.uniform("height", 0.6, 0.95)
        flat = solids.superellipse(wide, wide, 2.2, 36)
        lean = kit.uniform("lean", 0.1, 0.35) * wide
        levels = []
        for r, z in (
            (0.8, 0),
            (0.98, 0.08),
            (1.02, 0.25),
            (0.92, 0.45),
            (0.7, 0.68),
            (0.48, 0.85),
            (0.2, 0.98),
            (0.05, 1.0),
        ):
            dent = np.where(flat[:, :1] > 0, 1 - 0.25 * np.exp(-(((z - 0.55) / 0.2) ** 2)), 1.0)
            levels.append(
                (flat * r * np.hstack([dent, np.ones_like(dent)]) - [lean * z, 0], z * tall)
            )
        kit.add(cover, hollows.body(kit, levels, 0.08))
        kit.add(BLACK, ball(0.05, 0.05, 0.05, 10).at(-lean, 0, tall))
        return
    shell = pick(kit.rng, (lacquer, plastic))(kit.rng)
    tall, low = kit.uniform("height", 0.9, 1.3), 0.22
    angle = np.linspace(np.radians(48), np.radians(312), 25)
    rows = []
    for v in np.linspace(-0.85, 0.92, 13):
        r = np.sqrt(1 - v * v) * wide * 0.55
        rows.append(
            np.stack(
                [
                    r * np.cos(angle),
                    r * np.sin(angle),
                    0 * angle + low + (v + 0.85) / 1.77 * (tall - low),
                ],
                axis=1,
            )
        )
    kit.add(shell, sheet(np.array(rows), 0.03))
    kit.add(cover, cushion(wide * 0.8, wide * 0.85, 0.2, 2.5, 3.0).at(0, 0, low + 0.2))
    kit.add(cover, ball(wide * 0.5, wide * 0.5, 0.16, 16).at(z=low + 0.06))
    kit.add(
        CHROME, hollows.turned(kit, [(0.3, 0), (0.3, 0.02), (0.04, 0.05), (0.03, low + 0.05)], 32)
    )


def _throne(kit: Kit) -> None:
    """A high carved chair with finials."""
    frame = pick(kit.rng, (wood, GOLD))
    frame = frame if isinstance(frame, Material) else frame(kit.rng)
    cover = fabric(kit.rng)
    depth, width, seat = (
        kit.uniform("depth", 0.5, 0.65),
        kit.uniform("width", 0.55, 0.8),
        kit.uniform("seat_height", 0.42, 0.52),
    )
    high = kit.uniform("height", 1.2, 1.9)
    kit.add(frame, hollows.slab(kit, "seat_recess", rect(depth, width), 0.14).at(z=seat - 0.14))
    kit.add(cover, cushion(depth * 0.94, width * 0.9, 0.14, 7.0, 3.0).at(z=seat + 0.02))
    legs.four(
        kit,
        depth / 2 - 0.05,
        width / 2 - 0.05,
        seat - 0.13,
        frame,
        "turned",
        "cabriole",
        "square",
        thick=0.085,
    )
    rear = -depth / 2
    kit.both(
        frame,
        box(0.07, 0.07, high - seat + 0.1, 0.01).at(
            rear, width / 2 - 0.03, (high + seat) / 2 - 0.05
        ),
    )
    kit.both(frame, ball(0.1, 0.1, 0.13, 14).at(rear, width / 2 - 0.03, high + 0.04))
    crest = kit.choose("crest", "arch", "point", "flat")
    peak = {"arch": 0.14, "point": 0.26, "flat": 0.03}[crest]
    t = np.linspace(-0.5, 0.5, 17)
    rise_ = peak * (np.cos(t * np.pi) if crest != "point" else 1 - 2 * np.abs(t))
    outline = [(-width / 2, seat), (width / 2, seat)] + [
        (float(a) * width, high - 0.12 + float(b))
        for a, b in zip(t[::-1], rise_[::-1], strict=True)
    ]
    kit.add(frame, solids.prism(outline, 0.05).turned("z", 90).at(x=rear))
    pad = [(a * 0.76, seat + (b - seat) * 0.88 + 0.02) for a, b in outline]
    kit.add(cover, solids.prism(pad, 0.05, 0.01).turned("z", 90).at(x=rear + 0.02))
    top = seat + 0.26
    kit.both(
        frame,
        box(depth, 0.08, 0.06, 0.015).at(0, width / 2 - 0.02, top),
        box(0.07, 0.07, 0.3, 0.01).at(depth / 2 - 0.05, width / 2 - 0.02, seat + 0.1),
    )
    kit.both(frame, cylinder(0.05, 0.1, 16).turned("x", 90).at(depth / 2, width / 2 - 0.02, top))
    if kit.chance("dais", 0.4):
        kit.add(frame, box(depth + 0.5, width + 0.4, 0.1, 0.01).at(0.1, 0, -0.05))


def _wheelchair(kit: Kit) -> None:
    frame, cover = metal(kit.rng), fabric(kit.rng)
    width = kit.uniform("width", 0.44, 0.54)
    y, seat, big = width / 2 + 0.05, 0.5, kit.uniform("wheel", 0.28, 0.33)
    kit.add(cover, hollows.slab(kit, "seat_recess", rect(0.44, width), 0.06).at(z=seat - 0.06))
    kit.add(cover, box(0.05, width, 0.42, 0.02).turned("y", -8).at(-0.26, 0, seat + 0.24))
    ring = np.array([(big * np.cos(a), 0, big * np.sin(a)) for a in np.linspace(0, 2 * np.pi, 33)])
    kit.both(RUBBER, tube(ring, 0.017, 8).at(-0.12, y, big + 0.017))
    kit.both(frame, tube(ring * 0.88, 0.008, 6).at(-0.12, y + 0.035, big + 0.017))
    kit.both(frame, cylinder(0.035, 0.06, 12).turned("x", 90).at(-0.12, y, big + 0.017))
    for angle in around(8):
        kit.both(
            frame,
            rod((0, 0, 0), (big, 0, 0), 0.004, 5).turned("y", angle).at(-0.12, y, big + 0.017),
        )
    small = cylinder(0.08, 0.03, 20).turned("x", 90)
    kit.both(RUBBER, small.at(0.3, width / 2, 0.08))
    kit.both(
        frame,
        tube(
            solids.smooth_path(
                [
                    (-0.24, width / 2, 0.2),
                    (-0.24, width / 2, 0.7),
                    (-0.27, width / 2, 0.93),
                    (-0.38, width / 2, 0.94),
                ],
                4,
            ),
            0.013,
        ),
        tube(
            solids.smooth_path(
                [
                    (-0.24, width / 2, seat),
                    (0.2, width / 2, seat),
                    (0.3, width / 2, seat - 0.05),
                    (0.42, width / 2, 0.15),
                ],
                4,
            ),
            0.013,
        ),
        rod((-0.24, width / 2, 0.24), (0.3, width / 2, 0.24), 0.012),
        rod((0.3, width / 2, 0.08), (0.3, width / 2, 0.26), 0.012),
    )
    kit.both(cover, box(0.34, 0.05, 0.03, 0.01).at(-0.04, width / 2, seat + 0.22))
    kit.both(frame, rod((0.1, width / 2, seat), (0.1, width / 2, seat + 0.22), 0.011))
    kit.both(BLACK, box(0.14, 0.16, 0.02, 0.004).at(0.46, width / 4, 0.14))


def _swing(kit: Kit) -> None:
    """A basket chair of rings and ribs on a foot."""
    cover = pick(kit.rng, (wood, metal, lacquer))(kit.rng)
    soft = fabric(kit.rng)
    wide, lean = kit.uniform("width", 0.75, 1.05), kit.uniform("lean", 20, 50)
    rings, ribs = kit.choose("rings", 3, 4), kit.choose("ribs", 12, 16, 20)
    centre = np.array([0.0, 0.0, wide * 0.5 + 0.12])
    parts = []
    for t in np.linspace(0.3, 1.0, rings):
        a = np.linspace(0, 2 * np.pi, 37)
        r = wide / 2 * np.sin(t * np.pi * 0.42) / np.sin(np.pi * 0.42)
        z = -wide * 0.42 * np.cos(t * np.pi * 0.42)
        parts.append(
            tube(
                np.stack([r * np.cos(a), r * np.sin(a), 0 * a + z], axis=1),
                0.02 if t == 1 else 0.008,
                6,
            )
        )
    for angle in around(ribs):
        way = [
            (
                wide / 2 * np.sin(t * np.pi * 0.42) / np.sin(np.pi * 0.42),
                0,
                -wide * 0.42 * np.cos(t * np.pi * 0.42),
            )
            for t in np.linspace(0, 1, 7)
        ]
        parts.append(tube(np.array(way), 0.006, 5).turned("z", angle))
    for part in parts:
        kit.add(cover, part.turned("y", lean).at(*centre))
    kit.add(
        soft,
        cushion(wide * 0.75, wide * 0.75, 0.16, 2.2, 2.0)
        .at(z=-wide * 0.32)
        .turned("y", lean)
        .at(*centre),
    )
    kit.add(
        cover,
        hollows.turned(
            kit,
            [
                (wide * 0.36, 0),
                (wide * 0.36, 0.03),
                (wide * 0.1, 0.06),
                (wide * 0.08, 0.16),
                (wide * 0.2, 0.24),
            ],
            32,
        ),
    )


def _school(kit: Kit) -> None:
    """A chair with a writing board, or chairs joined in a row."""
    frame, cover = metal(kit.rng), pick(kit.rng, (plastic, wood, lacquer))(kit.rng)
    depth, width, seat = _size(kit)
    count = kit.choose("row", 1, 1, 2, 3, 4)
    share = kit.hide("seat_recess", *hollows.RANGE)
    high = kit.uniform("back_height", 0.35, 0.5)
    bench = count > 1
    for k in range(count):
        y = (k - (count - 1) / 2) * (width + 0.08)
        kit.add(
            cover,
            solids.tray(rect(depth, width, 0.06), 0.06, 0.025, share * 0.06).at(0, y, seat - 0.06),
        )
        t = np.linspace(-1, 1, 9)
        rows = [
            np.stack([0.05 * t**2 - 0.16 * v, t * width / 2, 0 * t + v * high + 0.08], axis=1)
            for v in np.linspace(0.25, 1, 5)
        ]
        kit.add(cover, sheet(np.array(rows), 0.02).at(-depth / 2, y, seat))
        for s in (-1, 1):
            kit.add(
                frame,
                rod(
                    (-depth * 0.4, y + s * width * 0.36, seat - 0.04),
                    (-depth / 2 - 0.1, y + s * width * 0.36, seat + high * 0.6),
                    0.012,
                ),
            )
            if not bench:
                for a in (-1, 1):
                    kit.add(
                        frame,
                        rod(
                            (a * depth * 0.5, s * width * 0.45, 0),
                            (a * depth * 0.4, s * width * 0.4, seat - 0.03),
                            0.013,
                        ),
                    )
    if bench:
        long = count * (width + 0.08)
        kit.add(frame, box(0.06, long, 0.06, 0.008).at(0, 0, seat - 0.1))
        for s in (-1, 1):
            y = s * (long / 2 - 0.2)
            kit.add(
                frame,
                box(0.07, 0.05, seat - 0.1).at(0, y, (seat - 0.1) / 2),
                box(depth * 1.2, 0.06, 0.03, 0.008).at(0, y, 0.015),
            )
    if kit.chance("writing_board", 0.6 if not bench else 0.2):
        for k in range(count):
            y = (k - (count - 1) / 2) * (width + 0.08) + width / 2
            kit.add(cover, box(0.3, 0.24, 0.02, 0.005).at(depth * 0.45, y - 0.06, seat + 0.26))
            kit.add(
                frame,
                tube(
                    solids.smooth_path(
                        [
                            (0.02, y, seat - 0.04),
                            (0.05, y + 0.02, seat + 0.18),
                            (depth * 0.4, y, seat + 0.25),
                        ],
                        4,
                    ),
                    0.012,
                ),
            )


KINDS: dict[str, Callable[[Kit], None]] = {
    "dining": _dining,
    "high_back": _high_back,
    "office": _office,
    "cantilever": _cantilever,
    "stool": _stool,
    "armchair": _armchair,
    "rocking": _rocking,
    "folding": _folding,
    "lounger": _lounger,
    "shell": _shell,
    "bean_bag": _bean_bag,
    "throne": _throne,
    "wheelchair": _wheelchair,
    "basket": _swing,
    "school": _school,
}

_WEIGHTS = {"dining": 5, "office": 3, "stool": 3, "armchair": 3, "shell": 2, "cantilever": 2}


def chair(kit: Kit) -> None:
    """Fifteen subtypes, see `KINDS`. Hidden: the depth of the recess under the seat."""
    kit.build_subtype(KINDS, _WEIGHTS)

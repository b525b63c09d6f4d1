"""Benches: park benches, pews, benches for halls and gyms."""

import itertools
from collections.abc import Callable

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families import hollows, legs
from data_gen.catalogues.families.kit import (
    BLACK,
    Kit,
    fabric,
    lacquer,
    metal,
    paint,
    pick,
    rect,
    wood,
)
from data_gen.catalogues.solids import Solid, ball, box, cushion, cylinder, pillow, rod, tube
from data_gen.mesh import Material

GREEN = Material((0.2, 0.42, 0.17), name="leaves")
STONE = Material((0.66, 0.64, 0.6), name="stone")


def _materials(kit: Kit) -> tuple[Material, Material]:
    """Materials of the boards and of the supports."""
    main = pick(kit.rng, (wood, wood, wood, lacquer))(kit.rng)
    return main, BLACK if kit.rng.random() < 0.2 else pick(kit.rng, (metal, lacquer))(kit.rng)


def _size(kit: Kit) -> tuple[float, float, float]:
    """Length, depth and height of the seat."""
    return (
        kit.uniform("length", 0.9, 2.4),
        kit.uniform("depth", 0.32, 0.55),
        kit.uniform("seat_height", 0.38, 0.5),
    )


def _back(
    kit: Kit, length: float, depth: float, seat: float, main: Material, iron: Material
) -> None:
    high, lean = kit.uniform("back_height", 0.3, 0.6), kit.uniform("back_lean", 5, 18)

    def tilt(part: Solid) -> Solid:
        return part.turned("y", -lean).at(-depth / 2 + 0.02, 0, seat - 0.02)

    style = kit.choose("back", "rails", "rails", "slats", "solid", "cross", "arch")
    kit.both(iron, tilt(box(0.035, 0.045, high, 0.004).at(-0.03, length / 2 - 0.1, high / 2)))
    if style == "solid":
        kit.add(main, tilt(box(0.03, length, high * 0.75, 0.008).at(0, 0, high * 0.62)))
    elif style == "rails":
        count = kit.choose("back_rails", 2, 3, 4, 5)
        pitch = high * 0.85 / count
        for k in range(count):
            rail = box(0.026, length, pitch * 0.72, 0.006).at(0, 0, high - pitch * (k + 0.5))
            kit.add(main, tilt(rail))
    elif style == "cross":
        kit.add(
            main,
            tilt(box(0.03, length, 0.05).at(z=high)),
            tilt(box(0.03, length, 0.05).at(z=high * 0.2)),
        )
        panels = max(2, round(length / 0.55))
        edges = np.linspace(-length / 2 + 0.08, length / 2 - 0.08, panels + 1)
        for a, b in itertools.pairwise(edges):
            for y0, y1 in ((a, b), (b, a)):
                kit.add(main, tilt(rod((0, y0, high * 0.2), (0, y1, high), 0.013, 6)))
    else:
        arch = 0.25 * high if style == "arch" else 0.0
        t = np.linspace(-0.5, 0.5, 17)
        top = [(0, float(a) * length, high + arch * float(np.cos(a * np.pi))) for a in t]
        kit.add(main, tilt(solids.sweep(solids.rounded(0.03, 0.06, 0.008, 1), top, (1, 0, 0))))
        kit.add(main, tilt(box(0.03, length, 0.05, 0.008).at(0, 0, high * 0.2)))
        for a in np.linspace(-0.5, 0.5, int(length / 0.1))[1:-1]:
            tall = high * 0.8 + arch * float(np.cos(a * np.pi))
            kit.add(main, tilt(box(0.015, 0.035, tall).at(0, a * length, high * 0.2 + tall / 2)))


def _park(kit: Kit) -> None:
    """A park bench: slats on cast-iron ends."""
    main, iron = _materials(kit)
    length, depth, seat = _size(kit)
    count = kit.choose("slats", 3, 4, 5, 7)
    pitch, under = depth / count, seat - 0.035
    for x in (np.arange(count) - (count - 1) / 2) * pitch:
        kit.add(main, box(pitch * 0.8, length, 0.035, 0.006).at(x, 0, seat - 0.017))
    style = kit.choose("ends", "curved", "straight", "arched", "hoop")
    places = (-1, 1) if kit.chance("two_ends", 0.7) else (-1, 0, 1)
    for side in places:
        y = side * (length / 2 - 0.1)
        kit.add(iron, box(depth * 0.94, 0.05, 0.03).at(0, y, under - 0.015))
        if style == "arched":
            t = np.linspace(0, np.pi, 13)
            arch = [(depth * 0.42 * np.cos(a), y, under * 0.85 * np.sin(a) ** 0.6) for a in t]
            kit.add(iron, tube(np.array(arch), 0.024))
            kit.add(iron, rod((0, y, under * 0.8), (0, y, under), 0.02))
        elif style == "hoop":
            a = np.linspace(0, 2 * np.pi, 25)
            ring = np.stack(
                [depth * 0.4 * np.cos(a), 0 * a + y, under / 2 * (1 + 0.97 * np.sin(a))], axis=1
            )
            kit.add(iron, tube(ring, 0.022))
        else:
            for sign in (-1, 1):
                leg = [(sign * depth * 0.4, y, under), (sign * depth * 0.46, y, 0.015)]
                if style == "curved":
                    leg.insert(1, (sign * depth * 0.28, y, under * 0.55))
                kit.add(iron, tube(solids.smooth_path(leg, 4), 0.022))
                kit.add(iron, box(0.09, 0.05, 0.02).at(sign * depth * 0.46, y, 0.01))
    rail = kit.uniform("rail", 0.07, 0.1)
    beam = hollows.slab(kit, "rail_recess", rect(depth * 0.6, length * 0.9, 0.01), rail, 0.015)
    kit.add(main, beam.at(z=under - rail))
    backed = kit.chance("with_back", 0.8)
    if kit.chance("arms", 0.6):
        y, rear = length / 2 - 0.05, depth * 0.45
        arm = [
            (-rear, y, seat + 0.22),
            (0, y, seat + 0.24),
            (depth * 0.4, y, seat + 0.2),
            (depth * 0.46, y, seat + 0.1),
            (depth * 0.42, y, seat - 0.02),
        ]
        if not backed:
            arm = [(-depth * 0.42, y, seat - 0.02), (-depth * 0.46, y, seat + 0.1), *arm]
        kit.both(iron, tube(solids.smooth_path(arm, 4), 0.018))
    if backed:
        _back(kit, length, depth, seat, main, iron)


def _slab(kit: Kit) -> None:
    """One thick board on legs or blocks."""
    main, iron = _materials(kit)
    length, depth, seat = _size(kit)
    thick = kit.uniform("thickness", 0.05, 0.16)
    outline = rect(depth, length, kit.uniform("corner", 0.005, 0.15))
    kit.add(main, hollows.slab(kit, "slab_recess", outline, thick).at(z=seat - thick))
    under = seat - thick + 0.002
    style = kit.choose("supports", "legs", "legs", "blocks", "cross", "loops", "trestle")
    y = length * kit.uniform("inset", 0.28, 0.45)
    if style == "legs":
        legs.four(kit, depth / 2 - 0.04, y, under, iron)
    elif style == "blocks":
        wide = kit.uniform("block", 0.05, 0.3)
        kit.both(iron, box(depth * 0.85, wide, under, 0.015).at(0, y - wide / 2, under / 2))
    elif style == "cross":
        for sign in (-1, 1):
            kit.both(iron, rod((sign * depth * 0.45, y, 0), (-sign * depth * 0.4, y, under), 0.022))
        kit.add(iron, rod((0, -y, under / 2), (0, y, under / 2), 0.015))
    elif style == "loops":
        path = np.array(
            [
                (-0.44 * depth, 0, 0.02),
                (0.44 * depth, 0, 0.02),
                (0.44 * depth, 0, under),
                (-0.44 * depth, 0, under),
            ]
        )
        kit.both(
            iron,
            solids.sweep(solids.rounded(0.06, 0.02, 0.003, 1), path, (0, 1, 0), loop=True).at(y=y),
        )
    else:
        shape = [(-0.45, 0), (-0.25, 0), (0, 0.3), (0.25, 0), (0.45, 0), (0.35, 1), (-0.35, 1)]
        kit.both(main, solids.prism([(a * depth, b * under) for a, b in shape], 0.05).at(y=y))
        kit.add(main, box(0.03, 2 * y, 0.1).at(0, 0, under * 0.6))
    if kit.chance("with_back", 0.3):
        _back(kit, length, depth, seat, main, iron)
    elif kit.chance("pad", 0.35):
        kit.add(fabric(kit.rng), cushion(depth, length * 0.98, 0.12, 9.0, 4.0).at(z=seat + 0.04))


def _panel_ends(kit: Kit) -> None:
    """Solid ends as wide as the seat. Hidden: the supports between them."""
    main, iron = _materials(kit)
    length, depth, seat = _size(kit)
    # One board, because the supports would be visible through gaps between slats.
    kit.add(main, box(depth, length, 0.035, 0.008).at(z=seat - 0.0175))
    count = kit.choose("slats", 3, 4, 5)
    for x in (np.arange(1, count) - count / 2) * depth / count:
        kit.add(BLACK, box(0.006, length * 0.97, 0.002).at(x, 0, seat))
    under = seat - 0.035
    kit.both(iron, box(depth, 0.06, under, 0.008).at(0, length / 2 - 0.06, under / 2))
    supports = kit.hide_count("supports", 4)
    width = kit.hide("support_width", 0.1, 0.3) * depth
    for y in np.linspace(-length / 2, length / 2, supports + 2)[1:-1] * 0.7:
        kit.add(iron, box(width, 0.05, under * 0.98).at(0, y, under * 0.5))
    kit.azimuth = ((85.0, 95.0), (-95.0, -85.0))
    if kit.chance("back", 0.6):
        _back(kit, length, depth, seat, main, iron)


def _storage(kit: Kit) -> None:
    main, iron = _materials(kit)
    length, depth, seat = _size(kit)
    body = seat - 0.03
    kit.add(main, hollows.slab(kit, "box_recess", rect(depth, length, 0.01), body))
    soft = fabric(kit.rng)
    if kit.chance("one_pad", 0.6):
        kit.add(soft, cushion(depth, length, 0.1, 9.0, 5.0).at(z=seat))
    else:
        for s in (-1, 1):
            kit.add(
                soft, cushion(depth, length / 2 - 0.01, 0.12, 7.0, 3.0).at(0, s * length / 4, seat)
            )
    front = kit.choose("front", "panels", "drawers", "open")
    for y in np.linspace(-length / 2, length / 2, kit.choose("panels", 2, 3, 4) + 1)[1:-1]:
        kit.add(BLACK, box(0.004, 0.012, seat * 0.8).at(depth / 2, y, seat * 0.46))
        if front == "drawers":
            kit.add(iron, box(0.03, 0.1, 0.02).at(depth / 2 + 0.01, y - 0.15, seat * 0.5))
    if front == "open":
        kit.add(BLACK, box(0.006, length * 0.92, seat * 0.4).at(depth / 2, 0, seat * 0.35))
    style = kit.choose("back", "none", "board", "hall")
    if style == "board":
        kit.add(main, box(0.04, length, 0.42, 0.01).at(-depth / 2 + 0.02, 0, seat + 0.2))
        kit.both(main, box(depth, 0.04, 0.26, 0.01).at(0, length / 2 - 0.02, seat + 0.1))
    elif style == "hall":
        tall = kit.uniform("hall", 1.0, 1.5)
        kit.add(main, box(0.04, length, tall, 0.006).at(-depth / 2 + 0.02, 0, seat + tall / 2))
        kit.add(main, box(0.25, length + 0.06, 0.04, 0.006).at(-depth / 2 + 0.12, 0, seat + tall))
        for y in np.linspace(-0.4, 0.4, 5) * length:
            kit.add(
                iron,
                rod(
                    (-depth / 2 + 0.03, y, seat + tall * 0.75),
                    (-depth / 2 + 0.12, y, seat + tall * 0.8),
                    0.012,
                ),
            )


def _pew(kit: Kit) -> None:
    """A pew: shaped ends, a closed back, a book rest."""
    main = pick(kit.rng, (wood, wood, lacquer))(kit.rng)
    length, depth, seat = _size(kit)
    length *= kit.uniform("stretch", 0.8, 1.5)
    kit.add(
        main, hollows.slab(kit, "seat_recess", rect(depth, length, 0.01), 0.05).at(z=seat - 0.05)
    )
    high = kit.uniform("back_height", 0.4, 0.75)
    end = kit.choose("ends", "scroll", "square", "gothic")
    low = [(-0.62, 0), (0.55, 0), (0.55, 0.05), (0.45, 0.1), (0.45, seat)]
    high_ = {
        "scroll": [
            (0.5, seat + 0.2),
            (0.25, seat + 0.28),
            (-0.2, seat + 0.3),
            (-0.35, seat + high),
            (-0.65, seat + high),
        ],
        "square": [
            (0.45, seat + 0.22),
            (-0.3, seat + 0.22),
            (-0.3, seat + high),
            (-0.65, seat + high),
        ],
        "gothic": [
            (0.3, seat + 0.25),
            (0.05, seat + high),
            (-0.25, seat + high * 1.35),
            (-0.62, seat + high),
        ],
    }[end]
    shape = [(a * depth, b) for a, b in (*low, *high_)]
    kit.both(main, solids.prism(shape, 0.06, 0.006).at(y=length / 2))
    lean = kit.uniform("lean", 4, 12)
    kit.add(
        main,
        box(0.03, length, high)
        .turned("y", -lean)
        .at(-depth * 0.5 - 0.03, 0, seat + high / 2 - 0.03),
    )
    kit.add(main, box(0.09, length, 0.03).at(-depth * 0.5 - 0.12, 0, seat + high - 0.1))
    if kit.chance("kneeler", 0.4):
        kit.add(fabric(kit.rng), pillow(0.16, length * 0.95, 0.07, 0.03).at(-depth * 0.75, 0, 0.18))
        for s in (-1, 0, 1):
            kit.add(main, box(0.03, 0.04, 0.16).at(-depth * 0.75, s * length * 0.4, 0.08))
    rows = kit.choose("rows", 1, 1, 1, 2, 3)
    if rows > 1:
        for k in range(1, rows):
            x = -k * kit.uniform("row_pitch", 0.85, 1.0)
            kit.add(main, box(depth, length, 0.05).at(x, 0, seat - 0.025))
            kit.both(main, solids.prism(shape, 0.06, 0.006).at(x, length / 2))
            kit.add(
                main,
                box(0.03, length, high)
                .turned("y", -lean)
                .at(x - depth * 0.5 - 0.03, 0, seat + high / 2 - 0.03),
            )


def _planter(kit: Kit) -> None:
    """A bench beside a planter or between two."""
    main, _ = _materials(kit)
    pot = pick(kit.rng, (STONE, wood(kit.rng), metal(kit.rng)))
    length, depth, seat = _size(kit)
    size = kit.uniform("planter", 0.45, 0.7)
    high = kit.uniform("planter_height", 0.35, 0.8)
    kit.add(
        main, hollows.slab(kit, "seat_recess", rect(depth, length, 0.01), 0.07).at(z=seat - 0.07)
    )
    sides = (-1, 1) if kit.chance("both", 0.7) else (1,)
    shape = solids.superellipse(size, size, kit.choose("pot_shape", 2, 12), 28)
    for s in sides:
        y = s * (length / 2 + size * 0.45)
        kit.add(pot, solids.stack([(shape * 0.85, 0), (shape, high)]).at(y=y))
        for _ in range(7):
            a, b, c = kit.rng.uniform(-0.25, 0.25, 3) * size
            r = kit.rng.uniform(0.4, 0.7) * size
            kit.add(GREEN, ball(r, r, r * 0.9, 10).at(a, y + b, high + 0.1 * size + c))
    if len(sides) == 1:
        kit.add(
            pot, box(depth * 0.8, 0.08, seat - 0.06).at(0, -length / 2 + 0.06, (seat - 0.06) / 2)
        )
    if kit.chance("back", 0.3):
        _back(kit, length, depth, seat, main, main)


def _curved(kit: Kit) -> None:
    """A curved bench, around a corner or all around a tree."""
    main, iron = _materials(kit)
    full = kit.chance("full", 0.4)
    radius, depth = kit.uniform("radius", 0.6, 1.6), kit.uniform("depth", 0.3, 0.5)
    seat = kit.uniform("seat_height", 0.38, 0.48)
    half = np.radians(180.0 if full else kit.uniform("sweep", 30, 80))
    steps = 40 if full else 20
    path = solids.rise(
        lambda t: (-radius * np.cos(half * (2 * t - 1)), radius * np.sin(half * (2 * t - 1)), 0),
        steps,
    )
    board = solids.rounded(0.06, depth, 0.01, 1)
    if full:
        kit.add(main, solids.sweep(board, path[:-1], (0, 0, 1), loop=True).at(z=seat - 0.03))
    else:
        kit.add(main, solids.sweep(board, path, (0, 0, 1)).at(z=seat - 0.03))
    count = 8 if full else kit.choose("feet", 3, 4)
    share = kit.hide("foot_recess", *hollows.RANGE)
    back = kit.chance("back", 0.5)
    spread = np.arange(count) / count * 2 - 1 if full else np.linspace(-0.85, 0.85, count)
    for t in spread * half:
        tray = solids.tray(rect(depth * 0.8, 0.16, 0.02), seat - 0.05, 0.03, share * 0.3)
        kit.add(iron, tray.turned("z", -np.degrees(t)).at(-radius * np.cos(t), radius * np.sin(t)))
        if back:
            r = (radius - depth * 0.5) if full else radius + depth * 0.5
            kit.add(
                iron,
                box(0.03, 0.05, 0.45)
                .turned("z", -np.degrees(t))
                .at(-r * np.cos(t), r * np.sin(t), seat + 0.18),
            )
    if back:
        scale = (radius - depth * 0.5) / radius if full else (radius + depth * 0.5) / radius
        rail = solids.rounded(0.1, 0.025, 0.005, 1)
        for z in (0.18, 0.36):
            way = path * [scale, scale, 1]
            kit.add(
                main,
                solids.sweep(rail, way[:-1] if full else way, (0, 0, 1), loop=full).at(z=seat + z),
            )
    if full and kit.chance("tree", 0.5):
        kit.add(wood(kit.rng), cylinder(radius * 0.25, 1.0, 16).at(z=0.5))
        kit.add(GREEN, ball(radius * 1.4, radius * 1.4, radius * 1.2, 16).at(z=1.1 + radius * 0.4))


def _picnic(kit: Kit) -> None:
    """A table with two benches."""
    main, iron = _materials(kit)
    length, depth, seat = _size(kit)
    gap = kit.uniform("gap", 0.45, 0.7)
    share = kit.hide("seat_recess", *hollows.RANGE)
    for s in (-1, 1):
        board = solids.tray(rect(depth * 0.8, length, 0.01), 0.05, 0.02, share * 0.05)
        kit.add(main, board.at(s * (gap + 0.1), 0, seat - 0.05))
    top = seat + kit.uniform("rise", 0.28, 0.36)
    kit.add(main, box(2 * gap * 0.72, length, 0.05, 0.01).at(z=top))
    y = length * 0.36
    if kit.chance("frame", 0.5):
        kit.both(iron, box(2 * gap + 0.3, 0.05, 0.06).at(0, y, seat - 0.08))
        for s in (-1, 1):
            kit.both(iron, rod((s * (gap + 0.15), y, 0), (s * gap * 0.3, y, top), 0.03, 6))
    else:
        for s in (-1, 1):
            for a in (-1, 1):
                kit.both(
                    iron,
                    rod(
                        (s * (gap + 0.1) + a * depth * 0.3, y, 0),
                        (s * (gap + 0.1) + a * depth * 0.2, y, seat - 0.04),
                        0.02,
                    ),
                )
            kit.both(iron, rod((s * gap * 0.55, y, 0), (s * gap * 0.45, y, top), 0.025))


def _stone(kit: Kit) -> None:
    """A solid bench: blocks, a slab on consoles, a wave."""
    stone = pick(kit.rng, (STONE, lacquer(kit.rng), paint(kit.rng)))
    length, depth, seat = _size(kit)
    style = kit.choose("style", "block", "consoles", "wave", "ledge")
    if style == "wave":
        path = solids.rise(
            lambda t: (
                0,
                (t - 0.5) * length * 1.3,
                seat * 0.7 + seat * 0.28 * np.sin(4.5 * np.pi * t),
            ),
            32,
        )
        kit.add(stone, solids.sweep(solids.rounded(depth * 1.3, 0.08, 0.02, 2), path, (1, 0, 0)))
        kit.add(stone, hollows.slab(kit, "base_recess", rect(depth, length * 0.9), 0.06))
        for t in (0.11, 0.55, 1.0):
            y = (t - 0.5) * length * 1.2
            kit.add(stone, cylinder(0.08, seat * 0.75, 14).at(0, y, seat * 0.375))
        return
    if style == "consoles":
        kit.add(
            stone, hollows.slab(kit, "base_recess", rect(depth, length, 0.02), 0.1).at(z=seat - 0.1)
        )
        profile = [(0.42, 0), (0.42, 0.1), (0.25, 0.25), (0.2, 0.6), (0.4, 0.85), (0.4, 1.0)]
        half = solids.smooth_profile([(a * depth, b * (seat - 0.09)) for a, b in profile], 3)
        shape = [(-a, b) for a, b in reversed(half)] + list(half)
        kit.both(stone, solids.prism(shape, 0.14, 0.01).at(y=length * 0.34))
        return
    kit.add(stone, hollows.slab(kit, "base_recess", rect(depth, length, 0.03), seat * 0.8))
    kit.add(stone, box(depth * 1.1, length * 1.03, seat * 0.25, 0.02).at(z=seat * 0.88))
    if style == "ledge":
        tall = kit.uniform("wall", 0.4, 1.1)
        kit.add(
            stone,
            box(0.16, length * 1.03, seat + tall, 0.02).at(-depth / 2 - 0.05, 0, (seat + tall) / 2),
        )
        kit.both(
            stone, box(depth * 1.2, 0.16, seat + 0.2, 0.02).at(0, length / 2, (seat + 0.2) / 2)
        )


def _gym(kit: Kit) -> None:
    """A weight bench or an exercise bench."""
    iron, cover = metal(kit.rng), fabric(kit.rng)
    seat, length = kit.uniform("seat_height", 0.4, 0.5), kit.uniform("length", 1.0, 1.4)
    kit.add(iron, hollows.slab(kit, "beam_recess", rect(length, 0.1), 0.08).at(z=seat - 0.14))
    tip = kit.uniform("incline", 0, 60)
    kit.add(cover, pillow(length * 0.4, 0.28, 0.07, 0.03).at(length * 0.28, 0, seat))
    rest = pillow(length * 0.62, 0.28, 0.07, 0.03).at(-length * 0.31).turned("y", tip)
    kit.add(cover, rest.at(length * 0.06, 0, seat))
    for x in (-0.45, 0.45):
        kit.add(
            iron,
            box(0.06, 0.5, 0.06).at(x * length, 0, 0.03),
            box(0.06, 0.06, seat - 0.1).at(x * length, 0, seat / 2 - 0.05),
        )
    if kit.chance("rack", 0.7):
        high = seat + kit.uniform("rack_height", 0.4, 0.7)
        kit.both(
            iron,
            box(0.05, 0.05, high).at(-length * 0.4, 0.35, high / 2),
            box(0.12, 0.05, 0.05).at(-length * 0.37, 0.35, high),
        )
        kit.add(
            iron,
            box(0.05, 0.7, 0.05).at(-length * 0.4, 0, 0.15),
            rod((-length * 0.37, -0.8, high + 0.04), (-length * 0.37, 0.8, high + 0.04), 0.014),
        )
        r = kit.uniform("plate", 0.1, 0.22)
        kit.both(
            BLACK, cylinder(r, 0.06, 24, 0.01).turned("x", 90).at(-length * 0.37, 0.66, high + 0.04)
        )
    if kit.chance("leg_rolls", 0.5):
        for z in (0.12, seat + 0.05):
            kit.add(cover, cylinder(0.05, 0.5, 16, 0.01).turned("x", 90).at(length * 0.55, 0, z))
        kit.add(iron, box(0.04, 0.05, seat).at(length * 0.52, 0, seat / 2 + 0.05))


def _swing(kit: Kit) -> None:
    """A porch swing in its frame, or a bus shelter's bench."""
    main, iron = _materials(kit)
    length, depth, seat = _size(kit)
    if kit.chance("shelter", 0.4):
        kit.add(
            main,
            hollows.slab(kit, "seat_recess", rect(depth, length, 0.01), 0.06).at(
                0.1, 0, seat - 0.06
            ),
        )
        high = kit.uniform("roof", 2.0, 2.5)
        x = -depth * 0.6
        for y in (-0.55, 0.55):
            kit.add(iron, box(0.07, 0.07, high).at(x, y * length, high / 2))
        kit.add(iron, box(depth * 2.6, length * 1.25, 0.06, 0.01).turned("y", -6).at(0.15, 0, high))
        kit.add(main, box(0.03, length * 1.1, high * 0.7).at(x, 0, high * 0.55))
        kit.both(
            iron, rod((x, length * 0.35, seat - 0.03), (0.1, length * 0.35, seat - 0.03), 0.025)
        )
        return
    high = kit.uniform("frame", 1.6, 2.1)
    lean = kit.uniform("feet", 0.5, 0.8)
    kit.add(
        main, hollows.slab(kit, "seat_recess", rect(depth, length, 0.01), 0.05).at(z=seat - 0.05)
    )
    y = length / 2 + 0.25
    for s in (-1, 1):
        kit.both(iron, rod((s * lean, y, 0), (0, y, high), 0.03))
        kit.both(
            iron,
            rod((s * depth * 0.4, length / 2 - 0.05, seat), (0, length / 2 - 0.05, high), 0.007, 6),
        )
    kit.both(iron, rod((-lean * 0.6, y, high * 0.4), (lean * 0.6, y, high * 0.4), 0.02))
    kit.add(iron, rod((0, -y, high), (0, y, high), 0.035))
    if kit.chance("canopy", 0.5):
        kit.add(
            fabric(kit.rng),
            solids.sheet(
                solids.rise(lambda t: (-0.7 + 1.4 * t, 0, high + 0.1 - 0.25 * (2 * t - 1) ** 2), 8)[
                    :, None
                ]
                + np.array([[0, -y, 0], [0, 0, 0], [0, y, 0]])[None],
                0.02,
            ),
        )
    _back(kit, length, depth, seat, main, iron)


def _locker_room(kit: Kit) -> None:
    """Long and narrow benches, in rows or steps."""
    main, iron = _materials(kit)
    length, depth = kit.uniform("length", 1.2, 2.6), kit.uniform("depth", 0.2, 0.34)
    seat = kit.uniform("seat_height", 0.38, 0.48)
    steps = kit.choose("steps", 1, 1, 2, 3, 4)
    share = kit.hide("seat_recess", *hollows.RANGE)
    pitch, rise = kit.uniform("pitch", 0.5, 0.7), kit.choose("rise", 0.0, 0.3)
    for k in range(steps):
        x, z = -k * pitch, seat + k * rise
        kit.add(
            main,
            solids.tray(rect(depth, length, 0.005), 0.05, 0.02, share * 0.05).at(x, 0, z - 0.05),
        )
        if rise and k:
            kit.add(main, box(depth, length, 0.03).at(x + pitch * 0.5, 0, z - seat + 0.02))
        for y in (
            np.linspace(-0.4, 0.4, kit.visible.setdefault("frames", pick(kit.rng, (2, 3)))) * length
        ):
            kit.add(iron, box(0.05, 0.05, z - 0.04).at(x, y, (z - 0.04) / 2))
            kit.add(iron, box(depth * 1.1, 0.06, 0.02).at(x, y, 0.01))
            if rise and k:
                kit.add(iron, rod((x, y, z - seat), (x + pitch, y, z - seat), 0.025))
    if steps == 1 and kit.chance("coat_rail", 0.4):
        kit.both(iron, box(0.05, 0.05, 1.7).at(-depth / 2, length * 0.4, 0.85))
        for z in (1.3, 1.6):
            kit.add(main, box(0.03, length, 0.09).at(-depth / 2, 0, z))
        for y in np.linspace(-0.45, 0.45, 8) * length:
            kit.add(iron, rod((-depth / 2, y, 1.55), (-depth / 2 + 0.1, y, 1.6), 0.012))


def _tete(kit: Kit) -> None:
    """Two seats, back to back or facing each other."""
    main, iron = _materials(kit)
    length, depth, seat = _size(kit)
    share = kit.hide("seat_recess", *hollows.RANGE)
    if kit.chance("round", 0.4):
        r = kit.uniform("radius", 0.4, 0.8)
        kit.add(iron, _drum(share, r, seat))
        kit.add(fabric(kit.rng), cushion(2 * r * 1.02, 2 * r * 1.02, 0.14, 2.0, 3.0, 36).at(z=seat))
        top = kit.uniform("cone", 0.3, 0.7)
        profile = [
            (r * 0.5, seat),
            (r * 0.4, seat + top * 0.6),
            (r * 0.42, seat + top),
            (0.0, seat + top + 0.02),
        ]
        kit.add(main, solids.lathe(solids.smooth_profile(profile, 3), 32))
        return
    high = kit.uniform("back_height", 0.35, 0.55)
    for s in (-1, 1):
        board = solids.tray(rect(depth, length, 0.01), 0.05, 0.02, share * 0.05)
        kit.add(main, board.at(s * (depth / 2 + 0.04), 0, seat - 0.05))
        for k in range(3):
            kit.add(
                main,
                box(0.025, length, high * 0.25).at(s * 0.04, 0, seat + high * (0.2 + 0.34 * k)),
            )
        for y in (-0.4, 0.4):
            kit.add(
                iron,
                rod(
                    (s * depth * 0.95, y * length, 0),
                    (s * depth * 0.85, y * length, seat - 0.04),
                    0.025,
                ),
            )
    for y in (-0.4, 0.4):
        kit.add(iron, box(0.06, 0.06, seat + high).at(0, y * length, (seat + high) / 2))
        kit.add(iron, box(2 * depth, 0.05, 0.04).at(0, y * length, seat - 0.07))


def _drum(share: float, radius: float, height: float) -> Solid:
    """A drum from the ground to the seat, with a recess in its underside."""
    flat = solids.superellipse(2 * radius, 2 * radius, 2.0, 36)
    return solids.stack(
        [
            (flat * 0.8, share * height * 0.8),
            (flat * 0.8, 0),
            (flat * 0.95, 0),
            (flat * 0.95, height - 0.02),
        ]
    )


def _deacon(kit: Kit) -> None:
    """A deacon's bench: long, with arms and a back of spindles."""
    main = pick(kit.rng, (wood, lacquer))(kit.rng)
    length, depth, seat = _size(kit)
    kit.add(
        main, hollows.slab(kit, "seat_recess", rect(depth, length, 0.03), 0.05).at(z=seat - 0.05)
    )
    pairs = max(2, round(length / 0.8))
    for y in np.linspace(-0.44, 0.44, pairs + 1) * length:
        for sign in (-1, 1):
            for part in legs.leg(
                "turned",
                seat - 0.04,
                0.05,
                (sign, 0),
                kit.visible.setdefault("turning", pick(kit.rng, (0, 1, 2))),
            ):
                kit.add(main, part.at(sign * (depth / 2 - 0.05), y))
    for sign in (-1, 1):
        kit.add(
            main,
            rod(
                (sign * (depth / 2 - 0.05), -0.44 * length, 0.18),
                (sign * (depth / 2 - 0.05), 0.44 * length, 0.18),
                0.012,
            ),
        )
    high, lean = kit.uniform("back_height", 0.4, 0.7), kit.uniform("lean", 6, 14)

    def tilt(part: Solid) -> Solid:
        return part.turned("y", -lean).at(-depth / 2 + 0.03, 0, seat)

    kit.add(main, tilt(box(0.03, length + 0.04, 0.12, 0.01).at(z=high)))
    for y in np.linspace(-0.48, 0.48, int(length / 0.09)):
        kit.add(main, tilt(rod((0, y * length, -0.02), (0, y * length, high), 0.01, 6)))
    top = seat + 0.25
    kit.both(main, box(depth * 1.15, 0.06, 0.03, 0.01).at(-0.04, length / 2 - 0.02, top))
    for x in (-0.1, 0.15, 0.4):
        kit.both(
            main,
            rod(
                (x * depth, length / 2 - 0.03, seat - 0.02),
                (x * depth, length / 2 - 0.02, top),
                0.014,
            ),
        )


KINDS: dict[str, Callable[[Kit], None]] = {
    "park": _park, "slab": _slab, "panel_ends": _panel_ends, "storage": _storage, "pew": _pew,
    "planter": _planter, "curved": _curved, "picnic": _picnic, "stone": _stone, "gym": _gym,
    "swing": _swing, "rows": _locker_room, "double": _tete, "settle": _deacon,
}  # fmt: skip

_WEIGHTS = {"park": 3, "slab": 3}


def bench(kit: Kit) -> None:
    """Fourteen subtypes, see `KINDS`. Hidden: the depth of a recess, or supports behind an end."""
    kit.build_subtype(KINDS, _WEIGHTS)

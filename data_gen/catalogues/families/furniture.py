"""Chairs, benches, cabinets, tables, couches, lamps."""

import itertools

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    GLASS,
    LIGHT,
    RUBBER,
    WHITE,
    Kit,
    around,
    case,
    disc,
    fabric,
    lacquer,
    metal,
    paint,
    pick,
    rect,
    wood,
)
from data_gen.catalogues.solids import Solid, ball, box, cylinder, lathe, pillow, rod, tube
from data_gen.meshes import Material


def _legs(kit: Kit, x: float, y: float, height: float, style: str, material: Material) -> None:
    """Four legs whose feet are at most at (+-x, +-y)."""
    thick = kit.uniform("leg_thickness", 0.025, 0.05)
    splay = kit.uniform("leg_splay", 0.0, 0.12) * height if style in ("round", "tapered") else 0.0
    for sx in (-1, 1):
        for sy in (-1, 1):
            foot, top = (sx * x, sy * y, 0.0), (sx * (x - splay), sy * (y - splay), height)
            if style == "square":
                kit.add(material, box(thick, thick, height, 0.004).at(sx * x, sy * y, height / 2))
            elif style == "round":
                kit.add(material, rod(foot, top, thick / 2, 10))
            elif style == "tapered":
                kit.add(material, tube([foot, top], [thick * 0.3, thick * 0.65], 12))
            elif style == "turned":
                profile = [
                    (0.35, 0),
                    (0.5, 0.08),
                    (0.35, 0.16),
                    (0.6, 0.45),
                    (0.4, 0.6),
                    (0.62, 0.66),
                    (0.4, 0.72),
                    (0.6, 0.78),
                    (0.6, 1.0),
                ]
                kit.add(
                    material,
                    lathe([(r * thick * 1.2, h * height) for r, h in profile], 12).at(
                        sx * x, sy * y
                    ),
                )


def _swivel_base(kit: Kit, radius: float, height: float, material: Material) -> None:
    """A star foot with castors and a gas column."""
    arms = kit.choose("base_arms", 4, 5, 5)
    for angle in around(arms, kit.uniform("base_turn", 0, 72)):
        arm = tube(
            [(0, 0, 0.11), (radius * 0.5, 0, 0.095), (radius, 0, 0.065)], [0.028, 0.022, 0.016]
        )
        kit.add(material, arm.turned("z", angle))
        castor = cylinder(0.03, 0.04, 12).turned("x", 90).at(radius, 0, 0.03)
        kit.add(RUBBER, castor.turned("z", angle))
    kit.add(material, cylinder(0.028, height - 0.1, 12).at(z=0.1 + (height - 0.1) / 2))
    kit.add(BLACK, cylinder(0.045, (height - 0.1) * 0.5, 12).at(z=0.1 + (height - 0.1) * 0.25))


def _chair_back(
    kit: Kit,
    style: str,
    depth: float,
    width: float,
    low: float,
    high: float,
    lean: float,
    frame: Material,
    cover: Material,
) -> None:
    """The back of a chair, from z = low to high at the seat's rear edge, leaning backward."""
    rise = high - low

    def tilt(part: Solid) -> Solid:
        return part.turned("y", -lean).at(-depth / 2 + 0.02, 0, low)

    def post(y: float, radius: float = 0.016) -> Solid:
        return rod((0, y, -0.03), (0, y, rise), radius)

    half = width / 2 - 0.02
    if style == "solid":
        outline = solids.rounded(width, rise, kit.uniform("back_round", 0.01, 0.16), 4)
        back = solids.stack([(outline, -0.0125), (outline, 0.0125)]).turned("x", 90).turned("z", 90)
        kit.add(frame, tilt(back.at(z=rise / 2)))
    elif style == "padded":
        pad = kit.uniform("back_pad", 0.05, 0.09)
        kit.add(cover, tilt(pillow(pad, width * 0.96, rise * 0.94, 0.04).at(0.01, 0, rise * 0.53)))
        kit.both(frame, tilt(post(half * 0.5, 0.014)))
    elif style == "slats":
        kit.both(frame, tilt(post(half)))
        kit.add(frame, tilt(box(0.024, width, 0.07, 0.006).at(z=rise - 0.03)))
        kit.add(frame, tilt(box(0.02, width - 0.03, 0.035).at(z=0.1)))
        for y in np.linspace(-half, half, kit.choose("back_slats", 3, 4, 5) + 2)[1:-1]:
            kit.add(frame, tilt(box(0.012, 0.035, rise - 0.12).at(0, y, rise / 2 + 0.02)))
    elif style == "ladder":
        kit.both(frame, tilt(post(half, 0.018)))
        for z in np.linspace(rise * 0.25, rise - 0.035, kit.choose("back_rungs", 2, 3, 4)):
            bow = [(0, -half, z), (-0.025, 0, z), (0, half, z)]
            rung = tube(solids.smooth_path(bow, 4), 0.03, 8)
            kit.add(frame, tilt(rung.at(z=-z).scaled(0.45, 1, 1.1).at(z=z)))
    elif style == "spindles":
        count = kit.choose("back_spindles", 5, 6, 7, 8)
        bow = [
            (0, -half, 0.0),
            (-0.01, -half * 1.0, rise * 0.6),
            (-0.02, -half * 0.6, rise * 0.95),
            (-0.02, half * 0.6, rise * 0.95),
            (-0.01, half * 1.0, rise * 0.6),
            (0, half, 0.0),
        ]
        kit.add(frame, tilt(tube(solids.smooth_path(bow, 6), 0.014)))
        for y in np.linspace(-half, half, count + 2)[1:-1]:
            top = rise * (0.97 - 0.12 * (y / half) ** 2)
            kit.add(frame, tilt(rod((0, y * 0.85, 0), (-0.02, y * 0.95, top), 0.007, 6)))
    else:  # "open": a frame with one band
        loop = [
            (0, -half, 0),
            (0, -half, rise * 0.75),
            (0, -half * 0.75, rise),
            (0, half * 0.75, rise),
            (0, half, rise * 0.75),
            (0, half, 0),
        ]
        kit.add(frame, tilt(tube(solids.smooth_path(loop, 5), 0.014)))
        band = rise * kit.uniform("back_band", 0.25, 0.5)
        kit.add(cover, tilt(pillow(0.03, 2 * half, band, 0.014, 2).at(z=rise - band * 0.62)))


def _armrests(
    kit: Kit, style: str, depth: float, width: float, seat: float, material: Material, pad: Material
) -> None:
    top = seat + kit.uniform("arm_height", 0.18, 0.25)
    y = width / 2 + 0.015
    if style == "posts":
        kit.both(material, rod((depth * 0.32, y, seat - 0.03), (depth * 0.32, y, top), 0.014))
        kit.both(pad, box(depth * 0.92, 0.05, 0.025, 0.008).at(-0.01, y, top))
    elif style == "loops":
        loop = [
            (-depth * 0.42, y, seat - 0.02),
            (-depth * 0.44, y, top - 0.03),
            (-depth * 0.3, y, top),
            (depth * 0.3, y, top),
            (depth * 0.4, y, top - 0.05),
            (depth * 0.36, y, seat - 0.02),
        ]
        kit.both(material, tube(solids.smooth_path(loop, 4), 0.016))


def chair(kit: Kit) -> None:
    """Four legs, swivel, sled, cantilever, stool, armchair. Hidden: the hollow under the seat."""
    kind = kit.choose(
        "subtype",
        "four_legs",
        "four_legs",
        "four_legs",
        "swivel",
        "sled",
        "stool",
        "armchair",
        "cantilever",
    )
    frame = pick(kit.rng, (wood, wood, metal, lacquer))(kit.rng)
    cover = fabric(kit.rng) if kit.rng.random() < 0.6 else frame
    depth, width = kit.uniform("depth", 0.4, 0.5), kit.uniform("width", 0.4, 0.5)
    seat, thick = kit.uniform("seat_height", 0.4, 0.48), kit.uniform("seat_thickness", 0.05, 0.09)
    round_ = kit.uniform("seat_round", 0.01, 0.1)
    if kind == "stool":
        seat = kit.uniform("stool_height", 0.55, 0.75)
        width = depth = kit.uniform("stool_width", 0.32, 0.4)
    if kind == "armchair":
        _armchair(kit, frame, cover)
        return
    hollow = kit.hide("seat_recess", 0.02, 0.9) * thick
    outline = rect(depth, width, round_)
    if kind == "stool" and kit.chance("round_seat", 0.6):
        outline = disc(width / 2)
    kit.add(cover, solids.tray(outline, thick, 0.025, hollow).at(z=seat - thick))
    if kit.chance("cushion", 0.3) and kind != "stool":
        kit.add(fabric(kit.rng), pillow(depth * 0.92, width * 0.92, 0.05, 0.024).at(z=seat + 0.02))
    under = seat - thick + 0.005
    if kind == "four_legs":
        style = kit.choose("legs", "square", "round", "tapered", "turned")
        x, y = depth / 2 - 0.03, width / 2 - 0.03
        _legs(kit, x, y, under, style, frame)
        if style in ("square", "turned") and kit.chance("stretchers", 0.6):
            z = under * kit.uniform("stretcher_height", 0.2, 0.45)
            kit.both(frame, rod((-x, y, z), (x, y, z), 0.01))
            kit.add(frame, rod((0, -y, z), (0, y, z), 0.01))
    elif kind == "swivel":
        steel = CHROME if kit.rng.random() < 0.5 else BLACK
        _swivel_base(kit, kit.uniform("base_radius", 0.27, 0.33), under, steel)
    elif kind == "sled":
        x, y = depth / 2 - 0.02, width / 2 - 0.01
        loop = [
            (-x * 0.8, y, under),
            (-x, y, 0.04),
            (-x * 0.8, y, 0.014),
            (x * 0.8, y, 0.014),
            (x, y, 0.04),
            (x * 0.8, y, under),
        ]
        kit.both(frame, tube(solids.smooth_path(loop, 4), 0.014))
        kit.add(frame, rod((-x * 0.8, -y, under - 0.02), (-x * 0.8, y, under - 0.02), 0.012))
    elif kind == "cantilever":
        x, y = depth / 2, width / 2 - 0.005
        loop = [
            (-x, y, 0.016),
            (x * 0.7, y, 0.016),
            (x * 0.95, y, 0.06),
            (x, y, under * 0.6),
            (x * 0.9, y, under),
            (-x * 0.9, y, under),
        ]
        kit.both(CHROME, tube(solids.smooth_path(loop, 5), 0.015))
        kit.add(CHROME, rod((-x, -y, 0.016), (-x, y, 0.016), 0.015))
    elif kind == "stool":
        if kit.chance("pedestal", 0.4):
            steel = CHROME
            kit.add(steel, lathe([(0.2, 0), (0.2, 0.012), (0.05, 0.035), (0.028, 0.06)], 28))
            kit.add(steel, cylinder(0.025, under - 0.05, 14).at(z=0.05 + (under - 0.05) / 2))
            angle = np.linspace(0, 2 * np.pi, 25)[:, None]
            ring = np.hstack([0.15 * np.cos(angle), 0.15 * np.sin(angle), 0 * angle + under * 0.4])
            kit.add(steel, tube(ring, 0.01, 6))
            kit.add(steel, rod((-0.15, 0, under * 0.4), (0.15, 0, under * 0.4), 0.009))
        else:
            foot = width / 2 + 0.02
            for sx in (-1, 1):
                for sy in (-1, 1):
                    kit.add(
                        frame,
                        rod(
                            (sx * foot, sy * foot, 0),
                            (sx * foot * 0.6, sy * foot * 0.6, under),
                            0.016,
                        ),
                    )
            for z in (0.3, 0.5):
                r = foot * (1 - 0.4 * z)
                for a, b in (
                    ((r, -r), (r, r)),
                    ((-r, -r), (-r, r)),
                    ((-r, r), (r, r)),
                    ((-r, -r), (r, -r)),
                ):
                    kit.add(frame, rod((*a, under * z), (*b, under * z), 0.009))
    if kind == "stool" and not kit.chance("stool_back", 0.3):
        return
    rise = kit.uniform("back_height", 0.32, 0.58) * (0.6 if kind == "stool" else 1)
    style = kit.choose("back", "solid", "slats", "ladder", "spindles", "padded", "open")
    if kind in ("swivel", "cantilever"):
        style = kit.choose("back", "padded", "padded", "solid", "open")
    lean = kit.uniform("back_lean", 4, 14)
    _chair_back(kit, style, depth, width, seat, seat + rise, lean, frame, cover)
    if kind != "stool" and kit.chance("arms", 0.4):
        arm = kit.choose("arm_style", "posts", "loops")
        _armrests(kit, arm, depth, width, seat, CHROME if kind == "cantilever" else frame, cover)


def _armchair(kit: Kit, frame: Material, cover: Material) -> None:
    depth, width = kit.uniform("depth", 0.7, 0.85), kit.uniform("width", 0.68, 0.9)
    arm, back = kit.uniform("arm_width", 0.1, 0.17), kit.uniform("back_thickness", 0.13, 0.2)
    seat, top = kit.uniform("seat_height", 0.36, 0.44), kit.uniform("height", 0.75, 1.0)
    lift = kit.uniform("leg_height", 0.06, 0.16)
    base = seat - 0.14 - lift
    hollow = kit.hide("base_recess", 0.02, 0.9) * base
    kit.add(cover, solids.tray(rect(depth, width, 0.05), base, 0.05, hollow).at(z=lift))
    inner = width - 2 * arm
    kit.add(cover, pillow(depth - back, inner, 0.16, 0.05).at(back / 2, 0, seat - 0.07))
    kit.add(
        cover,
        pillow(
            back, width if kit.chance("wide_back", 0.5) else inner + 0.02, top - lift - base, 0.07
        )
        .turned("y", 0)
        .at(-depth / 2 + back / 2, 0, (top + lift + base) / 2),
    )
    high = seat + kit.uniform("arm_height", 0.14, 0.22)
    kit.both(
        cover,
        pillow(depth * 0.98, arm, high - lift - base + 0.04, 0.05).at(
            0, width / 2 - arm / 2, (high + lift + base) / 2 - 0.02
        ),
    )
    style = kit.choose("legs", "square", "tapered")
    _legs(kit, depth / 2 - 0.06, width / 2 - 0.06, lift + 0.02, style, frame)


def bench(kit: Kit) -> None:
    """Park bench, slab, storage bench. Hidden: supports behind a solid end, or a hollow seat."""
    kind = kit.choose("subtype", "park", "park", "slab", "panel_ends", "panel_ends", "storage")
    main = pick(kit.rng, (wood, wood, wood, lacquer))(kit.rng)
    iron = pick(kit.rng, (metal, lacquer))(kit.rng) if kit.rng.random() < 0.8 else BLACK
    length, depth = kit.uniform("length", 1.1, 1.9), kit.uniform("depth", 0.36, 0.48)
    seat = kit.uniform("seat_height", 0.4, 0.48)
    if kind == "storage":
        hollow = kit.hide("box_recess", 0.05, 0.92) * (seat - 0.03)
        kit.add(main, solids.tray(rect(depth, length, 0.01), seat - 0.03, 0.03, hollow))
        kit.add(fabric(kit.rng), pillow(depth, length, 0.07, 0.03).at(z=seat))
        for y in np.linspace(-length / 2, length / 2, kit.choose("panels", 2, 3, 4) + 1)[1:-1]:
            kit.add(BLACK, box(0.004, 0.012, seat * 0.8).at(depth / 2, y, seat * 0.46))
        if kit.chance("back", 0.5):
            kit.add(main, box(0.04, length, 0.42, 0.01).at(-depth / 2 + 0.02, 0, seat + 0.2))
        return
    if kind == "slab":
        thick = kit.uniform("thickness", 0.07, 0.14)
        hollow = kit.hide("slab_recess", 0.02, 0.92) * thick
        kit.add(
            main, solids.tray(rect(depth, length, 0.012), thick, 0.03, hollow).at(z=seat - thick)
        )
        under = seat - thick + 0.002
        style = kit.choose("supports", "square", "round", "tapered", "blocks")
        if style == "blocks":
            for y in (-1, 1):
                block = box(depth * 0.8, 0.14, under, 0.015)
                kit.add(iron, block.at(0, y * length * 0.36, under / 2))
        else:
            _legs(kit, depth / 2 - 0.04, length / 2 - 0.06, under, style, iron)
        if kit.chance("back", 0.35):
            _bench_back(kit, length, depth, seat, main, iron)
        return
    count = kit.choose("slats", 3, 4, 5)
    pitch = depth / count
    if kind == "panel_ends":
        # One board: through gaps the sight would run along the slats to what stands below.
        kit.add(main, box(depth, length, 0.035, 0.008).at(z=seat - 0.0175))
        for x in (np.arange(1, count) - count / 2) * pitch:
            kit.add(BLACK, box(0.006, length * 0.97, 0.002).at(x, 0, seat))
    else:
        for x in (np.arange(count) - (count - 1) / 2) * pitch:
            kit.add(main, box(pitch * 0.8, length, 0.035, 0.006).at(x, 0, seat - 0.017))
    under = seat - 0.035
    if kind == "park":
        # Curved iron ends, two or three; a thick front rail hides its own hollow back.
        wide = 0.05
        ends = (-1, 1) if kit.chance("two_ends", 0.7) else (-1, 0, 1)
        for side in ends:
            y = side * (length / 2 - 0.1)
            kit.add(iron, box(depth * 0.94, wide, 0.03).at(0, y, under - 0.015))
            for sign in (-1, 1):
                leg = [
                    (sign * depth * 0.4, y, under),
                    (sign * depth * 0.3, y, under * 0.55),
                    (sign * depth * 0.46, y, 0.015),
                ]
                kit.add(iron, tube(solids.smooth_path(leg, 4), 0.022))
                kit.add(iron, box(0.09, wide, 0.02).at(sign * depth * 0.46, y, 0.01))
        rail = kit.uniform("rail", 0.07, 0.1)
        hollow = kit.hide("rail_recess", 0.02, 0.92) * rail
        kit.add(
            main,
            solids.tray(rect(depth * 0.6, length * 0.9, 0.01), rail, 0.015, hollow).at(
                z=under - rail
            ),
        )
        if kit.chance("arms", 0.6):
            for side in (-1, 1):
                y = side * (length / 2 - 0.05)
                arm = [
                    (-depth * 0.45, y, seat + 0.22),
                    (0, y, seat + 0.24),
                    (depth * 0.4, y, seat + 0.2),
                    (depth * 0.44, y, seat - 0.02),
                ]
                kit.add(iron, tube(solids.smooth_path(arm, 4), 0.018))
        if kit.chance("back", 0.85):
            _bench_back(kit, length, depth, seat, main, iron)
        return
    # Solid ends as wide as the seat: from the side nobody knows what stands between them.
    end = box(depth, 0.06, under, 0.008)
    kit.both(iron, end.at(0, length / 2 - 0.06, under / 2))
    supports = kit.hide_count("supports", 4)
    width = kit.hide("support_width", 0.1, 0.3) * depth
    for y in np.linspace(-length / 2, length / 2, supports + 2)[1:-1] * 0.7:
        kit.add(iron, box(width, 0.05, under * 0.98).at(0, y, under * 0.5))
    kit.azimuth = ((85.0, 95.0), (-95.0, -85.0))
    if kit.chance("back", 0.6):
        _bench_back(kit, length, depth, seat, main, iron)


def _bench_back(
    kit: Kit, length: float, depth: float, seat: float, main: Material, iron: Material
) -> None:
    rise, lean = kit.uniform("back_height", 0.34, 0.46), kit.uniform("back_lean", 5, 15)

    def tilt(part: Solid) -> Solid:
        return part.turned("y", -lean).at(-depth / 2 + 0.02, 0, seat - 0.02)

    style = kit.choose("back_style", "rails", "rails", "slats", "solid")
    kit.both(iron, tilt(box(0.035, 0.045, rise, 0.004).at(-0.03, length / 2 - 0.1, rise / 2)))
    if style == "solid":
        kit.add(main, tilt(box(0.03, length, rise * 0.75, 0.008).at(0, 0, rise * 0.62)))
    elif style == "rails":
        count = kit.choose("back_rails", 2, 3, 4)
        pitch = rise * 0.85 / count
        for k in range(count):
            kit.add(
                main,
                tilt(box(0.026, length, pitch * 0.72, 0.006).at(0, 0, rise - pitch * (k + 0.5))),
            )
    else:
        kit.add(main, tilt(box(0.03, length, 0.06, 0.008).at(0, 0, rise)))
        kit.add(main, tilt(box(0.03, length, 0.05, 0.008).at(0, 0, rise * 0.2)))
        for y in np.linspace(-length / 2, length / 2, int(length / 0.1))[1:-1]:
            kit.add(main, tilt(box(0.015, 0.035, rise * 0.8).at(0, y, rise * 0.6)))


def cabinet(kit: Kit) -> None:
    """Wardrobe, dresser, sideboard, shelf, locker. Hidden: how far in the back panel stands."""
    kind = kit.choose(
        "subtype", "wardrobe", "dresser", "sideboard", "shelf", "locker", "nightstand"
    )
    body = pick(kit.rng, (wood, wood, lacquer))(kit.rng)
    front = body if kit.rng.random() < 0.4 else pick(kit.rng, (wood, lacquer))(kit.rng)
    if kind == "locker":
        body = front = lacquer(kit.rng)
    knob = metal(kit.rng)
    sizes = {
        "wardrobe": ((0.9, 1.6), (1.7, 2.2), (0.5, 0.62)),
        "dresser": ((0.7, 1.2), (0.75, 1.2), (0.42, 0.55)),
        "sideboard": ((1.2, 1.9), (0.55, 0.85), (0.38, 0.5)),
        "shelf": ((0.6, 1.2), (1.2, 2.0), (0.28, 0.4)),
        "locker": ((0.5, 1.2), (1.5, 1.9), (0.42, 0.55)),
        "nightstand": ((0.4, 0.55), (0.45, 0.65), (0.35, 0.45)),
    }
    wide, tall, deep = sizes[kind]
    width, height = kit.uniform("width", *wide), kit.uniform("height", *tall)
    depth = kit.uniform("depth", *deep)
    lift = 0.0
    if kind != "locker" and kit.chance("feet", 0.6):
        lift = kit.uniform("foot_height", 0.06, 0.16)
        _legs(
            kit,
            depth / 2 - 0.04,
            width / 2 - 0.05,
            lift + 0.01,
            kit.choose("legs", "square", "tapered"),
            body,
        )
    else:
        lift = 0.05
        kit.add(BLACK, box(depth - 0.06, width - 0.03, lift + 0.01).at(z=lift / 2))
    inner = height - lift
    wall = 0.02
    # Open to the front, the recess ends at the panel that the shelves stand against.
    panel = depth * 0.18
    back = kit.hide("back_recess", 0.0, (panel - 0.01) / depth if kind == "shelf" else 0.8) * depth
    kit.azimuth = ((-85.0, 85.0),)
    top = kit.chance("top_plate", 0.6)
    if top:
        kit.add(body, box(depth + 0.03, width + 0.04, 0.03, 0.006).at(0, 0, height + 0.014))
    if kind == "shelf":
        kit.both(body, box(depth, wall, inner, 0.003).at(0, width / 2 - wall / 2, lift + inner / 2))
        kit.add(
            body,
            box(panel - back, width - wall, inner - 0.01).at(
                -depth / 2 + (panel + back) / 2, 0, lift + inner / 2
            ),
        )
        count = kit.choose("shelves", 3, 4, 5, 6)
        for z in np.linspace(lift + wall / 2, height - wall / 2, count + 1):
            shelf_depth = (
                depth if z in (lift + wall / 2, height - wall / 2) else depth - panel - 0.01
            )
            kit.add(
                body,
                box(shelf_depth - 0.004, width - wall, wall).at(depth / 2 - shelf_depth / 2, 0, z),
            )
        if kit.chance("upright", 0.4):
            kit.add(
                body,
                box(depth - panel - 0.02, wall, inner - 0.02).at(panel / 2, 0, lift + inner / 2),
            )
        if kit.chance("books", 0.6):
            edges = np.linspace(lift + wall / 2, height - wall / 2, count + 1)
            for z, above in itertools.pairwise(edges):
                y, end = -width / 2 + 0.05, width / 2 * kit.rng.uniform(-0.5, 0.9)
                cover = [paint(kit.rng) for _ in range(3)]
                while y < end:
                    t = kit.rng.uniform(0.025, 0.05)
                    tall_ = (above - z - wall) * kit.rng.uniform(0.6, 0.92)
                    kit.add(
                        pick(kit.rng, cover),
                        box(depth * 0.5, t * 0.92, tall_).at(
                            0.05 * depth, y, z + wall / 2 + tall_ / 2
                        ),
                    )
                    y += t
        return
    kit.add(body, case(depth - 0.02, width, inner, wall, back).at(-0.01, 0, lift))
    if kind == "wardrobe":
        columns, rows = kit.choose("doors", 2, 2, 3, 4), 1
    elif kind == "locker":
        columns, rows = kit.choose("doors", 1, 2, 3), kit.choose("tiers", 1, 2, 3)
    elif kind == "nightstand":
        columns, rows = 1, kit.choose("drawers", 1, 2, 3)
    elif kind == "dresser":
        columns, rows = kit.choose("columns", 1, 2), kit.choose("drawers", 3, 4, 5)
    else:
        columns, rows = kit.choose("doors", 2, 3, 4), kit.choose("tiers", 1, 1, 2, 3)
    gap, w, h = 0.008, (width - 0.01) / columns, (inner - 0.01) / rows
    handle = kit.choose("handle", "knob", "bar", "bar")
    inset_panel = kit.chance("inset_panels", 0.4)
    for i in range(columns):
        for j in range(rows):
            y, z = (i - (columns - 1) / 2) * w, lift + 0.005 + (j + 0.5) * h
            kit.add(front, box(0.022, w - gap, h - gap, 0.004).at(depth / 2 - 0.011, y, z))
            if inset_panel and min(w, h) > 0.16:
                kit.add(body, box(0.004, w - 0.1, h - 0.1, 0.001).at(depth / 2 + 0.001, y, z))
            tall_door = h > w * 0.9
            hy = y + (0.4 * w if i < columns / 2 else -0.4 * w) if tall_door else y
            if columns == 1 and tall_door:
                hy = y + 0.4 * w
            if handle == "knob":
                kit.add(knob, ball(0.035, 0.035, 0.035, 10).at(depth / 2 + 0.018, hy, z))
            else:
                size = (
                    (0.02, 0.014, min(0.16, h * 0.5))
                    if tall_door
                    else (0.02, min(0.16, w * 0.4), 0.014)
                )
                kit.add(knob, box(size[0], size[1], size[2], 0.004).at(depth / 2 + 0.012, hy, z))
    if kind == "locker":
        for i in range(columns):
            for k in range(4):
                kit.add(
                    BLACK,
                    box(0.004, w * 0.5, 0.008).at(
                        depth / 2 + 0.001, (i - (columns - 1) / 2) * w, height - 0.1 - 0.025 * k
                    ),
                )


def table(kit: Kit) -> None:
    """Four legs, pedestal, trestle, coffee table, desk. Hidden: under the top, behind a panel."""
    kind = kit.choose(
        "subtype", "four_legs", "four_legs", "pedestal", "trestle", "coffee", "desk", "desk"
    )
    main = pick(kit.rng, (wood, wood, lacquer))(kit.rng)
    frame = main if kit.rng.random() < 0.5 else metal(kit.rng)
    depth, length = kit.uniform("depth", 0.7, 1.0), kit.uniform("length", 1.0, 2.0)
    height = kit.uniform("height", 0.7, 0.78)
    thick = kit.uniform("thickness", 0.05, 0.11)
    if kind == "coffee":
        height, depth = kit.uniform("height", 0.32, 0.48), kit.uniform("depth", 0.5, 0.8)
        length = kit.uniform("length", 0.7, 1.3)
    round_top = (kind == "pedestal" and kit.chance("round_top", 0.7)) or (
        kind == "coffee" and kit.chance("round_top", 0.3)
    )
    if round_top:
        length = depth = kit.uniform("diameter", 0.7, 1.2)
    outline = (
        disc(depth / 2, 40)
        if round_top
        else rect(depth, length, kit.uniform("corner", 0.004, 0.08))
    )
    glass = kind in ("coffee", "four_legs", "pedestal") and kit.chance("glass_top", 0.2)
    recess = kit.hide("rail_recess" if glass else "top_recess", 0.02, 0.92)
    under = height - thick + 0.002
    if glass:
        kit.add(GLASS, solids.stack([(outline(0.0), height - 0.016), (outline(0.0), height)]))
        # Rails under the glass, of a profile that is open below.
        rail = thick * 0.7
        low = height - 0.016 - rail
        part = rail * recess
        if round_top:
            kit.add(frame, solids.tray(disc(depth * 0.3, 32), rail, 0.012, part).at(z=low))
        else:
            for sign in (-1, 1):
                kit.add(
                    frame,
                    solids.tray(rect(0.05, length - 0.05), rail, 0.008, part).at(
                        sign * (depth / 2 - 0.05), 0, low
                    ),
                )
                kit.add(
                    frame,
                    solids.tray(rect(depth - 0.1, 0.05), rail, 0.008, part).at(
                        0, sign * (length / 2 - 0.05), low
                    ),
                )
    else:
        kit.add(main, solids.tray(outline, thick, 0.03, recess * thick).at(z=height - thick))
    if kind in ("four_legs", "coffee"):
        style = kit.choose("legs", "square", "round", "tapered", "turned")
        inset_ = 0.15 * depth if round_top else 0.05
        x, y = depth / 2 - inset_, length / 2 - inset_
        if round_top:
            x = y = depth * 0.32
        _legs(kit, x, y, height - 0.016 if glass else under, style, frame)
        if kind == "coffee" and not round_top and kit.chance("shelf", 0.5):
            kit.add(main, box(2 * x, 2 * y, 0.02, 0.004).at(z=height * 0.3))
    elif kind == "pedestal":
        r = kit.uniform("column", 0.035, 0.07)
        foot = kit.choose("foot", "disc", "star")
        kit.add(
            frame, lathe([(r * 1.6, 0.02), (r, 0.14), (r * 0.9, under * 0.6), (r * 1.7, under)], 20)
        )
        if foot == "disc":
            wide = min(depth, length) * 0.32
            kit.add(frame, lathe([(wide, 0), (wide, 0.02), (wide * 0.3, 0.06)], 32))
        else:
            for angle in around(kit.choose("feet", 3, 4, 4), 45):
                reach = min(depth, length) * 0.38
                arm = tube(
                    solids.smooth_path([(0, 0, 0.16), (reach * 0.6, 0, 0.08), (reach, 0, 0.02)], 4),
                    0.024,
                )
                kit.add(frame, arm.turned("z", angle))
    elif kind == "trestle":
        y = length * 0.36
        if kit.chance("panels", 0.4):
            kit.both(frame, box(depth * 0.7, 0.05, under, 0.006).at(0, y, under / 2))
        else:
            for s in (-1, 1):
                kit.add(frame, rod((-depth * 0.4, s * y, 0.0), (depth * 0.2, s * y, under), 0.025))
                kit.add(frame, rod((depth * 0.4, s * y, 0.0), (-depth * 0.2, s * y, under), 0.025))
        kit.add(frame, box(0.03, 2 * y, 0.07).at(0, 0, under * 0.45))
    elif kind == "desk":
        side = kit.choose("sides", "panels", "legs")
        if side == "panels":
            kit.both(
                frame, box(depth * 0.94, 0.03, under, 0.004).at(0, length / 2 - 0.03, under / 2)
            )
            # Under the front panel the sight goes down to the floor: what hangs behind it, no lower
            # than its edge, is anybody's guess.
            edge = under * kit.uniform("panel_edge", 0.25, 0.5)
            kit.add(
                main,
                box(0.025, length - 0.06, under - edge).at(depth * 0.36, 0, (under + edge) / 2),
            )
            count = kit.hide_count("pedestals", 3)
            wide = kit.hide("pedestal_width", 0.18, 0.3) * length
            left = bool(kit.hide_count("left", 2))
            for k in range(count):
                s = 1 if (k == 0) == left else -1
                tall = under - edge - 0.01
                block = box(depth * 0.66, wide, tall).at(
                    -0.02, s * (length / 2 - 0.05 - wide / 2), under - tall / 2
                )
                kit.add(main, block)
            kit.azimuth = ((-30.0, 30.0),)
        else:
            _legs(
                kit,
                depth / 2 - 0.05,
                length / 2 - 0.05,
                under,
                kit.choose("legs", "square", "round"),
                frame,
            )
            wide = length * kit.uniform("drawers_width", 0.2, 0.32)
            s = kit.choose("drawers_side", -1, 1)
            kit.add(
                main,
                box(depth * 0.8, wide, under * 0.8, 0.004).at(
                    0, s * (length / 2 - 0.08 - wide / 2), under * 0.6
                ),
            )
            for k in range(3):
                z = under * (0.28 + 0.26 * k)
                kit.add(
                    frame,
                    box(0.02, wide * 0.5, 0.014).at(
                        depth * 0.4, s * (length / 2 - 0.08 - wide / 2), z + 0.06
                    ),
                )
                kit.add(
                    BLACK,
                    box(0.003, wide, 0.006).at(
                        depth * 0.4, s * (length / 2 - 0.08 - wide / 2), z + 0.18
                    ),
                )


def couch(kit: Kit) -> None:
    """Two to four seats, chaise, chesterfield, arms of many widths. Hidden: the hollow base."""
    kind = kit.choose("subtype", "modern", "modern", "classic", "chaise", "loveseat", "armless")
    cover = fabric(kit.rng)
    cushion = cover if kit.rng.random() < 0.6 else fabric(kit.rng)
    foot = pick(kit.rng, (wood, metal))(kit.rng)
    seats = {"loveseat": 2, "chaise": 3}.get(kind) or kit.choose("seats", 2, 3, 3, 4)
    kit.visible["seats"] = seats
    one = kit.uniform("seat_width", 0.55, 0.7)
    arm = 0.0 if kind == "armless" else kit.uniform("arm_width", 0.1, 0.26)
    depth, back = kit.uniform("depth", 0.82, 1.0), kit.uniform("back_thickness", 0.14, 0.24)
    width = seats * one + 2 * arm
    seat, top = kit.uniform("seat_height", 0.38, 0.46), kit.uniform("height", 0.68, 0.92)
    skirt = kit.chance("skirt", 0.35)
    lift = 0.0 if skirt else kit.uniform("leg_height", 0.06, 0.16)
    base = seat - 0.15 - lift
    hollow = kit.hide("base_recess", 0.02, 0.92) * base
    kit.add(cover, solids.tray(rect(depth, width, 0.04), base, 0.06, hollow).at(z=lift))
    if not skirt:
        _legs(
            kit,
            depth / 2 - 0.07,
            width / 2 - 0.08,
            lift + 0.02,
            kit.choose("legs", "square", "tapered", "round"),
            foot,
        )
    floor = lift + base
    rear = -depth / 2
    kit.add(
        cover,
        pillow(back, width, top - floor + 0.04, min(0.07, back * 0.45)).at(
            rear + back / 2, 0, (top + floor) / 2 - 0.02
        ),
    )
    front = depth / 2
    if arm:
        high = seat + kit.uniform("arm_height", 0.1, 0.22)
        y = width / 2 - arm / 2
        kit.both(
            cover, pillow(depth, arm, high - floor + 0.06, 0.04).at(0, y, (high + floor) / 2 - 0.03)
        )
        if kind == "classic":
            roll = cylinder(arm * 0.62, depth * 0.99, 20, 0.02).turned("y", 90)
            kit.both(cover, roll.at(0, y + arm * 0.05, high))
            kit.add(
                cover,
                cylinder(back * 0.5, width * 0.985, 20, 0.02)
                .turned("x", 90)
                .at(rear + back * 0.5, 0, top),
            )
    for k in range(seats):
        y = (k - (seats - 1) / 2) * one
        long = front - rear - back
        extra = 0.0
        if kind == "chaise" and k == seats - 1:
            extra = kit.uniform("chaise", 0.4, 0.7)
            kit.add(
                cover,
                box(extra + 0.02, one, base, 0.02).at(
                    front + extra / 2 - 0.01, y, floor - base / 2
                ),
            )
            kit.add(
                foot, cylinder(0.025, lift + 0.02, 10).at(front + extra - 0.08, y, lift / 2 + 0.01)
            )
        kit.add(
            cushion,
            pillow(long + extra, one - 0.012, 0.17, 0.05).at(
                rear + back + (long + extra) / 2, y, seat - 0.075
            ),
        )
        if kind != "armless" or kit.rng.random() < 0.5:
            soft = pillow(0.16, one - 0.03, top - seat - 0.04, 0.07).turned("y", -12)
            kit.add(cushion, soft.at(rear + back + 0.07, y, (top + seat) / 2 + 0.01))
    if kit.chance("throw_pillows", 0.5):
        loose = fabric(kit.rng)
        for s in (-1, 1):
            p = pillow(0.12, 0.38, 0.38, 0.055).turned("y", -22).turned("z", -s * 15)
            kit.add(loose, p.at(rear + back + 0.24, s * (width / 2 - arm - 0.22), seat + 0.2))


def lamp(kit: Kit) -> None:
    """Floor, table, desk, pendant, tripod. Hidden: bulb and frame in a shade closed on top."""
    kind = kit.choose("subtype", "table", "table", "floor", "tripod", "desk", "pendant", "arc")
    body = pick(kit.rng, (metal, metal, wood, lacquer))(kit.rng)
    shade = pick(kit.rng, (fabric, lacquer))(kit.rng)
    if kit.rng.random() < 0.4:
        shade = Material((0.93, 0.89, 0.78), name="shade")
    style = kit.choose("shade", "cone", "drum", "bell", "dome")

    def hang(radius: float, tall: float, x: float, z: float, tip: float = 0.0) -> None:
        """A shade whose top is at z, with what it hides."""
        top = {"cone": 0.5, "drum": 0.92, "bell": 0.42, "dome": 0.3}[style]
        wall = 0.012
        if style in ("bell", "dome"):
            t = np.linspace(0, 1, 9)
            r = top + (1 - top) * (t**1.7 if style == "bell" else np.sqrt(1 - (1 - t) ** 2))
        else:
            t = np.array([0.0, 1.0])
            r = top + (1 - top) * t
        outer = [(radius * a, -tall * b) for a, b in zip(r, t, strict=True)]
        inner = [
            (radius * a - wall, -tall * b - (wall if b == 0 else 0))
            for a, b in zip(r, t, strict=True)
        ]
        part = lathe([*outer, *inner[::-1]], 32)
        kit.add(shade, part.turned("y", tip).at(x, 0, z))
        bulb = kit.hide("bulb_radius", 0.05, 0.28) * radius
        drop = kit.hide("bulb_drop", 0.3, 0.6) * tall
        kit.add(
            LIGHT,
            ball(2 * bulb, 2 * bulb, min(2.4 * bulb, 0.5 * tall), 14)
            .at(z=-drop)
            .turned("y", tip)
            .at(x, 0, z),
        )

    if kind == "pendant":
        cord = kit.uniform("cord", 0.5, 1.2)
        lights = kit.choose("lights", 1, 1, 3)
        radius, tall = (
            kit.uniform("shade_radius", 0.16, 0.3),
            kit.uniform("shade_height", 0.16, 0.32),
        )
        if lights == 1:
            hang(radius, tall, 0, tall)
            kit.add(body, rod((0, 0, tall - 0.01), (0, 0, tall + cord), 0.008, 6))
            kit.add(body, lathe([(0.07, 0), (0.06, 0.03), (0.01, 0.04)], 20).at(z=tall + cord))
        else:
            # One beam, three shades in a row; each with the same things inside.
            saved = dict(kit.hidden)
            state = kit.hidden_rng.bit_generator.state
            for y in (-1, 0, 1):
                kit.hidden_rng.bit_generator.state = state
                kit.hidden = dict(saved)
                before = kit.num_parts
                hang(radius * 0.7, tall * 0.8, 0, tall * 0.8)
                kit.move_from(before, y * radius * 1.9)
                kit.add(
                    body,
                    rod(
                        (0, y * radius * 1.9, tall * 0.8 - 0.01),
                        (0, y * radius * 1.9, tall + cord * 0.6),
                        0.007,
                        6,
                    ),
                )
            kit.add(body, box(0.06, radius * 4.6, 0.035, 0.01).at(0, 0, tall + cord * 0.6))
        return
    if kind == "desk":
        base = kit.uniform("base", 0.09, 0.13)
        kit.add(body, lathe([(base, 0), (base, 0.015), (base * 0.9, 0.028), (0.02, 0.035)], 28))
        a, b = kit.uniform("lower_arm", 0.3, 0.42), kit.uniform("upper_arm", 0.28, 0.4)
        lean, reach = (
            np.radians(kit.uniform("lean", 8, 25)),
            np.radians(kit.uniform("reach", 20, 50)),
        )
        elbow = np.array([-a * np.sin(lean), 0, 0.03 + a * np.cos(lean)])
        head = elbow + np.array([b * np.cos(reach), 0, b * np.sin(reach)])
        for side in (-0.012, 0.012):
            kit.add(
                body,
                rod((0, side, 0.03), (elbow[0], side, elbow[2]), 0.007),
                rod((elbow[0], side, elbow[2]), (head[0], side, head[2]), 0.007),
            )
        kit.add(body, cylinder(0.02, 0.05, 12).turned("x", 90).at(*elbow))
        kit.add(body, ball(0.06, 0.06, 0.06, 12).at(*head))
        style = kit.visible["shade"] = pick(kit.rng, ("cone", "dome", "bell"))
        hang(
            kit.uniform("shade_radius", 0.08, 0.12),
            kit.uniform("shade_height", 0.11, 0.16),
            head[0],
            head[2] + 0.01,
            kit.uniform("tip", -12, 0),
        )
        return
    if kind == "arc":
        base = kit.uniform("base", 0.16, 0.22)
        high = kit.uniform("height", 1.5, 1.9)
        reach = kit.uniform("reach", 0.7, 1.1)
        kit.add(pick(kit.rng, (BLACK, WHITE, body)), cylinder(base, 0.06, 32, 0.01).at(z=0.03))
        path = [
            (0, 0, 0.05),
            (-0.06, 0, high * 0.55),
            (reach * 0.25, 0, high * 0.95),
            (reach * 0.7, 0, high),
            (reach, 0, high * 0.82),
        ]
        kit.add(body, tube(solids.smooth_path(path, 6), 0.014))
        hang(
            kit.uniform("shade_radius", 0.16, 0.24),
            kit.uniform("shade_height", 0.16, 0.26),
            reach,
            high * 0.83,
        )
        return
    if kind == "table":
        radius, tall = (
            kit.uniform("shade_radius", 0.14, 0.22),
            kit.uniform("shade_height", 0.16, 0.26),
        )
        stem = kit.uniform("stem", 0.22, 0.4)
        shape = kit.choose("foot", "vase", "ball", "column", "gourd", "box")
        if shape == "vase":
            p = [
                (0.06, 0),
                (0.07, 0.02),
                (0.05, 0.06),
                (0.09, 0.4),
                (0.1, 0.6),
                (0.05, 0.9),
                (0.03, 1.0),
            ]
            kit.add(body, lathe([(r, h if k < 3 else h * stem) for k, (r, h) in enumerate(p)], 28))
        elif shape == "ball":
            r = stem * 0.42
            kit.add(
                body,
                ball(2 * r, 2 * r, 2 * r, 20).at(z=r + 0.02),
                cylinder(r * 0.6, 0.03, 24).at(z=0.015),
            )
        elif shape == "column":
            kit.add(body, lathe([(0.09, 0), (0.09, 0.02), (0.025, 0.05), (0.02, stem)], 28))
        elif shape == "gourd":
            p = [
                (0.08, 0),
                (0.11, 0.12),
                (0.1, 0.3),
                (0.045, 0.55),
                (0.06, 0.72),
                (0.05, 0.88),
                (0.02, 1.0),
            ]
            kit.add(body, lathe([(r, h * stem) for r, h in p], 28))
        else:
            kit.add(body, box(0.11, 0.11, stem * 0.85, 0.012).at(z=stem * 0.425))
        kit.add(
            metal(kit.rng),
            cylinder(0.01, tall + stem * 0.3, 10).at(z=stem * 0.85 + (tall + stem * 0.3) / 2),
        )
        hang(radius, tall, 0, stem + tall)
        return
    radius, tall = kit.uniform("shade_radius", 0.18, 0.28), kit.uniform("shade_height", 0.2, 0.32)
    high = kit.uniform("height", 1.3, 1.7)
    if kind == "tripod":
        hub = high - tall - 0.12
        for angle in around(3, kit.uniform("turn", 0, 120)):
            foot = kit.visible.setdefault("spread", float(kit.rng.uniform(0.22, 0.34)))
            kit.add(body, rod((foot, 0, 0), (0.02, 0, hub), 0.016).turned("z", angle))
        kit.add(
            metal(kit.rng),
            cylinder(0.035, 0.08, 16, 0.01).at(z=hub),
            cylinder(0.012, high - hub - 0.02, 10).at(z=(high + hub) / 2 - 0.01),
        )
    else:
        base = kit.uniform("base", 0.12, 0.18)
        kit.add(
            body,
            lathe(
                [(base, 0), (base, 0.018), (base * 0.3, 0.04), (0.013, 0.06), (0.013, high - 0.01)],
                28,
            ),
        )
        if kit.chance("reading_arm", 0.25):
            kit.add(body, rod((0, 0, high * 0.6), (0.22, 0.0, high * 0.62), 0.008))
            kit.add(
                shade,
                lathe([(0.03, 0), (0.06, -0.1), (0.05, -0.1), (0.02, -0.01)], 20).at(
                    0.23, 0, high * 0.63
                ),
            )
    hang(radius, tall, 0, high)

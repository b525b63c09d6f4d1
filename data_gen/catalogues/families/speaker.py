"""Loudspeakers: boxes, columns, horns and spheres, alone and in sets."""

from collections.abc import Callable

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families import hollows, legs
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    RUBBER,
    WHITE,
    Kit,
    around,
    case,
    lacquer,
    metal,
    paint,
    pick,
    plastic,
    rect,
    wood,
)
from data_gen.catalogues.solids import Solid, ball, box, cylinder, lathe, rod, tube
from data_gen.mesh import Material

GRILLE = Material((0.13, 0.13, 0.14), name="grille")
CONES = (
    BLACK,
    Material((0.2, 0.2, 0.22), name="cone"),
    Material((0.85, 0.7, 0.2), name="kevlar"),
    Material((0.8, 0.8, 0.8), name="aluminium"),
)


def _materials(kit: Kit) -> tuple[Material, Material]:
    """Materials of the cabinet and of the cones."""
    return pick(kit.rng, (wood, wood, plastic, lacquer, paint))(kit.rng), pick(kit.rng, CONES)


def driver(cone: Material, radius: float) -> list[tuple[Material, Solid]]:
    """A driver that faces +x, with its plane at x = 0."""
    d = 0.1 * radius + 0.003
    outer, soft = 0.9 * radius, 0.8 * radius
    ring = [(outer, 0), (radius, 0), (radius, d), (0.93 * radius, 1.3 * d), (outer, d)]
    edge = [(soft, 0), (outer, 0), (outer, 0.6 * d), (0.86 * radius, 1.1 * d), (soft, 0.8 * d)]
    funnel = [(soft, 0), (soft, 0.8 * d), (0.3 * radius, 0.0035)]
    dome = ball(radius * 0.5, radius * 0.5, radius * 0.3, 14).at(z=0.003)
    parts = (
        (CHROME, lathe(ring, 28, loop=True)),
        (RUBBER, lathe(edge, 28, loop=True)),
        (cone, lathe(funnel, 28)),
        (BLACK, dome),
    )
    return [(material, part.turned("y", 90)) for material, part in parts]


def _drivers(
    kit: Kit, cone: Material, x: float, y: float, low: float, width: float, height: float,
    count: int,
) -> None:  # fmt: skip
    """Adds woofers and a tweeter above them to a front of this width and height."""
    r = min(width * 0.42, 0.42 * height * 0.72 / max(count, 1))
    pitch = min(2.2 * r, height * 0.72 / max(count, 1))
    for k in range(count):
        for material, part in driver(cone, min(r, 0.47 * pitch)):
            kit.add(material, part.at(x, y, low + height * 0.05 + pitch * (k + 0.5)))
    small = min(width * 0.18, 0.11 * height)
    z = low + min(height * 0.05 + pitch * count + 1.6 * small, height - 1.3 * small)
    for material, part in driver(cone, small):
        kit.add(material, part.at(x, y, z))


def _cabinet(
    kit: Kit, body: Material, depth: float, width: float, height: float, lift: float = 0.0
) -> None:
    """A closed box with a recess in its underside, or a box with an open back (`open_speaker`)."""
    if kit.visible.get("open_back"):
        back = kit.hide("back_recess", 0.0, 0.75) * depth
        kit.add(body, case(depth, width, height, 0.015, back).at(z=lift))
        kit.azimuth = ((-85.0, 85.0),)
        return
    corner = min(depth, width) * kit.choose("corner", 0.02, 0.02, 0.12, 0.3)
    taper = kit.choose("taper", 0.0, 0.0, 0.0, 0.25)
    flat = solids.rounded(depth, width, corner, 3)
    if taper:
        # Tapered toward the rear.
        flat = flat * np.stack([np.ones(len(flat)), 1 - taper * (0.5 - flat[:, 0] / depth)], axis=1)
    levels = [(flat, 0.0), (flat, height - 0.006), (flat * 0.985, height)]
    kit.add(body, hollows.body(kit, levels, min(0.06, 0.3 * height)).at(z=lift))
    port = kit.choose("rear", "port", "terminals", "plain")
    if port == "port":
        r = min(0.16 * width, 0.1 * height)
        kit.add(
            BLACK, cylinder(r, 0.012, 20).turned("y", 90).at(-depth / 2, 0, lift + height * 0.7)
        )
    if port != "plain":
        kit.add(BLACK, box(0.012, 0.4 * width, 0.3 * width).at(-depth / 2, 0, lift + height * 0.25))


def _grille(kit: Kit, depth: float, width: float, height: float, lift: float) -> bool:
    """Adds cloth over the front with some probability; returns whether it hides the drivers."""
    if kit.chance("covered", 0.2):
        kit.add(
            GRILLE,
            box(0.03, width * 0.92, height * 0.95, 0.008).at(depth / 2, 0, lift + height / 2),
        )
        return True
    kit.add(
        GRILLE, box(0.004, width * 0.8, height * 0.96, 0.001).at(depth / 2, 0, lift + height / 2)
    )
    return False


def _tower(kit: Kit) -> None:
    body, cone = _materials(kit)
    width, height = kit.uniform("width", 0.14, 0.42), kit.uniform("height", 0.75, 1.5)
    depth = kit.uniform("depth", 0.18, 0.5)
    lift = 0.025
    _cabinet(kit, body, depth, width, height, lift)
    base = kit.choose("base", "spikes", "plate", "outriggers")
    if base == "plate":
        kit.add(BLACK, box(depth * 1.15, width * 1.25, 0.03, 0.006).at(z=0.015))
    else:
        wide = 1.0 if base == "spikes" else 1.35
        for sx in (-1, 1):
            kit.both(
                BLACK,
                lathe([(0.006, 0), (0.016, lift + 0.002)], 10).at(
                    sx * (depth / 2 - 0.03), wide * (width / 2 - 0.03)
                ),
            )
        if wide > 1:
            for sx in (-1, 1):
                kit.add(
                    BLACK,
                    box(0.04, wide * width, 0.015).at(sx * (depth / 2 - 0.03), 0, lift + 0.005),
                )
    if not _grille(kit, depth, width, height, lift):
        _drivers(kit, cone, depth / 2, 0, lift, width, height, kit.choose("woofers", 1, 2, 3, 4))
        if kit.chance("side_woofer", 0.2):
            for material, part in driver(cone, min(depth * 0.4, height * 0.16)):
                kit.both(material, part.turned("z", 90).at(0, width / 2, lift + height * 0.2))


def _bookshelf(kit: Kit) -> None:
    body, cone = _materials(kit)
    width, height = kit.uniform("width", 0.14, 0.3), kit.uniform("height", 0.2, 0.5)
    depth = kit.uniform("depth", 0.13, 0.36)
    lift = 0.02 if kit.chance("feet", 0.5) else 0.0
    _cabinet(kit, body, depth, width, height, lift)
    for sx in (-1, 1) if lift else ():
        kit.both(
            BLACK,
            cylinder(0.014, lift + 0.004, 10).at(
                sx * (depth / 2 - 0.03), width / 2 - 0.03, lift / 2
            ),
        )
    if not _grille(kit, depth, width, height, lift):
        _drivers(kit, cone, depth / 2, 0, lift, width, height, 1)


def _tripod(
    kit: Kit,
    material: Material,
    height: float,
    leg: tuple[float, float, float],
    brace: tuple[float, float, float],
) -> None:
    """Three legs and three braces around a column.

    Args:
      kit: the model.
      material: material of legs and braces.
      height: height of the column; the legs begin at half of it.
      leg: reach as a fraction of `height`, height of the foot, radius.
      brace: height at the column and reach, both as fractions of `height`, and radius.
    """
    for angle in around(3, 60):
        kit.add(
            material,
            rod((0, 0, height * 0.5), (height * leg[0], 0, leg[1]), leg[2]).turned("z", angle),
            rod((0, 0, height * brace[0]), (height * brace[1], 0, height * 0.22), brace[2]).turned(
                "z", angle
            ),
        )


def _on_stand(kit: Kit) -> None:
    """A small box on a column, on legs or on a tripod."""
    body, cone = _materials(kit)
    width, height, depth = (
        kit.uniform("width", 0.1, 0.26),
        kit.uniform("height", 0.14, 0.46),
        kit.uniform("depth", 0.1, 0.32),
    )
    lift = kit.uniform("stand_height", 0.4, 1.1)
    _cabinet(kit, body, depth, width, height, lift)
    stand = kit.choose("stand", "column", "twin", "frame", "tripod", "disc")
    if stand == "tripod":
        kit.add(BLACK, cylinder(0.018, lift, 12).at(z=lift / 2))
        _tripod(kit, BLACK, lift, (0.36, 0.012, 0.012), (0.2, 0.2, 0.008))
    elif stand == "frame":
        for sx in (-1, 1):
            kit.both(
                body,
                tube(
                    [(sx * depth * 0.6, width * 0.7, 0), (sx * depth * 0.4, width * 0.4, lift)],
                    0.014,
                ),
            )
        kit.add(body, box(depth * 0.9, width * 0.9, 0.02).at(z=lift - 0.008))
    else:
        if stand == "disc":
            kit.add(BLACK, lathe([(0.16, 0), (0.16, 0.012), (0.03, 0.03)], 28))
        else:
            kit.add(BLACK, box(depth * 1.2, width * 1.4, 0.02, 0.005).at(z=0.01))
        kit.add(BLACK, box(depth * 0.9, width * 0.9, 0.015).at(z=lift - 0.006))
        for y in (-0.25, 0.25) if stand == "twin" else (0.0,):
            kit.add(BLACK, cylinder(0.022, lift - 0.01, 14).at(0, y * width, lift / 2))
    if not _grille(kit, depth, width, height, lift):
        _drivers(kit, cone, depth / 2, 0, lift, width, height, 1)


def _subwoofer(kit: Kit) -> None:
    """A subwoofer: a box with one large driver in front, or a drum with one on top."""
    body, cone = _materials(kit)
    size = kit.uniform("size", 0.28, 0.5)
    lift = kit.uniform("lift", 0.02, 0.1)
    legs.feet(kit, size * 0.36, size * 0.36, lift + 0.005, BLACK)
    if kit.chance("drum", 0.35):
        tall = size * kit.uniform("tall", 0.8, 1.7)
        kit.add(
            body,
            hollows.turned(
                kit,
                [(size * 0.47, 0), (size / 2, 0.02), (size / 2, tall - 0.02), (size * 0.47, tall)],
                36,
                0.05,
            ).at(z=lift),
        )
        for material, part in driver(cone, size * 0.38):
            kit.add(material, part.turned("y", -90).at(0, 0, lift + tall))
        return
    depth, width, height = (
        size * kit.uniform("d", 0.8, 1.3),
        size * kit.uniform("w", 0.7, 1.2),
        size,
    )
    _cabinet(kit, body, depth, width, height, lift)
    if not _grille(kit, depth, width, height, lift):
        for material, part in driver(cone, 0.4 * min(width, height)):
            kit.add(material, part.at(depth / 2, 0, lift + height * 0.54))


def _bar(kit: Kit) -> None:
    """A long and low speaker: a sound bar or a centre speaker."""
    body, cone = _materials(kit)
    width, height = kit.uniform("width", 0.4, 1.2), kit.uniform("height", 0.06, 0.2)
    depth, section = (
        kit.uniform("depth", 0.07, 0.26),
        kit.choose("section", "box", "oval", "bowed", "wedge"),
    )
    if section == "box":
        _cabinet(kit, body, depth, width, height)
    else:
        if section == "oval":
            flat = solids.superellipse(depth, width, 4.0, 36)
            levels = [
                (flat * 0.9, 0.0),
                (flat, 0.3 * height),
                (flat, 0.7 * height),
                (flat * 0.9, height),
            ]
        elif section == "bowed":
            t = np.linspace(-1, 1, 15)
            front = np.stack([depth / 2 + 0.12 * width * (1 - t**2), t * width / 2], axis=1)
            flat = np.concatenate([front, [(-depth / 2, width / 2), (-depth / 2, -width / 2)]])
            levels = [(flat, 0.0), (flat, height)]
        else:
            flat = solids.rounded(depth, width, 0.02)
            levels = [(flat, 0.0), (flat * [0.6, 1] - [0.2 * depth, 0], height)]
        kit.add(body, hollows.body(kit, levels, 0.1 * height))
        cloth = [(flat * [1.01, 0.9], 0.0), (flat * [1.01, 0.9], 0.6 * height)]
        if section != "wedge":
            kit.add(
                GRILLE,
                solids.stack(cloth).at(0.004 if section == "bowed" else 0.0, 0, 0.2 * height),
            )
        else:
            tip = float(np.degrees(np.arctan2(0.4 * depth, height)))
            strip = box(0.008, 0.9 * width, 0.8 * height).turned("y", -tip)
            kit.add(GRILLE, strip.at(0.3 * depth, 0, 0.5 * height))
    x = depth / 2
    if section in ("box", "oval"):
        kit.add(GRILLE, box(0.006, width * 0.7, height * 0.6).at(x, 0, height / 2))
        for y in np.linspace(-0.3, 0.3, kit.choose("drivers", 2, 3, 4, 6)) * width:
            for material, part in driver(cone, height * 0.3):
                kit.add(material, part.at(x + 0.001, float(y), height / 2))
    if kit.chance("subwoofer", 0.4):
        s, y = kit.uniform("sub", 0.22, 0.4), kit.choose("side", -1, 1) * (width / 2 + 0.3)
        kit.add(body, box(s * 1.1, s * 0.8, s, 0.01).at(0, y, s / 2))
        for material, part in driver(cone, s * 0.3):
            kit.add(material, part.at(s * 0.55, y, s * 0.5))


def _stage(kit: Kit) -> None:
    """A stage speaker: a horn above a woofer; on a pole, on wheels, or stacked."""
    body = BLACK if kit.chance("black", 0.6) else _materials(kit)[0]
    cone = pick(kit.rng, CONES[:2])
    width, height, depth = (
        kit.uniform("width", 0.32, 0.56),
        kit.uniform("height", 0.5, 0.95),
        kit.uniform("depth", 0.28, 0.5),
    )
    lift, place = 0.0, kit.choose("place", "ground", "pole", "wheels", "stack")
    if place == "pole":
        lift = kit.uniform("pole", 0.9, 1.5)
        kit.add(CHROME, cylinder(0.02, lift, 14).at(z=lift / 2))
        _tripod(kit, CHROME, lift, (0.42, 0.015, 0.014), (0.15, 0.25, 0.009))
    elif place == "wheels":
        lift = 0.09
        for sx in (-1, 1):
            kit.both(
                RUBBER,
                cylinder(0.045, 0.03, 16).turned("x", 90).at(sx * depth * 0.36, width * 0.4, 0.045),
            )
    elif place == "stack":
        tall = kit.uniform("sub", 0.45, 0.7)
        kit.add(body, box(depth * 1.3, width * 1.2, tall, 0.01).at(0, 0, tall / 2))
        for material, part in driver(cone, 0.42 * min(width * 1.2, tall)):
            kit.add(material, part.at(depth * 0.65, 0, tall / 2))
        lift = tall + (0.0 if kit.chance("direct", 0.5) else kit.uniform("rod", 0.3, 0.8))
        kit.add(BLACK, cylinder(0.02, lift, 12).at(z=lift / 2))
    _cabinet(kit, body, depth, width, height, lift)
    x = depth / 2
    for material, part in driver(cone, min(width * 0.4, height * 0.28)):
        kit.add(material, part.at(x, 0, lift + height * 0.33))
    horn = [
        (np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * [a, b], z)
        for a, b, z in ((0.3, 0.7, 0.0), (0.3, 0.7, 0.02), (0.24, 0.62, 0.02), (0.06, 0.14, 0.004))
    ]
    part = solids.stack([(flat * [height, width], z) for flat, z in horn]).turned("y", 90)
    kit.add(GRILLE, part.at(x, 0, lift + height * 0.8))
    kit.both(BLACK, box(depth * 0.4, 0.012, 0.09, 0.002).at(0, width / 2, lift + height * 0.7))


def _wedge(kit: Kit) -> None:
    """A floor monitor, with a front that leans back."""
    body = BLACK if kit.chance("black", 0.6) else _materials(kit)[0]
    cone = pick(kit.rng, CONES)
    width, depth = kit.uniform("width", 0.4, 0.75), kit.uniform("depth", 0.35, 0.6)
    height, lean = kit.uniform("height", 0.28, 0.46), kit.uniform("lean", 0.25, 0.7)
    t = lean * depth
    foot = solids.rounded(depth, width, 0.01, 1)
    levels = [
        (foot, 0.0),
        (foot, 0.12 * height),
        (solids.rounded(depth - t, width, 0.01, 1) - [t / 2, 0], height),
    ]
    kit.add(body, hollows.body(kit, levels, 0.12 * height))
    rise, run = 0.88 * height, t
    tip = np.degrees(np.arctan2(run, rise))
    slope = float(np.hypot(rise, run))
    middle = (depth / 2 - run / 2, 0.12 * height + rise / 2)
    front = box(0.012, width * 0.9, slope * 0.9).turned("y", -tip).at(middle[0], 0, middle[1])
    kit.add(GRILLE, front)
    for y, r in ((-0.2, 0.36), (0.26, 0.2)):
        for material, part in driver(cone, min(r * slope, 0.22 * width)):
            kit.add(
                material, part.turned("y", -tip).at(middle[0] + 0.006, y * width, middle[1] + 0.002)
            )


def _horn(kit: Kit) -> None:
    """A loudhailer on a post or bracket, a gramophone, several horns around a mast."""
    body = pick(kit.rng, (metal, lacquer, plastic))(kit.rng)
    mouth, long = kit.uniform("mouth", 0.15, 0.35), kit.uniform("long", 0.25, 0.6)
    power = kit.uniform("flare", 2.0, 4.0)
    t = np.linspace(0, 1, 11)
    outer = [(0.02 + (mouth - 0.02) * float(a) ** power, long * float(a)) for a in t]
    inner = [(max(r - 0.008, 0.008), z + (0.02 if k == 0 else 0)) for k, (r, z) in enumerate(outer)]
    sides = kit.choose("sides", 32, 32, 4)
    horn = lathe([*outer, *inner[::-1]], sides)
    if sides == 4:
        horn = horn.turned("z", 45).scaled(1.0, kit.uniform("wide", 1.0, 1.7), 1.0)
    back = lathe(
        solids.smooth_profile([(0.01, -0.12), (0.06, -0.09), (0.07, 0.0), (0.03, 0.04)], 3), 20
    )
    style = kit.choose("style", "gramophone", "post", "bracket", "mast")
    if style == "gramophone":
        case_ = wood(kit.rng)
        size = kit.uniform("case", 0.26, 0.4)
        flat = solids.rounded(size, size, 0.01, 1)
        kit.add(
            case_,
            hollows.body(
                kit,
                [
                    (flat * 1.1, 0.0),
                    (flat * 1.1, 0.03),
                    (flat, 0.04),
                    (flat, 0.15),
                    (flat * 1.06, 0.17),
                ],
                0.06,
            ),
        )
        kit.add(BLACK, cylinder(size * 0.42, 0.015, 32).at(z=0.18))
        path = solids.smooth_path(
            [
                (-size * 0.4, 0, 0.17),
                (-size * 0.45, 0, 0.34),
                (-size * 0.3, 0, 0.42),
                (-size * 0.1, 0, 0.44),
            ],
            4,
        )
        kit.add(body, tube(path, 0.02), horn.turned("y", 62).at(-size * 0.12, 0, 0.42))
        return
    count = kit.choose("horns", 2, 3, 4) if style == "mast" else 1
    high = {
        "post": kit.uniform("post", 0.3, 1.4),
        "bracket": mouth + 0.05,
        "mast": kit.uniform("mast", 0.8, 1.8),
    }[style]
    kit.add(
        BLACK, hollows.turned(kit, [(0.14, 0), (0.14, 0.02), (0.03, 0.04), (0.02, high)], 24, 0.015)
    )
    for angle in around(count):
        for part in (
            horn.turned("y", 90).at(0.05, 0, high),
            back.turned("y", 90).at(0.05, 0, high),
        ):
            kit.add(body, part.turned("z", angle))


def _round(kit: Kit) -> None:
    """A speaker in the shape of a cylinder, a ball, an egg or a ring."""
    body, cone = pick(kit.rng, (plastic, paint, lacquer))(kit.rng), pick(kit.rng, CONES)
    size = kit.uniform("size", 0.08, 0.2)
    style = kit.choose("style", "upright", "lying", "ball", "egg", "puck", "dome", "ring")
    if style in ("upright", "puck"):
        tall = size * (
            kit.uniform("tall", 1.4, 3.4) if style == "upright" else kit.uniform("flat", 0.35, 0.7)
        )
        r, edge = size / 2, 0.06 * size
        profile = [
            (r - edge, 0),
            (r, edge),
            (r * kit.uniform("waist", 0.85, 1.1), tall / 2),
            (r, tall - edge),
            (r - edge, tall),
        ]
        kit.add(body, hollows.turned(kit, profile, 36, 0.1 * size))
        kit.add(GRILLE, lathe([(r * 1.005, 0), (r * 1.005, 0.05 * tall)], 36).at(z=tall * 0.12))
        for material, part in driver(cone, r * 0.7):
            kit.add(material, part.turned("y", -90).at(0, 0, tall))
    elif style == "lying":
        long = size * kit.uniform("long", 1.6, 3.2)
        kit.add(
            body, cylinder(size / 2, long, 32, 0.04 * size).turned("x", 90).at(0, 0, size * 0.52)
        )
        for s in (-1, 1):
            for material, part in driver(cone, size * 0.4):
                kit.add(material, part.turned("z", s * 90).at(0, s * long / 2, size * 0.52))
        kit.add(
            RUBBER,
            hollows.slab(kit, "foot_recess", rect(size * 0.5, long * 0.6, 0.01), 0.1 * size, 0.008),
        )
        if kit.chance("handle", 0.4):
            path = solids.smooth_path(
                [
                    (0, -long * 0.35, size * 0.95),
                    (0, -long * 0.3, size * 1.35),
                    (0, long * 0.3, size * 1.35),
                    (0, long * 0.35, size * 0.95),
                ],
                5,
            )
            kit.add(BLACK, tube(path, 0.06 * size))
    elif style == "ring":
        r = size
        a = np.linspace(0, 2 * np.pi, 33)[:-1]
        path = np.stack([0 * a, r * np.cos(a), r * np.sin(a)], axis=1)
        flat = solids.superellipse(1.1 * size, 0.35 * size, 3.0, 16)
        kit.add(body, solids.sweep(flat, path, (1, 0, 0), loop=True).at(z=1.2 * r))
        kit.add(
            BLACK,
            hollows.turned(
                kit, [(0.6 * r, 0), (0.6 * r, 0.02), (0.2 * r, 0.06 * r + 0.02)], 28, 0.015
            ),
        )
    else:
        stretch = {"ball": 1.0, "egg": 1.35, "dome": 0.62}[style]
        t = np.linspace(-0.8, 1.0, 12)
        power = 1.0 if style != "egg" else 0.8
        profile = [
            (
                size * np.sqrt(max(1 - v * v, 0.0)) ** power * (1 - 0.12 * v * (style == "egg")),
                size * stretch * (v + 0.8),
            )
            for v in t
        ]
        lift = 0.0 if style == "dome" else kit.choose("lift", 0.0, 0.02, 0.6 * size)
        kit.add(body, hollows.turned(kit, profile, 32, 0.15 * size).at(z=lift))
        if lift > 0.03:
            for angle in around(3, 60):
                kit.add(
                    CHROME,
                    rod(
                        (0.9 * size, 0, 0), (0.3 * size, 0, lift + 0.15 * size), 0.07 * size
                    ).turned("z", angle),
                )
        for material, part in driver(cone, size * 0.55):
            kit.add(material, part.at(size * 0.82, 0, lift + size * stretch * 0.8))
        if style == "egg":
            for material, part in driver(cone, size * 0.22):
                kit.add(
                    material, part.turned("y", -35).at(size * 0.6, 0, lift + size * stretch * 1.42)
                )


def _set(kit: Kit) -> None:
    """Two or four satellites with a subwoofer, a centre speaker or a stereo system."""
    body, cone = _materials(kit)
    width, height, depth = (
        kit.uniform("width", 0.08, 0.16),
        kit.uniform("height", 0.12, 0.34),
        kit.uniform("depth", 0.08, 0.18),
    )
    count, pitch = kit.choose("satellites", 2, 2, 4), kit.uniform("pitch", 0.3, 0.7)
    share = kit.hide("base_recess", *hollows.RANGE)
    round_ = kit.chance("round", 0.3)
    stand = kit.choose("stand", 0.0, 0.0, 0.5)
    for k in range(count):
        s, row = (-1, 1)[k % 2], k // 2
        x, y = -row * 0.3, s * (pitch + 0.35 * row)
        parts = []
        if round_:
            parts.append(
                (body, ball(depth * 1.2, width * 1.2, height, 18).at(0, 0, stand + height / 2))
            )
            z = stand + height / 2
            parts += [(m, p.at(depth * 0.5, 0, z)) for m, p in driver(cone, width * 0.3)]
        else:
            parts.append(
                (
                    body,
                    solids.tray(rect(depth, width, 0.01), height, 0.012, share * 0.3 * height).at(
                        z=stand
                    ),
                )
            )
            parts += [
                (m, p.at(depth / 2, 0, stand + height * t))
                for t, r in ((0.35, 0.4), (0.8, 0.24))
                for m, p in driver(cone, min(r * width, 0.16 * height))
            ]
        if stand:
            parts += [
                (BLACK, cylinder(0.012, stand + 0.01, 10).at(z=stand / 2)),
                (BLACK, cylinder(0.1, 0.02, 24).at(z=0.01)),
            ]
        for material, part in parts:
            kit.add(material, part.turned("z", -s * 15).at(x, y))
    middle = kit.choose("middle", "subwoofer", "subwoofer", "stereo", "centre")
    if middle == "stereo":
        w = pitch * 0.7
        kit.add(BLACK, solids.tray(rect(0.25, w, 0.01), 0.12, 0.02, share * 0.05))
        for k in range(2):
            kit.add(body, box(0.25, w, 0.1, 0.006).at(0, 0, 0.17 + 0.11 * k))
        kit.add(
            CHROME,
            cylinder(0.03, 0.03, 20).turned("y", 90).at(0.13, w * 0.3, 0.17),
            box(0.01, w * 0.5, 0.03).at(0.125, -0.05 * w, 0.28),
        )
        kit.add(
            WHITE, *(box(0.012, 0.03, 0.012).at(0.125, w * (0.1 * k - 0.3), 0.06) for k in range(5))
        )
    else:
        sub = kit.uniform("sub", 0.2, 0.36)
        d, w, h = (
            (sub * 1.1, sub * 0.9, sub) if middle == "subwoofer" else (depth, height * 1.4, width)
        )
        kit.add(body, solids.tray(rect(d, w, 0.01), h, 0.02, share * 0.2 * h))
        for t in (0.0,) if middle == "subwoofer" else (-0.3, 0.3):
            for material, part in driver(cone, 0.38 * min(w, h)):
                kit.add(material, part.at(d / 2, t * w, h / 2))


def _radio(kit: Kit) -> None:
    """A boombox, a radio, a jukebox, a guitar amplifier."""
    body, cone = _materials(kit)
    style = kit.choose("style", "boombox", "radio", "jukebox", "amplifier")
    if style == "boombox":
        width, height, depth = (
            kit.uniform("width", 0.4, 0.7),
            kit.uniform("height", 0.18, 0.32),
            kit.uniform("depth", 0.1, 0.2),
        )
        _cabinet(kit, body, depth, width, height)
        for s in (-1, 1):
            for material, part in driver(cone, 0.38 * height):
                kit.add(
                    material, part.at(depth / 2, s * (width / 2 - 0.45 * height), height * 0.45)
                )
        kit.add(
            BLACK,
            box(0.01, width * 0.3, height * 0.4).at(depth / 2, 0, height * 0.4),
            box(0.012, width * 0.8, height * 0.1).at(depth / 2, 0, height * 0.9),
        )
        path = np.array(
            [
                (0, -width * 0.4, height),
                (0, -width * 0.4, height * 1.35),
                (0, width * 0.4, height * 1.35),
                (0, width * 0.4, height),
            ]
        )
        kit.add(CHROME, tube(path, 0.014))
        return
    if style == "radio":
        width, height, depth = (
            kit.uniform("width", 0.25, 0.45),
            kit.uniform("height", 0.18, 0.42),
            kit.uniform("depth", 0.12, 0.22),
        )
        t = np.linspace(0, np.pi, 15)
        arch = kit.uniform("arch", 0.0, 0.5)
        shape = [
            (width / 2 * np.cos(a), height * (1 - arch) + height * arch * np.sin(a)) for a in t
        ]
        shape = [(width / 2, 0.02), *shape, (-width / 2, 0.02)]
        kit.add(body, solids.prism(shape, depth, 0.006).turned("z", 90))
        kit.add(
            BLACK,
            hollows.slab(kit, "foot_recess", rect(depth * 0.9, width * 0.9, 0.01), 0.025, 0.01),
        )
        kit.add(
            GRILLE,
            cylinder(0.3 * min(width, height), 0.012, 28)
            .turned("y", 90)
            .at(depth / 2, -0.1 * width, height * 0.55),
        )
        kit.add(
            CHROME,
            *(
                cylinder(0.02, 0.03, 14)
                .turned("y", 90)
                .at(depth / 2 + 0.01, width * y, height * 0.18)
                for y in (-0.3, 0.0, 0.3)
            ),
        )
        return
    if style == "jukebox":
        width, height, depth = (
            kit.uniform("width", 0.6, 0.9),
            kit.uniform("height", 1.2, 1.6),
            kit.uniform("depth", 0.4, 0.6),
        )
        t = np.linspace(0, np.pi, 17)
        shape = [
            (width / 2, 0.06),
            *[(width / 2 * np.cos(a), height - width / 2 + width / 2 * np.sin(a)) for a in t],
            (-width / 2, 0.06),
        ]
        kit.add(body, solids.prism(shape, depth, 0.02).turned("z", 90))
        kit.add(
            BLACK,
            hollows.slab(kit, "foot_recess", rect(depth * 0.9, width * 0.94, 0.01), 0.07, 0.02),
        )
        inner = [(0.8 * a, 0.1 + (b - 0.1) * 0.92) for a, b in shape]
        kit.add(
            pick(kit.rng, (paint(kit.rng), CHROME)),
            solids.prism(inner, 0.04).turned("z", 90).at(x=depth / 2),
        )
        kit.add(
            GRILLE,
            box(0.02, width * 0.6, height * 0.35).at(depth / 2 + 0.015, 0, height * 0.28),
            box(0.02, width * 0.6, height * 0.16).at(depth / 2 + 0.015, 0, height * 0.66),
        )
        return
    width, height, depth = (
        kit.uniform("width", 0.4, 0.7),
        kit.uniform("height", 0.38, 0.8),
        kit.uniform("depth", 0.2, 0.34),
    )
    _cabinet(kit, body, depth, width, height)
    kit.add(GRILLE, box(0.02, width * 0.92, height * 0.7, 0.004).at(depth / 2, 0, height * 0.38))
    kit.add(CHROME, box(0.015, width * 0.92, height * 0.14).at(depth / 2, 0, height * 0.86))
    kit.add(
        BLACK,
        *(
            cylinder(0.014, 0.02, 12)
            .turned("y", 90)
            .at(depth / 2 + 0.012, width * y, height * 0.86)
            for y in np.linspace(-0.36, 0.36, 7)
        ),
    )
    kit.add(
        BLACK,
        tube(
            solids.smooth_path(
                [
                    (0, -0.12, height),
                    (0, -0.1, height + 0.04),
                    (0, 0.1, height + 0.04),
                    (0, 0.12, height),
                ],
                4,
            ),
            0.012,
        ),
    )
    if kit.chance("head", 0.4):
        kit.add(body, box(depth * 0.9, width * 0.95, 0.22, 0.01).at(0, 0, height + 0.15))
        kit.add(CHROME, box(0.015, width * 0.85, 0.08).at(depth * 0.45, 0, height + 0.12))


def _panel(kit: Kit) -> None:
    """Electrostatic panels, line arrays, ceiling speakers: thin or curved."""
    body, cone = _materials(kit)
    style = kit.choose("style", "electrostatic", "array", "ceiling", "spiral")
    if style == "electrostatic":
        width, height = kit.uniform("width", 0.25, 0.7), kit.uniform("height", 1.0, 1.8)
        bend, t = kit.uniform("bend", 0.0, 0.12), np.linspace(-1, 1, 13)
        rows = [np.stack([-bend * t**2, t * width / 2, 0 * t + z], axis=1) for z in (0.0, 0.5, 1.0)]
        base = kit.uniform("base", 0.1, 0.4)
        kit.add(
            GRILLE,
            solids.sheet(np.array([r * [1, 1, height - base] + [0, 0, base] for r in rows]), 0.03),
        )
        kit.both(body, box(0.05, 0.03, height - base).at(-bend, width / 2, (height + base) / 2))
        flat = solids.rounded(0.36, width, 0.01, 1)
        kit.add(body, hollows.body(kit, [(flat, 0.0), (flat, base)], 0.05).at(-0.06))
        return
    if style == "array":
        count, width, height, depth = (
            kit.choose("boxes", 3, 5, 8),
            kit.uniform("width", 0.5, 0.8),
            0.2,
            0.35,
        )
        fan = kit.uniform("fan", 0, 5)
        share = kit.hide("base_recess", *hollows.RANGE)
        kit.add(BLACK, solids.tray(rect(0.5, width, 0.01), 0.08, 0.03, share * 0.08))
        x, z, tip = 0.0, 0.1, 0.0
        for _ in range(count):
            kit.add(
                BLACK if cone is BLACK else body,
                box(depth, width, height - 0.01, 0.006)
                .at(0, 0, height / 2)
                .turned("y", -tip)
                .at(x, 0, z),
            )
            kit.add(
                GRILLE,
                box(0.01, width * 0.9, height * 0.8)
                .at(depth / 2, 0, height / 2)
                .turned("y", -tip)
                .at(x, 0, z),
            )
            x, z = x - height * np.sin(np.radians(tip)), z + height * np.cos(np.radians(tip))
            tip += fan
        kit.both(CHROME, box(0.06, 0.012, 0.12).at(-0.1, width / 2, 0.12))
        return
    if style == "ceiling":
        r, deep = kit.uniform("radius", 0.12, 0.25), kit.uniform("deep", 0.06, 0.2)
        kit.add(
            WHITE,
            hollows.turned(
                kit,
                [(r, 0), (r, 0.012), (r * 0.85, 0.02), (r * 0.8, deep), (r * 0.4, deep * 1.1)],
                36,
                0.01,
            ),
        )
        kit.add(
            BLACK,
            cylinder(r * 0.4, 0.06, 24).at(z=deep * 1.1),
            box(0.06, 0.1, 0.04).at(0, r * 0.8, deep * 0.6),
        )
        return
    # A spiral body.
    a = np.linspace(0.6, 3.2 * np.pi, 44)
    spiral = 0.05 + 0.035 * a
    path = np.stack([0 * a, spiral * np.cos(a), spiral * np.sin(a)], axis=1)
    size = np.linspace(0.4, 1.6, 44) * kit.uniform("thick", 0.08, 0.14)
    low = float((path[:, 2] - size).min())
    kit.add(
        body,
        solids.sweep(solids.superellipse(1.6, 1.6, 2.0, 16), path, (1, 0, 0), size).at(
            0, 0, -low + 0.03
        ),
    )
    kit.add(BLACK, hollows.slab(kit, "foot_recess", rect(0.36, 0.4, 0.05), 0.06))
    for material, part in driver(cone, 0.09):
        kit.add(material, part.at(0.14, 0, -low + 0.03))


KINDS: dict[str, Callable[[Kit], None]] = {
    "tower": _tower,
    "bookshelf": _bookshelf,
    "on_stand": _on_stand,
    "subwoofer": _subwoofer,
    "bar": _bar,
    "stage": _stage,
    "wedge": _wedge,
    "horn": _horn,
    "round": _round,
    "set": _set,
    "radio": _radio,
    "panel": _panel,
}

_WEIGHTS = {"tower": 2, "bookshelf": 2}

CASES = ("tower", "bookshelf", "on_stand", "stage")
"""The subtypes that can have an open back."""


def speaker(kit: Kit) -> None:
    """Twelve subtypes, see `KINDS`. Hidden: the depth of the recess in the underside."""
    kit.build_subtype(KINDS, _WEIGHTS)


def open_speaker(kit: Kit) -> None:
    """A speaker with a recessed back panel: `CASES` of `KINDS`. Hidden: the depth of the recess."""
    kit.visible["open_back"] = True
    kit.build_subtype({name: KINDS[name] for name in CASES})

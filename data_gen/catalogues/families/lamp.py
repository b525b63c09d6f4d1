"""Lamps: table lamps, floor lamps, hanging lamps, street lamps."""

from collections.abc import Callable

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families import hollows, legs
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    DARK_GLASS,
    GOLD,
    LIGHT,
    WHITE,
    Kit,
    around,
    fabric,
    lacquer,
    metal,
    paint,
    pick,
    wood,
)
from data_gen.catalogues.solids import Solid, ball, box, cylinder, lathe, rod, tube
from data_gen.mesh import Material

SHADES = ("cone", "drum", "bell", "dome", "empire", "square", "pleated", "hexagon")


def _materials(kit: Kit) -> tuple[Material, Material]:
    """Materials of the body and of the shade."""
    body = pick(kit.rng, (metal, metal, wood, lacquer, paint))(kit.rng)
    if kit.rng.random() < 0.4:
        return body, Material((0.93, 0.89, 0.78), name="shade")
    return body, pick(kit.rng, (fabric, lacquer))(kit.rng)


def _shade(kit: Kit, radius: float, tall: float, *styles: str) -> Solid:
    """A shade from z = 0 down to -tall, closed at the top and open at the bottom."""
    style = kit.choose("shade", *(styles or SHADES))
    top, t = kit.uniform("shade_top", 0.3, 0.6), np.linspace(0, 1, 8)
    if style == "drum":
        share = np.full(8, 1.0) - 0.08 * (1 - t)
    elif style == "bell":
        share = top + (1 - top) * t**2
    elif style == "dome":
        share = np.sqrt(np.maximum(1 - (1 - t) ** 2, 0.02))
    elif style == "empire":
        share = top + (1 - top) * (0.7 * t + 0.3 * t**4)
    else:
        share = top + (1 - top) * t
    sides = {"square": 4, "hexagon": 6}.get(style, 32)
    angle = np.arange(sides) / sides * 2 * np.pi + np.pi / sides
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    if style == "pleated":
        ring = ring * (1 + 0.04 * (-1) ** np.arange(sides))[:, None]
    wall = min(0.01, 0.1 * radius)
    outer = [(ring * radius * float(s), -tall * float(a)) for s, a in zip(share, t, strict=True)]
    inner = [
        (ring * max(radius * float(s) - wall, 0.002), -tall * float(a) - (wall if k == 0 else 0))
        for k, (s, a) in enumerate(zip(share, t, strict=True))
    ]
    return solids.stack([*outer, *inner[::-1]])


def _bulb(kit: Kit, radius: float, tall: float) -> Solid:
    """Adds a bulb of hidden size and height in a shade that is closed at the top."""
    size = kit.hide("bulb_radius", 0.05, 0.26) * radius
    drop = kit.hide("bulb_drop", 0.3, 0.6) * tall
    return ball(2 * size, 2 * size, min(2.4 * size, 0.5 * tall), 14).at(z=-drop)


def _foot(kit: Kit, material: Material, radius: float, *styles: str) -> float:
    """Adds a foot with a recess in its underside; returns the height of its upper end."""
    style = kit.choose("foot", *(styles or ("disc", "bell", "square", "dome", "steps")))
    if style == "square":
        flat = solids.rounded(1.7 * radius, 1.7 * radius, 0.1 * radius)
        levels = [(flat, 0.0), (flat, 0.02), (flat * 0.9, 0.03)]
        kit.add(material, hollows.body(kit, levels, 0.018, "foot_recess"))
        return 0.028
    profile = {
        "disc": [(1, 0), (1, 0.018), (0.95, 0.024), (0.12, 0.03)],
        "bell": [(1, 0), (1, 0.015), (0.6, 0.04), (0.25, 0.09), (0.12, 0.14)],
        "dome": [(1, 0), (0.97, 0.03), (0.8, 0.06), (0.5, 0.08), (0.12, 0.09)],
        "steps": [
            (1, 0),
            (1, 0.03),
            (0.75, 0.03),
            (0.75, 0.055),
            (0.45, 0.055),
            (0.45, 0.08),
            (0.15, 0.085),
        ],
    }[style]
    points = [(r * radius, z) for r, z in profile]
    kit.add(material, hollows.turned(kit, points, 30, 0.012, "foot_recess"))
    return profile[-1][1] - 0.004


def _table(kit: Kit) -> None:
    """A table lamp: a vase, a ball, a column or a figure below a shade."""
    body, shade = _materials(kit)
    radius, tall = kit.uniform("shade_radius", 0.11, 0.26), kit.uniform("shade_height", 0.12, 0.34)
    stem = kit.uniform("stem", 0.15, 0.45)
    shape = kit.choose(
        "body", "vase", "ball", "column", "gourd", "cube", "balls", "cone", "turned", "twist"
    )
    wide = kit.uniform("body_width", 0.6, 1.3)
    low = _foot(kit, body, kit.uniform("foot_radius", 0.06, 0.11) * max(wide, 0.8))
    profiles = {
        "vase": [(0.04, 0), (0.05, 0.05), (0.09, 0.4), (0.1, 0.62), (0.05, 0.9), (0.02, 1)],
        "gourd": [
            (0.06, 0),
            (0.1, 0.15),
            (0.09, 0.33),
            (0.04, 0.55),
            (0.06, 0.72),
            (0.05, 0.86),
            (0.015, 1),
        ],
        "column": [(0.03, 0), (0.022, 0.1), (0.02, 0.9), (0.03, 0.94), (0.015, 1)],
        "cone": [(0.1, 0), (0.07, 0.4), (0.03, 0.9), (0.012, 1)],
        "turned": [
            (0.05, 0),
            (0.06, 0.06),
            (0.02, 0.14),
            (0.06, 0.3),
            (0.07, 0.4),
            (0.025, 0.6),
            (0.05, 0.66),
            (0.025, 0.72),
            (0.035, 0.9),
            (0.012, 1),
        ],
    }
    if shape in profiles:
        points = [(r * wide, low + h * stem) for r, h in profiles[shape]]
        kit.add(body, lathe(solids.smooth_profile(points, 4), 28))
    elif shape == "ball":
        r = min(stem * 0.4, 0.12 * wide)
        kit.add(
            body,
            ball(2 * r, 2 * r, 2 * r, 22).at(z=low + r),
            cylinder(0.014, stem, 12).at(z=low + stem / 2),
        )
    elif shape == "balls":
        count = kit.choose("balls", 2, 3, 4)
        r = stem / count / 2
        for k in range(count):
            s = 2 * r * (1.15 - 0.12 * k)
            kit.add(body, ball(s, s, 2.05 * r, 18).at(z=low + r * (2 * k + 1)))
    elif shape == "cube":
        side = min(0.11 * wide, stem)
        kit.add(
            body,
            box(side, side, stem * 0.85, 0.01).at(z=low + stem * 0.425),
            cylinder(0.012, stem, 12).at(z=low + stem / 2),
        )
    else:
        for phase in (0, np.pi):
            t = np.linspace(0, 1, 30)
            path = np.stack(
                [
                    0.03 * wide * np.cos(9 * t + phase),
                    0.03 * wide * np.sin(9 * t + phase),
                    low + t * stem,
                ],
                axis=1,
            )
            kit.add(body, tube(path, 0.018, 8))
    kit.add(metal(kit.rng), cylinder(0.008, tall * 0.9, 10).at(z=low + stem + tall * 0.45))
    kit.add(shade, _shade(kit, radius, tall).at(z=low + stem + tall))
    kit.add(LIGHT, _bulb(kit, radius, tall).at(z=low + stem + tall))


def _floor(kit: Kit) -> None:
    body, shade = _materials(kit)
    high = kit.uniform("height", 1.2, 1.9)
    radius, tall = kit.uniform("shade_radius", 0.14, 0.32), kit.uniform("shade_height", 0.16, 0.4)
    low = _foot(kit, body, kit.uniform("foot_radius", 0.12, 0.2))
    r = kit.uniform("stem", 0.01, 0.035)
    if kit.chance("turned_stem", 0.3):
        points = [
            (a * 2.4 * r, low + b * (high - 0.06 - low)) for a, b in pick(kit.rng, legs.TURNED)
        ]
        kit.add(body, lathe(solids.smooth_profile(points, 3), 16))
    else:
        kit.add(body, cylinder(r, high - low, 14).at(z=(high - 0.02 + low) / 2))
    kit.add(shade, _shade(kit, radius, tall).at(z=high))
    kit.add(LIGHT, _bulb(kit, radius, tall).at(z=high))
    if kit.chance("tray", 0.25):
        kit.add(body, cylinder(0.2, 0.02, 28).at(z=high * 0.4))
    if kit.chance("reading_arm", 0.25):
        kit.add(
            body,
            tube(
                solids.smooth_path(
                    [(0, 0, high * 0.55), (0.12, 0, high * 0.66), (0.26, 0, high * 0.62)], 4
                ),
                0.008,
            ),
        )
        kit.add(
            shade,
            lathe([(0.02, 0), (0.06, -0.1), (0.05, -0.1), (0.015, -0.01)], 20).at(
                0.26, 0, high * 0.63
            ),
        )


def _torchiere(kit: Kit) -> None:
    """A floor lamp with a bowl that opens upward."""
    body, shade = _materials(kit)
    high = kit.uniform("height", 1.5, 1.95)
    low = _foot(kit, body, kit.uniform("foot_radius", 0.1, 0.18))
    stems = kit.choose("stems", 1, 1, 3)
    for angle in around(stems):
        off = 0.03 if stems > 1 else 0.0
        kit.add(
            body, cylinder(0.017, high - low, 10).at(off, 0, (high + low) / 2).turned("z", angle)
        )
    r, deep = kit.uniform("bowl", 0.15, 0.28), kit.uniform("bowl_depth", 0.06, 0.24)
    power = kit.uniform("bowl_shape", 0.4, 1.6)
    t = np.linspace(0, 1, 9)
    outer = [(max(r * float(a) ** power, 0.015), high + deep * float(a)) for a in t]
    inner = [(max(s - 0.008, 0.006), z + (0.01 if k == 0 else 0)) for k, (s, z) in enumerate(outer)]
    kit.add(shade, lathe([*outer, *inner[::-1]], 32))
    kit.add(LIGHT, ball(0.06, 0.06, 0.07, 12).at(z=high + min(0.05, deep * 0.4)))
    if kit.chance("side_light", 0.35):
        path = solids.smooth_path(
            [(0, 0, high * 0.62), (0.12, 0, high * 0.74), (0.26, 0, high * 0.72)], 5
        )
        kit.add(body, tube(path, 0.009))
        kit.add(
            shade,
            lathe([(0.02, 0), (0.07, -0.1), (0.06, -0.1), (0.015, -0.01)], 20)
            .turned("y", -25)
            .at(0.26, 0, high * 0.73),
        )


def _tripod(kit: Kit) -> None:
    body, shade = _materials(kit)
    small = kit.chance("for_table", 0.35)
    high = kit.uniform("table_height", 0.4, 0.65) if small else kit.uniform("height", 1.25, 1.75)
    scale = high / 1.5
    radius, tall = (
        scale * kit.uniform("shade_radius", 0.18, 0.36),
        scale * kit.uniform("shade_height", 0.2, 0.4),
    )
    hub, spread = high - tall - 0.08 * scale, scale * kit.uniform("spread", 0.22, 0.5)
    count, bend = kit.choose("legs", 3, 3, 4), kit.uniform("bend", -0.12, 0.12) * scale
    for angle in around(count, kit.uniform("turn", 0, 120)):
        path = solids.smooth_path(
            [(spread, 0, 0), (spread * 0.5 + bend, 0, hub / 2), (0.02, 0, hub)], 4
        )
        kit.add(
            body,
            tube(path, np.linspace(0.013, 0.02, 9) * (0.5 + 0.5 * scale), 10).turned("z", angle),
        )
    kit.add(
        metal(kit.rng),
        cylinder(0.035, 0.08, 16, 0.01).at(z=hub),
        cylinder(0.012, high - hub - 0.02, 10).at(z=(high + hub) / 2 - 0.01),
    )
    if kit.chance("spot", 0.25):
        kit.add(
            BLACK, cylinder(radius * 0.7, tall, 28, 0.01).turned("y", 75).at(0, 0, high - tall / 2)
        )
        kit.add(
            LIGHT,
            cylinder(radius * 0.62, 0.02, 28)
            .turned("y", 75)
            .at(tall * 0.5, 0, high - tall / 2 - tall * 0.13),
        )
    else:
        kit.add(shade, _shade(kit, radius, tall).at(z=high))
    kit.add(LIGHT, _bulb(kit, radius * 0.7, tall).at(z=high))


def _desk(kit: Kit) -> None:
    """A desk lamp: jointed arms, a goose neck, or a banker's lamp."""
    body, shade = _materials(kit)
    style = kit.choose("arm", "jointed", "jointed", "goose", "banker", "rigid")
    low = _foot(kit, body, kit.uniform("foot_radius", 0.07, 0.13))
    if style == "banker":
        high, long = kit.uniform("height", 0.28, 0.42), kit.uniform("bar", 0.2, 0.34)
        kit.add(GOLD, cylinder(0.014, high - low, 14).at(z=(high + low) / 2))
        t = np.linspace(0, np.pi, 13)
        arc = [(0.075 * np.cos(a), 0.08 * np.sin(a)) for a in t]
        inner = [(0.068 * np.cos(a), 0.073 * np.sin(a)) for a in t[::-1]]
        kit.add(
            shade,
            solids.prism([*arc, *inner], long)
            .turned("y", kit.uniform("tip", -10, 10))
            .at(0.03, 0, high),
        )
        kit.add(LIGHT, cylinder(0.02, long * 0.7, 12).turned("x", 90).at(0.03, 0, high + 0.035))
        return
    if style == "goose":
        high, reach = kit.uniform("height", 0.3, 0.5), kit.uniform("reach", 0.12, 0.35)
        back = kit.uniform("back", -0.1, 0.05)
        path = solids.smooth_path(
            [
                (0, 0, low),
                (back, 0, high * 0.55),
                (back + 0.04, 0, high * 0.9),
                (reach * 0.6, 0, high),
                (reach, 0, high * 0.84),
            ],
            6,
        )
        kit.add(body, tube(path, 0.01))
        head, tip = path[-1], kit.uniform("tip", -40, 0)
    else:
        a, b = kit.uniform("lower_arm", 0.22, 0.45), kit.uniform("upper_arm", 0.2, 0.45)
        lean, reach_ = (
            np.radians(kit.uniform("lean", -10, 40)),
            np.radians(kit.uniform("reach", -5, 60)),
        )
        if style == "rigid":
            lean, reach_ = 0.0, 0.0
        elbow = np.array([-a * np.sin(lean), 0, low + a * np.cos(lean)])
        head = elbow + np.array([b * np.cos(reach_), 0, b * np.sin(reach_)])
        pairs = (0.0,) if style == "rigid" else (-0.014, 0.014)
        for side in pairs:
            off = np.array([0, side, 0])
            kit.add(
                body,
                rod((0, side, low - 0.01), elbow + off, 0.007),
                rod(elbow + off, head + off, 0.007),
            )
        kit.add(
            body,
            cylinder(0.02, 0.05, 12).turned("x", 90).at(*elbow),
            ball(0.05, 0.05, 0.05, 12).at(*head),
        )
        tip = kit.uniform("tip", -30, 5)
    if style == "rigid" and kit.chance("bar_light", 0.6):
        kit.add(shade, box(0.34, 0.05, 0.025, 0.008).at(head[0] - 0.12, 0, head[2]))
        kit.add(LIGHT, box(0.3, 0.04, 0.006).at(head[0] - 0.12, 0, head[2] - 0.014))
        return
    radius, tall = kit.uniform("shade_radius", 0.05, 0.12), kit.uniform("shade_height", 0.08, 0.18)
    part = _shade(kit, radius, tall, "cone", "dome", "bell", "drum").turned("y", tip)
    kit.add(shade, part.at(head[0], 0, head[2] + 0.01))
    kit.add(LIGHT, _bulb(kit, radius, tall).turned("y", tip).at(head[0], 0, head[2] + 0.01))


def _arc(kit: Kit) -> None:
    """An arc lamp with one or several arcs."""
    body, shade = _materials(kit)
    high, reach = kit.uniform("height", 1.4, 2.1), kit.uniform("reach", 0.6, 1.5)
    base = kit.uniform("base", 0.14, 0.25)
    block = pick(kit.rng, (BLACK, WHITE, body))
    if kit.chance("cube_base", 0.4):
        flat = solids.rounded(1.6 * base, 1.6 * base, 0.01, 1)
        kit.add(block, hollows.body(kit, [(flat, 0.0), (flat, 0.14)], 0.08, "foot_recess"))
    else:
        kit.add(
            block,
            hollows.turned(
                kit, [(base, 0), (base, 0.05), (base * 0.9, 0.06)], 32, 0.03, "foot_recess"
            ),
        )
    bows = kit.choose("bows", 1, 1, 3, 5)
    radius, tall = kit.uniform("shade_radius", 0.13, 0.26), kit.uniform("shade_height", 0.12, 0.28)
    if bows > 1:
        radius, tall = radius * 0.55, tall * 0.6
    lamp = _shade(kit, radius, tall, "dome", "drum", "cone", "bell")
    bulb = _bulb(kit, radius, tall)
    for k in range(bows):
        turn = (k - (bows - 1) / 2) * (40 if bows == 3 else 30)
        h, far = high * (1 - 0.1 * abs(k - (bows - 1) / 2)), reach * (1 - 0.12 * (k % 2))
        path = solids.smooth_path(
            [
                (0, 0, 0.05),
                (-0.08, 0, h * 0.5),
                (far * 0.2, 0, h * 0.93),
                (far * 0.65, 0, h),
                (far, 0, h * 0.84),
            ],
            6,
        )
        kit.add(body, tube(path, 0.013).turned("z", turn))
        kit.add(shade, lamp.at(far, 0, h * 0.85).turned("z", turn))
        kit.add(LIGHT, bulb.at(far, 0, h * 0.85).turned("z", turn))


def _pendant(kit: Kit) -> None:
    """Hanging lamps on cords; z = 0 is at the lower edge of the lowest shade."""
    body, shade = _materials(kit)
    cord, lights = kit.uniform("cord", 0.25, 1.3), kit.choose("lights", 1, 1, 1, 2, 3, 5)
    radius, tall = kit.uniform("shade_radius", 0.12, 0.36), kit.uniform("shade_height", 0.1, 0.4)
    if lights > 1:
        radius, tall = radius * 0.6, tall * 0.7
    lamp, bulb = _shade(kit, radius, tall), _bulb(kit, radius, tall)
    top = tall + cord
    steps = kit.uniform("steps", 0.0, 0.4) if lights > 1 else 0.0
    for k in range(lights):
        y, lift = (k - (lights - 1) / 2) * radius * 2.2, steps * cord * k / max(lights - 1, 1)
        kit.add(shade, lamp.at(0, y, tall + lift))
        kit.add(LIGHT, bulb.at(0, y, tall + lift))
        kit.add(body, rod((0, y, tall + lift - 0.01), (0, y, top), 0.008, 6))
    if lights == 1:
        kit.add(body, lathe([(0.07, 0), (0.06, 0.03), (0.01, 0.04)], 20).at(z=top))
    else:
        kit.add(body, box(0.06, radius * 2.2 * (lights - 1) + 0.2, 0.035, 0.01).at(0, 0, top))


def _globe(kit: Kit) -> None:
    """A luminous body: a ball, a paper lantern, a drop, a stack of rings."""
    body, shade = _materials(kit)
    size = kit.uniform("size", 0.18, 0.5)
    profile = {
        "ball": [(0.1, 0), (0.35, 0.06), (0.5, 0.3), (0.5, 0.6), (0.35, 0.88), (0.1, 0.98)],
        "drop": [(0.15, 0), (0.45, 0.12), (0.5, 0.3), (0.3, 0.6), (0.1, 0.85), (0.03, 1)],
        "lantern": [(0.2, 0), (0.42, 0.1), (0.5, 0.35), (0.5, 0.65), (0.42, 0.9), (0.2, 1)],
        "tube": [(0.28, 0), (0.3, 0.1), (0.3, 1.7), (0.28, 1.8)],
    }[kit.choose("form", "ball", "drop", "lantern", "tube")]
    where = kit.choose("where", "hanging", "foot", "ground", "column")
    low = {"hanging": 0.0, "foot": 0.06, "ground": 0.0, "column": kit.uniform("column", 0.3, 1.4)}[
        where
    ]
    points = [(r * size, low + z * size) for r, z in solids.smooth_profile(profile, 4)]
    top = points[-1][1]
    if where == "ground" or where == "hanging":
        kit.add(LIGHT if shade.opacity < 1 else shade, hollows.turned(kit, points, 32, 0.08 * size))
        kit.add(body, cylinder(0.05 * size + 0.01, 0.05 * size, 16).at(z=top))
    else:
        kit.add(shade, lathe(points, 32))
        wide = 0.3 * size if where == "foot" else max(0.09, 0.35 * size)
        kit.add(
            body,
            hollows.turned(
                kit,
                [
                    (wide, 0),
                    (wide, 0.02),
                    (wide * 0.3, 0.05),
                    (wide * 0.3 if where == "foot" else 0.02, low + 0.02),
                ],
                28,
            ),
        )
    for k in range(1, kit.choose("rings", 1, 5, 9)):
        z = low + (top - low) * k / 9
        r = float(np.interp(z, [p[1] for p in points], [p[0] for p in points]))
        kit.add(body, lathe([(r, 0), (r + 0.004, 0.003), (r, 0.006)], 32).at(z=z - 0.003))
    if where == "hanging":
        cord = kit.uniform("cord", 0.2, 1.2) * (top + 0.1)
        kit.add(
            body,
            rod((0, 0, top), (0, 0, top + cord), 0.006, 6),
            lathe([(0.06, 0), (0.05, 0.03), (0.01, 0.04)], 20).at(z=top + cord),
        )


def _chandelier(kit: Kit) -> None:
    """Arms around a column, in one or two rings, with candles or shades."""
    body = pick(kit.rng, (GOLD, BLACK, CHROME, metal(kit.rng)))
    arms, reach = kit.choose("arms", 4, 5, 6, 8, 10), kit.uniform("reach", 0.28, 0.55)
    drop, tall = kit.uniform("drop", 0.3, 0.6), kit.uniform("chain", 0.25, 0.9)
    profile = [
        (0.02, 0),
        (0.07, 0.05),
        (0.03, 0.14),
        (0.06, 0.3),
        (0.09, 0.42),
        (0.03, 0.6),
        (0.05, 0.75),
        (0.02, 1),
    ]
    points = [(r, z * drop) for r, z in profile]
    kit.add(body, hollows.turned(kit, solids.smooth_profile(points, 3), 18, 0.02))
    kit.add(
        body,
        rod((0, 0, drop), (0, 0, drop + tall), 0.008, 6),
        lathe([(0.07, 0), (0.05, 0.04), (0.01, 0.05)], 20).at(z=drop + tall),
    )
    kind = kit.choose("lights", "candles", "shades", "globes", "bowls")
    up = kind in ("candles", "globes", "bowls")
    for ring in range(kit.choose("tiers", 1, 1, 2)):
        r, z = reach * (1 - 0.4 * ring), drop * (0.3 + 0.35 * ring)
        sag = kit.visible.setdefault("sag", float(kit.rng.uniform(-0.1, 0.15)))
        tip = (r, 0, z + (0.06 if up else 0.0))
        path = solids.smooth_path(
            [(0.03, 0, z + 0.04), (r * 0.4, 0, z - sag), (r * 0.85, 0, z - sag * 0.6), tip], 4
        )
        for angle in around(arms, ring * 180 / arms):
            parts = [
                (body, tube(path, 0.009, 6)),
                (body, lathe([(0.012, 0), (0.04, 0.015), (0.012, 0.02)], 12).at(*tip)),
            ]
            if kind == "candles":
                parts += [
                    (WHITE, cylinder(0.014, 0.1, 10).at(r, 0, tip[2] + 0.06)),
                    (LIGHT, ball(0.025, 0.025, 0.06, 8).at(r, 0, tip[2] + 0.14)),
                ]
            elif kind == "globes":
                parts.append((LIGHT, ball(0.13, 0.13, 0.13, 12).at(r, 0, tip[2] + 0.07)))
            elif kind == "bowls":
                parts.append(
                    (
                        LIGHT,
                        lathe(
                            [
                                (0.02, 0),
                                (0.07, 0.03),
                                (0.1, 0.08),
                                (0.09, 0.08),
                                (0.06, 0.036),
                                (0.01, 0.01),
                            ],
                            16,
                        ).at(r, 0, tip[2] + 0.01),
                    )
                )
            else:
                parts.append(
                    (
                        LIGHT,
                        lathe([(0.03, 0), (0.09, -0.1), (0.08, -0.1), (0.02, -0.008)], 14).at(*tip),
                    )
                )
            for material, part in parts:
                kit.add(material, part.turned("z", angle))


def _lantern(kit: Kit) -> None:
    """A lantern, standing, hanging or on a wall bracket."""
    body = pick(kit.rng, (BLACK, metal(kit.rng), GOLD))
    sides = kit.choose("sides", 4, 4, 6, 8)
    wide, tall = kit.uniform("width", 0.09, 0.18), kit.uniform("height", 0.2, 0.45)
    flare = kit.uniform("flare", 0.75, 1.3)
    a = np.arange(sides) / sides * 2 * np.pi + np.pi / sides
    ring = np.stack([np.cos(a), np.sin(a)], axis=1)
    base = [(ring * wide * 1.1, 0.0), (ring * wide * 1.1, 0.02), (ring * wide, 0.03)]
    kit.add(body, hollows.body(kit, base, 0.015, "foot_recess"))
    for x, y in ring:
        kit.add(
            body,
            rod((x * wide, y * wide, 0.02), (x * wide * flare, y * wide * flare, tall), 0.007, 6),
        )
    roof = kit.uniform("roof", 0.05, 0.16)
    kit.add(
        body,
        solids.stack(
            [
                (ring * wide * flare * 1.25, tall),
                (ring * wide * flare * 1.25, tall + 0.01),
                (ring * wide * flare * 0.5, tall + roof * 0.7),
                (ring * 0.02, tall + roof),
            ]
        ),
    )
    if kit.chance("panes", 0.5):
        kit.add(
            LIGHT, solids.stack([(ring * wide * 0.93, 0.02), (ring * wide * 0.93 * flare, tall)])
        )
    else:
        kit.add(WHITE, cylinder(wide * 0.35, tall * 0.5, 16).at(z=tall * 0.25 + 0.02))
        kit.add(LIGHT, ball(0.03, 0.03, 0.07, 8).at(z=tall * 0.5 + 0.05))
    top = tall + roof
    t = np.linspace(0, np.pi, 13)
    way = kit.choose("carried", "ring", "handle", "chain", "bracket")
    if way == "ring":
        loop = np.array(
            [(0, 0.04 * np.cos(b), 0.04 * np.sin(b)) for b in np.linspace(0, 2 * np.pi, 19)]
        )
        kit.add(body, tube(loop, 0.006, 6).at(z=top + 0.035))
    elif way == "handle":
        r = wide * flare * 1.1
        kit.add(
            body,
            tube(
                np.stack([0 * t, r * np.cos(t), tall + (roof + 0.12) * np.sin(t)], axis=1), 0.006, 6
            ),
        )
    elif way == "chain":
        long = kit.uniform("chain", 0.15, 0.6)
        kit.add(
            body,
            rod((0, 0, top - 0.01), (0, 0, top + long), 0.007, 6),
            cylinder(0.06, 0.03, 20).at(z=top + long),
        )
    else:
        reach = wide * flare + 0.08
        path = solids.smooth_path(
            [
                (0, 0, top - 0.01),
                (-0.02, 0, top + 0.1),
                (-reach * 0.6, 0, top + 0.1),
                (-reach, 0, top * 0.6),
            ],
            5,
        )
        kit.add(body, tube(path, 0.009), box(0.02, 0.1, 0.3, 0.006).at(-reach, 0, top * 0.6))


def _street(kit: Kit) -> None:
    """A street lamp with one or more heads."""
    body = pick(kit.rng, (BLACK, metal(kit.rng), lacquer(kit.rng)))
    high = kit.uniform("height", 2.2, 5.0)
    r = high * kit.uniform("post", 0.012, 0.024)
    base = [
        (3.2 * r, 0),
        (3.2 * r, 0.02 * high),
        (2.2 * r, 0.04 * high),
        (1.6 * r, 0.1 * high),
        (r, 0.13 * high),
        (0.8 * r, high),
    ]
    kit.add(body, hollows.turned(kit, base, 18, 0.015 * high, "foot_recess"))
    style = kit.choose(
        "head", "gooseneck", "double", "globe", "globes", "lantern", "lantern_arm", "flat"
    )
    s = high * kit.uniform("head_size", 0.05, 0.1)
    if style in ("gooseneck", "double", "flat"):
        reach = high * kit.uniform("reach", 0.15, 0.4)
        for sign in (1, -1) if style == "double" else (1,):
            path = solids.smooth_path(
                [
                    (0, 0, high * 0.96),
                    (sign * reach * 0.25, 0, high * 1.06),
                    (sign * reach, 0, high * 1.08),
                ],
                5,
            )
            if style == "flat":
                path = np.array([(0, 0, high * 0.98), (reach, 0, high)])
            kit.add(body, tube(path, 0.6 * r))
            head = solids.cushion(3.4 * s, 1.3 * s, 0.7 * s, 3.0, 2.5)
            z = path[-1][2]
            kit.add(body, head.at(sign * (reach + s), 0, z))
            kit.add(
                LIGHT,
                solids.cushion(2.6 * s, s, 0.5 * s, 3.0, 2.5).at(
                    sign * (reach + s), 0, z - 0.18 * s
                ),
            )
        return
    heads = [(0.0, 0.0, high)]
    if style in ("globes", "lantern_arm"):
        count, reach = kit.choose("heads", 2, 3, 4), 2.6 * s
        heads = [
            (reach * np.cos(a), reach * np.sin(a), high) for a in np.radians(around(count, 90))
        ]
        for x, y, z in heads:
            kit.add(
                body,
                tube(
                    solids.smooth_path(
                        [(0, 0, z - 2 * s), (x * 0.6, y * 0.6, z - 1.4 * s), (x, y, z)], 4
                    ),
                    0.5 * r,
                ),
            )
        if kit.chance("middle", 0.5):
            heads.append((0.0, 0.0, high + s))
    for x, y, z in heads:
        if style.startswith("lantern"):
            kit.add(LIGHT, lathe([(0.45 * s, 0), (0.8 * s, 1.6 * s)], 6).at(x, y, z))
            kit.add(
                body,
                lathe(
                    [(0.95 * s, 0), (0.9 * s, 0.15 * s), (0.15 * s, 0.7 * s), (0.05 * s, 1.0 * s)],
                    6,
                ).at(x, y, z + 1.6 * s),
                cylinder(0.5 * s, 0.1 * s, 12).at(x, y, z),
            )
        else:
            kit.add(LIGHT, ball(2 * s, 2 * s, 2 * s, 18).at(x, y, z + 0.9 * s))
            kit.add(body, cylinder(0.5 * s, 0.3 * s, 14).at(x, y, z))


def _spots(kit: Kit) -> None:
    """Spotlights on a bar, a post or a plate; or a stage light in its yoke."""
    body, _ = _materials(kit)
    count = kit.choose("spots", 1, 2, 3, 4)
    r, long = kit.uniform("radius", 0.04, 0.09), kit.uniform("long", 0.1, 0.22)
    stand = kit.choose("stand", "post", "bar", "plate", "yoke")
    flare = kit.uniform("flare", 0.6, 1.4)
    head = [
        (r * flare * 0.6, -long / 2),
        (r * flare * 0.6, -long * 0.2),
        (r, long / 2),
        (r * 0.9, long / 2),
        (r * 0.8, long * 0.42),
    ]
    if stand == "yoke":
        count, r2 = 1, r * 1.5
        kit.add(
            body,
            _wide(
                hollows.turned(
                    kit, [(0.14, 0), (0.14, 0.02), (0.03, 0.04)], 28, 0.015, "foot_recess"
                )
            ),
        )
        high = r2 * 2 + 0.1
        kit.add(
            body,
            tube(
                np.array(
                    [
                        (0, -r2 * 1.4, high),
                        (0, -r2 * 1.4, 0.05),
                        (0, 0, 0.03),
                        (0, r2 * 1.4, 0.05),
                        (0, r2 * 1.4, high),
                    ]
                ),
                0.012,
            ),
        )
        heads = [(0.0, 0.0, high)]
        head = [(a * 1.7, b * 1.7) for a, b in head]
    elif stand == "post":
        high = kit.uniform("height", 0.6, 1.7)
        low = _foot(kit, body, 0.13)
        kit.add(body, cylinder(0.014, high - low, 12).at(z=(high + low) / 2))
        heads = [(r * 1.8, (-1) ** k * 0.03, high - k * (r * 3.0)) for k in range(count)]
        for x, y, z in heads:
            kit.add(body, rod((0, 0, z), (x, y, z), 0.009, 6))
    else:
        wide = 0.26 * count
        levels = [(solids.rounded(0.1, wide, 0.02), 0.0), (solids.rounded(0.1, wide, 0.02), 0.03)]
        kit.add(body, hollows.body(kit, levels, 0.02, "foot_recess"))
        heads = [(0.0, (k - (count - 1) / 2) * 0.26, 0.03 + long * 0.9) for k in range(count)]
        for x, y, z in heads:
            kit.add(body, rod((x, y, 0.02), (x, y, z), 0.01, 8))
    for k, (x, y, z) in enumerate(heads):
        tip, turn = kit.uniform(f"tip_{k}", 60, 120), kit.uniform(f"turn_{k}", -35, 35)
        for material, part in (
            (body, lathe(head, 22)),
            (
                LIGHT,
                cylinder(r * 0.75, 0.01, 18).at(z=long * 0.42 * (1.7 if stand == "yoke" else 1)),
            ),
        ):
            kit.add(material, part.turned("y", tip).turned("z", turn).at(x, y, z))


def _wide(part: Solid) -> Solid:
    return part.scaled(1.0, 1.5, 1.0)


def _tiffany(kit: Kit) -> None:
    """An oil lamp, a mushroom lamp, or a lamp with a coloured dome."""
    body, shade = pick(kit.rng, (GOLD, metal(kit.rng), BLACK)), paint(kit.rng)
    style = kit.choose("style", "mushroom", "oil", "lava", "dome")
    high = kit.uniform("height", 0.3, 0.7)
    if style == "lava":
        profile = [(0.26, 0), (0.2, 0.2), (0.13, 0.3)]
        kit.add(body, hollows.turned(kit, [(r * high, z * high) for r, z in profile], 28, 0.03))
        kit.add(
            shade,
            lathe(
                [(0.13 * high, 0.3 * high), (0.17 * high, 0.42 * high), (0.08 * high, 0.9 * high)],
                28,
            ),
        )
        kit.add(
            body, lathe([(0.085 * high, 0.89 * high), (0.05 * high, high), (0.03 * high, high)], 28)
        )
        return
    if style == "oil":
        profile = [
            (0.2, 0),
            (0.18, 0.03),
            (0.08, 0.1),
            (0.06, 0.2),
            (0.2, 0.32),
            (0.2, 0.4),
            (0.07, 0.48),
        ]
        kit.add(
            body,
            hollows.turned(
                kit,
                solids.smooth_profile([(r * high, z * high) for r, z in profile], 4),
                28,
                0.01 * high,
            ),
        )
        glass = [(0.06, 0.46), (0.12, 0.58), (0.1, 0.7), (0.05, 0.85), (0.05, 1.0)]
        kit.add(
            LIGHT, lathe(solids.smooth_profile([(r * high, z * high) for r, z in glass], 4), 24)
        )
        if kit.chance("globe_shade", 0.5):
            kit.add(shade, ball(0.4 * high, 0.4 * high, 0.3 * high, 20).at(z=0.68 * high))
        return
    wide = high * kit.uniform("wide", 0.3, 0.55)
    foot = [
        (0.5 * wide, 0),
        (0.45 * wide, 0.02),
        (0.14 * wide, 0.12 * high),
        (0.1 * wide, 0.7 * high),
    ]
    if style == "mushroom":
        foot = [
            (0.6 * wide, 0),
            (0.5 * wide, 0.05),
            (0.25 * wide, 0.3 * high),
            (0.2 * wide, 0.7 * high),
        ]
    kit.add(body, hollows.turned(kit, solids.smooth_profile(foot, 4), 28, 0.02))
    t = np.linspace(0, 1, 9)
    power = kit.uniform("dome", 0.3, 0.9)
    outer = [(max(wide * float(a) ** power, 0.005), high - 0.4 * high * float(a)) for a in t]
    inner = [
        (max(r - 0.006, 0.003), z - (0.006 if k == 0 else 0)) for k, (r, z) in enumerate(outer)
    ]
    kit.add(shade, lathe([*outer, *inner[::-1]], 28))
    kit.add(GOLD, ball(0.04 * high, 0.04 * high, 0.07 * high, 10).at(z=high))
    kit.add(
        DARK_GLASS,
        lathe([(wide * 0.99, 0), (wide * 1.01, 0.006), (wide * 0.99, 0.012)], 28).at(z=0.6 * high),
    )


def _sconce(kit: Kit) -> None:
    """A wall lamp with arms, or a ceiling lamp."""
    body, shade = _materials(kit)
    if kit.chance("ceiling", 0.4):
        r, deep = kit.uniform("radius", 0.15, 0.3), kit.uniform("depth", 0.05, 0.16)
        t = np.linspace(0.15, 1, 8)
        bowl = [(r * float(a), deep * (1 - np.sqrt(1 - float(a) ** 2 * 0.98))) for a in t]
        kit.add(shade, hollows.turned(kit, bowl, 32, 0.4 * deep))
        kit.add(
            body,
            lathe(
                [
                    (r * 1.06, deep * 0.85),
                    (r * 1.06, deep * 0.85 + 0.03),
                    (r * 0.9, deep * 0.85 + 0.05),
                ],
                32,
            ),
        )
        return
    tall, arms = kit.uniform("plate", 0.16, 0.4), kit.choose("arms", 1, 1, 2, 3)
    flat = solids.superellipse(
        tall, tall * kit.uniform("ratio", 0.35, 0.8), kit.choose("plate_shape", 2, 3, 12), 28
    )
    kit.add(
        body,
        solids.stack([(flat, 0), (flat, 0.015), (flat * 0.85, 0.03)])
        .turned("y", 90)
        .at(0, 0, tall * 0.7),
    )
    reach, radius, high = (
        kit.uniform("reach", 0.1, 0.25),
        kit.uniform("shade_radius", 0.06, 0.12),
        kit.uniform("shade_height", 0.09, 0.18),
    )
    lamp, bulb = _shade(kit, radius, high), _bulb(kit, radius, high)
    for k in range(arms):
        turn = (k - (arms - 1) / 2) * 70
        path = solids.smooth_path(
            [
                (0, 0, tall * 0.6),
                (reach * 0.5, 0, tall * 0.4),
                (reach, 0, tall * 0.5),
                (reach, 0, tall * 0.5 + 0.05),
            ],
            5,
        )
        kit.add(
            body,
            tube(path, 0.008).turned("z", turn),
            lathe([(0.01, 0), (0.035, 0.012), (0.01, 0.016)], 14)
            .at(reach, 0, tall * 0.5 + 0.05)
            .turned("z", turn),
        )
        kit.add(WHITE, cylinder(0.012, 0.08, 10).at(reach, 0, tall * 0.5 + 0.1).turned("z", turn))
        kit.add(shade, lamp.at(reach, 0, tall * 0.5 + 0.1 + high).turned("z", turn))
        kit.add(LIGHT, bulb.at(reach, 0, tall * 0.5 + 0.1 + high).turned("z", turn))


KINDS: dict[str, Callable[[Kit], None]] = {
    "table": _table, "floor": _floor, "torchiere": _torchiere, "tripod": _tripod, "desk": _desk,
    "arc": _arc, "pendant": _pendant, "globe": _globe, "chandelier": _chandelier,
    "lantern": _lantern, "street": _street, "spots": _spots, "turned": _tiffany, "sconce": _sconce,
}  # fmt: skip

_WEIGHTS = {"table": 2, "desk": 2}


def lamp(kit: Kit) -> None:
    """Fourteen subtypes, see `KINDS`. Hidden: the bulb in a closed shade, or a recess."""
    kit.build_subtype(KINDS, _WEIGHTS)

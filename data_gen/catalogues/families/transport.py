"""Trains and trams; rockets and satellites; bicycles and motorcycles."""

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families import materials, shapes
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    DARK_GLASS,
    LIGHT,
    RED_LIGHT,
    RUBBER,
    Kit,
    around,
    metal,
    paint,
    pick,
    wood,
)
from data_gen.catalogues.families.mapping import Fitted, Wrapped
from data_gen.catalogues.families.materials import Material
from data_gen.catalogues.solids import Solid, ball, box, cylinder, lathe, prism, rod


def _wheels(kit: Kit, places: list[float], radius: float, gauge: float, rim: Material) -> None:
    for x in places:
        kit.both(rim, cylinder(radius, 0.08, 20, 0.02).turned("x", 90).at(x, gauge, radius))
        kit.both(BLACK, cylinder(0.35 * radius, 0.1, 12).turned("x", 90).at(x, gauge, radius))
        kit.add(BLACK, rod((x, -gauge, radius), (x, gauge, radius), 0.05, 8))


def _carriage(
    kit: Kit,
    centre: float,
    long: float,
    skin: Material,
    roof: Material,
    low: float,
    high: float,
    windows: int,
) -> None:
    wide = 1.3
    section = [
        (wide / 2, low),
        (wide / 2, 0.8 * high),
        (0.42 * wide, 0.93 * high),
        (0.2 * wide, high),
        (-0.2 * wide, high),
        (-0.42 * wide, 0.93 * high),
        (-wide / 2, 0.8 * high),
        (-wide / 2, low),
    ]
    kit.add(skin, prism(section[::-1], long).turned("z", 90).at(x=centre))
    kit.add(
        roof,
        prism([(1.02 * y, z + 0.02) for y, z in section[1:7]][::-1], 1.005 * long)
        .turned("z", 90)
        .at(x=centre),
    )
    for k in np.linspace(-0.45, 0.45, windows):
        kit.both(
            DARK_GLASS,
            box(0.65 * long / windows, 0.03, 0.3 * (high - low)).at(
                centre + k * long, wide / 2, low + 0.58 * (high - low)
            ),
        )
    kit.add(BLACK, box(0.96 * long, 0.8, 0.2).at(centre, 0, low - 0.05))


def train(kit: Kit) -> None:
    """Steam, diesel, express, tram, carriage, goods wagon, tank wagon; on rails or not."""
    kind = kit.choose(
        "subtype", "steam", "steam", "diesel", "express", "tram", "wagon", "tank", "carriage"
    )
    rng = kit.rng
    skin, trim, roof = pick(rng, (paint, paint, materials.livery))(rng), paint(rng), metal(rng)
    rim = pick(rng, (metal, paint))(rng)
    length = 4.0
    if kind == "steam":
        r, boiler = kit.uniform("boiler", 0.4, 0.55), kit.uniform("length", 2.0, 2.8)
        z = 0.55 + r
        body = paint(rng)
        kit.add(
            body,
            lathe([(0, 0), (0.9 * r, 0), (r, 0.06), (r, boiler)], 24)
            .turned("y", -90)
            .at(0.5 + boiler / 2, 0, z),
        )
        for k in np.linspace(0.12, 0.9, 5):
            kit.add(
                trim,
                cylinder(1.02 * r, 0.05, 24).turned("y", 90).at(0.5 + boiler * (k - 0.5), 0, z),
            )
        front = 0.5 + boiler / 2
        kit.add(BLACK, cylinder(0.6 * r, 0.05, 20).turned("y", 90).at(front, 0, z))
        kit.add(
            BLACK,
            lathe([(0.13, 0), (0.12, 0.4), (0.2, 0.55), (0.16, 0.6)], 16).at(
                front - 0.3, 0, z + 0.9 * r
            ),
        )
        for x in (0.1, 0.55):
            kit.add(
                pick(rng, (materials.GOLD, body)),
                lathe([(0.16, 0), (0.16, 0.15), (0.08, 0.24), (0, 0.25)], 16).at(
                    x - 0.2, 0, z + 0.93 * r
                ),
            )
        rear = 0.5 - boiler / 2
        kit.add(body, box(0.9, 1.15, 1.35).at(rear - 0.35, 0, 1.15))
        kit.add(
            trim,
            prism([(-0.65, 0), (0.65, 0), (0.45, 0.16), (-0.45, 0.16)], 1.05)
            .turned("z", 90)
            .at(rear - 0.35, 0, 1.8),
        )
        kit.both(DARK_GLASS, box(0.4, 0.03, 0.4).at(rear - 0.35, 0.57, 1.45))
        kit.add(BLACK, box(boiler + 1.4, 0.85, 0.2).at(0.1, 0, 0.5))
        big = kit.uniform("wheel", 0.3, 0.42)
        places = [rear + 0.1 + k * 2.2 * big for k in range(kit.choose("drivers", 2, 3, 4))]
        _wheels(kit, places, big, 0.48, rim)
        _wheels(kit, [front - 0.15, rear - 0.6], 0.2, 0.45, rim)
        kit.both(
            CHROME,
            box(places[-1] - places[0] + 0.2, 0.04, 0.06).at(
                (places[0] + places[-1]) / 2, 0.55, big
            ),
        )
        kit.add(trim, prism([(0, 0), (0.35, 0), (0.0, 0.35)], 0.9).at(front + 0.15, 0, 0.1))
        kit.add(LIGHT, cylinder(0.1, 0.12, 14).turned("y", 90).at(front + 0.02, 0, z + r + 0.1))
        if kit.chance("tender", 0.6):
            kit.add(body, box(1.2, 1.1, 0.8).at(rear - 1.55, 0, 0.95))
            kit.add(
                materials.soil(rng), shapes.blob(rng, 1.1, 0.95, 0.4, 0.3).at(rear - 1.55, 0, 1.35)
            )
            _wheels(kit, [rear - 1.95, rear - 1.2], 0.24, 0.46, rim)
    elif kind in ("wagon", "tank"):
        length = kit.uniform("length", 2.6, 4.0)
        kit.add(BLACK, box(length, 0.9, 0.15).at(z=0.5))
        if kind == "tank":
            kit.add(
                skin if rng.random() < 0.5 else materials.plating(rng),
                lathe(
                    [
                        (0, 0),
                        (0.5, 0.03),
                        (0.6, 0.12),
                        (0.6, length * 0.92 - 0.12),
                        (0.5, length * 0.92 - 0.03),
                        (0, length * 0.92),
                    ],
                    28,
                )
                .turned("y", 90)
                .at(-0.46 * length, 0, 1.2),
            )
            kit.add(
                metal(rng),
                cylinder(0.2, 0.25, 16).at(z=1.85),
                *[box(0.06, 1.24, 0.5).at(s * 0.35 * length, 0, 0.8) for s in (-1, 1)],
            )
        else:
            side = pick(rng, (wood, materials.plating, paint))(rng)
            high = kit.uniform("height", 0.5, 1.3)
            kit.both(side, box(length, 0.06, high).at(0, 0.6, 0.57 + high / 2))
            kit.add(
                side,
                *[box(0.06, 1.2, high).at(s * length / 2, 0, 0.57 + high / 2) for s in (-1, 1)],
            )
            for k in np.linspace(-0.45, 0.45, 6):
                kit.both(trim, box(0.08, 0.05, high).at(k * length, 0.64, 0.57 + high / 2))
            kit.add(
                pick(rng, (materials.soil, wood))(rng),
                shapes.blob(rng, 0.95 * length, 1.1, 0.6, 0.2, 18).at(0, 0, 0.45 + 0.8 * high),
            )
        _wheels(
            kit, [s * 0.36 * length + d for s in (-1, 1) for d in (-0.25, 0.25)], 0.2, 0.46, rim
        )
    else:
        cars = kit.choose("cars", 1, 2, 3) if kind != "carriage" else 1
        length = kit.uniform("length", 3.0, 4.5)
        high = kit.uniform("height", 1.7, 2.1)
        for k in range(cars):
            centre = -k * (length + 0.25)
            if kind == "express" and k == 0:
                nose = kit.uniform("nose", 0.8, 1.6)
                t = np.linspace(0, np.pi, 13)
                section = np.column_stack(
                    [0 * t, 0.65 * np.cos(t), 0.35 + (high - 0.35) * np.sin(t) ** 0.7]
                )
                rings = [
                    section * [1, s, s] + [x, 0, 0.35 * (1 - s)]
                    for x, s in (
                        (centre - length / 2, 1.0),
                        (centre + length / 2 - nose, 1.0),
                        (centre + length / 2 - 0.4 * nose, 0.78),
                        (centre + length / 2, 0.3),
                    )
                ]
                kit.add(skin, solids.loft(rings))
                kit.add(
                    DARK_GLASS,
                    ball(0.7 * nose, 0.75, 0.4, 16).at(
                        centre + length / 2 - 0.62 * nose, 0, 0.74 * high
                    ),
                )
                kit.both(
                    DARK_GLASS,
                    box(length - nose, 0.04, 0.3).at(centre - nose / 2, 0.63, 0.62 * high),
                )
                kit.add(BLACK, box(0.9 * length, 0.9, 0.2).at(centre - 0.1, 0, 0.35))
            else:
                _carriage(
                    kit,
                    centre,
                    length,
                    skin,
                    roof,
                    0.4,
                    high,
                    kit.visible.setdefault("windows", int(rng.integers(4, 9))),
                )
                for s in (-1, 1):
                    if kind in ("diesel", "tram"):
                        kit.add(
                            DARK_GLASS,
                            box(0.04, 1.0, 0.4).at(centre + s * length / 2, 0, 0.72 * high),
                        )
                        kit.both(
                            LIGHT,
                            ball(0.08, 0.16, 0.16, 12).at(
                                centre + s * length / 2, 0.42, 0.45 * high
                            ),
                        )
                        kit.add(RED_LIGHT, box(0.04, 0.3, 0.06).at(centre + s * length / 2, 0, 0.5))
            if kind == "diesel":
                kit.both(
                    materials.mesh(rng),
                    box(0.3 * length, 0.04, 0.3 * high).at(centre - 0.2 * length, 0.66, 0.6 * high),
                )
                kit.add(
                    roof,
                    *[
                        cylinder(0.25, 0.1, 16).at(centre + d * length, 0, high + 0.04)
                        for d in (-0.25, 0.0, 0.25)
                    ],
                )
            if kind in ("tram", "express"):
                kit.add(
                    BLACK,
                    rod((centre - 0.3, 0, high), (centre + 0.2, 0, high + 0.35), 0.02, 6),
                    rod((centre + 0.2, 0, high + 0.35), (centre - 0.2, 0, high + 0.6), 0.02, 6),
                    rod((centre - 0.2, -0.5, high + 0.6), (centre - 0.2, 0.5, high + 0.6), 0.02, 6),
                )
            _wheels(
                kit,
                [centre + s * 0.34 * length + d for s in (-1, 1) for d in (-0.25, 0.25)],
                0.22,
                0.46,
                rim,
            )
            if k:
                kit.add(BLACK, box(0.4, 0.7, 0.9).at(centre + length / 2 + 0.12, 0, 1.0))
    if kit.chance("rails", 0.3):
        steel, sleeper = metal(rng), wood(rng)
        kit.add(steel, *[box(length * 1.5, 0.06, 0.08).at(-0.3, s * 0.46, -0.04) for s in (-1, 1)])
        for x in np.arange(-0.75, 0.75, 0.09) * length:
            kit.add(sleeper, box(0.16, 1.5, 0.08).at(x - 0.3, 0, -0.1))


def rocket(kit: Kit) -> None:
    """Launcher, moon rocket, missile, shuttle, satellite, lander, flying saucer."""
    kind = kit.choose(
        "subtype",
        "launcher",
        "launcher",
        "fantasy",
        "missile",
        "shuttle",
        "satellite",
        "lander",
        "saucer",
    )
    rng = kit.rng
    skin = pick(rng, (materials.plating, paint, metal))(rng)
    trim, foil = (
        paint(rng),
        materials.shaded(
            (0.75, 0.58, 0.22),
            materials.textures.metal("cast", 2),
            materials.Tiled(0.9),
            0.6,
            40.0,
            "foil",
        ),
    )
    if kind in ("launcher", "missile", "fantasy"):
        h, r = kit.uniform("height", 3.0, 6.0), kit.uniform("radius", 0.25, 0.5)
        if kind == "fantasy":
            profile = shapes.curve(
                [(0.6 * r, 0.5), (1.4 * r, 0.35 * h), (1.2 * r, 0.65 * h), (0.0, h)], 8
            )
            kit.add(skin, lathe([(0, 0.5), *profile], 32))
            kit.add(trim, lathe([(r * 0.62, 0.84 * h), (0.0, 1.01 * h)], 28))
        else:
            step = kit.uniform("step", 0.6, 1.0)
            split = kit.uniform("split", 0.45, 0.65) * h
            profile = [
                (r, 0.2),
                (r, split),
                (step * r, split + 0.2),
                (step * r, 0.82 * h),
                *shapes.curve([(step * r, 0.82 * h), (0.7 * step * r, 0.93 * h), (0, h)], 5)[1:],
            ]
            stripes = materials.pictured(
                materials.textures.livery(int(rng.integers(8)), (0.9,) * 3, materials.lively(rng)),
                Wrapped((2, 1.0)),
                0.2,
            )
            kit.add(stripes if rng.random() < 0.35 else skin, lathe([(0, 0.2), *profile], 28))
            kit.add(
                trim,
                *[
                    cylinder(w * 1.02, 0.08, 28).at(z=z)
                    for w, z in ((r, 0.3), (r, 0.5 * split), (step * r, 0.7 * h))
                ],
            )
        fins = kit.choose("fins", 3, 4)
        reach, tall = kit.uniform("fin", 0.4, 0.9), kit.uniform("fin_height", 0.15, 0.3) * h
        for angle in around(fins, 45):
            fin = prism(
                [(0.5 * r, 0.3), (r + reach, 0.0), (r + reach, 0.3 * tall), (0.8 * r, tall + 0.4)],
                0.06,
            )
            kit.add(trim, fin.turned("z", angle))
        kit.add(
            BLACK,
            lathe(
                [(0.3 * r, 0.25), (0.6 * r, -0.05), (0.5 * r, -0.05), (0.2 * r, 0.2)], 20, loop=True
            ),
        )
        for k in range(kit.choose("boosters", 0, 0, 2, 4) if kind == "launcher" else 0):
            angle = 90 * k if kit.visible["boosters"] == 4 else 90 + 180 * k
            boost = lathe([(0.15, 0), (0.45 * r, 0.2), (0.45 * r, 0.4 * h), (0, 0.5 * h)], 20)
            kit.add(skin, boost.at(x=1.45 * r).turned("z", angle))
        for k in range(3 if kind == "fantasy" else 0):
            kit.add(
                materials.GOLD,
                lathe([(0.1, 0), (0.14, 0), (0.14, 0.08), (0.1, 0.08)], 18, loop=True)
                .turned("y", 90)
                .at(1.25 * r, 0, h * (0.35 + 0.12 * k)),
            )
        if kind == "missile":
            for angle in around(4, 45):
                kit.add(
                    trim,
                    prism(
                        [(0.5 * r, 0.55 * h), (2.0 * r, 0.55 * h), (0.8 * r, 0.72 * h)], 0.04
                    ).turned("z", angle),
                )
            kit.turn_all("y", 90 - kit.uniform("climb", 0, 60))
        elif kit.chance("pad", 0.4):
            kit.add(materials.stone(rng), box(2.6, 2.6, 0.2).at(z=-0.2))
            mast = metal(rng)
            for sx in (-1, 1):
                for s in (-1, 1):
                    kit.add(
                        mast,
                        rod(
                            (-1.1 + 0.2 * sx, 0.2 * s, -0.1),
                            (-1.1 + 0.2 * sx, 0.2 * s, 0.85 * h),
                            0.035,
                            6,
                        ),
                    )
            for z in np.arange(0.3, 0.85 * h, 0.5):
                kit.add(
                    mast,
                    box(0.45, 0.45, 0.05).at(-1.1, 0, z),
                    rod((-1.3, -0.2, z), (-0.9, 0.2, z + 0.5), 0.02, 5),
                )
            kit.add(mast, box(0.8, 0.1, 0.1).at(-0.6, 0, 0.7 * h))
    elif kind == "shuttle":
        kit.add(
            materials.pictured(
                materials.textures.livery(1, (0.92,) * 3, (0.15,) * 3), Fitted(), 0.2
            ),
            shapes.trunk(
                [
                    (-1.6, 0.5, 0.8, 0.8),
                    (-1.2, 0.5, 0.9, 0.9),
                    (0.6, 0.5, 0.9, 0.88),
                    (1.2, 0.46, 0.7, 0.66),
                    (1.75, 0.34, 0.1, 0.1),
                ],
                24,
            ),
        )
        wing = [
            (-1.6, 1.4),
            (-1.2, 1.45),
            (-0.3, 0.6),
            (0.9, 0.3),
            (0.9, -0.3),
            (-0.3, -0.6),
            (-1.2, -1.45),
            (-1.6, -1.4),
        ]
        kit.add(skin, prism(wing, 0.08).turned("x", 90).at(z=0.2))
        kit.add(skin, prism([(-1.7, 0.8), (-1.0, 0.85), (-1.5, 1.7), (-1.9, 1.7)], 0.08))
        kit.add(
            BLACK,
            *[
                lathe([(0.1, 0), (0.22, 0.35), (0.18, 0.35), (0.06, 0.05)], 18, loop=True)
                .turned("y", -90)
                .at(-1.5, y, z)
                for y, z in ((-0.25, 0.4), (0.25, 0.4), (0, 0.7))
            ],
        )
        kit.add(DARK_GLASS, ball(0.35, 0.5, 0.2, 14).at(1.15, 0, 0.72))
    elif kind == "satellite":
        kit.add(foil, box(0.8, 0.8, 1.1, 0.03).at(z=1.0))
        panel = materials.shaded(
            (0.08, 0.1, 0.3),
            materials.textures.masonry("tiles", 0),
            materials.Tiled(0.9),
            0.5,
            60.0,
            "solar cells",
        )
        span, count = kit.uniform("panel", 0.8, 1.4), kit.choose("panels", 1, 2, 3)
        for s in (-1, 1):
            kit.add(CHROME, rod((0, s * 0.4, 1.0), (0, s * (0.7 + span * count), 1.0), 0.03, 8))
            for k in range(count):
                kit.add(
                    panel,
                    box(0.03, 0.95 * span, 0.9)
                    .turned("y", 25)
                    .at(0, s * (0.7 + span * (k + 0.5)), 1.0),
                )
        dish = shapes.vessel(shapes.curve([(0.05, 0), (0.35, 0.1), (0.6, 0.32)]), 0.03, 0.02, 28)
        kit.add(materials.WHITE, dish.turned("y", kit.uniform("dish", 0, 90)).at(0.3, 0, 1.7))
        kit.add(
            CHROME,
            rod((0, 0, 1.5), (0.3, 0, 1.75), 0.04, 8),
            rod((-0.2, 0.2, 0.45), (-0.4, 0.3, 0.0), 0.02, 6),
        )
    elif kind == "lander":
        eight = np.stack(
            [np.cos(np.radians(around(8, 22.5))), np.sin(np.radians(around(8, 22.5)))], axis=1
        )
        kit.add(
            foil, solids.stack([(0.9 * eight, 0.6), (eight, 0.7), (eight, 1.2), (0.9 * eight, 1.3)])
        )
        kit.add(
            skin,
            solids.stack(
                [(0.6 * eight, 1.3), (0.75 * eight, 1.6), (0.6 * eight, 2.1), (0.3 * eight, 2.3)]
            ),
        )
        kit.add(DARK_GLASS, box(0.1, 0.5, 0.2).at(0.66, 0, 1.9))
        for angle in around(4, 45):
            leg = [
                rod((0.9, 0, 1.0), (1.7, 0, 0.05), 0.05, 8),
                rod((0.9, 0.25, 0.65), (1.5, 0, 0.3), 0.03, 6),
                rod((0.9, -0.25, 0.65), (1.5, 0, 0.3), 0.03, 6),
                lathe([(0.05, 0), (0.25, 0), (0.25, 0.04), (0.05, 0.08)], 16).at(1.7),
            ]
            kit.add(metal(rng), *[p.turned("z", angle) for p in leg])
        kit.add(BLACK, lathe([(0.2, 0.6), (0.4, 0.25), (0.36, 0.25), (0.15, 0.55)], 20, loop=True))
        if kit.chance("ground", 0.4):
            kit.add(materials.stone(rng), lathe([(2.6, -0.1), (2.6, 0), (0, 0.02)], 28))
    else:
        kit.add(
            skin,
            lathe(
                shapes.curve(
                    [(0.3, 0.2), (1.2, 0.35), (1.6, 0.55), (1.1, 0.75), (0.5, 0.9), (0, 0.92)], 5
                ),
                40,
            ),
        )
        kit.add(DARK_GLASS, ball(1.0, 1.0, 0.8, 24).at(z=0.9))
        for angle in around(kit.choose("lamps", 6, 9, 12)):
            kit.add(LIGHT, ball(0.14, 0.14, 0.1, 10).at(1.3, 0, 0.72).turned("z", angle))
        for angle in around(3, 30):
            kit.add(CHROME, rod((0.7, 0, 0.4), (1.1, 0, 0.0), 0.04, 8).turned("z", angle))


def _spoked(kit: Kit, x: float, radius: float, tyre: float, rim: Material, spokes: int) -> None:
    t = np.linspace(0, 2 * np.pi, 33)
    ring = np.stack([radius * np.cos(t), 0 * t, radius * np.sin(t)], axis=1)[:-1]
    angle = np.arange(8) / 8 * 2 * np.pi

    def torus(r: float, thick: float) -> Solid:
        away = ring / radius
        rings = [
            r * a + thick * (np.cos(angle)[:, None] * a + np.sin(angle)[:, None] * [0.0, 1, 0])
            for a in away
        ]
        return solids.loft(rings, loop=True)

    kit.add(RUBBER, torus(radius - tyre, tyre).at(x, 0, radius))
    kit.add(rim, torus(radius - 2.2 * tyre, 0.6 * tyre).at(x, 0, radius))
    kit.add(rim, cylinder(0.04, 0.12, 12).turned("x", 90).at(x, 0, radius))
    for a in np.arange(spokes) / spokes * 2 * np.pi:
        kit.add(
            rim,
            rod(
                (x, 0.04 * (-1) ** int(a * 7), radius),
                (x + (radius - 2 * tyre) * np.cos(a), 0, radius + (radius - 2 * tyre) * np.sin(a)),
                0.006,
                4,
            ),
        )


def _mudguard(
    x: float, axle: float, angles: np.ndarray, inner: float, outer: float, half_width: float
) -> Solid:
    """An arc over a wheel whose axle is at (x, 0, axle), between two radii."""
    profile = (
        (inner, -half_width), (inner, half_width), (outer, half_width), (outer, -half_width)
    )  # fmt: skip
    return solids.loft(
        [
            np.array([[x + r * np.cos(a), y, axle + r * np.sin(a)] for r, y in profile])
            for a in angles
        ]
    )


def cycle(kit: Kit) -> None:
    """Racing, mountain, town and penny-farthing bicycles, motorcycles, scooters, tricycle."""
    kind = kit.choose(
        "subtype",
        "racing",
        "mountain",
        "town",
        "penny",
        "motorcycle",
        "motorcycle",
        "scooter",
        "tricycle",
    )
    rng = kit.rng
    skin, steel, seat = paint(rng), pick(rng, (CHROME, BLACK, metal(rng))), materials.hide(rng)
    if kind in ("motorcycle", "scooter"):
        base, r = kit.uniform("base", 1.35, 1.6), 0.31 if kind == "motorcycle" else 0.24
        front, rear = base / 2, -base / 2
        for x in (front, rear):
            kit.add(
                RUBBER,
                lathe(
                    [
                        (0.62 * r, -0.07),
                        (0.9 * r, -0.08),
                        (r, -0.04),
                        (r, 0.04),
                        (0.9 * r, 0.08),
                        (0.62 * r, 0.07),
                    ],
                    30,
                    loop=True,
                )
                .turned("x", 90)
                .at(x, 0, r),
            )
            kit.add(steel, cylinder(0.55 * r, 0.05, 20).turned("x", 90).at(x, 0, r))
            for a in around(7):
                kit.add(steel, box(0.62 * r, 0.06, 0.05).at(0.32 * r).turned("y", a).at(x, 0, r))
        rake = kit.uniform("rake", 0.2, 0.5)
        head = np.array([front - rake, 0, 0.92])
        kit.both(CHROME, rod((front, 0.1, r), (head[0], 0.09, head[2]), 0.028, 10))
        bars = [
            head + np.array([0.02, 0, 0.05]),
            head + np.array([-0.05, 0.2, 0.13]),
            head + np.array([-0.2, 0.38, kit.uniform("bars", 0.02, 0.3)]),
        ]
        kit.both(BLACK, solids.tube(solids.smooth_path(bars, 4), 0.018, 8))
        kit.add(LIGHT, ball(0.12, 0.2, 0.2, 16).at(head[0] + 0.1, 0, head[2] - 0.05))
        if kind == "motorcycle":
            kit.add(metal(rng), box(0.42, 0.3, 0.34, 0.05).at(0.02, 0, 0.42))
            for s in (-1, 1):
                for k in range(5):
                    kit.add(
                        steel,
                        cylinder(0.12, 0.02, 14)
                        .turned("y", 20 * s)
                        .at(0.08 * s + 0.02, 0, 0.5 + 0.04 * k),
                    )
            kit.add(
                skin,
                shapes.trunk(
                    [
                        (-0.12, 0.82, 0.16, 0.12),
                        (0.1, 0.86, 0.3, 0.26),
                        (0.35, 0.88, 0.26, 0.24),
                        (0.46, 0.88, 0.1, 0.1),
                    ],
                    18,
                ),
            )
            kit.add(seat, solids.pillow(0.7, 0.26, 0.13, 0.06).at(-0.42, 0, 0.8))
            kit.both(
                CHROME,
                shapes.swept(
                    [
                        (0.2, 0.12, 0.45),
                        (0.15, 0.2, 0.25),
                        (-0.3, 0.2, 0.25),
                        (rear - 0.1, 0.2, 0.33),
                    ],
                    [0.03, 0.03, 0.045, 0.05],
                    10,
                ),
            )
            kit.both(
                BLACK,
                rod((rear, 0.1, r), (-0.1, 0.1, 0.35), 0.03, 8),
                rod((rear, 0.12, r), (-0.5, 0.12, 0.75), 0.03, 8),
            )
            if kit.chance("fairing", 0.45):
                kit.add(
                    skin,
                    shapes.trunk(
                        [
                            (-0.1, 0.6, 0.34, 0.4),
                            (0.35, 0.75, 0.4, 0.5),
                            (0.62, 0.82, 0.3, 0.36),
                            (0.75, 0.82, 0.06, 0.1),
                        ],
                        18,
                    ),
                )
                kit.add(DARK_GLASS, ball(0.4, 0.28, 0.24, 14).at(0.48, 0, 1.03))
                kit.add(materials.label(rng, "plate"), ball(0.05, 0.2, 0.16, 12).at(0.71, 0, 0.84))
        else:
            kit.add(
                skin,
                prism(
                    [
                        (-0.75, 0.3),
                        (-0.05, 0.28),
                        (0.05, 0.18),
                        (0.4, 0.18),
                        (0.55, 0.45),
                        (0.44, 0.95),
                        (0.38, 0.95),
                        (0.42, 0.5),
                        (0.3, 0.28),
                        (0.1, 0.26),
                        (-0.02, 0.68),
                        (-0.75, 0.66),
                    ][::-1],
                    0.36,
                    0.05,
                ),
            )
            kit.add(seat, solids.pillow(0.62, 0.3, 0.12, 0.05).at(-0.38, 0, 0.74))
        for x in (front, rear):
            kit.add(skin, _mudguard(x, r, np.linspace(0.5, 2.6, 9), 1.1 * r, 1.16 * r, 0.1))
        kit.add(RED_LIGHT, box(0.06, 0.12, 0.07, 0.01).at(rear - 0.12, 0, 0.68))
        return
    r = {"mountain": 0.33, "tricycle": 0.22}.get(kind, 0.34) * kit.uniform("wheel", 0.92, 1.08)
    tyre = {"mountain": 0.03, "racing": 0.014}.get(kind, 0.02)
    if kind == "penny":
        big = kit.uniform("big", 0.6, 0.75)
        _spoked(kit, 0.2, big, 0.016, steel, 36)
        _spoked(kit, -0.65, 0.2, 0.014, steel, 16)
        kit.add(
            skin,
            shapes.swept(
                [(0.12, 0, 2 * big + 0.05), (-0.25, 0, 1.8 * big), (-0.6, 0, big), (-0.65, 0, 0.2)],
                [0.03, 0.028, 0.022, 0.016],
                10,
            ),
        )
        kit.both(skin, rod((0.2, 0.07, big), (0.14, 0.06, 2 * big + 0.03), 0.015, 8))
        kit.add(seat, solids.pillow(0.26, 0.2, 0.07, 0.03).at(-0.1, 0, 2 * big + 0.04))
        kit.both(
            steel,
            solids.tube(
                solids.smooth_path(
                    [
                        (0.14, 0, 2 * big + 0.08),
                        (0.1, 0.2, 2 * big + 0.05),
                        (-0.05, 0.3, 2 * big - 0.05),
                    ],
                    4,
                ),
                0.014,
                8,
            ),
        )
        kit.both(BLACK, box(0.1, 0.08, 0.03).at(0.2, 0.16, big - 0.15))
        return
    base = 1.0 * kit.uniform("base", 0.95, 1.1)
    front, rear = 0.55 * base, -0.45 * base
    spokes = kit.choose("spokes", 14, 20, 28)
    _spoked(kit, front, r, tyre, steel, spokes)
    for y in (-0.28, 0.28) if kind == "tricycle" else (0.0,):
        before = kit.num_parts
        _spoked(kit, rear, r, tyre, steel, spokes)
        kit.move_from(before, y)
    thick = 0.017 * kit.uniform("tubes", 0.9, 1.6)
    pedal, saddle, head = (
        np.array([0, 0, 0.28]),
        np.array([-0.16, 0, 0.86]),
        np.array([0.36 * base, 0, 0.8]),
    )
    low = head + np.array([0.04, 0, -0.12])
    if kind != "town":
        kit.add(skin, shapes.bar(saddle - np.array([-0.03, 0, 0.1]), head, thick, 10))
    else:
        kit.add(
            skin,
            shapes.swept(
                [saddle - np.array([-0.1, 0, 0.4]), (0.15, 0, 0.5), head - np.array([0, 0, 0.03])],
                [thick, thick, thick],
                10,
            ),
        )
    kit.add(
        skin,
        shapes.bar(pedal, low, 1.2 * thick, 10),
        shapes.bar(pedal, saddle, thick, 10),
        shapes.bar(head + np.array([-0.02, 0, 0.05]), low, 1.3 * thick, 10),
    )
    for s in (-1, 1):
        y = 0.05 * s if kind != "tricycle" else 0.26 * s
        kit.add(
            skin,
            shapes.bar(pedal, (rear, y, r), 0.6 * thick, 8),
            shapes.bar(saddle - np.array([-0.03, 0, 0.1]), (rear, y, r), 0.55 * thick, 8),
            shapes.bar(low + np.array([0, 0.03 * s, 0]), (front, 0.05 * s, r), 0.8 * thick, 8),
        )
        kit.add(
            steel,
            shapes.bar((0, 0.07 * s, 0.28), (0.16 * s, 0.08 * s, 0.28 - 0.06 * s), 0.012, 6),
            box(0.09, 0.07, 0.025).at(0.16 * s, 0.13 * s, 0.28 - 0.06 * s),
        )
    if kind == "racing":
        bar = [
            head + np.array([0, 0, 0.08]),
            head + np.array([0.02, 0.2, 0.09]),
            head + np.array([0.14, 0.21, 0.06]),
            head + np.array([0.13, 0.21, -0.05]),
            head + np.array([0.02, 0.21, -0.05]),
        ]
    elif kind == "mountain":
        bar = [
            head + np.array([0.02, 0, 0.1]),
            head + np.array([0.02, 0.15, 0.12]),
            head + np.array([-0.02, 0.33, 0.12]),
        ]
    else:
        bar = [
            head + np.array([0, 0, 0.12]),
            head + np.array([0.02, 0.15, 0.2]),
            head + np.array([-0.2, 0.28, 0.18]),
        ]
    kit.both(BLACK, solids.tube(solids.smooth_path(np.asarray(bar).tolist(), 4), 0.014, 8))
    kit.add(
        seat,
        solids.pillow(0.27, 0.15 if kind == "racing" else 0.2, 0.06, 0.028).at(
            saddle[0], 0, saddle[2] + 0.02
        ),
    )
    kit.add(
        steel,
        cylinder(0.1, 0.012, 24).turned("x", 90).at(0, 0.055, 0.28),
        *[
            shapes.bar((0, 0.055, 0.28 + 0.09 * s), (rear, 0.055, r + 0.035 * s), 0.006, 5)
            for s in (-1, 1)
        ],
    )
    if kind == "town":
        for x in (front, rear):
            kit.add(skin, _mudguard(x, r, np.linspace(0.3, 2.8, 10), 1.05 * r, 1.09 * r, 0.03))
        if kit.chance("basket", 0.6):
            kit.add(
                materials.wicker(rng),
                shapes.vessel([(0.12, 0), (0.17, 0.22)], 0.015, 0.02, 20).at(front + 0.02, 0, 0.78),
            )
        kit.add(steel, box(0.4, 0.12, 0.015).at(rear - 0.02, 0, 2 * r + 0.06))

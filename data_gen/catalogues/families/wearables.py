"""Hats and helmets; bags, suitcases, shoes."""

import numpy as np

from data_gen.catalogues.families import materials, shapes
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    DARK_GLASS,
    GOLD,
    Kit,
    fabric,
    metal,
    paint,
    pick,
    plastic,
    rect,
)
from data_gen.catalogues.families.materials import Material
from data_gen.catalogues.solids import (
    Solid,
    ball,
    box,
    cylinder,
    lathe,
    loft,
    pillow,
    rod,
    smooth_path,
    stack,
    tube,
)


def _cover(kit: Kit) -> Material:
    rng = kit.rng
    return pick(rng, (fabric, materials.hide, fabric, materials.wicker))(rng)  # type: ignore[no-any-return]


def hat(kit: Kit) -> None:
    """Cap, top hat, brimmed hat, bowler, beanie, helmets of many sorts, crown, cone."""
    kind = kit.choose(
        "subtype",
        "cap",
        "top",
        "brimmed",
        "brimmed",
        "bowler",
        "beanie",
        "army",
        "racing",
        "crown",
        "hard",
        "cone",
    )
    rng = kit.rng
    cover, band = _cover(kit), fabric(rng)
    a, b = 1.0, kit.uniform("narrow", 0.78, 0.92)

    def shell(profile: list[tuple[float, float]], wall: float = 0.03) -> Solid:
        inner = [(max(r - wall, 0.0), z - wall) for r, z in profile if z > profile[0][1]]
        return lathe(
            [*profile, *inner[::-1], (profile[0][0] - wall, profile[0][1])], 36, loop=True
        ).scaled(a, b, 1)

    if kind in ("top", "brimmed", "bowler", "cone"):
        high = {"top": 0.8, "brimmed": 0.45, "bowler": 0.45, "cone": 1.1}[kind] * kit.uniform(
            "height", 0.8, 1.25
        )
        brim = kit.uniform("brim", 0.72, 1.3)
        curl = kit.uniform("curl", 0.0, 0.5)
        if kind == "cone":
            crown = [(0.5, 0.02), (0.25, 0.5 * high), (0.02, high), (0, high)]
        elif kind == "bowler":
            crown = shapes.curve([(0.5, 0.02), (0.5, 0.5 * high), (0.33, 0.9 * high), (0.0, high)])
        else:
            flare = kit.uniform("flare", 0.8, 1.1)
            crown = [
                (0.5, 0.02),
                (0.5 * flare, 0.92 * high),
                (0.45 * flare, high),
                (0.2, high - 0.06),
                (0, high - 0.07),
            ]
        kit.add(cover, lathe([(0, 0.0), (0.5, 0.0), *crown], 36).scaled(a, b, 1))
        plate = lathe([(0.48, 0), (brim, -0.005), (brim, 0.02), (0.48, 0.03)], 40, loop=True)
        kit.add(
            cover,
            plate.scaled(a, b, 1).bent(
                lambda v: (
                    v
                    + np.stack(
                        [0 * v[:, 0], 0 * v[:, 0], curl * v[:, 1] ** 2 * (np.abs(v[:, 1]) > 0.3)],
                        axis=1,
                    )
                )
            ),
        )
        kit.add(
            band,
            lathe([(0.505, 0.03), (0.51, 0.03), (0.505, 0.13), (0.5, 0.13)], 36, loop=True).scaled(
                a, b, 1
            ),
        )
        if kind == "brimmed" and kit.chance("feather", 0.3):
            kit.add(
                fabric(rng),
                shapes.swept(
                    [(0, 0.42, 0.1), (-0.2, 0.5, 0.5), (-0.5, 0.5, 0.7)], [0.02, 0.06, 0.01], 8
                ),
            )
        return
    if kind == "crown":
        gold, points = GOLD if rng.random() < 0.6 else metal(rng), kit.choose("points", 5, 8, 12)
        count = points * 4
        angle = np.arange(count) / count * 2 * np.pi
        rise = 0.3 + 0.25 * np.abs((np.arange(count) % 4) / 2 - 1)
        circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        rings = [
            np.column_stack([0.46 * circle, 0 * angle]),
            np.column_stack([0.5 * circle, 0 * angle]),
            np.column_stack([0.6 * circle, rise]),
            np.column_stack([0.57 * circle, rise]),
        ]
        kit.add(gold, loft(rings, loop=True))
        for k in range(points):
            turn = k / points * 2 * np.pi
            jewel = Material(materials.lively(rng), (0.7,) * 3, 100.0, name="jewel")  # type: ignore[arg-type]
            kit.add(
                jewel, ball(0.08, 0.08, 0.08, 10).at(0.6 * np.cos(turn), 0.6 * np.sin(turn), 0.57)
            )
            kit.add(
                jewel,
                ball(0.05, 0.09, 0.09, 8)
                .turned("z", np.degrees(turn))
                .at(0.52 * np.cos(turn), 0.52 * np.sin(turn), 0.13),
            )
        kit.add(fabric(rng), lathe([(0.47, 0.05), (0.5, 0.25), (0.3, 0.36), (0, 0.38)], 28))
        return
    high = kit.uniform("height", 0.42, 0.62)
    dome = shapes.curve([(0.5, 0), (0.52, 0.35 * high), (0.36, 0.82 * high), (0.0, high)], 6)
    if kind == "cap":
        kit.add(cover, shell(dome))
        peak = stack([(shapes.oval(0.62, 0.8, 28), -0.012), (shapes.oval(0.62, 0.8, 28), 0.012)])
        kit.add(
            cover if rng.random() < 0.5 else band,
            peak.at(x=0.42)
            .bent(lambda v: v - np.stack([0 * v[:, 0], 0 * v[:, 0], 0.7 * v[:, 1] ** 2], axis=1))
            .at(z=0.06),
        )
        kit.add(band, ball(0.07, 0.07, 0.04, 10).at(z=high))
        if kit.chance("badge", 0.6):
            kit.add(
                materials.label(rng, "plate"), ball(0.05, 0.3, 0.22, 14).at(0.5, 0, 0.42 * high)
            )
    elif kind == "beanie":
        kit.add(cover, shell(dome))
        kit.add(
            band,
            lathe([(0.49, 0), (0.54, 0), (0.54, 0.14), (0.49, 0.14)], 32, loop=True).scaled(
                a, b, 1
            ),
        )
        if kit.chance("bobble", 0.6):
            kit.add(band, shapes.blob(rng, 0.2, 0.2, 0.2, 0.15, 14).at(z=high + 0.06))
    elif kind in ("army", "hard"):
        skin = materials.camouflage(rng) if kind == "army" and rng.random() < 0.6 else paint(rng)
        kit.add(skin, shell([(0.6, -0.06), (0.54, 0.06), *dome[2:]]))
        if kind == "hard":
            kit.add(
                skin,
                tube(
                    [(a * r, 0.0, z) for r, z in [*dome[4:], *[(-r, z) for r, z in dome[-2:3:-1]]]],
                    0.045,
                    8,
                ),
                box(0.25, 0.6, 0.02, 0.008).at(0.6, 0, -0.04),
            )
            kit.add(materials.label(rng, "plate"), box(0.05, 0.2, 0.14).at(0.49, 0, 0.25 * high))
        strap = smooth_path(
            [
                (0, 0.44, 0),
                (0.05, 0.3, -0.35),
                (0.06, 0, -0.45),
                (0.05, -0.3, -0.35),
                (0, -0.44, 0),
            ],
            4,
        )
        kit.add(materials.hide(rng), tube(strap, 0.018, 6))
    else:
        skin = pick(rng, (paint, materials.livery))(rng)
        kit.add(
            skin,
            lathe(
                shapes.curve([(0.36, -0.5), (0.5, -0.3), (0.55, 0), (0.4, 0.42), (0, 0.55)], 5), 36
            ).scaled(1.1, 0.9, 1),
        )
        visor = lathe(
            shapes.curve([(0.4, -0.2), (0.565, -0.12), (0.56, 0.14), (0.4, 0.24)], 4), 36
        ).scaled(1.1, 0.9, 1)
        kit.add(
            DARK_GLASS,
            visor.bent(
                lambda v: np.where(v[:, :1] > 0.12, v * [1.015, 1.01, 1], v * [0.9, 0.9, 1])
            ),
        )
        kit.add(
            BLACK,
            lathe(
                [(0.33, -0.5), (0.38, -0.52), (0.38, -0.47), (0.33, -0.46)], 28, loop=True
            ).scaled(1.1, 0.9, 1),
        )
        kit.both(BLACK, cylinder(0.06, 0.04, 14).turned("x", 90).at(0.1, 0.5, 0.05))


def bag(kit: Kit) -> None:
    """Handbag, tote, backpack, suitcase, trolley, sports bag, briefcase, sack, shoe, boot."""
    kind = kit.choose(
        "subtype",
        "handbag",
        "tote",
        "backpack",
        "suitcase",
        "trolley",
        "sports",
        "briefcase",
        "sack",
        "shoe",
        "boot",
    )
    rng = kit.rng
    cover, trim = _cover(kit), materials.hide(rng)
    clasp = GOLD if rng.random() < 0.5 else CHROME
    x, y, z = (
        kit.uniform("depth", 0.15, 0.3),
        kit.uniform("width", 0.5, 0.8),
        kit.uniform("height", 0.35, 0.7),
    )

    def grip(reach: float, high: float, at_x: float, thick: float = 0.015) -> None:
        path = smooth_path(
            [
                (at_x, -reach, z - 0.03),
                (at_x, -0.85 * reach, z + high),
                (at_x, 0.85 * reach, z + high),
                (at_x, reach, z - 0.03),
            ],
            6,
        )
        kit.add(trim, tube(path, thick, 8))

    if kind in ("shoe", "boot"):
        sole, upper = pick(rng, (plastic, materials.hide))(rng), cover
        foot = [(-0.45, 0.3), (-0.2, 0.28), (0.2, 0.34), (0.4, 0.3), (0.5, 0.12)]
        t = np.linspace(0, 1, 12)
        width = np.interp(t, np.linspace(0, 1, 5), [w for _, w in foot])
        length = np.interp(t, np.linspace(0, 1, 5), [v for v, _ in foot])
        high = np.interp(t, [0, 0.25, 0.5, 0.75, 1], [0.32, 0.36, 0.3, 0.2, 0.13])
        angle = np.linspace(0, np.pi, 9)
        rings = [
            np.column_stack(
                [
                    np.full(11, px),
                    [w / 2, *(w / 2 * np.cos(angle)), -w / 2],
                    [0.06, *(0.06 + (h - 0.06) * np.sin(angle)), 0.06],
                ]
            )
            for px, w, h in zip(length, width, high, strict=True)
        ]
        heel = kit.uniform("heel", 0.02, 0.12)
        right = np.column_stack([length, 0.52 * width])
        edge = np.concatenate([right, (right * [1, -1])[::-1]])
        for s in (-1, 1):
            turn = 0.25 * s
            kit.add(upper, loft(rings).at(y=turn, z=heel))
            kit.add(
                sole,
                stack(
                    [(edge + np.array([0, turn]), heel), (edge + np.array([0, turn]), heel + 0.07)]
                ),
            )
            kit.add(sole, box(0.3, 0.28, heel + 0.02).at(-0.3, turn, (heel + 0.02) / 2))
            if kind == "boot":
                shaft = kit.visible.setdefault("shaft", float(rng.uniform(0.3, 0.8)))
                kit.add(
                    upper,
                    shapes.upright(
                        [
                            (heel + 0.15, 0.36, 0.28),
                            (heel + 0.35, 0.3, 0.26),
                            (heel + 0.3 + shaft, 0.36, 0.32),
                        ]
                    ).at(-0.26, turn),
                )
            for k in range(4):
                kit.add(
                    trim,
                    box(0.02, 0.16, 0.015)
                    .turned("y", 22)
                    .at(0.02 + 0.07 * k, turn, heel + 0.3 - 0.028 * k),
                )
        return
    if kind in ("suitcase", "trolley", "briefcase"):
        skin = pick(rng, (materials.hide, plastic, paint, fabric))(rng)
        z = z if kind != "trolley" else 1.2 * y
        kit.add(skin, box(x, y, z, 0.04).at(z=z / 2))
        for side in (-0.3, 0.3):
            if kit.visible.setdefault("straps", bool(rng.random() < 0.5)):
                kit.add(trim, box(x * 1.03, 0.05, z * 1.01).at(0, side * y, z / 2))
            kit.add(clasp, box(0.02, 0.06, 0.05).at(x / 2, side * y, 0.9 * z))
        for rib in (-1, 0, 1) if kind == "trolley" else ():
            kit.add(skin, box(0.02, 0.04, 0.85 * z, 0.008).at(x / 2, rib * 0.25 * y, z / 2))
        grip(0.12, 0.09, 0)
        if kind == "trolley":
            for sx in (-1, 1):
                kit.both(
                    BLACK,
                    cylinder(0.04, 0.03, 12).turned("x", 90).at(sx * 0.35 * x, 0.4 * y, -0.03),
                )
            kit.add(
                CHROME,
                *[
                    rod((-0.4 * x, s * 0.13, z), (-0.4 * x, s * 0.13, z + 0.35), 0.01, 6)
                    for s in (-1, 1)
                ],
            )
            kit.add(BLACK, box(0.04, 0.3, 0.03, 0.01).at(-0.4 * x, 0, z + 0.36))
        if kit.chance("stickers", 0.4):
            for _ in range(3):
                kit.add(
                    materials.label(rng, "box"),
                    box(0.01, 0.16, 0.13)
                    .turned("x", rng.uniform(-25, 25))
                    .at(x / 2 + 0.003, rng.uniform(-0.3, 0.3) * y, rng.uniform(0.25, 0.7) * z),
                )
        return
    if kind == "backpack":
        z *= 1.3
        kit.add(cover, pillow(1.2 * x, 0.75 * y, z, 0.1).at(z=z / 2))
        kit.add(
            trim if rng.random() < 0.5 else cover,
            pillow(0.5 * x, 0.55 * y, 0.45 * z, 0.05).at(0.7 * x, 0, 0.3 * z),
        )
        kit.both(cover, pillow(0.7 * x, 0.3 * x, 0.35 * z, 0.04).at(0, 0.4 * y, 0.25 * z))
        for s in (-1, 1):
            path = smooth_path(
                [
                    (-0.5 * x, s * 0.15 * y, z - 0.04),
                    (-1.0 * x, s * 0.2 * y, 0.75 * z),
                    (-0.9 * x, s * 0.25 * y, 0.3 * z),
                    (-0.5 * x, s * 0.28 * y, 0.1 * z),
                ],
                5,
            )
            kit.add(trim, tube(path, 0.03, 8))
        kit.add(clasp, box(0.02, 0.06, 0.04).at(0.95 * x, 0, 0.45 * z))
    elif kind == "sports":
        kit.add(
            cover,
            cylinder(0.5 * z, 1.2 * y, 24, 0.06).turned("x", 90).scaled(1.2, 1, 1).at(z=0.5 * z),
        )
        kit.both(
            trim,
            cylinder(0.51 * z, 0.04, 24).turned("x", 90).scaled(1.2, 1, 1).at(0, 0.3 * y, 0.5 * z),
        )
        for s in (-1, 1):
            grip(0.3 * y, 0.15, s * 0.15)
    elif kind == "sack":
        kit.add(
            materials.shaded(
                (0.6, 0.5, 0.36), materials.textures.weave("plain", 1), materials.Tiled(0.6)
            ),
            lathe(
                shapes.curve(
                    [(0.25, 0), (0.4, 0.12), (0.38, 0.5), (0.12, 0.72), (0.22, 0.85), (0, 0.86)], 5
                ),
                24,
            ).bent(
                lambda v: (
                    v * (1 + 0.05 * np.sin(5 * np.arctan2(v[:, 1], v[:, 0]) + 4 * v[:, 2]))[:, None]
                )
            ),
        )
        kit.add(trim, lathe([(0.12, 0.7), (0.15, 0.7), (0.15, 0.75), (0.12, 0.75)], 18, loop=True))
    else:
        flare = kit.uniform("flare", 0.7, 1.1)
        levels = [
            (shapes.oval(0.9 * x, 0.9 * y, 28), 0),
            (shapes.oval(x, y, 28), 0.05),
            (shapes.oval(flare * x, flare * y, 28), z),
        ]
        if kind == "tote":
            levels = [(rect(x, y, 0.04)(0), 0), (rect(x * flare, y * 1.05, 0.04)(0), z)]
        kit.add(cover, stack(levels))
        for s in (-1, 1):
            grip(
                0.22 * y,
                kit.visible.setdefault("grip", float(rng.uniform(0.12, 0.3))),
                s * 0.35 * x * flare,
                0.014,
            )
        if kind == "handbag":
            kit.add(
                trim,
                pillow(0.6 * x * flare, y * 0.9 * flare, 0.3 * z, 0.04).at(
                    0.28 * x * flare, 0, 0.84 * z
                ),
            )
            kit.add(clasp, ball(0.04, 0.07, 0.05, 10).at(0.6 * x * flare, 0, 0.72 * z))
        elif kit.chance("print", 0.6):
            kit.add(
                materials.label(rng, "bottle"),
                box(0.01, 0.5 * y, 0.5 * z).at(x * (1 + flare) / 4 + 0.004, 0, 0.5 * z),
            )

"""Clocks, books, boxes and barrels, beds, bathroom and kitchen fixtures."""

import numpy as np

from data_gen.catalogues.families import materials, shapes
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    GOLD,
    Kit,
    fabric,
    lacquer,
    metal,
    paint,
    pick,
    plastic,
    wood,
)
from data_gen.catalogues.families.mapping import Fitted, Wrapped
from data_gen.catalogues.families.materials import Material
from data_gen.catalogues.solids import (
    Solid,
    ball,
    box,
    cylinder,
    lathe,
    loft,
    pillow,
    prism,
    rod,
    rounded,
    smooth_path,
    stack,
    tube,
)

CLOCKS = ("wall", "alarm", "grandfather", "mantel", "cuckoo", "digital", "watch", "hourglass")


def _dial(kit: Kit, radius: float, at: tuple[float, float, float]) -> None:
    face = cylinder(radius, 0.02, 32).turned("y", 90)
    kit.add(materials.label(kit.rng, "clock"), face.at(*at))


def clock(kit: Kit) -> None:
    """A clock, watch or hourglass; see `CLOCKS`."""
    kind = kit.choose("subtype", *CLOCKS)
    rng = kit.rng
    body = pick(rng, (wood, wood, metal, lacquer))(rng)
    trim = pick(rng, (metal, wood))(rng)
    if kind == "wall":
        r, deep = 0.5, kit.uniform("depth", 0.06, 0.14)
        if kit.chance("square", 0.3):
            kit.add(body, box(deep, 2.1 * r, 2.1 * r, 0.03).at(z=1.05 * r))
            _dial(kit, 0.95 * r, (deep / 2, 0, 1.05 * r))
        else:
            ring = lathe(
                [
                    (0.9 * r, -deep / 2),
                    (1.1 * r, -deep / 2),
                    (1.12 * r, deep / 3),
                    (1.0 * r, deep / 2 + 0.03),
                    (0.9 * r, deep / 2),
                ],
                40,
                loop=True,
            )
            kit.add(
                body,
                ring.turned("y", 90).at(z=1.12 * r),
                cylinder(1.0 * r, 0.8 * deep, 36).turned("y", 90).at(z=1.12 * r),
            )
            _dial(kit, 0.95 * r, (deep / 2, 0, 1.12 * r))
    elif kind == "alarm":
        r = 0.4
        kit.add(body, cylinder(r, 0.25, 36, 0.03).turned("y", 90).at(z=0.52))
        _dial(kit, 0.9 * r, (0.125, 0, 0.52))
        for s in (-1, 1):
            kit.add(trim, ball(0.26, 0.26, 0.2, 18).turned("x", -s * 38).at(0, s * 0.26, 0.94))
            kit.add(trim, rod((0, s * 0.2, 0.2), (0, s * 0.32, 0), 0.03, 8))
        kit.add(
            trim,
            tube(
                smooth_path([(0, -0.2, 1.0), (0, -0.1, 1.15), (0, 0.1, 1.15), (0, 0.2, 1.0)], 4),
                0.02,
                8,
            ),
        )
    elif kind in ("grandfather", "cuckoo"):
        tall, wide = (2.1, 0.42) if kind == "grandfather" else (0.55, 0.5)
        deep = kit.uniform("depth", 0.24, 0.34)
        if kind == "grandfather":
            kit.add(
                body,
                box(deep, wide * 1.15, 0.4, 0.01).at(z=0.2),
                box(0.85 * deep, 0.8 * wide, tall - 0.8).at(z=tall / 2 - 0.02),
                box(deep, wide * 1.1, 0.5, 0.01).at(z=tall - 0.25),
            )
            kit.add(materials.DARK_GLASS, box(0.02, 0.55 * wide, 0.9).at(0.43 * deep, 0, 0.9))
            kit.add(
                GOLD,
                rod((0.46 * deep, 0, 1.3), (0.46 * deep, 0, 0.7), 0.008, 6),
                cylinder(0.07, 0.02, 18).turned("y", 90).at(0.46 * deep, 0, 0.66),
            )
            kit.add(
                body,
                prism(
                    [
                        (-0.55 * wide, 0),
                        (0.55 * wide, 0),
                        (0.2 * wide, 0.14),
                        (0, 0.22),
                        (-0.2 * wide, 0.14),
                    ],
                    deep,
                )
                .turned("z", 90)
                .at(z=tall),
            )
            _dial(kit, 0.19, (deep / 2, 0, tall - 0.25))
        else:
            kit.add(body, box(deep, wide, tall).at(z=0.6))
            kit.add(
                materials.roofing(rng),
                *[
                    s.turned("z", 0).at(z=0.6 + tall / 2)
                    for s in shapes.gable(deep, wide, 0.22, 0.08, 0.04)
                ],
            )
            kit.add(
                body,
                prism([(-wide / 2, 0), (wide / 2, 0), (0, 0.22)], 0.98 * deep)
                .turned("z", 90)
                .at(z=0.6 + tall / 2),
            )
            _dial(kit, 0.15, (deep / 2, 0, 0.55))
            for s in (-1, 1):
                kit.add(BLACK, rod((0, s * 0.1, 0.35), (0, s * 0.1, 0.1), 0.006, 5))
                kit.add(
                    trim,
                    shapes.upright([(0, 0.02, 0.02), (0.06, 0.08, 0.08), (0.14, 0.02, 0.02)]).at(
                        0, s * 0.1, 0.02 + 0.05 * s
                    ),
                )
    elif kind == "mantel":
        w, h, d = kit.uniform("width", 0.6, 0.9), 0.5, kit.uniform("depth", 0.18, 0.28)
        arch = [
            (w / 2, 0),
            *[
                (0.5 * w * np.cos(a) * (0.6 + 0.4 * abs(np.cos(a))), 0.12 + (h - 0.12) * np.sin(a))
                for a in np.linspace(0, np.pi, 15)
            ],
            (-w / 2, 0),
        ]
        kit.add(body, prism(arch, d).turned("z", 90))
        kit.add(trim, box(1.2 * d, 1.1 * w, 0.05, 0.01).at(z=-0.02))
        _dial(kit, 0.17, (d / 2 + 0.005, 0, 0.27))
    elif kind == "digital":
        w, h, d = kit.uniform("width", 0.5, 0.8), kit.uniform("height", 0.2, 0.3), 0.2
        skin = plastic(rng)
        kit.add(skin, prism([(-d, 0), (d * 0.6, 0), (d * 0.3, h), (-d, h)], w, 0.02))
        kit.add(
            materials.pictured(
                materials.textures.label("plate", int(rng.integers(8))),
                Fitted((2, 1)),
                0.3,
                60.0,
                "display",
            ),
            box(0.02, 0.85 * w, 0.65 * h).turned("y", -18).at(0.46 * d, 0, 0.5 * h),
        )
        for k in range(4):
            kit.add(BLACK, cylinder(0.025, 0.02, 10).at(-0.3 * d, (k - 1.5) * 0.15 * w, h))
    elif kind == "watch":
        strap = pick(rng, (materials.hide, metal, fabric))(rng)
        t = np.linspace(0, 2 * np.pi, 40, endpoint=False)
        outer = np.stack([0.5 * np.cos(t), 0 * t, 0.42 + 0.42 * np.sin(t)], axis=1)
        rings = [
            outer * [s, 1, 1] * 1.0 + [0, y, 0]
            if s == 1
            else (outer - np.array([0, 0, 0.42])) * 0.92 + [0, y, 0.42]
            for s, y in ((1, -0.1), (1, 0.1), (0.92, 0.1), (0.92, -0.1))
        ]
        kit.add(strap, loft(rings, loop=True))
        kit.add(metal(rng), cylinder(0.24, 0.12, 30, 0.03).at(z=0.88))
        kit.add(materials.label(rng, "clock"), cylinder(0.2, 0.02, 30).turned("z", 180).at(z=0.945))
        kit.turn_all("y", 60)
    else:
        for z in (0.04, 1.06):
            kit.add(body, cylinder(0.34, 0.08, 28, 0.02).at(z=z))
        for k in range(3):
            a = 2.1 * k
            kit.add(
                trim,
                lathe(
                    [(0.03, 0.08), (0.045, 0.3), (0.025, 0.55), (0.045, 0.8), (0.03, 1.02)], 10
                ).at(0.28 * np.cos(a), 0.28 * np.sin(a)),
            )
        glass = Material((0.7, 0.76, 0.76), (0.6,) * 3, 100.0, 0.5, name="glass")
        kit.add(
            glass,
            lathe(
                shapes.curve(
                    [
                        (0.1, 0.08),
                        (0.22, 0.2),
                        (0.2, 0.4),
                        (0.03, 0.55),
                        (0.2, 0.72),
                        (0.22, 0.9),
                        (0.1, 1.02),
                    ],
                    4,
                ),
                24,
            ),
        )
        kit.add(
            materials.shaded(
                (0.75, 0.6, 0.38), materials.textures.foliage("soil", 0), materials.Tiled(0.6)
            ),
            lathe([(0.1, 0.1), (0.19, 0.2), (0.16, 0.32), (0, 0.4)], 20),
        )


def one_book(kit: Kit, x: float, y: float, z: float) -> list[tuple[Material, Solid]]:
    """A closed book lying on z = 0, with its spine toward -y."""
    cover = materials.label(kit.rng, "book") if kit.rng.random() < 0.7 else materials.hide(kit.rng)
    pages = materials.shaded(
        (0.88, 0.84, 0.74), materials.textures.wood("veneer", 0), materials.Tiled(0.9, True)
    )
    board = 0.06 * z + 0.008
    return [
        (cover, box(x, y, board).at(z=board / 2)),
        (cover, box(x, y, board).at(z=z - board / 2)),
        (cover, box(x, board, z).at(y=-y / 2 + board / 2, z=z / 2)),
        (pages, box(0.96 * x, 0.95 * y, z - 2 * board).at(y=-0.01 * y, z=z / 2)),
    ]


def book(kit: Kit) -> None:
    """Single, standing, stack, row between ends, open, open on a stand."""
    kind = kit.choose("subtype", "single", "standing", "stack", "row", "open", "stand")
    rng = kit.rng
    x, y, z = (
        kit.uniform("length", 0.6, 0.9),
        kit.uniform("width", 0.45, 0.65),
        kit.uniform("thickness", 0.05, 0.25),
    )
    if kind in ("single", "standing"):
        for material, part in one_book(kit, x, y, z):
            kit.add(material, part if kind == "single" else part.turned("y", -90))
        if kind == "standing":
            kit.turn_all("z", kit.uniform("turn", -40, 40))
    elif kind == "stack":
        low = 0.0
        for _ in range(kit.choose("books", 2, 3, 4, 6, 9)):
            thick = rng.uniform(0.04, 0.16)
            scale, turn = rng.uniform(0.7, 1.05), rng.normal(0, 14) + 180 * rng.integers(2)
            for material, part in one_book(kit, x * scale, y * scale, thick):
                kit.add(material, part.turned("z", turn).at(z=low))
            low += thick
    elif kind == "row":
        place, count = 0.0, kit.choose("books", 4, 7, 11)
        for _ in range(count):
            thick, tall = rng.uniform(0.05, 0.15), rng.uniform(0.6, 1.0)
            for material, part in one_book(kit, tall, 0.7 * tall, thick):
                kit.add(
                    material,
                    part.turned("z", 90)
                    .turned("y", -90)
                    .turned("z", 90)
                    .turned("x", 0)
                    .at(0, place, tall / 2),
                )
            place += thick + 0.004
        end = pick(rng, (wood, metal, materials.marble))(rng)
        kit.add(
            end, box(0.5, 0.05, 0.6).at(0, -0.16, 0.3), box(0.5, 0.05, 0.6).at(0, place + 0.05, 0.3)
        )
        kit.add(end, box(0.7, place + 0.5, 0.03).at(0, place / 2, -0.015))
    else:
        page = materials.pictured(
            materials.textures.screen("document", int(rng.integers(8))), Fitted((1, 1)), name="page"
        )
        cover = materials.label(rng, "book")
        t = np.linspace(0, 1, 10)
        rise = z * np.sin(np.pi * np.minimum(t * 1.3, 1) ** 0.7) * (1 - 0.3 * t) + 0.02
        top = [(float(a * y), float(b)) for a, b in zip(t, rise, strict=True)]
        half = prism([(0, 0), (y, 0), *top[::-1][:-1], (0, 0.03)], x).turned("z", 90)
        lean = 0.0 if kind == "open" else -kit.uniform("lean", 50, 70)
        for part in (half, half.turned("z", 180)):
            kit.add(page, part.turned("y", lean))
        kit.add(cover, box(x * 1.05, 2.06 * y, 0.02).at(z=-0.011).turned("y", lean))
        if kind == "stand":
            desk = wood(rng)
            kit.add(desk, box(x * 1.1, 2.2 * y, 0.04).at(z=-0.045).turned("y", lean))
            foot = box(0.12, 2.2 * y, 0.04).at(0.58 * x, 0, 0.01).turned("y", lean)
            kit.add(
                desk, foot, box(0.05, 0.3 * y, 1.1 * x).turned("y", -25).at(-0.3 * x, 0, -0.1 * x)
            )


def container(kit: Kit) -> None:
    """Crate, cardboard box, chest, barrel, drum, shipping container, gift, package, bin, safe."""
    kind = kit.choose(
        "subtype",
        "crate",
        "cardboard",
        "chest",
        "barrel",
        "drum",
        "shipping",
        "gift",
        "bin",
        "safe",
        "package",
    )
    rng = kit.rng
    x, y, z = (kit.uniform(n, 0.5, 1.1) for n in ("depth", "width", "height"))
    trim = metal(rng)
    if kind == "crate":
        plank = wood(rng)
        kit.add(plank, box(x, y, z).at(z=z / 2))
        bar = 0.1 * min(x, y, z)
        for sx in (-1, 1):
            for s in (-1, 1):
                kit.add(
                    plank,
                    box(bar, bar, z * 1.02).at(sx * x / 2, s * y / 2, z / 2),
                    box(bar, y, bar).at(sx * x / 2, 0, z * (s + 1) / 2),
                    box(x, bar, bar).at(0, sx * y / 2, z * (s + 1) / 2),
                )
        if kit.chance("brace", 0.6):
            slant = float(np.degrees(np.arctan2(z, y)))
            for sx in (-1, 1):
                kit.add(
                    plank,
                    box(0.8 * bar, np.hypot(y, z) * 0.95, bar)
                    .turned("x", slant)
                    .at(sx * x / 2, 0, z / 2),
                )
    elif kind in ("cardboard", "gift", "package"):
        card = materials.shaded(
            (0.62, 0.46, 0.3),
            materials.textures.painted("brush", int(rng.integers(8))),
            materials.Tiled(1.2, True),
        )
        skin = (
            card
            if kind == "cardboard"
            else fabric(rng)
            if kind == "gift"
            else materials.label(rng, "box")
        )
        kit.add(skin, box(x, y, z).at(z=z / 2))
        if kind == "cardboard":
            kit.add(
                materials.shaded(
                    (0.75, 0.65, 0.45), materials.textures.painted("clean", 0), materials.Tiled(1)
                ),
                box(x * 1.004, 0.07 * y, z * 1.004).at(z=z / 2),
            )
            kit.add(
                materials.label(rng, "box"),
                box(0.004, 0.3 * y, 0.25 * z).at(x / 2, 0.22 * y, 0.6 * z),
            )
            if kit.chance("open", 0.5):
                for s in (-1, 1):
                    kit.add(
                        card,
                        box(x, 0.45 * y, 0.012)
                        .turned("x", s * kit.uniform(f"flap{s}", 20, 70))
                        .at(0, s * 0.68 * y, z + 0.15 * y),
                    )
        elif kind == "gift":
            ribbon = fabric(rng)
            kit.add(
                ribbon,
                box(x * 1.02, 0.09, z * 1.02).at(z=z / 2),
                box(0.09, y * 1.02, z * 1.02).at(z=z / 2),
            )
            for s in (-1, 1):
                kit.add(
                    ribbon, ball(0.12, 0.3, 0.16, 12).turned("x", 30 * s).at(0, s * 0.13, z + 0.07)
                )
    elif kind == "chest":
        plank = wood(rng)
        kit.add(plank, box(x, 1.4 * y, 0.6 * z).at(z=0.3 * z))
        t = np.linspace(0, np.pi, 13)
        lid = [(0.5 * x * np.cos(a), 0.45 * x * np.sin(a)) for a in t]
        kit.add(plank, prism(lid, 1.4 * y).at(z=0.61 * z))
        for k in (-0.55, 0.0, 0.55):
            kit.add(
                trim,
                prism([(1.02 * a, 1.02 * b) for a, b in lid], 0.06).at(0, k * y, 0.61 * z),
                box(x * 1.03, 0.06, 0.6 * z).at(0, k * y, 0.3 * z),
            )
        kit.add(GOLD, box(0.05, 0.14, 0.16, 0.01).at(x / 2 + 0.01, 0, 0.58 * z))
    elif kind in ("barrel", "drum", "bin"):
        r, h = 0.4 * x, kit.uniform("tall", 0.8, 1.3)
        if kind == "barrel":
            stave = wood(rng)
            bulge = kit.uniform("bulge", 1.08, 1.25)
            profile = shapes.curve(
                [
                    (r, 0),
                    (r * bulge * 0.97, 0.3 * h),
                    (r * bulge, 0.5 * h),
                    (r * bulge * 0.97, 0.7 * h),
                    (r, h),
                ],
                3,
            )
            kit.add(
                stave,
                lathe(
                    [
                        (0, 0.03),
                        (0.9 * r, 0.03),
                        (0.9 * r, 0),
                        *profile,
                        (0.9 * r, h),
                        (0.9 * r, h - 0.03),
                        (0, h - 0.03),
                    ],
                    28,
                ),
            )
            for k in (0.06, 0.26, 0.74, 0.94):
                w = 1.01 * float(np.interp(k * h, [b for _, b in profile], [a for a, _ in profile]))
                kit.add(
                    trim,
                    lathe(
                        [
                            (w - 0.03, k * h - 0.025),
                            (w, k * h - 0.025),
                            (w, k * h + 0.025),
                            (w - 0.03, k * h + 0.025),
                        ],
                        28,
                        loop=True,
                    ),
                )
        elif kind == "drum":
            skin = pick(rng, (paint, materials.plating, metal))(rng)
            profile = [
                (0.97 * r, 0),
                (1.03 * r, 0.02),
                (r, 0.04),
                (r, 0.32 * h),
                (1.04 * r, 0.34 * h),
                (r, 0.36 * h),
                (r, 0.64 * h),
                (1.04 * r, 0.66 * h),
                (r, 0.68 * h),
                (r, h - 0.04),
                (1.03 * r, h),
            ]
            kit.add(skin, lathe([(0, 0.02), *profile, (0.97 * r, h - 0.02), (0, h - 0.02)], 30))
            kit.add(
                materials.label(rng, "box", Wrapped((3, 1.0))),
                lathe([(1.005 * r, 0.4 * h), (1.005 * r, 0.6 * h)], 30),
            )
        else:
            skin = pick(rng, (metal, plastic, materials.mesh, materials.wicker))(rng)
            kit.add(
                skin,
                shapes.vessel(
                    [(0.75 * r, 0), (r, h * 0.75), (1.05 * r, h * 0.76), (1.05 * r, h * 0.8)],
                    0.02,
                    0.03,
                    30,
                ),
            )
            if kit.chance("lid", 0.5):
                kit.add(
                    plastic(rng),
                    lathe(shapes.curve([(1.08 * r, 0.8 * h), (0.9 * r, 0.92 * h), (0, h)], 5), 28),
                )
    elif kind == "shipping":
        skin = paint(rng)
        long = kit.uniform("length", 2.0, 4.0)
        ridge = np.arange(0, 1, 1 / 48)
        wave = 0.02 * (np.floor(ridge * 48) % 4 < 2)
        side = [(-0.5 * long + long * a, 0.5 + b) for a, b in zip(ridge, wave, strict=True)]
        outline = np.array([*side, *[(-a, -b) for a, b in side]])[::-1]
        kit.add(skin, stack([(outline, 0), (outline, 1.05)]))
        kit.add(
            trim,
            *[
                box(0.06, 0.06, 1.1).at(sx * long / 2, s * 0.5, 0.53)
                for sx in (-1, 1)
                for s in (-1, 1)
            ],
        )
        kit.add(
            trim,
            *[
                rod((long / 2 + 0.02, k, 0.05), (long / 2 + 0.02, k, 1.0), 0.012, 6)
                for k in (-0.3, -0.12, 0.12, 0.3)
            ],
        )
        kit.add(
            materials.label(rng, "plate"),
            box(0.7, 0.01, 0.35).at(0.2 * long, 0.53, 0.6),
            box(0.7, 0.01, 0.35).at(0.2 * long, -0.53, 0.6),
        )
    else:
        skin = materials.plating(rng)
        kit.add(skin, box(x, y, z, 0.03).at(z=z / 2))
        kit.add(paint(rng), box(0.04, 0.8 * y, 0.8 * z, 0.01).at(x / 2 + 0.01, 0, z / 2))
        kit.add(
            CHROME,
            lathe([(0.07, 0), (0.07, 0.05), (0, 0.06)], 20)
            .turned("y", 90)
            .at(x / 2 + 0.02, 0.15 * y, 0.5 * z),
        )
        for k in range(3):
            kit.add(
                CHROME,
                rod(
                    (x / 2 + 0.08, -0.15 * y, 0.5 * z),
                    (
                        x / 2 + 0.08,
                        -0.15 * y + 0.1 * np.cos(2.1 * k),
                        0.5 * z + 0.1 * np.sin(2.1 * k),
                    ),
                    0.012,
                    6,
                ),
            )


def bed(kit: Kit) -> None:
    """Single, double, bunk, four-poster, cot, divan, sleigh."""
    kind = kit.choose(
        "subtype", "single", "double", "double", "bunk", "poster", "cot", "divan", "sleigh"
    )
    rng = kit.rng
    frame = pick(rng, (wood, wood, lacquer, metal))(rng)
    sheet, cover, cushion = fabric(rng), fabric(rng), fabric(rng)
    long = kit.uniform("length", 1.9, 2.15) if kind != "cot" else 1.25
    wide = {"single": 0.95, "bunk": 0.95, "cot": 0.7}.get(kind) or kit.uniform("width", 1.4, 1.9)
    base, mattress = kit.uniform("base", 0.25, 0.4), kit.uniform("mattress", 0.14, 0.28)

    def lying(z: float) -> None:
        kit.add(sheet, pillow(long * 0.97, wide * 0.96, mattress, 0.06).at(0, 0, z + mattress / 2))
        top = z + mattress
        blanket = kit.visible.setdefault("blanket", float(rng.uniform(0.55, 0.85)))
        kit.add(
            cover,
            pillow(
                long * blanket, wide * (0.92 if kind == "cot" else 1.02), mattress * 0.8, 0.05
            ).at(long * (0.49 - blanket / 2), 0, top - 0.3 * mattress),
        )
        for y in (-0.25, 0.25) if wide > 1.2 else (0.0,):
            kit.add(
                cushion,
                pillow(0.38, min(0.62, 0.8 * wide), 0.15, 0.07)
                .turned("y", 14)
                .at(-0.38 * long, y * wide, top + 0.08),
            )

    if kind == "bunk":
        for z in (base, base + 1.0):
            kit.add(frame, box(long, wide, 0.12).at(z=z - 0.03))
            lying(z)
            for s in (-1, 1):
                kit.add(frame, box(long, 0.03, 0.1).at(0, s * wide / 2, z + 0.35))
        for sx in (-1, 1):
            for s in (-1, 1):
                kit.add(
                    frame,
                    box(0.08, 0.08, base + 1.5).at(sx * long / 2, s * wide / 2, (base + 1.5) / 2),
                )
        for k in range(5):
            kit.add(
                frame,
                rod(
                    (0.25 * long, wide / 2 + 0.04, 0.3 + 0.25 * k),
                    (0.43 * long, wide / 2 + 0.04, 0.3 + 0.25 * k),
                    0.02,
                    8,
                ),
            )
        for x in (0.25, 0.43):
            kit.add(
                frame,
                rod(
                    (x * long, wide / 2 + 0.04, 0),
                    (x * long, wide / 2 + 0.04, base + 1.3),
                    0.022,
                    8,
                ),
            )
    elif kind == "cot":
        kit.add(frame, box(long, wide, 0.06).at(z=base))
        lying(base)
        for s in (-1, 1):
            kit.add(frame, box(long, 0.04, 0.05).at(0, s * wide / 2, base + 0.55))
            for x in np.linspace(-0.47, 0.47, 14):
                kit.add(
                    frame,
                    rod(
                        (x * long, s * wide / 2, base),
                        (x * long, s * wide / 2, base + 0.55),
                        0.01,
                        6,
                    ),
                )
            kit.add(frame, box(0.04, wide, 0.75 + 0.1).at(s * long / 2, 0, base + 0.2))
            for sx in (-1, 1):
                kit.add(frame, box(0.05, 0.05, base).at(sx * long / 2, s * wide / 2, base / 2))
    else:
        kit.add(cover if kind == "divan" else frame, box(long, wide, 0.2, 0.02).at(z=base - 0.1))
        lying(base)
        if kind == "divan":
            kit.add(cover, box(long * 0.98, wide * 0.98, base - 0.15).at(z=(base - 0.15) / 2))
        else:
            for sx in (-1, 1):
                for s in (-1, 1):
                    kit.add(
                        frame,
                        box(0.09, 0.09, base, 0.01).at(sx * 0.47 * long, s * 0.46 * wide, base / 2),
                    )
        high = kit.uniform("headboard", 0.8, 1.3)
        style = kit.choose("head", "panel", "padded", "bars", "arched")
        if kind == "sleigh":
            for s, tall in ((-1, high), (1, 0.75 * high)):
                curve = [
                    (0, 0.1),
                    (0.02, 0.5 * tall),
                    (0.1, 0.9 * tall),
                    (0.2, tall),
                    (0.16, tall + 0.03),
                    (0.05, 0.93 * tall),
                    (-0.04, 0.5 * tall),
                    (-0.06, 0.1),
                ]
                part = prism(curve[::-1], wide * 1.04)
                kit.add(frame, (part.turned("z", 180) if s < 0 else part).at(x=s * long / 2))
        elif style == "bars":
            for y in np.linspace(-0.5, 0.5, 9):
                kit.add(
                    frame, rod((-long / 2, y * wide, 0.2), (-long / 2, y * wide, high), 0.015, 8)
                )
            kit.add(
                frame, rod((-long / 2, -wide / 2, high), (-long / 2, wide / 2, high), 0.025, 10)
            )
        elif style == "padded":
            kit.add(
                fabric(rng),
                pillow(0.12, wide * 1.03, high - 0.15, 0.05).at(
                    -long / 2 - 0.04, 0, high / 2 + 0.08
                ),
            )
        else:
            arch = 0.0 if style == "panel" else 0.25
            outline = [
                (-wide / 2, 0.1),
                (wide / 2, 0.1),
                *[
                    (wide / 2 * np.cos(a), high - arch + arch * np.sin(a))
                    for a in np.linspace(0, np.pi, 11)
                ],
            ]
            kit.add(frame, prism(outline, 0.06).turned("z", 90).at(x=-long / 2 - 0.02))
        if kind == "poster":
            for sx in (-1, 1):
                for s in (-1, 1):
                    post = lathe(
                        [
                            (0.045, 0),
                            (0.05, 0.5),
                            (0.035, 0.6),
                            (0.05, 0.7),
                            (0.03, 1.9),
                            (0.05, 2.0),
                        ],
                        12,
                    )
                    kit.add(frame, post.at(sx * long / 2, s * wide / 2))
                kit.add(
                    frame,
                    box(0.06, wide, 0.06).at(sx * long / 2, 0, 2.0),
                    box(long, 0.06, 0.06).at(0, sx * wide / 2, 2.0),
                )
            if kit.chance("canopy", 0.6):
                kit.add(fabric(rng), box(long * 1.03, wide * 1.03, 0.05).at(z=2.05))
    if kit.chance("rug", 0.15):
        kit.add(materials.carpet(rng), box(0.7 * long, 1.5 * wide, 0.02).at(0.3 * long, 0, -0.01))


def fixture(kit: Kit) -> None:
    """Bathtub, sink, toilet, washing machine, stove, fridge, fireplace, radiator, tap."""
    kind = kit.choose(
        "subtype",
        "bathtub",
        "sink",
        "toilet",
        "washer",
        "stove",
        "fridge",
        "fireplace",
        "radiator",
        "tap",
    )
    rng = kit.rng
    glaze = Material(materials.shade_of((0.9, 0.9, 0.9), rng), (0.5,) * 3, 70.0, name="ceramic")  # type: ignore[arg-type]
    steel = CHROME if rng.random() < 0.6 else metal(rng)

    def tap(x: float, z: float, size: float = 1.0) -> None:
        path = smooth_path(
            [
                (x, 0, z),
                (x, 0, z + 0.2 * size),
                (x + 0.08 * size, 0, z + 0.27 * size),
                (x + 0.2 * size, 0, z + 0.2 * size),
                (x + 0.21 * size, 0, z + 0.14 * size),
            ],
            4,
        )
        kit.add(steel, tube(path, 0.022 * size, 10))
        for s in (-1, 1):
            kit.add(
                steel,
                cylinder(0.03 * size, 0.09 * size, 12).at(x, s * 0.1 * size, z + 0.04 * size),
                box(0.1 * size, 0.025 * size, 0.02 * size).at(x, s * 0.1 * size, z + 0.1 * size),
            )

    if kind == "bathtub":
        x, y, h = (
            kit.uniform("width", 0.7, 0.9),
            kit.uniform("length", 1.5, 1.9),
            kit.uniform("height", 0.5, 0.65),
        )
        feet = kit.chance("feet", 0.5)
        low = 0.12 if feet else 0.0
        out, foot = (
            rounded(x, y, 0.48 * x if feet else 0.05, 6),
            rounded(0.75 * x, 0.8 * y, 0.35 * x, 6),
        )
        inner, floor = (
            rounded(0.86 * x, 0.93 * y, 0.4 * x, 6),
            rounded(0.55 * x, 0.72 * y, 0.25 * x, 6),
        )
        skin = glaze if feet or rng.random() < 0.5 else materials.tiles(rng)
        kit.add(
            skin,
            stack(
                [
                    (foot if feet else out, low),
                    (out, low + (0.3 * h if feet else 0.02)),
                    (out, low + h),
                ]
            ),
        )
        kit.add(
            glaze,
            stack(
                [
                    (1.02 * out, low + h - 0.01),
                    (1.02 * out, low + h + 0.03),
                    (inner, low + h + 0.03),
                    (floor, low + 0.12),
                ]
            ),
        )
        if feet:
            for sx in (-1, 1):
                kit.both(
                    GOLD,
                    shapes.swept(
                        [
                            (sx * 0.25 * x, 0.3 * y, 0.16),
                            (sx * 0.32 * x, 0.33 * y, 0.08),
                            (sx * 0.3 * x, 0.33 * y, 0),
                        ],
                        [0.05, 0.03, 0.04],
                        8,
                    ),
                )
        tap(-0.47 * x, low + h)
    elif kind == "sink":
        y, h = kit.uniform("width", 0.5, 0.9), 0.85
        out = rounded(0.45, y, 0.15, 5)
        if kit.chance("pedestal", 0.5):
            kit.add(glaze, shapes.upright([(0, 0.22, 0.26), (0.3, 0.14, 0.16), (0.7, 0.18, 0.24)]))
        else:
            kit.add(
                pick(rng, (wood, lacquer))(rng), box(0.42, y * 0.96, h - 0.18).at(z=(h - 0.18) / 2)
            )
            kit.add(
                steel,
                box(0.02, 0.02, 0.15).at(0.22, 0.04, 0.45),
                box(0.02, 0.02, 0.15).at(0.22, -0.04, 0.45),
            )
            kit.add(BLACK, box(0.006, 0.008, 0.6).at(0.21, 0, 0.35))
        kit.add(
            glaze,
            stack(
                [
                    (0.6 * out, h - 0.2),
                    (out, h - 0.03),
                    (out, h),
                    (0.82 * out, h),
                    (0.4 * out, h - 0.14),
                ]
            ),
        )
        tap(-0.19, h, 0.8)
        if kit.chance("mirror", 0.4):
            kit.add(materials.tiles(rng), box(0.03, y * 1.4, 1.1).at(-0.26, 0, h + 0.5))
            kit.add(materials.DARK_GLASS, box(0.02, y * 0.8, 0.6).at(-0.24, 0, h + 0.6))
    elif kind == "toilet":
        kit.add(
            glaze,
            shapes.upright(
                [(0, 0.4, 0.26), (0.12, 0.32, 0.22), (0.28, 0.48, 0.34), (0.4, 0.54, 0.4)]
            ).at(x=0.05),
        )
        lid = pick(rng, (lacquer, wood, plastic))(rng)
        kit.add(
            lid,
            stack([(shapes.oval(0.56, 0.41, 28), 0.4), (shapes.oval(0.56, 0.41, 28), 0.43)]).at(
                x=0.05
            ),
        )
        if kit.chance("open", 0.4):
            kit.add(
                lid,
                stack([(shapes.oval(0.5, 0.4, 28), 0), (shapes.oval(0.5, 0.4, 28), 0.025)])
                .turned("y", -98)
                .at(-0.22, 0, 0.68),
            )
        kit.add(
            glaze,
            box(0.2, 0.44, 0.38, 0.03).at(-0.3, 0, 0.6),
            box(0.23, 0.47, 0.04, 0.01).at(-0.3, 0, 0.81),
        )
        kit.add(steel, cylinder(0.03, 0.03, 14).at(-0.3, 0, 0.84))
    elif kind in ("washer", "stove", "fridge"):
        skin = pick(rng, (lacquer, metal, lacquer))(rng)
        x, y, h = (
            0.6,
            kit.uniform("width", 0.55, 0.9),
            kit.uniform("height", 1.5, 1.9) if kind == "fridge" else 0.86,
        )
        kit.add(skin, box(x, y, h, 0.015).at(z=h / 2))
        if kind == "washer":
            r = 0.2
            kit.add(
                steel,
                lathe([(r, 0), (r + 0.05, 0), (r + 0.05, 0.03), (r, 0.04)], 32, loop=True)
                .turned("y", 90)
                .at(x / 2, 0, 0.4),
            )
            kit.add(materials.DARK_GLASS, ball(0.1, 2 * r, 2 * r, 20).at(x / 2, 0, 0.4))
        elif kind == "stove":
            kit.add(materials.DARK_GLASS, box(0.02, 0.75 * y, 0.36).at(x / 2, 0, 0.36))
            kit.add(
                steel,
                rod((x / 2 + 0.04, -0.35 * y, 0.62), (x / 2 + 0.04, 0.35 * y, 0.62), 0.012, 8),
            )
            for back in (-0.14, 0.14):
                kit.both(BLACK, cylinder(0.09, 0.02, 20).at(back, 0.24 * y, h + 0.01))
        else:
            split = kit.uniform("split", 0.3, 0.7) * h
            kit.add(BLACK, box(0.006, y, 0.012).at(x / 2, 0, split))
            for z in (split - 0.2, split + 0.2):
                kit.add(steel, box(0.05, 0.025, 0.3, 0.008).at(x / 2 + 0.02, 0.4 * y, z))
            for _ in range(kit.choose("magnets", 0, 2, 5)):
                kit.add(
                    materials.label(rng, "box"),
                    box(0.006, 0.09, 0.1).at(
                        x / 2 + 0.002, rng.uniform(-0.3, 0.3) * y, rng.uniform(0.5, 0.95) * h
                    ),
                )
        for k in range(4 if kind != "fridge" else 0):
            kit.add(
                steel,
                cylinder(0.025, 0.03, 12)
                .turned("y", 90)
                .at(x / 2 + 0.01, (k - 1.5) * 0.16 * y, 0.78),
            )
        if kind != "fridge":
            kit.add(materials.screen(rng), box(0.01, 0.16, 0.06).at(x / 2, 0.4 * y - 0.03, 0.72))
    elif kind == "fireplace":
        stone = pick(rng, (materials.marble, materials.masonry, wood))(rng)
        y, h = kit.uniform("width", 1.2, 1.7), kit.uniform("height", 1.0, 1.3)
        kit.both(stone, box(0.35, 0.22, h).at(0, y / 2 - 0.11, h / 2))
        kit.add(
            stone,
            box(0.35, y, 0.25).at(z=h - 0.12),
            box(0.48, 1.12 * y, 0.06, 0.01).at(z=h + 0.03),
            box(0.7, 1.05 * y, 0.05).at(0.15, 0, 0.02),
        )
        kit.add(materials.masonry(rng), box(0.05, y - 0.3, h - 0.2).at(-0.15, 0, h / 2))
        for k in range(4):
            kit.add(
                materials.bark(rng),
                cylinder(0.05, 0.45, 10)
                .turned("x", 90)
                .turned("z", rng.uniform(-30, 30))
                .at(rng.uniform(-0.05, 0.1), 0, 0.1 + 0.08 * (k // 2)),
            )
        if kit.chance("breast", 0.4):
            kit.add(materials.masonry(rng), box(0.32, 0.8 * y, 0.9).at(0, 0, h + 0.5))
    elif kind == "radiator":
        skin, count = paint(rng), kit.choose("fins", 8, 12, 18)
        h = kit.uniform("height", 0.5, 0.9)
        for k in range(count):
            kit.add(
                skin,
                pillow(0.14, 0.062, h, 0.03, 2).at(0, (k - (count - 1) / 2) * 0.075, 0.12 + h / 2),
            )
        wide = count * 0.075
        kit.add(skin, *[rod((0, -wide / 2, z), (0, wide / 2, z), 0.03, 10) for z in (0.2, h)])
        kit.add(
            steel,
            *[rod((0, s * 0.4 * wide, 0), (0, s * 0.4 * wide, 0.2), 0.02, 8) for s in (-1, 1)],
        )
    else:
        kit.add(
            pick(rng, (materials.marble, wood, materials.tiles))(rng),
            box(0.5, 0.7, 0.05).at(z=-0.025),
        )
        tap(-0.1, 0, kit.uniform("size", 1.5, 3.0))

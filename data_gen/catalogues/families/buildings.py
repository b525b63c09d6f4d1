"""Houses, towers, blocks of flats, churches, barns, castles, windmills, temples."""

import numpy as np

from data_gen.catalogues.families import materials, shapes
from data_gen.catalogues.families.kit import DARK_GLASS, Kit, around, lacquer, metal, pick, wood
from data_gen.catalogues.families.mapping import Fitted, Wrapped
from data_gen.catalogues.families.materials import Material
from data_gen.catalogues.solids import box, cylinder, lathe, prism, stack


def _wall(
    kit: Kit, material: Material, x: float, y: float, z: float, at: tuple[float, float, float]
) -> None:
    kit.add(material, box(x, y, z).at(at[0], at[1], at[2] + z / 2))


def _windows(
    kit: Kit, x: float, y: float, low: float, high: float, count: int, frame: Material
) -> None:
    """Adds windows on the four sides of a block around the origin."""
    tall = 0.5 * (high - low)
    z = (low + high) / 2
    for s in (-1, 1):
        for k in np.linspace(-0.5, 0.5, count + 2)[1:-1]:
            wide = 0.42 * y / count
            kit.add(frame, box(0.04, wide + 0.06, tall + 0.06).at(s * x / 2, k * y, z))
            kit.add(DARK_GLASS, box(0.06, wide, tall).at(s * x / 2, k * y, z))
            wide = 0.42 * x / count
            kit.add(frame, box(wide + 0.06, 0.04, tall + 0.06).at(k * x, s * y / 2, z))
            kit.add(DARK_GLASS, box(wide, 0.06, tall).at(k * x, s * y / 2, z))


def building(kit: Kit) -> None:
    """Gabled or hipped house, tower block, church, barn, castle, windmill, lighthouse, temple."""
    kind = kit.choose(
        "subtype",
        "house",
        "house",
        "hipped",
        "block",
        "skyscraper",
        "stepped",
        "church",
        "barn",
        "castle",
        "windmill",
        "lighthouse",
        "temple",
        "modern",
    )
    rng = kit.rng
    wall, roof = materials.masonry(rng), materials.roofing(rng)
    frame = pick(rng, (lacquer, wood))(rng)
    x, y = kit.uniform("depth", 2.5, 4.5), kit.uniform("width", 2.5, 5.0)
    top = 0.0
    if kit.chance("ground", 0.35):
        kit.add(materials.ground(rng), box(1.7 * x, 1.5 * y, 0.08).at(z=-0.04))
    if kind in ("house", "hipped", "barn"):
        floors = 1 if kind == "barn" else kit.choose("floors", 1, 2, 2, 3)
        top = floors * 1.3 * (1.5 if kind == "barn" else 1)
        _wall(kit, wall, x, y, top, (0, 0, 0))
        rise = kit.uniform("roof", 0.3, 0.7) * y / 2
        over = kit.uniform("eaves", 0.1, 0.3)
        if kind == "hipped":
            ridge = max(x - y, 0.1) if x > y else 0.3
            square = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) / 2
            eaves = square * [x + 2 * over, y + 2 * over]
            kit.add(
                roof,
                stack(
                    [(eaves, top), (eaves, top + 0.05), (square * [ridge, 0.12], top + rise + 0.1)]
                ),
            )
        else:
            sides = shapes.gable(x, y, rise, over, 0.1)
            kit.add(roof, *[s.at(z=top) for s in sides])
            gable = prism([(-y / 2, 0), (y / 2, 0), (0, rise)], x * 0.999).turned("z", 90)
            kit.add(wall, gable.at(z=top - 0.001))
        for floor in range(floors):
            if kind != "barn":
                low = 1.3 * floor + 0.25
                _windows(kit, x, y, low, low + 0.9, kit.choose(f"windows_{floor}", 2, 3, 4), frame)
        door = 0.9 if kind != "barn" else 1.6
        kit.add(
            wood(rng), box(0.12, door * 0.55, door).at(x / 2, rng.uniform(-0.1, 0.1) * y, door / 2)
        )
        if kit.chance("chimney", 0.6):
            _wall(
                kit,
                materials.masonry(rng),
                0.35,
                0.35,
                rise + 0.5,
                (rng.uniform(-0.3, 0.3) * x, 0.2 * y, top),
            )
        if kind == "house" and kit.chance("wing", 0.4):
            w = kit.uniform("wing_width", 1.2, 2.2)
            _wall(kit, wall, 0.6 * x, w, 1.2, (-0.1 * x, y / 2 + w / 2, 0))
            kit.add(
                roof, box(0.7 * x, w + 0.2, 0.12).turned("x", -8).at(-0.1 * x, y / 2 + w / 2, 1.32)
            )
        if kit.chance("porch", 0.35):
            for s in (-1, 1):
                kit.add(frame, cylinder(0.06, 1.1, 10).at(x / 2 + 0.8, s * 0.8, 0.55))
            kit.add(roof, box(1.1, 2.0, 0.1).turned("y", 8).at(x / 2 + 0.45, 0, 1.18))
    elif kind in ("block", "skyscraper", "stepped", "modern"):
        style = kit.choose("facade", "office", "flats", "glass", "house")
        height = {"block": 4.0, "skyscraper": 10.0, "stepped": 8.0, "modern": 2.6}[
            kind
        ] * kit.uniform("height", 0.8, 1.4)
        levels = 1 if kind in ("block", "skyscraper") else kit.choose("levels", 2, 3, 4)
        low, wide = 0.0, 1.0
        for _ in range(levels):
            tall = height / levels
            a, b = wide * x, wide * y
            shift = (
                (rng.uniform(-0.3, 0.3) * x, rng.uniform(-0.3, 0.3) * y)
                if kind == "modern"
                else (0.0, 0.0)
            )
            turns = max(round(b / 2.4), 1), max(round(tall / 2.4), 1)
            face = (
                materials.facade(rng, style, turns)
                if kind == "modern"
                else kit.once("face", lambda r: materials.facade(r, style, (1.0, 1.0)))
            )
            kit.add(face, box(a, b, tall).at(shift[0], shift[1], low + tall / 2), uv=Fitted(turns))
            kit.add(frame, box(1.04 * a, 1.04 * b, 0.12).at(shift[0], shift[1], low + tall + 0.05))
            low, wide = (
                low + tall,
                wide * (kit.uniform("step", 0.6, 0.85) if kind == "stepped" else 1),
            )
        kit.add(
            metal(rng), box(0.3 * x * wide, 0.3 * y * wide, 0.5).at(0.1 * x * wide, 0, low + 0.3)
        )
        if kit.chance("mast", 0.4):
            kit.add(metal(rng), lathe([(0.08, low), (0.02, low + 0.25 * height)], 8))
    elif kind == "church":
        nave = y * 1.4
        _wall(kit, wall, nave, 0.6 * y, 2.2, (-0.3, 0, 0))
        kit.add(roof, *[s.at(-0.3, 0, 2.2) for s in shapes.gable(nave, 0.6 * y, 1.2, 0.15, 0.1)])
        kit.add(
            wall,
            prism([(-0.3 * y, 0), (0.3 * y, 0), (0, 1.2)], nave * 0.99)
            .turned("z", 90)
            .at(-0.3, 0, 2.199),
        )
        side, high = kit.uniform("tower", 1.0, 1.5), kit.uniform("tower_height", 3.5, 5.5)
        _wall(kit, wall, side, side, high, (nave / 2, 0, 0))
        outline = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]]) * side * 0.55
        kit.add(
            roof,
            stack([(outline, high), (0.02 * outline, high + kit.uniform("spire", 1, 3))]).at(
                x=nave / 2
            ),
        )
        for k in np.linspace(-0.4, 0.3, 5):
            kit.add(DARK_GLASS, box(0.3, 0.6 * y + 0.06, 1.1).at(k * nave, 0, 1.2))
        kit.add(
            materials.label(rng, "clock"),
            box(0.04, 0.7, 0.7).at(nave / 2 + side / 2 + 0.01, 0, 0.8 * high),
        )
    elif kind == "castle":
        stone = materials.masonry(rng)
        high, r = kit.uniform("height", 1.8, 3.0), kit.uniform("tower", 0.45, 0.8)
        _wall(kit, stone, x, y, high * 0.7, (0, 0, 0))
        for sx in (-1, 1):
            for sy in (-1, 1):
                kit.add(stone, cylinder(r, high, 20).at(sx * x / 2, sy * y / 2, high / 2))
                if kit.visible.setdefault("pointed", bool(rng.random() < 0.5)):
                    kit.add(
                        roof,
                        lathe([(1.2 * r, high), (0, high + 2.2 * r)], 20).at(
                            sx * x / 2, sy * y / 2
                        ),
                    )
                else:
                    kit.add(
                        stone, cylinder(1.15 * r, 0.25, 20).at(sx * x / 2, sy * y / 2, high + 0.12)
                    )
        for k in np.linspace(-0.5, 0.5, 9):
            for s in (-1, 1):
                kit.add(stone, box(0.2, 0.06 * y, 0.25).at(s * 0.48 * x, k * y, high * 0.7 + 0.12))
                kit.add(stone, box(0.06 * x, 0.2, 0.25).at(k * x, s * 0.48 * y, high * 0.7 + 0.12))
        if kit.chance("keep", 0.6):
            _wall(kit, stone, 0.4 * x, 0.4 * y, high * 1.4, (0, 0, 0))
        kit.add(wood(rng), box(0.1, 0.8, 1.0).at(x / 2, 0, 0.5))
    elif kind in ("windmill", "lighthouse"):
        r, high = kit.uniform("radius", 0.8, 1.2), kit.uniform("height", 3.5, 6.0)
        bands = materials.pictured(
            materials.textures.pattern(
                "stripes", 3, [(0.9,) * 3, (0.65, 0.12, 0.1), (0.9,) * 3, (0.2,) * 3]
            ),
            Wrapped((2, 1.0)),
        )
        tower = bands if kind == "lighthouse" and rng.random() < 0.3 else wall
        kit.add(tower, lathe([(r, 0), (0.85 * r, 0.4 * high), (0.65 * r, high)], 28))
        if kind == "windmill":
            kit.add(
                roof, lathe([(0.75 * r, high), (0.6 * r, high + 0.4 * r), (0, high + 0.8 * r)], 24)
            )
            hub, turn = high - 0.1, kit.uniform("turn", 0, 90)
            kit.add(wood(rng), cylinder(0.1, 0.8, 12).turned("y", 90).at(0.65 * r + 0.25, 0, hub))
            blade = wood(rng)
            for angle in around(4, turn):
                long = 0.75 * high
                sail = box(0.04, 0.35, 0.8 * long).at(0, 0.12, 0.58 * long)
                for part in (sail, box(0.08, 0.08, long).at(z=long / 2)):
                    kit.add(blade, part.turned("x", angle).at(0.65 * r + 0.6, 0, hub))
        else:
            kit.add(metal(rng), cylinder(0.85 * r, 0.1, 28).at(z=high + 0.05))
            kit.add(DARK_GLASS, cylinder(0.45 * r, 0.8, 16).at(z=high + 0.45))
            kit.add(
                roof, lathe([(0.6 * r, high + 0.8), (0.3 * r, high + 1.1), (0, high + 1.3)], 24)
            )
        kit.add(wood(rng), box(0.2, 0.5, 0.9).at(0.95 * r, 0, 0.45))
        for k in (0.35, 0.6):
            kit.add(DARK_GLASS, box(0.3, 0.3, 0.4).at(0.72 * r, 0, k * high))
    else:
        stone = pick(rng, (materials.marble, materials.stone, materials.masonry))(rng)
        for k in range(3):
            kit.add(
                stone, box(x * (1.2 - 0.06 * k), y * (1.2 - 0.06 * k), 0.15).at(z=0.075 + 0.15 * k)
            )
        high, count = kit.uniform("height", 1.6, 2.6), kit.choose("columns", 4, 5, 6)
        shaft = lathe([(0.2, 0), (0.2, 0.1), (0.15, 0.15), (0.12, high - 0.15), (0.2, high)], 14)
        for s in np.linspace(-0.5, 0.5, count):
            for t in (-1, 1):
                kit.add(stone, shaft.at(t * 0.48 * x, s * y, 0.45))
                kit.add(stone, shaft.at(s * 0.96 * x, t * 0.5 * y, 0.45))
        kit.add(stone, box(1.12 * x, 1.12 * y, 0.3).at(z=0.45 + high + 0.15))
        kit.add(
            stone,
            prism([(-0.58 * y, 0), (0.58 * y, 0), (0, 0.35 * y)], 1.14 * x)
            .turned("z", 90)
            .at(z=0.75 + high),
        )
        _wall(kit, stone, 0.6 * x, 0.65 * y, high, (0, 0, 0.45))

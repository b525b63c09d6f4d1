"""Plants in pots, trees, cacti, flowers."""

import numpy as np

from data_gen.catalogues.families import materials, shapes
from data_gen.catalogues.families.kit import Kit, around, metal, pick, wood
from data_gen.catalogues.families.materials import Material
from data_gen.catalogues.solids import ball, box, cylinder, lathe, rounded, stack, tube


def pot(kit: Kit, radius: float, height: float) -> float:
    """Adds a pot with soil at the origin; returns the height of the soil."""
    skin = pick(
        kit.rng,
        (materials.terracotta, materials.ceramic, materials.stone, wood, materials.wicker, metal),
    )(kit.rng)
    shape = kit.choose("pot", "cone", "bowl", "square", "urn", "drum")
    soil = 0.88 * height
    if shape == "square":
        outer, inner = (
            rounded(2 * radius, 2 * radius, 0.02, 2),
            rounded(1.8 * radius, 1.8 * radius, 0.02, 2),
        )
        kit.add(
            skin, stack([(0.8 * outer, 0), (outer, height), (inner, height), (inner, soil - 0.02)])
        )
        kit.add(materials.soil(kit.rng), stack([(inner * 0.99, soil - 0.03), (inner * 0.99, soil)]))
        return soil
    profile = {
        "cone": [(0.68, 0), (0.95, 0.8), (1.04, 0.8), (1.04, 1.0)],
        "bowl": shapes.curve([(0.55, 0), (0.95, 0.35), (1.06, 0.75), (1.0, 1.0)]),
        "urn": shapes.curve([(0.6, 0), (0.45, 0.12), (0.95, 0.5), (0.85, 0.85), (1.05, 1.0)]),
        "drum": [(1.0, 0), (1.0, 1.0)],
    }[shape]
    outside = [(r * radius, z * height) for r, z in profile]
    kit.add(skin, shapes.vessel(outside, 0.08 * radius, soil - 0.03))
    top = 0.9 * np.interp(soil, [z for _, z in outside], [r for r, _ in outside])
    kit.add(materials.soil(kit.rng), lathe([(top, soil - 0.02), (top, soil), (0, soil + 0.01)], 20))
    return soil


def _branches(
    kit: Kit, wooden: Material, base: float, height: float, radius: float, spread: float, count: int
) -> list[np.ndarray]:
    """Adds a branching trunk; returns the tips."""
    lean = kit.rng.normal(0, 0.05 * height, 2)
    fork = np.array([*lean, base + height * kit.rng.uniform(0.45, 0.65)])
    kit.add(
        wooden,
        shapes.swept(
            [(0, 0, base), (*(lean * 0.3), base + 0.3 * height), fork],
            [radius, 0.75 * radius, 0.6 * radius],
            10,
        ),
    )
    tips = []
    for angle in np.radians(around(count, kit.rng.uniform(0, 360))):
        out = spread * kit.rng.uniform(0.5, 1.0)
        up = (base + height - fork[2]) * kit.rng.uniform(0.7, 1.05)
        tip = fork + np.array([out * np.cos(angle), out * np.sin(angle), up])
        middle = (fork + tip) / 2 + np.array([0, 0, -0.1 * out])
        kit.add(
            wooden,
            shapes.swept(
                [fork - np.array([0, 0, 0.02]), middle, tip],
                [0.55 * radius, 0.35 * radius, 0.15 * radius],
                7,
            ),
        )
        tips.append(tip)
    return tips


def plant(kit: Kit) -> None:
    """Leafy, palm, cactus, bush, tree, conifer, flowers, snake plant; in a pot or on ground."""
    kind = kit.choose(
        "subtype",
        "leafy",
        "leafy",
        "palm",
        "cactus",
        "bush",
        "tree",
        "tree",
        "conifer",
        "flowers",
        "snake",
    )
    rng = kit.rng
    green = materials.leaf(rng)
    base = 0.0
    if kind in ("leafy", "cactus", "bush", "flowers", "snake") or kit.chance("potted", 0.3):
        radius = kit.uniform("pot_radius", 0.14, 0.24)
        base = pot(kit, radius, radius * kit.uniform("pot_height", 1.2, 2.6))
    elif kit.chance("ground", 0.4):
        wide = kit.uniform("ground_width", 0.5, 1.0)
        kit.add(materials.ground(rng), lathe([(wide, -0.04), (wide, 0), (0.6 * wide, 0.02)], 24))
    height = kit.uniform("height", 0.6, 1.6)
    if kind == "leafy":
        kit.add(
            green,
            *[
                p.at(z=base)
                for p in shapes.heap(
                    rng,
                    kit.choose("leaves", 9, 14, 20, 28),
                    height * 0.8,
                    kit.uniform("leaf_width", 0.04, 0.2),
                    kit.uniform("curl", 0.1, 0.8),
                )
            ],
        )
    elif kind == "palm":
        stem = materials.bark(rng)
        lean = kit.uniform("lean", -0.3, 0.3)
        top = (lean, 0.0, base + height)
        kit.add(
            stem,
            shapes.swept(
                [(0, 0, base - 0.02), (0.15 * lean, 0, base + height * 0.5), top],
                [0.07, 0.05, 0.045],
                10,
            ),
        )
        fronds = shapes.heap(
            rng,
            kit.choose("fronds", 9, 12, 16),
            height * 0.6,
            kit.uniform("leaf_width", 0.06, 0.14),
            kit.uniform("curl", 0.6, 1.1),
        )
        kit.add(green, *[p.at(*top) for p in fronds])
    elif kind == "cactus":
        skin = materials.leaf(rng)
        thick = kit.uniform("thickness", 0.06, 0.12)

        def column(points: list[tuple[float, float, float]], r: float) -> None:
            kit.add(skin, shapes.swept(points, [r, r, r, 0.9 * r, 0.3 * r], 12))

        if kit.chance("round", 0.3):
            ribs = kit.choose("ribs", 8, 11)
            wide = 0.3 * height
            body = ball(2 * wide, 2 * wide, 1.8 * wide, 4 * ribs)

            def rib(v: np.ndarray) -> np.ndarray:
                factor = 1 + 0.07 * np.cos(ribs * np.arctan2(v[:, 1], v[:, 0]))
                return v * np.stack([factor, factor, np.ones(len(v))], axis=1)

            kit.add(skin, body.bent(rib).at(z=base + 0.8 * wide))
        else:
            column([(0, 0, base - 0.02), (0, 0, base + 0.4 * height), (0, 0, base + height)], thick)
            for s in (-1, 1)[: kit.choose("arms", 1, 2)]:
                z, out = base + height * rng.uniform(0.25, 0.5), s * rng.uniform(2.4, 3.4) * thick
                column([(0, 0, z), (0, out, z + 0.04), (0, out, z + height * 0.35)], 0.65 * thick)
    elif kind == "bush":
        for _ in range(kit.choose("clumps", 3, 5, 8)):
            size = height * rng.uniform(0.3, 0.55)
            x, y = rng.normal(0, 0.12 * height, 2)
            kit.add(
                materials.leaves(rng) if rng.random() < 0.2 else green,
                shapes.blob(rng, size, size, size, 0.3).at(
                    x, y, base + rng.uniform(0.3, 0.8) * size
                ),
            )
        kit.add(
            materials.leaves(rng),
            shapes.blob(rng, 0.5 * height, 0.5 * height, 0.6 * height).at(z=base + 0.25 * height),
        )
    elif kind == "tree":
        crown = materials.leaves(rng)
        tall = height * 1.4
        spread = kit.uniform("spread", 0.3, 0.6) * tall
        tips = _branches(
            kit,
            materials.bark(rng),
            base - 0.02,
            tall * 0.75,
            0.045 * tall,
            spread * 0.7,
            kit.choose("forks", 3, 4, 5),
        )
        if not kit.chance("bare", 0.12):
            for tip in [*tips, np.mean(tips, axis=0) + np.array([0, 0, 0.15 * tall])]:
                size = spread * rng.uniform(0.7, 1.2)
                kit.add(crown, shapes.blob(rng, size, size, 0.8 * size, 0.3).at(*tip))
    elif kind == "conifer":
        tall = height * 1.5
        kit.add(materials.bark(rng), cylinder(0.05 * tall, 0.3 * tall, 10).at(z=base + 0.14 * tall))
        skin = materials.leaves(rng)
        tiers = kit.choose("tiers", 1, 3, 4, 5)
        wide = kit.uniform("width", 0.22, 0.36) * tall
        for k in range(tiers):
            low = base + tall * (0.15 + 0.75 * k / tiers)
            r = wide * (1 - 0.8 * k / tiers)
            cone = lathe(
                [
                    (0.3 * r, 0.03 * tall),
                    (r, 0),
                    (0.45 * r, 0.55 * tall / tiers),
                    (0.0, (1.15 if k == tiers - 1 else 1.0) * tall * 0.95 / tiers),
                ],
                18,
            )
            kit.add(skin, cone.at(z=low))
    elif kind == "flowers":
        petals, heart = [materials.fabric(rng) for _ in range(2)], materials.soil(rng)
        for k in range(kit.choose("stems", 5, 8, 12)):
            angle, out = 2.4 * k, rng.uniform(0.05, 0.3) * height
            tip = np.array(
                [out * np.cos(angle), out * np.sin(angle), base + height * rng.uniform(0.4, 0.75)]
            )
            kit.add(
                green,
                shapes.swept(
                    [(0, 0, base - 0.02), (*(0.3 * tip[:2]), (base + tip[2]) / 2), tip],
                    [0.008, 0.008, 0.006],
                    5,
                ),
            )
            size = rng.uniform(0.05, 0.09)
            kit.add(
                pick(rng, petals),
                lathe(
                    [
                        (0, 0),
                        (0.6 * size, 0.1 * size),
                        (size, 0.6 * size),
                        (0.5 * size, 0.35 * size),
                        (0, 0.3 * size),
                    ],
                    10,
                ).at(*tip),
            )
            kit.add(
                heart,
                ball(0.7 * size, 0.7 * size, 0.6 * size, 8).at(tip[0], tip[1], tip[2] + 0.4 * size),
            )
        kit.add(green, *[p.at(z=base) for p in shapes.heap(rng, 8, height * 0.4, 0.06, 0.3)])
    else:
        for _ in range(kit.choose("blades", 7, 11, 16)):
            x, y = rng.normal(0, 0.04, 2)
            long, wide = height * rng.uniform(0.5, 1.0), rng.uniform(0.04, 0.08)
            blade = tube(
                [(0, 0, 0), (0.02, 0, 0.5 * long), (0.05 * rng.normal(), 0, long)],
                [0.5 * wide, 0.6 * wide, 0.03 * wide],
                8,
            )
            kit.add(
                green,
                blade.scaled(0.3, 1, 1)
                .turned("z", rng.uniform(0, 360))
                .turned("y", rng.normal(0, 9))
                .at(x, y, base - 0.02),
            )
    if base and kit.chance("saucer", 0.2):
        kit.add(box_stand(kit), box(0.6, 0.6, 0.03, 0.01).at(z=-0.015))


def box_stand(kit: Kit) -> Material:
    """Adds an optional support of the pot."""
    material: Material = pick(kit.rng, (wood, materials.tiles, materials.marble))(kit.rng)
    return material

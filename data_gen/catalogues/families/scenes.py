"""Several objects on a base."""

from collections.abc import Callable

import numpy as np

from data_gen.catalogues.families import (
    buildings,
    figures,
    household,
    materials,
    plants,
    transport,
    vessels,
)
from data_gen.catalogues.families.kit import Kit, fabric, lacquer, metal, pick, wood
from data_gen.catalogues.solids import Solid, box, cylinder, lathe, pillow

# Objects that would exceed this number of faces are left out.
_MAX_FACES = 16_000

Family = Callable[[Kit], None]


def _put(
    kit: Kit, family: Family, size: float, x: float, y: float, z: float, turn: float = 0.0
) -> None:
    """Adds an object of a family at a position, scaled to a largest side of `size`."""
    inner = Kit(kit.rng, kit.rng)
    family(inner)
    low, high = inner.bounds()
    scale = size / float((high - low).max())
    centre = (low + high) / 2
    if kit.num_faces + inner.num_faces > _MAX_FACES:
        return

    def place(part: Solid) -> Solid:
        moved = part.at(-centre[0], -centre[1], -low[2]).scaled(scale, scale, scale)
        return moved.turned("z", turn).at(x, y, z)

    kit.take(inner, place)


def _table(kit: Kit, x: float, y: float, height: float) -> None:
    top, leg = pick(kit.rng, (wood, wood, lacquer, materials.marble))(kit.rng), wood(kit.rng)
    if kit.chance("round_table", 0.35):
        kit.add(top, cylinder(max(x, y) / 2, 0.04, 36, 0.01).at(z=height))
        kit.add(
            leg,
            lathe(
                [
                    (0.3 * x, 0),
                    (0.28 * x, 0.04),
                    (0.05, 0.12),
                    (0.05, height - 0.05),
                    (0.12, height - 0.02),
                ],
                20,
            ),
        )
    else:
        kit.add(top, box(x, y, 0.05, 0.008).at(z=height))
        for sx in (-1, 1):
            kit.both(leg, box(0.06, 0.06, height).at(sx * 0.44 * x, 0.45 * y, height / 2))


def _seat(kit: Kit, x: float, y: float, turn: float) -> None:
    """A plain chair, facing +x before its rotation."""
    frame, cover = kit.once("chair_frame", wood), kit.once("chair_cover", fabric)
    parts = [box(0.04, 0.04, 0.45).at(sx * 0.19, s * 0.19, 0.22) for sx in (-1, 1) for s in (-1, 1)]
    parts += [
        box(0.03, 0.42, 0.12).at(-0.19, 0, 0.9),
        *[box(0.03, 0.03, 0.5).at(-0.19, s * 0.19, 0.68) for s in (-1, 1)],
    ]
    kit.add(frame, *[p.turned("z", turn).at(x, y) for p in parts])
    kit.add(cover, pillow(0.44, 0.44, 0.07, 0.03).at(z=0.46).turned("z", turn).at(x, y))


def scene(kit: Kit) -> None:
    """Dining group, still life, garden, shelf, room corner, street, market stall, heap of boxes."""
    kind = kit.choose(
        "subtype", "dining", "still_life", "garden", "shelf", "room", "boxes", "stall", "street"
    )
    rng = kit.rng
    if kind == "dining":
        x, y = kit.uniform("depth", 0.8, 1.1), kit.uniform("width", 1.0, 1.9)
        _table(kit, x, y, 0.74)
        for s in (-1, 1):
            for k in np.linspace(
                -0.5, 0.5, kit.visible.setdefault("chairs", int(rng.integers(1, 4))) + 2
            )[1:-1]:
                _seat(kit, s * (x / 2 + 0.12), k * y * 1.2, 90 + 90 * s)
        for _ in range(kit.choose("things", 1, 2, 4)):
            _put(
                kit,
                pick(rng, (vessels.vase, vessels.cup, vessels.bottle)),
                rng.uniform(0.15, 0.3),
                rng.uniform(-0.3, 0.3) * x,
                rng.uniform(-0.35, 0.35) * y,
                0.765,
            )
        if kit.chance("rug", 0.4):
            kit.add(materials.carpet(rng), box(1.9 * x, 1.4 * y, 0.02).at(z=-0.01))
    elif kind == "still_life":
        kit.add(materials.ground(rng, indoors=True), box(1.4, 1.8, 0.06, 0.01).at(z=-0.03))
        for k in range(kit.choose("things", 3, 4, 5)):
            family = pick(
                rng, (vessels.vase, vessels.cup, vessels.bottle, household.book, household.clock)
            )
            _put(
                kit,
                family,
                rng.uniform(0.35, 0.8),
                0.35 * (-1) ** k,
                (k - 2) * 0.36 + rng.normal(0, 0.05),
                0.0,
                rng.uniform(-60, 60),
            )
    elif kind == "garden":
        x, y = kit.uniform("depth", 3, 5), kit.uniform("width", 4, 7)
        kit.add(materials.grass(rng), box(x, y, 0.1).at(z=-0.05))
        if kit.chance("house", 0.7):
            _put(kit, buildings.building, 2.4, -0.15 * x, -0.2 * y, 0)
        for _ in range(kit.choose("plants", 3, 5, 7)):
            _put(
                kit,
                plants.plant,
                rng.uniform(0.5, 1.6),
                rng.uniform(-0.42, 0.42) * x,
                rng.uniform(-0.42, 0.45) * y,
                0,
                rng.uniform(0, 360),
            )
        if kit.chance("people", 0.4):
            _put(kit, figures.figure, 0.8, 0.35 * x, 0.1 * y, 0)
        for s in (-1, 1):
            if kit.visible.setdefault("fence", bool(rng.random() < 0.4)):
                post = kit.once("fence_wood", wood)
                for k in np.linspace(-0.48, 0.48, 14):
                    kit.add(post, box(0.05, 0.18, 0.5).at(s * 0.49 * x, k * y, 0.25))
    elif kind == "shelf":
        board = pick(rng, (wood, lacquer))(rng)
        y, levels = kit.uniform("width", 0.8, 1.5), kit.choose("levels", 2, 3, 4)
        gap = 0.42
        for level in range(levels + 1):
            kit.add(board, box(0.34, y, 0.03).at(z=gap * level))
        kit.both(board, box(0.34, 0.03, gap * levels + 0.03).at(0, y / 2, gap * levels / 2))
        kit.add(board, box(0.02, y, gap * levels).at(-0.16, 0, gap * levels / 2))
        for level in range(levels):
            place = -0.42 * y
            while place < 0.4 * y:
                if rng.random() < 0.55:
                    thick, tall = rng.uniform(0.03, 0.07), rng.uniform(0.22, 0.36)
                    for material, part in household.one_book(kit, tall, 0.22, thick):
                        turned = part.turned("z", 90).turned("y", -90).turned("z", 90)
                        kit.add(material, turned.at(0.02, place, gap * level + 0.015 + tall / 2))
                    place += thick + 0.004
                else:
                    _put(
                        kit,
                        pick(rng, (vessels.vase, vessels.bottle, household.clock)),
                        0.26,
                        0,
                        place + 0.13,
                        gap * level + 0.016,
                    )
                    place += 0.3
                if kit.num_parts > 260:
                    break
    elif kind == "room":
        kit.add(materials.ground(rng, indoors=True), box(2.4, 2.8, 0.06).at(z=-0.03))
        kit.add(materials.masonry(rng), box(0.06, 2.8, 1.6).at(-1.2, 0, 0.8))
        if kit.chance("second_wall", 0.6):
            kit.add(materials.masonry(rng), box(2.4, 0.06, 1.6).at(0, -1.4, 0.8))
        _put(kit, pick(rng, (household.bed, household.fixture)), 1.7, -0.3, -0.4, 0)
        _put(kit, plants.plant, 0.9, -0.8, 1.0, 0)
        kit.add(materials.screen(rng), box(0.03, 0.9, 0.6).at(-1.16, 0.5, 1.1))
        if kit.chance("rug", 0.6):
            kit.add(materials.carpet(rng), box(0.8, 1.2, 0.02).at(0.6, 0.3, 0.01))
    elif kind == "boxes":
        # A rack of pallets, so that the upper objects stand at heights that do not depend on the
        # lower ones.
        board, post = wood(rng), metal(rng)
        rows, wide, gap = kit.choose("rows", 1, 2, 3), kit.choose("columns", 2, 3), 1.05
        for row in range(rows):
            low = gap * row
            if row or rows > 1:
                kit.add(board, box(0.95, wide, 0.06).at(z=low - 0.03))
            for k in range(wide):
                y = k - (wide - 1) / 2 + rng.normal(0, 0.02)
                _put(kit, household.container, rng.uniform(0.6, 0.9), 0, y, low, rng.normal(0, 6))
        for sx in (-1, 1) if rows > 1 else ():
            kit.both(post, box(0.06, 0.06, gap * rows).at(0.47 * sx, wide / 2, gap * (rows / 2)))
    elif kind == "stall":
        frame, roof = wood(rng), fabric(rng)
        for sx in (-1, 1):
            kit.both(frame, box(0.06, 0.06, 1.9).at(0.5 * sx, 0.9, 0.95))
        kit.add(roof, box(1.5, 2.2, 0.05).turned("y", 12).at(0.1, 0, 1.9))
        kit.add(frame, box(0.9, 1.8, 0.05).at(0.05, 0, 0.8), box(0.05, 1.8, 0.75).at(0.45, 0, 0.4))
        for k in range(5):
            _put(
                kit,
                pick(rng, (vessels.vase, household.container, vessels.bottle)),
                0.33,
                0.1,
                (k - 2) * 0.36,
                0.83,
            )
    else:
        kit.add(materials.stone(rng), box(4, 6, 0.1).at(z=-0.05))
        kit.add(
            materials.shaded(
                (0.28, 0.28, 0.28), materials.textures.stone("granite", 0), materials.Tiled(1.2)
            ),
            box(1.6, 6, 0.04).at(1.0, 0, 0.01),
        )
        for k in (-1, 0, 1):
            _put(kit, buildings.building, rng.uniform(1.8, 3.4), -1.0, 1.9 * k, 0)
        if kit.chance("cycle", 0.6):
            _put(kit, transport.cycle, 0.8, 0.9, rng.uniform(-2, 2), 0.03, 90)

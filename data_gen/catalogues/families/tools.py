"""Hand tools and blades; guitars and other string instruments."""

import numpy as np

from data_gen.catalogues.families import materials, shapes
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    GOLD,
    WHITE,
    Kit,
    lacquer,
    metal,
    paint,
    pick,
    plastic,
    wood,
)
from data_gen.catalogues.solids import (
    Solid,
    box,
    cylinder,
    inset,
    lathe,
    loft,
    prism,
    rod,
    smooth_path,
    tube,
)


def _grip(kit: Kit, length: float, thick: float) -> Solid:
    """A handle along y, from 0 to -length."""
    belly = kit.uniform("grip_belly", 1.0, 1.35)
    path = [(0, 0, 0), (0, -0.35 * length, 0), (0, -0.7 * length, 0), (0, -length, 0)]
    return shapes.swept(path, [thick * 0.85, thick * belly, thick, thick * 1.05], 12)


def _blade(outline: list[tuple[float, float]], thick: float) -> Solid:
    """A flat blade with sharp edges; the outline is (y, z)."""
    flat = np.array(outline)
    inner = inset(flat, 0.25 * float(np.ptp(flat, axis=0).min()))
    rings = [
        np.column_stack([np.full(len(p), x), p])
        for p, x in (
            (inner, -thick / 2),
            (flat, -0.05 * thick),
            (flat, 0.05 * thick),
            (inner, thick / 2),
        )
    ]
    return loft(rings)


def tool(kit: Kit) -> None:
    """Hammer, axe, screwdriver, saw, wrench, shovel, knife, sword, brush, pliers, drill, rake."""
    kind = kit.choose(
        "subtype",
        "hammer",
        "axe",
        "screwdriver",
        "saw",
        "wrench",
        "shovel",
        "knife",
        "sword",
        "brush",
        "pliers",
        "drill",
        "rake",
    )
    rng = kit.rng
    handle = pick(rng, (wood, wood, plastic, paint))(rng)
    steel = pick(rng, (metal, metal, materials.plating))(rng)
    long, thick = kit.uniform("length", 0.55, 1.0), kit.uniform("thickness", 0.025, 0.045)
    if kind in ("hammer", "axe"):
        kit.add(handle, _grip(kit, long, thick))
        if kind == "hammer":
            head = kit.uniform("head", 0.1, 0.2)
            style = kit.choose("style", "claw", "sledge", "ball")
            face = 1.4 * thick
            kit.add(steel, box(2.4 * thick, 2.6 * thick, 2 * head * 0.6, 0.01))
            kit.add(steel, cylinder(face, 0.6 * head, 16, 0.008).at(z=0.75 * head))
            if style == "claw":
                for s in (-1, 1):
                    claw = [
                        (s * 0.4 * thick, 0, -0.5 * head),
                        (s * 0.5 * thick, 0, -0.9 * head),
                        (s * 0.7 * thick, -0.12, -1.2 * head),
                    ]
                    kit.add(steel, shapes.swept(claw, [0.8 * thick, 0.5 * thick, 0.2 * thick], 8))
            elif style == "ball":
                kit.add(
                    steel,
                    lathe(
                        [
                            (face, -0.6 * head),
                            (face, -0.8 * head),
                            (0.7 * face, -1.1 * head),
                            (0, -1.15 * head),
                        ],
                        14,
                    ),
                )
            else:
                kit.add(steel, cylinder(face, 0.6 * head, 16, 0.008).at(z=-0.75 * head))
        else:
            wide, reach = kit.uniform("edge", 0.1, 0.2), kit.uniform("reach", 0.15, 0.28)
            outline = [
                (-0.05, -0.06),
                (0.05, -0.06),
                (0.05, 0.02),
                (wide, reach),
                (0, reach * 1.07),
                (-wide, reach),
            ]
            kit.add(steel, _blade(outline, 2.2 * thick))
            if kit.chance("double", 0.3):
                kit.add(steel, _blade([(y, -z) for y, z in outline], 2.2 * thick))
    elif kind == "screwdriver":
        kit.add(
            handle,
            lathe(
                [
                    (0.4 * thick, 0),
                    (1.3 * thick, 0.03),
                    (1.1 * thick, 0.1),
                    (1.5 * thick, 0.3 * long),
                    (0.9 * thick, 0.36 * long),
                    (0, 0.37 * long),
                ],
                12,
            ).turned("x", 90),
        )
        kit.add(CHROME, rod((0, 0, 0), (0, long * 0.55, 0), 0.3 * thick, 10))
        kit.add(CHROME, box(0.12 * thick, 0.08, 0.8 * thick).at(0, 0.57 * long, 0))
    elif kind == "saw":
        high = kit.uniform("blade", 0.12, 0.22)
        teeth = np.arange(0, long, 0.04)
        low = [
            (y + d, -0.025 * (d == 0) + high * 0.15 * y / long) for y in teeth for d in (0.0, 0.02)
        ]
        kit.add(
            steel,
            prism([*low, (long, 0.5 * high), (long, 0.65 * high), (0, high)], 0.012).turned(
                "z", 90
            ),
        )
        loop = [
            (0, 0.0, 0.1 * high),
            (0, -0.1, -0.02),
            (0, -0.2, 0.2 * high),
            (0, -0.18, 0.8 * high),
            (0, -0.08, high),
            (0, 0.02, 0.9 * high),
        ]
        kit.add(handle, tube(smooth_path(loop, 4), thick * 0.9, 10))
        kit.add(handle, box(1.5 * thick, 0.12, 0.9 * high, 0.01).at(0, 0.02, 0.5 * high))
    elif kind in ("wrench", "pliers"):
        size = kit.uniform("jaw", 0.07, 0.12)
        if kind == "wrench":
            kit.add(steel, box(1.2 * thick, 0.8 * long, 1.3 * thick, 0.01).at(0, 0.4 * long, 0))
            jaw = [
                (0, -0.9),
                (0.7, -0.75),
                (1.2, -0.9),
                (1.3, -0.45),
                (0.6, -0.35),
                (0.6, 0.35),
                (1.3, 0.45),
                (1.2, 0.9),
                (0.7, 0.75),
                (0, 0.9),
                (-0.6, 0.3),
                (-0.6, -0.3),
            ]
            part = prism([(a * size, b * size) for a, b in jaw], 1.4 * thick).turned("z", 90)
            kit.add(steel, part.at(0, 0.8 * long, 0))
            if kit.chance("double", 0.6):
                kit.add(steel, part.turned("z", 180))
            else:
                kit.add(
                    steel,
                    lathe(
                        [
                            (0.55 * size, -0.6 * thick),
                            (size, -0.6 * thick),
                            (size, 0.6 * thick),
                            (0.55 * size, 0.6 * thick),
                        ],
                        20,
                        loop=True,
                    ).turned("y", 90),
                )
        else:
            for s in (-1, 1):
                kit.add(
                    handle,
                    shapes.swept(
                        [
                            (s * 0.01, 0, s * 0.04),
                            (0, -0.2 * long, s * 0.12),
                            (0, -0.6 * long, s * 0.1),
                        ],
                        [0.8 * thick, thick, 0.9 * thick],
                    ),
                )
                kit.add(
                    steel,
                    _blade(
                        [
                            (-0.05, s * 0.05),
                            (0.0, s * 0.09),
                            (0.28 * long, s * 0.02),
                            (0.28 * long, 0.0),
                            (0.02, 0.0),
                        ][::-s],
                        1.6 * thick,
                    ),
                )
            kit.add(steel, cylinder(0.06, 2 * thick, 16).turned("y", 90))
    elif kind in ("shovel", "rake"):
        kit.add(handle, rod((0, 0, 0), (0, -1.3, 0), 0.022, 10))
        kit.add(
            handle,
            tube(
                smooth_path(
                    [
                        (0, -1.28, 0),
                        (0, -1.38, 0.08),
                        (0, -1.46, 0.07),
                        (0, -1.46, -0.07),
                        (0, -1.38, -0.08),
                        (0, -1.28, -0.012),
                    ],
                    3,
                ),
                0.018,
                8,
            ),
        )
        if kind == "shovel":
            w = kit.uniform("blade", 0.1, 0.17)
            tip = kit.uniform("tip", 0.0, 0.14)
            outline = [(0, -w), (0.25, -w), (0.28 + tip, 0), (0.25, w), (0, w)]
            part = prism(outline, 0.02).turned("z", 90)
            kit.add(
                steel,
                part.bent(
                    lambda v: v + np.stack([1.6 * v[:, 2] ** 2, 0 * v[:, 0], 0 * v[:, 0]], axis=1)
                ),
            )
            kit.add(steel, cylinder(0.03, 0.2, 10).turned("x", 90).at(0, -0.05, 0))
        else:
            wide = kit.uniform("width", 0.25, 0.45)
            kit.add(steel, rod((0, 0, -wide), (0, 0, wide), 0.016, 8))
            for z in np.linspace(-wide, wide, kit.choose("tines", 8, 12, 16)):
                kit.add(
                    steel,
                    shapes.swept(
                        [(0, 0, z), (0.03, 0.06, z), (0.14, 0.08, z)], [0.01, 0.009, 0.005], 6
                    ),
                )
    elif kind in ("knife", "sword"):
        reach = long * (0.45 if kind == "knife" else 1.2)
        w = kit.uniform("blade", 0.025, 0.06)
        curve = kit.uniform("curve", -0.1, 0.1) if kind == "sword" else 0.0
        outline = [(0, -w), (0.75 * reach, -w), (reach, 0.4 * w), (0.8 * reach, w), (0, w)]
        bend = _blade(outline, 0.4 * w).bent(
            lambda v: v + np.stack([0 * v[:, 0], 0 * v[:, 0], curve * v[:, 1] ** 2], axis=1)
        )
        kit.add(CHROME if rng.random() < 0.5 else steel, bend)
        grip = pick(rng, (materials.hide, wood, plastic))(rng)
        kit.add(grip, _grip(kit, 0.22, 0.02 + 0.2 * w))
        guard = GOLD if rng.random() < 0.4 else steel
        if kind == "sword":
            kit.add(guard, box(0.05, 0.035, kit.uniform("guard", 0.12, 0.3), 0.01))
            kit.add(guard, cylinder(0.035, 0.04, 14).turned("x", 90).at(0, -0.24, 0))
        else:
            kit.add(guard, box(0.05, 0.02, 2.4 * w, 0.004))
    elif kind == "brush":
        kit.add(handle, _grip(kit, long * 0.6, thick))
        bristle = materials.shaded(
            (0.55, 0.42, 0.25), materials.textures.foliage("straw", 1), materials.Tiled(0.9, True)
        )
        wide = kit.uniform("width", 0.05, 0.2)
        kit.add(steel, box(2 * thick, 0.1, 2 * wide, 0.01).at(0, 0.05, 0))
        kit.add(bristle, box(1.6 * thick, 0.22, 1.9 * wide, 0.01).at(0, 0.2, 0))
        kit.add(
            pick(rng, (paint, plastic))(rng),
            box(1.65 * thick, 0.08, 1.92 * wide, 0.01).at(0, 0.28, 0),
        )
    else:
        shell, dark = paint(rng), BLACK
        kit.add(
            shell,
            lathe([(0, -0.3), (0.11, -0.28), (0.12, 0), (0.1, 0.15), (0.05, 0.22), (0, 0.22)], 18)
            .turned("x", -90)
            .at(z=0.32),
        )
        kit.add(
            dark,
            lathe([(0.05, 0.2), (0.06, 0.25), (0.03, 0.34), (0, 0.35)], 14)
            .turned("x", -90)
            .at(z=0.32),
        )
        kit.add(CHROME, rod((0, 0.3, 0.32), (0, 0.65, 0.32), 0.014, 8))
        kit.add(
            dark,
            shapes.swept(
                [(0, -0.1, 0.28), (0, -0.14, 0.1), (0, -0.17, -0.05)], [0.06, 0.055, 0.06], 12
            ),
        )
        kit.add(shell, box(0.16, 0.26, 0.12, 0.02).at(0, -0.14, -0.1))
        kit.add(materials.label(rng, "box"), box(0.236, 0.2, 0.08).at(0, -0.06, 0.32))
    if kind == "drill" or kit.chance("flat", 0.7):
        return
    # The code above builds tools that stand on their narrow side. All drills and most other tools
    # stay like this; the others are tilted.
    kit.turn_all("x", kit.uniform("lean", 15, 75))


def guitar(kit: Kit) -> None:
    """Acoustic, electric, bass, violin, cello, banjo; on the floor or on a stand."""
    kind = kit.choose(
        "subtype",
        "acoustic",
        "acoustic",
        "electric",
        "electric",
        "bass",
        "violin",
        "cello",
        "banjo",
    )
    rng = kit.rng
    face = (
        wood(rng)
        if kind in ("acoustic", "violin", "cello")
        else pick(rng, (paint, lacquer, wood))(rng)
    )
    side, dark = wood(rng), materials.wood(rng)
    w, h = kit.uniform("width", 0.38, 0.46), kit.uniform("body", 0.48, 0.56)
    if kind in ("violin", "cello"):
        w *= 0.9
    waist, upper = kit.uniform("waist", 0.55, 0.75), kit.uniform("upper", 0.7, 0.85)
    t = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    if kind == "banjo":
        y, z = 0.5 * w * np.cos(t), 0.5 * w * np.sin(t) + 0.5 * w
        h = w
    elif kind in ("electric", "bass"):
        horn = kit.uniform("horn", 0.1, 0.25)
        half = np.interp(np.sin(t), [-1, -0.5, 0.1, 0.6, 1], [0.6, 1.0, waist, upper, 0.35])
        y, z = 0.5 * w * half * np.cos(t), 0.5 * h * (1 + np.sin(t))
        z = (
            z
            + horn * np.exp(-(((t - 0.9) / 0.35) ** 2))
            + 0.6 * horn * np.exp(-(((t - np.pi + 0.9) / 0.35) ** 2))
        )
    else:
        half = np.interp(
            np.sin(t), [-1, -0.75, -0.3, 0.2, 0.7, 1], [0.75, 1.0, 0.95, waist, upper, 0.6]
        )
        y, z = 0.5 * w * half * np.cos(t), 0.5 * h * (1 + np.sin(t))
    outline = np.stack([y, z], axis=1)
    deep = kit.uniform("depth", 0.09, 0.13) if kind in ("acoustic", "banjo", "cello") else 0.045
    bulge = 0.012 if kind in ("violin", "cello") else 0.0

    def ring(x: float, scale: float) -> np.ndarray:
        centre = outline.mean(axis=0)
        return np.column_stack([np.full(len(outline), x), centre + (outline - centre) * scale])

    kit.add(
        side,
        loft(
            [
                ring(-deep / 2 - bulge, 0.8),
                ring(-deep / 2, 0.98),
                ring(-0.4 * deep, 1.0),
                ring(deep / 2 - 0.003, 1.0),
            ]
        ),
    )
    kit.add(
        WHITE if kind == "banjo" else face,
        loft(
            [
                ring(deep / 2 - 0.003, 0.995),
                ring(deep / 2 + 0.002, 0.985),
                ring(deep / 2 + 0.002 + bulge, 0.8),
            ]
        ),
    )
    front = deep / 2 + 0.003 + bulge
    hole = 0.55 * h
    if kind in ("acoustic",):
        kit.add(BLACK, cylinder(0.055, 0.002, 24).turned("y", 90).at(front, 0, hole))
        kit.add(
            GOLD,
            lathe([(0.056, 0), (0.066, 0), (0.066, 0.003), (0.056, 0.003)], 28, loop=True)
            .turned("y", 90)
            .at(front - 0.001, 0, hole),
        )
    elif kind in ("violin", "cello"):
        for s in (-1, 1):
            kit.add(
                BLACK,
                tube(
                    smooth_path(
                        [
                            (front, s * 0.07, 0.32 * h),
                            (front, s * 0.05, 0.42 * h),
                            (front, s * 0.06, 0.52 * h),
                        ],
                        4,
                    ),
                    0.006,
                    6,
                ),
            )
    elif kind != "banjo":
        guard = pick(rng, (WHITE, BLACK, materials.DARK_GLASS))
        kit.add(guard, box(0.006, 0.5 * w, 0.45 * h, 0.002).at(front, -0.06 * w, 0.45 * h))
        for k in range(kit.choose("pickups", 1, 2, 3)):
            kit.add(BLACK, box(0.016, 0.09, 0.035, 0.004).at(front + 0.004, 0, 0.35 * h + 0.09 * k))
        for k in range(3):
            kit.add(
                CHROME,
                cylinder(0.012, 0.02, 10)
                .turned("y", 90)
                .at(front + 0.008, 0.12 + 0.02 * k, 0.14 * h + 0.05 * k),
            )
    neck = {"bass": 0.75, "violin": 0.32, "cello": 0.45}.get(kind, kit.uniform("neck", 0.42, 0.58))
    start, end = 0.62 * h, h + neck
    kit.add(dark, box(0.012, 0.052, end - start, 0.003).at(front + 0.008, 0, (start + end) / 2))
    kit.add(side, box(0.03, 0.045, end - h + 0.04, 0.01).at(front - 0.012, 0, (h + end) / 2))
    if kind not in ("violin", "cello"):
        for k in range(12):
            kit.add(
                CHROME,
                box(0.016, 0.05, 0.004).at(
                    front + 0.009, 0, end - neck * (1 - 0.92 ** (k + 1)) * 1.2
                ),
            )
    head = kit.uniform("head", 0.13, 0.2)
    kit.add(
        side, box(0.022, 0.075, head, 0.006).turned("y", -8).at(front - 0.012, 0, end + head / 2)
    )
    for k in range(2 if kind in ("violin", "cello", "bass", "banjo") else 3):
        for s in (-1, 1):
            kit.add(
                GOLD if kind == "acoustic" else CHROME,
                cylinder(0.01, 0.03, 8)
                .turned("x", 90)
                .at(front - 0.012, s * 0.052, end + head * (0.25 + 0.25 * k)),
            )
    kit.add(
        dark,
        box(0.02, 0.15 if kind not in ("violin", "cello") else 0.06, 0.022, 0.004).at(
            front + 0.006, 0, 0.22 * h
        ),
    )
    for k in range(4 if kind in ("bass", "violin", "cello", "banjo") else 6):
        y0 = (k - (2.5 if kind in ("acoustic", "electric") else 1.5)) * 0.008
        kit.add(
            CHROME,
            rod((front + 0.018, y0, 0.22 * h), (front + 0.016, 0.8 * y0, end + 0.02), 0.0016, 4),
        )
    if kit.chance("stand", 0.25):
        black = metal(rng)
        for s in (-1, 1):
            kit.add(black, rod((-0.18, s * 0.02, 0.5 * h), (0.1, s * 0.24, -0.1), 0.012, 8))
        kit.add(black, rod((-0.16, 0, 0.5 * h), (-0.35, 0, -0.1), 0.012, 8))
    elif kit.chance("lying", 0.25):
        kit.turn_all("y", -90)
    else:
        kit.turn_all("y", -kit.uniform("lean", 0, 15))

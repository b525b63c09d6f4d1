"""People and robots; animals."""

import numpy as np

from data_gen.catalogues.families import materials, shapes
from data_gen.catalogues.families.kit import BLACK, Kit, fabric, metal, paint, pick, wood
from data_gen.catalogues.families.materials import Material
from data_gen.catalogues.solids import Solid, ball, box, cylinder, lathe, pillow, prism, rod

_SKIN = (
    (0.85, 0.64, 0.52),
    (0.72, 0.5, 0.38),
    (0.5, 0.33, 0.23),
    (0.3, 0.2, 0.14),
    (0.9, 0.72, 0.62),
)
_HAIR = (
    (0.1, 0.08, 0.06),
    (0.3, 0.18, 0.1),
    (0.6, 0.45, 0.22),
    (0.55, 0.55, 0.55),
    (0.4, 0.15, 0.08),
)


def _cloth(kit: Kit) -> Material:
    rng = kit.rng
    return pick(rng, (fabric, fabric, materials.camouflage, paint))(rng)  # type: ignore[no-any-return]


def figure(kit: Kit) -> None:
    """A person who stands, walks, runs, sits, waves or aims; a robot or a statue."""
    kind = kit.choose(
        "subtype",
        "standing",
        "walking",
        "running",
        "sitting",
        "waving",
        "aiming",
        "robot",
        "statue",
    )
    rng = kit.rng
    if kind == "robot":
        _robot(kit)
        return
    skin = Material(materials.shade_of(pick(rng, _SKIN), rng), (0.1,) * 3, 20.0, name="skin")  # type: ignore[arg-type]
    hair = materials.shaded(
        pick(rng, _HAIR),
        materials.textures.foliage("fur", 0),
        materials.Tiled(0.6, True),
        name="hair",
    )
    shirt, trousers = _cloth(kit), _cloth(kit)
    shoes = materials.hide(rng) if rng.random() < 0.6 else BLACK
    if kind == "statue":
        skin = hair = shirt = trousers = shoes = pick(
            rng, (materials.stone, metal, materials.marble)
        )(rng)
    h = kit.uniform("height", 1.6, 1.9)
    build, wide = kit.uniform("build", 0.85, 1.25), kit.uniform("shoulders", 0.36, 0.5)
    hip = 0.5 * h if kind != "sitting" else 0.28 * h
    neck = hip + 0.34 * h
    skirt = kit.chance("skirt", 0.25) and kind != "sitting"

    torso = [
        (hip - 0.05, 0.16 * build, 0.28 * build),
        (hip + 0.05, 0.22 * build, 0.34 * build),
        (hip + 0.14, 0.19 * build, 0.29 * build),
        (hip + 0.23 * h, 0.23 * build, wide * 0.86),
        (neck - 0.03, 0.17 * build, wide * 0.8),
        (neck + 0.03, 0.1, 0.12),
    ]
    kit.add(shirt, shapes.upright(torso, 20))
    if kit.chance("coat", 0.3):
        long = kit.uniform("coat_length", 0.15, 0.5) * hip
        kit.add(
            shirt,
            shapes.upright(
                [(hip - long, 0.3 * build, 0.44 * build), (hip + 0.1, 0.25 * build, 0.36 * build)]
            ),
        )
    kit.add(skin, cylinder(0.055, 0.12, 12).at(0.01, 0, neck + 0.05))
    head = neck + 0.21
    kit.add(
        skin,
        ball(0.2, 0.165, 0.25, 16).at(0.02, 0, head),
        ball(0.05, 0.03, 0.05, 8).at(0.12, 0, head - 0.01),
    )
    style = kit.choose("hair", "short", "long", "bald", "cap", "bun")
    if style in ("short", "long", "bun"):
        kit.add(hair, ball(0.23, 0.19, 0.2, 16).at(-0.015, 0, head + 0.05))
        if style == "long":
            kit.add(hair, shapes.upright([(head - 0.28, 0.1, 0.16), (head, 0.13, 0.2)]).at(x=-0.06))
        if style == "bun":
            kit.add(hair, ball(0.11, 0.11, 0.11, 10).at(-0.1, 0, head + 0.12))
    elif style == "cap":
        kit.add(
            trousers,
            lathe([(0.115, 0), (0.11, 0.06), (0.06, 0.11), (0, 0.12)], 18).at(0.01, 0, head + 0.05),
        )
        kit.add(trousers, box(0.13, 0.16, 0.012, 0.004).at(0.14, 0, head + 0.055))

    stride = {"walking": 0.22, "running": 0.42}.get(kind, 0.03) * kit.uniform("stride", 0.6, 1.2)
    for s in (-1, 1):
        y = s * 0.09 * build
        if kind == "sitting":
            knee, foot = (
                np.array([0.42, y * 1.4, hip]),
                np.array([0.42 + rng.uniform(-0.05, 0.1), y * 1.4, 0.05]),
            )
        else:
            foot = np.array(
                [s * stride, y * 1.3, 0.05 + (0.25 if kind == "running" and s < 0 else 0)]
            )
            knee = (np.array([0, y, hip]) + foot) / 2 + np.array([0.04 + 0.5 * stride, 0, 0])
        top = np.array([0, y, hip + 0.02])
        bare = skirt
        kit.add(
            skin if bare else trousers,
            shapes.swept(
                [top, (top + knee) / 2, knee, (knee + foot) / 2, foot],
                [0.09 * build, 0.085 * build, 0.06 * build, 0.055 * build, 0.045 * build],
                12,
            ),
        )
        kit.add(
            shoes, pillow(0.27, 0.1, 0.09, 0.04, 2).at(foot[0] + 0.06, foot[1], foot[2] - 0.005)
        )
        shoulder = np.array([0, s * wide * 0.46, neck - 0.06])
        swing = -s * stride * 0.9
        hand = shoulder + np.array([swing + 0.05, s * rng.uniform(0.05, 0.2), -0.55])
        elbow = (shoulder + hand) / 2 + [-0.05, s * 0.04, 0]
        if kind == "waving" and s > 0:
            elbow, hand = (
                shoulder + np.array([0.02, 0.25, 0.05]),
                shoulder + np.array([0.05, 0.3, 0.4]),
            )
        elif kind == "aiming":
            hand = shoulder + np.array([0.42 + 0.1 * s, -s * wide * 0.4, 0.02])
            elbow = (shoulder + hand) / 2 + np.array([0, s * 0.1, -0.12])
        elif kind == "sitting":
            hand, elbow = (
                np.array([0.32, s * 0.14, hip + 0.1]),
                shoulder + np.array([-0.02, s * 0.08, -0.28]),
            )
        sleeve = (
            shirt if not kit.visible.setdefault("bare_arms", bool(rng.random() < 0.3)) else skin
        )
        kit.add(
            sleeve, shapes.swept([shoulder, elbow, hand], [0.062 * build, 0.05 * build, 0.036], 10)
        )
        kit.add(
            skin,
            ball(0.1, 0.07, 0.11, 10).at(
                *(hand + np.array([0.01, 0, -0.04 if kind != "waving" or s < 0 else 0.05]))
            ),
        )
    if skirt:
        low = kit.uniform("skirt_length", 0.05, 0.5) * hip
        kit.add(
            trousers,
            shapes.upright(
                [
                    (low, 0.4, 0.46),
                    (hip - 0.05, 0.26 * build, 0.37 * build),
                    (hip + 0.1, 0.2 * build, 0.3 * build),
                ]
            ),
        )
    if kind == "sitting":
        seat = pick(rng, (wood, materials.stone, fabric))(rng)
        kit.add(seat, box(0.42, 0.5, hip - 0.1, 0.02).at(0.03, 0, (hip - 0.1) / 2))
        if kit.chance("chair_back", 0.5):
            kit.add(seat, box(0.06, 0.5, hip + 0.5, 0.02).at(-0.2, 0, (hip + 0.5) / 2))
    if kind == "aiming":
        z = neck - 0.03
        kit.add(
            BLACK,
            box(0.75, 0.04, 0.08, 0.01).at(0.45, 0, z),
            rod((0.5, 0, z), (1.05, 0, z + 0.01), 0.014),
            box(0.05, 0.03, 0.16).at(0.5, 0, z - 0.1),
        )
    if kit.chance("backpack", 0.2):
        kit.add(_cloth(kit), pillow(0.18, 0.3, 0.42, 0.07).at(-0.19, 0, neck - 0.22))
    if kind == "statue" or kit.chance("base", 0.15):
        high = kit.uniform("base_height", 0.05, 0.6)
        kit.add(materials.stone(rng), box(0.9, 0.8, high).at(z=-high / 2))


def _robot(kit: Kit) -> None:
    rng = kit.rng
    shell, joint = materials.plating(rng), metal(rng)
    trim = paint(rng)
    wide, deep = kit.uniform("width", 0.5, 0.9), kit.uniform("depth", 0.35, 0.6)
    leg, body = kit.uniform("leg", 0.4, 0.9), kit.uniform("body", 0.5, 0.8)
    kit.add(shell, box(deep, wide, body, 0.05).at(z=leg + body / 2))
    kit.add(trim, box(0.03, 0.6 * wide, 0.4 * body).at(deep / 2, 0, leg + 0.6 * body))
    size = kit.uniform("head", 0.25, 0.4)
    head = leg + body + 0.06
    kit.add(joint, cylinder(0.08, 0.14, 12).at(z=head - 0.04))
    if kit.chance("round_head", 0.5):
        kit.add(shell, ball(size, size, size, 18).at(z=head + size / 2))
    else:
        kit.add(shell, box(size, 1.2 * size, size, 0.03).at(z=head + size / 2))
    for s in (-1, 1):
        kit.add(
            materials.RED_LIGHT,
            ball(0.06, 0.07, 0.07, 10).at(size * 0.48, s * size * 0.24, head + 0.6 * size),
        )
        y = s * (wide / 2 + 0.09)
        kit.add(joint, ball(0.2, 0.2, 0.2, 12).at(0, y, leg + 0.88 * body))
        bend = rng.uniform(-0.1, 0.5)
        kit.add(
            shell,
            shapes.swept(
                [
                    (0, y, leg + 0.85 * body),
                    (0, y * 1.1, leg + 0.4 * body),
                    (bend, y * 1.1, leg + 0.1),
                ],
                [0.07, 0.07, 0.09],
                10,
            ),
        )
        kit.add(trim, box(0.16, 0.06, 0.2, 0.02).at(bend, y * 1.1, leg))
        kit.add(joint, cylinder(0.07, leg, 12).at(0, s * 0.28 * wide, leg / 2))
        kit.add(shell, box(0.45, 0.3 * wide, 0.14, 0.03).at(0.06, s * 0.28 * wide, 0.07))


def animal(kit: Kit) -> None:
    """Dog, horse, cow, giraffe, elephant, bird, penguin, fish, dinosaur, tortoise, insect."""
    kind = kit.choose(
        "subtype",
        "dog",
        "horse",
        "cow",
        "giraffe",
        "elephant",
        "bird",
        "penguin",
        "fish",
        "dinosaur",
        "tortoise",
        "insect",
    )
    rng = kit.rng
    coat = materials.fur(rng)
    if kind in ("dog", "horse", "cow", "giraffe", "elephant"):
        _quadruped(kit, kind, coat)
    elif kind == "dinosaur":
        skin = pick(rng, (materials.camouflage, materials.leaf, materials.hide))(rng)
        t = kit.uniform("tail", 0.9, 1.4)
        kit.add(
            skin,
            shapes.trunk(
                [
                    (-t, 0.75, 0.05, 0.05),
                    (-0.5, 0.82, 0.2, 0.24),
                    (0, 0.85, 0.42, 0.5),
                    (0.35, 1.0, 0.3, 0.36),
                    (0.55, 1.25, 0.2, 0.24),
                ]
            ),
        )
        kit.add(
            skin,
            shapes.trunk(
                [
                    (0.42, 1.28, 0.16, 0.2),
                    (0.6, 1.34, 0.24, 0.28),
                    (0.8, 1.28, 0.19, 0.2),
                    (0.98, 1.24, 0.12, 0.1),
                ]
            ),
        )
        for s in (-1, 1):
            kit.add(
                skin,
                shapes.swept(
                    [
                        (0, s * 0.17, 0.85),
                        (0.18, s * 0.2, 0.5),
                        (-0.05, s * 0.2, 0.25),
                        (0.05, s * 0.2, 0.02),
                    ],
                    [0.17, 0.12, 0.06, 0.06],
                ),
            )
            kit.add(skin, box(0.26, 0.14, 0.05, 0.02).at(0.12, s * 0.2, 0.02))
            kit.add(
                skin,
                shapes.swept(
                    [(0.36, s * 0.13, 0.95), (0.5, s * 0.16, 0.8), (0.58, s * 0.14, 0.85)],
                    [0.05, 0.03, 0.02],
                ),
            )
    elif kind == "fish":
        d, w = kit.uniform("depth", 0.3, 0.6), kit.uniform("width", 0.12, 0.3)
        z = 0.45
        kit.add(
            coat if rng.random() < 0.3 else materials.fabric(rng),
            shapes.trunk(
                [
                    (0.6, z, 0.03, 0.05),
                    (0.45, z, w * 0.7, d * 0.6),
                    (0.1, z, w, d),
                    (-0.3, z, w * 0.6, d * 0.5),
                    (-0.55, z, 0.04, 0.1),
                ],
                20,
            ),
        )
        fin = materials.lacquer(rng)
        tail = [(-0.5, z), (-0.8, z + 0.5 * d), (-0.72, z), (-0.8, z - 0.5 * d)]
        for outline in (
            tail,
            [(0.2, z + 0.4 * d), (-0.05, z + 0.75 * d), (-0.25, z + 0.3 * d)],
            [(0.0, z - 0.4 * d), (-0.2, z - 0.65 * d), (-0.2, z - 0.25 * d)],
        ):
            kit.add(fin, Solid(*_flat(outline, 0.02)))
        kit.both(BLACK, ball(0.05, 0.03, 0.05, 8).at(0.46, 0.33 * w, z + 0.08 * d))
    elif kind in ("bird", "penguin"):
        up = kind == "penguin"
        if up:
            kit.add(
                coat,
                shapes.upright(
                    [
                        (0.02, 0.3, 0.34),
                        (0.3, 0.42, 0.46),
                        (0.65, 0.32, 0.36),
                        (0.85, 0.22, 0.22),
                        (1.02, 0.06, 0.06),
                    ]
                ),
            )
            kit.add(
                materials.WHITE,
                shapes.upright([(0.06, 0.2, 0.2), (0.3, 0.3, 0.32), (0.66, 0.16, 0.18)]).at(x=0.09),
            )
            head = (0.06, 0.0, 0.9)
        else:
            kit.add(
                coat,
                shapes.trunk(
                    [
                        (-0.55, 0.5, 0.16, 0.03),
                        (-0.3, 0.48, 0.14, 0.12),
                        (0, 0.5, 0.28, 0.3),
                        (0.2, 0.62, 0.2, 0.24),
                        (0.32, 0.76, 0.1, 0.1),
                    ]
                ),
            )
            head = (0.3, 0.0, 0.78)
            kit.add(coat, ball(0.2, 0.17, 0.18, 14).at(*head))
        bill = Material((0.8, 0.5, 0.12), name="bill")
        kit.add(
            bill, lathe([(0.035, 0), (0, 0.16)], 10).turned("y", 95).at(head[0] + 0.07, 0, head[2])
        )
        spread = kit.chance("wings_spread", 0.5) and not up
        for s in (-1, 1):
            if spread:
                wing = [(0.12, 0.0), (0.05, 0.9), (-0.15, 0.95), (-0.25, 0.0)]
                part = Solid(*_flat(wing, 0.03)).turned("x", 90).at(0, 0.1, 0.56)
                kit.add(coat, part if s < 0 else part.mirrored())
            else:
                kit.add(
                    coat,
                    ball(0.5 if not up else 0.16, 0.05, 0.2 if not up else 0.5, 12)
                    .turned("x", -12 * s if up else 0)
                    .at(-0.08 + 0.08 * up, s * (0.14 + 0.08 * up), 0.52),
                )
            kit.add(
                bill,
                rod((0.02, s * 0.07, 0.4 * (not up) + 0.02), (0.04, s * 0.08, 0.01), 0.018, 6),
                box(0.16, 0.08, 0.02).at(0.08, s * 0.09, 0.01),
            )
            kit.add(BLACK, ball(0.03, 0.03, 0.03, 8).at(head[0] + 0.05, s * 0.075, head[2] + 0.04))
    elif kind == "tortoise":
        shell = materials.shaded(
            (0.35, 0.28, 0.15),
            materials.textures.stone("cobbles", int(rng.integers(8))),
            materials.Tiled(1.3),
            0.2,
        )
        kit.add(
            shell,
            ball(1.0, 0.8, 0.6, 24)
            .bent(lambda v: v * [1, 1, 1] * np.where(v[:, 2:] < 0, [1, 1, 0.3], 1))
            .at(z=0.22),
        )
        skin = materials.hide(rng)
        kit.add(
            skin,
            shapes.swept([(0.4, 0, 0.2), (0.55, 0, 0.25), (0.68, 0, 0.32)], [0.08, 0.07, 0.09]),
        )
        for sx in (-1, 1):
            kit.both(
                skin,
                shapes.swept(
                    [(sx * 0.3, 0.25, 0.2), (sx * 0.36, 0.36, 0.12), (sx * 0.38, 0.4, 0.01)],
                    [0.1, 0.09, 0.08],
                ),
            )
    else:
        armour = paint(rng)
        kit.add(
            armour,
            ball(0.6, 0.4, 0.34, 20).at(-0.3, 0, 0.35),
            ball(0.3, 0.28, 0.26, 16).at(0.1, 0, 0.35),
        )
        kit.add(BLACK, ball(0.22, 0.24, 0.2, 14).at(0.32, 0, 0.36))
        for k in (-0.1, 0.08, 0.22):
            kit.both(
                BLACK,
                shapes.swept(
                    [
                        (k, 0.1, 0.3),
                        (k + 0.3 * (k - 0.08), 0.4, 0.45),
                        (k + 1.2 * (k - 0.08), 0.65, 0.0),
                    ],
                    [0.025, 0.022, 0.012],
                    6,
                ),
            )
        kit.both(
            BLACK,
            shapes.swept(
                [(0.4, 0.05, 0.42), (0.55, 0.12, 0.6), (0.7, 0.2, 0.58)], [0.012, 0.01, 0.008], 6
            ),
        )


def _flat(outline: list[tuple[float, float]], thick: float) -> tuple[np.ndarray, np.ndarray]:
    return prism(outline, thick)


def _quadruped(kit: Kit, kind: str, coat: Material) -> None:
    rng = kit.rng
    long, leg, deep, neck, head = {
        "dog": (0.6, 0.4, 0.26, 0.25, 0.22),
        "horse": (1.2, 0.9, 0.5, 0.6, 0.42),
        "cow": (1.3, 0.7, 0.6, 0.3, 0.38),
        "giraffe": (1.1, 1.3, 0.5, 1.5, 0.35),
        "elephant": (1.6, 1.0, 1.0, 0.25, 0.6),
    }[kind]
    long, leg, deep = (
        v * kit.uniform(n, 0.85, 1.15) for n, v in (("length", long), ("leg", leg), ("girth", deep))
    )
    wide = deep * kit.uniform("width", 0.7, 0.9)
    z = leg + 0.35 * deep
    if kind == "elephant":
        coat = materials.shaded(
            (0.42, 0.41, 0.4), materials.textures.leather("grained", 1), materials.Tiled(1.0)
        )
    kit.add(
        coat,
        shapes.trunk(
            [
                (-0.55 * long, z + 0.1 * deep, 0.2 * wide, 0.3 * deep),
                (-0.42 * long, z, 0.9 * wide, 0.85 * deep),
                (0, z - 0.03, wide, deep),
                (0.38 * long, z + 0.04, 0.9 * wide, deep),
                (0.56 * long, z + 0.1 * deep, 0.4 * wide, 0.5 * deep),
            ],
            18,
        ),
    )
    thick = 0.16 * deep if kind != "elephant" else 0.2 * deep
    stride = kit.uniform("stride", 0, 0.18) * leg
    for sx in (-1, 1):
        for s in (-1, 1):
            x, y = sx * 0.4 * long, s * 0.32 * wide
            step = sx * s * stride
            kit.add(
                coat,
                shapes.swept(
                    [(x, y, z), (x + 0.03 * sx, y, 0.5 * leg), (x + step, y, 0.02)],
                    [1.9 * thick, 0.9 * thick, 0.75 * thick],
                    10,
                ),
            )
            kit.add(
                BLACK, cylinder(0.85 * thick, 0.08 * leg, 10).at(x + step + 0.01, y, 0.04 * leg)
            )
    rise = kit.uniform("neck", 0.5, 1.2) if kind != "giraffe" else 1.25
    start = np.array([0.48 * long, 0, z + 0.15 * deep])
    tip = start + np.array([neck * np.cos(rise), 0, neck * np.sin(rise)])
    kit.add(
        coat,
        shapes.swept(
            [start - np.array([0.08 * long, 0, 0.1 * deep]), (start + tip) / 2, tip],
            [0.36 * deep, 0.24 * deep, 0.17 * deep],
            12,
        ),
    )
    down = 0.35 * head
    if kind == "elephant":
        kit.add(coat, ball(0.8, 0.7, 0.8, 18).at(*tip))
        kit.add(
            coat,
            shapes.swept(
                [
                    tip + np.array([0.3, 0, 0]),
                    tip + np.array([0.6, 0, -0.4]),
                    tip + np.array([0.55, 0, -1.0]),
                    tip + np.array([0.75, 0, -1.1]),
                ],
                [0.18, 0.13, 0.09, 0.06],
                12,
            ),
        )
        for s in (-1, 1):
            kit.add(
                coat,
                ball(0.5, 0.06, 0.7, 14).turned("z", 30 * s).at(tip[0] - 0.15, s * 0.45, tip[2]),
            )
            kit.add(
                materials.WHITE,
                shapes.swept(
                    [
                        tip + np.array([0.3, s * 0.18, -0.2]),
                        tip + np.array([0.6, s * 0.22, -0.45]),
                        tip + np.array([0.85, s * 0.2, -0.35]),
                    ],
                    [0.05, 0.04, 0.015],
                    8,
                ),
            )
    else:
        muzzle = tip + np.array([head, 0, -down])
        kit.add(
            coat,
            shapes.swept(
                [
                    tip - np.array([0.3 * head, 0, -0.1 * head]),
                    tip + np.array([0.3 * head, 0, -0.25 * down]),
                    muzzle,
                ],
                [0.26 * head, 0.34 * head, 0.19 * head],
                14,
            ),
        )
        kit.add(
            BLACK,
            ball(0.2 * head, 0.3 * head, 0.18 * head, 10).at(
                *(muzzle + np.array([0.12 * head, 0, 0.04 * head]))
            ),
        )
        for s in (-1, 1):
            kit.add(
                coat,
                lathe([(0.11 * head, 0), (0.12 * head, 0.2 * head), (0, 0.45 * head)], 8)
                .scaled(0.5, 1, 1)
                .turned("x", -s * 25)
                .at(tip[0] - 0.05 * head, s * 0.2 * head, tip[2] + 0.2 * head),
            )
            kit.add(
                BLACK,
                ball(0.1 * head, 0.06 * head, 0.1 * head, 8).at(
                    tip[0] + 0.4 * head, s * 0.27 * head, tip[2] + 0.05
                ),
            )
            if kind in ("cow", "giraffe"):
                kit.add(
                    materials.WHITE,
                    shapes.swept(
                        [
                            (tip[0], s * 0.15 * head, tip[2] + 0.2 * head),
                            (tip[0], s * 0.4 * head, tip[2] + 0.45 * head),
                            (tip[0] + 0.05, s * 0.4 * head, tip[2] + 0.7 * head),
                        ],
                        [0.05, 0.04, 0.015],
                        7,
                    ),
                )
        if kind == "horse":
            kit.add(
                BLACK,
                shapes.swept(
                    [
                        start + np.array([-0.2, 0, 0.3 * deep]),
                        (start + tip) / 2 + np.array([-0.12, 0, 0.1]),
                        tip + np.array([-0.1, 0, 0.15]),
                    ],
                    [0.05, 0.07, 0.04],
                    8,
                ),
            )
            if kit.chance("saddle", 0.4):
                kit.add(
                    materials.hide(rng),
                    pillow(0.45, 1.03 * wide, 0.2, 0.08).at(0, 0, z + 0.42 * deep),
                )
    tail = [
        (-0.54 * long, 0, z + 0.15 * deep),
        (-0.54 * long - 0.3 * deep, 0, z - 0.1 * deep),
        (-0.54 * long - 0.3 * deep, 0, z - 0.6 * deep),
    ]
    kit.add(
        coat if kind != "horse" else BLACK,
        shapes.swept(tail, [0.05, 0.04, 0.07] if kind == "horse" else [0.05, 0.03, 0.025], 7),
    )

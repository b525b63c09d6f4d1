"""Monitors, televisions, laptops and signs; flat, curved and with cathode-ray tubes."""

from collections.abc import Callable

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families import hollows, legs
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    DARK_GLASS,
    WHITE,
    Kit,
    around,
    lacquer,
    metal,
    pick,
    plastic,
    rect,
    screen,
    wood,
)
from data_gen.catalogues.solids import Solid, box, cylinder, rod, sheet, tube
from data_gen.mesh import Material


def _materials(kit: Kit) -> tuple[Material, Material]:
    """Materials of the housing and of the screen."""
    return plastic(kit.rng), screen(kit.rng)


def _panel(
    body: Material, glass: Material, width: float, height: float, thick: float, bezel: float,
    chin: float = 0.0,
) -> list[tuple[Material, Solid]]:  # fmt: skip
    """A flat screen whose lower edge is at z = 0; a bulge behind it holds the electronics."""
    rear = solids.rounded(height * 0.7, width * 0.7, 0.05 * width, 3)
    small = rear * 0.8
    bulge = solids.stack([(rear, 0.0), (small, thick * 0.9)]).turned("y", -90)
    show = box(0.006, width - 2 * bezel, height - 2 * bezel - chin)
    return [
        (body, box(thick, width, height, thick * 0.2).at(z=height / 2)),
        (body, bulge.at(-thick / 2 + 0.002, 0, height / 2)),
        (glass, show.at(thick / 2, 0, height / 2 + chin / 2)),
    ]


def _stand(kit: Kit, body: Material, width: float, lift: float, reach: float, rise: float) -> None:
    """A foot on the ground, and a neck behind x = 0 that ends at z = lift + rise."""
    style = kit.choose("stand", "plate", "disc", "vee", "ring", "bow", "block")
    thick = 0.012 * max(1.0, 1.5 * width)
    if style == "plate":
        slab = hollows.slab(kit, "foot_recess", rect(2 * reach, width * 0.45, 0.02), thick, 0.006)
        kit.add(body, slab)
    elif style == "disc":
        flat = solids.superellipse(2 * reach, 2.6 * reach, 2.0, 32)
        levels = [(flat, 0.0), (flat, thick * 0.6), (flat * 0.9, thick)]
        kit.add(body, hollows.body(kit, levels, 0.5 * thick, "foot_recess"))
    elif style == "block":
        outline = rect(1.6 * reach, width * 0.25, 0.01)
        kit.add(body, hollows.slab(kit, "foot_recess", outline, max(0.3 * lift, thick), 0.008))
    else:
        plate = rect(0.5 * reach, 0.5 * reach, 0.01)
        kit.add(body, hollows.slab(kit, "foot_recess", plate, thick, 0.006))
        r = thick * 0.8
        if style == "vee":
            for s in (-1, 1):
                kit.add(
                    body,
                    rod((0, 0, r), (reach, s * width * 0.3, r), r),
                    rod((0, 0, r), (-reach, s * width * 0.16, r), r),
                )
        elif style == "bow":
            path = solids.rise(
                lambda t: (reach * (1 - 0.9 * (2 * t - 1) ** 2), (2 * t - 1) * width * 0.34, r), 12
            )
            kit.add(body, tube(path, r), rod((-reach * 0.6, 0, r), (reach, 0, r), r))
        else:
            a = np.linspace(0, 2 * np.pi, 29)
            kit.add(
                body,
                tube(np.stack([reach * np.cos(a), 1.3 * reach * np.sin(a), 0 * a + r], axis=1), r),
                rod((-reach, 0, r), (reach, 0, r), r),
            )
    top = lift + rise
    neck = kit.choose("neck", "flat", "round", "leaning")
    if neck == "flat":
        kit.add(body, box(0.03 * width, width * 0.12, top, 0.003).at(-0.03 * width, 0, top / 2))
    elif neck == "round":
        kit.add(body, cylinder(0.025 * width + 0.004, top, 16).at(-0.03 * width, 0, top / 2))
    else:
        ends = [(-reach * 0.7, 0.0, thick), (-0.03 * width, 0.0, top)]
        kit.add(body, solids.sweep(solids.rounded(width * 0.1, 0.02, 0.004, 1), ends, (0, 1, 0)))


def _desk(kit: Kit) -> None:
    """A computer monitor of any format, also in portrait orientation, tilted and raised."""
    body, glass = _materials(kit)
    width, aspect = kit.uniform("width", 0.35, 0.8), kit.uniform("aspect", 1.2, 1.95)
    if kit.chance("upright", 0.15):
        width, aspect = width * 0.7, 1 / aspect
    height = width / aspect
    lift = kit.uniform("lift", 0.03, 0.3)
    bezel, chin = (
        width * kit.uniform("bezel", 0.01, 0.05),
        height * kit.choose("chin", 0.0, 0.0, 0.06, 0.12),
    )
    tip = kit.uniform("tip", -4, 16)
    for material, part in _panel(
        body, glass, width, height, 0.03 + 0.03 * kit.rng.random(), bezel, chin
    ):
        kit.add(material, part.at(z=-height / 2).turned("y", -tip).at(0.02, 0, lift + height / 2))
    _stand(kit, body, width, lift, kit.uniform("reach", 0.1, 0.17), height * 0.35)
    if kit.chance("side_speakers", 0.15):
        kit.both(body, box(0.07, 0.06, height, 0.01).at(0.02, width / 2 + 0.035, lift + height / 2))


def _tv(kit: Kit) -> None:
    body, glass = _materials(kit)
    width = kit.uniform("width", 0.8, 1.5)
    height, thick = (
        width / kit.uniform("aspect", 1.6, 1.85),
        width * kit.uniform("thickness", 0.02, 0.1),
    )
    lift, bezel = width * kit.uniform("lift", 0.02, 0.1), width * kit.uniform("bezel", 0.008, 0.06)
    speakers = kit.choose("speakers", "none", "none", "below", "sides")
    parts = _panel(
        body, glass, width, height, thick, bezel, 0.15 * height if speakers == "below" else 0.0
    )
    if speakers == "sides":
        parts += [
            (BLACK, box(thick * 0.9, 0.1 * width, height, 0.01).at(0, s * width * 0.55, height / 2))
            for s in (-1, 1)
        ]
    base = kit.choose("base", "stand", "feet", "easel", "cabinet", "wall")
    if base == "easel":
        lift = width * kit.uniform("easel", 0.5, 0.8)
        for s in (-1, 1):
            kit.add(
                body,
                tube(
                    [(0.25, s * width * 0.4, 0), (-thick, s * width * 0.12, lift + height * 0.5)],
                    0.018,
                ),
            )
        kit.add(body, tube([(-0.45, 0, 0), (-thick, 0, lift + height * 0.5)], 0.018))
        kit.add(
            body,
            hollows.slab(kit, "foot_recess", rect(0.2, width * 0.4, 0.01), 0.03).at(
                -0.1, 0, lift * 0.5
            ),
        )
    elif base == "cabinet":
        deep, lift = (
            kit.uniform("cabinet_depth", 0.35, 0.5),
            width * kit.uniform("cabinet", 0.25, 0.5),
        )
        wide = width * kit.uniform("cabinet_width", 0.8, 1.5)
        main = pick(kit.rng, (wood, lacquer))(kit.rng)
        kit.add(main, hollows.slab(kit, "foot_recess", rect(deep, wide), 0.06))
        open_ = kit.chance("open_cabinet", 0.5)
        if open_:
            kit.both(main, box(deep, 0.03, lift).at(0, wide / 2 - 0.015, lift / 2))
            kit.add(
                main,
                box(deep, 0.03, lift).at(0, 0, lift / 2),
                box(deep, wide, 0.03).at(0, 0, lift - 0.015),
                box(deep, wide, 0.02).at(0, 0, lift * 0.55),
            )
        else:
            kit.add(main, box(deep, wide, lift - 0.05, 0.005).at(0, 0, lift / 2 + 0.025))
            kit.add(BLACK, box(0.004, 0.008, lift * 0.7).at(deep / 2, 0, lift / 2))
        kit.add(body, box(0.2, width * 0.4, 0.03, 0.006).at(0, 0, lift + 0.01))
        lift += 0.02
    elif base == "feet":
        reach = width * kit.uniform("reach", 0.1, 0.2)
        for s in (-1, 1):
            kit.add(
                body,
                rod((0, s * width * 0.36, lift + 0.02), (reach, s * width * 0.38, 0.01), 0.012),
                rod((0, s * width * 0.36, lift + 0.02), (-reach, s * width * 0.38, 0.01), 0.012),
            )
        kit.add(
            body,
            hollows.slab(
                kit, "foot_recess", rect(thick * 0.9, width * 0.5, 0.004), 0.3 * lift, 0.004
            ).at(z=lift * 0.72),
        )
    elif base == "wall":
        lift = 0.0
        kit.add(
            body,
            hollows.slab(
                kit, "foot_recess", rect(0.06, width * 0.3, 0.004), height * 0.4, 0.004
            ).at(-thick - 0.03, 0, height * 0.25),
        )
        kit.add(
            metal(kit.rng),
            box(0.02, width * 0.35, height * 0.5).at(-thick - 0.09, 0, height * 0.45),
            box(0.1, 0.06, 0.06).at(-thick - 0.04, 0, height * 0.5),
        )
    else:
        _stand(kit, body, width, lift, width * kit.uniform("reach", 0.12, 0.2), height * 0.2)
    for material, part in parts:
        kit.add(material, part.at(z=lift))


def _tube(kit: Kit) -> None:
    """A monitor or television with a cathode-ray tube, on a foot, on legs or in a cabinet."""
    body, glass = _materials(kit)
    width, aspect = kit.uniform("width", 0.34, 0.75), kit.uniform("aspect", 1.1, 1.4)
    height, deep = width / aspect, width * kit.uniform("tube_depth", 0.55, 1.1)
    style = kit.choose("style", "swivel", "swivel", "block", "legs", "wooden", "round")
    low = {
        "swivel": 0.06,
        "block": 0.015,
        "legs": kit.uniform("legs_height", 0.2, 0.6),
        "wooden": 0.04,
        "round": 0.12,
    }[style]
    if style == "wooden":
        body = wood(kit.rng)
    bow = kit.uniform("taper", 0.45, 0.85)
    flat = solids.rounded(height, width, 0.05 * width, 3)
    shape = [(0.0, 0.96), (0.02, 1.0), (0.3 * deep, 1.0), (0.5 * deep, 0.5 + bow / 2), (deep, bow)]
    if style in ("block", "wooden"):
        shape = [(0.0, 0.98), (0.01, 1.0), (0.7 * deep, 1.0), (0.72 * deep, 0.7), (deep, 0.6)]
    if style == "round":
        flat = solids.superellipse(height, width, 2.3, 32)
        shape = [(0.0, 0.9), (0.05, 1.0), (0.5 * deep, 1.0), (0.85 * deep, 0.75), (deep, 0.3)]
    case = solids.stack([(flat * s, t) for t, s in shape]).turned("y", -90)
    case = case.at(deep / 2, 0, low + height / 2)
    kit.add(body, case)
    front, side = deep / 2, kit.choose("controls", "below", "side")
    w, h = (0.84, 0.76) if side == "below" else (0.66, 0.84)
    y = 0.0 if side == "below" else -0.12 * width
    z = low + height * (0.55 if side == "below" else 0.5)
    t = np.linspace(-0.5, 0.5, 9)
    grid = [
        np.stack(
            [
                front + 0.03 * width * (1 - 2 * t**2 - 2 * v**2),
                y + t * w * width,
                0 * t + z + v * h * height,
            ],
            axis=1,
        )
        for v in t
    ]
    kit.add(glass, sheet(np.array(grid), 0.012))
    if side == "side":
        kit.both(
            BLACK,
            cylinder(0.045 * width, 0.03, 16)
            .turned("y", 90)
            .at(front + 0.01, 0.34 * width, low + height * 0.75),
        )
        kit.add(
            BLACK,
            cylinder(0.045 * width, 0.03, 16)
            .turned("y", 90)
            .at(front + 0.01, 0.34 * width, low + height * 0.55),
            box(0.01, 0.14 * width, 0.3 * height).at(front, 0.34 * width, low + height * 0.25),
        )
    else:
        kit.add(
            BLACK,
            *(
                box(0.012, 0.02, 0.012).at(front, width * (0.2 + 0.06 * k), low + height * 0.07)
                for k in range(4)
            ),
        )
    if style == "swivel":
        kit.add(
            body,
            hollows.turned(
                kit,
                [
                    (width * 0.32, 0),
                    (width * 0.32, 0.015),
                    (width * 0.16, 0.035),
                    (width * 0.2, low + 0.02),
                ],
                28,
                0.012,
                "foot_recess",
            ),
        )
    else:
        foot = max(low, 0.02)
        if style in ("legs", "round"):
            legs.four(
                kit,
                deep * 0.3,
                width * 0.36,
                low + 0.12 * height,
                pick(kit.rng, (wood, metal))(kit.rng),
                "tapered",
                "round",
                "sabre",
                thick=0.03,
            )
            foot = 0.06
        slab = hollows.slab(kit, "foot_recess", rect(deep * 0.5, width * 0.7, 0.01), foot)
        kit.add(body, slab.at(0, 0, low + (0.05 if style == "round" else 0.02) - foot))
    if kit.chance("antenna", 0.3):
        top = low + height
        for s in (-1, 1):
            kit.add(
                CHROME,
                rod(
                    (0, 0, top),
                    (-0.05, s * width * 0.5, top + height * kit.uniform(f"antenna_{s}", 0.4, 0.9)),
                    0.005,
                    6,
                ),
            )
        kit.add(BLACK, box(0.06, 0.1, 0.03, 0.008).at(0, 0, top + 0.01))


def _curved(kit: Kit) -> None:
    body, glass = _materials(kit)
    width = kit.uniform("width", 0.7, 1.3)
    height, bend = width / kit.uniform("aspect", 1.7, 3.2), kit.uniform("bend", 0.1, 0.45)
    lift, t = width * kit.uniform("lift", 0.05, 0.2), np.linspace(-1, 1, 17)

    def face(w: float, h: float, x: float, thick: float) -> Solid:
        rows = [
            np.stack(
                [x + bend * width * 0.5 * (t * w) ** 2, t * w * width / 2, 0 * t + v * h], axis=1
            )
            for v in (-0.5, 0.0, 0.5)
        ]
        return sheet(np.array(rows), thick)

    centre = lift + height / 2
    kit.add(body, face(1.0, height, 0.0, 0.03).at(z=centre))
    # The screen is moved forward far enough to clear the housing even where the curve is most
    # oblique.
    ahead = 0.016 * float(np.hypot(1, 2 * bend))
    kit.add(glass, face(0.97, height * 0.93, ahead - 0.004, 0.012).at(z=centre))
    kit.add(body, box(0.06, width * 0.3, height * 0.5, 0.02).at(-0.035, 0, centre))
    _stand(kit, body, width, lift, width * kit.uniform("reach", 0.14, 0.24), height * 0.35)


def _laptop(kit: Kit) -> None:
    body, glass = _materials(kit)
    key = BLACK if kit.chance("black_keys", 0.6) else body
    width = kit.uniform("width", 0.28, 0.42)
    depth, thick = (
        width * kit.uniform("deck", 0.58, 0.8),
        width * kit.uniform("thickness", 0.03, 0.1),
    )
    height = depth * kit.uniform("lid", 0.9, 1.02)
    slab = hollows.slab(kit, "deck_recess", rect(depth, width, 0.03 * width), thick, 0.01)
    kit.add(body, slab.at(depth / 2))
    kit.add(BLACK, box(depth * 0.45, width * 0.88, 0.002).at(depth * 0.34, 0, thick))
    for i in range(5):
        for j in range(11):
            kit.add(
                key,
                box(depth * 0.07, width * 0.066, 0.004).at(
                    depth * (0.16 + 0.09 * i), (j - 5) * width * 0.078, thick + 0.001
                ),
            )
    kit.add(DARK_GLASS, box(depth * 0.2, width * 0.26, 0.002).at(depth * 0.78, 0, thick))
    lean = kit.choose("opened", 5, 15, 25, 40, 60, -40) + kit.uniform("lean", -5, 5)
    bezel = width * kit.uniform("bezel", 0.015, 0.07)
    cover = width * kit.uniform("lid_thickness", 0.02, 0.05)
    lid = box(cover, width, height, 0.004).at(0, 0, height / 2)
    show = box(0.002, width - 2 * bezel, height - 2.4 * bezel).at(cover / 2, 0, height / 2)
    for material, part in ((body, lid), (glass, show)):
        kit.add(material, part.turned("y", -lean).at(0.005, 0, thick))
    kit.add(body, cylinder(thick * 0.4, width * 0.8, 12).turned("x", 90).at(0.004, 0, thick * 0.9))


def _dual(kit: Kit) -> None:
    """Two to six screens on one stand or arm."""
    body, glass = _materials(kit)
    width = kit.uniform("width", 0.4, 0.6)
    height, lift = width / kit.uniform("aspect", 1.25, 1.9), kit.uniform("lift", 0.1, 0.25)
    plan = kit.choose("plan", (2, 1), (2, 1), (3, 1), (1, 2), (2, 2), (3, 2))
    columns, rows = plan
    turn = kit.uniform("turn", 0, 28) if columns > 1 else 0.0
    for i in range(columns):
        for j in range(rows):
            off = i - (columns - 1) / 2
            angle = -turn * off
            y = off * (width * 1.02) * np.cos(np.radians(turn) * 0.5)
            x = abs(off) * width * 0.55 * np.sin(np.radians(turn))
            for material, part in _panel(body, glass, width, height, 0.03, width * 0.02):
                kit.add(material, part.turned("z", angle).at(x, y, lift + j * (height + 0.02)))
    top = lift + rows * height - height * 0.4
    kit.add(
        body,
        hollows.slab(
            kit, "foot_recess", rect(0.26, width * kit.uniform("foot", 0.5, 1.0), 0.02), 0.02, 0.01
        ),
    )
    kit.add(body, cylinder(0.022, top, 16).at(-0.06, 0, top / 2))
    for j in range(rows):
        kit.add(
            body,
            box(0.03, max(columns - 1, 0.3) * width, 0.05).at(
                -0.045, 0, lift + (j + 0.5) * (height + 0.01)
            ),
        )


def _all_in_one(kit: Kit) -> None:
    """A computer in the foot, the screen, an egg-shaped case or a tower; most with a keyboard."""
    body, glass = _materials(kit)
    width = kit.uniform("width", 0.36, 0.65)
    height = width / kit.uniform("aspect", 1.2, 1.8)
    style = kit.choose("style", "slab", "dome", "egg", "tower", "tower")
    lift = 0.08
    if style == "dome":
        r = width * 0.27
        t = np.linspace(0, np.pi / 2, 9)
        profile = [(r * np.cos(a), 0.01 + r * 0.7 * np.sin(a)) for a in t[:-1]]
        kit.add(
            body,
            hollows.turned(
                kit, [(r, 0.0), *profile, (0.0, 0.01 + r * 0.7)], 28, 0.05, "foot_recess"
            ),
        )
        lift = r * 0.7 + kit.uniform("neck", 0.04, 0.16)
        kit.add(
            CHROME,
            tube(
                solids.smooth_path(
                    [(0, 0, r * 0.6), (-0.02, 0, lift), (0.06, 0, lift + height * 0.4)], 4
                ),
                0.014,
            ),
        )
        for material, part in _panel(body, glass, width, height, 0.025, 0.02):
            kit.add(material, part.at(0.09, 0, lift))
    elif style == "egg":
        flat = solids.superellipse(height * 1.1, width, 2.6, 32)
        deep = width * kit.uniform("egg", 0.6, 1.0)
        shape = [
            (0.0, 0.88),
            (0.05, 0.98),
            (0.3, 1.0),
            (0.55, 0.9),
            (0.8, 0.65),
            (0.95, 0.35),
            (1.0, 0.05),
        ]
        kit.add(
            body,
            solids.stack([(flat * s, t * deep) for t, s in shape])
            .turned("y", -90)
            .turned("y", 0)
            .at(deep / 2, 0, height * 0.6),
        )
        kit.add(
            glass,
            box(0.01, width * 0.7, height * 0.66, 0.004).at(deep / 2 + 0.002, 0, height * 0.66),
        )
        kit.add(body, hollows.slab(kit, "foot_recess", rect(deep * 0.6, width * 0.7, 0.02), 0.1))
    else:
        for material, part in _panel(body, glass, width, height, 0.05, 0.02, height * 0.1):
            kit.add(material, part.at(z=-height / 2).turned("y", -6).at(0, 0, lift + height / 2))
        bend = solids.smooth_path(
            [
                (0.14, 0, 0.006),
                (-0.08, 0, 0.006),
                (-0.12, 0, 0.03),
                (-0.04, 0, lift + height * 0.3),
            ],
            5,
        )
        kit.add(
            CHROME, solids.sweep(solids.rounded(width * 0.35, 0.012, 0.003, 1), bend, (0, 1, 0))
        )
        kit.add(
            CHROME, hollows.slab(kit, "foot_recess", rect(0.14, width * 0.33, 0.01), 0.03).at(-0.04)
        )
    if style == "tower":
        s, tall = kit.choose("side", -1, 1), kit.uniform("tower", 0.34, 0.5)
        kit.add(body, box(tall, 0.2, tall, 0.008).at(-0.1, s * (width / 2 + 0.2), tall / 2))
        kit.add(
            BLACK,
            box(0.006, 0.15, 0.03).at(tall / 2 - 0.1, s * (width / 2 + 0.2), tall * 0.85),
            box(0.006, 0.15, 0.03).at(tall / 2 - 0.1, s * (width / 2 + 0.2), tall * 0.75),
        )
    if kit.chance("keyboard", 0.6):
        x = 0.34
        kit.add(WHITE, box(0.14, width * 0.9, 0.02, 0.006).at(x, 0, 0.01))
        for i in range(4):
            kit.add(body, box(0.024, width * 0.84, 0.008).at(x - 0.045 + 0.03 * i, 0, 0.022))
        kit.add(WHITE, solids.cushion(0.1, 0.06, 0.04, 2.5, 2.2, 20).at(x, -width * 0.58, 0.018))


def _sign(kit: Kit) -> None:
    """A kiosk, an upright sign, a projection screen, a scoreboard."""
    body, glass = _materials(kit)
    style = kit.choose("style", "totem", "kiosk", "projection", "board")
    if style == "totem":
        high, wide = kit.uniform("height", 1.6, 2.1), kit.uniform("width", 0.6, 0.9)
        kit.add(body, hollows.slab(kit, "foot_recess", rect(0.45, wide * 1.1, 0.03), 0.04))
        kit.add(body, box(0.1, wide, high, 0.02).at(0, 0, high / 2))
        kit.add(glass, box(0.01, wide * 0.9, high * 0.68).at(0.05, 0, high * 0.6))
        return
    if style == "kiosk":
        high, wide = kit.uniform("height", 1.0, 1.4), kit.uniform("width", 0.35, 0.55)
        kit.add(body, hollows.slab(kit, "foot_recess", rect(0.45, wide * 1.2, 0.05), 0.04))
        shape = [
            (-0.15, 0),
            (0.15, 0),
            (0.1, high * 0.8),
            (0.28, high * 0.85),
            (-0.06, high + 0.15),
            (-0.2, high + 0.1),
        ]
        kit.add(body, solids.prism(shape, wide, 0.01))
        a, b = np.array([0.28, high * 0.85]), np.array([-0.06, high + 0.15])
        tip = np.degrees(np.arctan2(b[1] - a[1], a[0] - b[0]))
        pane = box(float(np.linalg.norm(a - b)) * 0.86, wide * 0.86, 0.01).turned("y", tip)
        kit.add(glass, pane.at((a[0] + b[0]) / 2, 0, (a[1] + b[1]) / 2))
        return
    if style == "projection":
        wide = kit.uniform("width", 1.4, 2.2)
        tall = wide / kit.uniform("aspect", 1.2, 1.8)
        lift = kit.uniform("lift", 0.5, 1.0)
        kit.add(
            BLACK, hollows.slab(kit, "roll_recess", rect(0.1, wide + 0.1, 0.03), 0.09).at(z=lift)
        )
        kit.add(WHITE, box(0.01, wide, tall).at(0, 0, lift + tall / 2))
        kit.both(BLACK, box(0.012, 0.05, tall).at(0, wide / 2, lift + tall / 2))
        kit.add(
            BLACK,
            box(0.04, wide + 0.05, 0.04).at(0, 0, lift + tall),
            rod((-0.03, 0, 0.1), (-0.03, 0, lift + tall), 0.014),
        )
        for angle in around(3, 90):
            foot = rod((0, 0, 0.3), (0.55, 0, 0.01), 0.012)
            kit.add(BLACK, foot.turned("z", angle).at(-0.03))
        return
    wide = kit.uniform("width", 1.2, 2.0)
    tall, lift = wide * kit.uniform("tall", 0.35, 0.6), kit.uniform("lift", 0.8, 1.6)
    kit.add(body, hollows.slab(kit, "foot_recess", rect(0.2, wide, 0.02), 0.3).at(z=lift))
    kit.add(body, box(0.2, wide, tall, 0.02).at(0, 0, lift + tall / 2))
    kit.add(glass, box(0.01, wide * 0.92, tall * 0.84).at(0.1, 0, lift + tall / 2))
    post = metal(kit.rng)
    for s in (-1, 1) if kit.chance("two_posts", 0.6) else (0,):
        kit.add(
            post,
            cylinder(0.05, lift + 0.1, 16).at(0, s * wide * 0.38, lift / 2),
            box(0.4, 0.2, 0.03).at(0, s * wide * 0.38, 0.015),
        )


def _tablet(kit: Kit) -> None:
    """A tablet or frame on an easel, a touch screen on an arm, a small set with a handle."""
    body, glass = _materials(kit)
    style = kit.choose("style", "easel", "arm", "portable", "flat")
    width = kit.uniform("width", 0.2, 0.34)
    height = width * kit.choose("format", 0.6, 0.75, 1.35)
    parts = _panel(body, glass, width, height, 0.014, 0.018)
    if style == "flat":
        kit.add(body, hollows.slab(kit, "foot_recess", rect(height, width, 0.015), 0.014, 0.008))
        kit.add(glass, box(height * 0.86, width * 0.88, 0.003).at(z=0.0135))
        if kit.chance("keyboard", 0.5):
            kit.add(body, box(height * 0.7, width, 0.012, 0.004).at(height * 0.9, 0, 0.006))
            for i in range(4):
                kit.add(
                    BLACK,
                    box(height * 0.12, width * 0.9, 0.004).at(height * (0.66 + 0.16 * i), 0, 0.013),
                )
        return
    if style == "easel":
        lean = kit.uniform("lean", 12, 35)
        for material, part in parts:
            kit.add(material, part.turned("y", -lean).at(0.0, 0, 0.015))
        far = np.sin(np.radians(lean)) * height
        kit.add(
            body,
            hollows.slab(kit, "foot_recess", rect(0.08 + far, width * 0.5, 0.01), 0.015, 0.008).at(
                -far / 2
            ),
        )
        kit.add(body, rod((-far - 0.03, 0, 0.01), (-far * 0.7, 0, height * 0.7), 0.007))
        return
    if style == "arm":
        kit.add(body, hollows.slab(kit, "foot_recess", rect(0.16, 0.16, 0.03), 0.02, 0.01).at(-0.2))
        lift = kit.uniform("lift", 0.15, 0.35)
        kit.add(
            metal(kit.rng),
            cylinder(0.014, lift, 12).at(-0.2, 0, lift / 2),
            tube([(-0.2, 0, lift), (-0.1, 0.1, lift + 0.05), (-0.01, 0, lift + 0.06)], 0.012),
        )
        for material, part in parts:
            kit.add(material, part.at(0, 0, lift + 0.06 - height / 2))
        return
    deep = width * kit.uniform("deep", 0.6, 1.1)
    kit.add(body, hollows.slab(kit, "foot_recess", rect(deep, width * 1.1, 0.02), 0.04).at())
    kit.add(body, box(deep, width * 1.1, height, 0.02).at(0, 0, height / 2 + 0.03))
    kit.add(
        glass,
        box(0.01, width * 0.66, height * 0.7, 0.004).at(deep / 2, -width * 0.16, height / 2 + 0.03),
    )
    kit.add(
        BLACK,
        *(
            cylinder(0.018, 0.02, 14).turned("y", 90).at(deep / 2, width * 0.38, height * t)
            for t in (0.35, 0.55, 0.8)
        ),
    )
    t = np.linspace(0, np.pi, 11)
    kit.add(
        CHROME,
        tube(
            np.stack(
                [0 * t, width * 0.4 * np.cos(t), height + 0.03 + 0.08 * np.sin(t) ** 0.5], axis=1
            ),
            0.008,
        ),
    )
    kit.add(
        CHROME,
        rod(
            (-deep * 0.3, width * 0.3, height),
            (-deep * 0.3, width * 0.75, height * kit.uniform("aerial", 1.5, 2.4)),
            0.004,
            6,
        ),
    )


KINDS: dict[str, Callable[[Kit], None]] = {
    "desk": _desk, "tv": _tv, "tube": _tube, "curved": _curved, "laptop": _laptop, "several": _dual,
    "computer": _all_in_one, "sign": _sign, "small": _tablet,
}  # fmt: skip

_WEIGHTS = {"desk": 2, "tv": 3, "tube": 2}


def monitor(kit: Kit) -> None:
    """Nine subtypes, see `KINDS`. Hidden: the depth of the recess in the foot."""
    kit.build_subtype(KINDS, _WEIGHTS)

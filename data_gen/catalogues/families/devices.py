"""Speakers, monitors, cellphones."""

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families.kit import (
    BLACK,
    CHROME,
    RUBBER,
    WHITE,
    Kit,
    case,
    lacquer,
    pick,
    plastic,
    screen,
    wood,
)
from data_gen.catalogues.solids import Solid, ball, box, cylinder, lathe, loft, prism, rod
from data_gen.meshes import Material


def speaker(kit: Kit) -> None:
    """Tower, bookshelf, on a stand, stage monitor, sound bar, round. Hidden: the recess behind."""
    kind = kit.choose("subtype", "tower", "bookshelf", "bookshelf", "stand", "stage", "bar")
    body = pick(kit.rng, (wood, plastic, lacquer))(kit.rng)
    cone = pick(
        kit.rng,
        (
            BLACK,
            Material((0.2, 0.2, 0.22), name="cone"),
            Material((0.85, 0.7, 0.2), name="kevlar"),
            Material((0.8, 0.8, 0.8), name="aluminium"),
        ),
    )
    grille = Material((0.13, 0.13, 0.14), name="grille")
    size = {
        "tower": ((0.18, 0.26), (0.85, 1.2), (0.24, 0.36)),
        "bookshelf": ((0.17, 0.24), (0.28, 0.42), (0.2, 0.3)),
        "stand": ((0.17, 0.24), (0.28, 0.42), (0.2, 0.3)),
        "stage": ((0.35, 0.5), (0.55, 0.8), (0.3, 0.42)),
        "bar": ((0.8, 1.2), (0.09, 0.14), (0.1, 0.16)),
    }[kind]
    width, height, depth = (
        kit.uniform(n, *r) for n, r in zip(("width", "height", "depth"), size, strict=True)
    )
    lift = 0.0
    if kind == "tower" or (kind == "bookshelf" and kit.chance("feet", 0.5)):
        lift = 0.025
        for sx in (-1, 1):
            for sy in (-1, 1):
                kit.add(
                    BLACK,
                    lathe([(0.006, 0), (0.016, lift + 0.002)], 10).at(
                        sx * (depth / 2 - 0.03), sy * (width / 2 - 0.03)
                    ),
                )
    elif kind == "stand":
        lift = kit.uniform("stand_height", 0.5, 0.7)
        kit.add(
            BLACK,
            box(depth * 1.05, width * 1.2, 0.02, 0.005).at(z=0.01),
            box(depth * 0.9, width * 0.9, 0.015).at(z=lift - 0.008),
        )
        kit.add(BLACK, cylinder(0.025, lift - 0.02, 14).at(z=lift / 2))
    back = kit.hide("back_recess", 0.0, 0.75) * depth
    kit.azimuth = ((-85.0, 85.0),)
    kit.add(body, case(depth, width, height, 0.015, back).at(z=lift))
    front = depth / 2

    def driver(radius: float, y: float, z: float) -> None:
        d = 0.1 * radius + 0.003
        outer, soft = 0.9 * radius, 0.8 * radius
        ring = [(outer, 0), (radius, 0), (radius, d), (0.93 * radius, 1.3 * d), (outer, d)]
        rim = lathe(ring, 28, loop=True)
        edge = [(soft, 0), (outer, 0), (outer, 0.6 * d), (0.86 * radius, 1.1 * d), (soft, 0.8 * d)]
        surround = lathe(edge, 28, loop=True)
        funnel = lathe([(soft, 0), (soft, 0.8 * d), (0.3 * radius, 0.0035)], 28)
        dome = ball(radius * 0.5, radius * 0.5, radius * 0.3, 14).at(z=0.003)
        for material, part in ((CHROME, rim), (RUBBER, surround), (cone, funnel), (BLACK, dome)):
            kit.add(material, part.turned("y", 90).at(front, y, z))

    kit.add(grille, box(0.004, width * 0.94, height * 0.96, 0.001).at(front, 0, lift + height / 2))
    if kind == "bar":
        for y in np.linspace(-0.42, 0.42, kit.choose("drivers", 4, 5, 6, 8)) * width:
            driver(height * 0.34, y, lift + height / 2)
    elif kind == "stage":
        driver(width * 0.4, 0, lift + height * 0.34)
        horn = prism([(0, -0.1), (0.012, -0.14), (0.012, 0.14), (0, 0.1)], width * 0.62).turned(
            "z", 0
        )
        kit.add(BLACK, horn.scaled(1, 1, height).at(front, 0, lift + height * 0.79))
        kit.add(
            CHROME,
            box(0.006, width * 0.2, height * 0.06).at(front + 0.009, 0, lift + height * 0.79),
        )
        kit.both(BLACK, box(depth * 0.4, 0.006, 0.09, 0.002).at(0, width / 2, lift + height * 0.7))
    else:
        woofers = kit.choose("woofers", 2, 3, 4) if kind == "tower" else 1
        r = width * 0.4
        pitch = min(2.15 * r, height * 0.68 / woofers)
        for k in range(woofers):
            driver(min(r, pitch * 0.47), 0, lift + height * 0.06 + pitch * (k + 0.5))
        driver(
            width * 0.17,
            0,
            lift + min(height * 0.06 + pitch * woofers + width * 0.24, height - width * 0.2),
        )
        if kind == "tower" and kit.chance("midrange", 0.5):
            driver(width * 0.24, 0, lift + height - width * 0.3)


def monitor(kit: Kit) -> None:
    """Desk monitor, television, CRT, curved, laptop. Hidden: the bulge behind the screen."""
    kind = kit.choose("subtype", "desk", "desk", "tv", "crt", "curved", "laptop")
    body, glass = plastic(kit.rng), screen(kit.rng)
    width = (
        kit.uniform("width", 0.9, 1.3)
        if kind in ("tv", "curved")
        else kit.uniform("width", 0.45, 0.65)
    )
    aspect = kit.uniform("aspect", 1.25, 1.4) if kind == "crt" else kit.uniform("aspect", 1.5, 1.9)
    if kind == "curved":
        aspect = kit.uniform("aspect", 2.0, 2.4)
    height = width / aspect
    bezel, thick = (
        width * kit.uniform("bezel", 0.012, 0.04),
        width * kit.uniform("thickness", 0.03, 0.06),
    )
    kit.azimuth = ((-30.0, 30.0),)

    def bulge(low: float, reach: float) -> None:
        """A housing behind the screen, inside the wedge that the screen hides from above."""
        deep = kit.hide("bulge_depth", 0.05, 1.0) * reach
        wide = kit.hide("bulge_width", 0.3, 0.6) * width
        tall = kit.hide("bulge_height", 0.3, 0.6) * height
        outer = np.array([[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]])
        rings = [
            np.column_stack([np.full(4, x), outer * [wide * s, tall * s]])
            for x, s in ((0.0, 1.0), (-deep, 0.6))
        ]
        kit.add(body, loft(rings).at(-thick / 2 + 0.001, 0, low + tall * 0.5 + 0.02 * height))

    if kind == "laptop":
        depth = width * kit.uniform("deck", 0.62, 0.72)
        kit.add(body, box(depth, width, 0.022, 0.005).at(depth / 2, 0, 0.011))
        kit.add(BLACK, box(depth * 0.45, width * 0.86, 0.004).at(depth * 0.4, 0, 0.023))
        for i in range(4):
            for j in range(10):
                kit.add(
                    body,
                    box(depth * 0.08, width * 0.065, 0.004).at(
                        depth * (0.24 + 0.105 * i), (j - 4.5) * width * 0.083, 0.026
                    ),
                )
        kit.add(BLACK, box(depth * 0.2, width * 0.26, 0.002).at(depth * 0.8, 0, 0.0225))
        lean = kit.uniform("lean", 8, 25)
        lid = box(0.014, width, height, 0.004).at(0, 0, height / 2)
        show = box(0.002, width - 2 * bezel, height - 2 * bezel).at(0.008, 0, height / 2)
        kit.add(body, lid.turned("y", -lean).at(0, 0, 0.02))
        kit.add(glass, show.turned("y", -lean).at(0, 0, 0.02))
        # Feet, battery pack: a wedge below the lid's shadow, no deeper than the lid leans back.
        reach = max(np.sin(np.radians(lean)) * height * 0.55, 0.01)
        deep = kit.hide("rear_pack", 0.02, 1.0) * reach
        kit.add(body, box(deep, width * 0.6, 0.016).at(-deep / 2 - 0.004, 0, 0.009))
        return
    if kind == "crt":
        deep = width * kit.uniform("tube_depth", 0.7, 0.9)
        low = 0.06
        face = np.array([[0.5, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.5, -0.5]]) * [width, height]
        shape = [
            (deep * 0.5, 0.97),
            (deep * 0.48, 1.0),
            (deep * 0.2, 1.0),
            (-deep * 0.05, 0.86),
            (-deep * 0.5, 0.62),
        ]
        rings = [np.column_stack([np.full(4, x), face * s]) for x, s in shape]
        kit.add(body, loft(rings).at(z=low + height / 2))
        kit.add(
            glass,
            box(0.01, width * 0.84, height * 0.8, 0.004).at(deep * 0.5, 0, low + height * 0.53),
        )
        kit.add(
            BLACK,
            *(
                box(0.008, 0.02, 0.01).at(deep * 0.5, width * (0.2 + 0.06 * k), low + height * 0.07)
                for k in range(4)
            ),
        )
        kit.add(
            body,
            cylinder(width * 0.3, 0.03, 24).at(deep * 0.1, 0, 0.015),
            cylinder(width * 0.14, low + 0.02, 20).at(deep * 0.1, 0, low / 2),
        )
        # Behind the wide front part, on the tube's underside.
        kit.azimuth = ((-20.0, 20.0),)
        pack = kit.hide("yoke_depth", 0.05, 0.42) * deep
        kit.add(
            body,
            box(pack, width * 0.4, height * 0.3).at(-deep * 0.02 - pack / 2, 0, low + height * 0.3),
        )
        return
    lift = width * kit.uniform("lift", 0.08, 0.2)
    if kind == "tv":
        lift = width * 0.06
    centre = lift + height / 2
    if kind == "curved":
        bend = kit.uniform("bend", 0.1, 0.25)
        y = np.linspace(-0.5, 0.5, 17)

        def shell(w: float, h: float, x0: float, x1: float) -> Solid:
            ring = [
                np.array(
                    [
                        [x0 + bend * width * t * t * 2, w * t, -h / 2],
                        [x1 + bend * width * t * t * 2, w * t, -h / 2],
                        [x1 + bend * width * t * t * 2, w * t, h / 2],
                        [x0 + bend * width * t * t * 2, w * t, h / 2],
                    ]
                )
                for t in y
            ]
            return loft(np.array(ring))

        kit.add(body, shell(width, height, -thick / 2, thick / 2).at(z=centre))
        kit.add(
            glass,
            shell(width - 2 * bezel, height - 2 * bezel, thick / 2, thick / 2 + 0.004).at(z=centre),
        )
    else:
        kit.add(body, box(thick, width, height, thick * 0.2).at(z=centre))
        kit.add(
            glass,
            box(0.006, width - 2 * bezel, height - 2.4 * bezel).at(
                thick / 2, 0, centre + 0.2 * bezel
            ),
        )
    stand = (
        kit.choose("stand", "feet", "plate")
        if kind == "tv"
        else kit.choose("stand", "plate", "disc", "vee")
    )
    reach = width * kit.uniform("stand_depth", 0.16, 0.24)
    if stand == "feet":
        for s in (-1, 1):
            for sign in (-1, 1):
                kit.add(
                    body,
                    rod(
                        (0, s * width * 0.36, lift + 0.01),
                        (sign * reach * 0.8, s * width * 0.36, 0.01),
                        0.012,
                    ),
                )
        reach *= 0.8
    else:
        if stand == "plate":
            kit.add(body, box(2 * reach, width * 0.45, 0.014, 0.004).at(z=0.007))
        elif stand == "disc":
            kit.add(body, cylinder(reach, 0.014, 32, 0.003).scaled(1, 1.3, 1).at(z=0.007))
        else:
            for s in (-1, 1):
                kit.add(
                    body,
                    rod((0, 0, 0.012), (reach, s * width * 0.3, 0.012), 0.011),
                    rod((0, 0, 0.012), (-reach, s * width * 0.16, 0.012), 0.011),
                )
        kit.add(
            body,
            box(thick * 0.6, width * 0.1, lift + height * 0.25).at(
                -thick * 0.6, 0, (lift + height * 0.25) / 2
            ),
        )
    bulge(lift, max(reach - thick / 2 - 0.01, 0.01))


def cellphone(kit: Kit) -> None:
    """Smartphone, candy bar, flip, slider, with keyboard. Hidden: how far the back is recessed."""
    kind = kit.choose(
        "subtype", "smartphone", "smartphone", "candybar", "flip", "slider", "keyboard"
    )
    body, glass = pick(kit.rng, (plastic, plastic, lacquer))(kit.rng), screen(kit.rng)
    key = WHITE if max(body.diffuse) < 0.5 else BLACK
    width = kit.uniform("width", 0.06, 0.078)
    height = width * kit.uniform("aspect", 1.85, 2.15)
    thick = (
        kit.uniform("thickness", 0.008, 0.012)
        if kind == "smartphone"
        else kit.uniform("thickness", 0.014, 0.02)
    )
    corner = width * kit.uniform("corner", 0.06, 0.2)
    kit.azimuth = ((-80.0, 80.0),)

    def slab(tall: float, deep: float, inner: float) -> Solid:
        """An upright slab whose front is at x = deep / 2, its back hollowed out."""
        wall = width * 0.05

        def outline(inward: float) -> np.ndarray:
            return solids.rounded(
                tall - 2 * inward, width - 2 * inward, max(corner - inward, 0.001), 4
            )

        bevel = deep * 0.18
        part = solids.stack(
            [
                (outline(wall), max(inner, 0.0002)),
                (outline(wall), 0.0),
                (outline(bevel * 0.5), 0.0),
                (outline(0.0), bevel),
                (outline(0.0), deep - bevel),
                (outline(bevel), deep),
            ]
        )
        return part.turned("y", 90).at(-deep / 2, 0, tall / 2)

    def keypad(front: float, low: float, high: float, rows: int) -> None:
        pitch = (high - low) / rows
        for i in range(rows):
            for j in range(3):
                kit.add(
                    key,
                    box(0.0012, width * 0.22, pitch * 0.62, 0.0003).at(
                        front, (j - 1) * width * 0.28, low + (i + 0.5) * pitch
                    ),
                )

    recess = kit.hide("back_recess", 0.02, 0.85) * thick
    front = thick / 2
    if kind == "smartphone":
        kit.add(body, slab(height, thick, recess))
        border = kit.uniform("border", 0.03, 0.14)
        kit.add(
            glass, box(0.0008, width * 0.92, height * (1 - border) - 0.003).at(front, 0, height / 2)
        )
        if border > 0.1:
            kit.add(
                CHROME,
                cylinder(width * 0.07, 0.001, 18)
                .turned("y", 90)
                .at(front, 0, height * border * 0.25),
            )
        kit.add(BLACK, box(0.001, width * 0.2, 0.0016).at(front + 0.0002, 0, height - 0.004))
        kit.both(CHROME, box(thick * 0.3, 0.0012, height * 0.08).at(0, width / 2, height * 0.7))
    elif kind == "candybar":
        kit.add(body, slab(height, thick, recess))
        kit.add(glass, box(0.001, width * 0.76, height * 0.36, 0.0003).at(front, 0, height * 0.72))
        keypad(front, height * 0.06, height * 0.4, 4)
        kit.add(
            CHROME, cylinder(width * 0.12, 0.0016, 18).turned("y", 90).at(front, 0, height * 0.46)
        )
        if kit.chance("antenna", 0.6):
            kit.add(
                BLACK, cylinder(thick * 0.32, height * 0.24, 12).at(0, width * 0.36, height * 1.08)
            )
    elif kind == "keyboard":
        kit.add(body, slab(height * 0.92, thick, recess))
        kit.add(glass, box(0.001, width * 0.84, height * 0.38, 0.0003).at(front, 0, height * 0.66))
        for i in range(4):
            for j in range(8):
                kit.add(
                    key,
                    box(0.0012, width * 0.085, height * 0.06, 0.0003).at(
                        front, (j - 3.5) * width * 0.11, height * (0.07 + 0.08 * i)
                    ),
                )
        kit.add(
            CHROME, cylinder(width * 0.06, 0.002, 16).turned("y", 90).at(front, 0, height * 0.42)
        )
    elif kind == "slider":
        kit.add(body, slab(height * 0.8, thick * 0.55, recess * 0.5).at(-thick * 0.28))
        upper = slab(height * 0.8, thick * 0.45, 0.0)
        slide = height * kit.uniform("slide", 0.25, 0.4)
        kit.add(body, upper.at(thick * 0.28, 0, slide))
        kit.add(
            glass,
            box(0.001, width * 0.84, height * 0.56, 0.0003).at(
                front + thick * 0.02, 0, slide + height * 0.46
            ),
        )
        kit.add(
            CHROME,
            cylinder(width * 0.1, 0.0016, 18)
            .turned("y", 90)
            .at(front + thick * 0.02, 0, slide + height * 0.09),
        )
        keypad(0.0, height * 0.03, slide * 0.95, 3)
    else:
        half = height * 0.62
        kit.add(body, slab(half, thick, recess))
        keypad(front, half * 0.08, half * 0.62, 4)
        kit.add(
            CHROME, cylinder(width * 0.14, 0.0016, 18).turned("y", 90).at(front, 0, half * 0.78)
        )
        tip = kit.uniform("open_angle", 8, 25)
        lid = slab(half, thick * 0.6, 0.0)
        kit.add(body, lid.turned("y", tip).at(thick * 0.1, 0, half * 1.0))
        show = box(0.001, width * 0.78, half * 0.66, 0.0003).at(thick * 0.3, 0, half * 0.54)
        kit.add(glass, show.turned("y", tip).at(thick * 0.1, 0, half * 1.0))
        kit.add(CHROME, cylinder(thick * 0.42, width * 0.9, 14).turned("x", 90).at(0.0, 0, half))

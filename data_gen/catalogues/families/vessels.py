"""Bottles and cans, vases and bowls, cups and pots."""

import numpy as np

from data_gen.catalogues.families import materials, shapes
from data_gen.catalogues.families.kit import Kit, lacquer, metal, pick, plastic, wood
from data_gen.catalogues.families.mapping import Wrapped
from data_gen.catalogues.families.materials import Material
from data_gen.catalogues.solids import (
    Solid,
    box,
    cylinder,
    lathe,
    rounded,
    smooth_path,
    stack,
    tube,
)

_GLASS = (
    (0.1, 0.22, 0.1),
    (0.3, 0.17, 0.06),
    (0.12, 0.12, 0.12),
    (0.55, 0.62, 0.62),
    (0.25, 0.35, 0.5),
    (0.8, 0.82, 0.8),
)


def _coloured_glass(kit: Kit) -> Material:
    colour = materials.shade_of(pick(kit.rng, _GLASS), kit.rng, 0.2)
    return Material(colour, (0.6, 0.6, 0.6), 110.0, name="bottle glass")


def _sleeve(profile: list[tuple[float, float]], low: float, high: float, sides: int = 28) -> Solid:
    """A thin label around a profile, between two heights."""
    z = np.linspace(low, high, 7)
    r = np.interp(z, [b for _, b in profile], [a for a, _ in profile])
    return lathe([(a * 1.012, b) for a, b in zip(r, z, strict=True)], sides)


def bottle(kit: Kit) -> None:
    """Wine, beer, soda, flask, jar, can, spray, square, canister: with labels and caps."""
    kind = kit.choose(
        "subtype", "wine", "beer", "soda", "jar", "can", "spray", "square", "flask", "canister"
    )
    rng = kit.rng
    skin = (
        _coloured_glass(kit)
        if kind in ("wine", "beer", "flask") or rng.random() < 0.4
        else plastic(rng)
    )
    cap = pick(rng, (metal, plastic, lacquer, wood))(rng)
    height, r = 1.0, kit.uniform("radius", 0.13, 0.24)
    neck = kit.uniform("neck", 0.25, 0.45) * r
    shoulder = kit.uniform("shoulder", 0.5, 0.72)
    print_ = materials.label(rng, "bottle", Wrapped((kit.choose("prints", 1, 2, 3), 1.0)))
    if kind in ("square", "canister"):
        depth = r * kit.uniform("depth", 0.9, 1.8)
        body = kit.uniform("body", 0.6, 0.8)
        outline = rounded(depth, 2 * r, 0.2 * r, 3)
        kit.add(
            skin,
            stack(
                [
                    (0.95 * outline, 0),
                    (outline, 0.02),
                    (outline, body),
                    (0.45 * outline, body + 0.12),
                    (0.42 * outline, body + 0.15),
                ]
            ),
        )
        kit.add(cap, cylinder(0.36 * r, 0.1, 20, 0.01).at(z=body + 0.19))
        if kind == "canister":
            grip = smooth_path(
                [
                    (0, -0.8 * r, body),
                    (0, -0.7 * r, body + 0.2),
                    (0, 0.3 * r, body + 0.25),
                    (0, 0.6 * r, body + 0.05),
                ],
                5,
            )
            kit.add(skin, tube(grip, 0.07 * r + 0.01, 8))
        face = materials.label(rng, "bottle")
        kit.add(face, stack([(1.01 * outline, 0.12 * body), (1.01 * outline, 0.85 * body)]))
        return
    if kind in ("wine", "beer", "soda", "flask"):
        waist = 0.85 if kind == "soda" else 1.4 if kind == "flask" else 1.0
        points = [
            (0.92 * r, 0),
            (r, 0.03),
            (r * (1 + (waist - 1) * 0.7), 0.3),
            (r, shoulder),
            (neck * 1.2, shoulder + 0.18),
            (neck, 0.9),
            (neck, height),
        ]
        profile = (
            shapes.curve(points, 4)
            if kind in ("soda", "flask")
            else [*points[:4], *shapes.curve(points[3:6], 5)[1:], points[6]]
        )
        kit.add(skin, lathe([(0, 0.015), *profile, (0, height)], 28))
        kit.add(
            cap,
            lathe(
                [(neck * 1.15, height - 0.07), (neck * 1.15, height + 0.02), (0, height + 0.02)], 20
            ),
        )
        if kind == "wine":
            kit.add(cap, _sleeve(profile, 0.82, 0.94))
    else:
        top = {"jar": 0.62, "can": 0.55, "spray": 0.75}[kind]
        width = r * (1.5 if kind != "spray" else 1.0)
        profile = [(0.94 * width, 0), (width, 0.02), (width, top - 0.06), (0.9 * width, top)]
        kit.add(
            metal(rng) if kind != "jar" else skin,
            lathe([(0, 0.01), *profile, (0, top - 0.005)], 32),
        )
        shoulder = top * 0.9
        r = width
        if kind == "jar":
            kit.add(
                cap, lathe([(0.95 * r, top - 0.03), (0.95 * r, top + 0.06), (0, top + 0.06)], 28)
            )
        elif kind == "can":
            kit.add(metal(rng), box(0.16 * r, 0.4 * r, 0.01).at(0.3 * r, 0, top + 0.004))
        else:
            kit.add(
                cap,
                lathe(
                    [(0.9 * r, top), (0.9 * r, top + 0.15), (0.7 * r, top + 0.2), (0, top + 0.2)],
                    24,
                ),
            )
    if kit.chance("label", 0.85):
        low = kit.uniform("label_low", 0.08, 0.2) * shoulder
        high = kit.uniform("label_high", 0.7, 0.95) * shoulder
        if kind == "can":
            low, high = 0.04, shoulder - 0.02
        kit.add(print_, _sleeve(profile, low, high, 32))


def _handle(
    kit: Kit, skin: Material, r: float, low: float, high: float, out: float, y: float, thick: float
) -> None:
    path = [
        (0, y * r * 0.92, low),
        (0, y * (r + 0.8 * out), low + 0.1 * (high - low)),
        (0, y * (r + out), 0.5 * (low + high)),
        (0, y * (r + 0.7 * out), high),
        (0, y * r * 0.9, high - 0.08 * (high - low)),
    ]
    kit.add(skin, tube(smooth_path(path, 5), thick, 10))


def vase(kit: Kit) -> None:
    """Vases (straight or twisted), amphoras, jugs, bowls, plates, baskets."""
    kind = kit.choose(
        "subtype", "vase", "vase", "amphora", "jug", "bowl", "plate", "basket", "twisted"
    )
    rng = kit.rng
    skin = materials.ceramic(rng)
    if kind == "basket":
        skin = materials.wicker(rng)
    elif rng.random() < 0.2:
        skin = pick(rng, (metal, wood, materials.marble, materials.terracotta))(rng)
    h = kit.uniform("height", 0.7, 1.3)
    radii = [
        kit.uniform(f"radius_{k}", a, b)
        for k, (a, b) in enumerate(
            ((0.12, 0.3), (0.2, 0.45), (0.22, 0.5), (0.08, 0.3), (0.12, 0.35))
        )
    ]
    if kind in ("bowl", "plate"):
        h = 0.4 if kind == "bowl" else kit.uniform("rim", 0.06, 0.12)
        wide = kit.uniform("width", 0.45, 0.6)
        outside = shapes.curve(
            [(0.4 * wide, 0), (0.4 * wide, 0.04), (0.85 * wide, 0.45 * h), (wide, h)]
        )
        kit.add(skin, shapes.vessel(outside, 0.03, 0.06 if kind == "bowl" else 0.045, 40))
        if kind == "bowl" and kit.chance("fruit", 0.5):
            for k in range(6):
                size, angle = rng.uniform(0.2, 0.28), k * 1.1
                colour = pick(
                    rng,
                    ((0.7, 0.12, 0.08), (0.85, 0.5, 0.1), (0.45, 0.55, 0.12), (0.85, 0.75, 0.2)),
                )
                fruit = Material(materials.shade_of(colour, rng), (0.3,) * 3, 40.0, name="fruit")  # type: ignore[arg-type]
                out = 0.22 if k < 5 else 0.0
                kit.add(
                    fruit,
                    shapes.blob(rng, size, size, 0.92 * size, 0.05, 12).at(
                        out * np.cos(angle), out * np.sin(angle), 0.3 + 0.18 * (k == 5)
                    ),
                )
        return
    if kind == "basket":
        wide = kit.uniform("width", 0.35, 0.6)
        outside = [
            (0.8 * wide, 0),
            (0.9 * wide, 0.3 * h),
            (wide, 0.6 * h),
            (1.06 * wide, 0.62 * h),
            (1.06 * wide, 0.66 * h),
        ]
        kit.add(skin, shapes.vessel(outside, 0.04, 0.05, 28))
        if kit.chance("grip", 0.6):
            arc = [
                (0, wide * np.cos(a), 0.6 * h + 0.55 * wide * np.sin(a) * 1.5)
                for a in np.linspace(0, np.pi, 9)
            ]
            kit.add(skin, tube(arc, 0.025, 8))
        return
    if kind in ("amphora", "jug"):
        radii[1], radii[3] = max(radii[1], 0.3), min(radii[3], 0.16)
    points = [
        (radii[0], 0),
        (radii[1], 0.3 * h),
        (radii[2], 0.58 * h),
        (radii[3], 0.85 * h),
        (radii[4], h),
    ]
    outside = shapes.curve(points, 6)
    part = shapes.vessel(outside, 0.025, 0.3 * h, 36)
    if kind == "twisted":
        lobes, depth, turn = (
            kit.choose("lobes", 3, 5, 8),
            kit.uniform("flute", 0.04, 0.14),
            kit.uniform("twist", 0, 3),
        )

        def flute(v: np.ndarray) -> np.ndarray:
            angle = np.arctan2(v[:, 1], v[:, 0]) + turn * v[:, 2]
            factor = 1 + depth * np.cos(lobes * angle)
            return v * np.stack([factor, factor, np.ones(len(v))], axis=1)

        part = part.bent(flute)
    kit.add(skin, part)
    if kind in ("amphora", "jug"):
        thick = kit.uniform("handle", 0.02, 0.035)
        for y in (-1, 1) if kind == "amphora" else (1,):
            _handle(kit, skin, radii[2] * 0.75, 0.5 * h, 0.92 * h, 0.2, y, thick)
    if kind == "vase" and kit.chance("stems", 0.4):
        green = materials.leaf(rng)
        kit.add(green, *[p.at(z=0.75 * h) for p in shapes.heap(rng, 12, 0.8 * h, 0.06, 0.4)])
        for _ in range(6):
            x, y = rng.normal(0, 0.2, 2)
            size = rng.uniform(0.12, 0.2)
            kit.add(
                materials.fabric(rng),
                shapes.blob(rng, size, size, 0.7 * size, 0.3, 10).at(
                    x, y, h * rng.uniform(1.2, 1.5)
                ),
            )
            kit.add(green, tube([(0, 0, 0.8 * h), (x, y, 1.25 * h)], 0.008, 5))


def cup(kit: Kit) -> None:
    """Mug, teacup with saucer, goblet, beaker, teapot, pan, cooking pot."""
    kind = kit.choose("subtype", "mug", "mug", "teacup", "goblet", "beaker", "teapot", "pan", "pot")
    rng = kit.rng
    skin = materials.ceramic(rng)
    if rng.random() < 0.3 and kind == "mug":
        skin = materials.label(rng, "bottle", Wrapped((2, 1.0)))
    if kind in ("pan", "pot") or (kind in ("goblet", "beaker") and rng.random() < 0.6):
        skin = metal(rng)
    r, h = kit.uniform("radius", 0.32, 0.42), kit.uniform("height", 0.7, 1.0)
    drink = Material(
        pick(rng, ((0.22, 0.12, 0.06), (0.5, 0.28, 0.08), (0.85, 0.82, 0.75), (0.4, 0.06, 0.06))),
        (0.4,) * 3,
        60.0,
        name="drink",
    )  # type: ignore[arg-type]
    thick = kit.uniform("handle", 0.03, 0.05)
    if kind in ("mug", "beaker"):
        taper = kit.uniform("taper", 0.7, 1.05)
        outside = [
            (0.95 * taper * r, 0),
            (taper * r, 0.03),
            (0.5 * (1 + taper) * r, 0.5 * h),
            (r, h),
        ]
        kit.add(skin, shapes.vessel(outside, 0.05, 0.08, 32))
        if kind == "mug":
            _handle(kit, skin, r, 0.2 * h, 0.85 * h, 0.24, kit.choose("side", -1, 1), thick)
        kit.add(drink, lathe([(0.9 * r, 0.8 * h), (0.9 * r, 0.82 * h), (0, 0.82 * h)], 28))
    elif kind == "teacup":
        outside = shapes.curve([(0.5 * r, 0.1), (0.5 * r, 0.13), (0.95 * r, 0.3), (1.2 * r, 0.62)])
        kit.add(skin, shapes.vessel(outside, 0.03, 0.16, 32))
        _handle(kit, skin, 1.1 * r, 0.25, 0.55, 0.18, kit.choose("side", -1, 1), 0.6 * thick)
        kit.add(drink, lathe([(0.95 * r, 0.48), (1.0 * r, 0.5), (0, 0.5)], 28))
        kit.add(
            skin,
            shapes.vessel(
                shapes.curve([(0.7 * r, 0), (0.9 * r, 0.03), (2.0 * r, 0.13)]), 0.025, 0.05, 36
            ),
        )
    elif kind == "goblet":
        bowl = kit.uniform("bowl", 0.45, 0.6)
        outside = shapes.curve(
            [
                (0.85 * r, 0),
                (0.3 * r, 0.05),
                (0.12 * r, 0.2),
                (0.12 * r, bowl * h),
                (r, h * 1.05),
                (kit.uniform("rim", 0.75, 1.1) * r, 1.4 * h),
            ]
        )
        kit.add(skin, shapes.vessel(outside, 0.03, h * 0.95, 32))
        kit.add(drink, lathe([(0.7 * r, 1.12 * h), (0.7 * r, 1.14 * h), (0, 1.14 * h)], 24))
    elif kind == "teapot":
        belly = shapes.curve(
            [(0.6 * r, 0), (1.25 * r, 0.35 * h), (1.1 * r, 0.65 * h), (0.5 * r, 0.85 * h)]
        )
        kit.add(skin, lathe([(0, 0), *belly, (0, 0.85 * h)], 32))
        lid = shapes.curve(
            [
                (0.55 * r, 0.84 * h),
                (0.3 * r, 0.95 * h),
                (0.08 * r, h),
                (0.14 * r, 1.08 * h),
                (0, 1.12 * h),
            ]
        )
        kit.add(skin, lathe(lid, 24))
        spout = [(0, 1.0 * r, 0.3 * h), (0, 1.6 * r, 0.5 * h), (0, 1.9 * r, 0.9 * h)]
        kit.add(skin, shapes.swept(spout, [0.09, 0.06, 0.035], 12))
        _handle(kit, skin, 1.1 * r, 0.25 * h, 0.75 * h, 0.3, -1, thick)
    else:
        h = kit.uniform("depth", 0.1, 0.2) if kind == "pan" else kit.uniform("depth", 0.3, 0.6)
        wide = kit.uniform("width", 0.4, 0.5)
        kit.add(
            skin, shapes.vessel([(0.9 * wide, 0), (wide, 0.05), (1.03 * wide, h)], 0.02, 0.03, 36)
        )
        grip = pick(rng, (wood, plastic, metal))(rng)
        if kind == "pan":
            kit.add(
                grip,
                shapes.swept(
                    [(0, wide, 0.8 * h), (0, wide + 0.3, h), (0, wide + 0.75, h + 0.04)],
                    [0.03, 0.04, 0.045],
                ),
            )
        else:
            for y in (-1, 1):
                _handle(kit, grip, wide, 0.55 * h, 0.8 * h, 0.12, y, 0.02)
            if kit.chance("lid", 0.7):
                kit.add(
                    skin,
                    lathe(
                        [
                            (1.05 * wide, h),
                            (1.05 * wide, h + 0.02),
                            (0.5 * wide, h + 0.08),
                            (0, h + 0.1),
                        ],
                        36,
                    ),
                )
                kit.add(
                    grip,
                    lathe(
                        [(0.03, h + 0.09), (0.03, h + 0.13), (0.07, h + 0.15), (0.0, h + 0.18)], 16
                    ),
                )

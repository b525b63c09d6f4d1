"""Legs and feet of furniture."""

from collections.abc import Callable

import numpy as np

from data_gen.catalogues import solids
from data_gen.catalogues.families.kit import BLACK, RUBBER, Kit, around, pick
from data_gen.catalogues.solids import Solid, ball, box, cylinder, lathe, rod, tube
from data_gen.mesh import Material

TURNED = (
    (
        (0.35, 0),
        (0.5, 0.08),
        (0.35, 0.16),
        (0.6, 0.45),
        (0.4, 0.6),
        (0.62, 0.66),
        (0.4, 0.72),
        (0.6, 0.78),
        (0.6, 1.0),
    ),
    (
        (0.3, 0),
        (0.42, 0.05),
        (0.28, 0.1),
        (0.75, 0.3),
        (0.85, 0.4),
        (0.4, 0.56),
        (0.55, 0.6),
        (0.4, 0.64),
        (0.5, 0.7),
        (0.62, 1.0),
    ),
    (
        (0.5, 0),
        (0.55, 0.03),
        (0.3, 0.1),
        (0.3, 0.2),
        (0.5, 0.26),
        (0.3, 0.32),
        (0.42, 0.6),
        (0.7, 0.8),
        (0.45, 0.86),
        (0.65, 0.92),
        (0.65, 1.0),
    ),
    (
        (0.6, 0),
        (0.7, 0.06),
        (0.6, 0.12),
        (0.3, 0.16),
        (1.1, 0.42),
        (1.2, 0.5),
        (1.0, 0.62),
        (0.45, 0.76),
        (0.7, 0.8),
        (0.5, 0.85),
        (0.7, 1.0),
    ),
)
"""Profiles of turned legs: (radius / thickness, height / height of the leg)."""

STYLES = ("square", "round", "tapered", "turned", "cabriole", "sabre", "hairpin", "wedge")


def leg(
    style: str, height: float, thick: float, outward: tuple[float, float], number: int = 0
) -> list[Solid]:
    """A leg with its foot at the origin.

    Args:
      style: one of `STYLES`.
      height: height of the leg.
      thick: approximate thickness at the thickest point.
      outward: horizontal direction away from the middle of the furniture.
      number: for turned legs, the index of the profile in `TURNED`; for "round", "tapered" and
        "hairpin" legs, the index of one of four slants. The other styles do not depend on it.
    """
    a, b = np.asarray(outward, float) / max(float(np.hypot(*outward)), 1e-9)
    lean = height * (0.0, 0.06, 0.12, 0.2)[number]
    top = (-a * lean, -b * lean, height)
    if style == "square":
        return [box(thick, thick, height, 0.004).at(z=height / 2)]
    if style == "round":
        return [rod((0, 0, 0), top, thick / 2, 12)]
    if style == "tapered":
        return [tube([(0, 0, 0), top], [thick * 0.3, thick * 0.7], 14)]
    if style == "turned":
        profile = [(r * thick * 0.9, h * height) for r, h in TURNED[number]]
        return [lathe(solids.smooth_profile(profile, 3), 14)]
    if style == "cabriole":
        way = [(0.5, 0), (0.45, 0.05), (0.0, 0.2), (0.1, 0.45), (0.9, 0.75), (0.7, 0.92), (0.5, 1)]
        out = min(0.12 * height, 2.5 * thick)
        path = [(a * (s - 0.5) * out, b * (s - 0.5) * out, t * height) for s, t in way]
        radius = np.interp(
            np.linspace(0, 1, 25),
            np.linspace(0, 1, 7),
            np.array([0.8, 0.75, 0.4, 0.5, 0.75, 0.9, 0.9]) * thick,
        )
        return [tube(solids.smooth_path(path, 4), radius, 12)]
    if style == "sabre":
        out = 0.16 * height
        bow = solids.rise(
            lambda t: (-a * out * (1 - (1 - t) ** 2), -b * out * (1 - (1 - t) ** 2), t * height), 8
        )
        section = solids.rounded(thick * 0.8, thick, 0.005, 1)
        return [solids.sweep(section, bow, (-b, a, 0), np.linspace(0.6, 1.1, 9))]
    if style == "hairpin":
        wide, r = max(1.2 * thick, 0.12 * height), max(0.006, 0.12 * thick)
        return [
            rod((0, 0, r), (-b * s * wide - a * lean, a * s * wide - b * lean, height), r, 8)
            for s in (-1, 1)
        ] + [ball(2 * r, 2 * r, 2 * r, 8).at(z=r)]
    # "wedge": a board that widens upward
    small, large = (
        solids.rounded(0.5 * thick, 0.5 * thick, 0.004, 1),
        solids.rounded(1.2 * thick, 1.2 * thick, 0.004, 1),
    )
    shift = np.array([-a, -b]) * 0.35 * thick
    return [solids.stack([(small, 0.0), (large + shift, height)])]


def four(
    kit: Kit,
    x: float,
    y: float,
    height: float,
    material: Material,
    *styles: str,
    thick: float | None = None,
) -> None:
    """Adds four legs with feet at (+-x, +-y), in one of the given styles, or of all."""
    style = kit.choose("legs", *(styles or STYLES))
    thick = kit.uniform("leg_thickness", 0.03, 0.07) if thick is None else thick
    number = kit.choose("leg_number", 0, 1, 2, 3)
    for sx in (-1, 1):
        for sy in (-1, 1):
            for part in leg(style, height, thick, (sx, sy), number):
                kit.add(material, part.at(sx * x, sy * y))


def star_base(kit: Kit, radius: float, height: float, material: Material) -> None:
    """A star foot with castors and a gas column."""
    arms = kit.choose("base_arms", 4, 5, 5, 5)
    for angle in around(arms, kit.uniform("base_turn", 0, 72)):
        arm = tube(
            [(0, 0, 0.11), (radius * 0.5, 0, 0.095), (radius, 0, 0.065)], [0.028, 0.022, 0.016]
        )
        kit.add(material, arm.turned("z", angle))
        castor = cylinder(0.03, 0.04, 12).turned("x", 90).at(radius, 0, 0.03)
        kit.add(RUBBER, castor.turned("z", angle))
    kit.add(material, cylinder(0.028, height - 0.1, 12).at(z=0.1 + (height - 0.1) / 2))
    kit.add(BLACK, cylinder(0.045, (height - 0.1) * 0.5, 12).at(z=0.1 + (height - 0.1) * 0.25))


def trumpet(radius: float, stem: float, height: float, sides: int = 28) -> Solid:
    """A round foot that narrows to a stem and widens again at the top."""
    return lathe(
        solids.smooth_profile(
            [
                (radius, 0),
                (radius * 0.98, 0.012),
                (radius * 0.5, 0.05),
                (stem, height * 0.35),
                (stem, height * 0.7),
                (stem * 2.0, height),
            ],
            4,
        ),
        sides,
    )


def feet(kit: Kit, x: float, y: float, height: float, material: Material) -> None:
    """Low feet below a case, within (+-x, +-y)."""
    make: dict[str, Callable[[], Solid]] = {
        "bun": lambda: lathe(
            solids.smooth_profile(
                [(0.012, 0), (0.03, height * 0.3), (0.03, height * 0.6), (0.018, height)], 3
            ),
            14,
        ),
        "block": lambda: box(0.06, 0.06, height, 0.004).at(z=height / 2),
        "peg": lambda: lathe([(0.012, 0), (0.025, height)], 12),
        "runner": lambda: box(2 * x, 0.05, height, 0.006).at(-x, 0, height / 2),
    }
    style = kit.choose("feet_style", *make)
    for sx in (1,) if style == "runner" else (-1, 1):
        for sy in (-1, 1):
            kit.add(material, make[style]().at(sx * x, sy * y))


def metal_or(
    kit: Kit, other: Material, *makers: Callable[[np.random.Generator], Material]
) -> Material:
    """`other` with probability 1/2, else a new material from one of `makers`."""
    return other if kit.rng.random() < 0.5 else pick(kit.rng, makers)(kit.rng)

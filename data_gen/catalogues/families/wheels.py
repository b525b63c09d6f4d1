"""Wheels of vehicles."""

from data_gen.catalogues.families.kit import BLACK, RUBBER, around
from data_gen.catalogues.solids import Solid, box, cylinder, lathe
from data_gen.mesh import Material

# Sections of tyre and rim: radius / radius of the wheel, y / half width of the wheel.
_TYRE = ((0.62, -1), (0.94, -1), (1, -0.6), (1, 0.6), (0.94, 1), (0.62, 1))
_RIM = ((0.64, 0.7), (0.64, 1), (0.54, 1), (0.54, 0.7))


def wheel(radius: float, width: float, spokes: int, hub: Material) -> list[tuple[Material, Solid]]:
    """A wheel at the origin with its axle along y and its outer side toward +y."""
    half = width / 2

    def ring(section: tuple[tuple[float, float], ...]) -> Solid:
        profile = [(radius * r, half * y) for r, y in section]
        return lathe(profile, 20, loop=True).turned("x", -90)

    parts = [
        (RUBBER, ring(_TYRE)),
        (BLACK, cylinder(radius * 0.63, width * 0.7, 20).turned("x", 90)),
        (hub, ring(_RIM)),
        (hub, cylinder(radius * 0.24, half, 12, 0.1 * radius).turned("x", 90).at(y=half)),
    ]
    for angle in around(spokes):
        spoke = box(radius * 0.14, half * 0.4, radius * 0.5).at(0, half * 0.75, radius * 0.36)
        parts.append((hub, spoke.turned("y", angle)))
    return parts


def small_wheel(radius: float, width: float, hub: Material) -> list[tuple[Material, Solid]]:
    """A wheel with few faces at the origin, for the landing gear of planes."""
    tyre = cylinder(radius, width, 16, 0.25 * width).turned("x", 90)
    return [(RUBBER, tyre), (hub, cylinder(radius * 0.5, width * 1.06, 12).turned("x", 90))]

"""Boats and ships."""

from collections.abc import Callable

from data_gen.catalogues.families.kit import WHITE, Kit, paint, pick, wood
from data_gen.catalogues.families.watercraft_boats import (
    catamaran,
    galleon,
    jet_ski,
    motor_yacht,
    rowing,
    sailing_yacht,
    speedboat,
)
from data_gen.catalogues.families.watercraft_ships import (
    cargo_ship,
    hovercraft,
    liner,
    submarine,
    tug,
    warship,
)
from data_gen.mesh import Material

# fmt: off
# Formatted by hand: the formatter would put every coordinate on a line of its own.

Builder = Callable[[Kit, Material, Material], None]

KINDS: dict[str, Builder] = {
    "sailing_yacht": sailing_yacht, "galleon": galleon, "rowing": rowing,
    "speedboat": speedboat, "jet_ski": jet_ski, "motor_yacht": motor_yacht,
    "catamaran": catamaran, "submarine": submarine, "hovercraft": hovercraft,
    "cargo_ship": cargo_ship, "tug": tug, "liner": liner, "warship": warship,
}


def watercraft(kit: Kit) -> None:
    """Boats and ships of 13 subtypes. Hidden: the depth of the recess in the bottom."""
    kind = kit.choose("subtype", "sailing_yacht", "warship", "cargo_ship", "rowing", "liner",
                      *KINDS)
    hulls = (lambda _: WHITE, lambda _: WHITE, lambda _: WHITE, wood, paint, paint, paint)
    skin = pick(kit.rng, hulls)(kit.rng)
    KINDS[kind](kit, skin, paint(kit.rng))

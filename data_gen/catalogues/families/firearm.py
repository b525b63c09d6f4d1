"""Firearms."""

from collections.abc import Callable

from data_gen.catalogues.families.firearm_hand import flintlock, pistol, revolver
from data_gen.catalogues.families.firearm_long import (
    assault,
    launcher,
    machine_gun,
    rifle,
    shotgun,
    sniper,
    submachine_gun,
)
from data_gen.catalogues.families.firearm_parts import POLYMERS, STEELS
from data_gen.catalogues.families.kit import Kit, pick, wood
from data_gen.mesh import Material

# fmt: off
# Formatted by hand: the formatter would put every coordinate on a line of its own.

Builder = Callable[[Kit, Material, Material], None]

KINDS: dict[str, Builder] = {
    "pistol": pistol, "revolver": revolver, "flintlock": flintlock, "rifle": rifle,
    "assault": assault, "submachine_gun": submachine_gun, "shotgun": shotgun,
    "machine_gun": machine_gun, "sniper": sniper, "launcher": launcher,
}

WOODEN = {"flintlock": 1.0, "rifle": 0.75, "shotgun": 0.7, "revolver": 0.7, "submachine_gun": 0.4}
"""Probability of a wooden stock and grip by kind; 0.33 for the others."""


def firearm(kit: Kit) -> None:
    """Firearms of 10 subtypes. Hidden: the depth of a cut-out on the far side."""
    kind = kit.choose("subtype", "pistol", "assault", *KINDS)
    steel = pick(kit.rng, STEELS)
    wooden = kit.rng.random() < WOODEN.get(kind, 0.33)
    KINDS[kind](kit, steel, wood(kit.rng) if wooden else pick(kit.rng, POLYMERS))

"""Planes and helicopters."""

from data_gen.catalogues.families.kit import WHITE, Kit, paint, pick
from data_gen.catalogues.families.plane_jets import (
    airliner,
    business,
    fighter,
    flying_wing,
    supersonic,
)
from data_gen.catalogues.families.plane_propellers import (
    biplane,
    flying_boat,
    glider,
    helicopter,
    light,
    turboprop,
    ultralight,
    warbird,
)
from data_gen.mesh import Material

# fmt: off
# Formatted by hand: the formatter would put every coordinate on a line of its own.

KINDS = {
    "airliner": airliner, "business": business, "turboprop": turboprop, "light": light,
    "biplane": biplane, "glider": glider, "fighter": fighter, "warbird": warbird,
    "flying_wing": flying_wing, "supersonic": supersonic, "flying_boat": flying_boat,
    "helicopter": helicopter, "ultralight": ultralight,
}

GREYS = ((0.42, 0.45, 0.36), (0.36, 0.38, 0.3), (0.5, 0.52, 0.55), (0.62, 0.64, 0.68),
         (0.3, 0.32, 0.34), (0.55, 0.5, 0.4))
"""Military colours."""


def plane(kit: Kit) -> None:
    """Planes of 13 subtypes. Hidden: the depth of a bay in the belly."""
    kind = kit.choose("subtype", "airliner", "airliner", "fighter", "fighter", "light", "warbird",
                      *KINDS)
    grey = Material(pick(kit.rng, GREYS), (0.15,) * 3, 20.0, name="service paint")
    civil = paint(kit.rng) if kind not in ("airliner", "business",
                                           "glider") or kit.rng.random() < 0.2 else WHITE
    service = {"fighter": 0.85, "warbird": 0.75, "flying_wing": 0.85, "helicopter": 0.3}.get(kind,
                                                                                             0.05)
    skin = grey if kit.rng.random() < service else WHITE if kit.rng.random() < 0.25 else civil
    KINDS[kind](kit, skin, paint(kit.rng))

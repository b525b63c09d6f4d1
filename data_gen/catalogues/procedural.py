"""Catalogue of procedural models: parametric families of the 13 categories of the paper."""

import functools
import os
from collections.abc import Callable

import numpy as np

from data_gen.catalogues.entry import FRACTIONS, Catalogue, Entry, split_of
from data_gen.catalogues.families import devices, furniture, seats, vehicles
from data_gen.catalogues.families import materials as m
from data_gen.catalogues.families.kit import Kit
from data_gen.mesh import Model

# Makes these random numbers independent of the other random numbers of a seed.
_STREAM = 0x70736776

FAMILIES: dict[str, tuple[Callable[[Kit, str], None], tuple[str, ...]]] = {
    "plane": (vehicles.plane, vehicles.PLANES),
    "bench": (seats.bench, seats.BENCHES),
    "cabinet": (furniture.cabinet, furniture.CABINETS),
    "car": (vehicles.car, vehicles.CARS),
    "chair": (seats.chair, tuple(seats.CHAIRS)),
    "monitor": (devices.monitor, devices.MONITORS),
    "lamp": (furniture.lamp, furniture.LAMPS),
    "speaker": (devices.speaker, devices.SPEAKERS),
    "firearm": (devices.firearm, devices.FIREARMS),
    "couch": (seats.couch, seats.COUCHES),
    "table": (furniture.table, furniture.TABLES),
    "cellphone": (devices.cellphone, devices.CELLPHONES),
    "watercraft": (vehicles.watercraft, vehicles.WATERCRAFT),
}
"""Functions that add the parts of a model of a kind to a kit, and the kinds, in the order of the
paper's table."""

# Largest number of models of a catalogue. A job lists all models before it renders the first.
_LARGEST = 1_000_000


def generate(category: str, seed: int) -> Model:
    """A model of a category; its `parameters` are the seed and the kind within the category."""
    kit = Kit(np.random.default_rng([_STREAM, [*FAMILIES].index(category), seed]))
    build, kinds = FAMILIES[category]
    kind = kit.choose(*kinds)
    build(kit, kind)
    if kit.chance(0.1):  # without colours, such as many models of ShapeNet
        material = m.plain(m.grey(kit.rng), kit.uniform(0, 0.3), 30.0, "plain")
        kit.parts = [(part, material) for part, _ in kit.parts]
    return kit.model({"seed": seed, "kind": kind})


def procedural(
    source: str | os.PathLike[str] = "100",
    *,
    first_seed: int = 0,
    fractions: tuple[float, float, float] = FRACTIONS,
) -> Catalogue:
    """Models of the families of the paper's table.

    Args:
      source: number of models of each category, such as "100"; or numbers by category, such as
        "chair=500,table=200".
      first_seed: first seed of each category.
      fractions: fractions of the models for training, validation and test, see `split_of`.

    Raises:
      ValueError: the source has another form, or a category is unknown.
    """
    text = str(source).strip()
    parts = [p.partition("=") for p in text.split(",")] if "=" in text else []
    counts = {c.strip(): n.strip() for c, _, n in parts} or dict.fromkeys(FAMILIES, text)
    if parts and len(counts) < len(parts):
        raise ValueError(f"source {text!r}: expected each category once")
    for category, count in counts.items():
        if category not in FAMILIES:
            raise ValueError(f"category {category!r}: expected one of {list(FAMILIES)}")
        if not count.isdecimal() or int(count) < 1:
            raise ValueError(f"source {text!r}: expected a number of models or category=number,...")
    if sum(map(int, counts.values())) > _LARGEST:
        raise ValueError(f"source {text!r}: expected at most {_LARGEST} models in all")
    if first_seed < 0:
        raise ValueError(f"first_seed: got {first_seed}, expected 0 or more")
    entries = []
    # The categories alternate, so that each prefix contains all of them.
    for seed in range(first_seed, first_seed + max(map(int, counts.values()))):
        for category, count in counts.items():
            if seed < first_seed + int(count):
                name = f"{category}-{seed}"
                load = functools.partial(generate, category, seed)
                entries.append(Entry(name, category, split_of(name, fractions), load))
    return Catalogue("procedural", entries, fractions)

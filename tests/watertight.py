"""Watertight models of all sources of the free set, for comparisons with winding numbers.

`python tests/watertight.py` chooses them again, by the rule of `search`, and prints their names.
"""

import hashlib
import pathlib
import sys

if __package__ in (None, ""):  # run as a file
    sys.path[0] = str(pathlib.Path(__file__).resolve().parents[1])
    sys.path.insert(1, str(pathlib.Path(__file__).resolve().parent))

import free_meshes
import numpy as np
import winding

from data_gen import cameras
from data_gen.mesh import UnusableModelError
from data_gen.sets import free, sources

ANGLES = (20.0, 63.0)
"""Azimuths of the two views that are compared."""

LEAST = 100
"""Cells that thick parts have at least."""

MAX_FACES = 20_000

_COUNTS = {"furniture": 12, "scenery": 12, "ancient": 8, "aircraft": 8, "cars": 8}
_SEEDS = 4


MODELS = {
    "furniture": (
        "Scopia/Scopia#com_bath2_soap",
        "Scopia/Scopia#chest-freezer",
        "BlendSwap-CC-0/Blend Swap CC-0#rock1",
        "Scopia/Scopia#aquarium",
        "BlendSwap-CC-BY/Blend Swap CC-BY#fotel",
        "BlendSwap-CC-BY/Blend Swap CC-BY#kitchenScale",
        "Scopia/Scopia#diving-board",
        "Scopia/Scopia#steak",
        "BlendSwap-CC-BY/Blend Swap CC-BY#choppingBoard",
        "BlendSwap-CC-0/Blend Swap CC-0#bread",
        "Scopia/Scopia#wood_logs",
        "Scopia/Scopia#medicoscopia_bottle",
        "BlendSwap-CC-0/Blend Swap CC-0#shelves",
    ),
    "scenery": (
        "Geometry/load.ac",
        "Maritime/Misc/pier_25m.ac",
        "Maritime/Misc/pier_50m.ac",
        "Maritime/Misc/liferaft4m.ac",
        "Maritime/Misc/yachting-pier-25m.ac",
        "Commercial/Office15x15.ac",
        "Maritime/Ice/iceberg1.ac",
        "Commercial/Office17x17.ac",
        "Maritime/Misc/liferaft8m.ac",
    ),
    "ancient": (
        "geology/metal_aegean_square",
        "geology/stone_desert_set_new_a",
        "props/special/eyecandy/sack_1_rough",
        "props/units/weapons/iber_healer_staff_skull",
        "props/special/eyecandy/column_doric_fallen",
        "fauna/zebra_2",
        "fauna/lion",
        "props/special/eyecandy/wood_small_1_c",
    ),
    "procedural": (
        "bench-0",
        "car-0",
        "speaker-0",
        "couch-0",
        "cellphone-0",
        "watercraft-0",
        "cabinet-1",
        "lamp-1",
        "chair-2",
        "plane-3",
        "monitor-4",
    ),
    "procedural_extra": (
        "bottle-0",
        "vase-0",
        "building-0",
        "figure-0",
        "animal-0",
        "hat-0",
        "bag-0",
        "clock-0",
        "container-0",
        "bed-0",
        "train-0",
        "rocket-0",
        "plant-1",
        "cup-1",
        "book-1",
        "fixture-1",
        "cycle-3",
    ),
    "procedural_groups": ("group-4", "group-5", "group-6"),
}
"""By source: what `search` chose, three groups, and two more.

The shelves have glass doors thinner than the distance of the points and a twentieth of a cell off
their frame. No monitor was found among the first 4.
"""

MISSES = {
    "Scopia/Scopia#com_bath2_soap": ("volumes", 0.900),
    "speaker-0": ("volumes", 0.937),
    "car-0": ("volumes", 0.946),
    "group-6": ("volumes", 0.934),
    "watercraft-0": ("IoU", 0.936),
}
"""Models of which a figure falls short of .95, and the figure.

They are slim. The soap and the speaker are 4.2 and 4.3 cells thick. By winding numbers the volumes
of the two views differ as much (car .948, group .934), because whole cells must be taken or left.
The boat is 4.6 cells wide and all of its cells are at the surface: those that differ are 40 to 60 %
filled, where 27 small cells and 125 points disagree on the half.
"""


def turn(view):
    """The rotation to a view."""
    return cameras.turn_about_vertical(-ANGLES[view])


def reason_against(entry):
    """Why a model cannot be compared, "" if it can."""
    try:
        model = entry.load()
    except UnusableModelError:
        return "unusable"
    if len(model.faces) > MAX_FACES:
        return "too many faces"
    if not winding.is_watertight(model):
        return "not watertight"
    thick = winding.thick_parts(winding.inside(model, turn(0)))
    return "" if winding.cells_of(thick, np.eye(3)).sum() >= LEAST else "thin"


def search():
    """Chooses models and yields lines that say which.

    Of each procedural category the first of 4 that is watertight and has thick parts
    (`winding.thick_parts`) of 100 cells or more. Of the others, in the order of the hashes of their
    names, the first that are so, one of a family (`sources.family_of`).
    """
    for source in free.SOURCES:
        entries = free_meshes.entries_of_source(source.name)
        if source.package:
            entries.sort(key=lambda e: hashlib.sha256(e.model_id.encode()).digest())
        else:
            entries = [e for e in entries if int(e.model_id.split("-")[1]) < _SEEDS]
        done, refused = set(), {}
        for entry in entries:
            family = sources.family_of(entry.model_id) if source.package else entry.category
            if family in done:
                continue
            reason = reason_against(entry)
            if reason:
                refused[reason] = refused.get(reason, 0) + 1
                continue
            done.add(family)
            yield f"{source.name}: {entry.model_id}"
            if len(done) == _COUNTS.get(source.name):
                break
        yield f"# {source.name}: {len(done)} chosen; {refused}"


if __name__ == "__main__":
    for line in search():
        print(line, flush=True)

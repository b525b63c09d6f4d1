"""Files of game data without a complete object: billboards, lights, smoke, parts of objects.

`SCENERY` and `AIRCRAFT` are regular expressions of the names of such files, one for each
collection of data. `objection` recognises such a file by the shape and name of its model.
"""

import re

import numpy as np

from data_gen.mesh import Model

FOLDERS = ("Weather", "Astro", "Effects")
"""Folders that contain only clouds, the sky, and effects such as lights, smoke and wakes."""

_LIGHTS = "light|flare|strobe"

SCENERY = (
    rf"(?i)^({'|'.join(FOLDERS)}|Autopush|Volcanoes)/|{_LIGHTS}|beacon\.ac|Crater|contrail"
    r"|null\.|puff|square\.|thermalcap|tracer|glide-path|Sillage|/cut\.|/datum\.|wave-off|flols|flash"
    r"|propeller\.|parks-and-objects|groundtile|towropes|banlieue|zone_?maisons|ZoneImmeubles"
    r"|ICE3firstcar|Buildings/(cow|horse)-stable|Geometry/(container_carrier|Ensign)"
    r"|AutoGate|DockingGate|jetway-movable|testpilot|Foxtrot\.|hull\.ac|superstructure|saratoga-"
)
"""FlightGear's scenery: lights, clouds, markings, water, parts, whole towns and copies of files.

`ICE3firstcar` is a train with a sphere far away from it."""

AIRCRAFT = (
    rf"{_LIGHTS}|flash|toggle|beacon|/nav[a-z]+\.|/taxi\.|exhaust|droptank|bomb-|refueling/"
    r"|banner|wheels\.|tank\.|ssme|omspods"
)
"""FlightGear's aircraft: lights and parts of aircraft, in upper or lower case."""

# Flat models are billboards that turn toward the viewer, or decals. For comparison: the thinnest
# solid objects of `flightgear-data-models`, landing stages, are 4 % as thick as long.
_FLAT = 0.01

_WORDS = {
    "light", "lights", "lighting", "strobe", "flare", "flash", "glow", "shine", "halo", "beam",
    "contrail", "puff", "smoke", "tracer",
}  # fmt: skip

# Lights consist of a few crossed faces. A street lamp or a signal has more faces and is an object.
_MAX_FACES = 100

# Light volumes of FlightGear's former renderer, which have more faces.
_VOLUMES = "rembrandt"


def thickness(model: Model) -> float:
    """Ratio of the smallest to the largest extent along the principal axes of the vertices."""
    corners = model.vertices[np.unique(model.faces)]
    centred = corners - corners.mean(axis=0)
    _, directions = np.linalg.eigh(centred.T @ centred)
    extents = np.ptp(centred @ directions, axis=0)
    return float(extents.min() / max(extents.max(), 1e-12))


def objection(name: str, model: Model) -> str:
    """The reason why a file contains no object, by its shape and name; "" if it may contain one.

    Args:
      name: name of the file, with its folders.
      model: the model in the file.
    """
    if thickness(model) < _FLAT:
        return "no object: it is flat, like a billboard or a decal"
    stem = name.rpartition("/")[2].rpartition(".")[0]
    words = {word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", stem)}
    if _VOLUMES in words or (words & _WORDS and len(model.faces) <= _MAX_FACES):
        word = min(words & (_WORDS | {_VOLUMES}))
        return (
            f"no object: its name ({word!r}) and its {len(model.faces)} faces are those of a light "
            "or smoke"
        )
    return ""

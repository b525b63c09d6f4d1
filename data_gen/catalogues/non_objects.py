"""Files of FlightGear's scenery that are no objects: billboards, lights, smoke."""

import re

import numpy as np

from data_gen.mesh import Model

FOLDERS = ("Weather", "Astro", "Effects")
"""Folders that hold nothing but clouds, the sky, and effects such as lights, smoke and wakes."""

# A plane that the program turns toward the viewer, or lays on the ground or a wall. The thinnest
# solid objects of `flightgear-data-models`, landing stages, are 4 % as thick as long.
_FLAT = 0.01

_WORDS = {
    "light", "lights", "lighting", "strobe", "flare", "flash", "glow", "shine", "halo", "beam",
    "contrail", "puff", "smoke", "tracer",
}  # fmt: skip

# Lights are a few crossed faces; a street light or a signal with more is an object.
_MAX_FACES = 100

# The volumes of light of FlightGear's former renderer, which have more faces.
_VOLUMES = "rembrandt"


def thickness(model: Model) -> float:
    """Least extent along the principal directions of a model's corners, over the largest."""
    corners = model.vertices[np.unique(model.faces)]
    centred = corners - corners.mean(axis=0)
    _, directions = np.linalg.eigh(centred.T @ centred)
    extents = np.ptp(centred @ directions, axis=0)
    return float(extents.min() / max(extents.max(), 1e-12))


def objection(name: str, model: Model) -> str:
    """Why a file holds no object, by its shape and name; "" where it may.

    Args:
      name: of the file, with its folders.
      model: what is in it.
    """
    if thickness(model) < _FLAT:
        return "no object: it is flat, a billboard or a decal"
    stem = name.rpartition("/")[2].rpartition(".")[0]
    words = {word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", stem)}
    if _VOLUMES in words or (words & _WORDS and len(model.faces) <= _MAX_FACES):
        word = min(words & (_WORDS | {_VOLUMES}))
        return (
            f"no object: a light or smoke, by its name ({word!r}) and its {len(model.faces)} faces"
        )
    return ""

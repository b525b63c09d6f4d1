"""A catalogue of models: boxes of random sizes."""

import functools
import os

import numpy as np

from data_gen.catalogues.entry import Catalogue, Entry, split_of
from data_gen.catalogues.open_catalogue import CATALOGUES
from data_gen.frame import normalize
from data_gen.mesh import Model, build_model

CORNERS = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), axis=-1).reshape(-1, 3)
SIDES = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def boxes(source: str | os.PathLike[str], *, flatness: float = 0.5) -> Catalogue:
    """Boxes that stand on the ground.

    Args:
      source: their number, such as "10".
      flatness: the height, as a fraction of a random one.
    """
    names = [f"box-{seed}" for seed in range(int(source))]
    loads = [functools.partial(box, seed, flatness) for seed in range(int(source))]
    pairs = zip(names, loads, strict=True)
    return Catalogue("boxes", [Entry(n, "box", split_of(n), load) for n, load in pairs])


def box(seed: int, flatness: float) -> Model:
    """The box of a seed, normalised to the frame of the project."""
    sides = np.random.default_rng(seed).uniform(0.5, 1, 3) * (1, 1, flatness)
    faces = [three for a, b, c, d in SIDES for three in ((a, b, c), (a, c, d))]
    return normalize(build_model(CORNERS * sides, np.array(faces)))


CATALOGUES["boxes"] = boxes

"""Cabinets whose depth is not visible from the front, for the study of ambiguity.

A cabinet has a front panel, a body of hidden depth behind it, and a rail of constant length under
both. Panel and rail determine the bounding box and the bounding hemisphere, so the position of the
panel after normalisation does not depend on the depth. The panel is larger than the body and hides
it from a camera straight in front of it, at elevation 0. The kinds are categories:

- `front`: the panel faces +x. From azimuth 0, the depth is ambiguous.
- `turned`: these cabinets, rotated by `TURN` degrees about the vertical axis; the side is visible.
"""

import dataclasses
import functools

import numpy as np

from data_gen.cameras import turn_about_vertical
from data_gen.catalogues.entry import Catalogue, Entry
from data_gen.catalogues.families.kit import Kit
from data_gen.catalogues.families.materials import BLACK, lacquer, metal, wood
from data_gen.catalogues.shapes import ball, box
from data_gen.mesh import Model

KINDS = ("front", "turned")
TURN = 55.0
DEPTH = (0.15, 1.0)
"""Range of the hidden depth, uniform, as a fraction of the largest depth."""

LENGTH, PANEL = 2.0, 0.06
"""Length of the rail, and distance from its front end to the body, before normalisation."""

# Makes these random numbers independent of the other random numbers of a seed.
_VISIBLE, _HIDDEN = 0x646F7562, 0x646F7568


def generate(kind: str, seed: int, hidden_seed: int) -> Model:
    """A normalised cabinet.

    `parameters["hidden"]["depth"]` is the hidden depth, within `DEPTH`. `parameters["scale"]` is
    the factor from lengths before normalisation to units of the frame.

    Args:
      kind: in `KINDS`; both kinds have the same cabinet for the same seeds.
      seed: seed of what is visible from the front.
      hidden_seed: with `seed`, the seed of the depth.
    """
    kit = Kit(np.random.default_rng([_VISIBLE, seed]))
    share = float(np.random.default_rng([_HIDDEN, seed, hidden_seed]).uniform(*DEPTH))
    width, height = kit.uniform(0.8, 1.3), kit.uniform(0.7, 1.2)
    body, front, knob = kit.draw(wood, lacquer), kit.draw(wood, lacquer), kit.draw(metal)
    end, face = LENGTH / 2, LENGTH / 2 - 0.02
    rear = end - PANEL
    kit.add(body, box(face - rear, width, height).at((face + rear) / 2, 0, height / 2))
    deep = share * (LENGTH - PANEL)
    kit.add(body, box(deep, 0.92 * width, 0.92 * height).at(rear - deep / 2, 0, 0.48 * height))
    kit.add(BLACK, box(LENGTH, 0.06, 0.02).at(z=0.01))
    columns, rows = kit.choose(1, 2, 3), kit.choose(1, 2, 3, 4)
    w, h = width / columns, height / rows
    for i in range(columns):
        for j in range(rows):
            y, z = (i - (columns - 1) / 2) * w, (j + 0.5) * h
            # Fronts and knobs are behind the front end of the rail: panel and rail determine the
            # bounding box.
            kit.add(front, box(0.01, w - 0.04, h - 0.04).at(face + 0.004, y, z))
            kit.add(knob, ball(0.02, 0.05, 0.05, 8).at(end - 0.0101, y, z))
    model = kit.model()
    scale = float(np.ptp(model.vertices[:, 0])) / LENGTH
    seeds = {"seed": seed, "hidden_seed": hidden_seed}
    about = {**seeds, "hidden": {"depth": share}, "scale": scale}
    turn = turn_about_vertical(0.0 if kind == "front" else TURN)
    return dataclasses.replace(model.transformed(turn), parameters=about)


def cabinets() -> Catalogue:
    """For each seed, cabinets of both kinds with several hidden depths."""
    entries = [
        Entry(f"{kind}-{s}-h{draw}", kind, split, functools.partial(generate, kind, s, draw))
        for split, first, count, depths in (("train", 0, 80, 4), ("validation", 1_000_000, 8, 8))
        for s in range(first, first + count)
        for kind in KINDS
        for draw in range(depths)
    ]
    return Catalogue("doubt", entries)

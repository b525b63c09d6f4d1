"""Cabinets whose depth cannot be told from the front: the data of the study of ambiguity.

A cabinet is a front panel, a body behind it of a hidden depth, and under the body a rail that is
always as long as the deepest body. Panel and rail alone make the bounding box and the bounding
hemisphere, so that normalisation keeps the panel where it is, whatever the depth; and the panel is
larger than the body, so that a camera on the horizon (elevation 0) straight in front of it, looking
at a point of the panel, sees the panel alone. From there images of one seed differ by nothing that
depends on the depth. Two kinds, as categories:

- `front`: the panel faces +x. Seen from azimuth 0 the depth is in doubt.
- `turned`: the same cabinets turned by `TURN` degrees about the vertical. The image shows the side
  and with it the depth: no doubt is left.
"""

import dataclasses
from collections.abc import Iterator

import numpy as np

from data_gen.catalogues.entry import Entry, loader
from data_gen.catalogues.families.kit import BLACK, Kit, lacquer, metal, pick, wood
from data_gen.catalogues.solids import ball, box
from data_gen.mesh import Model

KINDS = ("front", "turned")
TURN = 55.0
DEPTH = (0.15, 1.0)
"""Range of the hidden depth of the body, uniform, as a share of the deepest one."""

LENGTH, PANEL = 2.0, 0.06
"""Of the rail, which is as long as everything on it; how far behind its front end the body begins.
Lengths before normalisation."""

# Keeps these draws apart from those of other users of the same seed.
_VISIBLE, _HIDDEN = 0x646F7562, 0x646F7568


def generate(kind: str, seed: int, hidden_seed: int) -> Model:
    """A cabinet, normalised, named `<kind>-<seed>-h<hidden_seed>`.

    `parameters["hidden"]["depth"]` is the hidden share of `DEPTH`; `parameters["scale"]` takes
    lengths before normalisation to the frame's unit.

    Args:
      kind: one of `KINDS`; the same seeds give the same cabinet in both.
      seed: of everything that the front shows.
      hidden_seed: of the depth, together with `seed`.

    Raises:
      ValueError: there is no such kind.
    """
    if kind not in KINDS:
        raise ValueError(f"kind {kind!r}: expected one of {list(KINDS)}")
    kit = Kit(
        np.random.default_rng([_VISIBLE, seed]), np.random.default_rng([_HIDDEN, seed, hidden_seed])
    )
    width, height = kit.uniform("width", 0.8, 1.3), kit.uniform("height", 0.7, 1.2)
    share = kit.hide("depth", *DEPTH)
    body = pick(kit.rng, (wood, lacquer))(kit.rng)
    front = pick(kit.rng, (wood, lacquer))(kit.rng)
    knob = metal(kit.rng)
    end, face = LENGTH / 2, LENGTH / 2 - 0.02
    rear = end - PANEL
    kit.add(body, box(face - rear, width, height).at((face + rear) / 2, 0, height / 2))
    deep = share * (LENGTH - PANEL)
    kit.add(body, box(deep, 0.92 * width, 0.92 * height).at(rear - deep / 2, 0, 0.48 * height))
    kit.add(BLACK, box(LENGTH, 0.06, 0.02).at(z=0.01))
    columns, rows = kit.choose("columns", 1, 2, 3), kit.choose("rows", 1, 2, 3, 4)
    w, h = width / columns, height / rows
    for i in range(columns):
        for j in range(rows):
            y, z = (i - (columns - 1) / 2) * w, (j + 0.5) * h
            # No farther than the rail's end: panel and rail stay the box around everything.
            kit.add(front, box(0.01, w - 0.04, h - 0.04).at(face + 0.004, y, z))
            kit.add(knob, ball(0.02, 0.05, 0.05, 8).at(end - 0.0101, y, z))
    name = f"{kind}-{seed}-h{hidden_seed}"
    model = kit.model(kind, name, {"seed": seed, "hidden_seed": hidden_seed})
    scale = float(np.ptp(model.vertices[:, 0])) / LENGTH
    model = dataclasses.replace(model, parameters={**model.parameters, "scale": scale})
    if kind == "front":
        return model
    cosine, sine = np.cos(np.deg2rad(TURN)), np.sin(np.deg2rad(TURN))
    turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    return dataclasses.replace(model, vertices=model.vertices @ turn.T)


class DoubtCatalogue:
    """Cabinets of both kinds.

    Args:
      seeds: how many seeds each split has: (train, validation); a seed is in one split alone.
      draws: how many hidden depths of each seed each split has.

    Raises:
      ValueError: a number that is not positive.
    """

    name = "doubt"

    def __init__(self, seeds: tuple[int, int] = (160, 16), draws: tuple[int, int] = (4, 8)) -> None:
        if min(*seeds, *draws) < 1:
            raise ValueError(f"seeds {seeds}, draws {draws}: expected positive numbers")
        self._seeds, self._draws = seeds, draws

    def __len__(self) -> int:
        """Number of models."""
        numbers = zip(self._seeds, self._draws, strict=True)
        return len(KINDS) * sum(seeds * draws for seeds, draws in numbers)

    def entries(self) -> Iterator[Entry]:
        """The models: of each seed both kinds and all draws."""
        for split, first, seeds, draws in (
            ("train", 0, self._seeds[0], self._draws[0]),
            # Far enough for any number of training seeds.
            ("validation", 1_000_000, self._seeds[1], self._draws[1]),
        ):
            for seed in range(first, first + seeds):
                for kind in KINDS:
                    for draw in range(draws):
                        yield Entry(
                            f"{kind}-{seed}-h{draw}",
                            kind,
                            split,
                            loader(generate, kind, seed, draw),
                        )

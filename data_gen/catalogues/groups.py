"""Catalogue of groups: several procedural models that stand together as one object.

About one in seven of the authors' objects is a group: a row of chairs, a table with seats, a
device with a separate part, a piece of furniture in the corner of a room, a model on a plate. The
bounding box of a group is often not centred on its most conspicuous part.

`group(seed)` makes one. Its members come from all families of `catalogues.procedural` except
`scene`. A third of the groups have plain colours (grey, white, black or saturated), like many
models of ShapeNet.
"""

import dataclasses
import os
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from data_gen.catalogues import procedural, solids
from data_gen.catalogues.entry import FRACTIONS, Entry, loader, split_of
from data_gen.catalogues.solids import Solid
from data_gen.frame import normalize
from data_gen.mesh import Material, Model, build_model

# Makes these random numbers independent of others with the same seed.
_STREAM = 0x70736767

_FAMILIES = (*procedural.CATEGORIES, *(c for c in procedural.EXTRA_CATEGORIES if c != "scene"))
_CENTRES = ("table", "table", "plant", "fixture", "building", "couch")
_SEATS = ("chair", "chair", "bench", "couch", "figure", "lamp")
_PLAIN = 0.35
_LARGEST = 1_000_000


def group(seed: int) -> Model:
    """A group of models as one, in the project's frame.

    Half of the groups have their front toward +x; the others are rotated about the vertical axis by
    90, 180 or 270 degrees.

    Args:
      seed: at least 0; the same seed gives the same group.

    Returns:
      A normalised model named `group-<seed>`; `parameters["arrangement"]` is one of `ARRANGEMENTS`.

    Raises:
      ValueError: the seed is negative.
    """
    if seed < 0:
        raise ValueError(f"seed: got {seed}, expected 0 or more")
    rng = np.random.default_rng([_STREAM, seed])
    arrangement = str(rng.choice(list(ARRANGEMENTS)))
    parts = ARRANGEMENTS[arrangement](rng)
    whole = _turned(_joined(parts), rng.choice((0, 0, 0, 90, 180, 270)))
    if rng.random() < _PLAIN:
        whole = dataclasses.replace(
            whole, materials=tuple(_plain(rng, m.name) for m in whole.materials)
        )
    parameters = {"arrangement": arrangement, "seed": seed}
    named = dataclasses.replace(
        whole, category="group", model_id=f"group-{seed}", parameters=parameters, warnings=()
    )
    return normalize(named)


# --- Arrangements -----------------------------------------------------------------------------


def _row(rng: np.random.Generator) -> list[Model]:
    """Two to five copies of one model in a straight or bent row, sometimes turned at random."""
    model = _member(rng)
    width = np.ptp(model.vertices[:, 1])
    count = int(rng.choice((2, 2, 3, 3, 4, 5)))
    step = width * rng.uniform(1.03, 1.8)
    turns = rng.choice((0.0, 0.0, 30.0, 180.0)) * rng.uniform(-1, 1, count)
    bend = rng.choice((0.0, 0.0, 0.3)) * step
    return [
        _placed(model, 1.0, bend * k * k / count, k * step, turn=turn)
        for k, turn in enumerate(turns)
    ]


def _pair(rng: np.random.Generator) -> list[Model]:
    """Two different models next to each other, the second one scaled down."""
    first, second = _member(rng), _member(rng)
    scale = float(rng.uniform(0.25, 1.0))
    towards = rng.uniform(0, 360)
    return [first, _beside(first, second, scale, towards, rng.uniform(0.02, 0.5), rng)]


def _around(rng: np.random.Generator) -> list[Model]:
    """A model with up to six copies of another one around it, which face it."""
    centre = _member(rng, _CENTRES)
    seat = _member(rng, _SEATS)
    count = int(rng.integers(2, 7))
    reach = np.linalg.norm(centre.vertices[:, :2], axis=1).max()
    scale = float(rng.uniform(0.45, 0.9))
    distance = reach + scale * rng.uniform(0.25, 0.9)
    missing = int(rng.integers(0, count)) if rng.random() < 0.4 else -1
    seats = []
    for k in range(count):
        if k != missing:
            angle = 2 * np.pi * k / count
            x, y = distance * np.cos(angle), distance * np.sin(angle)
            seats.append(_placed(seat, scale, x, y, turn=np.degrees(angle) + 180))
    return [centre, *seats]


def _stray(rng: np.random.Generator) -> list[Model]:
    """A model and one to three small separate parts."""
    model = _member(rng)
    parts = [model]
    for _ in range(int(rng.integers(1, 4))):
        scale = float(rng.uniform(0.05, 0.3))
        part = _member(rng) if rng.random() < 0.5 else _simple(rng)
        height = rng.uniform(0, 0.6) if rng.random() < 0.3 else 0.0
        gap = rng.uniform(0.05, 0.7)
        parts.append(_beside(model, part, scale, rng.uniform(0, 360), gap, rng, height))
    return parts


def _on_plate(rng: np.random.Generator) -> list[Model]:
    """One or two models on a plate, not always in its middle."""
    model = _member(rng)
    parts = _pair(rng) if rng.random() < 0.3 else [model]
    x, y = 2 * np.abs(np.concatenate([p.vertices[:, :2] for p in parts])).max(axis=0)
    x, y = x * rng.uniform(1.0, 1.9), y * rng.uniform(1.0, 1.9)
    thick = rng.uniform(0.01, 0.12)
    if rng.random() < 0.3:
        plate = solids.cylinder(max(x, y) / 2, thick, 32)
    else:
        plate = solids.box(x, y, thick)
    dx, dy = rng.uniform(-0.3, 0.3, 2) * rng.choice((0, 1)) * (x, y)
    lift = 0.0 if rng.random() < 0.8 else rng.uniform(0.05, 0.6)
    return [*(_moved(p, 0.0, 0.0, lift) for p in parts), _solid(plate.at(dx, dy, -thick / 2), rng)]


def _in_corner(rng: np.random.Generator) -> list[Model]:
    """One to three models with one or two walls behind and beside them, often on a floor."""
    size = float(rng.uniform(1.2, 2.2))
    high, thick = size * rng.uniform(0.4, 1.0), rng.uniform(0.01, 0.08)
    parts = []
    for k in range(int(rng.integers(1, 4))):
        x, y = rng.uniform(-0.3, 0.3, 2) * size
        model = _member(rng)
        parts.append(
            _placed(model, rng.uniform(0.3, 0.6), x, y, turn=90 * int(rng.integers(4)) + k)
        )
    walls = [solids.box(thick, size, high).at(-size / 2, 0, high / 2)]
    if rng.random() < 0.7:
        side = rng.choice((-1, 1))
        walls.append(solids.box(size, thick, high).at(0, side * size / 2, high / 2))
    if rng.random() < 0.7:
        walls.append(solids.box(size, size, thick).at(0, 0, -thick / 2))
    return [*parts, *(_solid(w, rng) for w in walls)]


def _angle(rng: np.random.Generator) -> list[Model]:
    """Two copies of a model at a right angle, like an L-shaped desk or sofa."""
    model = _member(rng, ("table", "couch", "cabinet", "bench", "building", "cabinet"))
    x, y = np.ptp(model.vertices[:, :2], axis=0)
    longer = float(rng.uniform(0.4, 1.2))
    second = _turned(_scaled(model, (1.0, longer, 1.0)), 90)
    side = float(rng.choice((-1, 1)))
    offset = np.array([(x + y * longer) / 2 - x, side * (y / 2 - x / 2), 0.0])
    if rng.random() < 0.4:
        offset[1] += side * x  # next to the end of the first copy, without overlap
    return [model, _moved(second, *offset)]


ARRANGEMENTS: dict[str, Callable[[np.random.Generator], list[Model]]] = {
    "row": _row,
    "pair": _pair,
    "around": _around,
    "stray": _stray,
    "on_plate": _on_plate,
    "in_corner": _in_corner,
    "angle": _angle,
}
"""Kinds of groups; each draws the members and places them."""


# --- Members ----------------------------------------------------------------------------------


def _member(rng: np.random.Generator, families: Sequence[str] = _FAMILIES) -> Model:
    return procedural.generate(str(rng.choice(families)), int(rng.integers(1 << 31)))


def _simple(rng: np.random.Generator) -> Model:
    """A box, a cylinder or a ball."""
    x, y, z = rng.uniform(0.4, 1.5, 3)
    kind = rng.integers(3)
    if kind == 0:
        solid = solids.box(x, y, z)
    elif kind == 1:
        solid = solids.cylinder(x / 2, z)
    else:
        solid = solids.ball(x, y, z)
    return _moved(_solid(solid, rng), 0.0, 0.0, z / 2)


def _solid(solid: Solid, rng: np.random.Generator) -> Model:
    return build_model(solid.vertices, solid.faces, materials=[_plain(rng)])


def _plain(rng: np.random.Generator, name: str = "plain") -> Material:
    """Grey, white, black or saturated, without a texture."""
    kind = rng.choice(4, p=(0.45, 0.2, 0.1, 0.25))
    if kind == 3:
        colour = rng.uniform(0.05, 0.35, 3)
        colour[rng.integers(3)] = rng.uniform(0.5, 0.95)
        if rng.random() < 0.35:
            colour[rng.integers(3)] = rng.uniform(0.4, 0.9)
    else:
        tone = (rng.uniform(0.3, 0.75), rng.uniform(0.85, 1.0), rng.uniform(0.02, 0.12))[kind]
        colour = np.full(3, tone)
    gloss = float(rng.choice((0.0, 0.0, 0.2, 0.5)))
    red, green, blue = (float(c) for c in colour)
    return Material((red, green, blue), (gloss,) * 3, 40.0, name=name)


# --- Placing ----------------------------------------------------------------------------------


def _placed(model: Model, scale: float, x: float, y: float, turn: float = 0.0) -> Model:
    """The model scaled, turned about the vertical axis by `turn` degrees, and moved by (x, y)."""
    return _moved(_turned(_scaled(model, (scale,) * 3), turn), x, y, 0.0)


def _beside(
    model: Model,
    other: Model,
    scale: float,
    degrees: float,
    gap: float,
    rng: np.random.Generator,
    height: float = 0.0,
) -> Model:
    """The other model, scaled and moved in a direction until it is `gap` away from the first."""
    along = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    small = _turned(_scaled(other, (scale,) * 3), rng.uniform(0, 360))
    reach = (model.vertices[:, :2] @ along).max() - (small.vertices[:, :2] @ along).min()
    x, y = along * (reach + gap)
    return _moved(_placed(small, 1.0, x, y), 0.0, 0.0, height)


def _moved(model: Model, x: float, y: float, z: float) -> Model:
    return model.transformed(np.concatenate([np.eye(3), [[x], [y], [z]]], axis=1))


def _scaled(model: Model, factors: Sequence[float]) -> Model:
    return model.transformed(np.concatenate([np.diag(factors), np.zeros((3, 1))], axis=1))


def _turned(model: Model, degrees: float) -> Model:
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    rotation = np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1.0, 0]])
    return model.transformed(rotation)


def _joined(models: Sequence[Model]) -> Model:
    """All models as one; each keeps its materials."""
    vertices = np.cumsum([0, *(len(m.vertices) for m in models)])
    materials = np.cumsum([0, *(len(m.materials) for m in models)])
    return Model(
        vertices=np.concatenate([m.vertices for m in models]),
        faces=np.concatenate([m.faces + n for m, n in zip(models, vertices[:-1], strict=True)]),
        normals=np.concatenate([m.normals for m in models]),
        uv=np.concatenate([m.uv for m in models]),
        face_material=np.concatenate(
            [m.face_material + n for m, n in zip(models, materials[:-1], strict=True)]
        ),
        materials=tuple(material for m in models for material in m.materials),
    )


# --- The catalogue ----------------------------------------------------------------------------


class GroupCatalogue:
    """Groups of procedural models.

    Args:
      source: number of groups, such as "1000".
      first_seed: seed of the first.
      fractions: fractions of the models for training, validation and test, see
        `catalogues.entry.split_of`.

    Raises:
      ValueError: the source is not a number of models, or the first seed is negative.
    """

    name = "procedural_groups"

    def __init__(
        self,
        source: str | os.PathLike[str] = "1000",
        *,
        first_seed: int = 0,
        fractions: tuple[float, float, float] = FRACTIONS,
    ) -> None:
        text = str(source).strip()
        if not text.isdecimal() or not 1 <= int(text) <= _LARGEST:
            raise ValueError(f"source {text!r}: expected a number of models, 1 to {_LARGEST}")
        if first_seed < 0:
            raise ValueError(f"first_seed: got {first_seed}, expected 0 or more")
        self._count, self._first, self._fractions = int(text), first_seed, fractions

    def __len__(self) -> int:
        """Number of models."""
        return self._count

    def entries(self) -> Iterator[Entry]:
        """The groups in the order of their seeds."""
        for seed in range(self._first, self._first + self._count):
            name = f"group-{seed}"
            yield Entry(name, "group", split_of(name, self._fractions), loader(group, seed))

"""Catalogue of procedural models: parametric families of the 13 categories of the paper, and more.

`generate(category, seed)` makes a model of several parts and materials, with its front toward +x.
Each family has several subtypes with random proportions, parts and colours.

**Hidden parameters.** Parameters that are not visible in an image have a separate random generator.
For different h, the models of `generate(category, seed, hidden_seed=h)` look the same, pixel by
pixel, from every azimuth in `parameters["hidden_azimuth"]`. They differ where the camera cannot
see: in the hollow of a seat, under a foot, on the far side. The bounding box and the bounding
hemisphere do not depend on the hidden parameters, so neither does the normalisation. An azimuth is
the direction from the origin of the model to the camera, in degrees from +x toward +y. The ranges
hold for cameras at least 15 degrees above the horizon, at least 2.5 units away and no lower than
the highest point of the model. `hidden_azimuth` is a tuple of ranges (low, high) in [-180, 180];
`parameters["hidden"]` are the hidden values. `hidden_ranges` returns their ranges, `redraw_hidden`
makes other models that look like a given one. The extra families have no hidden parameters.
"""

import os
import re
import zlib
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from data_gen.catalogues.entry import FRACTIONS, Entry, loader, split_of
from data_gen.catalogues.families import (
    buildings,
    figures,
    household,
    materials,
    plants,
    scenes,
    tools,
    transport,
    vessels,
    wearables,
)
from data_gen.catalogues.families.bench import bench
from data_gen.catalogues.families.cabinet import cabinet, open_cabinet
from data_gen.catalogues.families.car import car
from data_gen.catalogues.families.cellphone import cellphone, open_cellphone
from data_gen.catalogues.families.chair import chair
from data_gen.catalogues.families.couch import couch
from data_gen.catalogues.families.firearm import firearm
from data_gen.catalogues.families.kit import HiddenRange, Kit
from data_gen.catalogues.families.lamp import lamp
from data_gen.catalogues.families.monitor import monitor
from data_gen.catalogues.families.plane import plane
from data_gen.catalogues.families.speaker import open_speaker, speaker
from data_gen.catalogues.families.table import table
from data_gen.catalogues.families.watercraft import watercraft
from data_gen.mesh import Model

# Makes these random numbers independent of others with the same seed.
_VISIBLE, _HIDDEN = 0x70736776, 0x70736768

FAMILIES: dict[str, Callable[[Kit], None]] = {
    "plane": plane,
    "bench": bench,
    "cabinet": cabinet,
    "car": car,
    "chair": chair,
    "monitor": monitor,
    "lamp": lamp,
    "speaker": speaker,
    "firearm": firearm,
    "couch": couch,
    "table": table,
    "cellphone": cellphone,
    "watercraft": watercraft,
}
"""The families, in the order of the paper's table."""

CATEGORIES = tuple(FAMILIES)

OPEN_BACKS: dict[str, Callable[[Kit], None]] = {
    "cabinet": open_cabinet,
    "speaker": open_speaker,
    "cellphone": open_cellphone,
}
"""Families of models with a recess of hidden depth at the back, for studies of ambiguity."""

EXTRA_FAMILIES: dict[str, Callable[[Kit], None]] = {
    "plant": plants.plant,
    "bottle": vessels.bottle,
    "vase": vessels.vase,
    "cup": vessels.cup,
    "building": buildings.building,
    "figure": figures.figure,
    "animal": figures.animal,
    "tool": tools.tool,
    "guitar": tools.guitar,
    "hat": wearables.hat,
    "bag": wearables.bag,
    "clock": household.clock,
    "book": household.book,
    "container": household.container,
    "bed": household.bed,
    "fixture": household.fixture,
    "train": transport.train,
    "rocket": transport.rocket,
    "cycle": transport.cycle,
    "scene": scenes.scene,
}
"""Families that are not in the paper's table but have many models in ShapeNet."""

EXTRA_CATEGORIES = tuple(EXTRA_FAMILIES)

_ALL = {**FAMILIES, **EXTRA_FAMILIES}

# Largest number of models of a catalogue, because a job lists them all before the first one.
_LARGEST = 1_000_000

# Fraction of the extra models without colours, like many models of ShapeNet.
_PLAIN = 0.15


def generate(
    category: str,
    seed: int,
    *,
    hidden_seed: int | None = None,
    hidden: Mapping[str, float] | None = None,
    open_back: bool = False,
) -> Model:
    """A model of a category, in the project's frame, with its front toward +x.

    Args:
      category: one of `CATEGORIES` or `EXTRA_CATEGORIES`.
      seed: seed of the visible parameters, at least 0; the same seed gives the same model.
      hidden_seed: seed of the hidden parameters; None = `seed`.
      hidden: values of hidden parameters that are set instead of drawn; see `hidden_ranges`.
      open_back: whether the model has a recess of hidden depth at its back (`OPEN_BACKS`), which is
        visible in half of the views. Otherwise its back is closed.

    Returns:
      A normalised model named `<category>-<seed>`, followed by `-open` if its back is open,
      `-h<hidden_seed>` if that is given, and `-set` if `hidden` is given. `parameters` contains all
      parameters; the hidden ones are described in the docstring of this module.

    Raises:
      ValueError: the category is unknown or has no models with an open back, a seed is negative, or
        a hidden parameter is unknown or outside its range.
    """
    inner = seed if hidden_seed is None else hidden_seed
    kit = _built(category, seed, inner, hidden or {}, open_back)
    name = _name(category, seed, hidden_seed, open_back) + ("-set" if hidden else "")
    return kit.model(category, name, {"seed": seed, "hidden_seed": inner})


def _number(category: str) -> int:
    """The number of a family in the seeds; it does not change when families are added."""
    if category in FAMILIES:
        return CATEGORIES.index(category)
    return 1 << 32 | zlib.crc32(category.encode())


def _name(category: str, seed: int, hidden_seed: int | None, open_back: bool) -> str:
    name = f"{category}-{seed}" + ("-open" if open_back else "")
    return name + ("" if hidden_seed is None else f"-h{hidden_seed}")


def _built(
    category: str, seed: int, hidden_seed: int, hidden: Mapping[str, float], open_back: bool
) -> Kit:
    if category not in _ALL:
        raise ValueError(f"category {category!r}: expected one of {list(_ALL)}")
    if open_back and category not in OPEN_BACKS:
        raise ValueError(
            f"category {category!r}: expected one of {list(OPEN_BACKS)} for an open back"
        )
    for name, value in (("seed", seed), ("hidden_seed", hidden_seed)):
        if value < 0:
            raise ValueError(f"{name}: got {value}, expected 0 or more")
    number = _number(category)
    kit = Kit(
        np.random.default_rng([_VISIBLE, number, seed]),
        np.random.default_rng([_HIDDEN, number, hidden_seed]),
        hidden,
    )
    (OPEN_BACKS if open_back else _ALL)[category](kit)
    if category in EXTRA_FAMILIES and kit.chance("plain", _PLAIN):
        kit.paint_all(materials.plain(kit.rng))
    unknown = [name for name in hidden if name not in kit.ranges]
    if unknown:
        raise ValueError(
            f"hidden {unknown[0]!r}: {category}-{seed} has no such hidden parameter, expected some "
            f"of {list(kit.ranges)}"
        )
    return kit


# --- Hidden parameters ------------------------------------------------------------------------


def _parse(model: str | Entry | Model) -> tuple[str, int, bool]:
    """Category and seed of a procedural model, and whether its back is open."""
    name = model if isinstance(model, str) else model.model_id
    match = re.fullmatch(r"([a-z]+)-([0-9]+)(-open)?(?:-h[0-9]+)?(?:-set)?", name)
    if match is None or match[1] not in (OPEN_BACKS if match[3] else _ALL):
        raise ValueError(
            f"model {name!r}: expected the name of a procedural model, such as 'chair-12'"
        )
    return match[1], int(match[2]), bool(match[3])


def hidden_ranges(model: str | Entry | Model) -> dict[str, HiddenRange]:
    """The hidden parameters of a model and their ranges.

    Each is drawn uniformly from its range, independently of the others and of the visible
    parameters. This is therefore also their distribution given an image from an azimuth in
    `parameters["hidden_azimuth"]`: `redraw_hidden` with random seeds samples the shapes that are
    possible for such an image.

    Args:
      model: a procedural model, its entry or its name.

    Raises:
      ValueError: this is not the name of a procedural model.
    """
    category, seed, open_back = _parse(model)
    return dict(_built(category, seed, seed, {}, open_back).ranges)


def redraw_hidden(
    model: str | Entry | Model,
    hidden_seed: int = 0,
    *,
    values: Mapping[str, float] | None = None,
) -> Model:
    """A model that looks the same and has other hidden parameters.

    Args:
      model: a procedural model, its entry or its name.
      hidden_seed: seed of the hidden parameters; different seeds are independent.
      values: hidden parameters that are set instead of drawn; the others come from `hidden_seed`.

    Returns:
      The model `generate(category, seed, hidden_seed=hidden_seed, hidden=values)`, in the same
      frame and scale as the given one, with its hidden parameters in `parameters["hidden"]`.

    Raises:
      ValueError: this is not the name of a procedural model, or a value is outside its range.
    """
    category, seed, open_back = _parse(model)
    return generate(category, seed, hidden_seed=hidden_seed, hidden=values, open_back=open_back)


# --- The catalogue ----------------------------------------------------------------------------


class ProceduralCatalogue:
    """Models of the families of the paper's table.

    Args:
      source: number of models of each category, such as "100"; or categories with their numbers,
        such as "chair=500,table=200".
      first_seed: first seed of each category.
      hidden_draws: number of models per seed: 1 = one model; n > 1 = n models that look the same
        and differ in the hidden parameters. They are in the same split.
      open_backs: whether cabinets, speakers and cellphones have a recess of hidden depth at the
        back (`OPEN_BACKS`). There are then only these categories.
      fractions: fractions of the models for training, validation and test, see
        `catalogues.entry.split_of`.

    Raises:
      ValueError: the source has another form, or a category is unknown or has no open backs.
    """

    name = "procedural"
    families: Mapping[str, Callable[[Kit], None]] = FAMILIES

    def __init__(
        self,
        source: str | os.PathLike[str] = "100",
        *,
        first_seed: int = 0,
        hidden_draws: int = 1,
        open_backs: bool = False,
        fractions: tuple[float, float, float] = FRACTIONS,
    ) -> None:
        known = tuple(OPEN_BACKS) if open_backs else tuple(self.families)
        text = str(source).strip()
        parts = [p.partition("=") for p in text.split(",")] if "=" in text else []
        counts = {c.strip(): n.strip() for c, _, n in parts} or dict.fromkeys(known, text)
        for category, count in counts.items():
            if category not in known:
                raise ValueError(f"category {category!r}: expected one of {list(known)}")
            if not count.isdecimal() or int(count) < 1:
                raise ValueError(
                    f"source {text!r}: expected a number of models or category=number,..."
                )
        if sum(map(int, counts.values())) * hidden_draws > _LARGEST:
            raise ValueError(f"source {text!r}: expected at most {_LARGEST} models in all")
        if first_seed < 0 or hidden_draws < 1:
            raise ValueError(
                f"first_seed, hidden_draws: got {first_seed}, {hidden_draws}, expected at least "
                "0 and at least 1"
            )
        self._counts = {category: int(count) for category, count in counts.items()}
        self._first, self._draws, self._fractions = first_seed, hidden_draws, fractions
        self._open = open_backs

    def __len__(self) -> int:
        """Number of models."""
        return sum(self._counts.values()) * self._draws

    def entries(self) -> Iterator[Entry]:
        """The models; the categories alternate, so that every prefix contains all of them."""
        for offset in range(max(self._counts.values())):
            seed = self._first + offset
            for category, count in self._counts.items():
                if offset >= count:
                    continue
                split = split_of(f"{category}-{seed}", self._fractions)
                for draw in range(self._draws):
                    hidden = None if self._draws == 1 else draw
                    name = _name(category, seed, hidden, self._open)
                    make = loader(
                        generate, category, seed, hidden_seed=hidden, open_back=self._open
                    )
                    yield Entry(name, category, split, make)


class ExtraCatalogue(ProceduralCatalogue):
    """Models of the extra families.

    Args:
      source: see `ProceduralCatalogue`; for example "100" or "plant=50,vase=20".
      first_seed: first seed of each category.
      fractions: see `catalogues.entry.split_of`.
    """

    name = "procedural_extra"
    families = EXTRA_FAMILIES

    def __init__(
        self,
        source: str | os.PathLike[str] = "100",
        *,
        first_seed: int = 0,
        fractions: tuple[float, float, float] = FRACTIONS,
    ) -> None:
        super().__init__(source, first_seed=first_seed, fractions=fractions)

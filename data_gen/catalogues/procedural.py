"""Parametric families for the 13 categories of the paper's table: endless, seeded, no files.

`generate(category, seed)` makes a model of several parts and materials, its front toward +x. Each
family has several sub-types with random proportions, parts and colours.

**Hidden parameters.** What an image cannot tell is drawn from a generator of its own:
`generate(category, seed, hidden_seed=h)` for different h gives models that look the same from every
azimuth in `parameters["hidden_azimuth"]`, pixel for pixel, and differ where the camera cannot see:
in the hollow of a seat, behind a front, on the far side. The bounding box and hemisphere do not
depend on them, so normalisation keeps the rest where it is. An azimuth is the direction from the
model's origin to the camera, in degrees from +x toward +y; the ranges hold for cameras at least 15
degrees above the horizon and at least 2.5 units away. `hidden_azimuth` is a tuple of ranges
(low, high) in [-180, 180]; `parameters["hidden"]` are the hidden values. `hidden_ranges` tells what
they are drawn from, `redraw_hidden` makes the other models that look like a given one.
"""

import os
import re
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from data_gen import catalogues
from data_gen.catalogues.families import devices, furniture, vehicles
from data_gen.catalogues.families.kit import HiddenRange, Kit
from data_gen.meshes import Model

# Keeps these draws apart from those of other users of the same seed.
_VISIBLE, _HIDDEN = 0x70736776, 0x70736768

FAMILIES: dict[str, Callable[[Kit], None]] = {
    "plane": vehicles.plane,
    "bench": furniture.bench,
    "cabinet": furniture.cabinet,
    "car": vehicles.car,
    "chair": furniture.chair,
    "monitor": devices.monitor,
    "lamp": furniture.lamp,
    "speaker": devices.speaker,
    "firearm": vehicles.firearm,
    "couch": furniture.couch,
    "table": furniture.table,
    "cellphone": devices.cellphone,
    "watercraft": vehicles.watercraft,
}
"""The families, in the order of the paper's table."""

CATEGORIES = tuple(FAMILIES)


def generate(
    category: str,
    seed: int,
    *,
    hidden_seed: int | None = None,
    hidden: Mapping[str, float] | None = None,
) -> Model:
    """A model of a category, in the project's frame, its front toward +x.

    Args:
      category: one of `CATEGORIES`.
      seed: of everything that can be seen, at least 0; the same seed gives the same model.
      hidden_seed: of what cannot be seen; None = `seed`.
      hidden: values of hidden parameters that are not drawn; see `hidden_ranges`.

    Returns:
      A normalised model named `<category>-<seed>`, `-h<hidden_seed>` appended where one is given,
      and `-set` where `hidden` is, with every parameter in `parameters`: see this module's
      docstring for the hidden ones.

    Raises:
      ValueError: there is no such category, a seed is negative, or a hidden parameter is unknown
        or outside of its range.
    """
    inner = seed if hidden_seed is None else hidden_seed
    kit = _built(category, seed, inner, hidden or {})
    name = f"{category}-{seed}" + ("" if hidden_seed is None else f"-h{hidden_seed}")
    name += "-set" if hidden else ""
    return kit.model(category, name, {"seed": seed, "hidden_seed": inner})


def _built(category: str, seed: int, hidden_seed: int, hidden: Mapping[str, float]) -> Kit:
    if category not in FAMILIES:
        raise ValueError(f"category {category!r}: expected one of {list(CATEGORIES)}")
    for name, value in (("seed", seed), ("hidden_seed", hidden_seed)):
        if value < 0:
            raise ValueError(f"{name}: got {value}, expected 0 or more")
    number = CATEGORIES.index(category)
    kit = Kit(
        np.random.default_rng([_VISIBLE, number, seed]),
        np.random.default_rng([_HIDDEN, number, hidden_seed]),
        hidden,
    )
    FAMILIES[category](kit)
    unknown = [name for name in hidden if name not in kit.ranges]
    if unknown:
        raise ValueError(
            f"hidden {unknown[0]!r}: {category}-{seed} has no such hidden parameter, expected some "
            f"of {list(kit.ranges)}"
        )
    return kit


# --- What an image cannot tell ----------------------------------------------------------------


def parse_id(model: str | catalogues.Entry | Model) -> tuple[str, int]:
    """Category and seed of a procedural model by its name (or the entry's, or the model's).

    Raises:
      ValueError: it is no name of this catalogue.
    """
    name = model if isinstance(model, str) else model.model_id
    match = re.fullmatch(r"([a-z]+)-([0-9]+)(?:-h[0-9]+)?(?:-set)?", name)
    if match is None or match[1] not in FAMILIES:
        raise ValueError(f"model {name!r}: expected the name of a procedural model, as 'chair-12'")
    return match[1], int(match[2])


def hidden_ranges(model: str | catalogues.Entry | Model) -> dict[str, HiddenRange]:
    """The hidden parameters of a model and what they are drawn from.

    Each is drawn uniformly from its range, independently of the others and of everything that can
    be seen. So this is their distribution given the model's image, too, for images from an azimuth
    in `parameters["hidden_azimuth"]`: the shapes that such an image leaves possible, each as
    probable as the others, are those of `redraw_hidden` over all seeds.

    Args:
      model: a procedural model, its entry or its name.

    Raises:
      ValueError: it is no name of a procedural model.
    """
    category, seed = parse_id(model)
    return dict(_built(category, seed, seed, {}).ranges)


def redraw_hidden(
    model: str | catalogues.Entry | Model,
    hidden_seed: int = 0,
    *,
    values: Mapping[str, float] | None = None,
) -> Model:
    """The model that looks the same and has other hidden parameters.

    Args:
      model: a procedural model, its entry or its name.
      hidden_seed: of the draw; different ones are independent.
      values: hidden parameters that are set instead of drawn; the rest is that of `hidden_seed`.

    Returns:
      The model `generate(category, seed, hidden_seed=hidden_seed, hidden=values)`, in the same
      frame and scale as the one given, its hidden parameters in `parameters["hidden"]`.

    Raises:
      ValueError: it is no name of a procedural model, or a value is outside of its range.
    """
    category, seed = parse_id(model)
    return generate(category, seed, hidden_seed=hidden_seed, hidden=values)


# --- The catalogue ----------------------------------------------------------------------------


class ProceduralCatalogue:
    """A number of models of each family.

    Args:
      source: models of each category, such as "100"; or categories with their numbers, such as
        "chair=500,table=200".
      first_seed: of each category.
      hidden_draws: models made of each seed: 1 = one, with the hidden parameters of its own seed;
        n > 1 = n that look the same and differ in what is hidden. They share a split.
      fractions: of models for training, validation and test, see `catalogues.split_of`.

    Raises:
      ValueError: the source is neither, or an unknown category.
    """

    name = "procedural"

    def __init__(
        self,
        source: str | os.PathLike[str] = "100",
        *,
        first_seed: int = 0,
        hidden_draws: int = 1,
        fractions: tuple[float, float, float] = catalogues.FRACTIONS,
    ) -> None:
        text = str(source).strip()
        parts = [p.partition("=") for p in text.split(",")] if "=" in text else []
        counts = {c.strip(): n.strip() for c, _, n in parts} or dict.fromkeys(CATEGORIES, text)
        for category, count in counts.items():
            if category not in FAMILIES:
                raise ValueError(f"category {category!r}: expected one of {list(CATEGORIES)}")
            if not count.isdecimal() or int(count) < 1:
                raise ValueError(
                    f"source {text!r}: expected a number of models, or category=number,..."
                )
        if first_seed < 0 or hidden_draws < 1:
            raise ValueError(
                f"first_seed, hidden_draws: got {first_seed}, {hidden_draws}, expected at least "
                "0 and at least 1"
            )
        self._counts = {category: int(count) for category, count in counts.items()}
        self._first, self._draws, self._fractions = first_seed, hidden_draws, fractions

    def __len__(self) -> int:
        """Number of models."""
        return sum(self._counts.values()) * self._draws

    def entries(self) -> Iterator[catalogues.Entry]:
        """The models; categories take turns, so that every beginning holds all of them."""
        for offset in range(max(self._counts.values())):
            seed = self._first + offset
            for category, count in self._counts.items():
                if offset >= count:
                    continue
                split = catalogues.split_of(f"{category}-{seed}", self._fractions)
                for draw in range(self._draws):
                    hidden = None if self._draws == 1 else draw
                    name = f"{category}-{seed}" + ("" if hidden is None else f"-h{hidden}")
                    make = catalogues.loader(generate, category, seed, hidden_seed=hidden)
                    yield catalogues.Entry(name, category, split, make)

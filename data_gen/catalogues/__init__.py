"""Where models come from: catalogues, one file each, behind one small interface.

A catalogue lists its models without reading them; an entry loads its own. Entries can be pickled,
so worker processes take them as they are. A new catalogue is a module with a class that has
`entries()`, and a line in `CATALOGUES`.
"""

import dataclasses
import functools
import hashlib
import importlib
import os
import typing
from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol

from data_gen.meshes import Model

SPLITS = ("train", "validation", "test")

FRACTIONS = (0.8, 0.1, 0.1)
"""Default parts of the splits, in the order of `SPLITS`."""


def printable(text: str) -> str:
    """One line that UTF-8 can hold: control characters and bytes that are no text are escaped."""
    text = text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


@dataclasses.dataclass(frozen=True)
class Entry:
    """One model of a catalogue.

    Attributes:
      model_id: unique in the catalogue.
      category: name, "" where unknown.
      split: one of `SPLITS`. All views of a model are in the same.
      loader: reads the model, normalised, in the project's frame; may be pickled. It raises
        `meshes.UnusableModelError` where no sample can be made of it.
    """

    model_id: str
    category: str
    split: str
    loader: Callable[[], Model]

    def __post_init__(self) -> None:
        """Makes both names printable."""
        object.__setattr__(self, "model_id", printable(self.model_id))
        object.__setattr__(self, "category", printable(self.category))

    def load(self) -> Model:
        """The model; its name and category are the entry's."""
        return self.loader()


class Catalogue(Protocol):
    """What a catalogue can do."""

    name: str

    def __len__(self) -> int:
        """Number of models."""
        ...

    def entries(self) -> Iterator[Entry]:
        """All models, in an order that is the same every time."""
        ...


def split_of(model_id: str, fractions: tuple[float, float, float] = FRACTIONS) -> str:
    """The split of a model, by a hash of its name: it never changes when models come or go.

    Args:
      model_id: of the model.
      fractions: of the splits, in the order of `SPLITS`; not negative, sum 1.

    Raises:
      ValueError: the fractions are no such parts.
    """
    if len(fractions) != len(SPLITS) or min(fractions) < 0 or abs(sum(fractions) - 1) > 1e-6:
        raise ValueError(
            f"split fractions: got {list(fractions)}, expected {len(SPLITS)} parts of 0 or more "
            "with a sum of 1"
        )
    digest = hashlib.sha256(model_id.encode("utf-8", "surrogatepass")).digest()
    place = int.from_bytes(digest[:8], "big") / 2**64
    for split, fraction in zip(SPLITS, fractions, strict=True):
        if place < fraction:
            return split
        place -= fraction
    # Rounding may leave a crumb at the end; it belongs to the last split that is not empty.
    return next(s for s, f in zip(SPLITS[::-1], fractions[::-1], strict=True) if f > 0)


CATALOGUES = {
    "procedural": "data_gen.catalogues.procedural:ProceduralCatalogue",
    "procedural_extra": "data_gen.catalogues.procedural:ExtraCatalogue",
    "folder": "data_gen.catalogues.folder:FolderCatalogue",
    "shapenet": "data_gen.catalogues.shapenet:ShapeNetCatalogue",
    "sh3f": "data_gen.catalogues.sh3f:SweetHomeCatalogue",
    "ac3d": "data_gen.catalogues.ac3d:AC3DCatalogue",
    "flightgear": "data_gen.catalogues.flightgear:FlightGearCatalogue",
    "torcs": "data_gen.catalogues.torcs:TorcsCatalogue",
    "pyrogenesis": "data_gen.catalogues.pyrogenesis:PyrogenesisCatalogue",
}
"""Names of the catalogues and where their classes are."""


def open(name: str, source: str | os.PathLike[str], **options: Any) -> Catalogue:
    """A catalogue by its name.

    Args:
      name: one of `CATALOGUES`.
      source: what it reads: a folder, a file; see the class.
      **options: of the class.

    Raises:
      ValueError: an unknown name, or a source that the catalogue cannot be made of.
    """
    catalogue: Catalogue = class_of(name)(source, **options)
    return catalogue


def class_of(name: str) -> Callable[..., Any]:
    """The class of a catalogue.

    Raises:
      ValueError: an unknown name.
    """
    if name not in CATALOGUES:
        raise ValueError(f"catalogue {name!r}: expected one of {sorted(CATALOGUES)}")
    module, _, kind = CATALOGUES[name].partition(":")
    found: Callable[..., Any] = getattr(importlib.import_module(module), kind)
    return found


_TRUTH = {"true": True, "1": True, "false": False, "0": False}


def option_types(name: str) -> dict[str, Any]:
    """Options of a catalogue's class and their types.

    Raises:
      ValueError: an unknown catalogue.
    """
    hints = typing.get_type_hints(class_of(name).__init__)  # type: ignore[misc]
    return {key: hint for key, hint in hints.items() if key not in ("source", "return")}


def parse_options(name: str, pairs: Sequence[str]) -> dict[str, Any]:
    """Options of a catalogue's class from texts such as "up=+z" or "categories=chair,table".

    Raises:
      ValueError: an unknown catalogue or option, one that is given twice, or a value that the
        option does not take.
    """
    hints = option_types(name)
    known = sorted(hints)
    result: dict[str, Any] = {}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        if not equals or key not in known:
            raise ValueError(
                f"--option={pair}: expected NAME=VALUE with NAME one of {known} for the catalogue "
                f"{name!r}"
            )
        if key in result:
            raise ValueError(f"--option={pair}: {key} is given twice")
        hint = hints[key]
        several = typing.get_origin(hint) is not None
        kind = typing.get_args(hint)[0] if several else hint
        parts = [part for part in text.split(",") if part or text] if several else [text]
        try:
            values = [_TRUTH[part.lower()] if kind is bool else kind(part) for part in parts]
        except (ValueError, KeyError):
            what = f"{kind.__name__} values with commas between them" if several else kind.__name__
            raise ValueError(f"--option={pair}: expected {what}") from None
        result[key] = tuple(values) if several else values[0]
    return result


def unique_names(names: list[str]) -> list[str]:
    """The names, with `-2`, `-3` ... appended to those that came before."""
    seen: dict[str, int] = {}
    taken = set(names)
    result = []
    for name in names:
        seen[name] = seen.get(name, 0) + 1
        fresh = name
        while seen[name] > 1 and (fresh in taken or fresh == name):
            fresh = f"{name}-{seen[name]}"
            if fresh in taken:
                seen[name] += 1
        taken.add(fresh)
        result.append(fresh)
    return result


def loader(function: Callable[..., Model], *args: Any, **kwargs: Any) -> Callable[[], Model]:
    """A loader for an `Entry` from a function of a module and its arguments."""
    return functools.partial(function, *args, **kwargs)

"""Catalogues by name, and their options from texts.

A new catalogue is a module with a class that has `entries()`, and a line in `CATALOGUES`.
"""

import importlib
import os
import typing
from collections.abc import Callable, Sequence
from typing import Any

from data_gen.catalogues.entry import Catalogue

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


def open_catalogue(name: str, source: str | os.PathLike[str], **options: Any) -> Catalogue:
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
    catalogue_class: Callable[..., Any] = getattr(importlib.import_module(module), kind)
    return catalogue_class


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

"""Opens catalogues by name, with options from the command line.

The first parameter of a catalogue is `source`. The other parameters are its options: the
annotations are their types for `--option`, and `--help` shows the section Args of the docstring.
"""

import os
import typing
from collections.abc import Callable, Sequence
from typing import Any

from data_gen.catalogues.entry import Catalogue
from data_gen.catalogues.indexed import indexed
from data_gen.catalogues.mesh_folder import folder
from data_gen.catalogues.procedural import procedural
from data_gen.catalogues.proportions import DEVIATION
from data_gen.catalogues.sh3f import sweet_home
from data_gen.catalogues.shapenet_meshes import shapenet

CATALOGUES: dict[str, Callable[..., Catalogue]] = {
    "procedural": procedural,
    "folder": folder,
    "indexed": indexed,
    "shapenet": shapenet,
    "sh3f": sweet_home,
}


def variants_of(models: Catalogue, variants: int = 0, deviation: float = DEVIATION) -> Catalogue:
    """A catalogue in which variants replace the models.

    Args:
      models: the catalogue.
      variants: number of variants with other proportions that replace each model; 0 = no change.
      deviation: standard deviation of the logarithm of the stretch along each axis, above 0 to 1.

    Raises:
      ValueError: a number is out of range.
    """
    if variants < 0:
        raise ValueError(f"variants: got {variants}, expected 0 or more")
    if not 0 < deviation <= 1:
        raise ValueError(f"deviation: got {deviation:g}, expected a number above 0, up to 1")
    if not variants:
        return models
    entries = [e.variant(n, deviation) for e in models.models for n in range(variants)]
    return Catalogue(models.name, entries, models.fractions)


def open_catalogue(
    name: str,
    source: str | os.PathLike[str],
    *,
    variants: int = 0,
    deviation: float | None = None,
    **options: Any,
) -> Catalogue:
    """The catalogue with this name in `CATALOGUES` and these options, or `variants_of` its models.

    Raises:
      ValueError: the name is unknown, the catalogue refuses the source, or `deviation` is given
        without `variants`.
    """
    if deviation is not None and not variants:
        raise ValueError(f"deviation: got {deviation:g}, which has no effect without variants")
    if name not in CATALOGUES:
        raise ValueError(f"catalogue {name!r}: expected one of {sorted(CATALOGUES)}")
    models = CATALOGUES[name](source, **options)
    return variants_of(models, variants, DEVIATION if deviation is None else deviation)


def option_types(name: str) -> dict[str, Any]:
    """The options of a catalogue and their types."""
    hints = typing.get_type_hints(CATALOGUES[name])
    own = {key: hint for key, hint in hints.items() if key not in ("source", "return")}
    return own | {"variants": int, "deviation": float}


def parse_options(name: str, pairs: Sequence[str]) -> dict[str, Any]:
    """Options of a catalogue from texts such as "up=+z" or "categories=chair,table".

    Raises:
      ValueError: an option is unknown or given twice, or a value has the wrong type.
    """
    hints = option_types(name)
    known = sorted(hints)
    result: dict[str, Any] = {}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        if not equals or key not in known:
            expected = f"NAME=VALUE with NAME one of {known} for the catalogue {name!r}"
            raise ValueError(f"option={pair}: expected {expected}")
        if key in result:
            raise ValueError(f"option={pair}: {key} is given twice, expected once")
        hint = hints[key]
        several = typing.get_origin(hint) is not None
        kind = typing.get_args(hint)[0] if several else hint
        parts = [part for part in text.split(",") if part or text] if several else [text]
        try:
            values = [kind(os.path.expanduser(part)) for part in parts]
        except ValueError:
            what = f"{kind.__name__} values with commas between them" if several else kind.__name__
            raise ValueError(f"option={pair}: expected {what}") from None
        result[key] = tuple(values) if several else values[0]
    return result

"""Builds frozen dataclasses from nested mappings and validates every key and value.

Field names, annotations (`Annotated[int, Bounds(low=1)]`, `Literal`, tuples, nested dataclasses)
and defaults of the dataclass define what is accepted. A field with the metadata
`{"derived": "NAMES"}` is computed from the fields or flags in NAMES: no key, and not written.
"""

import dataclasses
import difflib
import math
import sys
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

from psgn_jax.system.errors import UserError

T = TypeVar("T")


class ConfigError(UserError):
    """The configuration is wrong."""


@dataclasses.dataclass(frozen=True)
class Bounds:
    """Accepted interval of a number; `open_low` and `open_high` exclude the end points."""

    low: float | int = -math.inf
    high: float | int = math.inf
    open_low: bool = False
    open_high: bool = False

    def holds(self, value: float | int) -> bool:
        above = value > self.low if self.open_low else value >= self.low
        return above and (value < self.high if self.open_high else value <= self.high)

    def __str__(self) -> str:
        signs = {
            ">" if self.open_low else ">=": self.low,
            "<" if self.open_high else "<=": self.high,
        }
        ends = {sign: end for sign, end in signs.items() if math.isfinite(end)}
        texts = [f"{s} {x if isinstance(x, int) else format(x, 'g')}" for s, x in ends.items()]
        return " and ".join(texts)


@dataclasses.dataclass(frozen=True)
class Within:
    """Accepted pairs (low, high) of numbers: both in an interval, low <= high."""

    low: float
    high: float

    def holds(self, value: tuple[float, float]) -> bool:
        return self.low <= value[0] <= value[1] <= self.high

    def __str__(self) -> str:
        return f"(low, high) from {self.low:g} to {self.high:g}"


LARGEST_INT = 2**31 - 1  # largest count in a configuration, because counts are int32 on devices

Count = Annotated[int, Bounds(low=0, high=LARGEST_INT)]
PositiveInt = Annotated[int, Bounds(low=1, high=LARGEST_INT)]
Size = Annotated[int, Bounds(low=1, high=1_000_000)]
NonNegative = Annotated[float, Bounds(low=0)]
Positive = Annotated[float, Bounds(low=0, open_low=True)]
Fraction = Annotated[float, Bounds(low=0, high=1)]


Need = tuple[str, Callable[[Any], object], Sequence[str]]
"""A condition as text, its test, and the fields that are read only under it."""


def build(cls: type[T], node: Any, prefix: str = "") -> T:
    """Builds a dataclass from an `ml_collections.ConfigDict` or a mapping; lists count as tuples.

    `ConfigError` for an unknown key, a wrong type or a value out of range. One line has the field's
    name after `prefix` (such as "model."), its value and what is accepted.
    """
    if hasattr(node, "to_dict"):
        node = node.to_dict()
    if not isinstance(node, Mapping):
        raise wrong(prefix.rstrip("."), node, f"a section with {', '.join(_keys(cls))}")
    keys = _keys(cls)
    for key in node:
        if key not in keys:
            why = f"is not a field; {suggestion(str(key), keys)}accepted: {', '.join(keys)}"
            for field in dataclasses.fields(cls):  # type: ignore[arg-type]
                if field.name == key:
                    why = f"follows from {field.metadata['derived']}; remove it"
            raise ConfigError(f"{prefix}{key} {why}")
    hints = typing.get_type_hints(cls, include_extras=True)
    return cls(**{key: _convert(hints[key], value, prefix + key) for key, value in node.items()})


def to_dict(config: Any) -> dict[str, Any]:
    """Nested dict of a configuration dataclass, without derived fields; the inverse of `build`."""
    return {
        field.name: to_dict(value) if dataclasses.is_dataclass(value) else value
        for field in dataclasses.fields(config)
        if not field.metadata.get("derived")
        for value in [getattr(config, field.name)]
    }


def flatten(config: Any) -> dict[str, Any]:
    """`{"train.steps": 2000, ...}`, without derived fields."""

    def walk(node: Any, path: str) -> dict[str, Any]:
        if not isinstance(node, Mapping):
            return {path[1:]: node}
        return {k: v for key in node for k, v in walk(node[key], f"{path}.{key}").items()}

    return walk(to_dict(config), "")


def check_used(config: Any, needs: Sequence[Need], names: Iterable[str] | None = None) -> None:
    """Raises `ConfigError` if a field was changed (one of `names`, if given) but has no effect."""
    for needed, is_there, paths in needs:
        for path in () if is_there(config) else paths:
            section, _, field = path.partition(".")
            own = getattr(config, section)
            value, default = getattr(own, field), getattr(type(own)(), field)
            if value != default and (names is None or path in names):
                raise wrong(path, value, f"{default!r} unless {needed}")


def check_rules(config: Any, rules: Iterable[tuple[str, object, str]]) -> None:
    """Raises `ConfigError` for the first rule (field, whether it is wrong, accepted) that is."""
    for path, is_wrong, accepted in rules:
        if is_wrong:
            section, _, field = path.partition(".")
            raise wrong(path, getattr(getattr(config, section), field), accepted)


def suggestion(name: str, choices: Iterable[str]) -> str:
    """`"did you mean 'x'? "` if one of `choices` is similar to `name`, else "".

    Of dotted names, the last parts must be similar; "lr" is similar to "learning_rate".
    """
    section, _, last = name.rpartition(".")
    ends = {choice: choice.rpartition(".")[2] for choice in choices}
    short = {c: "".join(word[:1] for word in end.split("_")) for c, end in ends.items()}
    near = [c for c, end in ends.items() if last in (end, short[c] if "_" in end else end)]
    if not near:
        similar = difflib.get_close_matches(last, ends.values(), n=1, cutoff=0.7)
        near = [c for c, end in ends.items() if end in similar]
    near.sort(key=lambda choice: choice.rpartition(".")[0] != section)
    return f"did you mean {near[0]!r}? " if near else ""


def wrong(path: str, value: Any, accepted: str, hint: str = "") -> ConfigError:
    """The error for a wrong field, with its path, its value and the accepted values."""
    return ConfigError(f"{path or 'config'}={shown(value)}: {hint}accepted: {accepted}")


def shown(value: Any) -> str:
    """A value in a message: one line of at most 80 characters."""
    text = " ".join(repr(value).split())
    return text if len(text) <= 80 else text[:77] + "..."


def _convert(hint: Any, value: Any, path: str) -> Any:
    """Converts `value` to the type of the annotation `hint`, or raises `ConfigError`."""
    if dataclasses.is_dataclass(hint):
        return build(typing.cast(type, hint), value, path + ".")
    origin, args = get_origin(hint), get_args(hint)
    if origin is Annotated:
        converted = _convert(args[0], value, path)
        for bounds in args[1:]:
            if not bounds.holds(converted):
                kind = "range" if isinstance(bounds, Within) else "number"
                raise wrong(path, value, f"a {kind} {bounds}")
        return converted
    if origin is Literal:
        if not isinstance(value, str) or value not in args:
            hint_text = suggestion(value, args) if isinstance(value, str) else ""
            raise wrong(path, value, ", ".join(map(repr, args)), hint_text)
        return value
    if origin is tuple:
        return _convert_tuple(args, value, path)
    if origin is Mapping:
        if not isinstance(value, Mapping):
            raise wrong(path, value, "a section")
        return {key: _convert(args[1], item, f"{path}[{key!r}]") for key, item in value.items()}
    if hint is bool or hint is str:
        if not isinstance(value, hint):
            raise wrong(path, value, "True or False" if hint is bool else "a string")
        return value
    number: Any = int if hint is int else int | float
    if isinstance(value, bool) or not isinstance(value, number):
        raise wrong(path, value, "an integer" if hint is int else "a number")
    if hint is int:
        return value
    if not -sys.float_info.max <= value <= sys.float_info.max:
        raise wrong(path, value, "a finite number")
    return float(value)


def _convert_tuple(args: tuple[Any, ...], value: Any, path: str) -> tuple[Any, ...]:
    if not isinstance(value, list | tuple):
        raise wrong(path, value, "a tuple")
    hints = args[:1] * len(value) if args[-1] is Ellipsis else args
    if len(value) != len(hints):
        raise wrong(path, value, f"a tuple of {len(args)}")
    return tuple(_convert(hints[i], item, f"{path}[{i}]") for i, item in enumerate(value))


def _keys(cls: Any) -> list[str]:
    return [f.name for f in dataclasses.fields(cls) if not f.metadata.get("derived")]

"""Objects of the JSON of a glTF file, whose fields are read with their types checked."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from data_gen.mesh import UnusableModelError
from psgn_jax.system.untrusted import one_line


def damaged(what: str) -> UnusableModelError:
    """The refusal of a file."""
    return UnusableModelError(one_line(f"not readable as glTF: {what}")[:200])


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and -1e38 <= value <= 1e38


def _is_whole(value: Any) -> bool:
    return _is_number(value) and 0 <= value < 1 << 53 and value == int(value)


class Object:
    """An object of the JSON at a path such as `nodes[3]`. A wrong field is refused by its path."""

    def __init__(self, fields: Any, path: str, index: int = -1) -> None:
        if not isinstance(fields, dict):
            raise damaged(f"{path or 'its JSON'} is not an object")
        self.fields: dict[str, Any] = fields
        self.path, self.index = path, index

    def __contains__(self, key: str) -> bool:
        return key in self.fields

    def at(self, key: str) -> str:
        """The path of a field."""
        return f"{self.path}.{key}".lstrip(".")

    def _get(self, key: str, default: Any, right: Callable[[Any], bool], expected: str) -> Any:
        value = self.fields.get(key, default)
        if value is None or not right(value):
            got = "nothing" if value is None else repr(value)[:40]
            raise damaged(f"{self.at(key)}: got {got}, expected {expected}")
        return value

    def whole(self, key: str, default: int | None = None) -> int:
        return int(self._get(key, default, _is_whole, "a whole number from 0"))

    def number(self, key: str, default: float) -> float:
        return float(self._get(key, default, _is_number, "a number"))

    def text(self, key: str, default: str | None = None) -> str:
        value: str = self._get(key, default, lambda v: isinstance(v, str), "a text")
        return value

    def many(self, key: str, right: Callable[[Any], bool], expected: str) -> list[Any]:
        """A list; empty if it is missing."""
        value: list[Any] = self._get(
            key, [], lambda v: isinstance(v, list) and all(map(right, v)), f"a list of {expected}"
        )
        return value

    def wholes(self, key: str) -> list[int]:
        return [int(v) for v in self.many(key, _is_whole, "whole numbers from 0")]

    def texts(self, key: str) -> list[str]:
        return self.many(key, lambda v: isinstance(v, str), "texts")

    def numbers(self, key: str, default: Sequence[float] = ()) -> np.ndarray:
        """As many numbers as the default has; any number if that is empty."""
        values = self.many(key, _is_number, "numbers") if key in self else default
        if len(default) not in (0, len(values)):
            raise damaged(f"{self.at(key)}: got {len(values)} numbers, expected {len(default)}")
        return np.array(values, np.float64)

    def object(self, key: str) -> "Object":
        """The object in a field, without fields if it is missing."""
        return Object(self.fields.get(key, {}), self.at(key))

    def extension(self, name: str) -> "Object | None":
        found = self.object("extensions")
        return found.object(name) if name in found else None

    def objects(self, key: str) -> list["Object"]:
        values = self._get(key, [], lambda v: isinstance(v, list), "a list")
        return [Object(v, f"{self.at(key)}[{i}]", i) for i, v in enumerate(values)]

    def item(self, key: str, index: int) -> "Object":
        """An object of a list, which knows its index."""
        values = self._get(key, [], lambda v: isinstance(v, list), "a list")
        if index >= len(values):
            raise damaged(f"{self.at(key)}[{index}] does not exist, there are {len(values)}")
        return Object(values[index], f"{self.at(key)}[{index}]", index)

"""Checks of the fields of settings. The messages name the field, its value and what is expected."""

from collections.abc import Mapping, Sequence
from typing import Any

Range = tuple[float, float]
"""(low, high); a value is drawn from it uniformly."""


def check_between(name: str, value: float, low: float, high: float) -> None:
    """Raises ValueError unless low <= value <= high."""
    if not low <= value <= high:
        raise ValueError(f"{name}: got {value}, expected {low:g} to {high:g}")


def check_one_of(name: str, value: str, choices: Sequence[str]) -> None:
    """Raises ValueError unless the value is one of the choices."""
    if value not in choices:
        raise ValueError(f"{name}: got {value!r}, expected one of {list(choices)}")


def check_ranges(section: str, settings: Any, limits: Mapping[str, Range]) -> None:
    """Checks the fields of a settings object that are ranges.

    Args:
      section: name of the section, for the message.
      settings: the object with the fields.
      limits: for each field the least and the largest value that it may contain.

    Raises:
      ValueError: a field is not a pair (low, high) within its limits.
    """
    for name, (low, high) in limits.items():
        value = getattr(settings, name)
        if len(value) != 2 or not low <= value[0] <= value[1] <= high:
            raise ValueError(
                f"{section}.{name}: got {value}, expected (low, high) from {low:g} to {high:g}"
            )

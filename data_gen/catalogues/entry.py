"""What a catalogue is: models that are listed without being read, and loaded one by one.

Entries can be pickled, so worker processes take them as they are.
"""

import dataclasses
import functools
import hashlib
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from data_gen.mesh import Model

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
        `mesh.UnusableModelError` where no sample can be made of it.
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

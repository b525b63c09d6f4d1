"""The interface of catalogues: lists of models that are not read yet."""

import dataclasses
import functools
import hashlib
import pathlib
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

from data_gen.catalogues.proportions import vary
from data_gen.mesh import Model
from psgn_jax.system.untrusted import one_line

SPLITS = ("train", "validation", "test")
FRACTIONS = (0.8, 0.1, 0.1)
"""Default fractions of the splits, in the order of `SPLITS`."""


def printable(text: str) -> str:
    """The text as a line of valid UTF-8, with control characters and undecodable bytes escaped."""
    return one_line(text.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace"))


@dataclasses.dataclass(frozen=True)
class Entry:
    """A model of a catalogue, which can be pickled.

    Attributes:
      model_id: unique in the catalogue.
      category: "" if unknown.
      split: in `SPLITS`.
      load: reads the model and normalises it to the project's frame.
        `mesh.UnusableModelError` if no sample can be made from the model.
      find_file: returns the path of the mesh file. If the file changes, we try a refused model
        again.
    """

    model_id: str
    category: str
    split: str
    load: Callable[[], Model]
    find_file: Callable[[], pathlib.Path | None] | None = None

    def __post_init__(self) -> None:
        """Makes name and category printable."""
        for field in ("model_id", "category"):
            object.__setattr__(self, field, printable(getattr(self, field)))

    def variant(self, number: int, deviation: float) -> "Entry":
        """The variant `<model_id> variant <number>`, with random proportions and the same split.

        See `proportions.random_proportions` for the deviation.
        """
        name = f"{self.model_id}{_VARIANT}{number}"
        load = functools.partial(vary, self.load, name, deviation)
        return Entry(name, self.category, self.split, load, self.find_file)


_VARIANT = " variant "


def original_name(model_id: str) -> str:
    """The name without the ending of a variant."""
    return re.sub(rf"{_VARIANT}[0-9]+$", "", model_id)


@dataclasses.dataclass(frozen=True)
class Catalogue:
    """A list of models, always in the same order.

    The seeds of the models depend on `name`. `fractions` are those of `split_of`; None = the
    catalogue has its own splits.
    """

    name: str
    models: Sequence[Entry]
    fractions: tuple[float, float, float] | None = None


def split_of(model_id: str, fractions: tuple[float, float, float] = FRACTIONS) -> str:
    """The split of a model from a hash of its name, independent of other models.

    Raises:
      ValueError: a fraction is negative, or their sum is not 1.
    """
    if len(fractions) != len(SPLITS) or min(fractions) < 0 or abs(sum(fractions) - 1) > 1e-6:
        expected = f"{len(SPLITS)} numbers of 0 or more with a sum of 1"
        raise ValueError(f"split fractions: got {list(fractions)}, expected {expected}")
    number = hashed(model_id)
    for split, fraction in zip(SPLITS, fractions, strict=True):
        if number < fraction:
            return split
        number -= fraction
    # By rounding, the hash exceeds the sum of the fractions.
    return next(s for s, f in zip(SPLITS[::-1], fractions[::-1], strict=True) if f > 0)


def hashed(model_id: str) -> float:
    """A number in [0, 1) from a hash of the name."""
    digest = hashlib.sha256(model_id.encode("utf-8", "surrogatepass")).digest()
    return int.from_bytes(digest[:8], "big") / 2**64


_COLOURS = (
    "white|black|red|green|blue|yellow|grey|gray|brown|beige|orange|pink|purple|gold|silver|dark"
    "|light|clear"
)

_ENDINGS = re.compile(
    rf"([-_ .]?(lod[-_]?\d*|(low|high|hi)[-_]?(poly|res)|{_COLOURS})"
    r"|[-_ .]+(\d{1,3}|[a-z])|(?<=[a-z]{3})\d{1,2}|\(\d+\))$"
)

_GENERIC = re.compile(r"(model|scene|mesh|object)s?(_normalized)?")


def family_of(model_id: str) -> str:
    """The common name of near-duplicates.

    It is the name without folders, suffix, and numbers, colours and levels of detail at the end:
    "farmhouse" for `Models/farmhouse2-white.glb` and `farmhouse4.glb`. If a file is called model,
    scene, mesh or object, it is the name of the folder: "lemon" for `lemon/scene.gltf`.
    """
    folder, _, name = model_id.rpartition("/")
    stem = re.sub(r"\.[a-z]{1,4}$", "", name.rpartition("#")[2].casefold())
    while True:
        shorter = _ENDINGS.sub("", stem)
        if len(shorter) < 2 or shorter == stem:
            return family_of(folder) if folder and _GENERIC.fullmatch(stem) else stem
        stem = shorter


def moved_to_empty_splits(splits: Mapping[str, str], wanted: Sequence[str]) -> dict[str, str]:
    """New splits of objects of a small set, so that no `wanted` split is empty.

    An empty split gets an object of the largest split, chosen by a hash of the name. If no split
    has two objects, it gets the object of a later split: two objects are for training and
    validation.
    """
    moved: dict[str, str] = {}
    for index, empty in enumerate(wanted):
        now = {**splits, **moved}
        counts = Counter(now.values())
        if counts[empty] or not counts:
            continue
        givers = [s for s in wanted if counts[s] > 1] or [s for s in wanted[index:] if counts[s]]
        if givers:
            giver = max(givers, key=lambda s: counts[s])
            moved[min((name for name in now if now[name] == giver), key=hashed)] = empty
    return moved

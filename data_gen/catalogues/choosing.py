"""Which models of a catalogue: by patterns of category and name, and a sample spread over it."""

import dataclasses
import difflib
import fnmatch
import hashlib
from collections.abc import Sequence

from absl import logging

from data_gen.catalogues.entry import Entry


@dataclasses.dataclass(frozen=True)
class Choice:
    """Models of a catalogue: first `include`, then `exclude`, then the sample.

    A pattern of the shell (`*`, `?`, `[abc]`) stands for a model if it fits its category, its whole
    name, the beginning of the name up to one of its slashes, or a part between two slashes: of
    `Effects/Birds/swarm.ac`, `Effects`, `Effects/Birds`, `swarm.*` and `*swarm*` all do.

    Attributes:
      include: patterns; models that none of them fits are left out; () = all stay.
      exclude: patterns; models that one of them fits are left out.
      sample: so many of the models that are left, spread over categories and folders; 0 = all.
      seed: of the sample. A larger sample of the same seed holds a smaller one.
    """

    include: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()
    sample: int = 0
    seed: int = 0


def matches(pattern: str, entry: Entry) -> bool:
    """Whether a pattern stands for a model, see `Choice`."""
    return any(fnmatch.fnmatchcase(text, pattern) for text in _texts(entry))


def _texts(entry: Entry) -> set[str]:
    parts = entry.model_id.split("/")
    beginnings = {"/".join(parts[:count]) for count in range(1, len(parts) + 1)}
    return {entry.category, *parts, *beginnings} - {""}


def _check_patterns(flag: str, patterns: Sequence[str], entries: Sequence[Entry]) -> None:
    idle = [p for p in patterns if not any(matches(p, entry) for entry in entries)]
    if not idle:
        return
    known = sorted({text for entry in entries for text in _texts(entry)})
    near = [difflib.get_close_matches(p, known, 1) for p in idle]
    hints = [f"{p!r}" + (f" (did you mean {n[0]!r}?)" if n else "") for p, n in
             zip(idle, near, strict=True)]  # fmt: skip
    raise ValueError(f"--{flag}: no category and no name fits {', '.join(hints)}")


def choose(entries: Sequence[Entry], choice: Choice) -> list[Entry]:
    """The chosen models: in the given order without a sample, else in the sample's.

    Raises:
      ValueError: a pattern fits no model, nothing is left, or the sample has a negative size.
    """
    if choice.sample < 0:
        raise ValueError(f"--sample: got {choice.sample}, expected 1 or more")
    _check_patterns("include", choice.include, entries)
    _check_patterns("exclude", choice.exclude, entries)
    left = [
        entry for entry in entries
        if (not choice.include or any(matches(p, entry) for p in choice.include))
        and not any(matches(p, entry) for p in choice.exclude)
    ]  # fmt: skip
    if entries and not left:
        raise ValueError(f"--include, --exclude: none of the {len(entries)} models is left")
    if choice.sample > len(left):
        logging.warning("--sample=%d: all of the %d models are taken", choice.sample, len(left))
    return _spread(left, choice.seed)[: choice.sample] if choice.sample else left


def _spread(entries: Sequence[Entry], seed: int) -> list[Entry]:
    """All models in an order of which any beginning is spread over categories and folders.

    Of n models in all, a category or folder with m has k m / n of the first k, to within one. The
    model at place r of the random order of its m gets the place (r + u) / m in the whole, where u
    is uniform in [0, 1) and the same for the category or folder.
    """

    def uniform(*words: str) -> float:
        text = "\n".join([str(seed), *words]).encode("utf-8", "surrogatepass")
        return int.from_bytes(hashlib.sha256(text).digest()[:8], "big") / 2**64

    groups: dict[tuple[str, str], list[Entry]] = {}
    for entry in entries:
        folder = entry.model_id.rpartition("/")[0]
        groups.setdefault((entry.category, folder), []).append(entry)
    placed = []
    for group, members in groups.items():
        first = uniform("group", *group)
        ranked = sorted(members, key=lambda entry: uniform("model", entry.model_id))
        placed += [((r + first) / len(members), entry.model_id, entry)
                   for r, entry in enumerate(ranked)]  # fmt: skip
    return [entry for _, _, entry in sorted(placed, key=lambda item: item[:2])]

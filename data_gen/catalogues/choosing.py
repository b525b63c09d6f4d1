"""Chooses models of a catalogue by patterns of category and name, and by a stratified sample."""

import dataclasses
import difflib
import fnmatch
from collections.abc import Sequence

from absl import logging

from data_gen.catalogues.entry import Entry, hashed


@dataclasses.dataclass(frozen=True)
class Choice:
    """A choice of models: first by `include`, then by `exclude`, then the sample, then the limit.

    Patterns are shell patterns (`*`, `?`, `[abc]`). A pattern matches a model if it matches the
    category, the name, a part of the name between slashes, or the beginning of the name up to a
    slash. For example, `Effects`, `Effects/Birds`, `swarm.*` and `*swarm*` match
    `Effects/Birds/swarm.ac`.

    Attributes:
      include: patterns of models that we keep; () = all.
      exclude: patterns of models that we leave out.
      sample: number of models, spread over categories and folders; 0 = all.
      seed: of the sample. A larger sample with the same seed contains the smaller samples.
      limit: number of models, from the first; 0 = all.
    """

    include: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()
    sample: int = 0
    seed: int = 0
    limit: int = 0


def matches(pattern: str, entry: Entry) -> bool:
    texts = _texts(entry)
    return pattern in texts or any(fnmatch.fnmatchcase(text, pattern) for text in texts)


def _texts(entry: Entry) -> set[str]:
    parts = entry.model_id.split("/")
    beginnings = {"/".join(parts[:count]) for count in range(1, len(parts) + 1)}
    return {entry.category, *parts, *beginnings} - {""}


def choose(entries: Sequence[Entry], choice: Choice) -> list[Entry]:
    """The chosen models in their order; a sample is in random order.

    Raises:
      ValueError: a pattern matches no model, no model is left, or the sample size is negative.
    """
    if choice.sample < 0:
        raise ValueError(f"sample={choice.sample}: expected 0 or more")
    for field, patterns in (("include", choice.include), ("exclude", choice.exclude)):
        for pattern in patterns:
            if not any(matches(pattern, entry) for entry in entries):
                known = sorted({text for entry in entries for text in _texts(entry)})
                near = difflib.get_close_matches(pattern, known, 1)
                hint = f"; did you mean {near[0]!r}?" if near else ""
                raise ValueError(f"{field}={pattern}: no category and no name matches{hint}")
    left = [
        entry for entry in entries
        if (not choice.include or any(matches(p, entry) for p in choice.include))
        and not any(matches(p, entry) for p in choice.exclude)
    ]  # fmt: skip
    if entries and not left:
        raise ValueError(f"include and exclude leave none of the {len(entries)} models")
    if choice.sample > len(left):
        logging.warning("sample=%d: only %d models match", choice.sample, len(left))
    left = _spread(left, choice.seed)[: choice.sample] if choice.sample else left
    return left[: choice.limit or None]


def _spread(entries: Sequence[Entry], seed: int) -> list[Entry]:
    """All models in a random order, whose first k models are spread over categories and folders.

    A group has the models with the same category and folder. For each group of m models, we draw a
    number u uniformly in [0, 1). We order the group randomly and give its model of rank r the
    position (r + u) / m. If there are n models, about k m / n of the first k belong to the group.
    """

    def uniform(*words: str) -> float:
        return hashed("\n".join([str(seed), *words]))

    groups: dict[tuple[str, str], list[Entry]] = {}
    for entry in entries:
        folder = entry.model_id.rpartition("/")[0]
        groups.setdefault((entry.category, folder), []).append(entry)
    positions = []
    for group, members in groups.items():
        first = uniform("group", *group)
        ranked = sorted(members, key=lambda entry: uniform("model", entry.model_id))
        positions += [((r + first) / len(members), entry.model_id, entry)
                      for r, entry in enumerate(ranked)]  # fmt: skip
    return [entry for _, _, entry in sorted(positions, key=lambda item: item[:2])]

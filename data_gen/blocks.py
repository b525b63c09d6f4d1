"""The models of a job, divided into blocks; each block becomes a shard."""

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from typing import Any, NamedTuple

from psgn_jax.data.dataset import shard_name


class Name(NamedTuple):
    """Name, category and split of a model."""

    model_id: str
    category: str
    split: str


@dataclasses.dataclass(frozen=True)
class Job:
    """The specification of a data set, without the files of the models.

    Attributes:
      statement: settings, catalogue and renderer: everything that determines the samples of a
        model, besides its name and category.
      choice: how the models were chosen, as text for messages.
      names: the models, in the order of the catalogue.
      models_per_shard: number of models in a block.
    """

    statement: Mapping[str, Any]
    choice: Mapping[str, Any]
    names: tuple[Name, ...]
    models_per_shard: int

    @property
    def source(self) -> str:
        """The name of the catalogue."""
        return str(self.statement["source"])

    def blocks(self) -> list["Block"]:
        """All blocks, sorted by their first model."""
        result = []
        for split in dict.fromkeys(name.split for name in self.names):
            own = [i for i, name in enumerate(self.names) if name.split == split]
            for number, start in enumerate(range(0, len(own), self.models_per_shard)):
                indices = tuple(own[start : start + self.models_per_shard])
                names = tuple(self.names[i] for i in indices)
                text = json.dumps([self.statement, names], sort_keys=True)
                digest = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:16]
                result.append(Block(split, number, indices, names, digest))
        return sorted(result, key=lambda block: block.indices[0])


@dataclasses.dataclass(frozen=True)
class Block:
    """The models of a shard: from one split, in the order of the catalogue.

    Attributes:
      split: their split.
      number: number of the block in its split.
      indices: numbers of the models in the job.
      names: the models.
      digest: digest of the settings and the names.
    """

    split: str
    number: int
    indices: tuple[int, ...]
    names: tuple[Name, ...]
    digest: str

    @property
    def shard(self) -> str:
        """The name of the file of records."""
        return shard_name(self.split, self.number, self.digest[:8])

    @property
    def note(self) -> str:
        """The name of the file that marks the block as complete."""
        return f"{self.split}-{self.number:05d}-{self.digest}.json"

"""What a job makes: its models, in blocks of which each becomes a shard."""

import dataclasses
import hashlib
import json
from collections.abc import Mapping
from typing import Any, NamedTuple

from psgn_jax.data.dataset import shard_name


class Name(NamedTuple):
    """What a job knows of a model."""

    model_id: str
    category: str
    split: str


@dataclasses.dataclass(frozen=True)
class Job:
    """What a data set is made of, but for the models' files themselves.

    Attributes:
      statement: of the settings, the catalogue and the renderer: all that the samples of a model
        depend on besides its name and category.
      choice: how the models were chosen from the catalogue, for people and messages.
      names: the models, in the catalogue's order.
      models_per_shard: models of a block.
    """

    statement: Mapping[str, Any]
    choice: Mapping[str, Any]
    names: tuple[Name, ...]
    models_per_shard: int

    @property
    def source(self) -> str:
        """Name of the catalogue."""
        return str(self.statement["source"])

    def blocks(self) -> list["Block"]:
        """All blocks, by their first model, so that a job goes through the catalogue."""
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
    """Models whose samples make one shard: of one split, in the catalogue's order.

    Attributes:
      split: of all of them.
      number: of the block in its split.
      indices: of the models in the job.
      names: of the models.
      digest: of the settings and the names.
    """

    split: str
    number: int
    indices: tuple[int, ...]
    names: tuple[Name, ...]
    digest: str

    @property
    def shard(self) -> str:
        """Name of the file of records."""
        return shard_name(self.split, self.number, self.digest[:8])

    @property
    def note(self) -> str:
        """Name of the file that says it is done."""
        return f"{self.split}-{self.number:05d}-{self.digest}.json"

"""The manifest of a data set, `manifest.json`: format, version, splits, shards and counts."""

import dataclasses
import json
import os
import pathlib
from collections.abc import Mapping

from psgn_jax.data import schema
from psgn_jax.data.schema import RecordError
from psgn_jax.files import write_atomic

FORMAT = "psgn_jax records"
VERSION = 1
MANIFEST = "manifest.json"


@dataclasses.dataclass(frozen=True)
class Shard:
    """One file of records.

    Attributes:
      file: file name in the folder of the data set.
      split: name of its split.
      count: number of records.
      size: size of the file in bytes.
      crc32: CRC-32 of the whole file.
      categories: number of records of each category.
      fields: the fields that all its records have.
      inputs: identifiers of its inputs, for a converter that is started again.
    """

    file: str
    split: str
    count: int
    size: int
    crc32: int
    categories: Mapping[str, int]
    fields: tuple[str, ...]
    inputs: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True)
class Manifest:
    """The contents of a data set; `complete` is False while it is being written."""

    source: str
    complete: bool
    shards: tuple[Shard, ...]

    def splits(self) -> dict[str, tuple[Shard, ...]]:
        """Shards by split, both sorted by name."""
        out: dict[str, list[Shard]] = {}
        for shard in sorted(self.shards, key=lambda s: s.file):
            out.setdefault(shard.split, []).append(shard)
        return {name: tuple(out[name]) for name in sorted(out)}

    def fields(self) -> tuple[str, ...]:
        """Fields that every record has, in the order of `schema.FIELDS`."""
        present = [set(s.fields) for s in self.shards]
        common = set.intersection(*present) if present else set()
        return tuple(f for f in schema.FIELDS if f in common)


def save_manifest(folder: pathlib.Path, manifest: Manifest) -> None:
    """Writes the manifest atomically."""
    content = {
        "format": FORMAT,
        "version": VERSION,
        "source": manifest.source,
        "complete": manifest.complete,
        "fields": manifest.fields(),
        "shards": [dataclasses.asdict(s) for s in manifest.shards],
    }
    write_atomic(folder / MANIFEST, json.dumps(content, indent=1) + "\n")


def load_manifest(folder: str | os.PathLike[str], *, allow_incomplete: bool = False) -> Manifest:
    """Reads the manifest of a data set.

    Raises:
      RecordError: there is no data set; its manifest is damaged or of another version; or the data
        set is not complete and `allow_incomplete` is False.
    """
    folder = pathlib.Path(folder)
    path = folder / MANIFEST
    if not folder.is_dir():
        raise RecordError(f"data set {str(folder)!r}: there is no such folder")
    if not path.is_file():
        raise RecordError(
            f"data set {str(folder)!r}: not a data set of this project, it has no {MANIFEST} "
            "(`python -m psgn_jax.convert` creates one)"
        )
    try:
        content = json.loads(path.read_text())
        form, version = content["format"], content["version"]
    except (ValueError, TypeError, KeyError) as error:
        raise RecordError(f"{path}: damaged ({error}); convert the data set again") from None
    if form != FORMAT:
        raise RecordError(f"{path}: format {form!r}, expected {FORMAT!r}")
    if version != VERSION:
        raise RecordError(
            f"{path}: format version {version!r}, this version of psgn_jax reads {VERSION}; "
            "convert the data set again, or use the version of psgn_jax that wrote it"
        )
    try:
        shards = tuple(
            Shard(**{**s, "fields": tuple(s["fields"]), "inputs": tuple(s["inputs"])})
            for s in content["shards"]
        )
        for s in shards:
            # Names are used as paths: refuse names that lead out of the folder.
            if (
                pathlib.PurePath(s.file).name != s.file
                or not isinstance(s.count, int)
                or s.count < 0
            ):
                raise ValueError(f"shard {s.file!r} with {s.count!r} records")
        manifest = Manifest(str(content["source"]), bool(content["complete"]), shards)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise RecordError(f"{path}: damaged ({error}); convert the data set again") from None
    if not manifest.complete and not allow_incomplete:
        raise RecordError(
            f"data set {str(folder)!r}: its writing has not ended; run the command that writes it "
            "again, it continues where it stopped"
        )
    return manifest

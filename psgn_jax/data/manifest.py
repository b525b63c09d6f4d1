"""The manifest of a data set, `manifest.json`: format, version, splits, shards and counts."""

import dataclasses
import json
import os
import pathlib
import re
from collections.abc import Mapping
from typing import Any

from psgn_jax.data import schema
from psgn_jax.data.schema import RecordError
from psgn_jax.files import write_atomic
from psgn_jax.untrusted import one_line, read_json

FORMAT = "psgn_jax records"
VERSION = 1
MANIFEST = "manifest.json"

SPLIT_NAME = re.compile(r"[a-z0-9_]+")
"""Valid names of splits; the names of a split's files begin with its name."""

_MOST_RECORDS = 1 << 40  # of a shard: sums over shards stay within 64 bits
_MOST_BYTES = 1 << 53


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
      inputs: identifiers of the inputs that were converted to it. A converter that is started again
        compares them.
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
    if not path.exists():
        raise RecordError(
            f"data set {str(folder)!r}: not a data set of this project, it has no {MANIFEST} "
            "(`python -m psgn_jax.convert` creates one)"
        )
    try:
        content = read_json(path)
        form, version = content["format"], content["version"]
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror or error}") from None
    except (ValueError, TypeError, KeyError) as error:
        raise _damaged(path, error) from None
    if form != FORMAT:
        raise RecordError(f"{path}: format {_shown(form)}, expected {FORMAT!r}")
    if version != VERSION:
        raise RecordError(
            f"{path}: format version {_shown(version)}, this version of psgn_jax reads {VERSION}; "
            "convert the data set again, or use the version of psgn_jax that wrote it"
        )
    try:
        _check_type("source", content.get("source"), str)
        _check_type("complete", content.get("complete"), bool)
        _check_type("shards", content.get("shards"), list)
        shards = tuple(shard_of(entry) for entry in content["shards"])
        files = [shard.file for shard in shards]
        if len(set(files)) < len(files):
            twice = next(file for file in files if files.count(file) > 1)
            raise ValueError(f"shard {twice!r} is listed twice")
        manifest = Manifest(content["source"], content["complete"], shards)
    except ValueError as error:
        raise _damaged(path, error) from None
    if not manifest.complete and not allow_incomplete:
        raise RecordError(
            f"data set {str(folder)!r}: it is incomplete; start the command that writes it again: "
            "it continues where it stopped"
        )
    return manifest


def shard_of(entry: Any) -> Shard:
    """A shard from its entry in a manifest, with the type and range of every field checked.

    Raises:
      ValueError: a field is missing, unknown or wrong; the message names it.
    """
    _check_type("shard", entry, dict)
    names = [field.name for field in dataclasses.fields(Shard)]
    if set(entry) != set(names):
        odd = sorted({*entry} ^ {*names})
        raise ValueError(
            f"a shard with missing or unknown fields {_shown(odd)}, expected the fields {names}"
        )
    _check_type("file", entry["file"], str)
    # Names are used as paths: refuse names that lead out of the folder.
    name = entry["file"]
    if pathlib.PurePath(name).name != name or name == ".." or not name.isprintable():
        raise ValueError(f"file {_shown(name)}: expected the name of a file in the folder")
    _check_type("split", entry["split"], str)
    if not SPLIT_NAME.fullmatch(entry["split"]):
        raise ValueError(f"split {_shown(entry['split'])}: expected [a-z0-9_]")
    for name, most in (("count", _MOST_RECORDS), ("size", _MOST_BYTES), ("crc32", (1 << 32) - 1)):
        _check_count(name, entry[name], most)
    _check_type("categories", entry["categories"], dict)
    for value in entry["categories"].values():
        _check_count("categories", value, _MOST_RECORDS)
    if sum(entry["categories"].values()) != entry["count"]:
        raise ValueError(
            f"shard {entry['file']!r}: {entry['count']} records, but "
            f"{sum(entry['categories'].values())} in its categories"
        )
    for name in ("fields", "inputs"):
        _check_type(name, entry[name], list)
        for value in entry[name]:
            _check_type(name, value, str)
    if not set(entry["fields"]) <= set(schema.FIELDS):
        odd = sorted({*entry["fields"]} - {*schema.FIELDS})
        raise ValueError(f"fields {_shown(odd)}, expected any of {list(schema.FIELDS)}")
    return Shard(**{**entry, "fields": tuple(entry["fields"]), "inputs": tuple(entry["inputs"])})


def _check_type(name: str, value: Any, kind: type) -> None:
    if not isinstance(value, kind):
        raise ValueError(f"{name} is {_shown(value)}, expected {_KIND_NAMES[kind]}")


_KIND_NAMES = {str: "a string", bool: "true or false", list: "a list", dict: "a JSON object"}


def _check_count(name: str, value: Any, most: int) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= most:
        raise ValueError(f"{name} is {_shown(value)}, expected a number from 0 to {most}")


def _shown(value: Any) -> str:
    shown = repr(value)
    return shown if len(shown) <= 60 else shown[:57] + "..."


def _damaged(path: pathlib.Path, error: Exception) -> RecordError:
    what = f"no {error} there" if isinstance(error, KeyError) else one_line(error)
    return RecordError(f"{path}: damaged ({what}); convert the data set again")

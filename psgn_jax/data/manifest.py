"""The manifest of a data set, `manifest.json`: format, version, splits, shards and counts."""

import dataclasses
import json
import os
import pathlib
import re
import zlib
from collections.abc import Callable, Mapping
from typing import Any

from psgn_jax.data import schema
from psgn_jax.data.schema import RecordError
from psgn_jax.system.files import write_atomic
from psgn_jax.system.untrusted import one_line, read_json

FORMAT = "psgn_jax records"
VERSION = 1
MANIFEST = "manifest.json"

SPLIT_NAME = re.compile(r"[a-z0-9_]+")
"""Valid names of splits; the names of a split's files begin with its name."""

DUPLICATES = "duplicate"
"""Split of training samples whose shape is that of a validation or test object; nobody reads it."""


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
    """Writes the manifest atomically, with a CRC-32 of its content."""
    content = {
        "format": FORMAT,
        "version": VERSION,
        "source": manifest.source,
        "complete": manifest.complete,
        "fields": manifest.fields(),
        "shards": [dataclasses.asdict(s) for s in manifest.shards],
    }
    content["crc32"] = _checksum(content)
    write_atomic(folder / MANIFEST, json.dumps(content, indent=1) + "\n")


def _checksum(content: Mapping[str, Any]) -> int:
    """CRC-32 of all entries but the checksum itself, independent of their order and of spaces."""
    rest = {key: value for key, value in content.items() if key != "crc32"}
    return zlib.crc32(json.dumps(rest, sort_keys=True).encode())


def load_manifest(folder: str | os.PathLike[str], *, allow_incomplete: bool = False) -> Manifest:
    """Reads the manifest of a data set; those of earlier versions have no checksum.

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
            "(`psgn convert` creates one)"
        )
    try:
        content = read_json(path)
        form, version = content["format"], content["version"]
        if form != FORMAT:
            raise RecordError(f"{path}: format {_shown(form)}, expected {FORMAT!r}")
        if version != VERSION:
            raise RecordError(
                f"{path}: format version {_shown(version)}, this version of psgn_jax reads "
                f"{VERSION}; convert the data set again, or use the version of psgn_jax that wrote "
                "it"
            )
        if "crc32" in content and content["crc32"] != _checksum(content):
            raise ValueError("its checksum does not match")
        for name, (kind, expected) in _TYPES.items():
            if not isinstance(content.get(name), kind):
                raise ValueError(f"{name} is {_shown(content.get(name))}, expected {expected}")
        shards = tuple(shard_of(entry) for entry in content["shards"])
        files = [shard.file for shard in shards]
        if len(set(files)) < len(files):
            twice = next(file for file in files if files.count(file) > 1)
            raise ValueError(f"shard {twice!r} is listed twice")
    except RecordError:
        raise
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror or error}") from None
    except (ValueError, TypeError, KeyError) as error:
        what = f"no {error} there" if isinstance(error, KeyError) else one_line(error)
        raise RecordError(f"{path}: damaged ({what}); convert the data set again") from None
    if not content["complete"] and not allow_incomplete:
        raise RecordError(
            f"data set {str(folder)!r}: it is incomplete; start the command that writes it again: "
            "it continues where it stopped"
        )
    return Manifest(content["source"], content["complete"], shards)


def shard_of(entry: Any) -> Shard:
    """A shard from its entry in a manifest, with the type and range of every field checked.

    Raises:
      ValueError: a field is missing, unknown or wrong; the message names it.
    """
    names = [field.name for field in dataclasses.fields(Shard)]
    if not isinstance(entry, dict) or set(entry) != set(names):
        odd = sorted({*entry} ^ {*names}) if isinstance(entry, dict) else entry
        raise ValueError(
            f"a shard with missing or unknown fields {_shown(odd)}, expected the fields {names}"
        )
    for name, (holds, expected) in _RULES.items():
        if not holds(entry[name]):
            raise ValueError(f"{name} is {_shown(entry[name])}, expected {expected}")
    shard = Shard(**{**entry, "fields": tuple(entry["fields"]), "inputs": tuple(entry["inputs"])})
    if sum(shard.categories.values()) != shard.count:
        raise ValueError(
            f"shard {shard.file!r}: {shard.count} records, but "
            f"{sum(shard.categories.values())} in its categories"
        )
    if not shard.file.startswith(f"{shard.split}-"):
        raise ValueError(f"shard {shard.file!r} is listed in the split {shard.split!r}")
    return shard


def _is_count(value: Any, bits: int = 40) -> bool:
    """Whether a value is an integer of so many bits; sums over shards then stay within 64 bits."""
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < 1 << bits


def _is_file_name(name: Any) -> bool:
    """Whether a name stays in the folder of the data set; names are used as paths."""
    return (
        isinstance(name, str) and pathlib.PurePath(name).name == name != ".." and name.isprintable()
    )


def _are_strings(values: Any) -> bool:
    return isinstance(values, list) and all(isinstance(value, str) for value in values)


_TYPES = {
    "source": (str, "a string"),
    "complete": (bool, "true or false"),
    "shards": (list, "a list"),
}

_RULES: dict[str, tuple[Callable[[Any], bool], str]] = {
    "file": (_is_file_name, "the name of a file in the folder"),
    "split": (lambda v: isinstance(v, str) and bool(SPLIT_NAME.fullmatch(v)), "[a-z0-9_]"),
    "count": (_is_count, "a number below 2**40"),
    "size": (lambda v: _is_count(v, 53), "a number below 2**53"),
    "crc32": (lambda v: _is_count(v, 32), "a number below 2**32"),
    "categories": (
        lambda v: isinstance(v, dict) and all(map(_is_count, v.values())),
        "a number below 2**40 for each category",
    ),
    "fields": (
        lambda v: _are_strings(v) and set(v) <= set(schema.FIELDS),
        f"a list of any of {list(schema.FIELDS)}",
    ),
    "inputs": (_are_strings, "a list of strings"),
}


def _shown(value: Any) -> str:
    shown = repr(value)
    return shown if len(shown) <= 60 else shown[:57] + "..."

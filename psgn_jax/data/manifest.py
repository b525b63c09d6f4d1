"""The manifest of a data set, `manifest.json`: format, version, splits, shards and counts."""

import collections
import dataclasses
import json
import os
import pathlib
import re
from collections.abc import Mapping
from typing import Annotated

from psgn_jax.config.structured import Bounds, build
from psgn_jax.data import schema
from psgn_jax.data.schema import RecordError
from psgn_jax.system.files import write_atomic
from psgn_jax.system.untrusted import one_line, read_json, with_checksum, without_checksum

FORMAT = "psgn_jax records"
VERSION = 1
MANIFEST = "manifest.json"

SPLIT_NAME = re.compile(r"[a-z0-9_]+")
"""Valid names of splits, with which the names of their files begin."""

DUPLICATES = "duplicate"
"""Split of training samples with the shape of a validation or test object; no config uses it."""

# Sums of counts over all shards stay within 64 bits.
_Count = Annotated[int, Bounds(0, (1 << 40) - 1)]
NOT_STATED = -1


@dataclasses.dataclass(frozen=True)
class Shard:
    """One file of records."""

    file: str  # name in the folder of the data set
    split: str
    count: Annotated[int, Bounds(1, (1 << 40) - 1)]  # number of records
    size: Annotated[int, Bounds(0, (1 << 53) - 1)]  # in bytes
    crc32: Annotated[int, Bounds(0, (1 << 32) - 1)]  # of the whole file
    categories: Mapping[str, _Count]  # category -> number of records
    fields: tuple[str, ...]  # fields that all records have
    inputs: tuple[str, ...]  # digest of the inputs, if `data.shards` wrote the shard
    # Checksum of the file's ends, which identify the shard; older manifests do not state it.
    ends: Annotated[int, Bounds(NOT_STATED, (1 << 32) - 1)] = NOT_STATED


@dataclasses.dataclass(frozen=True)
class Manifest:
    """The contents of a data set; `complete` is False while it is being written."""

    source: str
    complete: bool
    shards: tuple[Shard, ...]

    def splits(self) -> dict[str, tuple[Shard, ...]]:
        """Split -> shards; both are sorted by name."""
        shards = sorted(self.shards, key=lambda shard: shard.file)
        return {
            name: tuple(shard for shard in shards if shard.split == name)
            for name in sorted({shard.split for shard in shards})
        }

    def fields(self) -> tuple[str, ...]:
        """The fields that every record has, in the order of `schema.FIELDS`."""
        common = self.shards and set.intersection(*(set(shard.fields) for shard in self.shards))
        return tuple(field for field in schema.FIELDS if field in common)


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
    write_atomic(folder / MANIFEST, json.dumps(with_checksum(content), indent=1) + "\n")


def load_manifest(folder: str | os.PathLike[str], *, allow_incomplete: bool = False) -> Manifest:
    """Reads the manifest of a data set.

    `RecordError` if there is none, it is damaged or of another version, or the data set is not
    complete and `allow_incomplete` is False.
    """
    folder = pathlib.Path(folder)
    path = folder / MANIFEST
    if not folder.is_dir():
        at = "" if folder.is_absolute() else f" in {pathlib.Path.cwd()}; give --data or data.path"
        raise RecordError(f"data set {str(folder)!r}: there is no such folder{at}")
    if not path.exists():
        raise RecordError(
            f"data set {str(folder)!r}: not a data set of this project, it has no {MANIFEST} "
            "(`psgn render` makes one of meshes, `psgn convert` of published data)"
        )
    try:
        content = without_checksum(read_json(path))
        if content["format"] != FORMAT or content["version"] != VERSION:
            found = f"{content['format']!r}"[:60], f"{content['version']!r}"[:60]
            raise RecordError(
                f"{path}: format {found[0]}, version {found[1]}; this version of psgn_jax reads "
                f"{FORMAT!r}, version {VERSION}; convert the data set again, "
                "or use a newer psgn_jax"
            )
        stated = {field.name: content[field.name] for field in dataclasses.fields(Manifest)}
        manifest = build(Manifest, stated)
        files = collections.Counter(_check(shard).file for shard in manifest.shards)
        if len(files) < len(manifest.shards):
            raise ValueError(f"shard {files.most_common(1)[0][0]!r} is listed twice")
    except RecordError:
        raise
    except OSError as error:
        raise RecordError(f"{path} cannot be read: {error.strerror or error}") from None
    except (ValueError, TypeError, KeyError) as error:
        what = f"no {error} there" if isinstance(error, KeyError) else one_line(error)
        raise RecordError(f"{path}: damaged ({what}); convert the data set again") from None
    if not manifest.complete and not allow_incomplete:
        raise RecordError(
            f"data set {str(folder)!r}: it is incomplete; start the command that writes it again: "
            "it continues where it stopped"
        )
    return manifest


def _check(shard: Shard) -> Shard:
    """Checks the names that become paths, and the lengths of categories."""
    if not SPLIT_NAME.fullmatch(shard.split):
        raise ValueError(f"split {shard.split!r}, expected lower-case letters, digits and _")
    if pathlib.PurePath(shard.file).name != shard.file or not shard.file.isprintable():
        raise ValueError(f"file {shard.file!r}, expected the name of a file in the folder")
    if not shard.file.startswith(f"{shard.split}-"):
        raise ValueError(f"file {shard.file!r} is listed in the split {shard.split!r}")
    if (longest := max(map(len, shard.categories), default=0)) > schema.MAX_LABEL:
        raise ValueError(
            f"a category has {longest} characters, expected at most {schema.MAX_LABEL}"
        )
    return shard

"""Data sets on disk: shards of records with random access and checksums.

A data set is a folder with a `manifest.json` (`data.manifest`) and shards
`<split>-<number>.arrayrecord`, ArrayRecord files with one record (`data.codec`) per group. If
`data.shards` writes a data set, the file's checksum follows the number.

Shards are written under a temporary name, fsynced and renamed. At the end, the manifest's field
`complete` becomes true. ArrayRecord's hashes detect damaged blocks; the CRC-32 of a record also
detects changes between encoder and decoder.
"""

import collections
import contextlib
import dataclasses
import errno
import itertools
import os
import pathlib
import threading
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Sized
from typing import Any, TypeVar

import numpy as np
from absl import logging
from array_record.python import array_record_module

from psgn_jax.data import schema
from psgn_jax.data.codec import decode, decode_stored, encode, unpack
from psgn_jax.data.doubts import Doubts
from psgn_jax.data.manifest import (
    MANIFEST,
    NOT_STATED,
    SPLIT_NAME,
    Manifest,
    Shard,
    load_manifest,
    save_manifest,
)
from psgn_jax.data.schema import RecordError, Sample
from psgn_jax.system.errors import native_error
from psgn_jax.system.files import file_crc32, install, local_path, remove_temporaries, temporary_for
from psgn_jax.system.locks import lock_part
from psgn_jax.system.untrusted import brief, kind_of, one_line

T = TypeVar("T")

# One record per group: reading a record does not decode its neighbours. Records are compressed.
_WRITER_OPTIONS = "group_size:1,uncompressed"
# Read-ahead costs memory and helps only sequential reads.
_READER_OPTIONS = "readahead_buffer_size:0"
_LOCK = threading.Lock()  # for the open shards; global, because a lock cannot be pickled


def shard_name(split: str, number: int, tag: str = "") -> str:
    """File name of a shard; the tag distinguishes shards with the same number."""
    if not SPLIT_NAME.fullmatch(split):
        raise ValueError(f"split {split!r}: expected lower-case letters, digits and _")
    return f"{split}-{number:05d}{tag and '-'}{tag}.arrayrecord"


class ShardWriter(contextlib.AbstractContextManager["ShardWriter"]):
    """Context that writes one shard; the file gets its name when the context ends without error.

    Afterwards, `shard` describes the file. With a `digest` of the shard's inputs, the file's
    checksum is part of its name. If the file cannot be written, `write` or the end of the context
    raises `OSError`, and no file remains.
    """

    def __init__(self, folder: pathlib.Path, split: str, number: int, digest: str = "") -> None:
        self._path, self._number = folder / shard_name(split, number), number
        self._temporary = temporary_for(self._path)
        self._split, self._inputs = split, (digest,) if digest else ()
        self._categories: collections.Counter[str] = collections.Counter()
        self._fields = set(schema.FIELDS)
        self._writer = array_record_module.ArrayRecordWriter(str(self._temporary), _WRITER_OPTIONS)
        self.count = 0
        self.shard: Shard  # set at the end of the context

    def write(self, record: bytes) -> dict[str, Any]:
        """Writes a record and returns its `codec.unpack`."""
        stored = unpack(record)
        with self._os_errors():
            self._writer.write(record)
        self.count += 1
        self._categories[str(stored["category"])] += 1
        self._fields -= {field for field in schema.OPTIONAL_FIELDS if field not in stored}
        return stored

    @contextlib.contextmanager
    def _os_errors(self) -> Iterator[None]:
        """Turns ArrayRecord's errors into `OSError`."""
        try:
            yield
        except RuntimeError as error:
            raise native_error(error, self._path) from error

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        try:
            with self._os_errors():
                self._writer.close()
            if kind is None:
                crc32 = file_crc32(self._temporary)
                if self._inputs:
                    name = shard_name(self._split, self._number, f"{crc32:08x}")
                    self._path = self._path.with_name(name)
                install(self._temporary, self._path)
                self.shard = Shard(
                    file=self._path.name,
                    split=self._split,
                    count=self.count,
                    size=self._path.stat().st_size,
                    crc32=crc32,
                    categories=dict(sorted(self._categories.items())),
                    fields=tuple(f for f in schema.FIELDS if f in self._fields),
                    inputs=self._inputs,
                    ends=_ends(self._path),
                )
        except OSError:
            if kind is None:  # otherwise the earlier error is raised
                raise
        finally:
            self._temporary.unlink(missing_ok=True)


def write_dataset(
    folder: str | os.PathLike[str],
    splits: Mapping[str, Iterable[Sample]],
    *,
    source: str,
    records_per_shard: int = 512,
) -> Manifest:
    """Writes a data set with one sample in memory at a time; `RecordError` if the folder has one.

    Probable mistakes are logged (`data.doubts`). A wrong argument raises ValueError before the
    first sample is taken, and another process that writes there `TakenError`. If the call fails,
    no file remains.
    """
    for split in splits:
        shard_name(split, 0)  # checks the name
    if not isinstance(source, str):
        raise ValueError(f"source {source!r}: expected a string")
    if records_per_shard < 1:
        raise ValueError(f"records_per_shard {records_per_shard}: expected at least 1")
    sized = [name for name, samples in splits.items() if isinstance(samples, Sized)]
    if not splits or not all(len(splits[name]) for name in sized):  # type: ignore[arg-type]
        raise ValueError(f"splits {list(splits)}: expected at least one, with samples in each")
    folder = pathlib.Path(local_path(folder, "folder"))
    folder.mkdir(parents=True, exist_ok=True)
    with lock_part(folder / ".work", (0, 1)):
        if (folder / MANIFEST).exists():
            raise RecordError(f"data set {str(folder)!r} exists; give another folder, or remove it")
        if left := sorted(folder.glob("*.arrayrecord")):
            raise RecordError(
                f"{left[0]} belongs to no data set, perhaps to one that was not finished; give "
                "another folder, or remove such files"
            )
        remove_temporaries(folder)
        doubts, shards = Doubts(), []
        try:
            for split, samples in splits.items():
                remaining, number = iter(samples), 0
                while (first := next(remaining, None)) is not None:
                    part = itertools.islice(remaining, records_per_shard - 1)
                    with ShardWriter(folder, split, number) as writer:
                        for sample in itertools.chain([first], part):
                            record = writer.write(encode(sample))
                            doubts.add(split, record, sample)
                    shards.append(writer.shard)
                    number += 1
                if not number:
                    raise ValueError(
                        f"split {split!r} has no samples; leave it out, or give samples"
                    )
            manifest = Manifest(source, True, tuple(shards))
            save_manifest(folder, manifest)
        except BaseException:
            for shard in shards:
                (folder / shard.file).unlink(missing_ok=True)
            raise
    for line in doubts.lines():
        logging.warning("data set %s: %s", folder, one_line(line))
    return manifest


class RecordReader:
    """Random access to the records of one split of one or more data sets, concatenated.

    Folders without the split are skipped; a repeated folder counts again. A reader can be pickled
    and shared between threads. The constructor compares the shards with the manifest. Decoding a
    record checks its CRC-32; `read` does not.

    Raises:
      RecordError: a folder has no complete data set, no folder has the split, or a shard is missing
        or is another file.
    """

    def __init__(
        self, folders: str | os.PathLike[str] | Sequence[str | os.PathLike[str]], split: str
    ) -> None:
        if isinstance(folders, str | os.PathLike):
            folders = [folders]
        paths = [pathlib.Path(folder) for folder in folders]
        splits = {path: load_manifest(path).splits() for path in dict.fromkeys(paths)}
        if not any(split in found for found in splits.values()):
            names, present = ",".join(map(str, splits)), sorted(set().union(*splits.values()))
            raise RecordError(
                f"data set {names!r} has no split {split!r}; it has {present}; choose one of them "
                "(data.train_split, data.eval_split, split), or render another "
                "set with the option fractions=0.6,0.2,0.2 of its catalogue"
            )
        parts = [(path / s.file, s) for path in paths for s in splits[path].get(split, ())]
        for path, shard in dict(parts).items():
            check_shard(path, shard)
        self.split = split
        self._paths, self.shards = [path for path, _ in parts], tuple(shard for _, shard in parts)
        self._ends = np.cumsum([shard.count for shard in self.shards])
        self._readers: dict[pathlib.Path, Any] = {}

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_readers": {}}

    def __len__(self) -> int:
        return int(self._ends[-1])

    def locate(self, index: int) -> tuple[pathlib.Path, int]:
        """The file of record `index`, and the record's number in the file."""
        if not 0 <= index < len(self):
            raise IndexError(f"record {index}: expected 0 to {len(self) - 1}")
        number = int(np.searchsorted(self._ends, index, side="right"))
        return self._paths[number], index - int(self._ends[number]) + self.shards[number].count

    def _open(self, path: pathlib.Path) -> Any:
        with _LOCK:
            if path not in self._readers:
                count = self.shards[self._paths.index(path)].count
                with _shard_errors(path, f"shard {path} cannot be opened"):
                    reader = array_record_module.ArrayRecordReader(str(path), _READER_OPTIONS)
                    if (found := reader.num_records()) != count:
                        raise RuntimeError(f"it has {found} records, expected {count}")
                self._readers[path] = reader
            return self._readers[path]

    def _decoded(self, index: int, decoder: Callable[[bytes], T]) -> T:
        path, position = self.locate(index)
        reader = self._open(path)
        with _shard_errors(path, f"record {position} of {path} is damaged"):
            return decoder(reader.read([position])[0])

    def read(self, index: int) -> bytes:
        """The bytes of record `index`; `RecordError` names the file and record if it is damaged."""
        return self._decoded(index, bytes)

    def unpacked(self, index: int) -> dict[str, Any]:
        """`codec.unpack` of record `index`."""
        return self._decoded(index, unpack)

    def stored(self, index: int, fields: Iterable[str] = schema.FIELDS) -> Any:
        """`codec.decode_stored` of record `index`."""
        return self._decoded(index, lambda data: decode_stored(data, fields))

    def __getitem__(self, index: int) -> Sample:
        return self._decoded(index, decode)

    def __iter__(self) -> Iterator[Sample]:
        return (self[i] for i in range(len(self)))

    def verify(self) -> None:
        """Compares the checksum of every shard; `RecordError` names the first damaged one."""
        for path, shard in zip(self._paths, self.shards, strict=True):
            _check_readable(path)
            if file_crc32(path) != shard.crc32:
                raise RecordError(
                    f"shard {path} is damaged: its checksum does not match; {_remedy(path)}"
                )


def doubts_of(splits: Mapping[str, RecordReader]) -> list[str]:
    """Probable mistakes in named splits (`data.doubts`), a line each.

    We read at most 4,096 evenly spaced records of each split, and the arrays of 32.
    """
    doubts = Doubts()
    for name, reader in splits.items():
        chosen = spread(len(reader), 4096)
        shown = set(spread(len(chosen), 32))
        for number, index in enumerate(chosen):
            record, sample = reader.unpacked(index), None
            if number in shown:
                stored = reader.stored(index, ("points", "mask", "depth", "occupancy"))
                depth = stored.depth and stored.depth.depth()
                sample = dataclasses.replace(stored, points=stored.points.points(), depth=depth)
            doubts.add(name, record, sample)
    return list(doubts.lines())


def spread(count: int, most: int) -> list[int]:
    """At most `most` evenly spaced indices of range(count)."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(int)).tolist()


def check_shard(path: pathlib.Path, shard: Shard) -> None:
    """Raises `RecordError` if a file is missing or is not this shard; reads only its ends."""
    _check_readable(path)
    if (size := path.stat().st_size) != shard.size:
        raise RecordError(
            f"shard {path} has {size} bytes, the manifest says {shard.size}; {_remedy(path)}"
        )
    if shard.ends not in (_ends(path), NOT_STATED):
        raise RecordError(
            f"shard {path} is not the one of the manifest: it is damaged, or another shard was "
            f"copied there; {_remedy(path)}"
        )


def _ends(path: pathlib.Path) -> int:
    """CRC-32 of the first 104 bytes and the last 64 KiB of a shard, which identify it.

    They contain the hash of the first record and the positions of all records.
    """
    with path.open("rb") as file:
        head = file.read(104)
        file.seek(-min(path.stat().st_size, 1 << 16), os.SEEK_END)
        return zlib.crc32(file.read(), zlib.crc32(head))


@contextlib.contextmanager
def _shard_errors(path: pathlib.Path, what: str) -> Iterator[None]:
    """Turns errors into `RecordError`: `what`, or that the file cannot be read."""
    try:
        yield
    except (RuntimeError, IndexError, OSError, ValueError) as error:
        _check_readable(path)
        raise RecordError(f"{what}: {brief(error)}; {_remedy(path)}") from error


def _remedy(path: pathlib.Path) -> str:
    return f"copy {path.name} from an undamaged copy of the data set, or write the set again"


def _check_readable(path: pathlib.Path) -> None:
    """Raises `RecordError` if a shard is missing or cannot be read, unlike a damaged shard."""
    try:
        if (kind := kind_of(path)) is not None:
            raise RecordError(f"shard {path} is {kind}, expected a file")
        with path.open("rb") as file:
            file.read(1)
    except FileNotFoundError:
        raise RecordError(f"shard {path} is missing; {_remedy(path)}") from None
    except OSError as error:
        too_many = error.errno in (errno.EMFILE, errno.ENFILE)
        remedy = "ulimit -n 10000 allows more" if too_many else "check its permissions and the disk"
        why = error.strerror or error
        raise RecordError(f"shard {path} cannot be read: {why}; {remedy}") from None

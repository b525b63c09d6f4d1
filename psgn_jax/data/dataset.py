"""Data sets on disk: shards of records with random access and checksums.

A data set is a folder with a `manifest.json` (`data.manifest`) and shards
`<split>-<number>.arrayrecord`. A shard is an ArrayRecord file with one record (`data.codec`) per
group. In data sets that can be extended, a tag follows the number in the file name.

Shards are written under a temporary name, fsynced and renamed. The data set is complete if the
field `complete` of its manifest is true; this is written last. ArrayRecord detects damaged blocks
by its own hashes and raises an exception (tested with several thousand damaged files: it never
aborted the process). The CRC-32 of a record also detects changes that happen outside the file,
between encoder and decoder.
"""

import contextlib
import errno
import os
import pathlib
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from array_record.python import array_record_module

from psgn_jax.data import schema
from psgn_jax.data.codec import DEFAULT_POINT_BITS, Stored, decode, decode_stored, encode
from psgn_jax.data.manifest import (
    MANIFEST,
    SPLIT_NAME,
    Manifest,
    Shard,
    load_manifest,
    save_manifest,
)
from psgn_jax.data.schema import RecordError, Sample
from psgn_jax.files import file_crc32, install, is_disk_full, remove_temporaries
from psgn_jax.untrusted import kind_of

# With one record per group, reading a record does not decode its neighbours. The records are
# compressed already.
_WRITER_OPTIONS = "group_size:1,uncompressed"
# Read-ahead only helps sequential reads, and costs memory.
_READER_OPTIONS = "readahead_buffer_size:0"


def shard_name(split: str, number: int, tag: str = "") -> str:
    """File name of a shard; within a split, names sort in the order of their numbers.

    Args:
      split: split of the records.
      number: number of the shard in the split.
      tag: suffix that distinguishes shards with the same number; "" = none.
    """
    if not SPLIT_NAME.fullmatch(split):
        raise ValueError(f"split {split!r}: expected lower-case letters, digits and _")
    return f"{split}-{number:05d}{tag and '-'}{tag}.arrayrecord"


class ShardWriter(contextlib.AbstractContextManager["ShardWriter"]):
    """Context that writes one shard; the file gets its name when the block ends without error.

    After the block, `shard` describes the file. If the file cannot be written, for instance because
    the disk is full, `write` or the end of the block raises `OSError`, and no file is left.
    """

    def __init__(
        self,
        folder: pathlib.Path,
        split: str,
        number: int,
        inputs: Iterable[str] = (),
        *,
        tag: str = "",
    ) -> None:
        self._path = folder / shard_name(split, number, tag)
        self._temporary = folder / f".{self._path.name}.{os.getpid()}.tmp"
        self._split, self.inputs = split, tuple(inputs)
        self._categories: dict[str, int] = {}
        self._fields: set[str] = set(schema.FIELDS)
        self._writer = array_record_module.ArrayRecordWriter(str(self._temporary), _WRITER_OPTIONS)
        self.count = 0
        self.shard: Shard | None = None

    def write(self, record: bytes, sample: Sample) -> None:
        """Appends `record`, the encoded form of `sample`."""
        with self._os_errors():
            self._writer.write(record)
        self.count += 1
        self._categories[sample.category] = self._categories.get(sample.category, 0) + 1
        self._fields -= {f for f in schema.OPTIONAL_FIELDS if getattr(sample, f) is None}

    @contextlib.contextmanager
    def _os_errors(self) -> Iterator[None]:
        """Turns ArrayRecord's errors into `OSError`."""
        try:
            yield
        except RuntimeError as error:
            number = errno.ENOSPC if is_disk_full(error) else errno.EIO
            raise OSError(number, os.strerror(number), str(self._path)) from error

    def __exit__(self, kind: Any, error: Any, trace: Any) -> None:
        """Closes the file and renames it to its name, or removes it after an error."""
        try:
            with self._os_errors():
                self._writer.close()
            if kind is None:
                install(self._temporary, self._path)
        except OSError:
            if kind is None:  # otherwise the first error is reported
                raise
        finally:
            self._temporary.unlink(missing_ok=True)
        if kind is not None:
            return
        self.shard = Shard(
            file=self._path.name,
            split=self._split,
            count=self.count,
            size=self._path.stat().st_size,
            crc32=file_crc32(self._path),
            categories=dict(sorted(self._categories.items())),
            fields=tuple(f for f in schema.FIELDS if f in self._fields),
            inputs=tuple(self.inputs),
        )


def write_dataset(
    folder: str | os.PathLike[str],
    splits: Mapping[str, Iterable[Sample]],
    *,
    source: str,
    records_per_shard: int = 512,
    point_bits: int = DEFAULT_POINT_BITS,
    overwrite: bool = False,
) -> Manifest:
    """Writes a data set; one sample is in memory at a time.

    Args:
      folder: folder for the data set; created if missing.
      splits: samples of each split.
      source: name of the source, for the manifest.
      records_per_shard: maximum number of records per file.
      point_bits: resolution of the lattice of the points, see `codec.lattice_of`.
      overwrite: whether to replace an existing data set.

    Raises:
      RecordError: a data set exists and `overwrite` is False.
    """
    folder = pathlib.Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    if (folder / MANIFEST).exists():
        if not overwrite:
            raise RecordError(
                f"data set {str(folder)!r} exists; give another folder, or overwrite=True"
            )
        (folder / MANIFEST).unlink()
    remove_temporaries(folder)
    shards: list[Shard] = []
    for split, samples in splits.items():
        iterator = iter(samples)
        sample = next(iterator, None)
        number = 0
        while sample is not None:
            with ShardWriter(folder, split, number) as writer:
                while sample is not None and writer.count < records_per_shard:
                    writer.write(encode(sample, point_bits=point_bits), sample)
                    sample = next(iterator, None)
            assert writer.shard is not None  # set at the end of the block
            shards.append(writer.shard)
            number += 1
    manifest = Manifest(source, True, tuple(shards))
    save_manifest(folder, manifest)
    return manifest


class RecordReader:
    """Random access to the records of one split; it can be pickled and shared between threads.

    The constructor checks that every shard exists and has the size stated in the manifest. Decoding
    a record checks its CRC-32; `read` does not.
    """

    def __init__(self, folder: str | os.PathLike[str], split: str) -> None:
        self.folder = pathlib.Path(folder)
        self.split = split
        self.manifest = load_manifest(folder)
        splits = self.manifest.splits()
        if split not in splits:
            raise RecordError(
                f"data set {str(self.folder)!r} has no split {split!r}; it has {sorted(splits)}"
            )
        self.shards = splits[split]
        for shard in self.shards:
            self._check_size(shard)
        self._ends = np.cumsum([s.count for s in self.shards])
        self._init_handles()

    def _init_handles(self) -> None:
        self._readers: dict[int, Any] = {}
        self._lock = threading.Lock()

    def __getstate__(self) -> dict[str, Any]:
        """The state without open files; the copy opens them again."""
        state = self.__dict__.copy()
        del state["_readers"], state["_lock"]
        return state

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restores the reader without open files."""
        self.__dict__.update(state)
        self._init_handles()

    def __len__(self) -> int:
        """Number of records."""
        return int(self._ends[-1]) if len(self._ends) else 0

    @property
    def num_distinct(self) -> int:
        """Number of different records, see `JoinedReader`."""
        return len(self)

    def original(self, index: int) -> int:
        """The number of the record, see `JoinedReader`."""
        return index

    def _remedy(self, shard: Shard) -> str:
        return f"copy {shard.file} from an undamaged copy of the data set, or write the set again"

    def _check_size(self, shard: Shard) -> None:
        path = self.folder / shard.file
        _check_readable(path, self._remedy(shard))
        if path.stat().st_size != shard.size:
            raise RecordError(
                f"shard {path} has {path.stat().st_size} bytes, the manifest says {shard.size}; "
                + self._remedy(shard)
            )

    def _reader(self, number: int) -> Any:
        with self._lock:
            if number not in self._readers:
                shard = self.shards[number]
                path = self.folder / shard.file
                try:
                    reader = array_record_module.ArrayRecordReader(str(path), _READER_OPTIONS)
                    count = reader.num_records()
                except (RuntimeError, OSError) as error:
                    _check_readable(path, self._remedy(shard))
                    raise RecordError(
                        f"shard {path} cannot be opened ({_first_line(error)}); "
                        + self._remedy(shard)
                    ) from error
                if count != shard.count:
                    raise RecordError(
                        f"shard {path} is damaged: it has {count} records, expected {shard.count}; "
                        + self._remedy(shard)
                    )
                self._readers[number] = reader
            return self._readers[number]

    def locate(self, index: int) -> tuple[pathlib.Path, int]:
        """The file of record `index` and its number within the file."""
        if not 0 <= index < len(self):
            raise IndexError(f"record {index}: expected 0 to {len(self) - 1}")
        number = int(np.searchsorted(self._ends, index, side="right"))
        start = int(self._ends[number]) - self.shards[number].count
        return self.folder / self.shards[number].file, index - start

    def read(self, index: int) -> bytes:
        """The bytes of one record.

        Raises:
          RecordError: the record cannot be read; the message names file and record.
          IndexError: `index` is not in [0, len).
        """
        path, position = self.locate(index)
        number = int(np.searchsorted(self._ends, index, side="right"))
        reader = self._reader(number)
        try:
            return reader.read([position])[0]
        except (RuntimeError, IndexError, OSError) as error:
            _check_readable(path, self._remedy(self.shards[number]))
            raise self._damaged(path, position, number, _first_line(error)) from error

    def _damaged(self, path: pathlib.Path, position: int, number: int, why: str) -> RecordError:
        return RecordError(
            f"record {position} of {path} is damaged: {why}; {self._remedy(self.shards[number])}"
        )

    def _decoded(self, index: int, decoder: Callable[[bytes], Any]) -> Any:
        data = self.read(index)
        try:
            return decoder(data)
        except ValueError as error:
            path, position = self.locate(index)
            number = int(np.searchsorted(self._ends, index, side="right"))
            raise self._damaged(path, position, number, _first_line(error)) from error

    def stored(self, index: int, fields: Iterable[str] = schema.FIELDS) -> Stored:
        """Record `index` with points and depth in their compact form; decodes only `fields`."""
        return self._decoded(index, lambda data: decode_stored(data, fields))

    def __getitem__(self, index: int) -> Sample:
        """Sample `index`.

        Raises:
          RecordError: the record is damaged; the message names file and record.
        """
        return self._decoded(index, decode)

    def __iter__(self) -> Iterator[Sample]:
        """All samples in order."""
        return (self[i] for i in range(len(self)))

    def verify(self) -> None:
        """Reads every shard and compares its checksum.

        Raises:
          RecordError: a shard is damaged or cannot be read; the message names the first one.
        """
        for shard in self.shards:
            path = self.folder / shard.file
            _check_readable(path, self._remedy(shard))
            if file_crc32(path) != shard.crc32:
                raise RecordError(
                    f"shard {path} is damaged: its checksum does not match; {self._remedy(shard)}"
                )


def read_shard(path: str | os.PathLike[str]) -> list[bytes]:
    """The bytes of all records of one file; no manifest is needed.

    Raises:
      RecordError: the file is missing or damaged.
    """
    _check_readable(pathlib.Path(path), "write the data set again")
    try:
        reader = array_record_module.ArrayRecordReader(str(path), _READER_OPTIONS)
        return list(reader.read(list(range(reader.num_records()))))
    except (RuntimeError, IndexError, OSError) as error:
        raise RecordError(f"shard {path} is damaged: {_first_line(error)}") from error


class JoinedReader:
    """The records of one split of several data sets, concatenated."""

    def __init__(self, readers: Sequence[RecordReader]) -> None:
        self._readers = tuple(readers)
        self._ends = np.cumsum([len(reader) for reader in readers])
        self.shards = tuple(shard for reader in readers for shard in reader.shards)
        self._folders = [reader.folder for reader in readers]

    def __len__(self) -> int:
        """Number of records."""
        return int(self._ends[-1])

    @property
    def num_distinct(self) -> int:
        """Number of records, where those of a folder that is listed repeatedly count once."""
        return sum({reader.folder: len(reader) for reader in self._readers}.values())

    def original(self, index: int) -> int:
        """The smallest number of the record `index`, whose folder may be listed repeatedly."""
        reader, own = self._of(index)
        return int(self._ends[self._folders.index(reader.folder)]) - len(reader) + own

    def _of(self, index: int) -> tuple[RecordReader, int]:
        if not 0 <= index < len(self):
            raise IndexError(f"record {index}: expected 0 to {len(self) - 1}")
        number = int(np.searchsorted(self._ends, index, side="right"))
        reader = self._readers[number]
        return reader, index - int(self._ends[number]) + len(reader)

    def locate(self, index: int) -> tuple[pathlib.Path, int]:
        """The file of record `index` and its number within the file."""
        reader, own = self._of(index)
        return reader.locate(own)

    def stored(self, index: int, fields: Iterable[str] = schema.FIELDS) -> Stored:
        """Record `index` with points and depth in their compact form; decodes only `fields`."""
        reader, own = self._of(index)
        return reader.stored(own, fields)

    def __getitem__(self, index: int) -> Sample:
        """Sample `index`; raises `RecordError` if the record is damaged."""
        reader, own = self._of(index)
        return reader[own]


def open_split(
    folders: Sequence[str | os.PathLike[str]], split: str
) -> RecordReader | JoinedReader:
    """Opens a split of one or more data sets; data sets without that split are skipped.

    Raises:
      RecordError: a folder has no complete data set, or none of them has the split.
      TypeError: `folders` is a single path instead of a list.
    """
    if isinstance(folders, str | os.PathLike):
        raise TypeError(f"folders: got {folders!r}, expected a list of folders")
    # A folder may be listed several times; it is opened once.
    alone = len(folders) == 1
    held = {f for f in dict.fromkeys(folders) if alone or split in load_manifest(f).splits()}
    having = [f for f in folders if f in held]
    if not having:
        names = [str(folder) for folder in folders]
        raise RecordError(f"none of the data sets {names} has a split {split!r}")
    opened = {folder: RecordReader(folder, split) for folder in dict.fromkeys(having)}
    readers = [opened[folder] for folder in having]
    return readers[0] if len(readers) == 1 else JoinedReader(readers)


def _check_readable(path: pathlib.Path, remedy: str) -> None:
    """Distinguishes a shard that is missing or cannot be read from a damaged one.

    Raises:
      RecordError: the shard is missing, is not a file, or cannot be read.
    """
    try:
        kind = kind_of(path)
        if kind is not None:
            raise RecordError(f"shard {path} is {kind}, expected a file")
        with path.open("rb") as file:
            file.read(1)
    except FileNotFoundError:
        raise RecordError(f"shard {path} is missing; {remedy}") from None
    except OSError as error:
        raise RecordError(
            f"shard {path} cannot be read: {error.strerror or error}; check its permissions "
            "and the disk"
        ) from None


def _first_line(error: BaseException) -> str:
    lines = str(error).splitlines()
    return lines[0][:200] if lines else type(error).__name__

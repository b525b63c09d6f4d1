"""Converts published data sets to records, shard by shard.

A file, a model or a view of a model that cannot be read is reported and left out; with `strict` it
stops the conversion. A conversion that is started again keeps the complete shards and continues
after them. Shards from which something was left out are converted again. If nothing was left out
and the source is the same, nothing changes.
"""

import contextlib
import functools
import pathlib
import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from absl import logging

from psgn_jax.data import schema
from psgn_jax.data.codec import encode
from psgn_jax.data.dataset import ShardWriter
from psgn_jax.data.manifest import (
    DUPLICATES,
    MANIFEST,
    Manifest,
    Shard,
    load_manifest,
    save_manifest,
)
from psgn_jax.data.schema import RecordError
from psgn_jax.data.sources import authors, duplicates, occnet, r2n2, shapenet
from psgn_jax.system.claims import claim
from psgn_jax.system.files import is_disk_full, remove_temporaries
from psgn_jax.system.untrusted import message_line, one_line

FILES_PER_SHARD = 8
MODELS_PER_SHARD = 64
LAYOUTS = {"r2n2": r2n2, "occnet": occnet}

_WORK = ".work"  # holds the lock of the process that converts

# What is read from an input: split, bytes and sample of a record, or a message for a damaged one.
ConvertedRecord = tuple[str, bytes, schema.Sample] | str


class Input(NamedTuple):
    """A file or a model that is converted as a whole; the tag identifies it and its version."""

    tag: str
    read: Callable[[], Iterator[ConvertedRecord]]


def _natural(path: pathlib.Path) -> tuple[int | str, ...]:
    """Sort key: 2.gz before 10.gz."""
    parts = re.split(r"(\d+)", path.name)
    return tuple(int(p) if p.isdigit() else p for p in parts)


def _state(path: pathlib.Path) -> str:
    """Size and modification time of a path, or "-" if it is missing."""
    try:
        status = path.stat()
    except OSError:
        return "-"
    return f"{status.st_size}.{status.st_mtime_ns}"


def convert_authors(
    source: str | pathlib.Path, destination: str | pathlib.Path
) -> tuple[Manifest, list[str]]:
    """Converts a folder of the authors' batches; one file is in memory at a time.

    Training samples whose shape is that of a validation or test object have the split
    `DUPLICATES`.

    Returns:
      The manifest, and a message for every file or sample that was left out.

    Raises:
      ValueError: `source` has no batch file, or none that can be read.
      RecordError: `destination` contains a data set from another source.
    """
    source, destination = pathlib.Path(source), pathlib.Path(destination)
    if not source.is_dir():
        raise ValueError(f"SRC {str(source)!r}: there is no such folder")
    paths = sorted((p for p in source.glob("*.gz") if p.is_file()), key=_natural)
    if not paths:
        raise ValueError(f"SRC {str(source)!r}: no *.gz file there")

    @functools.cache
    def held_out() -> duplicates.HeldOut:
        logging.info("reading the shapes of the validation and test objects")
        clouds = []
        for path in paths:
            with contextlib.suppress(ValueError, OSError):  # reported when the file is converted
                for entry in authors.read_batch(path):
                    if authors.split_of(path, entry.sample.model_id) != "train":
                        clouds.append(entry.sample.points)
        return duplicates.HeldOut(clouds)

    def read(path: pathlib.Path) -> Iterator[ConvertedRecord]:
        for entry in authors.read_batch(path):
            split = authors.split_of(path, entry.sample.model_id)
            if split == "train" and held_out().has(entry.sample.points):
                split = DUPLICATES
            yield split, entry.encode(), entry.sample

    # The splits of a file's samples depend on all files.
    files = zlib.crc32("".join(f"{p.name}:{_state(p)}" for p in paths).encode())
    inputs = [Input(f"{p.name}:{_state(p)}:{files:08x}", functools.partial(read, p)) for p in paths]
    return convert_inputs("authors", source, inputs, destination, FILES_PER_SHARD)


def convert_models(
    layout: str,
    source: str | pathlib.Path,
    destination: str | pathlib.Path,
    *,
    num_points: int = shapenet.NUM_POINTS,
    max_views: int = shapenet.NUM_VIEWS,
    strict: bool = False,
) -> tuple[Manifest, list[str]]:
    """Converts a folder tree of ShapeNet models; one model is in memory at a time.

    Args:
      layout: "r2n2" or "occnet"; the modules of these names describe the layouts.
      source: root of the tree.
      destination: folder for the data set; created if missing.
      num_points: maximum number of points per sample.
      max_views: maximum number of views per model; the first ones are used.
      strict: whether to stop at the first file, model or view that cannot be read.

    Returns:
      The manifest, and a message for everything that was left out.

    Raises:
      ValueError: `source` does not have the layout, or nothing in it can be read; with `strict`
        also if anything in it cannot be read.
      RecordError: `destination` contains a data set from another source.
    """
    source, destination = pathlib.Path(source), pathlib.Path(destination)
    reader: Any = LAYOUTS[layout]
    models, messages = reader.models(source)
    for message in messages:
        logging.error("%s", one_line(message))
    if strict and messages:
        raise ValueError(messages[0])

    def read(split: str, synset: str, name: str) -> Iterator[ConvertedRecord]:
        view_of = reader.open_model(source, synset, name, num_points)
        for view in range(min(max_views, shapenet.NUM_VIEWS)):
            try:
                sample = view_of(view)
                yield split, encode(sample), sample
            except (ValueError, OSError) as error:
                yield message_line(error)

    inputs = []
    for split, synset, name in models:
        states = (_state(p) for p in reader.input_files(source, synset, name))
        tag = f"{split}/{synset}/{name}:{num_points}:{max_views}:" + ":".join(states)
        inputs.append(Input(tag, functools.partial(read, split, synset, name)))
    manifest, refused = convert_inputs(
        layout, source, inputs, destination, MODELS_PER_SHARD, strict
    )
    return manifest, messages + refused


def convert_inputs(
    kind: str,
    source: pathlib.Path,
    inputs: Sequence[Input],
    destination: pathlib.Path,
    per_shard: int,
    strict: bool = False,
) -> tuple[Manifest, list[str]]:
    """Converts inputs in groups, each to at most one shard per split; resumes a stopped conversion.

    Raises:
      ValueError: nothing could be read, or with `strict` something could not be read.
      RecordError: `destination` contains a data set from another source.
      ClaimedError: another process converts to `destination`.
    """
    destination.mkdir(parents=True, exist_ok=True)
    with claim(destination / _WORK, (0, 1)):
        done = _finished(kind, destination)
        shards: list[Shard] = []
        refused: list[str] = []
        try:
            for number, start in enumerate(range(0, len(inputs), per_shard)):
                group = inputs[start : start + per_shard]
                tags = tuple(item.tag for item in group)
                if (number, tags) in done:
                    shards += done[number, tags]
                    continue
                made, messages = _convert_group(group, destination, number, strict)
                refused += messages
                shards += made
                save_manifest(destination, Manifest(kind, False, tuple(shards)))
                finished = min(start + per_shard, len(inputs))
                logging.info("converted %d of %d inputs", finished, len(inputs))
            if not shards:
                raise ValueError(
                    f"SRC {str(source)!r}: no file could be read; first message: "
                    f"{(refused or ['none'])[0]}"
                )
        except BaseException:
            if not list(destination.glob("*.arrayrecord")):
                (destination / MANIFEST).unlink()  # it lists no existing shard
            raise
        manifest = Manifest(kind, True, tuple(shards))
        save_manifest(destination, manifest)
        for left in destination.glob("*.arrayrecord"):
            if left.name not in {shard.file for shard in shards}:
                left.unlink()  # its inputs are gone, or are in another shard
        return manifest, refused


def _finished(
    kind: str, destination: pathlib.Path
) -> dict[tuple[int, tuple[str, ...]], list[Shard]]:
    """The finished shards of an earlier conversion, by their number and their inputs.

    Such a shard is kept if this conversion would give it the same inputs and the same number. The
    number is part of the file name: if it now belongs to a group with other inputs, that group will
    overwrite the file.
    """
    done: dict[tuple[int, tuple[str, ...]], list[Shard]] = {}
    if (destination / MANIFEST).exists():
        previous = load_manifest(destination, allow_incomplete=True)
        if previous.source != kind:
            raise RecordError(
                f"DST {str(destination)!r} contains a data set from {previous.source!r}; "
                "give another folder"
            )
        for shard in previous.shards:
            path = destination / shard.file
            if path.is_file() and path.stat().st_size == shard.size:
                number = int(path.stem.rpartition("-")[2])
                done.setdefault((number, shard.inputs), []).append(shard)
    elif any(p.suffix != ".tmp" and p.name != _WORK for p in destination.iterdir()):
        raise ValueError(
            f"DST {str(destination)!r}: not empty and not a data set; give an empty folder"
        )
    else:
        # The manifest is written before the first shard, so that after a kill the folder is
        # recognised as an unfinished conversion.
        save_manifest(destination, Manifest(kind, False, ()))
    remove_temporaries(destination)
    return done


def _convert_group(
    group: Sequence[Input], folder: pathlib.Path, number: int, strict: bool
) -> tuple[list[Shard], list[str]]:
    """Converts inputs to at most one shard per split; returns messages for what is left out."""
    writers: dict[str, ShardWriter] = {}
    refused: list[str] = []
    whole: list[str] = []

    def write(item: Input) -> Iterator[str]:
        """Writes the samples of an input; yields a message for each that is left out."""
        for result in item.read():
            if isinstance(result, str):
                yield result
                continue
            split, record, sample = result
            try:
                schema.check_content(sample)
            except ValueError as error:
                yield f"{sample.model_id}, view {sample.view}: {error}"
                continue
            if split not in writers:
                writers[split] = stack.enter_context(ShardWriter(folder, split, number))
            writers[split].write(record, sample)

    with contextlib.ExitStack() as stack:
        for item in group:
            messages: list[str] = []
            try:
                messages += write(item)
            except (ValueError, OSError) as error:
                if is_disk_full(error):
                    raise
                messages.append(message_line(error))
            for message in messages:
                logging.error("%s", one_line(message))
                if strict:
                    raise ValueError(message)
            refused += messages
            # The shards do not list an input of which something is missing, so that the group is
            # converted again next time.
            whole += [] if messages else [item.tag]
        for writer in writers.values():
            writer.inputs = tuple(whole)
    return [writers[split].shard for split in sorted(writers)], refused

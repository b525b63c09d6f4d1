"""Converts published data sets to records, shard by shard (`data.shards`).

`commands.convert` says what is left out and what a later call converts again.
"""

import contextlib
import functools
import pathlib
import zlib
from collections.abc import Callable, Generator, Iterator, Sequence
from typing import Any

from absl import logging

from psgn_jax.data import schema, shards
from psgn_jax.data.codec import encode
from psgn_jax.data.manifest import DUPLICATES, Manifest, load_manifest
from psgn_jax.data.shards import Job, Tag
from psgn_jax.data.sources import authors, duplicates, occnet, r2n2, shapenet
from psgn_jax.system.errors import is_disk_full
from psgn_jax.system.untrusted import message_line, one_line

FILES_PER_SHARD = 8
MODELS_PER_SHARD = 64
LAYOUTS = {"r2n2": r2n2, "occnet": occnet}
_INCOMPLETE = "incomplete"  # status of an input from which something was left out

ConvertedRecord = tuple[str, bytes, schema.Sample] | str
"""Split, bytes and sample of a record, or a message about what could not be read."""

Input = tuple[Tag, Callable[[], Iterator[ConvertedRecord]]]
"""A file or a model, and the function that reads it."""


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

    Training samples with the shape of a validation or test object have the split `DUPLICATES`.
    Result and errors as in `convert_models`.
    """
    source, destination = pathlib.Path(source), pathlib.Path(destination)
    if not source.is_dir():
        raise ValueError(f"SRC {str(source)!r}: there is no such folder")
    found = (path for path in source.glob("*.gz") if path.is_file())
    paths = sorted(found, key=lambda path: (len(path.name), path.name))  # 2.gz before 10.gz
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
    inputs = [
        (Tag(p.name, "", "", f"{_state(p)}:{files:08x}"), functools.partial(read, p)) for p in paths
    ]
    return convert("authors", source, inputs, destination, FILES_PER_SHARD)


def convert_models(
    layout: str,
    source: str | pathlib.Path,
    destination: str | pathlib.Path,
    *,
    num_points: int = shapenet.NUM_POINTS,
    views: int | None = None,
) -> tuple[Manifest, list[str]]:
    """Converts a folder tree of ShapeNet models; one model is in memory at a time.

    Args:
      layout: "r2n2" or "occnet"; the modules of these names describe the layouts.
      num_points: maximum number of points per sample.
      views: number of views of each model, the first ones; None = all.

    Returns:
      The manifest, and a message for each thing that was left out.

    Raises:
      ValueError: `source` does not have the layout or so many views, or nothing can be read.
      OtherSettingsError: `destination` has a data set from another source.
    """
    source, destination = pathlib.Path(source), pathlib.Path(destination)
    reader: Any = LAYOUTS[layout]
    if views is None:
        views = reader.NUM_VIEWS
    elif not 1 <= views <= reader.NUM_VIEWS:
        raise ValueError(f"views={views}: accepted: 1 to {reader.NUM_VIEWS}, the views of {layout}")
    models, messages = reader.models(source)
    for message in messages:
        logging.error("%s", one_line(message))

    def read(split: str, synset: str, name: str) -> Iterator[ConvertedRecord]:
        view_of = reader.open_model(source, synset, name, num_points)
        for view in range(views):
            try:
                sample = view_of(view)
                yield split, encode(sample), sample
            except (ValueError, OSError) as error:
                yield message_line(error)

    inputs = []
    for split, synset, name in models:
        states = [_state(p) for p in reader.input_files(source, synset, name)]
        version = f"{num_points}:{views}:" + ":".join(states)
        tag = Tag(f"{synset}/{name}", synset, split, version)
        inputs.append((tag, functools.partial(read, split, synset, name)))
    manifest, left_out = convert(layout, source, inputs, destination, MODELS_PER_SHARD)
    return manifest, messages + left_out


def convert(
    layout: str, source: pathlib.Path, inputs: Sequence[Input], target: pathlib.Path, per_shard: int
) -> tuple[Manifest, list[str]]:
    """Converts inputs or continues a conversion; result and errors as in `convert_models`."""

    def make(todo: Sequence[tuple[int, Any]]) -> Generator[shards.Result]:
        for number, read in todo:
            records: dict[str, list[bytes]] = {}
            tag, messages = inputs[number][0], []
            try:
                for result in read():
                    if isinstance(result, str):
                        messages.append(result)
                        continue
                    split, record, sample = result
                    try:
                        schema.check_content(sample)
                        records.setdefault(split, []).append(record)
                    except ValueError as error:
                        messages.append(f"{sample.model_id}, view {sample.view}: {error}")
            except (ValueError, OSError) as error:
                if is_disk_full(error):
                    raise
                messages.append(message_line(error))
            named = [m if tag.model_id in m else f"{tag.model_id}: {m}" for m in messages]
            line = {
                **tag._asdict(),
                "status": _INCOMPLETE if messages else "ok",
                "reason": "\n".join(named),
                "samples": sum(map(len, records.values())),
                "splits": {split: len(found) for split, found in records.items()},
            }
            yield shards.Result(number, line, records)

    def incomplete(line: shards.Line) -> bool:
        return bool(line["status"] == _INCOMPLETE)

    job = Job({"source": layout}, inputs, per_shard, converts=True, tries_again=incomplete)
    progress = shards.write(target, job, make)
    left_out = [
        text for line in progress.lines for text in line.get("reason", "").split("\n") if text
    ]
    if not progress.samples:
        first = (left_out or ["none"])[0]
        raise ValueError(f"SRC {str(source)!r}: no file could be read; first message: {first}")
    return load_manifest(target), left_out

"""Foreign data sets to records.

    python -m psgn_jax.data.convert authors SRC DST

`authors`: SRC is a folder of the authors' batch files (`*.gz`). A file that cannot be read is
reported and left out, and the command ends with exit code 1. Started again, the command goes on
behind the shards that are complete; a finished conversion is left as it is.
"""

import argparse
import pathlib
import re
import sys
from collections.abc import Sequence

from absl import logging

from psgn_jax.data import authors, records

FILES_PER_SHARD = 8


def _natural(path: pathlib.Path) -> tuple[int | str, ...]:
    """Sort key: 2.gz before 10.gz."""
    parts = re.split(r"(\d+)", path.name)
    return tuple(int(p) if p.isdigit() else p for p in parts)


def _input_tag(path: pathlib.Path) -> str:
    """Names an input and its state, so that a changed file is converted again."""
    status = path.stat()
    return f"{path.name}:{status.st_size}:{status.st_mtime_ns}"


def convert_authors(
    source: str | pathlib.Path, destination: str | pathlib.Path
) -> tuple[records.Manifest, list[str]]:
    """Converts a folder of the authors' batches; one file in memory at a time.

    Args:
      source: folder with `*.gz`.
      destination: folder of the data set, made where missing.

    Returns:
      the manifest, and a message for every file that was refused.

    Raises:
      ValueError: `source` holds no batch file, or no file of it can be read.
      RecordError: `destination` holds a data set from another source.
    """
    source, destination = pathlib.Path(source), pathlib.Path(destination)
    if not source.is_dir():
        raise ValueError(f"SRC {str(source)!r}: there is no such folder")
    paths = sorted((p for p in source.glob("*.gz") if p.is_file()), key=_natural)
    if not paths:
        raise ValueError(f"SRC {str(source)!r}: no *.gz file there")
    destination.mkdir(parents=True, exist_ok=True)
    # A finished shard is kept where its number and its inputs are what this run would give it: one
    # of another number could be overwritten by the group that now has that number.
    done: dict[tuple[int, tuple[str, ...]], list[records.Shard]] = {}
    if (destination / records.MANIFEST).exists():
        previous = records.load_manifest(destination, allow_incomplete=True)
        if previous.source != "authors":
            raise records.RecordError(
                f"DST {str(destination)!r} holds a data set from {previous.source!r}; "
                "give another folder"
            )
        for shard in previous.shards:
            path = destination / shard.file
            if path.is_file() and path.stat().st_size == shard.size:
                done.setdefault((_number(shard.file), shard.inputs), []).append(shard)
    elif any(not (p.name[0] == "." and p.suffix == ".tmp") for p in destination.iterdir()):
        raise ValueError(f"DST {str(destination)!r}: not empty and not a data set")
    for left in destination.glob(".*.tmp"):
        left.unlink()  # of a run that was killed

    shards: list[records.Shard] = []
    refused: list[str] = []
    for number, start in enumerate(range(0, len(paths), FILES_PER_SHARD)):
        group = paths[start : start + FILES_PER_SHARD]
        inputs = tuple(_input_tag(p) for p in group)
        if (number, inputs) in done:
            shards += done[number, inputs]
            continue
        made, messages = _convert_group(group, inputs, destination, number)
        refused += messages
        shards += made
        records.save_manifest(destination, records.Manifest("authors", False, tuple(shards)))
        logging.info("%d of %d files", min(start + FILES_PER_SHARD, len(paths)), len(paths))
    if not shards:
        raise ValueError(f"SRC {str(source)!r}: no file could be read; the first: {refused[0]}")
    manifest = records.Manifest("authors", True, tuple(shards))
    records.save_manifest(destination, manifest)
    for left in destination.glob("*.arrayrecord"):
        if left.name not in {shard.file for shard in shards}:
            left.unlink()  # of inputs that are no longer there
    return manifest, refused


def _number(file: str) -> int:
    """The number in a shard's file name."""
    return int(pathlib.PurePath(file).stem.rpartition("-")[2])


def _convert_group(
    group: Sequence[pathlib.Path], inputs: tuple[str, ...], folder: pathlib.Path, number: int
) -> tuple[list[records.Shard], list[str]]:
    """Converts some files to at most one shard of each split."""
    writers: dict[str, records.ShardWriter] = {}
    refused: list[str] = []
    read = dict(zip(group, inputs, strict=True))
    # Encoded records of one file at a time: a file is taken whole or not at all.
    for path in group:
        try:
            encoded = [(e.encode(), e.sample) for e in authors.read_batch(path)]
        except (ValueError, OSError) as error:
            logging.error("%s", error)
            refused.append(str(error))
            del read[path]
            continue
        for record, sample in encoded:
            split = authors.split_of(sample.model_id)
            if split not in writers:
                writers[split] = records.ShardWriter(folder, split, number)
            writers[split].write(record, sample)
    shards = []
    for split in sorted(writers):
        with writers[split] as writer:
            # A refused file is not among the inputs, so that the group is tried again next time.
            writer.inputs = tuple(read.values())
        assert writer.shard is not None  # set by the block's end
        shards.append(writer.shard)
    return shards, refused


def main(argv: Sequence[str] | None = None) -> int:
    """The command; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m psgn_jax.data.convert", description=(__doc__ or "").split("\n")[0]
    )
    commands = parser.add_subparsers(dest="layout", required=True)
    command = commands.add_parser("authors", help="the authors' published batches")
    command.add_argument("source", metavar="SRC", help="folder with the authors' *.gz files")
    command.add_argument("destination", metavar="DST", help="folder of the data set to be made")
    arguments = parser.parse_args(argv)
    logging.use_absl_handler()
    logging.set_verbosity(logging.INFO)
    try:
        manifest, refused = convert_authors(arguments.source, arguments.destination)
    except (ValueError, OSError) as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    for split, shards in manifest.splits().items():
        size, count = sum(s.size for s in shards), sum(s.count for s in shards)
        sys.stdout.write(f"{split}: {count} samples, {size / 1e6:.1f} MB\n")
    for message in refused:
        sys.stderr.write(f"left out: {message}\n")
    return 1 if refused else 0


if __name__ == "__main__":
    sys.exit(main())

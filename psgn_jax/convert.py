"""Converts published data sets to records.

    python -m psgn_jax.convert authors SRC DST
    python -m psgn_jax.convert r2n2 SRC DST [--views 24] [--points 16384] [--strict]
    python -m psgn_jax.convert occnet SRC DST [--views 24] [--points 16384] [--strict]

- `authors`: SRC is a folder with the authors' batch files (`*.gz`).
- `r2n2`: SRC contains `ShapeNetRendering` and `ShapeNetVox32` of 3D-R2N2.
- `occnet`: SRC is the folder `ShapeNet` of Occupancy Networks, with one folder per category.

A file, a model or a view of a model that cannot be read is reported and left out, and so is a
sample without an object (its mask or its volume is empty, or all its points are in one place). The
exit code is then 1. With `--strict` the command stops at the first such file, model or view. If the
command is started again, it keeps the complete shards and continues after them. Shards from which
something was left out are converted again. A complete conversion is not changed. If the disk is
full, the exit code is 5.
"""

import argparse
import sys
from collections.abc import Sequence

from absl import logging

from psgn_jax.command_line import exit_code_of
from psgn_jax.data.conversion import convert_authors, convert_models
from psgn_jax.data.sources import shapenet
from psgn_jax.files import check_folder
from psgn_jax.untrusted import message_line, one_line

LARGEST = {"views": 1000, "points": 1_000_000}
"""Largest values of the options."""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m psgn_jax.convert", description=(__doc__ or "").split("\n")[0]
    )
    commands = parser.add_subparsers(dest="layout", required=True)
    command = commands.add_parser("authors", help="the authors' published batches")
    command.add_argument("source", metavar="SRC", help="folder with the authors' *.gz files")
    command.add_argument("destination", metavar="DST", help="folder for the records")
    for layout, what in (
        ("r2n2", "folder with ShapeNetRendering and ShapeNetVox32"),
        ("occnet", "folder ShapeNet of Occupancy Networks"),
    ):
        command = commands.add_parser(layout, help=what)
        command.add_argument("source", metavar="SRC", help=what)
        command.add_argument("destination", metavar="DST", help="folder for the records")
        command.add_argument("--views", type=int, default=24, help="views per model, at most")
        command.add_argument(
            "--points", type=int, default=shapenet.NUM_POINTS, help="points per sample, at most"
        )
        command.add_argument("--strict", action="store_true", help="stop at the first bad file")
    arguments = parser.parse_args(argv)
    logging.use_absl_handler()
    logging.set_verbosity(logging.INFO)
    try:
        check_folder(arguments.destination, "DST")
        if arguments.layout == "authors":
            manifest, refused = convert_authors(arguments.source, arguments.destination)
        else:
            for name in ("views", "points"):
                if not 1 <= (value := getattr(arguments, name)) <= LARGEST[name]:
                    raise ValueError(f"--{name}={value}: expected 1 to {LARGEST[name]}")
            manifest, refused = convert_models(
                arguments.layout,
                arguments.source,
                arguments.destination,
                num_points=arguments.points,
                max_views=arguments.views,
                strict=arguments.strict,
            )
    except (ValueError, OSError) as error:
        sys.stderr.write(f"error: {message_line(error)}\n")
        return exit_code_of(error) or 2
    for split, shards in manifest.splits().items():
        size, count = sum(s.size for s in shards), sum(s.count for s in shards)
        sys.stdout.write(f"{split}: {count} samples, {size / 1e6:.1f} MB\n")
    for message in refused:
        sys.stderr.write(f"left out: {one_line(message)}\n")
    if refused:
        sys.stderr.write(f"{len(refused)} files, models or views were left out\n")
    return 1 if refused else 0


if __name__ == "__main__":
    sys.exit(main())

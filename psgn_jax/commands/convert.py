"""Converts published data sets to records.

    psgn convert authors SRC DST
    psgn convert r2n2 SRC DST [--views 24] [--points 16384] [--strict]
    psgn convert occnet SRC DST [--views 24] [--points 16384] [--strict]

- `authors`: SRC is a folder with the authors' batch files (`*.gz`). Files 48 and 49 are the split
  `test`, names that begin with `f` are `validation`. Training samples whose shape is that of a
  validation or test object, mirrored or not, are written to the split `duplicate`, on which nothing
  is trained.
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

from psgn_jax.data.conversion import LAYOUTS, convert_authors, convert_models
from psgn_jax.data.sources import shapenet
from psgn_jax.system.files import check_folder, exit_code_of
from psgn_jax.system.untrusted import message_line, one_line

LARGEST = {"views": shapenet.NUM_VIEWS, "points": 1_000_000}
"""Largest values of the options."""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="psgn convert", description=(__doc__ or "").split("\n")[0]
    )
    commands = parser.add_subparsers(dest="layout", required=True)
    command = commands.add_parser("authors", help="the authors' published batches")
    command.add_argument("source", metavar="SRC", help="folder with the authors' *.gz files")
    command.add_argument("destination", metavar="DST", help="folder for the records")
    for layout, reader in LAYOUTS.items():
        command = commands.add_parser(layout, help=reader.SOURCE)
        command.add_argument("source", metavar="SRC", help=reader.SOURCE)
        command.add_argument("destination", metavar="DST", help="folder for the records")
        command.add_argument(
            "--views", type=int, default=shapenet.NUM_VIEWS, help="views per model, at most"
        )
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

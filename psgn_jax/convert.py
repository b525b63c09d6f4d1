"""Foreign data sets to records.

    python -m psgn_jax.convert authors SRC DST
    python -m psgn_jax.convert r2n2 SRC DST [--views 24] [--points 16384] [--strict]
    python -m psgn_jax.convert occnet SRC DST [--views 24] [--points 16384] [--strict]

`authors`: SRC is a folder of the authors' batch files (`*.gz`). `r2n2`: SRC holds 3D-R2N2's
`ShapeNetRendering` and `ShapeNetVox32`. `occnet`: SRC is the `ShapeNet` folder of Occupancy
Networks, one folder for each category.

What cannot be read (a file, a model, one view of a model) is reported and left out, and the command
ends with exit code 1; under `--strict` it stops at the first. Started again, the command goes on
behind the shards that are complete, and converts those again that something was left out of; a
finished conversion is left as it is.
"""

import argparse
import sys
from collections.abc import Sequence

from absl import logging

from psgn_jax.data.conversion import convert_authors, convert_models
from psgn_jax.data.sources import shapenet


def main(argv: Sequence[str] | None = None) -> int:
    """The command; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m psgn_jax.convert", description=(__doc__ or "").split("\n")[0]
    )
    commands = parser.add_subparsers(dest="layout", required=True)
    command = commands.add_parser("authors", help="the authors' published batches")
    command.add_argument("source", metavar="SRC", help="folder with the authors' *.gz files")
    command.add_argument("destination", metavar="DST", help="folder of the data set to be made")
    for layout, what in (
        ("r2n2", "folder with ShapeNetRendering and ShapeNetVox32"),
        ("occnet", "folder ShapeNet of Occupancy Networks"),
    ):
        command = commands.add_parser(layout, help=what)
        command.add_argument("source", metavar="SRC", help=what)
        command.add_argument("destination", metavar="DST", help="folder of the data set")
        command.add_argument("--views", type=int, default=24, help="first so many of each model")
        command.add_argument("--points", type=int, default=shapenet.NUM_POINTS, help="of a sample")
        command.add_argument("--strict", action="store_true", help="stop at the first damage")
    arguments = parser.parse_args(argv)
    logging.use_absl_handler()
    logging.set_verbosity(logging.INFO)
    try:
        if arguments.layout == "authors":
            manifest, refused = convert_authors(arguments.source, arguments.destination)
        else:
            if min(arguments.views, arguments.points) < 1:
                raise ValueError("--views and --points: expected at least 1")
            manifest, refused = convert_models(
                arguments.layout,
                arguments.source,
                arguments.destination,
                num_points=arguments.points,
                max_views=arguments.views,
                strict=arguments.strict,
            )
    except (ValueError, OSError) as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    for split, shards in manifest.splits().items():
        size, count = sum(s.size for s in shards), sum(s.count for s in shards)
        sys.stdout.write(f"{split}: {count} samples, {size / 1e6:.1f} MB\n")
    for message in refused:
        sys.stderr.write(f"left out: {message}\n")
    if refused:
        sys.stderr.write(f"{len(refused)} things were left out\n")
    return 1 if refused else 0


if __name__ == "__main__":
    sys.exit(main())

"""Looks at a data set.

    python -m psgn_jax.inspect PATH [--sheet FILE.png] [--samples 12] [--check 256]

Prints splits, counts, fields, sizes and categories; checks shards' checksums, records, cameras and
depths; writes a contact sheet: a row per sample with its image, its cloud seen by the sample's
camera and its cloud from a second side. Exit code 1 if anything is damaged.
"""

import argparse
import pathlib
import sys
from collections.abc import Sequence

from psgn_jax.data.schema import RecordError
from psgn_jax.viewing.dataset import make_sheet, report


def main(argv: Sequence[str] | None = None) -> int:
    """The command; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m psgn_jax.inspect", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("path", metavar="PATH", help="folder of records")
    parser.add_argument("--sheet", default="", help="where to write the sheet (./<name>.png)")
    parser.add_argument("--samples", type=int, default=12, help="samples on the sheet")
    parser.add_argument("--check", type=int, default=256, help="samples checked in each split")
    arguments = parser.parse_args(argv)
    try:
        lines, whole = report(arguments.path, max(1, arguments.check))
        sys.stdout.write("\n".join(lines) + "\n")
    except (ValueError, OSError) as error:
        sys.stderr.write(f"error: {error}\n")
        return 2
    try:
        sheet = make_sheet(arguments.path, max(1, arguments.samples))
    except RecordError as error:
        sys.stderr.write(f"no contact sheet: {error}\n")
        return 1
    name = pathlib.Path(arguments.path).resolve().name
    target = pathlib.Path(arguments.sheet or f"{name}.png")
    try:
        sheet.save(target)
    except (OSError, ValueError) as error:
        sys.stderr.write(f"error: --sheet={target}: {error}\n")
        return 2
    sys.stdout.write(f"contact sheet: {target}\n")
    return 0 if whole else 1


if __name__ == "__main__":
    sys.exit(main())

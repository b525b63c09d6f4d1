"""Checks a data set and draws some of its samples.

    psgn inspect PATH [--sheet FILE.png] [--samples 12] [--check 256]

The command prints splits, counts, fields, sizes and categories. It verifies the checksums of all
shards, and checks the records, cameras and depths of some samples. It writes a contact sheet
with two samples per row. Each sample has three pictures: the image, the cloud seen by the sample's
camera, and the cloud from another direction. Exit codes: 0 the data set is intact; 1 something is
damaged; 2 another error.
"""

import argparse
import pathlib
import sys
from collections.abc import Sequence

from psgn_jax.data.schema import RecordError
from psgn_jax.system.untrusted import message_line, one_line
from psgn_jax.viewing import spheres
from psgn_jax.viewing.dataset import make_sheet, report


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="psgn inspect", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("path", metavar="PATH", help="folder of records")
    parser.add_argument("--sheet", default="", help="contact sheet (default: PATH/sheet.png)")
    parser.add_argument("--samples", type=int, default=12, help="samples on the sheet")
    parser.add_argument("--check", type=int, default=256, help="samples to check in each split")
    arguments = parser.parse_args(argv)
    target = pathlib.Path(arguments.sheet or pathlib.Path(arguments.path) / "sheet.png")
    try:
        spheres.check_picture(target, "--sheet")
        lines, whole = report(arguments.path, max(1, arguments.check))
        sys.stdout.write("".join(f"{one_line(line)}\n" for line in lines))
    except (ValueError, OSError) as error:
        sys.stderr.write(f"error: {message_line(error)}\n")
        return 2
    try:
        sheet = make_sheet(arguments.path, max(1, arguments.samples))
    except RecordError as error:
        sys.stderr.write(f"no contact sheet: {message_line(error)}\n")
        return 1
    try:
        spheres.write_picture(sheet, target)
    except (OSError, ValueError) as error:
        sys.stderr.write(f"error: --sheet={one_line(target)}: {message_line(error)}\n")
        return 2
    sys.stdout.write(f"contact sheet: {one_line(target)}\n")
    return 0 if whole else 1


if __name__ == "__main__":
    sys.exit(main())

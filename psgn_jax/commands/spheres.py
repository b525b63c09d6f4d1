"""Draws predictions as pictures or turntable films: `psgn spheres OUT/*.npz --out=sheet.png`."""

import argparse
import sys
from collections.abc import Sequence

from psgn_jax.system.untrusted import message_line, one_line
from psgn_jax.viewing import spheres


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(prog="psgn spheres", description=__doc__)
    parser.add_argument("predictions", nargs="+", metavar="NPZ", help="files of psgn predict")
    parser.add_argument("--out", required=True, help="PNG file to write")
    parser.add_argument("--columns", type=int, default=1)
    parser.add_argument("--turntable", help="GIF or MP4 of the first prediction, rotating")
    arguments = parser.parse_args(argv)
    try:
        if arguments.turntable:
            spheres.check_turntable(arguments.turntable)
        cases = spheres.cases_of_predictions(arguments.predictions)
        spheres.sheet(cases, columns=max(1, arguments.columns)).save(arguments.out)
        if arguments.turntable:
            spheres.turntable(*next(iter(cases[0].clouds.values())), arguments.turntable)
    except (OSError, ValueError) as error:
        sys.stderr.write(f"error: {message_line(error)}\n")
        return 2
    sys.stdout.write(f"{len(cases)} cases: {one_line(arguments.out)}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

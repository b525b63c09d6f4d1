"""Draws predictions as pictures or turntable films: `psgn spheres OUT/*.npz --out=sheet.png`.

The sheet shows the image and the first two clouds of each file, coloured by height. A single cloud
is shown twice, coloured by height and by branch.
"""

import argparse
import pathlib
import sys
from collections.abc import Sequence

from psgn_jax.system.untrusted import message_line, one_line
from psgn_jax.viewing import spheres
from psgn_jax.viewing.predictions import read_prediction


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="psgn spheres", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument("predictions", nargs="+", metavar="NPZ", help="files of psgn predict")
    parser.add_argument("--out", required=True, help="PNG file to write")
    parser.add_argument("--columns", type=int, default=1)
    parser.add_argument("--turntable", help="GIF or MP4 of the first prediction, rotating")
    arguments = parser.parse_args(argv)
    fields = ("points", "branch", "image", "intrinsics", "extrinsics")
    rows, first = [], None
    try:
        spheres.check_picture(arguments.out, "--out")
        if arguments.turntable:
            spheres.check_turntable(arguments.turntable)
        for path in arguments.predictions:
            arrays = read_prediction(path, fields)
            several = len(arrays["points"]) > 1
            titles = [f"sample {k}" for k in range(2)] if several else ["prediction"]
            clouds = spheres.by_height(dict(zip(titles, arrays["points"], strict=False)))
            first = first or clouds[titles[0]]
            if not several:
                colours = spheres.colours_by_branch(arrays["branch"])
                clouds["by branch"] = arrays["points"][0], colours
            rows.append((pathlib.Path(path).stem, spheres.panels(arrays, clouds, height=144)))
        sheet = spheres.sheet(rows, columns=max(1, arguments.columns))
        spheres.write_picture(sheet, arguments.out)
        if arguments.turntable and first:
            spheres.turntable(*first, arguments.turntable)
    except (OSError, ValueError) as error:
        sys.stderr.write(f"error: {message_line(error)}\n")
        return 2
    sys.stdout.write(f"{len(rows)} cases: {one_line(arguments.out)}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

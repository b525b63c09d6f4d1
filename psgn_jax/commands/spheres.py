"""Draws predictions as pictures or turntable films: `psgn spheres OUT/*.npz --out=sheet.png`.

The sheet shows the image and the first two clouds of each file, coloured by height. A single cloud
is shown twice, coloured by height and by branch.
"""

import pathlib
import sys
from collections.abc import Sequence

from psgn_jax.config.command_line import Flags
from psgn_jax.system.untrusted import one_line
from psgn_jax.viewing import spheres
from psgn_jax.viewing.predictions import read_prediction


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command; returns its exit code."""
    flags = Flags("psgn spheres NPZ... --out=FILE", __doc__)
    flags.string("out", None, "PNG file to write.")
    flags.integer("columns", 1, "Columns of the sheet.", lower_bound=1)
    flags.string("turntable", None, "GIF or MP4 of the first prediction, rotating.")
    return flags.run(_main, argv, wrong_input=(ValueError,))


def _main(flags: Flags) -> None:
    values = flags.values
    fields = ("points", "branch", "image", "intrinsics", "extrinsics")
    rows, first = [], None
    spheres.check_picture(values.out, "--out")
    if values.turntable:
        spheres.check_turntable(values.turntable)
    for path in flags.arguments:
        arrays = read_prediction(path, fields)
        several = len(arrays["points"]) > 1
        titles = [f"sample {k}" for k in range(2)] if several else ["prediction"]
        clouds = spheres.by_height(dict(zip(titles, arrays["points"], strict=False)))
        first = first or clouds[titles[0]]
        if not several:
            colours = spheres.colours_by_branch(arrays["branch"])
            clouds["by branch"] = arrays["points"][0], colours
        rows.append((pathlib.Path(path).stem, spheres.panels(arrays, clouds, height=144)))
    sheet = spheres.sheet(rows, columns=values.columns)
    spheres.write_picture(sheet, values.out)
    if values.turntable and first:
        spheres.turntable(*first, values.turntable)
    sys.stdout.write(f"{len(rows)} cases: {one_line(values.out)}\n")

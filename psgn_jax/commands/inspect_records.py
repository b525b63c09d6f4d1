"""Checks a data set and draws some of its samples.

    psgn inspect PATH [--sheet FILE.png] [--samples 12] [--check 256]

The command prints splits, counts, fields, sizes and categories. It verifies the checksums of all
shards, and checks the records, cameras and depths of some samples. A contact sheet shows the image
of each sample, the cloud seen by its camera, and the cloud from another direction. Exit codes: 0
the data set is intact; 1 something is damaged or doubtful; 2 another error.
"""

import pathlib
import sys
from collections.abc import Sequence

from psgn_jax.config.command_line import Flags
from psgn_jax.data.schema import RecordError
from psgn_jax.system.errors import Exit, is_disk_full
from psgn_jax.system.untrusted import message_line, one_line
from psgn_jax.viewing import spheres
from psgn_jax.viewing.inspection import make_sheet, report


def main(argv: Sequence[str] | None = None) -> int:
    flags = Flags("psgn inspect PATH", __doc__)
    flags.path("sheet", "", "Contact sheet; default: PATH/sheet.png.")
    flags.integer("samples", 12, "Samples on the sheet.", lower_bound=1)
    flags.integer("check", 256, "Samples to check in each split.", lower_bound=1)
    return flags.run(_main, argv, wrong_input=(ValueError,))


def _main(flags: Flags) -> int:
    values, (path,) = flags.values, flags.arguments
    target = pathlib.Path(values.sheet or pathlib.Path(path) / "sheet.png")
    spheres.check_picture(target, "--sheet")
    lines, whole = report(path, values.check)
    sys.stdout.write("".join(f"{one_line(line)}\n" for line in lines))
    try:
        sheet = make_sheet(path, values.samples)
    except RecordError as error:
        sys.stderr.write(f"no contact sheet: {message_line(error)}\n")
        return Exit.PARTLY
    try:
        spheres.write_picture(sheet, target)
    except OSError as error:
        if values.sheet or is_disk_full(error):
            raise
        why = f"{one_line(target.parent)}: {error.strerror}"
        sys.stderr.write(f"no contact sheet: {why}; give --sheet\n")
    else:
        sys.stdout.write(f"contact sheet: {one_line(target)}\n")
    return Exit.DONE if whole else Exit.PARTLY

"""Converts published data sets to records.

    psgn convert authors SRC DST
    psgn convert r2n2 SRC DST [--views N] [--points 16384]
    psgn convert occnet SRC DST [--views N] [--points 16384]

- `authors`: SRC is a folder with the authors' batch files (`*.gz`). Files 48 and 49 are the split
  `test`, samples whose names begin with `f` are `validation`. Training samples with the shape of a
  validation or test object, mirrored or not, go to the split `duplicate`, which no config uses.
- `r2n2`: SRC contains `ShapeNetRendering` and `ShapeNetVox32` of 3D-R2N2.
- `occnet`: SRC is the folder `ShapeNet` of Occupancy Networks, with one folder per category.

Files, models and views that cannot be read are reported and left out, and so are samples without an
object (an empty mask or volume, all points in one place). The exit code is then 1. The same command
continues a stopped conversion. It converts a shard again if something was left out of it, or if its
files have changed, and does not change a complete conversion. A DST with models that SRC lacks is
refused. If the disk is full, the exit code is 5.
"""

import sys
from collections.abc import Sequence

from psgn_jax.config.command_line import Flags
from psgn_jax.config.structured import ConfigError, suggestion
from psgn_jax.data.conversion import LAYOUTS, convert_authors, convert_models
from psgn_jax.data.sources import shapenet
from psgn_jax.system.errors import Exit
from psgn_jax.system.files import check_folder, local_path
from psgn_jax.system.untrusted import one_line


def main(argv: Sequence[str] | None = None) -> int:
    flags = Flags("psgn convert LAYOUT SRC DST", __doc__)
    flags.integer("views", None, "Views per model; by default all.")
    flags.integer("points", shapenet.NUM_POINTS, "Most points of a sample.", lower_bound=1,
                  upper_bound=1_000_000)  # fmt: skip
    return flags.run(_main, argv, wrong_input=(ValueError,))


def _main(flags: Flags) -> int:
    layout, source, destination = flags.arguments
    if layout not in (names := ["authors", *LAYOUTS]):
        hint = suggestion(layout, names)
        raise ConfigError(f"{layout}: no such layout; {hint}expected one of {', '.join(names)}")
    destination = local_path(destination, "DST")
    check_folder(destination, "DST")
    if layout == "authors":
        if given := flags.given("views", "points"):
            raise ConfigError(f"{given[0]}: not accepted by authors")
        manifest, refused = convert_authors(source, destination)
    else:
        options = {"num_points": flags.values.points, "views": flags.values.views}
        manifest, refused = convert_models(layout, source, destination, **options)
    for split, shards in manifest.splits().items():
        size, count = sum(s.size for s in shards), sum(s.count for s in shards)
        sys.stdout.write(f"{split}: {count} samples, {size / 1e6:.1f} MB\n")
    for message in refused:
        sys.stderr.write(f"left out: {one_line(message)}\n")
    if refused:
        sys.stderr.write(f"{len(refused)} files, models or views were left out\n")
    return Exit.PARTLY if refused else Exit.DONE

"""Draws predictions as pictures or turntable films: `psgn spheres OUT/*.npz --out=sheet.png`.

The sheet shows the image and the first clouds of each file from two sides. Points have their
colours in the photo, or are coloured by height if the photo shows none of them.
"""

import pathlib
import sys
from collections.abc import Sequence

import numpy as np

from psgn_jax.config.command_line import Flags
from psgn_jax.data import camera, framing
from psgn_jax.prediction.formats import read_prediction
from psgn_jax.system.untrusted import one_line
from psgn_jax.viewing import spheres, viewer


def main(argv: Sequence[str] | None = None) -> int:
    flags = Flags("psgn spheres NPZ... --out=FILE", __doc__)
    flags.path("out", None, "PNG file to write.")
    flags.integer("columns", 1, "Columns of the sheet.", lower_bound=1)
    flags.integer("clouds", 4, "Largest number of clouds of each file.", lower_bound=1)
    flags.path("turntable", None, "GIF of the first prediction, rotating.")
    flags.bool("branch", False, "Also show the first cloud coloured by branch.")
    flags.integer("height", 144, "Height of each picture in pixels; 480 is good for slides.",
                  lower_bound=48, upper_bound=2160)  # fmt: skip
    return flags.run(_main, argv, wrong_input=(ValueError,))


def _main(flags: Flags) -> None:
    values = flags.values
    rows, first = [], None
    spheres.check_picture(values.out, "--out")
    if values.turntable and not values.turntable.lower().endswith(".gif"):
        raise ValueError(f"--turntable={values.turntable}: accepted: a name that ends with .gif")
    for path in flags.arguments:
        arrays = read_prediction(path, (*viewer.FIELDS, "image"))
        points, by_photo = arrays["points"], arrays["seen"].any()
        paint = arrays["colours"] if by_photo else map(spheres.colours_by_height, points)
        count = min(values.clouds, len(points))
        titles = [f"cloud {k}" for k in range(count)] if len(points) > 1 else ["prediction"]
        clouds = dict(zip(titles, zip(points, paint, strict=True), strict=False))
        first = first or clouds[titles[0]]
        if values.branch:
            clouds["by branch"] = points[0], spheres.colours_by_branch(arrays["branch"])
        seen = _seen(arrays, values.height)
        rows.append((pathlib.Path(path).stem, spheres.panels(seen, clouds, height=values.height)))
    spheres.write_picture(spheres.sheet(rows, columns=values.columns), values.out)
    count = f"{len(rows)} case{'s' * (len(rows) > 1)}"
    sys.stdout.write(f"{count}: {one_line(values.out)}\n")
    if values.turntable and first:
        sys.stdout.flush()  # the film takes longer
        spheres.turntable(*first, values.turntable)
        sys.stdout.write(f"film: {one_line(values.turntable)}\n")


def _seen(arrays: dict[str, np.ndarray], height: int) -> dict[str, np.ndarray]:
    """The network's view of the photo, resampled to `height` rows, and its camera."""
    rows, columns = arrays["image"].shape[:2]
    size = height, max(1, min(round(columns * (height / rows)), 4 * height))
    to_view = np.diag([size[1] / columns, size[0] / rows, 1.0]) @ arrays["to_view"]
    everywhere = np.ones(arrays["photo"].shape[:2], np.bool_)
    image, _ = framing.move_image(arrays["photo"], everywhere, to_view, size)
    intrinsics = camera.scale_intrinsics(arrays["intrinsics"], (rows, columns), size)
    return {"image": image, "intrinsics": intrinsics, "extrinsics": arrays["extrinsics"]}

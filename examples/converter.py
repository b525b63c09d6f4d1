"""A converter of a data set laid out like ShapeNet: one picture and one file of points per model.

<synset>/<model>/points.txt   a line "x y z" for each point of the surface, +y up
<synset>/<model>/view.png     137x137, RGBA, azimuth 0, elevation 30, the largest distance
"""

import pathlib
import sys
from collections.abc import Callable

import numpy as np

from psgn_jax.data import schema
from psgn_jax.data.conversion import LAYOUTS
from psgn_jax.data.sources import shapenet

NUM_VIEWS = 1


def models(source: pathlib.Path) -> tuple[list[tuple[str, str, str]], list[str]]:
    """All models as (split, synset, name), and a message for everything that is no model."""
    paths = sorted(source.glob("*/*/points.txt"))
    return [("train", path.parts[-3], path.parts[-2]) for path in paths], []


def input_files(source: pathlib.Path, synset: str, name: str) -> list[pathlib.Path]:
    """The paths whose size and time show whether a model has changed."""
    return [source / synset / name / file for file in ("points.txt", "view.png")]


def open_model(
    source: pathlib.Path, synset: str, name: str, num_points: int
) -> Callable[[int], schema.Sample]:
    """Reads a model; the result reads the view of a number. Errors need not name the model."""
    cloud, picture = input_files(source, synset, name)
    world = np.loadtxt(cloud, ndmin=2)[:num_points] @ shapenet.TO_WORLD.T
    origin, unit = shapenet.object_frame(world, cloud)
    model = shapenet.ShapeNetModel("mine", synset, name, world, None, origin, unit)

    def read(view: int) -> schema.Sample:
        rgba = shapenet.read_image(picture, "PNG", "RGBA")
        mask = rgba[..., 3] > 127
        image = np.where(mask[..., None], rgba[..., :3], np.uint8(schema.BACKGROUND_GREY))
        eye = shapenet.orbit_camera(0, 30, shapenet.MAX_DISTANCE)
        return model.sample(view, eye, shapenet.intrinsics(), image, mask)

    return read


LAYOUTS["mine"] = sys.modules[__name__]

"""Models of plain solids, a camera, and settings of small renders."""

import pathlib

import numpy as np

from data_gen import cameras
from data_gen.catalogues import shapes
from data_gen.mesh import build_model
from psgn_jax.data import shards

SMALL = {
    "views": 1,
    "num_points": 600,
    "models_per_shard": 2,
    "camera": {"image_size": (48, 64)},
    "job": {"variant": "scalar", "workers": 1, "seconds_per_model": 60.0},
    # With few pixels and points, the distances between depth and points are larger.
    "checks": {"depth": 0.1, "inside": 0.9},
}


def model_of(solid, **kwargs):
    return build_model(solid.vertices, solid.faces, **kwargs)


def cube(size=1.0):
    return shapes.box(size, size, size)


def sphere(sides=32):
    return shapes.ball(2, 2, 2, sides)


def squares(*parts):
    """A model of squares that face +x, each of an x, half a side and a material."""
    shape = np.array([[0, -1, 0], [0, 1, 0], [0, 1, 2], [0, -1, 2]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)[faces]
    return build_model(
        np.concatenate([shape * half + [x, 0, 0] for x, half, _ in parts]),
        np.concatenate([faces + 4 * k for k in range(len(parts))]),
        uv=np.tile(uv, (len(parts), 1, 1)),
        materials=[material for _, _, material in parts],
        face_material=np.repeat(np.arange(len(parts)), 2),
    )


def view(azimuth=0.0, elevation=20.0, size=(48, 64), **changes):
    """The authors' camera, apart from what is given, for a small picture."""
    usual = {"distance": 3.6, "focal": 400.0, "roll": 0.0, "aim": 0.268}
    chosen = usual | changes
    return cameras.Camera(size, azimuth, elevation, **chosen)


def joined(*solids_):
    """Several solids as one, as arrays."""
    sizes = np.cumsum([0, *(len(p.vertices) for p in solids_)])
    return (
        np.concatenate([p.vertices for p in solids_]),
        np.concatenate([p.faces + n for p, n in zip(solids_, sizes[:-1], strict=True)]),
    )


def contents(folder):
    """The contents of all files except the report and `job.json`."""
    own = (shards.REPORT, shards.JOB)
    files = (p for p in pathlib.Path(folder).iterdir() if p.name not in own)
    return {p.name: p.read_bytes() for p in files}

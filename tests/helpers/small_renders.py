"""Settings of small renders, and what a finished data set holds."""

import pathlib

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


def contents(folder):
    """The contents of all files except the report and `job.json`."""
    own = (shards.REPORT, shards.JOB)
    files = (p for p in pathlib.Path(folder).iterdir() if p.name not in own)
    return {p.name: p.read_bytes() for p in files}

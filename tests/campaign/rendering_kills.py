"""Kills of renderings: the final bytes must be the same, and no temporary files may be left."""

import pathlib
import random

from campaign import kills
from campaign.forks import Forks
from campaign.frame import Finding

IMPORTS = ("absl.app", "ml_collections.config_flags", "trimesh", "data_gen.job", "data_gen.pool",
           "data_gen.cluster", "data_gen.catalogues.by_name", "data_gen.settings")  # fmt: skip


def contents(out: pathlib.Path) -> dict[str, bytes]:
    """The contents of all files, except those of the report, which contain times."""
    return {n: b"" if n == "models.jsonl" else c for n, c in kills.files_of(out).items()}


def part(rng: random.Random, deadline: float, folder: pathlib.Path) -> list[Finding]:
    """Kills a tiny job: three procedural models in three shards, with one rendering process."""
    words = ["data_gen/render.py", "--catalogue=procedural", "--source=chair=3", "--out={out}",
             "--config.views=1", "--config.job.workers=1", "--config.models_per_shard=1",
             "--config.num_points=500", "--config.job.variant=scalar", "--config.image.samples=1",
             "--config.camera.image_size=(24, 32)"]  # fmt: skip
    command = kills.Command("rendering", words, contents)
    with Forks(IMPORTS, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1") as forks:
        return kills.kill_all([kills.Killer(command, forks, folder / "own", rng)], deadline)

"""Kills of conversions: the final bytes must be the same, and no temporary files may be left."""

import pathlib
import random
import zlib

import numpy as np

from campaign import kills
from campaign.forks import Forks
from campaign.frame import Finding

FILES = 10  # two shards


def part(rng: random.Random, deadline: float, folder: pathlib.Path) -> list[Finding]:
    """Kills the conversion of batches of noise in the layout of the authors' files."""
    source = folder / "authors"
    source.mkdir()
    for number in range(FILES):
        (source / f"{number}.gz").write_bytes(_batch(number))
    words = ["-m", "psgn_jax.convert", "authors", str(source), "{out}"]
    command = kills.Command("conversion", words)
    imports = ("psgn_jax.data.conversion", "psgn_jax.command_line")
    with Forks(imports, OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1") as forks:
        return kills.kill_all([kills.Killer(command, forks, folder / "own", rng)], deadline)


def _batch(seed: int) -> bytes:
    """A file in the layout of the authors' batches, of noise."""
    rng = np.random.default_rng(seed)
    depth = np.zeros((32, 192, 256), np.uint16)
    depth[:, 60:120, 80:180] = rng.integers(1, 65535, (32, 1, 1))
    colour = np.full((32, 192, 256, 3), 191, np.uint8)
    colour[depth > 0] = (10, 20, 200)
    rotation = np.repeat(np.eye(3, dtype=np.float32)[None], 32, axis=0)
    points = rng.integers(0, 256, (32, 16384, 3), np.uint8)
    other = np.zeros((32, 1024, 4), np.uint16)
    names = "\n".join(f"{'fa'[i % 2]}{seed:03d}{i:028x}" for i in range(32)).replace("f", "a")
    arrays = (colour, depth, rotation, points, other)
    return zlib.compress(b"".join(a.tobytes() for a in arrays) + names.encode(), 1)

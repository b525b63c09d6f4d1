"""Kills of conversions and of renderings: the same bytes at the end, and nothing left over."""

import os
import pathlib
import random
import signal
import time
import zlib

import numpy as np

from campaign.frame import Finding, run, started

BATCHES = 3


def part(rng: random.Random, deadline: float, folder: pathlib.Path) -> list[Finding]:
    """Half of the time for each of the two."""
    middle = time.monotonic() + (deadline - time.monotonic()) / 2
    source = folder / "authors"
    source.mkdir()
    for number in range(BATCHES):
        (source / f"{number}.gz").write_bytes(_batch(number))
    convert = ["-m", "psgn_jax.convert", "authors", str(source), "{out}"]
    render = ["data_gen/render.py", "--catalogue=procedural", "--source=chair:0-2", "--out={out}",
              "--config.views=1", "--config.job.workers=1", "--config.models_per_shard=1",
              "--config.num_points=500"]  # fmt: skip
    return [
        _killed("conversion", convert, rng, middle, folder / "convert"),
        _killed("rendering", render, rng, deadline, folder / "render"),
    ]


def _killed(
    name: str, command: list[str], rng: random.Random, deadline: float, folder: pathlib.Path
) -> Finding:
    """Starts a command again and again after a SIGKILL at a random time, then once to its end."""
    folder.mkdir()
    finding = Finding(f"SIGKILL in {name}: same bytes, nothing left over")
    log = folder / "log"

    def filled(out: pathlib.Path) -> list[str]:
        return [word.format(out=out) for word in command]

    whole = run(filled(folder / "whole"), log)
    expected = _contents(folder / "whole")
    if whole.code or not expected:
        finding.add(f"exit code {whole.code}: {whole.text[-500:]}")
        return finding
    number = 0
    while not finding.tried or time.monotonic() < deadline:
        number += 1
        out = folder / str(number)
        kills = rng.randint(1, 4)
        for _ in range(kills):
            with started(filled(out), log) as process:
                time.sleep(rng.uniform(0, 1.1 * whole.seconds))
                process.send_signal(signal.SIGKILL)
        ended = run(filled(out), log)
        wrong = ""
        if ended.code:
            wrong = f"exit code {ended.code}: {ended.text[-500:]}"
        elif _contents(out) != expected:
            wrong = f"other files: {sorted(_contents(out))}, expected {sorted(expected)}"
        finding.add(wrong and f"{number}, {kills} kills: {wrong}")
    return finding


def _contents(folder: pathlib.Path) -> dict[str, bytes]:
    """The content of every file but the report, which holds times."""
    return {
        os.path.relpath(path, folder): b"" if path.name == "models.jsonl" else path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


def _batch(seed: int) -> bytes:
    """A file in the layout of the authors' batches, of noise."""
    rng = np.random.default_rng(seed)
    depth = np.zeros((32, 192, 256), np.uint16)
    depth[:, 60:120, 80:180] = rng.integers(1, 65535, (32, 60, 100))
    colour = np.full((32, 192, 256, 3), 191, np.uint8)
    colour[depth > 0] = (10, 20, 200)
    rotation = np.repeat(np.eye(3, dtype=np.float32)[None], 32, axis=0)
    points = rng.integers(0, 256, (32, 16384, 3), np.uint8)
    other = np.zeros((32, 1024, 4), np.uint16)
    names = "\n".join(f"{'fa'[i % 2]}{seed:03d}{i:028x}" for i in range(32)).replace("f", "a")
    arrays = (colour, depth, rotation, points, other)
    return zlib.compress(b"".join(a.tobytes() for a in arrays) + names.encode(), 1)

"""Decoded samples per second of the data loader.

    python tests/bench/loader.py [PATH] [--seconds 3] [--workers 2] [--step_samples 16]

PATH is a folder of records; without it, the default data set is used. For full and half-size
images, the command prints samples/s with threads, with worker processes and from the cache, and the
time of each step of loading one sample. Except for worker processes, it also prints the samples per
second of CPU time (the figure per core).
`--step_samples` is the number of samples that a training uses per second; the command then also
prints the loader's rate divided by this number.
"""

import argparse
import dataclasses
import itertools
import time

import numpy as np

from psgn_jax import default_data
from psgn_jax.config import DataConfig
from psgn_jax.data import augment, batches, loader, resize
from psgn_jax.data.codec import decode_stored, unpack
from psgn_jax.data.dataset import RecordReader

BATCH = 32


def rate(cfg, seconds):
    """Samples/s of wall time, and of the CPU time of this process."""
    batches = loader.train_batches(cfg, batch_size=BATCH, seed=0, start_step=0)
    warm = -(-loader.num_samples(cfg, cfg.train_split) // BATCH) + 8 if cfg.cache else 4
    for _ in itertools.islice(batches, warm):
        pass
    wall, cpu, count = time.perf_counter(), time.process_time(), 0
    while time.perf_counter() - wall < seconds:
        next(batches)
        count += BATCH
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    batches.close()
    return count / wall, count / cpu


def microseconds(function, count=40):
    """Best of 5 means."""
    best = np.inf
    for _ in range(5):
        start = time.perf_counter()
        for _ in range(count):
            function()
        best = min(best, (time.perf_counter() - start) / count)
    return 1e6 * best


def parts(cfg):
    """Time of each part of one sample, averaged over some samples."""
    reader = RecordReader(cfg.path, cfg.train_split)
    rng = np.random.default_rng(0)
    times = {}

    def add(name, function):
        times.setdefault(name, []).append(microseconds(function))

    for index in np.linspace(0, len(reader) - 1, 6).astype(int):
        index = int(index)
        data, stored = reader.read(index), reader.stored(index)
        chosen = batches._subset(rng, len(stored.points.codes), cfg.num_points)
        view = batches._view(batches.Items(cfg, reader)[index], rng, cfg.num_points)
        add("read", lambda i=index: reader.read(i))
        add("checksum and map", lambda d=data: unpack(d))
        for field in ("image", "mask", "points", "depth"):
            add(f"decode {field}", lambda d=data, f=field: decode_stored(d, (f,)))
        add("resize image", lambda s=stored: resize.resize_image(s.image, cfg.image_size))
        add("resize mask", lambda s=stored: resize.resize_mask(s.mask, cfg.image_size))
        add(
            "sample points",
            lambda s=stored: batches._subset(rng, len(s.points.codes), cfg.num_points),
        )
        add("points to the frame", lambda s=stored, c=chosen: s.points.points(c))
        add("flip", lambda v=view: augment.flip(v))
        add("stretch", lambda v=view: augment.stretch(v, 1.1))
        add("colour jitter", lambda v=view: augment.colour_jitter(v, rng, 0.2))
    return {name: float(np.mean(v)) for name, v in times.items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("path", nargs="?", default="")
    parser.add_argument("--seconds", type=float, default=3.0)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--step_samples", type=float, default=0.0)
    arguments = parser.parse_args()
    path = arguments.path or default_data.default_dataset()
    num_points = min(4096, len(RecordReader(path, "train")[0].points))
    for image_size in ((192, 256), (96, 128)):
        plain = DataConfig(path=path, image_size=image_size, num_points=num_points, cache_gb=0.0)
        augmented = dataclasses.replace(plain, flip=True, stretch=0.1, colour_jitter=0.2)
        print(f"images {image_size[0]}x{image_size[1]}, {num_points} points")
        cases = {
            "threads": plain,
            "threads, augmented": augmented,
            "threads, with depth": dataclasses.replace(plain, inputs=("rgb", "mask", "depth")),
            "cached": dataclasses.replace(plain, cache=True),
            "cached, augmented": dataclasses.replace(augmented, cache=True),
            f"{arguments.workers} processes": dataclasses.replace(
                plain, num_workers=arguments.workers
            ),
        }
        for name, cfg in cases.items():
            wall, cpu = rate(cfg, arguments.seconds)
            line = f"  {name:22s} {wall:7.0f} samples/s"
            if not cfg.num_workers:
                line += f" {cpu:7.0f} per core"
            if arguments.step_samples:
                line += f" {wall / arguments.step_samples:6.1f} times the step"
            print(line, flush=True)
        print("  one sample, microseconds:")
        for name, value in parts(plain).items():
            print(f"    {name:22s} {value:6.0f}")


if __name__ == "__main__":
    main()

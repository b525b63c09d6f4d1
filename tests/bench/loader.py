"""Decoded samples per second of the data loader.

    python tests/bench/loader.py [PATH] [--seconds 3]

PATH is a folder of records; without it, the default data set is used. For full and half-size
images, the command prints samples/s with threads and from the cache, and the samples per second of
CPU time (the figure per core).
"""

import argparse
import dataclasses
import itertools
import time

from psgn_jax.commands import default_data
from psgn_jax.config.data import DataConfig
from psgn_jax.data import loader
from psgn_jax.data.dataset import RecordReader

BATCH = 32


def rate(cfg, seconds):
    """Samples/s of wall time, and of the CPU time of this process."""
    batches = loader.train_batches(cfg, batch_size=BATCH, seed=0, start_step=0)
    warm = -(-loader.num_samples(cfg, cfg.train_split) // BATCH) + 8 if cfg.cache_gb else 4
    for _ in itertools.islice(batches, warm):
        pass
    wall, cpu, count = time.perf_counter(), time.process_time(), 0
    while time.perf_counter() - wall < seconds:
        next(batches)
        count += BATCH
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    batches.close()
    return count / wall, count / cpu


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("path", nargs="?", default="")
    parser.add_argument("--seconds", type=float, default=3.0)
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
            "cached": dataclasses.replace(plain, cache_gb=4.0),
            "cached, augmented": dataclasses.replace(augmented, cache_gb=4.0),
        }
        for name, cfg in cases.items():
            wall, cpu = rate(cfg, arguments.seconds)
            print(f"  {name:22s} {wall:7.0f} samples/s {cpu:7.0f} per core", flush=True)


if __name__ == "__main__":
    main()

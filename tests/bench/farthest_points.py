"""Times farthest point sampling, compared with loops in NumPy: 1,024 of 16,384 points.

    python tests/bench/farthest_points.py [--batch 32] [--rounds 3]

All methods are measured in alternation. `naive` is a simple loop, `tuned` is a loop with separate
coordinates and no allocation. Seconds are the CPU seconds of the process for the whole batch, which
other programs affect less than the wall clock. The NumPy loops are timed on `--loops` clouds and
extrapolated. This package uses several cores, so its wall-clock time is shorter than its CPU time.
"""

import argparse
import time

import jax
import numpy as np

from psgn_jax import losses


def naive(points, k):
    nearest_sq, index, i = np.full(len(points), np.inf, np.float32), np.empty(k, int), 0
    for t in range(k):
        index[t] = i
        nearest_sq = np.minimum(nearest_sq, ((points - points[i]) ** 2).sum(1))
        i = int(nearest_sq.argmax())
    return index


def tuned(points, k):
    x, y, z = np.ascontiguousarray(points.T)
    nearest_sq, index, i = np.full(len(points), np.inf, np.float32), np.empty(k, int), 0
    total, part = np.empty_like(x), np.empty_like(x)
    for t in range(k):
        index[t] = i
        np.subtract(x, x[i], out=total)
        np.multiply(total, total, out=total)
        for column in (y, z):
            np.subtract(column, column[i], out=part)
            np.multiply(part, part, out=part)
            np.add(total, part, out=total)
        np.minimum(nearest_sq, total, out=nearest_sq)
        i = int(nearest_sq.argmax())
    return index


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--batch", type=int, default=32)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--loops", type=int, default=1)
    arguments = parser.parse_args()
    clouds = np.random.default_rng(0).normal(size=(arguments.batch, 16384, 3)).astype(np.float32)
    ours = jax.jit(jax.vmap(lambda p: losses.farthest_point_indices(p, 1024)))
    pairs = jax.jit(
        lambda c: jax.lax.map(lambda p: losses.farthest_point_indices(p, 1024), c, batch_size=2)
    )
    rows = {
        "naive": (lambda: [naive(c, 1024) for c in clouds[: arguments.loops]], arguments.loops),
        "tuned": (lambda: [tuned(c, 1024) for c in clouds[: arguments.loops]], arguments.loops),
        "vmap": (lambda: np.asarray(ours(clouds)), arguments.batch),
        "lax.map 2": (lambda: np.asarray(pairs(clouds)), arguments.batch),
    }
    for name in ("vmap", "lax.map 2"):
        np.testing.assert_array_equal(rows[name][0]()[0], naive(clouds[0], 1024))
    best = {}
    for _ in range(arguments.rounds):
        for name, (call, count) in rows.items():
            cpu, wall = time.process_time(), time.perf_counter()
            call()
            cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
            old = best.get(name, (np.inf, np.inf))
            scale = arguments.batch / count
            best[name] = min(old[0], cpu * scale), min(old[1], wall * scale)
    for name, (cpu, wall) in best.items():
        ratios = ", ".join(f"{best[n][0] / cpu:.1f} x {n}" for n in ("naive", "tuned"))
        print(f"{name:9s} {cpu:8.3f} s cpu {wall:8.3f} s wall   {ratios}", flush=True)


if __name__ == "__main__":
    main()

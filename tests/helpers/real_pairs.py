"""Pairs of clouds, random or like those of a training, for tests and benchmarks of the losses."""

import functools
import itertools

import numpy as np

from psgn_jax.data.sources import authors

KINDS = ("near", "far", "init", "dup", "grid")


def clouds(rng, n, m, scale=1.0, offset=0.0):
    """Clouds of n and m points, normally distributed, float32; the second one is shifted."""
    a = rng.normal(size=(n, 3)) * scale + offset
    b = (rng.normal(size=(m, 3)) + 0.3) * scale + offset
    return a.astype(np.float32), b.astype(np.float32)


@functools.cache
def authors_clouds(folder, pairs):
    """Clouds [pairs, 16384, 3] from the authors' batches in a folder."""
    batches = map(authors.read_batch, sorted(folder.glob("*.gz")))
    entries = itertools.islice(itertools.chain.from_iterable(batches), pairs)
    return np.stack([entry.sample.points for entry in entries])


def pairs_of(whole, kind, n, m, rng):
    """Pairs of n and m points, float32, drawn from complete clouds [pairs, N, 3].

    near = two disjoint subsets of one cloud, far = clouds of two objects, init = all predictions
    within 1e-3 of the origin, dup = far with eight copies of every point on average, grid = far,
    rounded to a lattice of step 1/8, which gives ties.
    """
    orders = [rng.permutation(len(cloud)) for cloud in whole]
    a = np.stack([cloud[order[:n]] for cloud, order in zip(whole, orders, strict=True)])
    b = np.stack([cloud[order[-m:]] for cloud, order in zip(whole, orders, strict=True)])
    if kind != "near":
        a = np.roll(a, 1, axis=0)
    if kind == "init":
        a = rng.normal(0, 3e-4, a.shape)
    if kind == "dup":
        a, b = (x[:, rng.integers(0, max(x.shape[1] // 8, 1), x.shape[1])] for x in (a, b))
    if kind == "grid":
        a, b = np.round(a * 8) / 8, np.round(b * 8) / 8
    return a.astype(np.float32), b.astype(np.float32)

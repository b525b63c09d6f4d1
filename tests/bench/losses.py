"""Times the earth mover's distance against SciPy's exact solver, and states its errors.

    python tests/bench/losses.py [--data ../shared/psgn_batches] [--pairs 32] [--sizes 1024 ..]
        [--tolerances .01 ..] [--kinds near far init dup grid]

All rows use the same clouds of the authors' batches; `helpers/real_pairs.py` has the kinds. Times
are the CPU seconds of the process (the least of several calls), which other programs on the machine
affect less than the wall clock. SciPy's `linear_sum_assignment` gets the matrices of costs. Its
time grows like n^3, so larger sizes have fewer pairs. Errors are (sum of distances) / optimum - 1.
Memory is what XLA reserves in addition to arguments and results.
"""

import argparse
import functools
import itertools
import pathlib
import sys
import time

import jax
import jax.numpy as jnp
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))

from helpers.real_pairs import KINDS, authors_clouds, pairs_of

from psgn_jax import losses


def seconds(call):
    """Least time of a call; it is called at least twice, then until two seconds are over."""
    clock = time.process_time if jax.default_backend() == "cpu" else time.perf_counter
    jax.block_until_ready(call())
    times, begin = [], time.perf_counter()
    while len(times) < 2 or (time.perf_counter() - begin < 2 and len(times) < 30):
        start = clock()
        jax.block_until_ready(call())
        times.append(clock() - start)
    return min(times)


def measured(loss, a, b):
    """Seconds of the losses of a batch, of losses and gradients, and the extra MB of the latter."""
    a, b, batch = jnp.asarray(a), jnp.asarray(b), losses.map_pairs(loss)
    functions = batch, jax.value_and_grad(lambda a, b: batch(a, b).sum())
    programs = [jax.jit(function).lower(a, b).compile() for function in functions]
    times = [seconds(functools.partial(program, a, b)) for program in programs]
    return *times, programs[1].memory_analysis().temp_size_in_bytes / 1e6


def optimum(a, b):
    """The least sums of distances, and SciPy's seconds for a pair."""
    from scipy.optimize import linear_sum_assignment
    from scipy.spatial.distance import cdist

    matrices = [cdist(x, y) for x, y in zip(a.astype("f8"), b.astype("f8"), strict=True)]
    start = time.process_time()
    matches = [linear_sum_assignment(d) for d in matrices]
    spent = (time.process_time() - start) / len(a)
    return np.array([d[m].sum() for d, m in zip(matrices, matches, strict=True)]), spent


def rows(args, whole):
    yield (
        "n", "kind", "tolerance", "ms/pair", "with gradient", "pairs/s", "SciPy / ours",
        "mean error", "largest error", "largest gap", "bids per point", "extra MB",
    )  # fmt: skip
    for n, kind in itertools.product(args.sizes, args.kinds):
        pairs = max(4, args.pairs * 1024**2 // max(n, 1024) ** 2)
        a, b = (x[:pairs] for x in pairs_of(whole, kind, n, n, np.random.default_rng(0)))
        best, exact = optimum(a, b)
        for tolerance in args.tolerances:
            options = {"tolerance": tolerance}
            *times, memory = measured(functools.partial(losses.emd_sum, **options), a, b)
            one, both = (1e3 * spent / pairs for spent in times)
            found = losses.map_pairs(functools.partial(losses.assign, **options))(a, b)
            matched = np.take_along_axis(b.astype("f8"), found.index[..., None], axis=1)
            error = np.linalg.norm(a.astype("f8") - matched, axis=2).sum(axis=1) / best - 1
            percent = (f"{x:.2%}" for x in (error.mean(), error.max(), found.gap.max()))
            speed = f"{one:.2f}", f"{both:.2f}", f"{1e3 / one:.1f}", f"{1e3 * exact / one:.1f}"
            bids = f"{found.iterations.mean() / n:.1f}"
            yield n, kind, tolerance, *speed, *percent, bids, f"{memory:.1f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = pathlib.Path(__file__).resolve().parents[3] / "shared" / "psgn_batches"
    parser.add_argument("--data", type=pathlib.Path, default=default)
    parser.add_argument("--pairs", type=int, default=32)
    parser.add_argument("--sizes", nargs="+", type=int, default=[1024, 2048, 4096])
    parser.add_argument("--tolerances", nargs="+", type=float, default=[0.01, 0.03, 0.1])
    parser.add_argument("--kinds", nargs="+", default=KINDS, choices=KINDS)
    args = parser.parse_args()
    print(f"{jax.devices()[0].device_kind}, jax {jax.__version__}, {args.pairs} pairs, float32")
    whole = authors_clouds(args.data, args.pairs)
    for number, cells in enumerate(rows(args, whole)):
        print("| " + " | ".join(map(str, cells)) + " |", flush=True)
        if not number:
            print("|" + "---|" * len(cells))


if __name__ == "__main__":
    main()

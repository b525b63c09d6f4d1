"""Times the Chamfer and the earth mover's distance, and other implementations of them.

    python tests/bench/losses.py [--data ../shared/psgn_batches] [--pairs 32]
        [--only cd emd tolerances] [--sizes 1024x1024 ..] [--emd_sizes 1024 ..] [--emd_pairs 4]
        [--kinds near far init dup grid]

All rows use the same clouds in the same run. `cKDTree` is SciPy's, both directions, forward only,
with one thread; every time is also given relative to it. Seconds are the CPU seconds of the process
(the least of several calls), which other programs on the machine affect less than the wall clock.
Memory is what XLA reserves in addition to arguments and results; for torch, the size of its
matrices, marked with ~.

Kinds: near = two disjoint subsets of one cloud, far = clouds of two objects, init = all predictions
within 1e-3 of the origin, dup = far with eight copies of every point on average, grid = far,
rounded to a lattice of step 1/8, which gives ties.

In the table of the EMD, the optimum is that of SciPy's `linear_sum_assignment`. Its time and those
of POT and lapx do not include the cost matrices. Errors are (sum of distances) / optimum - 1; for
Sinkhorn, the sum is the cost of its transport plan. Libraries that are not installed are left out.
SciPy and this package are measured on all pairs; the others, which are slow, on only the first
`--emd_pairs`. The table of tolerances has the time of this package's auction on one core.
"""

import argparse
import functools
import importlib.util
import itertools
import pathlib
import time
import zlib

import jax
import jax.numpy as jnp
import numpy as np

from psgn_jax import losses


def real_clouds(folder, pairs):
    """The authors' clouds, whole [pairs, 16384, 3]."""
    start, whole = 32 * 192 * 256 * (3 + 2) + 32 * 9 * 4, []  # of the points in a batch file
    for path in sorted(pathlib.Path(folder).glob("*.gz")):
        raw = zlib.decompress(path.read_bytes())
        points = np.frombuffer(raw, np.uint8, 32 * 16384 * 3, start).reshape(32, 16384, 3)
        whole.extend(((points / 255.0 - [0.7, 0.5, 0.5]) / 0.4).astype(np.float32))
        if len(whole) >= pairs:
            break
    return np.stack(whole[:pairs])


def default_clouds(pairs):
    """Clouds of the default data set, used if those of the authors are missing."""
    from psgn_jax.commands import default_data
    from psgn_jax.data.dataset import RecordReader

    reader = RecordReader(default_data.default_dataset(), "train")
    return np.stack([reader[i].points for i in range(min(pairs, len(reader)))])


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


def ckdtree(a, b):
    from scipy.spatial import cKDTree

    def directed(x, y):
        return np.square(cKDTree(y).query(x)[0]).mean()

    return np.array([directed(x, y) + directed(y, x) for x, y in zip(a, b, strict=True)])


def naive(pred, gt):
    d = jnp.square(pred[:, None] - gt[None]).sum(-1)
    return d.min(1).mean() + d.min(0).mean()


def measured(forward, total, a, b):
    """Result, seconds forward, seconds forward and backward, and extra MB of these two."""
    a, b = jnp.asarray(a), jnp.asarray(b)
    functions = forward, jax.value_and_grad(lambda a, b: total(a, b).sum())
    programs = [jax.jit(function).lower(a, b).compile() for function in functions]
    one, two = (seconds(functools.partial(program, a, b)) for program in programs)
    memory = [program.memory_analysis().temp_size_in_bytes / 1e6 for program in programs]
    return jax.device_get(programs[0](a, b)), one, two, memory


def cd_jax(batch, a, b):
    """Seconds forward, seconds forward and backward, values, memory in MB."""
    value, one, two, memory = measured(batch, batch, a, b)
    return one, two, value.astype(np.float64), ", ".join(f"{m:.1f}" for m in memory)


def cd_torch(a, b):
    """Like `cd_jax`, with `torch.cdist` on a CPU."""
    import torch

    torch.set_num_threads(1)  # like the others; PyTorch's threads use CPU time while they wait
    a, b = torch.tensor(a, requires_grad=True), torch.tensor(b)

    def forward():
        d = torch.cdist(a, b)
        return d.amin(2).square().mean(1) + d.amin(1).square().mean(1)

    def both():
        a.grad = None
        forward().sum().backward()

    with torch.no_grad():
        value, one = forward().numpy(), seconds(lambda: forward() is None)
    needs = len(a) * a.shape[1] * b.shape[1] * 4 / 1e6
    return one, seconds(both), value, f"~{needs:.1f}, {2 * needs:.1f}"


def make_pairs(whole, pairs, n, m, kind, rng):
    """Pairs of n and m points; see the top of the file."""
    a, b = [], []
    for cloud in whole:
        order = rng.permutation(len(cloud))
        a.append(cloud[order[:n]])
        b.append(cloud[order[-m:]])
    a, b = np.stack(a), np.stack(b)
    if kind != "near":
        a = np.roll(a, 1, axis=0)
    a, b = a[:pairs], b[:pairs]
    if kind == "init":
        a = rng.normal(0, 3e-4, a.shape)
    if kind == "dup":
        a, b = (x[:, rng.integers(0, max(x.shape[1] // 8, 1), x.shape[1])] for x in (a, b))
    if kind == "grid":
        a, b = np.round(a * 8) / 8, np.round(b * 8) / 8
    return a.astype(np.float32), b.astype(np.float32)


def clocked(call, arguments):
    """Results for all arguments, CPU seconds (scipy, POT and lapx use one thread)."""
    start = time.process_time()
    results = [jax.device_get(call(*x)) for x in arguments]
    return results, time.process_time() - start


def emd_ours(batch, a, b):
    """(forward s, forward+backward s, sums, gaps, bids, extra MB) of `map_pairs`."""
    of_pairs = batch(losses.matched_distances), batch(losses.emd_sum)
    found, one, two, memory = measured(*of_pairs, a, b)
    index = found.assignment.index
    assert all(len(set(i)) == len(i) for i in index)
    sums = [
        np.linalg.norm(x.astype(np.float64) - y.astype(np.float64)[i], axis=1).sum()
        for x, y, i in zip(a, b, index, strict=True)
    ]
    bids, gaps = found.assignment.iterations, found.assignment.gap
    return one, two, np.array(sums), gaps, bids, max(memory)


def emd_sinkhorn(a, b, relative):
    """ott's Sinkhorn, epsilon relative to the mean cost: sums of costs, iterations, seconds."""
    from ott.geometry import costs, pointcloud
    from ott.solvers import linear

    @jax.jit
    def one(x, y):
        geometry = pointcloud.PointCloud(
            x, y, cost_fn=costs.Euclidean(), epsilon=relative, relative_epsilon="mean"
        )
        out = linear.solve(geometry, threshold=1e-3, max_iterations=2000)
        return (out.matrix * geometry.cost_matrix).sum() * len(x), out.n_iters

    call = one.lower(a[0], b[0]).compile()
    found, spent = clocked(call, zip(a, b, strict=True))
    return np.array([x for x, _ in found]), np.array([x for _, x in found]), spent


def pot(d):
    import ot

    weights = np.full(len(d), 1 / len(d))
    return ot.emd2(weights, weights, d, numItermax=10**7) * len(d)


def lapx(d):
    import lap

    return lap.lapjv(d)[0]


EXACT = {"ot": ("POT emd2", pot), "lap": ("lapx lapjv", lapx)}
"""Package -> name, and function from a matrix of costs to the least sum."""


def installed(package):
    return importlib.util.find_spec(package) is not None


def print_row(*cells):
    print("| " + " | ".join(map(str, cells)) + " |", flush=True)


def print_head(*cells):
    print()
    print_row(*cells)
    print("|" + "---|" * len(cells))


def cd_table(args, whole):
    print_head(
        "size", "kind", "version", "fwd s", "fwd+bwd s", "fwd / tree", "fwd+bwd / tree",
        "extra MB fwd, fwd+bwd", "mean error", "max error",
    )  # fmt: skip
    measures = {
        "map": functools.partial(cd_jax, losses.map_pairs(losses.chamfer_sq_mean, platform="cpu")),
        "naive": functools.partial(cd_jax, jax.vmap(naive)),
    }
    if installed("torch"):
        measures["torch"] = cd_torch
    for size, kind in itertools.product(args.sizes, args.kinds):
        n, m = (int(x) for x in size.split("x"))
        a, b = make_pairs(whole, len(whole), n, m, kind, np.random.default_rng(0))
        truth = ckdtree(a, b)
        tree = seconds(lambda a=a, b=b: ckdtree(a, b) is None)
        print_row(size, kind, "cKDTree", f"{tree:.3f}", "", 1, "", "", "", "")
        for name, measure in measures.items():
            one, both, value, memory = measure(a, b)
            error = np.abs(value / truth - 1)
            print_row(
                size, kind, name, f"{one:.3f}", f"{both:.3f}", f"{one / tree:.2f}",
                f"{both / tree:.2f}", memory, f"{error.mean():.0e}", f"{error.max():.0e}",
            )  # fmt: skip


def emd_table(args, whole):
    from scipy.optimize import linear_sum_assignment
    from scipy.spatial.distance import cdist

    print_head(
        "n", "kind", "version", "fwd ms/pair", "fwd+bwd ms/pair", "scipy / fwd", "mean error",
        "max error", "max stated gap", "iterations per point (max)", "extra MB",
    )  # fmt: skip
    for n, kind in itertools.product(args.emd_sizes, args.kinds):
        # The time of the exact solution grows like n^3, so larger sizes have fewer pairs.
        pairs = max(min(args.emd_pairs, len(whole)), len(whole) * 1024**2 // max(n, 1024) ** 2)
        a, b = make_pairs(whole, pairs, n, n, kind, np.random.default_rng(0))
        k = min(args.emd_pairs, pairs)
        matrices = [(cdist(x, y),) for x, y in zip(a.astype("f8"), b.astype("f8"), strict=True)]
        matches, spent = clocked(linear_sum_assignment, matrices)
        base = spent / pairs
        best = np.array([d[match].sum() for (d,), match in zip(matrices, matches, strict=True)])
        del matrices[k:]

        rows = [("scipy", base, best, {})]
        batch = functools.partial(losses.map_pairs, platform="cpu")
        one, both, sums, gap, bids, memory = emd_ours(batch, a, b)
        more = {
            "both": f"{1e3 * both / pairs:.2f}", "gap": f"{gap.max():.2%}",
            "iterations": f"{bids.mean() / n:.1f} ({bids.max() / n:.1f})",
            "memory": f"{memory:.1f}",
        }  # fmt: skip
        rows.append(("ours, map", one / pairs, sums, more))
        for package, (name, solve) in EXACT.items():
            if installed(package):
                solve(matrices[0][0])  # compiles, or imports
                sums, spent = clocked(solve, matrices)
                rows.append((name, spent / k, sums, {}))
        for relative in (0.02, 0.005) if installed("ott") else ():
            sums, rounds, spent = emd_sinkhorn(a[:k], b[:k], relative)
            # One iteration is a pass over the n rows of the matrix: one row per point.
            more = {"iterations": f"{rounds.mean():.1f} ({rounds.max():.1f})"}
            rows.append((f"ott Sinkhorn {relative:g}", spent / k, sums, more))
        for name, one, sums, more in rows:
            error = np.asarray(sums) / best[: len(sums)] - 1
            errors = f"{error.mean():.2%}", f"{error.max():.2%}"
            rest = (more.get(key, "") for key in ("gap", "iterations", "memory"))
            print_row(n, kind, name, f"{one * 1e3:.2f}", more.get("both", ""), f"{base / one:.2f}",
                      *errors, *rest)  # fmt: skip


def tolerances_table(args, whole):
    """The EMD of one core, pair by pair."""
    print_head("n", "kind", "tolerance", "CPU ms/pair", "pairs/s", "largest gap")
    for n, kind in itertools.product(args.emd_sizes, args.kinds):
        pairs = max(args.emd_pairs, args.pairs * 1024**2 // max(n, 1024) ** 2)
        a, b = make_pairs(whole, pairs, n, n, kind, np.random.default_rng(0))
        for tolerance in (0.01, 0.03, 0.1):
            call = functools.partial(losses.assign, tolerance=tolerance)
            jax.block_until_ready(call(a[0], b[0]))
            found, spent = clocked(call, zip(a, b, strict=True))
            print_row(n, kind, tolerance, f"{1e3 * spent / pairs:.1f}", f"{pairs / spent:.1f}",
                      f"{max(x.gap for x in found):.2%}")  # fmt: skip


TABLES = {"cd": cd_table, "emd": emd_table, "tolerances": tolerances_table}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = pathlib.Path(__file__).resolve().parents[3] / "shared" / "psgn_batches"
    parser.add_argument("--data", type=pathlib.Path, default=default)
    parser.add_argument("--pairs", type=int, default=32)
    parser.add_argument("--only", nargs="+", default=["cd", "emd"], choices=list(TABLES))
    parser.add_argument("--sizes", nargs="+", default=["1024x1024", "1024x4096", "1024x16384"])
    parser.add_argument("--emd_sizes", nargs="+", type=int, default=[1024, 2048, 4096])
    every = ["near", "far", "init", "dup", "grid"]
    parser.add_argument("--kinds", nargs="+", default=every, choices=every)
    parser.add_argument("--emd_pairs", type=int, default=4, help="pairs for the slow libraries")
    args = parser.parse_args()
    print(f"{jax.devices()[0].device_kind}, jax {jax.__version__}, {args.pairs} pairs, float32")
    real = args.data.is_dir()
    print(f"clouds: {'authors batches' if real else 'default data set'}")
    whole = real_clouds(args.data, args.pairs) if real else default_clouds(args.pairs)
    for name, table in TABLES.items():
        if name in args.only:
            table(args, whole)


if __name__ == "__main__":
    main()

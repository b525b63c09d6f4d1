"""Times the Chamfer and the earth mover's distance, and other implementations of them.

    python tests/bench/losses.py [--data ../shared/psgn_batches] [--pairs 32]
        [--only cd emd tolerances steps] [--sizes 1024x1024 ..] [--emd_sizes 1024 ..]
        [--emd_pairs 4] [--kinds near far init dup grid]

All rows use the same clouds in the same run; `helpers/real_pairs.py` has the kinds. `cKDTree` is
SciPy's, both directions, forward only, with one thread; every time is also given relative to it.
Seconds are the CPU seconds of the process (the least of several calls), which other programs on the
machine affect less than the wall clock. Memory is what XLA reserves in addition to arguments and
results; for torch, the size of its matrices, marked with ~.

In the table of the EMD, the optimum is that of SciPy's `linear_sum_assignment`. Its time and those
of POT and lapx do not include the cost matrices. Errors are (sum of distances) / optimum - 1; for
Sinkhorn, the sum is the cost of its transport plan. Libraries that are not installed are left out.
SciPy and this package are measured on all pairs; the others, which are slow, on only the first
`--emd_pairs`. The table of tolerances has the time of this package's auction on one core, the table
of steps that of the training loop in docs/losses.md, by loss.
"""

import argparse
import functools
import importlib.util
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


def default_clouds(pairs):
    """Clouds of the default data set, used if those of the authors are missing."""
    from psgn_jax.commands import default_data
    from psgn_jax.data.dataset import RecordReader

    reader = RecordReader(default_data.default_dataset(), "train")
    return np.stack([sample.points for sample in itertools.islice(reader, pairs)])


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


def clocked(call, arguments):
    """Results for all arguments, CPU seconds (scipy, POT and lapx use one thread)."""
    start = time.process_time()
    results = [jax.device_get(call(*x)) for x in arguments]
    return results, time.process_time() - start


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
    """Values, seconds forward, seconds forward and backward, memory in MB."""
    value, *times, memory = measured(batch, batch, a, b)
    return value.astype(np.float64), *times, ", ".join(f"{m:.1f}" for m in memory)


def cd_torch(a, b):
    """Like `cd_jax`, with `torch.cdist` on a CPU."""
    import torch

    torch.set_num_threads(1)  # like the others; PyTorch's threads use CPU time while they wait
    a, b = torch.tensor(a, requires_grad=True), torch.tensor(b)

    def forward():
        d = torch.cdist(a, b)
        return d.amin(2).square().mean(1) + d.amin(1).square().mean(1)

    with torch.no_grad():
        value, one = forward().numpy(), seconds(lambda: forward() is None)
    both = seconds(lambda: torch.autograd.grad(forward().sum(), a) is None)
    needs = len(a) * a.shape[1] * b.shape[1] * 4 / 1e6
    return value, one, both, f"~{needs:.1f}, {2 * needs:.1f}"


def emd_ours(batch, a, b):
    """Sums, seconds forward, seconds forward and backward, extra MB, assignments of `map_pairs`."""
    of_pairs = batch(losses.matched_distances), batch(losses.emd_sum)
    found, one, two, memory = measured(*of_pairs, a, b)
    assignment = found.assignment
    assert all(len(set(i)) == len(i) for i in assignment.index)
    matched = np.take_along_axis(b.astype("f8"), assignment.index[..., None], axis=1)
    sums = np.linalg.norm(a.astype("f8") - matched, axis=2).sum(axis=1)
    return sums, one, two, max(memory), assignment


def sinkhorn(relative, a, b):
    """ott's Sinkhorn, epsilon relative to the mean cost: sum of costs, iterations."""
    from ott.geometry import costs, pointcloud
    from ott.solvers import linear

    geometry = pointcloud.PointCloud(
        a, b, cost_fn=costs.Euclidean(), epsilon=relative, relative_epsilon="mean"
    )
    out = linear.solve(geometry, threshold=1e-3, max_iterations=2000)
    return (out.matrix * geometry.cost_matrix).sum() * len(a), out.n_iters


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


# The tables: each yields its heading and then its rows.


def cd_table(args, whole):
    yield (
        "size", "kind", "version", "fwd s", "fwd+bwd s", "fwd / tree", "fwd+bwd / tree",
        "extra MB fwd, fwd+bwd", "mean error", "max error",
    )  # fmt: skip
    measures = {
        "map": functools.partial(cd_jax, losses.map_pairs(losses.chamfer_sq_mean)),
        "naive": functools.partial(cd_jax, jax.vmap(naive)),
    }
    if installed("torch"):
        measures["torch"] = cd_torch
    for size, kind in itertools.product(args.sizes, args.kinds):
        n, m = (int(x) for x in size.split("x"))
        a, b = pairs_of(whole, kind, n, m, np.random.default_rng(0))
        truth = ckdtree(a, b)
        tree = seconds(lambda a=a, b=b: ckdtree(a, b) is None)
        yield size, kind, "cKDTree", f"{tree:.3f}", "", 1, "", "", "", ""
        for name, measure in measures.items():
            value, *times, memory = measure(a, b)
            error = np.abs(value / truth - 1)
            absolute, relative = [f"{t:.3f}" for t in times], [f"{t / tree:.2f}" for t in times]
            errors = f"{error.mean():.0e}", f"{error.max():.0e}"
            yield size, kind, name, *absolute, *relative, memory, *errors


def emd_rows(a, b, few):
    """Name, seconds of a pair forward, sums, and other cells by heading; first SciPy's."""
    from scipy.optimize import linear_sum_assignment
    from scipy.spatial.distance import cdist

    pairs, n, _ = a.shape
    matrices = [(cdist(x, y),) for x, y in zip(a.astype("f8"), b.astype("f8"), strict=True)]
    matches, spent = clocked(linear_sum_assignment, matrices)
    best = [d[match].sum() for (d,), match in zip(matrices, matches, strict=True)]
    yield "scipy", spent / pairs, best, {}
    del matrices[few:]
    sums, one, both, memory, found = emd_ours(losses.map_pairs, a, b)
    bids = found.iterations / n
    yield "ours, map", one / pairs, sums, {
        "both": f"{1e3 * both / pairs:.2f}", "gap": f"{found.gap.max():.2%}",
        "iterations": f"{bids.mean():.1f} ({bids.max():.1f})", "memory": f"{memory:.1f}",
    }  # fmt: skip
    for package, (name, solve) in EXACT.items():
        if installed(package):
            solve(matrices[0][0])  # compiles, or imports
            sums, spent = clocked(solve, matrices)
            yield name, spent / few, sums, {}
    for relative in (0.02, 0.005) if installed("ott") else ():
        call = jax.jit(functools.partial(sinkhorn, relative)).lower(a[0], b[0]).compile()
        found, spent = clocked(call, zip(a[:few], b[:few], strict=True))
        sums, rounds = np.array(found).T
        # One iteration is a pass over the n rows of the matrix: one row per point.
        more = {"iterations": f"{rounds.mean():.1f} ({rounds.max():.1f})"}
        yield f"ott Sinkhorn {relative:g}", spent / few, sums, more


def emd_table(args, whole):
    yield (
        "n", "kind", "version", "fwd ms/pair", "fwd+bwd ms/pair", "scipy / fwd", "mean error",
        "max error", "max stated gap", "iterations per point (max)", "extra MB",
    )  # fmt: skip
    for n, kind in itertools.product(args.emd_sizes, args.kinds):
        # The time of the exact solution grows like n^3, so larger sizes have fewer pairs.
        few = min(args.emd_pairs, len(whole))
        pairs = max(few, len(whole) * 1024**2 // max(n, 1024) ** 2)
        a, b = (x[:pairs] for x in pairs_of(whole, kind, n, n, np.random.default_rng(0)))
        for name, one, sums, more in emd_rows(a, b, few):
            if name == "scipy":
                base, best = one, np.array(sums)
            error = np.asarray(sums) / best[: len(sums)] - 1
            cells = [more.get(key, "") for key in ("both", "gap", "iterations", "memory")]
            errors = f"{error.mean():.2%}", f"{error.max():.2%}"
            times = f"{one * 1e3:.2f}", cells[0], f"{base / one:.2f}"
            yield n, kind, name, *times, *errors, *cells[1:]


def tolerances_table(args, whole):
    """The EMD of one core, pair by pair."""
    yield "n", "kind", "tolerance", "CPU ms/pair", "pairs/s", "largest gap"
    for n, kind in itertools.product(args.emd_sizes, args.kinds):
        pairs = max(args.emd_pairs, args.pairs * 1024**2 // max(n, 1024) ** 2)
        a, b = (x[:pairs] for x in pairs_of(whole, kind, n, n, np.random.default_rng(0)))
        for tolerance in (0.01, 0.03, 0.1):
            call = functools.partial(losses.assign, tolerance=tolerance)
            jax.block_until_ready(call(a[0], b[0]))
            found, spent = clocked(call, zip(a, b, strict=True))
            times = f"{1e3 * spent / len(a):.1f}", f"{len(a) / spent:.1f}"
            yield n, kind, tolerance, *times, f"{max(x.gap for x in found):.2%}"


def steps_table(args, whole):
    yield "loss", "ms per step"
    page = (pathlib.Path(__file__).resolve().parents[2] / "docs" / "losses.md").read_text()
    loop = page.partition("<!-- loop -->\n```python\n")[2].partition("```")[0]
    written = loop.partition("    return ")[2].partition("\n")[0]
    cd, emd = "losses.chamfer_sq_mean(pred, gt)", "losses.emd_mean(pred, gt, tolerance=0.1)"
    for loss in (cd, emd, written, emd.replace("0.1", "0.01")):
        exec(loop.replace(written, loss), names := {})
        state, times = (names["params"], names["state"]), []
        for number in range(60, 75):
            batch = jax.block_until_ready(names["batch"](jax.random.key(number)))
            start = time.process_time()
            *state, _ = jax.block_until_ready(names["step"](*state, *batch))
            times.append(time.process_time() - start)
        yield loss, f"{1e3 * np.mean(times):.0f}"


TABLES = {"cd": cd_table, "emd": emd_table, "tolerances": tolerances_table, "steps": steps_table}


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = pathlib.Path(__file__).resolve().parents[3] / "shared" / "psgn_batches"
    parser.add_argument("--data", type=pathlib.Path, default=default)
    parser.add_argument("--pairs", type=int, default=32)
    parser.add_argument("--only", nargs="+", default=["cd", "emd"], choices=list(TABLES))
    parser.add_argument("--sizes", nargs="+", default=["1024x1024", "1024x4096", "1024x16384"])
    parser.add_argument("--emd_sizes", nargs="+", type=int, default=[1024, 2048, 4096])
    parser.add_argument("--kinds", nargs="+", default=KINDS, choices=KINDS)
    parser.add_argument("--emd_pairs", type=int, default=4, help="pairs for the slow libraries")
    args = parser.parse_args()
    print(f"{jax.devices()[0].device_kind}, jax {jax.__version__}, {args.pairs} pairs, float32")
    real = args.data.is_dir()
    print(f"clouds: {'authors batches' if real else 'default data set'}")
    whole = authors_clouds(args.data, args.pairs) if real else default_clouds(args.pairs)
    for name in args.only:
        for number, cells in enumerate(TABLES[name](args, whole)):
            if not number:
                print()
            print("| " + " | ".join(map(str, cells)) + " |", flush=True)
            if not number:
                print("|" + "---|" * len(cells))


if __name__ == "__main__":
    main()

"""Times the Chamfer and the earth mover's distance, and other implementations of them.

    python tests/bench/losses.py [--data ../shared/psgn_batches] [--pairs 32] [--only cd emd]
        [--sizes 1024x1024 ..] [--emd_sizes 1024 ..] [--emd_kinds near far init dup grid]

All rows use the same clouds in the same run. `cKDTree` is SciPy's, both directions, forward only,
with one thread; every time is also given relative to it. Seconds are the CPU seconds of the process
(the least of several calls), which other programs on the machine affect less than the wall clock;
on one core (`taskset -c 0`) both are nearly equal. Libraries that run on a GPU (this package, ott
and torch, if there is a GPU) are measured by the wall clock. Memory is the memory that XLA reserves
in addition to arguments and results. For libraries that do not report it, it is the size of their
arrays (the tree and its results, matrices, plans), marked with ~.

Kinds: near = two disjoint subsets of one cloud, far = clouds of two objects, init = all predictions
within 1e-3 of the origin, dup = far with eight copies of every point on average, grid = far,
rounded to a lattice of step 1/8, which gives ties.

In the table of the EMD, the optimum is that of SciPy's `linear_sum_assignment`. Its time and those
of POT, lapx and optax's Hungarian algorithm do not include the cost matrices. Errors are (sum of
distances) / optimum - 1; for Sinkhorn, the sum is the cost of its transport plan. Libraries that
are not installed are left out with a message. SciPy and this package are measured on all pairs; the
others, which are slow, on only the first `--emd_pairs`.
"""

import argparse
import importlib.util
import pathlib
import subprocess
import sys
import time
import zlib

import jax
import jax.numpy as jnp
import numpy as np
import optax

from psgn_jax import losses

_POINTS = 32 * 192 * 256 * (3 + 2) + 32 * 9 * 4  # offset of the points in a batch file


def real_clouds(folder, pairs):
    """The authors' clouds, whole [pairs, 16384, 3]."""
    whole = []
    for path in sorted(pathlib.Path(folder).glob("*.gz")):
        raw = zlib.decompress(path.read_bytes())
        points = np.frombuffer(raw, np.uint8, 32 * 16384 * 3, _POINTS).reshape(32, 16384, 3)
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


def seconds(call, budget, gpu=None):
    """Least time of a call; it is called at least twice, then until the budget is spent."""
    gpu = jax.default_backend() != "cpu" if gpu is None else gpu
    clock = time.perf_counter if gpu else time.process_time
    jax.block_until_ready(call())
    times, begin = [], time.perf_counter()
    while len(times) < 2 or (time.perf_counter() - begin < budget and len(times) < 30):
        start = clock()
        jax.block_until_ready(call())
        times.append(clock() - start)
    return min(times)


def ckdtree(a, b):
    from scipy.spatial import cKDTree

    return np.array(
        [
            np.square(cKDTree(y).query(x)[0]).mean() + np.square(cKDTree(x).query(y)[0]).mean()
            for x, y in zip(a, b, strict=True)
        ]
    )


def naive(pred, gt):
    d = jnp.square(pred[:, None] - gt[None]).sum(-1)
    return d.min(1).mean() + d.min(0).mean()


def jax_rows(name, batch, a, b, budget):
    def total(a, b):
        return batch(a, b).sum()

    a, b = jnp.asarray(a), jnp.asarray(b)
    forward = jax.jit(batch).lower(a, b).compile()
    both = jax.jit(jax.value_and_grad(total)).lower(a, b).compile()
    memory = [x.memory_analysis().temp_size_in_bytes / 1e6 for x in (forward, both)]
    yield name, seconds(lambda: forward(a, b), budget), seconds(lambda: both(a, b), budget), memory
    yield np.asarray(forward(a, b), np.float64)


def torch_device():
    import torch

    torch.set_num_threads(1)  # like the others; PyTorch's threads use CPU time while they wait
    return "cuda" if torch.cuda.is_available() else "cpu"


def torch_seconds(call, budget):
    import torch

    gpu = torch_device() == "cuda"

    def done():
        call()
        if gpu:
            torch.cuda.synchronize()

    return seconds(done, budget, gpu)


def torch_cdist(a, b, budget, memory):
    import torch

    a, b = (torch.tensor(x, device=torch_device()) for x in (a, b))
    a.requires_grad_()

    def forward():
        d = torch.cdist(a, b)
        return d.amin(2).square().mean(1) + d.amin(1).square().mean(1)

    def both():
        a.grad = None
        forward().sum().backward()

    with torch.no_grad():
        value, one = forward().cpu().numpy(), torch_seconds(forward, budget)
    return ("torch.cdist", one, torch_seconds(both, budget), memory, "~"), value


def import_seconds():
    """Time of `import psgn_jax.losses` in a fresh interpreter that has imported jax."""
    code = (
        "import jax, jax.numpy, time; t = time.perf_counter(); import psgn_jax.losses;"
        "print(time.perf_counter() - t)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return float(done.stdout)


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


def clocked(call, arguments, gpu=False):
    """Results for all arguments, CPU seconds (scipy, POT and lapx use one thread)."""
    clock = time.perf_counter if gpu else time.process_time
    start = clock()
    results = [call(*x) for x in arguments]
    return results, clock() - start


def emd_ours(version, a, b, budget):
    """(forward s, forward+backward s, sums, gaps, bids, extra bytes) of `vmap` or `map_pairs`."""
    batch = {
        "map": lambda f: losses.map_pairs(f, platform="cpu"),
        "vmap": jax.vmap,
    }[version]
    a, b = jnp.asarray(a), jnp.asarray(b)
    solve = jax.jit(batch(losses.matched_distances)).lower(a, b).compile()
    both = (
        jax.jit(jax.value_and_grad(lambda a, b: batch(losses.emd_sum)(a, b).sum()))
        .lower(a, b)
        .compile()
    )
    found = solve(a, b)
    memory = max(x.memory_analysis().temp_size_in_bytes for x in (solve, both))
    one, two = seconds(lambda: solve(a, b), budget), seconds(lambda: both(a, b), budget)
    index = np.asarray(found.assignment.index)
    total = [
        np.linalg.norm(x.astype(np.float64) - y.astype(np.float64)[i], axis=1).sum()
        for x, y, i in zip(np.asarray(a), np.asarray(b), index, strict=True)
    ]
    assert all(len(set(i)) == len(i) for i in index)
    return (
        one,
        two,
        np.array(total),
        np.asarray(found.assignment.gap),
        np.asarray(found.assignment.iterations),
        memory,
    )


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
    gpu = jax.default_backend() != "cpu"
    found, spent = clocked(lambda x, y: jax.device_get(call(x, y)), zip(a, b, strict=True), gpu)
    memory = call.memory_analysis().temp_size_in_bytes
    return np.array([x for x, _ in found]), np.array([x for _, x in found]), spent, memory


def pot_emd(d):
    import ot  # slow at first: this function is called once before it is timed

    weights = np.full(len(d), 1 / len(d))
    return ot.emd2(weights, weights, d, numItermax=10**7) * len(d)


def lapx_emd(d):
    import lap

    return lap.lapjv(d)[0]


_hungarian = jax.jit(optax.assignment.hungarian_algorithm)


def optax_emd(d):
    row, col = jax.device_get(_hungarian(jnp.asarray(d, jnp.float32)))
    return d[row, col].sum()


def emd_table(args, whole):
    from scipy.optimize import linear_sum_assignment
    from scipy.spatial.distance import cdist

    missing = [x for x in ("ot", "lap", "ott") if importlib.util.find_spec(x) is None]
    for name in missing:
        print(f"not installed, left out: {name}")
    print("\n| n | kind | version | fwd ms/pair | fwd+bwd ms/pair | scipy / fwd | mean error"
          " | max error | max stated gap | iterations per point (max) | extra MB |\n"
          + "|" + "---|" * 11)  # fmt: skip
    for n in args.emd_sizes:
        for kind in args.emd_kinds:
            # The time of the exact solution grows like n^3, so larger sizes have fewer pairs.
            pairs = max(min(args.emd_pairs, len(whole)), len(whole) * 1024**2 // max(n, 1024) ** 2)
            a, b = make_pairs(whole, pairs, n, n, kind, np.random.default_rng(0))
            k = min(args.emd_pairs, pairs)
            best, matrices, solved = [], [], 0.0
            for x, y in zip(a.astype(np.float64), b.astype(np.float64), strict=True):
                d = cdist(x, y)
                (match,), spent = clocked(linear_sum_assignment, [(d,)])
                solved += spent
                best.append(d[match].sum())
                if len(matrices) < k:
                    matrices.append((d,))
            best, base = np.array(best), solved / pairs

            def show(name, one, both, total=None, gap=None, bids=None, memory=None,
                     about="", n=n, kind=kind, best=best, base=base):  # fmt: skip
                error = ["", ""]
                if total is not None:
                    wrong = total / best[: len(total)] - 1
                    error = [f"{wrong.mean():.2%}", f"{wrong.max():.2%}"]
                cells = (
                    n, kind, name, f"{one * 1e3:.2f}", both and f"{both * 1e3:.2f}",
                    f"{base / one:.2f}", *error, "" if gap is None else f"{gap.max():.2%}",
                    "" if bids is None else f"{bids.mean() / n:.1f} ({bids.max() / n:.1f})",
                    "" if memory is None else f"{about}{memory / 1e6:.1f}",
                )  # fmt: skip
                print("| " + " | ".join(str(x or "") for x in cells) + " |", flush=True)

            show("scipy", base, None, best, memory=8 * n * n, about="~")
            for version in ("map", "vmap"):
                if version in args.skip:
                    continue
                one, both, *rest = emd_ours(version, a, b, args.budget)
                show(f"ours, {version}", one / pairs, both / pairs, *rest)
            if "ot" not in missing and "ot" not in args.skip:
                pot_emd(matrices[0][0][:2, :2])
                total, spent = clocked(pot_emd, matrices)
                show("POT emd2", spent / k, None, np.array(total), memory=16 * n * n, about="~")
            if "lap" not in missing and "lap" not in args.skip:
                lapx_emd(matrices[0][0][:2, :2])
                total, spent = clocked(lapx_emd, matrices)
                show("lapx lapjv", spent / k, None, np.array(total), memory=8 * n * n, about="~")
            if "optax" not in args.skip:
                optax_emd(matrices[0][0])  # compiles
                total, spent = clocked(optax_emd, matrices)
                show(
                    "optax Hungarian", spent / k, None, np.array(total), memory=4 * n * n, about="~"
                )
            if "ott" not in missing and "ott" not in args.skip:
                for relative in args.sinkhorn:
                    total, rounds, spent, memory = emd_sinkhorn(a[:k], b[:k], relative)
                    # One iteration is a pass over the n rows of the matrix: one row per point.
                    name = f"ott Sinkhorn {relative:g}"
                    show(name, spent / k, None, total, None, rounds * n, memory)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = pathlib.Path(__file__).resolve().parents[3] / "shared" / "psgn_batches"
    parser.add_argument("--data", type=pathlib.Path, default=default)
    parser.add_argument("--pairs", type=int, default=32)
    parser.add_argument("--sizes", nargs="+", default=["1024x1024", "1024x4096", "1024x16384"])
    parser.add_argument("--only", nargs="+", default=["cd", "emd"], choices=["cd", "emd"])
    parser.add_argument("--emd_sizes", nargs="+", type=int, default=[1024, 2048, 4096])
    every = ["near", "far", "init", "dup", "grid"]
    parser.add_argument("--emd_kinds", nargs="+", default=every, choices=every)
    parser.add_argument("--emd_pairs", type=int, default=4, help="pairs for the slow libraries")
    parser.add_argument("--sinkhorn", nargs="*", type=float, default=[0.02, 0.005])
    parser.add_argument("--kinds", nargs="+", default=every, choices=every)
    parser.add_argument("--budget", type=float, default=2.0, help="seconds spent on each figure")
    parser.add_argument("--skip", nargs="*", default=[], help="rows to leave out, e.g. naive torch")
    parser.add_argument("--limit_gb", type=float, default=3.0, help="skip rows that need more")
    args = parser.parse_args()

    print(f"{jax.devices()[0].device_kind}, jax {jax.__version__}, {args.pairs} pairs, float32")
    print(f"import psgn_jax.losses beyond jax: {import_seconds():.2f} s")
    real = args.data.is_dir()
    print(f"clouds: {'authors batches' if real else 'default data set'}\n")
    whole = real_clouds(args.data, args.pairs) if real else default_clouds(args.pairs)
    if "cd" in args.only:
        cd_table(args, whole)
    if "emd" in args.only:
        emd_table(args, whole)


def cd_table(args, whole):
    print("| size | kind | version | fwd s | fwd+bwd s | fwd / tree | fwd+bwd / tree"
          " | extra MB fwd, fwd+bwd | mean error | max error |\n|" + "---|" * 10)  # fmt: skip
    for size in args.sizes:
        n, m = (int(x) for x in size.split("x"))
        for kind in args.kinds:
            a, b = make_pairs(whole, len(whole), n, m, kind, np.random.default_rng(0))
            truth, tree = (
                ckdtree(a, b),
                seconds(lambda a=a, b=b: ckdtree(a, b) is None, args.budget, gpu=False),
            )

            def show(row, value, truth=truth, tree=tree, size=size, kind=kind):
                name, one, both, memory, *about = row
                error = np.abs(value / truth - 1)
                extra = "".join(about) + ", ".join(f"{x:.1f}" for x in memory)
                print(f"| {size} | {kind} | {name} | {one:.3f} | {both:.3f} | {one / tree:.2f}"
                      f" | {both / tree:.2f} | {extra} | {error.mean():.0e} | {error.max():.0e} |",
                      flush=True)  # fmt: skip

            # Memory for one pair at a time: points in float64, their order, the results.
            needs = (n + m) * (24 + 8 + 16) / 1e6
            print(f"| {size} | {kind} | cKDTree | {tree:.3f} | | 1 | | ~{needs:.1f} | | |",
                  flush=True)  # fmt: skip
            versions = {
                "ours, map": losses.map_pairs(losses.chamfer_sq_mean, platform="cpu"),
                "ours, vmap": jax.vmap(losses.chamfer_sq_mean),
                "naive": jax.vmap(naive),
            }
            for name, batch in versions.items():
                if name in args.skip or (
                    name == "naive" and args.pairs * n * m * 4 * 6 > args.limit_gb * 1e9
                ):
                    continue
                show(*jax_rows(name, batch, a, b, args.budget))
            needs = [args.pairs * n * m * 4 * k / 1e6 for k in (1, 2)]
            if (
                "torch" not in args.skip
                and importlib.util.find_spec("torch")
                and needs[1] < args.limit_gb * 1e3
            ):
                show(*torch_cdist(a, b, args.budget, needs))


if __name__ == "__main__":
    main()

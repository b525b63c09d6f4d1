"""Times the Chamfer distance beside the ways people compute it: one command, one table.

    python tests/bench/losses.py [--data ../shared/psgn_batches] [--pairs 32] [--sizes 1024x1024 ..]

All rows see the same clouds in the same run. `cKDTree` is scipy's, both directions, forward only,
one thread; every time is also given as a ratio to it. Seconds are the CPU seconds of the process
(the least of several calls), which other programs on the machine disturb less than the wall
clock; pin the run to one core (`taskset -c 0`) and both are the same thing. On an accelerator the
wall clock is used. Memory is what XLA reserves beyond arguments and results.
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

from psgn_jax import losses

_POINTS = 32 * 192 * 256 * (3 + 2) + 32 * 9 * 4  # offset of the points in a batch file


def real_clouds(folder, pairs, n, m, kind, rng):
    """Subsets of the authors' clouds: near = of one cloud, with noise; far = of two objects."""
    whole = []
    for path in sorted(pathlib.Path(folder).glob("*.gz")):
        raw = zlib.decompress(path.read_bytes())
        points = np.frombuffer(raw, np.uint8, 32 * 16384 * 3, _POINTS).reshape(32, 16384, 3)
        whole.extend(((points / 255.0 - [0.7, 0.5, 0.5]) / 0.4).astype(np.float32))
        if len(whole) >= pairs:
            break
    return pick(np.stack(whole[:pairs]), n, m, kind, rng)


def random_clouds(pairs, n, m, kind, rng):
    """Points on spheres, in place of the authors' clouds where those are absent."""
    points = rng.normal(size=(pairs, 16384, 3))
    points /= np.linalg.norm(points, axis=-1, keepdims=True)
    return pick(points * rng.uniform(0.3, 1, (pairs, 1, 3)), n, m, kind, rng)


def pick(whole, n, m, kind, rng):
    a = np.stack([x[rng.permutation(len(x))[:n]] for x in whole])
    b = np.stack([x[rng.permutation(len(x))[:m]] for x in whole])
    if kind == "far":
        a = np.roll(a, 1, axis=0)
    return (a + rng.normal(0, 0.01, a.shape)).astype(np.float32), b.astype(np.float32)


def seconds(call, budget):
    """Least time of a call; it is called at least twice, then until the budget is spent."""
    cpu = jax.default_backend() == "cpu"
    clock = time.process_time if cpu else time.perf_counter
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


def torch_cdist(a, b, budget, memory):
    import torch

    a, b = torch.tensor(a, requires_grad=True), torch.tensor(b)

    def forward():
        d = torch.cdist(a, b)
        return d.amin(2).square().mean(1) + d.amin(1).square().mean(1)

    def both():
        a.grad = None
        forward().sum().backward()

    with torch.no_grad():
        value, one = forward().numpy(), seconds(lambda: forward() is None, budget)
    return ("torch.cdist", one, seconds(both, budget), memory), value


def import_seconds():
    """Time of `import psgn_jax.losses` once jax is imported, in a fresh interpreter."""
    code = (
        "import jax, jax.numpy, time; t = time.perf_counter(); import psgn_jax.losses;"
        "print(time.perf_counter() - t)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return float(done.stdout)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = pathlib.Path(__file__).resolve().parents[3] / "shared" / "psgn_batches"
    parser.add_argument("--data", type=pathlib.Path, default=default)
    parser.add_argument("--pairs", type=int, default=32)
    parser.add_argument("--sizes", nargs="+", default=["1024x1024", "1024x4096", "1024x16384"])
    parser.add_argument("--kinds", nargs="+", default=["near", "far"], choices=["near", "far"])
    parser.add_argument("--budget", type=float, default=2.0, help="seconds spent on each figure")
    parser.add_argument("--skip", nargs="*", default=[], help="rows to leave out, e.g. naive torch")
    parser.add_argument("--limit_gb", type=float, default=3.0, help="skip rows that need more")
    args = parser.parse_args()

    print(f"{jax.devices()[0].device_kind}, jax {jax.__version__}, {args.pairs} pairs, float32")
    print(f"import psgn_jax.losses beyond jax: {import_seconds():.2f} s")
    print(f"clouds: {'authors batches' if args.data.is_dir() else 'random'}\n")
    print("| size | kind | version | fwd s | fwd+bwd s | fwd / tree | fwd+bwd / tree"
          " | extra MB fwd, fwd+bwd | worst rel. error |\n|" + "---|" * 9)  # fmt: skip
    for size in args.sizes:
        n, m = (int(x) for x in size.split("x"))
        for kind in args.kinds:
            rng = np.random.default_rng(0)
            if args.data.is_dir():
                a, b = real_clouds(args.data, args.pairs, n, m, kind, rng)
            else:
                a, b = random_clouds(args.pairs, n, m, kind, rng)
            truth, tree = (
                ckdtree(a, b),
                seconds(lambda a=a, b=b: ckdtree(a, b) is None, args.budget),
            )

            def show(row, value, truth=truth, tree=tree, size=size, kind=kind):
                name, one, both, memory = row
                error = np.abs(value / truth - 1).max()
                extra = ", ".join(f"{x:.1f}" for x in memory)
                print(f"| {size} | {kind} | {name} | {one:.3f} | {both:.3f} | {one / tree:.2f}"
                      f" | {both / tree:.2f} | {extra} | {error:.1e} |", flush=True)  # fmt: skip

            print(f"| {size} | {kind} | cKDTree | {tree:.3f} | | 1 | | | |", flush=True)
            versions = {
                "ours, map": losses.batched(losses.chamfer_sq_mean, platform="cpu"),
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

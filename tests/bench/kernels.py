"""Times the losses on a GPU: the plain XLA path against the Pallas kernels.

    python tests/bench/kernels.py [--pairs 32] [--sizes 1024x16384] [--emd_sizes 1024 4096]

Prints wall-clock milliseconds per batch under `jax.vmap`, the least of several calls, without
compilation. A separate column has the seconds of compilation, because a kernel that compiles for
minutes is unusable. The floor of the Chamfer distance is the lower bound of its arithmetic: every
distance once, in 8 instructions per lane (3 differences, a product, 2 fused multiply-adds, a
minimum for each direction), on all lanes at the highest clock that `nvidia-smi` reports. Clouds:
near = two samples of one surface, far = samples of two surfaces, init = predictions within 1e-3 of
the origin, grid = far, rounded to a lattice. The first cloud of near and far has noise.

Without a GPU the command ends with a message. With `--interpret` it runs the kernels as plain JAX,
to test the command itself (the times have no meaning).
"""

import argparse
import functools
import os
import subprocess
import time

import jax
import jax.numpy as jnp
import numpy as np

from psgn_jax import losses
from psgn_jax.losses.kernels.dispatch import use_kernels

_INSTRUCTIONS = 8
_LANES = 128  # float32 lanes of a multiprocessor from compute capability 8.6 on


def clouds(kind, pairs, n, m, rng):
    def surface(points):
        x = rng.normal(size=(pairs, points, 3))
        x /= np.linalg.norm(x, axis=-1, keepdims=True)
        return x * scale

    scale = rng.uniform(0.2, 1, (pairs, 1, 3))
    b = surface(m)
    if kind != "near":
        scale = rng.uniform(0.2, 1, (pairs, 1, 3))
    a = surface(n) + rng.normal(0, 0.01, (pairs, n, 3))
    if kind == "init":
        a = rng.normal(0, 5e-4, a.shape)
    if kind == "grid":
        a, b = np.round(a * 8) / 8, np.round(b * 8) / 8
    return jnp.asarray(a, jnp.float32), jnp.asarray(b, jnp.float32)


def lane_rate():
    """Instructions per second of all lanes; None if `nvidia-smi` does not report the clock."""
    device = jax.devices()[0]
    try:
        clock = subprocess.run(
            ["nvidia-smi", "--query-gpu=clocks.max.sm", "--format=csv,noheader,nounits"],
            capture_output=True, text=True, check=True,
        ).stdout.split()[0]  # fmt: skip
        return float(clock) * 1e6 * device.core_count * _LANES
    except (OSError, subprocess.CalledProcessError, AttributeError, IndexError):
        return None


def measure(function, arguments, budget):
    """Seconds to compile, least milliseconds of a call, and its value."""
    start = time.perf_counter()
    call = jax.jit(function).lower(*arguments).compile()
    compiling = time.perf_counter() - start
    value = jax.block_until_ready(call(*arguments))
    times, begin = [], time.perf_counter()
    while len(times) < 3 or (time.perf_counter() - begin < budget and len(times) < 100):
        start = time.perf_counter()
        jax.block_until_ready(call(*arguments))
        times.append(time.perf_counter() - start)
    return compiling, 1e3 * min(times), value


def path(kernels, interpret):
    """Selects the kernels or the plain path for all functions that are traced afterwards."""
    os.environ["PSGN_KERNELS"] = "on" if kernels else "off"
    jax.clear_caches()
    if kernels and interpret:
        from psgn_jax.losses import assignment, chamfer
        from psgn_jax.losses.kernels import auction as auction_kernel
        from psgn_jax.losses.kernels import chamfer as chamfer_kernel

        search = functools.partial(chamfer_kernel.search, interpret=True)
        solve = functools.partial(auction_kernel.solve_pair, interpret=True)
        chamfer.select = lambda kernel, plain, *arrays: search(*arrays)
        plain = assignment._for_platform
        assignment._for_platform = lambda solver, n, schedule: (
            solve if use_kernels() else plain(solver, n, schedule)
        )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=32)
    parser.add_argument("--sizes", nargs="*", default=["1024x1024", "1024x16384"])
    parser.add_argument("--emd_sizes", nargs="*", type=int, default=[1024, 2048, 4096])
    parser.add_argument("--emd_kinds", nargs="*", default=["near", "far", "init", "grid"])
    parser.add_argument("--budget", type=float, default=2.0, help="seconds spent on each figure")
    parser.add_argument("--interpret", action="store_true", help="test the command without a GPU")
    args = parser.parse_args()
    if jax.default_backend() != "gpu" and not args.interpret:
        raise SystemExit(f"no GPU: JAX runs on {jax.default_backend()} (see --interpret)")
    rate = lane_rate()
    print(f"{jax.devices()[0].device_kind}, jax {jax.__version__}, {args.pairs} pairs, float32")
    print(f"floor: {rate / 1e12:.1f} T instructions/s\n" if rate else "floor: clock unknown\n")

    print("| Chamfer | path | compile s | forward ms | forward+backward ms | over the floor"
          " | difference |\n|" + "---|" * 7)  # fmt: skip
    for size in args.sizes:
        n, m = (int(x) for x in size.split("x"))
        a, b = clouds("near", args.pairs, n, m, np.random.default_rng(0))
        batch = jax.vmap(losses.chamfer_sq_mean)
        both = jax.value_and_grad(lambda a, b, batch=batch: batch(a, b).sum(), argnums=(0, 1))
        truth = None
        for kernels in (False, True):
            path(kernels, args.interpret)
            compiling, forward, value = measure(batch, (a, b), args.budget)
            _, backward, _ = measure(both, (a, b), args.budget)
            truth = value if truth is None else truth
            over = (
                f"{backward / (1e3 * args.pairs * n * m * _INSTRUCTIONS / rate):.2f}"
                if rate
                else ""
            )
            name = "kernel" if kernels else "plain"
            print(f"| {size} | {name} | {compiling:.1f} | {forward:.3f} | {backward:.3f} | {over}"
                  f" | {abs(value / truth - 1).max():.1e} |", flush=True)  # fmt: skip

    print("\n| EMD | kind | path | compile s | forward ms | bids a pair, mean and most | worst gap"
          " | not converged |\n|" + "---|" * 8)  # fmt: skip
    for n in args.emd_sizes:
        for kind in args.emd_kinds:
            a, b = clouds(kind, args.pairs, n, n, np.random.default_rng(0))
            for kernels in (False, True):
                path(kernels, args.interpret)
                solve = jax.vmap(losses.assign)
                compiling, forward, found = measure(solve, (a, b), args.budget)
                for index in np.asarray(found.index):
                    assert (np.sort(index) == np.arange(n)).all(), "not a bijection"
                bids = np.asarray(found.iterations)
                print(f"| {n} | {kind} | {'kernel' if kernels else 'plain'} | {compiling:.1f}"
                      f" | {forward:.2f} | {bids.mean():.0f}, {bids.max()} | {found.gap.max():.4f}"
                      f" | {int((~found.converged).sum())} |", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()

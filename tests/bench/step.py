"""Time of a training step of the two-branch network on a CPU.

One step is forward and backward with respect to all parameters; the loss is a fixed linear function
of the points, whose cost is negligible. Each row runs in a separate process, so that its peak
memory can be measured. They are measured in alternation, so that other work on the machine affects
all of them alike.

    python tests/bench/step.py                  # the network of configs/authors.py
    python tests/bench/step.py --small          # that of configs/authors_small.py

Prints seconds per step (the fastest, the median and the slowest), the ratio to the floor (the
median over the rounds), samples per second, and the peak memory of each process. The floor is the
time of the step's operations at the speed of NumPy's product of large matrices. This package is
measured with a device of JAX for each core, as `psgn train` uses them, and with one.
"""

import argparse
import multiprocessing
import resource
import statistics
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np

from psgn_jax.config import parse
from psgn_jax.config.files import load

_step, _times = None, 1.0  # what this process measures, and how often a step needs it


def prepare(build, *args):
    """Builds and compiles the step of this process; returns the number of parameters."""
    global _step, _times
    num_params, _step, _times = build(*args)
    _step()
    return num_params


def seconds():
    start = time.perf_counter()
    _step()
    return _times * (time.perf_counter() - start)


def peak_gb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9


def _model(name):
    """Parameters and images of a configuration's network, and its loss."""
    import jax
    import jax.numpy as jnp

    from psgn_jax.models import networks

    config = parse(load(name))
    model = networks.build(config.model)
    shape = (config.train.batch_size, *config.data.image_size, config.model.in_channels)
    x = np.random.default_rng(0).random(shape, np.float32)

    def loss(params, x):
        points = model.apply({"params": params}, x)
        return jnp.sum(points * jnp.cos(jnp.arange(points.size)).reshape(points.shape))

    return jax.jit(model.init)(jax.random.key(0), x[:1])["params"], x, loss


def build_floor(name):
    """As many products of matrices as have the operations of a step, by XLA's count."""
    import jax

    from psgn_jax.models.cpu_convolution import convolutions_for

    params, x, loss = _model(name)
    with convolutions_for("export"):  # calls of oneDNN are not counted
        flops = jax.jit(jax.grad(loss)).lower(params, x).cost_analysis()["flops"]
    matrix = np.random.default_rng(0).random((2048, 2048), np.float32)
    times = flops / (2 * len(matrix) ** 3)
    return sum(p.size for p in jax.tree.leaves(params)), lambda: matrix @ matrix, times


def build_jax(name, devices):
    """Number of parameters and step of the network; the devices share the batch."""
    from psgn_jax.system.cpu import keep_freed_memory

    keep_freed_memory()
    import jax
    from jax.sharding import PartitionSpec as P

    jax.config.update("jax_num_cpu_devices", devices)
    params, x, loss = _model(name)
    mesh = jax.make_mesh((devices,), ("data",), axis_types=(jax.sharding.AxisType.Auto,))
    specs = {"mesh": mesh, "in_specs": (P(), P("data")), "out_specs": P()}

    def gradient(params, x):
        return jax.lax.pmean(jax.grad(loss)(params, x), "data")

    step = jax.jit(jax.shard_map(gradient, check_vma=False, **specs))
    params = jax.device_put(params, jax.NamedSharding(mesh, P()))
    x = jax.device_put(x, jax.NamedSharding(mesh, P("data")))
    num_params = sum(p.size for p in jax.tree.leaves(params))
    return num_params, lambda: jax.block_until_ready(step(params, x)), 1


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--small", action="store_true", help="of authors_small.py")
    parser.add_argument("--repeats", type=int, default=5, help="timed steps of each")
    parser.add_argument("--devices", type=int, default=2, help="devices of JAX")
    arguments = parser.parse_args()
    name = "authors_small" if arguments.small else "authors"
    batch = parse(load(name)).train.batch_size
    rows = {
        "psgn_jax": (build_jax, name, arguments.devices),
        "on one device": (build_jax, name, 1),
        "floor": (build_floor, name),
    }
    context = multiprocessing.get_context("spawn")
    pools = {name: ProcessPoolExecutor(1, context) for name in rows}
    sizes = {name: pools[name].submit(prepare, *c).result() for name, c in rows.items()}
    print(f"{sizes['psgn_jax']:,} parameters, {name}, batch {batch}")
    times = {name: [] for name in rows}
    for _ in range(arguments.repeats):
        for name, pool in pools.items():
            times[name].append(pool.submit(seconds).result())
    titles = f"{'fastest':>9}{'median s':>9}{'slowest':>9}{'/ floor':>9}"
    print(f"{'':16}{titles}{'samples/s':>11}{'peak GB':>9}")
    for name, own in times.items():
        ratio = statistics.median(a / b for a, b in zip(own, times["floor"], strict=True))
        median, peak = statistics.median(own), pools[name].submit(peak_gb).result()
        print(
            f"{name:16}{min(own):9.3f}{median:9.3f}{max(own):9.3f}{ratio:9.2f}"
            f"{batch / median:11.1f}{peak:9.2f}"
        )
    for pool in pools.values():
        pool.shutdown()


if __name__ == "__main__":
    main()

"""Time of a training step of the two-branch network on a CPU, against PyTorch.

One step is forward and backward with respect to all parameters; the loss is a fixed linear function
of the points, whose cost is negligible. Each implementation runs in a separate process, so that its
peak memory can be measured. They are measured in alternation, so that other work on the machine
affects all of them alike.

    python tests/bench/step.py                  # the full network, batch 32
    python tests/bench/step.py --small          # the half-size network of configs/authors_small.py

Prints seconds per step (the fastest, the median and the slowest), the ratio to PyTorch channels
last (the median over the rounds), samples per second, and the peak memory of each process. This
package is measured with a device of JAX for each core, as `psgn train` uses them, and with one.
"""

import argparse
import multiprocessing
import resource
import statistics
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np

FULL = {
    "image_size": (192, 256),
    "widths": (16, 32, 64, 128, 256, 512, 512),
    "deconv_level": 3,
    "fc_widths": (2048, 1024),
}
SMALL = {
    "image_size": (96, 128),
    "widths": (8, 16, 32, 64, 128, 256),
    "deconv_level": 2,
    "fc_widths": (768, 512),
}
IN_CHANNELS, FC_POINTS, DECONV_CHANNELS = 4, 256, 3


_step = None  # which this process measures


def prepare(build, *args):
    """Builds and compiles the step of this process; returns the number of parameters."""
    global _step
    num_params, _step = build(*args)
    _step()
    return num_params


def seconds():
    start = time.perf_counter()
    _step()
    return time.perf_counter() - start


def peak_gb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9


def build_jax(network, batch, devices):
    """Number of parameters and step of this package's network; the devices share the batch."""
    from psgn_jax.system.cpu import keep_freed_memory

    keep_freed_memory()
    import jax
    import jax.numpy as jnp
    from jax.sharding import PartitionSpec as P

    jax.config.update("jax_num_cpu_devices", devices)

    from psgn_jax.config.experiment import ModelConfig
    from psgn_jax.models import networks

    model = networks.build(ModelConfig(in_channels=IN_CHANNELS, fc_points=FC_POINTS, **network))
    x = _images(network, batch)
    params = jax.jit(model.init)(jax.random.key(0), x[:1])["params"]

    def loss(params, x):
        points = model.apply({"params": params}, x)
        return jnp.sum(points * jnp.cos(jnp.arange(points.size)).reshape(points.shape))

    mesh = jax.make_mesh((devices,), ("data",), axis_types=(jax.sharding.AxisType.Auto,))
    specs = {"mesh": mesh, "in_specs": (P(), P("data")), "out_specs": P()}

    def gradient(params, x):
        return jax.lax.pmean(jax.grad(loss)(params, x), "data")

    step = jax.jit(jax.shard_map(gradient, check_vma=False, **specs))
    params = jax.device_put(params, jax.NamedSharding(mesh, P()))
    x = jax.device_put(x, jax.NamedSharding(mesh, P("data")))
    num_params = sum(p.size for p in jax.tree.leaves(params))
    return num_params, lambda: jax.block_until_ready(step(params, x))


def build_torch(network, batch, threads):
    """The same for this network in PyTorch."""
    import torch
    from torch_point_out_net import TwoBranch

    torch.set_num_threads(threads)
    net = TwoBranch(IN_CHANNELS, fc_points=FC_POINTS, deconv_channels=DECONV_CHANNELS, **network)
    net = net.to(memory_format=torch.channels_last)
    x = torch.from_numpy(_images(network, batch).transpose(0, 3, 1, 2).copy())
    x = x.to(memory_format=torch.channels_last)
    with torch.no_grad():
        shape = net(x[:1]).shape[1:]
    weights = torch.cos(torch.arange(batch * shape.numel())).reshape(batch, *shape)

    def step():
        net.zero_grad()
        (net(x) * weights).sum().backward()

    return sum(p.numel() for p in net.parameters()), step


def _images(network, batch):
    shape = (batch, *network["image_size"], IN_CHANNELS)
    return np.random.default_rng(0).random(shape, np.float32)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--small", action="store_true", help="the network of authors_small.py")
    parser.add_argument("--repeats", type=int, default=5, help="timed steps of each")
    parser.add_argument("--threads", type=int, default=2, help="of PyTorch, and devices of JAX")
    arguments = parser.parse_args()
    network, batch = (SMALL, 16) if arguments.small else (FULL, 32)
    competitors = {
        "psgn_jax": (build_jax, network, batch, arguments.threads),
        "on one device": (build_jax, network, batch, 1),
        "PyTorch channels last": (build_torch, network, batch, arguments.threads),
    }
    context = multiprocessing.get_context("spawn")
    pools = {name: ProcessPoolExecutor(1, context) for name in competitors}
    sizes = {name: pools[name].submit(prepare, *c).result() for name, c in competitors.items()}
    if len(set(sizes.values())) > 1:
        raise ValueError(f"parameters: got {sizes}, expected the same number in every network")
    print(f"{sizes['psgn_jax']:,} parameters, images {network['image_size']}, batch {batch}")
    times = {name: [] for name in competitors}
    for _ in range(arguments.repeats):
        for name, pool in pools.items():
            times[name].append(pool.submit(seconds).result())
    titles = f"{'fastest':>9}{'median s':>9}{'slowest':>9}{'ratio':>7}{'samples/s':>11}"
    print(f"{'':24}{titles}{'peak GB':>9}")
    # Ratios are computed within a round, because the load of the machine changes between rounds.
    reference = times["PyTorch channels last"]
    for name, own in times.items():
        ratio = statistics.median(t / r for t, r in zip(own, reference, strict=True))
        median, peak = statistics.median(own), pools[name].submit(peak_gb).result()
        print(
            f"{name:24}{min(own):9.3f}{median:9.3f}{max(own):9.3f}{ratio:7.2f}"
            f"{batch / median:11.1f}{peak:9.2f}"
        )
    for pool in pools.values():
        pool.shutdown()


if __name__ == "__main__":
    main()

"""Time of a training step of the two-branch network on a CPU, against PyTorch.

One step is forward and backward with respect to all parameters; the loss is a fixed linear function
of the points, whose cost is negligible. Each implementation runs in a separate process, so that its
peak memory can be measured. They are measured in alternation, so that other work on the machine
affects all of them alike.

    python tests/bench/step.py                  # the full network, batch 32
    python tests/bench/step.py --small          # the half-size network of configs/authors_small.py

Prints seconds per step (the fastest, the median and the slowest), the ratio to PyTorch channels
last (the median over the rounds), samples per second, the latency of one image forward, and the
peak memory of each process. This package is measured with a device of JAX for each core, as `psgn
train` uses them, with one device, and with one device and XLA's convolutions.
"""

import multiprocessing
import os
import resource
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from absl import app, flags

_BATCH = flags.DEFINE_integer("batch", 0, "images in a batch; 0 = 32, or 16 with --small")
_SMALL = flags.DEFINE_bool("small", False, "the network and image size of authors_small.py")
_REPEATS = flags.DEFINE_integer("repeats", 5, "timed steps of each implementation")
_THREADS = flags.DEFINE_integer("threads", 2, "threads of PyTorch, and devices of JAX")

FULL: dict[str, Any] = {
    "image_size": (192, 256),
    "widths": (16, 32, 64, 128, 256, 512, 512),
    "deconv_level": 3,
    "fc_widths": (2048, 1024),
}
SMALL: dict[str, Any] = {
    "image_size": (96, 128),
    "widths": (8, 16, 32, 64, 128, 256),
    "deconv_level": 2,
    "fc_widths": (768, 512),
}
IN_CHANNELS, FC_POINTS, DECONV_CHANNELS = 4, 256, 3


class Competitor:
    """A process that runs a step on request."""

    def __init__(self, build: Callable[..., Any], *args: Any):
        context = multiprocessing.get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, build, args), daemon=True)
        self._process.start()
        theirs.close()  # so that `recv` raises an error if the process has failed
        self.num_params: int = self._pipe.recv()
        self.seconds: list[float] = []

    def ask(self, what: str) -> float:
        """Runs "step" or "latency"; returns seconds. "peak" returns peak memory in bytes."""
        self._pipe.send(what)
        return self._pipe.recv()


def _serve(pipe: Any, build: Callable[..., Any], args: tuple[Any, ...]) -> None:
    runs = build(*args)
    for run in ("step", "latency"):
        runs[run]()  # compiles
    pipe.send(runs["num_params"])
    while True:
        try:
            what = pipe.recv()
        except EOFError:
            return
        if what == "peak":
            pipe.send(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
            continue
        start = time.perf_counter()
        runs[what]()
        pipe.send(time.perf_counter() - start)


def build_jax(
    network: dict[str, Any], batch: int, devices: int, convolutions: str = ""
) -> dict[str, Any]:
    """The step of this package's network.

    Args:
      network: fields of `ModelConfig`.
      batch: number of images.
      devices: number of CPU devices, which share the batch.
      convolutions: value of `PSGN_CONVOLUTIONS`; "" = unset.
    """
    os.environ.pop("PSGN_CONVOLUTIONS", None)
    if convolutions:
        os.environ["PSGN_CONVOLUTIONS"] = convolutions
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

    def loss(params: Any, x: Any) -> Any:
        points = model.apply({"params": params}, x)
        return jnp.sum(points * jnp.cos(jnp.arange(points.size)).reshape(points.shape))

    mesh = jax.make_mesh((devices,), ("data",), axis_types=(jax.sharding.AxisType.Auto,))
    specs = {"mesh": mesh, "in_specs": (P(), P("data")), "out_specs": P()}

    def gradient(params: Any, x: Any) -> Any:
        return jax.lax.pmean(jax.grad(loss)(params, x), "data")

    step = jax.jit(jax.shard_map(gradient, check_vma=False, **specs))
    params = jax.device_put(params, jax.NamedSharding(mesh, P()))
    forward = jax.jit(lambda params, x: model.apply({"params": params}, x))
    x, one = jax.device_put(x, jax.NamedSharding(mesh, P("data"))), jax.device_put(x[:1])
    return {
        "num_params": sum(p.size for p in jax.tree.leaves(params)),
        "step": lambda: jax.block_until_ready(step(params, x)),
        "latency": lambda: jax.block_until_ready(forward(params, one)),
    }


def build_torch(network: dict[str, Any], batch: int, threads: int) -> dict[str, Any]:
    """The step of the same network in PyTorch."""
    import torch
    from torch_point_out_net import TwoBranch

    torch.set_num_threads(threads)
    net = TwoBranch(
        IN_CHANNELS, fc_points=FC_POINTS, deconv_channels=DECONV_CHANNELS, **network
    ).to(memory_format=torch.channels_last)
    x = torch.from_numpy(_images(network, batch).transpose(0, 3, 1, 2).copy())
    x = x.to(memory_format=torch.channels_last)
    with torch.no_grad():
        shape = net(x[:1]).shape[1:]
    weights = torch.cos(torch.arange(batch * shape.numel())).reshape(batch, *shape)

    def step() -> None:
        net.zero_grad()
        (net(x) * weights).sum().backward()

    def latency() -> None:
        with torch.no_grad():
            net(x[:1])

    return {
        "num_params": sum(p.numel() for p in net.parameters()),
        "step": step,
        "latency": latency,
    }


def _images(network: dict[str, Any], batch: int) -> np.ndarray:
    shape = (batch, *network["image_size"], IN_CHANNELS)
    return np.random.default_rng(0).random(shape, np.float32)


def compare(network: dict[str, Any], batch: int) -> None:
    """Prints the table of whole steps."""
    from psgn_jax.models import onednn

    competitors = {
        "psgn_jax": Competitor(build_jax, network, batch, _THREADS.value),
        "on one device": Competitor(build_jax, network, batch, 1),
        "PyTorch channels last": Competitor(build_torch, network, batch, _THREADS.value),
    }
    if onednn.library()[0] is not None:
        competitors["XLA's convolutions"] = Competitor(build_jax, network, batch, 1, "xla")
    sizes = {name: c.num_params for name, c in competitors.items()}
    if len(set(sizes.values())) > 1:
        raise ValueError(f"parameters: got {sizes}, expected the same number in every network")
    print(f"{sizes['psgn_jax']:,} parameters, images {network['image_size']}, batch {batch}")
    for _ in range(_REPEATS.value):
        for competitor in competitors.values():
            competitor.seconds.append(competitor.ask("step"))
    print(
        f"{'':24}{'fastest':>9}{'median s':>9}{'slowest':>9}{'ratio':>7}{'samples/s':>11}", end=""
    )
    print(f"{'1 image':>10}{'peak GB':>9}")
    # Ratios are computed within a round, because the load of the machine changes between rounds.
    reference = competitors["PyTorch channels last"].seconds
    for name, c in competitors.items():
        ratio = statistics.median(t / r for t, r in zip(c.seconds, reference, strict=True))
        latency = min(c.ask("latency") for _ in range(5))
        median = statistics.median(c.seconds)
        print(
            f"{name:24}{min(c.seconds):9.3f}{median:9.3f}{max(c.seconds):9.3f}{ratio:7.2f}"
            f"{batch / median:11.1f}{1e3 * latency:7.1f} ms{c.ask('peak') / 1e9:9.2f}"
        )


def main(argv: list[str]) -> None:
    if len(argv) > 1:
        raise app.UsageError(f"arguments={argv[1:]}: accepted: none")
    network = SMALL if _SMALL.value else FULL
    batch = _BATCH.value or (16 if _SMALL.value else 32)
    compare(network, batch)


if __name__ == "__main__":
    app.run(main)

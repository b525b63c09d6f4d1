"""Time of a training step of the two-branch network on a CPU, against PyTorch.

One step is forward and backward with respect to all parameters; the loss is a fixed linear function
of the points, whose cost is negligible. Each implementation runs in a separate process, so that its
peak memory can be measured. They are measured in alternation, so that other work on the machine
affects all of them alike.

    python tests/bench/step.py                  # the full network, batch 32
    python tests/bench/step.py --small          # the half-size network of configs/authors_small.py
    python tests/bench/step.py --layers         # a table of layers instead
    python tests/bench/step.py --draws          # the cost of Min-of-N instead (batch 4)

Prints seconds per step (the fastest, the median and the slowest), the ratio to PyTorch channels
last (the median over the rounds), samples per second, the latency of one image forward, and the
peak memory of each process. This package is measured with oneDNN, if it is installed, and with its
own convolutions.
"""

import multiprocessing
import os
import resource
import statistics
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from absl import app, flags

_BATCH = flags.DEFINE_integer(
    "batch", 0, "images in a batch; 0 = 32, or 16 with --small, or 4 with --draws"
)
_SMALL = flags.DEFINE_bool("small", False, "the network and image size of authors_small.py")
_REPEATS = flags.DEFINE_integer("repeats", 5, "timed steps of each implementation")
_THREADS = flags.DEFINE_integer("threads", 2, "threads that PyTorch uses")
_LAYERS = flags.DEFINE_bool("layers", False, "time the convolutions one by one instead")
_DRAWS = flags.DEFINE_bool("draws", False, "time steps with Min-of-N against plain ones instead")
_FLOPS = flags.DEFINE_bool("flops", False, "with --draws: count operations, run nothing")
_RETURN_MEMORY = flags.DEFINE_bool(
    "return_memory", True, "also measure this package without `keep_freed_memory`"
)
_DEFAULT_LAYOUT = flags.DEFINE_bool(
    "default_layout", True, "also measure PyTorch with its default layout"
)

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
    network: dict[str, Any], batch: int, keep_memory: bool = True, convolutions: str = ""
) -> dict[str, Any]:
    """The step of this package's network.

    Args:
      network: fields of `ModelConfig`.
      batch: number of images.
      keep_memory: whether to call `keep_freed_memory`.
      convolutions: value of `PSGN_CONVOLUTIONS`; "" = unset.
    """
    os.environ.pop("PSGN_CONVOLUTIONS", None)
    if convolutions:
        os.environ["PSGN_CONVOLUTIONS"] = convolutions
    from psgn_jax.host_memory import keep_freed_memory

    if keep_memory:
        keep_freed_memory()
    import jax
    import jax.numpy as jnp

    from psgn_jax.config import ModelConfig
    from psgn_jax.models import point_out_net

    model = point_out_net.build(
        ModelConfig(in_channels=IN_CHANNELS, fc_points=FC_POINTS, **network)
    )
    x = _images(network, batch)
    params = jax.jit(model.init)(jax.random.key(0), x[:1])["params"]

    def loss(params: Any, x: Any) -> Any:
        points = model.apply({"params": params}, x)
        return jnp.sum(points * jnp.cos(jnp.arange(points.size)).reshape(points.shape))

    step = jax.jit(jax.grad(loss))
    forward = jax.jit(lambda params, x: model.apply({"params": params}, x))
    x, one = jax.device_put(x), jax.device_put(x[:1])
    return {
        "num_params": sum(p.size for p in jax.tree.leaves(params)),
        "step": lambda: jax.block_until_ready(step(params, x)),
        "latency": lambda: jax.block_until_ready(forward(params, one)),
    }


def build_torch(
    network: dict[str, Any], batch: int, threads: int, channels_last: bool
) -> dict[str, Any]:
    """The step of the same network in PyTorch."""
    import torch
    from torch_point_out_net import TwoBranch

    torch.set_num_threads(threads)
    layout = torch.channels_last if channels_last else torch.contiguous_format
    net = TwoBranch(
        IN_CHANNELS, fc_points=FC_POINTS, deconv_channels=DECONV_CHANNELS, **network
    ).to(memory_format=layout)
    x = torch.from_numpy(_images(network, batch).transpose(0, 3, 1, 2).copy())
    x = x.to(memory_format=layout)
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
        "psgn_jax": Competitor(build_jax, network, batch),
        "PyTorch channels last": Competitor(build_torch, network, batch, _THREADS.value, True),
    }
    if onednn.library() is not None:
        competitors["own convolutions"] = Competitor(build_jax, network, batch, True, "jax")
    if _RETURN_MEMORY.value:
        competitors["memory returned"] = Competitor(build_jax, network, batch, False)
    if _DEFAULT_LAYOUT.value:
        competitors["PyTorch default layout"] = Competitor(
            build_torch, network, batch, _THREADS.value, False
        )
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


def layers(network: dict[str, Any]) -> Iterator[tuple[str, int, int, int, int, int, int]]:
    """The convolutions: (kind, height, width, input channels, output channels, kernel, stride)."""
    (h, w), widths, top = network["image_size"], network["widths"], network["deconv_level"]
    last, channels = len(widths) - 1, IN_CHANNELS
    for level, c in enumerate(widths):
        if level:
            size = 5 if level == last else 3
            yield "conv", h >> (level - 1), w >> (level - 1), channels, c, size, 2
        else:
            yield "conv", h, w, channels, c, 3, 1
        channels = c
        if level < last:
            yield "conv", h >> level, w >> level, c, c, 3, 1
    for level in reversed(range(top, last)):
        half = widths[level] // 2
        yield "up", h >> (level + 1), w >> (level + 1), channels, half, 5, 2
        yield "conv", h >> level, w >> level, widths[level], half, 3, 1
        yield "conv", h >> level, w >> level, half, half, 3, 1
        channels = half


def compare_layers(network: dict[str, Any], batch: int) -> None:
    """Prints milliseconds of the three passes of each layer, here and in PyTorch channels last."""
    import jax
    import torch

    from psgn_jax.models import cpu_convolution

    torch.set_num_threads(_THREADS.value)
    rng = np.random.default_rng(0)
    print("milliseconds here / PyTorch channels last, fastest of the repeats")
    print(f"{'':34}{'forward':>16}{'input gradient':>18}{'kernel gradient':>18}")
    for kind, h, w, c_in, c_out, k, s in layers(network):
        function = cpu_convolution.conv2d if kind == "conv" else cpu_convolution.conv2d_transpose
        x = jax.numpy.asarray(rng.standard_normal((batch, h, w, c_in), np.float32))
        kernel = jax.numpy.asarray(rng.standard_normal((k, k, c_in, c_out), np.float32))

        def forward(x: Any, kernel: Any, f: Any = function, s: int = s) -> Any:
            return f(x, kernel, stride=s)

        def backward_x(x: Any, kernel: Any, dy: Any, f: Any = forward) -> Any:
            return jax.vjp(lambda x: f(x, kernel), x)[1](dy)

        def backward_kernel(x: Any, kernel: Any, dy: Any, f: Any = forward) -> Any:
            return jax.vjp(lambda kernel: f(x, kernel), kernel)[1](dy)

        y = jax.jit(forward)(x, kernel)
        ours = [
            _thunk(jax.jit(forward), x, kernel),
            _thunk(jax.jit(backward_x), x, kernel, y),
            _thunk(jax.jit(backward_kernel), x, kernel, y),
        ]
        theirs = _torch_passes(kind, batch, h, w, c_in, c_out, k, s)
        best = np.full((2, 3), np.inf)
        for _ in range(_REPEATS.value + 1):
            for i, runs in enumerate((ours, theirs)):
                for j, run in enumerate(runs):
                    start = time.perf_counter()
                    run()
                    best[i, j] = min(best[i, j], time.perf_counter() - start)
        label = f"{kind} {k}x{k} / {s}, {h}x{w}, {c_in} to {c_out}"
        cells = [f"{1e3 * a:9.1f} /{1e3 * b:6.1f}" for a, b in best.T]
        print(f"{label:34}" + "  ".join(cells), flush=True)


def compare_draws(network: dict[str, Any], batch: int) -> None:
    """Prints the cost of a step with Min-of-N relative to a plain step, for each network.

    "all" computes forward and backward for every sample; "winners" is
    `training.step.min_of_n_loss`. The loss is the CD of 1,024 and 4,096 points. The variants are
    measured in alternation in one process, without oneDNN, whose operations XLA does not count.
    """
    os.environ["PSGN_CONVOLUTIONS"] = "jax"
    import jax
    import jax.numpy as jnp

    from psgn_jax.config import parse
    from psgn_jax.losses import chamfer_sq_mean, map_pairs, min_of_n
    from psgn_jax.models import point_out_net
    from psgn_jax.training import step

    rng = np.random.default_rng(0)
    height, width = network["image_size"]
    data = {
        "image": rng.integers(0, 255, (batch, height, width, 3), np.uint8),
        "mask": rng.random((batch, height, width)) < 0.5,
        "points": rng.normal(0, 0.3, (batch, 4096, 3)).astype(np.float32),
    }
    image = np.zeros((1, height, width, IN_CHANNELS), np.float32)
    one = np.zeros((1, 128), np.float32)
    print(f"Min-of-N relative to a plain step, images {(height, width)}, batch {batch}")
    for name in ("two_branch", "hourglass"):
        fields = {k: v for k, v in network.items() if k != "image_size"}
        config = parse(
            {
                "data": {"image_size": (height, width)},
                "model": {"name": name, "random_size": 128, **fields},
            }
        )
        model = point_out_net.build(config.model)

        def plain(p: Any, b: Any, r: Any, c: Any = config, m: Any = model) -> Any:
            return jnp.mean(map_pairs(chamfer_sq_mean)(step.predict(c, m, p, b, r), b["points"]))

        def every(p: Any, b: Any, r: Any, c: Any = config, m: Any = model) -> Any:
            best = map_pairs(min_of_n(chamfer_sq_mean))(step.predict(c, m, p, b, r), b["points"])
            return jnp.mean(best.value)

        def winners(p: Any, b: Any, r: Any, c: Any = config, m: Any = model) -> Any:
            return step.min_of_n_loss(c, m, chamfer_sq_mean, p, b, r)[0]

        cases = [("plain", plain, 1)]
        cases += [(f"Mo{n}, {how}", f, n) for n in (2, 8) for how, f in
                  (("all", every), ("winners", winners))]  # fmt: skip
        shapes = jax.eval_shape(lambda m=model: m.init(jax.random.key(0), image, one)["params"])
        params = jax.tree.map(lambda s: rng.normal(0, 0.02, s.shape).astype(np.float32), shapes)
        runs, flops = {}, {}
        for label, function, n in cases:
            r = rng.normal(size=(batch, n, 128) if n > 1 else (batch, 128)).astype(np.float32)
            compiled = jax.jit(jax.grad(function)).lower(params, data, r).compile()
            flops[label] = compiled.cost_analysis()["flops"]
            if not _FLOPS.value:
                runs[label] = _thunk(compiled, params, data, r)
                runs[label]()
        best = dict.fromkeys(runs, np.inf)
        for _ in range(_REPEATS.value):
            for label, run in runs.items():
                start = time.perf_counter()
                run()
                best[label] = min(best[label], time.perf_counter() - start)
        for label, _, _ in cases:
            timed = f"{best[label]:8.3f} s{best[label] / best['plain']:7.2f}" if runs else ""
            print(f"{name:12}{label:16}{timed}  operations {flops[label] / flops['plain']:5.2f}",
                  flush=True)  # fmt: skip


def _thunk(function: Callable[..., Any], *args: Any) -> Callable[[], Any]:
    import jax

    return lambda: jax.block_until_ready(function(*args))


def _torch_passes(
    kind: str, batch: int, h: int, w: int, c_in: int, c_out: int, k: int, s: int
) -> list[Callable[[], Any]]:
    import torch

    up = kind == "up"
    x = torch.randn(batch, c_in, h, w).to(memory_format=torch.channels_last)
    shape = (c_in, c_out, k, k) if up else (c_out, c_in, k, k)
    kernel = torch.randn(shape).to(memory_format=torch.channels_last)
    geometry = ([s, s], [k // 2, k // 2], [1, 1], up, [s - 1, s - 1] if up else [0, 0], 1)
    dy = torch.ops.aten.convolution(x, kernel, None, *geometry)
    backward = torch.ops.aten.convolution_backward
    return [
        lambda: torch.ops.aten.convolution(x, kernel, None, *geometry),
        lambda: backward(dy, x, kernel, None, *geometry, [True, False, False]),
        lambda: backward(dy, x, kernel, None, *geometry, [False, True, False]),
    ]


def main(argv: list[str]) -> None:
    if len(argv) > 1:
        raise app.UsageError(f"arguments={argv[1:]}: accepted: none")
    network = SMALL if _SMALL.value else FULL
    if _DRAWS.value:
        compare_draws(network, _BATCH.value or 4)
        return
    batch = _BATCH.value or (16 if _SMALL.value else 32)
    (compare_layers if _LAYERS.value else compare)(network, batch)


if __name__ == "__main__":
    app.run(main)

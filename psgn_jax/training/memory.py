"""Compares, before compilation, the minimum memory of a training with the available memory.

The estimates are lower bounds, so that no training that fits is refused. They include parameters,
gradients and the optimiser's state; the outputs of convolutions and dense layers for one batch,
which the backward pass needs; one batch of samples; and the loader's worker processes.
"""

import contextlib
import math
import pathlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any

import jax
import numpy as np
from jax.extend import core

from psgn_jax.config import CHANNELS_OF, Config, ConfigError
from psgn_jax.data.schema import OCCUPANCY_SIZE
from psgn_jax.training.state import TrainState

WORKER = 150e6
"""Minimum memory of a worker process of the loader, in bytes."""


def check_memory(config: Config, create: Callable[[], TrainState]) -> None:
    """Compares the memory that a training needs with that of the machine and of its devices.

    Args:
      config: configuration of the training.
      create: creates the initial state by applying the network to one sample.

    Raises:
      ConfigError: the training needs more memory than is available; the message lists the parts.
    """
    program, state = jax.make_jaxpr(create, return_shape=True)()
    params = _bytes(jax.tree.leaves(state.params))
    device = {
        "parameters and optimiser": _bytes(jax.tree.leaves(state)) + params,
        f"activations of train.batch_size={config.train.batch_size}": (
            config.train.batch_size / jax.device_count() * _bytes(_layers(program.jaxpr))
        ),
    }
    host = {
        f"batches of {max(config.train.batch_size, config.eval.batch_size)} samples": (
            max(
                config.train.batch_size / jax.process_count() * _sample(config, train=True),
                config.eval.batch_size * _sample(config, train=False),
            )
        ),
        f"data.num_workers={config.data.num_workers}": config.data.num_workers * WORKER,
    }
    statistics = jax.local_devices()[0].memory_stats() or {}
    if "bytes_limit" in statistics:
        _require(device, statistics["bytes_limit"], f"the {jax.default_backend()}")
        _require(host, available(), "this machine")
    else:
        _require(device | host, available(), "this machine")


def available(root: pathlib.Path = pathlib.Path("/")) -> float:
    """Bytes that this process may still use, limited by the machine and by its control groups.

    Infinite if the system does not report it.

    Args:
      root: folder that contains `proc` and `sys`.
    """
    limits = [math.inf]
    with contextlib.suppress(OSError, ValueError, IndexError):
        lines = (root / "proc/meminfo").read_text().splitlines()
        limits += [1024.0 * int(x.split()[1]) for x in lines if x.startswith("MemAvailable:")]
    groups = [""]
    with contextlib.suppress(OSError):
        text = (root / "proc/self/cgroup").read_text()
        groups += [line.rpartition(":")[2].lstrip("/") for line in text.splitlines()]
    for group in groups:
        for folder, limit, used in (
            (root / "sys/fs/cgroup" / group, "memory.max", "memory.current"),
            (
                root / "sys/fs/cgroup/memory" / group,
                "memory.limit_in_bytes",
                "memory.usage_in_bytes",
            ),
        ):
            # A group without a limit has the text "max".
            with contextlib.suppress(OSError, ValueError):
                total, taken = (int((folder / name).read_text()) for name in (limit, used))
                cached = _reclaimable(folder / "memory.stat")
                limits.append(float(total - taken + cached))
    return max(0.0, min(limits))


def _reclaimable(path: pathlib.Path) -> int:
    """Bytes of a group's file cache; the system frees them when memory is needed."""
    fields = dict(line.split() for line in path.read_text().splitlines())
    return sum(int(fields.get(name, 0)) for name in ("inactive_file", "active_file"))


def _require(parts: Mapping[str, float], limit: float, where: str) -> None:
    if sum(parts.values()) <= limit:
        return
    listed = ", ".join(f"{name}: {size / 1e9:.3g} GB" for name, size in parts.items() if size)
    raise ConfigError(
        f"{where} has {limit / 1e9:.3g} GB of memory available, and the training needs at least "
        f"{sum(parts.values()) / 1e9:.3g} GB ({listed}); accepted: a smaller network or smaller "
        "batches"
    )


def _layers(jaxpr: Any) -> Iterator[Any]:
    """Outputs of the convolutions (XLA's or oneDNN's) and matrix products in a program."""
    for equation in jaxpr.eqns:
        if equation.primitive.name in ("conv_general_dilated", "dot_general", "buffer_callback"):
            yield from (out.aval for out in equation.outvars)
        for inner in core.jaxprs_in_params(equation.params):
            yield from _layers(inner)


def _bytes(arrays: Iterable[Any]) -> float:
    return float(sum(math.prod(a.shape) * np.dtype(a.dtype).itemsize for a in arrays))


def _sample(config: Config, *, train: bool) -> float:
    """Bytes of one sample of a batch in the host's memory."""
    data = config.data
    views = (data.train_views if train else data.eval_views) or 1
    pixels = data.image_size[0] * data.image_size[1]
    channels = CHANNELS_OF["rgb"] + 1 + 4 * ("depth" in data.inputs)
    points = data.num_points if train else data.num_eval_points
    occupancy = OCCUPANCY_SIZE**3 if data.occupancy else 0
    return float(views * pixels * channels + 12 * points + occupancy)

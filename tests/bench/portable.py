"""Time of one image: ONNX and StableHLO files in their runtimes, compared with this package.

    python tests/bench/portable.py --workdir=RUN [--threads=2]

All runtimes are called in alternation, with one image at a time. The command prints milliseconds of
wall-clock time (the median and the fastest) and of CPU time for each, and the largest difference of
a coordinate from this package. JAX uses one thread per core of the machine; to use fewer, run the
command under `taskset`.
"""

import statistics
import time
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from absl import app, flags

from psgn_jax.portable import check, folder, runtime
from psgn_jax.portable.network import PortableNetwork
from psgn_jax.prediction.predictor import Predictor
from psgn_jax.weights.opening import open_network

_WORKDIR = flags.DEFINE_string("workdir", None, "folder of a run")
_WEIGHTS = flags.DEFINE_string("weights", None, "name or file of weights")
_THREADS = flags.DEFINE_integer("threads", 2, "threads of onnxruntime")
_REPEATS = flags.DEFINE_integer("repeats", 30, "calls of each")


def main(argv: Sequence[str]) -> None:
    """Prints the table."""
    run = open_network(_WORKDIR.value, _WEIGHTS.value)
    network = PortableNetwork.from_run(run)
    samples = check.drawn_samples(network, 1)
    arrays = samples.inputs
    own = Predictor.from_run(run)
    program = jax.export.deserialize(bytearray(network.stablehlo()))
    call = jax.jit(program.call)
    random = arrays.get("r")

    def ours() -> Any:
        return own._network(own._params, arrays["image"], arrays["mask"], random)

    calls: dict[str, Callable[[], Any]] = {
        "this package": ours,
        "XLA's convolutions": lambda: network.compiled(*arrays.values()),
        "StableHLO": lambda: call(*arrays.values()),
    }
    for stored in folder.ONNX_NAMES:
        session = runtime.Session(folder.onnx_content(network, stored, {}), _THREADS.value)
        calls[f"ONNX, {stored}"] = lambda session=session: session(arrays)
    expected = np.asarray(ours()).reshape(-1, 3)
    wall: dict[str, list[float]] = {name: [] for name in calls}
    cpu = dict.fromkeys(calls, 0.0)
    difference = {
        name: np.abs(np.asarray(function()).reshape(-1, 3) - expected).max()
        for name, function in calls.items()
    }
    for _ in range(_REPEATS.value):
        for name, function in calls.items():
            begin, used = time.perf_counter(), time.process_time()
            np.asarray(function())
            wall[name].append(1000 * (time.perf_counter() - begin))
            cpu[name] += 1000 * (time.process_time() - used)
    for name, times in wall.items():
        print(
            f"{name:20} {statistics.median(times):7.1f} {min(times):7.1f} ms, "
            f"CPU {cpu[name] / _REPEATS.value:6.1f} ms, difference {difference[name]:.1e}"
        )


if __name__ == "__main__":
    app.run(main)

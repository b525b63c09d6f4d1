"""What a run trains and measures; `tasks.create` makes the task of a configuration."""

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

from psgn_jax.array_types import Array
from psgn_jax.config.experiment import Config
from psgn_jax.evaluation.results import Evaluation
from psgn_jax.evaluation.split import evaluate_split
from psgn_jax.system.cpu import compiler_options

Batch = Mapping[str, Any]
Metrics = dict[str, Array]
Result = tuple[Array, Metrics]


class Task:
    """A network with its loss and its metrics; `keys` are the arrays of a batch that it needs."""

    title: str  # name of the network, for the log
    frozen: Any = ()  # parameters of other networks, which loss and metrics read

    def __init__(self, config: Config, keys: Sequence[str]) -> None:
        self.config, self.keys = config, tuple(keys)

    def init_params(self) -> Any:
        """Initial parameters, which depend on the seed; it can run inside `jit`."""
        raise NotImplementedError

    def latents(self, step: Array | int, batch_size: int, *, train: bool) -> dict[str, Array]:
        """Random inputs of a step or of an evaluation batch, one row per sample."""
        return {}

    def total_loss(self, frozen: Any, params: Any, batch: Batch, step: Array) -> Result:
        """The value to minimise, and metrics; `loss` is the value without regularisation.

        `batch` includes the `latents`.
        """
        raise NotImplementedError

    def measure(self, frozen: Any, params: Any, batch: Batch) -> Result:
        """Predictions and metrics, with a row for each sample of a batch with `latents`."""
        raise NotImplementedError

    @functools.cached_property
    def eval_step(self) -> Callable[[Any, Batch, int], Any]:
        """`measure`, compiled: (params, batch on the host, index of the batch) -> its results.

        This process's devices share the batch if their number divides it; otherwise one computes.
        """
        devices, size = jax.local_devices(), self.config.eval.batch_size
        mesh = Mesh(np.asarray(devices[: 1 if size % len(devices) else None]), ("data",))
        everywhere, split = NamedSharding(mesh, P()), NamedSharding(mesh, P("data"))
        specs: Any = {"in_specs": (P(), P(), P("data")), "out_specs": P("data")}
        sharded = jax.shard_map(self.measure, mesh=mesh, check_vma=False, **specs)

        def step(frozen: Any, params: Any, batch: Batch, index: Any) -> Any:
            drawn = self.latents(index, size, train=False)
            return sharded(frozen, params, {**batch, **drawn})

        compiled = jax.jit(step, compiler_options=compiler_options())
        frozen = jax.device_put(self.frozen, everywhere)

        def run(params: Any, batch: Batch, index: int) -> Any:
            # Training may use more devices. Batches have `visible` only if the records have depth.
            params = jax.device_put(params, everywhere)
            arrays = {key: batch[key] for key in (*self.keys, "visible") if key in batch}
            return compiled(frozen, params, jax.device_put(arrays, split), np.int32(index))

        return run

    def evaluate(
        self, params: Any, *, chosen: Any = None, draws: int = 0, **options: Any
    ) -> Evaluation:
        """Metrics by `evaluate_split` with `options`, and of `draws` more clouds per image.

        `chosen` are thresholds of an earlier evaluation; others are chosen on this split.
        """
        return evaluate_split(self.config, params, self.eval_step, **options)

    def picture(self, params: Any) -> np.ndarray | None:
        """Some predictions, uint8 [h, w, 3], or None."""
        return None

    def keep_sources(self) -> None:
        """Copies the runs that this run reads into its folder."""

"""What a run trains and measures; `tasks.create` makes the task of a configuration."""

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jax.tree_util import Partial

from psgn_jax.array_types import Array
from psgn_jax.config.experiment import Config
from psgn_jax.evaluation.results import Evaluation
from psgn_jax.evaluation.split import compile_measure, evaluate_split

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
    def eval_step(self) -> Callable[[Any, Any, int], Any]:
        """`measure`, compiled by `evaluation.split.compile_measure`."""
        measure = Partial(self.measure, self.frozen)
        return compile_measure(measure, self.latents, self.keys, self.config.eval.batch_size)

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

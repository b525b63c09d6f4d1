"""Base class of the tasks: what a run trains and measures. `tasks.create` creates a task."""

import functools
import os
import pathlib
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jax.tree_util import Partial

from psgn_jax.array_types import Array
from psgn_jax.config.experiment import Config
from psgn_jax.evaluation.results import Evaluation
from psgn_jax.evaluation.split import OnBatch, compile_measure, evaluate_split

Batch = Mapping[str, Any]


class Task:
    """The task of one run.

    A subclass sets `title` and `keys` and defines `init_params`, `_loss` and `_measure`.

    Attributes:
      config: configuration of the run.
      title: name of the network, for the log.
      keys: keys of the arrays of a batch that the device needs.
      frozen: arrays that `_loss` and `_measure` read but training does not change, such as the
        parameters of other networks.
    """

    title: str
    keys: tuple[str, ...]

    def __init__(self, config: Config, workdir: str | os.PathLike[str]) -> None:
        self.config, self.workdir = config, pathlib.Path(workdir)
        self.frozen: Any = ()

    def init_params(self) -> Any:
        """Initial parameters, a function of the seed. It can run inside jit."""
        raise NotImplementedError

    def _loss(
        self, frozen: Any, params: Any, batch: Batch, step: Array
    ) -> tuple[Array, dict[str, Array]]:
        """The value to be minimised on a batch, and metrics.

        The metric `loss_step` is the value without regularisation terms.
        """
        raise NotImplementedError

    def _measure(self, frozen: Any, params: Any, batch: Batch) -> tuple[Array, dict[str, Array]]:
        """Predictions and metrics [B] or, if a threshold is to be chosen, [B, thresholds]."""
        raise NotImplementedError

    def random_columns(
        self, step: Array | int, batch_size: int, *, train: bool
    ) -> dict[str, Array]:
        """Random inputs of a training step (or of a batch of an evaluation), a row per sample."""
        return {}

    def objective(self) -> Callable[[Any, Batch, Array], tuple[Array, dict[str, Array]]]:
        """(params, batch, step) -> (value to be minimised, metrics).

        The batch includes `random_columns`. The function is a pytree with the leaves `frozen`.

        Raises:
          ConfigError: the loss does not fit the network.
        """
        return Partial(self._loss, self.frozen)

    def keep_sources(self) -> None:
        """Copies other runs that this run reads into its folder, so that they may be deleted."""

    @functools.cached_property
    def eval_step(self) -> Callable[..., Any]:
        """(params, batch on the host, its index) -> (predictions, metrics), compiled."""
        measure = Partial(self._measure, self.frozen)
        columns = functools.partial(self.random_columns, train=False)
        return compile_measure(measure, columns, self.keys, self.config.eval.batch_size)

    def evaluate(
        self,
        params: Any,
        *,
        split: str | None = None,
        max_samples: int = 0,
        on_batch: OnBatch | None = None,
        chosen: Mapping[str, float] | None = None,
        draws: int = 0,
    ) -> Evaluation:
        """Metrics on a split, as `evaluation.split.evaluate_split` measures them.

        `chosen` are thresholds from `Evaluation.chosen` of an earlier evaluation; missing ones are
        chosen on this split. `draws` is the number of predictions per image whose distances are
        measured too; 0 = none. It is only for the task "points".
        """
        return evaluate_split(
            self.config,
            params,
            self.eval_step,
            split=split,
            max_samples=max_samples,
            on_batch=on_batch,
        )

    def picture(self, params: Any) -> np.ndarray | None:
        """An image of some predictions, uint8 [h, w, 3], or None."""
        return None

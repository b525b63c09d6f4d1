"""The interface of a task: what a run trains and measures. `tasks.create` creates a task.

`training.loop.train` and `tasks.runs.evaluate_run` use only the attributes and methods below. A
task defines which arrays of a batch go to the device, the initial parameters, the objective and the
metrics.
"""

from collections.abc import Callable, Mapping
from typing import Any, Protocol

import numpy as np
import optax
from jax.sharding import Mesh

from psgn_jax.metrics.evaluation import Evaluation
from psgn_jax.training.state import TrainState
from psgn_jax.training.step import Batch
from psgn_jax.types import Array


class Task(Protocol):
    """The task of one run, created from its configuration and its folder.

    Attributes:
      title: name of the network, for the log.
      keys: keys of the arrays of a training batch that the device needs.
    """

    title: str
    keys: tuple[str, ...]

    def check(self) -> None:
        """Raises `ConfigError` if the configuration cannot be trained; called before training."""

    def keep_sources(self) -> None:
        """Copies the runs that this run reads into its folder, so that they may be deleted."""

    def create(self, tx: optax.GradientTransformation) -> TrainState:
        """The state before the first step. A pure function that can run inside jit."""

    def train_step(
        self, tx: optax.GradientTransformation, mesh: Mesh
    ) -> Callable[[TrainState, Batch], tuple[TrainState, dict[str, Array]]]:
        """The compiled training step, described in `training.step.compile_train_step`."""

    def evaluate(
        self,
        params: Any,
        *,
        split: str | None = None,
        max_samples: int = 0,
        on_batch: Callable[[int, Any, np.ndarray], None] | None = None,
        chosen: Mapping[str, float] | None = None,
    ) -> Evaluation:
        """Computes metrics on a split with `training.evaluation.evaluate_split`.

        Args:
          params: parameters of the network.
          split: name of the split; None: the evaluation split.
          max_samples: evaluate only this many samples, from the start of the split; 0 = all.
          on_batch: called with (index of the batch, batch, predictions).
          chosen: thresholds from `Evaluation.chosen` of an earlier evaluation. Missing thresholds
            are chosen on this split.
        """

    def picture(self, params: Any) -> np.ndarray | None:
        """An image of some predictions, uint8 [h, w, 3], or None."""

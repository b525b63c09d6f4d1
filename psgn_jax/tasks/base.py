"""The interface of a task: what a run trains and measures. `tasks.create` makes the one named.

`training.loop.train` and `tasks.runs.evaluate_run` know a task by the methods below alone: what
of a batch goes to the device, how parameters begin, what is minimised, what is measured.
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
    """One run's task, made of its configuration and its folder.

    Attributes:
      title: of the network, for the log.
      keys: of a training batch that the device needs.
    """

    title: str
    keys: tuple[str, ...]

    def check(self) -> None:
        """Raises `ConfigError` if the configuration cannot be trained; before anything is."""

    def keep_sources(self) -> None:
        """Copies into the run's folder what other runs it reads, so that it stands alone."""

    def create(self, tx: optax.GradientTransformation) -> TrainState:
        """The state before the first step. Pure, to be run inside jit."""

    def train_step(
        self, tx: optax.GradientTransformation, mesh: Mesh
    ) -> Callable[[TrainState, Batch], tuple[TrainState, dict[str, Array]]]:
        """The compiled step, see `training.step.compile_train_step`."""

    def evaluate(
        self,
        params: Any,
        *,
        split: str | None = None,
        max_samples: int = 0,
        on_batch: Callable[[int, Any, np.ndarray], None] | None = None,
        chosen: Mapping[str, float] | None = None,
    ) -> Evaluation:
        """Metrics on a split, see `training.evaluation.evaluate_split`.

        Args:
          params: of the network.
          split: default the evaluation split.
          max_samples: only the first so many; 0 = all.
          on_batch: called with (index of the batch, batch, predictions).
          chosen: from an earlier evaluation's `Evaluation.chosen`; what is missing is chosen anew,
            on this split.
        """

    def picture(self, params: Any) -> np.ndarray | None:
        """Some predictions, uint8 [h, w, 3], or None."""

"""Base class of the tasks on solid volumes: training step, evaluation and thresholds.

The ground truth is the occupancy in the records, a 32^3 grid in the frame of the image. IoU is
defined in `losses.iou`. A cell counts as occupied if its probability reaches a threshold. Of the
thresholds .05, .10, ..., .95, the one with the best mean IoU on the split that is evaluated during
training is chosen. Later evaluations, on any split, use the same threshold.
"""

import dataclasses
import functools
import pathlib
from collections.abc import Callable, Mapping
from typing import Any, cast

import numpy as np
import optax
from flax import linen as nn
from jax.sharding import Mesh

from psgn_jax.config import Config
from psgn_jax.data.schema import OCCUPANCY_SIZE
from psgn_jax.losses.iou import PREDICTION_THRESHOLDS
from psgn_jax.metrics.evaluation import Evaluation
from psgn_jax.training import evaluation
from psgn_jax.training import state as state_lib
from psgn_jax.training import step as step_lib
from psgn_jax.types import Array

GRID = (OCCUPANCY_SIZE,) * 3
THRESHOLD_OF = "threshold_of_"
"""`THRESHOLD_OF` + the name of a metric is the key of the threshold chosen for that metric."""


def apply(model: nn.Module, params: Any, *inputs: Any) -> Array:
    """Applies `model` with parameters `params`."""
    return cast(Array, model.apply({"params": params}, *inputs))


class VoxelTask:
    """Base class of the tasks on solid volumes; the interface is `tasks.base.Task`."""

    title: str
    metric: str = ""
    """Name of the IoU that decides which checkpoint is the best."""

    def __init__(self, config: Config, workdir: pathlib.Path) -> None:
        self._config, self._workdir = config, workdir
        depth = ("depth", "extrinsics") if "depth" in config.data.inputs else ()
        self.keys: tuple[str, ...] = ("image", "mask", *depth, "occupancy")
        self._frozen: dict[str, Any] = {}

    # Methods that a task implements.

    def _init(self, key: Array) -> Any:
        raise NotImplementedError

    def _loss(self, params: Any, frozen: Any, batch: step_lib.Batch, latents: Any) -> Array:
        raise NotImplementedError

    def _measure(
        self, params: Any, frozen: Any, batch: step_lib.Batch, latents: Any
    ) -> tuple[Array, dict[str, Array]]:
        """Returns predictions, and metrics [B], or [B, thresholds] if a threshold is chosen."""
        raise NotImplementedError

    def _sample_latents(self, index: Array | int, batch_size: int) -> Any:
        return None

    # The interface of `Task`.

    def check(self) -> None:
        """Does nothing: `config.parse` checks everything."""

    def keep_sources(self) -> None:
        """Does nothing: no other runs are read."""

    def create(self, tx: optax.GradientTransformation) -> state_lib.TrainState:
        """The state before the first step."""
        params = self._init(state_lib.init_key(self._config))["params"]
        return state_lib.fresh(self._config, params, tx)

    def train_step(
        self, tx: optax.GradientTransformation, mesh: Mesh
    ) -> Callable[
        [state_lib.TrainState, step_lib.Batch], tuple[state_lib.TrainState, dict[str, Array]]
    ]:
        """The compiled training step with the loss of the task."""

        def objective(
            params: Any, frozen: Any, batch: step_lib.Batch, latents: Any, _: Any
        ) -> tuple[Array, dict[str, Array]]:
            value = self._loss(params, frozen, batch, latents)
            return value, {"loss_step": value}

        def sample_latents(step: Array) -> tuple[Any, None]:
            return self._sample_latents(step, self._config.train.batch_size), None

        return step_lib.compile_train_step(
            self._config, objective, tx, mesh, frozen=self._frozen, sample_latents=sample_latents
        )

    @functools.cached_property
    def _eval_step(self) -> Callable[..., Any]:
        def make(mesh: Mesh) -> Callable[..., Any]:
            return step_lib.compile_eval_step(
                self._measure, mesh, frozen=self._frozen, sample_latents=self._sample_latents
            )

        return evaluation.over_devices(self._config, self.keys, make)

    def evaluate(
        self,
        params: Any,
        *,
        split: str | None = None,
        max_samples: int = 0,
        on_batch: Callable[[int, Any, np.ndarray], None] | None = None,
        chosen: Mapping[str, float] | None = None,
    ) -> Evaluation:
        """Metrics on a split, at the thresholds in `chosen` or the best ones on this split."""
        measured = evaluation.evaluate_split(
            self._config,
            params,
            self._eval_step,
            split=split,
            max_samples=max_samples,
            on_batch=on_batch,
        )
        return at_thresholds(measured, chosen or {}, best=self.metric)

    def picture(self, params: Any) -> None:
        """Returns None: there is no image of predictions."""


def at_thresholds(
    measured: Evaluation, chosen: Mapping[str, float], *, best: str = ""
) -> Evaluation:
    """Replaces the sweeps [samples, thresholds] of an evaluation by the values at one threshold.

    Args:
      measured: the evaluation with sweeps.
      chosen: `{"threshold_of_iou": .4, ...}` from an earlier evaluation. A threshold that is
        missing there is chosen here: the one with the best mean over the samples.
      best: name of the metric for which `one_minus_iou` is added.
    """
    metrics: dict[str, np.ndarray] = {}
    taken: dict[str, float] = {}
    fresh = []
    for name, values in measured.metrics.items():
        if values.ndim == 1:
            metrics[name] = values
            continue
        key = THRESHOLD_OF + name
        if key in chosen:
            column = int(np.argmin(np.abs(np.array(PREDICTION_THRESHOLDS) - chosen[key])))
        else:
            column = int(np.argmax(values.mean(axis=0)))
            fresh.append(name)
        metrics[name] = values[:, column]
        taken[key] = PREDICTION_THRESHOLDS[column]
    if best in metrics:
        metrics["one_minus_iou"] = 1 - metrics[best]
    where = "on this split" if fresh else "on the split that was evaluated during training"
    text = ", ".join(f"{k.removeprefix(THRESHOLD_OF)} {v:g}" for k, v in taken.items())
    note = (
        f"IoU of {OCCUPANCY_SIZE}^3 solid volumes; thresholds, chosen {where}: {text}."
        if taken
        else "Natural logarithms of volumes in radius^3."
    )
    return dataclasses.replace(measured, metrics=metrics, note=note, chosen=taken)

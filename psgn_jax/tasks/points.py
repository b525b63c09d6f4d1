"""The task "points": a cloud from an image, the paper's networks and losses."""

import functools
import pathlib
from collections.abc import Callable, Mapping
from typing import Any

import jax
import numpy as np
import optax
from flax import linen as nn
from jax.sharding import Mesh

from psgn_jax import evaluate as evaluate_lib
from psgn_jax import registry
from psgn_jax.config import Config, ConfigError
from psgn_jax.training import state as state_lib
from psgn_jax.training import step as step_lib
from psgn_jax.types import Array
from psgn_jax.viewing.clouds import draw_cases


class Points:
    """See `tasks.Task`."""

    def __init__(self, config: Config, workdir: pathlib.Path) -> None:
        self._config = config
        self._model = registry.build_model(config.model)
        self.title = config.model.name
        self.keys = step_lib.input_keys(config)

    @functools.cached_property
    def _eval_step(self) -> Callable[..., Any]:
        return evaluate_lib.make_step(self._config, self._model)

    def check(self) -> None:
        """As `Task.check`."""
        _check_loss(self._config, self._model, registry.loss(self._config.loss))

    def keep_sources(self) -> None:
        """There are none."""

    def create(self, tx: optax.GradientTransformation) -> state_lib.TrainState:
        """As `Task.create`."""
        return state_lib.create(self._config, self._model, tx)

    def train_step(
        self, tx: optax.GradientTransformation, mesh: Mesh
    ) -> Callable[
        [state_lib.TrainState, step_lib.Batch], tuple[state_lib.TrainState, dict[str, Array]]
    ]:
        """`training.step.make_train_step`."""
        loss = registry.loss(self._config.loss)
        return step_lib.make_train_step(self._config, self._model, loss, tx, mesh)

    def evaluate(
        self,
        params: Any,
        *,
        split: str | None = None,
        max_samples: int = 0,
        on_batch: Callable[[int, Any, np.ndarray], None] | None = None,
        chosen: Mapping[str, float] | None = None,
        draws: int = 0,
    ) -> evaluate_lib.Evaluation:
        """As `Task.evaluate`; nothing is chosen. With `draws` see `evaluate.with_draws`."""
        eval_step = self._eval_step
        if draws:
            eval_step = evaluate_lib.with_draws(self._config, self._model, eval_step, draws)
        return evaluate_lib.evaluate(
            self._config,
            params,
            split=split,
            max_samples=max_samples,
            eval_step=eval_step,
            on_batch=on_batch,
        )

    def picture(self, params: Any) -> np.ndarray:
        """Predictions of the first evaluation samples beside the truth."""
        config = self._config
        batches = registry.data_source().eval_batches(
            config.data,
            split=config.data.eval_split,
            batch_size=config.eval.batch_size,
            seed=config.seed,
            visible_tolerance=config.eval.visible_tolerance,
        )
        batch = next(iter(batches))
        points, _ = self._eval_step(params, batch, 0)
        shown = np.flatnonzero(batch["valid"])[: config.train.num_images]
        return draw_cases(batch, np.asarray(points), shown.tolist())


def _check_loss(config: Config, model: nn.Module, loss: step_lib.PairFunction) -> None:
    """Raises `ConfigError` if the loss does not take the network's points and the ground truth's.

    An EMD wants as many of one as of the other.
    """
    height, width = config.model.image_size
    image = jax.ShapeDtypeStruct((1, height, width, config.model.in_channels), np.float32)
    size = config.model.random_size
    r = jax.ShapeDtypeStruct((1, size), np.float32) if size else None
    pred, _ = jax.eval_shape(lambda x, r: model.init_with_output(jax.random.key(0), x, r), image, r)
    gt = jax.ShapeDtypeStruct((config.data.num_points, 3), np.float32)
    try:
        jax.eval_shape(loss, jax.ShapeDtypeStruct(pred.shape[1:], pred.dtype), gt)
    except ValueError as error:
        raise ConfigError(
            f"loss.name={config.loss.name!r} with data.num_points={config.data.num_points} and a "
            f"network of {pred.shape[1]} points: {error}"
        ) from error

"""The task "points": predicts a cloud from an image, with the paper's networks and losses."""

import functools
import pathlib
from collections.abc import Callable, Mapping
from typing import Any

import jax
import numpy as np
import optax
from flax import linen as nn
from jax.sharding import Mesh

from psgn_jax.config import Config, ConfigError
from psgn_jax.data import loader
from psgn_jax.losses.by_name import configured_loss, configured_terms
from psgn_jax.losses.chamfer import chamfer_sq_mean
from psgn_jax.losses.distances import map_pairs
from psgn_jax.metrics import clouds as metrics_lib
from psgn_jax.metrics import samples as sample_metrics
from psgn_jax.metrics.aligned import aligned_metrics
from psgn_jax.metrics.evaluation import Evaluation
from psgn_jax.models import point_out_net
from psgn_jax.prediction import sampling
from psgn_jax.training import evaluation
from psgn_jax.training import state as state_lib
from psgn_jax.training import step as step_lib
from psgn_jax.types import Array
from psgn_jax.viewing.clouds import render_cases


class Points:
    """See `tasks.base.Task`."""

    def __init__(self, config: Config, workdir: pathlib.Path) -> None:
        self._config = config
        self._model = point_out_net.build(config.model)
        self.title: str = config.model.name
        self.keys = step_lib.input_keys(config)

    @functools.cached_property
    def _eval_step(self) -> Callable[..., Any]:
        return make_eval_step(self._config, self._model)

    def check(self) -> None:
        """Raises `ConfigError` if the loss cannot compare the network's points with the truth."""
        _check_loss(self._config, self._model)

    def keep_sources(self) -> None:
        """Does nothing: this task reads no other runs."""

    def create(self, tx: optax.GradientTransformation) -> state_lib.TrainState:
        """The state before the first step, see `training.state.create`."""
        return state_lib.create(self._config, self._model, tx)

    def train_step(
        self, tx: optax.GradientTransformation, mesh: Mesh
    ) -> Callable[
        [state_lib.TrainState, step_lib.Batch], tuple[state_lib.TrainState, dict[str, Array]]
    ]:
        """`training.step.make_train_step`."""
        loss = configured_loss(self._config.loss)
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
    ) -> Evaluation:
        """Computes metrics of clouds on a split.

        With `draws`, the metrics of `with_draws` are added. `chosen` is not used, because this task
        has no thresholds to choose.
        """
        eval_step = self._eval_step
        if draws:
            eval_step = with_draws(self._config, self._model, eval_step, draws)
        return evaluation.evaluate_split(
            self._config,
            params,
            eval_step,
            split=split,
            max_samples=max_samples,
            on_batch=on_batch,
        )

    def picture(self, params: Any) -> np.ndarray:
        """An image of the first evaluation samples: predictions beside the true clouds."""
        config = self._config
        batches = loader.eval_batches(
            config.data,
            split=config.data.eval_split,
            batch_size=config.eval.batch_size,
            seed=config.seed,
            visible_tolerance=config.eval.visible_tolerance,
        )
        batch = next(iter(batches))
        points, _ = self._eval_step(params, batch, 0)
        shown = np.flatnonzero(batch["valid"])[: config.train.num_images]
        return render_cases(batch, np.asarray(points), shown.tolist())


def make_eval_step(config: Config, model: Any) -> Callable[..., Any]:
    """The compiled evaluation step, see `training.evaluation.over_devices`."""

    def pair(pred: Any, gt: Any, visible: Any = None) -> Any:
        # If there are fewer true points than predicted ones, no bijection exists and the EMD is
        # left out.
        emd_tolerance = config.eval.emd_tolerance if len(pred) <= len(gt) else 0
        metrics = metrics_lib.evaluate_pair(
            pred,
            gt,
            visible,
            threshold=config.eval.fscore_threshold,
            emd_tolerance=emd_tolerance or None,
        )
        if config.eval.aligned:
            metrics |= aligned_metrics(
                pred,
                gt,
                emd_tolerance=emd_tolerance or None,
                known_emd=metrics.get("emd_radius"),
            )
        return metrics

    return evaluation.over_devices(
        config,
        step_lib.input_keys(config),
        lambda mesh: step_lib.make_eval_step(config, model, pair, mesh),
    )


def with_draws(
    config: Config, model: Any, eval_step: Callable[..., Any], num_draws: int
) -> Callable[..., Any]:
    """An evaluation step that also measures K = `num_draws` draws for each image.

    It adds to the metrics of `eval_step`: best-of-K and mean-of-K of the Chamfer distance, the same
    of the EMD if `eval.emd_tolerance` is set, and `total_mutual_difference_radius2` if K > 1. They
    are defined in `metrics.samples`. The draws are those of `prediction.sampling.predict_samples`
    with the configuration's seed.

    Raises:
      ConfigError: the network has no random input.
    """
    sample = sampling.compile_predict_samples(config, model, num_draws)

    @jax.jit
    def measure(points: Any, gt: Any, mutual: Any) -> dict[str, Any]:
        distances: dict[str, Any] = {"cd_sq_radius2": chamfer_sq_mean}
        if config.eval.emd_tolerance and points.shape[2] <= gt.shape[1]:
            tolerance = config.eval.emd_tolerance
            distances["emd_radius"] = lambda a, b: metrics_lib.emd(a, b, tolerance=tolerance).emd

        def one(draws: Any, gt: Any) -> dict[str, Any]:
            return sample_metrics.summarise_draws(draws, gt, distances)

        metrics = map_pairs(one)(points, gt)
        if num_draws > 1:
            difference = jax.vmap(sample_metrics.total_mutual_difference)
            metrics["total_mutual_difference_radius2"] = difference(mutual)
        return metrics

    def run(params: Any, batch: Any, index: int) -> Any:
        points, values = eval_step(params, batch, index)
        drawn = sample(params, batch, config.seed, index * len(batch["image"]))
        return points, {**values, **measure(drawn.points, batch["points"], drawn.mutual)}

    return run


def _check_loss(config: Config, model: nn.Module) -> None:
    """Raises `ConfigError` if the loss cannot compare the network's points with the ground truth.

    An EMD requires equal numbers of points.
    """
    height, width = config.model.image_size
    image = jax.ShapeDtypeStruct((1, height, width, config.model.in_channels), np.float32)
    size = config.model.random_size
    r = jax.ShapeDtypeStruct((1, size), np.float32) if size else None
    pred, _ = jax.eval_shape(lambda x, r: model.init_with_output(jax.random.key(0), x, r), image, r)
    gt = jax.ShapeDtypeStruct((config.data.num_points, 3), np.float32)
    terms = configured_terms(config.loss)
    for term, loss in terms:
        try:
            jax.eval_shape(loss, jax.ShapeDtypeStruct(pred.shape[1:], pred.dtype), gt)
        except ValueError as error:
            which = f", the term {term.text!r}," if len(terms) > 1 else ""
            raise ConfigError(
                f"loss.name={config.loss.name!r}{which} with data.num_points="
                f"{config.data.num_points} and a network of {pred.shape[1]} points: {error}"
            ) from error

"""The tasks on solid volumes: "volume" and "views"; "refiner" is in `tasks.refiner`.

The ground truth is the occupancy in the records, a 32^3 grid in the frame of the image;
`losses.iou` defines the IoU. A cell is occupied if its probability reaches a threshold. Of .05,
.10, ..., .95, we choose the threshold with the best mean IoU on the split that is evaluated during
training. Later evaluations use it on any split.
"""

import pathlib
from collections.abc import Callable, Mapping
from typing import Any, cast

import jax
import jax.numpy as jnp
from flax import linen as nn
from jax.tree_util import Partial

from psgn_jax.array_types import Array
from psgn_jax.config.experiment import Config
from psgn_jax.evaluation.results import Evaluation, at_thresholds
from psgn_jax.evaluation.split import compile_measure, evaluate_split
from psgn_jax.losses.iou import iou_sweep
from psgn_jax.models import networks, recurrent, volumes
from psgn_jax.tasks.task import Batch, Task, no_latents


def apply(model: nn.Module, params: Any, *inputs: Any) -> Array:
    return cast(Array, model.apply({"params": params}, *inputs))


def voxel_task(
    config: Config,
    title: str,
    init_params: Callable[[], Any],
    total_loss: Partial,
    measure: Partial,
    *,
    best: str = "",
    latents: Callable[..., dict[str, Any]] = no_latents,
    keep_sources: Callable[[], None] = lambda: None,
) -> Task:
    """A task on solid volumes; see `Task` for the other arguments.

    Args:
      measure: maps (params, batch) to predictions and metrics [B] or, for each threshold,
        [B, thresholds].
      best: the metric that decides which checkpoint is the best; "" = none.
    """
    keys = (*(key for key in networks.input_keys(config) if key != "points"), "occupancy")
    eval_step = compile_measure(measure, latents, keys, config.eval.batch_size)

    def evaluate(
        params: Any, *, chosen: Mapping[str, float] | None = None, draws: int = 0, **options: Any
    ) -> Evaluation:
        measured = evaluate_split(config, params, eval_step, **options)
        return at_thresholds(measured, chosen or {}, best=best)

    return Task(
        title=title,
        keys=keys,
        init_params=init_params,
        total_loss=total_loss,
        evaluate=evaluate,
        latents=latents,
        keep_sources=keep_sources,
    )


def volume_task(config: Config, workdir: pathlib.Path) -> Task:
    """Maps an image to the natural logarithm of the object's volume (`models.volumes.VolumeNet`).

    The loss is its squared error, the metric `log_volume_abs_error` its absolute error.
    """
    model, sizes = networks.build_volume_net(config.model), config.model

    def init_params() -> Any:
        image = jnp.zeros((1, *sizes.image_size, sizes.in_channels))
        return model.init(networks.init_key(config), image)["params"]

    def errors(params: Any, batch: Batch) -> tuple[Array, Array]:
        pred = apply(model, params, networks.network_inputs(config.data.inputs, batch))
        return pred, pred - jax.vmap(volumes.log_volume)(batch["occupancy"])

    def total_loss(params: Any, batch: Batch, step: Array) -> tuple[Array, dict[str, Array]]:
        value = jnp.square(errors(params, batch)[1]).mean()
        return value, {"loss": value}

    def measure(params: Any, batch: Batch) -> tuple[Array, dict[str, Array]]:
        pred, error = errors(params, batch)
        return pred[:, None], {"log_volume_abs_error": jnp.abs(error)}

    return voxel_task(config, "volume network", init_params, Partial(total_loss), Partial(measure))


def views_task(config: Config, workdir: pathlib.Path) -> Task:
    """3D-R2N2 (`models.recurrent`): from images to a solid volume, trained by cross-entropy.

    Source: Choy et al., "3D-R2N2", ECCV 2016. **Ours**: like all networks of this project, it
    predicts in the frame of the first view, so it must infer how other views are rotated. The
    original predicts in the frame of the data set, the same for all views.

    Metrics: `iou_1_views`, `iou_3_views`, ..., for each number of views in `voxels.eval_views`.
    `on_batch` of `evaluate` gets the predictions for the first number.
    """
    model, sizes = networks.build_r2n2(config.model, config.voxels), config.model
    names = {count: f"iou_{count}_views" for count in config.voxels.eval_views}

    def init_params() -> Any:
        views = jnp.zeros((1, 1, *sizes.image_size, sizes.in_channels))
        return model.init(networks.init_key(config), views)["params"]

    def total_loss(params: Any, batch: Batch, step: Array) -> tuple[Array, dict[str, Array]]:
        logits = apply(model, params, networks.network_inputs(config.data.inputs, batch))
        value = jax.vmap(recurrent.voxel_cross_entropy)(logits, batch["occupancy"]).mean()
        return value, {"loss": value}

    def measure(params: Any, batch: Batch) -> tuple[Array, dict[str, Array]]:
        seen, metrics, predicted = networks.network_inputs(config.data.inputs, batch), {}, []
        for count, name in names.items():
            predicted.append(recurrent.occupancy(apply(model, params, seen[:, :count])))
            metrics[name] = jax.vmap(iou_sweep)(predicted[-1], batch["occupancy"])
        return predicted[0], metrics

    title = f"3D-R2N2 (widths times {config.voxels.width_multiplier:g})"
    best = next(iter(names.values()))
    return voxel_task(config, title, init_params, Partial(total_loss), Partial(measure), best=best)

"""The tasks on solid volumes: "volume" and "views"; "refiner" is in `tasks.refiner`.

The ground truth is the occupancy in the records, a 32^3 grid in the frame of the image;
`losses.iou` defines the IoU. A cell is occupied if its probability reaches a threshold: of .05,
.10, ..., .95, the one with the best mean IoU on the split that is evaluated during training.
"""

import pathlib
from typing import Any, cast

import jax
import jax.numpy as jnp
from flax import linen as nn

from psgn_jax.array_types import Array
from psgn_jax.config.experiment import Config
from psgn_jax.evaluation.results import Evaluation, at_thresholds
from psgn_jax.losses.iou import iou_sweep
from psgn_jax.models import networks, recurrent, volumes
from psgn_jax.tasks.task import Batch, Metrics, Result, Task


def apply(model: nn.Module, params: Any, *inputs: Any) -> Array:
    return cast(Array, model.apply({"params": params}, *inputs))


class VoxelTask(Task):
    """A task on solid volumes; metrics have a number for each sample or for each threshold."""

    best = ""  # the metric that decides which checkpoint is the best; "" = none

    def __init__(self, config: Config, model: nn.Module) -> None:
        keys = [key for key in networks.input_keys(config) if key != "points"]
        super().__init__(config, [*keys, "occupancy"])
        self.model = model

    def evaluate(self, params: Any, *, chosen: Any = None, **options: Any) -> Evaluation:
        measured = super().evaluate(params, **options)
        return at_thresholds(measured, chosen or {}, best=self.best)

    def init_params(self) -> Any:
        sizes, views = self.config.model, (1,) * bool(self.config.data.eval_views)
        image = jnp.zeros((1, *views, *sizes.image_size, sizes.in_channels))
        return self.model.init(networks.init_key(self.config), image)["params"]

    def seen(self, batch: Batch) -> Array:
        return networks.network_inputs(self.config.data.inputs, batch)


class Volume(VoxelTask):
    """Maps an image to the natural logarithm of the object's volume (`models.volumes.VolumeNet`).

    The loss is its squared error, the metric `log_volume_abs_error` its absolute error.
    """

    title = "volume network"

    def __init__(self, config: Config, workdir: pathlib.Path) -> None:
        super().__init__(config, networks.build_volume_net(config.model))

    def _errors(self, params: Any, batch: Batch) -> tuple[Array, Array]:
        pred = apply(self.model, params, self.seen(batch))
        return pred, pred - jax.vmap(volumes.log_volume)(batch["occupancy"])

    def total_loss(self, frozen: Any, params: Any, batch: Batch, step: Array) -> Result:
        value = jnp.square(self._errors(params, batch)[1]).mean()
        return value, {"loss": value}

    def measure(self, frozen: Any, params: Any, batch: Batch) -> Result:
        pred, error = self._errors(params, batch)
        return pred[:, None], {"log_volume_abs_error": jnp.abs(error)}


class Views(VoxelTask):
    """3D-R2N2 (`models.recurrent`): from images to a solid volume, trained by cross-entropy.

    Source: Choy et al., "3D-R2N2", ECCV 2016. **Ours**: like all networks of this project, it
    predicts in the frame of the first view, so it must infer how other views are rotated. The
    original predicts in the frame of the data set, the same for all views.

    Metrics: `iou_1_views`, `iou_3_views`, ..., for each number of views in `voxels.eval_views`.
    `on_batch` of `evaluate` gets the predictions for the first number.
    """

    def __init__(self, config: Config, workdir: pathlib.Path) -> None:
        super().__init__(config, networks.build_r2n2(config.model, config.voxels))
        self.title = f"3D-R2N2 (widths times {config.voxels.width_multiplier:g})"
        self.names = {count: f"iou_{count}_views" for count in config.voxels.eval_views}
        self.best = next(iter(self.names.values()))

    def total_loss(self, frozen: Any, params: Any, batch: Batch, step: Array) -> Result:
        logits = apply(self.model, params, self.seen(batch))
        value = jax.vmap(recurrent.voxel_cross_entropy)(logits, batch["occupancy"]).mean()
        return value, {"loss": value}

    def measure(self, frozen: Any, params: Any, batch: Batch) -> Result:
        seen, metrics, predicted = self.seen(batch), Metrics(), []
        for count, name in self.names.items():
            predicted.append(recurrent.occupancy(apply(self.model, params, seen[:, :count])))
            metrics[name] = jax.vmap(iou_sweep)(predicted[-1], batch["occupancy"])
        return predicted[0], metrics

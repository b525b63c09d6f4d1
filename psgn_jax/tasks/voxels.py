"""The tasks on solid volumes: "volume" and "views"; "refine" has a module of its own.

The ground truth is the occupancy in the records, a 32^3 grid in the frame of the image. IoU is
defined in `losses.iou`. A cell counts as occupied if its probability reaches a threshold. Of the
thresholds .05, .10, ..., .95, the one with the best mean IoU on the split that is evaluated during
training is chosen. Later evaluations, on any split, use the same threshold.
"""

import os
from collections.abc import Mapping
from typing import Any, cast

import jax
import jax.numpy as jnp
from flax import linen as nn

from psgn_jax.array_types import Array
from psgn_jax.config.experiment import Config
from psgn_jax.data.schema import OCCUPANCY_SIZE
from psgn_jax.evaluation.results import Evaluation, at_thresholds
from psgn_jax.losses.iou import iou_sweep
from psgn_jax.models import networks, r2n2, voxels
from psgn_jax.models.inputs import network_inputs
from psgn_jax.tasks.base import Batch, Task

GRID = (OCCUPANCY_SIZE,) * 3


def apply(model: nn.Module, params: Any, *inputs: Any) -> Array:
    """Applies `model` with parameters `params`."""
    return cast(Array, model.apply({"params": params}, *inputs))


class VoxelTask(Task):
    """Base class of the tasks on solid volumes.

    Attributes:
      metric: name of the IoU that decides which checkpoint is the best; "" = none.
    """

    metric: str = ""

    def __init__(self, config: Config, workdir: str | os.PathLike[str]) -> None:
        super().__init__(config, workdir)
        arrays = (key for key in networks.input_keys(config) if key != "points")
        self.keys = (*arrays, "occupancy")

    def evaluate(
        self, params: Any, *, chosen: Mapping[str, float] | None = None, **options: Any
    ) -> Evaluation:
        """Metrics on a split, at the thresholds in `chosen` or the best ones on this split."""
        return at_thresholds(super().evaluate(params, **options), chosen or {}, best=self.metric)


class Volume(VoxelTask):
    """Maps an image to the logarithm of the object's volume (`models.voxels.VolumeNet`).

    The loss is the squared error of the natural logarithm, the metric `log_volume_abs_error` its
    absolute error.
    """

    def __init__(self, config: Config, workdir: str | os.PathLike[str]) -> None:
        super().__init__(config, workdir)
        self._model = networks.build_volume_net(config.model)
        self.title = "volume network"

    def init_params(self) -> Any:
        """Initial parameters of the network."""
        model = self.config.model
        image = jnp.zeros((1, *model.image_size, model.in_channels))
        return self._model.init(networks.init_key(self.config), image)["params"]

    def _errors(self, params: Any, batch: Batch) -> tuple[Array, Array]:
        pred = apply(self._model, params, network_inputs(self.config.data.inputs, batch))
        return pred, pred - jax.vmap(voxels.log_volume)(batch["occupancy"])

    def _loss(
        self, frozen: Any, params: Any, batch: Batch, step: Array
    ) -> tuple[Array, dict[str, Array]]:
        value = jnp.square(self._errors(params, batch)[1]).mean()
        return value, {"loss_step": value}

    def _measure(self, frozen: Any, params: Any, batch: Batch) -> tuple[Array, dict[str, Array]]:
        pred, error = self._errors(params, batch)
        return pred[:, None], {"log_volume_abs_error": jnp.abs(error)}


class Views(VoxelTask):
    """3D-R2N2 (`models.r2n2`): from one or more images to a solid volume, trained by cross-entropy.

    Source: Choy et al., "3D-R2N2", ECCV 2016. **Ours**: the network predicts in the frame of the
    first view, like all networks of this project. The original predicts in the frame of the data
    set, which is the same for all views. With one view, the input and the frame are those of the
    point networks. With several views the network must infer how the other views are rotated
    relative to the first one.

    Metrics: `iou_1_views`, `iou_3_views`, ..., one for each number of views in `voxels.eval_views`.
    The predictions that `evaluate` passes to `on_batch` are those for the first of these numbers.
    """

    def __init__(self, config: Config, workdir: str | os.PathLike[str]) -> None:
        super().__init__(config, workdir)
        voxels = config.voxels
        self._model = networks.build_r2n2(config.model, voxels)
        self._names = {count: f"iou_{count}_views" for count in voxels.eval_views}
        self.metric = self._names[voxels.eval_views[0]]
        self.title = f"3D-R2N2 (widths times {voxels.width_multiplier:g})"

    def init_params(self) -> Any:
        """Initial parameters of the network."""
        model = self.config.model
        views = jnp.zeros((1, 1, *model.image_size, model.in_channels))
        return self._model.init(networks.init_key(self.config), views)["params"]

    def _loss(
        self, frozen: Any, params: Any, batch: Batch, step: Array
    ) -> tuple[Array, dict[str, Array]]:
        logits = apply(self._model, params, network_inputs(self.config.data.inputs, batch))
        value = jax.vmap(r2n2.voxel_cross_entropy)(logits, batch["occupancy"]).mean()
        return value, {"loss_step": value}

    def _measure(self, frozen: Any, params: Any, batch: Batch) -> tuple[Array, dict[str, Array]]:
        seen, metrics, volumes = network_inputs(self.config.data.inputs, batch), {}, []
        for count, name in self._names.items():
            logits = apply(self._model, params, seen[:, :count])
            volumes.append(r2n2.occupancy(logits))
            metrics[name] = jax.vmap(iou_sweep)(volumes[-1], batch["occupancy"])
        return volumes[0], metrics

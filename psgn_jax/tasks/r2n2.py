"""The task "views": 3D-R2N2, which predicts a solid volume from one or more images.

Source: Choy et al., "3D-R2N2", ECCV 2016.

**Ours**: the network predicts in the frame of the first view, like all networks of this project.
The original predicts in the frame of the data set, which is the same for all views. With one view,
the input and the frame are those of the point networks. With several views the network must infer
how the other views are rotated relative to the first one.
"""

import pathlib
from typing import Any

import jax
import jax.numpy as jnp

from psgn_jax.config import Config
from psgn_jax.losses.iou import iou_sweep
from psgn_jax.models import r2n2
from psgn_jax.models.inputs import network_inputs
from psgn_jax.models.layers import DTYPES
from psgn_jax.tasks.voxels import VoxelTask, apply
from psgn_jax.training import step as step_lib
from psgn_jax.types import Array


class Views(VoxelTask):
    """3D-R2N2 (`models.r2n2`): from one or more images to a volume, trained by cross-entropy.

    Metrics: `iou_1_views`, `iou_3_views`, ..., one for each number of views in `voxels.eval_views`.
    The predictions that `evaluate` passes to `on_batch` are those for the first of these numbers.
    """

    def __init__(self, config: Config, workdir: pathlib.Path) -> None:
        super().__init__(config, workdir)
        voxels = config.voxels
        dtype = DTYPES[config.model.compute_dtype]
        self._model = r2n2.build(voxels.cell, voxels.width_multiplier, dtype)
        self._names = {count: f"iou_{count}_views" for count in voxels.eval_views}
        self.metric = self._names[voxels.eval_views[0]]
        self.title = f"3D-R2N2 ({voxels.cell}, widths times {voxels.width_multiplier:g})"

    def _init(self, key: Array) -> Any:
        model = self._config.model
        return self._model.init(key, jnp.zeros((1, 1, *model.image_size, model.in_channels)))

    def _loss(self, params: Any, frozen: Any, batch: step_lib.Batch, latents: Any) -> Array:
        logits = apply(self._model, params, network_inputs(self._config, batch))
        return jax.vmap(r2n2.voxel_cross_entropy)(logits, batch["occupancy"]).mean()

    def _measure(
        self, params: Any, frozen: Any, batch: step_lib.Batch, latents: Any
    ) -> tuple[Array, dict[str, Array]]:
        seen, metrics, volumes = network_inputs(self._config, batch), {}, []
        for count, name in self._names.items():
            logits = apply(self._model, params, seen[:, :count])
            volumes.append(r2n2.occupancy(logits))
            metrics[name] = jax.vmap(iou_sweep)(volumes[-1], batch["occupancy"])
        return volumes[0], metrics

"""The task "volume": predicts the volume of the object, a number, from an image."""

import pathlib
from typing import Any

import jax
import jax.numpy as jnp

from psgn_jax.config import Config
from psgn_jax.models import voxel_refiner
from psgn_jax.models.inputs import network_inputs
from psgn_jax.tasks.voxels import VoxelTask, apply
from psgn_jax.training import step as step_lib
from psgn_jax.types import Array


class Volume(VoxelTask):
    """Maps an image to the logarithm of the object's volume (`models.voxel_refiner.VolumeNet`).

    The loss is the squared error of the natural logarithm, the metric `log_volume_abs_error` its
    absolute error.
    """

    def __init__(self, config: Config, workdir: pathlib.Path) -> None:
        super().__init__(config, workdir)
        self._model = voxel_refiner.build_volume_net(config.model)
        self.title = "volume network"

    def _init(self, key: Array) -> Any:
        model = self._config.model
        return self._model.init(key, jnp.zeros((1, *model.image_size, model.in_channels)))

    def _errors(self, params: Any, batch: step_lib.Batch) -> tuple[Array, Array]:
        pred = apply(self._model, params, network_inputs(self._config, batch))
        return pred, pred - jax.vmap(voxel_refiner.log_volume)(batch["occupancy"])

    def _loss(self, params: Any, frozen: Any, batch: step_lib.Batch, latents: Any) -> Array:
        return jnp.square(self._errors(params, batch)[1]).mean()

    def _measure(
        self, params: Any, frozen: Any, batch: step_lib.Batch, latents: Any
    ) -> tuple[Array, dict[str, Array]]:
        pred, error = self._errors(params, batch)
        return pred[:, None], {"log_volume_abs_error": jnp.abs(error)}

"""A trained network as one function of arrays, traced for any number of images.

The function, the ONNX graph and the StableHLO program have the same inputs and output:

    image   uint8 [batch, H, W, 3]       RGB, framed by `data.framing`; its background is ignored
    mask    bool [batch, H, W]           True on the object
    r       float32 [batch, draws, k]    random inputs N(0, 1), if the network has a random input
    points  float32 [batch, n, 3]        [batch, draws, n, 3] with r; in the project's frame

The normalisation of colours is part of the function.
"""

import dataclasses
import functools
from typing import Any

import jax
import numpy as np
from jax import export as jax_export

from psgn_jax.config import Config, ConfigError, require_points_task
from psgn_jax.models import convolution_choice, point_layout, point_out_net
from psgn_jax.training import step as step_lib
from psgn_jax.training.run_folder import Run

PLATFORMS = ("cpu", "cuda", "rocm", "tpu")
"""Platforms of the StableHLO program."""


@dataclasses.dataclass(frozen=True)
class Input:
    """An input of the network; a size in `shape` is a number or the name of a symbolic size."""

    name: str
    dtype: str
    shape: tuple[int | str, ...]


@dataclasses.dataclass(frozen=True, eq=False)
class PortableNetwork:
    """A trained network with its inputs.

    Attributes:
      config: configuration of the training, with `compute_dtype` changed to float32.
      params: parameters.
      inputs: `image`, `mask` and, if the network has a random input, `r`.
    """

    config: Config
    params: Any
    inputs: tuple[Input, ...]

    @classmethod
    def from_run(cls, run: Run) -> "PortableNetwork":
        """The network of an opened run, see `weights.opening.open_network`.

        Raises:
          ConfigError: the network does not predict points, or reads depth.
        """
        require_points_task(run.config, "a network for other programs")
        if "depth" in run.config.data.inputs:
            raise ConfigError(
                f"data.inputs={run.config.data.inputs!r}: accepted for export: a network with the "
                "inputs 'rgb' and 'mask'"
            )
        model = dataclasses.replace(run.config.model, compute_dtype="float32")
        config = dataclasses.replace(run.config, model=model)
        height, width = config.data.image_size
        inputs = [
            Input("image", "uint8", ("batch", height, width, 3)),
            Input("mask", "bool", ("batch", height, width)),
        ]
        if model.random_size:
            inputs.append(Input("r", "float32", ("batch", "draws", model.random_size)))
        return cls(config, run.params, tuple(inputs))

    @property
    def num_points(self) -> int:
        """Number of points of a cloud."""
        return point_layout.num_points(self.config.model)

    def __call__(self, image: Any, mask: Any, r: Any = None) -> jax.Array:
        """Predicts `points`, with XLA's own convolutions on every platform."""
        model = point_out_net.build(self.config.model)
        with convolution_choice.plain_convolutions():
            batch = {"image": image, "mask": mask}
            return step_lib.predict(self.config, model, self.params, batch, r)

    @functools.cached_property
    def compiled(self) -> Any:
        """The function, compiled by `jax.jit` in this process."""
        return jax.jit(lambda *arrays: self(*arrays))

    def trace(self) -> Any:
        """The jaxpr of the function, for any number of images and draws."""
        return jax.make_jaxpr(lambda *arrays: self(*arrays))(*self._symbolic())

    def stablehlo(self) -> bytes:
        """The program with its weights, for `jax.export.deserialize`."""
        function = jax.jit(lambda *arrays: self(*arrays))
        return bytes(
            jax_export.export(function, platforms=list(PLATFORMS))(*self._symbolic()).serialize()
        )

    def _symbolic(self) -> list[jax.ShapeDtypeStruct]:
        sizes = dict(
            zip(("batch", "draws"), jax_export.symbolic_shape("batch, draws"), strict=True)
        )
        return [
            jax.ShapeDtypeStruct(
                tuple(sizes[s] if isinstance(s, str) else s for s in item.shape),
                np.dtype(item.dtype),
            )
            for item in self.inputs
        ]

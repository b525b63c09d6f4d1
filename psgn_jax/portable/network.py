"""A trained network as a function of arrays, for any number of images.

The function and the ONNX graph have the same inputs and output:

    image   uint8 [batch, H, W, 3]       RGB, framed by `data.framing`; its background is ignored
    mask    bool [batch, H, W]           True on the object
    r       float32 [batch, draws, k]    random inputs N(0, 1), if the network has a random input
    points  float32 [batch, n, 3]        [batch, draws, n, 3] with r; in the project's frame

The normalisation of colours is part of the function.
"""

import dataclasses
from typing import Any, NamedTuple

import jax

from psgn_jax.config.experiment import Config
from psgn_jax.models import networks
from psgn_jax.models.cpu_convolution import convolutions_for
from psgn_jax.prediction.predictor import require_photos
from psgn_jax.system.errors import UserError
from psgn_jax.weights.run_folder import Trained


class InputSpec(NamedTuple):
    """An input of the network; `shape` has numbers and names of symbolic sizes."""

    name: str
    dtype: str
    shape: tuple[int | str, ...]


class ExportError(UserError):
    """A network cannot be exported, or an exported file computes wrong results."""


class PortableNetwork:
    """A trained network with its inputs; it computes in float32.

    Raises:
      ConfigError: the network does not predict points, or reads depth.
    """

    def __init__(self, run: Trained):
        require_photos(run.config, "an export")
        model = dataclasses.replace(run.config.model, compute_dtype="float32")
        self.config: Config = dataclasses.replace(run.config, model=model)
        self.params, self.num_points = run.params, networks.build(model).num_points
        height, width = run.config.data.image_size
        self.inputs: tuple[InputSpec, ...] = (
            InputSpec("image", "uint8", ("batch", height, width, 3)),
            InputSpec("mask", "bool", ("batch", height, width)),
        )
        if model.random_size:
            self.inputs += (InputSpec("r", "float32", ("batch", "draws", model.random_size)),)

    def __call__(self, image: Any, mask: Any, r: Any = None) -> jax.Array:
        """Predicts `points`, with XLA's own convolutions on every platform."""
        model = networks.build(self.config.model)
        with convolutions_for("export"):
            batch = {"image": image, "mask": mask}
            return networks.predict(self.config, model, self.params, batch, r)

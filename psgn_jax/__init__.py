"""Point set generation networks in JAX: from one image of an object to a cloud of 3D points.

    import psgn_jax

    model = psgn_jax.load()
    cloud = model("chair.jpg")  # mask="chair_mask.png" gives the object's mask
    cloud.points  # float32 [1, n, 3]: +z up, +y image right, +x to the camera
    cloud.save("chair.ply")

`psgn_jax.losses` has the distances. Both are imported at their first use.
"""

from __future__ import annotations

import importlib
import os
import typing

if typing.TYPE_CHECKING:
    from psgn_jax.prediction.predictor import Predictor

__version__ = "0.1.0"


def load(network: str | os.PathLike[str] = "") -> Predictor:
    """Opens a trained network; call the result with an image to predict clouds.

    Args:
      network: the name of weights in the package ("" = the default), a file of weights, or the
        folder of a run (its best checkpoint).

    Raises:
      ConfigError: there is no such network.
      CheckpointError, WeightsError: it cannot be read.
    """
    from psgn_jax.prediction.predictor import Predictor
    from psgn_jax.weights.opening import open_weights

    return Predictor(open_weights(network, argument="network"))


def __getattr__(name: str) -> object:
    if name == "losses":
        return importlib.import_module("psgn_jax.losses")
    raise AttributeError(f"module 'psgn_jax' has no attribute {name!r}")

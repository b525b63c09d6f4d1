"""The mask network's parameters: a file of weights with a format of its own, in the package."""

import json
import os
import pathlib
from typing import Any

import jax
import jax.numpy as jnp

from psgn_jax.models.mask_net import MaskNet
from psgn_jax.weights.file import WeightsError, read_arrays
from psgn_jax.weights.leaves import from_named_leaves

FILE = pathlib.Path(__file__).resolve().parent / "mask.safetensors"
FORMAT = "psgn_jax mask network 1"


def read_mask_network(path: str | os.PathLike[str] = FILE) -> tuple[Any, dict[str, Any]]:
    """The parameters, float32, and `figures` and `sources`; errors: `read_weights`."""
    texts, leaves, _ = read_arrays(path, FORMAT)
    image = jax.ShapeDtypeStruct((1, 32, 32, 3), jnp.float32)
    shapes = {"params": jax.eval_shape(MaskNet().init, jax.random.key(0), image)["params"]}
    try:
        params = from_named_leaves(shapes, leaves)["params"]
    except ValueError as error:
        raise WeightsError(f"{path}: not the parameters of the mask network: {error}") from None
    return params, {name: json.loads(texts[name]) for name in ("figures", "sources")}

"""Weights of a tiny network, made without compiling anything."""

import functools

import jax
import numpy as np

from helpers import standin
from psgn_jax.models import networks
from psgn_jax.models.networks import init_params
from psgn_jax.weights.file import Weights, figures_of

SOURCES = [
    {"source": "chairs", "licences": {"CC-BY-3.0": {"models": 7, "holders": ["Ada", "Bo"]}}},
    {"source": "cars", "licences": {"CC0-1.0": {}}},
]


def config(**changes):
    """The configuration of the tiny network, with changes as in `standin.config`."""
    tiny = {"model__name": "vanilla", "model__widths": (4, 6, 8), "model__random_size": 0}
    return standin.config(**{"loss__l2": "none", **tiny, **changes})


@functools.cache
def _shapes(config):
    return jax.eval_shape(lambda: init_params(config, networks.build(config.model)))


def random_params(config, seed=0):
    """Random parameters of a configuration's network."""
    rng = np.random.default_rng(seed)
    return jax.tree.map(lambda s: rng.normal(0, 0.1, s.shape).astype("f4"), _shapes(config))


def weights(config, dtype="float16"):
    """Weights with metrics and sources of data."""
    params = random_params(config)
    scores = {"cd_sq_radius2": 0.0123, "emd_radius": float("nan")}
    data = [{"name": "chairs", "source": "meshes", "samples": 84}]
    figures = figures_of(config, params, step=50, averaged=True, metrics=scores, data=data)
    return Weights(config, params, figures, SOURCES, dtype)

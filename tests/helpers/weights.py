"""Weights of a tiny network, made without compiling anything."""

import functools

import jax
import numpy as np

from helpers import standin
from psgn_jax.config.experiment import to_dict, to_json
from psgn_jax.models import networks
from psgn_jax.models.networks import init_params
from psgn_jax.weights.checkpoint import Checkpoints
from psgn_jax.weights.file import figures_of
from psgn_jax.weights.leaves import named_leaves
from psgn_jax.weights.run_folder import Trained

SOURCES = [
    {"source": "chairs", "licences": {"CC-BY-3.0": {"models": 7, "holders": ["Ada", "Bo"]}}},
    {"source": "cars", "licences": {"CC0-1.0": {}}},
]


def config(**changes):
    """The configuration of the tiny network, with changes as in `standin.config`."""
    tiny = {**standin.TINY, "model__random_size": 0, "loss__l2": "none"}
    return standin.config(**{**tiny, **changes})


@functools.cache
def _shapes(config):
    return jax.eval_shape(lambda: init_params(config, networks.build(config.model)))


def random_params(config, seed=0):
    """Random parameters of a configuration's network."""
    rng = np.random.default_rng(seed)
    return jax.tree.map(lambda s: rng.normal(0, 0.1, s.shape).astype("f4"), _shapes(config))


def weights(config, dtype="float16"):
    """A network with metrics and sources of data, for a file of weights."""
    scores = {"cd_sq_radius2": 0.0123, "emd_radius": float("nan")}
    run = Trained(config, 50, random_params(config), scores, "tiny", "weights", SOURCES)
    data = [{"name": "chairs", "source": "meshes", "samples": 84}]
    return run._replace(figures=figures_of(run, data, averaged=True), dtype=dtype)


def write_run(folder, config, trees, step=3, **scores):
    """The folder of a run with one checkpoint; returns the folder."""
    checkpoints = Checkpoints(folder / "checkpoints")
    checkpoints.save(step, named_leaves(trees), {"config": to_dict(config)})
    checkpoints.close()
    checkpoints.score(step, scores)
    (folder / "config.json").write_text(to_json(config))
    return folder

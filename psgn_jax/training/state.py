"""The state of training: a pytree, which is stored completely in a checkpoint.

The position in the data is not part of it, because the batch of a step and all random numbers are
functions of (seed, step).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from flax import linen as nn

from psgn_jax.config import Config, OptimConfig
from psgn_jax.models import posterior
from psgn_jax.types import Array, PRNGKey

# Purposes of random numbers, which are folded into the key of the seed.
_INIT, _TRAIN_RANDOM, _EVAL_RANDOM, _INIT_POSTERIOR = 0, 1, 2, 3


WATCHED = ("loss", "gradient norm")
"""Metrics that must be finite; `TrainState.bad_metric` is an index into this tuple."""


class TrainState(NamedTuple):
    """State of training.

    Attributes:
      step: int32, number of updates.
      params: parameters of the network, float32; with `model.posterior` also those of the posterior
        network, under the name "posterior", which the network itself ignores.
      opt_state: state of the optimiser.
      ema: averaged parameters, or `()` if `optim.ema_decay` is 0.
      loss_sum: float32, sum of the losses since the last multiple of `train.log_every`.
      loss_count: int32, number of these losses.
      bad_step: int32, first step with a non-finite loss or gradient, -1 = none.
      bad_metric: int32, index into `WATCHED` of the non-finite metric.
    """

    step: Array
    params: Any
    opt_state: Any
    ema: Any
    loss_sum: Array
    loss_count: Array
    bad_step: Array
    bad_metric: Array


def eval_params(state: TrainState) -> Any:
    """The parameters for evaluation: the averaged ones if they exist."""
    return state.ema if jax.tree.leaves(state.ema) else state.params


def schedule(config: OptimConfig, steps: int) -> optax.Schedule:
    """Learning rate of each step: linear warm-up from 0, then constant or half a cosine."""
    peak, warmup = config.learning_rate, config.warmup_steps
    if config.schedule == "constant":
        after = optax.constant_schedule(peak)
    else:
        after = optax.cosine_decay_schedule(peak, steps - warmup, alpha=config.final_fraction)
    if not warmup:
        return after
    return optax.join_schedules([optax.linear_schedule(0.0, peak, warmup), after], [warmup])


def optimizer(config: OptimConfig, steps: int) -> optax.GradientTransformation:
    """Adam (Kingma and Ba, 2015) under the schedule, after clipping by the global norm."""
    clip = optax.clip_by_global_norm(config.clip_norm) if config.clip_norm else optax.identity()
    return optax.chain(
        clip,
        optax.scale_by_adam(b1=config.b1, b2=config.b2, eps=config.eps),
        optax.scale_by_learning_rate(schedule(config, steps)),
    )


def random_key(seed: int, step: Array | int, *, train: bool = True) -> PRNGKey:
    """Key of the random input r at a training step, or at a batch of an evaluation."""
    purpose = _TRAIN_RANDOM if train else _EVAL_RANDOM
    return jax.random.fold_in(jax.random.fold_in(jax.random.key(seed), purpose), step)


def create(config: Config, model: nn.Module, tx: optax.GradientTransformation) -> TrainState:
    """The initial state, with random parameters from the seed. A pure function for use in jit."""
    height, width = config.model.image_size
    image = jnp.zeros((1, height, width, config.model.in_channels))
    r = jnp.zeros((1, config.model.random_size)) if config.model.random_size else None
    params = model.init(init_key(config), image, r)["params"]
    if config.model.posterior:
        key = jax.random.fold_in(jax.random.key(config.seed), _INIT_POSTERIOR)
        own = posterior.build(config.model).init(key, jnp.zeros((1, *posterior.GRID)))["params"]
        params = {**params, posterior.NAME: own}
    return fresh(config, params, tx)


def init_key(config: Config) -> PRNGKey:
    """Key of the initial parameters."""
    return jax.random.fold_in(jax.random.key(config.seed), _INIT)


def fresh(config: Config, params: Any, tx: optax.GradientTransformation) -> TrainState:
    """The state before the first step."""
    return TrainState(
        step=jnp.int32(0),
        params=params,
        opt_state=tx.init(params),
        ema=params if config.optim.ema_decay else (),
        loss_sum=jnp.float32(0),
        loss_count=jnp.int32(0),
        bad_step=jnp.int32(-1),
        bad_metric=jnp.int32(0),
    )


def named_leaves(tree: Any) -> dict[str, Any]:
    """Leaves by dotted path, `{"params.head.kernel": ...}`, as named in a checkpoint."""
    leaves, _ = jax.tree_util.tree_flatten_with_path(tree)
    return {jax.tree_util.keystr(path, simple=True, separator="."): leaf for path, leaf in leaves}


def from_named_leaves(template: Any, leaves: dict[str, np.ndarray]) -> Any:
    """The tree with the structure of `template` (arrays or shapes) and the given leaves.

    Raises:
      ValueError: a leaf is missing or not in `template`, or has another shape or dtype.
    """
    wanted = named_leaves(template)
    if different := sorted(wanted.keys() ^ leaves.keys()):
        where = "missing" if different[0] in wanted else "not expected"
        raise ValueError(f"leaf {different[0]} is {where} ({len(different)} leaves differ)")
    for name, want in wanted.items():
        have = leaves[name]
        if (have.shape, have.dtype) != (want.shape, want.dtype):
            raise ValueError(
                f"leaf {name} is {have.dtype}{list(have.shape)}, "
                f"expected {want.dtype}{list(want.shape)}"
            )
    return jax.tree.unflatten(jax.tree.structure(template), [leaves[name] for name in wanted])


def params_from_named_leaves(leaves: dict[str, np.ndarray], *, averaged: bool = True) -> Any:
    """The parameters for evaluation, as a nested dict, from the leaves of a checkpoint.

    With `averaged` these are the averaged ones, if they exist.
    """
    averaged = averaged and any(name.startswith("ema.") for name in leaves)
    section = "ema." if averaged else "params."
    tree: dict[str, Any] = {}
    for name, leaf in leaves.items():
        if not name.startswith(section):
            continue
        *parents, last = name.removeprefix(section).split(".")
        node = tree
        for parent in parents:
            node = node.setdefault(parent, {})
        node[last] = leaf
    return tree

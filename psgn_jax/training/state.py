"""The state of training and its optimiser.

The state is a pytree, which is stored completely in a checkpoint. The position in the data is not
part of it, because the batch of a step and all random numbers are functions of (seed, step).
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import optax

from psgn_jax.array_types import Array
from psgn_jax.config.experiment import Config, OptimConfig
from psgn_jax.models import efficientnet


class TrainState(NamedTuple):
    """State of training.

    Attributes:
      step: int32, number of updates.
      params: parameters of the network, float32; with `model.posterior` also those of the posterior
        network, under the name "posterior", which the network itself ignores.
      opt_state: state of the optimiser.
      ema: averaged parameters, or `()` if `optim.ema_decay` is 0.
    """

    step: Array
    params: Any
    opt_state: Any
    ema: Any


def create(config: Config, params: Any) -> TrainState:
    """The state before the first step."""
    opt_state = optimizer(config.optim, config.train.steps).init(params)
    return TrainState(jnp.int32(0), params, opt_state, params if config.optim.ema_decay else ())


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
    adam = optax.scale_by_adam(b1=config.b1, b2=config.b2, eps=config.eps)
    rate = optax.scale_by_learning_rate(schedule(config, steps))
    if config.encoder_rate == 1:
        return optax.chain(clip, adam, rate)

    def factors(updates: Any, _: Any) -> Any:
        def scaled(path: Any, update: Array) -> Array:
            pretrained = any(getattr(key, "key", None) == efficientnet.NAME for key in path)
            return config.encoder_rate * update if pretrained else update

        return jax.tree_util.tree_map_with_path(scaled, updates)

    return optax.chain(clip, adam, optax.stateless(factors), rate)

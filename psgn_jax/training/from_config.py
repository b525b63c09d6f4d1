"""The first state, the training step and the optimiser of a configuration."""

import functools
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import optax
from jax.sharding import Mesh

from psgn_jax.config.experiment import Config, OptimConfig
from psgn_jax.tasks.task import Task
from psgn_jax.training.step import TrainState, make_train_step


def create_training(
    config: Config, task: Task, mesh: Mesh
) -> tuple[Callable[[], TrainState], Callable[..., Any]]:
    """() -> the state before the first step, and the step (`step.make_train_step`)."""
    optim, train = config.optim, config.train
    tx, rate = optimizer(optim, train.steps), schedule(optim, train.steps)
    columns = functools.partial(task.random_columns, batch_size=train.batch_size, train=True)

    def create() -> TrainState:
        params = task.init_params()
        return TrainState(jnp.int32(0), params, tx.init(params), params if optim.ema_decay else ())

    return create, make_train_step(task.objective, columns, tx, rate, optim.ema_decay, mesh)


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
    return optax.chain(clip, adam, rate)

"""The first state, the optimiser, and the training step, compiled for a mesh of devices.

The batch is split over the mesh's axis `data`; the state is replicated. Each device computes its
share like a single device (`jax.shard_map`), and the gradients are averaged. So XLA never has to
partition the loops in losses and convolutions.
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

from psgn_jax.array_types import Array
from psgn_jax.config.experiment import Config, OptimConfig
from psgn_jax.system.cpu import compiler_options
from psgn_jax.tasks.task import Batch, Task


class TrainState(NamedTuple):
    """The state in a checkpoint; batches and random numbers are functions of `step`."""

    step: Array  # int32, number of updates
    params: Any  # float32; with `model.posterior` also those of the posterior network
    opt_state: Any
    ema: Any  # averaged parameters, or `()`


def eval_params(state: TrainState) -> Any:
    """The parameters for evaluation: the averages, if there are any."""
    return state.ema if jax.tree.leaves(state.ema) else state.params


def data_mesh(devices: list[jax.Device] | None = None) -> Mesh:
    """One axis, `data`, over all devices of all processes."""
    return Mesh(np.asarray(devices or jax.devices()), ("data",))


def put_batch(batch: Batch, mesh: Mesh, keys: tuple[str, ...]) -> dict[str, jax.Array]:
    """Puts this process's share of a batch on the mesh, split along the batch axis."""
    sharding = NamedSharding(mesh, P("data"))
    return {k: jax.make_array_from_process_local_data(sharding, batch[k]) for k in keys}


def put_replicated(tree: Any, mesh: Mesh) -> Any:
    """Copies host arrays, equal in all processes, to all devices."""
    sharding = NamedSharding(mesh, P())
    if jax.process_count() == 1:
        return jax.device_put(tree, sharding)
    # `jax.device_put` would first compare the values between processes.
    put = functools.partial(jax.make_array_from_process_local_data, sharding)
    return jax.tree.map(lambda leaf: put(np.asarray(leaf)), tree)


def optimizer(
    config: OptimConfig, steps: int
) -> tuple[optax.GradientTransformation, optax.Schedule]:
    """Clipping by the global norm, then Adam (Kingma and Ba, 2015); and the learning rate.

    The rate rises linearly from 0 in the warm-up, then is constant or falls along half a cosine.
    """
    peak, warmup = config.learning_rate, config.warmup_steps
    rate = optax.constant_schedule(peak)
    if config.schedule == "cosine":
        rate = optax.cosine_decay_schedule(peak, steps - warmup, alpha=config.final_fraction)
    if warmup:
        rate = optax.join_schedules([optax.linear_schedule(0.0, peak, warmup), rate], [warmup])
    clip = optax.clip_by_global_norm(config.clip_norm) if config.clip_norm else optax.identity()
    adam = optax.scale_by_adam(b1=config.b1, b2=config.b2, eps=config.eps)
    return optax.chain(clip, adam, optax.scale_by_learning_rate(rate)), rate


def create_training(
    config: Config, task: Task, mesh: Mesh
) -> tuple[Callable[[], TrainState], Callable[..., tuple[TrainState, dict[str, Array]]]]:
    """`() -> the first state`, and the compiled step `(state, batch) -> (state, metrics)`.

    The step donates the state. Its metrics are the task's, averaged over the devices, `total_loss`
    (the minimised value), `grad_norm` (before clipping) and `learning_rate`.
    """
    tx, rate = optimizer(config.optim, config.train.steps)
    largest_decay, batch_size = config.optim.ema_decay, config.train.batch_size
    everywhere, split = NamedSharding(mesh, P()), NamedSharding(mesh, P("data"))

    def create() -> TrainState:
        params = task.init_params()
        return TrainState(jnp.int32(0), params, tx.init(params), params if largest_decay else ())

    def gradients(frozen: Any, params: Any, batch: Batch, step: Array) -> Any:
        by_params = jax.value_and_grad(task.total_loss, argnums=1, has_aux=True)
        (value, metrics), grads = by_params(frozen, params, batch, step)
        return jax.lax.pmean((value, metrics, grads), "data")

    gradients = jax.shard_map(
        gradients,
        mesh=mesh,
        in_specs=(P(), P(), P("data"), P()),
        out_specs=P(),
        check_vma=False,  # the custom gradients do not declare varying axes
    )

    def train_step(frozen: Any, state: TrainState, batch: Batch) -> Any:
        batch = {**batch, **task.latents(state.step, batch_size, train=True)}
        value, metrics, grads = gradients(frozen, state.params, batch, state.step)
        updates, opt_state = tx.update(grads, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        ema: Any = ()
        if largest_decay:
            # The averaging window grows with the steps, so that the initial parameters lose weight.
            decay = jnp.minimum(largest_decay, (state.step + 1) / (state.step + 10))
            ema = jax.tree.map(lambda old, new: old + (1 - decay) * (new - old), state.ema, params)
        metrics |= {
            "total_loss": value,
            "grad_norm": optax.tree.norm(grads),
            "learning_rate": jnp.asarray(rate(state.step), jnp.float32),
        }
        return TrainState(state.step + 1, params, opt_state, ema), metrics

    compiled = jax.jit(
        train_step,
        donate_argnums=1,
        in_shardings=(everywhere, everywhere, split),
        out_shardings=everywhere,
        compiler_options=compiler_options(),
    )
    frozen = put_replicated(task.frozen, mesh)
    return create, lambda state, batch: compiled(frozen, state, batch)

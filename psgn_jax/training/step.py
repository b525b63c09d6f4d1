"""The training step, compiled for a mesh of devices.

The batch is split over the mesh's one axis, `data`; the state is replicated. Each device runs the
plain single-device computation on its share (`jax.shard_map`), and the gradients are averaged. XLA
therefore never has to partition the loops inside losses and convolutions.
"""

import functools
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

from psgn_jax.array_types import Array
from psgn_jax.system.cpu import compiler_options

Batch = Mapping[str, Any]


class TrainState(NamedTuple):
    """State of training, stored in a checkpoint; batches and random numbers follow from `step`."""

    step: Array  # int32, number of updates
    params: Any  # float32; with `model.posterior` those of the posterior network as "posterior"
    opt_state: Any
    ema: Any  # averaged parameters, or `()`


def eval_params(state: TrainState) -> Any:
    """The parameters for evaluation: the averaged ones if they exist."""
    return state.ema if jax.tree.leaves(state.ema) else state.params


def data_mesh(devices: list[jax.Device] | None = None) -> Mesh:
    """One axis, `data`, over all devices of all processes."""
    return Mesh(np.asarray(devices or jax.devices()), ("data",))


def put_batch(batch: Batch, mesh: Mesh, keys: tuple[str, ...]) -> dict[str, jax.Array]:
    """Puts this process's share of a batch on the mesh, split by samples."""
    sharding = NamedSharding(mesh, P("data"))
    return {k: jax.make_array_from_process_local_data(sharding, batch[k]) for k in keys}


def put_replicated(tree: Any, mesh: Mesh) -> Any:
    """Copies host arrays, which are equal in every process, to all devices of all processes."""
    sharding = NamedSharding(mesh, P())
    if jax.process_count() == 1:
        return jax.device_put(tree, sharding)
    # `jax.device_put` would first compare the values between processes.
    put = functools.partial(jax.make_array_from_process_local_data, sharding)
    return jax.tree.map(lambda leaf: put(np.asarray(leaf)), tree)


def make_train_step(
    objective: Callable[[Any, Batch, Array], tuple[Array, dict[str, Array]]],
    random_columns: Callable[[Array], Batch],
    tx: optax.GradientTransformation,
    rate: optax.Schedule,
    ema_decay: float,
    mesh: Mesh,
) -> Callable[[TrainState, Mapping[str, jax.Array]], tuple[TrainState, dict[str, Array]]]:
    """Compiled `(state, batch) -> (state, metrics)`; the state is donated.

    The metrics are those of the objective, averaged over the devices, `objective` (the value that
    is minimised), `grad_norm` (of the gradient before clipping), and `learning_rate`.

    Args:
      objective: (params, batch, step) -> (value to be minimised, metrics); a pytree, whose leaves
        are constants, such as the parameters of frozen networks.
      random_columns: step -> further arrays of the batch, a row for each sample.
      tx: the optimiser, which includes the schedule `rate`.
      ema_decay: largest decay of the averaged parameters; 0 = none.
    """
    everywhere, split = NamedSharding(mesh, P()), NamedSharding(mesh, P("data"))

    def gradients(objective: Any, params: Any, batch: Batch, step: Array) -> Any:
        (value, metrics), grads = jax.value_and_grad(objective, has_aux=True)(params, batch, step)
        return jax.lax.pmean((value, metrics, grads), "data")

    gradients = jax.shard_map(
        gradients,
        mesh=mesh,
        in_specs=(P(), P(), P("data"), P()),
        out_specs=P(),
        check_vma=False,  # the custom gradients do not declare varying axes
    )

    def train_step(objective: Any, state: TrainState, batch: Batch) -> Any:
        batch = {**batch, **random_columns(state.step)}
        value, metrics, grads = gradients(objective, state.params, batch, state.step)
        updates, opt_state = tx.update(grads, state.opt_state, state.params)
        params = optax.apply_updates(state.params, updates)
        ema: Any = ()
        if ema_decay:
            # The averaging window grows with the run, so that the initial parameters lose weight.
            decay = jnp.minimum(ema_decay, (state.step + 1) / (state.step + 10))
            ema = jax.tree.map(lambda old, new: old + (1 - decay) * (new - old), state.ema, params)
        metrics |= {
            "objective": value,
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
    objective = put_replicated(objective, mesh)
    return lambda state, batch: compiled(objective, state, batch)

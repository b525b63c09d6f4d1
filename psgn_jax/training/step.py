"""One training step and one evaluation step, compiled for a mesh of devices.

The batch is split over the mesh's one axis, `data`; the state is replicated. Each device runs the
plain single-device computation on its share (`jax.shard_map`), and the gradients are averaged. XLA
therefore never has to partition the loops inside losses and convolutions.
"""

import contextlib
from collections.abc import Callable, Generator, Mapping
from typing import Any, cast

import jax
import jax.numpy as jnp
import numpy as np
import optax
from flax import linen as nn
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

from psgn_jax.config import Config, ConfigError
from psgn_jax.cores import compiler_options
from psgn_jax.losses.by_name import with_terms
from psgn_jax.losses.distances import map_pairs
from psgn_jax.losses.min_of_n import MinOfN, min_of_n
from psgn_jax.models import posterior
from psgn_jax.models.inputs import network_inputs
from psgn_jax.training.state import TrainState, random_key, schedule
from psgn_jax.types import Array

# Weights of the L2 terms in the authors' published training code, each w * sum(kernel**2) / 2 as in
# tf.nn.l2_loss.
L2_CONV, L2_DENSE, L2_CARRY = 1e-5, 1e-3, 1e-4

Batch = Mapping[str, Any]
PairFunction = Callable[..., Any]
Objective = Callable[[Any, Any, Batch, Any, Any], tuple[Array, dict[str, Array]]]


def data_mesh(devices: list[jax.Device] | None = None) -> Mesh:
    """One axis, `data`, over all devices of all processes."""
    return Mesh(np.asarray(devices or jax.devices()), ("data",))


def check_batch_size(config: Config, mesh: Mesh) -> None:
    """Raises `ConfigError` if the training batch does not split evenly over the devices."""
    if config.train.batch_size % mesh.size:
        raise ConfigError(
            f"train.batch_size={config.train.batch_size}: accepted: a multiple of the "
            f"{mesh.size} devices"
        )


def put_batch(batch: Batch, mesh: Mesh, keys: tuple[str, ...]) -> dict[str, jax.Array]:
    """Puts this process's share of a batch on the mesh, split along the first axis."""
    sharding = NamedSharding(mesh, P("data"))
    return {k: jax.make_array_from_process_local_data(sharding, batch[k]) for k in keys}


def put_batches(
    batches: Generator[Batch, None, None], mesh: Mesh, keys: tuple[str, ...]
) -> Generator[dict[str, jax.Array], None, None]:
    """Applies `put_batch` to each batch; closing this generator closes `batches`."""
    with contextlib.closing(batches):
        for batch in batches:
            yield put_batch(batch, mesh, keys)


def put_replicated(tree: Any, sharding: NamedSharding) -> Any:
    """Copies host arrays, which are equal in every process, to all devices of all processes."""
    if jax.process_count() == 1:
        return jax.device_put(tree, sharding)

    # `jax.device_put` would first compare the values between processes.
    def put(leaf: Any) -> jax.Array:
        array = np.asarray(leaf)
        return jax.make_array_from_callback(array.shape, sharding, lambda index: array[index])

    return jax.tree.map(put, tree)


def input_keys(config: Config) -> tuple[str, ...]:
    """Keys of the arrays of a batch that the training step reads."""
    depth = ("depth", "extrinsics") if "depth" in config.data.inputs else ()
    return ("image", "mask", "points", *depth)


def l2_authors(params: Any) -> Array:
    """The authors' L2 terms: half the sum of squares of each kernel, weighted by layer type.

    The weights are 1e-5 for convolutions, 1e-4 for the dense layer `carry` in the fc branch of the
    hourglass (`models.point_out_net`), and 1e-3 for other dense layers. Biases are left out.
    """
    total = jnp.float32(0)
    for path, leaf in jax.tree_util.tree_flatten_with_path(params)[0]:
        names = [str(getattr(entry, "key", entry)) for entry in path]
        if names[-1] != "kernel":
            continue
        dense = L2_CARRY if any("carry" in name for name in names) else L2_DENSE
        total += (L2_CONV if leaf.ndim >= 4 else dense) * 0.5 * jnp.sum(jnp.square(leaf))
    return total


def predict(config: Config, model: nn.Module, params: Any, batch: Batch, r: Array | None) -> Array:
    """Points [B,N,3] of a batch's images; [B,draws,N,3] if r is [B,draws,random_size]."""
    return cast(Array, model.apply({"params": params}, network_inputs(config, batch), r))


def min_of_n_loss(
    config: Config, model: nn.Module, loss: PairFunction, params: Any, batch: Batch, r: Array
) -> tuple[Array, MinOfN]:
    """Batch mean of the Min-of-N distance over the draws of r [B,draws,k].

    Value and gradient equal those of `min_of_n` applied to `predict` with all draws, up to
    rounding, at less cost. Only the best draw of each sample has a gradient. All draws are
    therefore computed without storing activations, and only the best draw of each sample is
    computed again for the backward pass. The parts that do not depend on r (the encoder; in
    `hourglass` the encoder of the first pass) are the same in both passes, and XLA computes them
    once. The loss is not computed twice: its derivative with respect to the points is kept from the
    first pass and used in the backward pass of the second. `tests/bench/step.py --draws` measures
    the gain.
    """
    frozen = jax.lax.stop_gradient(params)
    preds = predict(config, model, frozen, batch, r)

    def total(preds: Array) -> tuple[Array, MinOfN]:
        best = map_pairs(min_of_n(with_terms(loss), has_aux=True))(preds, batch["points"])
        return jnp.sum(best.value), best

    (value, best), by_points = jax.value_and_grad(total, has_aux=True)(preds)
    rows = jnp.arange(len(r))
    pred = predict(config, model, params, batch, r[rows, best.winner])
    # The value is zero; the gradient is that of the loss, by the chain rule through the points.
    carried = by_points[rows, best.winner] * (pred - jax.lax.stop_gradient(pred))
    best = jax.lax.stop_gradient(best)
    return (jax.lax.stop_gradient(value) + jnp.sum(carried)) / len(r), best


def make_train_step(
    config: Config,
    model: nn.Module,
    loss: PairFunction,
    tx: optax.GradientTransformation,
    mesh: Mesh,
) -> Callable[[TrainState, Batch], tuple[TrainState, dict[str, Array]]]:
    """Compiled `(state, batch) -> (state, metrics)`; the state is donated.

    Metrics, scalars except `kl_of_dims`:

    - `loss_step`: the loss of this step, without the L2 and KL terms.
    - `loss`: mean of `loss_step` over the steps since the last multiple of `train.log_every`.
    - `loss_<name>`, if the loss is a sum: each term of `loss_step`, without its weight.
    - `loss_of_draws`, if `loss.min_of_n` > 1: mean of the distances over all draws. `loss_step` is
      the mean of the smallest distances; the difference shows how much the draws differ.
    - `l2`, unless `loss.l2` is "none": the L2 term.
    - `grad_norm`: norm of the gradient before clipping.
    - `learning_rate`.
    - `bad_step` and `bad_metric`: see `TrainState`.

    With `model.posterior` also:

    - `kl`: divergence in nats, summed over the dimensions of z and averaged over the samples.
    - `kl_weight`: weight of `kl` in the objective.
    - `kl_of_dims`: vector of the divergences of the dimensions.
    - `kl_dim_min`, `kl_dim_mean`, `kl_dim_max`: minimum, mean and maximum of `kl_of_dims`.
    - `active_dims`: number of dimensions with a divergence over `posterior.ACTIVE`.
    """
    encoder = posterior.build(config.model) if config.model.posterior else None

    def sample_latents(step: Array) -> tuple[Array | None, Array]:
        r = sample_step_latents(config, step, config.train.batch_size, train=True)
        return r, kl_weight_at(config, step)

    def objective(
        params: Any, _: Any, batch: Batch, r: Array | None, kl_weight: Array
    ) -> tuple[Array, dict[str, Array]]:
        metrics = {}
        extra = jnp.float32(0)
        if encoder is not None and r is not None:
            volumes = jax.vmap(posterior.occupied)(batch["points"])
            q = cast(posterior.Gaussian, encoder.apply({"params": params[posterior.NAME]}, volumes))
            r = posterior.reparameterise(q, r)
            metrics["kl_of_dims"] = jnp.mean(posterior.kl_of_dims(q), axis=0)
            metrics["kl"] = jnp.sum(metrics["kl_of_dims"])
            extra += kl_weight * metrics["kl"]
        if config.loss.min_of_n > 1 and r is not None:
            value, best = min_of_n_loss(config, model, loss, params, batch, r)
            metrics["loss_of_draws"] = jnp.mean(best.distances)
            terms = best.aux
        else:
            pred = predict(config, model, params, batch, r)
            values, terms = map_pairs(with_terms(loss))(pred, batch["points"])
            value = jnp.mean(values)
        metrics |= {f"loss_{name}": jnp.mean(values) for name, values in terms.items()}
        metrics["loss_step"] = value
        if config.loss.l2 != "none":
            metrics["l2"] = config.loss.l2_scale * l2_authors(params)
            extra += metrics["l2"]
        return value + extra, metrics

    def extra_metrics(metrics: dict[str, Array], kl_weight: Array) -> dict[str, Array]:
        if encoder is None:
            return {}
        by_dim = metrics["kl_of_dims"]
        return {
            "kl_weight": kl_weight,
            "kl_dim_min": by_dim.min(),
            "kl_dim_mean": by_dim.mean(),
            "kl_dim_max": by_dim.max(),
            "active_dims": jnp.sum(by_dim > posterior.ACTIVE),
        }

    return compile_train_step(
        config, objective, tx, mesh, sample_latents=sample_latents, extra_metrics=extra_metrics
    )


def _nothing(step: Array) -> tuple[None, None]:
    return None, None


def _compiled(function: Callable[..., Any], **arguments: Any) -> Callable[..., Any]:
    """`jax.jit` with `compiler_options`, which JAX accepts only outside other transformations."""
    outer = jax.jit(function, compiler_options=compiler_options(), **arguments)
    inner = jax.jit(function, **arguments)

    def call(*args: Any) -> Any:
        traced = any(isinstance(leaf, jax.core.Tracer) for leaf in jax.tree.leaves(args))
        return (inner if traced else outer)(*args)

    return call


def compile_train_step(
    config: Config,
    objective: Objective,
    tx: optax.GradientTransformation,
    mesh: Mesh,
    *,
    frozen: Any = (),
    sample_latents: Callable[[Array], tuple[Any, Any]] = _nothing,
    extra_metrics: Callable[[dict[str, Array], Any], dict[str, Array]] = lambda metrics, _: {},
) -> Callable[[TrainState, Batch], tuple[TrainState, dict[str, Array]]]:
    """Compiled `(state, batch) -> (state, metrics)` of any objective; the state is donated.

    Args:
      config: configuration of the run; `optim` and `train` are used.
      objective: (params, frozen, batch, latents, replicated_inputs) -> (value to be minimised on
        one device's share of the batch, metrics). The metric `loss_step` is the value without
        regularisation terms.
      tx: the optimiser.
      mesh: mesh of devices.
      frozen: constant arrays that the objective reads, such as other networks.
      sample_latents: step -> (latents, replicated_inputs), inputs of the objective. `latents` are
        random arrays with a row for each sample of the batch, which are split over the devices;
        `replicated_inputs` are equal on all devices.
      extra_metrics: (metrics, replicated_inputs) -> metrics to add.

    The metrics are those of the objective, averaged over the devices, those of `extra_metrics`, and
    `loss`, `grad_norm`, `learning_rate`, `bad_step` and `bad_metric`, see `make_train_step`.
    """
    rate = schedule(config.optim, config.train.steps)
    replicated, split = NamedSharding(mesh, P()), NamedSharding(mesh, P("data"))
    frozen = put_replicated(frozen, replicated)

    def gradients(
        params: Any, frozen: Any, batch: Batch, latents: Any, replicated_inputs: Any
    ) -> Any:
        (total, metrics), grads = jax.value_and_grad(objective, has_aux=True)(
            params, frozen, batch, latents, replicated_inputs
        )
        return jax.lax.pmean((total, metrics, grads), "data")

    sharded_gradients = jax.shard_map(
        gradients,
        mesh=mesh,
        in_specs=(P(), P(), P("data"), P("data"), P()),
        out_specs=P(),
        check_vma=False,  # the custom gradients do not declare varying axes
    )

    def train_step(
        state: TrainState, frozen: Any, batch: Batch
    ) -> tuple[TrainState, dict[str, Array]]:
        latents, replicated_inputs = sample_latents(state.step)
        total, metrics, grads = sharded_gradients(
            state.params, frozen, batch, latents, replicated_inputs
        )
        new, grad_norm = _updated(config, tx, state, total, metrics["loss_step"], grads)
        metrics |= extra_metrics(metrics, replicated_inputs)
        metrics |= {
            "loss": new.loss_sum / new.loss_count,
            "grad_norm": grad_norm,
            "learning_rate": jnp.asarray(rate(state.step), jnp.float32),
            "bad_step": new.bad_step,
            "bad_metric": new.bad_metric,
        }
        return new, metrics

    compiled = _compiled(
        train_step,
        donate_argnums=0,
        in_shardings=(replicated, replicated, split),
        out_shardings=(replicated, replicated),
    )
    return lambda state, batch: compiled(state, frozen, batch)


def _updated(
    config: Config,
    tx: optax.GradientTransformation,
    state: TrainState,
    total: Array,
    loss: Array,
    grads: Any,
) -> tuple[TrainState, Array]:
    """The state after an update by `grads`, and their norm before clipping."""
    grad_norm = optax.tree.norm(grads)
    updates, opt_state = tx.update(grads, state.opt_state, state.params)
    params = optax.apply_updates(state.params, updates)
    ema: Any = ()
    if config.optim.ema_decay:
        # The averaging window grows with the run: the initial parameters soon lose their weight.
        decay = jnp.minimum(config.optim.ema_decay, (state.step + 1) / (state.step + 10))
        ema = jax.tree.map(lambda old, new: old + (1 - decay) * (new - old), state.ema, params)
    first = state.step % config.train.log_every == 0
    bad = jnp.stack([~jnp.isfinite(total), ~jnp.isfinite(grad_norm)])
    first_bad = bad.any() & (state.bad_step < 0)
    new = TrainState(
        step=state.step + 1,
        params=params,
        opt_state=opt_state,
        ema=ema,
        loss_sum=jnp.where(first, 0, state.loss_sum) + loss,
        loss_count=jnp.where(first, 0, state.loss_count) + 1,
        bad_step=jnp.where(first_bad, state.step + 1, state.bad_step),
        bad_metric=jnp.where(first_bad, jnp.argmax(bad).astype(jnp.int32), state.bad_metric),
    )
    return new, grad_norm


def make_eval_step(
    config: Config, model: nn.Module, metrics: PairFunction, mesh: Mesh
) -> Callable[[Any, Batch, Any], tuple[Array, dict[str, Array]]]:
    """Compiled `(params, batch, index) -> (points [B,N,3], metrics of shape [B])`.

    `metrics` takes (pred, gt), and (pred, gt, visible) if the batch has `visible`. `index` is the
    number of the batch within the evaluation, which determines the random input.
    """

    def measure(params: Any, _: Any, batch: Batch, r: Array | None) -> Any:
        pred = predict(config, model, params, batch, r)
        visible = [batch["visible"]] if "visible" in batch else []
        return pred, map_pairs(metrics)(pred, batch["points"], *visible)

    def sample_latents(index: Array, batch_size: int) -> Array | None:
        return sample_step_latents(config, index, batch_size, train=False)

    return compile_eval_step(measure, mesh, sample_latents=sample_latents)


def compile_eval_step(
    measure: Callable[[Any, Any, Batch, Any], tuple[Array, dict[str, Array]]],
    mesh: Mesh,
    *,
    frozen: Any = (),
    sample_latents: Callable[[Array, int], Any] = lambda index, batch_size: None,
) -> Callable[[Any, Batch, Any], tuple[Array, dict[str, Array]]]:
    """Compiled `(params, batch, index) -> (predictions, metrics)`, each with a row per sample.

    Args:
      measure: (params, frozen, batch, latents) -> (predictions, metrics) of one device's share of
        the batch.
      mesh: mesh of devices.
      frozen: further arrays that `measure` reads, such as other networks.
      sample_latents: (index of the batch, its size) -> random input, with a row for each sample.
    """
    sharded = jax.shard_map(
        measure,
        mesh=mesh,
        in_specs=(P(), P(), P("data"), P("data")),
        out_specs=P("data"),
        check_vma=False,
    )
    frozen = jax.device_put(frozen, NamedSharding(mesh, P()))

    def eval_step(params: Any, frozen: Any, batch: Batch, index: Array) -> Any:
        return sharded(params, frozen, batch, sample_latents(index, len(batch["image"])))

    compiled = _compiled(eval_step)
    return lambda params, batch, index: cast(
        tuple[Array, dict[str, Array]], compiled(params, frozen, batch, index)
    )


def kl_weight_at(config: Config, step: Array | int) -> Array:
    """Weight of the KL at a training step: linear from 0 to `loss.kl_weight`, then constant."""
    warmup = config.loss.kl_warmup_steps
    share = jnp.minimum(jnp.float32(1), step / warmup) if warmup else jnp.float32(1)
    return jnp.asarray(config.loss.kl_weight * share, jnp.float32)


def sample_step_latents(
    config: Config, step: Array | int, batch_size: int, *, train: bool
) -> Array | None:
    """Random input r ~ N(0, I) [B, random_size], or None without one.

    For training with `loss.min_of_n` > 1 it is [B, min_of_n, random_size]. Source: paper, section
    "Generation of Multiple Plausible Shapes".
    """
    if not config.model.random_size:
        return None
    key = random_key(config.seed, step, train=train)
    draws = (config.loss.min_of_n,) if train and config.loss.min_of_n > 1 else ()
    return jax.random.normal(key, (batch_size, *draws, config.model.random_size))

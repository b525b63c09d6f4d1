"""Training: one function, from a configuration to a trained network in a folder.

The folder (`workdir`) gets `config.json`, `metrics.jsonl`, `tensorboard/` and `checkpoints/`.
If `train` is called again with the same folder, it continues from the newest intact checkpoint. On
the same machine, the final parameters are bit-identical to those of an uninterrupted run.
"""

import contextlib
import pathlib
import signal
from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
from absl import logging

from psgn_jax import tasks
from psgn_jax.config.experiment import (
    Config,
    ConfigError,
    check_paths,
    flatten,
    parse,
    to_dict,
    to_json,
)
from psgn_jax.data import loader
from psgn_jax.system import group
from psgn_jax.system.files import check_folder, write_atomic
from psgn_jax.system.signals import Stopped, StopSignal
from psgn_jax.tasks import Task
from psgn_jax.training.from_config import create_state, create_step
from psgn_jax.training.log import MetricsWriter, TrainingLog
from psgn_jax.training.step import TrainState, data_mesh, eval_params, put_batch, put_replicated
from psgn_jax.weights.checkpoint import Checkpoint, Checkpoints
from psgn_jax.weights.leaves import from_named_leaves, named_leaves
from psgn_jax.weights.opening import initial_params, open_initial
from psgn_jax.weights.run_folder import Run, locked

MAY_CHANGE = frozenset(
    {
        "data.path",  # a folder can be moved
        "data.eval_path",
        "data.eval_split",
        "data.num_eval_points",
        "data.num_workers",
        "data.cache_gb",
        "train.steps",
        "train.log_every",
        "train.eval_every",
        "train.checkpoint_every",
        "train.images_every",
        "train.num_images",
        "train.keep_checkpoints",
        "eval.batch_size",
        "eval.max_samples",
        "eval.fscore_threshold",
        "eval.emd_tolerance",
        "eval.visible_tolerance",
    }
)
"""Fields that may differ when a run is resumed; a difference in any other field is an error."""


class Outcome(NamedTuple):
    """End of a training: the state, and the signal that stopped it; None if it was not stopped."""

    state: TrainState
    stopped_by: int | None


def train(config: Any, workdir: str | pathlib.Path) -> Outcome:
    """Trains, or resumes training, until `config.train.steps` or a signal.

    After SIGTERM or SIGINT, the current step ends, its checkpoint is saved and the function
    returns; `system.signals.StopSignal` limits the time for that.

    Args:
      config: a `Config`, or a mapping for `config.parse`.
      workdir: folder of the run.

    Raises:
      ConfigError: raised before compilation if (a) the configuration is wrong, (b) it differs from
        the checkpoint's in a field that is not in `MAY_CHANGE`, or (c) another process trains in
        this folder.
      UserError: no file can be written to `workdir`.
      OSError: during training, for example if the disk is full.
      NonFiniteError: the loss or the norm of the gradient is not finite; the message names the
        metric and the step.
    """
    config = config if isinstance(config, Config) else parse(config)
    workdir, first, mesh = pathlib.Path(workdir), group.is_first(), data_mesh()
    check_folder(workdir, "--workdir")
    check_paths(config)
    if config.train.batch_size % mesh.size:
        raise ConfigError(
            f"train.batch_size={config.train.batch_size}: accepted: a multiple of the "
            f"{mesh.size} devices"
        )
    task = tasks.create(config, workdir)
    train_step = create_step(task, config, mesh)
    sizes = _check_data(config)
    # A wrong `train.init` is reported before there is a folder.
    trained = None if (workdir / "checkpoints").exists() else _open_initial(config, task)
    with contextlib.ExitStack() as stack:
        if first:
            stack.enter_context(locked(workdir))
        with group.first_alone():
            checkpoints = Checkpoints(
                workdir / "checkpoints", config.train.keep_checkpoints, read_only=not first
            )
            stored = checkpoints.restore_newest()
        stack.callback(checkpoints.close)
        if stored:
            _check_resumable(config, stored, workdir)
            state, trained = _restored(config, task, stored, workdir), None
        else:
            trained = trained or _open_initial(config, task)
            state = _initialised(config, task, trained)
        state = put_replicated(state, mesh)
        start = step = saved = int(stored.step) if stored else 0
        _describe(task.title, state, sizes, mesh.size, workdir, start)
        if first:
            task.keep_sources()
            write_atomic(workdir / "config.json", to_json(config))
        # A network from which the training starts is evaluated too.
        evaluate_first = _due(config.train.eval_every, start, config) and (
            start not in checkpoints.scores
        )
        evaluate_first |= bool(config.train.eval_every and trained)
        writer = MetricsWriter(workdir, start, evaluated=not evaluate_first) if first else None
        if writer:
            stack.callback(writer.close)
        log = TrainingLog(config, writer, start, _losses(config, stored))

        def save() -> None:
            log.drain()
            losses = {"loss_sum": float(log.loss_sum), "loss_count": log.loss_count}
            meta = {"config": to_dict(config), **losses}
            if first:
                checkpoints.save(step, named_leaves(state), meta)

        def evaluate() -> None:
            with log.pause(), contextlib.suppress(Stopped):  # a resumed run evaluates first
                result = task.evaluate(
                    _local(eval_params(state)),
                    max_samples=config.eval.max_samples,
                    on_batch=stop.check,
                )
                scores = {**result.means, **result.chosen}
                log.evaluation(step, scores)
                if first and step:
                    checkpoints.score(step, scores)

        batches = loader.train_batches(
            config.data,
            batch_size=config.train.batch_size,
            seed=config.seed,
            start_step=start,
            process_index=jax.process_index(),
            process_count=jax.process_count(),
        )
        stack.callback(batches.close)
        several = jax.process_count() > 1
        stop: group.SharedStop | StopSignal = group.SharedStop() if several else StopSignal()
        stack.enter_context(stop)
        if evaluate_first:
            evaluate()
        while step < config.train.steps and not stop.signal:
            state, metrics = train_step(state, put_batch(next(batches), mesh, task.keys))
            step += 1
            log.add(step, metrics)
            stop.after_step(step)
            due = _due(config.train.eval_every, step, config)
            if (
                due
                or step == config.train.steps
                or _due(config.train.checkpoint_every, step, config)
            ):
                with log.pause():
                    save()
                saved = step
            if due and not stop.signal:
                evaluate()
            if _due(config.train.images_every, step, config) and writer and not stop.signal:
                with log.pause():
                    picture = task.picture(_local(eval_params(state)))
                    if picture is not None:
                        writer.image(step, "eval/clouds", picture)
        log.drain()
        if saved < step:  # a signal has ended the loop
            save()
        checkpoints.wait()
    _report_end(workdir, step, stop.signal)
    return Outcome(state, stop.signal)


def _check_data(config: Config) -> dict[str, int]:
    """Samples per split; raises `ConfigError` if the data set does not fit the configuration."""
    sizes = {}
    data = config.data
    for split, evaluation in ((data.train_split, False), (data.eval_split, True)):
        name = "eval_path" if evaluation and data.eval_path else "path"
        try:
            sizes[split] = loader.num_samples(data, split, evaluation=evaluation)
        except (ValueError, OSError) as error:
            raise ConfigError(f"data.{name}={getattr(data, name)!r}: {error}") from error
    return sizes


def _check_resumable(config: Config, checkpoint: Checkpoint, workdir: pathlib.Path) -> None:
    """Raises `ConfigError` if the run was trained with another configuration."""
    before, now = flatten(parse(checkpoint.meta["config"])), flatten(config)
    changed = {key: (before[key], now[key]) for key in now if before[key] != now[key]}
    fatal = [f"{k}={changed[k][0]!r} (now {changed[k][1]!r})" for k in changed.keys() - MAY_CHANGE]
    if fatal:
        raise ConfigError(
            f"--workdir={workdir} holds a run with {', '.join(sorted(fatal))}; "
            "use another workdir or the same values"
        )
    for key, (old, new) in changed.items():
        logging.info("resuming with %s=%r instead of %r", key, new, old)


def _restored(
    config: Config, task: Task, checkpoint: Checkpoint, workdir: pathlib.Path
) -> TrainState:
    template = jax.eval_shape(lambda: create_state(config, task.init_params()))
    # Earlier versions had the numbers of the log among the leaves, not in the metadata.
    of_the_log = ("loss_sum", "loss_count", "bad_step", "bad_metric")
    leaves = {name: leaf for name, leaf in checkpoint.leaves.items() if name not in of_the_log}
    try:
        return from_named_leaves(template, leaves)
    except ValueError as error:
        raise ConfigError(
            f"--workdir={workdir}: its newest checkpoint does not fit the network of this "
            f"version: {error}"
        ) from error


def _losses(config: Config, checkpoint: Checkpoint | None) -> tuple[float, int]:
    """Sum and number of the losses since the last line of metrics."""
    if checkpoint is None or checkpoint.step % config.train.log_every == 0:
        return 0.0, 0
    return checkpoint.meta.get("loss_sum", 0.0), checkpoint.meta.get("loss_count", 0)


def _open_initial(config: Config, task: Task) -> Run | None:
    """The network of `train.init`, from which a new run starts; None if `train.init` is empty.

    Raises:
      ConfigError, CheckpointError, WeightsError: the network is missing, damaged or does not fit.
    """
    if not config.train.init:
        return None
    run = open_initial(config)
    initial_params(config, jax.eval_shape(task.init_params), run.params)
    logging.info("starting from the parameters of %s, step %d", run.source, run.step)
    return run


def _initialised(config: Config, task: Task, trained: Run | None) -> TrainState:
    """A new state; its leaves share no memory, so that the training step can overwrite them."""
    # The code that samples the parameters runs once. On a CPU, compiling it with full
    # optimisation takes three times as long (23 s instead of 7 s) and gains nothing.
    quick = {"xla_backend_optimization_level": 1} if jax.default_backend() == "cpu" else None
    create = jax.jit(lambda: create_state(config, task.init_params()), compiler_options=quick)
    state = jax.tree.map(np.array, create())
    if trained is None:
        return state
    params = initial_params(config, state.params, trained.params)
    ema = jax.tree.map(np.array, params) if jax.tree.leaves(state.ema) else ()
    return state._replace(params=jax.tree.map(np.array, params), ema=ema)


def _due(interval: int, step: int, config: Config) -> bool:
    return bool(interval) and step > 0 and (step % interval == 0 or step == config.train.steps)


def _local(params: Any) -> Any:
    """Parameters on this process's devices only: each process evaluates its own batches."""
    if jax.process_count() == 1:
        return params
    return jax.tree.map(lambda leaf: leaf.addressable_data(0), params)


def _describe(
    title: str,
    state: TrainState,
    sizes: Mapping[str, int],
    devices: int,
    workdir: pathlib.Path,
    start: int,
) -> None:
    count = sum(leaf.size for leaf in jax.tree.leaves(state.params))
    logging.info(
        "%s, %.2f M parameters, %s, %d %s device%s; %s -> %s",
        title,
        count / 1e6,
        ", ".join(f"{n} samples in {split!r}" for split, n in sizes.items()),
        devices,
        jax.default_backend(),
        "" if devices == 1 else "s",
        f"resuming at step {start}" if start else "starting",
        workdir,
    )


def _report_end(workdir: pathlib.Path, step: int, stopped_by: int | None) -> None:
    if stopped_by:
        when = f"after step {step}, checkpoint saved" if step else "before step 1"
        name = signal.Signals(stopped_by).name
        logging.info("stopped by %s %s; run the same command again to resume", name, when)
    else:
        logging.info("done: step %d, results in %s", step, workdir)

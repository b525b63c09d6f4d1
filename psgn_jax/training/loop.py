"""Training, from a configuration to a trained network in a folder.

The folder (`workdir`) gets `config.json`, `metrics.jsonl`, `tensorboard/` and `checkpoints/`. If it
exists, `train` continues from its newest intact checkpoint. On the same machine, the final
parameters have the same bits as without the interruption.
"""

import contextlib
import functools
import math
import pathlib
import signal
import time
import zlib
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
from absl import logging
from jax.sharding import Mesh

from psgn_jax import tasks
from psgn_jax.config.experiment import Config, ConfigError, check_paths, to_dict, to_json
from psgn_jax.config.structured import flatten
from psgn_jax.data import loader
from psgn_jax.data.dataset import RecordReader, doubts_of
from psgn_jax.data.manifest import load_manifest
from psgn_jax.data.schema import RecordError
from psgn_jax.data.workers import check_main_guard
from psgn_jax.system import distributed
from psgn_jax.system.cpu import host_memory
from psgn_jax.system.files import check_folder, local_path, write_atomic
from psgn_jax.system.signals import Stopped, StopSignal
from psgn_jax.system.untrusted import one_line
from psgn_jax.training.log import MetricsWriter, TrainingLog
from psgn_jax.training.step import (
    TrainState,
    create_training,
    data_mesh,
    eval_params,
    put_batch,
    put_replicated,
)
from psgn_jax.weights.checkpoint import Checkpoint, Checkpoints
from psgn_jax.weights.leaves import from_named_leaves, named_leaves
from psgn_jax.weights.opening import initial_params, open_initial
from psgn_jax.weights.run_folder import locked, trained_config

MAY_CHANGE = frozenset((
    "data.path", "data.eval_path",  # folders can be moved
    "data.eval_split", "data.num_eval_points", "data.num_workers", "data.cache_gb",
    "train.steps", "train.log_every", "train.eval_every", "train.checkpoint_every",
    "train.images_every", "train.keep_checkpoints", "train.stop_seconds",
    "eval.batch_size", "eval.max_samples", "eval.fscore_threshold", "eval.emd_tolerance",
    "eval.visible_tolerance", "eval.aligned", "eval.refine",
))  # fmt: skip
"""Fields that may differ when a run is resumed."""


class Outcome(NamedTuple):
    """The final state, and the signal that stopped the training, or None."""

    state: TrainState
    stopped_by: int | None


def train(config: Config, workdir: str | pathlib.Path) -> Outcome:
    """Trains, or resumes training, until `config.train.steps` or a signal.

    After SIGTERM or SIGINT, the current step ends, its checkpoint is saved and the function
    returns; after `train.stop_seconds`, the process ends (`system.signals.StopSignal`).

    Raises:
      ConfigError: before compilation, if the configuration does not fit the data or the machine,
        the checkpoint (apart from `MAY_CHANGE`) or the other processes, or if another training runs
        in this folder.
      UserError: no file can be written to `workdir`.
      OSError: during training, for example if the disk is full.
      NonFiniteError: the loss or the norm of the gradient is not finite.
    """
    check_main_guard()
    workdir = pathlib.Path(local_path(workdir, "workdir"))
    mesh, plan = data_mesh(), config.train
    first = distributed.is_first()
    sizes = _checked(config, workdir, mesh.size)
    task = tasks.create(config, workdir)
    create, train_step = create_training(config, task, mesh)
    _check_memory(config, jax.eval_shape(create), mesh)
    initial, folder = functools.cache(lambda: _initial(config, task)), workdir / "checkpoints"
    if not folder.exists():
        initial()  # a wrong `train.init` is reported before there is a folder
    with contextlib.ExitStack() as stack:
        if first:
            stack.enter_context(locked(workdir))
        else:
            distributed.gather(None)  # wait: the first process may move damaged checkpoints
        checkpoints = Checkpoints(folder, plan.keep_checkpoints, read_only=not first)
        stored = checkpoints.restore_newest()
        if first:
            distributed.gather(None)
        stack.callback(checkpoints.close)
        init = None if stored else initial()
        began, start = time.monotonic(), stored.step if stored else 0
        resumed = _resumed(config, create, stored, workdir) if stored else None
        if start < plan.steps:
            logging.info("compiling, about %d s on two cores", 20 if stored else 30)
        state: TrainState = put_replicated(resumed or _started(create, init), mesh)
        step = saved = start
        millions = sum(leaf.size for leaf in jax.tree.leaves(state.params)) / 1e6
        samples = ", ".join(f"{n} samples in {split!r}" for split, n in sizes.items())
        on = f"{mesh.size} {jax.default_backend()} device{'s' * (mesh.size > 1)}"
        what = f"resuming at step {start}" if start else "starting"
        message = "%s, %.2f M parameters, %s, %s; %s -> %s"
        logging.info(message, task.title, millions, samples, on, what, workdir)
        if first:
            task.keep_sources()
            write_atomic(workdir / "config.json", to_json(config))

        def due(interval: int) -> bool:
            return bool(interval and step) and (step % interval == 0 or step == plan.steps)

        # Scores on other data or with other settings cannot be compared.
        other = plan.eval_every and checkpoints.measure(_measured(config))
        # The network from which the training starts is evaluated, too.
        evaluate_first = due(plan.eval_every) and start not in checkpoints.scores
        evaluate_first |= bool(plan.eval_every and (init or other))
        writer = MetricsWriter(workdir, start, evaluated=not evaluate_first) if first else None
        if writer:
            stack.callback(writer.close)
        since = stored.meta if stored and start % plan.log_every else {}
        losses = since.get("loss_sum", 0.0), since.get("loss_count", 0)
        log = TrainingLog(plan, writer, start, losses, began)

        def save() -> None:
            log.drain()
            if first:
                losses = {"loss_sum": float(log.loss_sum), "loss_count": log.loss_count}
                meta = {"config": to_dict(config), **losses}
                with stop.lock:
                    checkpoints.save(step, named_leaves(state), meta)

        def evaluate() -> None:
            with log.pause(), contextlib.suppress(Stopped):  # a resumed run evaluates first
                options: Any = {"max_samples": config.eval.max_samples, "on_batch": stop.check}
                result = task.evaluate(_local(eval_params(state)), **options)
                scores = {**result.means, **result.chosen}
                log.evaluation(step, scores)
                if first and step:
                    checkpoints.score(step, scores)

        batches = loader.train_batches(
            config.data,
            batch_size=plan.batch_size,
            seed=config.seed,
            start_step=start,
            process_index=jax.process_index(),
            process_count=jax.process_count(),
        )
        stack.callback(batches.close)
        stop: Any = StopSignal(plan.stop_seconds, checkpoints.wait)
        if jax.process_count() > 1:
            stop = distributed.SharedStop()
        stack.enter_context(stop)
        # Python must not exit while a step calls back into it.
        stack.callback(lambda: _wait(state))
        if evaluate_first:
            evaluate()
        while step < plan.steps and not stop.signal:
            state, metrics = train_step(state, put_batch(next(batches), mesh, task.keys))
            step += 1
            log.add(step, metrics)
            stop.after_step(step)
            if due(plan.eval_every) or due(plan.checkpoint_every) or step == plan.steps:
                with log.pause():
                    save()
                saved = step
            if due(plan.eval_every) and not stop.signal:
                evaluate()
            if due(plan.images_every) and writer and not stop.signal:
                with log.pause():
                    if (picture := task.picture(_local(eval_params(state)))) is not None:
                        writer.image(step, "eval/clouds", picture)
        log.drain()
        if saved < step:  # a signal ended the loop
            save()
        with stop.lock:
            checkpoints.wait()
    if stop.signal:
        when = f"after step {step}, checkpoint saved" if step else "before step 1"
        name = signal.Signals(stop.signal).name
        logging.info("stopped by %s %s; run the same command again to resume", name, when)
    else:
        idle = f"nothing to do for train.steps={plan.steps}" if start >= plan.steps else "done"
        logging.info("%s: step %d, results in %s", idle, step, workdir)
    return Outcome(state, stop.signal)


def _checked(config: Config, workdir: pathlib.Path, devices: int) -> dict[str, int]:
    """Checks that the configuration fits data and machine; split -> number of samples."""
    ours, *others = distributed.gather(flatten(config))
    for index, theirs in enumerate(others, 1):
        if different := [name for name in ours if theirs[name] != ours[name]]:
            texts = [f"{name}={ours[name]!r} and {theirs[name]!r}" for name in different]
            raise ConfigError(
                f"processes 0 and {index} have {', '.join(texts)}; expected the same configuration"
            )
    check_folder(workdir, "workdir")
    check_paths(config)
    if (size := config.train.batch_size) % devices:
        raise ConfigError(f"train.batch_size={size}: accepted: a multiple of the {devices} devices")
    data, sizes = config.data, {}
    for split, evaluation in ((data.train_split, False), (data.eval_split, True)):
        name = "eval_path" if evaluation and data.eval_path else "path"
        try:
            sizes[split] = loader.num_samples(data, split, evaluation=evaluation)
        except (ValueError, OSError) as error:
            raise ConfigError(f"data.{name}={getattr(data, name)!r}: {error}") from error
    names, folders = (data.train_split, data.eval_split), (data.folders, data.eval_folders)
    both = dict(zip(names, zip(names, folders, strict=True), strict=True))
    if len(both) == 1 and set(data.folders) != set(data.eval_folders):
        both = {"data.path": (names[0], folders[0]), "data.eval_path": (names[1], folders[1])}
    with contextlib.suppress(RecordError):  # it is reported when the record is needed
        readers = {name: RecordReader(where, split) for name, (split, where) in both.items()}
        for line in doubts_of(readers) if distributed.is_first() else ():
            logging.warning("DOUBTFUL records: %s", one_line(line))
    return sizes


def _check_memory(config: Config, state: TrainState, mesh: Mesh) -> None:
    """Raises `ConfigError` if the state (its shapes) or a batch is larger than the memory."""
    device, copies, limit = mesh.devices.flat[0], 1, None
    if device.platform == "cpu":
        copies, limit = mesh.size, host_memory()
    elif stats := device.memory_stats():
        limit = stats.get("bytes_limit")
    sizes = [math.prod(x.shape) * x.dtype.itemsize for x in jax.tree.leaves(state)]
    (height, width), channels = config.data.image_size, config.model.in_channels
    samples = max(config.train.batch_size, config.eval.batch_size)
    batch = 4 * samples * height * width * channels
    for what, size, remedy in (
        ("the network with Adam's moments", copies * sum(sizes), "model.widths, model.fc_points"),
        ("the images of a batch", batch, "data.image_size, train.batch_size, eval.batch_size"),
    ):
        if limit and size > limit:
            raise ConfigError(
                f"{remedy}: {what} would take {size / 1e9:,.0f} GB, and there are "
                f"{limit / 1e9:,.0f} GB of memory; accepted: smaller values"
            )


def _resumed(
    config: Config, create: Callable[[], TrainState], checkpoint: Checkpoint, workdir: pathlib.Path
) -> TrainState:
    """The state in a checkpoint; `ConfigError` if its configuration or network differs."""
    run = f"workdir={workdir}"
    before, now = flatten(trained_config(checkpoint, workdir)), flatten(config)
    changed = {key: (before[key], now[key]) for key in now if before[key] != now[key]}
    if fatal := sorted(changed.keys() - MAY_CHANGE):
        named = [f"{key}={changed[key][0]!r} (now {changed[key][1]!r})" for key in fatal[:4]]
        named += [f"{len(fatal) - 4} other fields that differ"] * (len(fatal) > 4)
        values = ", ".join(named)
        raise ConfigError(
            f"{run} holds a run with {values}; use another workdir or the same values"
        )
    for key, (old, new) in changed.items():
        logging.info("resuming with %s=%r instead of %r", key, new, old)
    try:
        return from_named_leaves(jax.eval_shape(create), checkpoint.leaves)
    except ValueError as error:
        why = f"its newest checkpoint does not fit the network of this version: {error}"
        raise ConfigError(f"{run}: {why}") from error


def _measured(config: Config) -> dict[str, Any]:
    """What determines the scores: a checksum of the records, and settings."""
    names = ("data.eval_split", "data.num_eval_points", "eval.max_samples", "eval.refine")
    fields, folders = flatten(config), config.data.eval_folders
    splits = [load_manifest(folder).splits() for folder in folders]
    shards = [s.crc32 for found in splits for s in found.get(config.data.eval_split, ())]
    records = distributed.gather(zlib.crc32(repr(shards).encode()))
    if len(set(records)) > 1:
        raise ConfigError(f"{','.join(folders)}: differs between processes; expected the same")
    return {"records": records[0], **{name: fields[name] for name in names}}


def _initial(config: Config, task: tasks.Task) -> Callable[[Any], Any] | None:
    """A map from random parameters to those of `train.init`; None if it is empty."""
    if not config.train.init:
        return None
    opened = open_initial(config)
    init = functools.partial(initial_params, config, trained=opened.params)
    jax.eval_shape(lambda: init(task.init_params()))  # raises if parameters do not fit
    logging.info("starting from the parameters of %s, step %d", opened.source, opened.step)
    return init


def _started(create: Callable[[], TrainState], init: Callable[[Any], Any] | None) -> TrainState:
    """A new state, whose leaves share no memory, because the training step overwrites them."""
    # On a CPU, full optimisation would triple the time of compilation (23 s, not 7 s) for no gain.
    quick = {"xla_backend_optimization_level": 1} if jax.default_backend() == "cpu" else None
    state = jax.tree.map(np.array, jax.jit(create, compiler_options=quick)())
    if init is None:
        return state
    params = init(state.params)
    ema = jax.tree.map(np.array, params) if jax.tree.leaves(state.ema) else ()
    return state._replace(params=jax.tree.map(np.array, params), ema=ema)


def _wait(state: TrainState) -> None:
    """Waits for the current step and ignores its errors."""
    with contextlib.suppress(Exception):
        jax.block_until_ready(state)


def _local(params: Any) -> Any:
    """The parameters on this process's devices, which evaluate a part of the batches."""
    if jax.process_count() == 1:
        return params
    return jax.tree.map(lambda leaf: leaf.addressable_data(0), params)

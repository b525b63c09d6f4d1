"""Training: one function, from a configuration to a trained network in a folder.

The folder (`workdir`) gets `config.json`, `metrics.jsonl`, `tensorboard/` and `checkpoints/`.
If `train` is called again with the same folder, it continues from the newest intact checkpoint. On
the same machine, the final parameters are bit-identical to those of an uninterrupted run.
"""

import contextlib
import pathlib
import signal
from collections.abc import Generator, Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
import optax
from absl import logging
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

from psgn_jax import tasks
from psgn_jax.config import (
    Config,
    ConfigError,
    check_paths,
    flatten,
    parse,
    to_dict,
    to_json,
)
from psgn_jax.data import loader, on_device
from psgn_jax.files import check_folder, write_atomic
from psgn_jax.tasks.base import Task
from psgn_jax.training import processes
from psgn_jax.training import state as state_lib
from psgn_jax.training import step as step_lib
from psgn_jax.training.checkpoint import Checkpoint, Checkpoints
from psgn_jax.training.log import MetricsWriter, TrainingLog
from psgn_jax.training.memory import check_memory
from psgn_jax.training.run_folder import Run, locked
from psgn_jax.training.signals import Stopped, StopSignal
from psgn_jax.weights import initial

MAY_CHANGE = frozenset(
    {
        "data.path",  # a folder can be moved
        "data.eval_path",
        "data.eval_split",
        "data.num_eval_points",
        "data.num_workers",
        "data.cache",
        "data.cache_gb",
        "data.on_device",
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

    state: state_lib.TrainState
    stopped_by: int | None


def train(config: Any, workdir: str | pathlib.Path) -> Outcome:
    """Trains, or resumes training, until `config.train.steps` or a signal.

    After SIGTERM or SIGINT, the current step ends, its checkpoint is saved and the function
    returns.

    Args:
      config: a `Config`, or a mapping for `config.parse`.
      workdir: folder of the run.

    Raises:
      ConfigError: raised before compilation if (a) the configuration is wrong, (b) it differs from
        the checkpoint's in a field that is not in `MAY_CHANGE`, (c) another process trains in this
        folder, or (d) the training needs more memory than is available.
      UserError: no file can be written to `workdir`.
      OSError: during training, for example if the disk is full.
      NonFiniteError: the loss or the norm of the gradient is not finite; the message names the
        metric and the step.
    """
    config = config if isinstance(config, Config) else parse(config)
    workdir = pathlib.Path(workdir)
    group = processes.current()
    with contextlib.ExitStack() as stack:
        with group.agreement():
            if group.is_first:
                check_folder(workdir, "--workdir")
            check_paths(config)
            mesh = step_lib.data_mesh()
            step_lib.check_batch_size(config, mesh)
            task = tasks.create(config, workdir)
            task.check()
            optimizer = state_lib.optimizer(config.optim, config.train.steps)
            check_memory(config, lambda: task.create(optimizer))
            sizes = _check_data(config)
            init = _open_initial(config, workdir, task)
            if group.is_first:
                stack.enter_context(locked(workdir))
        return _Training(config, workdir, mesh, sizes, task, optimizer, init).run()


class _Training:
    """A training after the checks of `train`; no other process trains in its folder."""

    def __init__(
        self,
        config: Config,
        workdir: pathlib.Path,
        mesh: Mesh,
        sizes: Mapping[str, int],
        task: Task,
        optimizer: optax.GradientTransformation,
        init: Run | None = None,
    ) -> None:
        self._config, self._workdir, self._task, self._mesh = config, workdir, task, mesh
        self._init, self._group = init, processes.current()
        self._checkpoints = Checkpoints(
            workdir / "checkpoints",
            config.train.keep_checkpoints,
            read_only=not self._group.is_first,
        )
        self._optimizer = optimizer
        self._state = self._initial_state()
        self._step = self._saved = int(self._state.step)
        _describe(task.title, self._state, sizes, mesh.size, workdir, self._step)
        several = self._group.count > 1
        self._stop = processes.SharedStop(self._group, mesh) if several else StopSignal()

    def run(self) -> Outcome:
        """Trains to the last step, or until a signal."""
        config, start = self._config, self._step
        first = self._group.is_first
        if first:
            self._task.keep_sources()
            write_atomic(self._workdir / "config.json", to_json(config))
        train_step = self._task.train_step(self._optimizer, self._mesh)
        batches = self._batches(start)
        due = _due(config.train.eval_every, start, config)
        # If the training starts from a trained network, that network is evaluated too.
        due |= bool(config.train.eval_every and self._init)
        evaluated = self._group.from_first(lambda: start in self._checkpoints.scores) or not due
        writer = MetricsWriter(self._workdir, start, evaluated=evaluated) if first else None
        self._writer, self._log = writer, TrainingLog(config, writer, start)
        try:
            with self._stop:
                if not evaluated:
                    self._evaluate()
                while self._step < config.train.steps and not self._stop.signal:
                    self._state, metrics = train_step(self._state, next(batches))
                    self._step += 1
                    self._log.add(self._step, metrics)
                    self._stop.after_step()
                    self._after_step()
                self._log.drain()
                if self._saved < self._step:  # the signal came in `_after_step`
                    self._save()
        finally:
            batches.close()
            self._checkpoints.close()
            if writer:
                writer.close()
        self._report_end()
        return Outcome(self._state, self._stop.signal)

    def _initial_state(self) -> state_lib.TrainState:
        """The state of the newest checkpoint, or a new one."""
        replicated = NamedSharding(self._mesh, P())

        def create() -> state_lib.TrainState:
            return self._task.create(self._optimizer)

        if stored := self._newest_checkpoint():
            try:
                leaves = state_lib.from_named_leaves(jax.eval_shape(create), stored)
            except ValueError as error:
                raise ConfigError(
                    f"--workdir={self._workdir}: its newest checkpoint does not fit the network of "
                    f"this version: {error}"
                ) from error
            return step_lib.put_replicated(leaves, replicated)
        # The code that samples the parameters runs once. On a CPU, compiling it with full
        # optimisation takes three times as long (23 s instead of 7 s) and gains nothing.
        quick = {"xla_backend_optimization_level": 1} if jax.default_backend() == "cpu" else None
        state = jax.jit(create, out_shardings=replicated, compiler_options=quick)()
        if self._init is None:
            return state
        initialised = _with_params(self._config, state, self._init.params)
        return step_lib.put_replicated(initialised, replicated)

    def _newest_checkpoint(self) -> dict[str, np.ndarray] | None:
        """The leaves of the newest checkpoint, which the first process reads."""
        checkpoint = None
        with self._group.agreement():
            if self._group.is_first and (checkpoint := self._checkpoints.restore_newest()):
                _check_resumable(self._config, checkpoint, self._workdir)
        if not self._group.from_first(lambda: checkpoint is not None):
            return None
        return self._group.arrays_from_first(checkpoint and checkpoint.leaves)

    def _batches(self, start: int) -> Generator[step_lib.Batch, None, None]:
        """Batches on the devices, beginning with the batch of step `start`."""
        config, mesh, keys = self._config, self._mesh, self._task.keys
        arguments: dict[str, Any] = {
            "batch_size": config.train.batch_size,
            "seed": config.seed,
            "start_step": start,
            "process_index": self._group.index,
            "process_count": self._group.count,
        }
        if config.data.on_device:
            made = on_device.train_batches(config.data, mesh, keys=keys, **arguments)
            if made is not None:
                return made
        return step_lib.put_batches(loader.train_batches(config.data, **arguments), mesh, keys)

    def _after_step(self) -> None:
        """Saves a checkpoint, evaluates and writes pictures, if they are due at this step."""
        train, step = self._config.train, self._step
        ending = step == train.steps or bool(self._stop.signal)
        due_eval = _due(train.eval_every, step, self._config)
        if ending or due_eval or _due(train.checkpoint_every, step, self._config):
            with self._log.pause():
                self._save()
        if due_eval and not self._stop.signal:
            self._evaluate()
        if _due(train.images_every, step, self._config) and not self._stop.signal:
            self._write_picture()

    def _save(self) -> None:
        self._log.drain()
        config = self._config
        meta = {"config": to_dict(config), "seed": config.seed, "data_position": self._step}
        if self._group.is_first:
            self._checkpoints.save(self._step, state_lib.named_leaves(self._state), meta)
        self._saved = self._step

    def _evaluate(self) -> None:
        with self._log.pause():
            try:
                result = self._task.evaluate(
                    _local(state_lib.eval_params(self._state)),
                    max_samples=self._config.eval.max_samples,
                    on_batch=self._stop.check,
                )
            except Stopped:  # a resumed run begins with this evaluation
                self._stop.settle()
                return
            scores = {**result.means, **result.chosen}
            self._log.evaluation(self._step, scores)
            if self._group.is_first and self._step:
                self._checkpoints.score(self._step, scores)

    def _write_picture(self) -> None:
        with self._log.pause():
            if self._writer:
                picture = self._task.picture(_local(state_lib.eval_params(self._state)))
                if picture is not None:
                    self._writer.image(self._step, "eval/clouds", picture)

    def _report_end(self) -> None:
        if self._stop.signal:
            when = f"after step {self._step}, checkpoint saved" if self._step else "before step 1"
            logging.info(
                "stopped by %s %s; run the same command again to resume",
                signal.Signals(self._stop.signal).name,
                when,
            )
            return
        steps, workdir = self._config.train.steps, self._workdir
        logging.info("done: step %d of %d, results in %s", self._step, steps, workdir)


def _due(interval: int, step: int, config: Config) -> bool:
    return bool(interval) and step > 0 and (step % interval == 0 or step == config.train.steps)


def _local(params: Any) -> Any:
    """Parameters on this process's devices only: each process evaluates its own batches."""
    if jax.process_count() == 1:
        return params
    return jax.tree.map(lambda leaf: leaf.addressable_data(0), params)


def _open_initial(config: Config, workdir: pathlib.Path, task: Task) -> Run | None:
    """The network of `train.init`, from which a new run starts.

    None if `train.init` is empty or the run is resumed.

    Raises:
      ConfigError, CheckpointError, WeightsError: the network is missing, damaged or does not fit.
    """
    if not config.train.init:
        return None
    checkpoints = Checkpoints(workdir / "checkpoints", read_only=True)
    if processes.current().from_first(lambda: bool(checkpoints.steps())):
        return None
    run = initial.open_initial(config)
    optimizer = state_lib.optimizer(config.optim, config.train.steps)
    shapes = jax.eval_shape(lambda: task.create(optimizer)).params
    initial.initial_params(config, shapes, run.params)
    logging.info("starting from the parameters of %s, step %d", run.source, run.step)
    return run


def _with_params(config: Config, state: state_lib.TrainState, trained: Any) -> state_lib.TrainState:
    """An initial state with trained parameters; leaves share no memory, so they can be donated."""
    params = initial.initial_params(config, jax.tree.map(np.asarray, state.params), trained)
    ema = jax.tree.map(np.array, params) if jax.tree.leaves(state.ema) else ()
    return state._replace(params=jax.tree.map(np.array, params), ema=ema)


def _check_data(config: Config) -> dict[str, int]:
    """Samples per split; raises `ConfigError` if the data set does not fit the configuration."""
    sizes = {}
    data = config.data
    for field in ("train_split", "eval_split"):
        split = getattr(data, field)
        evaluation = field == "eval_split"
        name = "eval_path" if evaluation and data.eval_path else "path"
        path = getattr(data, name)
        try:
            sizes[split] = loader.num_samples(data, split, evaluation=evaluation)
        except (ValueError, OSError) as error:
            raise ConfigError(f"data.{name}={path!r}: {error}") from error
        if not sizes[split]:
            raise ConfigError(f"data.{field}={split!r}: no samples of this split in {path!r}")
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


def _describe(
    title: str,
    state: state_lib.TrainState,
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

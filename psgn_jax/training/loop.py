"""Training: one function, from a configuration to a trained network in a folder.

The folder (`workdir`) gets `config.json`, `metrics.jsonl`, `tensorboard/` and `checkpoints/`.
Called again with the same folder it goes on from the newest intact checkpoint; what follows, to
the last bit of the parameters, is what an uninterrupted run would have done on that machine.
"""

import collections
import contextlib
import pathlib
import signal
import time
from collections.abc import Mapping
from types import FrameType
from typing import Any, NamedTuple

import jax
import numpy as np
from absl import logging
from jax.sharding import Mesh, NamedSharding
from jax.sharding import PartitionSpec as P

from psgn_jax import registry
from psgn_jax.config import (
    Config,
    ConfigError,
    UserError,
    check_paths,
    flatten,
    parse,
    to_dict,
    to_json,
)
from psgn_jax.data.default import cache_folder
from psgn_jax.tasks import Task
from psgn_jax.training import state as state_lib
from psgn_jax.training import step as step_lib
from psgn_jax.training.checkpoint import Checkpoint, Checkpoints
from psgn_jax.training.log import MetricsWriter, locked, write_atomic

MAY_CHANGE = frozenset(
    {
        "data.path",  # a folder can be moved
        "data.eval_split",
        "data.num_eval_points",
        "data.num_workers",
        "data.cache",
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
"""Fields that a resumed run may have changed; any other one is an error."""


class NonFiniteError(UserError):
    """The loss or its gradient is not finite."""

    exit_code = 3


class Outcome(NamedTuple):
    """How a training ended: the state, and the signal that stopped it early, if one did."""

    state: state_lib.TrainState
    stopped_by: int | None


def train(config: Any, workdir: str | pathlib.Path) -> Outcome:
    """Trains, or goes on training, until `config.train.steps` or a signal.

    SIGTERM and SIGINT let the current step end, save a checkpoint and return.

    Args:
      config: a `Config`, or a mapping for `config.parse`.
      workdir: folder of the run.

    Raises:
      ConfigError: before anything is compiled, for a wrong configuration, or one that differs from
        that of the checkpoint in a field that is not in `MAY_CHANGE`, or while another process
        trains there.
      NonFiniteError: naming metric and step, if the loss or the gradient's norm is not finite.
    """
    config = config if isinstance(config, Config) else parse(config)
    workdir = pathlib.Path(workdir)
    check_paths(config)
    mesh = step_lib.data_mesh()
    step_lib.check_batch_size(config, mesh)
    task: Task = registry.task(config, workdir)
    task.check()
    sizes = _check_data(config, registry.data_source())
    with locked(workdir) if _is_first() else contextlib.nullcontext():
        return _train(config, workdir, mesh, sizes, task)


def _train(
    config: Config,
    workdir: pathlib.Path,
    mesh: Mesh,
    sizes: Mapping[str, int],
    task: Task,
) -> Outcome:
    """`train` after its checks, alone in `workdir`."""
    source = registry.data_source()
    tx = state_lib.optimizer(config.optim, config.train.steps)

    checkpoints = Checkpoints(workdir / "checkpoints", config.train.keep_checkpoints)
    found = checkpoints.restore_newest()
    if found:
        _check_resumable(config, found, workdir)
    replicated = NamedSharding(mesh, P())

    def create() -> state_lib.TrainState:
        return task.create(tx)

    if found:
        leaves = state_lib.from_named_leaves(jax.eval_shape(create), found.leaves)
        state = jax.device_put(leaves, replicated)
    else:
        # Drawing each parameter is code of its own, run once: on a CPU, compiling it with full
        # optimisation takes three times as long (23 s against 7) and gains nothing.
        quick = {"xla_backend_optimization_level": 1} if jax.default_backend() == "cpu" else None
        state = jax.jit(create, out_shardings=replicated, compiler_options=quick)()
    step = start = int(state.step)
    _describe(task.title, state, sizes, mesh.size, workdir, start)
    if jax.process_index() == 0:
        task.keep_sources()
        write_atomic(workdir / "config.json", to_json(config))

    train_step = task.train_step(tx, mesh)
    batches = source.train_batches(
        config.data,
        batch_size=config.train.batch_size,
        seed=config.seed,
        start_step=start,
        process_index=jax.process_index(),
        process_count=jax.process_count(),
    )
    evaluated = start in checkpoints.scores or not _due(config.train.eval_every, start, config)
    writer = MetricsWriter(workdir, start, evaluated=evaluated) if _is_first() else None
    log = _Log(config, writer, start)
    stop = _Stop()
    saved = start

    def save() -> None:
        nonlocal saved
        log.drain()
        meta = {"config": to_dict(config), "seed": config.seed, "data_position": step}
        checkpoints.save(step, state_lib.named_leaves(state), meta)
        saved = step

    def evaluate() -> None:
        with log.pause():
            try:
                result = task.evaluate(
                    _local(state_lib.eval_params(state)),
                    max_samples=config.eval.max_samples,
                    on_batch=stop.check,
                )
            except _Stopped:  # the checkpoint is there; the next start begins with the evaluation
                return
            found = {**result.means, **result.chosen}
            log.evaluation(step, found)
            if _is_first():
                checkpoints.score(step, found)

    def pictures() -> None:
        with log.pause():
            if writer:
                picture = task.picture(_local(state_lib.eval_params(state)))
                if picture is not None:
                    writer.image(step, "eval/clouds", picture)

    try:
        with stop:
            if not evaluated and start:
                evaluate()
            while step < config.train.steps and not stop.signal:
                batch = step_lib.put_batch(next(batches), mesh, task.keys)
                state, metrics = train_step(state, batch)
                step += 1
                log.add(step, metrics)
                ending = step == config.train.steps or bool(stop.signal)
                due_eval = _due(config.train.eval_every, step, config)
                if ending or due_eval or _due(config.train.checkpoint_every, step, config):
                    with log.pause():
                        save()
                if due_eval and not stop.signal:
                    evaluate()
                if _due(config.train.images_every, step, config) and not stop.signal:
                    pictures()
            log.drain()
            if saved < step:  # the signal came while the last step was being wound up
                save()
    finally:
        close = getattr(batches, "close", None)
        if close:
            close()
        checkpoints.close()
        if writer:
            writer.close()
    if stop.signal:
        logging.info(
            "stopped by %s after step %d, checkpoint saved; the same command goes on from there",
            signal.Signals(stop.signal).name,
            step,
        )
    else:
        logging.info("done: step %d of %d, results in %s", step, config.train.steps, workdir)
    return Outcome(state, stop.signal)


def keep_compiled() -> None:
    """Lets JAX keep compiled programs in the cache folder, for faster starts, on accelerators.

    Not on a CPU: XLA then warns that what it reads back was "compiled for another machine" even on
    the same one (jax 0.10), and with a home folder shared by unlike machines it may be right.
    Whoever sets JAX_COMPILATION_CACHE_DIR decides for themselves.
    """
    if jax.default_backend() != "cpu" and not jax.config.values["jax_compilation_cache_dir"]:
        jax.config.update("jax_compilation_cache_dir", str(cache_folder() / "compiled"))


class _Stopped(Exception):  # noqa: N818 - not an error
    """A signal arrived during an evaluation."""


class _Stop:
    """Remembers SIGTERM or SIGINT while the loop runs; a second one acts at once."""

    def __init__(self) -> None:
        self.signal: int | None = None
        self._old: dict[int, Any] = {}

    def __enter__(self) -> "_Stop":
        try:
            for number in (signal.SIGTERM, signal.SIGINT):
                self._old[number] = signal.signal(number, self._handle)
        except ValueError:  # not in the main thread: whoever runs us handles signals
            pass
        return self

    def __exit__(self, *_: object) -> None:
        self._restore()

    def check(self, *_: object) -> None:
        """Raises `_Stopped` if a signal has arrived."""
        if self.signal:
            raise _Stopped

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self.signal = number
        self._restore()

    def _restore(self) -> None:
        for number, handler in self._old.items():
            signal.signal(number, handler)
        self._old = {}


class _Log:
    """Metrics of the steps -> lines, two steps late so that the device never waits for the host.

    It also keeps the host from running ahead of the device by more than those two steps.
    """

    def __init__(self, config: Config, writer: MetricsWriter | None, start: int):
        self._config = config
        self._writer = writer
        self._pending: collections.deque[tuple[int, dict[str, jax.Array]]] = collections.deque()
        self._start = self._last_step = start
        self._began = self._last_time = time.monotonic()
        self._paused = 0.0
        self._last: dict[str, jax.Array] = {}

    def add(self, step: int, metrics: dict[str, jax.Array]) -> None:
        """Takes the metrics of a step that has been dispatched."""
        self._pending.append((step, metrics))
        while len(self._pending) > 2:
            self._pop()
        if step == self._start + 1:
            self.drain()
            logging.info("first step after %.1f s", time.monotonic() - self._began)
            self._restart_clock(step)

    def drain(self) -> None:
        """Waits for all steps; raises `NonFiniteError` if one was not finite."""
        while self._pending:
            self._pop()
        self._check()

    def pause(self) -> "_Pause":
        """Context whose time does not count as training."""
        return _Pause(self)

    def evaluation(self, step: int, means: Mapping[str, float]) -> None:
        """Logs an evaluation."""
        main = ("cd_sq_radius2", "cd_l1_radius", "emd_radius", "fscore", "log_volume_abs_error")
        names = [name for name in means if name in main or name.startswith("iou")]
        numbers = ", ".join(f"{name} {means[name]:.5f}" for name in names)
        logging.info("step %d: evaluation: %s", step, numbers)
        if self._writer:
            self._writer.scalars(step, "eval", means)
            self._writer.flush()

    def add_pause(self, seconds: float) -> None:
        """Takes away from the time of training."""
        self._paused += seconds

    def _pop(self) -> None:
        step, self._last = self._pending.popleft()
        jax.block_until_ready(self._last)
        if step % self._config.train.log_every and step != self._config.train.steps:
            return
        self._check()
        hidden = ("bad_step", "bad_metric", "loss_step")
        values = {k: float(v) for k, v in self._last.items() if k not in hidden and not v.ndim}
        vectors = {k: np.asarray(v) for k, v in self._last.items() if v.ndim}
        seconds = time.monotonic() - self._last_time - self._paused
        steps = step - self._last_step
        if steps:  # none where the first step, which compiles, is itself logged
            values["samples_per_second"] = steps * self._config.train.batch_size / seconds
        self._line(step, values, seconds / max(1, steps))
        if self._writer:
            self._writer.scalars(step, "train", values, vectors)
            self._writer.flush()
        self._restart_clock(step)

    def _restart_clock(self, step: int) -> None:
        self._last_step, self._last_time, self._paused = step, time.monotonic(), 0.0

    def _line(self, step: int, values: Mapping[str, float], seconds_per_step: float) -> None:
        total = self._config.train.steps
        if "samples_per_second" in values:
            left = _duration((total - step) * seconds_per_step)
            speed = f", {values['samples_per_second']:.3g} samples/s, {left} left"
        else:
            speed = ""
        kl = ""
        if "kl" in values:
            kl = f", KL {values['kl']:.3g} nats in {values['active_dims']:.0f} dimensions"
        logging.info(
            "step %d/%d: loss %.5g%s, gradient norm %.3g%s",
            step,
            total,
            values["loss"],
            kl,
            values["grad_norm"],
            speed,
        )

    def _check(self) -> None:
        if self._last and int(self._last["bad_step"]) >= 0:
            metric = step_lib.WATCHED[int(self._last["bad_metric"])]
            raise NonFiniteError(
                f"the {metric} is not finite at step {int(self._last['bad_step'])}; stopped, the "
                "checkpoints are from before; in a new --workdir, a lower optim.learning_rate or "
                "optim.clip_norm=1 may help"
            )


class _Pause:
    def __init__(self, log: _Log):
        self._log = log

    def __enter__(self) -> None:
        self._log.drain()
        self._began = time.monotonic()

    def __exit__(self, *_: object) -> None:
        self._log.add_pause(time.monotonic() - self._began)


def _due(interval: int, step: int, config: Config) -> bool:
    return bool(interval) and step > 0 and (step % interval == 0 or step == config.train.steps)


def _is_first() -> bool:
    return jax.process_index() == 0


def _local(params: Any) -> Any:
    """Parameters on this process's devices alone: each process evaluates by itself."""
    if jax.process_count() == 1:
        return params
    return jax.tree.map(lambda leaf: np.asarray(leaf.addressable_data(0)), params)


def _check_data(config: Config, source: Any) -> dict[str, int]:
    """Samples per split; a `ConfigError` for a data set that cannot serve the configuration."""
    sizes = {}
    for field in ("train_split", "eval_split"):
        split = getattr(config.data, field)
        try:
            sizes[split] = source.num_samples(config.data, split)
        except (ValueError, OSError) as error:
            raise ConfigError(f"data.path={config.data.path!r}: {error}") from error
        if not sizes[split]:
            raise ConfigError(
                f"data.{field}={split!r}: no samples of that split in {config.data.path!r}"
            )
    return sizes


def _check_resumable(config: Config, found: Checkpoint, workdir: pathlib.Path) -> None:
    """Raises `ConfigError` if the checkpoint was made with another configuration."""
    before, now = flatten(parse(found.meta["config"])), flatten(config)
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
        f"going on at step {start}" if start else "starting",
        workdir,
    )


def _duration(seconds: float) -> str:
    seconds = round(seconds)
    hours, minutes = seconds // 3600, seconds % 3600 // 60
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {seconds % 60:02d} s" if minutes else f"{seconds} s"

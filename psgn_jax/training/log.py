"""The output of training: JSON lines, TensorBoard files, and progress on the terminal.

Each line of `metrics.jsonl` is a JSON object with `step`, `kind` ("train" or "eval") and metrics,
which are numbers or lists of numbers. A resumed run removes the lines after its first step.
"""

import collections
import contextlib
import datetime
import errno
import functools
import json
import math
import os
import pathlib
import time
import types
from collections.abc import Iterator, Mapping
from typing import Any

import jax
import numpy as np
from absl import logging

from psgn_jax.config.experiment import TrainConfig
from psgn_jax.evaluation.table import title
from psgn_jax.system.errors import Exit, UserError
from psgn_jax.system.files import finite_or_none, write_atomic


class NonFiniteError(UserError):
    """The loss or its gradient is not finite."""

    exit_code = Exit.INCOMPLETE


class TrainingLog:
    """Logs the metrics of training steps to the terminal and a `writer`.

    A line has the metrics of its step, and the mean `loss` since the previous line. Between lines,
    metrics are read two steps late: the device does not wait for the host, and the host is at most
    two steps ahead. `loss_sum` (float32) and `loss_count` are the sum and number of the losses
    since the last line, from `losses` on. The compilation `began` at this `time.monotonic`.
    """

    def __init__(
        self,
        plan: TrainConfig,
        writer: "MetricsWriter | None",
        start: int,
        losses: tuple[float, int] = (0.0, 0),
        began: float | None = None,
    ):
        self._plan = plan
        self._writer = writer
        self._pending: collections.deque[tuple[int, dict[str, jax.Array]]] = collections.deque()
        self._start = start
        self._restart_clock(start)
        self._began = self._last_time if began is None else began
        self.loss_sum, self.loss_count = np.float32(losses[0]), int(losses[1])

    def add(self, step: int, metrics: dict[str, jax.Array]) -> None:
        """Adds the metrics of a dispatched step; raises `NonFiniteError`."""
        self._pending.append((step, metrics))
        first, due = step == self._start + 1, step % self._plan.log_every == 0
        line = due or step == self._plan.steps
        self._read(0 if first or line else 2)
        if first:
            logging.info("compiled; first step after %.1f s", time.monotonic() - self._began)
            self._restart_clock(step)
        if line:
            self._line(step, jax.device_get(metrics))
            self._restart_clock(step)
        if due:
            self.loss_sum, self.loss_count = np.float32(0), 0

    def drain(self) -> None:
        """Waits for all steps; raises `NonFiniteError` if a loss or gradient is not finite."""
        self._read(0)

    @contextlib.contextmanager
    def pause(self) -> Iterator[None]:
        """Context whose duration does not count as training time."""
        self.drain()
        began = time.monotonic()
        try:
            yield
        finally:
            self._paused += time.monotonic() - began

    def evaluation(self, step: int, means: Mapping[str, float]) -> None:
        names = [name for name in means if title(name) or name.startswith("iou")]
        numbers = ", ".join(f"{name} {means[name]:.5f}" for name in names)
        logging.info("step %d: evaluation: %s", step, numbers)
        if self._writer:
            self._writer.scalars(step, "eval", means)

    def _read(self, ahead: int) -> None:
        """Reads the losses of all steps but the last `ahead`."""
        while len(self._pending) > ahead:
            step, arrays = self._pending.popleft()
            watched = jax.device_get([arrays[k] for k in ("total_loss", "grad_norm", "loss")])
            for name, value in zip(("loss", "gradient norm"), watched, strict=False):
                if not np.isfinite(value):
                    raise NonFiniteError(
                        f"the {name} is not finite at step {step}; training has stopped, and the "
                        "checkpoints are from earlier steps; try a lower optim.learning_rate or "
                        "optim.clip_norm=1 in a new workdir"
                    )
            self.loss_sum, self.loss_count = self.loss_sum + watched[2], self.loss_count + 1

    def _restart_clock(self, step: int) -> None:
        self._last_step, self._last_time, self._paused = step, time.monotonic(), 0.0

    def _line(self, step: int, metrics: Mapping[str, np.ndarray]) -> None:
        vectors = {k: v for k, v in metrics.items() if v.ndim}
        values = {k: float(v) for k, v in metrics.items() if k != "total_loss" and not v.ndim}
        values["loss"] = float(self.loss_sum / np.float32(self.loss_count))
        others = [k for k in values if k not in ("loss", "grad_norm", "learning_rate")]
        each = "".join(f", {k.removeprefix('loss_')} {values[k]:.4g}" for k in others)
        speed, steps, total = "", step - self._last_step, self._plan.steps
        if steps:
            seconds = time.monotonic() - self._last_time - self._paused
            values["samples_per_second"] = steps * self._plan.batch_size / seconds
            left = datetime.timedelta(seconds=round((total - step) * seconds / steps))
            speed = f", {values['samples_per_second']:.3g} samples/s, {left} left"
        logging.info(
            "step %d/%d: loss %.5g%s, gradient norm %.3g%s",
            step, total, values["loss"], each, values["grad_norm"], speed,
        )  # fmt: skip
        if self._writer:
            self._writer.scalars(step, "train", values, vectors)


def read_metrics(path: str | pathlib.Path) -> list[dict[str, Any]]:
    """The lines of a `metrics.jsonl`; an empty list if the file does not exist.

    Skips an incomplete last line and, with a warning, damaged lines.
    """
    entries, damaged = [], 0
    with contextlib.suppress(FileNotFoundError), open(path, "rb") as file:
        for line in file:
            try:
                entry = json.loads(line)
            except (ValueError, RecursionError):
                entry = None
            if isinstance(entry, dict) and type(entry.get("step")) is int:
                entries.append(entry)
            elif line.endswith(b"\n"):
                damaged += 1
    if damaged:
        logging.warning("%s: %d lines are damaged and were skipped", path, damaged)
    return entries


class MetricsWriter:
    """Writes the metrics of a run to `metrics.jsonl` and `tensorboard/` in `workdir`.

    Removes the lines after `step`, where the run resumes, and unless `evaluated` its evaluation.
    """

    def __init__(self, workdir: str | pathlib.Path, step: int = 0, *, evaluated: bool = True):
        self._workdir = pathlib.Path(workdir)
        self._workdir.mkdir(parents=True, exist_ok=True)
        self._step = step
        path = self._workdir / "metrics.jsonl"
        if path.exists():
            kept = [x for x in read_metrics(path) if x["step"] <= step]
            if not evaluated:
                kept = [x for x in kept if x["step"] < step or x.get("kind") != "eval"]
            write_atomic(path, "".join(map(_line, kept)))
        self._file = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)

    def scalars(
        self,
        step: int,
        kind: str,
        values: Mapping[str, float],
        vectors: Mapping[str, np.ndarray] = types.MappingProxyType({}),
    ) -> None:
        """Writes a line, and `kind/name` to TensorBoard; `vectors` are lists or histograms."""
        lists = {name: vector.tolist() for name, vector in vectors.items()}
        # A single write in append mode: if the process is killed, it is rarely cut off.
        line = _line({"step": step, "kind": kind, **values, **lists}).encode()
        with self._named():
            if os.write(self._file, line) < len(line):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            for name, value in values.items():
                if math.isfinite(value):  # tensorboardX prints a line for others
                    self._board.add_scalar(f"{kind}/{name}", value, step)
            for name, vector in vectors.items():
                self._board.add_histogram(f"{kind}/{name}", vector, step)
            self._board.flush()

    def image(self, step: int, name: str, image: np.ndarray) -> None:
        """Writes an image, uint8 [H,W,3], to TensorBoard."""
        with self._named():
            self._board.add_image(name, image, step, dataformats="HWC")

    def close(self) -> None:
        os.close(self._file)
        if "_board" in vars(self):
            with self._named():
                self._board.close()

    @contextlib.contextmanager
    def _named(self) -> Iterator[None]:
        """Adds the folder's name to the errors of writing, which name no file."""
        try:
            yield
        except OSError as error:
            error.filename = error.filename or str(self._workdir)
            raise

    @functools.cached_property
    def _board(self) -> Any:
        import tensorboardX  # here, because this slow import would delay the first step

        folder = self._workdir / "tensorboard"
        # TensorBoard hides events that a killed run wrote after its last checkpoint.
        purge = self._step + 1 if folder.exists() else None
        board = tensorboardX.SummaryWriter(str(folder), purge_step=purge)
        # Write events in this thread: an error in the writer's thread, such as a full disk, would
        # end it, and this thread would wait forever for its queue.
        events = board.file_writer.event_writer
        events.add_event = events._ev_writer.write_event
        return board


def _line(entry: Mapping[str, Any]) -> str:
    return json.dumps(finite_or_none(entry), allow_nan=False) + "\n"

"""What a training writes: JSON lines, tensorboard, and progress on the terminal.

The only importer of tensorboardX. `metrics.jsonl` has one JSON object per line with `step`, `kind`
("train" or "eval") and numbers, or lists of them. A resumed run drops the lines past its first
step, since it will write them again; so lines are neither lost nor doubled.
"""

import collections
import contextlib
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

from psgn_jax.config import Config, UserError
from psgn_jax.files import finite_or_none, write_atomic
from psgn_jax.training.state import WATCHED


class NonFiniteError(UserError):
    """The loss or its gradient is not finite."""

    exit_code = 3


class TrainingLog:
    """Metrics of the steps -> lines, two steps late so that the device never waits for the host.

    It also keeps the host from running ahead of the device by more than those two steps.
    """

    def __init__(self, config: Config, writer: "MetricsWriter | None", start: int):
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

    @contextlib.contextmanager
    def pause(self) -> Iterator[None]:
        """Context whose time does not count as training."""
        self.drain()
        began = time.monotonic()
        try:
            yield
        finally:
            self._paused += time.monotonic() - began

    def evaluation(self, step: int, means: Mapping[str, float]) -> None:
        """Logs an evaluation."""
        main = ("cd_sq_radius2", "cd_l1_radius", "emd_radius", "fscore", "log_volume_abs_error")
        names = [name for name in means if name in main or name.startswith("iou")]
        numbers = ", ".join(f"{name} {means[name]:.5f}" for name in names)
        logging.info("step %d: evaluation: %s", step, numbers)
        if self._writer:
            self._writer.scalars(step, "eval", means)
            self._writer.flush()

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
        terms = [k for k in values if k.startswith("loss_") and k != "loss_of_draws"]
        of_terms = "".join(f", {k.removeprefix('loss_')} {values[k]:.4g}" for k in terms)
        logging.info(
            "step %d/%d: loss %.5g%s%s, gradient norm %.3g%s",
            step,
            total,
            values["loss"],
            of_terms,
            kl,
            values["grad_norm"],
            speed,
        )

    def _check(self) -> None:
        if self._last and int(self._last["bad_step"]) >= 0:
            metric = WATCHED[int(self._last["bad_metric"])]
            raise NonFiniteError(
                f"the {metric} is not finite at step {int(self._last['bad_step'])}; stopped, the "
                "checkpoints are from before; in a new --workdir, a lower optim.learning_rate or "
                "optim.clip_norm=1 may help"
            )


def read_metrics(path: str | pathlib.Path) -> list[dict[str, Any]]:
    """Lines of a `metrics.jsonl`; those torn by a kill are left out. No file, no lines."""
    with contextlib.suppress(FileNotFoundError), open(path, encoding="utf-8") as file:
        return [entry for line in file if (entry := _entry(line)) is not None]
    return []


class MetricsWriter:
    """Writes the metrics of one run below `workdir`.

    Args:
      workdir: gets `metrics.jsonl` and the folder `tensorboard`.
      step: step at which the run (re)starts; everything later is dropped.
      evaluated: whether the evaluation at `step` is done; if not, its line is dropped too.
    """

    def __init__(self, workdir: str | pathlib.Path, step: int = 0, *, evaluated: bool = True):
        self._workdir = pathlib.Path(workdir)
        self._workdir.mkdir(parents=True, exist_ok=True)
        self._step = step
        self._tensorboard: Any = None
        path = self._workdir / "metrics.jsonl"
        if path.exists():
            kept = [
                entry
                for entry in read_metrics(path)
                if entry["step"] < step
                or (entry["step"] == step and (evaluated or entry.get("kind") != "eval"))
            ]
            write_atomic(path, "".join(map(_line, kept)))
        self._file = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)

    def scalars(
        self,
        step: int,
        kind: str,
        values: Mapping[str, float],
        vectors: Mapping[str, np.ndarray] = types.MappingProxyType({}),
    ) -> None:
        """One line of numbers, and the same to tensorboard as `kind/name`.

        `vectors` are lists in the line and distributions in tensorboard.
        """
        lists = {k: [_finite(float(x)) for x in v] for k, v in vectors.items()}
        # One write of a whole line in append mode: a kill leaves all of it or (rarely) a torn end.
        os.write(self._file, _line({"step": step, "kind": kind, **values, **lists}).encode())
        board = self._board()
        for name, value in values.items():
            board.add_scalar(f"{kind}/{name}", value, step)
        for name, vector in vectors.items():
            board.add_histogram(f"{kind}/{name}", vector, step)

    def image(self, step: int, name: str, image: np.ndarray) -> None:
        """A picture uint8 [H,W,3] to tensorboard."""
        self._board().add_image(name, image, step, dataformats="HWC")

    def flush(self) -> None:
        """Hands everything to the operating system."""
        if self._tensorboard is not None:
            self._tensorboard.flush()

    def close(self) -> None:
        """Flushes and closes the files."""
        os.close(self._file)
        if self._tensorboard is not None:
            self._tensorboard.close()

    def _board(self) -> Any:
        if self._tensorboard is None:
            import tensorboardX  # not at the top: it delays the first step by its import

            folder = self._workdir / "tensorboard"
            self._tensorboard = tensorboardX.SummaryWriter(
                str(folder),
                # What a killed run wrote past its checkpoint is hidden by tensorboard.
                purge_step=self._step + 1 if folder.exists() else None,
            )
        return self._tensorboard


def _duration(seconds: float) -> str:
    seconds = round(seconds)
    hours, minutes = seconds // 3600, seconds % 3600 // 60
    if hours:
        return f"{hours} h {minutes:02d} min"
    return f"{minutes} min {seconds % 60:02d} s" if minutes else f"{seconds} s"


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _line(entry: Mapping[str, Any]) -> str:
    return json.dumps(finite_or_none(entry), allow_nan=False) + "\n"


def _entry(line: str) -> dict[str, Any] | None:
    try:
        entry = json.loads(line)
    except json.JSONDecodeError:
        return None
    return entry if isinstance(entry, dict) and isinstance(entry.get("step"), int) else None

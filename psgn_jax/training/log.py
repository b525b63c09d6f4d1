"""What a run writes: JSON lines, tensorboard, progress on a terminal, files whole or not at all.

The only importer of tensorboardX. `metrics.jsonl` has one JSON object per line with `step`, `kind`
("train" or "eval") and numbers, or lists of them. A resumed run drops the lines past its first
step, since it will write them again; so lines are neither lost nor doubled.
"""

import contextlib
import fcntl
import json
import logging as python_logging
import math
import os
import pathlib
import re
import sys
import types
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from absl import flags, logging

from psgn_jax.config import ConfigError
from psgn_jax.data.records import write_atomic as write_atomic  # for whoever writes results


def log_to_terminal() -> None:
    """Shows the progress of this package and of `data_gen`, of others only warnings, on stderr."""
    logging.use_absl_handler()
    if not flags.FLAGS.is_parsed():  # in a notebook: absl would complain with the first line
        flags.FLAGS.mark_as_parsed()
    logging.set_verbosity(logging.INFO)
    logging.set_stderrthreshold(logging.INFO)
    handler = logging.get_absl_handler()
    handler.setFormatter(python_logging.Formatter("%(asctime)s %(message)s", "%H:%M:%S"))
    package = pathlib.Path(__file__).resolve().parents[1]
    own = (f"{package}{os.sep}", f"{package.parent / 'data_gen'}{os.sep}")
    handler.addFilter(
        lambda r: (
            r.levelno >= python_logging.WARNING or os.path.realpath(r.pathname).startswith(own)
        )
    )


@contextlib.contextmanager
def exit_on_user_error() -> Iterator[None]:
    """Ends the process with one line and the error's exit code for what a user can mend.

    Those are the errors that have an `exit_code`: `UserError` and, since the records' code does not
    depend on the configuration's, `RecordError`.
    """
    try:
        yield
    except ValueError as error:
        exit_code = getattr(error, "exit_code", None)
        if exit_code is None:
            raise
        line = " ".join(str(error).split())
        sys.stderr.write(f"error: {line}\n")
        sys.exit(exit_code)


def parse_flags(argv: list[str]) -> list[str]:
    """Parses flags as absl does, but ends with one line whatever is wrong with one.

    For `app.run(..., flags_parser=parse_flags)`.
    """
    with exit_on_user_error():
        try:
            return flags.FLAGS(argv)
        except (AttributeError, KeyError) as error:
            # An unknown field; the message is a repr inside a repr: its quotes and escapes go.
            text = re.sub(r"\\n", " ", str(error.args[0])).translate(str.maketrans("", "", "\\'\""))
            text = " ".join(text.split())
            name = next(iter(re.findall(r"\w+", text)), "")
            given = next((a for a in argv if re.search(rf"\b{name}\b", a)), "--config")
            raise ConfigError(f"{given}: no such field: {text}") from error
        except (flags.Error, TypeError, ValueError, OSError) as error:
            raise ConfigError(str(error)) from error


def finite_or_none(entry: Mapping[str, Any]) -> dict[str, Any]:
    """JSON has no NaN: None, its null, in place of floats that are not finite."""
    return {k: _finite(v) for k, v in entry.items()}


def _finite(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value


@contextlib.contextmanager
def locked(workdir: str | pathlib.Path) -> Iterator[None]:
    """Keeps a second process from writing into a run's folder; the lock ends with the process.

    Raises:
      ConfigError: another process holds the folder.
    """
    path = pathlib.Path(workdir) / ".lock"
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "a") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ConfigError(
                f"--workdir={workdir}: another training is running there; wait for it, end it, "
                "or give another folder"
            ) from None
        except OSError as error:  # file systems without locks
            logging.warning("%s cannot be locked (%s): start no second training there", path, error)
        yield


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


def _line(entry: Mapping[str, Any]) -> str:
    return json.dumps(finite_or_none(entry), allow_nan=False) + "\n"


def _entry(line: str) -> dict[str, Any] | None:
    try:
        entry = json.loads(line)
    except json.JSONDecodeError:
        return None
    return entry if isinstance(entry, dict) and isinstance(entry.get("step"), int) else None

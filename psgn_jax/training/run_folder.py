"""The folder of a run: configuration, checkpoints and scores, as evaluation and prediction read it.

`config.json` holds the configuration, `checkpoints/` what `training.checkpoint` keeps. Reading
changes nothing in the folder: a training may be running there.
"""

import contextlib
import fcntl
import os
import pathlib
from collections.abc import Iterator
from typing import Any, NamedTuple

from absl import logging

from psgn_jax.config import Config, ConfigError, flatten, from_json, parse
from psgn_jax.training.checkpoint import Checkpoint, CheckpointError, Checkpoints
from psgn_jax.training.state import params_from_named_leaves


class Run(NamedTuple):
    """A trained run, opened at one checkpoint.

    Attributes:
      config: of the run.
      step: of the checkpoint.
      params: to evaluate with, averaged ones where the run has some.
      scores: metrics, and numbers chosen such as thresholds, that an evaluation during training
        recorded of the checkpoint; empty if there was none.
      source: where it comes from: the folder, or the name of weights.
      source_kind: which of these, "workdir" or "weights".
    """

    config: Config
    step: int
    params: Any
    scores: dict[str, float]
    source: str = ""
    source_kind: str = "workdir"


def open_run(
    workdir: str | os.PathLike[str], checkpoint: str = "best", *, averaged: bool = True
) -> Run:
    """Opens a run at its best or last checkpoint.

    Args:
      workdir: folder of the run.
      checkpoint: "best" (on the validation metric; the last one, with a warning, where none was
        evaluated or the best is damaged) or "last".
      averaged: whether to take the averaged parameters where the run has some.

    Raises:
      ConfigError: there is no run, or its configuration is not that of the checkpoint.
      CheckpointError: there is no checkpoint that can be read.
    """
    config = load_config(workdir)
    checkpoints = Checkpoints(pathlib.Path(workdir) / "checkpoints", read_only=True)
    try:
        found = _best(checkpoints) if checkpoint == "best" else checkpoints.restore_newest()
    finally:
        checkpoints.close()
    if found is None:
        raise CheckpointError(f"--workdir={workdir}: no checkpoint there")
    _check_fits(config, found, workdir)
    params = params_from_named_leaves(found.leaves, averaged=averaged)
    scores = checkpoints.scores.get(found.step, {})
    return Run(config, found.step, params, scores, str(workdir))


_OF_THE_NETWORK = ("task", "model.", "data.image_size", "data.inputs", "voxels.")


def _check_fits(config: Config, found: Checkpoint, workdir: str | os.PathLike[str]) -> None:
    """Raises `ConfigError` if `config.json` describes another network than the checkpoint's."""
    if "config" not in found.meta:
        return
    trained, now = flatten(parse(found.meta["config"])), flatten(config)
    names = [name for name in now if name.startswith(_OF_THE_NETWORK)]
    if different := [name for name in names if trained[name] != now[name]]:
        texts = [f"{name}={now[name]!r} (trained with {trained[name]!r})" for name in different]
        raise ConfigError(
            f"--workdir={workdir}: config.json does not fit the checkpoint of step {found.step}: "
            f"{', '.join(texts)}; restore config.json"
        )


def load_config(workdir: str | os.PathLike[str]) -> Config:
    """The configuration of a run; raises `ConfigError` if there is none."""
    path = pathlib.Path(workdir) / "config.json"
    try:
        text = path.read_text("utf-8", errors="replace")
    except FileNotFoundError:
        raise ConfigError(f"--workdir={workdir}: no run there ({path} does not exist)") from None
    except OSError as error:
        raise ConfigError(f"--workdir={workdir}: no run there ({error.strerror})") from error
    try:
        return from_json(text)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from None


def _best(checkpoints: Checkpoints) -> Checkpoint | None:
    step = checkpoints.best_step()
    if step is not None:
        try:
            return checkpoints.restore(step)
        except Exception as error:  # whatever orbax raises for what it cannot read
            why = " ".join(str(error).split())[:200]
            logging.warning("the best checkpoint (step %d) is damaged: %s", step, why)
    logging.warning("no best checkpoint to evaluate; using the last one")
    return checkpoints.restore_newest()


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

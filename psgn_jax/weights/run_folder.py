"""The folder of a run: reads configuration, checkpoints and scores for evaluation and prediction.

`config.json` contains the configuration, `checkpoints/` the files of `weights.checkpoint`. Reading
changes nothing in the folder, because a training may be running in it.
"""

import contextlib
import os
import pathlib
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from absl import logging

from psgn_jax.config.experiment import Config, ConfigError, DamagedError, flatten, from_json, parse
from psgn_jax.system import claims
from psgn_jax.system.files import remove_temporaries
from psgn_jax.system.untrusted import refuse_special_files
from psgn_jax.weights.checkpoint import CheckpointError, Checkpoints
from psgn_jax.weights.leaves import params_from_named_leaves


class Trained(NamedTuple):
    """A trained network: a run opened at one checkpoint, or a file of weights.

    Attributes:
      config: configuration of the run.
      step: step of the checkpoint.
      params: parameters for evaluation: the averaged ones if the run has them.
      scores: metrics and chosen thresholds that were recorded for this checkpoint during training;
        empty if it was not evaluated.
      source: the folder of the run, or the name of the weights.
      source_kind: "workdir" if `source` is a folder, "weights" if it is the name of weights.
      sources: the data of weights and their licences, as in `weights.file.Weights`.
      checkpoint: the checkpoint that was asked for, "best" or "last".
    """

    config: Config
    step: int
    params: Any
    scores: dict[str, float]
    source: str = ""
    source_kind: str = "workdir"
    sources: Sequence[Mapping[str, Any]] = ()
    checkpoint: str = "best"


def open_run(
    workdir: str | os.PathLike[str], checkpoint: str = "best", *, averaged: bool = True
) -> Trained:
    """Opens a run at its best or last checkpoint.

    Args:
      checkpoint: "last", or "best" on the validation metric. If no checkpoint was evaluated or the
        best one is damaged, "best" is the last one, with a warning. If `config.json` is damaged,
        the copy in the checkpoint is used, with a warning.

    Raises:
      ConfigError: there is no run, or its configuration does not fit the checkpoint.
      CheckpointError: there is no checkpoint that can be read, or a later version wrote it.
    """
    config, damaged = None, None
    try:
        config = load_config(workdir)
    except DamagedError as error:
        damaged = error
    checkpoints = Checkpoints(pathlib.Path(workdir) / "checkpoints", read_only=True)
    try:
        opened = checkpoints.restore_newest(best_first=checkpoint == "best")
    finally:
        checkpoints.close()
    if opened is None:
        raise CheckpointError(f"workdir={workdir}: no checkpoint there")
    if checkpoint == "best" and opened.step != checkpoints.best_step():
        logging.warning("no best checkpoint can be used; using the last one")
    trained = parse(opened.meta["config"])
    if config is None:
        logging.warning("%s; using the configuration in the checkpoint", damaged)
        config = trained
    _check_fits(config, trained, f"workdir={workdir}", opened.step)
    params = params_from_named_leaves(opened.leaves, averaged=averaged)
    scores = checkpoints.scores.get(opened.step, {})
    return Trained(config, opened.step, params, scores, str(workdir), checkpoint=checkpoint)


_OF_THE_NETWORK = ("task", "model.", "data.image_size", "data.inputs", "voxels.")


def _check_fits(config: Config, trained: Config, run: str, step: int) -> None:
    """Raises `ConfigError` if `config.json` describes another network than the checkpoint's."""
    before, now = flatten(trained), flatten(config)
    names = [name for name in now if name.startswith(_OF_THE_NETWORK)]
    if different := [name for name in names if before[name] != now[name]]:
        texts = [f"{name}={now[name]!r} (trained with {before[name]!r})" for name in different]
        raise ConfigError(
            f"{run}: config.json does not fit the checkpoint of step {step}: {', '.join(texts)}; "
            "restore config.json"
        )


def load_config(workdir: str | os.PathLike[str]) -> Config:
    """The configuration of a run.

    Raises:
      ConfigError: there is none.
      OSError: a file of the run is a named pipe, a socket or a device.
    """
    path = pathlib.Path(workdir) / "config.json"
    _refuse_pipes(workdir)
    try:
        text = path.read_text("utf-8", errors="replace")
    except FileNotFoundError:
        raise ConfigError(f"workdir={workdir}: no run there ({path} does not exist)") from None
    except OSError as error:
        raise ConfigError(f"workdir={workdir}: no run there ({error.strerror})") from error
    try:
        return from_json(text)
    except ConfigError as error:
        raise type(error)(f"{path}: {error}") from None


def _refuse_pipes(workdir: str | os.PathLike[str]) -> None:
    names = ("config.json", "metrics.jsonl", ".lock", "checkpoints")
    refuse_special_files(*(os.path.join(workdir, name) for name in names))


@contextlib.contextmanager
def locked(workdir: str | pathlib.Path) -> Iterator[None]:
    """Locks a run's folder against other trainings; the lock also ends if the process is killed.

    Temporary files that trainings left behind when they were killed are removed.

    Raises:
      ConfigError: another process holds the lock.
    """
    folder = pathlib.Path(workdir)
    folder.mkdir(parents=True, exist_ok=True)
    _refuse_pipes(workdir)
    with contextlib.ExitStack() as stack:
        try:
            held = stack.enter_context(claims.locked(folder / ".lock"))
        except BlockingIOError:
            raise ConfigError(
                f"workdir={workdir}: another training is running there; wait for it, stop it, "
                "or give another folder"
            ) from None
        if held:
            remove_temporaries(folder)
            remove_temporaries(folder / "checkpoints")
        yield

"""Reads configuration, checkpoints and scores from the folder of a run.

`config.json` contains the configuration, `checkpoints/` the files of `weights.checkpoint`. Reading
changes nothing in the folder, because a training may be running there.
"""

import contextlib
import os
import pathlib
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from absl import logging

from psgn_jax.config.experiment import Config, ConfigError, DamagedError, from_json, parse
from psgn_jax.config.structured import flatten
from psgn_jax.system import locks
from psgn_jax.system.files import remove_temporaries
from psgn_jax.system.untrusted import refuse_special_files
from psgn_jax.weights.leaves import params_from_named_leaves

if TYPE_CHECKING:
    from psgn_jax.weights.checkpoint import Checkpoint


class Trained(NamedTuple):
    """A trained network: a run opened at one checkpoint, or a file of weights."""

    config: Config
    step: int
    params: Any  # for evaluation: averaged, if the run has averages
    scores: dict[str, float]  # metrics and chosen thresholds of this checkpoint, if evaluated
    source: str = ""  # the folder of the run, or the name of the weights
    source_kind: str = "workdir"  # or "weights"
    sources: Sequence[dict[str, Any]] = ()  # data and licences of `weights.file`; () = not stated
    checkpoint: str = "best"  # the requested checkpoint, "best" or "last"
    figures: Mapping[str, Any] = {}  # metadata of `weights.file`, if it is or becomes such a file
    dtype: str = "float16"  # of the numbers in the file

    @property
    def name(self) -> str:
        """The last part of `source`."""
        return pathlib.Path(self.source).resolve().name if self.source else ""


def open_run(
    workdir: str | os.PathLike[str], checkpoint: str = "best", *, averaged: bool = True,
    name: str = "workdir",
) -> Trained:  # fmt: skip
    """Opens a run at its last checkpoint, or at the best by the validation metric.

    With a warning, the last checkpoint replaces a missing or damaged best checkpoint, and the
    configuration in the checkpoint a damaged `config.json`. `name` is the argument in messages.

    Raises:
      ConfigError: there is no run, or its configuration does not fit the checkpoint.
      CheckpointError: there is no checkpoint that can be read, or a later version wrote it.
    """
    # Imported here because weights do not need orbax, which takes an eighth of all imports.
    from psgn_jax.weights.checkpoint import CheckpointError, Checkpoints

    config: Config | DamagedError
    try:
        config = load_config(workdir, name)
    except DamagedError as error:
        config = error
    checkpoints = Checkpoints(pathlib.Path(workdir) / "checkpoints", read_only=True)
    try:
        opened = checkpoints.restore_newest(best_first=checkpoint == "best")
    finally:
        checkpoints.close()
    if opened is None:
        raise CheckpointError(f"{name}={workdir}: no checkpoint there")
    if checkpoint == "best" and opened.step != checkpoints.best_step():
        logging.warning("no best checkpoint can be used; using the last one")
    trained = trained_config(opened, workdir, name)
    if isinstance(config, DamagedError):
        logging.warning("%s; using the configuration in the checkpoint", config)
        config = trained
    _check_fits(config, trained, f"{name}={workdir}", opened.step)
    params = params_from_named_leaves(opened.leaves, averaged=averaged)
    scores = checkpoints.scores.get(opened.step, {})
    return Trained(config, opened.step, params, scores, str(workdir), checkpoint=checkpoint)


def trained_config(
    checkpoint: "Checkpoint", workdir: str | os.PathLike[str], name: str = "workdir"
) -> Config:
    """The configuration in a checkpoint; `ConfigError` if it has none."""
    try:
        return parse(checkpoint.meta["config"])
    except (ConfigError, KeyError) as error:
        why = "it is missing" if isinstance(error, KeyError) else error
        raise ConfigError(
            f"{name}={workdir}: the configuration in the checkpoint of step {checkpoint.step} "
            f"cannot be read ({why}); copy the checkpoint again, or give another folder"
        ) from None


_OF_THE_NETWORK = ("task", "model.", "data.image_size", "data.inputs", "voxels.")


def _check_fits(config: Config, trained: Config, run: str, step: int) -> None:
    """Raises `ConfigError` if `config.json` describes another network than the checkpoint."""
    before, now = flatten(trained), flatten(config)
    names = [name for name in now if name.startswith(_OF_THE_NETWORK)]
    if different := [name for name in names if before[name] != now[name]]:
        texts = [f"{name}={now[name]!r} (trained with {before[name]!r})" for name in different]
        raise ConfigError(
            f"{run}: config.json does not fit the checkpoint of step {step}: {', '.join(texts)}; "
            "restore config.json"
        )


def load_config(workdir: str | os.PathLike[str], name: str = "workdir") -> Config:
    """The configuration of a run; `ConfigError` if there is none, `OSError` if it is a pipe."""
    path = pathlib.Path(workdir) / "config.json"
    _refuse_pipes(workdir)
    try:
        text = path.read_text("utf-8", errors="replace")
    except FileNotFoundError:
        raise ConfigError(f"{name}={workdir}: no run there ({path} does not exist)") from None
    except OSError as error:
        raise ConfigError(f"{name}={workdir}: no run there ({error.strerror})") from error
    try:
        return from_json(text)
    except ConfigError as error:
        raise type(error)(f"{path}: {error}") from None


def _refuse_pipes(workdir: str | os.PathLike[str]) -> None:
    names = ("config.json", "metrics.jsonl", ".lock", "checkpoints")
    refuse_special_files(*(os.path.join(workdir, name) for name in names))


@contextlib.contextmanager
def locked(workdir: str | pathlib.Path) -> Iterator[None]:
    """Locks a run's folder, without temporary files; `ConfigError` if another training has it."""
    folder = pathlib.Path(workdir)
    folder.mkdir(parents=True, exist_ok=True)
    _refuse_pipes(workdir)
    with contextlib.ExitStack() as stack:
        try:
            held = stack.enter_context(locks.locked(folder / ".lock"))
        except BlockingIOError:
            raise ConfigError(
                f"workdir={workdir}: another training is running there; wait for it, stop it, "
                "or give another folder"
            ) from None
        if held:
            remove_temporaries(folder)
            remove_temporaries(folder / "checkpoints")
        yield

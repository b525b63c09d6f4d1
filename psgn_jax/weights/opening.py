"""Opens a trained network: from the folder of a run, from a file of weights, or by name.

The names are those of the files of weights in `psgn_jax/weights/`, which are part of the package.
"""

import os
import pathlib
import re

from psgn_jax.config import ConfigError, suggestion
from psgn_jax.training.run_folder import Run, open_run
from psgn_jax.weights.file import SUFFIX, Weights, read_weights

FOLDER = pathlib.Path(__file__).resolve().parent
"""Folder of the files in the package."""


def shipped() -> dict[str, pathlib.Path]:
    """The files of weights in the package by name; the last one is the default.

    They are sorted by name. Digits are compared as numbers: `small-2` comes before `small-10`.
    """
    paths = {path.stem: path for path in FOLDER.glob(f"*{SUFFIX}")}
    return {name: paths[name] for name in sorted(paths, key=_natural)}


def weights_path(name_or_file: str = "") -> pathlib.Path:
    """The file of weights for a name or a path; "" is the default of the package.

    Raises:
      ConfigError: there is no such file; the message says what is accepted.
    """
    known = shipped()
    if not name_or_file:
        if not known:
            raise ConfigError(
                "this version of the package has no weights; expected a trained run "
                "(--workdir=RUN) or a file of weights (--weights=FILE)"
            )
        return list(known.values())[-1]
    path = pathlib.Path(name_or_file)
    if name_or_file in known and not path.is_file():
        return known[name_or_file]
    if path.suffix == SUFFIX or path.is_file():
        return path
    raise ConfigError(
        f"--weights={name_or_file}: {suggestion(name_or_file, known)}accepted: a file of weights"
        + (f", or one of {', '.join(known)}" if known else " (this version contains no weights)")
    )


def open_weights(name_or_file: str = "") -> Run:
    """Opens the network in a file of weights; the name or file is described in `weights_path`.

    Raises:
      ConfigError: there is no such file.
      WeightsError: the file cannot be read.
    """
    path = weights_path(name_or_file)
    return as_run(read_weights(path), path.stem)


def open_network(
    workdir: str | os.PathLike[str] | None = None,
    weights: str | None = None,
    checkpoint: str = "best",
) -> Run:
    """Opens a trained network from a run or from weights.

    If neither is given, the package's default weights are opened.

    Args:
      workdir: folder of a run.
      weights: name or file of weights.
      checkpoint: checkpoint of the run, see `training.run_folder.open_run`.

    Raises:
      ConfigError: both are given, or the network does not exist.
      CheckpointError, WeightsError: the network cannot be read.
    """
    if workdir and weights:
        raise ConfigError(f"--weights={weights}: accepted only without --workdir")
    return open_run(workdir, checkpoint) if workdir else open_weights(weights or "")


def as_run(weights: Weights, name: str) -> Run:
    """Converts weights to an opened run, whose `scores` are the metrics in the file."""
    scores = {k: float(v) for k, v in weights.figures["metrics"].items() if v is not None}
    step = weights.figures["step"]
    return Run(weights.config, step, weights.params, scores, name, "weights", weights.sources)


def _natural(name: str) -> list[tuple[int, str]]:
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", name)]

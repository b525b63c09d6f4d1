"""Opens a trained network: from the folder of a run, from a file of weights, or by name.

The names are those of the files of weights in `psgn_jax/weights/`, which are part of the package.
"""

import os
import pathlib
import re

from psgn_jax.config.experiment import ConfigError, suggestion
from psgn_jax.weights.file import SUFFIX, read_weights
from psgn_jax.weights.run_folder import Run, open_run

FOLDER = pathlib.Path(__file__).resolve().parent
"""Folder of the files in the package."""


def shipped() -> dict[str, pathlib.Path]:
    """The files of weights in the package by name; the last one is the default.

    They are sorted by name. Digits are compared as numbers: `small-2` comes before `small-10`.
    """

    def natural(path: pathlib.Path) -> list[tuple[int, str]]:
        parts = re.split(r"(\d+)", path.stem)
        return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]

    return {path.stem: path for path in sorted(FOLDER.glob(f"*{SUFFIX}"), key=natural)}


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


def open_network(
    workdir: str | os.PathLike[str] | None = None,
    weights: str | None = None,
    checkpoint: str = "best",
) -> Run:
    """Opens a trained network from a run or from weights.

    Args:
      workdir: folder of a run.
      weights: name or file of weights (`weights_path`); used if there is no `workdir`. The `scores`
        of the opened run are then the metrics in the file.
      checkpoint: checkpoint of the run, see `weights.run_folder.open_run`.

    Raises:
      ConfigError: both are given, or the network does not exist.
      CheckpointError, WeightsError: the network cannot be read.
    """
    if workdir and weights:
        raise ConfigError(f"--weights={weights}: accepted only without --workdir")
    if workdir:
        return open_run(workdir, checkpoint)
    path = weights_path(weights or "")
    read = read_weights(path)
    scores = {k: float(v) for k, v in read.figures["metrics"].items() if v is not None}
    step = read.figures["step"]
    return Run(read.config, step, read.params, scores, path.stem, "weights", read.sources)

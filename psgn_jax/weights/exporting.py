"""Exports a trained run to a file of weights."""

import os
import pathlib
from collections.abc import Sequence
from typing import Any

from psgn_jax.config import Config, ConfigError
from psgn_jax.data.manifest import load_manifest
from psgn_jax.data.schema import RecordError
from psgn_jax.training.run_folder import open_run
from psgn_jax.weights.file import Weights, figures_of, read_sources, write_weights


def export_run(
    workdir: str | os.PathLike[str],
    out: str | os.PathLike[str],
    *,
    checkpoint: str = "best",
    averaged: bool = True,
    dtype: str = "float16",
    sources: Sequence[str | os.PathLike[str]] = (),
    samples_before: int = 0,
) -> Weights:
    """Writes a checkpoint of a run as a file of weights.

    Args:
      workdir: folder of the run.
      out: the file.
      checkpoint: "best" or "last", see `training.run_folder.open_run`.
      averaged: whether to export the averaged parameters, if the run has them.
      dtype: "float16" or "float32".
      sources: JSON files that list data and licences (`weights.file.read_sources`).
      samples_before: training samples that the networks of `train.init` had seen before the run;
        they are added to those of the run.

    Raises:
      ConfigError, CheckpointError, WeightsError: the run, an argument or the weights are invalid.
    """
    if samples_before < 0:
        raise ConfigError(f"--samples_before: got {samples_before}, expected 0 or more")
    rows = [row for path in sources for row in read_sources(path)]
    run = open_run(workdir, checkpoint, averaged=averaged)
    # The scores belong to the averaged parameters, because evaluation uses these if they exist.
    is_averaged = averaged and run.config.optim.ema_decay > 0
    measured = is_averaged or not run.config.optim.ema_decay
    figures = figures_of(
        run.config,
        run.params,
        step=run.step,
        averaged=is_averaged,
        metrics=run.scores if measured else {},
        data=_data_of(run.config),
    )
    figures["samples_seen"] += samples_before
    weights = Weights(run.config, run.params, figures, rows, dtype)
    write_weights(out, weights)
    return weights


def _data_of(config: Config) -> list[dict[str, Any]]:
    """Name of each data set; source and number of training samples if its manifest can be read."""
    if not config.data.path:
        return [{"name": "default data set"}]
    rows: list[dict[str, Any]] = []
    for folder in map(pathlib.Path, dict.fromkeys(config.data.folders)):
        rows.append({"name": folder.name})
        try:
            manifest = load_manifest(folder)
        except (RecordError, OSError):
            continue
        shards = manifest.splits().get(config.data.train_split, ())
        rows[-1] |= {"source": manifest.source, "samples": sum(shard.count for shard in shards)}
    return rows

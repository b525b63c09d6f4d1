"""Evaluation of a trained run in its folder: tables, and a gallery of all cases.

Every sample of a split is predicted and counted once. Metrics are those of
`metrics.clouds.evaluate_pair`, or those of the run's own task (`Config.task`); the unit is the
radius of an object's bounding hemisphere.

Files, below `W/eval_<split>_<best|last>/`: `table.txt`, `table.csv`, `table.json` with one row per
category and the two averages, and `samples.csv` with one row per sample.
"""

import dataclasses
import pathlib
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from absl import logging

from psgn_jax import tasks
from psgn_jax.config import ConfigError, check_paths, parse, require_points_task
from psgn_jax.default_data import with_default_data
from psgn_jax.files import write_atomic
from psgn_jax.metrics import table
from psgn_jax.metrics.evaluation import Evaluation
from psgn_jax.models.point_layout import branch_of_point
from psgn_jax.training.run_folder import load_config, open_run
from psgn_jax.viewing import report as report_lib


def evaluate_run(
    workdir: str | pathlib.Path,
    *,
    checkpoint: str = "best",
    split: str | None = None,
    data: str | None = None,
    out: str | pathlib.Path | None = None,
    draws: int = 0,
    on_batch: Callable[[int, Any, np.ndarray], None] | None = None,
) -> Evaluation:
    """Evaluates a checkpoint of a run and writes the tables.

    Args:
      workdir: the run's folder.
      checkpoint: "best" (on the validation metric; the last one if there is none) or "last".
      split: default the configuration's `data.eval_split`.
      data: folder of records in place of the configuration's `data.path`.
      out: folder for the files, default `workdir/eval_<split>_<checkpoint>`.
      draws: add the metrics of so many draws of each image, see `tasks.points.with_draws`;
        0 = none.
      on_batch: as for `training.evaluation.evaluate_split`.

    Raises:
      ConfigError, CheckpointError: one line on what is missing.
    """
    workdir = pathlib.Path(workdir)
    if data is not None:
        check_paths(parse({"data": {"path": data}}))
    run = open_run(workdir, checkpoint)
    config = run.config
    if data is not None:
        config = dataclasses.replace(
            config, data=dataclasses.replace(config.data, path=data, eval_path="")
        )
    check_paths(config)
    config = with_default_data(config)
    split = split or config.data.eval_split
    if draws:
        require_points_task(config, "--draws")
    logging.info("evaluating %s, step %d, split %s", workdir, run.step, split)
    task = tasks.create(config, workdir)
    options = {"draws": draws} if draws else {}
    result = task.evaluate(run.params, split=split, on_batch=on_batch, chosen=run.scores, **options)
    folder = pathlib.Path(out) if out else workdir / f"eval_{split}_{checkpoint}"
    write_atomic(folder / "table.txt", table.text(result))
    write_atomic(folder / "table.csv", table.csv_text(result))
    write_atomic(folder / "samples.csv", table.samples_csv(result))
    document = table.json_text(result, workdir=str(workdir), step=run.step, checkpoint=checkpoint)
    write_atomic(folder / "table.json", document)
    logging.info("tables written to %s", folder)
    return result


def report_runs(
    folder: str | pathlib.Path, workdirs: Sequence[str | pathlib.Path], **options: Any
) -> Evaluation:
    """Evaluates one run, or two to compare, and writes the gallery (`viewing.report`).

    Args:
      folder: for the pages.
      workdirs: one or two folders of runs.
      **options: of `evaluate_run`; `out` is the first run's.

    Returns:
      The first run's evaluation.

    Raises:
      ConfigError, CheckpointError: as `evaluate_run`; runs that see other samples.
    """
    runs: list[Any] = []
    samples: list[Any] = []
    configs = [load_config(workdir) for workdir in workdirs]
    for config in configs:
        require_points_task(config, "--report")
    for number, (workdir, config) in enumerate(zip(workdirs, configs, strict=True)):
        collector = report_lib.Collector()
        own = options if not number else options | {"out": None}
        result = evaluate_run(workdir, on_batch=collector, **own)
        num_fc = len(branch_of_point(config.model).fc)
        label = pathlib.Path(workdir).resolve().name
        runs.append(report_lib.Run(label, result, collector.preds, num_fc))
        samples = samples or collector.samples
    try:
        page = report_lib.write_report(folder, samples, runs)
    except ValueError as error:
        raise ConfigError(f"--report: {error}") from error
    logging.info("gallery written to %s", page)
    return runs[0].evaluation

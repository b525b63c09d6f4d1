"""Evaluates trained runs: writes tables, and a gallery of all samples.

Every sample of a split is evaluated once. The metrics are those of the run's task (`Config.task`),
for clouds `metrics.clouds.evaluate_pair`. The unit is the radius of an object's bounding
hemisphere.

Files in `W/eval_<split>_<best|last>/`, where W is the folder of the run: `table.txt`, `table.csv`
and `table.json` with one row per category and the two averages; `samples.csv` with one row per
sample.
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
      workdir: the folder of the run.
      checkpoint: "best" (by the validation metric; the last one if none was evaluated) or "last".
      split: name of the split; None: `data.eval_split` of the configuration.
      data: folder of records that replaces `data.path` of the configuration.
      out: folder for the files; None: `workdir/eval_<split>_<checkpoint>`.
      draws: number of samples per image for the additional metrics of `tasks.points.with_draws`;
        0 = none.
      on_batch: called with (index of the batch, batch, predictions).

    Raises:
      ConfigError, CheckpointError: the run, its checkpoint or its data are missing or do not match;
        the message is one line.
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
    """Evaluates one run, or two for a comparison, and writes the gallery (`viewing.report`).

    Args:
      folder: folder for the pages.
      workdirs: one or two folders of runs.
      **options: options of `evaluate_run`; `out` applies to the first run only.

    Returns:
      The evaluation of the first run.

    Raises:
      ConfigError, CheckpointError: the errors of `evaluate_run`, or the two runs are evaluated on
        different samples.
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

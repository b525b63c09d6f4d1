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
from psgn_jax.training.run_folder import load_config
from psgn_jax.viewing import report as report_lib
from psgn_jax.weights.opening import open_network, weights_path

FRAMES = ("keep", "place")


def evaluate_run(
    workdir: str | pathlib.Path | None = None,
    *,
    weights: str | None = None,
    checkpoint: str = "best",
    split: str | None = None,
    data: str | None = None,
    out: str | pathlib.Path | None = None,
    draws: int = 0,
    frame: str = "keep",
    on_batch: Callable[[int, Any, np.ndarray], None] | None = None,
) -> Evaluation:
    """Evaluates a checkpoint of a run, or weights, and writes the tables.

    Args:
      workdir: the run's folder.
      weights: name or file of weights, in place of a run; without either those of the package.
      checkpoint: "best" (on the validation metric; the last one if there is none) or "last".
      split: default the configuration's `data.eval_split`.
      data: folder of records in place of the configuration's `data.path`.
      out: folder for the files, default `workdir/eval_<split>_<checkpoint>`, or of weights
        `eval_<weights>_<split>`; with `_placed` after it for `frame="place"`.
      draws: add the metrics of so many draws of each image, see `tasks.points.with_draws`;
        0 = none.
      frame: "place" has every image cropped and placed as a photo is, and its points moved along
        (`data.framing`); "keep" = as framed.
      on_batch: as for `training.evaluation.evaluate_split`.

    Raises:
      ConfigError, CheckpointError, WeightsError: one line on what is missing.
    """
    if data is not None:
        check_paths(parse({"data": {"path": data}}))
    run = open_network(workdir, weights, checkpoint)
    config = run.config
    if data is not None:
        named = dataclasses.replace(config.data, path=data, eval_path="")
        config = dataclasses.replace(config, data=named)
    check_paths(config)
    config = with_default_data(config)
    split = split or config.data.eval_split
    if draws:
        require_points_task(config, "--draws")
    if frame not in FRAMES:
        raise ConfigError(f"--frame={frame}: accepted: {', '.join(FRAMES)}")
    if frame == "place":
        require_points_task(config, "--frame=place")
        config = dataclasses.replace(
            config, data=dataclasses.replace(config.data, eval_frame=frame)
        )
    config = dataclasses.replace(config, eval=dataclasses.replace(config.eval, aligned=True))
    logging.info("evaluating %s, step %d, split %s", run.source, run.step, split)
    task = tasks.create(config, workdir or "")
    options = {"draws": draws} if draws else {}
    result = task.evaluate(run.params, split=split, on_batch=on_batch, chosen=run.scores, **options)
    name = f"{workdir}/eval_{split}_{checkpoint}" if workdir else f"eval_{run.source}_{split}"
    folder = pathlib.Path(out or name + ("_placed" if frame == "place" else ""))
    write_atomic(folder / "table.txt", table.text(result))
    write_atomic(folder / "table.csv", table.csv_text(result))
    write_atomic(folder / "samples.csv", table.samples_csv(result))
    origin = {run.source_kind: run.source, "step": run.step, "frame": frame}
    if workdir:
        origin["checkpoint"] = checkpoint
    document = table.json_text(result, **origin)
    write_atomic(folder / "table.json", document)
    logging.info("tables written to %s", folder)
    return result


def report_runs(
    folder: str | pathlib.Path,
    workdirs: Sequence[str | pathlib.Path | None],
    *,
    weights: str | None = None,
    **options: Any,
) -> Evaluation:
    """Evaluates one run, or two to compare, and writes the gallery (`viewing.report`).

    Args:
      folder: for the pages.
      workdirs: one or two folders of runs; None = the network of `weights`.
      weights: as for `evaluate_run`.
      **options: of `evaluate_run`; `out` is the first run's.

    Returns:
      The first run's evaluation.

    Raises:
      ConfigError, CheckpointError: as `evaluate_run`; runs that see other samples.
    """
    runs: list[Any] = []
    samples: list[Any] = []
    if weights and None not in workdirs:
        raise ConfigError(f"--weights={weights}: accepted without --workdir (one network)")
    configs = [load_config(w) if w else open_network(None, weights).config for w in workdirs]
    for config in configs:
        require_points_task(config, "--report")
    for number, (workdir, config) in enumerate(zip(workdirs, configs, strict=True)):
        collector = report_lib.Collector()
        own = options if not number else options | {"out": None}
        given = None if workdir else weights
        result = evaluate_run(workdir, weights=given, on_batch=collector, **own)
        num_fc = len(branch_of_point(config.model).fc)
        label = (
            pathlib.Path(workdir).resolve().name if workdir else weights_path(weights or "").stem
        )
        runs.append(report_lib.Run(label, result, collector.preds, num_fc))
        samples = samples or collector.samples
    try:
        page = report_lib.write_report(folder, samples, runs)
    except ValueError as error:
        raise ConfigError(f"--report: {error}") from error
    logging.info("gallery written to %s", page)
    return runs[0].evaluation

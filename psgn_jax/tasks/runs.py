"""Evaluates trained runs, and writes tables and a gallery of all samples.

Every sample of a split is evaluated once. The metrics are those of the run's task (`Config.task`);
for clouds they are defined in `metrics.clouds.evaluate_pair`. The unit is the radius of an object's
bounding hemisphere.

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
from psgn_jax.files import check_folder, write_atomic
from psgn_jax.metrics import table
from psgn_jax.metrics.evaluation import Evaluation
from psgn_jax.models.point_layout import branch_of_point
from psgn_jax.training import processes
from psgn_jax.training.run_folder import load_config
from psgn_jax.viewing import report as report_lib
from psgn_jax.viewing.collected import Collector
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
      workdir: the folder of the run; None: evaluate `weights`.
      weights: name or file of weights, instead of a run. If `workdir` is None too, the weights of
        the package are used.
      checkpoint: "last", or "best" by the validation metric. If no checkpoint was evaluated, "best"
        is the last one.
      split: name of the split; None: `data.eval_split` of the configuration.
      data: folder of records that replaces `data.path` and `data.eval_path` of the configuration.
      out: folder for the files; None: `workdir/eval_<split>_<checkpoint>`, or for weights
        `eval_<weights>_<split>`. With `frame="place"`, `_placed` is appended.
      draws: number of predictions per image for the metrics of `tasks.points.with_draws`;
        0 = none.
      frame: "keep": use the images of the records as they are. "place": crop and place every image
        like a photo, and move its true points accordingly (`data.framing`).
      on_batch: called with (index of the batch, batch, predictions).

    Raises:
      ConfigError, CheckpointError, WeightsError: the run, its checkpoint, the weights or the data
        are missing or do not match; the message is one line.
    """
    if data is not None:
        check_paths(parse({"data": {"path": data}}))
    run = open_network(workdir, weights, checkpoint)
    config = run.config
    if data is not None:
        named = dataclasses.replace(config.data, path=data, eval_path="")
        config = dataclasses.replace(config, data=named)
    check_paths(config)
    config = processes.current().first_then_others(lambda: with_default_data(config))
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
    name = f"{workdir}/eval_{split}_{checkpoint}" if workdir else f"eval_{run.source}_{split}"
    folder = pathlib.Path(out or name + ("_placed" if frame == "place" else ""))
    check_folder(folder, "--out")
    task = tasks.create(config, workdir or "")
    options = {"draws": draws} if draws else {}
    result = task.evaluate(run.params, split=split, on_batch=on_batch, chosen=run.scores, **options)
    if not processes.current().is_first:
        return result
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
    """Evaluates one run, or two for a comparison, and writes the gallery (`viewing.report`).

    Args:
      folder: folder for the pages.
      workdirs: one or two folders of runs; None stands for the network of `weights`.
      weights: described in `evaluate_run`.
      **options: options of `evaluate_run`; `out` applies to the first run only.

    Returns:
      The evaluation of the first run.

    Raises:
      ConfigError, CheckpointError, WeightsError: the errors of `evaluate_run`, or the two runs are
        evaluated on different samples.
    """
    runs: list[Any] = []
    samples: Sequence[Any] = ()
    if weights and None not in workdirs:
        raise ConfigError(f"--weights={weights}: accepted only without --workdir")
    check_folder(folder, "--report")
    configs = [load_config(w) if w else open_network(None, weights).config for w in workdirs]
    for config in configs:
        require_points_task(config, "--report")
    for number, (workdir, config) in enumerate(zip(workdirs, configs, strict=True)):
        collector = Collector(folder)
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

"""Evaluates trained networks, and writes tables and a gallery of all samples.

The network's task (`Config.task`) defines the metrics; clouds have the metrics of
`evaluation.clouds.evaluate_pair`. The unit is the radius of an object's bounding hemisphere.

`table.txt`, `table.csv` and `table.json` have a row for each category and the two averages,
`samples.csv` has a row for each sample. They are in the run's folder `eval_<split>_<best|last>`,
or for weights in `eval_<weights>_<split>`; `_placed` follows placed objects, `_refine` refinement.
"""

import dataclasses
import pathlib
from collections.abc import Sequence
from typing import Any

from absl import logging

from psgn_jax import tasks
from psgn_jax.config.experiment import ConfigError, require_points_task
from psgn_jax.evaluation import report as report_lib
from psgn_jax.evaluation import table
from psgn_jax.evaluation.results import Evaluation
from psgn_jax.evaluation.split import OnBatch
from psgn_jax.models import networks
from psgn_jax.system import distributed
from psgn_jax.system.files import check_folder, write_atomic
from psgn_jax.weights.run_folder import Trained

FRAMES = ("keep", "place")


def evaluate_run(
    run: Trained,
    *,
    split: str | None = None,
    out: str | pathlib.Path | None = None,
    draws: int = 0,
    frame: str = "keep",
    refine: bool | None = None,
    on_batch: OnBatch | None = None,
) -> Evaluation:
    """Evaluates an opened network and writes the tables to `out`, or to the folder above.

    `ConfigError` if the task or the data do not fit.

    Args:
      draws: number of predictions per image whose best and mean are measured; 0 = none.
      frame: "keep" uses the images as they are; "place" crops and places objects as in photos, with
        their true points (`data.framing`).
      refine: whether to measure the clouds of `prediction.refine`; None = `eval.refine`.
    """
    config, workdir = run.config, run.source if run.source_kind == "workdir" else ""
    split = split or config.data.eval_split
    if frame not in FRAMES:
        raise ConfigError(f"frame={frame}: accepted: {', '.join(FRAMES)}")
    asked = {"draws": draws, f"frame={frame}": frame != "keep", "refine": refine}
    for option in filter(asked.get, asked):
        require_points_task(config, option)
    refine = config.eval.refine if refine is None else refine
    data = dataclasses.replace(config.data, eval_frame=frame)
    measured = dataclasses.replace(config.eval, aligned=True, refine=refine)
    config = dataclasses.replace(config, data=data, eval=measured)
    logging.info("evaluating %s, step %d, split %s", run.source, run.step, split)
    ends = ("_placed" if frame == "place" else "") + ("_refine" if refine else "")
    folder = output_folder(run, out, "eval", split, ends)
    result: Evaluation = tasks.create(config, workdir).evaluate(
        run.params, split=split, on_batch=on_batch, chosen=run.scores, draws=draws
    )
    if not distributed.is_first():
        return result
    origin = {run.source_kind: run.source, "step": run.step, "frame": frame, "refine": refine}
    origin |= {"checkpoint": run.checkpoint} if workdir else {}
    write_atomic(folder / "table.txt", table.text(result))
    write_atomic(folder / "table.csv", table.csv_text(result))
    write_atomic(folder / "samples.csv", table.samples_csv(result))
    write_atomic(folder / "table.json", table.json_text(result, **origin))
    logging.info("tables written to %s", folder)
    return result


def output_folder(
    run: Trained, out: str | pathlib.Path | None, name: str, split: str, ends: str = ""
) -> pathlib.Path:
    """`out`, or the default folder of results; `UserError` if it cannot be written."""
    default = f"{name}_{run.source}_{split}{ends}"
    if run.source_kind == "workdir":
        default = f"{run.source}/{name}_{split}_{run.checkpoint}{ends}"
    check_folder(out or default, "out")
    return pathlib.Path(out or default)


def report_runs(folder: str | pathlib.Path, runs: Sequence[Trained], **options: Any) -> Evaluation:
    """Evaluates a network, or two to compare, and writes the gallery (`evaluation.report`).

    `options` are those of `evaluate_run`; `out` applies to the first network only.
    """
    for run in runs:
        require_points_task(run.config, "report")
    reported: list[report_lib.Reported] = []
    for run in runs:
        collector = report_lib.Collector(folder)
        result = evaluate_run(run, on_batch=collector, **options)
        options["out"] = None
        num_fc = len(networks.build(run.config.model).branches.fc)
        reported.append(report_lib.Reported(run.name, result, collector, num_fc))
    try:
        page = report_lib.write_report(folder, reported)
    except ValueError as error:
        raise ConfigError(f"report={folder}: {error}") from error
    logging.info("gallery written to %s", page)
    return reported[0].evaluation

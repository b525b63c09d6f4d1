"""Evaluation of a run: `python -m psgn_jax.evaluate --workdir W`.

Every sample of a split is predicted and counted once. Metrics are those of
`metrics.clouds.evaluate_pair`; the unit is the radius of an object's bounding hemisphere. Two
averages are given and named: over samples, and over categories (each category counts the same).

A run whose task is another than points (`Config.task`) is measured as that task says.

Files, below `W/eval_<split>_<best|last>/`: `table.txt`, `table.csv`, `table.json` with one row per
category and the two averages, and `samples.csv` with one row per sample.
"""

import csv
import dataclasses
import io
import json
import pathlib
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from absl import app, flags, logging

from psgn_jax import registry
from psgn_jax.config import Config, ConfigError, check_paths, check_points, from_json
from psgn_jax.losses.chamfer import chamfer_sq_mean
from psgn_jax.losses.distances import map_pairs
from psgn_jax.metrics import clouds as metrics_lib
from psgn_jax.metrics import samples as sample_metrics
from psgn_jax.prediction import sampling
from psgn_jax.training import step as step_lib
from psgn_jax.training.checkpoint import CheckpointError, Checkpoints
from psgn_jax.training.log import (
    exit_on_user_error,
    finite_or_none,
    log_to_terminal,
    parse_flags,
    write_atomic,
)
from psgn_jax.training.state import params_from_named_leaves

_COLUMNS = (
    "cd_sq_radius2",
    "cd_l1_radius",
    "emd_radius",
    "fscore",
    "cd_sq_gt_to_pred_visible_radius2",
    "cd_sq_gt_to_pred_hidden_radius2",
    "visible_share",
)
OVER_SAMPLES, OVER_CATEGORIES = "mean over samples", "mean over categories"


@dataclasses.dataclass(frozen=True)
class Row:
    """One line of the table: a category (or an average), its samples, its mean metrics."""

    name: str
    count: int
    metrics: dict[str, float]


class SampleName(NamedTuple):
    """Which sample a row of `samples.csv` is about; `record` counts those of the split."""

    record: int
    category: str
    model_id: str
    view: int


@dataclasses.dataclass(frozen=True)
class Evaluation:
    """Metrics of every sample of a split, in order.

    Attributes:
      split: the split's name.
      names: one per sample.
      metrics: name -> float64 [samples].
      threshold: the F-score's distance, unit.
      num_points: points of a prediction, points of a truth; most metrics depend on both.
      visible_tolerance: what "visible" means, see `data.visibility`; unit.
      note: below the table, in place of what is said there of points; "" = metrics of points.
      chosen: numbers that were chosen on a split to evaluate with, such as thresholds.
    """

    split: str
    names: list[SampleName]
    metrics: dict[str, np.ndarray]
    threshold: float
    num_points: tuple[int, int]
    visible_tolerance: float = 0.0
    note: str = ""
    chosen: Mapping[str, float] = dataclasses.field(default_factory=dict)

    @property
    def means(self) -> dict[str, float]:
        """Every metric's mean over samples.

        A sample without visible (or hidden) points has no part in the metrics of those; NaN where
        no sample has any. Every other NaN is one of the means too.
        """
        everything = range(len(self.names))
        return {name: _mean(self._counted(name, everything)) for name in self.metrics}

    def _counted(self, name: str, of: Sequence[int]) -> np.ndarray:
        """A metric of some of the samples, without those that have no such points."""
        values, share = self.metrics[name][list(of)], self.metrics.get("visible_share")
        if share is not None and "_visible" in name:
            return values[share[list(of)] > 0]
        if share is not None and "_hidden" in name:
            return values[share[list(of)] < 1]
        return values

    def rows(self) -> list[Row]:
        """A row per category by name, then the mean over samples and over categories."""
        members: dict[str, list[int]] = {}
        for i, name in enumerate(self.names):
            members.setdefault(name.category or "(none)", []).append(i)
        rows = [
            Row(name, len(indices), {k: _mean(self._counted(k, indices)) for k in self.metrics})
            for name, indices in sorted(members.items())
        ]
        over_categories = {
            name: _mean([_mean(v) for of in members.values() if len(v := self._counted(name, of))])
            for name in self.metrics
        }
        return [
            *rows,
            Row(OVER_SAMPLES, len(self.names), self.means),
            Row(OVER_CATEGORIES, len(self.names), over_categories),
        ]

    def header(self, metric: str) -> str:
        """A metric's name with its unit, as it heads a column."""
        if of_draws := re.fullmatch(r"(.*)_(best|mean)_of_(\d+)", metric):
            return f"{of_draws[2]} of {of_draws[3]} draws: {self.header(of_draws[1])}"
        return {
            "cd_sq_radius2": "CD squared [radius^2]",
            "cd_sq_pred_to_gt_radius2": "pred to truth [radius^2]",
            "cd_sq_gt_to_pred_radius2": "truth to pred [radius^2]",
            "cd_l1_radius": "CD-L1 [radius]",
            "emd_radius": "EMD [radius]",
            "total_mutual_difference_radius2": "total mutual difference [radius^2]",
            "fscore": f"F-score at {self.threshold:g} radius [%]",
            "cd_sq_gt_to_pred_visible_radius2": "visible truth to pred [radius^2]",
            "cd_sq_gt_to_pred_hidden_radius2": "hidden [radius^2]",
            "cd_l1_gt_to_pred_visible_radius": "visible truth to pred [radius]",
            "cd_l1_gt_to_pred_hidden_radius": "hidden truth to pred [radius]",
            "visible_share": "visible [%]",
            "log_volume_abs_error": "|log predicted - log true volume|",
            "log_volume_spread": "the same of the split's mean",
        }.get(metric, f"{metric} [fraction]")

    def text(self) -> str:
        """The table as text."""
        names = [name for name in _COLUMNS if name in self.metrics]
        if self.note:
            names = list(self.metrics)
        names += [name for name in self.metrics if "_of_" in name or "mutual" in name]
        head = ["category", "samples", *map(self.header, names)]
        body = [
            [row.name, str(row.count), *(_number(name, row.metrics[name]) for name in names)]
            for row in self.rows()
        ]
        widths = [max(map(len, column)) for column in zip(head, *body, strict=True)]
        lines = [_aligned(head, widths), "-" * (sum(widths) + 2 * len(widths) - 2)]
        lines += [_aligned(line, widths) for line in body[:-2]]
        lines += [lines[1], *(_aligned(line, widths) for line in body[-2:])]
        if self.note:
            return "\n".join(lines) + f"\n\nSplit {self.split!r}. {self.note}\n"
        emd = ""
        if "emd_gap" in self.metrics:
            gap = 100 * float(np.max(self.metrics["emd_gap"]))
            emd = f""" EMD: mean distance of matched points,
each used once, of the prediction and as many true points; at most {gap:.2f} % above the least."""
        visibility = ""
        if "visible_share" in self.metrics:
            visibility = f"""
Visible: true points within {self.visible_tolerance:g} radius of what the depth image measured;
hidden: the others. Their columns: mean over such points of the squared distance to the nearest
predicted one."""
        note = f"""
Split {self.split!r}, {self.num_points[0]} predicted points against {self.num_points[1]} true ones.
radius = that of an object's bounding hemisphere, the unit of all coordinates.
CD squared: mean over predicted points of the squared distance to the nearest true point, plus the
mean over true points of that to the nearest predicted one. CD-L1: half the sum of both means of the
distances themselves.{emd}{visibility}
"""
        return "\n".join(lines) + "\n" + note

    def csv(self) -> str:
        """The table as CSV; the F-score, precision and recall are fractions here."""
        rows = [[r.name, r.count, *r.metrics.values()] for r in self.rows()]
        return _csv(["category", "samples", *self.metrics], rows)

    def samples_csv(self) -> str:
        """One row per sample."""
        columns = [values.tolist() for values in self.metrics.values()]
        rows = [[*name, *numbers] for name, *numbers in zip(self.names, *columns, strict=True)]
        return _csv([*SampleName._fields, *self.metrics], rows)

    def json(self, **more: Any) -> str:
        """The table as JSON, with fractions as `csv`; `more` is stored beside it.

        JSON has no NaN: null stands for what is not finite.
        """
        *categories, over_samples, over_categories = self.rows()
        of_points = {
            "num_pred_points": self.num_points[0],
            "num_gt_points": self.num_points[1],
            "fscore_threshold": self.threshold,
        }
        document = {
            **more,
            "split": self.split,
            "samples": over_samples.count,
            **(self.chosen if self.note else of_points),
            "categories": {
                r.name: {"samples": r.count, **finite_or_none(r.metrics)} for r in categories
            },
            OVER_SAMPLES.replace(" ", "_"): finite_or_none(over_samples.metrics),
            OVER_CATEGORIES.replace(" ", "_"): finite_or_none(over_categories.metrics),
        }
        return json.dumps(document, indent=2, allow_nan=False) + "\n"


def make_step(config: Config, model: Any) -> Callable[..., Any]:
    """The compiled evaluation step, over the local devices if they divide the batch."""

    def pair(pred: Any, gt: Any, visible: Any = None) -> Any:
        # A bijection wants at least as many true points; without them there is no EMD.
        emd_tolerance = config.eval.emd_tolerance if len(pred) <= len(gt) else 0
        return metrics_lib.evaluate_pair(
            pred,
            gt,
            visible,
            threshold=config.eval.fscore_threshold,
            emd_tolerance=emd_tolerance or None,
        )

    return over_devices(
        config,
        step_lib.input_keys(config),
        lambda mesh: step_lib.make_eval_step(config, model, pair, mesh),
    )


def over_devices(
    config: Config, keys: Sequence[str], make: Callable[[step_lib.Mesh], Callable[..., Any]]
) -> Callable[..., Any]:
    """`make(mesh)`, an evaluation step, fed with `keys` of a batch of the host.

    The mesh is of the local devices, or of one if they do not divide the batch.
    """
    devices = jax.local_devices()
    if config.eval.batch_size % len(devices):
        devices = devices[:1]
    mesh = step_lib.data_mesh(devices)
    step = make(mesh)

    replicated = jax.sharding.NamedSharding(mesh, step_lib.P())
    split = jax.sharding.NamedSharding(mesh, step_lib.P("data"))

    def run(params: Any, batch: Any, index: int) -> Any:
        # The parameters may come from a training on more devices than share an evaluation.
        params = jax.device_put(params, replicated)
        # Visible points are those of records with depth; the network may not see the depth.
        wanted = (*keys, "visible") if "visible" in batch else keys
        device_batch = jax.device_put({k: batch[k] for k in wanted}, split)
        return step(params, device_batch, np.int32(index))

    return run


def with_draws(
    config: Config, model: Any, eval_step: Callable[..., Any], num_draws: int
) -> Callable[..., Any]:
    """An evaluation step that also measures `num_draws` draws of each image.

    Added to the metrics of `eval_step`: best-of-K and mean-of-K of the Chamfer distance, of the EMD
    where `eval.emd_tolerance` asks for it, and `total_mutual_difference_radius2`, see
    `metrics.samples`. The draws are those of `prediction.sampling.draws` with the configuration's
    seed.

    Raises:
      ConfigError: the network has no random input.
    """
    sample = sampling.make_draws(config, model, num_draws)

    @jax.jit
    def measure(points: Any, gt: Any, mutual: Any) -> dict[str, Any]:
        distances: dict[str, Any] = {"cd_sq_radius2": chamfer_sq_mean}
        if config.eval.emd_tolerance and points.shape[2] <= gt.shape[1]:
            tolerance = config.eval.emd_tolerance
            distances["emd_radius"] = lambda a, b: metrics_lib.emd(a, b, tolerance=tolerance).emd

        def one(draws: Any, gt: Any) -> dict[str, Any]:
            return sample_metrics.summarise_draws(draws, gt, distances)

        found = map_pairs(one)(points, gt)
        if num_draws > 1:
            difference = jax.vmap(sample_metrics.total_mutual_difference)
            found["total_mutual_difference_radius2"] = difference(mutual)
        return found

    def run(params: Any, batch: Any, index: int) -> Any:
        points, values = eval_step(params, batch, index)
        found = sample(params, batch, config.seed, index * len(batch["image"]))
        return points, {**values, **measure(found.points, batch["points"], found.mutual)}

    return run


def evaluate(
    config: Config,
    params: Any,
    *,
    split: str | None = None,
    max_samples: int = 0,
    eval_step: Callable[..., Any] | None = None,
    on_batch: Callable[[int, Any, np.ndarray], None] | None = None,
) -> Evaluation:
    """Metrics of a network on a split, every sample counted once.

    Args:
      config: the run's configuration.
      params: parameters of the network.
      split: default `config.data.eval_split`.
      max_samples: only the first so many; 0 = all.
      eval_step: from `make_step`, to compile it once for several evaluations.
      on_batch: called with (index of the batch, batch, points [B,N,3]).

    Raises:
      ConfigError: if the split has no samples.
    """
    split = split or config.data.eval_split
    source = registry.data_source()
    eval_step = eval_step or make_step(config, registry.build_model(config.model))
    names: list[SampleName] = []
    num_pred = 0
    parts: list[dict[str, np.ndarray]] = []
    batches = source.eval_batches(
        config.data,
        split=split,
        batch_size=config.eval.batch_size,
        seed=config.seed,
        visible_tolerance=config.eval.visible_tolerance,
    )
    for index, batch in enumerate(batches):
        points, values = eval_step(params, batch, index)
        keep = np.flatnonzero(batch["valid"])
        if max_samples:
            keep = keep[: max_samples - len(names)]
        num_pred, start = points.shape[1], index * config.eval.batch_size
        names += [
            SampleName(start + i, batch["category"][i], batch["model_id"][i], batch["view"][i])
            for i in keep.tolist()
        ]
        parts.append({k: np.asarray(v, np.float64)[keep] for k, v in values.items()})
        if on_batch:
            on_batch(index, batch, np.asarray(points))
        if max_samples and len(names) >= max_samples:
            break
    if not names:
        raise ConfigError(f"the split {split!r} of data.path={config.data.path!r} has no samples")
    merged = {k: np.concatenate([part[k] for part in parts]) for k in parts[0]}
    num_points = num_pred, config.data.num_eval_points
    return Evaluation(
        split,
        names,
        merged,
        config.eval.fscore_threshold,
        num_points,
        config.eval.visible_tolerance,
    )


def evaluate_workdir(
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
      draws: add the metrics of so many draws of each image, see `with_draws`; 0 = none.
      on_batch: as for `evaluate`.

    Raises:
      ConfigError, CheckpointError: one line on what is missing.
    """
    workdir = pathlib.Path(workdir)
    config = load_config(workdir)
    if data is not None:
        config = dataclasses.replace(config, data=dataclasses.replace(config.data, path=data))
    check_paths(config)
    split = split or config.data.eval_split
    if draws:
        check_points(config, "--draws")
    step, params = load_params(workdir, checkpoint)
    logging.info("evaluating %s, step %d, split %s", workdir, step, split)
    task = registry.task(config, workdir)
    more = {"draws": draws} if draws else {}
    chosen = load_scores(workdir, step)
    result = task.evaluate(params, split=split, on_batch=on_batch, chosen=chosen, **more)
    folder = pathlib.Path(out) if out else workdir / f"eval_{split}_{checkpoint}"
    write_atomic(folder / "table.txt", result.text())
    write_atomic(folder / "table.csv", result.csv())
    write_atomic(folder / "samples.csv", result.samples_csv())
    write_atomic(
        folder / "table.json", result.json(workdir=str(workdir), step=step, checkpoint=checkpoint)
    )
    logging.info("tables written to %s", folder)
    return result


def report(
    folder: str | pathlib.Path, workdirs: Sequence[str | pathlib.Path], **options: Any
) -> Evaluation:
    """Evaluates one run, or two to compare, and writes the gallery (`viewing.report`).

    Args:
      folder: for the pages.
      workdirs: one or two folders of runs.
      **options: of `evaluate_workdir`; `out` is the first run's.

    Returns:
      The first run's evaluation.

    Raises:
      ConfigError, CheckpointError: as `evaluate_workdir`; runs that see other samples.
    """
    # Here, since its pages and pictures are wanted by nothing else of this module.
    from psgn_jax.models.point_out_net import branch_of_point
    from psgn_jax.viewing import report as report_lib

    runs: list[Any] = []
    samples: list[Any] = []
    for workdir in workdirs:
        check_points(load_config(workdir), "--report")
    for number, workdir in enumerate(workdirs):
        collector = report_lib.Collector()
        own = options if not number else options | {"out": None}
        result = evaluate_workdir(workdir, on_batch=collector, **own)
        num_fc = len(branch_of_point(load_config(workdir).model).fc)
        label = pathlib.Path(workdir).resolve().name
        runs.append(report_lib.Run(label, result, collector.preds, num_fc))
        samples = samples or collector.samples
    try:
        page = report_lib.write_report(folder, samples, runs)
    except ValueError as error:
        raise ConfigError(f"--report: {error}") from error
    logging.info("gallery written to %s", page)
    return runs[0].evaluation


def load_config(workdir: str | pathlib.Path) -> Config:
    """The configuration of a run; raises `ConfigError` if there is none."""
    path = pathlib.Path(workdir) / "config.json"
    try:
        return from_json(path.read_text())
    except FileNotFoundError:
        raise ConfigError(f"--workdir={workdir}: no run there ({path} does not exist)") from None


def load_scores(workdir: str | pathlib.Path, step: int) -> dict[str, float]:
    """What the evaluation of a run's checkpoint found and chose; nothing if there was none."""
    checkpoints = Checkpoints(pathlib.Path(workdir) / "checkpoints", read_only=True)
    return checkpoints.scores.get(step, {})


def load_params(workdir: str | pathlib.Path, which: str = "best") -> tuple[int, Any]:
    """(step, parameters to evaluate with) of a run's best or last checkpoint.

    Raises:
      CheckpointError: if there is none that can be read.
    """
    checkpoints = Checkpoints(pathlib.Path(workdir) / "checkpoints", read_only=True)
    try:
        found = None
        best = checkpoints.best_step() if which == "best" else None
        if best is not None:
            try:
                found = checkpoints.restore(best)
            except Exception as error:  # whatever orbax raises for what it cannot read
                why = " ".join(str(error).split())[:200]
                logging.warning("the best checkpoint (step %d) is damaged: %s", best, why)
        if found is None:
            if which == "best":
                logging.warning("no best checkpoint to evaluate; using the last one")
            found = checkpoints.restore_newest()
    finally:
        checkpoints.close()
    if found is None:
        raise CheckpointError(f"--workdir={workdir}: no checkpoint there")
    return found.step, params_from_named_leaves(found.leaves)


def _mean(values: Sequence[float] | np.ndarray) -> float:
    return float(np.mean(values)) if len(values) else float("nan")


def _number(metric: str, value: float) -> str:
    if metric in ("fscore", "visible_share"):
        return f"{100 * value:.2f}"
    return f"{value:.5f}"


def _aligned(cells: Sequence[str], widths: Sequence[int]) -> str:
    first, *rest = (
        cell.ljust(w) if i == 0 else cell.rjust(w)
        for i, (cell, w) in enumerate(zip(cells, widths, strict=True))
    )
    return "  ".join([first, *rest])


def _csv(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="\n").writerows([head, *rows])
    return buffer.getvalue()


def _main(argv: Sequence[str]) -> None:
    log_to_terminal()
    values = flags.FLAGS
    with exit_on_user_error():
        if len(argv) > 1:
            raise ConfigError(f"unexpected argument {argv[1]!r}")
        if values.compare and not values.report:
            raise ConfigError(f"--compare={values.compare}: accepted with --report=DIR")
        names = ("checkpoint", "split", "data", "out", "draws")
        options: dict[str, Any] = {name: values[name].value for name in names}
        if values.report:
            workdirs = [values.workdir, *([values.compare] if values.compare else [])]
            result = report(values.report, workdirs, **options)
        else:
            result = evaluate_workdir(values.workdir, **options)
    sys.stdout.write(result.text())


if __name__ == "__main__":
    flags.DEFINE_string("workdir", None, "Folder of the run.", required=True)
    flags.DEFINE_enum("checkpoint", "best", ["best", "last"], "Which checkpoint.")
    flags.DEFINE_string("split", None, "Split; default: data.eval_split of the run.")
    flags.DEFINE_string("data", None, "Folder of records in place of the run's data.path.")
    flags.DEFINE_string("out", None, "Folder for the tables; default: inside the workdir.")
    flags.DEFINE_integer("draws", 0, "Also measure so many draws of each image.", lower_bound=0)
    flags.DEFINE_string("report", None, "Folder for a gallery of all cases as pages.")
    flags.DEFINE_string("compare", None, "Folder of a second run for the gallery.")
    app.run(_main, flags_parser=parse_flags)

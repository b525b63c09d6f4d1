"""Trains the configurations of a study, measures each run, and writes a table and a figure.

Each training is an ordinary run in `WORKDIR/CONFIG-SEED`: a stopped study resumes, and a finished
run is not trained again. We measure last checkpoints, because most studies measure the samples on
which the best checkpoints were chosen. The results are `NAME.md` (tables), `NAME.csv` (all
numbers), `NAME.png`, and `NAME_curves.png`, the metrics during training against the samples seen.
"""

import dataclasses
import math
import pathlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from absl import logging

from psgn_jax import tasks
from psgn_jax.config import files
from psgn_jax.config.experiment import Config, ConfigError, check_paths, parse, to_dict
from psgn_jax.data import loader
from psgn_jax.data.manifest import load_manifest
from psgn_jax.evaluation.results import SampleName
from psgn_jax.evaluation.table import Lines, aligned, csv_of, markdown
from psgn_jax.studies import figures
from psgn_jax.system.errors import UserError
from psgn_jax.system.files import write_atomic
from psgn_jax.training import loop
from psgn_jax.training.log import read_metrics
from psgn_jax.weights.run_folder import load_config, open_run

Case = Mapping[str, np.ndarray]  # arrays of a sample, including its prediction `pred`

CASE = ("image", "points", "intrinsics", "extrinsics")
"""Arrays of a sample that are kept by default, besides `pred`."""

NUM_SHOWN = 6  # evenly spaced samples in the figure

Overrides = Mapping[str, Any]  # dotted name of a field -> its value


class Run(NamedTuple):
    """A training of a study, in its folder."""

    name: str  # of its configuration
    seed: int
    folder: pathlib.Path
    config: Config


class Measured(NamedTuple):
    """Measures of one run."""

    names: Sequence[SampleName]  # the same for all runs of a study
    # Name -> float64 [samples], NaN for samples without the metric; [1] for one of the whole run.
    metrics: Mapping[str, np.ndarray]
    shown: Any = None  # data for the figure, by default {number: sample}
    about: str = ""  # numbers of samples and points, for the text below the tables


Results = Mapping[str, Sequence[Measured]]
"""Configuration -> the measures of its runs, one for each seed."""


def train_network(run: Run) -> None:
    """Trains or resumes a run; raises `UserError` if a signal stopped it."""
    outcome = loop.train(run.config, run.folder)
    if outcome.stopped_by:
        stopped = UserError("stopped by a signal; the same command continues")
        stopped.exit_code = 128 + outcome.stopped_by
        raise stopped


def evaluate(
    run: Run,
    of_sample: Callable[[Case], Mapping[str, float]] = lambda _: {},
    *,
    keys: Sequence[str] = CASE,
) -> Measured:
    """The metrics of a run's last checkpoint on every sample of the evaluation split.

    `of_sample` maps the arrays `keys`, as far as a batch has them, and `pred` to further metrics.
    """
    opened, config = open_run(run.folder, "last"), run.config
    split = config.data.eval_split
    logging.info("measuring %s, step %d, on %r", run.folder, opened.step, split)
    total = loader.num_samples(config.data, split, evaluation=True)
    wanted = {int(i) for i in np.linspace(0, total - 1, NUM_SHOWN)}
    further: list[Mapping[str, float]] = []
    shown: dict[int, Case] = {}

    def keep(index: int, batch: Any, predictions: np.ndarray) -> None:
        for row in np.flatnonzero(batch["valid"]).tolist():
            # Copies, because views would keep the whole batch in memory.
            case = {key: np.array(batch[key][row]) for key in keys if key in batch}
            case["pred"] = np.array(predictions[row])
            further.append(of_sample(case))
            if (number := index * config.eval.batch_size + row) in wanted:
                shown[number] = case

    task = tasks.create(config, run.folder)
    found = task.evaluate(opened.params, on_batch=keep, chosen=opened.scores)
    metrics = dict(found.metrics)
    metrics |= {key: np.array([of[key] for of in further], np.float64) for key in further[0]}
    about = f"{len(found.names)} samples of {split!r} of {', '.join(config.data.eval_folders)}"
    if not found.note:
        about += f", {found.num_points[0]} predicted points, {found.num_points[1]} true points"
    return Measured(found.names, metrics, shown, about)


@dataclasses.dataclass(frozen=True)
class Study:
    """An experiment: its runs, their measures, and the tables and the figure of the results."""

    name: str  # of the result files
    base: Overrides  # changes of the recipe for all configurations
    # (base, function: configuration -> folder with the same seed) -> {configuration: overrides}
    configs: Callable[[Config, Callable[[str], str]], Mapping[str, Overrides]]
    # Metric -> title of its row, which ends with the unit in brackets; empty: all metrics.
    metrics: Mapping[str, str]
    figure: Callable[[Results], figures.Figure]
    measure: Callable[[Run], Measured] = evaluate
    pairs: Sequence[tuple[str, str]] = ()  # show these differences, first minus second
    tables: Callable[[Results], Sequence[Lines]] = lambda _: ()  # further tables
    train: Callable[[Run], None] = train_network  # trains a run, or resumes it
    recipe: str = "authors_small"  # the start of all configurations
    split: str = ""  # measured if it exists; otherwise the evaluation split
    note: str = ""  # definitions, below the tables

    def runs(
        self,
        workdir: pathlib.Path,
        data: str = "",
        seed: int = 0,
        steps: int = 0,
        eval_data: str = "",
    ) -> list[Run]:
        """The runs of all configurations with one seed."""
        paths = {"data.path": data, "data.eval_path": eval_data}
        tree = {**_INTERVALS, **self.base, "seed": seed, **paths}
        tree |= {"train.steps": steps} if steps else {}
        if wanted := tree.get("train.steps"):
            tree.setdefault("train.eval_every", max(1, wanted // _EVALUATIONS))
        base = changed(parse(files.load(self.recipe)), tree)
        found = self.configs(base, lambda name: str(workdir / f"{name}-{seed}"))
        return [
            Run(name, seed, workdir / f"{name}-{seed}", changed(base, overrides))
            for name, overrides in found.items()
        ]


_INTERVALS = {"train.images_every": 0, "train.checkpoint_every": 200}
_EVALUATIONS = 16  # points of a learning curve


def changed(config: Config, overrides: Overrides) -> Config:
    """The configuration with new values of fields, and intervals limited by its steps."""
    tree = to_dict(config)
    for key, value in overrides.items():
        section, _, field = key.rpartition(".")
        (tree[section] if section else tree)[field] = value
    train, optim = tree["train"], tree["optim"]
    optim["warmup_steps"] = min(optim["warmup_steps"], train["steps"] // 4)
    train |= {key: min(train[key], train["steps"]) for key in ("log_every", "eval_every")}
    return parse(tree)


def run(
    study: Study,
    workdir: str | pathlib.Path,
    *,
    data: str = "",
    seeds: int = 1,
    steps: int = 0,
    only: str = "",
    finished: Sequence[str] = (),
    eval_data: str = "",
    measure: Sequence[str] = (),
) -> str:
    """Trains, measures and writes the results; returns the tables as text.

    Args:
      only: CONFIG:SEED: train only this run, and measure nothing. So several machines can share a
        study; a call without `only` joins the results.
      finished: folders of finished runs to measure instead; for two, the tables show the
        difference, second minus first.
      measure: FOLDER:SPLIT of further splits, with results such as `networks-authors-test.md`.

    `ConfigError` if an argument, the data or a run in `workdir` does not fit; `UserError` if a
    signal stopped a training: the same call continues.
    """
    figures.check_installed()
    folder = pathlib.Path(workdir)
    if finished:
        runs = _finished_runs(finished, data)
        pairs = [(runs[1].name, runs[0].name)] if len(runs) == 2 else []
        study = dataclasses.replace(study, pairs=pairs)
    else:
        seed = only.rpartition(":")[2]
        wanted = [int(seed)] if seed.isdecimal() else range(seeds)
        every = [run for n in wanted for run in study.runs(folder, data, n, steps, eval_data)]
        runs = [run for run in every if only in ("", f"{run.name}:{run.seed}")]
        if not runs:
            names = ", ".join(dict.fromkeys(run.name for run in every))
            raise ConfigError(f"only={only}: accepted: CONFIG:SEED with one of {names}")
    places = {"": runs}
    for place in measure:
        path, _, split = place.rpartition(":")
        if not path or not split or not runs[0].config.data.path:
            raise ConfigError(
                f"measure={place}: accepted: FOLDER:SPLIT, such as records/authors:test, for a "
                "study that reads records"
            )
        name = f"-{pathlib.Path(path).name}-{split}"
        if name in places:
            raise ConfigError(f"measure={place}: accepted: folders with different names")
        places[name] = _on_split(runs, split, path)
    for several in places.values() if data and not finished else ():
        for config in {run.config.data: run.config for run in several}.values():
            _check_data(config)
    if not finished:
        for i, one in enumerate(runs):
            logging.info("run %d of %d: %s", i + 1, len(runs), one.folder)
            study.train(one)
        if only:
            return ""
    folders = runs[0].config.data.eval_folders if study.split else ()
    if any(study.split in load_manifest(path).splits() for path in folders):
        places[""] = _on_split(runs, study.split)
    elif study.split:
        logging.warning("no split %r: thresholds are chosen on the measured one", study.split)
    texts = []
    for place, several in places.items():
        results = {name: [*map(study.measure, same)] for name, same in _by_name(several).items()}
        if len({tuple(one.names) for many in results.values() for one in many}) > 1:
            raise ConfigError(f"{folder}: the runs are measured on different samples")
        titles = study.metrics or {x: x for many in results.values() for x in many[0].metrics}
        titled = dataclasses.replace(study, metrics=titles)
        texts.append(_write(titled, folder, place, several, results))
    return "\n".join(texts)


def _on_split(runs: Sequence[Run], split: str, path: str = "") -> list[Run]:
    data = {"data.eval_split": split, **({"data.eval_path": path} if path else {})}
    return [run._replace(config=changed(run.config, data)) for run in runs]


def _write(
    study: Study, folder: pathlib.Path, place: str, runs: Sequence[Run], results: Results
) -> str:
    """Writes tables, numbers and figure; returns the tables as text."""
    summaries = summarise(results, study)
    tables = [*_tables(summaries, study), *study.tables(results), *_costs(runs)]
    about = results[runs[0].name][0].about
    note = f"{about}{'. ' if about else ''}{_ERRORS} {study.note}".strip() + "\n"
    contents: dict[str, str | bytes] = {
        ".md": "\n".join([*map(markdown, tables), note]),
        ".csv": csv_of(Summary._fields, summaries),
        ".png": figures.png(study.figure(results)),
    }
    if not place and (found := _learning_curves(runs, study.metrics)):
        contents["_curves.png"] = figures.png(figures.curves(found))
    for suffix, content in contents.items():
        write_atomic(folder / f"{study.name}{place}{suffix}", content)
    logging.info("results in %s", folder)
    return "\n".join([*map(aligned, tables), note])


_ERRORS = (
    "+-: standard error over samples (views of a model count as dependent) and, with several "
    'seeds, over seeds. "Better on" counts models. Differences are paired by seed and sample.'
)


def _learning_curves(
    runs: Sequence[Run], metrics: Mapping[str, str]
) -> dict[str, dict[str, figures.Curve]]:
    """{title: {configuration: curve}} from the evaluations during the trainings of `runs`.

    Only at the last point has the learning rate reached its end. So compare points with the same
    points of other configurations, not with shorter trainings.
    """

    def evaluated(run: Run, metric: str) -> dict[int, float]:
        """Samples seen -> metric, from a run's log."""
        size = run.config.train.batch_size
        lines = read_metrics(run.folder / "metrics.jsonl")
        wanted = (line for line in lines if line["kind"] == "eval" and line["step"])
        return {size * x["step"]: x[metric] for x in wanted if x.get(metric) is not None}

    charts: dict[str, dict[str, figures.Curve]] = {}
    for metric, title in metrics.items():
        for name, same in _by_name(runs).items():
            several = [evaluated(run, metric) for run in same]
            shared = sorted(set.intersection(*map(set, several)))
            if len(shared) > 1:
                values = np.array([[one[seen] for seen in shared] for one in several])
                values *= 100 if title.endswith("[%]") else 1
                charts.setdefault(title, {})[name] = np.array(shared), values
    return charts


def _by_name(runs: Sequence[Run]) -> dict[str, list[Run]]:
    groups: dict[str, list[Run]] = {}
    for run in runs:
        groups.setdefault(run.name, []).append(run)
    return groups


def _finished_runs(folders: Sequence[str], data: str) -> list[Run]:
    """Finished runs, to be evaluated on `data` or on the data of the first run."""
    configs = [load_config(folder, "runs") for folder in folders]
    names = ("path", "eval_path", "eval_split", "num_eval_points")
    same = {f"data.{name}": getattr(configs[0].data, name) for name in names}
    same |= {"data.path": data, "data.eval_path": ""} if data else {}
    same |= {"eval": to_dict(configs[0].eval)}
    runs = [
        Run(folder, 0, pathlib.Path(folder), changed(config, same))
        for folder, config in zip(folders, configs, strict=True)
    ]
    check_paths(runs[0].config)
    return runs


def _check_data(config: Config) -> None:
    check_paths(config)
    try:
        loader.train_batches(config.data, batch_size=1, seed=0, start_step=0).close()
        loader.eval_batches(config.data, split=config.data.eval_split, batch_size=1).close()
    except (ValueError, OSError) as error:
        places = f"{config.data.path!r}, evaluation on {', '.join(config.data.eval_folders)!r}"
        raise ConfigError(f"data={places}: {error}") from error


class Summary(NamedTuple):
    """The mean of a metric, or of its difference between two configurations."""

    configuration: str
    minus: str  # the subtracted configuration, or ""
    metric: str
    mean: float  # over seeds and samples
    error_samples: float  # standard error of the means over seeds; NaN for one model
    error_seeds: float  # standard error of the means over samples; NaN for one seed
    # Share of models that are better than in `minus`; NaN without `minus`, and for metrics of
    # which neither larger nor smaller values are better.
    better: float
    samples: int  # number of samples
    seeds: int


_LARGER_IS_BETTER = ("fscore", "precision", "recall", "iou", "gain", "thin_recall")
_SMALLER_IS_BETTER = ("cd_", "emd_", "gt_to", "log_volume", "outliers", "missed", "uneven")
"""Beginnings of the names of metrics. Metrics in radii are better if they are smaller, too."""


def summarise(results: Results, study: Study) -> list[Summary]:
    """The means of the table's metrics, then the differences in `Study.pairs`."""
    values = {metric: _values(results, metric) for metric in study.metrics}
    means = [(n, "", m, a, models) for m, (of, models) in values.items() for n, a in of.items()]
    changes = [
        (one, other, metric, arrays[one] - arrays[other], models)
        for one, other in study.pairs
        for metric, (arrays, models) in values.items()
        if one in arrays and other in arrays
    ]
    return [_summary(*row) for row in [*means, *changes]]


def _values(results: Results, metric: str) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Configuration -> [seeds, samples with the metric], and the models of these samples."""
    arrays = {
        name: np.stack([measured.metrics[metric] for measured in many])
        for name, many in results.items()
        if metric in many[0].metrics
    }
    if not arrays:
        return {}, np.array([])
    keep = ~np.isnan(np.concatenate(list(arrays.values()))).all(axis=0)
    models = models_of(results)
    if len(models) != len(keep):  # a number of the whole run
        models = np.arange(len(keep))
    return {name: array[:, keep] for name, array in arrays.items()}, models[keep]


def models_of(results: Results) -> np.ndarray:
    """The number of the model of each sample [samples]."""
    names = next(iter(results.values()))[0].names
    return np.unique([(n.category, n.model_id) for n in names], axis=0, return_inverse=True)[1]


def _sums(values: np.ndarray, models: np.ndarray) -> np.ndarray:
    """The sums of the values over each model's samples."""
    return np.bincount(np.unique(models, return_inverse=True)[1], values)


def _summary(name: str, minus: str, metric: str, array: np.ndarray, models: np.ndarray) -> Summary:
    seeds, samples = array.shape
    each, better = array.mean(axis=0), math.nan
    of_models = _sums(each, models)
    if minus and samples and metric.startswith(_LARGER_IS_BETTER):
        better = float(np.mean(of_models > 0))
    elif minus and samples and ("radius" in metric or metric.startswith(_SMALLER_IS_BETTER)):
        better = float(np.mean(of_models < 0))
    mean = float(array.mean()) if array.size else math.nan
    errors = standard_error(each, models), standard_error(array.mean(axis=1) if samples else each)
    return Summary(name, minus, metric, mean, *errors, better, samples, seeds)


def standard_error(values: np.ndarray, models: np.ndarray | None = None) -> float:
    """Standard error of the mean of values [n]; NaN for fewer than two values or models.

    With `models` [n], only models count as independent, because views depend on each other.
    """
    deviations = values - values.mean() if len(values) else values
    if models is not None:
        deviations = _sums(deviations, models)
    count = len(deviations)
    if count < 2:
        return math.nan
    return float(np.sqrt(count / (count - 1) * np.square(deviations).sum()) / len(values))


def _tables(summaries: Sequence[Summary], study: Study) -> list[Lines]:
    """The means with a column for each configuration, and the differences."""
    means = {(e.metric, e.configuration): e for e in summaries if not e.minus}
    names = list(dict.fromkeys(name for _, name in means))
    lines = [["", *names]]
    for metric, title in study.metrics.items():
        cells = [_cell(title, means.get((metric, name))) for name in names]
        if any(cells):
            lines.append([title, *cells])
    if len(names) >= len(lines):
        lines = [list(column) for column in zip(*lines, strict=True)]
    changes = [["difference", "", "mean", "first better on"]]
    for e in summaries:
        if e.minus:
            title = study.metrics[e.metric]
            cell = _cell(title, e, sign=True)
            better = "" if math.isnan(e.better) else f"{e.better:.0%}"
            changes.append([f"{e.configuration} - {e.minus}", title, cell, better])
    return [lines, changes] if len(changes) > 1 else [lines]


def _cell(title: str, summary: Summary | None, *, sign: bool = False) -> str:
    if summary is None:
        return ""
    scale = 100 if title.endswith("[%]") else 1
    errors = [summary.error_samples, summary.error_seeds]
    shown = [f" +- {scale * error:.2g}" for error in errors if not math.isnan(error)]
    return f"{scale * summary.mean:{'+' if sign else ''}.4g}{''.join(shown)}"


def _cost(run: Run) -> tuple[float, float]:
    """Median seconds per step and total seconds of steps in a run's log; NaN for a short log."""
    last, steps, seconds = 0, [], []
    for line in read_metrics(run.folder / "metrics.jsonl"):
        if line["kind"] == "train":
            if rate := line.get("samples_per_second"):
                steps.append(line["step"] - last)
                seconds.append(run.config.train.batch_size / rate)
            last = line["step"]
    if not steps:
        return math.nan, math.nan
    return float(np.median(seconds)), float(np.dot(steps, seconds))


def _costs(runs: Sequence[Run]) -> list[Lines]:
    """A table of parameters, samples seen and times (means over seeds); empty without networks."""
    lines = [["", "parameters", "samples seen", "seconds per step", "minutes of steps"]]
    for name, several in _by_name(runs).items():
        if not (several[0].folder / "checkpoints").is_dir():
            continue
        opened = open_run(several[0].folder, "last")
        count = sum(np.size(leaf) for leaf in jax.tree.leaves(opened.params))
        seen = opened.step * opened.config.train.batch_size
        seconds, total = np.mean([_cost(run) for run in several], axis=0)
        lines.append([name, f"{count:,}", f"{seen:,}", f"{seconds:.3f}", f"{total / 60:.1f}"])
    return [lines] if len(lines) > 1 else []

"""The common structure of all studies: configurations, trainings, measures, tables and figures.

Each study is a `Study`: `configs` returns the configurations of the trainings, `measure` returns
numbers, `table` and `figure` present them, and `Study.run` executes all steps. The trainings are
ordinary runs in subfolders of the study's folder. If the command is stopped and started again, it
continues. The last checkpoints are measured, not the best ones, because most studies measure
the samples on which the best ones were chosen. Each study writes `NAME.txt`, `NAME.md`, `NAME.json`
(all numbers) and figures as PNG.
"""

import dataclasses
import json
import math
import pathlib
import sys
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from absl import app, flags, logging

from psgn_jax import config_files, tasks
from psgn_jax.command_line import flags_only, keep_compiled, parse_flags
from psgn_jax.config import Config, ConfigError, UserError, check_paths, parse, to_dict
from psgn_jax.data import loader
from psgn_jax.default_data import default_dataset, with_default_data
from psgn_jax.experiments import figures
from psgn_jax.files import write_atomic
from psgn_jax.host_memory import keep_freed_memory
from psgn_jax.metrics.evaluation import Evaluation
from psgn_jax.metrics.table import Lines, aligned, markdown
from psgn_jax.training import loop as train_lib
from psgn_jax.training.log import read_metrics
from psgn_jax.training.run_folder import load_config, open_run

USUAL_DATA = "records/authors"
"""The usual folder of the authors' records; used if it exists and `--data` is not given."""


@dataclasses.dataclass(frozen=True)
class Study:
    """An experiment.

    Attributes:
      name: name of the result files.
      configs: maps the options to (folder, configuration) of each training, in order. It is
        iterated while the trainings run, so a later configuration may depend on an earlier run.
      measure: maps the options to the numbers, which are saved as JSON, and to further data for the
        figures.
      table: maps the numbers to the tables.
      figure: maps the numbers and the further data to figures by file name, without ".png".
      options: names and default values of the flags besides `--workdir`.
      note: units and definitions, written below the tables.
    """

    name: str
    configs: Callable[[Any], Iterable[tuple[str, Config]]]
    measure: Callable[[Any], tuple[dict[str, Any], Any]]
    table: Callable[[Mapping[str, Any]], Sequence[Lines]]
    figure: Callable[[Mapping[str, Any], Any], Mapping[str, figures.Figure]]
    options: Mapping[str, Any] = dataclasses.field(
        default_factory=lambda: {"data": None, "full": False, "steps": 0, "cases": 6}
    )
    note: str = ""

    def run(self, workdir: str | pathlib.Path, **values: Any) -> str:
        """Trains, measures and writes the results; returns the tables as text.

        Args:
          workdir: folder of the runs and the results.
          **values: values of options; the others have their defaults.

        Raises:
          ConfigError: an option, the data or a run in `workdir` is not suitable.
          UserError: a signal ended a training; the same call continues.
          TypeError: an option is unknown.
        """
        figures.check_installed()
        given = {**self.options, **values}
        if unknown := given.keys() - self.options.keys():
            raise TypeError(f"{sorted(unknown)}: expected options among {sorted(self.options)}")
        options = types.SimpleNamespace(workdir=pathlib.Path(workdir), **given)
        for name, config in self.configs(options):
            _train(name, config, options.workdir / name)
        numbers, rest = self.measure(options)
        tables, note = self.table(numbers), self.text_below(numbers)
        text = "\n".join([*map(aligned, tables), note])
        folder = options.workdir
        write_atomic(folder / f"{self.name}.txt", text)
        write_atomic(folder / f"{self.name}.md", "\n".join([*map(markdown, tables), note]))
        document = finite({"options": given, **numbers})
        text_of_json = json.dumps(document, indent=2, allow_nan=False, default=str) + "\n"
        write_atomic(folder / f"{self.name}.json", text_of_json)
        for name, picture in self.figure(numbers, rest).items():
            write_atomic(folder / f"{name}.png", figures.png(picture))
        logging.info("results in %s", folder)
        return text

    def text_below(self, numbers: Mapping[str, Any]) -> str:
        """The numbers of samples, points and steps, and the note of the study."""
        parts = [self.note] if self.note else []
        if "samples" in numbers:
            counts = [f"{numbers['samples']} samples of {numbers['split']!r}"]
            if numbers.get("num_pred_points"):
                counts.append(f"{numbers['num_pred_points']} predicted points")
                counts.append(f"{numbers['num_gt_points']} true points")
            counts += [f"{name}: {n:,} steps" for name, n in numbers.get("steps", {}).items()]
            parts.insert(0, ", ".join(counts) + ".")
        return "".join(f"{part}\n" for part in parts)

    def main(self) -> None:
        """The command of the study: parses the flags, runs the study, prints the tables."""

        def command(argv: Sequence[str]) -> None:
            with flags_only(argv) as given:
                keep_compiled()
                keep_freed_memory()
                values: dict[str, Any] = {
                    name: given[name].value for name in ("workdir", *self.options)
                }
                text = self.run(**values)
            sys.stdout.write(text)

        _define_flags([name for name in ("workdir", *self.options) if name not in flags.FLAGS])
        app.run(command, flags_parser=parse_flags)


def _define_flags(names: Sequence[str]) -> None:
    if "workdir" in names:
        flags.DEFINE_string("workdir", None, "Folder of the runs and the results.", required=True)
    if "data" in names:
        text = f"Folder of records; default: {USUAL_DATA}, or the default data set."
        flags.DEFINE_string("data", None, text)
    if "full" in names:
        flags.DEFINE_bool("full", False, "Use full-size images and networks, for a GPU.")
    if "steps" in names:
        flags.DEFINE_integer("steps", 0, "Steps of each training; 0 = default.", lower_bound=0)
    if "cases" in names:
        flags.DEFINE_integer("cases", 6, "Samples in the figure.", lower_bound=1)


def _train(name: str, config: Config, folder: pathlib.Path) -> None:
    logging.info("%s: %d steps in %s", name, config.train.steps, folder)
    outcome = train_lib.train(config, folder)
    if outcome.stopped_by:
        stopped = UserError("stopped by a signal; the same command continues")
        stopped.exit_code = 128 + outcome.stopped_by
        raise stopped


# --- Data and configurations ------------------------------------------------------------------


def find_data(named: str | None) -> str:
    """Folder of the records to train on: `named`, `USUAL_DATA`, or the default data set.

    Args:
      named: a folder; None = `USUAL_DATA` if it exists, else the default data set; "" = the default
        data set.

    Raises:
      ConfigError: `named` does not exist.
    """
    if named:
        check_paths(parse({"data": {"path": named}}))
        return named
    if named is None and pathlib.Path(USUAL_DATA).is_dir():
        return USUAL_DATA
    logging.info("no folder in --data: training on the default data set")
    return default_dataset()


def recipe(
    path: str,
    *,
    full: bool,
    steps: int = 0,
    usual_steps: int = 0,
    changes: Mapping[str, Mapping[str, Any]] | None = None,
) -> Config:
    """The configuration of `configs/authors_small.py` or, if `full`, of `configs/authors.py`.

    The loss of the former is EMD + 5 CD, that of the latter the CD.

    Args:
      path: folder of records.
      full: use `configs/authors.py`: full-size images and network, 20,000 steps of 32 samples.
      steps: steps of the training; 0 = `usual_steps`, or those of the file.
      usual_steps: default number of steps unless `full`; 0 = those of the file.
      changes: section -> field -> value.
    """
    tree = config_files.load("authors" if full else "authors_small").to_dict()
    steps = steps or (0 if full else usual_steps) or tree["train"]["steps"]
    tree["data"]["path"] = path
    tree["optim"]["warmup_steps"] = min(tree["optim"]["warmup_steps"], steps // 4)
    tree["train"] |= {"steps": steps, "eval_every": math.ceil(steps / 3)}
    if not full:
        tree["train"] |= {"checkpoint_every": 200, "images_every": 0}
    for section, fields in (changes or {}).items():
        tree[section].update(fields)
    return parse(tree)


def check_data(config: Config) -> None:
    """Raises `ConfigError` if the data do not have what the configuration needs."""
    try:
        loader.train_batches(config.data, batch_size=1, seed=0, start_step=0).close()
        loader.eval_batches(config.data, split=config.data.eval_split, batch_size=1).close()
    except (ValueError, OSError) as error:
        raise ConfigError(f"--data={config.data.path!r}: {error}") from error


def finished_run(
    folder: str | pathlib.Path, data: str | None = None, *, like: Config | None = None
) -> Config:
    """The configuration with which a finished run is measured.

    Args:
      folder: folder of the run.
      data: records that replace those of the run.
      like: a configuration whose data and evaluation settings replace those of the run.

    Raises:
      ConfigError: there is no run, or its data do not exist.
    """
    tree = to_dict(load_config(folder))
    if like:
        other = to_dict(like)
        fields = ("path", "eval_path", "eval_split", "num_eval_points")
        tree["data"] |= {field: other["data"][field] for field in fields}
        tree["eval"] = other["eval"]
    elif data is not None:
        tree["data"] |= {"path": data, "eval_path": ""}
    config = parse(tree)
    check_paths(config)
    return with_default_data(config)


# --- Measures ---------------------------------------------------------------------------------

Sample = Mapping[str, np.ndarray]
"""Arrays of a sample, including its prediction `pred`."""


class Measured(NamedTuple):
    """A run on a split: metrics of every sample, and some samples with predictions."""

    config: Config
    evaluation: Evaluation
    cases: dict[int, Sample]


CASE = ("image", "points", "intrinsics", "extrinsics")
"""Arrays of a sample that are kept by default, besides `pred`."""


def measure(
    folder: pathlib.Path,
    *,
    config: Config | None = None,
    split: str = "",
    keys: Sequence[str] = CASE,
    num_cases: int = 0,
    on_sample: Callable[[int, Sample], None] | None = None,
) -> Measured:
    """Measures the last checkpoint of a run.

    Args:
      folder: folder of the run.
      config: replaces the configuration of the run, see `finished_run`.
      split: name of the split; "" = the evaluation split of the run.
      keys: arrays of a sample that are kept, if the batch contains them.
      num_cases: number of evenly spaced samples that are kept.
      on_sample: called with the number of each sample, and its `keys` and `pred`.
    """
    run = open_run(folder, "last")
    config = config or run.config
    split = split or config.data.eval_split
    logging.info("measuring %s, step %d, on %r", folder, run.step, split)
    total = loader.num_samples(config.data, split, evaluation=True) if num_cases else 0
    wanted = {int(i) for i in np.linspace(0, total - 1, min(num_cases, total))}
    cases: dict[int, Sample] = {}

    def keep(index: int, batch: Any, predictions: np.ndarray) -> None:
        for row in np.flatnonzero(batch["valid"]).tolist():
            number = index * config.eval.batch_size + row
            if number not in wanted and on_sample is None:
                continue
            # Copies, because views would keep the whole batch in memory.
            case = {key: np.array(batch[key][row]) for key in keys if key in batch}
            case["pred"] = np.array(predictions[row])
            if on_sample:
                on_sample(number, case)
            if number in wanted:
                cases[number] = case

    task = tasks.create(config, folder)
    evaluated = task.evaluate(run.params, split=split, on_batch=keep, chosen=run.scores)
    return Measured(config, evaluated, cases)


def about(run: Measured, **steps: int) -> dict[str, Any]:
    """Data set, samples and steps of a study, for its document.

    Args:
      run: one of the runs; the others have the same samples.
      **steps: steps of each training.
    """
    config, evaluation = run.config, run.evaluation
    return {
        "data": config.data.eval_path or config.data.path or "default",
        "steps": steps,
        "split": evaluation.split,
        "samples": len(evaluation.names),
        "num_pred_points": evaluation.num_points[0],
        "num_gt_points": evaluation.num_points[1],
        "fscore_threshold": evaluation.threshold,
        "visible_tolerance": evaluation.visible_tolerance,
    }


def mean_and_error(values: np.ndarray) -> tuple[float, float]:
    """Mean of the values that are not NaN and its standard error; NaN if there are too few."""
    values = values[~np.isnan(values)]
    return (float(values.mean()) if len(values) else math.nan), _error(values)


def _error(values: np.ndarray) -> float:
    return float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else math.nan


class Difference(NamedTuple):
    """A metric of one network minus that of another, over the samples that have the metric.

    Attributes:
      mean, error: mean of the difference and its standard error over samples.
      better: share of the samples on which the first network is better.
    """

    mean: float
    error: float
    better: float


def difference(metric: str, values: np.ndarray, others: np.ndarray) -> Difference:
    """Statistics of `values - others` of the same samples; NaN if no sample has both.

    F-score and recall are better if they are larger, all other metrics if they are smaller.
    """
    # A sample may have no hidden points, for example; then their metrics are NaN for both networks.
    change = (values - others)[~(np.isnan(values) & np.isnan(others))]
    if not len(change):
        return Difference(math.nan, math.nan, math.nan)
    larger = metric.startswith(("fscore", "recall"))
    better = float(np.mean(change > 0 if larger else change < 0))
    return Difference(float(np.mean(change)), _error(change), better)


def differences(metrics: Mapping[str, Mapping[str, np.ndarray]]) -> dict[str, Any]:
    """For two runs by name: the `difference` of the second and the first run in each metric."""
    first, second = metrics.values()
    return {key: difference(key, second[key], first[key])._asdict() for key in first}


def squared_distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Squared distances [n, m] between the points of two clouds."""
    a, b = a.astype(np.float64), b.astype(np.float64)
    products = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1)[None] - 2 * a @ b.T
    return np.maximum(products, 0)


def cost(folder: pathlib.Path) -> tuple[float, float]:
    """Seconds of the steps in the log of a run: median per step, and total; NaN for a short log.

    Compilation before the first step, evaluations and checkpoints are not included.
    """
    batch_size = load_config(folder).train.batch_size
    last, steps, seconds = 0, [], []
    for line in read_metrics(folder / "metrics.jsonl"):
        if line["kind"] == "train":
            if rate := line.get("samples_per_second"):
                steps.append(line["step"] - last)
                seconds.append(batch_size / rate)
            last = line["step"]
    if not steps:
        return math.nan, math.nan
    return float(np.median(seconds)), float(np.dot(steps, seconds))


def in_parts(function: Any, *arrays: np.ndarray, size: int = 16) -> Any:
    """Applies `function` to `size` rows of the arrays at a time; joins the results as numpy arrays.

    The last part is padded to the same shape as the others.
    """
    parts = []
    for start in range(0, len(arrays[0]), size):
        rows = np.minimum(np.arange(start, start + size), len(arrays[0]) - 1)
        keep = min(size, len(arrays[0]) - start)
        result = function(*(array[rows] for array in arrays))
        parts.append(jax.tree.map(lambda leaf, n=keep: np.asarray(leaf)[:n], result))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


# --- Tables -----------------------------------------------------------------------------------


def number(title: str, value: float, *, sign: bool = False) -> str:
    """The text of a cell: per cent if the title ends with "[%]", otherwise with five decimals."""
    percent, plus = title.endswith("[%]"), "+" if sign else ""
    return f"{100 * value:{plus}.2f}" if percent else f"{value:{plus}.5f}"


def change(title: str, entry: Mapping[str, float]) -> tuple[str, str]:
    """Two cells for a `difference`: mean with standard error, and share of better samples."""
    mean = number(title, entry["mean"], sign=True)
    return f"{mean} +- {number(title, entry['error'])}", f"{100 * entry['better']:.0f} %"


def table_of_two(
    means: Mapping[str, Mapping[str, float]],
    changes: Mapping[str, Mapping[str, float]],
    titles: Mapping[str, str],
    metrics: Mapping[str, str],
) -> Lines:
    """A row for each metric: both networks, their difference, and the share of better samples.

    Args:
      means: run -> metric -> mean.
      changes: metric -> fields of a `Difference`, second run minus first.
      titles: titles of the two runs.
      metrics: metric -> title of its row; metrics that were not measured are left out.
    """
    lines = [["", *titles.values(), "difference", f"{list(titles.values())[1]} better on"]]
    for metric, title in metrics.items():
        if metric in changes:
            cells = [number(title, means[run][metric]) for run in titles]
            lines.append([title, *cells, *change(title, changes[metric])])
    return lines


def finite(value: Any) -> Any:
    """The document with None for numbers that are not finite, which JSON cannot represent."""
    if isinstance(value, Mapping):
        return {key: finite(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [finite(entry) for entry in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value

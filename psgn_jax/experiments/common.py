"""Common parts of the studies that train networks: recipe, training, measures, tables and files.

A study trains a few networks in subfolders of one folder. It measures their last checkpoints on the
evaluation split; the best checkpoints would have been selected on the same samples. It compares
the networks sample by sample and writes `NAME.txt`, `.md`, `.json` and `.png`.
"""

import json
import math
import pathlib
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from absl import app, flags, logging
from PIL import Image, ImageDraw, ImageFont

from psgn_jax import tasks
from psgn_jax.command_line import exit_on_user_error, keep_compiled, log_to_terminal, parse_flags
from psgn_jax.config import Config, ConfigError, UserError, check_paths, parse
from psgn_jax.data import loader
from psgn_jax.default_data import default_dataset
from psgn_jax.files import write_atomic
from psgn_jax.metrics.evaluation import Evaluation
from psgn_jax.training import loop as train_lib
from psgn_jax.training.run_folder import open_run

USUAL_DATA = "records/authors"
"""Folder of the authors' records in README.md; the default if no data are given."""

HEAD_HEIGHT = 24
"""Height in pixels of the column titles above a picture."""


# --- Data and recipes -------------------------------------------------------------------------


def find_data(named: str | None) -> str:
    """Folder of the records to train on: `named`, else `USUAL_DATA`, else the default data set.

    Raises:
      ConfigError: the folder `named` does not exist.
    """
    if named:
        check_paths(parse({"data": {"path": named}}))
        return named
    if named is None and pathlib.Path(USUAL_DATA).is_dir():
        return USUAL_DATA
    logging.info("no --data named and none in %s: training on the default data set", USUAL_DATA)
    return default_dataset()


def recipe(
    path: str, *, full: bool, steps: int, changes: Mapping[str, Mapping[str, Any]] | None = None
) -> Config:
    """The recipe of `configs/authors_small.py`, or with `full` of `configs/authors.py`.

    Args:
      path: folder of records, "" = the default data set.
      full: use full-size images, the widths of the published network, and batches of 32.
      steps: number of training steps; the warm-up is shortened to at most a quarter of it.
      changes: values that replace those of the recipe, by section and field.
    """
    data: dict[str, Any] = {"path": path, "flip": True}
    optim = {"schedule": "cosine", "final_fraction": 0.01, "clip_norm": 1.0}
    tree: dict[str, dict[str, Any]]
    if full:
        tree = {
            "data": {**data, "stretch": 0.15},
            "optim": {**optim, "learning_rate": 3e-4, "warmup_steps": 500, "ema_decay": 0.999},
            "train": {"batch_size": 32, "log_every": 50, "images_every": 2_000},
        }
    else:
        augmentation = {"stretch": 0.2, "zoom": 0.05, "shift": 0.04, "colour_jitter": 0.2}
        tree = {
            "data": {**data, **augmentation, "image_size": (96, 128), "num_points": 2048},
            "model": {
                "widths": (8, 16, 32, 64, 128, 256),
                "deconv_level": 2,
                "fc_widths": (768, 512),
            },
            "optim": {**optim, "learning_rate": 1e-3, "warmup_steps": 200, "ema_decay": 0.998},
            "train": {"batch_size": 16, "log_every": 50, "images_every": 0},
        }
    tree["optim"]["warmup_steps"] = min(tree["optim"]["warmup_steps"], steps // 4)
    often = 500 if full else 200
    tree["train"] |= {
        "steps": steps,
        "eval_every": math.ceil(steps / 3),
        "checkpoint_every": often,
    }
    for section, fields in (changes or {}).items():
        tree.setdefault(section, {}).update(fields)
    return parse(tree)


def check_data(config: Config) -> None:
    """Raises `ConfigError` if the data do not suit a configuration; called before training."""
    try:
        for split in (config.data.train_split, config.data.eval_split):
            loader.eval_batches(config.data, split=split, batch_size=1).close()
    except (ValueError, OSError) as error:
        raise ConfigError(f"--data={config.data.path!r}: {error}") from error


# --- Trainings and measures -------------------------------------------------------------------


def train_each(
    configs: Mapping[str, Config],
    workdir: pathlib.Path,
    titles: Mapping[str, str] | None = None,
) -> None:
    """Trains the networks one after another in `workdir/NAME`; resumes runs that were stopped.

    Raises:
      ConfigError: the errors of `training.loop.train`.
      UserError: a signal stopped the training; the same call resumes it.
    """
    for name, config in configs.items():
        title = (titles or {}).get(name, name)
        logging.info("%s: %d steps in %s", title, config.train.steps, workdir / name)
        outcome = train_lib.train(config, workdir / name)
        if outcome.stopped_by:
            stopped = UserError("stopped by a signal; the same command resumes the training")
            stopped.exit_code = 128 + outcome.stopped_by
            raise stopped


class Measured(NamedTuple):
    """Results of one network: the metrics of all samples, and some samples with predictions."""

    evaluation: Evaluation
    cases: dict[int, dict[str, np.ndarray]]


CASE = ("image", "points", "intrinsics", "extrinsics")
"""The default arrays of a sample that are kept in addition to `pred`."""


def measure(
    config: Config,
    workdir: pathlib.Path,
    num_cases: int,
    *,
    keys: Sequence[str] = CASE,
    check: Callable[[Mapping[str, Any]], None] | None = None,
    on_sample: Callable[[int, dict[str, np.ndarray]], None] | None = None,
) -> Measured:
    """Measures the last checkpoint of a run on its evaluation split.

    Args:
      config: configuration of the run.
      workdir: folder of the run.
      num_cases: number of samples, evenly spaced, that are kept with their predictions.
      keys: arrays of these samples to keep, if the batch has them.
      check: called with each batch; raises an error if the data lack something.
      on_sample: called for each sample with its number and a dict of `keys` and `pred`.
    """
    run = open_run(workdir, "last")
    logging.info("measuring %s, step %d", workdir, run.step)
    total = loader.num_samples(config.data, config.data.eval_split, evaluation=True)
    wanted = {int(i) for i in np.linspace(0, total - 1, min(num_cases, total))}
    cases: dict[int, dict[str, np.ndarray]] = {}

    def keep(index: int, batch: Any, points: np.ndarray) -> None:
        if check:
            check(batch)
        for row in np.flatnonzero(batch["valid"]).tolist():
            number = index * config.eval.batch_size + row
            if number not in wanted and on_sample is None:
                continue
            case = {k: np.asarray(batch[k][row]) for k in keys if k in batch}
            case["pred"] = points[row]
            if on_sample:
                on_sample(number, case)
            if number in wanted:
                # Copies: a view would keep its whole batch in memory.
                cases[number] = {k: v.copy() for k, v in case.items()}

    return Measured(tasks.create(config, workdir).evaluate(run.params, on_batch=keep), cases)


# --- Comparisons ------------------------------------------------------------------------------


class Difference(NamedTuple):
    """Paired difference of a metric between two networks.

    Attributes:
      mean: mean of the difference over samples.
      error: standard error of the mean.
      better: fraction of the samples for which the first network is better.
    """

    mean: float
    error: float
    better: float


def mean_and_error(values: np.ndarray) -> tuple[float, float]:
    """Mean and standard error of the values that are not NaN; NaN if there are too few values."""
    values = values[~np.isnan(values)]
    if not len(values):
        return math.nan, math.nan
    error = float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else math.nan
    return float(np.mean(values)), error


def difference(
    values: np.ndarray, others: np.ndarray, *, larger_is_better: bool = False
) -> Difference:
    """Statistics of `values - others`; NaN if no sample has both.

    Args:
      values: metric of the first network, one number per sample.
      others: metric of the second network on the same samples.
      larger_is_better: whether larger values of the metric are better.
    """
    # A sample may have no visible or no hidden points. Its metric is then NaN for both networks.
    kept = ~(np.isnan(values) & np.isnan(others))
    change = (values - others)[kept]
    if not len(change):
        return Difference(math.nan, math.nan, math.nan)
    error = float(np.std(change, ddof=1) / np.sqrt(len(change))) if len(change) > 1 else math.nan
    better = float(np.mean(change > 0 if larger_is_better else change < 0))
    return Difference(float(np.mean(change)), error, better)


def squared_distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Squared distances [n, m] between the points of two clouds."""
    a, b = a.astype(np.float64), b.astype(np.float64)
    products = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1)[None] - 2 * a @ b.T
    return np.maximum(products, 0)


# --- Tables and files -------------------------------------------------------------------------


def text_table(lines: Sequence[Sequence[str]]) -> str:
    """Formats a header and rows as text; the first column is left-aligned, the others right."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    text = [
        "  ".join(
            [line[0].ljust(widths[0])]
            + [cell.rjust(w) for cell, w in zip(line[1:], widths[1:], strict=True)]
        )
        for line in lines
    ]
    return "\n".join([text[0], "-" * len(text[0]), *text[1:]]) + "\n"


def markdown_table(lines: Sequence[Sequence[str]]) -> str:
    """Formats a header and rows as a Markdown table."""
    head, *rows = lines
    ruled = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in ruled) + "\n"


def finite(values: Mapping[str, float]) -> dict[str, float | None]:
    """Replaces non-finite numbers by None (null in JSON), because JSON has no NaN."""
    return {k: v if math.isfinite(v) else None for k, v in values.items()}


def write_results(
    workdir: pathlib.Path,
    name: str,
    *,
    text: str,
    markdown: str,
    document: Mapping[str, Any],
    picture: Image.Image,
) -> None:
    """Writes `NAME.txt`, `.md`, `.json` and `.png`."""
    write_atomic(workdir / f"{name}.txt", text)
    write_atomic(workdir / f"{name}.md", markdown)
    write_atomic(workdir / f"{name}.json", json.dumps(document, indent=2, allow_nan=False))
    picture.save(workdir / f"{name}.png")
    logging.info("results in %s", workdir)


def with_titles(strips: Sequence[np.ndarray], titles: Sequence[str]) -> Image.Image:
    """Stacks strips of equal panels, with a title above each column of panels."""
    font = ImageFont.load_default(size=15)
    head = np.full((HEAD_HEIGHT, strips[0].shape[1], 3), 255, np.uint8)
    sheet = Image.fromarray(np.concatenate([head, *strips]))
    pen, width = ImageDraw.Draw(sheet), strips[0].shape[1] // len(titles)
    for column, title in enumerate(titles):
        pen.text((column * width + 6, 4), title, fill="black", font=font)
    return sheet


# --- The command ------------------------------------------------------------------------------


def define_flags(*, cases: int = 0) -> None:
    """Defines `--data`, `--full`, `--steps` and, if `cases` > 0, `--cases` with that default."""
    flags.DEFINE_string(
        "data", None, f"Folder of records; default: {USUAL_DATA}, or the default data set."
    )
    flags.DEFINE_bool("full", False, "Full-size images and network, 20,000 steps: for a GPU.")
    flags.DEFINE_integer("steps", 0, "Training steps; 0 = those of the recipe.", lower_bound=0)
    if cases:
        flags.DEFINE_integer("cases", cases, "Samples in the picture.", lower_bound=1)


def main(study: Callable[[Any], str]) -> None:
    """Runs a study as a command: parses the flags, prints its table, reports errors in one line.

    Args:
      study: called with the values of the flags; returns the table.
    """

    def command(argv: Sequence[str]) -> None:
        log_to_terminal()
        with exit_on_user_error():
            if len(argv) > 1:
                raise ConfigError(f"unexpected argument {argv[1]!r}")
            keep_compiled()
            text = study(flags.FLAGS)
        sys.stdout.write(text)

    app.run(command, flags_parser=parse_flags)

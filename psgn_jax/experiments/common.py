"""What studies that train networks have in common: recipe, trainings, measures, tables, files.

A study is a few ordinary trainings in subfolders of one folder, measured on the evaluation split
with their last checkpoints (the best would be picked on the samples that it is shown on), compared
sample by sample, and written as `NAME.txt`, `.md`, `.json` and `.png`.
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
"""Where README.md puts the authors' records; taken where no data are named."""

HEAD_HEIGHT = 24
"""Pixels above a picture for the titles of its columns."""


# --- Data and recipes -------------------------------------------------------------------------


def find_data(named: str | None) -> str:
    """Folder of the records to train on: named, the usual one, or the default data set.

    Raises:
      ConfigError: a folder was named that is not there.
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
    """That of `configs/authors_small.py`, or, `full`, of `configs/authors.py`, made as long.

    Args:
      path: folder of records, "" = the default data set.
      full: full-size images, the published network's widths, steps of 32 samples.
      steps: of the training.
      changes: section -> field -> value, in place of the recipe's.
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
    """Raises `ConfigError` if the data cannot serve a configuration, before any training."""
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
    """Trains one network after the other in `workdir/NAME`, or goes on where that was.

    Raises:
      ConfigError: as `training.loop.train`.
      UserError: a signal ended a training; the same call goes on.
    """
    for name, config in configs.items():
        title = (titles or {}).get(name, name)
        logging.info("%s: %d steps in %s", title, config.train.steps, workdir / name)
        outcome = train_lib.train(config, workdir / name)
        if outcome.stopped_by:
            stopped = UserError("stopped by a signal; the same command goes on")
            stopped.exit_code = 128 + outcome.stopped_by
            raise stopped


class Measured(NamedTuple):
    """One network on the split: metrics of every sample, and some samples with predictions."""

    evaluation: Evaluation
    cases: dict[int, dict[str, np.ndarray]]


CASE = ("image", "points", "intrinsics", "extrinsics")
"""What is kept of a sample, beside `pred`, unless more is asked for."""


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
      config: of the run.
      workdir: of the run.
      num_cases: so many samples at even distances are kept with their predictions.
      keys: what is kept of them, where a batch has it.
      check: called with each batch; raises if the data lack something.
      on_sample: called with the number of each sample, and `keys` and `pred` of it.
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
                # Not views, which would keep their whole batches.
                cases[number] = {k: v.copy() for k, v in case.items()}

    return Measured(tasks.create(config, workdir).evaluate(run.params, on_batch=keep), cases)


# --- Comparisons ------------------------------------------------------------------------------


class Difference(NamedTuple):
    """One network's metric minus another's, sample by sample, over the samples that both count.

    Attributes:
      mean, error: of the difference, and the mean's standard error over samples.
      better: share of the samples on which the one is the better one.
    """

    mean: float
    error: float
    better: float


def mean_and_error(values: np.ndarray) -> tuple[float, float]:
    """Mean and its standard error, of the values that are not NaN; NaN where there are too few."""
    values = values[~np.isnan(values)]
    if not len(values):
        return math.nan, math.nan
    error = float(np.std(values, ddof=1) / np.sqrt(len(values))) if len(values) > 1 else math.nan
    return float(np.mean(values)), error


def difference(values: np.ndarray, others: np.ndarray, *, more: bool = False) -> Difference:
    """`values - others`, paired; NaN where no sample has both.

    Args:
      values: of one network, a number per sample.
      others: of the network that it is compared with, on the same samples.
      more: whether the larger one is the better one.
    """
    # Points of one class may be missing from a sample; then they are for both networks.
    kept = ~(np.isnan(values) & np.isnan(others))
    change = (values - others)[kept]
    if not len(change):
        return Difference(math.nan, math.nan, math.nan)
    error = float(np.std(change, ddof=1) / np.sqrt(len(change))) if len(change) > 1 else math.nan
    better = float(np.mean(change > 0 if more else change < 0))
    return Difference(float(np.mean(change)), error, better)


def squared_distances(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Squared distances [n, m] of two clouds."""
    a, b = a.astype(np.float64), b.astype(np.float64)
    products = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1)[None] - 2 * a @ b.T
    return np.maximum(products, 0)


# --- Tables and files -------------------------------------------------------------------------


def text_table(lines: Sequence[Sequence[str]]) -> str:
    """Head and rows as text in columns, the first one flush left."""
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
    """Head and rows as a table for a README."""
    head, *rows = lines
    ruled = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in ruled) + "\n"


def finite(values: Mapping[str, float]) -> dict[str, float | None]:
    """For JSON, which has no NaN: null for what is not finite."""
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
    """Strips of as many equal panels as there are titles, one below the other, under the titles."""
    font = ImageFont.load_default(size=15)
    head = np.full((HEAD_HEIGHT, strips[0].shape[1], 3), 255, np.uint8)
    sheet = Image.fromarray(np.concatenate([head, *strips]))
    pen, width = ImageDraw.Draw(sheet), strips[0].shape[1] // len(titles)
    for column, title in enumerate(titles):
        pen.text((column * width + 6, 4), title, fill="black", font=font)
    return sheet


# --- The command ------------------------------------------------------------------------------


def define_flags(*, cases: int = 0) -> None:
    """Defines `--data`, `--full`, `--steps` and, with a default over 0, `--cases`."""
    flags.DEFINE_string(
        "data", None, f"Folder of records; default: {USUAL_DATA}, or the default data set."
    )
    flags.DEFINE_bool("full", False, "Full-size images and network, 20,000 steps: for a GPU.")
    flags.DEFINE_integer("steps", 0, "Steps of each training; 0 = the recipe's.", lower_bound=0)
    if cases:
        flags.DEFINE_integer("cases", cases, "Samples in the picture.", lower_bound=1)


def main(study: Callable[[Any], str]) -> None:
    """Runs a study as a command: parses the flags, prints its table, tells a user's mistake.

    Args:
      study: takes the values of the flags and returns the table.
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

"""Comparison of the paper's networks: `python -m psgn_jax.experiments.networks --workdir DIR`.

The study trains `vanilla` (all points from a fully connected branch), `two_branch` and `hourglass`,
each with the squared Chamfer distance (CD) and with the earth mover's distance (EMD), on the same
data, in the same order, for the same number of steps. With layers of equal widths the networks have
different numbers of parameters. A fourth network, `fc_equal`, is therefore `vanilla` with hidden
widths scaled so that it has as many parameters as `two_branch`.

The trainings are ordinary runs in `DIR/two_branch_cd`, ...: if the command is killed, starting it
again resumes them; if all are complete, it only measures and draws. Two other studies can use
these runs: `psgn_jax.experiments.branches` (`--run=DIR/two_branch_cd`) and `.losses`
(`--cd=DIR/two_branch_cd --emd=DIR/two_branch_emd`).

Files: `networks.txt`, `.md` and `.json` with the numbers. `networks.png` shows the CD of the
networks trained by CD and the EMD of those trained by EMD, relative to `vanilla`.

Source: Fan, Su, Guibas, CVPR 2017, section 5.5 and its figure comparing networks: "the introduction
of deconvolution significantly improves performance. Stacking another hourglass level also gives
performance gain." They train for 300,000 steps; sizes and measures here are **ours**.
"""

import itertools
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from absl import flags
from PIL import Image, ImageDraw, ImageFont

from psgn_jax.config import Config
from psgn_jax.experiments import common
from psgn_jax.experiments.common import Difference
from psgn_jax.metrics.evaluation import Evaluation
from psgn_jax.models import point_out_net
from psgn_jax.models.point_layout import padded_size
from psgn_jax.training import state as state_lib
from psgn_jax.training.log import read_metrics

NETWORKS: Mapping[str, str] = {
    "vanilla": "vanilla (fc)",
    "fc_equal": "fc, parameters of two-branch",
    "two_branch": "two-branch",
    "hourglass": "hourglass",
}
"""Titles of the networks, by name."""

LOSSES: Mapping[str, str] = {"cd": "chamfer_sq_mean", "emd": "emd_mean"}
"""Names of the losses, by the suffix of a training's folder."""

METRICS: Mapping[str, str] = {"cd": "cd_sq_radius2", "emd": "emd_radius"}
TITLES: Mapping[str, str] = {"cd": "CD squared [radius^2]", "emd": "EMD [radius]"}

PAIRS = (
    ("two_branch", "vanilla"),
    ("two_branch", "fc_equal"),
    ("hourglass", "two_branch"),
    ("hourglass", "vanilla"),
)
"""The pairs of networks that are compared sample by sample."""

_SMALL: Mapping[str, Mapping[str, Any]] = {
    "data": {"image_size": (48, 64), "num_points": 1024},
    "model": {"widths": (16, 32, 64, 128, 256), "deconv_level": 1, "fc_widths": (512, 512)},
    "train": {"eval_every": 0},
}
_COLOURS = ((150, 150, 150), (197, 176, 150), (70, 130, 180), (226, 114, 62))


def configuration(network: str, loss: str, path: str, *, full: bool, steps: int = 0) -> Config:
    """The recipe of `configs/authors_small.py` on quarter-size images with 24x32 deconv points.

    Args:
      network: a key of `NETWORKS`.
      loss: a key of `LOSSES`.
      path: folder of records, "" = the default data set.
      full: use the recipe of `configs/authors.py` instead: full-size images, the widths of the
        published network, 20,000 steps with batches of 32.
      steps: number of training steps; 0 = that of the recipe.
    """
    # The EMD needs as many true points as predicted ones. With 450 steps, all eight trainings take
    # 40 minutes on two CPU cores with little other load.
    small = {"data": {"num_points": 1024}, "train": {"eval_every": 0}} if full else _SMALL
    steps = steps or (20_000 if full else 450)

    def build(name: str, **model: Any) -> Config:
        changes = {
            **small,
            "model": {**small.get("model", {}), "name": name, **model},
            "loss": {"name": LOSSES[loss]},
        }
        return common.recipe(path, full=full, steps=steps, changes=changes)

    if network in ("two_branch", "hourglass"):
        return build(network)
    alone = build("vanilla", fc_points=1024)
    if network == "vanilla":
        return alone
    widths = alone.model.fc_widths
    spare = num_parameters(build("two_branch")) - num_parameters(alone) + _fc_parameters(alone)

    def scaled(factor: float) -> Config:
        scaled = tuple(max(1, round(factor * width)) for width in widths)
        return build("vanilla", fc_points=1024, fc_widths=scaled)

    low, high = 0.0, 8.0
    while high - low > 0.5 / max(widths):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if _fc_parameters(scaled(middle)) < spare else (low, middle)
    return min((scaled(low), scaled(high)), key=lambda c: abs(_fc_parameters(c) - spare))


def _fc_parameters(config: Config) -> int:
    """Number of parameters in the fc branch of a `vanilla` network (kernels and biases)."""
    model, divisor = config.model, config.model.divisor
    height, width = padded_size(model.image_size, len(model.widths))
    bottleneck = (height // divisor) * (width // divisor) * model.widths[-1]
    sizes = (bottleneck, *model.fc_widths, 3 * model.fc_points)
    return sum((a + 1) * b for a, b in itertools.pairwise(sizes))


def num_parameters(config: Config) -> int:
    """Number of parameters of a network, from shapes alone."""
    model = point_out_net.build(config.model)
    tx = state_lib.optimizer(config.optim, config.train.steps)
    shapes = jax.eval_shape(lambda: state_lib.create(config, model, tx).params)
    return sum(leaf.size for leaf in jax.tree.leaves(shapes))


# --- Results ----------------------------------------------------------------------------------


class Trained(NamedTuple):
    """The evaluation and the cost of one training.

    Attributes:
      evaluation: evaluation of the last checkpoint.
      parameters: number of parameters of the network.
      seconds: duration of a step, the median over the lines of the log.
      minutes: duration of all steps, without compilation, evaluations and checkpoints.
    """

    evaluation: Evaluation
    parameters: int
    seconds: float
    minutes: float


def cost(workdir: pathlib.Path, batch_size: int) -> tuple[float, float]:
    """Median seconds per step and minutes of all steps, from a run's log; NaN if it is short."""
    last, steps, seconds = 0, [], []
    for line in read_metrics(workdir / "metrics.jsonl"):
        if line["kind"] == "train":
            if rate := line.get("samples_per_second"):
                steps.append(line["step"] - last)
                seconds.append(batch_size / rate)
            last = line["step"]
    if not steps:
        return float("nan"), float("nan")
    return float(np.median(seconds)), float(np.dot(steps, seconds)) / 60


def compare(results: Mapping[str, Trained], one: str, other: str, loss: str) -> Difference:
    """The metric of `loss`, `one` minus `other`, for two networks trained with that loss."""
    a, b = (results[f"{name}_{loss}"].evaluation.metrics[METRICS[loss]] for name in (one, other))
    return common.difference(a, b)


def _lines(results: Mapping[str, Trained]) -> list[list[str]]:
    head = ["network", "parameters"]
    head += [f"{m.upper()} after {t.upper()}" for t in LOSSES for m in METRICS]
    head += [f"s a step, {t.upper()}" for t in LOSSES] + ["minutes in all"]
    lines = [head]
    for name, title in NETWORKS.items():
        runs_of = [results[f"{name}_{t}"] for t in LOSSES]
        means = [run.evaluation.means[m] for run in runs_of for m in METRICS.values()]
        lines.append(
            [
                title,
                f"{runs_of[0].parameters:,}",
                *(f"{mean:.5f}" for mean in means),
                *(f"{run.seconds:.3f}" for run in runs_of),
                f"{sum(run.minutes for run in runs_of):.1f}",
            ]
        )
    return lines


def _pair_lines(results: Mapping[str, Trained]) -> list[list[str]]:
    head = ["difference"]
    for loss in LOSSES:
        head += [f"{loss.upper()} after {loss.upper()}", "better on"]
    lines = [head]
    for one, other in PAIRS:
        cells = [f"{NETWORKS[one]} - {NETWORKS[other]}"]
        for loss in LOSSES:
            change = compare(results, one, other, loss)
            cells += [f"{change.mean:+.5f} +- {change.error:.5f}", f"{100 * change.better:.0f} %"]
        lines.append(cells)
    return lines


def _note(results: Mapping[str, Trained], steps: int) -> str:
    first = results["two_branch_emd"].evaluation
    return (
        f"CD: squared, radius^2; EMD: radius; after CD: of the network trained by CD. "
        f"{len(first.names)} samples of {first.split!r}, {first.num_points[0]} predicted points "
        f"against {first.num_points[1]} true ones (EMD: as many as predicted), after {steps:,} "
        "steps of each training. A difference is a mean over samples with its standard error, from "
        "one training of each; it would also change with the seed of the training."
    )


def table(results: Mapping[str, Trained], steps: int) -> str:
    """Both tables as text."""
    parts = [common.text_table(_lines(results)), common.text_table(_pair_lines(results))]
    return "\n".join([*parts, _note(results, steps)]) + "\n"


def markdown(results: Mapping[str, Trained], steps: int) -> str:
    """Both tables as Markdown."""
    parts = [common.markdown_table(_lines(results)), common.markdown_table(_pair_lines(results))]
    return "\n".join([*parts, _note(results, steps)]) + "\n"


def numbers(results: Mapping[str, Trained]) -> dict[str, Any]:
    """The comparison for JSON, with null for numbers that are not finite."""
    first = results["two_branch_emd"].evaluation
    return {
        "split": first.split,
        "samples": len(first.names),
        "num_pred_points": first.num_points[0],
        "num_gt_points": first.num_points[1],
        "fscore_threshold": first.threshold,
        "runs": {
            name: {
                "parameters": result.parameters,
                **common.finite(
                    {"seconds_per_step": result.seconds, "minutes_of_steps": result.minutes}
                ),
                "mean_over_samples": common.finite(result.evaluation.means),
            }
            for name, result in results.items()
        },
        "differences": {
            f"{one} - {other}": {
                loss: common.finite(compare(results, one, other, loss)._asdict()) for loss in LOSSES
            }
            for one, other in PAIRS
        },
    }


# --- Picture ----------------------------------------------------------------------------------

_SIZE, _LEFT, _TOP, _BASE = (860, 430), 66, 62, 330
_BAR, _BETWEEN, _GROUP = 78, 12, 40


def figure(results: Mapping[str, Trained]) -> Image.Image:
    """Draws bars: CD after training by CD, and EMD after EMD, relative to `vanilla`.

    Lower is better. The error bars are the standard errors of the differences from `vanilla`.
    """
    scale = 2  # drawn at twice the size, for antialiasing
    sheet = Image.new("RGB", (_SIZE[0] * scale, _SIZE[1] * scale), "white")
    pen = ImageDraw.Draw(sheet)

    def text(x: float, y: float, words: str, size: int, anchor: str, fill: Any = "black") -> None:
        font = ImageFont.load_default(size=size * scale)
        pen.text((x * scale, y * scale), words, fill=fill, font=font, anchor=anchor)

    def line(points: Sequence[float], fill: Any, width: float = 1) -> None:
        pen.line([p * scale for p in points], fill=fill, width=round(width * scale))

    heights: dict[tuple[str, str], tuple[float, float]] = {}
    for loss, metric in METRICS.items():
        means = {n: results[f"{n}_{loss}"].evaluation.means[metric] for n in NETWORKS}
        for name in NETWORKS:
            error = compare(results, name, "vanilla", loss).error
            heights[name, loss] = means[name] / means["vanilla"], error / means["vanilla"]
    shown = [sum(pair) for pair in heights.values() if np.isfinite(sum(pair))]
    top = max(1.2, 0.2 * np.ceil(5 * 1.04 * max(shown, default=1.0)))

    def height(value: float) -> float:
        return _BASE - (_BASE - _TOP) * value / top

    text(10, 14, "Error over that of vanilla, after training by that distance; lower is better", 16,
         "la")  # fmt: skip
    every = 0.2 if top <= 2 else float(np.ceil(top) / 5)
    for tick in np.arange(0, top + every / 2, every):
        line((_LEFT, height(tick), _SIZE[0] - 20, height(tick)), (222, 222, 222))
        text(_LEFT - 8, height(tick), f"{tick:.1f}", 13, "rm")
    left = float(_LEFT + _GROUP / 2)
    for loss in METRICS:
        begin = left
        for name, colour in zip(NETWORKS, _COLOURS, strict=True):
            value, error = heights[name, loss]
            mean = results[f"{name}_{loss}"].evaluation.means[METRICS[loss]]
            if np.isfinite(value):
                box = (left, height(value), left + _BAR, height(0))
                pen.rectangle([p * scale for p in box], fill=colour)
                peak = value
                if name != "vanilla" and np.isfinite(error):
                    middle, peak = left + _BAR / 2, value + error
                    low, high = height(value - error), height(peak)
                    line((middle, low, middle, high), (40, 40, 40), 1.5)
                    for y in (low, high):
                        line((middle - 7, y, middle + 7, y), (40, 40, 40), 1.5)
                text(left + _BAR / 2, height(peak) - 4, f"{value:.2f}", 14, "mb")
                text(left + _BAR / 2, height(0) - 8, f"{mean:.4f}", 13, "mb")
            left += _BAR + _BETWEEN
        title = f"{TITLES[loss]}, trained by {loss.upper()}"
        text((begin + left - _BETWEEN) / 2, _BASE + 8, title, 14, "ma")
        left += _GROUP - _BETWEEN
    line((_LEFT, _BASE, _SIZE[0] - 20, _BASE), (60, 60, 60), 1.5)
    for i, (name, title) in enumerate(NETWORKS.items()):
        x, y = _LEFT + 20 + i % 2 * 390, _BASE + 40 + i // 2 * 24
        pen.rectangle([p * scale for p in (x, y, x + 16, y + 16)], fill=_COLOURS[i])
        parameters = results[f"{name}_cd"].parameters
        amount = f"{parameters / 1e6:.2f} M" if parameters >= 10_000 else f"{parameters:,}"
        text(x + 24, y + 8, f"{title}: {amount} parameters", 14, "lm")
    return sheet.reduce(scale)


# --- The study --------------------------------------------------------------------------------


def run(
    workdir: str | pathlib.Path, *, data: str | None = None, full: bool = False, steps: int = 0
) -> str:
    """Runs the study; returns the tables.

    Args:
      workdir: folder for the runs and the results.
      data: folder of records; None: chosen by `common.find_data`.
      full: described in `configuration`.
      steps: steps of each training; 0 = those of the recipe.

    Raises:
      ConfigError: the data do not exist, or the folder contains other runs.
      UserError: a signal stopped a training; the same call resumes it.
    """
    workdir, path = pathlib.Path(workdir), common.find_data(data)
    configs = {
        f"{network}_{loss}": configuration(network, loss, path, full=full, steps=steps)
        for loss in LOSSES
        for network in NETWORKS
    }
    common.check_data(configs["two_branch_cd"])
    common.train_each(configs, workdir)
    results = {}
    for name, config in configs.items():
        evaluation = common.measure(config, workdir / name, 0).evaluation
        spent = cost(workdir / name, config.train.batch_size)
        results[name] = Trained(evaluation, num_parameters(config), *spent)
    length = configs["two_branch_cd"].train.steps
    text = table(results, length)
    common.write_results(
        workdir,
        "networks",
        text=text,
        markdown=markdown(results, length),
        document={"data": path or "default", "full": full, "steps": length, **numbers(results)},
        picture=figure(results),
    )
    return text


def _study(values: Any) -> str:
    return run(values.workdir, data=values.data, full=values.full, steps=values.steps)


if __name__ == "__main__":
    flags.DEFINE_string("workdir", None, "Folder of all runs and the results.", required=True)
    common.define_flags()
    common.main(_study)

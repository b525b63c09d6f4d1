"""Comparison of the paper's networks: `python -m psgn_jax.experiments.networks --workdir DIR`.

The study trains `vanilla` (all points by a fully connected branch), `two_branch` and `hourglass`
with the squared Chamfer distance (CD) and with the earth mover's distance (EMD), on the same data,
in the same order, for the same number of steps. With layers of the same widths, the networks have
different numbers of parameters. A fourth network therefore allows a comparison at equal size:
`fc_equal` is `vanilla` with its hidden layers scaled to as many parameters as `two_branch`.

The runs are `DIR/two_branch_cd`, ...: `psgn_jax.experiments.branches --run=DIR/two_branch_cd` and
`.losses --cd=DIR/two_branch_cd --emd=DIR/two_branch_emd` accept them. `networks.png` shows the CD
of the networks trained with CD and the EMD of those trained with EMD, divided by that of `vanilla`.

Source: Fan, Su, Guibas, CVPR 2017, section 5.5 and its figure comparing networks: "the introduction
of deconvolution significantly improves performance. Stacking another hourglass level also gives
performance gain." The paper trains for 300,000 steps; sizes and measures here are **ours**.
"""

import itertools
from collections.abc import Iterable, Mapping
from typing import Any

import jax
import numpy as np

from psgn_jax.config import Config
from psgn_jax.experiments import common, figures
from psgn_jax.experiments.losses import LOSSES
from psgn_jax.metrics.table import Lines
from psgn_jax.models import point_out_net
from psgn_jax.models.point_layout import padded_size
from psgn_jax.training import state as state_lib

NETWORKS: Mapping[str, str] = {
    "vanilla": "vanilla (fc)",
    "fc_equal": "fc, parameters of two-branch",
    "two_branch": "two-branch",
    "hourglass": "hourglass",
}
"""Name -> title."""

METRICS: Mapping[str, str] = {"cd": "cd_sq_radius2", "emd": "emd_radius"}
TITLES: Mapping[str, str] = {"cd": "CD squared [radius^2]", "emd": "EMD [radius]"}

PAIRS = (
    ("two_branch", "vanilla"),
    ("two_branch", "fc_equal"),
    ("hourglass", "two_branch"),
    ("hourglass", "vanilla"),
)
"""Pairs of networks that are compared sample by sample."""

_SMALL: Mapping[str, Mapping[str, Any]] = {
    "data": {"image_size": (48, 64), "num_points": 1024},
    "model": {"widths": (16, 32, 64, 128, 256), "deconv_level": 1, "fc_widths": (512, 512)},
    "train": {"eval_every": 0},
}


def configuration(network: str, loss: str, path: str, *, full: bool, steps: int = 0) -> Config:
    """`common.recipe` with quarter-size images and 24x32 deconv points, or at full size if `full`.

    Args:
      network: one of `NETWORKS`.
      loss: one of `LOSSES`.
      path: folder of records.
      full: see `common.recipe`.
      steps: see `common.recipe`.
    """
    # An EMD requires as many true points as predicted ones. 450 steps: all eight trainings take
    # about 40 minutes on two CPU cores that run little else.
    small = {"data": {"num_points": 1024}, "train": {"eval_every": 0}} if full else _SMALL

    def build(name: str, **model: Any) -> Config:
        changes = {
            **small,
            "model": {**small.get("model", {}), "name": name, **model},
            "loss": {"name": LOSSES[loss]},
        }
        return common.recipe(path, full=full, steps=steps, usual_steps=450, changes=changes)

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
    """Number of parameters of the fc branch of a `vanilla` network: kernels and biases."""
    model, divisor = config.model, config.model.divisor
    height, width = padded_size(model.image_size, len(model.widths))
    bottleneck = (height // divisor) * (width // divisor) * model.widths[-1]
    sizes = (bottleneck, *model.fc_widths, 3 * model.fc_points)
    return sum((a + 1) * b for a, b in itertools.pairwise(sizes))


def num_parameters(config: Config) -> int:
    """Number of parameters of the network of a configuration, from shapes only."""
    model = point_out_net.build(config.model)
    tx = state_lib.optimizer(config.optim, config.train.steps)
    shapes = jax.eval_shape(lambda: state_lib.create(config, model, tx).params)
    return sum(leaf.size for leaf in jax.tree.leaves(shapes))


def configs(options: Any) -> Iterable[tuple[str, Config]]:
    """The configurations of all trainings."""
    path = common.find_data(options.data)
    made = {
        f"{network}_{loss}": configuration(
            network, loss, path, full=options.full, steps=options.steps
        )
        for loss in LOSSES
        for network in NETWORKS
    }
    common.check_data(made["two_branch_cd"])
    return made.items()


def measure(options: Any) -> tuple[dict[str, Any], None]:
    """Measures all networks and their differences."""
    runs: dict[str, Any] = {}
    metrics: dict[str, Any] = {}
    for name in (f"{network}_{loss}" for loss in LOSSES for network in NETWORKS):
        measured = common.measure(options.workdir / name)
        seconds, total = common.cost(options.workdir / name)
        metrics[name] = measured.evaluation.metrics
        runs[name] = {
            "parameters": num_parameters(measured.config),
            "seconds_per_step": seconds,
            "minutes_of_steps": total / 60,
            "mean_over_samples": measured.evaluation.means,
        }
    document = {
        **common.about(measured, **{"each training": measured.config.train.steps}),
        "runs": runs,
        "differences": {f"{a} - {b}": compare(metrics, a, b) for a, b in PAIRS},
        "vanilla_differences": {name: compare(metrics, name, "vanilla") for name in NETWORKS},
    }
    return document, None


def compare(
    metrics: Mapping[str, Mapping[str, np.ndarray]], one: str, other: str
) -> dict[str, dict[str, float]]:
    """Loss -> `one` minus `other`, both trained with this loss, in the metric of the loss."""
    return {
        loss: common.difference(
            metric, metrics[f"{one}_{loss}"][metric], metrics[f"{other}_{loss}"][metric]
        )._asdict()
        for loss, metric in METRICS.items()
    }


def table(numbers: Mapping[str, Any]) -> list[Lines]:
    """The results of all networks, and the differences between some of them."""
    head = ["network", "parameters"]
    head += [f"{m.upper()} after {t.upper()}" for t in LOSSES for m in METRICS]
    lines = [[*head, *(f"s a step, {t.upper()}" for t in LOSSES), "minutes in all"]]
    for name, title in NETWORKS.items():
        runs = [numbers["runs"][f"{name}_{loss}"] for loss in LOSSES]
        means = [run["mean_over_samples"][metric] for run in runs for metric in METRICS.values()]
        cells = [title, f"{runs[0]['parameters']:,}", *(f"{mean:.5f}" for mean in means)]
        cells += [f"{run['seconds_per_step']:.3f}" for run in runs]
        lines.append([*cells, f"{sum(run['minutes_of_steps'] for run in runs):.1f}"])
    head = [cell for t in LOSSES for cell in (f"{t.upper()} after {t.upper()}", "better on")]
    pairs = [["difference", *head]]
    for one, other in PAIRS:
        entry = numbers["differences"][f"{one} - {other}"]
        cells = [cell for loss in LOSSES for cell in common.change(TITLES[loss], entry[loss])]
        pairs.append([f"{NETWORKS[one]} - {NETWORKS[other]}", *cells])
    return [lines, pairs]


def ratios(numbers: Mapping[str, Any]) -> dict[str, list[tuple[float, float]]]:
    """Network -> for each loss its metric divided by that of `vanilla`, and the standard error."""
    pairs: dict[str, list[tuple[float, float]]] = {}
    for loss, metric in METRICS.items():
        means = {n: numbers["runs"][f"{n}_{loss}"]["mean_over_samples"][metric] for n in NETWORKS}
        for name in NETWORKS:
            error = numbers["vanilla_differences"][name][loss]["error"]
            entry = means[name] / means["vanilla"], error / means["vanilla"]
            pairs.setdefault(name, []).append(entry)
    return pairs


def figure(numbers: Mapping[str, Any], _: Any) -> dict[str, Any]:
    """Bars of `ratios`."""
    pairs = ratios(numbers)
    chart = figures.Bars(
        "Error divided by that of vanilla; lower is better",
        [f"{TITLES[loss]}, trained with {loss.upper()}" for loss in LOSSES],
        {NETWORKS[name]: [value for value, _ in pair] for name, pair in pairs.items()},
        {NETWORKS[name]: [error for _, error in pair] for name, pair in pairs.items()},
    )
    return {"networks": figures.bars([chart])}


STUDY = common.Study(
    "networks",
    configs,
    measure,
    table,
    figure,
    options={"data": None, "full": False, "steps": 0},
    note="CD squared is in radius^2, EMD in radius. 'EMD after CD' is the EMD of the network "
    "trained with the CD. Difference: mean over samples with its standard error, from one training "
    "of each network.",
)

if __name__ == "__main__":
    STUDY.main()

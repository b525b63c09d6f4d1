"""Comparison of the paper's networks: `psgn study networks`.

We train `vanilla` (fully connected), `two_branch` and `hourglass` with the squared Chamfer distance
(CD) and with the earth mover's distance (EMD) plus five times the CD. `fc_equal` is `vanilla` with
as many parameters as `two_branch`. The studies `branches` and `losses` measure some of these runs.

Source: Fan, Su, Guibas, CVPR 2017, section 5.5 and its figure comparing networks: "the introduction
of deconvolution significantly improves performance. Stacking another hourglass level also gives
performance gain." The paper trains for 300,000 steps; sizes and measures here are **ours**.
"""

import numpy as np

from psgn_jax.studies import figures, runner

LOSSES = {"cd": "chamfer_sq_mean", "emd": "emd_mean + 5*chamfer_sq_mean"}
TRAINED_FOR = {"cd": "cd_sq_radius2", "emd": "emd_radius"}
"""Loss -> metric of its networks in the figure."""
NETWORKS: dict[str, runner.Overrides] = {
    "vanilla": {"model.name": "vanilla", "model.fc_points": 1024},
    # 4,306,243 parameters; two_branch has 4,306,323.
    "fc_equal": {"model.name": "vanilla", "model.fc_points": 1024, "model.fc_widths": (433, 433)},
    "two_branch": {"model.name": "two_branch"},
    "hourglass": {"model.name": "hourglass"},
}
METRICS = {
    "cd_sq_radius2": "CD squared [radius^2]",
    "emd_radius": "EMD [radius]",
    "aligned_cd_sq_radius2": "aligned CD squared [radius^2]",
    "fscore": "F-score at .02 radius [%]",
}

BASE: runner.Overrides = {
    "data.image_size": (48, 64),
    "data.num_points": 1024,  # as many as predicted points, for the EMD
    "model.widths": (16, 32, 64, 128, 256),
    "model.deconv_level": 1,
    "model.fc_widths": (512, 512),
    "train.steps": 1600,
    "eval.fscore_threshold": 0.02,
}


def configs(networks: list[str]) -> dict[str, runner.Overrides]:
    """The configurations of networks with both losses, such as `two_branch_cd`."""
    pairs = [(network, *loss) for loss in LOSSES.items() for network in networks]
    return {f"{name}_{loss}": {**NETWORKS[name], "loss.name": text} for name, loss, text in pairs}


def measure(run: runner.Run) -> runner.Measured:
    """The metrics of a run, with and without alignment."""
    return runner.evaluate(run._replace(config=runner.changed(run.config, {"eval.aligned": True})))


def figure(results: runner.Results) -> figures.Figure:
    """Errors divided by `vanilla`'s, with the standard errors of the differences over samples."""
    series: dict[str, list[float]] = {name: [] for name in NETWORKS}
    errors: dict[str, list[float]] = {name: [] for name in NETWORKS}
    models = runner.models_of(results)
    for name in NETWORKS:
        for loss, metric in TRAINED_FOR.items():
            runs = results[f"{name}_{loss}"], results[f"vanilla_{loss}"]
            values, others = (np.mean([x.metrics[metric] for x in of], axis=0) for of in runs)
            series[name].append(values.mean() / others.mean())
            error = runner.standard_error(values - others, models)
            errors[name].append(error / others.mean())
    groups = [f"{METRICS[m]}, trained with {loss.upper()}" for loss, m in TRAINED_FOR.items()]
    title = "Error divided by vanilla's; lower is better"
    return figures.bars({title: series}, groups, errors=errors)


PAIRS = (
    ("two_branch", "vanilla"),
    ("two_branch", "fc_equal"),
    ("hourglass", "two_branch"),
    ("hourglass", "vanilla"),
)

STUDY = runner.Study(
    "networks",
    BASE,
    lambda *_: configs(list(NETWORKS)),
    METRICS,
    figure,
    measure,
    pairs=[(f"{one}_{loss}", f"{other}_{loss}") for loss in LOSSES for one, other in PAIRS],
    note="two_branch_cd: the two-branch network trained with the CD.",
)

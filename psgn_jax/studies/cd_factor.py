"""The factor w of the CD in the loss EMD + w CD: `psgn study cd_factor`.

The two-branch network of the study `networks`, whose run with w = 5 is used if both studies get the
same `--workdir`. The paper trains with one of the two distances; the sum is **ours**.
"""

import numpy as np

from psgn_jax.studies import figures, networks
from psgn_jax.studies.runner import Results, Study

NAMES = {1: "two_branch_emd_1cd", 5: "two_branch_emd", 20: "two_branch_emd_20cd"}
"""w -> name of the configuration."""


def figure(results: Results) -> figures.Figure:
    """CD against EMD, each divided by its value at w = 5."""
    metrics = ("cd_sq_radius2", "emd_radius")
    means = {
        f"w = {w}": [float(np.mean([run.metrics[m] for run in results[name]])) for m in metrics]
        for w, name in NAMES.items()
    }
    unit = means["w = 5"]
    series = {name: list(np.divide(values, unit)) for name, values in means.items()}
    title = "Error divided by that with w = 5; lower is better"
    return figures.bars({title: series}, ["CD squared", "EMD"])


STUDY = Study(
    "cd_factor",
    networks.BASE,
    lambda *_: {
        name: {**networks.NETWORKS["two_branch"], "loss.name": f"emd_mean + {w}*chamfer_sq_mean"}
        for w, name in NAMES.items()
    },
    networks.METRICS,
    figure,
    networks.measure,
    pairs=[(NAMES[w], NAMES[5]) for w in (1, 20)],
)

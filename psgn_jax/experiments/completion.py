"""Shape completion, RGB against RGB-D: `python -m psgn_jax.experiments.completion --workdir DIR`.

The study trains a network twice on the same data, in the same order, with the same augmentations
and number of steps. One run has colour and mask as input, the other also the depth image. Both are
measured on the evaluation split, separately on the true points that are visible in the depth image
(`data.visibility`) and on the hidden ones. The depth image contains the visible points; the hidden
points have to be completed.

The runs are `DIR/rgb` and `DIR/rgbd`. The samples of `completion.png` are evenly spaced in the
split, not chosen by result.

Source: Fan, Su, Guibas, CVPR 2017, section "3D Shape Completion from RGBD Images", which shows
images and no numbers; networks, sizes and measures here are **ours**.
"""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from psgn_jax.config import Config
from psgn_jax.experiments import common, figures
from psgn_jax.experiments.common import Sample
from psgn_jax.metrics.table import Lines

INPUTS: Mapping[str, tuple[str, ...]] = {
    "rgb": ("rgb", "mask"),
    "rgbd": ("rgb", "mask", "depth"),
}
"""Folder of a training -> inputs of its network."""

TITLES = {"rgb": "RGB", "rgbd": "RGB-D"}

METRICS = {
    "cd_sq_radius2": "CD squared [radius^2]",
    "cd_l1_radius": "CD-L1 [radius]",
    "emd_radius": "EMD [radius]",
    "fscore": "F-score [%]",
    "cd_sq_pred_to_gt_radius2": "predicted points to truth [radius^2]",
    "cd_sq_gt_to_pred_visible_radius2": "visible true points to prediction [radius^2]",
    "cd_sq_gt_to_pred_hidden_radius2": "hidden true points to prediction [radius^2]",
    "cd_l1_gt_to_pred_visible_radius": "visible true points to prediction [radius]",
    "cd_l1_gt_to_pred_hidden_radius": "hidden true points to prediction [radius]",
    "recall_visible": "recall of visible points [%]",
    "recall_hidden": "recall of hidden points [%]",
    "visible_share": "visible true points [%]",
}
"""Rows of the table."""

VISIBLE, HIDDEN = (40, 95, 190), (225, 120, 30)


def configuration(inputs: Sequence[str], path: str, *, full: bool, steps: int = 0) -> Config:
    """The configuration of `common.recipe` with the given inputs."""
    # 1,800 steps: with the CD as the loss, both trainings took about 40 minutes on two CPU cores.
    # The time with the loss of the recipe, EMD + 5 CD, was not measured.
    changes = {"data": {"inputs": tuple(inputs)}}
    return common.recipe(path, full=full, steps=steps, usual_steps=1_800, changes=changes)


def configs(options: Any) -> Iterable[tuple[str, Config]]:
    """The configurations of both trainings; the data are checked for depth."""
    path = common.find_data(options.data)
    made = {
        name: configuration(inputs, path, full=options.full, steps=options.steps)
        for name, inputs in INPUTS.items()
    }
    common.check_data(made["rgbd"])
    return made.items()


def measure(options: Any) -> tuple[dict[str, Any], dict[str, dict[int, Sample]]]:
    """Measures both runs; returns the numbers, and the samples of the figure for each run."""
    keys = (*common.CASE, "depth", "visible")
    runs = {
        name: common.measure(options.workdir / name, keys=keys, num_cases=options.cases)
        for name in INPUTS
    }
    steps = {name: run.config.train.steps for name, run in runs.items()}
    document = {
        **common.about(runs["rgbd"], **steps),
        "mean_over_samples": {name: run.evaluation.means for name, run in runs.items()},
        "rgbd_minus_rgb": common.differences(
            {name: run.evaluation.metrics for name, run in runs.items()}
        ),
    }
    return document, {name: run.cases for name, run in runs.items()}


def table(numbers: Mapping[str, Any]) -> list[Lines]:
    """The comparison."""
    means, changes = numbers["mean_over_samples"], numbers["rgbd_minus_rgb"]
    return [common.table_of_two(means, changes, TITLES, METRICS)]


def panels(rgb: Sample, rgbd: Sample) -> dict[str, np.ndarray]:
    """Image and depth; both predictions and the truth seen from the camera, then rotated.

    A predicted point has the colour of the nearest true point.
    """
    truth, visible = rgbd["points"], rgbd["visible"]
    colours = np.where(visible[:, None], VISIBLE, HIDDEN)
    painted = {}
    for title, case in (("RGB", rgb), ("RGB-D", rgbd)):
        nearest = common.squared_distances(case["pred"], truth).argmin(axis=1)
        painted[title] = case["pred"], colours[nearest]
    # As many true points as predicted ones, because a denser cloud looks better.
    step = max(1, len(truth) // len(rgbd["pred"]))
    painted["truth"] = truth[::step], colours[::step]
    image, *others = figures.clouds(rgbd, painted).items()
    depth = np.where(rgbd["depth"] > 0, rgbd["depth"], np.nan)
    return dict([image, ("depth", depth), *others])


def figure(_: Mapping[str, Any], cases: Mapping[str, Mapping[int, Sample]]) -> dict[str, Any]:
    """A row for each sample."""
    rows = [panels(cases["rgb"][number], case) for number, case in cases["rgbd"].items()]
    return {"completion": figures.grid(rows)}


STUDY = common.Study(
    "completion",
    configs,
    measure,
    table,
    figure,
    note="Visible: within `visible_tolerance` of a surface point in the depth image. Difference: "
    "mean over samples with its standard error, from one training of each network.",
)

if __name__ == "__main__":
    STUDY.main()

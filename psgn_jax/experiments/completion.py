"""Shape completion: RGB against RGB-D, `python -m psgn_jax.experiments.completion --workdir DIR`.

The study trains one network twice on the same data, in the same order, with the same augmentation
and number of steps. The first time the inputs are colour and mask, the second time also the depth
image. Both networks are measured on the evaluation split, separately for true points that are
visible in the depth image (`data.visibility`) and for hidden ones. The depth image gives the
visible points, but the hidden ones must be completed.

The trainings are ordinary runs in `DIR/rgb` and `DIR/rgbd`: if the command is killed, starting it
again resumes them; if both are complete, it only measures and draws. Files: `completion.txt`, `.md`
and `.json` with the numbers; `completion.png` with some samples of the split, evenly spaced (not
selected by result).

Source: Fan, Su, Guibas, CVPR 2017, section "3D Shape Completion from RGBD Images", which gives
pictures but no numbers. Networks, sizes and measures here are **ours**.
"""

import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from absl import flags
from PIL import Image

from psgn_jax.config import Config, ConfigError
from psgn_jax.experiments import common
from psgn_jax.experiments.common import USUAL_DATA, Difference, find_data
from psgn_jax.metrics.evaluation import Evaluation
from psgn_jax.viewing.clouds import render_cloud, turned

INPUTS: Mapping[str, tuple[str, ...]] = {
    "rgb": ("rgb", "mask"),
    "rgbd": ("rgb", "mask", "depth"),
}
"""The inputs of the networks, by the folder of the training."""

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
}
"""Rows of the table."""

_PERCENT = ("fscore", "recall_visible", "recall_hidden")
_VISIBLE, _HIDDEN = np.array([40, 95, 190]), np.array([225, 120, 30])


def configuration(inputs: Sequence[str], path: str, *, full: bool, steps: int = 0) -> Config:
    """The recipe of `configs/authors_small.py` (with `full`, of `configs/authors.py`), shortened.

    Args:
      inputs: inputs of the network.
      path: folder of records with depth, "" = the default data set.
      full: use full-size images, the widths of the published network, and 20,000 steps with batches
        of 32.
      steps: number of training steps; 0 = 20,000 with `full`, else 1,800.
    """
    # With 1,800 instead of 3,200 steps both trainings take 40 minutes on two CPU cores.
    steps = steps or (20_000 if full else 1_800)
    return common.recipe(path, full=full, steps=steps, changes={"data": {"inputs": tuple(inputs)}})


def run(
    workdir: str | pathlib.Path,
    *,
    data: str | None = None,
    full: bool = False,
    steps: int = 0,
    num_cases: int = 6,
) -> str:
    """Runs the study; returns the table.

    Args:
      workdir: folder for the runs `rgb` and `rgbd` and the results.
      data: folder of records with depth; None: `USUAL_DATA` if it exists, else the default data
        set.
      full: described in `configuration`.
      steps: steps of each training; 0 = those of the recipe.
      num_cases: number of samples in the picture.

    Raises:
      ConfigError: the data do not exist or have no depth, or the folder contains other runs.
      UserError: a signal stopped a training; the same call resumes it.
    """
    workdir, path = pathlib.Path(workdir), find_data(data)
    configs = {
        name: configuration(inputs, path, full=full, steps=steps) for name, inputs in INPUTS.items()
    }
    # Check that there is depth before the RGB training, which takes half of the time.
    common.check_data(configs["rgbd"])
    common.train_each(configs, workdir, TITLES)
    measured = {
        name: _measure(config, workdir / name, num_cases) for name, config in configs.items()
    }
    evaluations = {name: result.evaluation for name, result in measured.items()}
    text = table(evaluations)
    common.write_results(
        workdir,
        "completion",
        text=text,
        markdown=markdown(evaluations),
        document={
            "data": path or "default",
            "full": full,
            "steps": configs["rgb"].train.steps,
            **numbers(evaluations),
        },
        picture=figure({name: result.cases for name, result in measured.items()}),
    )
    return text


def _measure(config: Config, workdir: pathlib.Path, num_cases: int) -> common.Measured:
    def check(batch: Mapping[str, Any]) -> None:
        if "visible" not in batch:
            raise ConfigError(f"data.path={config.data.path!r}: expected records with depth")

    keys = (*common.CASE, "depth", "visible")
    return common.measure(config, workdir, num_cases, keys=keys, check=check)


def compare(evaluations: Mapping[str, Evaluation], metric: str) -> Difference:
    """The difference of a metric, RGB-D minus RGB; NaN if no sample has it."""
    rgb, rgbd = (evaluations[name].metrics[metric] for name in INPUTS)
    return common.difference(rgbd, rgb, larger_is_better=metric in _PERCENT)


def _rows(evaluations: Mapping[str, Evaluation]) -> list[list[str]]:
    rows = []
    for metric, title in METRICS.items():
        if metric not in evaluations["rgb"].metrics:  # no EMD
            continue
        scale, digits = (100, 2) if metric in _PERCENT else (1, 5)
        change = compare(evaluations, metric)
        rows.append(
            [
                title,
                *(f"{scale * evaluations[name].means[metric]:.{digits}f}" for name in INPUTS),
                f"{scale * change.mean:+.{digits}f} +- {scale * change.error:.{digits}f}",
                f"{100 * change.better:.0f} %",
            ]
        )
    return rows


_HEAD = ("", *TITLES.values(), "difference", "RGB-D better on")


def _note(evaluations: Mapping[str, Evaluation]) -> str:
    rgbd = evaluations["rgbd"]
    return (
        f"{len(rgbd.names)} samples of {rgbd.split!r}, {rgbd.num_points[0]} predicted points "
        f"against {rgbd.num_points[1]} true ones, of which "
        f"{100 * rgbd.means['visible_share']:.1f} % are visible (within "
        f"{rgbd.visible_tolerance:g} radius of a point that the depth image measured). F-score and "
        f"recall at {rgbd.threshold:g} radius. The difference is a mean over samples with its "
        "standard error, from one training of each; it would also change with the seed of the "
        "training."
    )


def table(evaluations: Mapping[str, Evaluation]) -> str:
    """The comparison as text."""
    lines = [list(_HEAD), *_rows(evaluations)]
    return f"{common.text_table(lines)}\n{_note(evaluations)}\n"


def markdown(evaluations: Mapping[str, Evaluation]) -> str:
    """The comparison as a Markdown table."""
    lines = [list(_HEAD), *_rows(evaluations)]
    return f"{common.markdown_table(lines)}\n{_note(evaluations)}\n"


def numbers(evaluations: Mapping[str, Evaluation]) -> dict[str, Any]:
    """The comparison for JSON: fractions, not percentages; null for numbers not finite."""
    rgbd = evaluations["rgbd"]
    metrics = [m for m in METRICS if m in rgbd.metrics]
    return {
        "split": rgbd.split,
        "samples": len(rgbd.names),
        "num_pred_points": rgbd.num_points[0],
        "num_gt_points": rgbd.num_points[1],
        "visible_tolerance": rgbd.visible_tolerance,
        "fscore_threshold": rgbd.threshold,
        "mean_over_samples": {name: common.finite(e.means) for name, e in evaluations.items()},
        "rgbd_minus_rgb": {m: common.finite(compare(evaluations, m)._asdict()) for m in metrics},
    }


def depth_picture(depth: np.ndarray) -> np.ndarray:
    """Depth [h, w] as grey uint8 [h, w, 3]: near is light, far is dark, none is white."""
    measured = depth > 0
    near, far = (depth[measured].min(), depth[measured].max()) if measured.any() else (0, 1)
    grey = 220 - 190 * (depth - near) / max(far - near, 1e-6)
    return np.where(measured, grey, 255).astype(np.uint8)[..., None].repeat(3, axis=2)


def figure(cases: Mapping[str, Mapping[int, Mapping[str, np.ndarray]]]) -> Image.Image:
    """Draws a row per sample: image, depth; RGB, RGB-D and truth from the camera and the side.

    Visible true points are blue, hidden ones orange. A predicted point, which has no class, has the
    colour of the nearest true point.
    """
    titles = ["image", "depth"]
    titles += [f"{what}{view}" for view in ("", ", side") for what in ("RGB", "RGB-D", "truth")]
    strips = []
    for number, case in cases["rgbd"].items():
        gt, visible = case["points"], case["visible"]
        scale = max(1, round(192 / case["image"].shape[0]))
        size = (case["image"].shape[0] * scale, case["image"].shape[1] * scale)
        inner = np.diag([scale, scale, 1.0]) @ case["intrinsics"]
        clouds = []
        for cloud in (cases["rgb"][number]["pred"], case["pred"]):
            gaps = ((cloud[:, None, :] - gt[None, :, :]) ** 2).sum(axis=-1)
            clouds.append((cloud, visible[gaps.argmin(axis=1)]))
        # Show about as many true points as predicted ones, so that both clouds look equally dense.
        step = max(1, len(gt) // len(case["pred"]))
        clouds.append((gt[::step], visible[::step]))
        panels = [
            np.asarray(Image.fromarray(picture).resize(size[::-1], Image.Resampling.NEAREST))
            for picture in (case["image"], depth_picture(case["depth"]))
        ]
        panels += [
            render_cloud(
                cloud, inner, view, size, colours=np.where(seen[:, None], _VISIBLE, _HIDDEN)
            )
            for view in (case["extrinsics"], turned(case["extrinsics"], 90))
            for cloud, seen in clouds
        ]
        strips.append(np.concatenate(panels, axis=1))
    return common.with_titles(strips, titles)


def _study(values: Any) -> str:
    return run(
        values.workdir,
        data=values.data,
        full=values.full,
        steps=values.steps,
        num_cases=values.cases,
    )


if __name__ == "__main__":
    flags.DEFINE_string("workdir", None, "Folder of both runs and the results.", required=True)
    flags.DEFINE_string(
        "data",
        None,
        f"Folder of records with depth; default: {USUAL_DATA}, or the default data set.",
    )
    flags.DEFINE_bool("full", False, "Full-size images and network, 20,000 steps: for a GPU.")
    flags.DEFINE_integer("steps", 0, "Training steps; 0 = those of the recipe.", lower_bound=0)
    flags.DEFINE_integer("cases", 6, "Samples in the picture.", lower_bound=1)
    common.main(_study)

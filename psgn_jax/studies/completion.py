"""Shape completion: RGB against RGB-D, `python -m psgn_jax.studies.completion --workdir DIR`.

Trains one network twice on the same data, in the same order, with the same augmentations and number
of steps; one sees colour and mask, the other the depth image too. Then measures both on the
evaluation split, true points that the depth image shows (`data.visibility`) and those that it does
not apart: depth gives away the first, the others have to be completed.

The trainings are ordinary runs in `DIR/rgb` and `DIR/rgbd`: killed and started again, the same
command goes on where it was; with both done, it only measures and draws. Files: `completion.txt`,
`.md` and `.json` with the numbers, `completion.png` with some samples of the split at even
distances (not chosen by result).

Source: Fan, Su, Guibas, CVPR 2017, section "3D Shape Completion from RGBD Images", which shows
pictures and no numbers; networks, sizes and measures here are **ours**.
"""

import json
import math
import pathlib
import sys
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from absl import app, flags, logging
from PIL import Image, ImageDraw, ImageFont

from psgn_jax import evaluate as evaluate_lib
from psgn_jax import registry
from psgn_jax import train as train_lib
from psgn_jax.config import Config, ConfigError, UserError, check_paths, parse
from psgn_jax.viewing.clouds import draw_cloud, turned
from psgn_jax.writer import exit_on_user_error, log_to_terminal, parse_flags, write_atomic

USUAL_DATA = "records/authors"
"""Where README.md puts the authors' records; taken where no data are named."""

INPUTS: Mapping[str, tuple[str, ...]] = {
    "rgb": ("rgb", "mask"),
    "rgbd": ("rgb", "mask", "depth"),
}
"""Folder of a training -> what its network sees."""

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


class Measured(NamedTuple):
    """One network on the split: metrics of every sample, and some samples with predictions."""

    evaluation: evaluate_lib.Evaluation
    cases: dict[int, dict[str, np.ndarray]]


def configuration(inputs: Sequence[str], path: str, *, full: bool, steps: int = 0) -> Config:
    """The recipe of `configs/authors_small.py` (or, `full`, of `configs/authors.py`), shortened.

    Args:
      inputs: what the network sees.
      path: records with depth, "" = the default data set.
      full: full-size images, the published network's widths, 20,000 steps of 32.
      steps: in place of the recipe's.
    """
    data: dict[str, Any] = {"path": path, "inputs": tuple(inputs), "flip": True}
    optim = {"schedule": "cosine", "final_fraction": 0.01, "clip_norm": 1.0}
    if full:
        steps = steps or 20_000
        tree: dict[str, Any] = {
            "data": {**data, "stretch": 0.15},
            "optim": {**optim, "learning_rate": 3e-4, "warmup_steps": 500, "ema_decay": 0.999},
            "train": {"batch_size": 32, "log_every": 50, "images_every": 2_000},
        }
    else:
        # 1,800 steps, not 3,200: both trainings in 40 minutes on two CPU cores.
        steps = steps or 1_800
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
    interval = math.ceil(steps / 3)
    often = 500 if full else 200
    tree["train"] |= {"steps": steps, "eval_every": interval, "checkpoint_every": often}
    return parse(tree)


def find_data(named: str | None) -> str:
    """Folder of the records to train on; "" is the default data set.

    Raises:
      ConfigError: a folder was named that is not there.
    """
    if named is not None:
        check_paths(parse({"data": {"path": named}}))
        return named
    if pathlib.Path(USUAL_DATA).is_dir():
        return USUAL_DATA
    logging.info(
        "no --data named and none in %s: training on the default data set",
        USUAL_DATA,
    )
    return ""


def run(
    workdir: str | pathlib.Path,
    *,
    data: str | None = None,
    full: bool = False,
    steps: int = 0,
    num_cases: int = 6,
) -> str:
    """The whole study; returns the table.

    Args:
      workdir: gets the runs `rgb` and `rgbd` and the results.
      data: records with depth; None = `USUAL_DATA`, or without them the default data set.
      full: see `configuration`.
      steps: of each training, in place of the recipe's.
      num_cases: samples in the picture.

    Raises:
      ConfigError: the data are not there or lack depth, or the folder holds other runs.
      UserError: a signal ended a training; the same call goes on.
    """
    workdir, path = pathlib.Path(workdir), find_data(data)
    configs = {
        name: configuration(inputs, path, full=full, steps=steps) for name, inputs in INPUTS.items()
    }
    # The one that needs more is checked before the other has trained for half of the time.
    source, needs = registry.data_source(), configs["rgbd"].data
    try:
        for split in (needs.train_split, needs.eval_split):
            source.eval_batches(needs, split=split, batch_size=1).close()
    except (ValueError, OSError) as error:
        raise ConfigError(f"--data={path!r}: {error}") from error
    for name, config in configs.items():
        logging.info("%s: %d steps in %s", TITLES[name], config.train.steps, workdir / name)
        outcome = train_lib.train(config, workdir / name)
        if outcome.stopped_by:
            stopped = UserError("stopped by a signal; the same command goes on")
            stopped.exit_code = 128 + outcome.stopped_by
            raise stopped
    measured = {
        name: _measure(config, workdir / name, num_cases) for name, config in configs.items()
    }
    evaluations = {name: found.evaluation for name, found in measured.items()}
    text = table(evaluations)
    write_atomic(workdir / "completion.txt", text)
    write_atomic(workdir / "completion.md", markdown(evaluations))
    document = {
        "data": path or "default",
        "full": full,
        "steps": configs["rgb"].train.steps,
        **numbers(evaluations),
    }
    write_atomic(workdir / "completion.json", json.dumps(document, indent=2, allow_nan=False))
    figure({name: found.cases for name, found in measured.items()}).save(workdir / "completion.png")
    logging.info("results in %s", workdir)
    return text


def _measure(config: Config, workdir: pathlib.Path, num_cases: int) -> Measured:
    """The last checkpoint, not the best: none of the two is picked on the split it is shown on."""
    step, params = evaluate_lib.load_params(workdir, "last")
    logging.info("measuring %s, step %d", workdir, step)
    total = registry.data_source().num_samples(config.data, config.data.eval_split)
    wanted = {int(i) for i in np.linspace(0, total - 1, min(num_cases, total))}
    cases: dict[int, dict[str, np.ndarray]] = {}

    def keep(index: int, batch: Any, points: np.ndarray) -> None:
        if "visible" not in batch:
            raise ConfigError(f"data.path={config.data.path!r}: records without depth")
        for row in np.flatnonzero(batch["valid"]).tolist():
            number = index * config.eval.batch_size + row
            if number in wanted:
                keys = ("image", "depth", "points", "visible", "intrinsics", "extrinsics")
                cases[number] = {k: batch[k][row] for k in keys if k in batch}
                cases[number]["pred"] = points[row]

    return Measured(evaluate_lib.evaluate(config, params, on_batch=keep), cases)


class Difference(NamedTuple):
    """RGB-D minus RGB, sample by sample, over the samples that both count.

    Attributes:
      mean, error: of the difference, and the mean's standard error over samples.
      better: share of the samples on which RGB-D is the better one.
    """

    mean: float
    error: float
    better: float


def compare(evaluations: Mapping[str, evaluate_lib.Evaluation], metric: str) -> Difference:
    """What depth changes in a metric; NaN where no sample has it."""
    rgb, rgbd = (evaluations[name].metrics[metric] for name in INPUTS)
    # Points of one class may be missing from a sample; then they are for both networks.
    kept = ~(np.isnan(rgb) & np.isnan(rgbd))
    change = (rgbd - rgb)[kept]
    if not len(change):
        return Difference(math.nan, math.nan, math.nan)
    more = metric in _PERCENT  # the larger the better
    error = float(np.std(change, ddof=1) / np.sqrt(len(change))) if len(change) > 1 else math.nan
    better = float(np.mean(change > 0 if more else change < 0))
    return Difference(float(np.mean(change)), error, better)


def _rows(evaluations: Mapping[str, evaluate_lib.Evaluation]) -> list[list[str]]:
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


def _note(evaluations: Mapping[str, evaluate_lib.Evaluation]) -> str:
    found = evaluations["rgbd"]
    return (
        f"{len(found.names)} samples of {found.split!r}, {found.num_points[0]} predicted points "
        f"against {found.num_points[1]} true ones, of which "
        f"{100 * found.means['visible_share']:.1f} % are visible (within "
        f"{found.visible_tolerance:g} radius of what the depth image measured). F-score and recall "
        f"at {found.threshold:g} radius. The difference is a mean over samples with its standard "
        "error, from one training of each; another seed would move it too."
    )


def table(evaluations: Mapping[str, evaluate_lib.Evaluation]) -> str:
    """The comparison as text."""
    lines = [list(_HEAD), *_rows(evaluations)]
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    text = [
        "  ".join(
            [line[0].ljust(widths[0])]
            + [cell.rjust(w) for cell, w in zip(line[1:], widths[1:], strict=True)]
        )
        for line in lines
    ]
    return "\n".join([text[0], "-" * len(text[0]), *text[1:], "", _note(evaluations)]) + "\n"


def markdown(evaluations: Mapping[str, evaluate_lib.Evaluation]) -> str:
    """The comparison as a table for a README."""
    lines = [list(_HEAD), ["---"] * len(_HEAD), *_rows(evaluations)]
    rows = ["| " + " | ".join(line) + " |" for line in lines]
    return "\n".join([*rows, "", _note(evaluations)]) + "\n"


def numbers(evaluations: Mapping[str, evaluate_lib.Evaluation]) -> dict[str, Any]:
    """The comparison for JSON; fractions, not percent, and null for what is not finite."""

    def finite(values: Mapping[str, float]) -> dict[str, float | None]:
        return {k: v if math.isfinite(v) else None for k, v in values.items()}

    found = evaluations["rgbd"]
    shared = [m for m in METRICS if m in found.metrics]
    return {
        "split": found.split,
        "samples": len(found.names),
        "num_pred_points": found.num_points[0],
        "num_gt_points": found.num_points[1],
        "visible_tolerance": found.visible_tolerance,
        "fscore_threshold": found.threshold,
        "mean_over_samples": {name: finite(e.means) for name, e in evaluations.items()},
        "rgbd_minus_rgb": {m: finite(compare(evaluations, m)._asdict()) for m in shared},
    }


def depth_picture(depth: np.ndarray) -> np.ndarray:
    """Depth [h, w] as grey uint8 [h, w, 3], near ones light, on white where there is none."""
    measured = depth > 0
    near, far = (depth[measured].min(), depth[measured].max()) if measured.any() else (0, 1)
    grey = 220 - 190 * (depth - near) / max(far - near, 1e-6)
    return np.where(measured, grey, 255).astype(np.uint8)[..., None].repeat(3, axis=2)


def figure(cases: Mapping[str, Mapping[int, Mapping[str, np.ndarray]]]) -> Image.Image:
    """A row per sample: image, depth; RGB, RGB-D and truth from the camera, then from the side.

    Blue are visible true points, orange hidden ones; a predicted point, which has no such class,
    takes the colour of the true point nearest to it.
    """
    font = ImageFont.load_default(size=15)
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
        # As many true points as predicted ones: a denser cloud would only look better.
        step = max(1, len(gt) // len(case["pred"]))
        clouds.append((gt[::step], visible[::step]))
        panels = [
            np.asarray(Image.fromarray(picture).resize(size[::-1], Image.Resampling.NEAREST))
            for picture in (case["image"], depth_picture(case["depth"]))
        ]
        panels += [
            draw_cloud(cloud, inner, view, size, colours=np.where(seen[:, None], _VISIBLE, _HIDDEN))
            for view in (case["extrinsics"], turned(case["extrinsics"], 90))
            for cloud, seen in clouds
        ]
        strips.append(np.concatenate(panels, axis=1))
    head = np.full((24, strips[0].shape[1], 3), 255, np.uint8)
    sheet = Image.fromarray(np.concatenate([head, *strips]))
    pen, width = ImageDraw.Draw(sheet), strips[0].shape[1] // len(titles)
    for column, title in enumerate(titles):
        pen.text((column * width + 6, 4), title, fill="black", font=font)
    return sheet


def _main(argv: Sequence[str]) -> None:
    log_to_terminal()
    values = flags.FLAGS
    with exit_on_user_error():
        if len(argv) > 1:
            raise ConfigError(f"unexpected argument {argv[1]!r}")
        train_lib.keep_compiled()
        text = run(
            values.workdir,
            data=values.data,
            full=values.full,
            steps=values.steps,
            num_cases=values.cases,
        )
    sys.stdout.write(text)


if __name__ == "__main__":
    flags.DEFINE_string("workdir", None, "Folder of both runs and the results.", required=True)
    flags.DEFINE_string(
        "data",
        None,
        f"Folder of records with depth; default: {USUAL_DATA}, or the default data set.",
    )
    flags.DEFINE_bool("full", False, "Full-size images and network, 20,000 steps: for a GPU.")
    flags.DEFINE_integer("steps", 0, "Steps of each training; 0 = the recipe's.", lower_bound=0)
    flags.DEFINE_integer("cases", 6, "Samples in the picture.", lower_bound=1)
    app.run(_main, flags_parser=parse_flags)

"""CD against EMD in training: `python -m psgn_jax.experiments.losses --workdir DIR`.

Trains one network twice on the same data, in the same order, with the same augmentations and number
of steps and as many true points; one minimises the squared Chamfer distance (CD), the other the
earth mover's distance (EMD). Then measures both by both, and by what the paper sees: the network
trained by CD "tends to scatter a few points in its uncertain area", so points farther than `FAR`
from any true one are counted as stray; that trained by EMD is "more compact" but "sometimes overly
shrinks local structures", so true points farther than `FAR` from any predicted one are counted as
missed.

The trainings are ordinary runs in `DIR/cd` and `DIR/emd`: killed and started again, the same
command goes on where it was; with both done, it only measures and draws. `--cd=RUN --emd=RUN` takes
two finished runs of one network instead, and says so where one had more steps. Files: `losses.txt`,
`.md` and `.json` with the numbers, `losses.png` with the samples whose two predictions differ most
(by CD squared from one to the other): cases that are chosen to show the difference, not usual ones.

Source: Fan, Su, Guibas, CVPR 2017, section 5.5 and its figure of predictions of networks trained by
CD and EMD, which shows one case and no numbers; networks, sizes and measures here are **ours**.
"""

import pathlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from absl import flags
from PIL import Image, ImageDraw, ImageFont

from psgn_jax.config import Config, ConfigError, check_paths, flatten, parse, to_dict
from psgn_jax.data import camera
from psgn_jax.default_data import with_default_data
from psgn_jax.experiments import common
from psgn_jax.experiments.common import Difference
from psgn_jax.losses.by_name import parse_terms
from psgn_jax.metrics.evaluation import Evaluation
from psgn_jax.training.run_folder import load_config
from psgn_jax.viewing import spheres
from psgn_jax.viewing.clouds import turned

LOSSES: Mapping[str, str] = {"cd": "chamfer_sq_mean", "emd": "emd_mean"}
"""Folder of a training -> what it minimises."""

TITLES = {"cd": "trained by CD", "emd": "trained by EMD"}

FAR = 0.1
"""Distance, in units, from which on a point is stray or missed."""

METRICS = {
    "cd_sq_radius2": "CD squared [radius^2]",
    "emd_radius": "EMD [radius]",
    "cd_l1_radius": "CD-L1 [radius]",
    "fscore": "F-score [%]",
    "cd_sq_pred_to_gt_radius2": "predicted points to truth [radius^2]",
    "cd_sq_gt_to_pred_radius2": "truth to predicted points [radius^2]",
    "stray": "predicted points farther than .1 from the truth [%]",
    "missed": "true points farther than .1 from the prediction [%]",
    "unevenness": "unevenness: deviation over mean of the distance to the next point",
}
"""Rows of the table; the last three are this study's own."""

_PERCENT = ("fscore", "stray", "missed")
_COLOURS: Mapping[str, tuple[int, int, int]] = {
    "cd": (70, 130, 180),  # blue and green, as the paper has them
    "emd": (90, 165, 90),
    "truth": (165, 165, 165),
}
_PANEL, _TEXT, _GAP, _SIDE = 192, 22, 8, 75


def configuration(loss: str, path: str, *, full: bool, steps: int = 0) -> Config:
    """The recipe of `configs/authors_small.py` (or, `full`, of `configs/authors.py`), shortened.

    Args:
      loss: an entry of `losses.by_name.LOSSES`.
      path: folder of records, "" = the default data set.
      full: full-size images, the published network's widths, 20,000 steps of 32.
      steps: in place of the recipe's.
    """
    # 1,100 steps: both trainings in 40 minutes on two CPU cores. As many true points as predicted
    # ones, which an EMD wants.
    changes: dict[str, dict[str, Any]] = {
        "data": {"num_points": 1024},
        "loss": {"name": loss},
        "train": {"eval_every": 0},
    }
    steps = steps or (20_000 if full else 1_100)
    return common.recipe(path, full=full, steps=steps, changes=changes)


# --- Measures ---------------------------------------------------------------------------------


def own_measures(pred: np.ndarray, gt: np.ndarray) -> dict[str, float]:
    """Stray, missed and unevenness of one prediction [n, 3], n > 1, against its truth [m, 3]."""
    gaps, among = common.squared_distances(pred, gt), common.squared_distances(pred, pred)
    np.fill_diagonal(among, np.inf)
    spacing = np.sqrt(among.min(axis=1))
    return {
        "stray": float(np.mean(gaps.min(axis=1) > FAR**2)),
        "missed": float(np.mean(gaps.min(axis=0) > FAR**2)),
        "unevenness": float(spacing.std() / max(spacing.mean(), 1e-12)),
    }


def apart(a: np.ndarray, b: np.ndarray) -> float:
    """CD squared of two predictions, the mean over each plus that over the other; unit^2."""
    gaps = common.squared_distances(a, b)
    return float(gaps.min(axis=1).mean() + gaps.min(axis=0).mean())


Numbers = Mapping[str, Mapping[str, np.ndarray]]
"""Run -> metric -> one number per sample."""


def compare(metrics: Numbers, metric: str) -> Difference:
    """Trained by EMD minus trained by CD."""
    return common.difference(metrics["emd"][metric], metrics["cd"][metric], more=metric == "fscore")


# --- Results ----------------------------------------------------------------------------------


def _lines(metrics: Numbers) -> list[list[str]]:
    lines = [["", *TITLES.values(), "EMD - CD", "EMD better on"]]
    for metric, title in METRICS.items():
        if metric not in metrics["cd"]:  # no EMD
            continue
        scale, digits = (100, 2) if metric in _PERCENT else (1, 5)
        change = compare(metrics, metric)
        means = [common.mean_and_error(metrics[name][metric])[0] for name in LOSSES]
        lines.append(
            [
                title,
                *(f"{scale * mean:.{digits}f}" for mean in means),
                f"{scale * change.mean:+.{digits}f} +- {scale * change.error:.{digits}f}",
                f"{100 * change.better:.0f} %",
            ]
        )
    return lines


def _note(found: Evaluation, steps: Mapping[str, int]) -> str:
    counts = f"after {steps['cd']:,} steps of each training"
    if steps["cd"] != steps["emd"]:
        counts = f"after {steps['cd']:,} steps by CD, {steps['emd']:,} by EMD: not one budget"
    return (
        f"{len(found.names)} samples of {found.split!r}, {found.num_points[0]} predicted points "
        f"against {found.num_points[1]} true ones (EMD: as many as predicted), {counts}. "
        f"F-score at {found.threshold:g} radius. The difference is a mean over samples with "
        "its standard error, from one training of each; another seed would move it too."
    )


def table(metrics: Numbers, found: Evaluation, steps: Mapping[str, int]) -> str:
    """The comparison as text."""
    return f"{common.text_table(_lines(metrics))}\n{_note(found, steps)}\n"


def markdown(metrics: Numbers, found: Evaluation, steps: Mapping[str, int]) -> str:
    """The comparison as a table for a README."""
    return f"{common.markdown_table(_lines(metrics))}\n{_note(found, steps)}\n"


def numbers(metrics: Numbers, found: Evaluation) -> dict[str, Any]:
    """The comparison for JSON; fractions, not percent, and null for what is not finite."""
    shared = [metric for metric in METRICS if metric in metrics["cd"]]
    return {
        "split": found.split,
        "samples": len(found.names),
        "num_pred_points": found.num_points[0],
        "num_gt_points": found.num_points[1],
        "fscore_threshold": found.threshold,
        "far_radius": FAR,
        "mean_over_samples": {
            name: common.finite({m: common.mean_and_error(metrics[name][m])[0] for m in shared})
            for name in LOSSES
        },
        "emd_minus_cd": {m: common.finite(compare(metrics, m)._asdict()) for m in shared},
    }


def figure(cases: Mapping[int, Mapping[str, Any]]) -> Image.Image:
    """A row per sample: image; both predictions and the truth from the camera, then turned.

    Args:
      cases: number of the sample -> image, points, camera; `clouds`, the prediction of each run;
        `texts`, a line for each of them and for the image.
    """
    titles = ["image"]
    for view in ("", f", {_SIDE} degrees"):
        titles += [f"{title}{view}" for title in (*TITLES.values(), "truth")]
    font, strips = ImageFont.load_default(size=14), []
    for case in cases.values():
        shape = case["image"].shape[:2]
        size = (_PANEL, round(shape[1] * _PANEL / shape[0]))
        inner = camera.scale_intrinsics(case["intrinsics"], shape, size)
        image = Image.fromarray(case["image"]).resize(size[::-1], Image.Resampling.BICUBIC)
        step = max(1, len(case["points"]) // len(case["clouds"]["cd"]))
        clouds = {**case["clouds"], "truth": case["points"][::step]}
        panels = [np.asarray(image)]
        for angle in (0, _SIDE):
            extrinsics = turned(case["extrinsics"], angle)
            for name, cloud in clouds.items():
                paint = np.full((len(cloud), 3), _COLOURS[name], np.uint8)
                panels.append(spheres.render(cloud, paint, inner, extrinsics, size))
        gap = np.full((_PANEL, _GAP, 3), 255, np.uint8)
        row = np.concatenate([part for panel in panels for part in (panel, gap)], axis=1)
        text = Image.new("RGB", (row.shape[1], _TEXT), "white")
        pen, width = ImageDraw.Draw(text), row.shape[1] // len(titles)
        for column, name in enumerate(("image", *LOSSES)):
            pen.text((column * width + 6, 2), case["texts"][name], fill=(70, 70, 70), font=font)
        strips += [row, np.asarray(text)]
    return common.with_titles(strips, titles)


# --- The study --------------------------------------------------------------------------------


def run(
    workdir: str | pathlib.Path,
    *,
    trained: Mapping[str, str | pathlib.Path] | None = None,
    data: str | None = None,
    full: bool = False,
    steps: int = 0,
    num_cases: int = 6,
) -> str:
    """The whole study; returns the table.

    Args:
      workdir: gets the results, and the runs `cd` and `emd` if they are trained here.
      trained: folders of finished runs by `LOSSES`; None = train them.
      data: records; None = those of the runs `trained`, or as `common.find_data`.
      full: see `configuration`; for trainings alone, as
      steps: of each training, in place of the recipe's.
      num_cases: samples in the picture.

    Raises:
      ConfigError: the data are not there, the folder holds other runs, or those named cannot be
        compared.
      UserError: a signal ended a training; the same call goes on.
    """
    workdir = pathlib.Path(workdir)
    if trained is None:
        path = common.find_data(data)
        configs = {
            name: configuration(loss, path, full=full, steps=steps) for name, loss in LOSSES.items()
        }
        common.check_data(configs["cd"])
        common.train_each(configs, workdir, TITLES)
        folders = {name: workdir / name for name in LOSSES}
    else:
        if full or steps:
            raise ConfigError(
                "--full and --steps are for trainings: accepted: not with --cd, --emd"
            )
        folders = {name: pathlib.Path(trained[name]) for name in LOSSES}
        configs = _configs_of(folders, data)
    own: dict[str, list[dict[str, float]]] = {name: [] for name in LOSSES}
    preds: list[np.ndarray] = []
    cases: dict[int, dict[str, Any]] = {}

    def of_cd(number: int, case: Mapping[str, np.ndarray]) -> None:
        own["cd"].append(own_measures(case["pred"], case["points"]))
        preds.append(case["pred"].copy())

    def of_emd(number: int, case: dict[str, np.ndarray]) -> None:
        own["emd"].append(own_measures(case["pred"], case["points"]))
        cases[number] = {
            **{key: value.copy() for key, value in case.items()},
            "apart": apart(preds[number], case["pred"]),
        }
        if len(cases) > num_cases:
            del cases[min(cases, key=lambda n: cases[n]["apart"])]

    evaluations = {
        name: common.measure(configs[name], folders[name], 0, on_sample=on_sample).evaluation
        for name, on_sample in (("cd", of_cd), ("emd", of_emd))
    }
    metrics = {
        name: {
            **found.metrics,
            **{key: np.array([sample[key] for sample in own[name]]) for key in own[name][0]},
        }
        for name, found in evaluations.items()
    }
    shown = {}
    for number in sorted(cases, key=lambda n: -cases[n]["apart"]):
        case = cases[number]
        texts = {"image": evaluations["cd"].names[number].category or f"sample {number}"}
        for name in LOSSES:
            texts[name] = f"CD {metrics[name]['cd_sq_radius2'][number]:.4f}"
            if "emd_radius" in metrics[name]:
                texts[name] += f", EMD {metrics[name]['emd_radius'][number]:.3f}"
        clouds = {"cd": preds[number], "emd": case["pred"]}
        shown[number] = {**case, "clouds": clouds, "texts": texts}
    lengths = {name: config.train.steps for name, config in configs.items()}
    text = table(metrics, evaluations["emd"], lengths)
    common.write_results(
        workdir,
        "losses",
        text=text,
        markdown=markdown(metrics, evaluations["emd"], lengths),
        document={
            "data": configs["cd"].data.path or "default",
            "runs": {name: str(folder) for name, folder in folders.items()},
            "steps": lengths,
            "losses": {name: config.loss.name for name, config in configs.items()},
            **numbers(metrics, evaluations["emd"]),
            "shown": {str(n): shown[n]["apart"] for n in shown},
        },
        picture=figure(shown),
    )
    return text


def _configs_of(folders: Mapping[str, pathlib.Path], data: str | None) -> dict[str, Config]:
    """The configurations of finished runs, which are measured alike."""
    configs = {name: load_config(folder) for name, folder in folders.items()}
    for name, config in configs.items():
        kind = {"cd": "chamfer", "emd": "emd"}[name]
        if not all(term.name.startswith(kind) for term in parse_terms(config.loss.name)):
            raise ConfigError(
                f"--{name}={folders[name]}: loss.name={config.loss.name!r}: accepted: a run "
                f"{TITLES[name]}"
            )
    tree = {name: to_dict(config) for name, config in configs.items()}
    if data is not None:
        tree["cd"]["data"]["path"] = data
    for field in ("path", "eval_split", "num_eval_points"):
        tree["emd"]["data"][field] = tree["cd"]["data"][field]
    tree["emd"]["eval"] = tree["cd"]["eval"]
    configs = {name: parse(entry) for name, entry in tree.items()}
    flat = {name: flatten(config) for name, config in configs.items()}
    fields = [
        f for f in flat["cd"] if f.startswith("model.") or f in ("data.inputs", "data.image_size")
    ]
    if other := [f for f in fields if flat["cd"][f] != flat["emd"][f]]:
        field = other[0]
        raise ConfigError(
            f"{field}: {flat['cd'][field]!r} in --cd, {flat['emd'][field]!r} in --emd: accepted: "
            "runs of one network"
        )
    for config in configs.values():
        check_paths(config)
    return {name: with_default_data(config) for name, config in configs.items()}


def _study(values: Any) -> str:
    if bool(values.cd) != bool(values.emd):
        raise ConfigError("--cd and --emd: accepted: both or none of them")
    return run(
        values.workdir,
        trained={"cd": values.cd, "emd": values.emd} if values.cd else None,
        data=values.data,
        full=values.full,
        steps=values.steps,
        num_cases=values.cases,
    )


if __name__ == "__main__":
    flags.DEFINE_string("workdir", None, "Folder of the results and the runs.", required=True)
    flags.DEFINE_string("cd", None, "Folder of a finished run trained by CD; default: train one.")
    flags.DEFINE_string("emd", None, "Folder of a finished run trained by EMD.")
    common.define_flags(cases=6)
    common.main(_study)

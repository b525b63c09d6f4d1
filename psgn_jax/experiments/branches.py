"""The role of each branch: `python -m psgn_jax.experiments.branches --workdir DIR [--run RUN]`.

A two-branch or hourglass network predicts some points by a fully connected (fc) branch and the
others by a deconvolution (deconv) branch, as an image of coordinates. The paper shows the channels
of this image and the points of both branches. It states that the deconv branch learns a surface
that is wrapped around the object, while fc points have no order; and that deconv points form the
main body, fc points the details ("tip of gun, tail of plane, arms of a sofa"). This study draws the
points and measures:

- Order: the mean distance of points that are neighbours in the output (fc: consecutive points;
  deconv: adjacent cells), divided by the mean distance of two points of the branch; 1 = no order.
- The mean squared distances from the points of each branch to the truth and back, and the spread of
  each branch.
- The share of true points whose nearest predicted point is an fc point, to be compared with the
  share of fc among the predicted points.
- The same share for fifths of the true points of a sample. The points are sorted by their distance
  from the object's centre, or by the amount of surface within `AROUND` of them, which is small at
  tips and thin parts. If details were predicted by fc, its share would be larger in the outermost
  fifth and in the fifth with the least surface around it.

RUN is the folder of any run of `psgn_jax.training.loop` whose network has both branches. Without
it, a network is trained in `DIR/two_branch_cd` with the recipe of `configs/authors_small.py`, in 30
minutes on two CPU cores; if the command is killed, starting it again resumes the training. Files:
`branches.txt`, `.md` and `.json` with the numbers; `branches.png` with samples that are evenly
spaced in the split (not selected by result).

Source: Fan, Su, Guibas, CVPR 2017, section 5.5 and its figures on the channels and the points of
both branches, which give pictures but no numbers. The measures are **ours**. Lengths are in radii
of the bounding hemisphere.
"""

import pathlib
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from absl import flags
from PIL import Image, ImageDraw, ImageFont

from psgn_jax.config import Config, ConfigError, check_paths, parse, to_dict
from psgn_jax.data import camera
from psgn_jax.default_data import with_default_data
from psgn_jax.experiments import common
from psgn_jax.metrics.evaluation import Evaluation
from psgn_jax.models.point_layout import Branches, OutputGrid, branch_of_point, output_grid
from psgn_jax.training.run_folder import load_config
from psgn_jax.viewing import spheres
from psgn_jax.viewing.clouds import turned

RUN = "two_branch_cd"
"""Folder of the training of this study."""

AROUND = 0.2
"""Radius, in units, of the neighbourhood of a true point."""

FIFTHS = 5
_SAMPLED = 2048  # maximum number of true points whose neighbourhoods are counted
_STEP = 0.25  # the colour scale of the channel maps ends at multiples of this
_PANEL, _GAP, _SIDE = 192, 8, 75


class Rows(NamedTuple):
    """Title and number of digits of a row of the table."""

    title: str
    digits: int


MEASURES: Mapping[str, Rows] = {
    "points": Rows("points", 0),
    "order": Rows("order: distance of neighbours over that of random points", 3),
    "spread": Rows("spread: rms distance from the branch's centre [radius]", 4),
    "extent": Rows("rms distance from the object's centre [radius]", 4),
    "pred_to_gt": Rows("predicted points to truth [radius^2]", 5),
    "gt_to_pred": Rows("truth to the points of this branch alone [radius^2]", 5),
    "share": Rows("true points to which it is nearest [%]", 1),
}
"""Measures of each branch, one number per sample."""

PROFILES: Mapping[str, str] = {
    "by_distance": "distance from the object's centre, near to far",
    "by_surroundings": "surface around, much to little",
}
"""The orders that define the fifths of the true points; details are in the last fifth."""

_DETAILS = {"by_distance": "far from the centre", "by_surroundings": "at tips and thin parts"}


class Found(NamedTuple):
    """The measures of a split.

    Attributes:
      measures: arrays [samples] by branch and measure.
      both: "gt_to_pred" of the points of both branches together, [samples].
      profiles: share of the fc branch in each fifth, [samples, 5], by the keys of `PROFILES`.
    """

    measures: dict[str, dict[str, np.ndarray]]
    both: np.ndarray
    profiles: dict[str, np.ndarray]


def configuration(path: str, *, full: bool, steps: int = 0) -> Config:
    """The recipe of `configs/authors_small.py` (with `full`, of `configs/authors.py`).

    Args:
      path: folder of records, "" = the default data set.
      full: use full-size images, the widths of the published network, and 20,000 steps with batches
        of 32.
      steps: number of training steps; 0 = 20,000 with `full`, else 3,200.
    """
    return common.recipe(path, full=full, steps=steps or (20_000 if full else 3_200))


# --- Measures ---------------------------------------------------------------------------------


def order(points: np.ndarray, neighbours: np.ndarray) -> float:
    """Mean distance of the pairs `neighbours` [k, 2] divided by that of all pairs of points."""
    n = len(points)
    if n < 2 or not len(neighbours):
        return float("nan")
    near = np.linalg.norm(points[neighbours[:, 0]] - points[neighbours[:, 1]], axis=1).mean()
    apart = np.sqrt(common.squared_distances(points, points)).sum() / (n * (n - 1))
    return float(near / max(apart, 1e-12))


def neighbours_in_grid(grid: OutputGrid) -> np.ndarray:
    """Pairs [k, 2] of deconv points in horizontally or vertically adjacent cells."""
    numbers = np.arange(grid.height * grid.width * grid.points_per_cell).reshape(grid)
    right = np.stack([numbers[:, :-1], numbers[:, 1:]], axis=-1).reshape(-1, 2)
    below = np.stack([numbers[:-1], numbers[1:]], axis=-1).reshape(-1, 2)
    return np.concatenate([right, below])


def measure_sample(
    pred: np.ndarray, gt: np.ndarray, branches: Branches, grid: OutputGrid
) -> tuple[dict[str, dict[str, float]], float, dict[str, np.ndarray]]:
    """The measures of one sample: the fields of `Found` without the axis of samples.

    Args:
      pred: [n, 3], fc points first.
      gt: [m, 3], uniform on the surface.
      branches: indices of the points of each branch.
      grid: output grid of the deconv branch.
    """
    clouds = {"fc": pred[list(branches.fc)], "deconv": pred[list(branches.deconv)]}
    chain = np.arange(len(branches.fc))
    pairs = {
        "fc": np.stack([chain[:-1], chain[1:]], axis=1),
        "deconv": neighbours_in_grid(grid),
    }
    gaps = {name: common.squared_distances(gt, cloud) for name, cloud in clouds.items()}
    nearest = {name: gap.min(axis=1) for name, gap in gaps.items()}
    by_fc = nearest["fc"] < nearest["deconv"]
    centre = gt.mean(axis=0)
    measures = {
        name: {
            "points": float(len(cloud)),
            "order": order(cloud, pairs[name]),
            "spread": _rms(cloud - cloud.mean(axis=0)),
            "extent": _rms(cloud - centre),
            "pred_to_gt": float(gaps[name].min(axis=0).mean()),
            "gt_to_pred": float(nearest[name].mean()),
            "share": float(np.mean(by_fc if name == "fc" else ~by_fc)),
        }
        for name, cloud in clouds.items()
    }
    both = float(np.minimum(nearest["fc"], nearest["deconv"]).mean())
    few = gt[:: max(1, len(gt) // _SAMPLED)]
    chosen = by_fc[:: max(1, len(gt) // _SAMPLED)]
    around = (common.squared_distances(few, few) < AROUND**2).sum(axis=1)
    profiles = {
        "by_distance": shares(by_fc, np.linalg.norm(gt - centre, axis=1)),
        "by_surroundings": shares(chosen, -around),
    }
    return measures, both, profiles


def shares(hits: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Fraction of True in `hits` [m] for each fifth of the points, sorted by `by` [m]."""
    ranked = hits[np.argsort(by, kind="stable")]
    return np.array([part.mean() if len(part) else np.nan for part in _split(ranked)])


def _split(values: np.ndarray) -> list[np.ndarray]:
    return np.array_split(values.astype(np.float64), FIFTHS)


def _rms(offsets: np.ndarray) -> float:
    return float(np.sqrt((offsets**2).sum(axis=1).mean()))


def gather(
    samples: Sequence[tuple[dict[str, dict[str, float]], float, dict[str, np.ndarray]]],
) -> Found:
    """Stacks the results of `measure_sample` for the samples of a split."""
    return Found(
        {
            branch: {key: np.array([s[0][branch][key] for s in samples]) for key in MEASURES}
            for branch in ("fc", "deconv")
        },
        np.array([s[1] for s in samples]),
        {key: np.array([s[2][key] for s in samples]) for key in PROFILES},
    )


# --- Results ----------------------------------------------------------------------------------


def _lines(found: Found) -> list[list[str]]:
    lines = [["", "fc", "deconv", "both"]]
    for key, (title, digits) in MEASURES.items():
        cells = []
        for branch in ("fc", "deconv"):
            mean, error = common.mean_and_error(found.measures[branch][key])
            scale = 100 if key == "share" else 1
            cell = f"{scale * mean:.{digits}f}"
            cells.append(cell if key == "points" else f"{cell} +- {scale * error:.{digits}f}")
        both = ""
        if key == "gt_to_pred":
            mean, error = common.mean_and_error(found.both)
            both = f"{mean:.{digits}f} +- {error:.{digits}f}"
        lines.append([title, *cells, both])
    return lines


def last_minus_first(profile: np.ndarray) -> tuple[float, float]:
    """Mean of the share in the last fifth minus that in the first, and its standard error."""
    return common.mean_and_error(profile[:, -1] - profile[:, 0])


def _profile_lines(found: Found) -> list[list[str]]:
    ordinals = ("first", "second", "third", "fourth", "last")
    lines = [["share of fc among the nearest [%]", *ordinals, "last - first"]]
    for key, title in PROFILES.items():
        profile = 100 * found.profiles[key]
        mean, error = last_minus_first(profile)
        shown = [f"{common.mean_and_error(fifth)[0]:.1f}" for fifth in profile.T]
        lines.append([f"fifths by {title}", *shown, f"{mean:+.1f} +- {error:.1f}"])
    return lines


def _verdict(found: Found) -> str:
    """Compares the numbers with the statements of the paper, in words."""
    fc, deconv = (
        {key: float(np.nanmean(values)) for key, values in found.measures[branch].items()}
        for branch in ("fc", "deconv")
    )
    both = f"neighbours at {deconv['order']:.2f} of a random distance, of fc at {fc['order']:.2f}"
    if deconv["order"] < 0.5 and deconv["order"] < 0.7 * fc["order"]:
        said = [f"The deconv points are in the order of a surface, those of fc less so ({both})."]
    elif deconv["order"] < 0.9 * fc["order"]:
        said = [
            f"The deconv points are in more order than those of fc, but no smooth one ({both})."
        ]
    else:
        said = [f"The deconv points are in no clearer order than those of fc ({both})."]
    said.append(
        "Alone, the deconv points leave the truth "
        f"{deconv['gt_to_pred'] / max(fc['gt_to_pred'], 1e-12):.2f} times the squared distance "
        "that the fc points leave: "
        + ("a main body." if deconv["gt_to_pred"] < fc["gt_to_pred"] else "no main body.")
    )
    for key, where in _DETAILS.items():
        mean, error = last_minus_first(found.profiles[key])
        change = f"{100 * mean:+.1f} +- {100 * error:.1f} percentage points"
        if not abs(mean) > 2 * error:
            said.append(f"fc has no clearly other share of the nearest points {where} ({change}).")
        elif mean > 0:
            said.append(f"fc has more of the nearest points {where} ({change}): details.")
        else:
            said.append(f"fc has fewer of the nearest points {where} ({change}): no details.")
    share = fc["points"] / (fc["points"] + deconv["points"])
    said.append(f"It has {100 * share:.1f} % of the points.")
    return " ".join(said)


def _note(evaluation: Evaluation, found: Found) -> str:
    return (
        f"{len(evaluation.names)} samples of {evaluation.split!r}, {evaluation.num_points[0]} "
        f"predicted points against {evaluation.num_points[1]} true ones, CD squared "
        f"{evaluation.means['cd_sq_radius2']:.5f} radius^2. Means over samples with their standard "
        "errors, from one training. Fifths: of the true points of each sample; surface around: "
        f"within {AROUND:g} radius.\n\n{_verdict(found)}"
    )


def table(evaluation: Evaluation, found: Found) -> str:
    """Both tables as text."""
    parts = [common.text_table(_lines(found)), common.text_table(_profile_lines(found))]
    return "\n".join([*parts, _note(evaluation, found)]) + "\n"


def markdown(evaluation: Evaluation, found: Found) -> str:
    """Both tables as Markdown."""
    parts = [common.markdown_table(_lines(found)), common.markdown_table(_profile_lines(found))]
    return "\n".join([*parts, _note(evaluation, found)]) + "\n"


def numbers(evaluation: Evaluation, found: Found) -> dict[str, Any]:
    """The measures for JSON: fractions, not percentages; null for numbers not finite."""

    def entry(values: np.ndarray) -> dict[str, float | None]:
        mean, error = common.mean_and_error(values)
        return common.finite({"mean": mean, "error": error})

    return {
        "split": evaluation.split,
        "samples": len(evaluation.names),
        "num_pred_points": evaluation.num_points[0],
        "num_gt_points": evaluation.num_points[1],
        "around_radius": AROUND,
        "mean_over_samples": common.finite(evaluation.means),
        "branches": {
            branch: {key: entry(values) for key, values in measures.items()}
            for branch, measures in found.measures.items()
        },
        "gt_to_pred_of_both": entry(found.both),
        "fc_share_in_fifths": {
            key: {
                "fifths": [entry(fifth) for fifth in profile.T],
                "last_minus_first": entry(profile[:, -1] - profile[:, 0]),
            }
            for key, profile in found.profiles.items()
        },
        "verdict": _verdict(found),
    }


# --- Picture ----------------------------------------------------------------------------------


def channel_maps(pred: np.ndarray, branches: Branches, grid: OutputGrid) -> np.ndarray:
    """The deconv branch as an image of coordinates [h, w, 3]: the first point of each cell."""
    return pred[list(branches.deconv)].reshape(*grid, 3)[:, :, 0]


def _painted(maps: np.ndarray, scale: tuple[float, float]) -> list[np.ndarray]:
    """Colours the maps of x, y and z, uint8 [h, w, 3] each."""
    low, high = scale
    return [
        spheres.colours_by_value(channel.ravel() - low, high - low).reshape(*channel.shape, 3)
        for channel in np.moveaxis(maps, -1, 0)
    ]


def _legend(width: int, scale: tuple[float, float]) -> np.ndarray:
    """Draws the colour scale of the maps and the colours of both branches, [48, width, 3]."""
    height, font = 48, ImageFont.load_default(size=14)
    strip = Image.new("RGB", (width, height), "white")
    pen = ImageDraw.Draw(strip)
    bar, left = 300, 6
    low, high = scale
    ramp = spheres.colours_by_value(np.linspace(0, high - low, bar), high - low)
    strip.paste(Image.fromarray(np.repeat(ramp[None], 14, axis=0)), (left, 6))
    pen.rectangle((left, 6, left + bar - 1, 19), outline=(110, 110, 110))
    for value in np.arange(low, high + _STEP / 2, _STEP):
        at = left + (value - low) / (high - low) * (bar - 1)
        pen.line((at, 20, at, 24), fill=(70, 70, 70))
        anchor = "la" if value == low else "ra" if value == high else "ma"
        pen.text((at, 26), f"{value:g}", fill="black", font=font, anchor=anchor)
    text = "coordinate in the maps [radius]: x to the camera, y to the right, z up"
    pen.text((left + bar + 12, 4), text, fill="black", font=font)
    place = left + bar + 12
    for colour, name in zip(spheres.BRANCH_COLOURS, ("fc points", "deconv points"), strict=True):
        pen.ellipse((place, 27, place + 13, 40), fill=colour)
        pen.text((place + 19, 25), name, fill="black", font=font)
        place += 19 + int(pen.textlength(name, font=font)) + 24
    return np.asarray(strip)


def figure(cases: Mapping[int, Mapping[str, np.ndarray]], config: Config) -> Image.Image:
    """Draws a row per sample: image; maps of x, y, z; points by branch from two sides; truth.

    All maps have the same colour scale. The aspect ratio of a map is that of the deconv grid.
    """
    branches, grid = branch_of_point(config.model), output_grid(config.model)
    branch = np.repeat([0, 1], [len(branches.fc), len(branches.deconv)])
    titles = [
        "image",
        "x (to the camera)",
        "y (to the right)",
        "z (up)",
        "by branch",
        f"by branch, {_SIDE} degrees",
        "truth",
    ]
    maps = {number: channel_maps(case["pred"], branches, grid) for number, case in cases.items()}
    values = np.nan_to_num(np.stack(list(maps.values())))
    ends = _STEP * np.floor(values.min() / _STEP), _STEP * np.ceil(values.max() / _STEP)
    scale = float(ends[0]), max(float(ends[1]), float(ends[0]) + _STEP)
    strips = []
    for number, case in cases.items():
        shape, pred = case["image"].shape[:2], case["pred"]
        size = (_PANEL, round(shape[1] * _PANEL / shape[0]))
        inner = camera.scale_intrinsics(case["intrinsics"], shape, size)
        image = Image.fromarray(case["image"]).resize(size[::-1], Image.Resampling.BICUBIC)
        truth = case["points"][:: max(1, len(case["points"]) // len(pred))]
        grey = np.full((len(truth), 3), 150, np.uint8)
        outer = case["extrinsics"]
        colours = spheres.colours_by_branch(branch)
        panels = [np.asarray(image)]
        panels += [_fitted(m, size) for m in _painted(maps[number], scale)]
        panels += [
            spheres.render(cloud, paint, inner, turned(outer, angle), size)
            for cloud, paint, angle in (
                (pred, colours, 0),
                (pred, colours, _SIDE),
                (truth, grey, 0),
            )
        ]
        gap = np.full((_PANEL, _GAP, 3), 255, np.uint8)
        row = np.concatenate([part for panel in panels for part in (panel, gap)], axis=1)
        strips += [row, np.full((_GAP, row.shape[1], 3), 255, np.uint8)]
    return common.with_titles([*strips, _legend(strips[0].shape[1], scale)], titles)


def _fitted(picture: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Enlarges a picture to fit into `size`, without smoothing, on white."""
    factor = min(size[0] / picture.shape[0], size[1] / picture.shape[1])
    shape = (max(1, int(picture.shape[1] * factor)), max(1, int(picture.shape[0] * factor)))
    large = Image.fromarray(picture).resize(shape, Image.Resampling.NEAREST)
    panel = Image.new("RGB", size[::-1], "white")
    panel.paste(large, ((size[1] - shape[0]) // 2, (size[0] - shape[1]) // 2))
    return np.asarray(panel)


# --- The study --------------------------------------------------------------------------------


def run(
    workdir: str | pathlib.Path,
    *,
    trained: str | pathlib.Path | None = None,
    data: str | None = None,
    full: bool = False,
    steps: int = 0,
    num_cases: int = 6,
) -> str:
    """Runs the study; returns the tables.

    Args:
      workdir: folder for the results, and for the run if one is trained here.
      trained: folder of a finished run; None: train one.
      data: folder of records; None: those of the run `trained`, or chosen by `common.find_data`.
      full: described in `configuration`; not allowed with `trained`.
      steps: number of training steps; 0 = that of the recipe; not allowed with `trained`.
      num_cases: number of samples in the picture.

    Raises:
      ConfigError: the data do not exist, `workdir` contains another training, or the network of
        `trained` does not have both branches.
      UserError: a signal stopped the training; the same call resumes it.
    """
    workdir = pathlib.Path(workdir)
    if trained is None:
        config = configuration(common.find_data(data), full=full, steps=steps)
        common.train_each({RUN: config}, workdir)
        trained = workdir / RUN
    else:
        if full or steps:
            raise ConfigError("--full and --steps: accepted: only for a training, not with --run")
        config = _config_of(pathlib.Path(trained), data)
    branches, grid = branch_of_point(config.model), output_grid(config.model)
    samples: list[Any] = []

    def on_sample(number: int, case: Mapping[str, np.ndarray]) -> None:
        samples.append(measure_sample(case["pred"], case["points"], branches, grid))

    path = pathlib.Path(trained)
    evaluation, cases = common.measure(config, path, num_cases, on_sample=on_sample)
    found = gather(samples)
    text = table(evaluation, found)
    common.write_results(
        workdir,
        "branches",
        text=text,
        markdown=markdown(evaluation, found),
        document={
            "run": str(trained),
            "data": config.data.path or "default",
            "network": config.model.name,
            "steps": config.train.steps,
            **numbers(evaluation, found),
        },
        picture=figure(cases, config),
    )
    return text


def _config_of(trained: pathlib.Path, data: str | None) -> Config:
    config = load_config(trained)
    if data is not None:
        tree = to_dict(config)
        tree["data"]["path"] = data
        config = parse(tree)
    check_paths(config)
    branches = branch_of_point(config.model)
    if not (branches.fc and branches.deconv):
        raise ConfigError(
            f"--run={trained}: model.name={config.model.name!r} with {len(branches.fc)} fc and "
            f"{len(branches.deconv)} deconv points: accepted: a network with both branches"
        )
    return with_default_data(config)


def _study(values: Any) -> str:
    return run(
        values.workdir,
        trained=values.run,
        data=values.data,
        full=values.full,
        steps=values.steps,
        num_cases=values.cases,
    )


if __name__ == "__main__":
    flags.DEFINE_string("workdir", None, "Folder of the results.", required=True)
    flags.DEFINE_string("run", None, "Folder of a run with both branches; default: train one.")
    common.define_flags(cases=6)
    common.main(_study)

"""The points of each branch: `python -m psgn_jax.experiments.branches --workdir DIR [--run RUN]`.

A two-branch or hourglass network predicts some points by a fully connected (fc) branch and the
others, as an image of coordinates, by a deconvolutional (deconv) branch. The paper shows the
channels of this image and both sets of points. It states that the deconv branch learns a surface
wrapped around the object, while fc points are unordered. It also states that deconv points form the
main body and fc points the details ("tip of gun, tail of plane, arms of a sofa"). This study draws
the channels and the points, and measures

- order: the mean distance of points that are neighbours in the output (fc: consecutive points;
  deconv: adjacent cells), divided by that of two random points of the branch; 1 = no order;
- squared distances from the points of each branch to the truth and back, and the spread of each
  branch;
- the share of true points whose nearest predicted point belongs to each branch;
- the share of the fc branch in each fifth of the true points of a sample. The points are sorted by
  their distance from the centre of the object, or by the amount of surface around them (within
  `AROUND`), which is small at tips and thin parts. If the fc branch predicts the details, its share
  is larger in the outermost fifth and in the fifth with the least surface.

RUN is the folder of any run of `psgn_jax.main` with both branches. Without it, a network is trained
in `DIR/two_branch` with the recipe of `configs/authors_small.py`; this takes an estimated 40
minutes on two CPU cores. The samples of `branches.png` are evenly spaced in the split, not chosen
by result.

Source: Fan, Su, Guibas, CVPR 2017, section 5.5 and its figures of the channels and the points of
both branches, which show images and no numbers; the measures are **ours**. Unit of lengths: the
radius of the bounding hemisphere.
"""

import pathlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from absl import flags

from psgn_jax.config import Config, ConfigError
from psgn_jax.experiments import common, figures
from psgn_jax.experiments.common import Sample
from psgn_jax.metrics.table import Lines
from psgn_jax.models.point_layout import Branches, OutputGrid, branch_of_point, output_grid
from psgn_jax.viewing import spheres

RUN = "two_branch"
"""Folder of the run that the study trains."""

AROUND = 0.2
"""Radius of the neighbourhood of a true point, unit of the frame."""

FIFTHS = 5
_SAMPLED = 2048  # true points of a sample whose neighbourhoods are counted
_STEP = 0.25  # the limits of the colour scale of channels are multiples of this


class Row(NamedTuple):
    """A row of the table: title and digits of a measure."""

    title: str
    digits: int


MEASURES: Mapping[str, Row] = {
    "points": Row("points", 0),
    "order": Row("order: distance of neighbours over that of random points", 3),
    "spread": Row("spread: rms distance from the branch's centre [radius]", 4),
    "extent": Row("rms distance from the object's centre [radius]", 4),
    "pred_to_gt": Row("predicted points to truth [radius^2]", 5),
    "gt_to_pred": Row("truth to the points of only this branch [radius^2]", 5),
    "share": Row("true points nearest to this branch [%]", 1),
}
"""Measures of each branch, with one number per sample."""

PROFILES: Mapping[str, str] = {
    "by_distance": "distance from the object's centre, near to far",
    "by_surroundings": "surface nearby, most to least",
}
"""Quantities by which the true points are sorted into fifths."""

_ORDINALS = ("first", "second", "third", "fourth", "last")


def configuration(path: str, *, full: bool, steps: int = 0) -> Config:
    """The configuration of `common.recipe`, by default with the number of steps of its file."""
    return common.recipe(path, full=full, steps=steps)


def configs(options: Any) -> Iterable[tuple[str, Config]]:
    """The configuration of the training. If a finished run is given, it is checked instead."""
    if not options.run:
        path = common.find_data(options.data)
        return [(RUN, configuration(path, full=options.full, steps=options.steps))]
    if options.full or options.steps:
        raise ConfigError("--full, --steps apply only to a training; expected them without --run")
    model = common.finished_run(options.run, options.data).model
    branches = branch_of_point(model)
    if not (branches.fc and branches.deconv):
        raise ConfigError(
            f"--run={options.run}: model.name={model.name!r} with {len(branches.fc)} fc and "
            f"{len(branches.deconv)} deconv points; expected a network with both branches"
        )
    return []


def order(points: np.ndarray, neighbours: np.ndarray) -> float:
    """Mean distance of the pairs `neighbours` [k, 2], divided by that of all pairs of points."""
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
    """Measures of a sample.

    Returns the measures of each branch, the mean squared distance from the truth to the points of
    both branches, and for each quantity in `PROFILES` the fc share of each fifth [5].

    Args:
      pred: predicted points [n, 3], fc points first.
      gt: true points [m, 3], uniform on the surface.
      branches: the indices of the points of each branch.
      grid: the grid of the deconv branch.
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


def shares(values: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Share of the booleans `values` [m] that are True in each fifth; sorted by `by` [m]."""
    ranked = values[np.argsort(by, kind="stable")]
    return np.array([part.mean() if len(part) else np.nan for part in _split(ranked)])


def _split(values: np.ndarray) -> list[np.ndarray]:
    return np.array_split(values.astype(np.float64), FIFTHS)


def _rms(offsets: np.ndarray) -> float:
    return float(np.sqrt((offsets**2).sum(axis=1).mean()))


def gather(
    samples: Sequence[tuple[dict[str, dict[str, float]], float, dict[str, np.ndarray]]],
) -> dict[str, Any]:
    """Means and standard errors of the results of `measure_sample`, for the document."""

    def entry(values: Sequence[float] | np.ndarray) -> dict[str, float]:
        mean, error = common.mean_and_error(np.asarray(values, np.float64))
        return {"mean": mean, "error": error}

    profiles = {key: np.array([sample[2][key] for sample in samples]) for key in PROFILES}
    return {
        "branches": {
            branch: {key: entry([sample[0][branch][key] for sample in samples]) for key in MEASURES}
            for branch in ("fc", "deconv")
        },
        "gt_to_pred_of_both": entry([sample[1] for sample in samples]),
        "fc_share_in_fifths": {
            key: {
                "fifths": [entry(fifth) for fifth in profile.T],
                "last_minus_first": entry(profile[:, -1] - profile[:, 0]),
            }
            for key, profile in profiles.items()
        },
    }


def measure(options: Any) -> tuple[dict[str, Any], tuple[dict[int, Sample], Config]]:
    """Measures the run; returns the numbers, and the samples and configuration of the figure."""
    folder = pathlib.Path(options.run or options.workdir / RUN)
    config = common.finished_run(folder, options.data if options.run else None)
    branches, grid = branch_of_point(config.model), output_grid(config.model)
    samples: list[Any] = []

    def on_sample(_: int, case: Sample) -> None:
        samples.append(measure_sample(case["pred"], case["points"], branches, grid))

    run = common.measure(folder, config=config, num_cases=options.cases, on_sample=on_sample)
    document = {
        **common.about(run, training=config.train.steps),
        "run": str(folder),
        "network": config.model.name,
        "around_radius": AROUND,
        "mean_over_samples": run.evaluation.means,
        **gather(samples),
    }
    return document, (run.cases, config)


def table(numbers: Mapping[str, Any]) -> list[Lines]:
    """The measures of both branches, and the share of fc in each fifth of the true points."""

    def cell(entry: Mapping[str, float], digits: int, scale: float = 1, sign: str = "") -> str:
        mean, error = scale * entry["mean"], scale * entry["error"]
        return f"{mean:{sign}.{digits}f} +- {error:.{digits}f}" if digits else f"{mean:.0f}"

    lines = [["", "fc", "deconv", "both"]]
    for key, (title, digits) in MEASURES.items():
        scale = 100 if key == "share" else 1
        cells = [cell(numbers["branches"][b][key], digits, scale) for b in ("fc", "deconv")]
        both = cell(numbers["gt_to_pred_of_both"], digits) if key == "gt_to_pred" else ""
        lines.append([title, *cells, both])
    fifths = [["share of fc among the nearest [%]", *_ORDINALS, "last - first"]]
    for key, title in PROFILES.items():
        entry = numbers["fc_share_in_fifths"][key]
        shares = [f"{100 * fifth['mean']:.1f}" for fifth in entry["fifths"]]
        last = cell(entry["last_minus_first"], 1, 100, "+")
        fifths.append([f"fifths by {title}", *shares, last])
    return [lines, fifths]


def channel_maps(pred: np.ndarray, branches: Branches, grid: OutputGrid) -> np.ndarray:
    """The deconv branch as an image of coordinates [h, w, 3]: the first point of each cell."""
    return pred[list(branches.deconv)].reshape(*grid, 3)[:, :, 0]


def panels(case: Sample, config: Config) -> dict[str, np.ndarray]:
    """Image; maps of x, y, z; points coloured by branch, and truth, from two directions."""
    branches, grid = branch_of_point(config.model), output_grid(config.model)
    branch = np.repeat([0, 1], [len(branches.fc), len(branches.deconv)])
    pred = case["pred"]
    truth = case["points"][:: max(1, len(case["points"]) // len(pred))]
    painted = {
        "fc orange, deconv blue": (pred, spheres.colours_by_branch(branch)),
        "truth": (truth, np.array([150, 150, 150])),
    }
    image, *others = figures.clouds(case, painted).items()
    titles = ("x (to the camera)", "y (to the right)", "z (up)")
    maps = np.moveaxis(channel_maps(pred, branches, grid), -1, 0)
    return dict([image, *zip(titles, maps, strict=True), *others])


def figure(_: Any, rest: tuple[Mapping[int, Sample], Config]) -> dict[str, Any]:
    """A row for each sample; one colour scale for all maps."""
    rows = [panels(case, rest[1]) for case in rest[0].values()]
    values = [panel for row in rows for panel in row.values() if panel.ndim == 2]
    low, high = (
        _STEP * np.floor(np.nanmin(values) / _STEP),
        _STEP * np.ceil(np.nanmax(values) / _STEP),
    )
    scale = (float(low), float(max(high, low + _STEP)))
    return {"branches": figures.grid(rows, scale=scale, scale_title="coordinate [radius]")}


STUDY = common.Study(
    "branches",
    configs,
    measure,
    table,
    figure,
    options={"data": None, "full": False, "steps": 0, "cases": 6, "run": None},
    note="Means over samples with their standard errors, from one training. Fifths: of the true "
    f"points of each sample. Surface nearby: within {AROUND:g} radius.",
)

if __name__ == "__main__":
    flags.DEFINE_string("run", None, "Folder of a run with both branches; default: train one.")
    STUDY.main()

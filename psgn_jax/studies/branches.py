"""The points of each branch: `psgn study branches [--runs=RUN]`.

According to the paper, the deconv branch predicts the main body as an ordered surface, the fc
branch unordered points on details. For the two-branch networks of the study `networks`, we measure:

- order: the mean distance of neighbours in the output (fc: consecutive points; deconv: adjacent
  cells), divided by the mean distance of two points of the branch; 1 = no order;
- squared distances between the points of each branch and the truth, and the spread of each branch;
- the share of true points whose nearest predicted point belongs to each branch. For fc, we also
  measure this share for each fifth of a sample's true points, sorted by the distance from the
  object's centre, or by the number of true points within `AROUND`, which is small at thin parts.

Source: Fan, Su, Guibas, CVPR 2017, section 5.5 and its figures of both branches, which show images
and no numbers; the measures are **ours**. Unit of lengths: the radius of the bounding hemisphere.
"""

import numpy as np
from scipy.spatial.distance import cdist

from psgn_jax.config.experiment import ConfigError, ModelConfig
from psgn_jax.models.networks import build
from psgn_jax.models.point_out_net import OutputGrid
from psgn_jax.studies import architectures, figures, runner
from psgn_jax.viewing import spheres

AROUND = 0.2  # radius of the neighbourhood of a true point, unit of the frame
_SAMPLED = 2048  # true points of a sample whose neighbourhoods are counted

_OF_BRANCH = {
    "points": "points",
    "order": "distance of neighbours / distance of random points",
    "spread": "rms distance from the branch's centre [radius]",
    "extent": "rms distance from the object's centre [radius]",
    "pred_to_gt": "predicted points to truth [radius^2]",
    "gt_to_pred": "truth to the points of only this branch [radius^2]",
    "share": "true points nearest to this branch [%]",
}
_SORTED = {
    "distance": "by distance from the centre, near to far",
    "surface": "by surface nearby, most to least",
}
METRICS = {
    **{f"{b}_{key}": f"{b}: {t}" for key, t in _OF_BRANCH.items() for b in ("fc", "deconv")},
    "gt_to_pred": "truth to the points of both branches [radius^2]",
    **{
        f"by_{key}_{i}": f"share of fc, fifth {i} {title} [%]"
        for key, title in _SORTED.items()
        for i in range(1, 6)
    },
    **{f"by_{key}_change": f"... last - first, {title} [%]" for key, title in _SORTED.items()},
}


def order(points: np.ndarray, neighbours: np.ndarray) -> float:
    """Mean distance of the pairs `neighbours` [k, 2], divided by the mean over all pairs."""
    n = len(points)
    if n < 2 or not len(neighbours):
        return float("nan")
    near = np.linalg.norm(points[neighbours[:, 0]] - points[neighbours[:, 1]], axis=1).mean()
    apart = cdist(points, points).sum() / (n * (n - 1))
    return float(near / max(apart, 1e-12))


def neighbours_in_grid(grid: OutputGrid) -> np.ndarray:
    """Pairs [k, 2] of deconv points in horizontally or vertically adjacent cells."""
    numbers = np.arange(grid.height * grid.width * grid.points_per_cell).reshape(grid)
    right = np.stack([numbers[:, :-1], numbers[:, 1:]], axis=-1).reshape(-1, 2)
    below = np.stack([numbers[:-1], numbers[1:]], axis=-1).reshape(-1, 2)
    return np.concatenate([right, below])


def measure_sample(case: runner.Case, model: ModelConfig) -> dict[str, float]:
    """The metrics of a sample; `pred` begins with the fc points, `points` are uniform."""
    pred, gt = case["pred"], case["points"]
    network = build(model)
    branches = network.branches
    chain = np.arange(len(branches.fc))
    pairs = np.stack([chain[:-1], chain[1:]], axis=1), neighbours_in_grid(network.grid)
    clouds = pred[list(branches.fc)], pred[list(branches.deconv)]
    gaps = [cdist(gt, cloud, "sqeuclidean") for cloud in clouds]
    to_fc, to_deconv = nearest = [gap.min(axis=1) for gap in gaps]
    by_fc, centre = to_fc < to_deconv, gt.mean(axis=0)
    found = {"gt_to_pred": float(np.minimum(to_fc, to_deconv).mean())}
    for i, branch in enumerate(("fc", "deconv")):
        cloud, mine = clouds[i], by_fc if branch == "fc" else ~by_fc
        measures = (
            len(cloud), order(cloud, pairs[i]), _rms(cloud - cloud.mean(axis=0)),
            _rms(cloud - centre), gaps[i].min(axis=0).mean(), nearest[i].mean(), np.mean(mine),
        )  # fmt: skip
        found |= {f"{branch}_{key}": v for key, v in zip(_OF_BRANCH, measures, strict=True)}
    some = slice(None, None, max(1, len(gt) // _SAMPLED))
    around = (cdist(gt[some], gt[some]) < AROUND).sum(axis=1)
    fifths = {
        "distance": shares(by_fc, np.linalg.norm(gt - centre, axis=1)),
        "surface": shares(by_fc[some], -around),
    }
    for key, values in fifths.items():
        found |= {f"by_{key}_{i + 1}": value for i, value in enumerate(values)}
        found[f"by_{key}_change"] = values[-1] - values[0]
    return found


def shares(values: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Share of True in `values` [m] in each fifth, after sorting by `by` [m]."""
    ranked = values[np.argsort(by, kind="stable")].astype(np.float64)
    return np.array([part.mean() if len(part) else np.nan for part in np.array_split(ranked, 5)])


def _rms(offsets: np.ndarray) -> float:
    return float(np.sqrt((offsets**2).sum(axis=1).mean()))


def measure(run: runner.Run) -> runner.Measured:
    """Measures the branches of a run, shown as panels; `ConfigError` if the network lacks one."""
    model = run.config.model
    branches = build(model).branches
    if not (branches.fc and branches.deconv):
        raise ConfigError(
            f"{run.folder}: model.name={model.name!r} with {len(branches.fc)} fc and "
            f"{len(branches.deconv)} deconv points; expected a network with both branches"
        )
    measured = runner.evaluate(run, lambda case: measure_sample(case, model))
    return measured._replace(shown=[panels(case, model) for case in measured.shown.values()])


def panels(case: runner.Case, model: ModelConfig) -> dict[str, np.ndarray]:
    """Image; maps of x, y, z; points by branch and truth from two directions."""
    network, pred = build(model), case["pred"]
    branches = network.branches
    branch = np.repeat([0, 1], [len(branches.fc), len(branches.deconv)])
    painted = {
        "fc orange, deconv blue": (pred, spheres.colours_by_branch(branch)),
        "truth": (spheres.thinned(case["points"], pred), np.array([150, 150, 150])),
    }
    image, *others = spheres.panels(case, painted).items()
    # The first point of each cell.
    maps = pred[list(branches.deconv)].reshape(*network.grid, 3)[:, :, 0]
    titles = ("x (to the camera)", "y (to the right)", "z (up)")
    return dict([image, *zip(titles, np.moveaxis(maps, -1, 0), strict=True), *others])


def figure(results: runner.Results) -> figures.Figure:
    """Samples of each run, a row each; one colour scale for all maps, in steps of .25."""
    rows: list[dict[str, np.ndarray]] = []
    labels: list[str] = []
    for name, runs in results.items():
        shown = runs[0].shown[: None if len(results) == 1 else 3]
        rows += shown
        labels += [name] * len(shown)
    values = np.concatenate([p.ravel() for row in rows for p in row.values() if p.ndim == 2])
    low, high = np.floor(4 * np.nanmin(values)) / 4, np.ceil(4 * np.nanmax(values)) / 4
    scale = (float(low), float(max(high, low + 0.25)))
    return figures.grid(rows, labels=labels, scale=scale, scale_title="coordinate [radius]")


STUDY = runner.Study(
    "branches",
    architectures.BASE,
    lambda *_: architectures.configs(["two_branch"]),
    METRICS,
    figure,
    measure,
    note=f"Fifths: of the true points of each sample. Surface nearby: within {AROUND:g} radius.",
)

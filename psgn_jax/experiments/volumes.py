"""The measures of the study `comparison`, whose docstring describes them.

They are IoU, CD, EMD and the recall of thin parts of predicted volumes.
"""

import pathlib
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from psgn_jax.config import ConfigError
from psgn_jax.data.sources import shapenet
from psgn_jax.experiments import common
from psgn_jax.losses.distances import map_pairs
from psgn_jax.losses.farthest_points import farthest_points
from psgn_jax.metrics import clouds as metrics_lib
from psgn_jax.metrics.evaluation import Evaluation
from psgn_jax.models.voxel_refiner import GRID_EDGE, GRID_ORIGIN

POINTS = ("cd", "emd")
HEADS: Mapping[str, tuple[str, ...]] = {
    "head_cd": ("cd",),
    "head_cd_volume": ("cd", "volume"),
    "head_cd_emd": ("cd", "emd"),
    "head_cd_emd_volume": ("cd", "emd", "volume"),
}
"""Folder of a voxel head -> the runs that it reads."""

OURS = "head_cd_emd_volume"
"""The head that is compared with 3D-R2N2. In the paper it is the best one."""

PEER = "r2n2"
VIEWS = (1, 3, 5)

GAINS: Mapping[str, tuple[str, str]] = {
    "gain_over_splat": ("head_cd", "splat_cd"),
    "gain_emd": ("head_cd_emd", "head_cd"),
    "gain_volume_one_cloud": ("head_cd_volume", "head_cd"),
    "gain_volume": ("head_cd_emd_volume", "head_cd_emd"),
}
"""Name of a difference of IoU -> the minuend and the subtrahend."""

NUM_POINTS = 1024
CANDIDATES = 4096
"""Number of points on the surface of a volume from which the farthest points are sampled."""

_CASES = ("chair", "table", "bench", "lamp", "plane", "firearm")


def surface_of(volume: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """`CANDIDATES` points on the surface of the occupied cells, float32 [n, 3]."""
    solid = shapenet.Solid(volume, np.array(GRID_ORIGIN), GRID_EDGE / len(volume))
    return shapenet.surface_points(solid, CANDIDATES, rng).astype(np.float32)


def solid_at(probability: np.ndarray, threshold: float) -> np.ndarray:
    """Cells at or above a threshold; if there are none, the most probable cells."""
    volume = probability >= threshold
    return volume if volume.any() else probability >= probability.max()


def thin_cells(volume: np.ndarray) -> np.ndarray:
    """Occupied cells that are in no 2x2x2 block of occupied cells, bool like `volume`."""
    padded, n = np.pad(volume, 1), len(volume) + 1
    ends = [(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    corners = [np.s_[i : i + n, j : j + n, k : k + n] for i, j, k in ends]
    blocks = np.logical_and.reduce([padded[corner] for corner in corners])
    covered = np.zeros_like(padded)
    for corner in corners:
        covered[corner] |= blocks
    return volume & ~covered[1:-1, 1:-1, 1:-1]


@jax.jit
def _sampled(candidates: Any) -> Any:
    return jax.lax.map(lambda c: farthest_points(c, NUM_POINTS), candidates, batch_size=2)


@jax.jit
def _distances(pred: Any, gt: Any) -> dict[str, Any]:
    return map_pairs(lambda a, b: metrics_lib.evaluate_pair(a, b, emd_tolerance=0.01))(pred, gt)


def clouds_of(volumes: Sequence[np.ndarray]) -> np.ndarray:
    """Clouds [s, 1024, 3] of volumes, by farthest point sampling of their surfaces."""
    candidates = [surface_of(v, np.random.default_rng([0, i])) for i, v in enumerate(volumes)]
    return np.asarray(common.in_parts(_sampled, np.stack(candidates)))


class Run(NamedTuple):
    """A run on a split: metrics of every sample, and predictions [s, ...]."""

    evaluation: Evaluation
    predictions: np.ndarray


def measure_run(folder: pathlib.Path, split: str, samples: dict[str, list[Any]]) -> Run:
    """Measures the last checkpoint of a run; appends arrays to the lists in `samples` by name."""
    predictions: list[np.ndarray] = []

    def on_sample(_: int, case: common.Sample) -> None:
        predictions.append(case["pred"])
        for key, arrays in samples.items():
            arrays.append(case[key])

    measured = common.measure(folder, split=split, keys=tuple(samples), on_sample=on_sample)
    return Run(measured.evaluation, np.stack(predictions))


def compare(folder: pathlib.Path, split: str) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Measures the predictions; returns the numbers and the samples of the figure."""
    samples: dict[str, list[Any]] = {key: [] for key in (*common.CASE, "occupancy")}
    runs = {name: measure_run(folder / name, split, {}) for name in (*HEADS, PEER, *POINTS)
            if name != OURS}  # fmt: skip
    runs[OURS] = measure_run(folder / OURS, split, samples)
    names = runs[OURS].evaluation.names
    for run in runs.values():
        if run.evaluation.names != names:
            raise ConfigError(
                f"{folder}: the runs were measured on different samples of {split!r}; expected the "
                "same samples"
            )
    thresholds = {
        OURS: runs[OURS].evaluation.chosen["threshold_of_iou"],
        PEER: runs[PEER].evaluation.chosen["threshold_of_iou_1_views"],
    }
    volumes = {
        name: [solid_at(p, at) for p in runs[name].predictions] for name, at in thresholds.items()
    }
    values = {**ious(runs), **distances(runs, volumes[PEER], samples)}
    thin = [thin_cells(volume) for volume in samples["occupancy"]]
    for name, solids in volumes.items():
        recall = [v[t].mean() if t.any() else np.nan for v, t in zip(solids, thin, strict=True)]
        values[f"thin_recall:{name}"] = np.array(recall)
    categories = np.array([name.category or "(none)" for name in names])
    rows = {
        category: {key: _mean(key, v[categories == category]) for key, v in values.items()}
        for category in sorted(set(categories.tolist()))
    }
    models = [name.model_id for name in names]
    document = {
        "split": split,
        "samples": len(names),
        "samples_of": {category: int((categories == category).sum()) for category in rows},
        "categories": rows,
        "mean": {key: _mean(key, np.array([row[key] for row in rows.values()])) for key in values},
        "thresholds": thresholds,
        **{
            key: _gain(values[f"iou:{a}"], values[f"iou:{b}"], models)
            for key, (a, b) in GAINS.items()
        },
    }
    cases = []
    for category in [c for c in dict.fromkeys((*_CASES, *rows)) if c in rows][: len(_CASES)]:
        i = max(np.flatnonzero(categories == category).tolist(), key=lambda i: thin[i].sum())
        shown = {"cloud": runs["cd"].predictions[i], "truth": samples["occupancy"][i]}
        shown |= {name: solids[i] for name, solids in volumes.items()}
        view = {key: samples[key][i] for key in ("image", "intrinsics", "extrinsics")}
        cases.append({**view, **shown, "category": category})
    return document, cases


def ious(runs: Mapping[str, Run]) -> dict[str, np.ndarray]:
    """IoU per sample of the heads, of both splatted clouds and of 3D-R2N2."""
    ious = {f"iou:{name}": runs[name].evaluation.metrics["iou"] for name in HEADS}
    for name in POINTS:
        ious[f"iou:splat_{name}"] = runs[OURS].evaluation.metrics[f"iou_splat_{name}"]
    for count in VIEWS:
        ious[f"iou:{PEER}_{count}"] = runs[PEER].evaluation.metrics[f"iou_{count}_views"]
    return ious


def distances(
    runs: Mapping[str, Run], volumes: Sequence[np.ndarray], samples: Mapping[str, list[Any]]
) -> dict[str, np.ndarray]:
    """CD and EMD of the point networks and of the `volumes` of 3D-R2N2, to both truths."""
    surfaces = []
    for i, points in enumerate(samples["points"]):
        # A random subset, because the points of a record are ordered by position.
        order = np.random.default_rng([1, i]).permutation(len(points))
        surfaces.append(points[order[:NUM_POINTS]])
    clouds = {name: runs[name].predictions[:, :NUM_POINTS] for name in POINTS}
    clouds[PEER] = clouds_of(volumes)
    values = {}
    for label, gt in (("", clouds_of(samples["occupancy"])), ("_surface", np.stack(surfaces))):
        for name, cloud in clouds.items():
            measured = common.in_parts(_distances, cloud, gt)
            for metric in ("cd_sq_radius2", "emd_radius"):
                values[f"{metric}{label}:{name}"] = measured[metric]
    return values


def _mean(key: str, values: np.ndarray) -> float:
    """The mean; that of the recall of thin parts is over the objects that have thin parts."""
    if key.startswith("thin_recall"):
        values = values[~np.isnan(values)]
    return float(values.mean()) if len(values) else float("nan")


def _gain(a: np.ndarray, b: np.ndarray, models: Sequence[str]) -> dict[str, float]:
    """Mean of a - b over models and its standard error; views of a model are averaged first."""
    _, model = np.unique(models, return_inverse=True)
    change = np.bincount(model, a - b) / np.bincount(model)
    mean, error = common.mean_and_error(change)
    return {"mean": mean, "error": error}

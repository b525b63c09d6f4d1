"""Comparison with 3D-R2N2: `python -m psgn_jax.experiments.comparison --workdir DIR`.

The study trains on the same records and images:

- The point networks `cd` and `emd`, the `volume` network, and the voxel head (the voxel
  post-processing of the paper) in four versions: on the CD-trained cloud; on this cloud and the
  predicted volume; on both clouds; on both clouds and the volume.
- 3D-R2N2 (`r2n2`) on one to five views. It is trained for as many seconds as the last of these
  heads together with the networks that it reads. The trainer measures these seconds, without
  compilation and evaluation. A few timed steps of 3D-R2N2 give the number of steps that fit. The
  number is computed once and stored in `budget.json`.

It then measures for each category, on the test split (on the evaluation split if there is none):

- IoU of 32^3 solid volumes, for the head and for 3D-R2N2 with 1, 3 and 5 views. Thresholds are
  chosen on the evaluation split.
- CD and EMD of 1,024 points by the protocol of the paper: the predicted volumes of 3D-R2N2 and the
  true volumes are turned into clouds by farthest point sampling. Both systems are compared with the
  cloud of the true volume. The candidates are 4,096 points on the surface of the occupied cells
  (**ours**: the paper does not say where in a volume they are, and our networks predict surfaces).
  A second table compares with the surface points of the records (**ours**).
- Recall of thin parts (**ours**): the fraction of thin true cells that are occupied in the
  prediction. A thin cell is an occupied cell that is in no 2x2x2 block of occupied cells.

CD is the sum of the mean squared distances in both directions. Units: 1/10 of the edge of the grid,
as in the paper (the edge is 2 radii here), and the radius of the bounding hemisphere.

The trainings are ordinary runs in folders of `DIR`: if the command is stopped, starting it again
resumes them. Files: `comparison.txt` and `.json`; `comparison.png` (bars); `cases.png` (pictures of
the test sample with the most thin cells in each category, not selected by result).

Source: Fan, Su, Guibas, CVPR 2017, section "Comparison to state-of-the-art", table and figures;
Choy et al., "3D-R2N2", ECCV 2016. By default the networks are smaller than theirs, and the data are
different.
"""

import json
import pathlib
import time
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from absl import flags, logging
from PIL import Image, ImageDraw, ImageFont

from psgn_jax import tasks
from psgn_jax.config import Config, ConfigError, check_paths, parse
from psgn_jax.data import loader
from psgn_jax.data.manifest import load_manifest
from psgn_jax.data.sources import shapenet
from psgn_jax.experiments import common
from psgn_jax.files import cache_folder, finite_or_none, write_atomic
from psgn_jax.losses.distances import map_pairs
from psgn_jax.losses.farthest_points import farthest_points
from psgn_jax.metrics import clouds as metrics_lib
from psgn_jax.metrics.evaluation import Evaluation
from psgn_jax.models.voxel_refiner import GRID_EDGE, GRID_ORIGIN
from psgn_jax.training import state as state_lib
from psgn_jax.training import step as step_lib
from psgn_jax.training.log import read_metrics
from psgn_jax.training.run_folder import load_config, open_run
from psgn_jax.viewing.clouds import render_cloud, turned

POINTS = ("cd", "emd")
HEADS: Mapping[str, tuple[str, ...]] = {
    "head_cd": ("cd",),
    "head_cd_volume": ("cd", "volume"),
    "head_cd_emd": ("cd", "emd"),
    "head_cd_emd_volume": ("cd", "emd", "volume"),
}
"""The runs that each voxel head reads, by the folder of the head."""

OURS = "head_cd_emd_volume"
"""The head that is compared with 3D-R2N2: the best one of the paper."""

PEER = "r2n2"
VIEWS = (1, 3, 5)
PAPER: Mapping[str, tuple[float, float, float, float]] = {
    "plane": (0.601, 0.513, 0.549, 0.561),
    "bench": (0.550, 0.421, 0.502, 0.527),
    "cabinet": (0.771, 0.716, 0.763, 0.772),
    "car": (0.831, 0.798, 0.829, 0.836),
    "chair": (0.544, 0.466, 0.533, 0.550),
    "monitor": (0.552, 0.468, 0.545, 0.565),
    "lamp": (0.462, 0.381, 0.415, 0.421),
    "speaker": (0.737, 0.662, 0.708, 0.717),
    "firearm": (0.604, 0.544, 0.593, 0.600),
    "couch": (0.708, 0.628, 0.690, 0.706),
    "table": (0.606, 0.513, 0.564, 0.580),
    "cellphone": (0.749, 0.661, 0.732, 0.754),
    "watercraft": (0.611, 0.513, 0.596, 0.610),
    "mean": (0.640, 0.560, 0.617, 0.631),
}
"""IoU in the table of the paper: theirs, and 3D-R2N2 with 1, 3, 5 views, on ShapeNet renderings."""

_TRUTHS = {"": "CD, EMD to the true volume", "_surface": "CD, EMD to the true surface"}
"""The ground truth of a metric, by the suffix in the metric's name."""

NUM_POINTS = 1024
CANDIDATES = 4096
"""Number of points on the surface of a volume from which farthest point sampling selects."""

_CASES = ("chair", "table", "bench", "lamp", "plane", "firearm")
_BLUE, _ORANGE, _GREY = (40, 95, 190), (225, 120, 30), np.array([110, 110, 110])


class Size(NamedTuple):
    """Settings that depend on `--full`.

    Attributes:
      models: models per category in the data set that is rendered if no data are given.
      image_size: (height, width).
      model: fields of `ModelConfig` for the point networks.
      num_points: true points per sample in a training step with the CD.
      batch: batch sizes: of the point and volume networks, and of the other networks.
      learning_rate: of all networks but the heads, which use five times as much.
      steps: steps of the runs cd, emd, volume and of each head.
      widths: width of the hidden layers of the heads.
      width_multiplier: multiplier of the widths of 3D-R2N2.
    """

    models: int
    image_size: tuple[int, int]
    model: Mapping[str, Any]
    num_points: int
    batch: tuple[int, int]
    learning_rate: float
    steps: tuple[int, int, int, int]
    widths: int
    width_multiplier: float


DEFAULT = Size(
    models=40,
    image_size=(96, 128),
    model={"widths": (8, 16, 32, 64, 128, 256), "deconv_level": 2, "fc_widths": (512, 512)},
    num_points=2048,
    batch=(16, 8),
    learning_rate=1e-3,
    steps=(800, 400, 400, 400),
    widths=8,
    width_multiplier=0.125,
)
FULL = Size(
    models=400,
    image_size=(192, 256),
    model={},
    num_points=4096,
    batch=(32, 32),
    learning_rate=3e-4,
    steps=(20_000, 20_000, 10_000, 10_000),
    widths=16,
    width_multiplier=1.0,
)


# --- Data and trainings -------------------------------------------------------------------------


def build_data(models: int) -> str:
    """Renders five views of `models` procedural models per category; resumes if incomplete."""
    from data_gen import default, settings

    if not default.can_build():
        raise ConfigError(
            "--data is not set and the data cannot be rendered: accepted: a folder of records, or"
            " pip install 'psgn-jax[render]'"
        )
    folder = cache_folder() / f"{default.NAME.rsplit('-', 1)[0]}-{models}-views-{max(VIEWS)}"
    options = settings.Settings(views=max(VIEWS), models_per_shard=64)
    try:
        return default.build(folder, models_per_category=models, options=options)
    except (RuntimeError, ValueError) as error:
        raise ConfigError(f"the study's data set: {error}") from error


def configuration(
    name: str, path: str, workdir: pathlib.Path, size: Size, *, scale: float = 1.0, steps: int = 0
) -> Config:
    """The configuration of one run.

    Args:
      name: name of its folder: one of `POINTS`, "volume", one of `HEADS`, or `PEER`.
      path: folder of records.
      workdir: folder of the study.
      size: `DEFAULT` or `FULL`.
      scale: factor on the numbers of steps.
      steps: number of steps; 0 = that of `size`.
    """
    kind = next((i for i, n in enumerate((*POINTS, "volume")) if n == name), 3)
    steps = steps or max(1, round(scale * size.steps[kind]))
    points = name in POINTS
    rate = size.learning_rate
    tree: dict[str, Any] = {
        "data": {
            "path": path, "image_size": size.image_size, "flip": True, "cache": True,
            "num_points": size.num_points if name == "cd" else NUM_POINTS,
        },
        "model": dict(size.model),
        "optim": {
            "learning_rate": rate, "schedule": "cosine", "final_fraction": 0.01, "clip_norm": 1.0,
            "warmup_steps": min(100, steps // 4),
        },
        "train": {
            "batch_size": size.batch[0 if points or name == "volume" else 1], "steps": steps,
            "log_every": min(20, steps), "eval_every": steps, "images_every": 0,
            "checkpoint_every": max(1, min(500, steps // 4)),
        },
        "eval": {"batch_size": 16, "emd_tolerance": 0.0, "visible_tolerance": 0.0},
    }  # fmt: skip
    if points:
        tree["loss"] = {"name": "emd_mean" if name == "emd" else "chamfer_sq_mean"}
        tree["loss"]["emd_tolerance"] = 0.02
    elif name == "volume":
        tree["task"] = "volume"
    elif name == PEER:
        tree["task"] = "views"
        tree["voxels"] = {
            "width_multiplier": size.width_multiplier, "max_views": max(VIEWS), "eval_views": VIEWS
        }  # fmt: skip
    else:
        tree["task"] = "refine"
        tree["voxels"] = {f"from_{source}": str(workdir / source) for source in HEADS[name]}
        tree["voxels"]["widths"] = (size.widths,) * 5
        # The heads have few parameters and, on a CPU, few steps.
        tree["optim"]["learning_rate"] = 5 * rate
    return parse(tree)


def seconds(workdir: pathlib.Path) -> float:
    """Seconds of all steps of a run, from its log, without compilation and evaluations.

    For 3D-R2N2 they include compilation for the second and later numbers of views.
    """
    batch = load_config(workdir).train.batch_size
    total, before = 0.0, 0
    for entry in read_metrics(workdir / "metrics.jsonl"):
        if entry["kind"] != "train":
            continue
        if "samples_per_second" in entry:
            total += (entry["step"] - before) * batch / entry["samples_per_second"]
        before = entry["step"]
    return total


def step_seconds(config: Config, workdir: pathlib.Path) -> float:
    """Mean seconds of a step of 3D-R2N2 over the numbers of views, assumed linear in the number."""
    task = tasks.create(config, workdir)
    mesh = step_lib.data_mesh()
    tx = state_lib.optimizer(config.optim, config.train.steps)
    step = task.train_step(tx, mesh)
    took = []
    height, width = config.data.image_size
    for count in (1, config.voxels.max_views):
        shape = (config.train.batch_size, count, height, width)
        batch = {
            "image": np.zeros((*shape, 3), np.uint8),
            "mask": np.ones(shape, np.bool_),
            "occupancy": np.zeros((shape[0], 32, 32, 32), np.bool_),
        }
        device_batch = step_lib.put_batch(batch, mesh, task.keys)
        current = jax.jit(lambda: task.create(tx))()
        times = []
        for _ in range(4):
            began = time.monotonic()
            current, _ = jax.block_until_ready(step(current, device_batch))
            times.append(time.monotonic() - began)
        took.append(min(times[1:]))
    return float(np.mean(took))


def budget(config: Config, workdir: pathlib.Path, names: Sequence[str], steps: int) -> int:
    """Steps of 3D-R2N2: `steps`, or if 0, as many as fit into the time of the other runs.

    The number is stored in `workdir/budget.json` and read from there the next time.
    """
    path = workdir / "budget.json"
    if path.exists():
        return int(json.loads(path.read_text())["steps"])
    allowed = sum(seconds(workdir / name) for name in names)
    document: dict[str, Any] = {"seconds": allowed, "of": list(names)}
    if not steps:
        document["step_seconds"] = step_seconds(config, workdir / PEER)
        steps = max(1, round(allowed / document["step_seconds"]))
    write_atomic(path, json.dumps({**document, "steps": steps}, indent=1) + "\n")
    return steps


# --- Measuring ----------------------------------------------------------------------------------


def surface_of(volume: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Samples `CANDIDATES` points on the surface of the occupied cells, float32 [n, 3]."""
    solid = shapenet.Solid(volume, np.array(GRID_ORIGIN), GRID_EDGE / len(volume))
    return shapenet.surface_points(solid, CANDIDATES, rng).astype(np.float32)


def solid_at(probability: np.ndarray, threshold: float) -> np.ndarray:
    """Cells at or above a threshold; if there are none, the cells with the highest probability."""
    volume = probability >= threshold
    return volume if volume.any() else probability >= probability.max()


def thin_cells(volume: np.ndarray) -> np.ndarray:
    """Occupied cells that are in no 2x2x2 block of occupied cells; bool, shape of `volume`."""
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


def in_parts(function: Any, *arrays: np.ndarray, size: int = 16) -> Any:
    """Applies `function` to `size` rows at a time; returns its results as NumPy arrays."""
    parts = []
    for start in range(0, len(arrays[0]), size):
        rows = np.minimum(np.arange(start, start + size), len(arrays[0]) - 1)
        keep = min(size, len(arrays[0]) - start)
        part = function(*(array[rows] for array in arrays))
        parts.append(jax.tree.map(lambda leaf, n=keep: np.asarray(leaf)[:n], part))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *parts)


def clouds_of(volumes: Sequence[np.ndarray]) -> np.ndarray:
    """Turns volumes into clouds [s, 1024, 3] by farthest point sampling of their surfaces."""
    candidates = [surface_of(v, np.random.default_rng([0, i])) for i, v in enumerate(volumes)]
    return np.asarray(in_parts(_sampled, np.stack(candidates)))


class Run(NamedTuple):
    """Results of a run on the split: metrics of all samples, and predictions [s, ...]."""

    evaluation: Evaluation
    predictions: np.ndarray


def measure(workdir: pathlib.Path, split: str, samples: dict[str, list[Any]] | None = None) -> Run:
    """Measures the last checkpoint of a run on a split; appends its samples to `samples`."""
    run = open_run(workdir, "last")
    kept: list[np.ndarray] = []
    keys = ("image", "points", "occupancy", "intrinsics", "extrinsics")

    def keep(_: int, batch: Any, predictions: np.ndarray) -> None:
        rows = np.flatnonzero(batch["valid"])
        kept.append(predictions[rows])
        if samples is not None:
            for key in keys:
                samples.setdefault(key, []).extend(batch[key][rows])

    logging.info("measuring %s, step %d, on %r", workdir, run.step, split)
    task = tasks.create(run.config, workdir)
    evaluation = task.evaluate(run.params, split=split, on_batch=keep, chosen=run.scores)
    return Run(evaluation, np.concatenate(kept))


def compare(workdir: pathlib.Path, split: str) -> tuple[dict[str, Any], Image.Image]:
    """Computes all measures, as stored in `comparison.json`, and draws the cases."""
    samples: dict[str, list[Any]] = {}
    heads = {
        name: measure(workdir / name, split, samples if name == OURS else None) for name in HEADS
    }
    peer = measure(workdir / PEER, split)
    points = {name: measure(workdir / name, split) for name in POINTS}
    names = heads[OURS].evaluation.names
    for run in (peer, *points.values()):
        if run.evaluation.names != names:
            raise ConfigError(f"the runs in {workdir} see different samples of {split!r}")

    ours_at = heads[OURS].evaluation.chosen["threshold_of_iou"]
    peer_at = peer.evaluation.chosen["threshold_of_iou_1_views"]
    truth = samples["occupancy"]
    ours_volumes = [solid_at(p, ours_at) for p in heads[OURS].predictions]
    peer_volumes = [solid_at(p, peer_at) for p in peer.predictions]
    truth_clouds, peer_clouds = clouds_of(truth), clouds_of(peer_volumes)
    # A random subset, because the points of a record are sorted by position.
    chosen = [np.random.default_rng([1, i]).permutation(len(c)) for i, c in
              enumerate(samples["points"])]  # fmt: skip
    surfaces = np.stack(
        [c[order[:NUM_POINTS]] for c, order in zip(samples["points"], chosen, strict=True)]
    )

    values: dict[str, np.ndarray] = {}
    for label, gt in (("", truth_clouds), ("_surface", surfaces)):
        for name, clouds in (
            *((n, points[n].predictions[:, :NUM_POINTS]) for n in POINTS),
            (PEER, peer_clouds),
        ):
            distances = in_parts(_distances, clouds, gt)
            values[f"cd_sq_radius2{label}:{name}"] = distances["cd_sq_radius2"]
            values[f"emd_radius{label}:{name}"] = distances["emd_radius"]
    for name, run in heads.items():
        values[f"iou:{name}"] = run.evaluation.metrics["iou"]
    for metric in ("iou_splat_cd", "iou_splat_emd"):
        values[f"iou:{metric.removeprefix('iou_')}"] = heads[OURS].evaluation.metrics[metric]
    for count in VIEWS:
        values[f"iou:{PEER}_{count}"] = peer.evaluation.metrics[f"iou_{count}_views"]
    thin = [thin_cells(volume) for volume in truth]
    for name, volumes in ((OURS, ours_volumes), (PEER, peer_volumes)):
        recall = [v[t].mean() if t.any() else np.nan for v, t in zip(volumes, thin, strict=True)]
        values[f"thin_recall:{name}"] = np.array(recall)

    categories = sorted({name.category or "(none)" for name in names})
    category_of = np.array([name.category or "(none)" for name in names])
    table = {
        category: {key: _mean(key, v[category_of == category]) for key, v in values.items()}
        for category in categories
    }
    mean = {key: _mean(key, np.array([row[key] for row in table.values()])) for key in values}
    models = [name.model_id for name in names]

    def gain(a: str, b: str) -> dict[str, float]:
        return _gain(values[f"iou:{a}"], values[f"iou:{b}"], models)

    document = {
        "split": split,
        "samples": {category: int((category_of == category).sum()) for category in categories},
        "categories": table,
        "mean": mean,
        "seconds": {name: seconds(workdir / name) for name in (*POINTS, "volume", *HEADS, PEER)},
        "thresholds": {OURS: ours_at, PEER: peer_at},
        "gain_volume": gain("head_cd_emd_volume", "head_cd_emd"),
        "gain_volume_one_cloud": gain("head_cd_volume", "head_cd"),
        "gain_emd": gain("head_cd_emd", "head_cd"),
        "gain_over_splat": gain("head_cd", "splat_cd"),
    }
    shown = list(dict.fromkeys(c for c in (*_CASES, *categories) if c in categories))
    rows = [
        max(np.flatnonzero(category_of == category).tolist(), key=lambda i: thin[i].sum())
        for category in shown[: len(_CASES)]
    ]
    cases = [
        {
            **{key: samples[key][i] for key in ("image", "intrinsics", "extrinsics")},
            "category": category_of[i],
            "panels": [points["cd"].predictions[i], ours_volumes[i], peer_volumes[i], truth[i]],
        }
        for i in rows
    ]
    return document, side_by_side(cases)


def _mean(key: str, values: np.ndarray) -> float:
    """Mean of the values; objects without thin parts do not count in their recall."""
    if key.startswith("thin_recall"):
        values = values[~np.isnan(values)]
    return float(values.mean()) if len(values) else float("nan")


def _gain(a: np.ndarray, b: np.ndarray, models: Sequence[str]) -> dict[str, float]:
    """Mean of a - b over models, and its standard error.

    The views of a model are averaged first, because they are not independent.
    """
    _, model = np.unique(models, return_inverse=True)
    change = np.bincount(model, a - b) / np.bincount(model)
    mean, error = common.mean_and_error(change)
    return {"mean": mean, "error": error}


# --- Tables and pictures ------------------------------------------------------------------------


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """The lines of `common.text_table`, with a rule above the last row."""
    lines = common.text_table(rows).splitlines()
    return [*lines[:-1], lines[1], lines[-1]]


def table(document: Mapping[str, Any]) -> str:
    """All results as text; the table of IoU has the layout of the paper's table."""
    rows = {**document["categories"], "mean": document["mean"]}
    counts = {**document["samples"], "mean": sum(document["samples"].values())}
    peers = [f"iou:{PEER}_{count}" for count in VIEWS]
    head = ["IoU", "samples", "ours, 1 view", *(f"3D-R2N2, {count}" for count in VIEWS)]
    iou = [[*head, "paper*: ours", *(f"3D-R2N2*, {count}" for count in VIEWS)]]
    for name, row in rows.items():
        paper = [f"{v:.3f}" for v in PAPER.get(name, ())] or ["-"] * 4
        own = [f"{row[key]:.3f}" for key in (f"iou:{OURS}", *peers)]
        iou.append([name, str(counts[name]), *own, *paper])
    wins = sum(row[f"iou:{OURS}"] > row[peers[0]] for row in document["categories"].values())

    unit2, unit = metrics_lib.sq_to_grid_units, metrics_lib.to_grid_units
    clouds = {}
    for label, title in _TRUTHS.items():
        head = [title, "CD ours [u^2]", "3D-R2N2 [u^2]", "CD ours [r^2]", "3D-R2N2 [r^2]"]
        clouds[label] = [[*head, "EMD ours [u]", "3D-R2N2 [u]", "EMD ours [r]", "3D-R2N2 [r]"]]
        for name, row in rows.items():
            cd = [row[f"cd_sq_radius2{label}:{n}"] for n in ("cd", PEER)]
            emd = [row[f"emd_radius{label}:{n}"] for n in ("emd", PEER)]
            cells = [*(f"{unit2(v):.3f}" for v in cd), *(f"{v:.5f}" for v in cd)]
            cells += [*(f"{unit(v):.3f}" for v in emd), *(f"{v:.5f}" for v in emd)]
            clouds[label].append([name, *cells])
    thin = [["recall of thin parts", "ours", "3D-R2N2, 1"]]
    for name, row in rows.items():
        thin.append([name, *(f"{row[f'thin_recall:{n}']:.3f}" for n in (OURS, PEER))])

    mean = document["mean"]
    heads = [["voxel head (mean over categories)", "IoU"]]
    heads += [["plain splat, CD-trained", f"{mean['iou:splat_cd']:.3f}"]]
    heads += [["plain splat, EMD-trained", f"{mean['iou:splat_emd']:.3f}"]]
    heads += [[" + ".join(sources), f"{mean[f'iou:{n}']:.3f}"] for n, sources in HEADS.items()]
    gains = {
        "head over the plain splat of the same (CD) cloud": "gain_over_splat",
        "second (EMD) cloud": "gain_emd",
        "volume channel, one cloud": "gain_volume_one_cloud",
        "volume channel, both clouds": "gain_volume",
    }
    took = document["seconds"]
    spent = sum(took[name] for name in (*POINTS, "volume", OURS))
    lines = [
        *_aligned(iou),
        f"Ours above 3D-R2N2 with one view in {wins} of {len(document['categories'])} categories.",
        "* printed in the paper: other data (renderings of ShapeNet), networks and trainings.",
        "",
        *_aligned(clouds[""]),
        "",
        *_aligned(clouds["_surface"]),
        "u = 1/10 of the grid's edge (the paper's unit; edge 2 r), r = radius of the bounding "
        "hemisphere.",
        "CD of the CD-trained network, EMD of the EMD-trained. True volume: 1,024 farthest points "
        "of its surface, the paper's truth; what is inside a solid is not on it.",
        "True surface: that of the model, as our networks were taught.",
        "",
        *_aligned(thin),
        "",
        *_aligned(heads),
        *(
            f"gain of the {what}: {document[key]['mean']:+.4f} +- {document[key]['error']:.4f}"
            for what, key in gains.items()
        ),
        "Gains: mean over models, and its standard error (of these models, not of trainings).",
        "",
        f"Split {document['split']!r}; mean over categories. Thresholds, chosen on the evaluation "
        f"split: {document['thresholds'][OURS]:g} (ours), "
        f"{document['thresholds'][PEER]:g} (3D-R2N2). Trained for {spent:.0f} s (ours: "
        + ", ".join(f"{name} {took[name]:.0f}" for name in (*POINTS, "volume", OURS))
        + f") and {took[PEER]:.0f} s (3D-R2N2, compiling for two to five views included). One "
        "training of each.",
    ]
    return "\n".join(lines) + "\n"


def bars(document: Mapping[str, Any]) -> Image.Image:
    """Draws CD, EMD and 1 - IoU per category, ours and 3D-R2N2 with one view; lower is better."""
    rows = {**document["categories"], "mean": document["mean"]}
    panels = [
        ("CD [(grid edge / 10)^2]", "cd_sq_radius2:cd", f"cd_sq_radius2:{PEER}", 25.0),
        ("EMD [grid edge / 10]", "emd_radius:emd", f"emd_radius:{PEER}", 5.0),
        ("1 - IoU", f"iou:{OURS}", f"iou:{PEER}_1", 0.0),
    ]
    step, height, left = 62, 170, 20
    sheet = Image.new("RGB", (left + step * len(rows), (height + 70) * len(panels)), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=12)
    for number, (title, ours, peer, factor) in enumerate(panels):
        base = (height + 70) * number + height + 40
        pairs = [
            [row[key] * factor if factor else 1 - row[key] for key in (ours, peer)]
            for row in rows.values()
        ]
        top = max(value for pair in pairs for value in pair if np.isfinite(value))
        pen.text((left, base - height - 34), f"{title}: ours", fill=_BLUE, font=font)
        pen.text((left + 260, base - height - 34), "3D-R2N2, 1 view", fill=_ORANGE, font=font)
        for column, (name, pair) in enumerate(zip(rows, pairs, strict=True)):
            x = left + step * column
            for i, (value, colour) in enumerate(zip(pair, (_BLUE, _ORANGE), strict=True)):
                length = height * value / max(top, 1e-9) if np.isfinite(value) else 0
                low = x + 24 * i
                pen.rectangle((low, base - length, low + 21, base), fill=colour)
                pen.text((low, base - length - 14), f"{value:.2f}", fill="black", font=font)
            pen.text((x, base + 4), name[:10], fill="black", font=font)
    return sheet


def side_by_side(cases: Sequence[Mapping[str, Any]]) -> Image.Image:
    """Draws a row for each case: image; our cloud; our, 3D-R2N2's and the true volume; from a side.

    Volumes are drawn as points at the centres of the occupied cells. After the view from the camera
    the row shows the view from the side.
    """
    titles = ["image", "our cloud", "our volume", "3D-R2N2, 1 view", "true volume"]
    strips = []
    for case in cases:
        scale = max(1, round(192 / case["image"].shape[0]))
        size = (case["image"].shape[0] * scale, case["image"].shape[1] * scale)
        inner = np.diag([scale, scale, 1.0]) @ case["intrinsics"]
        panels = [np.asarray(Image.fromarray(case["image"]).resize(size[::-1]))]
        cloud, *volumes = case["panels"]
        centres = [
            (np.argwhere(v) + 0.5) * (GRID_EDGE / len(v)) + np.array(GRID_ORIGIN) for v in volumes
        ]
        for view in (case["extrinsics"], turned(case["extrinsics"], 90)):
            panels.append(render_cloud(cloud, inner, view, size))
            panels += [render_cloud(c, inner, view, size, radius=3) for c in centres]
        strips.append(np.concatenate(panels, axis=1))
    sheet = common.with_titles(strips, [*titles, *(f"{t}, side" for t in titles[1:])])
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=15)
    for row, case in enumerate(cases):
        pen.text(
            (6, common.HEAD_HEIGHT + 4 + row * strips[0].shape[0]),
            str(case["category"]),
            "black",
            font=font,
        )
    return sheet


# --- The study ----------------------------------------------------------------------------------


def run(
    workdir: str | pathlib.Path,
    *,
    data: str | None = None,
    full: bool = False,
    scale: float = 1.0,
    peer_steps: int = 0,
) -> str:
    """Runs the study; returns the tables.

    Args:
      workdir: folder for the runs and the results.
      data: folder of records with volumes and five views per model; None: render a data set.
      full: use the settings `FULL` instead of `DEFAULT`.
      scale: factor on the numbers of steps, except 3D-R2N2's.
      peer_steps: steps of 3D-R2N2; 0 = as many as fit into the time of our networks.

    Raises:
      ConfigError: the data do not exist, or have too few views or no volumes; or the folder
        contains other runs.
      UserError: a signal stopped a training; the same call resumes it.
    """
    workdir, size = pathlib.Path(workdir), FULL if full else DEFAULT
    path = build_data(size.models) if data is None else data
    peer = configuration(PEER, path, workdir, size, steps=peer_steps or 1)
    check_paths(peer)
    # Check the data for the last training before the first one starts.
    try:
        loader.train_batches(peer.data, batch_size=1, seed=0, start_step=0).close()
        splits = set().union(*(load_manifest(f).splits() for f in peer.data.folders))
    except (ValueError, OSError) as error:
        raise ConfigError(f"--data={path!r}: {error}") from error
    split = "test" if "test" in splits else peer.data.eval_split
    if split == peer.data.eval_split:
        logging.warning("no test split: measuring on the split that thresholds are chosen on")
    names = (*POINTS, "volume", *HEADS)
    ours = {name: configuration(name, path, workdir, size, scale=scale) for name in names}
    common.train_each(ours, workdir)
    steps = budget(peer, workdir, (*POINTS, "volume", OURS), peer_steps)
    common.train_each({PEER: configuration(PEER, path, workdir, size, steps=steps)}, workdir)
    document, cases = compare(workdir, split)
    document |= {"data": path, "full": full, "steps_of_3d_r2n2": steps}
    text = table(document)
    write_atomic(workdir / "comparison.txt", text)
    finite = {
        **{k: finite_or_none(v) if k.startswith("gain") else v for k, v in document.items()},
        "categories": {k: finite_or_none(v) for k, v in document["categories"].items()},
        "mean": finite_or_none(document["mean"]),
    }
    write_atomic(workdir / "comparison.json", json.dumps(finite, indent=1) + "\n")
    bars(document).save(workdir / "comparison.png")
    cases.save(workdir / "cases.png")
    logging.info("results in %s", workdir)
    return text


def _study(values: Any) -> str:
    return run(
        values.workdir,
        data=values.data,
        full=values.full,
        scale=values.scale,
        peer_steps=values.peer_steps,
    )


if __name__ == "__main__":
    flags.DEFINE_string("workdir", None, "Folder of the runs and the results.", required=True)
    flags.DEFINE_string(
        "data", None, "Records with volumes and five views; default: procedural models, rendered."
    )
    flags.DEFINE_bool("full", False, "Full-size images and networks: for a GPU.")
    flags.DEFINE_float("scale", 1.0, "Factor on the numbers of steps.", lower_bound=1e-3)
    flags.DEFINE_integer("peer_steps", 0, "Steps of 3D-R2N2; 0 = equal time.", lower_bound=0)
    common.main(_study)

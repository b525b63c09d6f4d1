"""Comparison with 3D-R2N2: `python -m psgn_jax.experiments.comparison --workdir DIR`.

The study trains on the same records, with the same images:

- the point networks `cd` and `emd`, and `volume`, which predicts the size of the object (its
  log-volume, one number);
- the voxel head (the paper's post-processing network, which predicts an occupancy grid) with four
  sets of inputs: the cloud of `cd`; this cloud and the predicted size; both clouds; both clouds and
  the predicted size;
- 3D-R2N2 (`r2n2`) on one to five views, for the total training time of the last of these heads and
  of the three networks that it reads. The number of steps is calculated from a few timed steps and
  from the times in the logs of these trainings (without compilation and evaluations). It is stored
  in `budget.json`.

It then measures on the test split (the evaluation split if there is none), per category:

- IoU of 32^3 grids: of the heads, and of 3D-R2N2 with 1, 3 and 5 views. The head with all three
  inputs is compared with 3D-R2N2. Thresholds are chosen on the evaluation split;
- CD and EMD of 1,024 points by the paper's protocol: the grids that 3D-R2N2 predicts and the true
  grids are converted to clouds by farthest point sampling, here from 4,096 points on the surface of
  the occupied cells (**ours**: the paper does not state which points of a grid are sampled). The
  truth for both systems is the cloud of the true grid. CD and EMD are also measured with the
  surface points of the records as truth (**ours**);
- recall of thin parts (**ours**): thin cells are true cells that belong to no 2x2x2 block of
  occupied cells; the recall is the share of them that a predicted grid contains.

The measures are in `volumes`. CD is the sum of the mean squared distances in both directions. Units
are 1/10 of the edge of the grid, as in the paper (the edge is 2 here), and the radius of the
bounding hemisphere.

`comparison.png` shows bar charts. `cases.png` shows one test sample for each of up to six
categories: the sample with the most thin cells, not one chosen by result.

Source: Fan, Su, Guibas, CVPR 2017, section "Comparison to state-of-the-art", table and figures;
Choy et al., "3D-R2N2", ECCV 2016. By default the networks are smaller than theirs; the data differ.
"""

import json
import pathlib
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from absl import flags, logging

from psgn_jax import tasks
from psgn_jax.config import Config, ConfigError, check_paths, parse
from psgn_jax.data.manifest import load_manifest
from psgn_jax.experiments import common, figures
from psgn_jax.experiments.volumes import (
    GAINS,
    HEADS,
    NUM_POINTS,
    OURS,
    PEER,
    POINTS,
    VIEWS,
    compare,
)
from psgn_jax.files import cache_folder, write_atomic
from psgn_jax.metrics import clouds as metrics_lib
from psgn_jax.metrics.table import Lines
from psgn_jax.models.voxel_refiner import GRID_EDGE, GRID_ORIGIN
from psgn_jax.training import state as state_lib
from psgn_jax.training import step as step_lib
from psgn_jax.training.run_folder import load_config
from psgn_jax.viewing import spheres

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
"""IoU in the paper's table: the paper's network, and 3D-R2N2 with 1, 3 and 5 views, on ShapeNet."""

_TRUTHS = {"": "CD, EMD to the true volume", "_surface": "CD, EMD to the true surface"}
"""End of a metric's name -> title, which says with which truth the metric is measured."""


class Size(NamedTuple):
    """Settings that depend on `--full`.

    Attributes:
      models: models of each category in the data set that is rendered if no data are named.
      image_size: (height, width).
      model: fields of `ModelConfig` of the point networks.
      num_points: true points per sample and step when training with the CD.
      batch: two batch sizes: (point and volume networks, heads and 3D-R2N2).
      learning_rate: learning rate; that of the heads is five times as large.
      steps: steps of the runs cd, emd and volume, and of each head.
      widths: widths of the heads.
      width_multiplier: width multiplier of 3D-R2N2.
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
    """Renders five views of `models` procedural models per category, or completes the data set."""
    from data_gen import default, settings

    if not default.can_build():
        raise ConfigError(
            "without --data, views of procedural models are rendered, which needs Mitsuba: "
            "pip install -e '.[render]'"
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
    """The configuration of a run.

    Args:
      name: name of its folder: one of `POINTS`, "volume", one of `HEADS`, or `PEER`.
      path: folder of records.
      workdir: folder of the study.
      size: `DEFAULT` or `FULL`.
      scale: factor of the numbers of steps.
      steps: steps of 3D-R2N2.
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


def step_seconds(config: Config, workdir: pathlib.Path) -> float:
    """Mean duration of a step of 3D-R2N2 over the possible numbers of views, in seconds.

    The duration is linear in the number of views, so only the smallest and the largest are timed.
    """
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
    """Steps of 3D-R2N2: those stored in `budget.json`, or `steps`, or as many as the time allows.

    Without `steps`, 3D-R2N2 is trained for as long as the runs `names` took together.
    """
    path = workdir / "budget.json"
    if path.exists():
        return int(json.loads(path.read_text())["steps"])
    allowed = float(np.nansum([common.cost(workdir / name)[1] for name in names]))
    document: dict[str, Any] = {"seconds": allowed, "of": list(names)}
    if not steps:
        document["step_seconds"] = step_seconds(config, workdir / PEER)
        steps = max(1, round(allowed / document["step_seconds"]))
    write_atomic(path, json.dumps({**document, "steps": steps}, indent=1) + "\n")
    return steps


def configs(options: Any) -> Iterator[tuple[str, Config]]:
    """The configurations of all trainings; the last one depends on the duration of earlier ones.

    Raises:
      ConfigError: the data do not exist, or have no volumes or views.
    """
    size, folder = FULL if options.full else DEFAULT, options.workdir
    path = build_data(size.models) if options.data is None else options.data
    peer = configuration(PEER, path, folder, size, steps=options.peer_steps or 1)
    check_paths(peer)
    common.check_data(peer)  # the other trainings need fewer fields
    for name in (*POINTS, "volume", *HEADS):
        yield name, configuration(name, path, folder, size, scale=options.scale)
    steps = budget(peer, folder, (*POINTS, "volume", OURS), options.peer_steps)
    yield PEER, configuration(PEER, path, folder, size, steps=steps)


# --- Measures -----------------------------------------------------------------------------------


def measure(options: Any) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """Measures per category; returns the numbers and the samples of the figure."""
    config = load_config(options.workdir / PEER)
    splits = set().union(*(load_manifest(f).splits() for f in config.data.eval_folders))
    split = "test" if "test" in splits else config.data.eval_split
    if split == config.data.eval_split:
        logging.warning("no test split: measuring on the split on which thresholds were chosen")
    numbers, cases = compare(options.workdir, split)
    spent = {
        name: common.cost(options.workdir / name)[1] for name in (*POINTS, "volume", *HEADS, PEER)
    }
    others = {"data": config.data.path, "steps_of_3d_r2n2": config.train.steps, "seconds": spent}
    return {**numbers, **others}, cases


# --- Tables and figures -------------------------------------------------------------------------


def table(numbers: Mapping[str, Any]) -> list[Lines]:
    """Tables: IoU as in the paper, CD and EMD, thin parts, heads and their gains, times."""
    rows = {**numbers["categories"], "mean": numbers["mean"]}
    peers = [f"iou:{PEER}_{count}" for count in VIEWS]
    head = ["IoU", "samples", "ours, 1 view", *(f"3D-R2N2, {count}" for count in VIEWS)]
    iou = [[*head, "paper*: ours", *(f"3D-R2N2*, {count}" for count in VIEWS)]]
    unit2, unit = metrics_lib.sq_to_grid_units, metrics_lib.to_grid_units
    clouds = {}
    for label, title in _TRUTHS.items():
        head = [title, "CD ours [u^2]", "3D-R2N2 [u^2]", "CD ours [r^2]", "3D-R2N2 [r^2]"]
        clouds[label] = [[*head, "EMD ours [u]", "3D-R2N2 [u]", "EMD ours [r]", "3D-R2N2 [r]"]]
    thin = [["recall of thin parts", "ours", "3D-R2N2, 1"]]
    for name, row in rows.items():
        count = numbers["samples_of"].get(name, numbers["samples"])
        own = (f"{row[key]:.3f}" for key in (f"iou:{OURS}", *peers))
        paper = [f"{v:.3f}" for v in PAPER.get(name, ())] or ["-"] * 4
        iou.append([name, str(count), *own, *paper])
        for label, lines in clouds.items():
            cd = [row[f"cd_sq_radius2{label}:{n}"] for n in ("cd", PEER)]
            emd = [row[f"emd_radius{label}:{n}"] for n in ("emd", PEER)]
            cells = [*(f"{unit2(v):.3f}" for v in cd), *(f"{v:.5f}" for v in cd)]
            lines.append(
                [name, *cells, *(f"{unit(v):.3f}" for v in emd), *(f"{v:.5f}" for v in emd)]
            )
        thin.append([name, *(f"{row[f'thin_recall:{n}']:.3f}" for n in (OURS, PEER))])
    heads = [["mean over categories", "IoU"]]
    for key in ("splat_cd", "splat_emd", *HEADS):
        heads.append([key, f"{numbers['mean'][f'iou:{key}']:.3f}"])
    gains = [["difference of IoU, mean over models", ""]]
    for key, (a, b) in GAINS.items():
        entry = numbers[key]
        gains.append([f"{a} - {b}", f"{entry['mean']:+.4f} +- {entry['error']:.4f}"])
    times = [["run", "seconds of steps"]]
    times += [[name, f"{seconds:.0f}"] for name, seconds in numbers["seconds"].items()]
    return [iou, *clouds.values(), thin, heads, gains, times]


def bars(numbers: Mapping[str, Any]) -> figures.Figure:
    """Charts of CD, EMD and 1 - IoU per category, ours and 3D-R2N2 with one view."""
    rows = {**numbers["categories"], "mean": numbers["mean"]}
    charts = []
    for title, ours, peer, factor in (
        ("CD [(grid edge / 10)^2]", "cd_sq_radius2:cd", f"cd_sq_radius2:{PEER}", 25.0),
        ("EMD [grid edge / 10]", "emd_radius:emd", f"emd_radius:{PEER}", 5.0),
        ("1 - IoU", f"iou:{OURS}", f"iou:{PEER}_1", 0.0),
    ):
        series = {
            name: [row[key] * factor if factor else 1 - row[key] for row in rows.values()]
            for name, key in (("ours", ours), ("3D-R2N2, 1 view", peer))
        }
        charts.append(figures.Bars(title, list(rows), series))
    return figures.bars(charts, colours=figures.COLOURS[2:])


def panels(case: Mapping[str, Any]) -> dict[str, np.ndarray]:
    """Image, our cloud, our volume, that of 3D-R2N2, the true volume; then the last four, rotated.

    Volumes are shown as spheres at the centres of the occupied cells.
    """
    painted = {"our cloud": case["cloud"]}
    for title, key in (
        ("our volume", OURS), ("3D-R2N2, 1 view", PEER), ("true volume", "truth")
    ):  # fmt: skip
        cell = GRID_EDGE / len(case[key])
        painted[title] = (np.argwhere(case[key]) + 0.5) * cell + np.array(GRID_ORIGIN)
    colours = {title: (c, spheres.colours_by_height(c)) for title, c in painted.items()}
    radius = {title: cell / 2 for title in painted if title != "our cloud"}
    return figures.clouds(case, colours, (0, 90), radius=radius)


def figure(numbers: Mapping[str, Any], cases: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """The bar charts, and a row of panels for each case."""
    labels = [str(case["category"]) for case in cases]
    grid = figures.grid([panels(case) for case in cases], labels=labels)
    return {"comparison": bars(numbers), "cases": grid}


STUDY = common.Study(
    "comparison",
    configs,
    measure,
    table,
    figure,
    options={"data": None, "full": False, "scale": 1.0, "peer_steps": 0},
    note="""* printed in the paper: other data (renderings of ShapeNet), networks and trainings.
Means are over categories. r: radius of the bounding hemisphere. u: a tenth of the grid's edge, the
paper's unit; the edge is 2 r. CD is measured for the network trained with the CD, EMD for the one
trained with the EMD. True volume: the truth is 1,024 points on the surface of the solid volume,
chosen by farthest point sampling, as in the paper. True surface: the truth is sampled from the
surface of the model, as in the training of our networks. Differences of IoU have their standard
error over models; each network was trained once. The seconds of 3D-R2N2 include its compilation
for two to five views.""",
)

if __name__ == "__main__":
    flags.DEFINE_string(
        "data", None, "Records with volumes and five views; default: procedural models, rendered."
    )
    flags.DEFINE_float("scale", 1.0, "Factor for the numbers of steps.", lower_bound=1e-3)
    flags.DEFINE_integer("peer_steps", 0, "Steps of 3D-R2N2; 0 = equal time.", lower_bound=0)
    STUDY.main()

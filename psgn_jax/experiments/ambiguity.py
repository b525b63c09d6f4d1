"""Several plausible shapes for one image: `python -m psgn_jax.experiments.ambiguity --workdir DIR`.

Do the samples of a network cover the possible shapes of an ambiguous image? Do they agree on an
unambiguous image? The data are cabinets of different depths (`data_gen.catalogues.doubt`). The
depth cannot be seen straight from the front, but can be seen if the cabinet is rotated. Four
networks of the same architecture are trained on both kinds of images, for the same number of steps:
a deterministic one (without random input), Mo2 and Mo8 (the best of 2 and of 8 draws of the random
input r), and the conditional variational autoencoder. On the cabinets of a validation split, the
study measures

- the Chamfer distance of a prediction, and of the best of K draws, from the truth;
- the spread (standard deviation over draws) of the output points along the hidden direction (x, the
  depth) and along the visible directions (y, z), on ambiguous images;
- the spread on unambiguous images;
- the spread of the marginals (`metrics.samples.marginal_spread`), which does not change if points
  exchange places;
- the depths of the predicted cabinets, measured from their points (`measured_depth`). Their
  distribution is compared with that of the true cabinets with the same image: Wasserstein-1
  distance, coverage of the range, and spread. The spread is also compared with that of the
  minimiser of the Mo-n objective (`spread_of_the_minimiser`);
- minimum matching distance and coverage of the true shapes that share an image, and the total
  mutual difference of the draws (`psgn_jax.metrics.samples`).

`DIR/data` is the data set. `ambiguity.png` shows predictions for one image, rotated by 45, 90 and
180 degrees, as in the paper.

Source: Fan, Su, Guibas, CVPR 2017, sections "Generation of Multiple Plausible Shapes" and
"Predicting Multiple Plausible Shapes", which show images and no numbers. Data, measures and
`GOALS` are **ours**. Unit of lengths: the radius of the bounding hemisphere.
"""

import dataclasses
import pathlib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import optax
from absl import logging

from psgn_jax.config import Config, parse
from psgn_jax.data import loader
from psgn_jax.data.dataset import RecordReader
from psgn_jax.experiments import common, figures
from psgn_jax.experiments.hidden_depth import (
    DOUBT,
    NO_DOUBT,
    Truth,
    build_data,
    calibration,
    check_measure,
    groups,
    measured_depth,
    truths,
)
from psgn_jax.losses.chamfer import chamfer_sq_mean
from psgn_jax.metrics import samples as sample_metrics
from psgn_jax.metrics.table import Lines
from psgn_jax.models import point_out_net
from psgn_jax.prediction import sampling
from psgn_jax.training import step as step_lib
from psgn_jax.training.run_folder import open_run
from psgn_jax.types import Array
from psgn_jax.viewing import spheres

NETWORKS = ("deterministic", "Mo2", "Mo8", "cVAE")

GOALS = {
    "best of K / deterministic": 0.7,
    "hidden / visible spread": 3.0,
    "spread, unambiguous / ambiguous images": 1 / 3,
}
"""Goals for the three ratios of `judge`, in its order: upper bound, lower bound, upper bound."""


@dataclasses.dataclass(frozen=True)
class Size:
    """The size of the study.

    Attributes:
      seeds, draws: arguments of the catalogue, for (train, validation).
      image_size: size of the images and of the network's input.
      model: fields of `config.ModelConfig`.
      num_points: ground-truth points per sample and training step.
      steps, batch_size, learning_rate: hyperparameters of each training.
      random_size: dimension of the random input r.
      kl_weight: weight of the KL divergence; the loss is the squared Chamfer distance.
      num_draws: K, the number of draws that are compared.
      num_measured: number of draws per image whose depth is measured; at least K.
    """

    seeds: tuple[int, int] = (80, 8)
    draws: tuple[int, int] = (4, 8)
    image_size: tuple[int, int] = (64, 64)
    model: Mapping[str, Any] = dataclasses.field(
        default_factory=lambda: {
            "widths": (8, 16, 32, 64, 64),
            "deconv_level": 2,
            "fc_points": 256,
            "fc_widths": (256, 256),
            "posterior_widths": (8, 16, 32),
            "posterior_hidden": 64,
        }
    )
    num_points: int = 1024
    steps: int = 1500
    batch_size: int = 16
    learning_rate: float = 1.5e-3
    random_size: int = 8
    kl_weight: float = 2e-4
    num_draws: int = 8
    num_measured: int = 32


DEFAULT = Size()
FULL = Size(
    seeds=(2000, 32),
    image_size=(192, 256),
    model={},
    num_points=4096,
    steps=20_000,
    batch_size=32,
    learning_rate=3e-4,
    random_size=128,
)
"""The full network at full image size, for a GPU. Never run."""


# --- Data and trainings -----------------------------------------------------------------------


def config_of(network: str, data: pathlib.Path, size: Size) -> Config:
    """The configuration of one of `NETWORKS`."""
    model: dict[str, Any] = {**size.model}
    loss: dict[str, Any] = {"name": "chamfer_sq_mean"}
    if network != "deterministic":
        model["random_size"] = size.random_size
    if network.startswith("Mo"):
        loss["min_of_n"] = int(network[2:])
    if network == "cVAE":
        model["posterior"] = True
        loss |= {"kl_weight": size.kl_weight, "kl_warmup_steps": size.steps // 4}
    tree = {
        "data": {
            "path": str(data), "image_size": size.image_size, "num_points": size.num_points,
            "num_eval_points": 2048, "cache": True,
            "flip": False,  # because all turned cabinets are rotated in the same direction
        },
        "model": model,
        "loss": loss,
        "optim": {
            "learning_rate": size.learning_rate, "schedule": "cosine",
            "warmup_steps": size.steps // 20, "final_fraction": 0.01, "clip_norm": 1.0,
            "ema_decay": 0.998,
        },
        "train": {
            "batch_size": size.batch_size, "steps": size.steps, "log_every": min(50, size.steps),
            "eval_every": 0, "checkpoint_every": max(1, size.steps // 10), "images_every": 0,
        },
        "eval": {"batch_size": 32, "emd_tolerance": 0},
    }  # fmt: skip
    return parse(tree)


def configs(options: Any) -> Iterable[tuple[str, Config]]:
    """Renders the data and returns the configurations of all trainings."""
    data, size = options.workdir / "data", FULL if options.full else DEFAULT
    build_data(data, size.image_size, size.seeds, size.draws)
    return [(name, config_of(name, data, size)) for name in NETWORKS]


# --- Measures ---------------------------------------------------------------------------------


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def predictions(folder: pathlib.Path, num_draws: int) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Predictions [samples, draws, n, 3] on the validation split, and arrays of its samples.

    The last checkpoint of the run in `folder` is used. A deterministic network has one draw.
    """
    run = open_run(folder, "last")
    config, params = run.config, run.params
    model = point_out_net.build(config.model)
    predict = jax.jit(lambda params, batch: step_lib.predict(config, model, params, batch, None))
    keys = [key for key in step_lib.input_keys(config) if key != "points"]
    batches = loader.eval_batches(
        config.data, split="validation", batch_size=config.eval.batch_size, seed=config.seed
    )
    points: list[np.ndarray] = []
    samples: dict[str, list[np.ndarray]] = {key: [] for key in common.CASE}
    for batch in batches:
        if config.model.random_size:
            first = len(points)
            drawn = sampling.predict_samples(config, model, params, batch, num_draws, first=first)
            clouds = drawn.points
        else:
            clouds = predict(params, {key: batch[key] for key in keys})[:, None]
        rows = np.flatnonzero(batch["valid"])
        points.extend(np.asarray(clouds)[rows])
        for key, arrays in samples.items():
            arrays.extend(batch[key][rows])
    return np.stack(points), {key: np.stack(arrays) for key, arrays in samples.items()}


@jax.jit
def _from_truth(draws: Array, truth: Array) -> Array:
    def distances(pair: tuple[Array, Array]) -> Array:
        return sample_metrics.cross_distances(pair[0], pair[1][None], chamfer_sq_mean)[:, 0]

    return jax.lax.map(distances, (draws, truth))


@jax.jit
def _mutual(draws: Array) -> Array:
    return jax.lax.map(lambda d: sample_metrics.mutual_distances(d, chamfer_sq_mean), draws)


def measure_network(
    drawn: np.ndarray, truth: np.ndarray, known: Sequence[Truth], num_draws: int
) -> dict[str, Any]:
    """All measures of a network on the whole validation split.

    Args:
      drawn: predictions [samples, draws, n, 3].
      truth: true points [samples, m, 3].
      known: parameters of each sample.
      num_draws: K.

    Returns:
      Numbers by name; `front` and `turned` in a name denote ambiguous and unambiguous images.
    """
    points = drawn[:, :num_draws]
    random = points.shape[1] > 1
    distances = common.in_parts(_from_truth, points, truth)
    mutual = common.in_parts(_mutual, points) if random else None
    result: dict[str, Any] = {"K": points.shape[1]}
    for kind in (DOUBT, NO_DOUBT):
        rows = np.array([t.kind == kind for t in known])
        each = distances[rows]
        result[f"CD of one draw, {kind} [radius^2]"] = float(each.mean())
        result[f"CD of the best of K, {kind} [radius^2]"] = float(each.min(axis=1).mean())
        if mutual is None:
            continue
        by_axis = points[rows].std(axis=1)
        result[f"spread along x, {kind} [radius]"] = _rms(by_axis[..., 0])
        result[f"spread along y and z, {kind} [radius]"] = _rms(by_axis[..., 1:])
        result[f"spread, {kind} [radius]"] = float(np.sqrt(3) * _rms(by_axis))
        marginal = np.asarray(jax.vmap(sample_metrics.marginal_spread)(points[rows]))
        result[f"spread of the marginal along x, {kind} [radius]"] = _rms(marginal[:, 0])
        result[f"spread of the marginals along y and z, {kind} [radius]"] = _rms(marginal[:, 1:])
        difference = jax.vmap(sample_metrics.total_mutual_difference)(mutual[rows])
        result[f"total mutual difference, {kind} [radius^2]"] = float(np.mean(difference))
    if random:
        result |= _against_truths(points, truth, known)
        depths = [
            [measured_depth(cloud, t.scale) for cloud in clouds]
            for clouds, t in zip(drawn, known, strict=True)
        ]
        result |= calibration(np.asarray(depths), known)
    return result


def _against_truths(
    points: np.ndarray, truth: np.ndarray, known: Sequence[Truth]
) -> dict[str, float]:
    """For each group of samples with the same image: compares its draws with all true shapes."""
    distance = jax.jit(lambda a, b: sample_metrics.cross_distances(a, b, chamfer_sq_mean))
    matrices = [distance(points[rows[0]], truth[rows]) for rows in groups(known).values()]
    return {
        "minimum matching distance [radius^2]": float(
            np.mean([sample_metrics.minimum_matching_distance(d) for d in matrices])
        ),
        "coverage of the true shapes": float(
            np.mean([sample_metrics.coverage(d) for d in matrices])
        ),
    }


def spread_of_the_minimiser(num_draws: int) -> float:
    """Standard deviation of the samples that minimise Mo-n, divided by that of the truth.

    The truth x is a number, uniform on [-1, 1], and the distance is the squared error. The function
    computes the distribution q, represented by 32 equally likely numbers, that minimises the
    expectation of min_i (x - s_i)^2 over x and s_1 ... s_n ~ q. The result is a property of the
    objective, independent of any network: 0 for n = 1 (the mean), .56 for 2, .87 for 4, 1.00 for 8.
    """
    x = jnp.linspace(-1, 1, 201)
    rank = jnp.arange(33) / 32
    # The probability that the nearest of n draws is the i-th nearest of all 32 numbers.
    weights = -jnp.diff((1 - rank) ** num_draws)

    def value(numbers: Array) -> Array:
        squares = jnp.sort((x[:, None] - numbers[None, :]) ** 2, axis=1)
        return jnp.mean(squares @ weights)

    steps = 400
    adam = optax.adam(optax.cosine_decay_schedule(2e-2, steps))

    def step(_: Array, carry: tuple[Array, Any]) -> tuple[Array, Any]:
        numbers, state = carry
        updates, state = adam.update(jax.grad(value)(numbers), state)
        return optax.apply_updates(numbers, updates), state

    start = jnp.linspace(-0.5, 0.5, 32)
    numbers, _ = jax.lax.fori_loop(0, steps, step, (start, adam.init(start)))
    return float(jnp.std(numbers) * np.sqrt(3))


def judge(results: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """The three ratios of `GOALS` for each network with random input."""
    alone = results["deterministic"][f"CD of one draw, {DOUBT} [radius^2]"]
    return {
        name: {
            "best of K / deterministic": values[f"CD of the best of K, {DOUBT} [radius^2]"] / alone,
            "hidden / visible spread": values[f"spread along x, {DOUBT} [radius]"]
            / values[f"spread along y and z, {DOUBT} [radius]"],
            "spread, unambiguous / ambiguous images": values[f"spread, {NO_DOUBT} [radius]"]
            / values[f"spread, {DOUBT} [radius]"],
        }
        for name, values in results.items()
        if name != "deterministic"
    }


Shown = tuple[dict[str, np.ndarray], np.ndarray, dict[str, np.ndarray]]
"""Data of the figure: a sample, true shapes with the same image, draws by network."""


def measure(options: Any) -> tuple[dict[str, Any], Shown]:
    """Measures all networks; returns the numbers and the data of the figure."""
    data, size = options.workdir / "data", FULL if options.full else DEFAULT
    known = truths(data)
    # The samples that share the first ambiguous image, sorted by depth.
    columns = min(6, size.num_draws)
    sharing = sorted(min(groups(known).items())[1][: columns - 1], key=lambda i: known[i].depth)
    results: dict[str, dict[str, Any]] = {}
    clouds: dict[str, np.ndarray] = {}
    for name in NETWORKS:
        count = max(size.num_measured, size.num_draws)
        drawn, samples = predictions(options.workdir / name, count)
        results[name] = measure_network(drawn, samples["points"], known, size.num_draws)
        if name.startswith("Mo"):
            exact = results[name]["spread of exact draws [share]"]
            spread = exact * spread_of_the_minimiser(int(name[2:]))
            results[name]["spread of the objective's minimiser [share]"] = spread
        some, scale = drawn[sharing[0], :columns], known[sharing[0]].scale
        clouds[name] = some[np.argsort([measured_depth(cloud, scale) for cloud in some])]
        logging.info("%s: measured", name)
    document = {
        "size": dataclasses.asdict(size),
        "networks": results,
        "goals": GOALS,
        "reached": judge(results),
        "depth measured on the truth [share]": check_measure(data),
    }
    reader = RecordReader(data, "validation")
    sample = {key: arrays[sharing[0]] for key, arrays in samples.items()}
    return document, (sample, np.stack([reader[i].points for i in sharing]), clouds)


# --- Table and figure -------------------------------------------------------------------------


def table(numbers: Mapping[str, Any]) -> list[Lines]:
    """All measures, and the ratios with their goals; a column for each network."""
    results, reached = numbers["networks"], numbers["reached"]
    measures = [["measure", *results]]
    for name in dict.fromkeys(key for values in results.values() for key in values):
        cells = (f"{values[name]:.4g}" if name in values else "-" for values in results.values())
        measures.append([name, *cells])
    goals = [["ratio", "goal", *reached]]
    for name, goal in GOALS.items():
        sign = ">=" if "visible" in name else "<="
        cells = (f"{values[name]:.3f}" for values in reached.values())
        goals.append([name, f"{sign} {goal:.2f}", *cells])
    return [measures, goals]


def panels(shown: Shown, angle: float) -> dict[str, dict[str, np.ndarray]]:
    """Network -> panels: image and draws, seen from an angle.

    A network with a single draw is followed by true shapes instead of further draws.
    """
    sample, shapes, by_network = shown
    # Rotated shapes are wider than those in the image.
    zoom = np.array([[0.85, 1, 1], [1, 0.85, 1], [1, 1, 1]])
    case = {**sample, "intrinsics": sample["intrinsics"] * zoom}
    case["extrinsics"] = _from_above(sample["extrinsics"].astype(np.float64))
    rows = {}
    for name, draws in by_network.items():
        clouds = {f"draw {i + 1}": cloud for i, cloud in enumerate(draws)}
        if len(draws) == 1:
            step = max(1, shapes.shape[1] // draws.shape[1])
            clouds = {"prediction": draws[0]}
            clouds |= {f"true shape {i + 1}": c[::step] for i, c in enumerate(shapes)}
        painted = {title: (c, spheres.colours_by_height(c)) for title, c in clouds.items()}
        image, *views = figures.clouds(case, painted, (angle,)).values()
        rows[name] = dict(zip(("image", *painted), (image, *views), strict=True))
    return rows


def _from_above(extrinsics: np.ndarray) -> np.ndarray:
    """The camera, raised by 15 degrees, because shapes are easier to recognise from there."""
    tilt = np.deg2rad(15)
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    middle = np.array([0, 0, 0.4])
    place = extrinsics[:, :3] @ middle + extrinsics[:, 3]
    rotation = turn @ extrinsics[:, :3]
    return np.column_stack([rotation, place - rotation @ middle])


def figure(_: Any, shown: Shown) -> dict[str, Any]:
    """Predictions for one image, sorted by depth; three views for each network."""
    views = {angle: panels(shown, angle) for angle in (45, 90, 180)}
    keys = [(name, angle) for name in shown[2] for angle in views]
    rows = [views[angle][name] for name, angle in keys]
    labels = [f"{name}, {angle} degrees" for name, angle in keys]
    return {"ambiguity": figures.grid(rows, labels=labels)}


STUDY = common.Study(
    "ambiguity",
    configs,
    measure,
    table,
    figure,
    options={"full": False},
    note="front: ambiguous images; turned: unambiguous images. [share]: relative to the largest "
    "depth.",
)

if __name__ == "__main__":
    STUDY.main()

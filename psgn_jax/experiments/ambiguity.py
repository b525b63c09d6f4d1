"""Several plausible shapes for one image: `python -m psgn_jax.experiments.ambiguity --workdir DIR`.

This study tests whether a network that samples shapes predicts different shapes for ambiguous
images, and only for those. The data are rendered cabinets with a hidden depth
(`data_gen.catalogues.doubt`): in a view straight from the front the depth is ambiguous, in a
rotated view it is visible. Four networks are trained on both kinds of images with the same
architecture and number of steps: a deterministic one (without random input), Mo2 and Mo8 (the best
of 2 and of 8 samples of r), and the conditional variational autoencoder. On cabinets that are not
in the training data, the study measures:

- The Chamfer distance to the truth, of one prediction and of the best of K samples.
- How far output points move between samples along the hidden direction (x, the viewing
  direction) and along the visible directions (y, z), for ambiguous images.
- How far output points move between samples for unambiguous images.
- The same for the marginals of the samples (`metrics.samples.marginal_spread`), which do not change
  if points only exchange positions or slide along the surface.
- The depth of each sampled cloud, measured from its points (`measured_depth`), compared with the
  distribution of the depth among the cabinets with this image: Wasserstein-1 distance, coverage of
  the range, and standard deviation, which is also given for the minimiser of the objective
  (`spread_of_the_minimiser`).
- Minimum matching distance and coverage of the true shapes with the same image, and the total
  mutual difference of the samples (`psgn_jax.metrics.samples`).

`DIR` contains the data set, a run of `psgn_jax.training.loop` for each network, `ambiguity.json`
with all numbers and `ambiguity.png`, which shows predictions of one image from three directions
(half side, side, back), as in the paper. If the command is killed, starting it again resumes it.

Source: Fan, Su, Guibas, CVPR 2017, sections "Generation of Multiple Plausible Shapes" and
"Predicting Multiple Plausible Shapes", which give pictures but no numbers. Data, measures and the
goals in `GOALS` are **ours**. Lengths are in radii of the bounding hemisphere.
"""

import dataclasses
import json
import pathlib
import sys
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax
from absl import app, flags, logging
from PIL import Image, ImageDraw, ImageFont

from psgn_jax.command_line import exit_on_user_error, log_to_terminal, parse_flags
from psgn_jax.config import Config, ConfigError, parse
from psgn_jax.data import loader
from psgn_jax.data.camera import scale_intrinsics
from psgn_jax.data.dataset import RecordReader
from psgn_jax.files import write_atomic
from psgn_jax.losses.chamfer import chamfer_sq_mean
from psgn_jax.losses.distances import map_pairs
from psgn_jax.metrics import samples as sample_metrics
from psgn_jax.models import point_out_net
from psgn_jax.prediction import sampling
from psgn_jax.training import step as step_lib
from psgn_jax.training.loop import train
from psgn_jax.training.run_folder import open_run
from psgn_jax.types import Array
from psgn_jax.viewing import spheres
from psgn_jax.viewing.clouds import turned

NETWORKS = ("deterministic", "Mo2", "Mo8", "cVAE")
DOUBT, NO_DOUBT = "front", "turned"

GOALS = {
    "best of K over deterministic": 0.7,
    "hidden over visible spread": 3.0,
    "spread without doubt over with": 1 / 3,
}
"""The first and the third ratio should be at most, the second at least this value."""

# Geometry of `data_gen.catalogues.doubt` before normalisation, from the middle of the rail: the
# front of the body, and the length of the deepest body.
_BODY_BEGINS, _DEEPEST = 0.94, 1.94
_DEPTH_RANGE = (0.15, 1.0)


@dataclasses.dataclass(frozen=True)
class Size:
    """Size of the study.

    Attributes:
      seeds, draws: numbers of seeds and of draws of the catalogue, for (train, validation).
      image_size: image size of data and network.
      model: fields of `config.ModelConfig`.
      num_points: ground-truth points per sample in a training step.
      steps, batch_size, learning_rate: of each training.
      random_size: components of r and of z.
      kl_weight: weight of the KL divergence of the autoencoder, with the squared Chamfer distance.
      num_draws: K, the number of samples for best-of-K and for comparisons between samples.
      num_measured: number of samples per image whose depth is measured, at least K.
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
"""The full network at full image size, for a GPU. It has not been run."""


class Truth(NamedTuple):
    """Parameters of a validation sample: kind of view, seed, scale and hidden depth."""

    kind: str
    seed: int
    scale: float
    depth: float


# --- Data and trainings -----------------------------------------------------------------------


def build_data(folder: pathlib.Path, size: Size) -> None:
    """Renders the data set; resumes an incomplete one and keeps a complete one.

    Raises:
      ConfigError: rendering is not installed or not possible, or the folder contains other files.
    """
    # Imported here because only `data_gen` needs Mitsuba.
    from data_gen import cameras, job, settings
    from data_gen.catalogues import doubt

    options = settings.Settings(
        views=1,
        num_points=4096,
        models_per_shard=64,
        # Straight in front, at the height of the horizon, looking at the middle of the panel; the
        # catalogue explains why.
        camera=cameras.CameraSettings(
            image_size=size.image_size, azimuth=(0.0, 0.0), elevation=(0.0, 0.0), aim=(0.45, 0.45)
        ),
    )
    try:
        summary = job.render_catalogue(
            doubt.DoubtCatalogue(size.seeds, size.draws), folder, options
        )
    except (RuntimeError, ValueError) as error:
        raise ConfigError(f"the study's data set: {error}") from error
    logging.info("data: %s", summary.text().splitlines()[1])


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
    return parse(
        {
            "data": {
                "path": str(data),
                "image_size": size.image_size,
                "num_points": size.num_points,
                "num_eval_points": 2048,
                "flip": False,  # all rotated cabinets are rotated in the same direction
                "cache": True,
            },
            "model": model,
            "loss": loss,
            "optim": {
                "learning_rate": size.learning_rate,
                "schedule": "cosine",
                "warmup_steps": size.steps // 20,
                "final_fraction": 0.01,
                "clip_norm": 1.0,
                "ema_decay": 0.998,
            },
            "train": {
                "batch_size": size.batch_size,
                "steps": size.steps,
                "log_every": min(50, size.steps),
                "eval_every": 0,
                "checkpoint_every": max(1, size.steps // 10),
                "images_every": 0,
            },
            "eval": {"batch_size": 32, "emd_tolerance": 0},
        }
    )


def truths(data: pathlib.Path, split: str = "validation") -> list[Truth]:
    """Kind, seed, scale and hidden depth of every record of a split, in order."""
    reader = RecordReader(data, split)
    known = []
    for index in range(len(reader)):
        sample = reader[index]
        parameters = json.loads(sample.extra)["parameters"]
        known.append(
            Truth(
                sample.category,
                parameters["seed"],
                parameters["scale"],
                parameters["hidden"]["depth"],
            )
        )
    return known


# --- Measures ---------------------------------------------------------------------------------


def measured_depth(points: np.ndarray, scale: float) -> float:
    """Measures the hidden depth of a cabinet seen from the front from its points [n, 3].

    The back of the body is the 5 % quantile of x over the points above the rail. The rear panel has
    more than 5 % of these points, and there are fewer stray points than that.

    Args:
      points: points in the frame of a sample of the kind `front`.
      scale: scale of the cabinet, `Truth.scale`; it does not depend on the hidden depth.
    """
    above = points[points[:, 2] > 0.1, 0]
    if not len(above):
        return _DEPTH_RANGE[0]
    return float((_BODY_BEGINS - np.quantile(above, 0.05) / scale) / _DEEPEST)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def measure(config: Config, params: Any, size: Size, known: Sequence[Truth]) -> dict[str, Any]:
    """Computes all measures of one network on the whole validation split.

    Returns:
      Numbers by name; `front` in a name means ambiguous images, `turned` unambiguous ones.
    """
    model = point_out_net.build(config.model)
    batches = loader.eval_batches(
        config.data, split="validation", batch_size=config.eval.batch_size, seed=config.seed
    )
    random = bool(config.model.random_size)
    k = size.num_draws if random else 1
    num_drawn = max(size.num_measured, k) if random else 1
    cross = jax.jit(
        map_pairs(lambda p, g: sample_metrics.cross_distances(p, g[None], chamfer_sq_mean)[:, 0])
    )
    mutual_of = jax.jit(map_pairs(lambda p, _: sample_metrics.mutual_distances(p, chamfer_sq_mean)))
    predict = jax.jit(lambda params, batch: step_lib.predict(config, model, params, batch, None))
    keys = [key for key in step_lib.input_keys(config) if key != "points"]
    each, depths, clouds, mutual, gts = [], [], [], [], []
    seen = 0
    for batch in batches:
        if random:
            drawn = sampling.predict_samples(
                config, model, params, batch, num_drawn, first=seen
            ).points
        else:
            drawn = predict(params, {key: batch[key] for key in keys})[:, None]
        some = drawn[:, :k]
        kept = np.flatnonzero(batch["valid"])
        each.append(np.asarray(cross(some, batch["points"]))[kept])
        if k > 1:
            mutual.append(np.asarray(mutual_of(some, batch["points"]))[kept])
        clouds.append(np.asarray(some)[kept])
        gts.append(batch["points"][kept])
        for i in kept.tolist():
            scale = known[seen + i].scale
            depths.append([measured_depth(c, scale) for c in np.asarray(drawn[i])])
        seen += len(kept)
    distances, points = np.concatenate(each), np.concatenate(clouds)
    truth, drawn_depths = np.concatenate(gts), np.asarray(depths)
    result: dict[str, Any] = {"K": k}
    for kind in (DOUBT, NO_DOUBT):
        rows = np.array([t.kind == kind for t in known])
        result[f"CD of one draw, {kind} [radius^2]"] = float(distances[rows].mean())
        result[f"CD of the best of K, {kind} [radius^2]"] = float(
            distances[rows].min(axis=1).mean()
        )
        if not random:
            continue
        by_axis = points[rows].std(axis=1)
        result[f"spread along x, {kind} [radius]"] = _rms(by_axis[..., 0])
        result[f"spread along y and z, {kind} [radius]"] = _rms(by_axis[..., 1:])
        result[f"spread, {kind} [radius]"] = float(np.sqrt(3) * _rms(by_axis))
        marginal = np.asarray(jax.vmap(sample_metrics.marginal_spread)(points[rows]))
        result[f"spread of the marginal along x, {kind} [radius]"] = _rms(marginal[:, 0])
        result[f"spread of the marginals along y and z, {kind} [radius]"] = _rms(marginal[:, 1:])
        difference = jax.vmap(sample_metrics.total_mutual_difference)
        result[f"total mutual difference, {kind} [radius^2]"] = float(
            np.mean(difference(np.concatenate(mutual)[rows]))
        )
    if random:
        result |= _against_truths(points, truth, known)
        result |= _calibration(drawn_depths, known)
    return result


def _groups(known: Sequence[Truth]) -> dict[int, list[int]]:
    """Indices of the ambiguous records with the same image, by seed."""
    groups: dict[int, list[int]] = {}
    for i, t in enumerate(known):
        if t.kind == DOUBT:
            groups.setdefault(t.seed, []).append(i)
    return groups


def _against_truths(
    points: np.ndarray, truth: np.ndarray, known: Sequence[Truth]
) -> dict[str, float]:
    """Compares the samples for one image of each group with all true shapes of the group."""
    distance = jax.jit(lambda a, b: sample_metrics.cross_distances(a, b, chamfer_sq_mean))
    matrices = [distance(points[rows[0]], truth[rows]) for rows in _groups(known).values()]
    return {
        "minimum matching distance [radius^2]": float(
            np.mean([sample_metrics.minimum_matching_distance(d) for d in matrices])
        ),
        "coverage of the true shapes": float(
            np.mean([sample_metrics.coverage(d) for d in matrices])
        ),
    }


def _calibration(depths: np.ndarray, known: Sequence[Truth]) -> dict[str, float]:
    """Compares sampled depths [records, samples] with their true, uniform distribution."""
    low, high = _DEPTH_RANGE
    uniform = np.linspace(low, high, 1001)
    rows = [i for i, t in enumerate(known) if t.kind == DOUBT]
    apart = [sample_metrics.wasserstein_1(depths[i], uniform) for i in rows]
    # The same for as many exact samples.
    exact = np.random.default_rng(0).uniform(low, high, (200, depths.shape[1]))
    return {
        "Wasserstein-1 of the depth, one image [share]": float(np.mean(apart)),
        "Wasserstein-1 of exact draws [share]": float(
            np.mean([sample_metrics.wasserstein_1(d, uniform) for d in exact])
        ),
        "Wasserstein-1 of the depth, all images [share]": sample_metrics.wasserstein_1(
            depths[rows].reshape(-1), uniform
        ),
        "Wasserstein-1 of a single value, the mean [share]": (high - low) / 4,
        "coverage of the range of depths": float(
            np.mean([sample_metrics.range_coverage(depths[i], low, high) for i in rows])
        ),
        "mean drawn depth [share]": float(depths[rows].mean()),
        "spread of the drawn depth [share]": float(depths[rows].std(axis=1).mean()),
        "spread of exact draws [share]": (high - low) / float(np.sqrt(12)),
    }


def spread_of_the_minimiser(num_draws: int) -> float:
    """Standard deviation of the distribution that minimises MoN, relative to the true one.

    The truth x is a number, uniform on [-1, 1]. The distribution q, 32 equally likely numbers,
    minimises E over x, s_1 ... s_n ~ q of min_i (x - s_i)^2. The result is the optimum of the
    objective, independent of any network: 0 for n = 1 (the mean), .56 for 2, .87 for 4, 1.00 for 8.
    """
    x = jnp.linspace(-1, 1, 201)
    rank = jnp.arange(33) / 32
    # Probability that the nearest of n samples is the i-th nearest of the 32 numbers.
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
    """The three ratios of `GOALS` for each network that samples."""
    alone = results["deterministic"][f"CD of one draw, {DOUBT} [radius^2]"]
    judged = {}
    for name, result in results.items():
        if name == "deterministic":
            continue
        judged[name] = {
            "best of K over deterministic": result[f"CD of the best of K, {DOUBT} [radius^2]"]
            / alone,
            "hidden over visible spread": result[f"spread along x, {DOUBT} [radius]"]
            / result[f"spread along y and z, {DOUBT} [radius]"],
            "spread without doubt over with": result[f"spread, {NO_DOUBT} [radius]"]
            / result[f"spread, {DOUBT} [radius]"],
        }
    return judged


# --- Table and figure -------------------------------------------------------------------------


def table(results: Mapping[str, Mapping[str, Any]]) -> str:
    """All measures as text, with a column for each network, and the goals."""
    names = list(results)
    measures = list(dict.fromkeys(m for result in results.values() for m in result))
    width = max(map(len, measures)) + 2
    lines = ["".ljust(width) + "".join(f"{name:>15}" for name in names)]
    for name in measures:
        cells = [
            f"{result[name]:15.4g}" if name in result else "-".rjust(15)
            for result in results.values()
        ]
        lines.append(name.ljust(width) + "".join(cells))
    lines.append("")
    judged = judge(results)
    for name, goal in GOALS.items():
        sign = ">=" if "visible" in name else "<="
        cells = [f"{judged[n][name]:15.3f}" if n in judged else "-".rjust(15) for n in names]
        lines.append(f"{name} (goal {sign} {goal:.2f})".ljust(width) + "".join(cells))
    return "\n".join(lines) + "\n"


def figure(
    sample: Mapping[str, Any],
    truths: np.ndarray,
    clouds: Mapping[str, np.ndarray],
    height: int = 150,
) -> Image.Image:
    """Draws predictions of one image: three rows per network (half side, side, back).

    For a network with one prediction the true shapes are drawn to its right.

    Args:
      sample: image, intrinsics and extrinsics of one sample.
      truths: some true shapes with the same image, [t, m, 3].
      clouds: predictions [k, n, 3] of each network.
      height: height of a panel in pixels.
    """
    image = sample["image"]
    size = (height, round(height * image.shape[1] / image.shape[0]))
    intrinsics = scale_intrinsics(sample["intrinsics"], image.shape[:2], size)
    intrinsics[:2, :2] *= 0.85  # from the side the shapes are wider than in the image
    extrinsics = _from_above(sample["extrinsics"].astype(np.float64))
    blocks: dict[str, list[np.ndarray]] = {}
    for name, draws in clouds.items():
        thinned = truths[:, :: max(1, truths.shape[1] // draws.shape[1])]
        if len(draws) > 1:
            blocks[f"{name}: {len(draws)} draws, sorted by depth"] = list(draws)
        else:
            title = f"{name}: its prediction; then {len(truths)} true shapes of the same image"
            blocks[title] = [draws[0], *thinned]
    columns = 1 + max(map(len, blocks.values()))
    head = 24
    top, bottom = round(0.2 * height), round(0.86 * height)  # the rest of a panel is empty
    panel = bottom - top
    block = 3 * panel + head
    sheet = Image.new("RGB", (size[1] * columns, block * len(blocks)), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(size=15)
    picture = Image.fromarray(image).resize(size[::-1], Image.Resampling.BICUBIC)
    for number, (title, shown) in enumerate(blocks.items()):
        start = number * block + head
        pen.text((6, start - head + 3), title, fill="black", font=font)
        sheet.paste(picture, (0, start))
        pen.text((6, start + height + 8), "half side,\nside, back", fill="gray", font=font)
        for row, degrees in enumerate((45, 90, 180)):
            view = turned(extrinsics, degrees)
            for column, cloud in enumerate(shown, start=1):
                colours = spheres.colours_by_height(cloud)
                drawn = spheres.render(cloud, colours, intrinsics, view, size, radius=0.03)
                place = (column * size[1], start + row * panel)
                sheet.paste(Image.fromarray(drawn[top:bottom]), place)
    return sheet


def _from_above(extrinsics: np.ndarray) -> np.ndarray:
    """The camera raised by 15 degrees, because shapes are hard to recognise from the horizon."""
    tilt = np.deg2rad(15)
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    middle = np.array([0, 0, 0.4])
    place = extrinsics[:, :3] @ middle + extrinsics[:, 3]
    rotation = turn @ extrinsics[:, :3]
    return np.column_stack([rotation, place - rotation @ middle])


# --- The study --------------------------------------------------------------------------------


def run(workdir: str | pathlib.Path, size: Size = DEFAULT) -> str | int:
    """Runs or resumes the study; returns the table, or the number of the signal that stopped it.

    Raises:
      ConfigError: the errors of `build_data` and `training.loop.train`.
    """
    workdir = pathlib.Path(workdir)
    data = workdir / "data"
    build_data(data, size)
    configs = {name: config_of(name, data, size) for name in NETWORKS}
    for name, config in configs.items():
        logging.info("training %s", name)
        outcome = train(config, workdir / name)
        if outcome.stopped_by:
            return outcome.stopped_by
    known = truths(data)
    results, clouds = {}, {}
    # The first ambiguous image, and records with the same image and different depths.
    sharing = min(_groups(known).items())[1]
    sharing = sorted(sharing[: min(6, size.num_draws) - 1], key=lambda i: known[i].depth)
    shown = sharing[0]
    sample: dict[str, Any] = {}
    for name, config in configs.items():
        params = open_run(workdir / name, "last").params
        results[name] = measure(config, params, size, known)
        logging.info("%s: measured", name)
        if config.loss.min_of_n > 1:
            exact = results[name]["spread of exact draws [share]"]
            results[name]["spread of the objective's minimiser [share]"] = (
                exact * spread_of_the_minimiser(config.loss.min_of_n)
            )
        sample, drawn = _draws_of(config, params, shown, min(6, size.num_draws))
        depths = [measured_depth(cloud, known[shown].scale) for cloud in drawn]
        clouds[name] = drawn[np.argsort(depths)]
    document = {
        "size": dataclasses.asdict(size),
        "networks": results,
        "goals": GOALS,
        "reached": judge(results),
        "depth measured on the truth [share]": check_measure(data),
    }
    reader = RecordReader(data, "validation")
    shapes = np.stack([reader[i].points for i in sharing])
    figure(sample, shapes, clouds).save(workdir / "ambiguity.png")
    write_atomic(workdir / "ambiguity.json", json.dumps(document, indent=2) + "\n")
    return table(results)


def _draws_of(
    config: Config, params: Any, index: int, count: int
) -> tuple[dict[str, Any], np.ndarray]:
    """One validation sample and `count` predictions for it (one if the network has no r)."""
    batch_size = config.eval.batch_size
    batches = loader.eval_batches(
        config.data, split="validation", batch_size=batch_size, seed=config.seed
    )
    batch = next(b for number, b in enumerate(batches) if number == index // batch_size)
    row = index % batch_size
    keys = ("image", "mask", "points", "intrinsics", "extrinsics")
    one = {key: batch[key][row : row + 1] for key in keys}
    model = point_out_net.build(config.model)
    if config.model.random_size:
        draws = sampling.predict_samples(config, model, params, one, count, first=index).points[0]
    else:
        draws = step_lib.predict(config, model, params, one, None)
    return {key: value[0] for key, value in one.items()}, np.asarray(draws)


def check_measure(data: pathlib.Path) -> dict[str, float]:
    """The mean and the largest error of `measured_depth` on the true points."""
    reader, known = RecordReader(data, "validation"), truths(data)
    errors = [
        abs(measured_depth(reader[i].points, t.scale) - t.depth)
        for i, t in enumerate(known)
        if t.kind == DOUBT
    ]
    return {"mean error": float(np.mean(errors)), "largest error": float(np.max(errors))}


def _main(argv: Sequence[str]) -> None:
    log_to_terminal()
    values = flags.FLAGS
    with exit_on_user_error():
        if len(argv) > 1:
            raise ConfigError(f"unexpected argument {argv[1]!r}")
        text = run(values.workdir, FULL if values.full else DEFAULT)
    if isinstance(text, int):
        sys.exit(128 + text)
    sys.stdout.write(text)


if __name__ == "__main__":
    flags.DEFINE_string("workdir", None, "Folder of the study.", required=True)
    flags.DEFINE_bool("full", False, "The full network and image size; for a GPU.")
    app.run(_main, flags_parser=parse_flags)

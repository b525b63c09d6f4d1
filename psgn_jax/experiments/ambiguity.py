"""Several plausible shapes for one image: `python -m psgn_jax.experiments.ambiguity --workdir DIR`.

Where an image leaves the shape in doubt, does a sampler draw what it may be, and only there? The
data are cabinets of a hidden depth (`data_gen.catalogues.doubt`), rendered by the data stage: seen
straight from the front, the depth is in doubt; seen turned, it shows. On both together are trained,
with one budget and one network: a deterministic one (without random input), Mo2 and Mo8 (the best
of 2 and of 8 draws of r), and the conditional variational autoencoder. Then, on cabinets that no
training has seen, are measured

- the Chamfer distance of one prediction, and the best of K draws, from the truth;
- how far output points move between draws along the hidden direction (x, from the camera into the
  depth) and along the visible ones (y, z), on images in doubt;
- how far they move on images that leave no doubt;
- the same for the draws' marginals (`metrics.samples.marginal_spread`), to which points that only
  change places or slide along the surface do not add;
- the depth of each drawn cloud, measured back from its points (`measured_depth`), against the
  distribution that it has among cabinets of this image: Wasserstein-1, coverage of the range, and
  the spread, beside the one that the minimiser of the objective has (`spread_of_the_minimiser`);
- minimum matching distance and coverage of the true shapes that share an image, and the total
  mutual difference of the draws (`psgn_jax.metrics.samples`).

`DIR` gets the data set, a run of `psgn_jax.training.loop` for each network, `ambiguity.json` with
all numbers and `ambiguity.png`: predictions of one image from the half side, the side and the back,
as in the paper. Killed at any moment, the same command goes on where it was.

Source: Fan, Su, Guibas, CVPR 2017, sections "Generation of Multiple Plausible Shapes" and
"Predicting Multiple Plausible Shapes"; they show pictures and no numbers. Data, measures and the
goals in `GOALS` are **ours**. Unit of lengths: the radius of the bounding hemisphere.
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
"""At most, at least, at most."""

# Geometry of `data_gen.catalogues.doubt` before normalisation: where the body begins and the
# deepest one's length, from the rail's middle.
_BODY_BEGINS, _DEEPEST = 0.94, 1.94
_DEPTH_RANGE = (0.15, 1.0)


@dataclasses.dataclass(frozen=True)
class Size:
    """How large the study is.

    Attributes:
      seeds, draws: of the catalogue, for (train, validation).
      image_size: of images and network.
      model: fields of `config.ModelConfig`.
      num_points: ground-truth points a training step sees.
      steps, batch_size, learning_rate: of each training.
      random_size: of r and z.
      kl_weight: of the autoencoder; the loss is the squared Chamfer distance.
      num_draws: K of best-of-K, and of all that compares draws with each other.
      num_measured: draws of each image whose depth is measured, at least K.
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
"""The full network at full image size; for a GPU. Not measured."""


class Truth(NamedTuple):
    """What is known of a validation sample besides its points."""

    kind: str
    seed: int
    scale: float
    depth: float


# --- Data and trainings -----------------------------------------------------------------------


def build_data(folder: pathlib.Path, size: Size) -> None:
    """Renders the data set, or completes it; what is complete is left as it is.

    Raises:
      ConfigError: rendering is not installed or not possible, or the folder holds something else.
    """
    # The data stage needs Mitsuba, the rest of the package does not.
    from data_gen import cameras, job, settings
    from data_gen.catalogues import doubt

    options = settings.Settings(
        views=1,
        num_points=4096,
        models_per_shard=64,
        # On the horizon, straight in front, looking at the middle of the panel: see the catalogue.
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
                "flip": False,  # the turned cabinets are all turned the same way
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
    found = []
    for index in range(len(reader)):
        sample = reader[index]
        parameters = json.loads(sample.extra)["parameters"]
        found.append(
            Truth(
                sample.category,
                parameters["seed"],
                parameters["scale"],
                parameters["hidden"]["depth"],
            )
        )
    return found


# --- Measures ---------------------------------------------------------------------------------


def measured_depth(points: np.ndarray, scale: float) -> float:
    """The hidden depth of a cabinet seen from the front, read off its points [n, 3].

    The body's far end is taken where 5 % of the points above the rail lie farther back: its rear
    panel holds more of them, strays are fewer.

    Args:
      points: in the frame of a sample of the kind `front`.
      scale: of the cabinet, `Truth.scale`; it depends on nothing hidden.
    """
    above = points[points[:, 2] > 0.1, 0]
    if not len(above):
        return _DEPTH_RANGE[0]
    return float((_BODY_BEGINS - np.quantile(above, 0.05) / scale) / _DEEPEST)


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def measure(config: Config, params: Any, size: Size, known: Sequence[Truth]) -> dict[str, Any]:
    """All measures of one network, on the whole validation split.

    Returns:
      numbers by name; `front` and `turned` after a name stand for images in doubt and in none.
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
    truth, found_depths = np.concatenate(gts), np.asarray(depths)
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
        result |= _calibration(found_depths, known)
    return result


def _groups(known: Sequence[Truth]) -> dict[int, list[int]]:
    """Records in doubt that share an image: by seed."""
    groups: dict[int, list[int]] = {}
    for i, t in enumerate(known):
        if t.kind == DOUBT:
            groups.setdefault(t.seed, []).append(i)
    return groups


def _against_truths(
    points: np.ndarray, truth: np.ndarray, known: Sequence[Truth]
) -> dict[str, float]:
    """Draws of one image of each group against all true shapes of the group."""
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
    """Drawn depths [samples, draws] of images in doubt against their true distribution, uniform."""
    low, high = _DEPTH_RANGE
    uniform = np.linspace(low, high, 1001)
    rows = [i for i, t in enumerate(known) if t.kind == DOUBT]
    apart = [sample_metrics.wasserstein_1(depths[i], uniform) for i in rows]
    # What as many exact draws would have.
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
    """Standard deviation of the draws that minimise Mo-n, over that of the truth.

    For one number, uniform on [-1, 1], under the squared error: the q that minimises
    E over x, s_1 ... s_n ~ q of min (x - s_i)^2, as 32 equally likely numbers. It says what the
    objective asks for, before any network learns it: 0 for n = 1 (the mean), .56 for 2, .87 for 4,
    1.00 for 8.
    """
    x = jnp.linspace(-1, 1, 201)
    rank = jnp.arange(33) / 32
    # The probability that the nearest of n draws is the i-th nearest of all.
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
    """For each sampler the three ratios of `GOALS`."""
    alone = results["deterministic"][f"CD of one draw, {DOUBT} [radius^2]"]
    judged = {}
    for name, found in results.items():
        if name == "deterministic":
            continue
        judged[name] = {
            "best of K over deterministic": found[f"CD of the best of K, {DOUBT} [radius^2]"]
            / alone,
            "hidden over visible spread": found[f"spread along x, {DOUBT} [radius]"]
            / found[f"spread along y and z, {DOUBT} [radius]"],
            "spread without doubt over with": found[f"spread, {NO_DOUBT} [radius]"]
            / found[f"spread, {DOUBT} [radius]"],
        }
    return judged


# --- What is shown ----------------------------------------------------------------------------


def table(results: Mapping[str, Mapping[str, Any]]) -> str:
    """All measures as text, a column for each network, and the goals."""
    names = list(results)
    measures = list(dict.fromkeys(m for found in results.values() for m in found))
    width = max(map(len, measures)) + 2
    lines = ["".ljust(width) + "".join(f"{name:>15}" for name in names)]
    for name in measures:
        cells = [
            f"{found[name]:15.4g}" if name in found else "-".rjust(15) for found in results.values()
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
    """Predictions of one image: three rows for each network, half side, side and back.

    A network with one cloud has the true shapes to its right.

    Args:
      sample: image, intrinsics and extrinsics of one sample.
      truths: some shapes that share the image [t, m, 3].
      clouds: network -> draws [k, n, 3].
      height: of a panel in pixels.
    """
    image = sample["image"]
    size = (height, round(height * image.shape[1] / image.shape[0]))
    intrinsics = scale_intrinsics(sample["intrinsics"], image.shape[:2], size)
    intrinsics[:2, :2] *= 0.85  # from the side the shapes are wider than what the image shows
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
    top, bottom = round(0.2 * height), round(0.86 * height)  # above and below there is nothing
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
    """The camera 15 degrees higher, where a shape is easier to read than on the horizon."""
    tilt = np.deg2rad(15)
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    middle = np.array([0, 0, 0.4])
    place = extrinsics[:, :3] @ middle + extrinsics[:, 3]
    rotation = turn @ extrinsics[:, :3]
    return np.column_stack([rotation, place - rotation @ middle])


# --- The whole study --------------------------------------------------------------------------


def run(workdir: str | pathlib.Path, size: Size = DEFAULT) -> str | int:
    """The whole study, or what is left of it; returns the table, or the signal that stopped it.

    Raises:
      ConfigError: see `build_data` and `training.loop.train`.
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
    # The first image in doubt, and the depths that it may have.
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
    """One validation sample and `count` predictions of it, one if the network is deterministic."""
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
        found = sampling.predict_samples(config, model, params, one, count, first=index).points[0]
    else:
        found = step_lib.predict(config, model, params, one, None)
    return {key: value[0] for key, value in one.items()}, np.asarray(found)


def check_measure(data: pathlib.Path) -> dict[str, float]:
    """How well `measured_depth` does on the true points: mean and largest error."""
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

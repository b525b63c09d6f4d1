"""Several plausible shapes for one image: `psgn study ambiguity`.

The data are `data_gen.catalogues.cabinets`. Images from the front hide the depth of a cabinet,
images of a turned cabinet show it. On both we train a deterministic network, Mo2, Mo4 and Mo8 (with
the best of 2, 4 and 8 draws of the random input) and the conditional variational autoencoder. We
measure distances from the truth; the spread (standard deviation over draws) of the output points
along the hidden direction x and along y and z; the depths of the drawn cabinets against their true
distribution; and the metrics of `prediction.draws` for the true shapes that share an image.

Source: Fan, Su, Guibas, CVPR 2017, sections "Generation of Multiple Plausible Shapes" and
"Predicting Multiple Plausible Shapes", which show images and no numbers. Data, measures and goals
are **ours**. Unit of lengths: the radius of the bounding hemisphere.
"""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import jax
import numpy as np
from scipy.stats import wasserstein_distance

from psgn_jax.array_types import Array
from psgn_jax.config.data import DataConfig
from psgn_jax.config.experiment import Config
from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.schema import RecordError
from psgn_jax.evaluation.table import Lines
from psgn_jax.losses.chamfer import chamfer_sq_mean
from psgn_jax.models import networks
from psgn_jax.prediction.draws import (
    coverage,
    cross_distances,
    sample_latents,
    total_mutual_difference,
)
from psgn_jax.studies import figures, runner
from psgn_jax.system.untrusted import parse_json
from psgn_jax.viewing import spheres
from psgn_jax.weights.run_folder import open_run

NUM_DRAWS = 8  # compared draws per image
NUM_MEASURED = 32  # draws per image whose depth is measured

# Geometry of `data_gen.catalogues.cabinets` before normalisation: x of the front of the body, from
# the middle of the rail; length of the deepest body.
BODY_BEGINS, DEEPEST = 0.94, 1.94
DEPTH_RANGE = (0.15, 1.0)

BASE: runner.Overrides = {
    "data.image_size": (64, 64),
    "data.num_points": 1024,
    "data.num_eval_points": 2048,
    "data.cache_gb": 4.0,
    "data.flip": False,  # because all turned cabinets are rotated in the same direction
    "model.widths": (8, 16, 32, 64, 64),
    "model.fc_widths": (256, 256),
    "loss.name": "chamfer_sq_mean",
    "loss.emd_tolerance": 0.01,
    "optim.learning_rate": 1.5e-3,
    "optim.warmup_steps": 75,
    "optim.ema_decay": 0.998,
    "train.steps": 1500,
    "train.log_every": 50,
    "train.eval_every": 10**9,
    "train.checkpoint_every": 1000,
    "train.images_every": 10**9,
    "eval.emd_tolerance": 0,
}


def configs(base: Config, _: Callable[[str], str]) -> dict[str, runner.Overrides]:
    """The five networks; Mo2 and Mo4 train for the time of Mo8 on a CPU."""
    random: runner.Overrides = {"model.random_size": 8}
    steps = base.train.steps
    return {
        "deterministic": {},
        "Mo2": {**random, "loss.min_of_n": 2, "train.steps": round(1.62 * steps)},
        "Mo4": {**random, "loss.min_of_n": 4, "train.steps": round(1.37 * steps)},
        "Mo8": {**random, "loss.min_of_n": 8},
        "cVAE": {
            **random,
            "model.posterior": True,
            "model.posterior_widths": (8, 16, 32),
            "model.posterior_hidden": 64,
            "loss.kl_weight": 2e-4,
            "loss.kl_warmup_steps": steps // 4,
        },
    }


class Cabinet(NamedTuple):
    """Parameters of a sample."""

    seed: int  # of what is visible from the front
    scale: float
    depth: float  # hidden


def cabinets(data: DataConfig) -> list[Cabinet]:
    """The parameters of the evaluated records, in order."""
    reader = RecordReader(data.eval_folders, data.eval_split)
    known: list[Cabinet] = []
    for sample in map(reader.__getitem__, range(len(reader))):
        try:
            entry = parse_json(sample.extra)["parameters"]
            depth = float(entry["hidden"]["depth"])
            known.append(Cabinet(int(entry["seed"]), float(entry["scale"]), depth))
        except (ValueError, KeyError, TypeError) as error:
            raise RecordError(
                f"{', '.join(data.eval_folders)}: {sample.model_id!r} lacks the study's parameters "
                f"({error!r}); expected records of data_gen.catalogues.cabinets"
            ) from None
    return known


def measured_depth(points: np.ndarray, scale: float) -> float:
    """The hidden depth of a cabinet, from its points [n, 3] in the frame of a sample `front`.

    The far end of the body is the 5 % quantile of x over the points above the rail: the back face
    has more than 5 % of these points, and less than 5 % are outliers.
    """
    above = points[points[:, 2] > 0.1, 0]
    if not len(above):
        return DEPTH_RANGE[0]
    return float((BODY_BEGINS - np.quantile(above, 0.05) / scale) / DEEPEST)


_difference = jax.jit(total_mutual_difference)


@jax.jit
def _cross(draws: Array, truths: Array) -> Array:
    return cross_distances(draws, truths, chamfer_sq_mean)


def of_draws(draws: np.ndarray, truth: np.ndarray, scale: float) -> dict[str, float]:
    """Measures of draws [k, n, 3] for an image with true points [m, 3]."""
    some = draws[:NUM_DRAWS]
    distances = np.asarray(_cross(some, truth[None]))
    found = {
        "CD of one draw [radius^2]": float(distances.mean()),
        "CD of the best draw [radius^2]": float(distances.min()),
    }
    if len(draws) == 1:
        return found
    variance = some.var(axis=0).mean(axis=0)
    depths = np.array([measured_depth(cloud, scale) for cloud in draws])
    inside = np.clip(depths, *DEPTH_RANGE)
    return {
        **found,
        "total mutual difference [radius^2]": float(_difference(some)),
        "depth: Wasserstein-1 from its true distribution": wasserstein_distance(
            depths, np.linspace(*DEPTH_RANGE, 1001)
        ),
        "depth: coverage of the range": np.ptp(inside) / np.ptp(DEPTH_RANGE),
        "depth: mean": float(depths.mean()),
        "depth: standard deviation": float(depths.std()),
        "hidden": float(variance[0]),
        "visible": float(variance[1:].mean()),
    }


def by_kind(each: Mapping[str, np.ndarray], front: np.ndarray) -> dict[str, Any]:
    """The results of `of_draws` by kind of image, [samples], and the spreads over all samples."""
    result: dict[str, Any] = {}
    total = []
    for kind, of in (("front", front), ("turned", ~front)):
        for key, values in each.items():
            if key not in ("hidden", "visible") and not (kind == "turned" and "depth" in key):
                result[f"{kind}: {key}"] = np.where(of, values, np.nan)
        if "hidden" in each:
            hidden, visible = each["hidden"][of].mean(), each["visible"][of].mean()
            result[f"{kind}: spread along x [radius]"] = hidden**0.5
            result[f"{kind}: spread along y and z [radius]"] = visible**0.5
            total.append(hidden + 2 * visible)
            if kind == "front":
                ratio = (hidden / visible) ** 0.5
                result["front: spread along x / along y and z (goal: at least 3)"] = ratio
    if total:
        result["spread, turned / front (goal: at most 1/3)"] = (total[1] / total[0]) ** 0.5
    return result


def measure(run: runner.Run) -> runner.Measured:
    """Measures a network; shown: a sample, the true shapes with its image, and draws."""
    config, params = run.config, open_run(run.folder, "last").params
    model, known = networks.build(config.model), cabinets(config.data)
    cases: list[runner.Case] = []
    each: list[dict[str, float]] = []

    @jax.jit
    def sample(params: Any, batch: Any, number: Array) -> Array:
        r = sample_latents(config, number, 1, NUM_MEASURED, 0)
        return networks.predict(config, model, params, batch, r)[0]

    def draw(case: runner.Case) -> dict[str, float]:
        draws = case["pred"][None]
        if config.model.random_size:
            batch = {key: case[key][None] for key in ("image", "mask")}
            draws = np.asarray(sample(params, batch, np.int32(len(cases))))
        each.append(of_draws(draws, case["points"], known[len(cases)].scale))
        cases.append({**case, "draws": draws})
        return {}

    found = runner.evaluate(run, draw, keys=(*runner.CASE, "mask"))
    front = np.array([name.category == "front" for name in found.names])
    metrics = by_kind({key: np.array([of[key] for of in each]) for key in each[0]}, front)
    groups: dict[int, list[int]] = {}  # samples with the same image
    for i in np.flatnonzero(front).tolist():
        groups.setdefault(known[i].seed, []).append(i)
    if config.model.random_size:
        pairs = [
            _cross(cases[i[0]]["draws"][:NUM_DRAWS], np.stack([cases[j]["points"] for j in i]))
            for i in groups.values()
        ]
        metrics["coverage of the true shapes"] = np.mean([*map(coverage, pairs)])
    # The samples that share the first ambiguous image, and its draws, sorted by depth.
    sharing = sorted(min(groups.items())[1][:5], key=lambda i: known[i].depth)
    first, scale = cases[sharing[0]], known[sharing[0]].scale
    some = sorted(first["draws"][:6], key=lambda cloud: measured_depth(cloud, scale))
    shown = first, [cases[i]["points"] for i in sharing], np.stack(some)
    arrays = {key: np.atleast_1d(value) for key, value in metrics.items()}
    about = f"{found.about}, {NUM_DRAWS} draws, {NUM_MEASURED} for depths"
    # Cabinets that differ only in depth count as one model; in `front` they have one image.
    names = [n._replace(model_id=str(c.seed)) for n, c in zip(found.names, known, strict=True)]
    return found._replace(names=names, metrics=arrays, shown=shown, about=about)


def ratios(results: runner.Results) -> list[Lines]:
    """The best of K draws, divided by the prediction of the deterministic network."""
    key = "front: CD of the best draw [radius^2]"
    best = {
        name: float(np.mean([np.nanmean(run.metrics[key]) for run in runs]))
        for name, runs in results.items()
    }
    alone = best.pop("deterministic", np.nan)
    cells = [f"{value / alone:.3f}" for value in best.values()]
    return [[["", *best], ["best of K / deterministic (goal: at most .7)", *cells]]]


def figure(results: runner.Results) -> figures.Figure:
    """Draws for one image, sorted by depth, from two angles; after a single draw, true shapes."""
    # Rotated shapes are wider than in the image.
    zoom = np.array([[0.85, 1, 1], [1, 0.85, 1], [1, 1, 1]])
    rows, labels = [], []
    for name, runs in results.items():
        sample, shapes, draws = runs[0].shown
        clouds = {f"draw {i + 1}": cloud for i, cloud in enumerate(draws)}
        if len(draws) == 1:
            clouds = {"prediction": draws[0]}
            for i, cloud in enumerate(shapes, 1):
                clouds[f"true shape {i}"] = spheres.thinned(cloud, draws[0])
        case = {**sample, "intrinsics": sample["intrinsics"] * zoom}
        for angle in (45, 90):
            panels = spheres.panels(case, spheres.by_height(clouds), (angle,)).values()
            rows.append(dict(zip(("image", *clouds), panels, strict=True)))
            labels.append(f"{name}, {angle} degrees")
    return figures.grid(rows, labels=labels)


STUDY = runner.Study(
    "ambiguity",
    BASE,
    configs,
    {},
    figure,
    measure,
    tables=ratios,
    recipe="quickstart",
    note="front: ambiguous images; turned: unambiguous ones. Depths are divided by the largest; "
    "for 32 exact draws, their Wasserstein-1 distance is .047 and their standard deviation .241. "
    "Cabinets that differ only in depth count as one model.",
)

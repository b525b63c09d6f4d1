"""Compares a person's models with networks: tables and the paper's figure.

The metrics of `evaluation.clouds` compare points of models and networks with the record's points.
As in the paper, models are not aligned with the truth: the person builds them in the record's
frame, seen by the image's camera.

Source: Fan, Su, Guibas, CVPR 2017, section "Analysis of human ability for single view 3D
reconstruction". The paper uses 16 cases and 1,024 points, and shows the figure without numbers. The
choice of cases, the primitives and the sampling of a union are **ours**.
"""

import dataclasses
import json
import pathlib
from collections.abc import Mapping, Sequence

import jax
import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import ConvexHull, QhullError

from psgn_jax.config.experiment import ConfigError
from psgn_jax.data.resample import resize_image, resize_mask
from psgn_jax.data.schema import Sample
from psgn_jax.evaluation.clouds import evaluate_pair
from psgn_jax.evaluation.table import markdown, title
from psgn_jax.models import networks
from psgn_jax.prediction.draws import sample_latents
from psgn_jax.prediction.predictor import require_photos
from psgn_jax.studies import figures
from psgn_jax.system.files import finite_or_none, write_atomic
from psgn_jax.system.untrusted import message_line, one_line
from psgn_jax.web.human.cases import Answer, StudyFile
from psgn_jax.weights.run_folder import Trained

NUM_POINTS = 1024  # as in the paper
MAX_NETWORKS = 3  # colours in the figure
PERSON = "person"
METRICS = ("cd_sq_radius2", "emd_radius")
_SHOWN = {
    "emd_radius": ("EMD [0.01 radius]", 100),
    "cd_sq_radius2": ("CD squared [0.001 radius^2]", 1000),
}
_NUDGE = 1e-5
# Each round of sampling replaces the hidden points of the previous round. A model is refused if
# less than about 2 % of its surface is visible.
_ROUNDS = 400
_COLOURS = ("#e2723e", "#4682b4", "#5aa55a", "#966ebe")


@dataclasses.dataclass(frozen=True, eq=False)
class Scored:
    """A modelled case with its metrics: person or network -> metric -> value."""

    answer: Answer
    sample: Sample
    metrics: Mapping[str, Mapping[str, float]]


def label_networks(runs: Sequence[Trained]) -> dict[str, Trained]:
    """Name -> network; the name is the last part of the folder, or the name of the weights.

    Raises:
      ConfigError: there are too many networks, two have the same name, or one cannot predict points
        from photos.
    """
    if len(runs) > MAX_NETWORKS:
        raise ConfigError(f"{len(runs)} networks: accepted: at most {MAX_NETWORKS}")
    labelled: dict[str, Trained] = {}
    for run in runs:
        require_photos(run.config, "psgn human score")
        label = one_line(run.name)
        if label in labelled or label == PERSON:
            raise ConfigError(
                f"{run.source}: the name {label!r} is already used; expected another one"
            )
        labelled[label] = run
    return labelled


def predict(run: Trained, samples: Sequence[Sample], records: Sequence[int]) -> list[np.ndarray]:
    """A network's points [n, 3] for each image; a random input depends on the record's number."""
    config, model = run.config, networks.build(run.config.model)
    size = config.data.image_size
    network = jax.jit(lambda params, batch, r: networks.predict(config, model, params, batch, r))
    clouds = []
    for sample, record in zip(samples, records, strict=True):
        image, mask = resize_image(sample.image, size), resize_mask(sample.mask, size)
        batch = {"image": image[None], "mask": mask[None]}
        r = sample_latents(config, record, 1, 1, 0) if config.model.random_size else None
        clouds.append(np.asarray(network(run.params, batch, r), np.float32).reshape(-1, 3))
    return clouds


def score(
    study: StudyFile,
    answers: Sequence[Answer],
    samples: Sequence[Sample],
    networks: Mapping[str, Trained],
    num_points: int = NUM_POINTS,
) -> list[Scored]:
    """The metrics of every case with a model, for clouds of `num_points` points.

    Raises:
      ConfigError: no case has a model, a model has no visible surface, or a network or a record
        does not have the number of points.
    """
    rows = [i for i, answer in enumerate(answers) if answer.solids]
    if not rows:
        raise ConfigError("no case has a model yet; expected at least one")
    kept = [samples[i] for i in rows]
    records = [study.cases[i].record for i in rows]
    fewer = min(len(sample.points) for sample in kept)
    if fewer < num_points:
        raise ConfigError(
            f"points={num_points}: a record has {fewer} points; accepted: at most {fewer}"
        )
    pairs = zip(rows, records, strict=True)
    clouds = {PERSON: [_model_points(answers[i], num_points, record) for i, record in pairs]}
    for name, run in networks.items():
        clouds[name] = predict(run, kept, records)
        if (predicted := len(clouds[name][0])) != num_points:
            raise ConfigError(
                f"points={num_points}: {run.source} predicts {predicted} points; expected the same "
                "number, as the EMD depends on it"
            )
    measure = jax.jit(lambda pred, gt: evaluate_pair(pred, gt, emd_tolerance=0.01))
    scored = []
    for i, sample, *preds in zip(rows, kept, *clouds.values(), strict=True):
        values = [jax.device_get(measure(pred, sample.points)) for pred in preds]
        metrics = [{key: float(value) for key, value in each.items()} for each in values]
        scored.append(Scored(answers[i], sample, dict(zip(clouds, metrics, strict=True))))
    return scored


def _model_points(answer: Answer, count: int, seed: int) -> np.ndarray:
    try:
        return sample_union([ConvexHull(corners) for corners in answer.solids], count, seed)
    except (ValueError, IndexError, QhullError) as error:
        why = message_line(error)[:200]
        raise ConfigError(f"{answer.case}: {why}; expected a model with a surface") from None


def write_scores(
    out: pathlib.Path,
    study: StudyFile,
    scored: Sequence[Scored],
    networks: Mapping[str, Trained],
    num_points: int,
) -> str:
    """Writes scores.json, scores.md and scores.png (the paper's figure); returns scores.md."""
    names = list(scored[0].metrics)

    def mean(name: str, metric: str) -> float:
        return float(np.mean([case.metrics[name][metric] for case in scored]))

    numbers = {
        "study": study.id,
        "data": study.data,
        "split": study.split,
        "cases_in_study": len(study.cases),
        "cases_modelled": len(scored),
        "num_points": num_points,
        "num_gt_points": [len(case.sample.points) for case in scored],
        "networks": {
            name: {run.source_kind: run.source, "step": run.step, "loss": run.config.loss.name}
            for name, run in networks.items()
        },
        "mean_over_cases": {name: {key: mean(name, key) for key in METRICS} for name in names},
        "cases": [
            {
                **{key: getattr(case.answer, key) for key in ("case", "seconds", "done", "parts")},
                **{key: getattr(case.sample, key) for key in ("category", "model_id", "view")},
                "metrics": {name: finite_or_none(dict(m)) for name, m in case.metrics.items()},
            }
            for case in scored
        ],
    }
    columns = [(name, metric) for metric in METRICS for name in names]
    heads = [f"{name}: {title(metric)}" for name, metric in columns]
    lines = [["case", "category", "minutes", "parts", *heads]]
    for case in scored:
        about = [
            case.answer.case + ("" if case.answer.done else " (not marked as done)"),
            one_line(case.sample.category) or "-",
            f"{case.answer.seconds / 60:.1f}",
            str(case.answer.parts),
        ]
        lines.append([*about, *(f"{case.metrics[n][m]:.5f}" for n, m in columns)])
    minutes = np.mean([case.answer.seconds for case in scored]) / 60
    parts = np.mean([case.answer.parts for case in scored])
    means = [f"{mean(*column):.5f}" for column in columns]
    lines.append(["mean", "", f"{minutes:.1f}", f"{parts:.1f}", *means])
    trained = "".join(
        f"\n`{name}`: loss `{run.config.loss.name}`, step {run.step}."
        for name, run in networks.items()
    )
    text = f"""{markdown(lines)}
{len(scored)} of {len(study.cases)} cases have a model. Each cloud has {num_points} points. The
points of a model are uniform by area on the surface of the union of its parts. Models and
predictions are not aligned with the truth. radius: the radius of the object's bounding
hemisphere.{trained}
"""
    groups = [case.answer.case.removeprefix("Case ") for case in scored]
    charts = {
        title: {name: [factor * case.metrics[name][metric] for case in scored] for name in names}
        for metric, (title, factor) in _SHOWN.items()
    }
    write_atomic(out / "scores.json", json.dumps(numbers, indent=2, allow_nan=False) + "\n")
    write_atomic(out / "scores.md", text)
    write_atomic(out / "scores.png", figures.png(figures.bars(charts, groups, colours=_COLOURS)))
    return text


# --- The union of convex solids -----------------------------------------------------------------


def inside(solid: ConvexHull, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
    """Which points are inside a solid; for points on its surface, either answer is possible."""
    normals, offsets = solid.equations[:, :3], solid.equations[:, 3]
    return np.asarray((points @ normals.T + offsets < 0).all(axis=1))


def sample_union(solids: Sequence[ConvexHull], count: int, seed: int) -> Float[np.ndarray, "n 3"]:
    """Points uniform by area on the surface of the union of solids.

    Surfaces inside another solid, or where two solids touch, have no points. Where faces of two
    solids coincide and have the same normal, we keep the first solid's points.

    Raises:
      ValueError: too little of the surface is visible.
    """
    rng = np.random.default_rng(seed)
    corners = np.concatenate([s.points[s.simplices] for s in solids])
    normals = np.concatenate([s.equations[:, :3] for s in solids])
    owner = np.repeat(np.arange(len(solids)), [len(s.simplices) for s in solids])
    edges = corners[:, 1:] - corners[:, :1]
    double = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    cumulated = np.cumsum(double)
    kept: list[np.ndarray] = []
    missing = count
    for _ in range(_ROUNDS):
        level = (np.arange(missing) + rng.random(missing)) / missing * cumulated[-1]
        face = np.minimum(np.searchsorted(cumulated, level, side="right"), len(double) - 1)
        # The square root makes the points uniform in the triangle.
        root, other = np.sqrt(rng.random(missing)), rng.random(missing)
        weights = np.stack([1 - root, root * (1 - other), root * other], axis=1)
        points = np.einsum("nk,nkd->nd", weights, corners[face])
        out, back = points + _NUDGE * normals[face], points - _NUDGE * normals[face]
        visible = np.ones(missing, bool)
        for number, solid in enumerate(solids):
            hidden = inside(solid, out) | ((number < owner[face]) & inside(solid, back))
            visible &= ~hidden | (owner[face] == number)
        kept.append(points[visible])
        missing -= int(visible.sum())
        if not missing:
            return np.concatenate(kept).astype(np.float32)
    raise ValueError("almost all of its surface is inside other parts")

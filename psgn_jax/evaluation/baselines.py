"""A network beside baselines on the same samples, `psgn evaluate --baselines`.

Every row has a cloud of n points for each sample of a split; n is the network's number of points.

- floor: n other points of the true surface. No prediction can be expected to be nearer.
- network: its predictions (with a random input, one draw).
- refined: its predictions after `prediction.refine`, as `psgn predict` writes them.
- oracle: the best training cloud, chosen with the truth known. CD and F-scores belong to the cloud
  with the least CD; the EMD is the least EMD of the 16 clouds with the least CD. This is the best
  that copying could give (Tatarchenko et al., "What Do Single-view 3D Reconstruction Networks
  Learn?", CVPR 2019).
- retrieval: the cloud of the training image with the most similar mask (cosine of masks averaged
  over 24x32 cells).
- fixed cloud: n random points of all training clouds.
- shuffled: predictions for other images. If they are as good, the network ignores its images.
"""

import dataclasses
import json
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from absl import logging

from psgn_jax.config.experiment import Config, ConfigError
from psgn_jax.data import loader
from psgn_jax.data.dataset import RecordReader
from psgn_jax.evaluation.clouds import emd, fscore
from psgn_jax.evaluation.table import aligned
from psgn_jax.losses.chamfer import chamfer_sq_mean, nearest_both
from psgn_jax.losses.mapping import map_pairs
from psgn_jax.models import networks
from psgn_jax.prediction.refine import first_clouds

ROWS = ("floor", "network", "refined", "oracle", "retrieval", "fixed cloud", "shuffled")
THRESHOLDS = (0.01, 0.02, 0.05)
METRICS = ("cd_sq_radius2", "emd_radius", *(f"fscore_{t:g}" for t in THRESHOLDS))
TITLES = ("CD squared [radius^2]", "EMD [radius]", *(f"F at {t:g} radius [%]" for t in THRESHOLDS))
MOST_TRAINING = 20_000  # largest number of training samples; of more, we draw so many at random

# The oracle compares this many points first; clouds that it keeps after the first two comparisons.
_COARSE, _BY_CD, _BY_EMD = 128, 64, 16
_RESAMPLES = 2000


def measure(config: Config, params: Any, split: str) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """The metrics of all rows, {row: float64 [samples, len(METRICS)]}, and the samples' models.

    `ConfigError` if `split` is the training split, or its records have too few points;
    `RecordError` if they are missing or damaged.
    """
    if split == config.data.train_split:
        raise ConfigError(f"split={split!r} is the training split; accepted: another")
    network = networks.build(config.model)
    n, rng = network.num_points, np.random.default_rng(0)
    describe = jax.jit(_features)
    keys = {*networks.input_keys(config), "intrinsics", "extrinsics"}

    least = len(RecordReader(config.data.eval_folders, split)[0].points)
    if least < 2 * n:
        accepted = f"at least {2 * n}, twice as many as the network predicts"
        raise ConfigError(f"split={split!r}: a record has {least} points; accepted: {accepted}")

    def collect(split: str, count: int, wanted: int, *, predict: bool) -> list[np.ndarray]:
        parts = []
        for batch in _batches(config, split, count, wanted):
            keep = batch["valid"]
            rows = [batch["points"], np.asarray(describe(batch["mask"]))]
            rows += [np.array([*zip(batch["category"], batch["model_id"], strict=True)])]
            if predict:
                rows.append(np.asarray(predicted(params, {key: batch[key] for key in keys})))
            parts.append([row[keep] for row in rows])
        return [np.concatenate(part) for part in zip(*parts, strict=True)]

    @jax.jit
    def predicted(params: Any, batch: Any) -> Any:
        return jnp.stack(first_clouds(config, network, params, batch), axis=1)

    logging.info("baselines: reading the training clouds")
    train, train_features, _ = collect(config.data.train_split, n, MOST_TRAINING, predict=False)
    both, features, models, predictions = collect(split, 2 * n, 0, predict=True)
    both = both[:, rng.permutation(2 * n)]
    truth, floor = both[:, :n], both[:, n:]
    similarity = _unit(features) @ _unit(train_features).T
    logging.info("baselines: %d samples, %d training clouds", len(truth), len(train))
    pairs = jax.jit(map_pairs(_metrics))
    fixed = rng.choice(train.reshape(-1, 3), n, replace=False)
    clouds = {
        "floor": floor,
        "network": predictions[:, 0],
        "refined": predictions[:, 1],
        "retrieval": train[np.argmax(similarity, axis=1)],
        "fixed cloud": np.broadcast_to(fixed, truth.shape),
        "shuffled": np.roll(predictions[:, 0], max(1, len(truth) // 2), axis=0),
    }
    table = {name: np.asarray(pairs(c, truth), np.float64) for name, c in clouds.items()}
    coarse = train[:, rng.permutation(n)[:_COARSE]]
    table["oracle"] = np.stack([_oracle(cloud, train, coarse) for cloud in truth])
    return {name: table[name] for name in ROWS}, np.unique(models, axis=0, return_inverse=True)[1]


def _batches(config: Config, split: str, count: int, wanted: int) -> Iterator[Any]:
    path = "" if split == config.data.train_split else config.data.eval_path
    data = dataclasses.replace(config.data, num_eval_points=count, eval_path=path)
    size = config.eval.batch_size

    def choose(number: int) -> list[int]:
        order = np.random.default_rng(0).permutation(number).tolist()
        return sorted(order[: max(1, wanted // size) if wanted else number])

    return loader.eval_batches(data, split=split, batch_size=size, seed=config.seed, choose=choose)


def _features(mask: Any) -> Any:
    cells = jax.image.resize(mask.astype(jnp.float32), (len(mask), 24, 32), "linear")
    return cells.reshape(len(mask), -1)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)


def _metrics(pred: Any, truth: Any) -> Any:
    to_truth, to_pred = nearest_both(pred, truth)
    scores = [fscore(to_truth.distance_sq, to_pred.distance_sq, t) for t in THRESHOLDS]
    cd = to_truth.distance_sq.mean() + to_pred.distance_sq.mean()
    return jnp.stack([cd, emd(pred, truth).emd, *scores])


_cds = jax.jit(jax.vmap(chamfer_sq_mean, (0, None)))
_all_metrics = jax.jit(lambda clouds, truth: jax.lax.map(lambda c: _metrics(c, truth), clouds))


def _oracle(truth: np.ndarray, train: np.ndarray, coarse: np.ndarray) -> np.ndarray:
    distances = np.asarray(_cds(coarse, truth[: 4 * _COARSE]))
    near = train[np.argsort(distances)[:_BY_CD]]
    near = near[np.argsort(np.asarray(_cds(near, truth)))[:_BY_EMD]]
    values = np.asarray(_all_metrics(near, truth), np.float64)
    best = values[0].copy()
    best[1] = values[:, 1].min()
    return best


def intervals(values: np.ndarray, models: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean of [samples, metrics] and the ends of the 95 % percentile bootstrap interval.

    Models are drawn with all their samples, because views of a model depend on each other.
    """
    counts, rng = np.bincount(models), np.random.default_rng(0)
    sums = np.zeros((len(counts), values.shape[1]))
    np.add.at(sums, models, values)
    drawn = (rng.integers(len(counts), size=len(counts)) for _ in range(_RESAMPLES))
    means = [sums[index].sum(axis=0) / counts[index].sum() for index in drawn]
    low, high = np.percentile(means, (2.5, 97.5), axis=0)
    return values.mean(axis=0), low, high


def text(rows: dict[str, np.ndarray], models: np.ndarray, num_points: int) -> str:
    """The table: mean [interval] of every metric."""
    lines = [["", *TITLES]]
    for name, values in rows.items():
        lines.append([name])
        for title, *numbers in zip(TITLES, *intervals(values, models), strict=True):
            factor, digits = (100, 1) if title.endswith("[%]") else (1, 4)
            mean, low, high = (f"{factor * v:.{digits}f}" for v in numbers)
            lines[-1].append(f"{mean} [{low}, {high}]")
    count = len(next(iter(rows.values())))
    note = (
        f"{count} samples, {num_points} predicted and {num_points} true points; in brackets 95 %\n"
        "bootstrap intervals over models. psgn_jax/evaluation/baselines.py describes the rows."
    )
    return f"{aligned(lines)}\n{note}\n"


def json_text(rows: dict[str, np.ndarray], models: np.ndarray, **others: Any) -> str:
    """The table as JSON: {row: {metric: [mean, low, high]}}, and `others`."""
    table = {
        name: dict(zip(METRICS, np.stack(intervals(values, models), axis=1).tolist(), strict=True))
        for name, values in rows.items()
    }
    return json.dumps({**others, "rows": table}, indent=2, allow_nan=False) + "\n"

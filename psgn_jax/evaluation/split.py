"""Evaluation of a network on all samples of a split.

Several processes (`system.distributed`) share the batches; each gets the whole result.
"""

import contextlib
import itertools
from collections.abc import Callable, Generator, Sequence
from typing import Any

import numpy as np

from psgn_jax.config.experiment import Config, ConfigError
from psgn_jax.data import loader
from psgn_jax.evaluation.results import Evaluation, SampleName
from psgn_jax.system import distributed

OnBatch = Callable[[int, Any, np.ndarray], None]


def eval_batches(config: Config, split: str = "", **options: Any) -> Generator[Any, None, None]:
    """The batches of an evaluation, by `loader.eval_batches` with the other `options`."""
    return loader.eval_batches(
        config.data,
        split=split or config.data.eval_split,
        batch_size=config.eval.batch_size,
        seed=config.seed,
        visible_tolerance=config.eval.visible_tolerance,
        **options,
    )


def evaluate_split(
    config: Config,
    params: Any,
    eval_step: Callable[..., Any],
    *,
    split: str | None = None,
    max_samples: int = 0,
    on_batch: OnBatch | None = None,
) -> Evaluation:
    """Metrics of a network on a split, or on its first `max_samples` > 0 samples.

    `eval_step` is a task's; `on_batch` gets (index of a batch, batch, predictions).
    """
    split = split or config.data.eval_split
    process, count = distributed.index_and_count()
    batches = eval_batches(config, split, choose=lambda number: range(process, number, count))
    names: list[SampleName] = []
    parts: list[dict[str, np.ndarray]] = []
    num_pred, distinct = 0, set[int]()
    with contextlib.closing(batches):
        for index, batch in zip(itertools.count(process, count), batches, strict=False):
            start = index * config.eval.batch_size
            if max_samples and start >= max_samples:
                break
            points, metrics = eval_step(params, batch, index)
            keep = np.flatnonzero(batch["valid"])[: max_samples - start if max_samples else None]
            names += [
                SampleName(start + i, batch["category"][i], batch["model_id"][i], batch["view"][i])
                for i in keep.tolist()
            ]
            parts.append({k: np.asarray(rows, np.float64)[keep] for k, rows in metrics.items()})
            num_pred = points.shape[1]
            # Batches may repeat points. A point float32 [3] has 12 bytes.
            clouds = [np.ascontiguousarray(cloud) for cloud in batch["points"][keep]]
            distinct |= {len(np.unique(cloud.view("V12"))) for cloud in clouds}
            if on_batch is not None:
                on_batch(index, batch, np.asarray(points))
    # JAX sorts the metrics by name; those of aligned clouds are put last.
    metric_names = sorted(parts[0] if parts else (), key=lambda name: name.startswith("aligned_"))
    values = {name: np.concatenate([part[name] for part in parts]) for name in metric_names}
    if count > 1:
        lists = {name: array.tolist() for name, array in values.items()}
        gathered = distributed.gather([names, lists, num_pred, sorted(distinct)])
        names, values, num_pred, distinct = _merged([part for part in gathered if part[0]])
    if not names:
        raise ConfigError(f"the split {split!r} of data.path={config.data.path!r} has no samples")
    settings, points = config.eval, (num_pred, config.data.num_eval_points)
    return Evaluation(
        split, names, values, settings.fscore_threshold, points, settings.visible_tolerance,
        frame=config.data.eval_frame, refined=settings.refine,
        num_distinct=(min(distinct), max(distinct)),
    )  # fmt: skip


def _merged(parts: Sequence[Any]) -> tuple[Any, ...]:
    """The measurements of all processes with samples, in the order of the records."""
    names = [SampleName(*name) for part in parts for name in part[0]]
    order = np.argsort([name.record for name in names])
    values = {
        metric: np.concatenate([np.array(part[1][metric], np.float64) for part in parts])[order]
        for metric in (parts[0][1] if parts else ())
    }
    counts = {number for part in parts for number in part[3]}
    return [names[i] for i in order], values, max((part[2] for part in parts), default=0), counts

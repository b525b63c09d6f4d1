"""Evaluation on a split: every sample is predicted and counted once.

Several processes (`training.processes`) divide the batches among themselves; each gets the whole
result.
"""

import contextlib
import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from psgn_jax.config import Config, ConfigError
from psgn_jax.data import loader
from psgn_jax.metrics.evaluation import Evaluation, SampleName
from psgn_jax.training import processes
from psgn_jax.training import step as step_lib
from psgn_jax.training.signals import Stopped


def evaluate_split(
    config: Config,
    params: Any,
    eval_step: Callable[..., Any],
    *,
    split: str | None = None,
    max_samples: int = 0,
    on_batch: Callable[[int, Any, np.ndarray], None] | None = None,
) -> Evaluation:
    """Metrics of a network on a split.

    Args:
      config: configuration of the run.
      params: parameters of the network.
      eval_step: maps (params, batch on the host, index of the batch) to predictions and metrics
        with a row for each sample; see `over_devices`.
      split: name of the split; None = `config.data.eval_split`.
      max_samples: evaluate only this many samples, from the start of the split; 0 = all.
      on_batch: called with (index of the batch, batch, predictions).

    Raises:
      ConfigError: the split has no samples.
      Stopped: `on_batch` raised it in any process.
    """
    split = split or config.data.eval_split
    group = processes.current()
    parts = [_Part([], {}, 0)]
    batches = loader.eval_batches(
        config.data,
        split=split,
        batch_size=config.eval.batch_size,
        seed=config.seed,
        visible_tolerance=config.eval.visible_tolerance,
        process_index=group.index,
        process_count=group.count,
    )
    with contextlib.closing(batches):
        for index in itertools.count(group.index, group.count):
            start = index * config.eval.batch_size
            enough = bool(max_samples) and start >= max_samples
            batch = None if enough else next(batches, None)
            state = _DONE if batch is None else _MORE
            if batch is not None:
                points, values = eval_step(params, batch, index)
                keep = np.flatnonzero(batch["valid"])[
                    : max_samples - start if max_samples else None
                ]
                parts.append(_measured(batch, start, keep, points.shape[1], values))
                try:
                    if on_batch:
                        on_batch(index, batch, np.asarray(points))
                except Stopped:
                    state = _STOPPED
            states = group.exchange(state)
            if _STOPPED in states:
                raise Stopped
            if _MORE not in states:
                break
    merged = _merged([_Part.of(entry) for entry in group.exchange(_merged(parts).entry())])
    if not merged.names:
        raise ConfigError(f"the split {split!r} of data.path={config.data.path!r} has no samples")
    num_points = merged.num_pred, config.data.num_eval_points
    return Evaluation(
        split,
        merged.names,
        merged.metrics,
        config.eval.fscore_threshold,
        num_points,
        config.eval.visible_tolerance,
        frame=config.data.eval_frame,
    )


# Messages that a process sends after each batch.
_MORE, _DONE, _STOPPED = "more", "done", "stopped"


class _Part(NamedTuple):
    """Measurements of one process: names of samples, and metrics with a row for each sample."""

    names: list[SampleName]
    metrics: dict[str, np.ndarray]
    num_pred: int

    def entry(self) -> list[Any]:
        """The measurements as JSON values, which `of` reads."""
        metrics = {name: values.tolist() for name, values in self.metrics.items()}
        return [self.names, metrics, self.num_pred]

    @classmethod
    def of(cls, entry: Any) -> "_Part":
        names, metrics, num_pred = entry
        arrays = {name: np.array(values, np.float64) for name, values in metrics.items()}
        return cls([SampleName(*name) for name in names], arrays, num_pred)


def _measured(
    batch: Any, start: int, keep: np.ndarray, num_pred: int, values: Mapping[str, Any]
) -> _Part:
    """The samples `keep` of a batch, which begins at sample `start` of the split."""
    names = [
        SampleName(start + i, batch["category"][i], batch["model_id"][i], batch["view"][i])
        for i in keep.tolist()
    ]
    metrics = {name: np.asarray(rows, np.float64)[keep] for name, rows in values.items()}
    return _Part(names, metrics, num_pred)


def _merged(parts: Sequence[_Part]) -> _Part:
    """All parts, the samples in the order of the records."""
    filled = [part for part in parts if part.names]
    if not filled:
        return parts[0]
    names = [name for part in filled for name in part.names]
    order = sorted(range(len(names)), key=lambda i: names[i].record)
    # JAX returns the metrics sorted by name; here those computed after aligning the clouds
    # (`aligned_…`) are put last.
    ordered = sorted(filled[0].metrics, key=lambda name: name.startswith("aligned_"))
    metrics = {k: np.concatenate([part.metrics[k] for part in filled])[order] for k in ordered}
    return _Part([names[i] for i in order], metrics, filled[0].num_pred)


def over_devices(
    config: Config, keys: Sequence[str], make: Callable[[step_lib.Mesh], Callable[..., Any]]
) -> Callable[..., Any]:
    """The evaluation step `make(mesh)`, applied to the arrays `keys` of a batch on the host.

    The mesh contains the local devices, or one device if their number does not divide the batch.
    """
    devices = jax.local_devices()
    if config.eval.batch_size % len(devices):
        devices = devices[:1]
    mesh = step_lib.data_mesh(devices)
    step = make(mesh)

    replicated = jax.sharding.NamedSharding(mesh, step_lib.P())
    split = jax.sharding.NamedSharding(mesh, step_lib.P("data"))

    def run(params: Any, batch: Any, index: int) -> Any:
        # The parameters may be on more devices than the evaluation uses.
        params = jax.device_put(params, replicated)
        # `visible` is not among `keys`, because a batch has it only if the records have depth.
        wanted = (*keys, "visible") if "visible" in batch else keys
        device_batch = jax.device_put({k: batch[k] for k in wanted}, split)
        return step(params, device_batch, np.int32(index))

    return run

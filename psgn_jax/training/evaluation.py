"""Evaluation on a split: every sample is predicted and counted once."""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from psgn_jax.config import Config, ConfigError
from psgn_jax.data import loader
from psgn_jax.metrics.evaluation import Evaluation, SampleName
from psgn_jax.training import step as step_lib


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
      max_samples: number of first samples that are evaluated; 0 = all.
      on_batch: called with (index of the batch, batch, points [B,N,3]).

    Raises:
      ConfigError: the split has no samples.
    """
    split = split or config.data.eval_split
    names: list[SampleName] = []
    num_pred = 0
    parts: list[dict[str, np.ndarray]] = []
    batches = loader.eval_batches(
        config.data,
        split=split,
        batch_size=config.eval.batch_size,
        seed=config.seed,
        visible_tolerance=config.eval.visible_tolerance,
    )
    for index, batch in enumerate(batches):
        points, values = eval_step(params, batch, index)
        keep = np.flatnonzero(batch["valid"])
        if max_samples:
            keep = keep[: max_samples - len(names)]
        num_pred, start = points.shape[1], index * config.eval.batch_size
        names += [
            SampleName(start + i, batch["category"][i], batch["model_id"][i], batch["view"][i])
            for i in keep.tolist()
        ]
        parts.append({k: np.asarray(v, np.float64)[keep] for k, v in values.items()})
        if on_batch:
            on_batch(index, batch, np.asarray(points))
        if max_samples and len(names) >= max_samples:
            break
    if not names:
        raise ConfigError(f"the split {split!r} of data.path={config.data.path!r} has no samples")
    # JAX sorts the names; aligned metrics are moved to the end.
    ordered = sorted(parts[0], key=lambda name: name.startswith("aligned_"))
    merged = {k: np.concatenate([part[k] for part in parts]) for k in ordered}
    num_points = num_pred, config.data.num_eval_points
    return Evaluation(
        split,
        names,
        merged,
        config.eval.fscore_threshold,
        num_points,
        config.eval.visible_tolerance,
        frame=config.data.eval_frame,
    )


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
        # Visible points need the depth, which may not be an input of the network.
        wanted = (*keys, "visible") if "visible" in batch else keys
        device_batch = jax.device_put({k: batch[k] for k in wanted}, split)
        return step(params, device_batch, np.int32(index))

    return run

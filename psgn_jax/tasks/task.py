"""A task as a record of functions; `tasks.create` makes it."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from psgn_jax.evaluation.results import Evaluation

Batch = Mapping[str, Any]


def no_latents(step: Any, batch_size: int, *, train: bool) -> dict[str, Any]:
    return {}


@dataclasses.dataclass(frozen=True)
class Task:
    """What a run trains and measures."""

    title: str  # name of the network, for the log
    keys: tuple[str, ...]  # names of the arrays of a batch that devices need
    # () -> initial parameters, which depend on the seed; it can run inside `jit`.
    init_params: Callable[[], Any]
    # (params, batch, step) -> (value to minimise, metrics), a `jax.tree_util.Partial` whose leaves
    # are constant arrays. The batch includes `latents`. The metric `loss` is the value without
    # regularisation.
    total_loss: Callable[[Any, Batch, Any], tuple[Any, dict[str, Any]]]
    # (params, split=None, max_samples=0, on_batch=None, chosen=None, draws=0) -> metrics on a
    # split, see `evaluation.split.evaluate_split`. `chosen`: thresholds of an earlier evaluation;
    # missing thresholds are chosen on this split. `draws`: measure also so many predictions per
    # image (points only).
    evaluate: Callable[..., Evaluation]
    # params -> a picture of some predictions, uint8 [h, w, 3], or None.
    picture: Callable[[Any], np.ndarray | None] = lambda params: None
    # (step, batch_size, train=) -> latents of a step or evaluation batch, one row per sample.
    latents: Callable[..., dict[str, Any]] = no_latents
    # Copies the runs that this run reads into its folder.
    keep_sources: Callable[[], None] = lambda: None

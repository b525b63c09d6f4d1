"""The record of functions that a task consists of; `tasks.create` makes one."""

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
    keys: tuple[str, ...]  # of the arrays of a batch that the device needs
    # () -> initial parameters, a function of the seed; it can run inside jit.
    init_params: Callable[[], Any]
    # (params, batch, step) -> (value to be minimised, metrics), a `jax.tree_util.Partial` whose
    # leaves are arrays that training does not change. The batch includes `latents`. The metric
    # `loss` is the value without regularisation.
    total_loss: Callable[[Any, Batch, Any], tuple[Any, dict[str, Any]]]
    # (params, split=None, max_samples=0, on_batch=None, chosen=None, draws=0) -> metrics on a
    # split, as `evaluation.split.evaluate_split` measures them. `chosen`: thresholds of an earlier
    # evaluation; missing thresholds are chosen on this split. `draws`: the number of
    # predictions per image whose distances are measured too (points only).
    evaluate: Callable[..., Evaluation]
    # params -> an image of some predictions, uint8 [h, w, 3], or None.
    picture: Callable[[Any], np.ndarray | None] = lambda params: None
    # (step, batch_size, train=) -> latents of a step or evaluation batch, one row per sample.
    latents: Callable[..., dict[str, Any]] = no_latents
    # Copies the runs that this run reads into its folder.
    keep_sources: Callable[[], None] = lambda: None

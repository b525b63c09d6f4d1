"""The losses that a configuration can name."""

import functools
import inspect
from collections.abc import Callable
from typing import Any

from psgn_jax.config import ConfigError, LossConfig, suggestion
from psgn_jax.losses import chamfer, emd

LOSSES: dict[str, Callable[..., Any]] = {
    "chamfer_sq": chamfer.chamfer_sq,
    "chamfer_sq_mean": chamfer.chamfer_sq_mean,
    "chamfer_l1_mean": chamfer.chamfer_l1_mean,
    "chamfer_authors": chamfer.chamfer_authors,
    "emd_sum": emd.emd_sum,
    "emd_mean": emd.emd_mean,
}
"""Losses of one pair `(pred [n,3], gt [m,3]) -> scalar`; callers vmap."""


def configured_loss(config: LossConfig) -> Callable[..., Any]:
    """The loss of one pair of clouds that `loss.name` names, with the options of its kind.

    Raises:
      ConfigError: there is no loss of that name.
    """
    if config.name not in LOSSES:
        raise ConfigError(
            f"loss.name={config.name!r} is unknown; {suggestion(config.name, LOSSES)}"
            f"accepted: {', '.join(LOSSES)}"
        )
    function = LOSSES[config.name]
    if "schedule" in inspect.signature(function).parameters:
        return functools.partial(
            function, tolerance=config.emd_tolerance, schedule=config.emd_schedule
        )
    return function

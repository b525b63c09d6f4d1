"""Names of the configuration -> network, loss, data source; an unknown name lists the choices.

An entry is `"module:attribute"`, imported when it is asked for: to name a loss costs no import of
flax. A project that uses this one as a library adds its own entries to the dictionaries.
"""

import functools
import importlib
import inspect
import pathlib
from collections.abc import Callable, Mapping
from typing import Any, cast

from psgn_jax.config import Config, ConfigError, LossConfig, ModelConfig, suggestion

MODELS: dict[str, str | Callable[[ModelConfig], Any]] = {
    "vanilla": "psgn_jax.models.point_out_net:build",
    "two_branch": "psgn_jax.models.point_out_net:build",
    "hourglass": "psgn_jax.models.point_out_net:build",
}
"""Builders `(ModelConfig) -> linen module` mapping images [B,H,W,C], r to points [B,N,3]."""

LOSSES: dict[str, str | Callable[..., Any]] = {
    "chamfer_sq": "psgn_jax.losses.chamfer:chamfer_sq",
    "chamfer_sq_mean": "psgn_jax.losses.chamfer:chamfer_sq_mean",
    "chamfer_l1_mean": "psgn_jax.losses.chamfer:chamfer_l1_mean",
    "chamfer_authors": "psgn_jax.losses.chamfer:chamfer_authors",
    "emd_sum": "psgn_jax.losses.emd:emd_sum",
    "emd_mean": "psgn_jax.losses.emd:emd_mean",
}
"""Losses of one pair `(pred [n,3], gt [m,3]) -> scalar`; callers vmap."""

DATA_SOURCES: dict[str, Any] = {"records": "psgn_jax.data.loader"}
"""Modules (or objects) with `train_batches`, `eval_batches` and `num_samples`."""

TASKS: dict[str, str | Callable[..., Any]] = {
    "points": "psgn_jax.tasks.points:Points",
    "refine": "psgn_jax.tasks.voxels:Refine",
    "volume": "psgn_jax.tasks.voxels:Volume",
    "views": "psgn_jax.tasks.voxels:Views",
}
"""Makers `(Config, folder of the run) -> psgn_jax.tasks.Task`."""


def task(config: Config, workdir: str | pathlib.Path) -> Any:
    """What a run trains and measures, as `task` names it; raises `ConfigError` if it cannot."""
    return _look_up(TASKS, config.task, "task")(config, pathlib.Path(workdir))


def build_model(config: ModelConfig) -> Any:
    """The network that `config.name` names, as a linen module."""
    return _look_up(MODELS, config.name, "model.name")(config)


def loss(config: LossConfig) -> Callable[..., Any]:
    """The loss of one pair of clouds that `loss.name` names, with the options of its kind."""
    function = _look_up(LOSSES, config.name, "loss.name")
    if "schedule" in inspect.signature(function).parameters:
        return functools.partial(
            function, tolerance=config.emd_tolerance, schedule=config.emd_schedule
        )
    return cast(Callable[..., Any], function)


def data_source(name: str = "records") -> Any:
    """The module that turns a `DataConfig` into batches."""
    return _look_up(DATA_SOURCES, name, "data source")


def _look_up(entries: Mapping[str, Any], name: str, field: str) -> Any:
    if name not in entries:
        raise ConfigError(
            f"{field}={name!r} is unknown; {suggestion(name, entries)}"
            f"accepted: {', '.join(entries)}"
        )
    entry = entries[name]
    if not isinstance(entry, str):
        return entry
    module, _, attribute = entry.partition(":")
    imported = importlib.import_module(module)
    return getattr(imported, attribute) if attribute else imported

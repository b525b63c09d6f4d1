"""Tasks: what a run trains and measures. `Config.task` names one; the type is `tasks.base.Task`."""

import pathlib
from collections.abc import Callable

from psgn_jax.config import Config
from psgn_jax.tasks.base import Task
from psgn_jax.tasks.points import Points
from psgn_jax.tasks.r2n2 import Views
from psgn_jax.tasks.refiner import Refine
from psgn_jax.tasks.volume import Volume

TASKS: dict[str, Callable[[Config, pathlib.Path], Task]] = {
    "points": Points,
    "refine": Refine,
    "volume": Volume,
    "views": Views,
}
"""Constructors of the tasks, called with (configuration, folder of the run)."""


def create(config: Config, workdir: str | pathlib.Path) -> Task:
    """Creates the task of a configuration; raises `ConfigError` if a run that it reads is missing.

    A task reads other runs if `voxels.from_cd`, `from_emd` or `from_volume` names them.
    """
    return TASKS[config.task](config, pathlib.Path(workdir))

"""What a run trains and measures: a task, see `tasks.base.Task`, by its name in `Config.task`."""

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
"""Makers of (configuration, folder of the run)."""


def create(config: Config, workdir: str | pathlib.Path) -> Task:
    """The task of a configuration; raises `ConfigError` if another run that it reads is missing."""
    return TASKS[config.task](config, pathlib.Path(workdir))

"""Tasks: what a run trains and measures; `Config.task` names a `tasks.task.Task`."""

import os
import pathlib
from collections.abc import Callable

from psgn_jax.config.experiment import Config
from psgn_jax.tasks.points import Points
from psgn_jax.tasks.refiner import Refiner
from psgn_jax.tasks.task import Task
from psgn_jax.tasks.voxels import Views, Volume

TASKS: dict[str, Callable[[Config, pathlib.Path], Task]] = {
    "points": Points, "refiner": Refiner, "volume": Volume, "views": Views,
}  # fmt: skip


def create(config: Config, workdir: str | os.PathLike[str] = "") -> Task:
    """The task of a configuration; `ConfigError` if its loss or a run in `voxels` does not fit."""
    return TASKS[config.task](config, pathlib.Path(workdir))

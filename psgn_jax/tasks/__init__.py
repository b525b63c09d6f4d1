"""Tasks: what a run trains and measures; `Config.task` names a `tasks.task.Task`."""

import os
import pathlib

from psgn_jax.config.experiment import Config
from psgn_jax.tasks.points import points_task
from psgn_jax.tasks.refiner import refiner_task
from psgn_jax.tasks.task import Task
from psgn_jax.tasks.voxels import views_task, volume_task

TASKS = {
    "points": points_task,
    "refiner": refiner_task,
    "volume": volume_task,
    "views": views_task,
}


def create(config: Config, workdir: str | os.PathLike[str] = "") -> Task:
    """Creates the task of a configuration.

    Raises:
      ConfigError: the loss does not fit the network, or a run in `voxels.from_cd`, `from_emd` or
        `from_volume` is missing.
    """
    return TASKS[config.task](config, pathlib.Path(workdir))

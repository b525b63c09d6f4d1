"""Tasks: what a run trains and measures. `Config.task` names one; the type is `tasks.base.Task`."""

import os

from psgn_jax.config.experiment import Config
from psgn_jax.tasks.base import Task
from psgn_jax.tasks.points import Points
from psgn_jax.tasks.refiner import Refine
from psgn_jax.tasks.voxels import Views, Volume

TASKS: dict[str, type[Task]] = {
    "points": Points,
    "refine": Refine,
    "volume": Volume,
    "views": Views,
}


def create(config: Config, workdir: str | os.PathLike[str] = "") -> Task:
    """Creates the task of a configuration.

    Args:
      config: configuration of the run.
      workdir: folder of the run.

    Raises:
      ConfigError: a run that `voxels.from_cd`, `from_emd` or `from_volume` names is missing.
    """
    return TASKS[config.task](config, workdir)

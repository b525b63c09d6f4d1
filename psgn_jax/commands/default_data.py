"""The default data set, for configurations without `data.path`: rendered on first use and cached.

Rendering needs the extra `render` and takes a minute or two. `data_gen.default` describes the data.
"""

import pathlib

from absl import logging

from psgn_jax.config.data import DEFAULT_DATA
from psgn_jax.config.experiment import Config, ConfigError
from psgn_jax.data.manifest import load_manifest
from psgn_jax.data.schema import RecordError
from psgn_jax.system.cores import num_cores
from psgn_jax.system.files import cache_folder, check_folder
from psgn_jax.system.locks import locked


def ensure_default_data(config: Config, *, training: bool = True) -> None:
    """Renders the default data set if the configuration reads it, for evaluation or `training`.

    Raises:
      ConfigError: the task needs several views of each model; or as `default_dataset`.
      UserError: the cache folder cannot be written.
    """
    data = config.data
    if data.path or (data.eval_path and not training):
        return
    views = 0 if data.eval_path else data.eval_views
    if training:
        views = max(views, data.train_views)
    if views > 1:
        raise ConfigError(
            f"data.path is empty, and the default data set has one view of each model, but "
            f"task={config.task!r} needs {views}: set data.path to a folder of records with "
            f"{views} views, such as one of psgn render --config.views={views}"
        )
    default_dataset()


def default_dataset() -> str:
    """Renders the default data set, or the missing part of it; returns its folder.

    If several processes call this, one renders and the others wait.

    Raises:
      ConfigError: the data set does not exist and cannot be rendered.
      UserError: the cache folder cannot be written.
    """
    from data_gen import default  # imports the loader and the renderer

    folder = cache_folder() / DEFAULT_DATA
    if _is_complete(folder):
        return str(folder)
    check_folder(folder.parent, "PSGN_CACHE")
    lock = folder.with_name(f".{DEFAULT_DATA}.lock")
    with locked(lock, waiting="waiting for another process that renders the default data set"):
        if not _is_complete(folder):
            minutes = max(1, round(default.CORE_SECONDS / 60 / num_cores()))
            logging.info(
                "data.path is empty: rendering the default data set once, %d images of procedural "
                "models, about %d minutes on %d cores; --config.data.path, for psgn evaluate --data"
                ", names other records; folder: %s",
                default.NUM_MODELS, minutes, num_cores(), folder,
            )  # fmt: skip
            try:
                default.build(folder)
            except (RuntimeError, ValueError) as error:
                raise ConfigError(
                    f"data.path is empty, and the default data set cannot be rendered: {error}"
                ) from error
    return str(folder)


def _is_complete(folder: pathlib.Path) -> bool:
    try:
        return load_manifest(folder, allow_incomplete=True).complete
    except RecordError:
        return False

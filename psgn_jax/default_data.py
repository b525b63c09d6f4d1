"""The default data set: procedural models rendered by the data stage on first use, then kept.

What a configuration without `data.path` trains on. Commands make it, by the ordinary
pipeline (`data_gen`, extra `render`), into a cache folder, which takes a minute or two; see
`data_gen.default` for what is in it. A program that calls the library calls `with_default_data`.
"""

import dataclasses
import fcntl
import pathlib

from absl import logging

from data_gen import default
from psgn_jax.config import Config, ConfigError
from psgn_jax.data.manifest import load_manifest
from psgn_jax.data.schema import RecordError
from psgn_jax.files import cache_folder


def with_default_data(config: Config) -> Config:
    """A configuration that finds its data: one without `data.path` gets the default data set.

    `data.path` itself, and so what a run's folder says, stays as it is.

    Raises:
      ConfigError: as `default_dataset`.
    """
    if config.data.path:
        return config
    data = dataclasses.replace(config.data, default_folder=default_dataset())
    return dataclasses.replace(config, data=data)


def default_dataset() -> str:
    """Folder of the default data set; renders it, or what lacks of it, where it is missing.

    Killed on the way, the next call goes on with it. Of several processes one renders and the
    others wait.

    Raises:
      ConfigError: it is not there and cannot be made, with the remedy.
    """
    folder = cache_folder() / default.NAME
    if _is_complete(folder):
        return str(folder)
    if not default.can_build():
        raise ConfigError(
            "no data are named, and the default data set is rendered on first use, which needs "
            "Mitsuba: pip install -e '.[render]'; or set data.path to a folder of records"
        )
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"the cache folder (environment variable PSGN_CACHE): {error}") from error
    with open(folder.with_name(f".{default.NAME}.lock"), "w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            logging.info("waiting for another process that makes the default data set")
            fcntl.flock(lock, fcntl.LOCK_EX)
        if not _is_complete(folder):
            logging.info("making the default data set in %s", folder)
            default.build(folder)
    return str(folder)


def _is_complete(folder: pathlib.Path) -> bool:
    try:
        return load_manifest(folder, allow_incomplete=True).complete
    except RecordError:
        return False

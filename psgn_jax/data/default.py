"""The default data set: procedural models rendered by the data stage on first use, then kept.

What a configuration without `data.path` trains on. It is made by the ordinary pipeline
(`data_gen`, extra `render`) into a cache folder, which takes a minute or two; see
`data_gen.default` for what is in it.
"""

import fcntl
import os
import pathlib

from absl import logging

from psgn_jax.config import ConfigError
from psgn_jax.data import records


def cache_folder() -> pathlib.Path:
    """Where data made on first use is kept: $PSGN_CACHE, or ~/.cache/psgn_jax."""
    return pathlib.Path(os.environ.get("PSGN_CACHE") or pathlib.Path.home() / ".cache" / "psgn_jax")


def default_dataset() -> str:
    """Folder of the default data set; renders it, or what lacks of it, where it is missing.

    Killed on the way, the next call goes on with it. Of several processes one renders and the
    others wait.

    Raises:
      ConfigError: it is not there and cannot be made, with the remedy.
    """
    from data_gen import default

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
        return records.load_manifest(folder, allow_incomplete=True).complete
    except records.RecordError:
        return False

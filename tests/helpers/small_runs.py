"""A small data set, a configuration file and a fast environment, for tests of whole commands."""

import os
import shutil

from helpers.standin import SOLIDS
from psgn_jax.config.experiment import to_dict


def write_solids(folder):
    """Copies the records of `standin.SOLIDS`; returns the folder."""
    return shutil.copytree(SOLIDS, folder, dirs_exist_ok=True)


def write_config(path, config):
    """Writes a file for `--config`; returns its path."""
    path.write_text(
        "import ml_collections\n\n\ndef get_config():\n"
        f"    return ml_collections.ConfigDict({to_dict(config)!r})\n"
    )
    return path


def quick_environment(folder):
    """An environment in which each program is compiled once, as by `keep_compiled`."""
    return os.environ | {
        "JAX_PLATFORMS": "cpu",
        "PSGN_CONVOLUTIONS": "xla",
        "JAX_COMPILATION_CACHE_DIR": str(folder / "cache"),
        "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0",
        "JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES": "-1",
        # XLA warns that cached programs might be for another machine, even on the same machine.
        "TF_CPP_MIN_LOG_LEVEL": "3",
    }

"""Trains a network: `psgn train --config=base --workdir=runs/base`.

`python -m psgn_jax.main` is the same command. `--config` takes the path of a file or the name of a
configuration that comes with the package (`psgn_jax.config.recipes`).

Any field of the configuration can be given as a flag, `--config.train.steps=2000`. The same command
resumes a stopped run. Exit codes: 0 done; 2 a wrong configuration (the message names the field) or
a file that cannot be written; 3 a loss that is not finite; 4 another process of the same training
has ended; 5 a full disk; 143 stopped by SIGTERM; 130 stopped by Ctrl-C. In the last two cases, a
checkpoint has been saved, unless that took more than five seconds or a second signal came.
`system.group` describes training in several processes.
"""

import os
import pathlib
import re
import sys
from collections.abc import Sequence
from typing import Any

from absl import app, flags
from ml_collections import config_flags

from psgn_jax.commands.common import (
    define_group_flags,
    exit_on_user_error,
    keep_compiled,
    log_to_terminal,
    parse_flags,
)
from psgn_jax.config.experiment import ConfigError, check_paths, parse
from psgn_jax.config.recipes import descriptions, with_paths
from psgn_jax.data.dataset import RecordReader
from psgn_jax.system.files import check_folder
from psgn_jax.system.group import joined
from psgn_jax.system.memory import keep_freed_memory


def main(argv: Sequence[str]) -> None:
    """Checks the configuration, then trains."""
    log_to_terminal()
    values = flags.FLAGS
    with exit_on_user_error():
        if len(argv) > 1:
            raise ConfigError(f"unexpected argument {argv[1]!r}; a field is --config.NAME=VALUE")
        given = parse(_config())
        path = config_flags.get_config_filename(values["config"])
        workdir = values.workdir or os.path.join("runs", pathlib.Path(path).stem)
        check_paths(given)
        check_folder(workdir, "--workdir")
        data = given.data
        for folders, split in (
            (data.folders, data.train_split), (data.eval_folders, data.eval_split)
        ):  # fmt: skip
            if folders:
                RecordReader(folders, split)
        # Imported here so that wrong configurations and records are reported before JAX is loaded.
        keep_compiled()
        keep_freed_memory()
        from psgn_jax.commands.default_data import with_default_data
        from psgn_jax.training.loop import train

        with joined(values.coordinator, values.num_processes, values.process_id):
            outcome = train(with_default_data(given), workdir)
    if outcome.stopped_by:
        sys.exit(128 + outcome.stopped_by)


def _config() -> Any:
    """The value of `--config`; raises `ConfigError` if the file cannot be read."""
    try:
        flags.FLAGS.config.to_dict()
    except OSError as error:
        raise ConfigError(f"--config: {error}") from error
    return flags.FLAGS.config


def _parse_flags(argv: list[str]) -> list[str]:
    with exit_on_user_error():
        argv = with_paths(argv)
    if not any(re.match(r"--?(config(=|$)|help|\?)", argument) for argument in argv[1:]):
        lines = "".join(f"  {name:20} {what}\n" for name, what in descriptions().items())
        sys.stderr.write(f"error: --config is missing: a file, or one of these names\n{lines}")
        sys.exit(2)
    return parse_flags(argv)


def define_flags() -> None:
    """Defines the command's flags."""
    config_flags.DEFINE_config_file(
        "config", None, "A configuration: its path, or a name such as quickstart.", lock_config=True
    )
    flags.DEFINE_string(
        "workdir", None, "Folder of the run; default: runs/<name of the configuration file>."
    )
    define_group_flags()


if __name__ == "__main__":
    define_flags()
    app.run(main, flags_parser=_parse_flags)

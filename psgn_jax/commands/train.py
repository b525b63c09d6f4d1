"""Trains a network: `psgn train --config=base --workdir=runs/base`.

`python -m psgn_jax.main` is the same command. `--config` takes the path of a file or the name of a
configuration in the package. Every field is a flag, such as `--config.train.steps=2000`. The same
command resumes a stopped run.

Exit codes: 0 done; 2 the configuration is wrong (the message names the field) or a file cannot be
written; 3 the loss is not finite; 4 another process of the same training has ended; 5 the disk is
full; 143 stopped by SIGTERM; 130 stopped by Ctrl-C. A stopped training has saved a checkpoint,
unless the step took longer than `train.stop_seconds`, a second signal came, or Ctrl-C stopped one
of several processes.
"""

import pathlib
import sys
from collections.abc import Sequence

from psgn_jax.commands.common import define_process_flags, joined, keep_compiled
from psgn_jax.config.command_line import HELP, Flags
from psgn_jax.config.experiment import Config, check_paths, check_used, parse
from psgn_jax.config.files import descriptions, path_of
from psgn_jax.data.dataset import RecordReader
from psgn_jax.system.cpu import keep_freed_memory
from psgn_jax.system.errors import Exit
from psgn_jax.system.files import check_folder


def main(argv: Sequence[str] | None = None) -> int:
    argv = list(sys.argv[1:] if argv is None else argv)
    if not any(each.partition("=")[0] in {"--config", "-config", *HELP} for each in argv):
        sys.stderr.write(f"error: --config is missing: a file, or one of these names\n{_names()}\n")
        return Exit.ERROR
    flags = Flags("psgn train --config=FILE|NAME", __doc__, lambda: f"\nConfigurations\n{_names()}")
    flags.config(Config(), path_of)
    flags.path(
        "workdir", None, "Folder of the run; default: runs/<name of the configuration file>."
    )
    define_process_flags(flags)
    return flags.run(_main, argv)


def _names() -> str:
    return "\n".join(f"  {name:20} {what}" for name, what in descriptions().items())


def _main(flags: Flags) -> int:
    values = flags.values
    config = parse(flags.settings)
    check_used(config, flags.fields)
    stem = pathlib.Path(flags.config_file.partition(":")[0]).stem
    workdir = values.workdir or str(pathlib.Path("runs", stem))
    check_paths(config)
    check_folder(workdir, "--workdir")
    data = config.data
    if data.path:
        RecordReader(data.folders, data.train_split)
    if data.path or data.eval_path:
        RecordReader(data.eval_folders, data.eval_split)
    # JAX is loaded here, after wrong configurations and records were reported.
    keep_compiled()
    keep_freed_memory()
    import jax

    from psgn_jax.commands.default_data import ensure_default_data
    from psgn_jax.models.networks import build
    from psgn_jax.training.loop import train
    from psgn_jax.weights.opening import check_initial

    # A wrong network or `train.init` is reported before the default data set is rendered.
    build(config.model)
    if config.train.init and not pathlib.Path(workdir, "checkpoints").exists():
        check_initial(config)
    with joined(values, config.train.batch_size):
        jax.devices()
        ensure_default_data(config)
        outcome = train(config, workdir)
    return 128 + outcome.stopped_by if outcome.stopped_by else 0

"""Trained weights as files: `python -m psgn_jax.weights COMMAND`.

    python -m psgn_jax.weights list [NAME|FILE ...]
    python -m psgn_jax.weights export --workdir=RUN --out=FILE.safetensors
        [--checkpoint=best|last] [--ema|--no-ema] [--dtype=float16|float32]
        [--sources=sources.json,more.json] [--samples_before=N]

`list` shows the network, metrics, data and licences of the weights in the package, or of the given
ones. `export` writes a checkpoint of a run as a file, for `--weights=FILE` of the other commands
and for `--config.train.init=FILE`. The format is described in `psgn_jax.weights.file`. Exit codes:
0 done, 2 error, 5 disk full.
"""

import argparse
import pathlib
import sys
from collections.abc import Sequence

from psgn_jax.command_line import exit_on_user_error, log_to_terminal
from psgn_jax.weights.exporting import export_run
from psgn_jax.weights.file import DTYPES, read_weights
from psgn_jax.weights.listing import describe
from psgn_jax.weights.opening import shipped, weights_path


def main(argv: Sequence[str] | None = None) -> int:
    """The command; returns its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m psgn_jax.weights", description=(__doc__ or "").split("\n")[0]
    )
    commands = parser.add_subparsers(dest="command", required=True)
    command = commands.add_parser("list", help="show the network, metrics, data and licences")
    command.add_argument(
        "names", nargs="*", metavar="NAME|FILE", help="default: all weights in the package"
    )
    command = commands.add_parser("export", help="write a checkpoint of a run to a file of weights")
    command.add_argument("--workdir", required=True, help="folder of the run")
    command.add_argument("--out", required=True, help="file to be written, *.safetensors")
    command.add_argument("--checkpoint", default="best", choices=("best", "last"))
    command.add_argument(
        "--ema",
        default=True,
        action=argparse.BooleanOptionalAction,
        help="export the averaged parameters, if the run has them",
    )
    command.add_argument("--dtype", default="float16", choices=tuple(DTYPES))
    command.add_argument(
        "--sources", default="", help="JSON files that list data and licences, separated by commas"
    )
    command.add_argument(
        "--samples_before",
        type=int,
        default=0,
        help="training samples seen before the run, by the networks that it started from",
    )
    arguments = parser.parse_args(argv)
    log_to_terminal()
    with exit_on_user_error():
        if arguments.command == "list":
            sys.stdout.write(_list(arguments.names))
            return 0
        weights = export_run(
            arguments.workdir,
            arguments.out,
            checkpoint=arguments.checkpoint,
            averaged=arguments.ema,
            dtype=arguments.dtype,
            sources=[path for path in arguments.sources.split(",") if path],
            samples_before=arguments.samples_before,
        )
        sys.stdout.write(describe(weights, pathlib.Path(arguments.out)))
    return 0


def _list(names: Sequence[str]) -> str:
    known = list(shipped())
    if not known and not names:
        return "no weights come with this version of the package\n"
    texts = []
    for name in names or known:
        path = weights_path(name)
        is_default = bool(known) and path == shipped()[known[-1]]
        texts.append(describe(read_weights(path), path, is_default=is_default))
    return "\n".join(texts)


if __name__ == "__main__":
    sys.exit(main())

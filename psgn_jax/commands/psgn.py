"""The console script `psgn`, with one subcommand for each command of the package.

    psgn train --config=quickstart
    psgn predict photo.jpg --workdir=runs/quickstart --out=out

`psgn NAME ARGUMENTS` is the same as `python -m MODULE ARGUMENTS`. The module is imported only when
its command runs, and defines the flags, the help and the exit codes.
"""

import difflib
import runpy
import sys
from collections.abc import Mapping, Sequence
from importlib import metadata

COMMANDS: Mapping[str, str] = {
    "train": "train a network, or resume a run",
    "evaluate": "measure a run; write tables and pages",
    "predict": "predict points from image files",
    "demo": "serve a web page on this machine that predicts from photos",
    "weights": "list weights, or export those of a run",
    "export": "write a network for other programs: ONNX and StableHLO files",
    "page": "write a web page that runs a network in the browser",
    "human": "write a page on which people model objects; compare their models with networks",
    "convert": "convert published data sets to records",
    "inspect": "check a folder of records and show some samples",
    "render": "render meshes or procedural models to records",
    "free-set": "render a training set from free packages of meshes",
    "variants": "draw variants of the objects in records, for training",
    "view": "show predictions on a web page, with clouds that can be rotated",
    "spheres": "draw predictions as pictures or turntable films",
    "study": "run an experiment of the paper",
}
"""Name of each subcommand -> a description in one line."""

_ELSEWHERE = {
    "train": "psgn_jax.main",
    "inspect": "psgn_jax.commands.inspect_records",
    "render": "data_gen.render",
    "free-set": "data_gen.sets.free",
    "variants": "data_gen.sets.variants",
}


def module(name: str) -> str:
    """The module of a subcommand."""
    return _ELSEWHERE.get(name, f"psgn_jax.commands.{name}")


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a subcommand; `argv` are the arguments without the name of the program.

    Most commands end the process themselves. An exit code is returned after help or `--version`,
    after an unknown name, after Ctrl-C while a command's modules are imported, and if a command
    returns.
    """
    arguments = list(sys.argv[1:] if argv is None else argv)
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        sys.stdout.write(_help())
        return 0
    if arguments[0] == "--version":
        sys.stdout.write(f"psgn_jax {metadata.version('psgn-jax')}\n")
        return 0
    name, *rest = arguments
    if name not in COMMANDS:
        near = difflib.get_close_matches(name, COMMANDS, 1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        sys.stderr.write(
            f"error: psgn {name}: no such command; {hint}expected one of {', '.join(COMMANDS)}\n"
        )
        return 2
    sys.argv = [f"psgn {name}", *rest]
    try:
        # Run as the main module, because worker processes import it by that name.
        runpy.run_module(module(name), run_name="__main__", alter_sys=True)
    except SystemExit as stopped:
        if stopped.code == 1 and _HELP.intersection(rest):  # absl exits with 1 after its help
            return 0
        raise
    except KeyboardInterrupt:  # while the command's modules were being imported
        sys.stderr.write("stopped by Ctrl-C\n")
        return 130
    return 0


_HELP = frozenset({"--help", "--helpshort", "--helpfull"})


def _help() -> str:
    width = max(map(len, COMMANDS))
    lines = "".join(f"  {name:{width}}  {summary}\n" for name, summary in COMMANDS.items())
    return (
        f"usage: psgn COMMAND [arguments]\n\n{lines}"
        "\n`psgn COMMAND --help` shows the arguments of a command.\n"
    )


if __name__ == "__main__":
    sys.exit(main())

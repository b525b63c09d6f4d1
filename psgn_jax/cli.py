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
from typing import NamedTuple


class Command(NamedTuple):
    """A subcommand: its module, and a description in one line."""

    module: str
    summary: str


COMMANDS: Mapping[str, Command] = {
    "train": Command("psgn_jax.main", "train a network, or resume a run"),
    "evaluate": Command("psgn_jax.evaluate", "measure a run; write tables and pages"),
    "predict": Command("psgn_jax.predict", "predict points from image files"),
    "demo": Command("psgn_jax.demo", "serve a web page on this machine that predicts from photos"),
    "weights": Command("psgn_jax.weights.__main__", "list weights, or export those of a run"),
    "export": Command(
        "psgn_jax.export_network", "write a network for other programs: ONNX and StableHLO files"
    ),
    "page": Command(
        "psgn_jax.page.__main__", "write a web page that runs a network in the browser"
    ),
    "human": Command(
        "psgn_jax.human.__main__",
        "write a page on which people model objects; compare their models with networks",
    ),
    "convert": Command("psgn_jax.convert", "convert published data sets to records"),
    "inspect": Command("psgn_jax.inspect", "check a folder of records and show some samples"),
    "render": Command("data_gen.render", "render meshes or procedural models to records"),
    "free-set": Command("data_gen.sets.free", "render a training set from free packages of meshes"),
    "view": Command(
        "psgn_jax.viewing.page", "show predictions on a web page, with clouds that can be rotated"
    ),
    "spheres": Command(
        "psgn_jax.viewing.spheres", "draw predictions as pictures or turntable films"
    ),
}
"""Name -> command."""

STUDIES: Mapping[str, Command] = {
    "mean_shape": Command("psgn_jax.experiments.mean_shape", "mean shapes under CD and EMD"),
    "completion": Command("psgn_jax.experiments.completion", "RGB against RGB-D input"),
    "ambiguity": Command(
        "psgn_jax.experiments.ambiguity", "several predictions for one image: Mo2, Mo8, cVAE"
    ),
    "networks": Command(
        "psgn_jax.experiments.networks", "vanilla, two-branch and hourglass networks"
    ),
    "branches": Command("psgn_jax.experiments.branches", "the points of each branch of a network"),
    "losses": Command("psgn_jax.experiments.losses", "training by CD against training by EMD"),
    "comparison": Command(
        "psgn_jax.experiments.comparison", "predicted volumes, compared with 3D-R2N2"
    ),
}
"""Name -> study, for `psgn study NAME`."""


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
    if name != "study":
        return _run("psgn", name, {**COMMANDS, "study": _STUDY}, rest)
    if not rest or rest[0] in ("-h", "--help"):
        sys.stdout.write("usage: psgn study NAME [arguments]\n\n" + _list(STUDIES))
        return 0
    return _run("psgn study", rest[0], STUDIES, rest[1:])


_HELP = frozenset({"--help", "--helpshort", "--helpfull"})
_STUDY = Command("", "run an experiment of the paper; `psgn study --help` lists them")


def _run(program: str, name: str, commands: Mapping[str, Command], arguments: list[str]) -> int:
    if name not in commands:
        near = difflib.get_close_matches(name, commands, 1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        sys.stderr.write(
            f"error: {program} {name}: no such command; {hint}expected one of "
            f"{', '.join(commands)}\n"
        )
        return 2
    module = commands[name].module
    sys.argv = [f"{program} {name}", *arguments]
    try:
        # Run as the main module, because worker processes import it by that name.
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    except SystemExit as stopped:
        if stopped.code == 1 and _HELP.intersection(arguments):  # absl exits with 1 after its help
            return 0
        raise
    except KeyboardInterrupt:  # while the command's modules were being imported
        sys.stderr.write("stopped by Ctrl-C\n")
        return 130
    return 0


def _help() -> str:
    return (
        "usage: psgn COMMAND [arguments]\n\n"
        + _list({**COMMANDS, "study": _STUDY})
        + "\n`psgn COMMAND --help` shows the arguments of a command.\n"
    )


def _list(commands: Mapping[str, Command]) -> str:
    width = max(map(len, commands))
    return "".join(f"  {name:{width}}  {c.summary}\n" for name, c in commands.items())


if __name__ == "__main__":
    sys.exit(main())

"""The console script `psgn`; it imports the module of a subcommand only to run it."""

import importlib
import os
import sys
from collections.abc import Mapping, Sequence

from psgn_jax import __version__
from psgn_jax.system.errors import Exit, exit_code_of
from psgn_jax.system.terminal import nothing_reads_output, start_command

COMMANDS: Mapping[str, str] = {
    "train": "train a network, or resume a run",
    "evaluate": "measure a run; write tables and pages",
    "predict": "predict points from image files",
    "weights": "list weights, or export those of a run",
    "export": "write a network for other programs: ONNX files",
    "page": "write a web page that runs a network in the browser",
    "human": "write a page on which people model objects; compare their models with networks",
    "convert": "convert published data sets to records",
    "inspect": "check a folder of records and show some samples",
    "render": "render meshes or procedural models to records",
    "view": "show predictions on a web page, with clouds that can be rotated",
    "spheres": "draw predictions as pictures or turntable films",
    "study": "run an experiment of the paper",
}
"""Subcommand -> description."""


def module(name: str) -> str:
    return f"psgn_jax.commands.{'inspect_records' if name == 'inspect' else name}"


def main(argv: Sequence[str] | None = None) -> int:
    """Runs a subcommand and returns its exit code.

    Without `argv`, as the console script, it takes the arguments of the process and prepares the
    process (`terminal.start_command`).
    """
    if argv is None:
        start_command()
    try:
        code = _run(list(sys.argv[1:] if argv is None else argv))
        if not code:
            sys.stdout.flush()
    except KeyboardInterrupt:  # during the imports of the command's module
        sys.stderr.write("stopped by Ctrl-C\n")
        code = Exit.CTRL_C
    except OSError as error:  # stdout is a full disk, or a pipe that nothing reads
        code = Exit.CLOSED_PIPE if nothing_reads_output() else exit_code_of(error) or Exit.ERROR
        if code != Exit.CLOSED_PIPE:
            sys.stderr.write(f"error: {error.strerror or error}\n")
    try:
        sys.stdout.flush()
    except OSError:  # Python would flush again at its exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if argv is None and code == Exit.CTRL_C:
        os._exit(code)  # after an interrupted compilation, jaxlib may crash at Python's exit
    return code


def _run(arguments: Sequence[str]) -> int:
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        sys.stdout.write(_help())
        return 0
    if arguments[0] == "--version":
        sys.stdout.write(f"psgn_jax {__version__}\n")
        return 0
    name, *rest = arguments
    if name not in COMMANDS:
        from psgn_jax.config.structured import suggestion

        sys.stderr.write(
            f"error: psgn {name}: no such command; {suggestion(name, COMMANDS)}expected one of "
            f"{', '.join(COMMANDS)}\n"
        )
        return Exit.ERROR
    code: int = importlib.import_module(module(name)).main(rest)
    return code


def _help() -> str:
    width = max(map(len, COMMANDS))
    lines = "".join(f"  {name:{width}}  {summary}\n" for name, summary in COMMANDS.items())
    return (
        f"usage: psgn COMMAND [arguments]\n\n{lines}"
        "\n`psgn COMMAND --help` shows the arguments of a command.\n"
    )


if __name__ == "__main__":
    sys.exit(main())

"""Settings of a command's process, and child processes that cannot import from the current folder.

Python puts the current folder first on the import path of `python -m` and `python -c`. Files from
others are data, so a `numpy.py` beside a mesh must not run in the children of a command.
"""

import io
import logging
import os
import pathlib
import sys
from typing import Any

ROOT = pathlib.Path(__file__).resolve().parents[2]
"""The folder that contains the packages `psgn_jax` and `data_gen`."""


def python(module: str, *arguments: str) -> list[str]:
    """The command that runs a module of this package; start it with `environment`."""
    return [sys.executable, "-P", "-m", module, *arguments]


def environment(**changes: str) -> dict[str, str]:
    """The environment of a child process: this one's, with an import path of absolute folders.

    It holds for Python processes at any depth, also for those that libraries start.
    """
    given = os.environ.get("PYTHONPATH", "").split(os.pathsep)
    paths = [str(ROOT), *(path for path in given if os.path.isabs(path))]
    return {
        **os.environ,
        **changes,
        "PYTHONSAFEPATH": "1",
        "PYTHONPATH": os.pathsep.join(dict.fromkeys(paths)),
    }


def start_command() -> None:
    """Changes this process for a command; only its entry point calls this, once.

    Its children import from absolute folders only. XLA's and CUDA's native code logs only fatal
    errors, unless TF_CPP_MIN_LOG_LEVEL is set: when XLA loads a program from the compilation cache
    on a CPU, it wrongly warns, in 3,000 characters, that the processor lacks two features, which
    are tuning flags of XLA. The variable has no effect once jaxlib has been imported.

    A closed stdout or stderr (`psgn ... >&-`) takes everything, and a name that the encoding of
    stdout lacks is escaped, as on stderr.
    """
    os.environ.update(environment())
    os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "3")
    quiet_orbax()
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def quiet_orbax() -> None:
    """Suppresses messages about errors that are raised as well; only commands call this.

    It changes the loggers and `sys.unraisablehook` of this process. If a checkpoint cannot be read
    or written, `weights.checkpoint` raises an error. Orbax's threads log it too, with a stack
    trace. If one array fails, orbax closes its event loop while operations on other arrays are
    pending. When such an operation ends, Python prints an exception, "Event loop is closed". If an
    operation has failed before the loop was closed, asyncio logs that its exception was never
    retrieved.
    """
    for name in ("absl", "asyncio"):
        logging.getLogger(name).addFilter(_is_news)  # adding it again has no effect
    before = sys.unraisablehook

    def ignore_closed_loops(unraisable: Any) -> None:
        if str(unraisable.exc_value) != "Event loop is closed":
            before(unraisable)

    sys.unraisablehook = ignore_closed_loops


def _is_news(record: logging.LogRecord) -> bool:
    message = record.getMessage()
    of_tensorstore = "tensorstore_spec" in message or "OCDBT database" in message
    if of_tensorstore and "exception was never retrieved" in message:
        return False
    return not (record.exc_info and f"{os.sep}orbax{os.sep}" in record.pathname)

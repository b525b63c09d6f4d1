"""Settings of a command's process, and child processes that cannot import from the current folder.

Python puts the current folder first on the import path of `python -m` and `python -c`. Files from
others are data, so a `numpy.py` beside a mesh must not run in the children of a command.
"""

import contextlib
import io
import logging
import os
import pathlib
import resource
import select
import sys
from typing import Any

from absl import logging as absl_logging

ROOT = pathlib.Path(__file__).resolve().parents[2]
"""The folder that contains the packages `psgn_jax` and `data_gen`."""


def python(module: str, *arguments: str) -> list[str]:
    """The command that runs a module of this package; start it with `environment`."""
    return [sys.executable, "-P", "-m", module, *arguments]


def environment(**changes: str) -> dict[str, str]:
    """The environment of a child process and its children: import paths are absolute folders."""
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

    Its children import from absolute folders only. A closed stdout or stderr (`psgn ... >&-`) takes
    everything, and characters that the encoding of stdout lacks are escaped, as on stderr. A reader
    keeps its shards open, and some systems allow only 256 open files, so we raise this limit.
    """
    os.environ.update(environment())
    # After a kill, the process that removes what our workers shared would warn that it does so.
    warned = [os.environ.get("PYTHONWARNINGS", ""), "ignore:resource_tracker:UserWarning"]
    os.environ["PYTHONWARNINGS"] = ",".join(dict.fromkeys(filter(None, warned)))
    # Before jaxlib is imported: XLA and CUDA log only fatal errors. When XLA loads a program from
    # the compilation cache on a CPU, it wrongly warns that the processor lacks two features. Jax
    # sets 1 for itself and, unasked, for the commands that its process starts.
    if os.environ.get("TF_CPP_MIN_LOG_LEVEL", "1") == "1":
        os.environ["TF_CPP_MIN_LOG_LEVEL"] = "3"
    quiet_orbax()
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    with contextlib.suppress(OSError, ValueError):  # macOS accepts no more than 10,240
        resource.setrlimit(resource.RLIMIT_NOFILE, (max(soft, min(hard, 10_240)), hard))
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def nothing_reads_output() -> bool:
    """Whether stdout is a pipe whose reader has ended, as of `psgn ... | head -1`."""
    asked = select.poll()
    with contextlib.suppress(OSError, ValueError):  # it has no descriptor
        asked.register(sys.stdout.fileno(), 0)
        return bool(asked.poll(0))
    return False


def quiet_orbax() -> None:
    """Suppresses messages about errors that are raised as well; only commands call this.

    If a checkpoint cannot be read or written, `weights.checkpoint` raises an error, and orbax's
    threads log it too, with a stack trace. If one array fails, orbax closes its event loop: Python
    then prints "Event loop is closed" for the operations that are still pending, and asyncio logs
    that exceptions of others were never retrieved.
    """
    for logger in (absl_logging.get_absl_logger(), logging.getLogger("asyncio")):
        logger.addFilter(_is_news)  # adding it again has no effect
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

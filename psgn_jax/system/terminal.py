"""Settings of a command's process: output, log, limits, messages of other packages."""

import contextlib
import gc
import io
import logging
import os
import resource
import select
import sys
from typing import Any

from absl import flags
from absl import logging as absl_logging

from psgn_jax.system.processes import ROOT, environment
from psgn_jax.system.untrusted import one_line


def start_command() -> None:
    """Prepares this process for a command; only the entry point calls this, once.

    - Child processes import from absolute folders only.
    - A closed stdout or stderr (`psgn ... >&-`) is replaced by the null device. Characters that the
      encoding of stdout lacks are escaped, as on stderr.
    - The limit of open files is raised, because readers keep their shards open, and some systems
      allow only 256.
    - Garbage is collected less often: imports and JAX's tracing make many objects and few cycles.
    """
    gc.set_threshold(10_000)
    os.environ.update(environment())
    # After a kill, the resource tracker would warn when it removes the workers' shared memory.
    warned = [os.environ.get("PYTHONWARNINGS", ""), "ignore:resource_tracker:UserWarning"]
    os.environ["PYTHONWARNINGS"] = ",".join(dict.fromkeys(filter(None, warned)))
    # XLA and CUDA log only fatal errors; this must be set before jaxlib is imported. When XLA loads
    # a program from the compilation cache on a CPU, it wrongly warns that the processor lacks two
    # features. The value 1 may come from JAX in a parent process.
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
    """Whether stdout is a pipe whose reader has ended, as in `psgn ... | head -1`."""
    asked = select.poll()
    with contextlib.suppress(OSError, ValueError):  # stdout has no descriptor
        asked.register(sys.stdout.fileno(), 0)
        return bool(asked.poll(0))
    return False


def quiet_orbax() -> None:
    """Suppresses orbax's messages about errors that are raised as well; only commands call this.

    If a checkpoint cannot be read or written, `weights.checkpoint` raises an error, and orbax's
    threads also log it with a stack trace. If one array fails, orbax closes its event loop. Python
    then prints "Event loop is closed" for pending operations, and asyncio logs that exceptions were
    never retrieved.
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


def log_to_terminal() -> None:
    """Logs to stderr: all messages of this package and `data_gen`, warnings of other packages."""
    absl_logging.use_absl_handler()
    if not flags.FLAGS.is_parsed():  # absl would warn
        flags.FLAGS.mark_as_parsed()
    absl_logging.set_verbosity(absl_logging.INFO)
    absl_logging.set_stderrthreshold(absl_logging.INFO)
    handler = absl_logging.get_absl_handler()
    handler.setFormatter(_OneLine("%(asctime)s %(message)s", "%H:%M:%S"))
    handler.addFilter(_is_ours_or_warns)  # once, however often this is called


_OURS = tuple(f"{ROOT / name}{os.sep}" for name in ("psgn_jax", "data_gen"))


def _is_ours_or_warns(record: logging.LogRecord) -> bool:
    return record.levelno >= logging.WARNING or os.path.realpath(record.pathname).startswith(_OURS)


class _OneLine(logging.Formatter):
    """Escapes control characters in messages; tracebacks keep their lines."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802
        record.message = one_line(record.message)
        return super().formatMessage(record)

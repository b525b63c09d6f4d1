"""Suppresses messages about errors that are raised as well, for commands.

If a checkpoint cannot be read or written, `weights.checkpoint` raises an error. Orbax's threads log
it too, with a stack trace. If one array fails, orbax closes its event loop while operations on
other arrays are pending. When such an operation ends, Python prints an exception, "Event loop is
closed". If an operation has failed before the loop was closed, asyncio logs that its exception was
never retrieved.
"""

import logging
import os
import sys
from typing import Any


def quiet_orbax() -> None:
    """Changes the loggers and `sys.unraisablehook` of this process; only commands call this."""
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

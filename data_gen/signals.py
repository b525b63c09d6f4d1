"""SIGTERM and Ctrl-C as an exception, for the commands."""

import signal
from typing import Any


class StoppedError(Exception):
    """A signal asked for the end."""

    def __init__(self, number: int) -> None:
        super().__init__(f"stopped by signal {number}")
        self.number = number


def _stop(number: int, frame: Any) -> None:
    raise StoppedError(number)


def stop_on_signals() -> None:
    """Makes SIGTERM and Ctrl-C raise `StoppedError` from now on."""
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, _stop)

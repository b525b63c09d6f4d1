"""Turns SIGTERM and Ctrl-C into an exception, for the commands."""

import signal
from typing import Any


class StoppedError(Exception):
    """A signal asked the process to stop."""

    def __init__(self, number: int) -> None:
        super().__init__(f"stopped by signal {number}")
        self.number = number


def _stop(number: int, frame: Any) -> None:
    raise StoppedError(number)


def stop_on_signals() -> None:
    """Makes SIGTERM and Ctrl-C raise `StoppedError` from now on."""
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, _stop)

"""Handles SIGTERM and SIGINT: they end training after the current step."""

import signal
from types import FrameType
from typing import Any


class Stopped(Exception):  # noqa: N818 - not an error
    """A signal arrived during an evaluation."""


class StopSignal:
    """Context that records SIGTERM or SIGINT; a second signal has its usual effect."""

    def __init__(self) -> None:
        self.signal: int | None = None
        self._old: dict[int, Any] = {}

    def __enter__(self) -> "StopSignal":
        try:
            for number in (signal.SIGTERM, signal.SIGINT):
                self._old[number] = signal.signal(number, self._handle)
        except ValueError:  # not in the main thread, where signals cannot be handled
            pass
        return self

    def __exit__(self, *_: object) -> None:
        self._restore()

    @property
    def arrived(self) -> bool:
        """Whether this process has received a signal."""
        return bool(self.signal)

    def check(self, *_: object) -> None:
        """Raises `Stopped` if a signal has arrived."""
        if self.arrived:
            raise Stopped

    def after_step(self) -> None:
        """Does nothing for a single process; `processes.SharedStop` overrides it."""

    def settle(self) -> None:
        """Does nothing for a single process; `processes.SharedStop` overrides it."""

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self.signal = number
        self._restore()

    def _restore(self) -> None:
        for number, handler in self._old.items():
            signal.signal(number, handler)
        self._old = {}

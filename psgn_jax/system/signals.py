"""Handlers of SIGTERM and SIGINT: training ends after the current step, other work at once."""

import contextlib
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any, NoReturn


class Stopped(Exception):  # noqa: N818 - not an error
    """A signal arrived during an evaluation."""


class StopSignal:
    """Context that records SIGTERM or SIGINT in `signal`.

    If the context is still open `seconds` after the signal, `last` is called and the process ends
    with the exit code 128 + the signal's number. A second signal ends it at once. A thread receives
    the signals: Python runs handlers in the main thread, which may wait for a compilation or a long
    step.
    """

    def __init__(self, seconds: float, last: Callable[[], None] = lambda: None) -> None:
        self.signal: int | None = None  # number of the received signal
        self.lock = threading.Lock()  # while it is held, the process does not end
        self._seconds, self._last = seconds, last
        self._old: dict[int, Any] = {}

    def __enter__(self) -> "StopSignal":
        if threading.current_thread() is not threading.main_thread():
            return self  # only the main thread can set handlers
        self._receiver, self._sender = socket.socketpair()
        self._sender.setblocking(False)
        self._old_descriptor = signal.set_wakeup_fd(self._sender.fileno())
        for number in (signal.SIGTERM, signal.SIGINT):
            self._old[number] = signal.signal(number, lambda *_: None)
        self._watcher = threading.Thread(target=self._watch, daemon=True)
        self._watcher.start()
        return self

    def __exit__(self, *_: object) -> None:
        if not self._old:
            return
        with self.lock:
            signal.set_wakeup_fd(self._old_descriptor)
            for number, handler in self._old.items():
                signal.signal(number, handler)
            self._old = {}
        self._sender.close()
        self._watcher.join()
        self._receiver.close()

    def check(self, *_: object) -> None:
        """Raises `Stopped` if a signal has arrived."""
        if self.signal:
            raise Stopped

    def after_step(self, step: int) -> None:
        """See `distributed.SharedStop`."""

    def _watch(self) -> None:
        if not (received := self._receiver.recv(1)):
            return  # the context has ended
        self.signal = received[0]
        self._receiver.settimeout(min(max(self._seconds, 1e-3), 1e6))  # 0 would not wait
        try:
            again = self._receiver.recv(1)
        except TimeoutError:
            threading.Thread(target=self._end_in_order, daemon=True).start()
            self._receiver.settimeout(None)
            again = self._receiver.recv(1)
        if again:
            self._end()

    def _end_in_order(self) -> None:
        with self.lock:
            with contextlib.suppress(Exception):  # the process ends in any case
                self._last()
            if self._old:  # the context is still open
                self._end()

    def _end(self) -> NoReturn:
        number = self.signal or signal.SIGTERM
        os.write(
            2,
            f"stopped by {signal.Signals(number).name} without waiting for the current step; run "
            "the same command again to resume from the newest checkpoint\n".encode(),
        )
        os._exit(128 + number)


def exit_on_signals() -> None:
    """Makes SIGTERM and Ctrl-C end this process with code 143 or 130."""
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, _exit)


def _exit(number: int, frame: FrameType | None) -> None:
    name = signal.Signals(number).name
    sys.stderr.write(f"stopped by {name}; run the same command again to resume\n")
    sys.exit(128 + number)

"""Starts the loader's worker processes, which the training process ends.

Batch systems and terminals send SIGTERM and SIGINT to every process of a group. Workers block both
signals, because the training process needs them until its last step. If it is killed, they end,
too.
"""

import atexit
import concurrent.futures
import multiprocessing
import multiprocessing.connection
import os
import signal
import sys
import threading
import weakref
from collections.abc import Callable
from multiprocessing import resource_tracker
from multiprocessing.process import BaseProcess
from typing import TypeVar

T = TypeVar("T")

_started: weakref.WeakSet[BaseProcess] = weakref.WeakSet()


def start_sheltered(start: Callable[[], T]) -> T:
    """Calls `start`; the processes that it starts never receive SIGTERM or SIGINT.

    `start` runs in a thread that blocks both signals. New processes and threads inherit this before
    they run any code. This process still handles signals as usual.
    """
    # At Python's exit, workers are killed before Python sends them SIGTERM and waits.
    atexit.unregister(_kill_workers)
    atexit.register(_kill_workers)
    # If the tracker started later, it would unblock the signals of the thread that starts it.
    resource_tracker.ensure_running()
    others = set(multiprocessing.active_children())
    try:
        with concurrent.futures.ThreadPoolExecutor(1, initializer=_block_signals) as pool:
            return pool.submit(start).result()
    finally:
        _started.update(set(multiprocessing.active_children()) - others)


def check_main_guard() -> None:
    """Ends a worker process that would train because it imports the main script."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        sys.exit(
            "error: a script with data.num_workers > 0 must train inside "
            '`if __name__ == "__main__":`, because each worker process imports it'
        )


def end_with_parent(*_: int) -> None:
    """In a worker: ends this process as soon as its parent has ended."""

    def wait() -> None:
        if parent := multiprocessing.parent_process():
            # `sentinel` is ready when the parent has ended. (PR_SET_PDEATHSIG would act at the end
            # of the parent's *thread*.)
            multiprocessing.connection.wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


def _block_signals() -> None:
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM, signal.SIGINT})


def _kill_workers() -> None:
    for worker in _started:
        worker.kill()

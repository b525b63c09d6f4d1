"""Starts the loader's worker processes, which end only with, or by, their training process.

Batch systems and terminals send SIGTERM and SIGINT to every process of a group. Workers block both
signals, because the training process stops them after its last step. A worker whose training
process was killed ends by itself.
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

    `start` is called in a thread that blocks both signals. New processes and threads inherit the
    blocked signals before they run any code. This process still handles signals as usual.
    """
    # Remaining workers end before Python, at its exit, sends them SIGTERM and waits.
    atexit.unregister(_kill_workers)
    atexit.register(_kill_workers)
    # A tracker that is started later would unblock the signals of the thread that starts it.
    resource_tracker.ensure_running()
    others = set(multiprocessing.active_children())
    try:
        with concurrent.futures.ThreadPoolExecutor(1, initializer=_block_signals) as pool:
            return pool.submit(start).result()
    finally:
        _started.update(set(multiprocessing.active_children()) - others)


def check_main_guard() -> None:
    """Ends a worker process that trains because it imports the main script, with a message."""
    if getattr(multiprocessing.current_process(), "_inheriting", False):
        sys.exit(
            "error: a script with data.num_workers > 0 must train inside "
            '`if __name__ == "__main__":`, because each worker process imports it'
        )


def end_with_parent(*_: int) -> None:
    """In a worker: ends this process as soon as its parent has ended, whatever it is doing."""

    def wait() -> None:
        if parent := multiprocessing.parent_process():
            # `sentinel` becomes ready when the parent ends, and is ready if it has ended already.
            # (PR_SET_PDEATHSIG would act at the end of the parent's *thread*.)
            multiprocessing.connection.wait([parent.sentinel])
            os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


def _block_signals() -> None:
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM, signal.SIGINT})


def _kill_workers() -> None:
    for worker in _started:
        worker.kill()

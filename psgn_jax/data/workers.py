"""Ends the loader's worker processes when the training is stopped or killed.

Batch systems and terminals send SIGTERM and SIGINT to every process of a group. Workers block both
signals, because the training process stops them after its last step. A worker whose training
process was killed ends by itself. After the last worker has ended, Python's resource tracker frees
the workers' shared memory. The tracker does not belong to the group, so it also does this after a
SIGKILL of the whole group. Only a block of shared memory that a worker is creating at that moment
can remain.
"""

import concurrent.futures
import multiprocessing
import multiprocessing.connection
import multiprocessing.util
import os
import signal
import subprocess
import threading
from collections.abc import Callable, Sequence
from multiprocessing import resource_tracker
from typing import Any, TypeVar

from psgn_jax.system import processes

T = TypeVar("T")


def start_sheltered(start: Callable[[], T]) -> T:
    """Calls `start`; the processes that it starts never receive SIGTERM or SIGINT.

    `start` is called in a thread that blocks both signals. New processes and threads inherit the
    blocked signals before they run any code. This process still handles signals as usual.
    """
    # A tracker that is started later would unblock the signals of the thread that starts it.
    _start_tracker()
    # At exit, Python sends SIGTERM to the remaining workers and waits for their end. The workers
    # block SIGTERM, so they are killed before that.
    multiprocessing.util.Finalize(None, _kill_children, exitpriority=0)
    with concurrent.futures.ThreadPoolExecutor(1, initializer=_block_signals) as pool:
        return pool.submit(start).result()


def end_with_parent(*_: int) -> None:
    """In a worker: ends this process as soon as its parent has ended, whatever it is doing."""
    threading.Thread(target=_wait_for_parent, daemon=True).start()


def _wait_for_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        # `sentinel` becomes ready when the parent ends, and is ready if it has ended already.
        # (PR_SET_PDEATHSIG would act at the end of the parent's *thread*.)
        multiprocessing.connection.wait([parent.sentinel])
        os._exit(1)


def _start_tracker() -> None:
    """Starts Python's resource tracker, if it is not running, in a session of its own."""
    util: Any = multiprocessing.util
    before = util.spawnv_passfds
    util.spawnv_passfds = _spawn_in_session
    try:
        resource_tracker.ensure_running()
    finally:
        util.spawnv_passfds = before


def _spawn_in_session(path: bytes, arguments: Sequence[str], files: Sequence[int]) -> int:
    """`multiprocessing.util.spawnv_passfds`, in a new session.

    After a SIGKILL, the tracker frees the shared memory and would warn about each block.
    """
    process = subprocess.Popen(
        arguments, executable=path, pass_fds=files, start_new_session=True,
        stderr=subprocess.DEVNULL, env=processes.environment(),
    )  # fmt: skip
    process.returncode = 0  # the caller of this function waits for the process
    return process.pid


def _block_signals() -> None:
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM, signal.SIGINT})


def _kill_children() -> None:
    for child in multiprocessing.active_children():
        if child.daemon:
            child.kill()

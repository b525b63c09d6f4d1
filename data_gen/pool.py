"""Rendering processes, which may crash, and a pool of them on this machine.

A `Renderer` runs a process, `python -m data_gen.pool FD`, that communicates by the open pipe with
this file descriptor. `render_local` uses `job.workers` renderers on this machine,
`data_gen.cluster` a renderer for each worker thread of a Dask cluster.
"""

import concurrent.futures
import contextlib
import multiprocessing.connection
import os
import pathlib
import queue
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Generator, Sequence
from typing import Any

from data_gen import engine
from data_gen.catalogues.entry import Entry
from data_gen.render_model import Context, line_of, render_model
from psgn_jax.data.shards import Result
from psgn_jax.system import processes
from psgn_jax.system.cores import num_cores

_ATTEMPTS = 2  # at a model whose process dies, perhaps for another reason
_FAILED_STARTS = 3  # after so many failed starts, no model can be the cause
_SECONDS_TO_START = 300.0
_SECONDS_IDLE = 600.0

Pool = Callable[[Sequence[tuple[int, Entry]], Context], Generator[Result]]
"""Renders numbered models in any order.

A failing model does not stop the pool. RuntimeError if no process can start."""


class Renderer:
    """Renders models in a separate process, within the limits of the job's settings.

    The process starts with the first model. We replace it when it dies, exceeds a limit or has
    rendered `models_per_worker` models. We do not use `multiprocessing`, whose daemonic processes,
    such as cluster workers, may not start children.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Any = None
        self._done = 0
        self._killed = False

    def render(self, number: int, entry: Entry) -> Result:
        """Renders a model; once more if the process dies.

        Statuses in addition to those of `render_model`: "error", "crashed", "timeout", "memory".

        Raises:
          RuntimeError: the processes end before they are ready.
        """
        for _ in range(_ATTEMPTS):
            line, records = self._render_once(entry)
            if line["status"] != "crashed":
                break
        return Result(number, line, {entry.split: records})

    def _render_once(self, entry: Entry) -> tuple[dict[str, Any], list[bytes]]:
        # An idle process ends after `_SECONDS_IDLE`.
        if self._process is not None and self._process.poll() is not None:
            self._discard()
        if self._process is None:
            self._start()
        options = self._context.settings.job
        started = time.monotonic()
        try:
            self._connection.send(entry)
            while not self._connection.poll(0.5):
                if self._megabytes() > options.megabytes_per_worker:
                    what = f"over {options.megabytes_per_worker} MB of memory"
                    return self._lost(entry, "memory", what)
                if time.monotonic() - started > options.seconds_per_model:
                    return self._lost(entry, "timeout", f"over {options.seconds_per_model:g} s")
            line, records = self._connection.recv()
        except (EOFError, OSError):
            return self._lost(entry, "crashed", "")
        self._done += 1
        if self._done >= options.models_per_worker:
            self.end()
        return line, records

    def end(self) -> None:
        if self._process is not None:
            with contextlib.suppress(OSError):
                self._connection.send(None)
        self._discard()

    def kill(self) -> None:
        """Kills the process and ends the renderer, also while another thread is in `render`."""
        self._killed = True
        if (process := self._process) is not None:
            process.kill()

    def _start(self) -> None:
        for _ in range(_FAILED_STARTS):
            if self._killed:
                raise RuntimeError("the renderer was ended")
            ours, theirs = multiprocessing.connection.Pipe()
            threads = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
            with theirs:
                self._process = subprocess.Popen(
                    processes.python("data_gen.pool", str(theirs.fileno())),
                    pass_fds=[theirs.fileno()],
                    stdin=subprocess.DEVNULL,
                    env={**dict.fromkeys(threads, "1"), **self._context.variant.environment()},
                )
            if self._killed:
                self._process.kill()
            self._connection, self._done = ours, 0
            try:
                ours.send(self._context)
                if ours.poll(_SECONDS_TO_START):
                    ours.recv()
                    return
                self._process.kill()
                self._discard()
                why = f"were not ready after {_SECONDS_TO_START:g} s; is the machine busy?"
            except (EOFError, OSError):
                why = f"ended before they were ready (exit code {self._discard()})"
                why += "; job.variant='scalar' needs no LLVM"
        raise RuntimeError(f"{_FAILED_STARTS} worker processes {why}")

    def _discard(self) -> int | None:
        """Waits for the end of the process, or kills it. Returns the exit code."""
        process, connection = self._process, self._connection
        self._process = self._connection = None
        if process is None:
            return None
        # If it is ending, its exit code says more than the exit code of a kill.
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(10)
        process.kill()
        connection.close()
        return process.wait()

    def _lost(self, entry: Entry, status: str, reason: str) -> tuple[dict[str, Any], list[bytes]]:
        if status != "crashed" and self._process is not None:
            self._process.kill()
        code = self._discard()
        return line_of(entry, status, reason or f"exit code {code}"), []

    def _megabytes(self) -> float:
        """Resident memory of the process; 0 = unknown."""
        try:
            assert self._process is not None
            statm = pathlib.Path(f"/proc/{self._process.pid}/statm").read_text()
            return int(statm.split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
        except (OSError, ValueError, IndexError):
            return 0.0


def render_local(tasks: Sequence[tuple[int, Entry]], context: Context) -> Generator[Result]:
    """Renders models in processes on this machine, by default one per core; see `Pool`."""
    count = min(context.settings.job.workers or num_cores(), len(tasks))
    renderers = [Renderer(context) for _ in range(count)]
    idle: queue.SimpleQueue[Renderer] = queue.SimpleQueue()
    for renderer in renderers:
        idle.put(renderer)

    def render(number: int, entry: Entry) -> Result:
        renderer = idle.get()
        try:
            return renderer.render(number, entry)
        finally:
            idle.put(renderer)

    with concurrent.futures.ThreadPoolExecutor(count) as threads:
        # We keep no list of the futures, which hold the samples.
        done = concurrent.futures.as_completed([threads.submit(render, *task) for task in tasks])
        try:
            for future in done:
                yield future.result()
            for renderer in renderers:
                renderer.end()
        except BaseException:
            threads.shutdown(wait=False, cancel_futures=True)
            for renderer in renderers:
                renderer.kill()
            raise


def _serve(connection: multiprocessing.connection.Connection) -> None:
    """Receives a `Context` and sends None when ready. Then receives entries, sends (line, records).

    It ends at None, or after `_SECONDS_IDLE`; the end of the connection is an error.
    """
    # All processes of a terminal receive Ctrl-C; the `Renderer` ends this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    context: Context = connection.recv()
    engine.start(context.variant.name)
    connection.send(None)  # ready
    while connection.poll(_SECONDS_IDLE):
        if (entry := connection.recv()) is None:
            return
        try:
            records, line = render_model(entry, context)
        except Exception as error:
            # Other models may succeed.
            what = f"{type(error).__name__}: {error}".splitlines()[0][:300]
            records, line = [], line_of(entry, "error", what)
        connection.send((line, records))
        del records
        engine.release()


if __name__ == "__main__":
    # The connection ends if the process of the `Renderer` is killed.
    _ended = contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError)
    with _ended, multiprocessing.connection.Connection(int(sys.argv[1])) as _pipe:
        _serve(_pipe)

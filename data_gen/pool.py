"""Processes that render models and may die, and a pool of them on this machine.

A `Renderer` is one process and whoever watches it: it takes a model at a time and comes back with
its samples, or with what became of the process. `render_local` does a job's models with as many of
them as there are processors; `data_gen.cluster` does it with those of a Dask cluster.
"""

import collections
import contextlib
import multiprocessing.connection
import os
import pathlib
import queue
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

from data_gen import ROOT
from data_gen.catalogues.entry import Entry
from data_gen.render_model import Context
from data_gen.results import failure, pack_result

ATTEMPTS = 2
"""A model whose process died is tried once more, in a fresh one: it may have been the process."""

# Processes of one renderer that die before they have rendered anything: then it is not the models.
_STILLBORN = 3
_SECONDS_TO_START = 300.0


class Result(NamedTuple):
    """What became of one model: its number, its line, and `results.pack_result` of it."""

    number: int
    line: dict[str, Any]
    content: bytes


Pool = Callable[[Sequence[tuple[int, Entry]], Context], Iterator[Result]]
"""Renders numbered models in any order. No model can end it; it raises RuntimeError where no
process can be started."""


class Renderer:
    """Renders models in a process of its own, within the limits of the job's settings.

    The process is started with the first model, and replaced when it dies, exceeds a limit or has
    done `models_per_worker`. It is no child of `multiprocessing`: those cannot be had by processes
    that are daemons themselves, as workers of a cluster are. A model's loader must be importable.

    Args:
      context: what the process needs besides the models.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Any = None
        self._done = 0
        self._ended = False

    def render(self, entry: Entry) -> tuple[dict[str, Any], bytes]:
        """One attempt at a model: its line and `results.pack_result` of it.

        The line's status is one of `render_model.render_model`, "error", or "crashed", "timeout",
        "memory" where the process is gone.

        Raises:
          RuntimeError: the processes die before they are ready.
        """
        # One that has waited long ends by itself.
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
            line, content = self._connection.recv()
        except (EOFError, OSError):
            return self._lost(entry, "crashed", "")
        self._done += 1
        if self._done >= options.models_per_worker:
            self._dismiss()
        return line, content

    def end(self) -> None:
        """Ends the process, if there is one, and with it the renderer."""
        self._ended = True
        self._dismiss()

    def kill(self) -> None:
        """Ends both at once; safe while another thread is in `render`."""
        self._ended = True
        process = self._process
        if process is not None:
            process.kill()

    def _start(self) -> None:
        for _ in range(_STILLBORN):
            if self._ended:
                break
            ours, theirs = multiprocessing.connection.Pipe()
            with theirs:
                self._process = subprocess.Popen(
                    [sys.executable, "-m", "data_gen.worker", "serve", str(theirs.fileno())],
                    pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL, env=_environment(),
                )  # fmt: skip
            self._connection, self._done = ours, 0
            with contextlib.suppress(EOFError, OSError):
                ours.send(self._context)
                if ours.poll(_SECONDS_TO_START):
                    ours.recv()
                    return
                self._process.kill()
            code = self._discard()
        if self._ended:
            raise RuntimeError("the renderer was ended")
        raise RuntimeError(
            f"{_STILLBORN} worker processes ended before they were ready (exit code {code}); try "
            "--config.job.variant=scalar"
        )

    def _dismiss(self) -> None:
        """Tells the process to end."""
        if self._process is not None:
            with contextlib.suppress(OSError):
                self._connection.send(None)
        self._discard()

    def _discard(self) -> int | None:
        """Makes sure that the process is gone; returns its exit code."""
        process, connection = self._process, self._connection
        self._process = self._connection = None
        if process is None:
            return None
        # Whoever comes here has told it to end, killed it, or seen its pipe closed: it is ending,
        # and its own exit code says more than that of a kill.
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(10)
        process.kill()
        connection.close()
        return process.wait()

    def _lost(self, entry: Entry, status: str, reason: str) -> tuple[dict[str, Any], bytes]:
        if status != "crashed" and self._process is not None:
            self._process.kill()
        code = self._discard()
        line = failure(entry, status, reason or f"exit code {code}")
        return line, pack_result(line, [])

    def _megabytes(self) -> float:
        """Resident memory of the process, 0 where it cannot be told."""
        try:
            assert self._process is not None
            statm = pathlib.Path(f"/proc/{self._process.pid}/statm").read_text()
            return int(statm.split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
        except (OSError, ValueError, IndexError):
            return 0.0


def _environment() -> dict[str, str]:
    """One thread for each process, and modules found where they are found here."""
    return {
        "OMP_NUM_THREADS": "1",
        "OPENBLAS_NUM_THREADS": "1",
        "MKL_NUM_THREADS": "1",
        **os.environ,
        "PYTHONPATH": os.pathsep.join(
            dict.fromkeys([str(ROOT), *(os.path.abspath(p) for p in sys.path)])
        ),
    }


def render_local(tasks: Sequence[tuple[int, Entry]], context: Context) -> Iterator[Result]:
    """Renders models in processes of this machine; see `Pool`."""
    count = min(context.settings.job.workers or len(os.sched_getaffinity(0)), len(tasks))
    todo = collections.deque(tasks)
    done: queue.SimpleQueue[Result | BaseException] = queue.SimpleQueue()
    renderers = [Renderer(context) for _ in range(count)]

    def work(renderer: Renderer) -> None:
        try:
            while True:
                try:
                    index, entry = todo.popleft()
                except IndexError:
                    renderer.end()
                    return
                for _ in range(ATTEMPTS):
                    line, content = renderer.render(entry)
                    if line["status"] != "crashed":
                        break
                done.put(Result(index, line, content))
        except BaseException as error:
            done.put(error)

    threads = [threading.Thread(target=work, args=(r,), daemon=True) for r in renderers]
    for thread in threads:
        thread.start()
    try:
        for _ in tasks:
            result = done.get()
            if isinstance(result, BaseException):
                raise result
            yield result
    except BaseException:
        todo.clear()
        for renderer in renderers:
            renderer.kill()
        raise
    finally:
        for thread in threads:
            thread.join()

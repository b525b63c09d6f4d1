"""Rendering processes, which may crash, and a pool of them on this machine.

A `Renderer` manages one process. It renders one model at a time and returns its samples, or the
reason why the process ended. `render_local` renders the models of a job with `job.workers`
renderers (0 = one per processor), at most one per model; `data_gen.cluster` renders them on the
workers of a Dask cluster.
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
"""Number of attempts at a model if the rendering process dies; each uses a new process.

A second attempt is made because the process may have died for another reason than the model."""

# After this many processes have ended before they were ready, rendering is given up: no model can
# be the cause.
_FAILED_STARTS = 3
_SECONDS_TO_START = 300.0


class Result(NamedTuple):
    """The result of one model: its number, its line in the report, the bytes of `pack_result`."""

    number: int
    line: dict[str, Any]
    content: bytes


Pool = Callable[[Sequence[tuple[int, Entry]], Context], Iterator[Result]]
"""Renders numbered models in any order.

A failing model does not stop the pool. RuntimeError is raised if no process can be started."""


class Renderer:
    """Renders models in a separate process, within the limits of the job's settings.

    The process is started for the first model. It is replaced when it dies, exceeds a limit or has
    rendered `models_per_worker` models. It is not started by `multiprocessing`, because daemonic
    processes, such as cluster workers, may not start children with it. Loaders of models must be
    importable in the process.

    Args:
      context: data that the process needs in addition to the models.
    """

    def __init__(self, context: Context) -> None:
        self._context = context
        self._process: subprocess.Popen[bytes] | None = None
        self._connection: Any = None
        self._done = 0
        self._ended = False

    def render(self, entry: Entry) -> tuple[dict[str, Any], bytes]:
        """Renders a model once; returns its line and the bytes of `results.pack_result`.

        The status of the line is one of those of `render_model.render_model`, "error", or
        "crashed", "timeout" or "memory" if the process has ended.

        Raises:
          RuntimeError: the processes end before they are ready.
        """
        # A process that has been idle for a long time ends by itself.
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
        """Ends the process, if one is running, and the renderer."""
        self._ended = True
        self._dismiss()

    def kill(self) -> None:
        """Kills the process and ends the renderer, even while another thread is in `render`."""
        self._ended = True
        process = self._process
        if process is not None:
            process.kill()

    def _start(self) -> None:
        for _ in range(_FAILED_STARTS):
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
            f"{_FAILED_STARTS} worker processes ended before they were ready (exit code {code}); "
            "try --config.job.variant=scalar"
        )

    def _dismiss(self) -> None:
        """Tells the process to end."""
        if self._process is not None:
            with contextlib.suppress(OSError):
                self._connection.send(None)
        self._discard()

    def _discard(self) -> int | None:
        """Waits for the process to end, kills it if it does not, and returns its exit code."""
        process, connection = self._process, self._connection
        self._process = self._connection = None
        if process is None:
            return None
        # The process is already ending: it was asked to end or killed, or its pipe is closed. It is
        # given time, because its own exit code is more informative than that of a kill.
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
        """Resident memory of the process; 0 if it is unknown."""
        try:
            assert self._process is not None
            statm = pathlib.Path(f"/proc/{self._process.pid}/statm").read_text()
            return int(statm.split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6
        except (OSError, ValueError, IndexError):
            return 0.0


def _environment() -> dict[str, str]:
    """Environment of the processes: one thread each, and the import path of this process."""
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
    """Renders models in processes on this machine; see `Pool`."""
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

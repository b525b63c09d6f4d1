"""Rendering on a Dask cluster. Only this module imports Dask.

The cluster's workers need this package with its `render` extra, the catalogue's files under the
same path (nothing for procedural models), and the folder of background pictures if
`image.background` is "folder". They need no access to the output folder: samples are returned
through Dask and written by the process that runs the job. Each thread of a Dask worker keeps one
rendering process, with the limits of the job's settings, so workers are best started with one
thread per processor.

A model whose rendering process dies is tried once more, on another worker if there is one. If a
Dask worker dies, its models are given to other workers. If more workers than the scheduler's
`allowed-failures` die while they render the same model, the model is tried once more and then
reported as crashed.
"""

import contextlib
import dataclasses
import os
import pickle
import queue
import threading
import time
import uuid
from collections.abc import Iterator, Sequence
from typing import Any

from absl import logging

from data_gen import pool
from data_gen.catalogues.entry import Entry
from data_gen.mitsuba_setup import choose_variant
from data_gen.render_model import Context
from data_gen.results import failure, pack_result

NO_DASK = "Dask is not installed: `pip install 'psgn-jax[cluster]'`"

# The job stops after this time without any worker; it can be resumed.
_SECONDS_WITHOUT_WORKERS = 600.0

# --- On the workers ---------------------------------------------------------------------------

# The rendering process of each thread, and the job that it belongs to.
_kept: dict[int, tuple[str, pool.Renderer]] = {}


def _of_this_machine(context: Context) -> Context:
    """The context with the LLVM library of this machine, if the path in it does not exist here."""
    if not context.variant.libllvm or os.path.exists(context.variant.libllvm):
        return context
    variant, _ = choose_variant("llvm")
    return dataclasses.replace(context, variant=variant)


def _render(job: str, entry: bytes, context: bytes) -> tuple[dict[str, Any], bytes, str]:
    """Renders a model once in this thread's rendering process.

    Returns the model's line, the bytes of `results.pack_result`, and the address of the worker.
    """
    import distributed

    thread = threading.get_ident()
    if thread in _kept and _kept[thread][0] != job:
        _kept.pop(thread)[1].end()
    if thread not in _kept:
        _kept[thread] = job, pool.Renderer(_of_this_machine(pickle.loads(context)))
    line, content = _kept[thread][1].render(pickle.loads(entry))
    return line, content, distributed.get_worker().address


def _release(job: str) -> None:
    """Kills the rendering processes of a job."""
    for thread in [t for t, (owner, _) in list(_kept.items()) if owner == job]:
        _kept.pop(thread)[1].kill()


# --- In the job -------------------------------------------------------------------------------


def render_on(
    address: str, tasks: Sequence[tuple[int, Entry]], context: Context
) -> Iterator[pool.Result]:
    """Renders models on a cluster; see `pool.Pool`.

    Args:
      address: address of the scheduler, such as "tcp://host:8786".
      tasks: numbered models.
      context: further data for rendering.

    Raises:
      RuntimeError: Dask is not installed, the scheduler does not answer, the cluster has no
        workers, or there is an error on a worker that does not come from a model.
    """
    try:
        import distributed
    except ImportError as error:
        raise RuntimeError(NO_DASK) from error
    try:
        client = distributed.Client(address, timeout=30, set_as_default=False)
    except (OSError, ValueError) as error:
        raise RuntimeError(f"--scheduler {address!r}: no scheduler answers: {error}") from error
    with client:
        job = uuid.uuid4().hex
        try:
            yield from _render_with(client, job, list(tasks), context)
        finally:
            # An error here must not hide the error that ended the job.
            with contextlib.suppress(Exception):
                client.run(_release, job, on_error="ignore")


def _render_with(
    client: Any, job: str, tasks: list[tuple[int, Entry]], context: Context
) -> Iterator[pool.Result]:
    import distributed
    from distributed.scheduler import KilledWorker

    packed = pickle.dumps(context)
    todo = [(index, entry, 1, "") for index, entry in reversed(tasks)]
    running: dict[Any, tuple[int, Entry, int]] = {}
    done: queue.SimpleQueue[Any] = queue.SimpleQueue()
    seen = time.monotonic()
    while todo or running:
        threads: dict[str, int] = client.nthreads()
        if threads:
            seen = time.monotonic()
        elif time.monotonic() - seen > _SECONDS_WITHOUT_WORKERS:
            raise RuntimeError(
                f"the cluster has had no workers for {_SECONDS_WITHOUT_WORKERS:g} s; run the "
                "same command again to resume"
            )
        # Submits only enough to keep all threads busy, so that workers that join later get some.
        while todo and len(running) < 2 * sum(threads.values()):
            index, entry, attempt, avoid = todo.pop()
            others = [a for a in threads if a != avoid] if avoid else []
            future = client.submit(
                _render, job, pickle.dumps(entry), packed,
                pure=False, key=f"render-{job}-{index}-{attempt}",
                workers=others or None, allow_other_workers=bool(others),
            )  # fmt: skip
            running[future] = (index, entry, attempt)
            future.add_done_callback(done.put)
        try:
            future = done.get(timeout=10 if running else 1)
        except queue.Empty:
            continue
        index, entry, attempt = running.pop(future)
        address = ""
        try:
            line, content, address = future.result()
        except (KilledWorker, distributed.CancelledError) as error:
            what = f"its Dask worker died: {type(error).__name__}"
            line = failure(entry, "crashed", what)
            content = pack_result(line, [])
        except Exception as error:
            raise RuntimeError(
                f"a Dask worker cannot render: {type(error).__name__}: {error}"
            ) from error
        future.release()
        if line["status"] == "crashed" and attempt < pool.ATTEMPTS:
            logging.warning("%s: %s; trying it again", entry.model_id, line["reason"])
            todo.append((index, entry, attempt + 1, address))
            continue
        yield pool.Result(index, line, content)

"""Rendering on a Dask cluster. Only this module imports Dask.

The workers need this package with the extra `render`, and the catalogue's files under the same
path. They do not need the output folder: the process that runs the job writes the samples. Each
thread of a Dask worker keeps a rendering process, so start workers with a thread per processor. If
a Dask worker dies, Dask gives its models to other workers. If a model kills more workers than the
scheduler's `allowed-failures`, its status is "crashed".
"""

import contextlib
import copy
import dataclasses
import itertools
import logging
import os
import threading
import uuid
from collections.abc import Generator, Sequence
from typing import Any

from data_gen import pool
from data_gen.catalogues.entry import Entry
from data_gen.engine import choose_variant
from data_gen.render_model import Context, line_of
from psgn_jax.data.shards import Result

# On a worker: the renderers by job and thread.
_kept: dict[tuple[str, int], pool.Renderer] = {}


def _render(job: str, number: int, entry: Entry, context: Context) -> Result:
    """Renders a model on a worker, in the process that belongs to this thread."""
    key = job, threading.get_ident()
    if key not in _kept:
        if context.variant.libllvm and not os.path.exists(context.variant.libllvm):
            context = dataclasses.replace(context, variant=choose_variant("llvm")[0])
        _kept[key] = pool.Renderer(context)
    return _kept[key].render(number, entry)


def _release(job: str) -> None:
    """Kills a job's rendering processes on a worker."""
    for key in [key for key in list(_kept) if key[0] == job]:
        _kept.pop(key).kill()


def is_no_traceback(record: logging.LogRecord) -> bool:
    """False for Dask's traceback of a lost connection; `render_on` raises an error instead."""
    return not (record.exc_info and record.name.startswith("distributed."))


def render_on(
    address: str, tasks: Sequence[tuple[int, Entry]], context: Context
) -> Generator[Result]:
    """Renders models on the cluster of the scheduler at `address`; see `pool.Pool`.

    Raises:
      RuntimeError: Dask is not installed, the scheduler does not answer, the cluster has no
        workers, or a worker fails for another reason than a model.
    """
    try:
        import distributed
        from distributed.scheduler import KilledWorker
    except ImportError as error:
        raise RuntimeError("Dask is not installed: `pip install 'psgn-jax[cluster]'`") from error
    try:
        client = distributed.Client(address, set_as_default=False)
    except (OSError, ValueError) as error:
        raise RuntimeError(f"scheduler={address}: no scheduler answers: {error}") from error
    job = uuid.uuid4().hex
    with client:
        try:
            client.wait_for_workers(1, timeout=600)
        except TimeoutError as error:
            raise RuntimeError(f"scheduler={address}: it has no workers: {error}") from error
        todo = iter(tasks)
        # As a task, because scattered data are lost with their workers.
        shared = client.submit(copy.copy, context, pure=False)
        running: dict[Any, tuple[int, Entry]] = {}
        done = distributed.as_completed(loop=client.loop)

        def submit() -> None:
            """Submits enough for all threads, not more, to bound the memory."""
            free = 2 * sum(client.nthreads().values()) - len(running)
            for number, entry in itertools.islice(todo, max(free, not running)):
                future = client.submit(_render, job, number, entry, shared, pure=False)
                running[future] = number, entry
                done.add(future)

        try:
            submit()
            for future in done:
                number, entry = running.pop(future)
                try:
                    result = future.result()
                except KilledWorker as error:
                    line = line_of(entry, "crashed", f"its Dask workers died: {error}")
                    result = Result(number, line, {})
                except Exception as error:
                    if future.cancelled():
                        raise ConnectionError from error
                    what = f"{type(error).__name__}: {error}"
                    raise RuntimeError(f"a Dask worker cannot render: {what}") from error
                yield result
                future.release()
                submit()
        except OSError as error:
            what = "the connection was lost; run the command again, which continues"
            raise RuntimeError(f"scheduler={address}: {what}") from error
        finally:
            # An error here must not hide the error that has ended the job.
            with contextlib.suppress(Exception):
                client.run(_release, job, on_error="ignore")

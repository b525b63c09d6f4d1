"""Training and evaluation in several processes, each with its own accelerators.

Every process runs the same program on its share of each batch; the training step averages the
gradients. `jax.distributed.initialize` connects the processes. It gets their number and addresses
from flags, from Open MPI's `mpirun` or from SLURM's `srun`, and detects by heartbeats that a
process has ended. All processes read the records and the run's folder; only the first writes there.
"""

import contextlib
import json
import os
import signal
import sys
import threading
import traceback
from collections.abc import Iterator
from typing import Any

import numpy as np

from psgn_jax.system.errors import Exit, UserError, exit_code_of
from psgn_jax.system.untrusted import message_line

_HEARTBEAT_SECONDS = 40
# Variables in which launchers state the number of processes.
_COUNTS = ("OMPI_COMM_WORLD_SIZE", "SLURM_STEP_NUM_TASKS")


def is_one_of_several(
    coordinator: str | None, num_processes: int | None, process_id: int | None
) -> bool:
    """Whether flags or environment say that there are several processes; arguments: `joined`."""
    launched = any(os.environ.get(name, "1") != "1" for name in _COUNTS)
    launched |= "JAX_COORDINATOR_ADDRESS" in os.environ
    return bool(coordinator or process_id or (num_processes or 1) != 1 or launched)


@contextlib.contextmanager
def joined(
    coordinator: str | None = None, num_processes: int | None = None, process_id: int | None = None
) -> Iterator[bool]:
    """Context in which the processes are connected; its value is whether this one is the first.

    Enter it before JAX is used. If one process fails, the others exit when its heartbeat stops. A
    single process is not changed.

    Args:
      coordinator: HOST:PORT of the first process. None here and below = from the environment.
      num_processes: number of processes.
      process_id: index of this process, from 0.

    Raises:
      UserError: the processes cannot connect to each other.
    """
    if not is_one_of_several(coordinator, num_processes, process_id):
        yield True
        return
    import jax  # here, because a single process need not load JAX yet

    try:
        jax.distributed.initialize(
            coordinator, num_processes, process_id, heartbeat_timeout_seconds=_HEARTBEAT_SECONDS
        )
    except (RuntimeError, ValueError) as error:
        raise UserError(
            f"coordinator={coordinator}, num_processes={num_processes}, process_id={process_id}: "
            f"no connection to the other processes ({message_line(error)[:300]}); expected all "
            "three, with HOST:PORT of the first process, or a start by srun or mpirun"
        ) from error
    try:
        yield is_first()
    except BaseException as error:
        _end_with(error)
    jax.distributed.shutdown()


def _end_with(error: BaseException) -> None:
    """Ends this process at once; Python's normal exit would wait for the other processes."""
    code = exit_code_of(error)
    if code is not None:
        sys.stderr.write(f"error: {message_line(error)}\n")
    elif type(error).__name__ == "JaxRuntimeError" or "Gloo" in str(error):  # on a CPU, ValueError
        code = Exit.OTHER_ENDED
        sys.stderr.write(
            f"error: another process has ended, so this process ends too "
            f"({message_line(error)[:200]}); run the same command again to resume from the newest "
            "checkpoint\n"
        )
    elif isinstance(error, SystemExit):
        code = error.code if isinstance(error.code, int) else 1
    elif isinstance(error, KeyboardInterrupt):
        code = Exit.CTRL_C
    else:
        code = 1
        traceback.print_exception(error)
    sys.stderr.flush()
    os._exit(code)


def index_and_count() -> tuple[int, int]:
    """Index of this process, from 0, and number of processes."""
    import jax

    return jax.process_index(), jax.process_count()


def is_first() -> bool:
    """Whether this process is the first, which writes the files."""
    return index_and_count()[0] == 0


def gather(value: Any) -> list[Any]:
    """The JSON values of all processes, ordered by index; every process must call this."""
    if index_and_count()[1] == 1:
        return [value]
    from jax.experimental import multihost_utils

    text = np.frombuffer(json.dumps(value).encode(), np.uint8)
    sizes = multihost_utils.process_allgather(np.int32(len(text)))
    padded = np.zeros(int(np.max(sizes)), np.uint8)
    padded[: len(text)] = text
    rows = np.asarray(multihost_utils.process_allgather(padded))
    return [
        json.loads(row[:size].tobytes()) for row, size in zip(rows, sizes.tolist(), strict=True)
    ]


class SharedStop(contextlib.AbstractContextManager["SharedStop"]):
    """`signals.StopSignal` for several processes: JAX chooses the step after which all stop."""

    def __init__(self) -> None:
        self.signal: int | None = None
        self.lock = threading.Lock()

    def __exit__(self, *_: object) -> None: ...

    def after_step(self, step: int) -> None:
        """Every process must call this after every step."""
        from jax.experimental import multihost_utils

        if multihost_utils.reached_preemption_sync_point(step):
            self.signal = signal.SIGTERM

    def check(self, *_: object) -> None:
        """Does nothing: an evaluation ends before the processes agree on a step."""

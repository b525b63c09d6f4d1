"""Determines which of several processes this one is, from flags or the environment.

In order of precedence:

1. The flags `--coordinator`, `--num_processes` and `--process_id`. A flag that is not given is read
   from JAX_COORDINATOR_ADDRESS, JAX_NUM_PROCESSES or JAX_PROCESS_ID; if that variable is not set,
   2 or 3 applies.
2. Open MPI: `mpirun` sets OMPI_COMM_WORLD_SIZE and OMPI_COMM_WORLD_RANK.
3. SLURM: `srun` sets SLURM_PROCID and SLURM_STEP_NUM_TASKS.

Without any of these, or with a count of one, the training has a single process.
"""

import dataclasses
import zlib
from collections.abc import Mapping

from psgn_jax.config import ConfigError

# Ports above those that Linux gives to outgoing connections (32768 to 60999).
_FIRST_PORT, _NUM_PORTS = 61_440, 4_000


@dataclasses.dataclass(frozen=True)
class Place:
    """The place of a process among those of its training.

    Attributes:
      coordinator: HOST:PORT at which the first process accepts connections of the others.
      count: number of processes.
      index: index of this process, from 0.
      devices: indices of the machine's accelerators that this process uses; None = all visible.
    """

    coordinator: str
    count: int
    index: int
    devices: tuple[int, ...] | None = None


def place_of(
    environment: Mapping[str, str],
    *,
    coordinator: str | None = None,
    num_processes: int | None = None,
    process_id: int | None = None,
) -> Place | None:
    """The place of this process; None if the training has a single process.

    Args:
      environment: the environment variables.
      coordinator: value of `--coordinator`; None = not given.
      num_processes: value of `--num_processes`; None = not given.
      process_id: value of `--process_id`; None = not given.

    Raises:
      ConfigError: something is missing or out of range.
    """
    coordinator = coordinator or environment.get("JAX_COORDINATOR_ADDRESS")
    if num_processes is None:
        num_processes = _number(environment, "JAX_NUM_PROCESSES")
    if process_id is None:
        process_id = _number(environment, "JAX_PROCESS_ID")
    launcher = _open_mpi(environment) or _slurm(environment)
    if launcher is not None:
        num_processes = launcher.count if num_processes is None else num_processes
        process_id = launcher.index if process_id is None else process_id
    if (num_processes or 1) == 1 and not process_id:
        return None
    coordinator = coordinator or (launcher.coordinator if launcher else "")
    return _checked(coordinator, num_processes, process_id, _devices(environment, launcher))


@dataclasses.dataclass(frozen=True)
class _Launcher:
    """Values from a launcher; `coordinator` is empty if it does not name the first machine."""

    coordinator: str
    count: int
    index: int
    local_count: int
    local_index: int


def _open_mpi(environment: Mapping[str, str]) -> _Launcher | None:
    count = _number(environment, "OMPI_COMM_WORLD_SIZE")
    index = _number(environment, "OMPI_COMM_WORLD_RANK")
    if count is None or index is None:
        return None
    local_count = _number(environment, "OMPI_COMM_WORLD_LOCAL_SIZE") or 1
    local_index = _number(environment, "OMPI_COMM_WORLD_LOCAL_RANK") or 0
    job = environment.get("PMIX_NAMESPACE") or environment.get("OMPI_MCA_ess_base_jobid", "")
    # The machine of the first process is known only if all processes run on one machine.
    coordinator = f"127.0.0.1:{_port(job)}" if local_count == count else ""
    return _Launcher(coordinator, count, index, local_count, local_index)


def _slurm(environment: Mapping[str, str]) -> _Launcher | None:
    # SLURM sets this variable for the tasks of `srun`, not for the batch script around them.
    nodes = environment.get("SLURM_STEP_NODELIST")
    index = _number(environment, "SLURM_PROCID")
    count = _number(environment, "SLURM_STEP_NUM_TASKS")
    if count is None:
        count = _number(environment, "SLURM_NTASKS")
    if not nodes or index is None or count is None:
        return None
    machines = _number(environment, "SLURM_STEP_NUM_NODES") or 1
    job = f"{environment.get('SLURM_JOB_ID')}.{environment.get('SLURM_STEP_ID')}"
    return _Launcher(
        f"{first_node(nodes)}:{_port(job)}",
        count,
        index,
        -(-count // machines),
        _number(environment, "SLURM_LOCALID") or 0,
    )


def first_node(nodes: str) -> str:
    """First name of a node list of SLURM: `gpu[003-007,9],login` -> `gpu003`."""
    head, bracket, rest = nodes.split(",")[0].partition("[")
    if not bracket:
        return head
    number, _, suffix = rest.partition("]")
    return head + number.partition("-")[0] + suffix


def _devices(environment: Mapping[str, str], launcher: _Launcher | None) -> tuple[int, ...] | None:
    """One accelerator for each process of a machine, unless they are assigned already."""
    if named := environment.get("JAX_LOCAL_DEVICE_IDS"):
        return tuple(int(part) for part in named.split(","))
    visible = environment.get("CUDA_VISIBLE_DEVICES")
    if launcher is None or launcher.local_count == 1 or (visible and "," not in visible):
        return None
    return (launcher.local_index,)


def _port(job: str) -> int:
    return _FIRST_PORT + zlib.crc32(job.encode()) % _NUM_PORTS


def _number(environment: Mapping[str, str], name: str) -> int | None:
    text = environment.get(name)
    if text is None:
        return None
    if not text.isdigit():
        raise ConfigError(f"environment variable {name}={text!r}: accepted: a number")
    return int(text)


def _checked(
    coordinator: str, count: int | None, index: int | None, devices: tuple[int, ...] | None
) -> Place:
    if count is None:
        raise ConfigError("--num_processes: missing; accepted: the number of all processes")
    if index is None or not 0 <= index < count:
        raise ConfigError(f"--process_id={index}: accepted: 0 to {count - 1}")
    host, _, port = coordinator.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65_536:
        raise ConfigError(
            f"--coordinator={coordinator}: accepted: HOST:PORT of the first process, at which the "
            "others reach it"
        )
    return Place(coordinator, count, index, devices)

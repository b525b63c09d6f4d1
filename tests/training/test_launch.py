"""The index of a process among several, from flags and variables of SLURM and Open MPI."""

import pytest

from psgn_jax.config import ConfigError
from psgn_jax.training.launch import Place, first_node, place_of

SLURM = {
    "SLURM_JOB_ID": "77",
    "SLURM_STEP_ID": "0",
    "SLURM_STEP_NODELIST": "gpu[003-004]",
    "SLURM_STEP_NUM_NODES": "2",
    "SLURM_STEP_NUM_TASKS": "8",
    "SLURM_PROCID": "6",
    "SLURM_LOCALID": "2",
}
OPEN_MPI = {
    "OMPI_COMM_WORLD_SIZE": "4",
    "OMPI_COMM_WORLD_RANK": "3",
    "OMPI_COMM_WORLD_LOCAL_SIZE": "4",
    "OMPI_COMM_WORLD_LOCAL_RANK": "3",
}


@pytest.mark.parametrize(
    "environment", [{}, {"SLURM_NTASKS": "4", "SLURM_JOB_ID": "7"}, {**SLURM, "SLURM_PROCID": "0",
     "SLURM_STEP_NUM_TASKS": "1"}]
)  # fmt: skip
def test_alone(environment):
    assert place_of(environment) is None


def test_flags_and_variables():
    flags = {"coordinator": "a:1234", "num_processes": 2, "process_id": 0}
    assert place_of({}, **flags) == Place("a:1234", 2, 0, None)
    variables = {"JAX_COORDINATOR_ADDRESS": "b:99", "JAX_NUM_PROCESSES": "3", "JAX_PROCESS_ID": "2"}
    assert place_of(variables) == Place("b:99", 3, 2, None)
    assert place_of(variables, process_id=1) == Place("b:99", 3, 1, None)
    assert place_of(variables | SLURM) == Place("b:99", 3, 2, (2,))


def test_slurm_has_one_accelerator_for_each_task_of_a_machine():
    place = place_of(SLURM)
    host, port = place.coordinator.split(":")
    assert (host, place.count, place.index, place.devices) == ("gpu003", 8, 6, (2,))
    assert 61_440 <= int(port) < 65_536
    assert place_of(SLURM | {"SLURM_JOB_ID": "78"}).coordinator != place.coordinator
    assert place_of(SLURM | {"SLURM_PROCID": "1"}).coordinator == place.coordinator
    # With `--gpus-per-task=1`, a task sees only its own GPU; a task alone on a machine uses all.
    assert place_of(SLURM | {"CUDA_VISIBLE_DEVICES": "5"}).devices is None
    assert place_of(SLURM | {"SLURM_STEP_NUM_NODES": "8"}).devices is None
    assert place_of(SLURM | {"JAX_LOCAL_DEVICE_IDS": "0,1"}).devices == (0, 1)


def test_open_mpi():
    place = place_of(OPEN_MPI | SLURM)  # mpirun starts its own daemons by srun
    assert place.coordinator.startswith("127.0.0.1:")
    assert (place.count, place.index, place.devices) == (4, 3, (3,))
    with pytest.raises(ConfigError, match=r"--coordinator=: accepted: HOST:PORT"):
        place_of(OPEN_MPI | {"OMPI_COMM_WORLD_LOCAL_SIZE": "2"})


@pytest.mark.parametrize(
    ("nodes", "first"),
    [
        ("node7", "node7"),
        ("node7,node9", "node7"),
        ("gpu[003-007,9],login", "gpu003"),
        ("gpu[1,3]", "gpu1"),
        ("rack[2-3]-ib", "rack2-ib"),
    ],
)
def test_first_node(nodes, first):
    assert first_node(nodes) == first


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        ({"coordinator": "a:1", "process_id": 1}, "--num_processes: missing"),
        ({"coordinator": "a:1", "num_processes": 2}, "--process_id=None: accepted: 0 to 1"),
        ({"coordinator": "a:1", "num_processes": 2, "process_id": 2}, "--process_id=2: accepted"),
        ({"num_processes": 2, "process_id": 0}, "--coordinator=: accepted: HOST:PORT"),
        (
            {"coordinator": "a", "num_processes": 2, "process_id": 0},
            "--coordinator=a: accepted: HOST:PORT",
        ),
    ],
)
def test_what_is_missing_is_named(flags, message):
    with pytest.raises(ConfigError, match=message):
        place_of({}, **flags)


def test_a_variable_that_is_no_number():
    with pytest.raises(ConfigError, match="environment variable JAX_NUM_PROCESSES='two'"):
        place_of({"JAX_NUM_PROCESSES": "two"})

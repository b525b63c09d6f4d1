"""Worker processes after the trainer is killed, or after a signal to the whole group."""

import os
import pathlib
import signal
import subprocess
import sys
import time

import pytest
from helpers import processes

SCRIPT = """
from psgn_jax.system import signals

signals.GRACE_SECONDS = 60.0  # on busy cores, workers take longer to start than the usual time

if __name__ == "__main__":
    import sys, time
    from psgn_jax.config.experiment import DataConfig
    from psgn_jax.data import loader
    from psgn_jax.system.signals import StopSignal

    cfg = DataConfig(path=sys.argv[1], image_size=(24, 32), num_points=50,
                     num_workers=int(sys.argv[2]))
    batches = loader.train_batches(cfg, batch_size=4, seed=0, start_step=0)
    with StopSignal() as stop:
        for batch in batches:
            print("batch", flush=True)
            if stop.signal:
                break
            time.sleep(0.01)
    batches.close()
    print("stopped by", stop.signal)
"""


@pytest.fixture
def start(dataset, tmp_path):
    script, log = tmp_path / "script.py", tmp_path / "log"
    script.write_text(SCRIPT)
    groups = []

    def begin(moment):
        # One worker is enough, unless the second is to be started.
        workers = "2" if moment == "starting" else "1"
        with log.open("w") as file:
            process = subprocess.Popen(
                [sys.executable, str(script), str(dataset), workers],
                stdout=file,
                stderr=subprocess.STDOUT,
                env=os.environ | {"PYTHONPATH": os.getcwd()},
                start_new_session=True,
            )
        groups.append(process.pid)
        return process, log

    yield begin
    for group in groups:
        for process in processes.of_group(group):
            os.kill(process, signal.SIGKILL)


def wait_for(moment, process, log):
    def reached():
        if moment == "starting":
            # Itself and a worker; the tracker has its own group. The memory may come after them.
            workers = len(processes.of_group(process.pid)) > 1
            return workers and bool(processes.shared_memory(process.pid))
        return log.read_text().count("batch") > 3

    assert processes.wait_until(lambda: reached() or process.poll() is not None)
    assert process.poll() is None, log.read_text()


@pytest.mark.parametrize(
    ("moment", "kill"), [("starting", os.kill), ("working", os.kill), ("working", os.killpg)]
)
def test_workers_end_with_a_killed_trainer_and_leave_no_memory(start, moment, kill):
    process, log = start(moment)
    wait_for(moment, process, log)
    files = processes.shared_memory(process.pid)
    assert files
    # The resource tracker does not know a block that is being created at the moment of the kill.
    time.sleep(0.1)
    kill(process.pid, signal.SIGKILL)
    process.wait()
    assert processes.wait_until(lambda: not processes.of_group(process.pid), 20)
    paths = [pathlib.Path("/dev/shm", f) for f in files]
    assert processes.wait_until(lambda: not any(p.exists() for p in paths), 20)
    assert set(log.read_text().split()) <= {"batch"}  # no warnings of the resource tracker


@pytest.mark.parametrize(
    ("moment", "number"), [("starting", signal.SIGTERM), ("working", signal.SIGINT)]
)
def test_a_signal_to_the_whole_group_is_the_trainers_alone(start, moment, number):
    process, log = start(moment)
    wait_for(moment, process, log)
    os.killpg(process.pid, number)
    assert process.wait(60) == 0, log.read_text()
    lines = log.read_text().splitlines()
    assert lines[-1] == f"stopped by {int(number)}"
    assert set(lines[:-1]) == {"batch"}
    assert processes.wait_until(lambda: not processes.of_group(process.pid), 20)

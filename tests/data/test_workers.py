"""Worker processes after the trainer is killed, after a signal to the group, and in scripts."""

import os
import signal
import subprocess
import sys

import pytest
from helpers import processes

SCRIPT = """
if __name__ == "__main__":
    import sys, time
    from psgn_jax.config.experiment import DataConfig
    from psgn_jax.data import loader
    from psgn_jax.system.signals import StopSignal

    cfg = DataConfig(path=sys.argv[1], image_size=(24, 32), num_points=50,
                     num_workers=int(sys.argv[2]))
    batches = loader.train_batches(cfg, batch_size=4, seed=0, start_step=0)
    with StopSignal(60) as stop:
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
    groups = []

    def begin(workers, text=SCRIPT):
        script.write_text(text)
        with log.open("w") as file:
            process = subprocess.Popen(
                [sys.executable, str(script), str(dataset), str(workers)],
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
        if moment == "starting":  # itself, the resource tracker, a worker
            return len(processes.of_group(process.pid)) > 2
        return log.read_text().count("batch") > 3

    assert processes.wait_until(lambda: reached() or process.poll() is not None)
    assert process.poll() is None, log.read_text()


# One worker is enough, unless the second is to be started.
@pytest.mark.parametrize(("moment", "workers"), [("starting", 2), ("working", 1)])
def test_workers_end_with_a_killed_trainer(start, moment, workers):
    process, log = start(workers)
    wait_for(moment, process, log)
    process.kill()
    process.wait()
    assert processes.wait_until(lambda: not processes.of_group(process.pid))


@pytest.mark.parametrize(
    ("moment", "workers", "number"),
    [("starting", 2, signal.SIGTERM), ("working", 1, signal.SIGINT)],
)
def test_a_signal_to_the_whole_group_is_the_trainers_alone(start, moment, workers, number):
    process, log = start(workers)
    wait_for(moment, process, log)
    os.killpg(process.pid, number)
    assert process.wait(60) == 0, log.read_text()
    lines = log.read_text().splitlines()
    assert lines[-1] == f"stopped by {int(number)}"
    assert set(lines[:-1]) == {"batch"}
    assert processes.wait_until(lambda: not processes.of_group(process.pid))


def test_a_script_that_ends_early_leaves_no_worker(start):
    process, log = start(
        1,
        SCRIPT.replace("if stop.signal:", "if True:").replace(
            "batches.close()", "sys.keep = batches"
        ),
    )
    assert process.wait(60) == 0, log.read_text()
    assert log.read_text().startswith("batch\nstopped by None\n")
    assert processes.wait_until(lambda: not processes.of_group(process.pid))


def test_a_script_without_the_guard_says_what_it_needs(start):
    process, log = start(1, SCRIPT.replace('if __name__ == "__main__":', "if True:"))
    assert process.wait(60) == 1
    text = log.read_text()
    assert text.startswith("error: a script with data.num_workers > 0 must train inside ")
    assert "bootstrapping" not in text
    assert text.splitlines()[-1] == (
        "psgn_jax.data.loader.WorkerError: data.num_workers=1: a worker process ended with exit "
        "code 1; its messages are above"
    )

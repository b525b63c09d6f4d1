import os
import signal
import subprocess
import sys

import pytest
from helpers import processes
from helpers.refusals import check_message

SCRIPT = """
if __name__ == "__main__":
    import sys, time
    from psgn_jax.config.data import DataConfig
    from psgn_jax.data import loader
    from psgn_jax.system.signals import StopSignal

    cfg = DataConfig(path=sys.argv[1], image_size=(24, 32), num_points=50,
                     num_workers=int(sys.argv[2]))
    batches = loader.train_batches(cfg, batch_size=4, seed=0, start_step=0)
    for part in range(int(sys.argv[3])):
        with StopSignal(60) as stop:
            for batch in batches:
                print("batch", flush=True)
                if stop.signal:
                    break
                time.sleep(0.01)
        print("stopped by", stop.signal, flush=True)
    batches.close()
"""


@pytest.fixture
def start(dataset, tmp_path):
    script, log = tmp_path / "script.py", tmp_path / "log"
    groups = []

    def begin(workers, parts, text=SCRIPT):
        script.write_text(text)
        command = [sys.executable, script, dataset, str(workers), str(parts)]
        options = {"env": os.environ | {"PYTHONPATH": os.getcwd()}, "start_new_session": True}
        with log.open("w") as file:
            process = subprocess.Popen(command, stdout=file, stderr=file, **options)
        groups.append(process.pid)
        return process, log

    yield begin
    for group in groups:
        for process in processes.of_group(group):
            os.kill(process, signal.SIGKILL)


def is_starting(process):
    """Whether there are itself, the resource tracker and a worker."""
    return len(processes.of_group(process.pid)) > 2


def test_workers_that_start_end_with_a_killed_trainer(start):
    process, log = start(2, 1)
    processes.wait_for(lambda: is_starting(process), process, log)
    process.kill()
    process.wait()
    assert processes.wait_until(lambda: not processes.of_group(process.pid))


def test_signals_to_the_whole_group_are_the_trainers_alone(start):
    """While a worker starts, and while it works."""
    process, log = start(1, 2)
    processes.wait_for(lambda: is_starting(process), process, log)
    os.killpg(process.pid, signal.SIGTERM)
    processes.wait_for(lambda: log.read_text().count("batch") > 3, process, log)
    os.killpg(process.pid, signal.SIGINT)
    assert process.wait(60) == 0, log.read_text()
    lines = log.read_text().splitlines()
    assert [line for line in lines if line != "batch"] == ["stopped by 15", "stopped by 2"]
    assert processes.wait_until(lambda: not processes.of_group(process.pid))


def test_scripts_that_end_early_or_lack_the_guard(start):
    text = SCRIPT.replace("if stop.signal:", "if True:")
    process, log = start(1, 1, text.replace("batches.close()", "sys.keep = batches"))
    assert process.wait(60) == 0, log.read_text()
    assert log.read_text().startswith("batch\nstopped by None\n")
    assert processes.wait_until(lambda: not processes.of_group(process.pid))
    process, log = start(1, 1, SCRIPT.replace('if __name__ == "__main__":', "if True:"))
    assert process.wait(60) == 1
    text = log.read_text()
    assert text.startswith("error: ")
    assert "bootstrapping" not in text
    check_message(text.splitlines()[-1], "WorkerError", "data.num_workers=1", "exit code 1")

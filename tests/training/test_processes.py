"""Several CPU processes (gloo) train as one process does; resuming with another number; kills."""

import json
import pathlib
import re
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest
from helpers import standin
from helpers.small_runs import quick_environment, write_config, write_solids

from psgn_jax.training.checkpoint import Checkpoints
from psgn_jax.training.log import read_metrics
from psgn_jax.training.loop import train

ROOT = pathlib.Path(__file__).resolve().parents[2]
TRAIN, EVALUATE = ["tests/helpers/standin.py"], ["-m", "psgn_jax.evaluate"]


def tiny(**changes):
    return standin.config(model__name="vanilla", model__widths=(4, 6, 8), **changes)


@pytest.fixture(scope="module")
def records(tmp_path_factory):
    return write_solids(tmp_path_factory.mktemp("processes") / "data")


@pytest.fixture(scope="module")
def alone(records, tmp_path_factory):
    workdir = tmp_path_factory.mktemp("alone") / "run"
    train(tiny(data__path=str(records)), workdir)
    return workdir


@pytest.fixture(scope="module")
def given(records, tmp_path_factory):
    """The file of the tiny configuration, and the environment of the processes."""
    folder = tmp_path_factory.mktemp("start")
    file = write_config(folder / "tiny.py", tiny(data__path=str(records)))
    return file, quick_environment(folder)


@pytest.fixture
def start(given):
    """A function that starts a number of processes on the tiny configuration in a workdir.

    All of them are ended after the test, because they would slow down the next one.
    """
    file, environment = given
    running = []

    def run(count, workdir, *flags, command=TRAIN, only={}):  # noqa: B006 - not changed
        configured = [f"--config={file}"] if command is TRAIN else []
        with socket.create_server(("127.0.0.1", 0)) as free:
            coordinator = f"127.0.0.1:{free.getsockname()[1]}"
        processes = []
        for index in range(count):
            together = [f"--coordinator={coordinator}", f"--num_processes={count}",
                        f"--process_id={index}"] if count > 1 else []  # fmt: skip
            with open(f"{workdir}.{index}.log", "w") as log:
                processes.append(
                    subprocess.Popen(
                        [
                            sys.executable,
                            *command,
                            f"--workdir={workdir}",
                            *configured,
                            *together,
                            *flags,
                            *only.get(index, []),
                        ],
                        stdout=log,
                        stderr=subprocess.STDOUT,
                        env=environment,
                        cwd=ROOT,
                    )
                )
        running.extend(processes)
        return processes

    yield run
    for process in running:
        process.kill()
        process.wait()


def codes(processes, timeout=180):
    return [process.wait(timeout) for process in processes]


def text(workdir, index):
    return pathlib.Path(f"{workdir}.{index}.log").read_text()


def lines(workdir, index):
    """The lines that a process printed, without gloo's."""
    return [line for line in text(workdir, index).splitlines() if not line.startswith("[Gloo]")]


def wait_for_step(workdir, step, processes, seconds=300):
    """Waits until a step has been logged; half a minute is enough, unless the machine is busy."""
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline and all(process.poll() is None for process in processes):
        steps = [entry["step"] for entry in read_metrics(workdir / "metrics.jsonl")]
        if steps and max(steps) >= step:
            return
        time.sleep(0.05)
    pytest.fail(f"no step {step}: {text(workdir, 0)}")


def newest(workdir):
    return Checkpoints(workdir / "checkpoints", read_only=True).restore_newest()


def assert_same_run(one, other):
    first, second = newest(one), newest(other)
    assert first.step == second.step
    for name, leaf in first.leaves.items():
        np.testing.assert_allclose(second.leaves[name], leaf, rtol=1e-4, atol=2e-6, err_msg=name)
    logs = [read_metrics(workdir / "metrics.jsonl") for workdir in (one, other)]
    for mine, theirs in zip(*logs, strict=True):
        assert mine.pop("kind") == theirs.pop("kind")
        for entry in (mine, theirs):
            entry.pop("samples_per_second", None)
        assert mine == pytest.approx(theirs, rel=1e-4, abs=1e-6)


def test_two_processes_are_as_one(alone, start, tmp_path):
    workdir = tmp_path / "run"
    assert codes(start(2, workdir)) == [0, 0], text(workdir, 0) + text(workdir, 1)
    assert_same_run(alone, workdir)
    assert lines(workdir, 1) == []
    assert text(workdir, 0).count("done: step 12 of 12") == 1


@pytest.mark.slow
def test_evaluating_is_shared(alone, start, tmp_path):
    def table(count):
        out = tmp_path / f"table{count}"
        log = tmp_path / f"log{count}"
        flags = [f"--workdir={alone}", f"--out={out}"]
        assert codes(start(count, log, *flags, command=EVALUATE)) == [0] * count, text(log, 0)
        return (out / "samples.csv").read_text(), [lines(log, index) for index in range(count)]

    expected, _ = table(1)
    shared, printed = table(2)
    assert shared == expected
    assert any("mean over samples" in line for line in printed[0])
    assert printed[1] == []


@pytest.mark.slow
def test_a_signal_stops_all_and_another_number_goes_on(alone, start, tmp_path):
    workdir = tmp_path / "run"
    four = start(4, workdir, "--config.train.steps=100000", "--config.train.eval_every=6")
    wait_for_step(workdir, 8, four)
    four[2].send_signal(signal.SIGTERM)
    assert codes(four) == [143] * 4, text(workdir, 0)
    stopped = newest(workdir).step
    assert f"stopped by SIGTERM after step {stopped}, checkpoint saved; run" in text(workdir, 0)
    flags = [f"--config.train.steps={stopped + 5}", "--config.train.eval_every=6"]
    assert codes(start(2, workdir, *flags)) == [0, 0], text(workdir, 0)
    assert f"resuming at step {stopped}" in text(workdir, 0)
    assert codes(start(1, workdir, f"--config.train.steps={stopped + 8}", flags[1])) == [0]
    reference = tmp_path / "reference"
    assert codes(start(1, reference, f"--config.train.steps={stopped + 8}", flags[1])) == [0]
    first, second = newest(reference), newest(workdir)
    for name, leaf in first.leaves.items():
        np.testing.assert_allclose(second.leaves[name], leaf, rtol=1e-3, atol=1e-5, err_msg=name)


@pytest.mark.slow
@pytest.mark.parametrize("victim", [0, 1])
def test_a_killed_process_ends_the_other(alone, start, tmp_path, victim):
    workdir = tmp_path / "run"
    endless = ["--config.train.steps=100000", "--config.train.eval_every=0"]
    two = start(2, workdir, *endless)
    wait_for_step(workdir, 8, two)
    two[victim].kill()
    killed = time.monotonic()
    other = 1 - victim
    code = two[other].wait(60)
    assert time.monotonic() - killed < 60
    said = [line for line in lines(workdir, other) if line.startswith("error:")]
    if victim:  # JAX's service ends with the first process and may abort the other one earlier
        assert code == 4
        assert said == [
            "error: process 1 has ended unexpectedly, so this process ends too; run the same "
            "command again to resume from the newest checkpoint"
        ]
        assert "Traceback" not in text(workdir, other)
    assert said or code
    assert (
        codes(start(2, workdir, "--config.train.steps=12")) == [0, 0] or newest(workdir).step > 12
    )


@pytest.mark.slow
def test_what_is_wrong_in_one_process_ends_all(start, tmp_path):
    workdir = tmp_path / "run"
    both = start(2, workdir, only={1: ["--config.data.path=/nowhere"]})
    assert codes(both) == [2, 2]
    assert lines(workdir, 0) == []
    (line,) = lines(workdir, 1)
    assert re.match(r"error: data\.path='/nowhere' does not exist", line)
    assert not (workdir / "checkpoints").exists()


@pytest.mark.slow
def test_a_damaged_record_in_one_process_ends_all(records, start, tmp_path):
    workdir = tmp_path / "run"
    damaged = tmp_path / "data"
    damaged.mkdir()
    for path in records.iterdir():
        (damaged / path.name).write_bytes(path.read_bytes())
    for path in damaged.glob("train-*"):
        data = bytearray(path.read_bytes())
        data[len(data) // 2 : len(data) // 2 + 4000] = bytes(4000)
        path.write_bytes(bytes(data))
    both = start(2, workdir, only={1: [f"--config.data.path={damaged}"]})
    assert codes(both) == [4, 2]
    (line,) = [line for line in lines(workdir, 1) if line.startswith("error")]
    assert "is damaged" in line
    assert any(one.startswith("error: process 1 failed: ") for one in lines(workdir, 0))
    assert json.loads((workdir / "config.json").read_text())["train"]["steps"] == 12

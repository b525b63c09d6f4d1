"""A run that is killed at any moment and resumed ends bit-identical to an uninterrupted run."""

import json
import pathlib
import random
import re
import resource
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from helpers import drawn_solids as solids
from helpers import standin
from helpers.small_runs import quick_environment, write_config

from psgn_jax.data.dataset import write_dataset
from psgn_jax.training.checkpoint import Checkpoints
from psgn_jax.training.run_folder import locked

ROOT = pathlib.Path(__file__).resolve().parents[2]
STEPS = 120


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    """A function that starts `psgn_jax.main` on the tiny configuration in a workdir."""
    folder = tmp_path_factory.mktemp("resume")
    config = standin.config(
        train__steps=STEPS,
        train__log_every=7,
        train__eval_every=30,
        train__checkpoint_every=3,
        model__name="vanilla",
        model__widths=(4, 6, 8),
    )
    file = write_config(folder / "tiny.py", config)
    environment = quick_environment(folder) | {"PSGN_STANDIN_DELAY": "0.01"}

    def start(workdir, *flags):
        with open(f"{workdir}.log", "a") as log:
            return subprocess.Popen(
                [
                    sys.executable,
                    str(ROOT / "tests/helpers/standin.py"),
                    f"--config={file}",
                    f"--workdir={workdir}",
                    *flags,
                ],
                stdout=log,
                stderr=subprocess.STDOUT,
                env=environment,
                cwd=ROOT,
            )

    return start


@pytest.fixture(scope="module")
def undisturbed(command, tmp_path_factory):
    workdir = tmp_path_factory.mktemp("undisturbed") / "run"
    assert command(workdir).wait() == 0, log_of(workdir)
    return workdir


def log_of(workdir):
    return pathlib.Path(f"{workdir}.log").read_text()


def final(workdir):
    checkpoints = Checkpoints(workdir / "checkpoints", read_only=True)
    found = checkpoints.restore_newest()
    checkpoints.close()
    return found


def lines(workdir):
    """Lines of metrics without the numbers that depend on the clock."""
    text = (workdir / "metrics.jsonl").read_text().splitlines()
    entries = [json.loads(line) for line in text]
    return [{k: v for k, v in e.items() if k != "samples_per_second"} for e in entries]


def assert_same_end(workdir, reference):
    have, want = final(workdir), final(reference)
    assert have.step == want.step == STEPS
    assert have.leaves.keys() == want.leaves.keys()
    for name, leaf in want.leaves.items():
        np.testing.assert_array_equal(have.leaves[name], leaf, err_msg=name)
    assert lines(workdir) == lines(reference)
    assert (workdir / "checkpoints/scores.json").read_text() == (
        reference / "checkpoints/scores.json"
    ).read_text()


def wait_for(condition, process, workdir, seconds=120.0):
    deadline = time.monotonic() + seconds
    while not condition():
        assert process.poll() is None, log_of(workdir)
        assert time.monotonic() < deadline, log_of(workdir)
        time.sleep(0.0005)


def newest(workdir):
    folder = workdir / "checkpoints"
    steps = [int(p.name) for p in folder.iterdir() if p.name.isdigit()] if folder.is_dir() else []
    return max(steps, default=0)


def being_written(workdir):
    folder = workdir / "checkpoints"
    return folder.is_dir() and any("tmp" in p.name for p in folder.iterdir())


def disturb(command, workdir, kills, seed):
    """Starts and kills a run for each of `kills`, then lets it end. Returns a list of the kills."""
    choice = random.Random(seed)
    done = []
    for kill in kills:
        before = newest(workdir)
        process = command(workdir)
        if kill == "writing":
            goal = before + choice.randrange(3, 18)
            wait_for(lambda g=goal: newest(workdir) >= g, process, workdir)
            wait_for(lambda: being_written(workdir), process, workdir)
            time.sleep(choice.uniform(0, 0.02))
        else:
            wait_for(lambda b=before: newest(workdir) > b, process, workdir)
            time.sleep(choice.uniform(0, 0.2))
        process.send_signal(signal.SIGTERM if kill == "term" else signal.SIGKILL)
        code = process.wait()
        assert code == (143 if kill == "term" else -signal.SIGKILL), log_of(workdir)
        done.append((kill, newest(workdir), being_written(workdir)))
        assert newest(workdir) < STEPS, "the run ended before it was killed"
    assert command(workdir).wait() == 0, log_of(workdir)
    return done


def test_killed_run_ends_bit_identical(command, undisturbed, tmp_path):
    workdir = tmp_path / "run"
    done = disturb(command, workdir, ["writing", "term", "any", "writing"], seed=0)
    assert any(partial for kill, _, partial in done if kill == "writing"), done
    assert_same_end(workdir, undisturbed)
    text = log_of(workdir)
    assert len(re.findall("resuming at step", text)) == 4
    assert "stopped by SIGTERM after step" in text
    assert "Traceback" not in text
    assert "damaged" not in text


def test_a_full_disk_ends_in_one_line_and_the_run_goes_on_when_there_is_room(
    command, undisturbed, tmp_path
):
    workdir = tmp_path / "run"
    process = command(workdir)
    wait_for(lambda: newest(workdir) >= 6, process, workdir)
    resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (2000, resource.RLIM_INFINITY))
    assert process.wait() == 5, log_of(workdir)
    assert "Traceback" not in log_of(workdir)
    last = log_of(workdir).splitlines()[-1]
    assert last.startswith(f"error: {workdir}")
    assert command(workdir).wait() == 0, log_of(workdir)
    assert_same_end(workdir, undisturbed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 4))
def test_killed_many_times_ends_bit_identical(command, undisturbed, tmp_path, seed):
    workdir = tmp_path / "run"
    kills = random.Random(seed).choices(["writing", "term", "any"], k=7)
    disturb(command, workdir, kills, seed)
    assert_same_end(workdir, undisturbed)


@pytest.mark.slow
def test_killed_run_on_records_ends_bit_identical(command, tmp_path):
    """With the real loader, decoding, augmentation and the choice of points are resumed too."""
    splits = {
        "train": solids.samples(20, seed=0, image_size=(48, 64)),
        "validation": solids.samples(5, seed=1, image_size=(48, 64)),
    }
    write_dataset(tmp_path / "records", splits, source="solids", records_per_shard=7)
    flags = [
        f"--config.data.path={tmp_path / 'records'}",
        "--config.data.flip=True",
        "--config.data.stretch=0.2",
        "--config.data.colour_jitter=0.3",
    ]

    def start(workdir):
        return command(workdir, *flags)

    assert start(tmp_path / "whole").wait() == 0, log_of(tmp_path / "whole")
    disturb(start, tmp_path / "run", ["any", "term", "any"], seed=4)
    assert_same_end(tmp_path / "run", tmp_path / "whole")


@pytest.mark.slow
def test_killed_run_with_a_posterior_ends_bit_identical(command, tmp_path):
    flags = [
        "--config.model.posterior=True",
        "--config.model.posterior_widths=(2,2,2)",
        "--config.model.posterior_hidden=4",
        "--config.loss.kl_weight=0.01",
        "--config.loss.kl_warmup_steps=60",
    ]

    def start(workdir):
        return command(workdir, *flags)

    assert start(tmp_path / "whole").wait() == 0, log_of(tmp_path / "whole")
    disturb(start, tmp_path / "run", ["any", "term"], seed=5)
    assert_same_end(tmp_path / "run", tmp_path / "whole")
    assert any("posterior" in name for name in final(tmp_path / "whole").leaves)
    last = lines(tmp_path / "run")[-2]
    assert {"kl", "active_dims", "kl_weight"} <= last.keys()
    assert "nats in" in log_of(tmp_path / "run")


def test_two_trainings_in_one_folder_are_refused(command, undisturbed):
    with locked(undisturbed):
        process = command(undisturbed)
        assert process.wait() == 2
    last = log_of(undisturbed).strip().splitlines()[-1]
    assert last.startswith("error: --workdir=")
    assert "another training is running there" in last


def test_finished_run_has_nothing_to_do(command, undisturbed):
    before = lines(undisturbed)
    assert command(undisturbed).wait() == 0, log_of(undisturbed)
    assert lines(undisturbed) == before


def test_another_configuration_is_refused_and_harmless_changes_are_not(command, undisturbed):
    process = command(undisturbed, "--config.model.fc_points=16", "--config.optim.b1=0.8")
    assert process.wait() == 2
    last = log_of(undisturbed).strip().splitlines()[-1]
    assert last.startswith("error: --workdir=")
    assert "model.fc_points=8 (now 16), optim.b1=0.9 (now 0.8)" in last
    assert command(undisturbed, "--config.train.keep_checkpoints=3").wait() == 0

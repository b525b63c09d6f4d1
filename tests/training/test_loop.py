import functools
import json
import logging
import pathlib
import re
import resource
import shutil
import signal
import socket
import subprocess
import sys

import numpy as np
import pytest
from helpers import standin
from helpers.commands import ROOT
from helpers.processes import wait_for, wait_until
from helpers.refusals import all_refused, refused
from helpers.standin import TINY, VAE, quick_environment, write_config, write_solids

from psgn_jax.config.experiment import ConfigError, from_json
from psgn_jax.data import loader
from psgn_jax.data.dataset import RecordReader, write_dataset
from psgn_jax.system import distributed
from psgn_jax.training.log import NonFiniteError
from psgn_jax.training.loop import train
from psgn_jax.weights.checkpoint import Checkpoints
from psgn_jax.weights.run_folder import locked

pytestmark = pytest.mark.usefixtures("keep_compiled")
LARGE = {"data__image_size": (192, 256)}
EVERY = {"train__images_every": 6, "train__log_every": 4, "eval__max_samples": 6}
changed = functools.partial(standin.config, **TINY, **EVERY)
CONFIG = changed()


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    workdir = tmp_path_factory.mktemp("train") / "run"
    return workdir, train(CONFIG, workdir)


def newest(workdir):
    return Checkpoints(workdir / "checkpoints", read_only=True).restore_newest()


def lines(workdir):
    """Lines of metrics without the numbers that depend on the clock."""
    entries = map(json.loads, (workdir / "metrics.jsonl").read_text().splitlines())
    return [{k: v for k, v in e.items() if k != "samples_per_second"} for e in entries]


def assert_same_leaves(have, want):
    """Of two checkpoints."""
    assert have.leaves.keys() == want.leaves.keys()
    for name, leaf in want.leaves.items():
        np.testing.assert_array_equal(have.leaves[name], leaf, err_msg=name)


def test_a_run_leaves_everything_behind(run):
    workdir, outcome = run
    assert (outcome.stopped_by, int(outcome.state.step)) == (None, 12)
    assert from_json((workdir / "config.json").read_text()) == CONFIG
    entries = lines(workdir)
    assert [e["step"] for e in entries if e["kind"] == "train"] == [4, 8, 12]
    assert [e["step"] for e in entries if e["kind"] == "eval"] == [6, 12]
    assert all(np.isfinite(v) for e in entries for v in e.values() if isinstance(v, float))
    assert list((workdir / "tensorboard").iterdir())
    checkpoints = Checkpoints(workdir / "checkpoints", read_only=True)
    assert 12 in checkpoints.steps()
    assert checkpoints.best_step() in (6, 12)


def test_a_finished_run_has_nothing_to_do_and_another_is_refused(run, caplog, monkeypatch):
    before = lines(run[0])
    with caplog.at_level(logging.INFO, "absl"):
        train(changed(train__keep_checkpoints=3), run[0])  # a harmless change
    assert lines(run[0]) == before
    assert "nothing to do" in caplog.text
    caplog.clear()
    other = changed(model__fc_points=16, optim__b1=0.8, train__steps=20)
    with refused(ConfigError, run[0], "model.fc_points=8 (now 16)", "optim.b1=0.9 (now 0.8)"):
        train(other, run[0])
    assert "compiling" not in caplog.text
    with locked(run[0]), refused(ConfigError, run[0]):
        train(CONFIG, run[0])
    monkeypatch.setattr(distributed, "gather", lambda own: [own, {**own, "optim.b1": 0.5}])
    with refused(ConfigError, "optim.b1=0.9", "0.5"):
        train(CONFIG, run[0].parent / "other")


def test_scores_belong_to_their_records_wherever_these_are(tmp_path, monkeypatch, caplog):
    moved, workdir = tmp_path / "moved", tmp_path / "run"

    def scores(path=moved, **fields):
        caplog.clear()
        with caplog.at_level(logging.WARNING, "absl"):
            train(changed(data__path=str(path), **fields), workdir)
        return Checkpoints(workdir / "checkpoints", read_only=True).scores

    first = scores(write_solids(tmp_path / "records"))
    assert first.keys() == {6, 12}
    shutil.move(tmp_path / "records", moved)
    assert scores() == first
    assert "the evaluation" not in caplog.text
    there = scores(data__eval_split="train")
    assert "(records, data.eval_split)" in caplog.text
    back = scores()  # without a further checkpoint
    assert there.keys() == back.keys() == {12}
    assert first[12] == back[12] != there[12]
    with monkeypatch.context() as patch:  # of another process, with a copy that differs
        differing = lambda own: [own, own + 1] if type(own) is int else [own]  # noqa: E731
        patch.setattr(distributed, "gather", differing)
        with refused(ConfigError, moved, "processes"):
            scores()
    samples = list(RecordReader(moved, "train"))
    shutil.rmtree(moved)
    write_dataset(moved, {"train": samples, "validation": samples[:11]}, source="solids")
    assert scores()[12] != back[12]
    assert "(records)" in caplog.text


def test_non_finite_loss_stops_naming_metric_and_step(tmp_path, monkeypatch):
    def train_batches(cfg, read=loader.train_batches, **arguments):
        batches = read(cfg, **arguments)
        for number, batch in enumerate(batches, arguments["start_step"] + 1):
            if number == 5:
                batch["points"] = np.full_like(batch["points"], np.inf)
            yield batch

    monkeypatch.setattr(loader, "train_batches", train_batches)
    with refused(NonFiniteError, "loss", "step 5", "optim.learning_rate"):
        train(CONFIG, tmp_path / "run")
    assert Checkpoints(tmp_path / "run" / "checkpoints", read_only=True).steps() == [3]


@pytest.mark.usefixtures("unchecked_annotations")
def test_what_does_not_fit_is_named_before_anything_is_written(tmp_path):
    config = standin.config(**TINY, loss__name="chamfer_sq_mean + emd_mean@33", data__num_points=40)
    few = standin.config(loss__min_of_n=2, loss__winner_points=65)
    table = [(config, "loss.name", "'emd_mean@33'", "data.num_points=40")]
    table += [(few, "loss.winner_points=65", "64", "data.num_points")]
    table += [
        (standin.config(**{**TINY, **changes}), *names, "GB of memory")
        for names, changes in (
            (("model.widths",), {"model__widths": (1_000_000, 1_000_000, 8)}),
            (("model.fc_points",), {"model__fc_points": 10**6, "model__fc_widths": (10**6,)}),
            (("data.image_size", "train.batch_size"), {"train__batch_size": 10**6, **LARGE}),
            (("data.image_size", "eval.batch_size"), {"eval__batch_size": 10**6, **LARGE}),
        )
    ]
    all_refused(lambda config: train(config, tmp_path / "run"), ConfigError, table)
    assert not (tmp_path / "run").exists()


@pytest.fixture(scope="module")
def command(tmp_path_factory):
    """A function that starts `psgn_jax.main` on the tiny configuration in a workdir."""
    folder = tmp_path_factory.mktemp("commands")
    file = write_config(folder / "tiny.py", CONFIG)
    environment = quick_environment(folder)

    def start(workdir, *flags):
        program = [sys.executable, "-m", "psgn_jax.main", f"--config={file}"]
        program += [f"--workdir={workdir}", *flags]
        with open(f"{workdir}.log", "a") as log:
            return subprocess.Popen(program, stdout=log, stderr=log, env=environment, cwd=ROOT)

    return start


def log_of(workdir):
    return pathlib.Path(f"{workdir}.log").read_text()


def saved(workdir):
    folder = workdir / "checkpoints"
    return [p.name for p in folder.iterdir()] if folder.is_dir() else []


def newest_step(workdir):
    return max((int(name) for name in saved(workdir) if name.isdigit()), default=0)


@pytest.mark.slow
def test_killed_stopped_and_out_of_space_a_run_ends_with_the_same_bits(command, tmp_path):
    steps, workdir, reference = "--config.train.steps=60", tmp_path / "run", tmp_path / "reference"
    log = tmp_path / "run.log"
    assert command(reference, steps).wait() == 0
    for end in (-signal.SIGKILL, 128 + signal.SIGTERM, 5):
        process = command(workdir, steps)
        goal = newest_step(workdir) + 6
        wait_for(lambda goal=goal: newest_step(workdir) >= goal, process, log)
        if end == 5:  # a full disk
            resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (20_000, resource.RLIM_INFINITY))
        elif end > 0:
            process.send_signal(signal.SIGTERM)
        else:
            wait_for(lambda: any("tmp" in name for name in saved(workdir)), process, log)
            process.kill()  # while a checkpoint is being written
        assert process.wait() == end, log_of(workdir)
    assert log_of(workdir).splitlines()[-1].startswith(f"error: {workdir}")
    assert 0 < newest_step(workdir) < 60
    assert command(workdir, steps).wait() == 0
    assert newest(workdir).step == 60
    assert_same_leaves(newest(workdir), newest(reference))
    assert lines(workdir) == lines(reference)
    scores = [folder / "checkpoints" / "scores.json" for folder in (workdir, reference)]
    assert scores[0].read_text() == scores[1].read_text()
    said = log_of(workdir)
    assert said.count("resuming at step") == 3
    assert "stopped by SIGTERM" in said
    assert not re.search("Traceback|damaged", said)


def test_a_run_in_parts_ends_with_the_same_bits(tmp_path):
    """Decoding, augmentation, the choice of points and random inputs are resumed too.

    The parts end between two lines of metrics, two checkpoints and two evaluations.
    """
    config = functools.partial(
        standin.config, **VAE, data__flip=True, data__stretch=0.2, data__colour_jitter=0.3,
        train__log_every=4,
    )  # fmt: skip
    train(config(), tmp_path / "whole")
    train(config(train__steps=5), tmp_path / "run")
    train(config(), tmp_path / "run")
    assert_same_leaves(newest(tmp_path / "run"), newest(tmp_path / "whole"))
    found, wanted = (
        [e for e in lines(tmp_path / name) if e["kind"] == "train" and e["step"] % 4 == 0]
        for name in ("run", "whole")
    )
    assert found == wanted
    assert {"kl", "active_dims", "kl_weight", "kl_of_dims"} <= found[-1].keys()


@pytest.mark.slow
def test_two_processes_train_and_evaluate_as_one_and_a_signal_stops_both(command, run, tmp_path):
    def start(workdir, *flags):
        with socket.create_server(("127.0.0.1", 0)) as server:
            address = f"127.0.0.1:{server.getsockname()[1]}"
        both = [f"--coordinator={address}", "--num_processes=2", *flags]
        first = command(workdir, *both, "--process_id=0")
        return [first, command(workdir, *both, "--process_id=1")]

    workdir = tmp_path / "run"
    assert [process.wait(300) for process in start(workdir)] == [0, 0], log_of(workdir)
    have, want = newest(workdir), newest(run[0])
    for name, leaf in want.leaves.items():
        np.testing.assert_allclose(have.leaves[name], leaf, rtol=1e-4, atol=2e-6, err_msg=name)
    for mine, theirs in zip(lines(workdir), lines(run[0]), strict=True):
        assert mine.pop("kind") == theirs.pop("kind")
        assert mine == pytest.approx(theirs, rel=1e-4, abs=1e-6)
    assert log_of(workdir).count("done: step 12, results in") == 1

    both = start(workdir, "--config.train.steps=100000", "--config.train.eval_every=0")
    assert wait_until(lambda: newest_step(workdir) > 14, 120), log_of(workdir)
    both[1].send_signal(signal.SIGTERM)
    assert [process.wait(60) for process in both] == [143, 143], log_of(workdir)
    step = newest(workdir).step
    assert f"stopped by SIGTERM after step {step}, checkpoint saved; run" in log_of(workdir)

    both = start(workdir, "--config.train.steps=100000", "--config.train.eval_every=0")
    before = newest_step(workdir)
    assert wait_until(lambda: newest_step(workdir) > before, 300), log_of(workdir)
    both[0].kill()
    both[0].wait()
    assert both[1].wait(120) == 4, log_of(workdir)
    assert "Traceback" not in log_of(workdir)
    assert "another process has ended" in log_of(workdir)

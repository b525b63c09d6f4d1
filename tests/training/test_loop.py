"""Training end to end in one process, on a stand-in data set."""

import dataclasses
import json
import os
import pathlib
import runpy
import subprocess
import sys

import numpy as np
import pytest
from helpers import standin

from psgn_jax.config import ConfigError, from_json, parse
from psgn_jax.data import loader
from psgn_jax.tasks.runs import evaluate_run
from psgn_jax.training.checkpoint import Checkpoints
from psgn_jax.training.log import NonFiniteError, _duration
from psgn_jax.training.loop import train
from psgn_jax.viewing.clouds import render_case, render_cloud

ROOT = pathlib.Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def source(monkeypatch):
    standin.install(monkeypatch)


@pytest.fixture(scope="module")
def config():
    return standin.config(
        model__name="vanilla", model__widths=(4, 6, 8), train__images_every=6, eval__max_samples=6
    )


@pytest.fixture(scope="module")
def run(config, tmp_path_factory):
    workdir = tmp_path_factory.mktemp("train") / "run"
    with pytest.MonkeyPatch.context() as patch:
        standin.install(patch)
        outcome = train(config, workdir)
    return workdir, outcome


def test_a_run_leaves_everything_behind(run, config):
    workdir, outcome = run
    assert outcome.stopped_by is None
    assert int(outcome.state.step) == 12
    assert from_json((workdir / "config.json").read_text()) == config
    lines = [json.loads(line) for line in (workdir / "metrics.jsonl").read_text().splitlines()]
    assert [e["step"] for e in lines if e["kind"] == "train"] == [2, 4, 6, 8, 10, 12]
    assert [e["step"] for e in lines if e["kind"] == "eval"] == [6, 12]
    assert all(np.isfinite(v) for e in lines for v in e.values() if isinstance(v, float))
    assert list((workdir / "tensorboard").iterdir())
    checkpoints = Checkpoints(workdir / "checkpoints", read_only=True)
    assert 12 in checkpoints.steps()
    assert checkpoints.best_step() in (6, 12)


def test_evaluating_the_workdir_repeats_the_evaluation_of_training(run):
    workdir, _ = run
    result = evaluate_run(workdir, checkpoint="last", out=workdir / "again")
    scores = json.loads((workdir / "checkpoints" / "scores.json").read_text())["12"]
    first = {name: float(np.mean(values[:6])) for name, values in result.metrics.items()}
    # Unlike training, the command also measures aligned predictions.
    own = {name: first.pop(name) for name in list(first) if name.startswith("aligned_")}
    assert set(own) >= {"aligned_cd_sq_radius2", "aligned_scale"}
    assert first == pytest.approx(scores, rel=1e-6)
    assert len(result.names) == standin.SIZES["validation"]


def test_non_finite_loss_stops_naming_metric_and_step(config, tmp_path, monkeypatch):
    def train_batches(cfg, **arguments):
        batches = standin.train_batches(cfg, **arguments)
        for number, batch in enumerate(batches, arguments["start_step"] + 1):
            if number == 5:
                batch["points"] = np.full_like(batch["points"], np.inf)
            yield batch

    monkeypatch.setattr(loader, "train_batches", train_batches)
    with pytest.raises(NonFiniteError, match=r"the loss is not finite at step 5;"):
        train(config, tmp_path / "run")
    assert Checkpoints(tmp_path / "run" / "checkpoints", read_only=True).steps() == [3]


def test_missing_split_is_named_before_anything_is_written(tmp_path):
    with pytest.raises(ConfigError, match=r"data.eval_split='tset': no samples"):
        train(standin.config(data__eval_split="tset"), tmp_path / "run")
    assert not (tmp_path / "run").exists()


def test_batches_that_the_devices_do_not_divide(tmp_path):
    """Training refuses the batch before anything is written; an evaluation uses one device."""
    code = f"""
import jax, pytest, sys
jax.config.update("jax_num_cpu_devices", 2)
from psgn_jax.config import ConfigError
from psgn_jax.training.loop import train
sys.path.insert(0, {str(ROOT / "tests")!r})
from helpers import standin
standin.install(pytest.MonkeyPatch())
config = standin.config(
    model__name="vanilla", model__widths=(4, 6, 8), eval__batch_size=3, train__steps=2,
    train__eval_every=2, train__images_every=2, train__log_every=2, optim__warmup_steps=0,
)
train(config, {str(tmp_path / "run")!r})
with pytest.raises(ConfigError, match="train.batch_size=3: accepted: a multiple of the 2 devices"):
    train(standin.config(train__batch_size=3), {str(tmp_path / "refused")!r})
"""
    environment = os.environ | {
        "JAX_PLATFORMS": "cpu",
        "XLA_FLAGS": "--xla_backend_optimization_level=0",
    }
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, cwd=ROOT
    )
    assert result.returncode == 0, result.stderr[-3000:]
    assert not (tmp_path / "refused").exists()
    lines = (tmp_path / "run" / "metrics.jsonl").read_text().splitlines()
    assert [json.loads(line)["kind"] for line in lines] == ["train", "eval"]


def test_emd_wants_equal_sizes_and_trains(config, tmp_path, unchecked_annotations):
    wrong = standin.config(loss__name="emd_mean", data__num_points=33)
    with pytest.raises(ConfigError, match=r"loss.name='emd_mean' with data.num_points=33 and a"):
        train(wrong, tmp_path / "wrong")
    wrong = standin.config(loss__name="chamfer_sq_mean + emd_mean@33", data__num_points=40)
    with pytest.raises(ConfigError, match=r"the term 'emd_mean@33', with data.num_points=40"):
        train(wrong, tmp_path / "wrong")
    wrong = standin.config(loss__name="chamfer_sq_mean@99", data__num_points=40)
    with pytest.raises(ConfigError, match="got 40 points, expected at least 99"):
        train(wrong, tmp_path / "wrong")
    assert not (tmp_path / "wrong").exists()
    changes = {"train": dataclasses.replace(config.train, steps=4, eval_every=0, images_every=0)}
    changes["loss"] = dataclasses.replace(config.loss, name="emd_mean", emd_tolerance=0.05)
    changes["data"] = dataclasses.replace(config.data, num_points=config.model.fc_points)
    train(dataclasses.replace(config, **changes), tmp_path / "run")
    lines = (tmp_path / "run" / "metrics.jsonl").read_text().splitlines()
    assert json.loads(lines[-1])["loss"] > 0


def test_durations():
    assert [_duration(s) for s in (3.4, 61, 3725)] == ["3 s", "1 min 01 s", "1 h 02 min"]


def test_clouds_are_drawn_where_the_camera_sees_them():
    camera = (standin.INTRINSICS.astype(float), standin.EXTRINSICS.astype(float))
    # Two points are on one ray; the nearer one, which is higher up, hides the other.
    centre = np.linalg.inv(camera[1][:, :3]) @ (np.array([0, 0, 3.0]) - camera[1][:, 3])
    nearer = np.linalg.inv(camera[1][:, :3]) @ (np.array([0, 0, 2.0]) - camera[1][:, 3])
    both = render_cloud(np.stack([nearer, centre]), *camera, (48, 64))
    alone = render_cloud(nearer[None], *camera, (48, 64))
    hit = (both != 255).any(axis=-1)
    assert np.argwhere(hit).min(axis=0).tolist() == [23, 31]
    assert hit.sum() == 9
    assert np.abs(both[24, 32].astype(int) - alone[24, 32]).max() < 80
    outside = np.array([[np.nan, 0, 0], [0, 99, 0], [50, 0, 0]])
    assert (render_cloud(outside, *camera, (48, 64)) == 255).all()
    assert (render_cloud(np.zeros((0, 3)), *camera, (48, 64)) == 255).all()
    image = np.zeros((48, 64, 3), np.uint8)
    assert render_case(image, both[0, :5].astype(float), outside, *camera).shape == (192, 1280, 3)


@pytest.mark.parametrize("name", [pytest.param("authors_emd", marks=pytest.mark.slow), "mo2_emd"])
def test_the_emd_configurations_train(tmp_path, name):
    """The configurations with smaller sizes train for three steps and are evaluated."""
    settings = runpy.run_path(str(ROOT / "configs" / f"{name}.py"))["get_config"]()
    small = standin.config()
    settings.data.path = ""
    settings.data.image_size = small.data.image_size
    settings.data.num_points = settings.data.num_eval_points = 136
    settings.model.update(widths=(4, 6, 8, 8), fc_points=8, fc_widths=(12,), deconv_level=1)
    settings.train.update(
        batch_size=4, steps=3, log_every=1, eval_every=3, checkpoint_every=3, images_every=0
    )
    settings.eval.update(batch_size=4, emd_tolerance=0.05)
    settings.optim.warmup_steps = 1
    train(parse(settings), tmp_path / name)
    lines = [
        json.loads(line) for line in (tmp_path / name / "metrics.jsonl").read_text().splitlines()
    ]
    assert [e["step"] for e in lines if e["kind"] == "train"] == [1, 2, 3]
    assert all(np.isfinite(e["loss"]) for e in lines if e["kind"] == "train")
    assert [e["emd_radius"] > 0 for e in lines if e["kind"] == "eval"] == [True]

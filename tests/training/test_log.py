import json
import time

import numpy as np
import pytest
from helpers.processes import without_room

from psgn_jax.config.experiment import TrainConfig
from psgn_jax.training.log import MetricsWriter, TrainingLog, read_metrics


def test_lines_and_tensorboard(tmp_path):
    writer = MetricsWriter(tmp_path)
    writer.scalars(3, "train", {"loss": 0.5}, {"kl_of_dims": np.array([0.25, 0.5], np.float32)})
    writer.scalars(3, "eval", {"cd": float("nan")})
    writer.image(3, "eval/clouds", np.zeros((4, 6, 3), np.uint8))
    writer.close()
    assert read_metrics(tmp_path / "metrics.jsonl") == [
        {"step": 3, "kind": "train", "loss": 0.5, "kl_of_dims": [0.25, 0.5]},
        {"step": 3, "kind": "eval", "cd": None},
    ]
    (events,) = (tmp_path / "tensorboard").iterdir()
    assert all(tag in events.read_bytes() for tag in (b"train/loss", b"eval/clouds"))
    assert b"eval/cd" not in events.read_bytes()


def test_resume_drops_what_comes_again_and_damaged_lines(tmp_path, caplog):
    path = tmp_path / "metrics.jsonl"
    kinds = [(1, "train"), (2, "train"), (2, "eval"), (3, "train")]
    entries = [{"step": step, "kind": kind} for step, kind in kinds]
    text = "".join(json.dumps(e) + "\n" for e in entries)
    path.write_text(text + '{"step": 4, "ki')  # left by a kill: no warning
    MetricsWriter(tmp_path, 2).close()
    assert read_metrics(path) == entries[:3]
    assert not caplog.text
    wrong = [b"[]", b"null", b'{"a": {}}', b"\xff", b"[" * 100_000, b'{"step": true}']
    path.write_bytes(b"\n".join([*wrong, path.read_bytes()]))
    MetricsWriter(tmp_path, 2, evaluated=False).close()
    assert f"metrics.jsonl: {len(wrong)} lines are damaged" in caplog.text
    assert path.read_text() == "".join(json.dumps(e) + "\n" for e in entries[:2])
    MetricsWriter(tmp_path, 0).close()
    assert path.read_text() == ""


def test_a_full_disk_is_an_error_and_no_wait(tmp_path):
    writer = MetricsWriter(tmp_path)
    writer.scalars(1, "train", {"loss": 0.5})
    picture = np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)
    with without_room():
        for step in range(40):  # longer than the queue of tensorboardX
            with pytest.raises(OSError, match="File too large"):
                writer.image(step, "eval/clouds", picture)
    with without_room(60), pytest.raises(OSError, match="No space left"):
        writer.scalars(2, "train", {"loss": 0.5})
    assert all(entry["loss"] == 0.5 for entry in read_metrics(tmp_path / "metrics.jsonl"))
    MetricsWriter(tmp_path, 1).scalars(2, "train", {"loss": 0.5})
    assert [entry["step"] for entry in read_metrics(tmp_path / "metrics.jsonl")] == [1, 2]


def test_every_logged_speed_is_that_of_the_steps(tmp_path):
    plan = TrainConfig(batch_size=3, steps=8, log_every=1)
    writer = MetricsWriter(tmp_path)
    log = TrainingLog(plan, writer, 0)
    for step in range(1, plan.steps + 1):
        time.sleep(0.05)  # the loader is slower than the device
        log.add(step, {name: np.float32(1) for name in ("total_loss", "grad_norm", "loss")})
    log.drain()
    entries = read_metrics(tmp_path / "metrics.jsonl")
    assert [entry["step"] for entry in entries] == list(range(1, 9))
    assert "samples_per_second" not in entries[0]  # the first step includes the compilation
    assert all(10 < entry["samples_per_second"] < 61 for entry in entries[1:])

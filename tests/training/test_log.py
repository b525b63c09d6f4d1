"""Metrics survive kills: no line is lost, none comes twice."""

import json
import pathlib
import struct
import subprocess
import sys

import numpy as np
import pytest
import tensorboardX

from psgn_jax.config import ConfigError, UserError
from psgn_jax.training import log as writer_lib
from psgn_jax.training.log import MetricsWriter, locked, read_metrics, write_atomic

ROOT = pathlib.Path(__file__).resolve().parents[2]


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
    data = events.read_bytes()
    records = 0
    while data:  # a record: length, its checksum, payload, its checksum
        (length,) = struct.unpack("<Q", data[:8])
        data = data[16 + length :]
        records += 1
    assert records == 5


def test_resume_drops_what_comes_again(tmp_path):
    path = tmp_path / "metrics.jsonl"
    entries = [
        {"step": s, "kind": k} for s, k in [(1, "train"), (2, "train"), (2, "eval"), (3, "train")]
    ]
    text = "".join(json.dumps(e) + "\n" for e in entries)
    path.write_text(text + '{"step": 4, "ki')
    MetricsWriter(tmp_path, 2).close()
    assert read_metrics(path) == entries[:3]
    MetricsWriter(tmp_path, 2, evaluated=False).close()
    assert read_metrics(path) == entries[:2]
    MetricsWriter(tmp_path, 0).close()
    assert path.read_text() == ""


def test_torn_and_foreign_lines_are_passed_over(tmp_path):
    path = tmp_path / "metrics.jsonl"
    path.write_text('{"step": 1}\n[]\n{"step": "x"}\nnoise\n{"step": 2}\n{"st')
    assert [e["step"] for e in read_metrics(path)] == [1, 2]
    assert read_metrics(tmp_path / "none") == []


def test_a_killed_run_is_purged_from_tensorboard_also_before_its_first_checkpoint(
    tmp_path, monkeypatch
):
    purged = []

    class Board:
        def __init__(self, folder, purge_step):
            purged.append(purge_step)
            pathlib.Path(folder).mkdir(exist_ok=True)

        def add_scalar(self, *_):
            pass

        close = add_scalar

    monkeypatch.setattr(tensorboardX, "SummaryWriter", Board)
    for step in (0, 0, 5):
        writer = MetricsWriter(tmp_path, step)
        writer.scalars(step + 1, "train", {"loss": 0.5})
        writer.close()
    assert purged == [None, 1, 6]


def test_terminal_shows_own_progress_and_others_warnings():
    code = """
from absl import logging
from psgn_jax.training import log
from psgn_jax.data.sources import authors
from psgn_jax import convert
writer.log_to_terminal()
logging.info("of another package")
logging.warning("their warning")
exec(compile("logging.info('own progress')", convert.__file__, "exec"))
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    lines = [line.partition(" ")[2] for line in result.stderr.splitlines()]
    assert lines == ["their warning", "own progress"], result.stderr


def test_a_folder_is_locked_until_its_owner_ends(tmp_path):
    with locked(tmp_path / "run"), pytest.raises(ConfigError, match="another training is running"):
        locked(tmp_path / "run").__enter__()
    with locked(tmp_path / "run"):
        pass


def test_write_atomic_replaces_whole_files(tmp_path, monkeypatch):
    path = tmp_path / "new" / "file"
    write_atomic(path, "one")
    assert path.read_text() == "one"

    def fail(*_):
        raise OSError("disk full")

    monkeypatch.setattr(writer_lib.os, "fsync", fail)
    with pytest.raises(OSError, match="disk full"):
        write_atomic(path, "two")
    assert path.read_text() == "one"
    assert [p.name for p in path.parent.iterdir()] == ["file"]


def test_user_errors_end_in_one_line(capsys):
    with pytest.raises(SystemExit) as caught, writer_lib.exit_on_user_error():
        raise UserError("one\n two")
    assert caught.value.code == 2
    assert capsys.readouterr().err == "error: one two\n"

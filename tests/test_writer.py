"""Metrics survive kills: no line is lost, none comes twice."""

import json
import struct

import numpy as np
import pytest

from psgn_jax import writer as writer_lib
from psgn_jax.config import UserError
from psgn_jax.writer import MetricsWriter, read_metrics, write_atomic


def test_lines_and_tensorboard(tmp_path):
    writer = MetricsWriter(tmp_path)
    writer.scalars(3, "train", {"loss": 0.5})
    writer.scalars(3, "eval", {"cd": float("nan")})
    writer.image(3, "eval/clouds", np.zeros((4, 6, 3), np.uint8))
    writer.close()
    assert read_metrics(tmp_path / "metrics.jsonl") == [
        {"step": 3, "kind": "train", "loss": 0.5},
        {"step": 3, "kind": "eval", "cd": None},
    ]
    (events,) = (tmp_path / "tensorboard").iterdir()
    data = events.read_bytes()
    records = 0
    while data:  # a record: length, its checksum, payload, its checksum
        (length,) = struct.unpack("<Q", data[:8])
        data = data[16 + length :]
        records += 1
    assert records == 4


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

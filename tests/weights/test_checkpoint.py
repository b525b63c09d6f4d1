import logging

import jax.numpy as jnp
import numpy as np
import pytest
from helpers.refusals import refused

from psgn_jax.weights import checkpoint
from psgn_jax.weights.checkpoint import CheckpointError, Checkpoints


def leaves(value):
    return {
        "params.a.kernel": jnp.full((2, 3, 4), value, jnp.float32),
        "params.a.bias": np.random.default_rng(0).normal(size=100_000).astype(np.float32),
        "step": jnp.int32(value),
    }


def fill(folder, steps, keep=2, scores=()):
    checkpoints = Checkpoints(folder, keep)
    scores = dict(scores)
    for step in steps:
        checkpoints.save(step, leaves(step), {"config": {"seed": step}})
        if step in scores:
            checkpoints.score(step, {"cd_sq_radius2": scores[step]})
    checkpoints.close()
    return checkpoints


def test_round_trip_keeps_every_bit(tmp_path):
    fill(tmp_path / "c", [1, 5])
    found = Checkpoints(tmp_path / "c").restore_newest()
    assert found.step == 5
    assert found.meta == {"config": {"seed": 5}}
    for name, leaf in leaves(5).items():
        np.testing.assert_array_equal(found.leaves[name], leaf, strict=True)
    # The caller may overwrite the arrays at once.
    array = np.zeros(300_000, np.float32)
    checkpoints = Checkpoints(tmp_path / "c")
    checkpoints.save(6, {"a": array}, {})
    array[:] = 1
    checkpoints.close()
    assert not checkpoints.restore_newest().leaves["a"].any()


def test_newest_and_best_are_kept(tmp_path):
    checkpoints = fill(tmp_path / "c", range(1, 7), 2, {1: 0.5, 2: 0.1, 4: 0.3, 6: float("nan")})
    assert checkpoints.steps() == [2, 5, 6]
    assert checkpoints.best_step() == 2
    assert Checkpoints(tmp_path / "c").best_step() == 2


@pytest.mark.parametrize("damage", ["flip", "truncate", "remove", "flip in meta"])
def test_damaged_newest_falls_back(tmp_path, damage, caplog, capfd):
    folder = tmp_path / "c"
    fill(folder, [1, 2], scores={2: 0.1})
    largest = max((folder / "2").rglob("*"), key=lambda p: p.stat().st_size * p.is_file())
    data, meta = largest.read_bytes(), folder / "2" / "meta" / "metadata"
    middle = len(data) // 2
    if damage == "remove":
        largest.unlink()
    elif damage == "truncate":
        largest.write_bytes(data[:middle])
    elif damage == "flip":
        largest.write_bytes(data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :])
    else:
        meta.write_text(meta.read_text().replace('"seed": 2', '"seed": 3'))

    reader = Checkpoints(folder, read_only=True)
    assert reader.restore_newest(best_first=True).step == 1
    assert reader.steps() == [1, 2]
    again = Checkpoints(folder)
    with caplog.at_level(logging.WARNING, "absl"):
        assert again.restore_newest().step == 1
    assert "checkpoint 2 is damaged" in caplog.text
    assert "Traceback" not in capfd.readouterr().err  # orbax prints nothing
    assert again.best_step() is None
    again.save(2, leaves(2), {})
    again.close()
    assert (folder / "damaged" / "2").is_dir()
    assert Checkpoints(folder).restore_newest().step == 2


def test_a_checkpoint_of_another_step_or_version_is_refused(tmp_path, monkeypatch):
    fill(tmp_path, [10, 20])
    (tmp_path / "20").rename(tmp_path / "30")
    for read_only in (True, False):
        with refused(CheckpointError, "30", "step 20"):
            Checkpoints(tmp_path, read_only=read_only).restore_newest()
    (tmp_path / "30").rename(tmp_path / "20")
    assert Checkpoints(tmp_path).restore_newest().step == 20
    before = sorted(tmp_path.rglob("*"))
    monkeypatch.setattr(checkpoint, "FORMAT", 0)
    with refused(CheckpointError, tmp_path / "20", "later version", 1, 0):
        Checkpoints(tmp_path).restore_newest()
    assert sorted(tmp_path.rglob("*")) == before


def test_damaged_scores_are_none_with_a_warning(tmp_path, caplog):
    folder = tmp_path / "c"
    fill(folder, [1, 2], scores={1: 0.5})
    for content in (
        b"[]", b'{"a":{}}', b"\xff", b"[" * 100_000, b'{"1": {"iou": "x"}}',
        b'{"measured": 1}', b'{"1": {"cd_sq_radius2": %s}}' % (b"9" * 4000),
        b'{"1": {"cd_sq_radius2": 0.25}, "crc32": 1}',
    ):  # fmt: skip
        (folder / "scores.json").write_bytes(content)
        caplog.clear()
        with caplog.at_level(logging.WARNING, "absl"):
            checkpoints = Checkpoints(folder)
        assert "scores.json is damaged" in caplog.text, content[:40]
        assert checkpoints.scores == {}
        assert checkpoints.best_step() is None
    checkpoints.score(2, {"cd_sq_radius2": 0.25})
    assert Checkpoints(folder).best_step() == 2


def test_leftovers_are_removed_but_unreadable_checkpoints_stay(tmp_path):
    fill(tmp_path / "c", [1])
    leftovers = [tmp_path / "c" / n for n in ("2.orbax-checkpoint-tmp", "0.deleting")]
    for leftover in leftovers:
        leftover.mkdir()
        (leftover / "file").touch()
    assert Checkpoints(tmp_path / "c", read_only=True).restore_newest().step == 1
    assert all(leftover.exists() for leftover in leftovers)
    assert Checkpoints(tmp_path / "c").restore_newest().step == 1
    assert not any(leftover.exists() for leftover in leftovers)
    fill(tmp_path, [1])
    for path in [p for p in (tmp_path / "1").rglob("*") if p.is_file()]:
        path.write_bytes(b"")
    again = Checkpoints(tmp_path)
    with refused(CheckpointError, tmp_path, "step 1"):
        again.restore_newest()
    assert again.steps() == [1]

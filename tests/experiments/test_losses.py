"""CD against EMD: strays, paired differences, runs that cannot be compared, a picture."""

import json

import numpy as np
import pytest

from psgn_jax.config import ConfigError, flatten, parse, to_json
from psgn_jax.experiments import losses as lib
from psgn_jax.metrics.evaluation import Evaluation, SampleName


def test_both_trainings_differ_in_the_loss_alone():
    a, b = (flatten(lib.configuration(loss, "", full=False)) for loss in lib.LOSSES.values())
    assert {k for k in a if a[k] != b[k]} == {"loss.name"}
    assert a["data.num_points"] == 1024
    assert flatten(lib.configuration("emd_mean", "", full=True))["train.steps"] == 20_000


def test_stray_missed_and_uneven_points():
    gt = np.stack([np.linspace(0, 1, 101), np.zeros(101), np.zeros(101)], axis=1)
    pred = gt[0:51:10].copy()
    pred[0] += [0, 0, 0.3]
    found = lib.own_measures(pred.astype(np.float32), gt.astype(np.float32))
    assert found["stray"] == pytest.approx(1 / 6)
    assert found["missed"] == pytest.approx(40 / 101, abs=0.021)
    assert lib.own_measures(gt[::10], gt)["unevenness"] == pytest.approx(0, abs=1e-6)
    assert found["unevenness"] > 0.3
    assert lib.apart(pred, pred) == pytest.approx(0, abs=1e-12)
    assert lib.apart(gt[:1], gt[50:51]) == pytest.approx(0.5)


def metrics(emd, fscore):
    return {
        "cd_sq_radius2": np.array([1.0, 2, 3, 4]), "emd_radius": np.array(emd),
        "fscore": np.array(fscore), "stray": np.array([0.1, 0.2, 0.1, 0.0]),
    }  # fmt: skip


def test_the_table_and_its_numbers():
    both = {
        "cd": metrics([1.0, 2, 3, 4], [0.1, 0.2, 0.3, 0.4]),
        "emd": metrics([0.5, 1, 3.5, 3], [0.2, 0.3, 0.4, 0.3]),
    }
    change = np.array([-0.5, -1, 0.5, -1])
    found = lib.compare(both, "emd_radius")
    assert found.mean == pytest.approx(change.mean())
    assert found.error == pytest.approx(change.std(ddof=1) / 2)
    assert found.better == 0.75
    assert lib.compare(both, "fscore").better == 0.75  # the larger the better
    names = [SampleName(i, "car", f"m{i}", 0) for i in range(4)]
    evaluation = Evaluation("validation", names, {}, 0.01, (1024, 4096), 0.025)
    text = lib.table(both, evaluation, {"cd": 30, "emd": 30})
    assert "after 30 steps of each training" in text
    assert "(not equal)" in lib.table(both, evaluation, {"cd": 30, "emd": 20})
    lines = lib.markdown(both, evaluation, {"cd": 30, "emd": 30}).splitlines()
    assert {x.count("|") for x in lines if x.startswith("|")} == {6}
    document = json.loads(json.dumps(lib.numbers(both, evaluation), allow_nan=False))
    assert document["emd_minus_cd"]["emd_radius"]["mean"] == pytest.approx(-0.5)
    assert document["mean_over_samples"]["cd"]["stray"] == pytest.approx(0.1)


def test_runs_that_cannot_be_compared(tmp_path):
    def make(name, **changes):
        folder = tmp_path / name
        folder.mkdir()
        tree = {"data": {"path": str(tmp_path), "num_points": 1024}, "loss": {"name": "emd_mean"}}
        (folder / "config.json").write_text(to_json(parse({**tree, **changes})))
        return folder

    emd, cd = make("emd"), make("cd", loss={"name": "chamfer_sq_mean"})
    other = make("other", model={"name": "hourglass"})
    with pytest.raises(ConfigError, match=r"--cd=.*a run trained by CD"):
        lib.run(tmp_path, trained={"cd": emd, "emd": emd})
    with pytest.raises(ConfigError, match=r"model\.name: 'two_branch' in --cd, 'hourglass'"):
        lib.run(tmp_path, trained={"cd": cd, "emd": other})
    with pytest.raises(ConfigError, match="not with --cd, --emd"):
        lib.run(tmp_path, trained={"cd": cd, "emd": emd}, steps=2)


def test_figure(rng):
    cloud = rng.uniform(-0.4, 0.4, (60, 3)).astype(np.float32)
    case = {
        "image": np.full((24, 32, 3), 100, np.uint8),
        "points": np.repeat(cloud, 2, axis=0),
        "clouds": {"cd": cloud, "emd": cloud},
        "texts": {"image": "car", "cd": "CD 1", "emd": "CD 2"},
        "intrinsics": np.array([[50, 0, 16], [0, 50, 12], [0, 0, 1.0]], np.float32),
        "extrinsics": np.array([[0, 1, 0, 0], [0, 0, -1, 0.3], [-1, 0, 0, 3.6]], np.float32),
    }
    sheet = np.asarray(lib.figure({0: case}))
    assert sheet.shape == (24 + 192 + 22, 7 * (256 + 8), 3)
    for column, channel in ((1, 2), (2, 1), (4, 2), (5, 1)):
        panel = sheet[24:216, column * 264 : column * 264 + 256].astype(int)
        drawn = panel[np.ptp(panel, axis=2) > 40]
        assert len(drawn)
        assert (drawn.argmax(axis=1) == channel).all()

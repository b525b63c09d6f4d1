"""CD against EMD: stray points, paired differences, runs that cannot be compared, a picture."""

import numpy as np
import pytest

from psgn_jax.config import ConfigError, flatten, parse, to_json
from psgn_jax.experiments import common
from psgn_jax.experiments import losses as lib


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
    numbers = lib.compare(both)
    found = common.Difference(**numbers["emd_minus_cd"]["emd_radius"])
    assert found.mean == pytest.approx(change.mean())
    assert found.error == pytest.approx(change.std(ddof=1) / 2)
    assert found.better == 0.75
    assert found.mean == pytest.approx(-0.5)
    assert numbers["emd_minus_cd"]["fscore"]["better"] == 0.75  # larger is better
    assert numbers["mean_over_samples"]["cd"]["stray"] == pytest.approx(0.1)
    (lines,) = lib.table(numbers)
    assert ["EMD [radius]", "2.50000", "2.00000", "-0.50000 +- 0.35355", "75 %"] in lines
    assert lines[-1][:3] == [
        "predicted points farther than .1 from the truth [%]",
        "10.00",
        "10.00",
    ]
    about = {"samples": 4, "split": "validation", "steps": {"cd": 30, "emd": 20}}
    assert lib.STUDY.text_below(about).startswith(
        "4 samples of 'validation', cd: 30 steps, emd: 20"
    )


def test_runs_that_cannot_be_compared(tmp_path):
    def make(name, **changes):
        folder = tmp_path / name
        folder.mkdir()
        tree = {"data": {"path": str(tmp_path), "num_points": 1024}, "loss": {"name": "emd_mean"}}
        (folder / "config.json").write_text(to_json(parse({**tree, **changes})))
        return folder

    emd, cd = make("emd"), make("cd", loss={"name": "chamfer_sq_mean"})
    other = make("other", model={"name": "hourglass"})
    with pytest.raises(ConfigError, match=r"--cd=.*expected a run trained with CD"):
        lib.STUDY.run(tmp_path, cd=emd, emd=emd)
    with pytest.raises(ConfigError, match=r"model\.name: 'two_branch' in --cd, 'hourglass'"):
        lib.STUDY.run(tmp_path, cd=cd, emd=other)
    with pytest.raises(ConfigError, match="without --cd and --emd"):
        lib.STUDY.run(tmp_path, cd=cd, emd=emd, steps=2)
    with pytest.raises(ConfigError, match="expected both or neither"):
        lib.STUDY.run(tmp_path, cd=cd)


def test_panels(rng):
    cloud = rng.uniform(-0.4, 0.4, (60, 3)).astype(np.float32)
    case = {
        "image": np.full((24, 32, 3), 100, np.uint8),
        "points": np.repeat(cloud, 2, axis=0),
        "cd": cloud,
        "emd": cloud,
        "intrinsics": np.array([[50, 0, 16], [0, 50, 12], [0, 0, 1.0]], np.float32),
        "extrinsics": np.array([[0, 1, 0, 0], [0, 0, -1, 0.3], [-1, 0, 0, 3.6]], np.float32),
    }
    panels = list(lib.panels(case).values())
    assert [panel.shape for panel in panels] == [(192, 256, 3)] * 7
    for column, channel in ((1, 2), (2, 1), (4, 2), (5, 1)):
        panel = panels[column].astype(int)
        drawn = panel[np.ptp(panel, axis=2) > 40]
        assert len(drawn)
        assert (drawn.argmax(axis=1) == channel).all()

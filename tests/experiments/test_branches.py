"""The study of both branches: order, nearest points, fifths, maps; a run with only one branch."""

import json

import numpy as np
import pytest
from helpers import drawn_solids as solids
from PIL import Image

from psgn_jax.config import ConfigError, flatten, parse, to_json
from psgn_jax.data.dataset import write_dataset
from psgn_jax.experiments import branches as lib
from psgn_jax.models.point_layout import branch_of_point, output_grid

MODEL = {"widths": (4, 6, 8), "deconv_level": 1, "fc_points": 30, "fc_widths": (8,)}
CONFIG = parse({"data": {"image_size": (24, 32)}, "model": MODEL})
BRANCHES, GRID = branch_of_point(CONFIG.model), output_grid(CONFIG.model)


def sheet_and_tips(rng):
    """A sheet and two thin rods: deconv points lie on the sheet, fc points on the rods."""
    row, column = np.mgrid[: GRID.height, : GRID.width]
    sheet = np.stack([row / GRID.height, column / GRID.width, 0 * row], axis=-1) - [0.5, 0.5, 0]
    along = rng.permutation(np.concatenate([np.linspace(-1.0, -0.6, 15), np.linspace(0.6, 1, 15)]))
    rods = np.stack([0 * along, along, 0 * along], axis=1)
    pred = np.concatenate([rods, sheet.reshape(-1, 3)]).astype(np.float32)
    flat = np.concatenate([rng.uniform(-0.5, 0.5, (900, 2)), np.zeros((900, 1))], axis=1)
    return pred, np.concatenate([flat, rods, rods, rods]).astype(np.float32)


def test_a_sheet_with_rods_is_told_from_the_rods(rng):
    pred, gt = sheet_and_tips(rng)
    sample = lib.measure_sample(pred, gt, BRANCHES, GRID)
    measures, both, profiles = sample
    assert measures["fc"]["points"] == 30
    assert measures["deconv"]["order"] < 0.25
    assert measures["fc"]["order"] > 0.7
    assert measures["fc"]["pred_to_gt"] == pytest.approx(0, abs=1e-9)
    assert measures["fc"]["share"] + measures["deconv"]["share"] == pytest.approx(1)
    assert both <= min(measures[name]["gt_to_pred"] for name in measures)
    assert profiles["by_distance"][-1] > 0.4 > 0.1 > profiles["by_distance"][0]
    assert profiles["by_surroundings"][-1] > profiles["by_surroundings"][0]
    # The same distances, computed directly.
    gaps = np.linalg.norm(gt[:, None] - pred[None, 30:], axis=-1) ** 2
    assert measures["deconv"]["gt_to_pred"] == pytest.approx(gaps.min(axis=1).mean(), rel=1e-5)

    found = lib.gather([sample, sample])
    assert found["branches"]["fc"]["points"]["mean"] == 30
    first, *_, last = (
        fifth["mean"] for fifth in found["fc_share_in_fifths"]["by_distance"]["fifths"]
    )
    change = found["fc_share_in_fifths"]["by_distance"]["last_minus_first"]
    assert change["mean"] == pytest.approx(last - first)
    assert change["error"] == pytest.approx(0)
    branches, fifths = lib.table(found)
    assert branches[1] == ["points", "30", str(len(BRANCHES.deconv)), ""]
    assert {len(line) for line in branches} == {4}
    assert [line[-1] for line in fifths[1:]] == [
        f"{100 * found['fc_share_in_fifths'][key]['last_minus_first']['mean']:+.1f} +- 0.0"
        for key in lib.PROFILES
    ]


def test_neighbours_are_cells_side_by_side_and_below():
    pairs = lib.neighbours_in_grid(GRID._replace(height=2, width=3, points_per_cell=2))
    assert len(pairs) == 2 * (2 * 2 + 3)
    assert {tuple(pair) for pair in pairs.tolist()} >= {(0, 2), (1, 3), (0, 6), (5, 11)}


def test_shares_of_fifths():
    of = np.array([True] * 2 + [False] * 8)
    assert lib.shares(of, np.arange(10)).tolist() == [1, 0, 0, 0, 0]
    assert lib.shares(of, -np.arange(10)).tolist() == [0, 0, 0, 0, 1]


def test_the_recipe_and_a_run_without_a_second_branch(tmp_path):
    config = lib.configuration("", full=False)
    assert (config.train.steps, config.data.image_size) == (3_200, (96, 128))
    assert flatten(lib.configuration("", full=True, steps=7))["train.steps"] == 7
    alone = parse({"model": {"name": "vanilla"}, "data": {"path": str(tmp_path)}})
    (tmp_path / "config.json").write_text(to_json(alone))
    with pytest.raises(ConfigError, match="expected a network with both branches"):
        lib.STUDY.run(tmp_path / "out", run=tmp_path)
    with pytest.raises(ConfigError, match="without --run"):
        lib.STUDY.run(tmp_path / "out", run=tmp_path, steps=3)


def test_panels(rng):
    pred, gt = sheet_and_tips(rng)
    case = {
        "image": np.full((24, 32, 3), 100, np.uint8),
        "points": gt,
        "pred": pred,
        "intrinsics": np.array([[50, 0, 16], [0, 50, 12], [0, 0, 1.0]], np.float32),
        "extrinsics": np.array([[0, 1, 0, 0], [0, 0, -1, 0.3], [-1, 0, 0, 3.6]], np.float32),
    }
    panels = list(lib.panels(case, CONFIG).values())
    assert len(panels) == 8
    x, y, z = panels[1:4]
    assert x.shape == (GRID.height, GRID.width)
    assert (x[0] == x[0, 0]).all()
    assert x[0, 0] != x[-1, 0]  # x runs down the grid,
    assert y[0, 0] != y[0, -1]  # y across it,
    assert (z == z[0, 0]).all()  # and z is one
    by_branch = panels[4].astype(int)
    drawn = by_branch[np.ptp(by_branch, axis=2) > 40]
    assert (drawn[:, 0] > drawn[:, 2]).any()
    assert (drawn[:, 0] < drawn[:, 2]).any()


def test_the_whole_study_and_again(tmp_path, monkeypatch):
    def configuration(path, *, full, steps):
        data = {"path": path, "image_size": (12, 16), "num_points": 50, "num_eval_points": 60}
        train = {
            "batch_size": 2, "steps": 1, "log_every": 1, "eval_every": 0, "checkpoint_every": 0,
            "images_every": 0,
        }  # fmt: skip
        model = {"widths": (4, 6), "deconv_level": 0, "fc_points": 20, "fc_widths": (8,)}
        evaluation = {"batch_size": 3, "emd_tolerance": 0}
        return parse({"data": data, "model": model, "train": train, "eval": evaluation})

    monkeypatch.setattr(lib, "configuration", configuration)
    data, work = tmp_path / "data", tmp_path / "work"
    drawn = list(solids.samples(4, seed=0, image_size=(24, 32)))
    write_dataset(data, {"train": drawn[:2], "validation": drawn}, source="")
    text = lib.STUDY.run(work, data=str(data), cases=2)
    assert text == (work / "branches.txt").read_text()
    document = json.loads((work / "branches.json").read_text())
    assert (document["samples"], document["steps"]) == (4, {"training": 1})
    with Image.open(work / "branches.png") as picture:
        assert picture.size[0] > 8 * 256

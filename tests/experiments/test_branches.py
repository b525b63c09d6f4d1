"""What each branch does: order, nearest points, fifths, maps; a run that has no second branch."""

import json

import numpy as np
import pytest
from helpers import drawn_solids as solids
from PIL import Image

from psgn_jax.config import ConfigError, flatten, parse, to_json
from psgn_jax.data.dataset import write_dataset
from psgn_jax.experiments import branches as lib
from psgn_jax.metrics.evaluation import Evaluation, SampleName
from psgn_jax.models.point_layout import branch_of_point, output_grid

MODEL = {"widths": (4, 6, 8), "deconv_level": 1, "fc_points": 30, "fc_widths": (8,)}
CONFIG = parse({"data": {"image_size": (24, 32)}, "model": MODEL})
BRANCHES, GRID = branch_of_point(CONFIG.model), output_grid(CONFIG.model)


def sheet_and_tips(rng):
    """A flat sheet, which the grid lies on, with two thin rods, which the fc points lie on."""
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
    # The distances, slowly.
    gaps = np.linalg.norm(gt[:, None] - pred[None, 30:], axis=-1) ** 2
    assert measures["deconv"]["gt_to_pred"] == pytest.approx(gaps.min(axis=1).mean(), rel=1e-5)

    found = lib.gather([sample, sample])
    names = [SampleName(i, "car", f"m{i}", 0) for i in range(2)]
    metrics = {"cd_sq_radius2": np.array([0.01, 0.02])}
    evaluation = Evaluation("validation", names, metrics, 0.01, (222, 990), 0.025)
    text = lib.table(evaluation, found)
    assert "fc has more of the nearest points far from the centre" in text
    assert "a main body" in text
    document = json.loads(json.dumps(lib.numbers(evaluation, found), allow_nan=False))
    assert document["branches"]["fc"]["points"]["mean"] == 30
    lines = [x for x in lib.markdown(evaluation, found).splitlines() if x.startswith("|")]
    assert {x.count("|") for x in lines} == {5, 8}


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
    with pytest.raises(ConfigError, match="accepted: a network with both branches"):
        lib.run(tmp_path / "out", trained=tmp_path)
    with pytest.raises(ConfigError, match="not with --run"):
        lib.run(tmp_path / "out", trained=tmp_path, steps=3)


def test_figure(rng):
    pred, gt = sheet_and_tips(rng)
    case = {
        "image": np.full((24, 32, 3), 100, np.uint8),
        "points": gt,
        "pred": pred,
        "intrinsics": np.array([[50, 0, 16], [0, 50, 12], [0, 0, 1.0]], np.float32),
        "extrinsics": np.array([[0, 1, 0, 0], [0, 0, -1, 0.3], [-1, 0, 0, 3.6]], np.float32),
    }
    sheet = np.asarray(lib.figure({0: case, 5: case}, CONFIG))
    assert sheet.shape == (24 + 2 * (192 + 8) + 48, 7 * (256 + 8), 3)
    maps = [sheet[24:216, c * 264 : c * 264 + 256] for c in (1, 2, 3)]
    assert (maps[0][0] == maps[0][15]).all()  # one cell, enlarged sixteen times
    assert (maps[0][0, 0] != maps[0][-1, 0]).any()  # x runs down the grid,
    assert (maps[1][0, 0] != maps[1][0, -1]).any()  # y across it,
    assert (maps[2] == maps[2][0, 0]).all()  # and z is one
    by_branch = sheet[24:216, 4 * 264 : 4 * 264 + 256].astype(int)
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
    text = lib.run(work, data=str(data), num_cases=2)
    assert text == (work / "branches.txt").read_text()
    document = json.loads((work / "branches.json").read_text())
    assert (document["samples"], document["steps"]) == (4, 1)
    with Image.open(work / "branches.png") as picture:
        assert picture.size == (7 * 264, 24 + 2 * 200 + 48)

"""RGB against RGB-D: two runs that differ in their input alone, resumed, measured, drawn."""

import dataclasses
import json
import pathlib
import runpy

import numpy as np
import pytest
from helpers import drawn_solids as solids
from PIL import Image

from psgn_jax.config import ConfigError, flatten, parse
from psgn_jax.data.dataset import write_dataset
from psgn_jax.experiments import common
from psgn_jax.experiments import completion as lib
from psgn_jax.metrics.evaluation import Evaluation, SampleName

ROOT = pathlib.Path(__file__).resolve().parents[2]


def config_file(name):
    return flatten(parse(runpy.run_path(str(ROOT / "configs" / f"{name}.py"))["get_config"]()))


@pytest.mark.parametrize(
    ("full", "name"), [(False, "authors_small"), (True, "authors"), (True, "rgbd_cd")]
)
def test_the_recipe_is_that_of_the_configuration_file(full, name):
    theirs = config_file(name)
    ours = flatten(lib.configuration(theirs["data.inputs"], "records/authors", full=full))
    shortened = {"train.steps"} if not full else set()
    intervals = {"train.eval_every", "train.checkpoint_every", "train.images_every"}
    assert {k for k in ours if ours[k] != theirs[k]} <= shortened | intervals


def test_both_networks_differ_in_what_they_see_alone():
    a, b = (flatten(lib.configuration(i, "", full=False, steps=9)) for i in lib.INPUTS.values())
    assert {k for k in a if a[k] != b[k]} == {"data.inputs"}
    assert a["train.steps"] == 9


def test_rgbd_emd_is_authors_emd_with_depth():
    a, b = config_file("authors_emd"), config_file("rgbd_emd")
    assert {k for k in a if a[k] != b[k]} == {"data.inputs"}
    assert b["data.inputs"] == ("rgb", "mask", "depth")


def test_data_named_found_or_drawn(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(common, "default_dataset", lambda: "rendered")
    assert lib.find_data(None) == lib.find_data("") == "rendered"
    with pytest.raises(ConfigError, match="does not exist"):
        lib.find_data("no/such")
    pathlib.Path(lib.USUAL_DATA).mkdir(parents=True)
    assert lib.find_data(None) == lib.USUAL_DATA
    assert lib.find_data("records") == "records"


def evaluation(hidden, fscore):
    names = [SampleName(i, "car", f"m{i}", 0) for i in range(4)]
    metrics = {
        "cd_sq_radius2": np.array([1.0, 2, 3, 4]),
        "fscore": np.array(fscore),
        "cd_sq_gt_to_pred_hidden_radius2": np.array(hidden),
        "visible_share": np.array([0.5, 0.5, 0.5, 1.0]),
    }
    return Evaluation("validation", names, metrics, 0.01, (1024, 4096), 0.025)


def test_differences_are_paired_and_leave_out_what_no_sample_has():
    both = {
        "rgb": evaluation([1.0, 2.0, 3.0, np.nan], [0.1, 0.2, 0.3, 0.4]),
        "rgbd": evaluation([0.5, 1.0, 3.5, np.nan], [0.2, 0.3, 0.4, 0.3]),
    }
    hidden = lib.compare(both, "cd_sq_gt_to_pred_hidden_radius2")
    change = np.array([-0.5, -1.0, 0.5])
    assert hidden.mean == pytest.approx(change.mean())
    assert hidden.error == pytest.approx(change.std(ddof=1) / np.sqrt(3))
    assert hidden.better == pytest.approx(2 / 3)
    assert lib.compare(both, "fscore").better == pytest.approx(3 / 4)  # the larger the better
    text = lib.table(both)
    (line,) = [x for x in text.splitlines() if x.startswith("hidden true points")]
    assert "2.00000" in line
    assert "1.66667" in line
    assert "67 %" in line
    assert "62.5 % are visible" in text
    lines = lib.markdown(both).splitlines()
    assert lines[0] == "|  | RGB | RGB-D | difference | RGB-D better on |"
    assert {x.count("|") for x in lines if x.startswith("|")} == {6}
    document = json.loads(json.dumps(lib.numbers(both), allow_nan=False))
    assert document["mean_over_samples"]["rgb"]["fscore"] == pytest.approx(0.25)
    assert document["rgbd_minus_rgb"]["fscore"]["mean"] == pytest.approx(0.05)


def tiny(inputs, path, *, full, steps):
    return parse(
        {
            "data": {
                "path": path, "inputs": inputs, "image_size": (24, 32), "num_points": 50,
                "num_eval_points": 60,
            },
            "model": {"name": "vanilla", "widths": (4, 6), "fc_points": 20, "fc_widths": (8,)},
            "train": {
                "batch_size": 2, "steps": steps or 2, "log_every": 1, "eval_every": 0,
                "checkpoint_every": 1, "images_every": 0,
            },
            "eval": {"batch_size": 3, "emd_tolerance": 0},
        }
    )  # fmt: skip


@pytest.mark.slow
def test_the_whole_study_and_again(tmp_path, monkeypatch):
    monkeypatch.setattr(lib, "configuration", tiny)
    drawn = list(solids.samples(5, seed=0, image_size=(48, 64)))
    data = tmp_path / "data"
    write_dataset(data, {"train": drawn[:2], "validation": drawn}, source="")
    work = tmp_path / "work"
    text = lib.run(work, data=str(data), num_cases=2)
    assert "hidden true points" in text
    assert text == (work / "completion.txt").read_text()
    document = json.loads((work / "completion.json").read_text())
    assert set(document["mean_over_samples"]) == {"rgb", "rgbd"}
    assert document["samples"] == 5
    picture = np.asarray(Image.open(work / "completion.png"))
    assert picture.shape == (24 + 2 * 192, 8 * 256, 3)  # 24x32 images, enlarged eight times
    # What is done is not trained again, and gives the same numbers.
    before = {name: (work / name / "metrics.jsonl").read_bytes() for name in lib.INPUTS}
    assert lib.run(work, data=str(data), num_cases=2) == text
    assert before == {name: (work / name / "metrics.jsonl").read_bytes() for name in lib.INPUTS}

    bare = tmp_path / "bare"
    flat = [dataclasses.replace(s, depth=None) for s in drawn[:2]]
    write_dataset(bare, {"train": flat, "validation": flat}, source="")
    with pytest.raises(ConfigError, match="asks for depth"):
        lib.run(tmp_path / "other", data=str(bare))
    assert not (tmp_path / "other").exists()


def test_figure_has_both_colours(rng):
    s = next(solids.samples(1, seed=0, image_size=(96, 128)))
    case = {k: getattr(s, k) for k in ("image", "depth", "points", "intrinsics", "extrinsics")}
    case |= {"visible": s.points[:, 0] > 0, "pred": s.points[::64] + np.float32(0.01)}
    sheet = np.asarray(lib.figure({"rgb": {3: case}, "rgbd": {3: case}}))
    assert sheet.shape == (24 + 192, 8 * 256, 3)
    for column in range(2, 8):
        panel = sheet[24:, column * 256 : (column + 1) * 256].astype(int)
        drawn = panel[(panel != 255).any(axis=2)]
        assert (drawn[:, 2] > drawn[:, 0]).any()
        assert (drawn[:, 2] < drawn[:, 0]).any()
    assert (lib.depth_picture(np.zeros((2, 3), np.float32)) == 255).all()

"""RGB against RGB-D: two runs that differ only in their inputs are resumed, measured and drawn."""

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
    assert common.find_data(None) == common.find_data("") == "rendered"
    with pytest.raises(ConfigError, match="does not exist"):
        common.find_data("no/such")
    pathlib.Path(common.USUAL_DATA).mkdir(parents=True)
    assert common.find_data(None) == common.USUAL_DATA
    assert common.find_data("records") == "records"


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
    changes = common.differences({name: found.metrics for name, found in both.items()})
    hidden = common.Difference(**changes["cd_sq_gt_to_pred_hidden_radius2"])
    change = np.array([-0.5, -1.0, 0.5])
    assert hidden.mean == pytest.approx(change.mean())
    assert hidden.error == pytest.approx(change.std(ddof=1) / np.sqrt(3))
    assert hidden.better == pytest.approx(2 / 3)
    assert changes["fscore"]["better"] == pytest.approx(3 / 4)  # larger is better
    assert changes["fscore"]["mean"] == pytest.approx(0.05)
    means = {name: found.means for name, found in both.items()}
    assert means["rgb"]["fscore"] == pytest.approx(0.25)
    (lines,) = lib.table({"mean_over_samples": means, "rgbd_minus_rgb": changes})
    assert lines[0] == ["", "RGB", "RGB-D", "difference", "RGB-D better on"]
    (line,) = [line for line in lines if line[0].startswith("hidden true points")]
    assert line[1:3] == ["2.00000", "1.66667"]
    assert line[3] == f"{change.mean():+.5f} +- {change.std(ddof=1) / np.sqrt(3):.5f}"
    assert line[4] == "67 %"
    assert ["visible true points [%]", "62.50", "62.50", "+0.00 +- 0.00", "0 %"] in lines


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
    text = lib.STUDY.run(work, data=str(data), cases=2)
    assert "hidden true points" in text
    assert text == (work / "completion.txt").read_text()
    document = json.loads((work / "completion.json").read_text())
    assert set(document["mean_over_samples"]) == {"rgb", "rgbd"}
    assert document["samples"] == 5
    assert "5 samples of 'validation', 20 predicted points, 60 true points, rgb: 2 steps" in text
    with Image.open(work / "completion.png") as picture:
        assert picture.size[0] > 8 * 256
    # A finished run is not trained again and gives the same numbers.
    before = {name: (work / name / "metrics.jsonl").read_bytes() for name in lib.INPUTS}
    assert lib.STUDY.run(work, data=str(data), cases=2) == text
    assert before == {name: (work / name / "metrics.jsonl").read_bytes() for name in lib.INPUTS}

    bare = tmp_path / "bare"
    flat = [dataclasses.replace(s, depth=None) for s in drawn[:2]]
    write_dataset(bare, {"train": flat, "validation": flat}, source="")
    with pytest.raises(ConfigError, match="asks for depth"):
        lib.STUDY.run(tmp_path / "other", data=str(bare))
    assert not (tmp_path / "other").exists()


def test_panels_have_both_colours():
    s = next(solids.samples(1, seed=0, image_size=(96, 128)))
    case = {k: getattr(s, k) for k in ("image", "depth", "points", "intrinsics", "extrinsics")}
    case |= {"visible": s.points[:, 0] > 0, "pred": s.points[::64] + np.float32(0.01)}
    image, depth, *clouds = lib.panels(case, case).values()
    assert image.shape == (192, 256, 3)
    assert np.isnan(depth[s.depth == 0]).all()
    assert len(clouds) == 6
    for panel in (panel.astype(int) for panel in clouds):
        coloured = panel[np.ptp(panel, axis=2) > 40]
        assert (coloured[:, 2] > coloured[:, 0]).any()
        assert (coloured[:, 2] < coloured[:, 0]).any()

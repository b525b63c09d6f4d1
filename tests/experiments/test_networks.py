"""The networks compared: equal parameters, costs, differences, bars; the study, resumed."""

import json

import numpy as np
import pytest
from helpers import drawn_solids as solids
from PIL import Image

from psgn_jax.config import flatten, parse
from psgn_jax.data.dataset import write_dataset
from psgn_jax.experiments import branches, losses
from psgn_jax.experiments import networks as lib
from psgn_jax.metrics.evaluation import Evaluation, SampleName


@pytest.fixture(scope="module")
def configs():
    return {
        name: lib.configuration(name, loss, "", full=False)
        for name, loss in zip(lib.NETWORKS, ("cd", "cd", "emd", "cd"), strict=True)
    }


def test_one_budget_and_equal_parameters(configs):
    flat = {name: flatten(config) for name, config in configs.items()}
    for name, fields in flat.items():
        changed = {k for k in fields if fields[k] != flat["hourglass"][k]}
        assert changed <= {"model.name", "model.fc_points", "model.fc_widths", "loss.name"}, name
    counts = {name: lib.num_parameters(config) for name, config in configs.items()}
    assert counts["fc_equal"] == pytest.approx(counts["two_branch"], rel=2e-3)
    assert counts["hourglass"] > counts["two_branch"] < counts["vanilla"]
    assert flat["fc_equal"]["model.name"] == "vanilla"


def results(rng):
    names = [SampleName(i, "car", f"m{i}", 0) for i in range(9)]
    found = {}
    for loss in lib.LOSSES:
        for factor, name in zip((1.0, 1.05, 0.8, 0.7), lib.NETWORKS, strict=True):
            metrics = {
                "cd_sq_radius2": factor * rng.uniform(0.9, 1.1, 9) / 100,
                "emd_radius": factor * rng.uniform(0.9, 1.1, 9) / 10,
            }
            evaluation = Evaluation("validation", names, metrics, 0.01, (1024, 4096))
            found[f"{name}_{loss}"] = lib.Trained(evaluation, 4_300_000, 0.25, 3.0)
    return found


def test_tables_numbers_and_bars(rng):
    found = results(rng)
    text = lib.table(found, 700)
    assert "two-branch - vanilla" in text
    assert "after 700 steps" in text
    change = lib.compare(found, "two_branch", "vanilla", "emd")
    assert change.mean < 0
    assert change.better == 1
    lines = [x for x in lib.markdown(found, 700).splitlines() if x.startswith("|")]
    assert {x.count("|") for x in lines} == {10, 6}
    document = json.loads(json.dumps(lib.numbers(found), allow_nan=False))
    assert document["differences"]["two_branch - vanilla"]["emd"]["mean"] == pytest.approx(
        change.mean
    )
    picture = np.asarray(lib.figure(found))
    for colour in lib._COLOURS:
        assert (picture == colour).all(axis=2).sum() > 1000
    # The lower the error, the lower the bar: two groups, the last bar the lowest of each.
    heights = [(picture == colour).all(axis=2).sum() for colour in lib._COLOURS]
    assert heights[3] < heights[2] < heights[0]


def test_costs_of_a_log(tmp_path):
    lines = [
        {"step": 1, "kind": "train", "loss": 1.0},
        {"step": 3, "kind": "train", "samples_per_second": 8.0},
        {"step": 3, "kind": "eval", "cd_sq_radius2": 1.0},
        {"step": 5, "kind": "train", "samples_per_second": 4.0},
    ]
    (tmp_path / "metrics.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    seconds, minutes = lib.cost(tmp_path, 8)
    assert seconds == 1.5
    assert minutes == pytest.approx((2 * 1 + 2 * 2) / 60)
    (tmp_path / "metrics.jsonl").write_text("")
    assert np.isnan(lib.cost(tmp_path, 8)).all()


def tiny(path, network, loss):
    model = {"widths": (4, 6), "deconv_level": 0, "deconv_channels": 3, "fc_widths": (8,)}
    model |= {"name": network, "fc_points": 256 if network == "vanilla" else 64}
    return parse(
        {
            "data": {
                "path": path, "image_size": (12, 16), "num_points": 256, "num_eval_points": 256,
            },
            "model": model,
            "loss": {"name": lib.LOSSES[loss]},
            "train": {
                "batch_size": 2, "steps": 2, "log_every": 1, "eval_every": 0,
                "checkpoint_every": 1, "images_every": 0,
            },
            "eval": {"batch_size": 3},
        }
    )  # fmt: skip


@pytest.mark.slow
def test_the_whole_study_again_and_what_takes_its_runs(tmp_path, monkeypatch):
    def configuration(network, loss, path, *, full, steps):
        return tiny(path, network, loss)

    # Two trainings; the whole set differs in nothing but its number.
    monkeypatch.setattr(lib, "configuration", configuration)
    monkeypatch.setattr(lib, "NETWORKS", {"two_branch": "two-branch"})
    monkeypatch.setattr(lib, "PAIRS", (("two_branch", "two_branch"),))
    monkeypatch.setattr(lib, "figure", lambda results: Image.new("RGB", (9, 9)))
    data, work = tmp_path / "data", tmp_path / "work"
    drawn = list(solids.samples(4, seed=0, image_size=(48, 64)))
    write_dataset(data, {"train": drawn[:2], "validation": drawn}, source="")
    text = lib.run(work, data=str(data))
    assert text == (work / "networks.txt").read_text()
    document = json.loads((work / "networks.json").read_text())
    assert document["runs"].keys() == {"two_branch_cd", "two_branch_emd"}
    before = {p: p.read_bytes() for p in work.glob("*/metrics.jsonl")}

    trained = {"cd": work / "two_branch_cd", "emd": work / "two_branch_emd"}
    text = losses.run(tmp_path / "losses", trained=trained, num_cases=2)
    assert "2 steps of each training" in text
    document = json.loads((tmp_path / "losses/losses.json").read_text())
    apart = list(document["shown"].values())
    assert len(apart) == 2
    assert apart == sorted(apart, reverse=True)
    branches.run(tmp_path / "branches", trained=trained["emd"], data=str(data), num_cases=2)
    document = json.loads((tmp_path / "branches/branches.json").read_text())
    assert document["samples"] == 4
    assert document["branches"]["deconv"]["points"]["mean"] == 192
    with Image.open(tmp_path / "branches/branches.png") as picture:
        assert picture.size == (7 * 264, 24 + 2 * 200 + 48)
    assert before == {p: p.read_bytes() for p in work.glob("*/metrics.jsonl")}

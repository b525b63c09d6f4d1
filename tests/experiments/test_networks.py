"""The comparison of networks: equal parameters, costs, differences, bars; a resumed study."""

import dataclasses
import json

import numpy as np
import pytest
from helpers import drawn_solids as solids
from PIL import Image

from psgn_jax.config import flatten, parse, to_json
from psgn_jax.data.dataset import write_dataset
from psgn_jax.experiments import branches, common, figures, losses
from psgn_jax.experiments import networks as lib


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
    found = {}
    for loss in lib.LOSSES:
        for factor, name in zip((1.0, 1.05, 0.8, 0.7), lib.NETWORKS, strict=True):
            found[f"{name}_{loss}"] = {
                "cd_sq_radius2": factor * rng.uniform(0.9, 1.1, 9) / 100,
                "emd_radius": factor * rng.uniform(0.9, 1.1, 9) / 10,
            }
    return found


def document(found):
    runs = {
        name: {
            "parameters": 4_300_000,
            "seconds_per_step": 0.25,
            "minutes_of_steps": 3.0,
            "mean_over_samples": {key: float(values.mean()) for key, values in metrics.items()},
        }
        for name, metrics in found.items()
    }
    return {
        "runs": runs,
        "differences": {f"{a} - {b}": lib.compare(found, a, b) for a, b in lib.PAIRS},
        "vanilla_differences": {n: lib.compare(found, n, "vanilla") for n in lib.NETWORKS},
    }


def test_tables_numbers_and_bars(rng):
    found = results(rng)
    change = lib.compare(found, "two_branch", "vanilla")["emd"]
    values = [found[f"{name}_emd"]["emd_radius"] for name in ("two_branch", "vanilla")]
    assert change["mean"] == pytest.approx((values[0] - values[1]).mean())
    assert change["mean"] < 0
    assert change["better"] == 1
    numbers = document(found)
    networks, pairs = lib.table(numbers)
    assert [len(line) for line in networks] == [9] * 5
    assert [line[0] for line in pairs[1:]] == [
        "two-branch - vanilla (fc)", "two-branch - fc, parameters of two-branch",
        "hourglass - two-branch", "hourglass - vanilla (fc)",
    ]  # fmt: skip
    assert pairs[1][4] == "100 %"
    ratios = lib.ratios(numbers)
    assert ratios["vanilla"] == [(1.0, 0.0), (1.0, 0.0)]
    assert ratios["two_branch"][1][0] == pytest.approx(values[0].mean() / values[1].mean())
    assert ratios["two_branch"][1][1] == pytest.approx(change["error"] / values[1].mean())
    (figure,) = lib.figure(numbers, None).values()
    heights = [[bar.get_height() for bar in bars] for bars in figure.axes[0].containers
               if hasattr(bars, "patches")]  # fmt: skip
    assert heights == [[value for value, _ in pair] for pair in ratios.values()]
    assert figures.png(figure).startswith(b"\x89PNG")


def test_costs_of_a_log(tmp_path):
    lines = [
        {"step": 1, "kind": "train", "loss": 1.0},
        {"step": 3, "kind": "train", "samples_per_second": 8.0},
        {"step": 3, "kind": "eval", "cd_sq_radius2": 1.0},
        {"step": 5, "kind": "train", "samples_per_second": 4.0},
    ]
    (tmp_path / "metrics.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    (tmp_path / "config.json").write_text(to_json(parse({"train": {"batch_size": 8}})))
    seconds, total = common.cost(tmp_path)
    assert seconds == 1.5
    assert total == pytest.approx(2 * 1 + 2 * 2)
    (tmp_path / "metrics.jsonl").write_text("")
    assert np.isnan(common.cost(tmp_path)).all()


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

    # Only two of the eight trainings, which are all alike.
    monkeypatch.setattr(lib, "configuration", configuration)
    monkeypatch.setattr(lib, "NETWORKS", {"two_branch": "two-branch"})
    monkeypatch.setattr(lib, "PAIRS", (("two_branch", "two_branch"),))
    compare = lib.compare
    monkeypatch.setattr(lib, "compare", lambda m, one, _: compare(m, one, "two_branch"))
    study = dataclasses.replace(lib.STUDY, figure=lambda *_: {})
    data, work = tmp_path / "data", tmp_path / "work"
    drawn = list(solids.samples(4, seed=0, image_size=(48, 64)))
    write_dataset(data, {"train": drawn[:2], "validation": drawn}, source="")
    text = study.run(work, data=str(data))
    assert text == (work / "networks.txt").read_text()
    document = json.loads((work / "networks.json").read_text())
    assert document["runs"].keys() == {"two_branch_cd", "two_branch_emd"}
    before = {p: p.read_bytes() for p in work.glob("*/metrics.jsonl")}

    trained = {"cd": work / "two_branch_cd", "emd": work / "two_branch_emd"}
    text = losses.STUDY.run(tmp_path / "losses", **trained, cases=2)
    assert "cd: 2 steps, emd: 2 steps" in text
    document = json.loads((tmp_path / "losses/losses.json").read_text())
    apart = list(document["shown"].values())
    assert len(apart) == 2
    assert apart == sorted(apart, reverse=True)
    branches.STUDY.run(tmp_path / "branches", run=trained["emd"], data=str(data), cases=2)
    document = json.loads((tmp_path / "branches/branches.json").read_text())
    assert document["samples"] == 4
    assert document["branches"]["deconv"]["points"]["mean"] == 192
    with Image.open(tmp_path / "branches/branches.png") as picture:
        assert picture.size[0] > 7 * 256
    assert before == {p: p.read_bytes() for p in work.glob("*/metrics.jsonl")}

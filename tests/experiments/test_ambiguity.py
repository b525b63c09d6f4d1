"""The study of several plausible shapes: measures, table, a tiny run if Mitsuba is installed."""

import json

import jax
import numpy as np
import pytest
from PIL import Image

from data_gen.catalogues import doubt
from data_gen.mitsuba_setup import has_mitsuba
from data_gen.surface import sample_surface
from psgn_jax.experiments import ambiguity as lib
from psgn_jax.experiments import hidden_depth


def truth_cloud(seed, hidden, count=4096):
    model = doubt.generate("front", seed, hidden)
    points = sample_surface(model, count, 0).points.astype(np.float32)
    return points, model.parameters


def test_the_geometry_is_that_of_the_catalogue():
    assert hidden_depth.DEPTH_RANGE == doubt.DEPTH
    assert pytest.approx(doubt.LENGTH / 2 - doubt.PANEL) == hidden_depth.BODY_BEGINS
    assert pytest.approx(doubt.LENGTH - doubt.PANEL) == hidden_depth.DEEPEST
    assert {lib.DOUBT, lib.NO_DOUBT} == set(doubt.KINDS)


def test_depth_is_read_off_the_true_points():
    for seed in range(4):
        for hidden in range(4):
            points, parameters = truth_cloud(seed, hidden)
            found = hidden_depth.measured_depth(points, parameters["scale"])
            assert found == pytest.approx(parameters["hidden"]["depth"], abs=0.02)
    assert hidden_depth.measured_depth(np.zeros((3, 3)), 1.0) == doubt.DEPTH[0]


def test_groups_and_calibration_of_exact_draws(rng):
    known = [
        hidden_depth.Truth("front", 1, 1.0, 0.5),
        hidden_depth.Truth("turned", 1, 1.0, 0.5),
    ] * 3
    assert hidden_depth.groups(known) == {1: [0, 2, 4]}
    exact = rng.uniform(*doubt.DEPTH, (6, 400))
    found = hidden_depth.calibration(exact, known)
    floor = found["Wasserstein-1 of exact draws [share]"]
    assert found["Wasserstein-1 of the depth, one image [share]"] < 2 * floor
    assert found["coverage of the range of depths"] > 0.98
    point = hidden_depth.calibration(np.full((6, 10), np.mean(doubt.DEPTH)), known)
    single = found["Wasserstein-1 of a single value, the mean [share]"]
    assert point["Wasserstein-1 of the depth, one image [share]"] == pytest.approx(single, abs=1e-3)


def test_goals_and_table():
    alone = {"K": 1, "CD of one draw, front [radius^2]": 0.01}
    sampler = {
        "K": 8,
        "CD of the best of K, front [radius^2]": 0.005,
        "spread along x, front [radius]": 0.2,
        "spread along y and z, front [radius]": 0.05,
        "spread, front [radius]": 0.2,
        "spread, turned [radius]": 0.02,
    }
    results = {"deterministic": alone, "Mo2": sampler}
    judged = lib.judge(results)
    assert list(judged["Mo2"].values()) == pytest.approx([0.5, 4, 0.1])
    measures, goals = lib.table({"networks": results, "reached": judged})
    assert ["spread, front [radius]", "-", "0.2"] in measures
    assert goals[1:] == [
        ["best of K / deterministic", "<= 0.70", "0.500"],
        ["hidden / visible spread", ">= 3.00", "4.000"],
        ["spread, unambiguous / ambiguous images", "<= 0.33", "0.100"],
    ]


def test_the_better_of_two_asks_for_too_little_spread_and_of_eight_for_all():
    assert lib.spread_of_the_minimiser(1) == pytest.approx(0, abs=1e-3)
    # Two equally likely numbers a and -a would be best at 1/4, with .43 of the truth's spread.
    assert lib.spread_of_the_minimiser(2) == pytest.approx(0.556, abs=5e-3)
    assert lib.spread_of_the_minimiser(8) == pytest.approx(1.0, abs=0.02)


def test_panels():
    points, _ = truth_cloud(0, 0, 256)
    sample = {
        "image": np.full((64, 64, 3), 191, np.uint8),
        "points": points,
        "intrinsics": np.array([[133, 0, 32], [0, 133, 32], [0, 0, 1]], np.float32),
        "extrinsics": np.array([[0, 1, 0, 0], [0, 0, -1, 0.45], [-1, 0, 0, 3.6]], np.float32),
    }
    clouds = {"deterministic": points[None, :128], "Mo2": np.stack([points[:128]] * 3)}
    rows = lib.panels((sample, np.stack([points] * 2), clouds), 90)
    assert list(rows["deterministic"]) == ["image", "prediction", "true shape 1", "true shape 2"]
    assert list(rows["Mo2"]) == ["image", "draw 1", "draw 2", "draw 3"]
    for row in rows.values():
        for panel in list(row.values())[1:]:
            drawn = np.argwhere((panel < 160).any(axis=-1))
            assert len(drawn) > 450
            assert (np.abs(drawn.mean(axis=0) - 96) < 48).all()  # not at the panel's edge


@pytest.mark.slow
@pytest.mark.skipif(not has_mitsuba(), reason="rendering is not installed")
def test_whole_study_goes_on_where_it_was(tmp_path, monkeypatch):
    size = lib.Size(
        seeds=(2, 1),
        draws=(2, 2),
        image_size=(32, 32),
        model={
            "widths": (4, 6, 8),
            "deconv_level": 1,
            "fc_points": 16,
            "fc_widths": (16,),
            "posterior_widths": (2, 2),
            "posterior_hidden": 4,
        },
        num_points=128,
        steps=3,
        batch_size=4,
        num_draws=3,
        num_measured=4,
    )
    monkeypatch.setattr(lib, "DEFAULT", size)
    text = lib.STUDY.run(tmp_path)
    assert "coverage of the true shapes" in text
    document = json.loads((tmp_path / "ambiguity.json").read_text())
    assert set(document["networks"]) == set(lib.NETWORKS)
    assert set(document["reached"]) == set(lib.NETWORKS) - {"deterministic"}
    with Image.open(tmp_path / "ambiguity.png") as figure:
        assert figure.size[0] > 4 * 192
    jax.clear_caches()
    assert lib.STUDY.run(tmp_path) == text

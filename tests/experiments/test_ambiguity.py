"""The study of several plausible shapes: its measures, its table, and a tiny run where it can."""

import json

import jax
import numpy as np
import pytest
from PIL import Image

from data_gen.catalogues import doubt
from data_gen.mitsuba_setup import has_mitsuba
from data_gen.surface import sample_surface
from psgn_jax.experiments import ambiguity as lib


def truth_cloud(seed, hidden, count=4096):
    model = doubt.generate("front", seed, hidden)
    points = sample_surface(model, count, 0).points.astype(np.float32)
    return points, model.parameters


def test_the_geometry_is_that_of_the_catalogue():
    assert lib._DEPTH_RANGE == doubt.DEPTH
    assert pytest.approx(doubt.LENGTH / 2 - doubt.PANEL) == lib._BODY_BEGINS
    assert pytest.approx(doubt.LENGTH - doubt.PANEL) == lib._DEEPEST
    assert {lib.DOUBT, lib.NO_DOUBT} == set(doubt.KINDS)


def test_depth_is_read_off_the_true_points():
    for seed in range(4):
        for hidden in range(4):
            points, parameters = truth_cloud(seed, hidden)
            found = lib.measured_depth(points, parameters["scale"])
            assert found == pytest.approx(parameters["hidden"]["depth"], abs=0.02)
    assert lib.measured_depth(np.zeros((3, 3)), 1.0) == doubt.DEPTH[0]


def test_groups_and_calibration_of_exact_draws(rng):
    known = [lib.Truth("front", 1, 1.0, 0.5), lib.Truth("turned", 1, 1.0, 0.5)] * 3
    assert lib._groups(known) == {1: [0, 2, 4]}
    exact = rng.uniform(*doubt.DEPTH, (6, 400))
    found = lib._calibration(exact, known)
    floor = found["Wasserstein-1 of exact draws [share]"]
    assert found["Wasserstein-1 of the depth, one image [share]"] < 2 * floor
    assert found["coverage of the range of depths"] > 0.98
    point = lib._calibration(np.full((6, 10), np.mean(doubt.DEPTH)), known)
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
    judged = lib.judge(results)["Mo2"]
    assert list(judged.values()) == pytest.approx([0.5, 4, 0.1])
    text = lib.table(results)
    assert "best of K over deterministic (goal <= 0.70)" in text
    assert "hidden over visible spread (goal >= 3.00)" in text


def test_the_better_of_two_asks_for_too_little_spread_and_of_eight_for_all():
    assert lib.spread_of_the_minimiser(1) == pytest.approx(0, abs=1e-3)
    # Two equally likely numbers a and -a would be best at 1/4, with .43 of the truth's spread.
    assert lib.spread_of_the_minimiser(2) == pytest.approx(0.556, abs=5e-3)
    assert lib.spread_of_the_minimiser(8) == pytest.approx(1.0, abs=0.02)


def test_figure(rng):
    points, _ = truth_cloud(0, 0, 256)
    sample = {
        "image": np.full((64, 64, 3), 191, np.uint8),
        "points": points,
        "intrinsics": np.array([[133, 0, 32], [0, 133, 32], [0, 0, 1]], np.float32),
        "extrinsics": np.array([[0, 1, 0, 0], [0, 0, -1, 0.45], [-1, 0, 0, 3.6]], np.float32),
    }
    clouds = {"deterministic": points[None, :128], "Mo2": np.stack([points[:128]] * 3)}
    picture = np.asarray(lib.figure(sample, np.stack([points] * 2), clouds, height=64))
    # A picture, then a prediction and two truths, or three draws.
    panel = 55 - 13
    assert picture.shape == (2 * (3 * panel + 24), 4 * 64, 3)
    for top in (24, 24 + panel, 48 + 3 * panel):
        for left in (64, 128, 192):
            drawn = np.argwhere((picture[top : top + panel, left : left + 64] < 160).any(axis=-1))
            assert len(drawn) > 50
            assert (np.abs(drawn.mean(axis=0) - [21, 32]) < 16).all()  # not at the panel's edge


@pytest.mark.slow
@pytest.mark.skipif(not has_mitsuba(), reason="rendering is not installed")
def test_whole_study_goes_on_where_it_was(tmp_path):
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
    text = lib.run(tmp_path, size)
    assert "coverage of the true shapes" in text
    document = json.loads((tmp_path / "ambiguity.json").read_text())
    assert set(document["networks"]) == set(lib.NETWORKS)
    assert set(document["reached"]) == set(lib.NETWORKS) - {"deterministic"}
    with Image.open(tmp_path / "ambiguity.png") as figure:
        assert figure.size[0] == 4 * 150
    jax.clear_caches()
    assert lib.run(tmp_path, size) == text

"""The paper's statements about mean shapes, on small clouds."""

import json

import jax
import numpy as np
import pytest
from PIL import Image

from psgn_jax.experiments import mean_shape as lib


@pytest.mark.parametrize("distribution", lib.DISTRIBUTIONS, ids=lambda d: d.name)
def test_shapes_lie_where_the_drawing_and_the_measures_expect_them(distribution):
    keys = jax.random.split(jax.random.key(0), 40)
    clouds = np.asarray(jax.vmap(lambda k: distribution.draw(k, 200))(keys))
    assert clouds.shape == (40, 200, 2)
    assert np.abs(clouds).max() < 0.6
    assert len(np.unique(clouds[:, 0], axis=0)) == 40
    measures = distribution.measure(clouds[0])
    assert all(np.isfinite(v) for v in measures.values())
    if "points in no shape at all [%]" in measures:
        assert all(distribution.measure(c)["points in no shape at all [%]"] == 0 for c in clouds)


@pytest.mark.slow
def test_half_of_the_bars_have_their_share_of_points_in_the_disk():
    keys = jax.random.split(jax.random.key(1), 400)
    outside = [lib.measure_disk(np.asarray(lib.bar_with_disk(k, 400))) for k in keys[:100]]
    shares = np.array([m["points outside the bar [%]"] for m in outside])
    assert 30 < (shares > 0).sum() < 70
    disk = np.pi * lib.DISK**2
    want = 100 * disk / (disk + 4 * lib.BAR[0] * lib.BAR[1])
    assert shares[shares > 0].mean() == pytest.approx(want, abs=1)


def test_measure_of_a_circle():
    angle = np.linspace(0, 2 * np.pi, 50)
    points = 0.3 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    found = lib.measure_circle(points)
    assert found["mean radius"] == pytest.approx(0.3)
    assert found["spread of the radius"] == pytest.approx(0, abs=1e-12)


@pytest.mark.slow
def test_emd_keeps_the_circle_and_cd_blurs_it():
    spread = {}
    for name, distance in lib.DISTANCES.items():
        points = lib.mean_shape(
            distance, lib.circle, jax.random.key(0), num_points=48, steps=150, shapes=4
        )
        measures = lib.measure_circle(np.asarray(points))
        assert measures["mean radius"] == pytest.approx(np.mean(lib.RADII), abs=0.03)
        spread[name] = measures["spread of the radius"]
    assert spread["EMD"] < 0.3 * spread["CD"]


def test_files(tmp_path, monkeypatch):
    monkeypatch.setattr(lib, "DISTRIBUTIONS", lib.DISTRIBUTIONS[:1])
    text = lib.STUDY.run(tmp_path, points=16, steps=2)
    assert "circle of random radius" in text
    document = json.loads((tmp_path / "mean_shape.json").read_text())
    assert set(document["measures"]["circle of random radius"]) == {"EMD", "CD"}
    picture = np.asarray(Image.open(tmp_path / "mean_shape.png"))
    assert (picture[..., :3] == [205, 30, 30]).all(axis=-1).sum() > 0

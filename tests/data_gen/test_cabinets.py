"""Cabinets with a hidden depth: the depth changes neither the front view nor the normalisation."""

import numpy as np

from data_gen import cameras
from data_gen.catalogues import cabinets

_SPLITS = ("train", "validation")


def test_the_depth_moves_nothing_that_normalisation_reads():
    models = [cabinets.generate("front", 5, h) for h in range(6)]
    depths = [m.parameters["hidden"]["depth"] for m in models]
    assert len(set(depths)) == 6
    assert all(cabinets.DEPTH[0] <= d <= cabinets.DEPTH[1] for d in depths)
    for m in models:
        np.testing.assert_allclose(m.vertices.min(axis=0), models[0].vertices.min(axis=0))
        np.testing.assert_allclose(m.vertices.max(axis=0), models[0].vertices.max(axis=0))
        assert m.parameters["scale"] == models[0].parameters["scale"]
        visible = {k: v for k, v in m.parameters.items() if k not in ("hidden", "hidden_seed")}
        assert visible == {
            k: v for k, v in models[0].parameters.items() if k not in ("hidden", "hidden_seed")
        }


def test_what_the_depth_moves_is_behind_the_panel():
    camera = cameras.make(
        image_size=(64, 64), azimuth=0, elevation=0, distance=3.6, focal=400, roll=0, aim=0.45
    )
    for seed in range(20):
        shallow, deep = (cabinets.generate("front", seed, h).vertices for h in range(2))
        moved = np.abs(shallow - deep).max(axis=1) > 1e-9
        assert moved.any()
        assert len(shallow) == len(deep)
        front = deep[:, 0] > 0.9 * deep[:, 0].max()
        panel, _ = cameras.project(deep[front], camera)
        for cloud in (shallow, deep):
            behind, _ = cameras.project(cloud[moved], camera)
            assert (behind > panel.min(axis=0)).all()
            assert (behind < panel.max(axis=0)).all()


def test_catalogue_keeps_seeds_in_one_split():
    catalogue = cabinets.cabinets((3, 2), (2, 4))
    entries = catalogue.models
    assert len(entries) == 2 * (3 * 2 + 2 * 4)
    assert len({e.model_id for e in entries}) == len(entries)
    seeds = {s: {e.model_id.split("-")[1] for e in entries if e.split == s} for s in _SPLITS}
    assert not seeds["train"] & seeds["validation"]
    assert entries[0].load().model_id == entries[0].model_id

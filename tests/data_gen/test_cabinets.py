import numpy as np
from helpers.solid_models import view

from data_gen import cameras
from data_gen.catalogues import cabinets


def test_the_depth_moves_only_what_is_behind_the_panel():
    models = [cabinets.generate("front", 5, h) for h in range(6)]
    first, depths = models[0], {m.parameters["hidden"]["depth"] for m in models}
    assert len(depths) == 6
    assert cabinets.DEPTH[0] <= min(depths) < max(depths) <= cabinets.DEPTH[1]
    for m in models:
        np.testing.assert_allclose(m.vertices.min(axis=0), first.vertices.min(axis=0))
        np.testing.assert_allclose(m.vertices.max(axis=0), first.vertices.max(axis=0))
        hidden = {key: first.parameters[key] for key in ("hidden", "hidden_seed")}
        assert m.parameters | hidden == first.parameters
    camera = view(elevation=0, size=(64, 64), aim=0.45)
    for seed in range(3):
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

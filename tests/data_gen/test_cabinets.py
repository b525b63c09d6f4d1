import numpy as np
from helpers.solid_models import view

from data_gen import cameras
from data_gen.catalogues import cabinets
from data_gen.mesh import face_normals


def test_the_depth_moves_only_what_is_behind_the_panel():
    models = [cabinets.generate("front", 5, h) for h in range(6)]
    depths = [m.parameters["hidden"]["depth"] for m in models]
    assert len(set(depths)) == 6
    assert all(cabinets.DEPTH[0] <= d <= cabinets.DEPTH[1] for d in depths)
    first = models[0]
    for m in [*models, cabinets.generate("turned", 5, 0)]:
        assert (face_normals(m.vertices, m.faces)[:, None] * m.normals).sum(axis=2).min() > 0.8
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

import dataclasses
import json

import numpy as np
import scipy.spatial
from helpers.refusals import check_message

from data_gen import cameras, render_model
from data_gen.catalogues.procedural import generate
from data_gen.picture import Picture
from data_gen.settings import ImageSettings, Settings
from psgn_jax.system.untrusted import parse_json

ALL = Settings(image=ImageSettings(missing=1.0))


def test_faces_are_missing_and_vertices_are_not():
    model = generate("chair", 3)
    shares = []
    for seed in range(40):
        part, settings = render_model.without_faces(model, ALL, seed)
        assert np.array_equal(part.vertices, model.vertices)
        assert len(part.faces) > 0
        assert set(map(tuple, part.faces)) <= set(map(tuple, model.faces))
        shares.append(len(part.faces) / len(model.faces))
        assert (settings.checks.inside == 0) == (part is not model)  # if a face would be left
        assert dataclasses.replace(settings, checks=ALL.checks) == ALL
    assert min(shares) < 0.2
    assert shares.count(1.0) < 10
    half = Settings(image=ImageSettings(missing=0.5))
    parts = [render_model.without_faces(model, half, seed)[0] for seed in range(40)]
    assert 10 <= sum(part is not model for part in parts) <= 30


def test_an_empty_view_is_refused_and_its_line_can_be_read(rng):
    points = rng.uniform(-0.2, 0.2, (64, 3))
    nothing = np.zeros((192, 256))
    image = np.zeros((192, 256, 3), np.uint8)
    picture = Picture(image, nothing.astype(bool), nothing.astype(np.float32))
    camera = cameras.draw(rng, cameras.CameraSettings(), points)
    checks = render_model.check_view(picture, camera, points, scipy.spatial.cKDTree(points))
    check_message(render_model.objection_to(checks, Settings()), "0.005")
    assert parse_json(json.dumps(checks)) == checks

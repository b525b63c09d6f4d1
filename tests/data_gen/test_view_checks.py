"""A view without the object is refused, and its measurements can be written as JSON."""

import json

import numpy as np
import scipy.spatial

from data_gen import cameras, settings, view_checks
from data_gen.picture import Picture
from psgn_jax.untrusted import parse_json


def test_an_empty_view_is_refused_and_its_line_can_be_read(rng):
    points = rng.uniform(-0.2, 0.2, (64, 3))
    shape = (192, 256)
    picture = Picture(
        np.zeros((*shape, 3), np.uint8),
        np.zeros(shape, bool),
        np.zeros(shape, np.float32),
        np.zeros((*shape, 3), np.float32),
        np.zeros(shape, np.float32),
    )
    camera = cameras.draw(rng, cameras.CameraSettings(), points)
    checks = view_checks.check_view(picture, camera, points, scipy.spatial.cKDTree(points))
    assert view_checks.objection_to(checks, settings.Settings()).startswith("the object covers")
    assert parse_json(json.dumps(checks)) == checks

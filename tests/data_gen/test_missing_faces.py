"""Objects of which only a part is rendered: the image changes, points and volume do not."""

import dataclasses

import numpy as np
import pytest

from data_gen import missing_faces
from data_gen.catalogues.procedural import generate
from data_gen.settings import ImageSettings, Settings

ALL = Settings(image=ImageSettings(missing=1.0))


@pytest.fixture(scope="module")
def model():
    return generate("chair", 3)


def test_nothing_is_missing_by_default(model):
    assert missing_faces.draw(model, Settings(), 7) == (model, Settings())


def test_faces_are_missing_and_vertices_are_not(model):
    shares = []
    for seed in range(40):
        part, settings = missing_faces.draw(model, ALL, seed)
        assert np.array_equal(part.vertices, model.vertices)
        assert 0 < len(part.faces) <= len(model.faces)
        assert set(map(tuple, part.faces)) <= set(map(tuple, model.faces))
        shares.append(len(part.faces) / len(model.faces))
        if part is model:  # no face would be left
            assert settings is ALL
            continue
        assert settings.checks.inside == 0
        assert settings.checks.coverage == missing_faces.COVERAGE
        assert dataclasses.replace(settings, checks=ALL.checks) == ALL
    assert min(shares) < 0.2
    assert shares.count(1.0) < 10


def test_the_same_seed_draws_the_same_part(model):
    first, again = (missing_faces.draw(model, ALL, 5)[0] for _ in range(2))
    assert np.array_equal(first.faces, again.faces)


def test_a_fraction_of_the_models_loses_faces(model):
    settings = Settings(image=ImageSettings(missing=0.25))
    changed = sum(missing_faces.draw(model, settings, seed)[0] is not model for seed in range(200))
    assert 30 <= changed <= 70


def test_the_fraction_has_a_range():
    with pytest.raises(ValueError, match=r"image\.missing"):
        ImageSettings(missing=1.5)

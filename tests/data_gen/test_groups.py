import dataclasses

import numpy as np
import pytest

from data_gen.catalogues.by_name import open_catalogue
from data_gen.catalogues.groups import ARRANGEMENTS, group

SEEDS = range(40)


@pytest.fixture(scope="module")
def groups():
    return [group(seed) for seed in SEEDS]


def test_every_arrangement_occurs_and_fits_the_frame(groups):
    assert {m.parameters["arrangement"] for m in groups} == set(ARRANGEMENTS)
    for model in groups:
        assert model.vertices[:, 2].min() == pytest.approx(0, abs=1e-9)
        assert np.linalg.norm(model.vertices, axis=1).max() == pytest.approx(1)
        assert model.face_material.max() < len(model.materials)


def test_a_seed_gives_one_group(groups):
    again = group(3)
    for field in dataclasses.fields(again):
        one, other = (getattr(m, field.name) for m in (again, groups[3]))
        if isinstance(one, np.ndarray):
            np.testing.assert_array_equal(one, other)
    assert not np.array_equal(groups[3].vertices[:8], groups[4].vertices[:8])


def test_the_catalogue_loads_its_models():
    catalogue = open_catalogue("procedural_groups", "5", first_seed=2)
    entries = list(catalogue.entries())
    assert [e.model_id for e in entries] == [f"group-{n}" for n in range(2, 7)]
    assert len(catalogue) == 5
    model = entries[0].load()
    assert (model.model_id, model.category) == ("group-2", "group")


@pytest.mark.parametrize("source", ["0", "many", "-3"])
def test_a_wrong_number_of_groups_is_refused(source):
    with pytest.raises(ValueError, match="expected a number of models"):
        open_catalogue("procedural_groups", source)


def test_a_negative_seed_is_refused():
    with pytest.raises(ValueError, match="seed: got -1, expected 0 or more"):
        group(-1)

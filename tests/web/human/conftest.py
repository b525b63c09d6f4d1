"""A study of two cases: a table with known parts, and a drawn solid."""

import pytest
from helpers import drawn_solids
from helpers.human_study import table_sample

from psgn_jax.data.dataset import write_dataset
from psgn_jax.web.human.cases import build_study


@pytest.fixture(scope="session")
def records(tmp_path_factory):
    """Folder of the records of both cases."""
    folder = tmp_path_factory.mktemp("human") / "records"
    (solid,) = drawn_solids.samples(1, seed=3, image_size=(96, 128))
    write_dataset(folder, {"validation": [table_sample(), solid]}, source="test")
    return folder


@pytest.fixture(scope="session")
def study_folder(records, tmp_path_factory):
    """Folder of the study, as `psgn human` writes it."""
    out = tmp_path_factory.mktemp("human") / "study"
    build_study(str(records), out, cases=2)
    return out

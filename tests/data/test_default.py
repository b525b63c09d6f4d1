import dataclasses
import pathlib

import pytest

from data_gen import default as recipe
from data_gen import job, job_folder, settings, worker
from psgn_jax.config import ConfigError, DataConfig
from psgn_jax.data import default, loader, records

TINY = settings.Settings(views=1, num_points=4096, job=settings.JobSettings(workers=1))


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("PSGN_CACHE", str(tmp_path))
    return tmp_path


def test_without_mitsuba_the_remedy_is_named(monkeypatch):
    monkeypatch.setattr(worker, "has_mitsuba", lambda: False)
    with pytest.raises(ConfigError, match=r"pip install -e '\.\[render\]'"):
        loader.num_samples(DataConfig(), "train")


def test_a_complete_one_is_taken_as_it_is(cache, monkeypatch):
    made = []

    def build(folder):
        made.append(folder)
        pathlib.Path(folder).mkdir()
        records.save_manifest(folder, records.Manifest("procedural", True, ()))

    monkeypatch.setattr(recipe, "can_build", lambda: True)
    monkeypatch.setattr(recipe, "build", build)
    first = default.default_dataset()
    assert default.default_dataset() == first == str(cache / recipe.NAME)
    assert len(made) == 1


@pytest.mark.skipif(not worker.has_mitsuba(), reason="Mitsuba is not installed")
def test_one_begun_otherwise_is_begun_anew(cache, monkeypatch):
    """Built by the real job, three models; what another renderer had begun is dropped."""
    source = recipe.catalogues.open("procedural", "chair=3")
    monkeypatch.setattr(recipe.catalogues, "open", lambda *_: source)
    folder = cache / "data"
    other = dataclasses.replace(TINY, seed=1)
    entries = list(source.entries())
    begun = job.job_of("procedural", entries, other, "none", job.EVERYTHING, 0)
    assert not job_folder.begin(folder, begun)
    recipe.build(folder, options=TINY)
    splits = records.load_manifest(folder).splits()
    assert sum(len(records.RecordReader(folder, split)) for split in splits) == 3
    with pytest.raises(job.OtherSettingsError, match="complete data set"):
        recipe.build(folder, options=other)

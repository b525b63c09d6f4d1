import dataclasses

import pytest
from helpers.refusals import all_refused, refused

from data_gen import default as recipe
from data_gen import engine, job, settings
from data_gen.engine import has_mitsuba
from psgn_jax.commands import default_data
from psgn_jax.config.data import DEFAULT_DATA
from psgn_jax.config.experiment import Config, ConfigError, parse
from psgn_jax.data import shards
from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.manifest import Manifest, load_manifest, save_manifest

TINY = settings.Settings(views=1, num_points=4096, job=settings.JobSettings(workers=1))


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("PSGN_CACHE", str(tmp_path))
    return tmp_path


def test_without_mitsuba_the_remedy_is_named(monkeypatch):
    monkeypatch.setattr(engine, "has_mitsuba", lambda: False)
    all_refused(default_data.ensure_default_data, ConfigError, [
        (Config(), "pip install 'psgn-jax[render]'", "data.path"),
        (parse({"task": "views"}), "'views'", "--config.views=5", "data.path"),
    ])  # fmt: skip


def test_a_complete_one_is_taken_as_it_is(cache, monkeypatch, caplog):
    caplog.set_level("INFO", "absl")

    def build(folder):
        assert all(text in caplog.text for text in ("520 images", "minutes", "--data"))
        folder.mkdir()  # fails if it is called again
        save_manifest(folder, Manifest("procedural", True, ()))

    monkeypatch.setattr(recipe, "build", build)
    first = default_data.default_dataset()
    assert default_data.default_dataset() == first == str(cache / DEFAULT_DATA)
    default_data.ensure_default_data(Config())
    assert Config().data.folders == (first,)


@pytest.mark.skipif(not has_mitsuba(), reason="Mitsuba is not installed")
def test_one_begun_otherwise_is_begun_anew(cache, monkeypatch):
    """Built by the real job, three models; what another renderer had begun is dropped."""
    source = recipe.open_catalogue("procedural", "chair=3")
    monkeypatch.setattr(recipe, "open_catalogue", lambda *_: source)
    folder = cache / "data"
    other = dataclasses.replace(TINY, seed=1)

    def stopped(tasks, context):
        raise KeyboardInterrupt
        yield

    with pytest.raises(KeyboardInterrupt):
        job.render_catalogue(source, folder, other, render=stopped)
    recipe.build(folder, options=TINY)
    assert sum(len(RecordReader(folder, split)) for split in load_manifest(folder).splits()) == 3
    with refused(shards.OtherSettingsError, folder):
        recipe.build(folder, options=other)

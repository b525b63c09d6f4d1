import dataclasses
import pathlib
import re

import pytest

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
    with pytest.raises(ConfigError, match=r"pip install 'psgn-jax\[render\]'"):
        default_data.ensure_default_data(Config())
    with pytest.raises(ConfigError, match=r"'views' needs 5: .* --config\.views=5"):
        default_data.ensure_default_data(parse({"task": "views"}))


def test_a_complete_one_is_taken_as_it_is(cache, monkeypatch, caplog):
    caplog.set_level("INFO", "absl")
    made = []

    def build(folder):
        assert re.search(r"520 images of .* about \d+ minutes on \d+ cores; .*--data", caplog.text)
        made.append(folder)
        pathlib.Path(folder).mkdir()
        save_manifest(folder, Manifest("procedural", True, ()))

    monkeypatch.setattr(engine, "has_mitsuba", lambda: True)
    monkeypatch.setattr(recipe, "build", build)
    first = default_data.default_dataset()
    assert default_data.default_dataset() == first == str(cache / DEFAULT_DATA)
    assert len(made) == 1
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
    splits = load_manifest(folder).splits()
    assert sum(len(RecordReader(folder, split)) for split in splits) == 3
    with pytest.raises(shards.OtherSettingsError, match="seed: 0 before, 1 now"):
        recipe.build(folder, options=other)

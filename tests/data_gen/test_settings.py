import dataclasses

import pytest

from data_gen import config, settings
from data_gen.settings import Settings


def test_defaults_go_there_and_back():
    assert settings.parse(config.get_config()) == Settings()
    assert settings.parse(settings.to_dict(Settings())) == Settings()


def test_preset():
    parsed = settings.parse(config.get_config("r2n2"))
    assert parsed.camera.image_size == (137, 137)
    with pytest.raises(ValueError, match="expected one of"):
        config.get_config("nobody")


def test_numbers_are_converted():
    parsed = settings.parse({"camera": {"elevation": [0, 30]}, "checks": {"inside": 1}})
    assert parsed.camera.elevation == (0.0, 30.0)
    assert isinstance(parsed.checks.inside, float)


@pytest.mark.parametrize(
    ("values", "message"),
    [({"veiws": 2}, "did you mean 'views'"), ({"views": 0}, "views: got 0"),
     ({"views": 1.5}, "views=1.5: accepted: an integer"),
     ({"camera": {"elevation": 3}}, "camera.elevation=3: accepted: a tuple"),
     ({"camera": 3}, "camera=3: accepted: a section"),
     ({"image": {"shading": "toon"}}, "image.shading"),
     ({"image": {"background": "folder"}}, "background_folder"),
     ({"job": {"variant": "cuda"}}, "job.variant"),
     ({"light": {"source": "folder"}}, "light.folder"),
     ({"light": {"folder": "maps"}},
      "light.folder.*light.source='procedural': expected 'folder' or 'mixed'"),
     ({"image": {"soft_edges": True, "samples": 0}}, "soft_edges.*no effect with image.samples=0"),
     ({"image": {"background_folder": "walls", "background": "random"}},
      "image.background_folder.*no effect without image.background=folder")],
)  # fmt: skip
def test_wrong_values_name_the_field(values, message):
    with pytest.raises(ValueError, match=message):
        settings.parse(values)


def test_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Settings().views = 3

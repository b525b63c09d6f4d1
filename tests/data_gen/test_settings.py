import pytest

from data_gen import config, settings
from data_gen.settings import Settings
from psgn_jax.config import structured


def test_defaults_go_there_and_back():
    assert settings.parse(config.get_config()) == Settings()
    assert settings.parse(structured.to_dict(Settings())) == Settings()
    assert settings.parse(config.get_config("r2n2")).camera.image_size == (137, 137)


@pytest.mark.parametrize(
    ("values", "message"),
    [({"veiws": 2}, "did you mean 'views'"), ({"views": 0}, "views=0: accepted: a number >= 1"),
     ({"light": {"source": "folder"}}, "light.folder"),
     ({"camera": {"elevation": (30, 20)}}, r"camera.elevation=\(30, 20\): accepted"),
     ({"camera": {"distance": (0.5, 2)}}, "camera.distance.*from 1.05 to 1000"),
     ({"image": {"background": "surroundings"}}, "it needs image.shading=photo")],
)  # fmt: skip
def test_wrong_values_name_the_field(values, message):
    with pytest.raises(ValueError, match=message):
        settings.parse(values)


@pytest.mark.parametrize(
    ("values", "name"),
    [({"image": {"rays": 9}}, "image.rays"), ({"film": {"grain": (0.0, 0.1)}}, "film.grain"),
     ({"image": {"shading": "photo"}, "light": {"count": 3}}, "light.count"),
     ({"image": {"shading": "photo", "ground": "wood"}}, "image.ground"),
     ({"image": {"samples": 0, "soft_edges": True}}, "image.soft_edges"),
     ({"light": {"source": "sunsky", "folder": "maps"}}, "light.folder"),
     ({"camera": {"keep_size": True}}, "camera.keep_size")],
)  # fmt: skip
def test_settings_without_effect_are_refused(values, name):
    with pytest.raises(ValueError, match=f"{name}: it has no effect without"):
        settings.parse(values)

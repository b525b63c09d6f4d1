from helpers.refusals import all_refused

from data_gen import config, settings
from data_gen.settings import Settings
from psgn_jax.config import structured


def test_defaults_go_there_and_back():
    assert settings.parse(config.get_config()) == Settings()
    assert settings.parse(structured.to_dict(Settings())) == Settings()
    assert settings.parse(config.get_config("r2n2")).camera.image_size == (137, 137)


def test_wrong_values_and_values_without_effect_name_the_field():
    photo, maps = {"shading": "photo"}, {"source": "folder"}
    table = (
        ({"veiws": 2}, "'views'"), ({"views": 0}, "views=0"), ({"light": maps}, "light.folder"),
        ({"camera": {"elevation": (30, 20)}}, "camera.elevation=(30, 20)"),
        ({"camera": {"distance": (0.5, 2)}}, "camera.distance", "from 1.05 to 1000"),
        ({"image": {"background": "surroundings"}}, "image.background", "image.shading=photo"),
        ({"image": {"rays": 9}}, "image.rays", "without"),
        ({"film": {"grain": (0.0, 0.1)}}, "film.grain", "without"),
        ({"image": photo, "light": {"count": 3}}, "light.count", "without"),
        ({"image": photo | {"ground": "wood"}}, "image.ground", "without"),
        ({"image": {"samples": 0, "soft_edges": True}}, "image.soft_edges", "without"),
        ({"light": {"source": "sunsky", "folder": "maps"}}, "light.folder", "without"),
        ({"camera": {"keep_size": True}}, "camera.keep_size", "without"),
    )  # fmt: skip
    all_refused(settings.parse, ValueError, table)

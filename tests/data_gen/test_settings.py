from helpers.refusals import all_refused

from data_gen import settings
from psgn_jax.config.structured import ConfigError


def test_wrong_values_and_settings_without_effect_are_refused():
    photo = {"shading": "photo"}
    all_refused(settings.parse, ConfigError, [
        ({"veiws": 2}, "veiws", "'views'"),
        ({"views": 0}, "views=0", ">= 1"),
        ({"light": {"source": "folder"}}, "light.folder", ".hdr"),
        ({"camera": {"elevation": (30, 20)}}, "camera.elevation=(30, 20)"),
        ({"camera": {"distance": (0.5, 2)}}, "camera.distance", "1.05", "1000"),
        ({"image": {"background": "surroundings"}}, "image.background", "image.shading"),
        ({"image": {"rays": 9}}, "image.rays=9", "image.shading='photo'"),
        ({"film": {"grain": (0.0, 0.1)}}, "film.grain", "image.shading='photo'"),
        ({"image": photo, "light": {"count": 3}}, "light.count=3", "image.shading='local'"),
        ({"image": {**photo, "ground": "wood"}}, "image.ground='wood'", "image.background"),
        ({"image": {"samples": 0, "soft_edges": True}}, "image.soft_edges", "image.samples"),
        ({"light": {"source": "sunsky", "folder": "maps"}}, "light.folder='maps'", "light.source"),
        ({"camera": {"keep_size": True}}, "camera.keep_size=True", "camera.focal"),
    ])  # fmt: skip

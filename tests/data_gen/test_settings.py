import pytest

from data_gen import config, settings
from data_gen.settings import Settings
from psgn_jax.config import structured


def test_defaults_go_there_and_back():
    assert settings.parse(config.get_config()) == Settings()
    assert settings.parse(structured.to_dict(Settings())) == Settings()


def test_presets():
    parsed = {name: settings.parse(config.get_config(name)) for name in settings.PRESETS}
    assert parsed["r2n2"].camera.image_size == (137, 137)
    with pytest.raises(ValueError, match="expected one of"):
        config.get_config("nobody")


def test_numbers_are_converted():
    parsed = settings.parse({"camera": {"elevation": [0, 30]}, "checks": {"inside": 1}})
    assert parsed.camera.elevation == (0.0, 30.0)
    assert isinstance(parsed.checks.inside, float)


@pytest.mark.parametrize(
    ("values", "message"),
    [({"veiws": 2}, "did you mean 'views'"), ({"views": 0}, "views=0: accepted: a number >= 1"),
     ({"views": 1.5}, "views=1.5: accepted: an integer"),
     ({"camera": {"elevation": 3}}, "camera.elevation=3: accepted: a tuple"),
     ({"camera": 3}, "camera=3: accepted: a section"),
     ({"image": {"shading": "toon"}}, "image.shading"),
     ({"image": {"background": "folder"}}, "background_folder"),
     ({"job": {"variant": "cuda"}}, "job.variant"),
     ({"light": {"source": "folder"}}, "light.folder"),
     ({"camera": {"elevation": (30, 20)}}, r"camera.elevation=\(30, 20\): accepted"),
     ({"camera": {"distance": (0.5, 2)}}, "camera.distance.*from 1.05 to 1000"),
     ({"camera": {"azimuth": (float("nan"), 1.0)}}, "camera.azimuth"),
     ({"camera": {"image_size": (4, 4)}}, "camera.image_size"),
     ({"light": {"count": 0}}, "light.count=0"),
     ({"film": {"blur": (2.0, 1.0)}}, "film.blur"),
     ({"image": {"background": "surroundings"}}, "it needs image.shading=photo")],
)  # fmt: skip
def test_wrong_values_name_the_field(values, message):
    with pytest.raises(ValueError, match=message):
        settings.parse(values)


def changed(value):
    """Another valid value than a default."""
    if isinstance(value, tuple):
        return (value[1], value[1])
    if isinstance(value, str):
        return "wood" if value == "none" else "a folder"
    if isinstance(value, bool):
        return not value
    return value + (1 if isinstance(value, int) else 0.1)


# For every rule of `settings.EFFECTS`, settings with which its condition does not hold.
WITHOUT = {
    "image.shading=photo": {},
    "image.shading=path": {},
    "image.shading=local or path": {"image": {"shading": "photo"}},
    "image.shading=local": {"image": {"shading": "path"}},
    "image.samples": {"image": {"samples": 0}},
    "image.background=folder": {"image": {"background": "random"}},
    "light.source=folder or mixed": {"light": {"source": "sunsky"}},
    "another camera.focal than 400": {"camera": {"azimuth": (0.0, 1.0)}},
}
WITH = {
    "image.shading=photo": {"image": {"shading": "photo"}},
    "image.shading=path": {"image": {"shading": "path"}},
    "image.background=folder": {"image": {"background": "folder", "background_folder": "x"}},
    "light.source=folder or mixed": {"light": {"source": "mixed"}},
    "another camera.focal than 400": {"camera": {"focal": (300.0, 500.0)}},
}


@pytest.mark.parametrize("rule", settings.EFFECTS, ids=lambda rule: rule[2])
def test_settings_without_effect_are_refused(rule):
    names, _, needed = rule
    for name in names:
        section, _, field = name.partition(".")
        own = {field: changed(getattr(getattr(Settings(), section), field))}
        for others, accepted in ((WITHOUT[needed], False), (WITH.get(needed, {}), True)):
            values = {**others, section: {**others.get(section, {}), **own}}
            if accepted:
                assert settings.parse(values) != Settings()
            else:
                with pytest.raises(ValueError, match=f"{name}: it has no effect without {needed}"):
                    settings.parse(values)

"""Configuration of `data_gen/render.py`; any field is a flag, too: `--config.views=8`.

`--config=data_gen/config.py:photo` begins with the named preset, see `settings.PRESETS`: "authors"
(the default), "r2n2" (that camera) or "photo" (pictures that look like photographs). For own
settings, copy this file and change what it returns.
"""

import ml_collections

from data_gen import settings


def get_config(preset: str = "authors") -> ml_collections.ConfigDict:
    """The defaults of `settings.Settings`, with a preset's changes."""
    if preset not in settings.PRESETS:
        raise ValueError(f"preset {preset!r}: expected one of {sorted(settings.PRESETS)}")
    config = ml_collections.ConfigDict(settings.to_dict(settings.Settings()))
    for section, values in settings.PRESETS[preset].items():
        config[section].update(values)
    return config

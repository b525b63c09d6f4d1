"""Configuration of `data_gen/render.py`; any field is a flag, too: `--config.views=8`.

`--config=data_gen/config.py:r2n2` begins with the named camera, see `cameras.PRESETS`. For own
settings, copy this file and change what it returns.
"""

import ml_collections

from data_gen import cameras, settings


def get_config(preset: str = "authors") -> ml_collections.ConfigDict:
    """The defaults of `settings.Settings`, with a camera preset."""
    if preset not in cameras.PRESETS:
        raise ValueError(f"camera preset {preset!r}: expected one of {sorted(cameras.PRESETS)}")
    config = ml_collections.ConfigDict(settings.to_dict(settings.Settings()))
    config.camera.update(cameras.PRESETS[preset])
    return config

"""Configuration of `data_gen/render.py`. Every field is also a flag: `--config.views=8`.

`--config=photo` starts from a preset: "authors" (the default), "r2n2" (the camera of 3D-R2N2),
"photo" (images that look like photographs), "angles" (the cameras of "photo" with the light and
shading of "authors") or "level" ("angles" at elevations of -8 to 10 degrees). For other defaults,
copy this file and change what it returns.
"""

import ml_collections

from data_gen import settings
from psgn_jax.config import structured


def get_config(preset: str = "authors") -> ml_collections.ConfigDict:
    if preset not in settings.PRESETS:
        raise ValueError(f"preset {preset!r}: expected one of {sorted(settings.PRESETS)}")
    config = ml_collections.ConfigDict(structured.to_dict(settings.Settings()))
    for section, values in settings.PRESETS[preset].items():
        config[section].update(values)
    return config

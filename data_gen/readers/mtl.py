"""Materials of Wavefront MTL files."""

from collections.abc import Sequence

import numpy as np

from data_gen.mesh import Material
from data_gen.readers.textures import Assets, with_alpha_map

GREY = (0.6, 0.6, 0.6)


def floats(words: Sequence[str], count: int) -> list[float] | None:
    """The first `count` words as finite numbers, or None."""
    try:
        values = [float(w) for w in words[:count]]
    except ValueError:
        return None
    return values if len(values) == count and np.isfinite(values).all() else None


def _colour(words: Sequence[str]) -> tuple[float, float, float] | None:
    values = floats(words, 3) or floats(list(words[:1]) * 3, 3)
    if values is None:
        return None
    red, green, blue = (min(max(v, 0.0), 1.0) for v in values)
    return red, green, blue


# Options of a map statement and their number of arguments, from the MTL specification. Those of
# `_MAP_VECTORS` have one to three arguments.
_MAP_OPTIONS = {"-blendu": 1, "-blendv": 1, "-cc": 1, "-clamp": 1, "-texres": 1, "-imfchan": 1,
                "-type": 1, "-bm": 1, "-boost": 1, "-mm": 2}  # fmt: skip

_MAP_VECTORS = ("-o", "-s", "-t")


def _map_name(rest: str) -> str:
    """The file name of a map statement without the options before it; it may contain spaces."""
    words = rest.split()
    start = 0
    while start < len(words) and words[start].lower() in {*_MAP_OPTIONS, *_MAP_VECTORS}:
        option = words[start].lower()
        start += 1
        if option in _MAP_OPTIONS:
            start += _MAP_OPTIONS[option]
        else:
            taken = 0
            while start < len(words) - 1 and taken < 3 and floats([words[start]], 1):
                start, taken = start + 1, taken + 1
    return rest.strip() if start == 0 else " ".join(words[start:])


def read_mtl(text: str, assets: Assets, folder: str = "") -> dict[str, Material]:
    """The materials of an MTL file in a `folder` below that of the model, by name.

    We read Kd, Ks, Ns, d, Tr, illum (2 and above have a highlight), map_Kd and map_d. A black Kd
    with a texture counts as white, because many exporters write black and mean only the texture.
    """
    statements: dict[str, dict[str, str]] = {}
    current: dict[str, str] = {}
    for line in text.splitlines():
        words = line.strip().split(None, 1)
        if not words or words[0].startswith("#"):
            continue
        rest = words[1].strip() if len(words) > 1 else ""
        if words[0].lower() == "newmtl":
            current = statements.setdefault(rest, {})
        else:
            current[words[0].lower()] = rest
    result = {}
    for name, lines in statements.items():
        files = (_map_name(lines[key]) if lines.get(key) else "" for key in ("map_kd", "map_d"))
        texture, alpha_map = (assets.texture(file, folder) if file else None for file in files)
        if alpha_map is not None:
            texture = with_alpha_map(texture, alpha_map)
        diffuse = _colour(lines.get("kd", "").split())
        if diffuse is None or ("map_kd" in lines and max(diffuse) < 0.02):
            diffuse = (1.0, 1.0, 1.0) if texture is not None else GREY
        opacity = floats(lines.get("d", "").replace("-halo", "").split(), 1)
        if opacity is None:
            clear = floats(lines.get("tr", "").split(), 1)
            opacity = [1.0] if clear is None else [1 - clear[0]]
        specular = _colour(lines.get("ks", "").split()) or (0.0, 0.0, 0.0)
        if lines.get("illum", "2").strip() in ("0", "1"):
            specular = (0.0, 0.0, 0.0)
        shininess = (floats(lines.get("ns", "").split(), 1) or [20.0])[0]
        gloss, alpha = min(max(shininess, 1.0), 1000.0), min(max(opacity[0], 0.0), 1.0)
        result[name] = Material(diffuse, specular, gloss, alpha, texture, name)
    return result

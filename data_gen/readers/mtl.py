"""Materials of Wavefront MTL files."""

from collections.abc import Sequence

import numpy as np

from data_gen.mesh import GREY, Material
from data_gen.readers.model_files import whole_lines
from data_gen.readers.parts import Look
from data_gen.readers.textures import Assets, levels, with_alpha
from psgn_jax.system.untrusted import one_line


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


# Options of a map statement and their number of arguments, from the MTL specification. Options
# in `_MAP_VECTORS` have one to three arguments.
_MAP_OPTIONS = {"-blendu": 1, "-blendv": 1, "-cc": 1, "-clamp": 1, "-texres": 1, "-imfchan": 1,
                "-type": 1, "-bm": 1, "-boost": 1, "-mm": 2}  # fmt: skip

_MAP_VECTORS = ("-o", "-s", "-t")


def _map_name(rest: str) -> tuple[str, dict[str, list[str]]]:
    """The file name of a map statement, which may contain spaces, and the options before it."""
    words = rest.split()
    options: dict[str, list[str]] = {}
    start = 0
    while start < len(words) and words[start].lower() in {*_MAP_OPTIONS, *_MAP_VECTORS}:
        option = words[start].lower()
        start += 1
        taken = _MAP_OPTIONS.get(option, 0)
        if option in _MAP_VECTORS:
            while (
                start + taken < len(words) - 1 and taken < 3 and floats([words[start + taken]], 1)
            ):
                taken += 1
        options[option] = words[start : start + taken]
        start += taken
    return (rest.strip() if start == 0 else " ".join(words[start:])), options


def read_mtl(data: bytes, assets: Assets, folder: str = "") -> dict[str, Look]:
    """The materials of an MTL file in a `folder` below the model's folder, by name.

    We read Kd, Ks, Ns, d, Tr, illum (2 and above have a highlight), map_Kd and map_d with the
    options -s, -o, -clamp, -mm and -imfchan, and map_Ka if there is no map_Kd. A black Kd with a
    texture counts as white, because many exporters write black and mean only the texture.
    """
    statements: dict[str, dict[str, str]] = {}
    current: dict[str, str] = {}
    text = whole_lines(data).decode("utf-8", "surrogateescape")
    for line in text.split("\n"):
        words = line.strip().split(None, 1)
        if not words or words[0].startswith("#"):
            continue
        rest = words[1].strip() if len(words) > 1 else ""
        if words[0].lower() == "newmtl":
            current = statements.setdefault(rest, {})
        else:
            current[words[0].lower()] = rest
    return {name: _look(name, lines, assets, folder) for name, lines in statements.items()}


def _look(name: str, lines: dict[str, str], assets: Assets, folder: str) -> Look:
    if "map_kd" not in lines and "map_ka" in lines:
        lines = {**lines, "map_kd": lines["map_ka"]}
    for key, rest in lines.items():
        others = key.startswith("map_") and key not in ("map_kd", "map_ka", "map_d")
        if rest and (others or key in ("bump", "disp", "norm", "refl", "decal")):
            assets.warn("maps of MTL not read", key)
    if max(_colour(lines.get("ke", "").split()) or (0,)) > 0.02:
        assets.warn("emission not read", repr(name))
    (file, options), (alpha_file, of_alpha) = (
        _map_name(lines.get(key, "")) for key in ("map_kd", "map_d")
    )
    texture = assets.texture(file, folder) if file else None
    gain = floats(options.get("-mm", ()), 2)
    if texture is not None and gain:
        rgb = (255 * gain[0] + gain[1] * texture[..., :3]).clip(0, 255).round().astype(np.uint8)
        texture = np.dstack([rgb, texture[..., 3]])
    alpha_map = assets.texture(alpha_file, folder) if alpha_file else None
    if alpha_map is not None:
        channel = "rgbm".find("".join(of_alpha.get("-imfchan", ())).lower() or "none")
        alpha = alpha_map[..., channel] if channel >= 0 else levels(alpha_map)
        texture = with_alpha(texture, alpha)
    diffuse = _colour(lines.get("kd", "").split())
    if diffuse is None and lines.get("kd", "").split():
        assets.warn("colours of MTL that are not RGB not read", lines["kd"])
    if diffuse is None or ("map_kd" in lines and max(diffuse) < 0.02):
        diffuse = (1.0, 1.0, 1.0) if texture is not None else GREY
    opacity = floats(lines.get("d", "").replace("-halo", "").split(), 1)
    if opacity is None:
        clear = floats(lines.get("tr", "").split(), 1)
        opacity = [1.0] if clear is None else [1 - clear[0]]
    specular = _colour(lines.get("ks", "").split()) or (0.0, 0.0, 0.0)
    if lines.get("illum", "2").split()[:1] in (["0"], ["1"]):
        specular = (0.0, 0.0, 0.0)
    shininess = (floats(lines.get("ns", "").split(), 1) or [20.0])[0]
    gloss, opaque = min(max(shininess, 1.0), 1000.0), min(max(opacity[0], 0.0), 1.0)
    material = Material(diffuse, specular, gloss, opaque, texture, one_line(name))
    if texture is None:
        return Look(material)
    if any(float(word) for word in options.get("-t", ())):
        assets.warn("turbulence (-t) of textures not read", file)
    used = options if file else of_alpha
    scale, offset = (
        [*map(float, used.get(key, ())), default, default][:2]
        for key, default in (("-s", 1.0), ("-o", 0.0))
    )
    wrap = "clamp" if used.get("-clamp") == ["on"] else "repeat"
    return Look(material, np.column_stack([np.diag(scale), offset]), (wrap, wrap))

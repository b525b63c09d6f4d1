"""Materials of procedural models, with natural textures and colours.

Each function draws a material: its kind, its colour and a variant of its texture. The distribution
of hues is that of the authors' images: 60 % of the pixels are grey, most others are red to yellow,
almost none are purple (`tests/bench/appearance.py` compares them).
"""

import colorsys
import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from data_gen.catalogues.families import textures
from data_gen.catalogues.families.mapping import Fitted, Tiled, UVMapping, Wrapped
from data_gen.mesh import Material

_HUES = (
    # Range in degrees, and weight.
    (-10, 15, 0.30),
    (15, 45, 0.27),
    (45, 65, 0.09),
    (65, 100, 0.08),
    (100, 160, 0.06),
    (160, 200, 0.04),
    (200, 225, 0.08),
    (225, 255, 0.09),
    (255, 330, 0.03),
    (330, 350, 0.015),
)

# fmt: off
_COLOURS: dict[str, tuple[tuple[float, float, float], ...]] = {
    "wood": (
        (0.66, 0.48, 0.30), (0.76, 0.62, 0.44), (0.80, 0.65, 0.44), (0.40, 0.26, 0.17),
        (0.50, 0.26, 0.16), (0.22, 0.15, 0.12), (0.56, 0.38, 0.24), (0.36, 0.19, 0.10),
        (0.50, 0.47, 0.43),
    ),
    "metal": (
        (0.66, 0.66, 0.66), (0.78, 0.78, 0.78), (0.2, 0.2, 0.2), (0.12, 0.12, 0.12),
        (0.72, 0.57, 0.27), (0.45, 0.33, 0.22), (0.36, 0.36, 0.37),
    ),
    "leather": (
        (0.33, 0.19, 0.12), (0.12, 0.12, 0.12), (0.12, 0.12, 0.12), (0.55, 0.34, 0.2),
        (0.85, 0.81, 0.74), (0.4, 0.08, 0.07),
    ),
    "plastic": (
        (0.09, 0.09, 0.09), (0.2, 0.2, 0.2), (0.5, 0.5, 0.5), (0.9, 0.9, 0.9),
        (0.78, 0.74, 0.66), (0.7, 0.7, 0.7),
    ),
    "stone": (
        (0.85, 0.84, 0.82), (0.3, 0.3, 0.3), (0.55, 0.53, 0.5), (0.2, 0.22, 0.2),
        (0.6, 0.5, 0.42),
    ),
    "leaves": (
        (0.18, 0.28, 0.08), (0.25, 0.34, 0.12), (0.3, 0.36, 0.1), (0.16, 0.24, 0.12),
        (0.42, 0.34, 0.1),
    ),
    "fur": (
        (0.36, 0.24, 0.15), (0.52, 0.38, 0.24), (0.2, 0.17, 0.15), (0.65, 0.6, 0.53),
        (0.4, 0.4, 0.4),
    ),
}
# fmt: on
"""For each kind of material, the mean colours from which one is chosen."""

_ONCE: UVMapping = Tiled()


@dataclasses.dataclass(frozen=True, eq=False)
class TexturedMaterial(Material):
    """A material with a texture mapping, which parts can override."""

    mapping: UVMapping = _ONCE


def shade_of(rgb: Sequence[float], rng: np.random.Generator, spread: float = 0.08) -> Any:
    """A slightly lighter or darker colour."""
    factor = 1 + rng.uniform(-spread, spread)
    return tuple(float(np.clip(v * factor, 0, 1)) for v in rgb)


def pick(rng: np.random.Generator, choices: Sequence[Any]) -> Any:
    """A uniformly drawn choice."""
    return choices[int(rng.integers(len(choices)))]


# --- Colours --------------------------------------------------------------------------------------


def lively(rng: np.random.Generator) -> tuple[float, float, float]:
    """A random saturated colour."""
    weights = np.array([w for _, _, w in _HUES])
    low, high, _ = _HUES[int(rng.choice(len(_HUES), p=weights / weights.sum()))]
    saturation = 1.0 if rng.random() < 0.2 else rng.uniform(0.5, 0.95)
    hue = rng.uniform(low, high) / 360 % 1
    return colorsys.hsv_to_rgb(hue, saturation, rng.uniform(0.3, 0.9))


def muted(rng: np.random.Generator) -> tuple[float, float, float]:
    """A colour with low saturation, as of cloth and walls; more often warm than cold."""
    hue, saturation, value = colorsys.rgb_to_hsv(*lively(rng))
    return colorsys.hsv_to_rgb(hue, saturation * rng.uniform(0.25, 0.7), value)


def grey(rng: np.random.Generator) -> tuple[float, float, float]:
    """White, grey or black."""
    tone = float(pick(rng, (0.95, 0.9, 0.8, 0.7, 0.6, 0.5, 0.38, 0.26, 0.16, 0.09)))
    colour: tuple[float, float, float] = shade_of((tone, tone, tone), rng, 0.06)
    return colour


def _colours(rng: np.random.Generator) -> list[Sequence[float]]:
    """Four matching colours of a pattern."""
    ground = pick(rng, (grey, muted, muted, lively))(rng)
    figure = pick(rng, (lively, muted, grey))(rng)
    if abs(np.mean(ground) - np.mean(figure)) < 0.15:
        figure = tuple(0.25 * v for v in ground) if np.mean(ground) > 0.4 else (0.9, 0.88, 0.82)
    return [ground, figure, pick(rng, (muted, grey))(rng), lively(rng)]


# --- Textured materials -------------------------------------------------------------------------


def _tiled(rng: np.random.Generator, texture: np.ndarray, along_grain: bool = False) -> Tiled:
    """A mapping with tiles of 1 to 1.7 times the smallest size that `TEXELS_PER_RADIUS` permits."""
    finest = texture.shape[1] / textures.TEXELS_PER_RADIUS
    return Tiled(finest * rng.uniform(1.0, 1.7), along_grain)


def shaded(
    colour: Sequence[float],
    texture: np.ndarray,
    mapping: UVMapping,
    specular: float = 0.0,
    shininess: float = 20.0,
    name: str = "",
) -> TexturedMaterial:
    """A material with a given mean colour, modulated by a texture."""
    full = np.asarray(colour) / np.maximum(textures.mean_colour(texture), 0.05)
    diffuse = tuple(float(v) for v in np.clip(full, 0, 1))
    return TexturedMaterial(diffuse, (specular,) * 3, shininess, 1.0, texture, name, mapping)  # type: ignore[arg-type]


def pictured(
    texture: np.ndarray,
    mapping: UVMapping,
    specular: float = 0.0,
    shininess: float = 20.0,
    name: str = "",
) -> TexturedMaterial:
    """A material with the colours of its texture."""
    return TexturedMaterial(
        (1.0, 1.0, 1.0), (specular,) * 3, shininess, 1.0, texture, name, mapping
    )


def _variant(rng: np.random.Generator) -> int:
    return int(rng.integers(textures.VARIANTS))


# --- Materials of the families --------------------------------------------------------------------


def wood(rng: np.random.Generator) -> Material:
    """Oak, beech, pine, walnut, cherry, ebony: solid, boards or veneer, grain along the part."""
    colour = shade_of(pick(rng, _COLOURS["wood"]), rng, 0.15)
    kind = pick(rng, ("straight", "straight", "cathedral", "cathedral", "planks", "veneer"))
    texture = textures.wood(kind, _variant(rng))
    return shaded(colour, texture, _tiled(rng, texture, True), 0.12, 25.0, "wood")


def metal(rng: np.random.Generator) -> Material:
    """Steel, chrome, black iron, brass, bronze: polished, brushed, cast, rusty."""
    colour = shade_of(pick(rng, _COLOURS["metal"]), rng)
    kind = pick(rng, ("plain", "brushed", "brushed", "cast", "rusty"))
    if kind == "plain":
        return Material(colour, (0.55, 0.55, 0.55), 60.0, name="metal")
    texture = textures.metal(kind, _variant(rng))
    gloss = {"brushed": 0.45, "cast": 0.3, "rusty": 0.15}[kind]
    return shaded(colour, texture, _tiled(rng, texture, True), gloss, 40.0, "metal")


def paint(rng: np.random.Generator) -> Material:
    """Paint of vehicles, grey or saturated: clean, dirty, or with panel seams."""
    colour = grey(rng) if rng.random() < 0.5 else lively(rng)
    kind = pick(rng, ("clean", "panels", "panels", "panels", "worn", "worn"))
    texture = textures.painted(kind, _variant(rng))
    gloss = 0.4 if kind in ("clean", "panels") else 0.2
    return shaded(colour, texture, _tiled(rng, texture), gloss, 60.0, "paint")


def lacquer(rng: np.random.Generator) -> Material:
    """Painted furniture: white, greys, black, muted colours, sometimes saturated ones."""
    kind = rng.random()
    colour = grey(rng) if kind < 0.6 else muted(rng) if kind < 0.85 else lively(rng)
    sort = pick(rng, ("plain", "brush", "grain", "chipped"))
    if sort == "plain":
        return Material(colour, (0.25, 0.25, 0.25), 40.0, name="lacquer")
    if sort == "grain":
        texture = textures.wood(pick(rng, ("planks", "straight")), _variant(rng))
    else:
        texture = textures.painted(sort, _variant(rng))
    return shaded(colour, texture, _tiled(rng, texture, True), 0.2, 40.0, "lacquer")


def fabric(rng: np.random.Generator) -> Material:
    """Upholstery: cloth of one colour, stripes, checks, flowers and other patterns, leather."""
    kind = rng.random()
    if kind < 0.4:
        colour = pick(rng, (grey, grey, muted, muted, lively))(rng)
        texture = textures.weave(pick(rng, ("plain", "twill", "rib", "knit")), _variant(rng))
        return shaded(colour, texture, _tiled(rng, texture), name="fabric")
    if kind < 0.75:
        sort = pick(rng, textures.PATTERNS[:-1])
        texture = textures.pattern(sort, _variant(rng), _colours(rng))
        return pictured(texture, _tiled(rng, texture), name="fabric")
    if kind < 0.82:
        return Material(pick(rng, (grey, muted, lively))(rng), name="fabric")
    return hide(rng)


def hide(rng: np.random.Generator) -> Material:
    """Leather, grained or buttoned."""
    texture = textures.leather(pick(rng, ("grained", "grained", "tufted")), _variant(rng))
    colour = shade_of(pick(rng, _COLOURS["leather"]), rng)
    return shaded(colour, texture, _tiled(rng, texture), 0.2, 30.0, "leather")


def plastic(rng: np.random.Generator) -> Material:
    """Housings: black, greys, white, beige; smooth or with a fine grain."""
    colour = shade_of(pick(rng, _COLOURS["plastic"]), rng)
    if rng.random() < 0.4:
        return Material(colour, (0.25, 0.25, 0.25), 40.0, name="plastic")
    texture = pick(
        rng,
        (
            textures.metal("cast", _variant(rng)),
            textures.painted("brush", _variant(rng)),
            textures.painted("worn", _variant(rng)),
        ),
    )
    return shaded(colour, texture, _tiled(rng, texture), 0.25, 40.0, "plastic")


def screen(rng: np.random.Generator) -> Material:
    """A display, switched off or with an image that fills the part."""
    if rng.random() < 0.2:
        return Material((0.05, 0.05, 0.06), (0.5, 0.5, 0.5), 120.0, name="screen")
    texture = textures.screen(pick(rng, textures.SCREENS), _variant(rng))
    return pictured(texture, Fitted(), 0.3, 120.0, "screen")


def plain(rng: np.random.Generator) -> Material:
    """The grey of a model without materials."""
    tone = float(pick(rng, (0.9, 0.8, 0.7, 0.6, 0.5, 0.35)))
    return Material((tone,) * 3, (float(rng.uniform(0, 0.3)),) * 3, 30.0, name="plain")  # type: ignore[arg-type]


# --- Further materials ----------------------------------------------------------------------------


def _of(
    rng: np.random.Generator,
    texture: np.ndarray,
    colours: Sequence[Sequence[float]],
    name: str,
    specular: float = 0.0,
    along_grain: bool = False,
) -> Material:
    colour = shade_of(pick(rng, colours), rng, 0.15)
    return shaded(colour, texture, _tiled(rng, texture, along_grain), specular, 40.0, name)


def stone(rng: np.random.Generator) -> Material:
    """Marble, granite, concrete, cobbles."""
    kind = pick(rng, ("marble", "granite", "concrete", "cobbles"))
    gloss = 0.3 if kind in ("marble", "granite") else 0.0
    return _of(rng, textures.stone(kind, _variant(rng)), _COLOURS["stone"], "stone", gloss)


def marble(rng: np.random.Generator) -> Material:
    """Polished marble or granite."""
    texture = textures.stone(pick(rng, ("marble", "granite")), _variant(rng))
    colours = ((0.88, 0.87, 0.85), (0.25, 0.25, 0.25), (0.5, 0.42, 0.36), (0.2, 0.26, 0.22))
    return _of(rng, texture, colours, "marble", 0.35)


def masonry(rng: np.random.Generator) -> Material:
    """Walls: brick, blocks, plaster, boards."""
    kind = pick(rng, ("brick", "brick", "blocks", "plaster", "planks"))
    colours: tuple[Sequence[float], ...]
    if kind == "planks":
        return _of(
            rng,
            textures.wood("planks", _variant(rng)),
            ((0.85, 0.84, 0.8), (0.5, 0.35, 0.22), (0.55, 0.2, 0.15)),
            "boards",
            along_grain=True,
        )
    if kind == "plaster":
        colours = ((0.88, 0.86, 0.8), (0.8, 0.72, 0.55), (0.75, 0.6, 0.5), (0.9, 0.9, 0.9))
        return _of(rng, textures.stone("plaster", _variant(rng)), colours, "plaster")
    colours = (
        ((0.55, 0.28, 0.2), (0.62, 0.42, 0.3), (0.45, 0.2, 0.16))
        if kind == "brick"
        else ((0.62, 0.6, 0.56), (0.5, 0.48, 0.45))
    )
    return _of(rng, textures.masonry(kind, _variant(rng)), colours, kind)


def roofing(rng: np.random.Generator) -> Material:
    """Roof tiles and shingles."""
    texture = textures.masonry(pick(rng, ("roof", "shingles")), _variant(rng))
    colours = ((0.5, 0.22, 0.15), (0.42, 0.25, 0.18), (0.25, 0.25, 0.27), (0.36, 0.3, 0.26))
    return _of(rng, texture, colours, "roof")


def tiles(rng: np.random.Generator) -> Material:
    """Floor or wall tiles."""
    colours = ((0.88, 0.88, 0.86), (0.45, 0.55, 0.6), (0.7, 0.6, 0.48), (0.3, 0.3, 0.3))
    return _of(rng, textures.masonry("tiles", _variant(rng)), colours, "tiles", 0.35)


def ceramic(rng: np.random.Generator) -> Material:
    """Ceramic: of one colour, marbled, or with a pattern."""
    kind = rng.random()
    if kind < 0.35:
        return Material(pick(rng, (grey, muted, lively))(rng), (0.5,) * 3, 70.0, name="ceramic")  # type: ignore[arg-type]
    if kind < 0.6:
        texture = textures.stone(pick(rng, ("plaster", "granite", "marble")), _variant(rng))
        colours = ((0.6, 0.33, 0.2), (0.85, 0.82, 0.75), (0.35, 0.25, 0.18), (0.3, 0.36, 0.4))
        return _of(rng, texture, colours, "ceramic", 0.3)
    texture = textures.pattern(pick(rng, textures.PATTERNS[:-1]), _variant(rng), _colours(rng))
    return pictured(texture, Wrapped((int(rng.integers(1, 3)), 1.0)), 0.45, 70.0, "ceramic")


def terracotta(rng: np.random.Generator) -> Material:
    """Unglazed clay."""
    colours = ((0.62, 0.34, 0.2), (0.55, 0.3, 0.2), (0.7, 0.45, 0.3))
    return _of(rng, textures.stone("plaster", _variant(rng)), colours, "terracotta")


def wicker(rng: np.random.Generator) -> Material:
    """Woven cane, straw, rattan."""
    colours = ((0.6, 0.42, 0.24), (0.72, 0.58, 0.36), (0.3, 0.2, 0.13))
    return _of(rng, textures.weave("basket", _variant(rng)), colours, "wicker", 0.1)


def leaves(rng: np.random.Generator) -> Material:
    """Foliage."""
    return _of(rng, textures.foliage("leaves", _variant(rng)), _COLOURS["leaves"], "leaves")


def leaf(rng: np.random.Generator) -> Material:
    """A single leaf."""
    colours = ((0.18, 0.3, 0.08), (0.26, 0.36, 0.12), (0.34, 0.4, 0.14))
    texture = textures.wood("straight", _variant(rng))
    return _of(rng, texture, colours, "leaf", 0.1, along_grain=True)


def bark(rng: np.random.Generator) -> Material:
    """The bark of a trunk."""
    colours = ((0.33, 0.23, 0.15), (0.42, 0.34, 0.26), (0.25, 0.18, 0.13))
    return _of(rng, textures.foliage("bark", _variant(rng)), colours, "bark", along_grain=True)


def soil(rng: np.random.Generator) -> Material:
    """Earth in a pot."""
    texture = textures.foliage("soil", _variant(rng))
    return _of(rng, texture, ((0.22, 0.15, 0.1), (0.3, 0.22, 0.15)), "soil")


def grass(rng: np.random.Generator) -> Material:
    """A lawn."""
    texture = textures.foliage("grass", _variant(rng))
    return _of(rng, texture, ((0.3, 0.38, 0.14), (0.24, 0.32, 0.12), (0.45, 0.42, 0.2)), "grass")


def ground(rng: np.random.Generator, indoors: bool = False) -> Material:
    """Ground: lawn, earth, paving; indoors tiles, boards or a rug."""
    kind = pick(
        rng, ("tiles", "wood", "carpet") if indoors else ("grass", "stone", "tiles", "soil")
    )
    return {  # type: ignore[no-any-return]
        "grass": grass,
        "stone": stone,
        "tiles": tiles,
        "wood": wood,
        "carpet": carpet,
        "soil": soil,
    }[kind](rng)


def carpet(rng: np.random.Generator) -> Material:
    """A rug that fills the part."""
    return pictured(textures.carpet(_variant(rng)), Fitted(), name="carpet")


def fur(rng: np.random.Generator) -> Material:
    """The coat of an animal, of one colour or spotted."""
    if rng.random() < 0.3:
        one, two = pick(
            rng,
            (
                ((0.85, 0.82, 0.76), (0.12, 0.1, 0.09)),
                ((0.7, 0.5, 0.28), (0.2, 0.12, 0.07)),
                ((0.82, 0.8, 0.75), (0.42, 0.26, 0.15)),
            ),
        )
        texture = textures.pattern("camouflage", _variant(rng), [one, one, two, two])
        return pictured(texture, _tiled(rng, texture), name="fur")
    return _of(
        rng, textures.foliage("fur", _variant(rng)), _COLOURS["fur"], "fur", along_grain=True
    )


def camouflage(rng: np.random.Generator) -> Material:
    """Camouflage in green, sand or grey."""
    colours = pick(
        rng,
        (
            [(0.26, 0.3, 0.18), (0.36, 0.36, 0.22), (0.3, 0.22, 0.15), (0.13, 0.14, 0.12)],
            [(0.66, 0.58, 0.43), (0.56, 0.46, 0.32), (0.42, 0.34, 0.25), (0.74, 0.68, 0.55)],
            [(0.45, 0.46, 0.47), (0.3, 0.31, 0.32), (0.6, 0.6, 0.6), (0.18, 0.18, 0.19)],
        ),
    )
    texture = textures.pattern("camouflage", _variant(rng), colours)
    return pictured(texture, _tiled(rng, texture), 0.1, 20.0, "camouflage")


def plating(rng: np.random.Generator) -> Material:
    """Metal of machines: riveted plates, tread plate, panels with vents."""
    texture = pick(
        rng,
        (
            textures.metal("plates", _variant(rng)),
            textures.metal("tread", 0),
            textures.painted("panels", _variant(rng)),
            textures.painted("worn", _variant(rng)),
        ),
    )
    colour = grey(rng) if rng.random() < 0.7 else lively(rng)
    return shaded(colour, texture, _tiled(rng, texture), 0.3, 40.0, "plating")


def mesh(rng: np.random.Generator) -> Material:
    """Perforated sheet metal, as of grilles."""
    texture = textures.metal("mesh", 0)
    return _of(rng, texture, ((0.3, 0.3, 0.3), (0.14, 0.14, 0.14), (0.7, 0.7, 0.7)), "mesh", 0.3)


def facade(rng: np.random.Generator, kind: str, repeats: tuple[float, float]) -> Material:
    """A wall with windows.

    Args:
      rng: the random generator.
      kind: see `textures.facade`.
      repeats: number of repeats of its 4 x 4 windows on a part, across and upward.
    """
    return pictured(textures.facade(kind, _variant(rng)), Fitted(repeats), 0.15, 50.0, "facade")


def label(rng: np.random.Generator, kind: str, mapping: UVMapping | None = None) -> Material:
    """A printed label; `kind` is described in `textures.label`."""
    return pictured(textures.label(kind, _variant(rng)), mapping or Fitted(), 0.2, 40.0, "label")


def livery(rng: np.random.Generator) -> Material:
    """Paint with bands and numbers, fitted to the sides of a part."""
    texture = textures.livery(_variant(rng), pick(rng, (grey, lively))(rng), lively(rng))
    return pictured(texture, Fitted(), 0.4, 60.0, "livery")


RUBBER = Material((0.09, 0.09, 0.09), (0.08, 0.08, 0.08), 15.0, name="rubber")
DARK_GLASS = Material((0.1, 0.13, 0.16), (0.6, 0.6, 0.6), 120.0, name="dark glass")
GLASS = Material((0.42, 0.6, 0.6), (0.6, 0.6, 0.6), 120.0, opacity=0.5, name="glass")
BLACK = Material((0.07, 0.07, 0.07), name="black")
WHITE = Material((0.92, 0.92, 0.92), (0.2, 0.2, 0.2), 30.0, name="white")
CHROME = Material((0.75, 0.75, 0.75), (0.7, 0.7, 0.7), 90.0, name="chrome")
LIGHT = Material((0.98, 0.95, 0.82), (0.5, 0.5, 0.5), 60.0, name="light")
RED_LIGHT = Material((0.72, 0.05, 0.05), (0.5, 0.5, 0.5), 60.0, name="red light")
GOLD = Material((0.78, 0.62, 0.25), (0.6, 0.55, 0.4), 60.0, name="brass")

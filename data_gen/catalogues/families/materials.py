"""Materials of procedural models, and their textures: small periodic uint8 RGBA arrays.

The hues are those of the authors' images: 60 % of the pixels are grey, most others are red to
yellow, almost none are purple.
"""
# fmt: off
# We format by hand, because the formatter would put each number of a table in a line.

import colorsys
import dataclasses
import functools
import zlib
from collections.abc import Callable, Sequence

import numpy as np

from data_gen.mesh import Material

Colour = tuple[float, float, float]

VARIANTS = 8
"""Number of random variants of each texture."""

SHADES = {
    "wood": ("straight", "cathedral", "planks"),
    "cloth": ("plain", "twill", "rib", "basket"),
    "leather": ("grained", "tufted"),
    "metal": ("brushed", "cast", "mesh"),
    "paint": ("clean", "panels", "worn"),
    "stone": ("marble", "granite", "concrete"),
}
"""Kinds of surfaces and their sorts, see `shade`."""

PATTERNS = ("stripes", "checks", "dots", "diamonds")
SCREENS = ("page", "windows", "landscape")

_SIZE = 128
_ROW, _COLUMN = (np.mgrid[:_SIZE, :_SIZE] + 0.5) / _SIZE

# --- Textures -------------------------------------------------------------------------------------


def _noise(rng: np.random.Generator, rows: float, columns: float) -> np.ndarray:
    """Periodic noise with mean 0 and standard deviation 1, blurred along each axis."""
    spectrum = np.fft.rfft2(rng.standard_normal((_SIZE, _SIZE)))
    fy, fx = np.fft.fftfreq(_SIZE)[:, None], np.fft.rfftfreq(_SIZE)
    spectrum *= np.exp(-2 * np.pi**2 * ((fy * rows) ** 2 + (fx * columns) ** 2))
    spectrum[0, 0] = 0
    field = np.fft.irfft2(spectrum, (_SIZE, _SIZE))
    return field / max(float(field.std()), 1e-9)


def _texture(colour: np.ndarray) -> np.ndarray:
    """Values [H, W] or [H, W, 3] in [0, 1] as a read-only texture."""
    rgb = colour if colour.ndim == 3 else np.repeat(colour[..., None], 3, axis=2)
    result = np.full((*rgb.shape[:2], 4), 255, np.uint8)
    result[..., :3] = np.rint(255 * np.clip(rgb, 0, 1))
    result.flags.writeable = False
    return result


@functools.lru_cache(maxsize=256)
def shade(kind: str, sort: str, variant: int) -> np.ndarray:
    """The reflectance of a surface of `SHADES` relative to its brightest part.

    The grain of wood and of brushed metal is along u.
    """
    rng = np.random.default_rng([zlib.crc32(f"{kind} {sort}".encode()), variant])
    i, j = np.mgrid[:_SIZE, :_SIZE]
    if kind == "wood":
        bend = {"straight": 0.3, "cathedral": 1.1, "planks": 0.4}[sort]
        phase = rng.integers(4, 9) * _ROW + bend * _noise(rng, 14, 40)
        dark = 0.16 * (phase % 1) ** 2 + 0.09 * np.clip(_noise(rng, 0.8, 20), -1.5, 2.5)
        if sort == "planks":
            board = i * int(rng.integers(4, 8)) // _SIZE
            dark += rng.uniform(-0.05, 0.22, 8)[board] + 0.4 * (board != np.roll(board, 1, axis=0))
        # Darker parts of wood are redder.
        return _texture(1 - (dark - np.percentile(dark, 3))[..., None] * [0.85, 1.0, 1.15])
    if kind == "cloth":
        across = (i // 4 + j // 4) % 2 == 1
        basket = 0.4 + 0.6 * np.sin(np.pi * (np.where(across, i, j) % 4 + 0.5) / 4)
        tone = {"plain": np.where((i // 2 + j // 2) % 2, 1.0, 0.74), "basket": basket,
                "twill": 0.76 + 0.24 * ((i + j) % 8 < 4),
                "rib": 0.72 + 0.28 * np.sin(np.pi * (j % 8 + 0.5) / 8)}[sort]
        tone = tone * (1 - 0.05 * np.abs(_noise(rng, 0.7, 0.7)))
    elif kind == "leather":
        tone = 0.93 - 0.12 * (np.abs(_noise(rng, 1.3, 1.3)) < 0.35) + 0.04 * _noise(rng, 10, 10)
        if sort == "tufted":  # buttons in a diamond grid with creases between them
            a, b = 4 * (_ROW + _COLUMN) % 1, 4 * (_ROW - _COLUMN) % 1
            a, b = np.minimum(a, 1 - a), np.minimum(b, 1 - b)
            tone *= 0.62 + 0.38 * np.clip(np.minimum(a, b) / 0.16, 0, 1)
            tone[np.hypot(a, b) < 0.1] = 0.45
    elif kind == "metal":
        hole = np.hypot(i % 8 - 3.5, (j + 4 * (i // 8 % 2)) % 8 - 3.5) < 2.7
        tone = {"brushed": 0.84 + 0.08 * _noise(rng, 0.5, 30), "mesh": np.where(hole, 0.3, 1.0),
                "cast": 0.88 + 0.045 * _noise(rng, 0.8, 0.8) + 0.03 * _noise(rng, 8, 8)}[sort]
    elif kind == "paint":
        tone = 0.96 + 0.015 * _noise(rng, 14, 14)
        if sort == "panels":
            tone[rng.integers(_SIZE, size=3)] *= 0.6
            tone[:, rng.integers(_SIZE, size=3)] *= 0.6
        elif sort == "worn":
            dirt = np.maximum(_noise(rng, 24, 1.2), 0) + 2 * np.maximum(_noise(rng, 12, 12), 0)
            return _texture(tone[..., None] * (1 - 0.05 * dirt[..., None] * [0.8, 1.0, 1.25]))
    else:
        vein = np.abs(_noise(rng, 16, 16) + 0.3 * _noise(rng, 5, 5))
        tone = {"marble": 0.97 - 0.4 * np.exp(-((vein / 0.11) ** 2)),
                "granite": 0.78 + 0.11 * _noise(rng, 0.7, 0.7),
                "concrete": 0.87 + 0.05 * _noise(rng, 12, 12) + 0.03 * _noise(rng, 0.6, 0.6)}[sort]
    return _texture(tone)


def pattern(kind: str, variant: int, colours: Sequence[Sequence[float]]) -> np.ndarray:
    """A printed or woven pattern of four colours: ground, figure, second figure, accent."""
    rng = np.random.default_rng([zlib.crc32(kind.encode()), variant])
    count = int(rng.integers(3, 8))
    a, b = _ROW * count, _COLUMN * count
    number = {
        "stripes": np.digitize(b % 1, [rng.uniform(0.2, 0.6), 0.9]),
        "checks": (a % 1 < 0.5).astype(int) + (b % 1 < 0.5),
        "dots": (np.hypot(a % 1 - 0.5, b % 1 - 0.5) < rng.uniform(0.2, 0.36)).astype(int),
        "diamonds": ((np.floor(a + b) + np.floor(a - b)) % 2).astype(int),
    }[kind]
    return _texture(np.asarray(colours, float)[number])


@functools.lru_cache(maxsize=64)
def display(kind: str, variant: int) -> np.ndarray:
    """The image on a screen, of a kind in `SCREENS`."""
    rng = np.random.default_rng([zlib.crc32(kind.encode()), variant])
    sky = np.array([(0.35, 0.55, 0.85), (0.8, 0.5, 0.35), (0.55, 0.6, 0.68)])[rng.choice(3)]
    page = (1 - _ROW[..., None]) * sky + _ROW[..., None] * 0.9
    for level, hill in ((0.5, (0.45, 0.52, 0.55)), (0.65, (0.3, 0.42, 0.22)),
                        (0.8, (0.22, 0.3, 0.12))):
        waves = [rng.uniform(0, 0.07) / k * np.sin(6.3 * k * _COLUMN + 6 * level) for k in (1, 3)]
        page[sum(waves, level) < _ROW] = np.array(hill) * rng.uniform(0.7, 1.2)
    windows = {"page": np.array([(0, 0, _SIZE, _SIZE)]),
               "windows": rng.integers((4, 4, 40, 40), (50, 50, 84, 84), (3, 4))}
    for top, left, high, wide in windows.get(kind, ()):
        part = page[top : top + high, left : left + wide]
        part[:] = 0.95
        part[:5] = rng.choice([0.2, 0.45, 0.75]), 0.4, 0.6
        for line in range(9, high - 3, 4):
            part[line : line + 2, 4 : int(part.shape[1] * rng.uniform(0.4, 0.95))] = 0.3
    return _texture(page)


# --- Materials ------------------------------------------------------------------------------------

# Range of the hue in degrees, and weight.
_HUES = ((-10, 15, 0.30), (15, 45, 0.27), (45, 65, 0.09), (65, 100, 0.08), (100, 160, 0.06),
         (160, 200, 0.04), (200, 225, 0.08), (225, 255, 0.09), (255, 330, 0.03), (330, 350, 0.015))

_COLOURS: dict[str, tuple[Colour, ...]] = {
    "wood": ((0.66, 0.48, 0.30), (0.76, 0.62, 0.44), (0.80, 0.65, 0.44), (0.40, 0.26, 0.17),
             (0.50, 0.26, 0.16), (0.22, 0.15, 0.12), (0.56, 0.38, 0.24), (0.36, 0.19, 0.10)),
    "metal": ((0.66, 0.66, 0.66), (0.78, 0.78, 0.78), (0.2, 0.2, 0.2), (0.12, 0.12, 0.12),
              (0.72, 0.57, 0.27), (0.45, 0.33, 0.22), (0.36, 0.36, 0.37)),
    "leather": ((0.33, 0.19, 0.12), (0.12, 0.12, 0.12), (0.55, 0.34, 0.2), (0.85, 0.81, 0.74),
                (0.4, 0.08, 0.07)),
    "plastic": ((0.09, 0.09, 0.09), (0.2, 0.2, 0.2), (0.5, 0.5, 0.5), (0.9, 0.9, 0.9),
                (0.78, 0.74, 0.66), (0.7, 0.7, 0.7)),
    "stone": ((0.85, 0.84, 0.82), (0.3, 0.3, 0.3), (0.55, 0.53, 0.5), (0.6, 0.5, 0.42)),
    "gun": ((0.1, 0.1, 0.1), (0.16, 0.16, 0.17), (0.25, 0.25, 0.26), (0.45, 0.45, 0.46)),
}
"""Mean colours to choose from."""

# Largest number of texels per radius of the model: 1.3 per pixel with the default camera, which the
# samples within a pixel smooth without moiré.
_TEXELS_PER_RADIUS = 145.0


@dataclasses.dataclass(frozen=True, eq=False)
class Textured(Material):
    """A material with a texture mapping.

    Attributes:
      tile: period of the texture, in units of the model's radius; 0 = it covers the part.
      along_grain: whether u is along the longest side of the part; otherwise it is horizontal.
    """

    tile: float = 1.0
    along_grain: bool = False


def lively(rng: np.random.Generator) -> Colour:
    """A random saturated colour."""
    weights = np.array([w for _, _, w in _HUES])
    low, high, _ = _HUES[int(rng.choice(len(_HUES), p=weights / weights.sum()))]
    saturation = 1.0 if rng.random() < 0.2 else rng.uniform(0.5, 0.95)
    return colorsys.hsv_to_rgb(rng.uniform(low, high) / 360 % 1, saturation, rng.uniform(0.3, 0.9))


def muted(rng: np.random.Generator) -> Colour:
    """A colour of low saturation, such as cloth and walls; more often warm than cold."""
    hue, saturation, value = colorsys.rgb_to_hsv(*lively(rng))
    return colorsys.hsv_to_rgb(hue, saturation * rng.uniform(0.25, 0.7), value)


def grey(rng: np.random.Generator) -> Colour:
    """White, grey or black."""
    tone = rng.choice((0.95, 0.9, 0.8, 0.7, 0.6, 0.5, 0.38, 0.26, 0.16, 0.09))
    return (min(float(tone * rng.uniform(0.94, 1.06)), 1.0),) * 3


def _of(rng: np.random.Generator, kind: str) -> Colour:
    """A colour of `_COLOURS`, a little lighter or darker."""
    colour = _COLOURS[kind][int(rng.integers(len(_COLOURS[kind])))]
    red, green, blue = np.clip(np.array(colour) * rng.uniform(0.87, 1.13), 0, 1).tolist()
    return red, green, blue


def plain(colour: Colour, gloss: float = 0.2, shininess: float = 40.0, name: str = "") -> Material:
    """A material without a texture."""
    return Material(colour, (gloss,) * 3, shininess, name=name)


def _shaded(rng: np.random.Generator, colour: Colour, kind: str, gloss: float, plain_share: float,
            sorts: Sequence[str] = ()) -> Material:
    """A material of this mean colour; with the probability `plain_share`, without a texture."""
    if rng.random() < plain_share:
        return plain(colour, gloss, name=kind)
    texture = shade(kind, str(rng.choice(sorts or SHADES[kind])), int(rng.integers(VARIANTS)))
    red, green, blue = np.clip(np.array(colour) / texture[..., :3].mean(axis=(0, 1)) * 255, 0, 1)
    tile = _SIZE / _TEXELS_PER_RADIUS * rng.uniform(1.0, 1.7)
    return Textured((red, green, blue), (gloss,) * 3, 40.0, 1.0, texture, kind, tile,
                    kind in ("wood", "metal"))


def _usual(colours: str, kind: str, gloss: float, plain_share: float,
           *sorts: str) -> Callable[[np.random.Generator], Material]:
    """Draws materials with a mean colour of `_COLOURS`; the other arguments are as in `_shaded`."""
    return lambda rng: _shaded(rng, _of(rng, colours), kind, gloss, plain_share, sorts)


wood = _usual("wood", "wood", 0.12, 0.15)  # solid wood or boards, with the grain along the part
metal = _usual("metal", "metal", 0.45, 0.4, "brushed", "cast")  # steel, chrome, iron, brass, bronze
steel = _usual("gun", "metal", 0.35, 0.5, "brushed", "cast")  # the dark steel of guns
plastic = _usual("plastic", "metal", 0.25, 0.6, "cast")  # housings: black, grey, white, beige
stone = _usual("stone", "stone", 0.2, 0.1)  # marble, granite, concrete
leather = _usual("leather", "leather", 0.2, 0.2)  # grained or with buttons


def _pictured(texture: np.ndarray, tile: float, gloss: float, name: str) -> Material:
    """A material with the colours of its texture."""
    return Textured((1.0, 1.0, 1.0), (gloss,) * 3, 60.0, 1.0, texture, name, tile)


def paint(rng: np.random.Generator) -> Material:
    """Paint of vehicles, grey or saturated."""
    return _shaded(rng, (grey if rng.random() < 0.5 else lively)(rng), "paint", 0.4, 0.4)


def lacquer(rng: np.random.Generator) -> Material:
    """Painted furniture: white, grey, black or muted, sometimes saturated."""
    colour = (grey, grey, grey, muted, lively)[int(rng.choice(5,
        p=(0.2, 0.2, 0.2, 0.25, 0.15)))](rng)
    return _shaded(rng, colour, "wood", 0.2, 0.6)


def perforated(rng: np.random.Generator) -> Material:
    """Perforated sheet, or wickerwork."""
    if rng.random() < 0.5:
        return _shaded(rng, (0.25, 0.25, 0.25), "metal", 0.2, 0.0, ("mesh",))
    return _shaded(rng, _of(rng, "wood"), "cloth", 0.0, 0.0, ("basket",))


def fabric(rng: np.random.Generator) -> Material:
    """Upholstery: plain colours, cloth, patterns."""
    colour = (grey, grey, muted, muted, lively)[int(rng.integers(5))](rng)
    if rng.random() < 0.7:
        return _shaded(rng, colour, "cloth", 0.0, 0.4)
    figure = (lively, muted, grey)[int(rng.integers(3))](rng)
    if abs(np.mean(colour) - np.mean(figure)) < 0.15:
        figure = (0.9, 0.88, 0.82) if np.mean(colour) < 0.4 else (0.15, 0.13, 0.1)
    colours = (colour, figure, muted(rng), lively(rng))
    texture = pattern(str(rng.choice(PATTERNS)), int(rng.integers(VARIANTS)), colours)
    return _pictured(texture, rng.uniform(0.9, 1.5), 0.0, "pattern")


def screen(rng: np.random.Generator) -> Material:
    """A display, switched off or with an image that fills the part."""
    if rng.random() < 0.3:
        return plain((0.05, 0.05, 0.06), 0.5, 120.0, "screen")
    return _pictured(display(str(rng.choice(SCREENS)), int(rng.integers(VARIANTS))), 0.0, 0.3,
                     "screen")


BLACK = plain((0.07, 0.07, 0.07), 0.05, name="black")
WHITE = plain((0.92, 0.92, 0.92), 0.2, name="white")
CHROME = plain((0.75, 0.75, 0.75), 0.7, 90.0, "chrome")
DARK_GLASS = plain((0.08, 0.1, 0.12), 0.6, 120.0, "dark glass")
GLASS = Material((0.42, 0.6, 0.6), (0.6, 0.6, 0.6), 120.0, opacity=0.5, name="glass")
LIGHT = plain((0.98, 0.95, 0.82), 0.5, 60.0, "light")
RED_LIGHT = plain((0.72, 0.05, 0.05), 0.5, 60.0, "red light")

"""The ground under an object: a plane with a procedural texture.

The plane is z = 0 of the project's frame. Colours are linear reflectances.
"""

import dataclasses

import numpy as np
from jaxtyping import Bool, Float

from data_gen.cameras import turn_about_vertical
from data_gen.surroundings import Surroundings, noise

KINDS = ("paper", "wood", "planks", "tiles", "carpet", "cloth", "concrete", "asphalt", "grass")
"""The kinds of ground."""

_TEXELS = 512

# Kinds that fit each kind of surroundings, with weights.
_FITTING = {
    "room": {"wood": 4, "planks": 3, "tiles": 2, "carpet": 2, "cloth": 2, "paper": 1,
             "concrete": 1},
    "studio": {"paper": 5, "wood": 2, "cloth": 1, "concrete": 1},
    "outdoors": {"asphalt": 3, "concrete": 3, "grass": 3, "tiles": 2, "planks": 1},
    "map": {"wood": 3, "concrete": 2, "asphalt": 2, "tiles": 2, "paper": 2, "grass": 1, "cloth": 1,
            "planks": 2},
}  # fmt: skip


@dataclasses.dataclass(frozen=True, eq=False)
class Ground:
    """A horizontal plane, or a rectangle of it.

    Attributes:
      levels: float32 [T, T, 3] each, the repeating texture at full, half, ... resolution.
      size: side length of the texture, in units of the frame.
      turn: rotation of texture and edges about the vertical axis, degrees.
      half: half of the rectangle's length and width; infinite for a plane.
      gloss: reflectance at normal incidence.
      sweep: distance behind the object from which the plane curves upward and becomes the
        background, like the paper of product photographs; 0 = it stays flat.
    """

    levels: tuple[Float[np.ndarray, "t t 3"], ...]
    size: float
    turn: float
    half: tuple[float, float]
    gloss: float
    sweep: float = 0.0

    @property
    def mean(self) -> Float[np.ndarray, " 3"]:
        """The mean reflectance."""
        mean: np.ndarray = self.levels[-1].reshape(3)
        return mean

    @property
    def endless(self) -> bool:
        """Whether it is a plane."""
        return not np.isfinite(self.half).any()

    def _own(self, places: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        own: np.ndarray = places @ turn_about_vertical(self.turn)[:2, :2].astype(np.float32)
        return own

    def holds(self, places: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, " n"]:
        """Which points of the plane are on the ground."""
        inside: np.ndarray = (np.abs(self._own(places)) <= np.array(self.half)).all(axis=1)
        return inside

    def colour(
        self, places: Float[np.ndarray, "n 2"], footprint: Float[np.ndarray, " n"]
    ) -> Float[np.ndarray, "n 3"]:
        """Reflectance at points of the plane, a mean over squares of side `footprint`."""
        own = self._own(places) / self.size
        texel = self.size / len(self.levels[0])
        exact = np.clip(np.log2(np.maximum(footprint / texel, 1e-6)), 0, len(self.levels) - 1)
        result = np.zeros((len(places), 3), np.float32)
        for number, level in enumerate(self.levels):
            share = np.maximum(1 - np.abs(exact - number), 0).astype(np.float32)
            index = np.flatnonzero(share)
            result[index] += share[index, None] * _bilinear(level, own[index])
        return result


def _bilinear(level: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Bilinear interpolation of a texture that repeats with period 1."""
    exact = place * len(level) - 0.5
    low = np.floor(exact).astype(np.int64)
    result = np.zeros((len(place), 3), np.float32)
    for row, column in ((0, 0), (0, 1), (1, 0), (1, 1)):
        corner = low + np.array([row, column])
        weight = (1 - np.abs(exact - corner)).prod(axis=1, keepdims=True)
        result += weight.astype(np.float32) * level[*(corner % len(level)).T]
    return result


def _levels(texture: np.ndarray) -> tuple[np.ndarray, ...]:
    result = [np.clip(texture, 0.005, 0.9).astype(np.float32)]
    while len(result[-1]) > 1:
        last = result[-1]
        result.append(last.reshape(len(last) // 2, 2, len(last) // 2, 2, 3).mean(axis=(1, 3)))
    return tuple(result)


_WOODS = ((0.46, 0.28, 0.14), (0.32, 0.16, 0.07), (0.6, 0.44, 0.27), (0.16, 0.08, 0.045),
          (0.4, 0.3, 0.2), (0.5, 0.2, 0.09), (0.36, 0.33, 0.3))  # fmt: skip


def _tone(rng: np.random.Generator, low: float, high: float, saturation: float) -> np.ndarray:
    """A random colour, more often warm than cold, like floors and tables."""
    colour = 1 + saturation * rng.uniform(-1, 1, 3)
    colour *= np.array([1.1, 1.0, 0.88]) / colour.mean()
    return np.clip(colour * rng.uniform(low, high), 0.02, 0.85)


def _grain(rng: np.random.Generator, colour: np.ndarray) -> np.ndarray:
    """Wood with horizontal grain."""
    size = (_TEXELS, _TEXELS)
    broad = noise(rng, size, slope=1.8, stretch=(1, 14))
    rings = np.sin(broad * rng.uniform(4, 12) + 2 * noise(rng, size, slope=1.5, stretch=(1, 30)))
    fine = noise(rng, size, slope=0.5, stretch=(1, 40))
    depth = rng.uniform(0.06, 0.2)
    shade = 1 + depth * rings + 0.11 * fine + 0.12 * noise(rng, size, slope=1.6)
    stain = np.clip(shade, 0.3, 1.6)[..., None]
    return colour * stain ** np.array([1.0, 1.15, 1.3])


def _cells(rng: np.random.Generator, rows: int, columns: int, stagger: bool) -> tuple:
    """For each texel the number of its board or tile, and the distance to its edge in texels."""
    y, x = np.mgrid[:_TEXELS, :_TEXELS].astype(np.float32) + 0.5
    high, wide = _TEXELS / rows, _TEXELS / columns
    row = (y / high).astype(int)
    shift = rng.integers(0, columns * 8, rows)[row] * wide / 8 if stagger else 0
    x = (x + shift) % _TEXELS
    column = (x / wide).astype(int)
    edge = np.minimum(np.minimum(y % high, high - y % high), np.minimum(x % wide, wide - x % wide))
    return row * columns + column, edge


def _texture(kind: str, rng: np.random.Generator) -> tuple[np.ndarray, float, float]:
    """A texture, its side length, and its gloss."""
    size = (_TEXELS, _TEXELS)
    white = rng.standard_normal((*size, 1)).astype(np.float32)
    if kind == "paper":
        colour = np.array([0.75, 0.75, 0.74])
        if rng.random() < 0.5:
            colour = _tone(rng, 0.05, 0.8, 0.5)
        return colour * (1 + 0.01 * noise(rng, size, slope=1.2)[..., None]), 3.0, 0.0
    if kind in ("wood", "planks"):
        colour = np.array(_WOODS[int(rng.integers(len(_WOODS)))]) * rng.uniform(0.7, 1.3)
        grain = _grain(rng, colour)
        if kind == "planks" or rng.random() < 0.4:
            rows = int(rng.integers(4, 10))
            number, edge = _cells(rng, rows, int(rng.integers(1, 3)), True)
            shift = rng.integers(0, _TEXELS, (number.max() + 1, 2))
            y, x = np.mgrid[:_TEXELS, :_TEXELS]
            grain = grain[(y + shift[number, 0]) % _TEXELS, (x + shift[number, 1]) % _TEXELS]
            shade = rng.uniform(0.8, 1.2, number.max() + 1)[number]
            gap = np.clip(edge / rng.uniform(1, 3), 0.25, 1)
            grain = grain * (shade * gap)[..., None]
        size_of = rng.uniform(1.5, 3.0) if kind == "wood" else rng.uniform(2.5, 5)
        return grain, size_of, rng.choice([0.0, 0.02, 0.05])
    if kind == "tiles":
        rows = int(rng.integers(3, 9))
        number, edge = _cells(rng, rows, rows if rng.random() < 0.7 else rows // 2 + 1,
                              rng.random() < 0.25)  # fmt: skip
        colour = _tone(rng, 0.15, 0.7, 0.15)
        shade = rng.uniform(0.88, 1.12, number.max() + 1)[number]
        if rng.random() < 0.25:  # a chequered floor
            shade = shade * np.where(
                (number // max(rows, 1) + number) % 2, 1, rng.uniform(0.2, 0.7)
            )
        body = colour * (shade * (1 + 0.08 * noise(rng, size, slope=1.4)))[..., None]
        grout = rng.uniform(0.1, 0.5) * np.ones(3)
        line = np.clip(edge / rng.uniform(1.2, 3.5) - 0.5, 0, 1)[..., None]
        return body * line + grout * (1 - line), rng.uniform(2.5, 5), rng.choice([0.0, 0.03, 0.06])
    if kind == "carpet":
        colour = _tone(rng, 0.06, 0.5, 0.35)
        tufts = 1 + 0.22 * white[..., 0] + 0.12 * noise(rng, size, slope=1.3)
        if rng.random() < 0.5:  # a pattern
            y, x = np.mgrid[:_TEXELS, :_TEXELS] * (2 * np.pi / _TEXELS)
            a, b = rng.integers(2, 10, 2)
            wave = np.sin(a * x) * np.sin(b * y) if rng.random() < 0.5 else np.sin(a * x)
            other = _tone(rng, 0.06, 0.6, 0.5)
            share = np.clip(4 * wave + 0.5, 0, 1)[..., None]
            colour = colour * share + other * (1 - share)
        return colour * np.clip(tufts, 0.3, 2)[..., None], rng.uniform(2, 4), 0.0
    if kind == "cloth":
        y, x = np.mgrid[:_TEXELS, :_TEXELS]
        threads = int(2 ** rng.integers(5, 7))
        weave = np.sin(x * threads * 2 * np.pi / _TEXELS) * np.sin(
            y * threads * 2 * np.pi / _TEXELS
        )
        colour = _tone(rng, 0.15, 0.75, 0.35)
        cloth = colour * np.ones((*size, 1))
        if rng.random() < 0.5:  # checks
            count = int(rng.integers(3, 10))
            band = (x * count * 2 // _TEXELS % 2 + y * count * 2 // _TEXELS % 2) / 2.0
            other = _tone(rng, 0.1, 0.8, 0.5)
            cloth = cloth * (1 - band[..., None]) + other * band[..., None]
        shade = 1 + 0.08 * weave + 0.06 * noise(rng, size, slope=1.6)
        return cloth * shade[..., None], rng.uniform(1.2, 2.5), 0.0
    if kind == "concrete":
        colour = np.array([1.0, 0.97, 0.92]) * rng.uniform(0.15, 0.5)
        shade = 1 + 0.09 * noise(rng, size, slope=1.3) + 0.09 * noise(rng, size, slope=0.7)
        shade = shade + 0.06 * white[..., 0]
        shade = shade - 0.2 * (noise(rng, size, slope=0.8) > 2.4)
        return colour * np.clip(shade, 0.3, 1.7)[..., None], rng.uniform(2, 5), 0.0
    if kind == "asphalt":
        stones = noise(rng, size, slope=0.35)
        colour = (
            np.array([1.0, 1.0, 1.0]) * rng.uniform(0.04, 0.2) * (1 + rng.uniform(-0.1, 0.1, 3))
        )
        shade = 1 + 0.35 * stones + 0.1 * noise(rng, size, slope=1.5)
        return colour * np.clip(shade, 0.25, 2.6)[..., None], rng.uniform(1.2, 3), 0.0
    blades = noise(rng, size, slope=0.5, stretch=(1, 3)) + noise(
        rng, size, slope=0.5, stretch=(3, 1)
    )
    colour = np.array([0.12, 0.16, 0.055]) * rng.uniform(0.5, 1.3)
    dry = np.clip(0.5 * noise(rng, size, slope=1.2) + rng.uniform(-0.6, 0.4), 0, 0.7)[..., None]
    colour = colour * (1 - dry) + dry * np.array([0.2, 0.18, 0.1])
    shade = np.clip(1 + 0.3 * blades + 0.15 * noise(rng, size, slope=1.2), 0.15, 2.4)
    return colour * shade[..., None], rng.uniform(1.5, 3.5), 0.0


def draw(rng: np.random.Generator, kind: str, around: Surroundings) -> Ground:
    """Draws a ground of one of `KINDS`, or "random" = one that fits the surroundings.

    The floor of a room ends at its walls, a table at its edges.
    """
    if kind == "random":
        fitting = _FITTING[around.kind]
        weights = np.array(list(fitting.values()), float)
        kind = str(rng.choice(list(fitting), p=weights / weights.sum()))
    texture, size, gloss = _texture(kind, rng)
    levels = _levels(np.broadcast_to(texture, (_TEXELS, _TEXELS, 3)))
    turn = float(rng.uniform(0, 360))
    half = (float("inf"), float("inf"))
    sweep = 0.0
    if kind == "paper":
        sweep = float(rng.uniform(1.5, 4))
    elif around.room is not None:
        if around.room.floor == 0:
            turn, half = around.room.turn, around.room.half
        else:
            half = (float(rng.uniform(1.3, 3.5)), float(rng.uniform(1.3, 2.5)))
    elif around.kind == "map" and kind in ("wood", "cloth") and rng.random() < 0.5:
        half = (float(rng.uniform(1.3, 3.5)), float(rng.uniform(1.3, 2.5)))
    return Ground(levels, float(size), turn, half, float(gloss), sweep)

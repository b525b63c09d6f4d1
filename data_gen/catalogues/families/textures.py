"""Procedural textures: small periodic uint8 RGBA arrays, determined by their arguments.

There are two kinds. A *shade* (wood, weave, leather, metal, stone) is the reflectance of a surface
relative to its brightest part and is multiplied by the diffuse colour of the material. A *picture*
(screens, labels, carpets) has its own colours. Each texture exists in a few random versions, which
are numbered by `variant` and cached.

The size of a repeated texture on a model is usually random. It then has at most `TEXELS_PER_RADIUS`
texels per radius of the model. With the default camera that is 1.3 texels per pixel, which the
samples of a pixel smooth without moiré. In a few materials the size is fixed and may be smaller.
"""

import functools
import itertools
import zlib
from collections.abc import Sequence

import numpy as np

VARIANTS = 8
"""Number of random versions of each kind of texture."""

TEXELS_PER_RADIUS = 145.0
"""Largest number of texels per radius of the model, for repeated textures of random size."""

Colour = Sequence[float] | np.ndarray

_SIZE = 128


def _rng(kind: str, variant: int) -> np.random.Generator:
    return np.random.default_rng([zlib.crc32(kind.encode()), variant])


def _noise(
    rng: np.random.Generator, rows: float, columns: float, size: int | tuple[int, int] = _SIZE
) -> np.ndarray:
    """Periodic noise with mean 0 and standard deviation 1, blurred along each axis."""
    height, width = (size, size) if isinstance(size, int) else size
    spectrum = np.fft.rfft2(rng.standard_normal((height, width)))
    fy, fx = np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)
    spectrum *= np.exp(-2 * np.pi**2 * ((fy * rows) ** 2 + (fx * columns) ** 2))
    spectrum[0, 0] = 0
    field = np.fft.irfft2(spectrum, (height, width))
    return field / max(float(field.std()), 1e-9)


def _fractal(rng: np.random.Generator, coarse: float = 16.0, size: int = _SIZE) -> np.ndarray:
    """Noise of many scales, with mean 0 and standard deviation about 1."""
    total = sum(0.6**k * _noise(rng, coarse / 2**k, coarse / 2**k, size) for k in range(4))
    return np.asarray(total / np.std(total))


def _grid(size: int = _SIZE) -> tuple[np.ndarray, np.ndarray]:
    """Row and column in [0, 1) of each texel."""
    row, column = (np.mgrid[:size, :size] + 0.5) / size
    return row, column


def _texture(colour: np.ndarray, alpha: np.ndarray | None = None) -> np.ndarray:
    """Values [H, W] or [H, W, 3] in [0, 1] as a read-only texture."""
    rgb = colour if colour.ndim == 3 else np.repeat(colour[..., None], 3, axis=2)
    result = np.full((*rgb.shape[:2], 4), 255, np.uint8)
    result[..., :3] = np.rint(255 * np.clip(rgb, 0, 1))
    if alpha is not None:
        result[..., 3] = np.rint(255 * np.clip(alpha, 0, 1))
    result.flags.writeable = False
    return result


def mean_colour(texture: np.ndarray) -> np.ndarray:
    """Mean colour [3] in [0, 1]."""
    return texture[..., :3].mean(axis=(0, 1)) / 255


# --- Shades: reflectance relative to the brightest part -----------------------------------------


@functools.lru_cache(maxsize=64)
def wood(kind: str, variant: int) -> np.ndarray:
    """Wood with horizontal grain (along u).

    Args:
      kind: "straight", "cathedral" (wide, bent rings), "planks" (boards with seams), or "veneer"
        (fine and even).
      variant: number of the random version.
    """
    rng = _rng("wood " + kind, variant)
    row, _ = _grid()
    bend = {"straight": 0.5, "cathedral": 2.2, "planks": 0.8, "veneer": 0.3}[kind]
    rings = rng.integers(4, 9) * (2 if kind == "veneer" else 1)
    phase = rings * row + bend * 0.5 * _noise(rng, 14, 40)
    saw = phase - np.floor(phase)
    streak = _noise(rng, 0.8, 20)
    dark = 0.16 * saw**2 + 0.09 * np.clip(streak, -1.5, 2.5) + 0.08 * (_noise(rng, 0.6, 5) > 1.5)
    if kind == "veneer":
        dark *= 0.7
    if kind == "planks":
        boards = int(rng.integers(4, 8))
        edge = np.linspace(0, _SIZE, boards + 1).astype(int)
        for low, high in itertools.pairwise(edge):
            board = np.roll(dark[low:high], int(rng.integers(_SIZE)), axis=1)
            board += rng.uniform(-0.05, 0.22)
            board[:1] += 0.4
            board[:, int(rng.integers(_SIZE))] += 0.4
            dark[low:high] = board
    dark = dark - np.percentile(dark, 3)
    # Darker parts of wood are redder.
    return _texture(1 - dark[..., None] * [0.85, 1.0, 1.15])


@functools.lru_cache(maxsize=32)
def weave(kind: str, variant: int) -> np.ndarray:
    """Cloth of one colour: "plain", "twill", "rib", "knit", or "basket" (wicker, rattan)."""
    rng = _rng("weave " + kind, variant)
    size = 64
    i, j = np.mgrid[:size, :size]
    if kind == "plain":
        shade = np.where((i // 2 + j // 2) % 2, 1.0, 0.74)
    elif kind == "twill":
        shade = 0.76 + 0.24 * ((i + j) % 8 < 4)
    elif kind == "rib":
        shade = 0.72 + 0.28 * np.sin(np.pi * (j % 8 + 0.5) / 8)
    elif kind == "knit":
        shade = 0.7 + 0.3 * np.abs(np.sin(np.pi * (i + np.abs(j % 8 - 3.5)) / 8))
    else:
        across = ((i // 4 + j // 4) % 2).astype(bool)
        shade = np.where(
            across, np.sin(np.pi * (i % 4 + 0.5) / 4), np.sin(np.pi * (j % 4 + 0.5) / 4)
        )
        shade = 0.35 + 0.65 * shade * np.where(across, 1.0, 0.85)
    return _texture(shade * (1 - 0.05 * np.abs(_noise(rng, 0.7, 0.7, size))))


@functools.lru_cache(maxsize=32)
def leather(kind: str, variant: int) -> np.ndarray:
    """Leather: "grained", or "tufted" (buttons in a diamond grid with creases between them)."""
    rng = _rng("leather " + kind, variant)
    pebble = _noise(rng, 1.3, 1.3)
    shade = 0.93 - 0.12 * (np.abs(pebble) < 0.35) + 0.04 * _noise(rng, 10, 10)
    if kind == "tufted":
        row, column = _grid()
        a, b = 4 * (row + column) % 1, 4 * (row - column) % 1
        crease = np.minimum(np.minimum(a, 1 - a), np.minimum(b, 1 - b))
        shade *= 0.62 + 0.38 * np.clip(crease / 0.16, 0, 1)
        at = np.hypot(np.minimum(a, 1 - a), np.minimum(b, 1 - b))
        shade = np.where(at < 0.1, 0.45, shade)
    return _texture(shade)


@functools.lru_cache(maxsize=64)
def metal(kind: str, variant: int) -> np.ndarray:
    """Metal: "brushed" (horizontally), "cast", "rusty", "plates", "tread" or "mesh"."""
    rng = _rng("metal " + kind, variant)
    row, column = _grid()
    if kind == "brushed":
        return _texture(0.84 + 0.08 * _noise(rng, 0.5, 30))
    if kind == "cast":
        return _texture(0.88 + 0.045 * _noise(rng, 0.8, 0.8) + 0.03 * _noise(rng, 8, 8))
    if kind == "rusty":
        rust = 1 / (1 + np.exp(-4 * (_fractal(rng, 14) - 0.7)))
        base = 0.92 + 0.04 * _noise(rng, 1, 1)
        spots = (0.55 + 0.15 * _noise(rng, 0.8, 0.8))[..., None] * [1.0, 0.6, 0.35]
        return _texture(base[..., None] * (1 - rust[..., None]) + spots * rust[..., None])
    if kind == "plates":
        shade = 0.92 + 0.03 * _noise(rng, 10, 10)
        count = int(rng.integers(2, 4))
        r, c = row * count % 1, column * count % 1
        shade[(r < 0.035) | (c < 0.035)] = 0.45
        beat = np.hypot((r * 8 % 1 - 0.5), (np.minimum(c, 1 - c) - 0.08) * 8)
        shade[(beat < 0.3) & (r > 0.05)] *= 0.7
        return _texture(shade)
    if kind == "tread":
        i, j = np.mgrid[:64, :64]
        turn = ((i // 8 + j // 8) % 2).astype(bool)
        bar = np.where(turn, np.abs(i % 8 - j % 8) < 2, np.abs(i % 8 + j % 8 - 7) < 2)
        return _texture(np.where(bar, 1.0, 0.7))
    i, j = np.mgrid[:60, :60]
    hole = np.hypot(i % 6 - 2.5, (j + 3 * (i // 6 % 2)) % 6 - 2.5) < 2
    return _texture(np.where(hole, 0.3, 1.0))


@functools.lru_cache(maxsize=64)
def painted(kind: str, variant: int) -> np.ndarray:
    """Paint on panels.

    Args:
      kind: "clean", "panels" (seams, small hatches and vents), "worn" (scratches, dirt that runs
        down), "chipped" (bare spots), or "brush" (horizontal brush marks).
      variant: number of the random version.
    """
    rng = _rng("painted " + kind, variant)
    shade = 0.96 + 0.015 * _noise(rng, 14, 14)
    if kind == "brush":
        return _texture(0.9 + 0.05 * _noise(rng, 0.9, 18))
    if kind in ("panels", "worn"):
        for _ in range(int(rng.integers(2, 4))):
            shade[int(rng.integers(_SIZE))] *= 0.6
        for _ in range(int(rng.integers(2, 4))):
            shade[:, int(rng.integers(_SIZE))] *= 0.6
        for _ in range(int(rng.integers(3, 7))):
            top, left = rng.integers(0, _SIZE - 26, 2)
            high, wide = rng.integers(5, 24, 2)
            patch = shade[top : top + high, left : left + wide]
            if rng.random() < 0.4:
                patch[::3] *= 0.5  # a vent
            else:
                patch[[0, -1]] *= 0.65
                patch[:, [0, -1]] *= 0.65
    if kind == "worn":
        run = np.maximum(_noise(rng, 24, 1.2), 0)
        dirt = np.maximum(_fractal(rng, 20), 0)
        brown = (0.05 * run + 0.11 * dirt)[..., None] * [0.8, 1.0, 1.25]
        shade = shade[..., None] * (1 - brown)
        shade *= 1 - 0.2 * (_noise(rng, 0.5, 7) > 2.4)[..., None]
    if kind == "chipped":
        bare = _fractal(rng, 10) > 1.25
        edge = np.roll(bare, 1, axis=0) & ~bare
        shade = np.where(bare, 0.5, np.where(edge, 1.0, shade))
        shade = shade - 0.05 * np.maximum(_fractal(rng, 20), 0)
    return _texture(shade)


@functools.lru_cache(maxsize=64)
def stone(kind: str, variant: int) -> np.ndarray:
    """Stone: "marble", "granite", "concrete", "plaster" or "cobbles"."""
    rng = _rng("stone " + kind, variant)
    if kind == "marble":
        vein = np.abs(_fractal(rng, 22) + 0.25 * _noise(rng, 1.5, 1.5))
        return _texture(0.97 - 0.4 * np.exp(-((vein / 0.11) ** 2)) + 0.03 * _noise(rng, 12, 12))
    if kind == "granite":
        speckle = _noise(rng, 0.7, 0.7)
        return _texture(0.78 + 0.11 * speckle - 0.25 * (_noise(rng, 1, 1) > 1.4))
    if kind == "concrete":
        shade = 0.87 + 0.06 * _fractal(rng, 20) + 0.03 * _noise(rng, 0.6, 0.6)
        return _texture(shade - 0.3 * (_noise(rng, 0.8, 0.8) > 2.4))
    if kind == "plaster":
        return _texture(0.92 + 0.045 * _noise(rng, 1.2, 1.2) + 0.03 * _fractal(rng, 24))
    size = _SIZE
    seeds = rng.random((60, 2))
    row, column = _grid()
    gap = np.abs(np.stack([row, column], -1)[:, :, None] - seeds)
    distance = np.sort((np.minimum(gap, 1 - gap) ** 2).sum(-1), axis=-1)[..., :2] ** 0.5
    number = np.argmin((np.minimum(gap, 1 - gap) ** 2).sum(-1), axis=-1)
    joint = distance[..., 1] - distance[..., 0] < 0.018
    tone = rng.uniform(0.65, 0.95, 60)[number] + 0.05 * _noise(rng, 1, 1, size)
    return _texture(np.where(joint, 0.35, tone))


@functools.lru_cache(maxsize=64)
def masonry(kind: str, variant: int) -> np.ndarray:
    """Masonry: "brick", "blocks", "tiles" (square), "roof" (rows of tiles) or "shingles".

    The courses are horizontal (along u). The joints of bricks are lighter than the bricks.
    """
    rng = _rng("masonry " + kind, variant)
    high, wide, joint = {
        "brick": (8, 16, 1),
        "blocks": (16, 32, 1),
        "tiles": (16, 16, 1),
        "roof": (8, 8, 2),
        "shingles": (8, 8, 1),
    }[kind]
    i, j = np.mgrid[:_SIZE, :_SIZE]
    course = i // high
    shift = 0 if kind == "tiles" else wide // 2
    brick = ((j + shift * (course % 2)) // wide) % (_SIZE // wide)
    tone = rng.uniform(0.72, 0.95, (_SIZE // high, _SIZE // wide + 1))[course, brick]
    tone = tone + 0.04 * _noise(rng, 0.8, 0.8)
    seam = (i % high < joint) | ((j + shift * (course % 2)) % wide < (1 if kind != "roof" else 0))
    colour = tone[..., None] * np.array([1.0, 0.97, 0.95])
    if kind == "roof":
        colour = colour * (0.55 + 0.45 * np.sin(np.pi * (j % wide + 0.5) / wide))[..., None]
        colour = colour * (0.7 + 0.3 * (i % high) / high)[..., None]
    light = {"brick": 1.0, "tiles": 0.55, "blocks": 0.6, "roof": 0.45, "shingles": 0.5}[kind]
    return _texture(np.where(seam[..., None], light, colour * (0.82 if kind == "brick" else 1)))


@functools.lru_cache(maxsize=32)
def foliage(kind: str, variant: int) -> np.ndarray:
    """Plants, soil and fur.

    The kinds are "leaves", "grass", "soil"; and, with the fibres horizontal, "bark", "fur",
    "straw".
    """
    rng = _rng("foliage " + kind, variant)
    if kind == "leaves":
        top = np.full((_SIZE, _SIZE), 0.25)
        row, column = _grid()
        for _ in range(90):
            centre, angle, size = rng.random(2), rng.uniform(0, np.pi), rng.uniform(0.05, 0.085)
            dy, dx = ((row - centre[0] + 0.5) % 1 - 0.5), ((column - centre[1] + 0.5) % 1 - 0.5)
            u = (np.cos(angle) * dx + np.sin(angle) * dy) / size
            v = (np.cos(angle) * dy - np.sin(angle) * dx) / (0.45 * size)
            inside = u**2 + np.abs(v) < 1
            tone = rng.uniform(0.5, 0.95)
            top[inside] = tone * (1 - 0.25 * (np.abs(v[inside]) < 0.2))
        return _texture(top[..., None] * np.array([0.95, 1.0, 0.85]))
    if kind == "grass":
        shade = 0.72 + 0.13 * _noise(rng, 2.2, 0.6) + 0.08 * _fractal(rng, 16)
        return _texture(shade[..., None] * np.array([1.0, 1.0, 0.85]))
    if kind == "bark":
        crack = np.abs(_noise(rng, 1.3, 9)) < 0.25
        return _texture(0.85 + 0.08 * _noise(rng, 1, 5) - 0.4 * crack)
    if kind == "soil":
        return _texture(0.7 + 0.15 * _noise(rng, 0.9, 0.9) + 0.08 * _noise(rng, 3, 3))
    if kind == "straw":
        return _texture(0.78 + 0.14 * _noise(rng, 0.6, 8) - 0.2 * (_noise(rng, 0.6, 6) > 1.4))
    return _texture(0.8 + 0.1 * _noise(rng, 0.7, 4) + 0.1 * _fractal(rng, 20))


# --- Patterns: an index of the palette for each texel ---------------------------------------------

PATTERNS = ("stripes", "pinstripes", "tartan", "gingham", "dots", "flowers", "leaves", "diamonds",
            "zigzag", "damask", "camouflage")  # fmt: skip


@functools.lru_cache(maxsize=96)
def _pattern(kind: str, variant: int) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the palette [H, W], 0 to 3, and a shade [H, W]."""
    rng = _rng("pattern " + kind, variant)
    row, column = _grid()
    i, j = np.mgrid[:_SIZE, :_SIZE]
    plain = 0.93 + 0.07 * ((i + j) % 2) * (rng.random() < 0.7) + 0 * row
    number = np.zeros((_SIZE, _SIZE), np.int64)
    if kind in ("stripes", "pinstripes"):
        count = int(rng.integers(3, 7)) if kind == "stripes" else int(rng.integers(8, 14))
        share = rng.uniform(0.35, 0.55) if kind == "stripes" else 0.22
        phase = column * count % 1
        number = (phase < share).astype(int)
        if kind == "stripes" and rng.random() < 0.6:
            number[(phase > share + 0.12) & (phase < share + 0.24)] = 2
        if rng.random() < 0.3:
            number = number.T
    elif kind in ("tartan", "gingham"):
        count = int(rng.integers(3, 5)) if kind == "tartan" else int(rng.integers(6, 11))
        a, b = (row * count % 1 < 0.5), (column * count % 1 < 0.5)
        plain = plain * np.where(a & b, 0.75, np.where(a | b, 0.9, 1.0))
        number = (a ^ b).astype(int) if kind == "tartan" else (a | b).astype(int)
        if kind == "tartan":
            for line in (row, column):
                number[np.abs(line * count % 1 - 0.25) < 0.04] = 2
                number[np.abs(line * count % 1 - 0.75) < 0.05] = 3
    elif kind == "dots":
        count = int(rng.integers(5, 9))
        odd = (row * count).astype(int) % 2 * 0.5
        if count % 2:
            odd = odd * 0
        at = np.hypot(row * count % 1 - 0.5, (column * count + odd) % 1 - 0.5)
        number = (at < rng.uniform(0.2, 0.34)).astype(int)
    elif kind in ("flowers", "leaves"):
        for _ in range(16 if kind == "flowers" else 26):
            centre, size, turn = rng.random(2), rng.uniform(0.07, 0.13), rng.uniform(0, 6.3)
            dy, dx = (row - centre[0] + 0.5) % 1 - 0.5, (column - centre[1] + 0.5) % 1 - 0.5
            radius, angle = np.hypot(dx, dy) / size, np.arctan2(dy, dx) + turn
            if kind == "leaves" or rng.random() < 0.35:
                u, v = radius * np.cos(angle), radius * np.sin(angle)
                number[(u**2 + np.abs(v) * 2.4 < 1) & (np.abs(v) > 0.05)] = 2
                continue
            petals = radius < 0.55 + 0.4 * np.abs(np.cos(2.5 * angle))
            number[petals] = int(rng.choice([1, 1, 3]))
            number[radius < 0.27] = 3
    elif kind == "diamonds":
        count = int(rng.integers(3, 6))
        a, b = (row + column) * count, (row - column) * count
        number = ((np.floor(a) + np.floor(b)) % 2).astype(int)
        number[(np.abs(a % 1 - 0.5) < 0.04) | (np.abs(b % 1 - 0.5) < 0.04)] = 2
    elif kind == "zigzag":
        count = int(rng.integers(4, 7))
        phase = (row * count + np.abs(column * count * 2 % 2 - 1) * 0.5) % 1
        number = np.where(phase < 0.34, 1, np.where(phase < 0.5, 2, 0))
    elif kind == "damask":
        quarter = _fractal(rng, 7, 32)
        half = np.concatenate([quarter, quarter[:, ::-1]], axis=1)
        motif = np.concatenate([half, np.roll(half, 32, axis=1)], axis=0)
        number = np.tile((motif > 0.35).astype(int), (2, 2))
    else:
        field = _fractal(rng, 12)
        number = np.digitize(field, [-0.6, 0.2, 0.9])
    return number, plain


def pattern(kind: str, variant: int, colours: Sequence[Colour]) -> np.ndarray:
    """A printed or woven pattern.

    Args:
      kind: one of `PATTERNS`.
      variant: number of the random version.
      colours: the palette of four: ground, figure, second figure, accent.
    """
    number, shade = _pattern(kind, variant)
    return _texture(np.asarray(colours, float)[number] * shade[..., None])


# --- Pictures -----------------------------------------------------------------------------------


def _lines(
    rng: np.random.Generator,
    page: np.ndarray,
    top: int,
    left: int,
    high: int,
    wide: int,
    ink: Colour,
) -> None:
    """Fills a part of an image with lines of text."""
    for line in range(top, top + high - 2, 4):
        place, end = left, left + int(wide * rng.uniform(0.55, 1.0))
        while place < end - 2:
            word = int(rng.integers(2, 9))
            page[line : line + 2, place : min(place + word, end)] = ink
            place += word + 2


def _landscape(rng: np.random.Generator, height: int, width: int) -> np.ndarray:
    """A landscape: sky, hills and a foreground."""
    row = np.linspace(0, 1, height)[:, None, None]
    sky = rng.choice(3)
    high = np.array([(0.25, 0.45, 0.8), (0.75, 0.45, 0.3), (0.55, 0.6, 0.68)])[sky]
    low = np.array([(0.8, 0.88, 0.95), (0.98, 0.82, 0.5), (0.85, 0.86, 0.88)])[sky]
    image = (1 - row) * high + row * low + np.zeros((1, width, 1))
    x = np.linspace(0, 2 * np.pi, width)
    clouds = _noise(rng, 3, 9, (height, width))[..., None]
    image = np.where(clouds > 1.0, 0.5 * image + 0.5, image)
    y, level = np.arange(height)[:, None], 0.4
    for tone in range(3):
        level += rng.uniform(0.1, 0.2)
        wave = sum(
            rng.uniform(0, 0.07) / k * np.sin(k * x + rng.uniform(0, 6.3)) for k in (1, 2, 3, 5, 9)
        )
        hill = np.array([(0.45, 0.52, 0.55), (0.3, 0.42, 0.22), (0.22, 0.3, 0.12)])[tone]
        hill = (
            hill * rng.uniform(0.7, 1.2) * (1 + 0.1 * _noise(rng, 1, 2, (height, width)))[..., None]
        )
        image = np.where((y > (level + wave) * height)[..., None], hill, image)
    return np.asarray(image)


SCREENS = ("desktop", "document", "landscape", "sheet", "code", "icons", "film", "dials")


@functools.lru_cache(maxsize=96)
def screen(kind: str, variant: int) -> np.ndarray:
    """The image on a display: one of `SCREENS`."""
    rng = _rng("screen " + kind, variant)
    height, width = 112, 160
    bar = np.array([(0.2, 0.35, 0.65), (0.75, 0.75, 0.77), (0.15, 0.15, 0.17)])[rng.choice(3)]
    page = np.full((height, width, 3), 0.95)
    if kind == "landscape":
        page = _landscape(rng, height, width)
    elif kind == "desktop":
        page = _landscape(rng, height, width)
        for k in range(int(rng.integers(3, 7))):
            page[6 + 15 * k : 14 + 15 * k, 5:13] = rng.uniform(0.2, 0.95, 3)
        for _ in range(int(rng.integers(1, 4))):
            top, left = int(rng.integers(4, 40)), int(rng.integers(18, 70))
            high, wide = int(rng.integers(40, 64)), int(rng.integers(50, 84))
            page[top : top + high, left : left + wide] = 0.94
            page[top : top + 6, left : left + wide] = bar
            _lines(rng, page, top + 9, left + 4, high - 12, wide - 8, (0.3, 0.3, 0.32))
        page[-8:] = bar
        page[-7:-1, 2:16] = 1 - bar
    elif kind in ("document", "code"):
        ink = (0.15, 0.15, 0.17)
        if kind == "code":
            page[:] = (0.1, 0.11, 0.14)
            for line in range(4, height - 4, 5):
                left = 8 + 8 * int(rng.integers(0, 5))
                colour = np.array(
                    [(0.8, 0.8, 0.8), (0.4, 0.7, 0.4), (0.8, 0.6, 0.3), (0.4, 0.6, 0.9)]
                )
                _lines(rng, page, line, left, 5, int(rng.integers(20, 100)), colour[rng.choice(4)])
        else:
            page[:] = 0.6
            page[:, 30:-30] = 0.97
            page[12:17, 40:110] = ink
            _lines(rng, page, 24, 38, 84, width - 76, ink)
        page[:6] = bar
    elif kind == "sheet":
        page[::9] = 0.6
        page[:, ::20] = 0.6
        for top in range(10, height - 8, 9):
            for left in range(4, width - 14, 20):
                if rng.random() < 0.6:
                    _lines(rng, page, top, left, 5, 13, (0.2, 0.2, 0.25))
        page[:9] = bar
        for k in range(8):
            tall = int(rng.integers(6, 40))
            page[-8 - tall : -8, 86 + 8 * k : 92 + 8 * k] = (0.25, 0.45, 0.75)
    elif kind == "icons":
        page = _landscape(rng, height, width) * 0.7
        for top in range(8, height - 20, 26):
            for left in range(8, width - 20, 30):
                page[top : top + 16, left : left + 20] = rng.uniform(0.15, 0.95, 3)
                page[top + 4 : top + 12, left + 6 : left + 14] = 0.95
    elif kind == "film":
        page = _landscape(rng, height, width) * 0.6
        row, column = np.mgrid[:height, :width]
        for _ in range(2):
            x, tone = rng.uniform(30, 130), rng.uniform(0.1, 0.8, 3)
            head = np.hypot(column - x, row - 45) < 14
            body = (np.hypot((column - x) / 1.2, row - 100) < 34) & (row > 55)
            page[body], page[head] = tone, np.array([0.8, 0.6, 0.48]) * rng.uniform(0.5, 1.1)
        page[:10], page[-10:] = 0.03, 0.03
    else:
        page[:] = 0.07
        row, column = np.mgrid[:height, :width]
        for x, y, radius in ((40, 56, 34), (118, 56, 34), (80, 92, 15)):
            distance = np.hypot(column - x, row - y)
            page[np.abs(distance - radius) < 1.5] = 0.85
            angle = np.arctan2(row - y, column - x)
            tick = (np.abs(np.sin(8 * angle)) < 0.15) & (distance > radius * 0.75)
            page[tick & (distance < radius)] = 0.8
            turn = rng.uniform(-2.5, -0.6)
            hand = np.abs(np.sin(angle - turn)) * distance < 1.5
            page[hand & (np.cos(angle - turn) > 0) & (distance < radius * 0.8)] = (0.85, 0.2, 0.1)
    return _texture(page)


@functools.lru_cache(maxsize=64)
def label(kind: str, variant: int) -> np.ndarray:
    """Print: "bottle", "box", "book" (a cover), "clock" (a dial) or "plate" (a number)."""
    rng = _rng("label " + kind, variant)
    size = 96
    row, column = np.mgrid[:size, :size]
    palette = np.array(
        [(0.75, 0.12, 0.1), (0.1, 0.25, 0.5), (0.9, 0.75, 0.2), (0.12, 0.35, 0.2),
         (0.92, 0.9, 0.85), (0.12, 0.12, 0.13), (0.85, 0.45, 0.1)]
    )  # fmt: skip
    one, two, three = palette[rng.permutation(len(palette))[:3]]
    page = np.zeros((size, size, 3)) + one
    if kind == "clock":
        page[:] = (0.95, 0.94, 0.9) if rng.random() < 0.7 else (0.1, 0.1, 0.11)
        ink = 1 - page[0, 0]
        distance = np.hypot(column - 47.5, row - 47.5)
        angle = np.arctan2(row - 47.5, column - 47.5)
        page[(np.abs(np.sin(6 * angle)) < 0.25) & (np.abs(distance - 39) < 5)] = ink
        page[np.abs(distance - 46) < 1.2] = ink
        for long, wide in ((22, 2.2), (33, 1.5)):
            turn = rng.uniform(0, 6.3)
            near = np.abs(np.sin(angle - turn)) * distance < wide
            page[near & (np.cos(angle - turn) > 0) & (distance < long)] = ink
        return _texture(page)
    if kind == "plate":
        page[:] = 0.95 if rng.random() < 0.6 else two
        ink = (0.08, 0.08, 0.1)
        for k in range(2):
            left = 14 + 36 * k
            # Segments of a digit.
            parts = [(12, 18, 0, 28), (45, 51, 0, 28), (78, 84, 0, 28), (12, 48, 0, 7),
                     (12, 48, 21, 28), (48, 84, 0, 7), (48, 84, 21, 28)]  # fmt: skip
            for top, bottom, a, b in [p for p in parts if rng.random() < 0.75]:
                page[top:bottom, left + a : left + b] = ink
        return _texture(page)
    page[: int(rng.integers(8, 30))] = two
    page[-int(rng.integers(8, 30)) :] = three if rng.random() < 0.5 else two
    x, y, radius = rng.uniform(30, 66), rng.uniform(28, 48), rng.uniform(12, 24)
    logo = np.hypot((column - x) / rng.uniform(1, 1.8), row - y) < radius
    page[logo] = three
    ink = (0.95, 0.95, 0.92) if one.mean() < 0.5 else (0.1, 0.1, 0.12)
    page[int(y) - 4 : int(y) + 4, int(x) - 14 : int(x) + 14] = ink
    _lines(rng, page, 62, 14, 24 if kind != "book" else 14, 68, ink)
    if kind == "box":
        page[[0, 1, -2, -1]], page[:, [0, 1, -2, -1]] = two, two
        for k in range(20):  # a bar code
            page[80:92, 58 + k] = 0.95 if rng.random() < 0.5 else 0.05
    if kind == "book":
        page[:, :4] *= 0.6
    return _texture(page)


@functools.lru_cache(maxsize=32)
def carpet(variant: int) -> np.ndarray:
    """A rug with borders and a figure in the middle."""
    rng = _rng("carpet", variant)
    palette = np.array(
        [(0.45, 0.1, 0.09), (0.13, 0.16, 0.32), (0.76, 0.66, 0.48), (0.3, 0.22, 0.14),
         (0.62, 0.3, 0.16), (0.2, 0.28, 0.2)]
    )[rng.permutation(6)]  # fmt: skip
    half = 64
    quarter = np.digitize(_fractal(rng, 6, half), [-0.7, 0.2, 1.0])
    row, column = np.mgrid[:half, :half]
    middle = np.hypot(half - row, half - column) / half
    quarter = np.where((middle < 0.55) & (middle > 0.48), 4, quarter)
    border = np.minimum(row, column)
    quarter = np.where(border < 16, 4 + (border // 3 + (row + column) // 5) % 2, quarter)
    quarter = np.where((border < 3) | (np.abs(border - 15) < 2), 3, quarter)
    upper = np.concatenate([quarter, quarter[:, ::-1]], axis=1)
    image = palette[np.concatenate([upper, upper[::-1]])]
    return _texture(image * (0.92 + 0.06 * _noise(rng, 0.6, 0.6))[..., None])


@functools.lru_cache(maxsize=64)
def facade(kind: str, variant: int) -> np.ndarray:
    """Four by four windows of a wall: "office", "flats", "glass" or "house"."""
    rng = _rng("facade " + kind, variant)
    wall = np.array(
        [
            (0.78, 0.74, 0.66),
            (0.6, 0.58, 0.55),
            (0.62, 0.36, 0.28),
            (0.86, 0.84, 0.8),
            (0.45, 0.42, 0.4),
        ]
    )[rng.choice(5)]
    page = np.zeros((_SIZE, _SIZE, 3)) + wall
    page *= (1 + 0.03 * _noise(rng, 0.8, 0.8) + 0.03 * _fractal(rng, 20))[..., None]
    if kind in ("flats", "house") and rng.random() < 0.5:
        page *= masonry("brick", variant)[..., :3] / 255
    low, high, left, right = {
        "office": (8, 26, 2, 30),
        "flats": (7, 24, 8, 24),
        "glass": (2, 30, 2, 30),
        "house": (8, 26, 9, 23),
    }[kind]
    for top in range(0, _SIZE, 32):
        for start in range(0, _SIZE, 32):
            pane = np.array(
                [(0.2, 0.27, 0.33), (0.4, 0.5, 0.58), (0.1, 0.12, 0.15), (0.75, 0.7, 0.5)]
            )
            tone = pane[rng.choice(4, p=[0.45, 0.25, 0.25, 0.05])] * rng.uniform(0.8, 1.15)
            page[top + low : top + high, start + left : start + right] = 0.85 * wall + 0.1
            page[top + low + 1 : top + high - 1, start + left + 1 : start + right - 1] = tone
            page[top + low : top + high, start + (left + right) // 2] = 0.8
            if kind == "flats":
                page[top + high : top + high + 3, start + left - 3 : start + right + 3] = 0.4
            if kind == "house":
                page[top + (low + high) // 2, start + left : start + right] = 0.8
    if kind == "office":
        page[::32] = 0.7 * wall
    return _texture(page)


def livery(variant: int, ground: Colour, accent: Colour) -> np.ndarray:
    """Bands, a wave, stripes or lines of text, often with a number, for the sides of a vehicle.

    It is not repeated: it covers a side once.
    """
    rng = _rng("livery", variant)
    page = np.zeros((96, 192, 3)) + np.asarray(ground)
    kind = rng.choice(4)
    row, column = np.mgrid[:96, :192]
    if kind == 0:
        top = int(rng.integers(30, 50))
        page[top : top + int(rng.integers(8, 20))] = accent
        page[top - 4 : top - 2] = accent
    elif kind == 1:
        page[row > 50 + 14 * np.sin(column / 192 * 5 + rng.uniform(0, 6))] = accent
    elif kind == 2:
        page[(row + column // 2) % 70 < 24] = accent
    else:
        page[60:] = accent
        _lines(rng, page, 34, 40, 14, 110, accent)
    if rng.random() < 0.5:
        left = int(rng.integers(20, 130))
        page[30:66, left : left + 36] = label("plate", variant)[4:92:2, 4:92:2, :3][:36, :36] / 255
    return _texture(page)

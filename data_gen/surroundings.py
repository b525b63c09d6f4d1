"""Random surroundings of an object: outdoor scenes, rooms and studios, and the ground under it.

They are in the view-aligned frame, the ground in the plane z = 0. All numbers are **ours**.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from data_gen import lights
from data_gen.cameras import Camera, turn_about_vertical
from data_gen.environment_maps import NUM_SUNSKY, sunsky
from data_gen.lights import LightSettings, Map

GROUNDS = ("paper", "wood", "tiles", "cloth", "concrete", "grass")

TEXELS = 512

_FITTING = {
    "room": ("wood", "wood", "wood", "tiles", "cloth", "cloth"),
    "studio": ("paper", "paper", "paper", "wood", "cloth", "concrete"),
    "outdoors": ("concrete", "concrete", "grass", "tiles", "wood"),
    "map": ("wood", "concrete", "concrete", "tiles", "paper", "grass"),
}


@dataclasses.dataclass(frozen=True, eq=False)
class Surroundings:
    """An environment map (`data_gen.lights`), its kind, and half sides and turn of the ground."""

    radiance: Map
    kind: str = "map"
    half: tuple[float, float] = (200.0, 200.0)
    turn: float = 0.0


@dataclasses.dataclass(frozen=True, eq=False)
class Ground:
    """A strip of ground, turned about the vertical axis by `turn` degrees.

    The texture has linear reflectances and repeats after a length `size`. `profile` has points
    (x, z) of the cross-section from the back to the front.
    """

    texture: Float[np.ndarray, "t t 3"]
    size: float
    gloss: float
    profile: Float[np.ndarray, "n 2"]
    half_width: float
    turn: float


def noise(
    rng: np.random.Generator,
    size: tuple[int, int] = lights.DETAIL,
    slope: float = 1.5,
    stretch: tuple[float, float] = (1, 1),
) -> Float[np.ndarray, "h w"]:
    """Periodic random values with mean 0, standard deviation 1 and spectrum ~ f^-slope.

    `stretch` are vertical and horizontal factors of the size of structures.
    """
    rows = np.fft.fftfreq(size[0])[:, None] * size[0] * stretch[0]
    frequency = np.hypot(rows, np.fft.rfftfreq(size[1]) * size[1] * stretch[1])
    frequency[0, 0] = np.inf
    result = np.fft.irfft2(np.fft.rfft2(rng.standard_normal(size)) * frequency**-slope, s=size)
    return (result / max(float(result.std()), 1e-9)).astype(np.float32)


def _colour(
    rng: np.random.Generator, low: float, high: float, saturation: float
) -> Float[np.ndarray, " 3"]:
    """A random colour with a brightness in [low, high]."""
    colour = 1 + saturation * rng.uniform(-1, 1, 3)
    return np.clip(colour / colour.mean() * rng.uniform(low, high), 0.01, None)


def _with_key_light(rng: np.random.Generator, rest: np.ndarray, key: np.ndarray) -> np.ndarray:
    """The sum of two maps; the second has a random share of the light on the ground.

    Without a strong light, objects would have hardly any shadow.
    """
    up = np.maximum(lights.directions_of(lights.DETAIL)[..., 2:], 0)
    weight = up * lights.solid_angles(lights.DETAIL)[..., None]
    share = rng.uniform(0.4, 0.7)
    own = max(float((key * weight).sum()), 1e-9)
    return rest + key * (share / (1 - share) * (rest * weight).sum() / own)


def _disc(direction: np.ndarray, degrees: float) -> np.ndarray:
    """A map that is 1 within an angle of a direction."""
    toward = lights.directions_of(lights.DETAIL)
    return (toward @ direction > np.cos(np.deg2rad(degrees)))[..., None].astype(float)


def _direction(rng: np.random.Generator, low: float, high: float) -> np.ndarray:
    """A random direction with an elevation between two angles in degrees."""
    return lights.direction(*np.deg2rad([rng.uniform(0, 360), rng.uniform(low, high)]))


def outdoors(rng: np.random.Generator, sky: Map) -> Surroundings:
    """A clear sky with clouds and sun, or an overcast sky, above trees or houses."""
    size = lights.DETAIL
    degrees = np.rad2deg(np.arcsin(lights.directions_of(size)[..., 2:]))
    clear = np.minimum(sky, np.quantile(sky, 0.99))  # without the sun, which is large in the map
    cloud = np.clip(1.1 + 0.25 * noise(rng), 0.3, 2)[..., None]
    overcast = rng.random() < 0.25
    cover = noise(rng, size, 1.7, (2, 1))[..., None] - (-9 if overcast else rng.uniform(0, 2))
    veil = np.clip(degrees / 8, 0, 1) / (1 + np.exp(-3 * cover))
    result = clear / clear[degrees[..., 0] > 0].mean() * (1 - veil) + cloud * veil
    columns = np.arange(size[1])
    for _ in range(int(rng.integers(1, 4))):
        line, shade = noise(rng, (8, size[1]), 0.8)[0], np.array([0.7, 1.0, 0.45])
        if rng.random() < 0.5:  # houses have flat roofs
            block = rng.integers(5, 20)
            line, shade = line[columns // block * block % size[1]], _colour(rng, 1, 2, 0.2)
        texture = np.clip(1 + 0.35 * noise(rng, size, 0.8), 0.2, 2.5)[..., None]
        top = (rng.uniform(1, 7) + rng.uniform(1, 4) * line)[:, None]
        edge, haze = np.clip((top - degrees) / 0.7, 0, 1), rng.uniform(0, 0.4)
        result += edge * (shade * texture * rng.uniform(0.06, 0.3) + haze - result)
    result = np.where(degrees < 0, _colour(rng, 0.15, 0.35, 0.1), result)
    if not overcast:
        sun = _disc(_direction(rng, 22, 70), 1.0)
        result = _with_key_light(rng, result, sun * [1.0, 0.93, 0.8])
    return Surroundings(result, "outdoors")


def studio(rng: np.random.Generator) -> Surroundings:
    """A dim or bright studio with large soft lamps and a smaller lamp."""
    toward = lights.directions_of(lights.DETAIL)
    rest = _colour(rng, 0.08, 0.7, 0.06) * (0.7 + 0.3 * toward[..., 2:])
    for _ in range(int(rng.integers(1, 4))):
        centre = _direction(rng, 5, 60)
        lamp = np.clip((toward @ centre - rng.uniform(0.75, 0.97)) / 0.02, 0, 1)[..., None]
        rest = rest + lamp * _colour(rng, 1, 8, 0.06)
    lamp = _disc(_direction(rng, 30, 65), rng.uniform(3, 8))
    return Surroundings(_with_key_light(rng, rest, lamp * _colour(rng, 1, 1, 0.06)), "studio")


def room(rng: np.random.Generator, eye: Float[np.ndarray, " 3"]) -> Surroundings:
    """A room as seen from a camera: furniture, pictures and windows on its walls, and a lamp."""
    turn = float(rng.uniform(0, 360))
    eye = eye @ turn_about_vertical(turn)
    toward = lights.directions_of(lights.DETAIL) @ turn_about_vertical(turn)
    half = np.maximum(rng.uniform(5, 12, 2), np.abs(eye[:2]) + 1)
    # The object is on the floor or on a table.
    floor = 0.0 if rng.random() < 0.5 and eye[2] > 0.03 else min(-rng.uniform(1.5, 4), eye[2] - 1)
    ceiling = max(rng.uniform(4, 9), eye[2] + 1)
    with np.errstate(divide="ignore"):
        reach = (np.where(toward > 0, [*half, ceiling], [*-half, floor]) - eye) / toward
    axis, point = reach.argmin(-1), eye + toward * reach.min(-1, keepdims=True)
    # 0 to 3: walls; 4: floor; 5: ceiling.
    wall = 2 * axis + (np.take_along_axis(toward, axis[..., None], -1)[..., 0] > 0)
    along, up = np.where(axis == 0, point[..., 1], point[..., 0]), point[..., 2]
    colours = _colour(rng, 0.25, 0.8, 0.12) * rng.uniform(0.7, 1.1, (6, 1))
    colours[rng.integers(5, size=2)] = [_colour(rng, 0.1, 0.6, 0.3), _colour(rng, 0.1, 0.6, 0.1)]
    corner = np.where(axis == 2, 9, np.minimum(up - floor, ceiling - up))  # corners are darker
    shade = (1 - 0.35 * np.exp(-np.maximum(corner, 0) / 0.8))[..., None] * rng.uniform(0.12, 0.5)
    result = colours[wall] * shade

    def paint(colour: np.ndarray, left: float, low: float, right: float, high: float) -> None:
        part = (wall == where) & (along > left) & (along < right) & (up > low) & (up < high)
        result[part] = np.broadcast_to(colour, result.shape)[part]

    for number in range(12):
        where, what = number % 4, rng.random()
        left, low = rng.uniform(-0.9, 0.6) * half[1 - where // 2], floor + rng.uniform(0.8, 2.5)
        right, high = left + rng.uniform(0.6, 3), floor + rng.uniform(2.7, 4)
        frame, inner = _colour(rng, 0.03, 0.8, 0.2) * shade, _colour(rng, 0.1, 0.8, 0.6) * shade
        if what < 0.4:  # furniture
            low = floor
        elif what < 0.7:  # a picture
            inner = inner * np.clip(1 + 0.4 * noise(rng), 0.1, 2)[..., None]
        else:  # a window
            inner = np.array([0.9, 1.0, 1.12]) * rng.uniform(1, 5)
        paint(frame, left, low, right, high)
        paint(inner, left + 0.07, low + 0.07, right - 0.07, high - 0.07)
    lamp = _disc(_direction(rng, 35, 75), rng.uniform(2, 6))
    result = _with_key_light(rng, result, lamp * [1.0, 0.92, 0.8])
    size = half if floor == 0 else rng.uniform(1.3, 3.0, 2)
    return Surroundings(result, "room", (float(size[0]), float(size[1])), turn)


def draw(
    rng: np.random.Generator,
    settings: LightSettings,
    maps: Float[np.ndarray, "m h w 3"] | None,
    camera: Camera,
    *,
    detail: bool,
) -> Surroundings:
    """Draws the surroundings of a view. `detail`: is the map visible in the image?"""

    def measured() -> Surroundings:
        assert maps is not None
        return Surroundings(lights.turned(rng, maps[int(rng.integers(len(maps)))]))

    def sky(size: tuple[int, int]) -> np.ndarray:
        return lights.turned(rng, sunsky(int(rng.integers(NUM_SUNSKY)), size))

    if settings.source == "procedural":
        return Surroundings(lights.turned(rng, lights.procedural_sky(rng)))
    if settings.source == "folder":
        return measured()
    if settings.source == "sunsky":
        return Surroundings(sky(lights.DETAIL if detail else lights.MAP_SIZE))
    what = rng.random()
    if maps is not None and rng.random() < 0.4:
        return measured()
    if what < 0.4:
        return room(rng, camera.position)
    return studio(rng) if what < 0.6 else outdoors(rng, sky(lights.DETAIL))


def texture_of(kind: str, rng: np.random.Generator) -> Float[np.ndarray, "t t 3"]:
    """A periodic texture of linear reflectances for a kind of ground."""
    size = (TEXELS, TEXELS)
    y, x = np.mgrid[:TEXELS, :TEXELS]
    cloudy, fine = noise(rng, size, 1.4), noise(rng, size, 0.5)
    colour = _colour(rng, 0.08, 0.65, 0.3) * [1.08, 1.0, 0.9]  # more often warm than cold
    shade = 1 + 0.08 * cloudy
    if kind == "paper":
        shade = 1 + 0.01 * cloudy
    elif kind == "wood":
        wood = np.array([[0.46, 0.28, 0.14], [0.3, 0.16, 0.08], [0.6, 0.44, 0.27], [0.4, 0.3, 0.2]])
        colour = rng.choice(wood) * rng.uniform(0.7, 1.3)
        rings = np.sin(rng.uniform(4, 12) * noise(rng, size, 1.8, (1, 14)))
        shade = 1 + 0.12 * rings + 0.11 * noise(rng, size, 0.5, (1, 40))
    elif kind == "cloth":
        threads = 2 * np.pi * 2.0 ** rng.integers(5, 7) / TEXELS
        stripes = np.sin(rng.integers(4, 16) * 2 * np.pi / TEXELS * x)
        shade += 0.08 * np.sin(x * threads) * np.sin(y * threads) + 0.05 * fine
        shade *= 1 + rng.choice([0, 0.3]) * np.clip(3 * stripes, -1, 1)
    elif kind == "concrete":
        colour = np.array([1.0, 0.98, 0.94]) * rng.uniform(0.06, 0.5)
        shade += 0.06 * noise(rng, size, 0.8) + rng.uniform(0.05, 0.25) * fine
    elif kind == "grass":
        dry = np.clip(0.5 * cloudy + rng.uniform(-0.6, 0.4), 0, 0.7)[..., None]
        colour = np.array([0.12, 0.16, 0.055]) * (1 - dry) + np.array([0.2, 0.18, 0.1]) * dry
        shade = (1 + 0.3 * noise(rng, size, 0.5, (1, 3)) + 0.3 * fine) * rng.uniform(0.6, 1.3)
    if kind == "tiles" or (kind == "wood" and rng.random() < 0.7):  # tiles or boards
        rows = columns = int(rng.integers(3, 9))
        if kind == "wood":
            rows, columns = rows + 2, 1
        high, wide = TEXELS / rows, TEXELS / columns
        row = (y / high).astype(int)
        x = (x + rng.integers(0, TEXELS, rows)[row] * (kind == "wood")) % TEXELS
        number = row * columns + (x / wide).astype(int)
        if kind == "wood":  # each board is another piece of wood
            shade = shade[(y + 97 * row) % TEXELS, x]
        shade = shade * rng.uniform(0.85, 1.15, rows * columns)[number]
        edge = np.minimum((y % high).clip(max=high / 2), x % wide)
        shade = shade * np.clip(edge / rng.uniform(1.5, 4), rng.uniform(0.4, 0.8), 1)
    return np.clip(colour * shade[..., None], 0.01, 0.85).astype(np.float32)


def draw_ground(rng: np.random.Generator, kind: str, around: Surroundings) -> Ground:
    """Draws a ground of a kind in `GROUNDS`, or "random": of a kind that fits the surroundings.

    The floor of a room ends at the walls, a table at its edges. Behind the object, paper curves
    upward, as in product photographs.
    """
    if kind == "random":
        kind = str(rng.choice(_FITTING[around.kind]))
    long, wide = around.half
    profile, turn = np.array([[-long, 0.0], [long, 0.0]]), around.turn
    if kind == "paper":
        back, radius = -rng.uniform(1.5, 4), rng.uniform(0.8, 2.5)
        angle = np.linspace(np.pi / 2, 0, 17)[:, None]
        bend = [back, radius] - radius * np.concatenate([np.sin(angle), np.cos(angle)], axis=1)
        profile = np.concatenate([[[bend[0, 0], 60.0]], bend, [[60.0, 0.0]]])
        wide, turn = 60.0, 0.0
    gloss = rng.choice([0.0, 0.3, 0.6]) if kind in ("wood", "tiles") else 0.0
    size = float(rng.uniform(1.5, 4.0))
    return Ground(texture_of(kind, rng), size, float(gloss), profile, wide, turn)

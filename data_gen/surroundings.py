"""Random surroundings of an object: skies, rooms, studios and measured environment maps.

Each view gets its own environment map, large enough to be the background of the image. Maps are in
the view-aligned frame with the object at the origin.
"""

import dataclasses

import numpy as np
import scipy.ndimage
from jaxtyping import Float

from data_gen import lights
from data_gen.cameras import turn_about_vertical
from data_gen.environment_maps import NUM_SUNSKY
from data_gen.lights import Lights, LightSettings

Array = np.ndarray


@dataclasses.dataclass(frozen=True)
class Room:
    """A box-shaped room.

    It assigns a position on its walls to each direction of an environment map.

    Attributes:
      half: half of its length and width, in units of the frame.
      floor: height of the floor, 0 or less.
      ceiling: height of the ceiling.
      turn: rotation about the vertical axis, degrees.
    """

    half: tuple[float, float]
    floor: float
    ceiling: float
    turn: float


@dataclasses.dataclass(frozen=True, eq=False)
class Surroundings:
    """An environment map and its kind.

    Attributes:
      radiance: float [H, W, 3], in the view-aligned frame, see `data_gen.lights`.
      kind: "outdoors", "room", "studio", or "map" if that is unknown.
      room: the room that the map shows; None = everything in the map is far away.
    """

    radiance: Float[np.ndarray, "h w 3"]
    kind: str = "map"
    room: Room | None = None


def noise(
    rng: np.random.Generator,
    size: tuple[int, int],
    *,
    slope: float = 1.5,
    stretch: tuple[float, float] = (1.0, 1.0),
) -> Float[np.ndarray, "h w"]:
    """Periodic random values with mean 0, standard deviation 1 and spectrum ~ f^-slope.

    `stretch` are factors by which structures are stretched vertically and horizontally.
    """
    rows = np.fft.fftfreq(size[0])[:, None] * size[0] * stretch[0]
    columns = np.fft.rfftfreq(size[1])[None] * size[1] * stretch[1]
    frequency = np.hypot(rows, columns)
    frequency[0, 0] = np.inf
    white = np.fft.rfft2(rng.standard_normal(size))
    result = np.fft.irfft2(white * frequency**-slope, s=size)
    return (result / max(float(result.std()), 1e-9)).astype(np.float32)


def _direction(azimuth_degrees: float, elevation_degrees: float) -> Array:
    around, up = np.deg2rad(azimuth_degrees), np.deg2rad(elevation_degrees)
    return np.array([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up)])


def _colour(rng: np.random.Generator, low: float, high: float, saturation: float) -> Array:
    """A random colour with a brightness in [low, high]."""
    colour = 1 + saturation * rng.uniform(-1, 1, 3)
    return colour / colour.mean() * rng.uniform(low, high)


def outdoors(
    rng: np.random.Generator, sky: Float[np.ndarray, "h w 3"] | None = None
) -> Surroundings:
    """A sky with clouds and perhaps a sun, above a skyline of trees, hills or houses.

    `sky` is a clear sky with its sun; None = a random one.
    """
    size = lights.DETAIL
    toward = lights.directions_of(size)
    height = toward[..., 2]
    degrees = np.rad2deg(np.arcsin(height))
    clear = float(rng.random())  # 0 = overcast
    if sky is None:
        zenith = np.array([0.25, 0.45, 0.95]) * clear + np.array([0.75, 0.8, 0.85]) * (1 - clear)
        horizon = np.array([0.85, 0.95, 1.05]) * rng.uniform(0.8, 1.2)
        up = (np.clip(height, 0, 1) ** rng.uniform(0.35, 0.6))[..., None]
        result = horizon * (1 - up) + zenith * up
        sun = _direction(rng.uniform(0, 360), rng.uniform(22, 70))
        cosine = toward @ sun
        warm = np.array([1.0, 0.93, 0.8]) * rng.uniform(0.9, 1.1, 3)
        for width, share in ((2.0, 0.85), (14.0, 0.15)):
            sharp = 1 / (1 - np.cos(np.deg2rad(width)))
            lobe = np.exp(sharp * (cosine - 1)) * sharp / (2 * np.pi)
            # The irradiance from the sky is about pi, that from the sun up to four times as much.
            result = result + lobe[..., None] * warm * (16 * clear * share)
    else:
        result = scipy.ndimage.zoom(
            sky, (size[0] / sky.shape[0], size[1] / sky.shape[1], 1), order=1, mode="grid-wrap",
            grid_mode=True,
        )  # fmt: skip
        result = result / max(float(result[height > 0].mean()), 1e-9)
    cover = 1 / (
        1 + np.exp(-3 * (noise(rng, size, slope=1.7, stretch=(2, 1)) - rng.uniform(-1, 2)))
    )
    cloud = np.clip(1.1 + 0.25 * noise(rng, size, slope=1.6), 0.3, 2)[..., None]
    veil = (cover * np.clip(degrees / 8, 0, 1))[..., None] * 0.9
    bright = result.mean(axis=-1, keepdims=True) > 4
    result = np.where(bright, result * (1 - 0.4 * veil), result * (1 - veil) + veil * cloud)
    # The skyline: distant hills, then trees or houses in front of them.
    columns = np.arange(size[1])
    for layer in range(int(rng.integers(1, 4))):
        line = noise(rng, (8, size[1]), slope=1.2)[0]
        rough = rng.uniform(1, 4)
        if rng.random() < 0.5:  # houses have flat roofs
            block = rng.integers(5, 20)
            line = line[(columns // block) * block % size[1]]
            shade = _colour(rng, 0.15, 0.6, 0.2)
            rough *= 1.5
        else:
            line = line + 0.4 * noise(rng, (8, size[1]), slope=0.3)[0]
            shade = np.array([0.7, 1.0, 0.45]) * rng.uniform(0.06, 0.3)
        top = rng.uniform(1, 7) / (1 + layer * 0.3) + rough * line
        texture = np.clip(1 + 0.35 * noise(rng, size, slope=rng.uniform(0.5, 1.1)), 0.2, 2.5)
        edge = np.clip((top - degrees) / 0.7, 0, 1)[..., None]
        haze = rng.uniform(0, 0.4)
        result = result * (1 - edge) + edge * (shade * texture[..., None] * (1 - haze) + 0.8 * haze)
    ground = np.array([1.0, 0.97, 0.9]) * rng.uniform(0.1, 0.35)
    floor = np.clip(1 + 0.2 * noise(rng, size, slope=1.0, stretch=(3, 1)), 0.3, 2)[..., None]
    result = np.where(height[..., None] < 0, ground * floor, result)
    return Surroundings(result.astype(np.float32), "outdoors")


def room(rng: np.random.Generator) -> Surroundings:
    """A room with windows, lamps, doors, pictures and furniture along its walls."""
    size = lights.DETAIL
    half = (float(rng.uniform(5, 12)), float(rng.uniform(5, 12)))
    floor = 0.0 if rng.random() < 0.5 else -float(rng.uniform(1.5, 4.0))
    ceiling = float(rng.uniform(4, 9))
    turn = float(rng.uniform(0, 360))
    toward = lights.directions_of(size) @ turn_about_vertical(turn)
    limits = np.where(toward > 0, [*half, ceiling], [-half[0], -half[1], min(floor, -1e-3)])
    with np.errstate(divide="ignore"):
        reach = limits / toward
    face = reach.argmin(axis=-1)
    place = toward * reach.min(axis=-1)[..., None]
    # 0 to 3: walls; 4: ceiling; 5: floor.
    positive = np.take_along_axis(toward, face[..., None], -1)[..., 0] > 0
    wall = 2 * face + np.where(face == 2, ~positive, positive)
    along = np.where(face == 0, place[..., 1], place[..., 0])
    up = np.where(face == 2, place[..., 1], place[..., 2])
    paint = _colour(rng, 0.25, 0.8, 0.12)
    colours = np.stack([paint * rng.uniform(0.6, 1.1) for _ in range(4)])
    if rng.random() < 0.4:  # one wall with a different colour
        colours[int(rng.integers(4))] = _colour(rng, 0.1, 0.6, 0.5)
    tops = np.stack([np.full(3, rng.uniform(0.6, 0.9)), _colour(rng, 0.1, 0.5, 0.3)])
    result = np.concatenate([colours, tops])[wall]
    # Corners are darker than the middle of a wall.
    near = np.minimum(np.where(face == 2, 9, np.minimum(up - floor, ceiling - up)),
                      np.where(face == 0, half[1], half[0]) - np.abs(along))  # fmt: skip
    result = result * (1 - 0.35 * np.exp(-np.maximum(near, 0) / 0.8))[..., None]
    result *= np.clip(1 + 0.06 * noise(rng, size, slope=1.2), 0.7, 1.3)[..., None]
    level = rng.uniform(0.12, 0.5)
    result *= level

    def rectangle(where: int, left: float, right: float, low: float, high: float) -> Array:
        return (wall == where) & (along > left) & (along < right) & (up > low) & (up < high)

    for where in range(4):
        breadth = half[1] if where < 2 else half[0]
        for _ in range(int(rng.integers(1, 5))):
            left = rng.uniform(-breadth, breadth * 0.7)
            what = rng.random()
            if what < 0.45:  # furniture on the floor
                part = rectangle(where, left, left + rng.uniform(0.8, 3.5), floor,
                                 floor + rng.uniform(0.7, 3.5))  # fmt: skip
                shade = _colour(rng, 0.05, 0.6, 0.4)
                lines = 1 - 0.4 * (np.sin(up * rng.uniform(3, 12)) > 0.93)
                result[part] = (shade * level * lines[..., None])[part]
            elif what < 0.8:  # a picture, with a frame
                low = floor + rng.uniform(1.5, 3.0)
                right, high = left + rng.uniform(0.5, 2), low + rng.uniform(0.5, 1.5)
                result[rectangle(where, left, right, low, high)] = (
                    _colour(rng, 0.03, 0.8, 0.2) * level
                )
                inner = rectangle(where, left + 0.1, right - 0.1, low + 0.1, high - 0.1)
                blotch = 0.5 + 0.3 * noise(rng, (64, 128), slope=1.5).repeat(4, 0).repeat(4, 1)
                blotch = np.clip(blotch, 0.1, 1.5)[..., None]
                result[inner] = (_colour(rng, 0.2, 0.8, 0.6) * level * blotch)[inner]
            else:  # a door
                result[rectangle(where, left, left + 1.8, floor, floor + 3.8)] = (
                    _colour(rng, 0.15, 0.8, 0.2) * level
                )
    day = rng.random() < 0.75
    windows = []
    for where in rng.choice(4, int(rng.integers(1, 3)), replace=False) if day else ():
        breadth = half[1] if where < 2 else half[0]
        strength, wide = rng.uniform(4, 14), rng.uniform(1.0, 2.5)
        low, high = floor + rng.uniform(0.8, 1.6), ceiling - rng.uniform(0.4, 1.5)
        view = np.clip(3 * np.clip((up - low) / (high - low), 0, 1) - 0.8, 0, 1)[..., None]
        outside = np.array([0.9, 1.0, 1.12]) * strength * (0.35 + 0.65 * view)
        for left in np.arange(-breadth + 0.7, breadth - wide, wide + rng.uniform(0.5, 3.0)):
            part = rectangle(int(where), left, left + wide, low, high)
            part &= np.abs(along - left - wide / 2) > 0.06
            part &= np.abs(up - (low + high) / 2) > 0.06
            result[part] = outside[part]
            windows.append(part)
    for number in range(int(rng.integers(1, 5)) if day else int(rng.integers(1, 6))):
        x, y = rng.uniform(-0.8, 0.8, 2) * half
        radius = rng.uniform(0.3, 1.0)
        if number == 0:  # at the side of the object, and small, so that the shadow is distinct
            x, y = _direction(rng.uniform(0, 360), 0)[:2] * ceiling * rng.uniform(0.6, 1.3)
            x, y = np.clip([x, y], -0.9 * np.array(half), 0.9 * np.array(half))
            radius = ceiling * rng.uniform(0.03, 0.08)
        warm = np.array([1.0, 0.88, 0.68]) ** rng.uniform(0.2, 1.3)
        lamp = (wall == 4) & (np.hypot(place[..., 0] - x, place[..., 1] - y) < radius)
        result[lamp] = warm * rng.uniform(10, 40)
        if number == 0:
            key = lamp
    if windows and rng.random() < 0.25:
        key = windows[int(rng.integers(len(windows)))]
    result = _with_key_light(rng, result * ~key[..., None], result * key[..., None])
    return Surroundings(result.astype(np.float32), "room", Room(half, floor, ceiling, turn))


def _with_key_light(rng: np.random.Generator, rest: Array, key: Array) -> Array:
    """The sum of two maps, the second scaled to a random share of the light on the ground.

    Without one light that is stronger than the others, objects have hardly any shadow.
    """
    up = np.maximum(lights.directions_of(lights.DETAIL)[..., 2:], 0)
    weight = up * lights.solid_angles(lights.DETAIL)[..., None]
    share = rng.uniform(0.4, 0.7)
    strength = share / (1 - share) * (rest * weight).sum() / max((key * weight).sum(), 1e-9)
    return rest + strength * key


def studio(rng: np.random.Generator) -> Surroundings:
    """A dim or bright studio with large soft lamps and one smaller one."""
    toward = lights.directions_of(lights.DETAIL)
    base = _colour(rng, 0.08, 0.7, 0.06)
    result = base * (0.7 + 0.3 * toward[..., 2:3])
    lamps = []
    for number in range(int(rng.integers(2, 5))):
        elevation = rng.uniform(30, 65) if number == 0 else rng.uniform(5, 60)
        centre = _direction(rng.uniform(0, 360), elevation)
        side = np.cross([0, 0, 1.0], centre)
        side /= np.linalg.norm(side)
        away = np.maximum(toward @ centre, 1e-3)
        wide, high = rng.uniform(0.03, 0.12, 2) if number == 0 else rng.uniform(0.2, 0.7, 2)
        x = (toward @ side) / away / wide
        y = (toward @ np.cross(centre, side)) / away / high
        box = np.exp(-(np.abs(x) ** 8) - np.abs(y) ** 8) * (toward @ centre > 0.05)
        power = rng.uniform(0.8, 4) / (wide * high * 4)
        lamps.append(box[..., None] * _colour(rng, 1, 1, 0.06) * power)
    result = _with_key_light(rng, result + sum(lamps[1:]), lamps[0])
    return Surroundings(result.astype(np.float32), "studio")


def draw(
    rng: np.random.Generator,
    settings: LightSettings,
    maps: Float[np.ndarray, "m h w 3"] | None,
) -> tuple[Lights, Surroundings]:
    """Draws the light of a view: surroundings, and directional lights that approximate them.

    `maps` are the environment maps to choose from; None = procedural ones.
    """
    if settings.source != "mixed":
        if maps is None:
            radiance = lights.procedural_sky(rng)
        else:
            radiance = np.asarray(maps[int(rng.integers(len(maps)))], np.float64)
        chosen = Surroundings(_turned(radiance, rng))
    else:
        chosen = _mixed(rng, maps)
    ambient = float(rng.uniform(*settings.ambient))
    exposure = float(rng.uniform(*settings.exposure))
    small = chosen.radiance
    if small.shape[:2] != lights.MAP_SIZE:
        small = lights.shrink(small)
    return lights.reduce(small, settings, ambient=ambient, exposure=exposure), chosen


def _turned(radiance: Array, rng: np.random.Generator) -> Array:
    """The map, rotated about the vertical axis by a random angle."""
    return np.roll(radiance, round(float(rng.random()) * radiance.shape[1]), axis=1)


def _mixed(rng: np.random.Generator, maps: Array | None) -> Surroundings:
    """One of the maps of a folder, a room, a studio, or an outdoor scene."""
    what = float(rng.random())
    skies = () if maps is None else maps[:NUM_SUNSKY]
    measured = () if maps is None else maps[NUM_SUNSKY:]
    if len(measured) and what < 0.4:
        chosen = Surroundings(np.asarray(measured[int(rng.integers(len(measured)))], np.float32))
    else:
        what = float(rng.random())
        if what < 0.45:
            chosen = room(rng)
        elif what < 0.65:
            chosen = studio(rng)
        else:
            clear = len(skies) and rng.random() < 0.5
            chosen = outdoors(rng, skies[int(rng.integers(len(skies)))] if clear else None)
    radiance = chosen.radiance
    if chosen.room is None:
        radiance = _turned(radiance, rng)
    tint = 1 + rng.uniform(-0.05, 0.05, 3)
    return dataclasses.replace(chosen, radiance=(radiance * tint).astype(np.float32))

"""Environment maps, and directional lights that approximate them.

For local shading, `reduce` computes directional lights and ambient light from a map. Path tracing
uses the map.
"""

import dataclasses
import functools
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float

from data_gen.cameras import Range
from psgn_jax.config.structured import Bounds, Fraction, Within

Map = Float[np.ndarray, "h w 3"]
"""An environment map, radiance: the first row is the zenith, the last row the nadir, and the
columns go around the horizon."""

MAP_SIZE = (32, 64)
"""Size of maps for `reduce`."""

DETAIL = (256, 512)
"""Size of maps that are the background of images."""


@dataclasses.dataclass(frozen=True)
class LightSettings:
    """The light: its source and its strength.

    Attributes:
      source: "procedural" skies, Mitsuba's "sunsky", a "folder", or "mixed": for each view an
        outdoor scene, a room, a studio or, if `folder` is given, one of its maps.
      folder: folder of .hdr and .exr files, for "folder" and "mixed". The content of the files
        counts, not the path.
      count: number of directional lights.
      ambient: range of the ambient fraction of the light. Without ambient light, surfaces that face
        away from the lights would be black.
      exposure: range of the brightness of a white surface that faces the light; above 1, the image
        saturates.
      saturation: saturation of the lights' colours, 0 to 1. The authors' light is nearly white.
      specular: factor of the materials' highlights.
      darkest: lower bound of diffuse colours, so that no object is completely black.
    """

    source: Literal["procedural", "sunsky", "folder", "mixed"] = "procedural"
    folder: str = ""
    count: Annotated[int, Bounds(1, 32)] = 5
    ambient: Annotated[Range, Within(0, 1)] = (0.2, 0.42)
    exposure: Annotated[Range, Within(0.01, 10)] = (0.9, 1.5)
    saturation: Fraction = 0.25
    specular: Annotated[float, Bounds(0, 10)] = 0.6
    darkest: Fraction = 0.03


@dataclasses.dataclass(frozen=True, eq=False)
class Lights:
    """Directional lights and ambient light. Under light of strength 1, white surfaces are white.

    `directions` point to the lights in the view-aligned frame. `sky` and `ground` are the ambient
    light on surfaces that face up and down.
    """

    directions: Float[np.ndarray, "k 3"]
    colours: Float[np.ndarray, "k 3"]
    sky: Float[np.ndarray, " 3"]
    ground: Float[np.ndarray, " 3"]
    specular: float
    darkest: float


def directions_of(size: tuple[int, int]) -> Float[np.ndarray, "h w 3"]:
    """Unit vectors toward the centres of a map's pixels, +z at the first row."""
    height, width = size
    polar = (np.arange(height) + 0.5) / height * np.pi
    around = (np.arange(width) + 0.5) / width * 2 * np.pi
    level, height_of = np.sin(polar)[:, None], np.broadcast_to(np.cos(polar)[:, None], size)
    return np.stack([level * np.cos(around), level * np.sin(around), height_of], axis=-1)


def direction(azimuth: float, elevation: float) -> Float[np.ndarray, " 3"]:
    """The unit vector with these angles [rad]."""
    level = np.cos(elevation)
    return np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])


def solid_angles(size: tuple[int, int]) -> Float[np.ndarray, "h w"]:
    """Solid angles of the pixels of a map; their sum is 4 pi."""
    edges = np.cos(np.linspace(0, np.pi, size[0] + 1))
    return np.repeat(-np.diff(edges)[:, None], size[1], axis=1) * 2 * np.pi / size[1]


def shrink(radiance: np.ndarray, size: tuple[int, int] = MAP_SIZE) -> Map:
    """A smaller map of mean values; values that are negative or not finite count as 0."""
    full = np.asarray(radiance, np.float64)[..., :3]
    full = np.clip(np.nan_to_num(full, nan=0.0, posinf=1e6, neginf=0.0), 0, 1e6)
    for axis, wanted in enumerate(size):
        have = full.shape[axis]
        if have < wanted:
            full = np.repeat(full, -(-wanted // have), axis=axis)
            have = full.shape[axis]
        cuts = np.linspace(0, have, wanted + 1).round().astype(int)
        counts = np.diff(cuts).reshape((-1,) + (1,) * (2 - axis))
        full = np.add.reduceat(full, cuts[:-1], axis=axis) / counts
    return full


def turned(rng: np.random.Generator, radiance: Map) -> Map:
    """A map, rotated by a random angle."""
    radiance = np.asarray(radiance, np.float64)
    return np.roll(radiance, round(float(rng.random()) * radiance.shape[1]), axis=1)


def procedural_sky(rng: np.random.Generator) -> Map:
    """A random map: a sky that is brighter near the horizon, ground, sun and windows."""
    toward = directions_of(MAP_SIZE)
    height = toward[..., 2]
    zenith = np.array([0.75, 0.85, 1.0]) * rng.uniform(0.3, 1.0)
    horizon = np.array([1.0, 0.97, 0.92]) * rng.uniform(0.4, 1.2)
    ground = np.array([1.0, 0.95, 0.88]) * rng.uniform(0.1, 0.6)
    up = np.clip(height, 0, 1)[..., None] ** rng.uniform(0.4, 1.0)
    result = np.where(height[..., None] > 0, horizon * (1 - up) + zenith * up, ground)
    for number in range(int(rng.integers(2, 5))):
        # The first spot is the sun or a lamp above, the others are windows and bright walls.
        low, high = (35, 75) if number == 0 else (-5, 60)
        elevation, azimuth = np.deg2rad(rng.uniform(low, high)), rng.uniform(0, 2 * np.pi)
        warmth = rng.uniform(-0.12, 0.12)
        colour = np.array([1 + warmth, 1.0, 1 - warmth])
        width = rng.uniform(8, 20) if number == 0 else rng.uniform(12, 35)
        power = rng.uniform(1.5, 3.0) if number == 0 else rng.uniform(0.5, 1.6)
        cap = 1 - np.cos(np.deg2rad(width))
        spot = np.exp(1 / cap * (toward @ direction(azimuth, elevation) - 1))[..., None]
        result = result + spot * colour * power / (2 * np.pi * cap)
    return result


@functools.cache
def _neighbours() -> Float[np.ndarray, "n n"]:
    """1 for pairs of pixels of a small map within 35 degrees of each other, else 0."""
    toward = directions_of(MAP_SIZE).reshape(-1, 3)
    return (toward @ toward.T > np.cos(np.deg2rad(35.0))).astype(np.float32)


def reduce(radiance: Map, settings: LightSettings, ambient: float, exposure: float) -> Lights:
    """Directional lights and ambient light that approximate a map of size `MAP_SIZE`.

    We choose the brightest direction, which collects the light within 35 degrees, then the
    brightest direction of the rest, and so on. Ambient light has the mean colour of the map's upper
    half on surfaces that face up, and of both halves on surfaces that face down. A white surface in
    the brightest orientation visible from above or from the front has the brightness `exposure`,
    with a fraction `ambient` from ambient light.
    """
    toward = directions_of(MAP_SIZE).reshape(-1, 3)
    energy = (radiance * solid_angles(MAP_SIZE)[..., None]).reshape(-1, 3)
    # The light that each direction would collect. Light from below is rare and counts 0.3 times.
    weight = np.where(toward[:, 2] < 0, 0.3, 1.0)
    left = energy * weight[:, None]
    close = _neighbours()
    directions, colours = [], []
    for _ in range(settings.count):
        gathered = close @ left.sum(axis=1).astype(np.float32)
        at = close[int(gathered.argmax())] > 0
        light = left[at].sum(axis=0)
        if light.sum() <= 0:
            break
        mean = (left[at].sum(axis=1)[:, None] * toward[at]).sum(axis=0)
        directions.append(mean / np.linalg.norm(mean))
        colours.append(light)
        left = np.where(at[:, None], 0.0, left)
    if not directions:  # a black map
        directions, colours = [np.array([0.6, 0.0, 0.8])], [np.ones(3)]
    lamp, colour = np.array(directions), np.array(colours)
    sky = energy[toward[:, 2] > 0].sum(axis=0) + 1e-9
    floor = energy[toward[:, 2] <= 0].sum(axis=0) + 1e-9

    def plain(value: np.ndarray) -> np.ndarray:
        grey = value.mean(axis=-1, keepdims=True)
        return grey + settings.saturation * (value - grey)

    # Visible orientations: up, and on the camera's side of the object.
    seen = toward[(toward[:, 0] > -0.2) & (toward[:, 2] > -0.3)]
    strongest = (np.clip(seen @ lamp.T, 0, None) @ colour.mean(axis=1)).max()
    colour = plain(colour) * exposure * (1 - ambient) / max(strongest, 1e-9)
    sky_colour = plain(sky / sky.mean()) * exposure * ambient
    # Light from the ground is reflected light from the sky.
    ground_colour = 0.7 * plain((floor / floor.mean() + sky / sky.mean()) / 2) * exposure * ambient
    arrays = (lamp, colour, sky_colour, ground_colour)
    lamp, colour, above, below = (a.astype(np.float32) for a in arrays)
    return Lights(lamp, colour, above, below, settings.specular, settings.darkest)


def draw(rng: np.random.Generator, settings: LightSettings, radiance: Map) -> Lights:
    """Draws the ambient fraction and the exposure, and reduces a map to lights."""
    ambient, exposure = (float(rng.uniform(*r)) for r in (settings.ambient, settings.exposure))
    small = radiance if radiance.shape[:2] == MAP_SIZE else shrink(radiance)
    return reduce(small, settings, ambient, exposure)

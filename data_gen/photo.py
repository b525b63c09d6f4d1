"""Images that look like photographs: soft shadows, environment light, reflections, camera response.

Everything is computed with numpy, except for the intersection of rays with the mesh. All colours
are linear until `develop`, and all positions are in the view-aligned frame.

The irradiance of each pixel is estimated with a few rays of two kinds: toward bright parts of the
environment map, and distributed by the cosine of the angle to the normal. They are combined by the
balance heuristic (Veach 1997). Each of the 16 pixels in a block of 4 x 4 uses a different set of
rays, and an edge-preserving filter averages over such blocks, as if there were sixteen times as
many rays. Unoccluded surfaces have no noise. The light that a face of the model reflects onto other
faces is estimated once, from its colour and its irradiance.
"""

import dataclasses
import functools
from collections.abc import Callable

import numpy as np
import scipy.ndimage
from jaxtyping import Bool, Float, Int, UInt8

from data_gen import lights, shading
from data_gen.cameras import Camera, turn_about_vertical
from data_gen.grounds import Ground
from data_gen.mesh import row_dots
from data_gen.picture import Mesh, Picture, follow_rays, sample_rays, window_of
from data_gen.scene import BACKGROUND, RayHits, Scene, Surfaces
from data_gen.settings import FilmSettings, ImageSettings
from data_gen.surroundings import Surroundings

PATTERNS = 16
"""Number of different sets of rays; neighbouring pixels use different sets."""

_LIGHT_SIZE = (64, 128)

# Rows and columns of the table of irradiance by normal.
_TABLE = (17, 32)

# The start of a ray is moved off the surface by this distance along the normal, and by the same
# distance along the ray. Otherwise coarse meshes with smooth normals would shadow themselves.
_OFF = 0.002

# First estimate of the irradiance of the model's faces, as a fraction of the unoccluded irradiance.
# The light that faces reflect onto each other is computed from it.
_SEEN_BY_OTHERS = 0.5

# Faces that share their irradiance lie in the same cubic cell. This is the number of cells along
# one unit of the frame.
_CELLS = 10

# Largest number of surfaces that light passes through (holes and glass).
_LAYERS = 4

# Blur of the maps for reflections: standard deviation in radians.
_BLURS = (0.0, 0.1, 0.25, 0.5)

# Values above this multiple of white are clipped before the lens blur is applied.
_BRIGHTEST = 6.0

_UP = np.array([[0, 0, 1]], np.float32)


def develop(
    light: Float[np.ndarray, "h w 3"],
    weight: Float[np.ndarray, "h w"],
    settings: FilmSettings,
    rng: np.random.Generator,
    *,
    illuminant: Float[np.ndarray, " 3"],
) -> UInt8[np.ndarray, "h w 3"]:
    """The image that a camera records of linear radiance.

    `weight` are the weights of the pixels in the measurement of the exposure, `illuminant` is the
    colour of the light.
    """
    height, width = weight.shape
    draw = {
        f.name: float(rng.uniform(*getattr(settings, f.name))) for f in dataclasses.fields(settings)
    }
    shift = 1 + 0.02 * rng.standard_normal(3)
    balance = (illuminant.mean() / np.maximum(illuminant, 1e-6)) ** draw["white_balance"] * shift
    values = light * balance.astype(np.float32)
    grey = values.mean(axis=-1)
    middle = np.exp((np.log(grey + 1e-4 * grey.max() + 1e-9) * weight).sum() / weight.sum())
    gain = 0.2 * 2 ** draw["exposure"] / middle
    # Bright parts may be white, but not a large fraction of the image.
    bright = max(float(np.quantile(grey, 0.93)), 1e-9)
    gain = min(gain, 0.75 * 2 ** max(draw["exposure"], 0) / bright)
    values = np.clip(values * np.float32(gain), 0, _BRIGHTEST)
    rows, columns = np.mgrid[:height, :width]
    away = np.hypot(rows / height - 0.5, columns / width - 0.5)[..., None]
    values = values * (1 - draw["vignette"] * 2 * away**2).astype(np.float32)
    values = scipy.ndimage.gaussian_filter(values, (draw["blur"], draw["blur"], 0))
    # Shot noise grows with the square root of the light; read noise is constant.
    spread = draw["grain"] * np.sqrt(0.05 + values / 0.2).astype(np.float32) * 0.4
    values = np.maximum(values + spread * rng.standard_normal(values.shape, np.float32), 0)
    # A linear curve with a soft shoulder, and a film curve (Narkowicz 2015).
    plain = np.where(values < 0.6, values, 1 - 0.4 * np.exp(-(values - 0.6) / 0.4))
    x = values * np.float32(0.75)
    film = x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)
    mixed = plain + draw["contrast"] * (film - plain)
    grey = mixed.mean(axis=-1, keepdims=True)
    mixed = grey + np.float32(draw["saturation"]) * (mixed - grey)
    return np.rint(255 * np.clip(mixed, 0, 1) ** (1 / 2.2)).astype(np.uint8)


def smooth(
    values: Float[np.ndarray, "h w 3"],
    valid: Bool[np.ndarray, "h w"],
    guides: Float[np.ndarray, "h w 7"] | None = None,
    *,
    step: int = 1,
) -> Float[np.ndarray, "h w 3"]:
    """Weighted means over 5 x 5 pixels of the same surface (weights 1/2, 1, 1, 1, 1/2 per axis).

    The pixels are `step` apart. `guides` are for each pixel its normal n, its position p and a
    tolerance: another pixel is on the same surface if its normal is similar and its distance from
    the plane through p perpendicular to n is less than `step` times the tolerance.
    """
    for axis in (0, 1):
        size = valid.shape[axis]
        total, weight = np.zeros_like(values), np.zeros((*valid.shape, 1), np.float32)
        for offset, share in zip((-2, -1, 0, 1, 2), (0.5, 1, 1, 1, 0.5), strict=True):
            here, there = [slice(None)] * 2, [slice(None)] * 2
            move = offset * step
            here[axis] = slice(max(0, -move), min(size, size - move))
            there[axis] = slice(max(0, move), min(size, size + move))
            at, source = tuple(here), tuple(there)
            part = share * (valid[at] & valid[source]).astype(np.float32)
            if guides is not None and offset:
                mine, its = guides[at], guides[source]
                normal = mine[..., :3]
                same = np.einsum("hwd,hwd->hw", normal, its[..., :3])
                off = np.abs(np.einsum("hwd,hwd->hw", normal, mine[..., 3:6] - its[..., 3:6]))
                part = part * np.clip(10 * same - 8.5, 0, 1) * (off < mine[..., 6] * step)
            total[at] += part[..., None] * values[source]
            weight[at] += part[..., None]
        values = total / np.maximum(weight, 1e-6)
    return values


def linear(display: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Linear reflectances of display colours, bounded away from black and white."""
    value = np.float32(0.82) * np.maximum(display, 0) ** np.float32(2.2)
    return np.maximum(value, np.float32(0.015)).astype(np.float32)


def _cell(direction: np.ndarray, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Continuous rows and columns of directions on a map."""
    row = np.arccos(np.clip(direction[..., 2], -1, 1)) * np.float32(size[0] / np.pi)
    turns = np.arctan2(direction[..., 1], direction[..., 0]) * np.float32(0.5 / np.pi)
    return row, (turns - np.floor(turns)) * np.float32(size[1])


def look_around(
    radiance: Float[np.ndarray, "h w 3"], direction: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Interpolated values of a map in the given directions (unit vectors)."""
    size = (radiance.shape[0], radiance.shape[1])
    row, column = _cell(direction, size)
    return _between(radiance, np.clip(row - 0.5, 0, size[0] - 1), column - 0.5)


def _between(values: np.ndarray, row: np.ndarray, column: np.ndarray) -> np.ndarray:
    """Bilinear interpolation of a map that is periodic along its columns."""
    height, width = values.shape[:2]
    low, left = np.floor(row).astype(np.int64), np.floor(column)
    y, x = (row - low)[:, None], (column - left)[:, None]
    high = np.minimum(low + 1, height - 1)
    left = left.astype(np.int64) % width
    right = (left + 1) % width
    upper = values[low, left] * (1 - x) + values[low, right] * x
    lower = values[high, left] * (1 - x) + values[high, right] * x
    result: np.ndarray = (upper * (1 - y) + lower * y).astype(np.float32)
    return result


def _blurred(radiance: np.ndarray, radians: float) -> np.ndarray:
    """A map blurred by approximately an angle."""
    pixels = radians / np.pi * len(radiance)
    result: np.ndarray = scipy.ndimage.gaussian_filter(
        radiance, (pixels, pixels, 0), mode=("nearest", "wrap", "nearest")
    )
    return result


@functools.lru_cache(maxsize=1)
def _gathering() -> np.ndarray:
    """Matrix from a map to irradiance / pi, for the normals of the rows and columns of `_TABLE`.

    The first and last rows are the poles.
    """
    toward = lights.directions_of(_LIGHT_SIZE).reshape(-1, 3)
    polar = np.linspace(0, np.pi, _TABLE[0])[:, None]
    around = (np.arange(_TABLE[1]) + 0.5) / _TABLE[1] * 2 * np.pi
    normals = np.stack(
        [np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around),
         np.broadcast_to(np.cos(polar), _TABLE)], axis=-1,
    )  # fmt: skip
    angles = lights.solid_angles(_LIGHT_SIZE).reshape(-1)
    gathered = np.maximum(normals.reshape(-1, 3) @ toward.T, 0) * angles / np.pi
    return gathered.astype(np.float32)


def _sides(normal: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors orthogonal to each normal and to each other (Duff et al. 2017)."""
    sign = np.where(normal[:, 2] < 0, np.float32(-1), np.float32(1))
    a = -1 / (sign + normal[:, 2])
    b = normal[:, 0] * normal[:, 1] * a
    one = np.stack([1 + sign * normal[:, 0] ** 2 * a, sign * b, -sign * normal[:, 0]], axis=1)
    return one, np.stack([b, sign + normal[:, 1] ** 2 * a, -normal[:, 1]], axis=1)


class Light:
    """The light of a scene: irradiance and reflections.

    `rotation` is from the model's frame to the view-aligned one. `cast` returns the first hits on
    the model, for origins and directions. `rays` is the number of rays at each point.
    """

    def __init__(
        self,
        around: Surroundings,
        ground: Ground | None,
        surfaces: Surfaces,
        rotation: Float[np.ndarray, "3 3"],
        cast: Callable[[np.ndarray, np.ndarray], RayHits],
        *,
        rays: int,
        rng: np.random.Generator,
    ) -> None:
        self._surfaces, self._ground, self._cast = surfaces, ground, cast
        turn = rotation.T.astype(np.float32)
        vertices = surfaces.vertices @ turn
        self._low, self._high = vertices.min(axis=0) - 0.01, vertices.max(axis=0) + 0.01
        whole = np.asarray(around.radiance, np.float64)
        small = lights.shrink(whole, _LIGHT_SIZE)
        toward = lights.directions_of(_LIGHT_SIZE)
        angles = lights.solid_angles(_LIGHT_SIZE)
        hidden = (toward[..., 2:] < 0) & (ground is not None and ground.endless)
        open_sky = np.where(hidden, 0, small)
        # Directions toward bright parts of the map, divided among the sets of rays.
        energy = (open_sky.mean(axis=-1) * angles).ravel() + 1e-12
        chance = energy / energy.sum()
        self._density = (chance / angles.ravel()).astype(np.float32)
        count = PATTERNS * (rays // 2)
        steps = (np.arange(count) + rng.random()) / count
        cells = np.minimum(np.searchsorted(np.cumsum(chance), steps), chance.size - 1)
        rows, columns = np.divmod(cells, _LIGHT_SIZE[1])
        edges = np.cos(np.linspace(0, np.pi, _LIGHT_SIZE[0] + 1))
        z = edges[rows] + (edges[rows + 1] - edges[rows]) * rng.random(count)
        angle = (columns + rng.random(count)) / _LIGHT_SIZE[1] * 2 * np.pi
        flat = np.sqrt(1 - z**2)
        bright = np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)
        self._bright = bright.reshape(-1, PATTERNS, 3).swapaxes(0, 1).astype(np.float32)
        # Directions around a normal, distributed by the cosine. Consecutive directions belong to
        # different sets, so that each covers the hemisphere.
        count = PATTERNS * (rays - rays // 2)
        first = (np.arange(count) + 0.5) / count
        angle = 2 * np.pi * ((np.arange(count) * 0.6180339887 + rng.random()) % 1)
        radius = np.sqrt(first)
        matt = np.stack(
            [radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - first)], axis=1
        )
        self._matt = matt.reshape(-1, PATTERNS, 3).swapaxes(0, 1).astype(np.float32)
        self.spread = (matt[:: len(matt) // PATTERNS][:PATTERNS] * [1, 1, 0]).astype(np.float32)
        # Irradiance of unoccluded surfaces by normal.
        if ground is not None:
            up = (angles * np.maximum(toward[..., 2], 0))[..., None]
            from_ground = 0.8 * ground.mean * (open_sky * up).sum(axis=(0, 1)) / np.pi
            small = np.where(hidden, from_ground, small)
        self._table = (_gathering() @ small.reshape(-1, 3)).reshape(*_TABLE, 3).astype(np.float32)
        self.open_ground = self.in_the_open(_UP)[0]
        self._small = small.reshape(-1, 3).astype(np.float32)
        self._sharp = [whole.astype(np.float32)] + [
            _blurred(small, b).astype(np.float32) for b in _BLURS[1:]
        ]
        # Light that the faces reflect, first without occlusion and from the open ground.
        count = len(surfaces.material)
        middle = np.full((count, 3), 1 / 3, np.float32)
        colour = linear(shading.look_up(surfaces, np.arange(count), middle)[0])
        self._normals = surfaces.face_normals @ turn
        self._glow = np.float32(_SEEN_BY_OTHERS) * np.stack(
            [colour * self.in_the_open(sign * self._normals) for sign in (1, -1)], axis=1
        )
        # Radiance of the ground on a coarse grid, for rays that hit the ground.
        self._floor: np.ndarray | None = None
        if ground is not None:
            side = np.linspace(-1.6, 1.6, 33, dtype=np.float32)
            x, y = (a.ravel() for a in np.meshgrid(side, side, indexing="ij"))
            places = np.stack([x, y, 0 * x], axis=1)
            lit = self.gather(places, _UP.repeat(len(x), 0), np.arange(len(x)) % PATTERNS, far=True)
            lit = scipy.ndimage.uniform_filter(lit.reshape(33, 33, 3), (3, 3, 1))
            self._floor = (lit * ground.mean).astype(np.float32)
        self._glow = colour[:, None] * self._light_on_faces(surfaces.corners.mean(axis=1) @ turn)

    def _light_on_faces(self, middles: Float[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 2 3"]:
        """Irradiance of both sides of faces; nearby faces with similar normals share a value."""
        cells = np.floor((middles + 2) * np.float32(_CELLS)).astype(np.int64)
        signs = (self._normals > 0) @ np.array([1, 2, 4])
        key = cells @ [1 << 23, 1 << 13, 8] + signs
        _, some, which = np.unique(key, return_index=True, return_inverse=True)
        pattern = np.arange(len(some)) % PATTERNS
        sides = []
        for sign in (1, -1):
            normals = (sign * self._normals[some]).astype(np.float32)
            sides.append(self.gather(middles[some], normals, pattern)[which])
        return np.stack(sides, axis=1)

    def in_the_open(self, normals: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Irradiance / pi of unoccluded surfaces."""
        row, column = _cell(normals, (_TABLE[0] - 1, _TABLE[1]))
        return _between(self._table, row, column - 0.5)

    def _see(
        self, origins: np.ndarray, directions: np.ndarray, distant: np.ndarray, far: bool
    ) -> np.ndarray:
        """Radiance along rays (unit vectors): from the model, the ground, or `distant`.

        If many rays miss the bounding box of the model (`far`), those are not traced.
        """
        result = distant.copy()
        ground, floor = self._ground, self._floor
        reach = np.full(len(origins), np.inf, np.float32)
        if ground is not None and floor is not None:
            down = np.flatnonzero(directions[:, 2] < -1e-4)
            t = -origins[down, 2] / directions[down, 2]
            place = origins[down, :2] + t[:, None] * directions[down, :2]
            down, t, place = (a[(t > 0) & ground.holds(place)] for a in (down, t, place))
            reach[down] = t
            cell = np.clip((place + 1.6) * 10 + 0.5, 0, 32).astype(np.int64)
            result[down] = floor[cell[:, 0], cell[:, 1]]
        index = np.flatnonzero(self._near(origins, directions)) if far else np.arange(len(origins))
        through = np.ones(len(index), np.float32)
        gone = np.full(len(index), _OFF, np.float32)
        for _ in range(_LAYERS):
            start = origins[index] + gone[:, None] * directions[index]
            hits = self._cast(start, directions[index])
            met = np.flatnonzero((hits.face >= 0) & (hits.t + gone < reach[index]))
            if not len(met):
                break
            index, through, gone = index[met], through[met], gone[met]
            face = hits.face[met]
            behind = row_dots(self._normals[face], directions[index]) > 0
            glow = self._glow[face, behind.astype(np.int64)]
            if self._surfaces.opaque:
                result[index] = glow
                break
            _, opacity = shading.look_up(self._surfaces, face, hits.weights[met])
            result[index] += (through * opacity)[:, None] * (glow - result[index])
            through, gone = through * (1 - opacity), gone + hits.t[met] + np.float32(0.0005)
            index, through, gone = (a[through > 0.02] for a in (index, through, gone))
        return result

    def _near(self, origins: np.ndarray, directions: np.ndarray) -> np.ndarray:
        """Which rays intersect the bounding box of the model."""
        enter = np.zeros(len(origins), np.float32)
        leave = np.full(len(origins), np.inf, np.float32)
        with np.errstate(divide="ignore", invalid="ignore"):
            for axis in range(3):
                inverse = 1 / directions[:, axis]
                one = (self._low[axis] - origins[:, axis]) * inverse
                two = (self._high[axis] - origins[:, axis]) * inverse
                np.fmax(enter, np.fmin(one, two), out=enter)
                np.fmin(leave, np.fmax(one, two), out=leave)
        result: np.ndarray = enter <= leave
        return result

    def gather(
        self,
        places: Float[np.ndarray, "n 3"],
        normals: Float[np.ndarray, "n 3"],
        pattern: Int[np.ndarray, " n"],
        *,
        far: bool = False,
    ) -> Float[np.ndarray, "n 3"]:
        """Irradiance / pi at points; times the reflectance it is the radiance of a matt surface.

        `pattern` is the number of the set of rays of each point, below `PATTERNS`. With `far`, rays
        that miss the bounding box of the model are not traced.
        """
        result = np.empty((len(places), 3), np.float32)
        for begin in range(0, len(places), 4096):
            part = slice(begin, begin + 4096)
            result[part] = self._gather(places[part], normals[part], pattern[part], far)
        return result

    def _gather(
        self, places: np.ndarray, normals: np.ndarray, pattern: np.ndarray, far: bool
    ) -> np.ndarray:
        axes = np.stack([*_sides(normals), normals], axis=1)
        along = np.concatenate([self._bright[pattern], self._matt[pattern] @ axes], axis=1)
        count, rays = along.shape[:2]
        cosine = np.einsum("nrd,nd->nr", along, normals).ravel()
        use = np.flatnonzero(cosine > 1e-3)
        along, cosine, point = along.reshape(-1, 3)[use], cosine[use], use // rays
        row, column = (a.astype(np.int64) for a in _cell(along, _LIGHT_SIZE))
        cell = np.minimum(row, _LIGHT_SIZE[0] - 1) * _LIGHT_SIZE[1]
        cell += np.minimum(column, _LIGHT_SIZE[1] - 1)
        distant = self._small[cell]
        seen = self._see((places + _OFF * normals)[point], along, distant, far)
        bright = self._bright.shape[1]
        density = bright * self._density[cell] + (rays - bright) * cosine / np.float32(np.pi)
        weight = cosine / (np.float32(np.pi) * density)

        def total(values: np.ndarray) -> np.ndarray:
            return np.stack([np.bincount(point, v * weight, count) for v in values.T], axis=1)

        # The unoccluded irradiance is known exactly; the rays estimate the fraction that remains.
        part = np.minimum(total(seen) / np.maximum(total(distant), 1e-12), 4)
        return (self.in_the_open(normals) * part).astype(np.float32)

    def reflect(
        self,
        places: Float[np.ndarray, "n 3"],
        normals: Float[np.ndarray, "n 3"],
        view: Float[np.ndarray, "n 3"],
        blur: Float[np.ndarray, " n"],
    ) -> Float[np.ndarray, "n 3"]:
        """Radiance of mirror reflections toward `view`, blurred by an angle in radians."""
        along = 2 * row_dots(normals, view)[:, None] * normals - view
        along = (along / np.linalg.norm(along, axis=1, keepdims=True)).astype(np.float32)
        level = np.abs(blur[:, None] - np.array(_BLURS, np.float32)).argmin(axis=1)
        distant = np.empty((len(places), 3), np.float32)
        for number, sharp in enumerate(self._sharp):
            at = np.flatnonzero(level == number)
            distant[at] = look_around(sharp, along[at])
        return self._see((places + _OFF * normals).astype(np.float32), along, distant, True)


def _mirror_of(
    surfaces: Surfaces, owner: np.ndarray, strength: float
) -> tuple[np.ndarray, np.ndarray]:
    """Reflectance [n, 3] of materials at normal incidence, and blur [n] of the reflections.

    A material whose specular colour is stronger than its diffuse colour counts as metal. Others
    count as varnish or plastic, with a reflectance of at most 0.04.
    """
    specular = np.clip(strength * surfaces.specular, 0, 1)
    bright = specular.mean(axis=1, keepdims=True)
    metal = np.clip(2 * bright - 1.5 * surfaces.diffuse.mean(axis=1, keepdims=True), 0, 1)
    table = 0.04 * np.minimum(1, 2.5 * bright) * (1 - metal) + 0.8 * specular * metal
    blur = np.sqrt(1 / (surfaces.shininess / 4 + 1))
    return table.astype(np.float32)[owner], blur.astype(np.float32)[owner]


def _fresnel(straight: np.ndarray, cosine: np.ndarray, blur: np.ndarray) -> np.ndarray:
    """Reflectance [n, 3] by angle (Schlick 1994), with a smaller increase for rough surfaces."""
    most = np.where(straight > 0, np.maximum(straight, (1 - blur)[:, None] * 0.7), 0)
    result: np.ndarray = straight + (most - straight) * ((1 - np.clip(cosine, 0, 1)) ** 5)[:, None]
    return result


class _Shade:
    """Linear colours of hits. Irradiance is computed at the centres of pixels and reused.

    A sample that hits a different surface than the centre of its pixel gets its own estimate.
    Pixels are indices of the window, padded by one pixel; `pixels` are those of the rays.
    """

    def __init__(self, light: Light, scene: Scene, picture: Picture, side: int) -> None:
        self._light, self._scene = light, scene
        camera = scene.camera
        window = window_of(scene.surfaces, camera)
        self._width = window[1].stop - window[1].start + 2
        mask, depth = (np.pad(a[window], 1) for a in (picture.mask, picture.depth))
        normal = np.pad(picture.normals[window], ((1, 1), (1, 1), (0, 0)))
        numbers = np.arange(mask.size).reshape(mask.shape)[1:-1, 1:-1]
        self.pixels = numbers.ravel().repeat(side * side)
        place = np.zeros((mask.size, 3), np.float32)
        seen = camera.position.astype(np.float32) + sample_rays(camera, window, 1) * depth[
            1:-1, 1:-1
        ].reshape(-1, 1)
        place[numbers.ravel()] = seen
        place = place.reshape(*mask.shape, 3)
        pixel = np.float32(camera.distance / camera.intrinsics[0, 0])
        self._near = 3 * pixel
        at = np.nonzero(mask)
        light_at = np.zeros_like(place)
        light_at[at] = light.gather(place[at], normal[at], at[0] % 4 * 4 + at[1] % 4)
        off = np.full((*mask.shape, 1), 1.5 * pixel, np.float32)
        guides = np.concatenate([normal, place, off], axis=-1)
        for step in (1, 2):
            light_at = smooth(light_at, mask, guides, step=step)
        self._mask, self._light_at = mask.ravel(), light_at.reshape(-1, 3)
        self._normal, self._place = normal.reshape(-1, 3), place.reshape(-1, 3)

    def __call__(
        self,
        at: Int[np.ndarray, " n"],
        fresh: Bool[np.ndarray, " n"],
        place: Float[np.ndarray, "n 3"],
        normal: Float[np.ndarray, "n 3"],
        view: Float[np.ndarray, "n 3"],
        owner: Int[np.ndarray, " n"],
        diffuse: Float[np.ndarray, "n 3"],
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Radiance toward the camera: diffuse, and reflected."""
        light = np.zeros((len(at), 3), np.float32)
        pixel = self.pixels[at]
        rest = np.ones(len(at), np.bool_)
        for offset in (0, 1, -1, self._width, -self._width):
            left = np.flatnonzero(fresh & rest)
            neighbour = pixel[left] + offset
            off = row_dots(normal[left], self._place[neighbour] - place[left])
            alike = (
                self._mask[neighbour]
                & (row_dots(normal[left], self._normal[neighbour]) > 0.85)
                & (np.abs(off) < self._near)
            )
            light[left[alike]] = self._light_at[neighbour[alike]]
            rest[left[alike]] = False
        own = np.flatnonzero(rest)
        if len(own):
            # Samples of a pixel whose normals are in the same octant share their irradiance.
            key = pixel[own] * 8 + (normal[own] > 0) @ np.array([1, 2, 4])
            _, some, which = np.unique(key, return_index=True, return_inverse=True)
            some = own[some]
            pattern = pixel[some] * 7 % PATTERNS
            light[own] = self._light.gather(place[some], normal[some], pattern)[which]
        straight, blur = _mirror_of(self._scene.surfaces, owner, self._scene.lights.specular)
        glossy = np.flatnonzero(straight.max(axis=1) > 0.002)
        mirrored = np.zeros((len(at), 3), np.float32)
        colour = linear(diffuse)
        part = _fresnel(straight[glossy], row_dots(normal[glossy], view[glossy]), blur[glossy])
        mirrored[glossy] = part * self._light.reflect(
            place[glossy], normal[glossy], view[glossy], blur[glossy]
        )
        colour[glossy] *= 1 - straight[glossy]
        return colour * light, mirrored


def backdrop(
    light: Light,
    around: Surroundings,
    ground: Ground | None,
    camera: Camera,
    hidden: Bool[np.ndarray, "h w"],
    *,
    blur: float,
) -> Float[np.ndarray, "h w 3"]:
    """The image of ground and surroundings without the object but with its shadow.

    Values of `hidden` pixels are arbitrary. `blur` is that of distant surroundings, in radians.
    """
    height, width = camera.image_size
    rays = sample_rays(camera, (slice(0, height), slice(0, width)), 1)
    origin = camera.position.astype(np.float32)
    along = rays / np.linalg.norm(rays, axis=1, keepdims=True)
    radiance = _blurred(around.radiance, blur)
    result = look_around(radiance, _on_walls(around, origin, along))
    if ground is None:
        return result.reshape(height, width, 3)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(along[:, 2] < -1e-4, -origin[2] / along[:, 2], np.inf)
    down: np.ndarray = np.flatnonzero(reach < 400)
    t, grazing = reach[down], np.maximum(-along[down, 2], 0.01)
    place = origin[:2] + t[:, None] * along[down, :2]
    # Antialiased edges: the coverage of a pixel is the mean over nine points in it.
    size = (t / np.float32(camera.intrinsics[0, 0]))[:, None]
    side = np.cross(along[down], [0, 0, 1.0])[:, :2] * size / 3
    front = np.stack([side[:, 1], -side[:, 0]], axis=1) / grazing[:, None]
    nine = [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1)]
    share = np.sum([ground.holds(place + a * side + b * front) for a, b in nine], 0) / np.float32(9)
    kept = share > 0
    down, t, place, share, grazing = (a[kept] for a in (down, t, place, share, grazing))
    points = np.pad(place, ((0, 0), (0, 1))).astype(np.float32)
    rows, columns = np.divmod(down, width)
    pattern, up = rows % 4 * 4 + columns % 4, _UP.repeat(len(down), 0)
    valid = np.zeros((height, width), np.bool_)
    valid[rows, columns] = ~hidden[rows, columns]

    def smoothed(values: np.ndarray) -> np.ndarray:
        image = np.zeros((height, width, 3), np.float32)
        image[rows, columns] = values
        return smooth(image, valid)[rows, columns]

    lit = np.tile(light.open_ground, (len(points), 1))
    near = np.flatnonzero((np.linalg.norm(place, axis=1) < 4.0) & valid[rows, columns])
    lit[near] = light.gather(points[near], up[near], pattern[near], far=True)
    footprint = t / np.float32(camera.intrinsics[0, 0]) / np.sqrt(grazing)
    value = ground.colour(place.astype(np.float32), footprint) * smoothed(lit)
    view = -along[down]
    if ground.gloss > 0:
        # Floors are worn: reflections are blurred, and more so if the object is far from the floor.
        rough = np.full(len(down), 0.25, np.float32)
        mirror = _fresnel(np.full((len(down), 3), ground.gloss, np.float32), view[:, 2], rough)
        uneven = up + light.spread[pattern] * np.float32(0.06)
        uneven /= np.linalg.norm(uneven, axis=1, keepdims=True)
        value += smoothed(0.6 * mirror * light.reflect(points, uneven, view, rough))
    if ground.sweep > 0:
        # Paper that curves upward behind the object, lit like a surface that faces the camera.
        wall = ground.mean * light.in_the_open(np.array([[1.0, 0.0, 0.0]], np.float32))
        bend = np.clip((-place[:, 0] - ground.sweep) / (2 * ground.sweep), 0, 1)[:, None]
        bend = bend**2 * (3 - 2 * bend)
        value = value * (1 - bend) + wall * bend
        result = wall * (1 - np.clip(along[:, 2:3] * 1.5, 0, 0.4))
    elif ground.endless:
        haze = (1 - np.exp(-((t / 80) ** 2)))[:, None]
        middle = len(radiance) // 2
        level = np.median(radiance[middle - max(middle // 30, 1) : middle], axis=(0, 1))
        value = value * (1 - haze) + haze * level
    result[down] += share[:, None] * (value - result[down])
    return result.reshape(height, width, 3)


def _on_walls(around: Surroundings, origin: np.ndarray, along: np.ndarray) -> np.ndarray:
    """Directions from the object to the points where rays from another origin meet the walls."""
    room = around.room
    if room is None:
        return along
    turn = turn_about_vertical(room.turn).astype(np.float32)
    start, ray = origin @ turn, along @ turn
    high = np.array([*room.half, room.ceiling], np.float32)
    low = np.array([-room.half[0], -room.half[1], min(room.floor, -1e-3)], np.float32)
    with np.errstate(divide="ignore", invalid="ignore"):
        leave = np.fmax((low - start) / ray, (high - start) / ray).min(axis=1)
    place = (start + np.maximum(leave, 1e-3)[:, None] * ray) @ turn.T
    result: np.ndarray = place / np.maximum(np.linalg.norm(place, axis=1, keepdims=True), 1e-6)
    return result.astype(np.float32)


def photograph(
    mesh: Mesh,
    scene: Scene,
    picture: Picture,
    around: Surroundings,
    ground: Ground | None,
    *,
    film: FilmSettings,
    image: ImageSettings,
    rng: np.random.Generator,
) -> UInt8[np.ndarray, "h w 3"]:
    """The image of a view lit by its surroundings.

    Args:
      mesh: the mesh of `scene.surfaces.corners`.
      scene: the scene; its directional lights are ignored.
      picture: the view as rendered by `render`: its mask, depth and normals are used.
      around: the surroundings.
      ground: the ground under the object; None = there is none.
      film: the response of the camera.
      image: see `settings.ImageSettings`.
      rng: generator of directions, blur and noise.
    """
    camera, side = scene.camera, max(image.samples, 1)
    height, width = camera.image_size
    window = window_of(scene.surfaces, camera)
    turn = camera.rotation.astype(np.float32)
    light_rng, film_rng = rng.spawn(2)

    def cast(origins: np.ndarray, directions: np.ndarray) -> RayHits:
        return mesh.cast(origins @ turn, directions @ turn)

    light = Light(
        around, ground, scene.surfaces, camera.rotation, cast, rays=image.rays, rng=light_rng
    )
    shade = _Shade(light, scene, picture, side)
    seen = follow_rays(mesh, scene, sample_rays(camera, window, side), shade)
    colour = np.concatenate([seen.colour, 1 - seen.through[:, None]], axis=1)
    colour = colour.reshape(-1, side * side, 4)
    if image.soft_edges:
        total = colour.mean(axis=1)
    else:
        # Hard edges: a pixel outside the mask shows only the background.
        count = np.maximum(seen.hit.reshape(-1, side * side).sum(axis=1), 1)[:, None]
        total = np.where(picture.mask[window].reshape(-1, 1), colour.sum(axis=1) / count, 0)
    full = np.zeros((height, width, 4), np.float32)
    full[window] = total.reshape(full[window].shape)
    if image.background == "surroundings" or ground is not None:
        hidden, blur = full[..., 3] > 0.995, float(light_rng.uniform(0, 0.03))
        behind = backdrop(light, around, ground, camera, hidden, blur=blur)
    else:
        level = light.in_the_open(np.array([[1.0, 0, 0]], np.float32))[0].mean()
        behind = linear(np.asarray(BACKGROUND, np.float32)) * level
    radiance = full[..., :3] + (1 - full[..., 3:]) * behind
    weight = 0.3 + 2.0 * picture.mask * (height * width / max(picture.mask.sum(), 1)) * 0.3
    illuminant = light.in_the_open(np.array([[0.5, 0, 0.866]], np.float32))[0]
    return develop(radiance, weight, film, film_rng, illuminant=illuminant)

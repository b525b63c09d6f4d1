"""The light of a scene: irradiance and reflections.

All colours are linear.
"""

import functools
from collections.abc import Callable

import numpy as np
import scipy.ndimage
from jaxtyping import Float, Int

from data_gen import lights, shading
from data_gen.grounds import Ground
from data_gen.scene import RayHits, Surfaces
from data_gen.surroundings import Surroundings

PATTERNS = 16
"""Number of different sets of rays; neighbouring pixels use different sets."""

_LIGHT_SIZE = (64, 128)

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


def linear(display: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Linear reflectances of display colours, bounded away from black and white."""
    value = np.float32(0.82) * np.maximum(display, 0) ** np.float32(2.2)
    return np.maximum(value, np.float32(0.015)).astype(np.float32)


def _cell(direction: np.ndarray, size: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Continuous rows and columns of directions on a map."""
    row = np.arccos(np.clip(direction[..., 2], -1, 1)) * np.float32(size[0] / np.pi)
    turns = np.arctan2(direction[..., 1], direction[..., 0]) * np.float32(0.5 / np.pi)
    return row, (turns - np.floor(turns)) * np.float32(size[1])


def _nearest(direction: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Index of the nearest pixel of each direction, in the flattened map."""
    row, column = _cell(direction, size)
    rows = np.minimum(row.astype(np.int64), size[0] - 1)
    return rows * size[1] + np.minimum(column.astype(np.int64), size[1] - 1)


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


def blurred(radiance: np.ndarray, radians: float) -> np.ndarray:
    """A map blurred by approximately an angle."""
    pixels = radians / np.pi * len(radiance)
    result: np.ndarray = scipy.ndimage.gaussian_filter(
        radiance, (pixels, pixels, 0), mode=("nearest", "wrap", "nearest")
    )
    return result


@functools.lru_cache(maxsize=1)
def _gathering() -> np.ndarray:
    """Matrix from a map to irradiance / pi, for a grid of normals.

    The normals are those of the rows and columns of `_TABLE`; the first and last rows are the
    poles.
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
    """The light of a scene, in the view-aligned frame."""

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
        """Prepares rays and tables.

        Deliberately one function: each table is computed from those before it, and the order of
        the random numbers is fixed.

        Args:
          around: the surroundings, which emit the light.
          ground: the ground, which reflects and blocks light; None = there is none.
          surfaces: arrays of the model.
          rotation: rotation from the model's frame to the view-aligned one.
          cast: returns the first hits on the model, for origins and directions in the view-aligned
            frame.
          rays: number of rays at each point.
          rng: generator of the directions.
        """
        self._surfaces, self._ground, self._cast = surfaces, ground, cast
        turn = rotation.T.astype(np.float32)
        corners = surfaces.vertices @ turn
        self._low, self._high = corners.min(axis=0) - 0.01, corners.max(axis=0) + 0.01
        whole = np.asarray(around.radiance, np.float64)
        small = lights.shrink(whole, _LIGHT_SIZE)
        toward = lights.directions_of(_LIGHT_SIZE)
        endless = ground is not None and not np.isfinite(ground.half).any()
        below = toward[..., 2] < 0
        open_sky = np.where((endless & below)[..., None], 0, small)
        # Directions toward bright parts of the map, divided among the sets of rays.
        angles = lights.solid_angles(_LIGHT_SIZE)
        energy = (open_sky.mean(axis=-1) * angles).ravel() + 1e-12
        chance = energy / energy.sum()
        self._density = (chance / angles.ravel()).astype(np.float32)
        count = PATTERNS * (rays // 2)
        steps = (np.arange(count) + rng.random()) / count
        cells = np.minimum(np.searchsorted(np.cumsum(chance), steps), chance.size - 1)
        rows, columns = np.divmod(cells, _LIGHT_SIZE[1])
        edges = np.cos(np.linspace(0, np.pi, _LIGHT_SIZE[0] + 1))
        z = edges[rows] + (edges[rows + 1] - edges[rows]) * rng.random(count)
        around_z = (columns + rng.random(count)) / _LIGHT_SIZE[1] * 2 * np.pi
        flat = np.sqrt(1 - z**2)
        bright = np.stack([flat * np.cos(around_z), flat * np.sin(around_z), z], axis=1)
        self._bright = bright.reshape(-1, PATTERNS, 3).swapaxes(0, 1).astype(np.float32)
        # Directions around a normal, distributed by the cosine.
        count = PATTERNS * (rays - rays // 2)
        first = (np.arange(count) + 0.5) / count
        second = (np.arange(count) * 0.6180339887 + rng.random()) % 1
        angle, radius = 2 * np.pi * second, np.sqrt(first)
        matt = np.stack(
            [radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - first)], axis=1
        )
        # Consecutive directions belong to different sets, so that each covers the hemisphere.
        self._matt = matt.reshape(-1, PATTERNS, 3).swapaxes(0, 1).astype(np.float32)
        self.spread = np.concatenate(
            [matt[:: len(matt) // PATTERNS][:PATTERNS, :2], np.zeros((PATTERNS, 1))], axis=1
        ).astype(np.float32)
        # Tables: irradiance of unoccluded surfaces by normal.
        gathering = _gathering()
        if ground is not None:
            up = (angles * np.maximum(toward[..., 2], 0))[..., None]
            from_ground = 0.8 * ground.mean * (open_sky * up).sum(axis=(0, 1)) / np.pi
            small = np.where((endless & below)[..., None], from_ground, small)
        table = gathering @ small.reshape(-1, 3)
        self._table = table.reshape(*_TABLE, 3).astype(np.float32)
        self.open_ground = self.in_the_open(np.array([[0, 0, 1]], np.float32))[0]
        self._small = small.reshape(-1, 3).astype(np.float32)
        self._sharp = [whole.astype(np.float32)] + [
            blurred(small, b).astype(np.float32) for b in _BLURS[1:]
        ]
        count = len(surfaces.material)
        colour, _ = shading.look_up(
            surfaces, np.arange(count), np.full((count, 3), 1 / 3, np.float32)
        )
        normals = surfaces.face_normals @ turn
        colour = linear(colour)
        self._normals = normals
        self._glow = np.float32(_SEEN_BY_OTHERS) * np.stack(
            [colour * self.in_the_open(normals), colour * self.in_the_open(-normals)], axis=1
        )
        # Radiance of the ground on a coarse grid, for rays that hit the ground.
        self._floor: np.ndarray | None = None
        if ground is not None:
            side = np.linspace(-1.6, 1.6, 33, dtype=np.float32)
            places = np.stack([*np.meshgrid(side, side, indexing="ij"), np.zeros((33, 33))], -1)
            lit = self.gather(
                places.reshape(-1, 3).astype(np.float32),
                np.broadcast_to(np.array([0, 0, 1], np.float32), (33 * 33, 3)),
                np.arange(33 * 33) % PATTERNS,
                far=True,
            ).reshape(33, 33, 3)
            floor = scipy.ndimage.uniform_filter(lit, (3, 3, 1))
            self._floor = (floor * ground.mean).astype(np.float32)
        self._glow = colour[:, None] * self._light_on_faces(surfaces.corners.mean(axis=1) @ turn)

    def _light_on_faces(self, middles: Float[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 2 3"]:
        """Irradiance of both sides of faces; nearby faces with similar normals share a value."""
        cells = np.floor((middles + 2) * np.float32(_CELLS)).astype(np.int64)
        signs = (self._normals > 0) @ np.array([1, 2, 4])
        key = ((cells[:, 0] * 1024 + cells[:, 1]) * 1024 + cells[:, 2]) * 8 + signs
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

    def see(
        self,
        origins: Float[np.ndarray, "n 3"],
        directions: Float[np.ndarray, "n 3"],
        distant: Float[np.ndarray, "n 3"],
        *,
        far: bool = False,
    ) -> Float[np.ndarray, "n 3"]:
        """Radiance along rays: from the model, the ground, or the distant surroundings.

        Args:
          origins: origins of the rays.
          directions: unit vectors.
          distant: radiance of rays that hit nothing.
          far: whether many rays miss the bounding box of the model. Those are not traced.
        """
        result = distant.copy()
        ground, low = self._ground, directions[:, 2] < -1e-4
        reach = np.full(len(origins), np.inf, np.float32)
        if ground is not None and self._floor is not None and low.any():
            down = np.flatnonzero(low)
            t = -origins[down, 2] / directions[down, 2]
            place = origins[down, :2] + t[:, None] * directions[down, :2]
            down, t, place = (a[(t > 0) & ground.holds(place)] for a in (down, t, place))
            reach[down] = t
            cell = np.clip((place + 1.6) * 10 + 0.5, 0, 32).astype(np.int64)
            result[down] = self._floor[cell[:, 0], cell[:, 1]]
        index = np.flatnonzero(self._near(origins, directions)) if far else np.arange(len(origins))
        through = np.ones(len(index), np.float32)
        start, along = origins[index] + _OFF * directions[index], directions[index]
        gone = np.full(len(index), _OFF, np.float32)
        for _ in range(_LAYERS):
            hits = self._cast(start, along)
            met = np.flatnonzero((hits.face >= 0) & (hits.t + gone < reach[index]))
            if not len(met):
                break
            index, through, along, start = index[met], through[met], along[met], start[met]
            face, t = hits.face[met], hits.t[met]
            away = np.einsum("nd,nd->n", self._normals[face], along) > 0
            glow = self._glow[face, away.astype(np.int64)]
            if self._surfaces.opaque:
                result[index] = glow
                break
            _, opacity = shading.look_up(self._surfaces, face, hits.weights[met])
            result[index] += (through * opacity)[:, None] * (glow - result[index])
            through = through * (1 - opacity)
            on = np.flatnonzero(through > 0.02)
            step = t[on] + np.float32(0.0005)
            index, through, along = index[on], through[on], along[on]
            start, gone = start[on] + step[:, None] * along, gone[met][on] + step
            if not len(index):
                break
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

        Args:
          places: positions of the points.
          normals: unit vectors on the visible side.
          pattern: number of the set of rays of each point, 0 to 15.
          far: see `see`.
        """
        result = np.empty((len(places), 3), np.float32)
        for begin in range(0, len(places), 4096):
            part = slice(begin, begin + 4096)
            result[part] = self._gather(places[part], normals[part], pattern[part], far)
        return result

    def _gather(
        self, places: np.ndarray, normals: np.ndarray, pattern: np.ndarray, far: bool
    ) -> np.ndarray:
        local = self._matt[pattern]
        one, two = _sides(normals)
        matt = (
            local[..., :1] * one[:, None] + local[..., 1:2] * two[:, None]
            + local[..., 2:] * normals[:, None]
        )  # fmt: skip
        along = np.concatenate([self._bright[pattern], matt], axis=1)
        count, rays = along.shape[:2]
        cosine = np.einsum("nrd,nd->nr", along, normals).ravel()
        use = np.flatnonzero(cosine > 1e-3)
        along = along.reshape(-1, 3)[use]
        cosine = cosine[use]
        point = use // rays
        cell = _nearest(along, _LIGHT_SIZE)
        start = (places + _OFF * normals)[point]
        distant = self._small[cell]
        seen = self.see(start, along, distant, far=far)
        bright = self._bright.shape[1]
        density = bright * self._density[cell] + (rays - bright) * cosine / np.float32(np.pi)
        weight = (cosine / (np.float32(np.pi) * density))[:, None]

        def total(values: np.ndarray) -> np.ndarray:
            values = values * weight
            return np.stack(
                [np.bincount(point, values[:, k], minlength=count) for k in range(3)], axis=1
            )

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
        """Radiance of blurred mirror reflections.

        Args:
          places: positions of the points.
          normals: unit vectors.
          view: unit vectors toward the camera.
          blur: blur of distant surroundings, in radians.
        """
        along = 2 * np.einsum("nd,nd->n", normals, view)[:, None] * normals - view
        along = (along / np.linalg.norm(along, axis=1, keepdims=True)).astype(np.float32)
        level = np.abs(blur[:, None] - np.array(_BLURS, np.float32)).argmin(axis=1)
        distant = np.empty((len(places), 3), np.float32)
        for number, sharp in enumerate(self._sharp):
            at = np.flatnonzero(level == number)
            distant[at] = look_around(sharp, along[at])
        return self.see((places + _OFF * normals).astype(np.float32), along, distant, far=True)


def mirror_of(
    surfaces: Surfaces, owner: Int[np.ndarray, " n"], strength: float
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, " n"]]:
    """Reflectance of surfaces at normal incidence, and blur of the reflections in radians.

    A material whose specular colour is stronger than its diffuse colour counts as metal. Others
    count as varnish or plastic, with a reflectance of at most 0.04.
    """
    specular = np.clip(strength * surfaces.specular, 0, 1)
    bright = specular.mean(axis=1, keepdims=True)
    metal = np.clip(2 * bright - 1.5 * surfaces.diffuse.mean(axis=1, keepdims=True), 0, 1)
    table = 0.04 * np.minimum(1, 2.5 * bright) * (1 - metal) + 0.8 * specular * metal
    blur = np.sqrt(1 / (surfaces.shininess / 4 + 1))
    return table.astype(np.float32)[owner], blur.astype(np.float32)[owner]


def fresnel(
    straight: Float[np.ndarray, "n 3"],
    cosine: Float[np.ndarray, " n"],
    blur: Float[np.ndarray, " n"],
) -> Float[np.ndarray, "n 3"]:
    """Reflectance by angle (Schlick 1994), with a smaller increase for rough surfaces."""
    most = np.where(straight > 0, np.maximum(straight, (1 - blur)[:, None] * 0.7), 0)
    return straight + (most - straight) * ((1 - np.clip(cosine, 0, 1)) ** 5)[:, None]

"""Common parts of the data sets built on ShapeNet: categories, frames, cameras and volumes.

**World**: ShapeNet's models have +y up. We rotate them to +z up, `(x, y, z) = (X, -Z, Y)`, as
Blender does when it reads an OBJ. Samples are in the project's frame: rotated about the vertical
axis so that +y is the right of the image, with the origin on the ground under the middle of the
bounding box. The unit is the distance of the farthest point from the origin (`object_frame`).

**Camera** of 3D-R2N2's renderings. Sources: commit 3f62115, `lib/blender_renderer.py`, and the
matrices that later projects derived from it, which agree. The images have 137x137 pixels. The focal
length is 35 mm on a sensor of 32 mm, that is 35/32 * 137 = 149.8 pixels (the "field of view" of 25
in the metadata was not used). The camera looks at the origin of the world from the distance
1.75 * ratio. The elevation is the angle above the ground; the azimuth is the angle from the
direction (1, 0), clockwise seen from above.
"""

import dataclasses
import io
import pathlib

import numpy as np
from PIL import Image
from scipy import ndimage

from psgn_jax.data import camera, schema, synsets
from psgn_jax.data.sources.binvox import Grid
from psgn_jax.system.untrusted import size_of

NUM_POINTS = 16384
NUM_VIEWS = 24
IMAGE_SIDE = 137
FOCAL = 35 / 32 * IMAGE_SIDE
MAX_DISTANCE = 1.75

# Rotation from ShapeNet's axes to the world's.
TO_WORLD = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])

_MAX_FILE_SIZE = 1 << 24
_FINE = 4
_LARGEST = 1e4  # bound of a model's coordinates and of 1 / radius


def intrinsics() -> np.ndarray:
    """The camera of 3D-R2N2's renderings, float64 [3, 3] at 137x137 pixels."""
    half = IMAGE_SIDE / 2
    return np.array([[FOCAL, 0, half], [0, FOCAL, half], [0, 0, 1]])


def orbit_camera(azimuth: float, elevation: float, distance: float) -> np.ndarray:
    """World-to-camera matrix [3, 4] of a camera that looks at the origin; degrees, world units."""
    a, e = np.deg2rad(azimuth), np.deg2rad(elevation)
    outward = np.array([np.cos(a) * np.cos(e), -np.sin(a) * np.cos(e), np.sin(e)])
    right = np.array([np.sin(a), np.cos(a), 0])
    rotation = np.stack([right, np.cross(-outward, right), -outward])
    return np.concatenate([rotation, [[0], [0], [distance]]], axis=1)


def object_frame(points: np.ndarray, path: pathlib.Path) -> tuple[np.ndarray, float]:
    """Origin [3] and unit of an object's frame, from all its points [n, 3] in the world.

    ValueError, which names `path`, without points, or if the size is far from ShapeNet's (about 1).
    """
    if not len(points):
        raise ValueError(f"{path}: the volume is empty")
    low, high = points.min(axis=0), points.max(axis=0)
    if not np.abs([low, high]).max() <= _LARGEST:
        raise ValueError(
            f"{path}: coordinates from {low.min():g} to {high.max():g}, expected a few units"
        )
    origin = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    unit = float(np.linalg.norm(points - origin, axis=1).max())
    if not unit >= 1 / _LARGEST:
        raise ValueError(f"{path}: the object's radius is {unit:g}, expected some tenths of a unit")
    return origin, unit


def world_grid(grid: Grid) -> Grid:
    """Transforms the volume of a ShapeNet model to the world."""
    x, y, z = grid.low
    low = np.array([x, -(z + grid.size), y])
    return Grid(grid.cells.transpose(0, 2, 1)[:, ::-1], low, grid.size)


def corners(solid: Grid) -> np.ndarray:
    """Corners of all occupied cells in the world, [n, 3]."""
    cells = np.argwhere(solid.cells)
    steps = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), axis=-1).reshape(-1, 3)
    return np.unique((cells[:, None] + steps).reshape(-1, 3), axis=0) * solid.edge + solid.low


def surface_points(solid: Grid, count: int, rng: np.random.Generator) -> np.ndarray:
    """Uniform random points on the outer faces of occupied cells, in the world.

    The faces form steps, so their surface is rougher and larger than the model's. On a slanted
    plane, points are up to one cell away from it.
    """
    padded = np.pad(solid.cells, 1)
    faces = []
    for axis in range(3):
        between = np.diff(padded.astype(np.int8), axis=axis) != 0
        low = np.argwhere(between) - 1.0  # indices of the padded grid
        low[:, axis] += 1
        faces.append(np.concatenate([low, np.full((len(low), 1), axis)], axis=1))
    chosen = np.concatenate(faces)
    chosen = chosen[rng.integers(len(chosen), size=count)]
    offset = rng.random((count, 3))
    offset[np.arange(count), chosen[:, 3].astype(int)] = 0
    return (chosen[:, :3] + offset) * solid.edge + solid.low


def turned_occupancy(solid: Grid, origin: np.ndarray, unit: float, turn: np.ndarray) -> np.ndarray:
    """Resamples the volume to the schema's grid in the frame of a view, bool [32, 32, 32].

    We divide a cell into 4^3 parts; a part is solid if its centre is in an occupied cell of
    `solid`. A cell is occupied if at least half of its parts are solid or, to keep thin structures,
    if any part is and the first rule occupies none of its 26 neighbours.
    """
    size, fine = schema.OCCUPANCY_SIZE, schema.OCCUPANCY_SIZE * _FINE
    along = (np.arange(fine) + 0.5) * (2 / fine)
    n = len(solid.cells)
    x, y = np.meshgrid(along - 1, along - 1, indexing="ij")
    world = np.stack([x, y], axis=-1) @ turn[:2, :2] * unit + origin[:2]
    column = np.floor((world - solid.low[:2]) / solid.edge).astype(np.int64)
    height = along * unit + origin[2]
    level = np.floor((height - solid.low[2]) / solid.edge).astype(np.int64)
    column, level = np.clip(column, -1, n) + 1, np.clip(level, -1, n) + 1
    padded = np.pad(solid.cells, 1)
    parts = padded[column[..., 0], column[..., 1]][:, :, level]
    share = parts.reshape(size, _FINE, size, _FINE, size, _FINE).mean(axis=(1, 3, 5))
    thick = share >= 0.5
    near = np.pad(thick, 1)
    for axis in range(3):
        near = near | np.roll(near, 1, axis) | np.roll(near, -1, axis)  # the border is empty
    return thick | ((share > 0) & ~near[1:-1, 1:-1, 1:-1])


def drawn_mask(pixels: np.ndarray, depth: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The pixels that contain projected points, with gaps of one pixel closed, bool [H, W]."""
    height, width = shape
    pixels = pixels[(depth > 0) & np.isfinite(pixels).all(axis=1)]
    cell = np.floor(pixels).astype(np.int64)
    cell = cell[((cell >= 0) & (cell < (width, height))).all(axis=1)]
    hit = np.zeros((height, width), np.bool_)
    hit[cell[:, 1], cell[:, 0]] = True
    return ndimage.binary_closing(np.pad(hit, 1), np.ones((3, 3)))[1:-1, 1:-1]


def read_limited(path: pathlib.Path) -> bytes:
    """Reads a file; ValueError if it is larger than any file of these data sets."""
    if (size := size_of(path)) > _MAX_FILE_SIZE:
        raise ValueError(f"{path}: {size} bytes, expected at most {_MAX_FILE_SIZE}")
    return path.read_bytes()


def read_image(path: pathlib.Path, kind: str, mode: str) -> np.ndarray:
    """Decodes an image of 137x137 pixels and the format `kind` to uint8 [137, 137, channels].

    `mode` is "RGB" (grey images are converted) or "RGBA". ValueError, which names the file, for
    another image.
    """
    data, size = read_limited(path), (IMAGE_SIDE, IMAGE_SIDE)
    try:
        picture = Image.open(io.BytesIO(data), formats=(kind,))
        if picture.size != size:
            raise ValueError(f"{picture.size} pixels, expected {size}")
        if mode == "RGBA" and picture.mode not in ("RGBA", "LA"):
            raise ValueError(f"mode {picture.mode}, expected one with an alpha channel")
        return np.asarray(picture.convert(mode))
    except (ValueError, OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise ValueError(f"{path}: not a readable {kind} image ({error})") from None


@dataclasses.dataclass(frozen=True, eq=False)
class ShapeNetModel:
    """A model in the world. In the frame of a view it is (world - origin) / unit, rotated."""

    source: str  # name of the data set
    synset: str
    name: str
    points: np.ndarray  # [n, 3]
    solid: Grid | None
    origin: np.ndarray  # [3]
    unit: float

    def sample(
        self, view: int, eye: np.ndarray, inner: np.ndarray, image: np.ndarray, mask: np.ndarray
    ) -> schema.Sample:
        """The sample of a view with extrinsics `eye` [3, 4] (from world) and intrinsics `inner`.

        ValueError if the camera is rolled on its side.
        """
        turn, origin, unit = camera.turn_to_view(eye), self.origin, self.unit
        moved = (eye[:, :3] @ origin + eye[:, 3]) / unit
        solid = self.solid
        return schema.Sample(
            image=image,
            mask=mask,
            points=((self.points - origin) @ turn.T / unit).astype(np.float32),
            occupancy=turned_occupancy(solid, origin, unit, turn) if solid else None,
            intrinsics=inner.astype(np.float32),
            extrinsics=np.column_stack([eye[:, :3] @ turn.T, moved]).astype(np.float32),
            category=synsets.SHAPENET.get(self.synset, self.synset),
            model_id=f"{self.synset}/{self.name}",
            view=view,
            source=self.source,
        )

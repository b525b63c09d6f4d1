"""Reads the renderings and voxels of 3D-R2N2.

The published layout (README of github.com/chrischoy/3D-R2N2): two archives, unpacked in a folder,

    ShapeNetRendering/<synset>/<model>/rendering/00.png .. 23.png   137x137, RGBA
    ShapeNetRendering/<synset>/<model>/rendering/rendering_metadata.txt
    ShapeNetVox32/<synset>/<model>/model.binvox                     32^3, solid, ShapeNet's axes

The metadata have one line per view: azimuth, elevation, in-plane rotation (0 in all lines),
distance ratio, field of view. `shapenet` describes the camera.

Splits: of the models of a category, sorted by name, the first 80 % (rounded down) are `train`, the
others `test`. This is the rule of 3D-R2N2 (`lib/data_io.py`), applied to the models in the folder.

The data set has no surface points. We sample `points` uniformly on the outer faces of the voxels,
whose position is in the header of the binvox file. So the points are as coarse as the voxels (1/32
of the longest edge). `occupancy` is the volume resampled to the frame of the view.
"""

import pathlib
import zlib
from collections.abc import Callable

import numpy as np

from psgn_jax.data import camera, schema, synsets
from psgn_jax.data.sources import binvox, shapenet

RENDERINGS = "ShapeNetRendering"
VOXELS = "ShapeNetVox32"
NUM_VIEWS = shapenet.NUM_VIEWS
TRAIN_SHARE = 0.8
_MAX_LINES = 1000

# A voxel at the surface extends beyond the model by up to its diagonal, about 3.3 * sqrt(3) pixels.
_NEAR_PIXELS = 6
_LEAST_NEAR = 0.9
# This check misses many wrong signs of the elevation. We refuse a view if the other sign fits
# better by this IoU.
_CLEARLY = 0.05


def models(source: pathlib.Path) -> tuple[list[tuple[str, str, str]], list[str]]:
    """All models as (split, synset, name), and a message for each folder of another category."""
    for part in (RENDERINGS, VOXELS):
        if not (source / part).is_dir():
            raise ValueError(f"SRC {str(source)!r}: no folder {part} there")
    listed: list[tuple[str, str, str]] = []
    messages: list[str] = []
    folders = {p.name for part in (RENDERINGS, VOXELS) for p in (source / part).iterdir()}
    for synset in sorted(folders):
        places = [p for part in (RENDERINGS, VOXELS) if (p := source / part / synset).is_dir()]
        if synset not in synsets.R2N2:
            if places:
                messages.append(f"{places[0]}: not one of the 13 categories")
            continue
        names = sorted({p.name for place in places for p in place.iterdir() if p.is_dir()})
        last = int(TRAIN_SHARE * len(names))
        listed += [("train" if i < last else "test", synset, name) for i, name in enumerate(names)]
    return listed, messages


def input_files(source: pathlib.Path, synset: str, name: str) -> list[pathlib.Path]:
    """The paths whose size and time show whether a model has changed."""
    rendering = source / RENDERINGS / synset / name / "rendering"
    voxels = source / VOXELS / synset / name / "model.binvox"
    return [rendering, rendering / "rendering_metadata.txt", voxels]


def _read_metadata(path: pathlib.Path) -> list[tuple[float, ...] | str]:
    """The rows of a metadata file, with a message in place of a wrong row."""
    lines = shapenet.read_limited(path).decode("utf-8-sig", "replace").splitlines()
    if len(lines) > _MAX_LINES:
        raise ValueError(f"{path}: {len(lines)} lines, expected {shapenet.NUM_VIEWS}")
    rows: list[tuple[float, ...] | str] = []
    for line in lines:
        try:
            numbers = tuple(float(word) for word in line.split())
        except ValueError:
            numbers = ()
        if len(numbers) != 5:
            rows.append(f"{line[:60]!r} are not 5 numbers")
        elif not np.isfinite(numbers).all() or numbers[3] <= 0 or abs(numbers[1]) > 90:
            rows.append(f"{line[:60]!r}: expected finite numbers, |elevation| <= 90, distance > 0")
        elif abs(numbers[2]) > 1e-3:
            rows.append(f"in-plane rotation {numbers[2]:g}, expected 0 as in all published rows")
        else:
            rows.append(numbers)
    return rows


def open_model(
    source: pathlib.Path, synset: str, name: str, num_points: int
) -> Callable[[int], schema.Sample]:
    """Reads a model; returns a function that reads view i. All views have the same points.

    Both functions raise ValueError or OSError, which names the file. Fewer rows of metadata than
    images are an error of the model: if a row were lost, all later views would have wrong cameras.
    """
    rendering, metadata, voxels = input_files(source, synset, name)
    solid = shapenet.world_grid(binvox.read(voxels))
    origin, unit = shapenet.object_frame(shapenet.corners(solid), voxels)
    rng = np.random.default_rng(zlib.crc32(f"{synset}/{name}".encode()))
    points = shapenet.surface_points(solid, num_points, rng)
    model = shapenet.ShapeNetModel("r2n2", synset, name, points, solid, origin, unit)
    rows = _read_metadata(metadata)
    pictures = sum((rendering / f"{view:02d}.png").exists() for view in range(shapenet.NUM_VIEWS))
    if len(rows) < pictures:
        raise ValueError(
            f"{metadata}: {len(rows)} rows for {pictures} pictures, expected one row per picture"
        )
    inner = shapenet.intrinsics()

    def read(view: int) -> schema.Sample:
        path = rendering / f"{view:02d}.png"
        row = rows[view] if view < len(rows) else "missing"
        if isinstance(row, str):
            raise ValueError(f"{metadata}: row {view}: {row}")
        image, mask = _read_view(path)
        azimuth, elevation, _, ratio, _ = row
        eye = shapenet.orbit_camera(azimuth, elevation, ratio * shapenet.MAX_DISTANCE)
        sample = model.sample(view, eye, inner, image, mask)
        pixels, depth = camera.project(sample.points, sample.intrinsics, sample.extrinsics)
        near = camera.inside_mask(pixels, mask, _NEAR_PIXELS)[depth > 0].sum() / len(depth)
        if near < _LEAST_NEAR:
            raise ValueError(
                f"{path}: {near:.0%} of the points project to within {_NEAR_PIXELS} pixels of the "
                f"object, expected {_LEAST_NEAR:.0%}; camera, shape and image disagree"
            )
        below = shapenet.orbit_camera(azimuth, -elevation, ratio * shapenet.MAX_DISTANCE)
        drawn = [shapenet.drawn_mask(*camera.project(points, inner, x), mask.shape)
                 for x in (eye, below)]  # fmt: skip
        overlap, other = ((x & mask).sum() / (x | mask).sum() for x in drawn)
        if other > overlap + _CLEARLY:
            raise ValueError(
                f"{path}: an elevation of {-elevation:g} degrees fits the image better (IoU "
                f"{other:.2f}) than that of {metadata.name}, {elevation:g} (IoU {overlap:.2f})"
            )
        return sample

    return read


def _read_view(path: pathlib.Path) -> tuple[np.ndarray, np.ndarray]:
    """The image on the project's background, and the mask (alpha above one half)."""
    rgba = shapenet.read_image(path, "PNG", "RGBA")
    alpha = rgba[..., 3:].astype(np.float32) / 255
    mask = rgba[..., 3] > 127
    if not mask.any():
        raise ValueError(f"{path}: the image is transparent, expected an object")
    over = rgba[..., :3] * alpha + schema.BACKGROUND_GREY * (1 - alpha)
    image = np.where(mask[..., None], np.rint(over), schema.BACKGROUND_GREY).astype(np.uint8)
    return image, mask

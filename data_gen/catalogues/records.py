"""Catalogue of the models in a folder of records: new views of point clouds without meshes.

We approximate the surface of a model by surfels: a small tangential rectangle at each point. The
principal directions of the point's nearest neighbours are the normal and the axes of the surfel.
The long semi-axis is the distance to the 5th neighbour, which leaves e^-5 of a plane with
Poisson-distributed points uncovered. On thin parts and edges, the other semi-axis is shorter. The
colour comes from the record's image, at hidden points from the nearest visible point. If the record
has no depth, all points are grey.

Objects keep position and scale. The job must use `centre=bounds`, the default.
"""

import dataclasses
import functools
import os

import numpy as np
import scipy.spatial

from data_gen.catalogues.entry import SPLITS, Catalogue, Entry
from data_gen.catalogues.proportions import Change, random_proportions
from data_gen.mesh import Model, UnusableModelError, build_model, unit_vectors
from data_gen.readers.parts import palette
from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.manifest import DUPLICATES, load_manifest
from psgn_jax.data.schema import Sample

_NEIGHBOURS = 32  # number of points for the normal and the axes of a surfel
_REACH = 5  # the long semi-axis of a surfel is the distance to this neighbour
_THINNEST = 0.3  # smallest ratio of the semi-axes
_SHOWN = 0.04  # largest difference between the depths of a visible point and of the image
_FEWEST = 100  # smallest number of points of a usable model


def records(source: str | os.PathLike[str]) -> Catalogue:
    """The models in a folder of records, each from its first record.

    Args:
      source: a folder of records.

    Raises:
      ValueError: there are no readable records, a split is unknown, or model names are empty or
        ambiguous.
    """
    source = os.path.abspath(source)  # for processes in other working directories
    entries = [  # in the order of the records
        Entry(
            name, category, split, functools.partial(_load, source, split, index),
            functools.partial(_load_variant, source, split, index),
        )
        for name, (category, split, index) in _first_records(source).items()
    ]  # fmt: skip
    return Catalogue("records", entries)


def _first_records(source: str) -> dict[str, tuple[str, str, int]]:
    """Category, split and index of the first record of each model, by name."""
    splits = load_manifest(source).splits()
    splits.pop(DUPLICATES, None)
    unknown = sorted(set(splits) - set(SPLITS))
    if unknown or not splits:
        raise ValueError(f"{source}: splits {sorted(splits)}, expected some of {list(SPLITS)}")
    found: dict[str, tuple[str, str, int]] = {}
    for split in (s for s in SPLITS if s in splits):
        stream = _reader(source, split)
        for index in range(len(stream)):
            stored = stream.stored(index, ())
            name = stored.model_id
            first = found.setdefault(name, (stored.category, split, index))
            if not name or first[:2] != (stored.category, split):
                expected = "a name that belongs to a single model, category and split"
                what = f"record {index} of split {split!r} has the model name {name!r}"
                raise ValueError(f"{source}: {what}, expected {expected}")
    return found


@functools.lru_cache(maxsize=4)
def _reader(source: str, split: str) -> RecordReader:
    return RecordReader(source, split)


def _load(source: str, split: str, index: int) -> Model:
    return surfels(_reader(source, split)[index])


def _load_variant(source: str, split: str, index: int, name: str, deviation: float) -> Model:
    sample = dataclasses.replace(_reader(source, split)[index], model_id=name)
    return surfels(sample, lambda points: _varied(points, name, deviation))


def _varied(points: np.ndarray, name: str, deviation: float) -> np.ndarray:
    """Points with random proportions, with the same origin and the farthest at distance 1."""
    change, _ = random_proportions(points, name, deviation)
    moved = change(points) - change(np.zeros((1, 3))) * [1, 1, 0]
    return moved / np.linalg.norm(moved, axis=1).max()


def surfels(sample: Sample, change: Change | None = None) -> Model:
    """A mesh with a rectangle for each point of a sample, moved by `change`."""
    points = np.unique(sample.points.astype(np.float64), axis=0)
    if len(points) < _FEWEST:
        raise UnusableModelError(f"{len(points)} different points, expected {_FEWEST} or more")
    colours = np.full((len(points), 4), 255, np.uint8)
    colours[:, :3] = _colours(sample, points)
    corners, normals = _rectangles(points if change is None else change(points))
    first = 4 * np.arange(len(corners))[:, None]
    faces = np.concatenate([first + corner for corner in (0, 1, 2, 0, 2, 3)], axis=1).reshape(-1, 3)
    material, uv = palette(colours.repeat(2, axis=0))
    return build_model(
        corners.reshape(-1, 3), faces, materials=(material,), uv=uv,
        normals=normals[:, None].repeat(6, axis=1).reshape(-1, 3, 3),
        category=sample.category, model_id=sample.model_id,
    )  # fmt: skip


def _rectangles(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The corners [n, 4, 3] of the surfels of points [n, 3], and their unit normals."""
    distance, nearest = scipy.spatial.cKDTree(points).query(points, k=_NEIGHBOURS + 1)
    around = points[nearest] - points[nearest].mean(axis=1, keepdims=True)
    # In ascending order: the normal, the short and the long axis.
    variances, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))
    ratio = np.sqrt(np.maximum(variances[:, 1], 0) / np.maximum(variances[:, 2], 1e-12))
    # A rectangle has the area of an ellipse with 2 / sqrt(pi) times its axes.
    reach = distance[:, _REACH] * np.sqrt(np.pi) / 2
    long = axes[:, :, 2] * reach[:, None]
    short = axes[:, :, 1] * (reach * np.clip(ratio, _THINNEST, 1))[:, None]
    offsets = np.stack([-long - short, long - short, long + short, short - long], 1)
    corners = points[:, None] + offsets
    # Surfels end at the ground and at radius 1.
    corners[..., 2] = np.maximum(corners[..., 2], 0)
    corners /= np.maximum(np.linalg.norm(corners, axis=2, keepdims=True), 1)
    return corners, _smoothed(axes[:, :, 0], nearest)


def _smoothed(normals: np.ndarray, nearest: np.ndarray) -> np.ndarray:
    """Mean normals [n, 3] of the nearest points, with the signs of the points' normals."""
    around = normals[nearest]
    around *= np.sign(np.einsum("nki,ni->nk", around, normals))[..., None]
    return unit_vectors(around.sum(axis=1))


def _colours(sample: Sample, points: np.ndarray) -> np.ndarray:
    """The colours of points, uint8 [n, 3]."""
    grey = np.full((len(points), 3), 150, np.uint8)
    if sample.depth is None:
        return grey
    inside = points @ sample.extrinsics[:, :3].T + sample.extrinsics[:, 3]
    depth = inside[:, 2]
    pixels = (inside @ sample.intrinsics[:2].T) / np.maximum(depth, 1e-6)[:, None]
    height, width = sample.mask.shape
    columns = np.clip(pixels[:, 0].astype(int), 0, width - 1)
    rows = np.clip(pixels[:, 1].astype(int), 0, height - 1)
    shown = sample.mask[rows, columns]
    shown &= np.abs(sample.depth[rows, columns] - depth) < _SHOWN
    if not shown.any():
        return grey
    _, nearest = scipy.spatial.cKDTree(points[shown]).query(points)
    return sample.image[rows, columns][shown][nearest]

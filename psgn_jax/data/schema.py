"""What one sample is: fields, shapes, dtypes, units and frames.

This module needs numpy alone, so the renderer (`data_gen`) shares it.

**Frame** (every data set, prediction and export): right-handed, +z up, +y to the image's right,
+x horizontally toward the camera, origin on the ground under the object. The unit of length is the
radius of the object's bounding hemisphere.

**Camera**: `extrinsics` [3,4] takes a point of that frame to the camera's, which is OpenCV's: x to
the right of the image, y down, z forward along the optical axis. `intrinsics` [3,3] takes it to
the image, `(column, row) = (K @ X)[:2] / (K @ X)[2]`.

**Pixels**: image coordinates are continuous with (0, 0) at the outer corner of the first pixel, so
pixel (row i, column j) covers [i, i+1) x [j, j+1) and its **centre is at (i + 0.5, j + 0.5)**. A
point falls into the pixel `floor(row), floor(column)`, and a resized image only scales the
intrinsics. (With the camera fitted to the authors' images, this reading puts the most points inside
the masks; shifted by half a pixel in either direction it is worse.)
"""

import dataclasses
import json
from typing import Any

import numpy as np

BACKGROUND_GREY = 191
"""Colour of all background pixels, as in the authors' images."""

OCCUPANCY_SIZE = 32
"""Edge of the occupancy grid in cells."""

_ROTATION_TOLERANCE = 1e-3

FIELDS = (
    "image",
    "mask",
    "depth",
    "points",
    "normals",
    "occupancy",
    "intrinsics",
    "extrinsics",
    "category",
    "model_id",
    "view",
    "source",
)
"""Names of a sample's fields, in order."""

OPTIONAL_FIELDS = ("depth", "normals", "occupancy")


class RecordError(ValueError):
    """A data set, a shard or a record that is missing, damaged or of another format."""

    exit_code = 2  # commands end with the message alone and this code


@dataclasses.dataclass(frozen=True, eq=False)
class Sample:
    """One image of an object and the object's surface.

    Attributes:
      image: uint8 [H, W, 3], RGB.
      mask: bool [H, W], True on the object.
      depth: float32 [H, W] along the optical axis, 0 = background, or not measured (a sensor's
        hole, where the mask is True); None where unknown.
      points: float32 [M, 3], points of the complete surface. Their order carries no meaning.
      normals: float32 [M, 3], outward unit normals of `points`, or None.
      occupancy: bool [32, 32, 32] indexed [x, y, z], or None. The grid covers
        [-1, 1] x [-1, 1] x [0, 2], cells cubes of 1/16.
      intrinsics: float32 [3, 3], pixels.
      extrinsics: float32 [3, 4], project frame to camera.
      category: name of the object's category, "" where unknown.
      model_id: name of the object in its source.
      view: number of the view of this object.
      source: where the sample comes from, such as "authors".
      extra: what else its maker knows of it, as a JSON object in text, "" = nothing. Not one of
        `FIELDS`: nothing in training reads it.
    """

    image: np.ndarray
    mask: np.ndarray
    points: np.ndarray
    intrinsics: np.ndarray
    extrinsics: np.ndarray
    depth: np.ndarray | None = None
    normals: np.ndarray | None = None
    occupancy: np.ndarray | None = None
    category: str = ""
    model_id: str = ""
    view: int = 0
    source: str = ""
    extra: str = ""


def _fail(field: str, got: Any, accepted: str) -> None:
    raise ValueError(f"sample field {field!r}: got {got}, expected {accepted}")


def _check_array(
    field: str, value: Any, dtype: type[np.generic], shape: tuple[int | None, ...]
) -> None:
    """Checks dtype and shape; a None in `shape` accepts any size of at least one."""
    expected = f"a numpy array {np.dtype(dtype).name} [{', '.join(str(s or 'n') for s in shape)}]"
    if not isinstance(value, np.ndarray):
        _fail(field, type(value).__name__, expected)
    if value.dtype != dtype or value.ndim != len(shape):
        _fail(field, f"{value.dtype.name} {list(value.shape)}", expected)
    for size, wanted in zip(value.shape, shape, strict=True):
        if size != wanted if wanted is not None else size < 1:
            _fail(field, f"{value.dtype.name} {list(value.shape)}", expected)


def _check_finite(field: str, value: np.ndarray, accepted: str = "finite values") -> None:
    if not np.isfinite(value).all():
        bad = int(np.size(value) - np.isfinite(value).sum())
        _fail(field, f"{bad} values that are not finite", accepted)


def validate(sample: Sample) -> Sample:
    """Checks every field of a sample and returns the sample.

    Raises:
      ValueError: names the first wrong field, what it holds and what is accepted.
    """
    _check_array("image", sample.image, np.uint8, (None, None, 3))
    size = sample.image.shape[:2]
    _check_array("mask", sample.mask, np.bool_, size)
    _check_array("points", sample.points, np.float32, (None, 3))
    _check_finite("points", sample.points)
    _check_array("intrinsics", sample.intrinsics, np.float32, (3, 3))
    _check_array("extrinsics", sample.extrinsics, np.float32, (3, 4))
    check_camera(sample.intrinsics, sample.extrinsics)
    if sample.depth is not None:
        _check_array("depth", sample.depth, np.float32, size)
        _check_finite("depth", sample.depth, "finite values, 0 where nothing was measured")
        if sample.depth.min() < 0:
            accepted = "0 (background, not measured) or more"
            _fail("depth", f"a minimum of {sample.depth.min():g}", accepted)
    if sample.normals is not None:
        _check_array("normals", sample.normals, np.float32, sample.points.shape)
        length = np.linalg.norm(sample.normals, axis=1)
        if not (np.abs(length - 1) < 1e-2).all():
            _fail("normals", f"lengths {length.min():g} to {length.max():g}", "unit vectors")
    if sample.occupancy is not None:
        _check_array("occupancy", sample.occupancy, np.bool_, (OCCUPANCY_SIZE,) * 3)
    for field in ("category", "model_id", "source", "extra"):
        if not isinstance(getattr(sample, field), str):
            _fail(field, repr(getattr(sample, field)), "a string")
    if sample.extra and not _is_json_object(sample.extra):
        _fail("extra", repr(sample.extra[:80]), "a JSON object in text, or nothing")
    if not isinstance(sample.view, int) or isinstance(sample.view, bool) or sample.view < 0:
        _fail("view", repr(sample.view), "an integer of 0 or more")
    return sample


def _is_json_object(text: str) -> bool:
    try:
        return isinstance(json.loads(text), dict)
    except ValueError:
        return False


def check_camera(intrinsics: np.ndarray, extrinsics: np.ndarray) -> None:
    """Checks that a camera is proper: finite, positive focal lengths, a right-handed rotation.

    Raises:
      ValueError: names `intrinsics` or `extrinsics` and what is wrong.
    """
    _check_finite("intrinsics", intrinsics)
    _check_finite("extrinsics", extrinsics)
    if intrinsics[0, 0] <= 0 or intrinsics[1, 1] <= 0 or abs(intrinsics[1, 0]) > 0:
        _fail(
            "intrinsics",
            intrinsics.tolist(),
            "[[fx, skew, cx], [0, fy, cy], [0, 0, 1]], fx and fy > 0",
        )
    if not np.array_equal(intrinsics[2], [0, 0, 1]):
        _fail("intrinsics", f"last row {intrinsics[2].tolist()}", "[0, 0, 1]")
    rotation = extrinsics[:, :3].astype(np.float64)
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > _ROTATION_TOLERANCE:
        _fail("extrinsics", rotation.tolist(), "a rotation in the first three columns")
    if np.linalg.det(rotation) < 0:
        _fail("extrinsics", "a mirroring (determinant -1)", "a right-handed rotation")

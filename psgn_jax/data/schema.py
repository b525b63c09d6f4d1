"""The definition of a sample: fields, shapes, dtypes, units and frames.

**Frame** (for data sets, predictions and exports): right-handed, +z up, +y to the right of the
image, +x horizontally toward the camera, origin on the ground under the object. The unit of length
is the radius of the object's bounding hemisphere.

**Camera**: `extrinsics` [3,4] maps a point from this frame to the frame of the camera, which is
OpenCV's: x to the right of the image, y down, z forward along the optical axis. `intrinsics` [3,3]
projects a point X of the camera frame to the image, `(column, row) = (K @ X)[:2] / (K @ X)[2]`.

**Pixels**: image coordinates are continuous, with (0, 0) at the outer corner of the first pixel.
Pixel (row i, column j) covers [i, i+1) x [j, j+1), and its **centre is at (i + 0.5, j + 0.5)**.
Resizing an image only scales the intrinsics. (In the authors' images, this convention puts more
points inside the masks than a shift by half a pixel in either direction.)
"""

import dataclasses
from typing import Any

import numpy as np

from psgn_jax.system.errors import UserError
from psgn_jax.system.untrusted import parse_json

BACKGROUND_GREY = 191
"""Grey level of all background pixels, as in the authors' images."""

OCCUPANCY_SIZE = 32
"""Number of cells along an edge of the occupancy grid."""

# Limits that bound the memory for a malicious record.
MAX_IMAGE_SIDE = 4096
MAX_POINTS = 1 << 22
MAX_LABEL = 1000  # characters of a category, the name of a model or a source
MAX_COORDINATE = 1e9  # of points and depths, units of the frame

_ROTATION_TOLERANCE = 1e-3
_LAST_VIEW = 2**31 - 1
SMALLEST_EXTENT = 1e-3  # in units; with a smaller extent, points are all in one place

FIELDS = (
    "image", "mask", "depth", "points", "occupancy",
    "intrinsics", "extrinsics", "category", "model_id", "view", "source",
)  # fmt: skip
"""Names of a sample's fields, in order."""

OPTIONAL_FIELDS = ("depth", "occupancy")


class RecordError(UserError):
    """A data set, a shard or a record is missing, damaged or of another format."""


@dataclasses.dataclass(frozen=True, eq=False)
class Sample:
    """One image of an object and the object's surface.

    Attributes:
      image: uint8 [H, W, 3], RGB.
      mask: bool [H, W], True on the object.
      depth: float32 [H, W] along the optical axis; 0 = background, or a hole of the sensor (where
        the mask is True). None if there is no depth map.
      points: float32 [M, 3] on the complete surface. Their order has no meaning.
      occupancy: bool [32, 32, 32] indexed [x, y, z], or None. The grid covers
        [-1, 1] x [-1, 1] x [0, 2]; a cell is a cube with an edge of 1/16.
      intrinsics: float32 [3, 3], in pixels.
      extrinsics: float32 [3, 4], from the project's frame to the camera's.
      category: name of the object's category, "" if unknown.
      model_id: name of the object in its source.
      view: number of the view of this object.
      source: the data set or program from which the sample comes, such as "authors".
      extra: the text of a JSON object with further information, "" = none. Training does not read
        this text, so `FIELDS` does not list `extra`.
    """

    image: np.ndarray
    mask: np.ndarray
    points: np.ndarray
    intrinsics: np.ndarray
    extrinsics: np.ndarray
    depth: np.ndarray | None = None
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
    """Checks dtype (in any byte order) and shape; None in `shape` accepts any size >= 1.

    Floats must be finite.
    """
    expected = f"a numpy array {np.dtype(dtype).name} [{', '.join(str(s or 'n') for s in shape)}]"
    # A subclass may mean something else, such as a masked array's elements that do not count.
    if type(value) not in (np.ndarray, np.memmap):
        _fail(field, type(value).__name__, expected)
    sizes = [wanted or max(size, 1) for size, wanted in zip(value.shape, shape, strict=False)]
    native = value.dtype.newbyteorder("=")
    if native != dtype or value.ndim != len(shape) or list(value.shape) != sizes:
        _fail(field, f"{value.dtype.name} {list(value.shape)}", expected)
    if value.dtype.kind == "f" and not np.isfinite(value).all():
        bad = int(value.size - np.isfinite(value).sum())
        _fail(field, f"{bad} values that are not finite", "finite values")


def validate(sample: Sample) -> Sample:
    """Checks and returns a sample; ValueError names the field, its value and what is expected."""
    _check_array("image", sample.image, np.uint8, (None, None, 3))
    size = sample.image.shape[:2]
    if max(size) > MAX_IMAGE_SIDE:
        _fail("image", f"{size[1]}x{size[0]} pixels", f"at most {MAX_IMAGE_SIDE} a side")
    _check_array("mask", sample.mask, np.bool_, size)
    _check_array("points", sample.points, np.float32, (None, 3))
    if len(sample.points) > MAX_POINTS or np.abs(sample.points).max() > MAX_COORDINATE:
        got = f"{len(sample.points)} points up to {np.abs(sample.points).max():g}"
        _fail("points", got, f"at most {MAX_POINTS}, and coordinates up to {MAX_COORDINATE:g}")
    _check_array("intrinsics", sample.intrinsics, np.float32, (3, 3))
    _check_array("extrinsics", sample.extrinsics, np.float32, (3, 4))
    check_camera(sample.intrinsics, sample.extrinsics)
    if sample.depth is not None:
        _check_array("depth", sample.depth, np.float32, size)
        low, high = sample.depth.min(), sample.depth.max()
        if low < 0 or high > MAX_COORDINATE:
            _fail("depth", f"{low:g} to {high:g}", f"0 (not measured) to {MAX_COORDINATE:g}")
    if sample.occupancy is not None:
        _check_array("occupancy", sample.occupancy, np.bool_, (OCCUPANCY_SIZE,) * 3)
    check_labels(sample)
    if sample.extra:
        try:
            is_object = isinstance(parse_json(sample.extra), dict)
        except ValueError:
            is_object = False
        if not is_object:
            _fail("extra", repr(sample.extra[:80]), "the text of a JSON object, or ''")
    return sample


def check_labels(sample: Any) -> None:
    """Checks the texts and the view of a `Sample` or an object with the same attributes."""
    for field in ("category", "model_id", "source", "extra"):
        if not isinstance(value := getattr(sample, field), str):
            _fail(field, repr(value)[:80], "a string")
        if field != "extra" and len(value) > MAX_LABEL:
            _fail(field, f"{len(value)} characters", f"at most {MAX_LABEL}")
        try:
            value.encode()
        except UnicodeEncodeError:
            _fail(field, ascii(value)[:80], "text that UTF-8 can encode")
    view = sample.view
    is_integer = isinstance(view, int | np.integer) and not isinstance(view, bool)
    if not is_integer or not 0 <= view <= _LAST_VIEW:
        _fail("view", repr(view)[:80], f"an integer from 0 to {_LAST_VIEW}")


def check_content(sample: Sample) -> None:
    """ValueError if a sample shows no object: an empty mask or volume, all points in one place."""
    if not sample.mask.any():
        raise ValueError("the mask is empty: no pixel shows the object")
    extent = float(np.ptp(sample.points, axis=0).max())
    if extent < SMALLEST_EXTENT:
        raise ValueError(f"all points are in one place: their extent is {extent:g} units")
    if sample.occupancy is not None and not sample.occupancy.any():
        raise ValueError("the volume is empty")


def check_camera(intrinsics: np.ndarray, extrinsics: np.ndarray) -> None:
    """ValueError unless a camera is finite, with focal lengths > 0 and a right-handed rotation."""
    for name, matrix in (("intrinsics", intrinsics), ("extrinsics", extrinsics)):
        if not np.isfinite(matrix).all():
            _fail(name, matrix.tolist(), "finite values")
    lower = [intrinsics[1, 0], *intrinsics[2]]
    if intrinsics[0, 0] <= 0 or intrinsics[1, 1] <= 0 or lower != [0, 0, 0, 1]:
        accepted = "[[fx, skew, cx], [0, fy, cy], [0, 0, 1]], fx and fy > 0"
        _fail("intrinsics", intrinsics.tolist(), accepted)
    rotation = extrinsics[:, :3].astype(np.float64)
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > _ROTATION_TOLERANCE:
        _fail("extrinsics", rotation.tolist(), "a rotation in the first three columns")
    if np.linalg.det(rotation) < 0:
        _fail("extrinsics", "a reflection (determinant -1)", "a right-handed rotation")

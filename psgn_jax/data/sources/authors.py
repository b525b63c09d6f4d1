"""Reads the authors' published training batches.

A file contains 32 samples as a zlib stream (not gzip, in spite of its name). The arrays are, in
this order:

    colour     uint8 [32, 192, 256, 3], BGR
    depth      uint16 [32, 192, 256], 0 = background
    rotation   float32 [32, 3, 3]
    points     uint8 [32, 16384, 3]
    other      uint16 [32, 1024, 4], not used here

The names of the models follow, separated by newlines. All models of a file belong to the same
split (`split_of`).

Records store the file's 8-bit coordinates of points and 16-bit codes of depth, so nothing is lost.
The camera is `camera.default_camera`, which was fitted to the silhouettes.
"""

import dataclasses
import pathlib
import zlib
from collections.abc import Iterator

import numpy as np

from psgn_jax.data import camera, schema
from psgn_jax.data.codec import DepthCodes, QuantisedPoints, encode

BATCH = 32
HEIGHT, WIDTH = camera.VIEW_SIZE
NUM_POINTS = 16384
TILT_DEGREES = 20.0

# Depth: z = 1.8 * (3 - 2 d / 65535) along the optical axis.
DEPTH_OFFSET = 5.4
DEPTH_SCALE = -camera.DISTANCE / 65535

_LAYOUT = (
    ("colour", np.dtype("<u1"), (BATCH, HEIGHT, WIDTH, 3)),
    ("depth", np.dtype("<u2"), (BATCH, HEIGHT, WIDTH)),
    ("rotation", np.dtype("<f4"), (BATCH, 3, 3)),
    ("points", np.dtype("<u1"), (BATCH, NUM_POINTS, 3)),
    ("other", np.dtype("<u2"), (BATCH, 1024, 4)),
)
_ARRAYS_SIZE = sum(dtype.itemsize * int(np.prod(shape)) for _, dtype, shape in _LAYOUT)
_MAX_KEY = 256
_MAX_SIZE = _ARRAYS_SIZE + BATCH * (_MAX_KEY + 1)  # of a file's content, with the names
# A valid file is at most as large as its content and the overhead of deflate.
_MAX_FILE_SIZE = _MAX_SIZE + (1 << 16)

# Maps p - (1, 0, 0), with p in the authors' target frame (down, right, toward the camera), to the
# project's frame: (x, y, z) = (p2, p1, 1 - p0).
_TO_PROJECT = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])


@dataclasses.dataclass(frozen=True, eq=False)
class ExactSample:
    """A sample with the integers that a record stores exactly."""

    sample: schema.Sample
    points: QuantisedPoints
    depth: DepthCodes

    def encode(self) -> bytes:
        return encode(self.sample, points=self.points, depth=self.depth)


TEST_FILES = ("48.gz", "49.gz")
"""Files of the test split: we train and choose nothing on them.

The authors have no test split, and we chose the recipes on files 15 and 31. This choice is
**ours**: we got these two files after all choices up to the weights small-3."""


def split_of(path: pathlib.Path, model_id: str) -> str:
    """The split of a model: test by its file, validation by the authors' rule, else train."""
    if path.name in TEST_FILES:
        return "test"
    return "validation" if model_id.startswith("f") else "train"


def _inflate(path: pathlib.Path) -> bytes:
    """Inflates a zlib file to at most `_MAX_SIZE` bytes."""
    size = path.stat().st_size
    if size > _MAX_FILE_SIZE:
        raise ValueError(f"{path}: {size} bytes, more than any file of this format has")
    stream = zlib.decompressobj()
    try:
        out = stream.decompress(path.read_bytes(), _MAX_SIZE + 1)
    except zlib.error as error:
        raise ValueError(f"{path}: not a zlib stream, or damaged ({error})") from None
    if len(out) > _MAX_SIZE:
        raise ValueError(
            f"{path}: inflates to more than {_MAX_SIZE} bytes, not a file of this format"
        )
    if not stream.eof:
        raise ValueError(f"{path}: truncated, the zlib stream has no end")
    if stream.unused_data:
        raise ValueError(f"{path}: bytes after the end of the zlib stream")
    return out


def _keys(data: bytes, path: pathlib.Path) -> list[str]:
    try:
        keys = data.decode("ascii").removesuffix("\n").split("\n")
    except UnicodeDecodeError:
        raise ValueError(f"{path}: the models' names are not ASCII") from None
    if len(keys) != BATCH or not all(k and k.isprintable() and len(k) <= _MAX_KEY for k in keys):
        raise ValueError(f"{path}: {len(keys)} names of models, expected {BATCH} printable ones")
    return keys


def matrix_of(rotation: np.ndarray) -> np.ndarray:
    """The affine map from 8-bit coordinates to the project's frame, float64 [3, 4].

    With the rotation R of the file and the tilt V of the camera,
    m = (points / 255 - (0.7, 0.5, 0.5)) / 0.4 are coordinates in the frame of the model, and
    m @ (R @ inv(V)) are coordinates in the authors' target frame minus (1, 0, 0).
    """
    cosine, sine = np.cos(np.deg2rad(TILT_DEGREES)), np.sin(np.deg2rad(TILT_DEGREES))
    tilt = np.array([[cosine, 0, -sine], [0, 1, 0], [sine, 0, cosine]])
    turn = _TO_PROJECT @ (rotation.astype(np.float64) @ np.linalg.inv(tilt)).T / 0.4
    return np.concatenate([turn / 255, turn @ [[-0.7], [-0.5], [-0.5]]], axis=1)


def read_batch(path: str | pathlib.Path) -> Iterator[ExactSample]:
    """Yields the 32 samples of a file after checking it; ValueError names the file and why."""
    path = pathlib.Path(path)
    data = _inflate(path)
    if len(data) <= _ARRAYS_SIZE:
        raise ValueError(f"{path}: inflates to {len(data)} bytes, expected over {_ARRAYS_SIZE}")
    arrays: dict[str, np.ndarray] = {}
    start = 0
    for name, dtype, shape in _LAYOUT:
        count = int(np.prod(shape))
        arrays[name] = np.frombuffer(data, dtype, count, start).reshape(shape)
        start += count * dtype.itemsize
    keys = _keys(data[start:], path)
    rotation = arrays["rotation"].astype(np.float64)
    if not np.isfinite(rotation).all():
        raise ValueError(f"{path}: a rotation is not finite, expected finite numbers")
    defect = np.abs(rotation @ rotation.transpose(0, 2, 1) - np.eye(3)).max()
    if defect > 1e-3 or (np.linalg.det(rotation) < 0).any():
        raise ValueError(
            f"{path}: a matrix is not a rotation (|R R^T - 1| up to {defect:.3g}), expected "
            "orthonormal matrices of determinant 1"
        )
    intrinsics, extrinsics = camera.default_camera((HEIGHT, WIDTH), tilt_degrees=TILT_DEGREES)

    for i, key in enumerate(keys):
        codes = arrays["depth"][i]
        mask = codes > 0
        points = QuantisedPoints(arrays["points"][i], matrix_of(rotation[i]))
        depth = DepthCodes(codes, mask, DEPTH_SCALE, DEPTH_OFFSET)
        sample = schema.Sample(
            image=np.ascontiguousarray(arrays["colour"][i, :, :, ::-1]),
            mask=mask,
            depth=depth.depth(),
            points=points.points(),
            intrinsics=intrinsics,
            extrinsics=extrinsics,
            model_id=key,
            source="authors",
        )
        yield ExactSample(sample, points, depth)

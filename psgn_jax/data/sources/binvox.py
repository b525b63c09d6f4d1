"""Reads binvox files in bounded memory.

A file begins with text lines: `#binvox 1`, `dim D D D`, optionally `translate X Y Z` and `scale S`,
and `data`. Pairs of bytes follow: a value (0 or 1) and a count (1 to 255). In the file **y runs
fastest, then z, then x**. Our arrays are indexed [x, y, z], along the axes of the voxelised model.

The grid is a cube with the edge `scale` and the lowest corner `translate`, in the coordinates of
the model. Cell (i, j, k) of a D^3 grid spans `translate + scale * [i, i+1] / D` along x, and so on.

Source: www.patrickmin.com/binvox/binvox.html.
"""

import dataclasses
import os
import pathlib

import numpy as np

from psgn_jax.data.schema import OCCUPANCY_SIZE
from psgn_jax.system.untrusted import size_of

_MAX_LINE = 256
_MAX_LINES = 16
_LENGTHS = {"dim": 3, "translate": 3, "scale": 1}  # numbers in a line of the header


@dataclasses.dataclass(frozen=True, eq=False)
class Grid:
    """A cube of voxels, in the coordinates of a model or of the world."""

    cells: np.ndarray  # bool [D, D, D] indexed [x, y, z], True inside the object
    low: np.ndarray  # float64 [3], lowest corner
    size: float  # edge of the cube

    @property
    def edge(self) -> float:
        return self.size / len(self.cells)


def read(path: str | os.PathLike[str], size: int = OCCUPANCY_SIZE) -> Grid:
    """Reads a file with `size`^3 cells; otherwise ValueError, with the file and the reason."""
    try:
        return _read(pathlib.Path(path), size)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def _read(path: pathlib.Path, dim: int) -> Grid:
    fields = {"translate": [0.0, 0.0, 0.0], "scale": [1.0]}
    size_of(path)
    with path.open("rb") as file:
        if not file.readline(_MAX_LINE).startswith(b"#binvox"):
            raise ValueError("not a binvox file, it does not begin with #binvox")
        for _ in range(_MAX_LINES):
            words = file.readline(_MAX_LINE).decode("ascii", "replace").split()
            if words == ["data"]:
                break
            shown = " ".join(words)[:60]
            if not words or len(words) != 1 + _LENGTHS.get(words[0], -1):
                raise ValueError(f"{shown!r} is not a line of a binvox header")
            try:
                fields[words[0]] = [float(word) for word in words[1:]]
            except ValueError:
                fields[words[0]] = [np.nan]
            if not np.isfinite(fields[words[0]]).all():
                raise ValueError(f"{shown!r}: expected finite numbers")
        else:
            raise ValueError("no line `data` in the header")
        if "dim" not in fields:
            raise ValueError("no line `dim` in the header")
        dims, (scale,) = fields["dim"], fields["scale"]
        if dims != [dim] * 3:
            raise ValueError(f"dim {dims}, expected {dim} cells per edge")
        # Every run has at least one cell, so more than 2 bytes per cell cannot be valid.
        raw = np.frombuffer(file.read(2 * dim**3 + 1), np.uint8)
    if len(raw) % 2:
        raise ValueError("cut off, or bytes after the end of the data")
    values, counts = raw[::2], raw[1::2]
    count = int(counts.sum(dtype=np.int64))
    if count != dim**3:
        what = "cut off" if count < dim**3 else "too long"
        raise ValueError(f"{what}, {count} of {dim**3} cells")
    if values.max() > 1:
        raise ValueError(f"a value of {values.max()}, expected 0 or 1")
    if not scale > 0:
        raise ValueError(f"scale {scale}, expected more than 0")
    solid = np.repeat(values.astype(np.bool_), counts).reshape(dim, dim, dim).transpose(0, 2, 1)
    return Grid(np.ascontiguousarray(solid), np.array(fields["translate"]), scale)

"""Reads (in bounded memory) and writes binvox files.

A file begins with a header of text lines: `#binvox 1`, `dim D D D`, optionally `translate X Y Z`
and `scale S`, and `data`. Pairs of bytes follow: a value (0 or 1) and a count (1 to 255). In the
file **y runs fastest, then z, then x**. Here arrays are indexed [x, y, z], along the axes of the
model that was voxelised.

The grid is a cube with the edge `scale` and the lowest corner `translate`, in the coordinates of
the model. Cell (i, j, k) of a D^3 grid spans `translate + scale * [i, i+1] / D` along x, and so on.

Source: www.patrickmin.com/binvox/binvox.html.
"""

import dataclasses
import os
import pathlib

import numpy as np

MAX_DIM = 256
_MAX_LINE = 256
_MAX_LINES = 16


@dataclasses.dataclass(frozen=True, eq=False)
class Binvox:
    """A voxelised model.

    Attributes:
      solid: bool [D, D, D] indexed [x, y, z].
      translate: float64 [3], lowest corner of the grid in the coordinates of the model.
      scale: edge of the grid in the unit of the model.
    """

    solid: np.ndarray
    translate: np.ndarray
    scale: float


def read(path: str | os.PathLike[str], *, max_dim: int = MAX_DIM) -> Binvox:
    """Reads a file; `max_dim` bounds the memory for any content.

    Raises:
      ValueError: the file is not binvox, its header is invalid, its grid is not a cube or is larger
        than `max_dim`, or its runs do not add up to the grid (it is cut off); the message names the
        file and the reason.
      OSError: the file cannot be read.
    """
    path = pathlib.Path(path)
    with path.open("rb") as file:
        if not file.readline(_MAX_LINE).startswith(b"#binvox"):
            raise ValueError(f"{path}: not a binvox file, it does not begin with #binvox")
        fields: dict[str, list[float]] = {}
        for _ in range(_MAX_LINES):
            line = file.readline(_MAX_LINE)
            words = line.decode("ascii", "replace").split()
            if words == ["data"]:
                break
            fields |= _header_line(words, path)
        else:
            raise ValueError(f"{path}: no line `data` in the header")
        if "dim" not in fields:
            raise ValueError(f"{path}: no line `dim` in the header")
        dims = fields["dim"]
        dim = int(dims[0])
        if len(set(dims)) > 1 or dim != dims[0] or not 1 <= dim <= max_dim:
            raise ValueError(
                f"{path}: dim {dims}, expected a cube of 1 to {max_dim} cells per edge"
            )
        total = dim**3
        # Every run has at least one cell, so more than 2 bytes per cell cannot be valid.
        raw = np.frombuffer(file.read(2 * total + 1), np.uint8)
    if len(raw) % 2:
        raise ValueError(f"{path}: cut off, or bytes after the end of the data")
    values, counts = raw[::2], raw[1::2]
    count = int(counts.sum(dtype=np.int64))
    if count != total:
        what = "cut off" if count < total else "too long"
        raise ValueError(f"{path}: {what}, {count} of {total} cells")
    if values.size and values.max() > 1:
        raise ValueError(f"{path}: a value of {values.max()}, expected 0 or 1")
    solid = np.repeat(values.astype(np.bool_), counts).reshape(dim, dim, dim).transpose(0, 2, 1)
    scale = fields.get("scale", [1.0])[0]
    if not scale > 0:
        raise ValueError(f"{path}: scale {scale}, expected more than 0")
    translate = np.array(fields.get("translate", [0.0, 0.0, 0.0]))
    return Binvox(np.ascontiguousarray(solid), translate, scale)


def write(path: str | os.PathLike[str], grid: Binvox) -> None:
    """Writes a file; `read` returns the same grid, with numbers to 17 digits.

    Raises:
      ValueError: `grid.solid` is not a boolean cube.
    """
    solid = grid.solid
    if solid.dtype != np.bool_ or solid.ndim != 3 or len(set(solid.shape)) != 1:
        raise ValueError(f"solid: got {solid.dtype} {list(solid.shape)}, expected bool [D, D, D]")
    dim = solid.shape[0]
    flat = solid.transpose(0, 2, 1).reshape(-1)
    edges = np.concatenate([[0], np.flatnonzero(flat[1:] != flat[:-1]) + 1, [flat.size]])
    lengths = np.diff(edges)
    pieces = -(-lengths // 255)
    counts = np.full(pieces.sum(), 255)
    counts[np.cumsum(pieces) - 1] = lengths - 255 * (pieces - 1)
    values = np.repeat(flat[edges[:-1]], pieces)
    translate = " ".join(f"{float(t):.17g}" for t in grid.translate)
    header = f"#binvox 1\ndim {dim} {dim} {dim}\ntranslate {translate}\nscale {grid.scale:.17g}\n"
    data = np.stack([values, counts], axis=1).astype(np.uint8).tobytes()
    pathlib.Path(path).write_bytes(header.encode() + b"data\n" + data)


def _header_line(words: list[str], path: pathlib.Path) -> dict[str, list[float]]:
    lengths = {"dim": 3, "translate": 3, "scale": 1}
    shown = " ".join(words)[:60]
    if not words or words[0] not in lengths or len(words) != 1 + lengths[words[0]]:
        raise ValueError(f"{path}: {shown!r} is not a line of a binvox header")
    try:
        numbers = [float(word) for word in words[1:]]
    except ValueError:
        numbers = [np.nan]
    if not np.isfinite(numbers).all():
        raise ValueError(f"{path}: {shown!r}: expected finite numbers")
    return {words[0]: numbers}

"""The files of a prediction: clouds as PLY, XYZ, OBJ and GLB; all arrays as NPZ, read again.

All files are in the project's frame (`data.schema`): right-handed, **+z up**, +y to the right of
the image, +x toward the camera, origin on the ground, unit = radius of the bounding hemisphere.
Only in GLB +y points up, as its standard says. If y points up in your program, as in many OBJ
viewers, rotate the other formats by -90 degrees about x.
"""

import io
import json
import math
import os
import zipfile
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from psgn_jax.data import schema
from psgn_jax.system.errors import UserError
from psgn_jax.system.untrusted import kind_of, one_line, read_npz

VERSION = 1
"""Version of the NPZ and JSON files of a prediction."""

_FRAME = "frame: right-handed, +z up, +y image right, +x to the camera; unit: bounding hemisphere"


def ply(points: np.ndarray, colours: np.ndarray) -> bytes:
    """Binary little-endian PLY: float x, y, z and uchar red, green, blue of each vertex."""
    head = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment {_FRAME}",
        f"element vertex {len(points)}",
        *(f"property float {name}" for name in "xyz"),
        *(f"property uchar {name}" for name in ("red", "green", "blue")),
        "end_header",
    ]
    rows = np.empty(len(points), [("point", "<f4", 3), ("colour", "u1", 3)])
    rows["point"], rows["colour"] = points, colours
    return ("\n".join(head) + "\n").encode() + rows.tobytes()


def xyz(points: np.ndarray, colours: np.ndarray | None = None) -> bytes:
    """A line `x y z` for each point, without header or colours; most programs read this."""
    return "".join(f"{x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in points.tolist()).encode()


def obj(points: np.ndarray, colours: np.ndarray) -> bytes:
    """OBJ: `v x y z r g b` (colours in [0, 1]), and a `p` element so that viewers show points."""
    lines = [f"# {_FRAME}"]
    for (x, y, z), (r, g, b) in zip(points.tolist(), (colours / 255).tolist(), strict=True):
        lines.append(f"v {x:.6f} {y:.6f} {z:.6f} {r:.4f} {g:.4f} {b:.4f}")
    lines.append("p " + " ".join(map(str, range(1, len(points) + 1))))
    return ("\n".join(lines) + "\n").encode()


def glb(points: np.ndarray, colours: np.ndarray) -> bytes:
    """Binary glTF 2.0 with one primitive of points; +y points up, so (x, y, z) -> (y, z, x)."""
    turned = np.ascontiguousarray(points[:, [1, 2, 0]], "<f4")
    encoded = colours / 255  # sRGB; the colours of glTF are linear
    linear = np.where(encoded > 0.04045, ((encoded + 0.055) / 1.055) ** 2.4, encoded / 12.92)
    binary = turned.tobytes() + linear.astype("<f4").tobytes()
    bounds = {"min": turned.min(axis=0).tolist(), "max": turned.max(axis=0).tolist()}
    count, length = len(points), turned.nbytes
    document = {
        "asset": {"version": "2.0", "generator": "psgn_jax"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}, "mode": 0}]}],
        "buffers": [{"byteLength": len(binary)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": length},
            {"buffer": 0, "byteOffset": length, "byteLength": length},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3", **bounds},
            {"bufferView": 1, "componentType": 5126, "count": count, "type": "VEC3"},
        ],
    }
    text = json.dumps(document).encode()
    chunks = [(b"JSON", text + b" " * (-len(text) % 4)), (b"BIN\0", binary)]
    body = b"".join(len(data).to_bytes(4, "little") + kind + data for kind, data in chunks)
    return b"glTF" + np.array([2, 12 + len(body)], "<u4").tobytes() + body


MAKERS: Mapping[str, Callable[[np.ndarray, np.ndarray], bytes]]
MAKERS = {"ply": ply, "xyz": xyz, "obj": obj, "glb": glb}
FORMATS = (*MAKERS, "npz")
DEFAULT_FORMATS = ("ply", "xyz", "obj", "npz")


def npz(arrays: Mapping[str, np.ndarray]) -> bytes:
    """All arrays of a prediction, which `read_prediction` reads."""
    np.savez(stream := io.BytesIO(), allow_pickle=False, version=np.int32(VERSION), **arrays)
    return stream.getvalue()


# --- Reading ------------------------------------------------------------------------------------

# Type and shape of each field; a letter stands for any size, the same in all fields.
_FIELDS = {
    "points": ("f", "kn3"), "colours": ("uint8", "kn3"), "seen": ("bool", "kn"),
    "branch": ("uint8", "n"), "spread": ("f", "kn"), "image": ("uint8", "hw3"),
    "photo": ("uint8", "ab3"), "intrinsics": ("f", "33"), "extrinsics": ("f", "34"),
    "to_view": ("f", "33"),
}  # fmt: skip
_OPTIONAL = ("spread",)  # a network without a random input has none
MOST_CLOUDS = 64
_LARGEST = {"k": MOST_CLOUDS, "n": 1 << 18, "h": 2048, "w": 2048, "a": 2048, "b": 2048}
_MOST_NUMBERS = 1 << 24  # in one array


class PredictionFileError(UserError):
    """A file is not a prediction, or is damaged."""


def read_prediction(path: str | os.PathLike[str], fields: Sequence[str]) -> dict[str, np.ndarray]:
    """The arrays `fields` of a prediction, and `spread` if it has one; nothing is unpickled.

    Raises:
      PredictionFileError: the file is missing, of another kind or damaged.
    """
    shown = one_line(path)
    try:
        if kind_of(path) is None and not zipfile.is_zipfile(path):
            raise ValueError("expected a file NAME.npz of `psgn predict`")
        limits = {
            name: min(_MOST_NUMBERS, math.prod(_LARGEST.get(c) or int(c) for c in _FIELDS[name][1]))
            for name in (*fields, *_OPTIONAL)
        }
        arrays = read_npz(path, {**limits, "version": 1})
        if (version := arrays.pop("version", VERSION)) != VERSION:
            raise ValueError(
                f"it was made by a later version of psgn_jax: its version is {version}, this one "
                f"reads {VERSION}; predict again, or use a newer psgn_jax"
            )
        _check(arrays, [*fields, *(name for name in _OPTIONAL if name in arrays)])
    except OSError as error:
        raise PredictionFileError(f"{shown}: {error.strerror or error}") from None
    except ValueError as error:
        why = one_line(error)[:160]
        raise PredictionFileError(f"{shown} cannot be read as a prediction: {why}") from None
    return arrays


def _check(arrays: dict[str, np.ndarray], fields: Sequence[str]) -> None:
    """Raises a `ValueError` if arrays are not a prediction; converts numbers to float32."""
    sizes = {str(digit): digit for digit in range(10)}
    for name in fields:
        if name not in arrays:
            raise ValueError(f"it has no array {name!r}")
        array, (kind, letters) = arrays[name], _FIELDS[name]
        fits = array.ndim == len(letters) and all(
            0 < n <= _LARGEST.get(a, n) and sizes.setdefault(a, n) == n
            for a, n in zip(letters, array.shape, strict=True)
        )
        if not fits or kind not in (array.dtype.kind, array.dtype.name):
            most = ", ".join(f"{a} up to {_LARGEST[a]}" for a in letters if a in _LARGEST)
            raise ValueError(
                f"{name} is {array.dtype} {list(array.shape)}, expected "
                f"{'float' if kind == 'f' else kind} [{', '.join(letters)}]"
                + (f" with {most}" if most else "")
            )
        if kind == "f":
            arrays[name] = array.astype(np.float32)
            if not np.isfinite(arrays[name]).all():
                raise ValueError(f"{name} is not finite")
    if "branch" in fields and arrays["branch"].max() > 1:
        raise ValueError(f"branch is {arrays['branch'].max()}, expected 0 or 1")
    if "to_view" in fields:
        (across, *rest), (skew, down, _), last = arrays["to_view"].tolist()
        bounded = 1e-3 < across < 1e3 and 1e-3 < down < 1e3
        if not bounded or [rest[0], skew, *last] != [0, 0, 0, 0, 1]:
            raise ValueError("to_view is no scale and shift")
    if {"intrinsics", "extrinsics"} <= set(fields):
        schema.check_camera(arrays["intrinsics"], arrays["extrinsics"])

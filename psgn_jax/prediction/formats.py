"""Files of a cloud: functions from points and colours to bytes.

All formats use the project's frame (`data.schema`): right-handed, **+z up**, +y to the right of the
image, +x toward the camera, origin on the ground, unit = radius of the bounding hemisphere. Only in
GLB +y points up, as its standard says. In programs in which y points up (many OBJ viewers), rotate
the other formats by -90 degrees about x.
"""

import io
import json
from collections.abc import Callable, Mapping

import numpy as np

from psgn_jax.viewing.predictions import VERSION

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
    """A line `x y z` for each point, without header or colours; most programs can read this."""
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
    opaque = np.column_stack([colours, np.full(len(colours), 255)]).astype(np.uint8)  # 4 bytes each
    binary = turned.tobytes() + opaque.tobytes()
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
            {"buffer": 0, "byteOffset": length, "byteLength": opaque.nbytes},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": count, "type": "VEC3", **bounds},
            {"bufferView": 1, "componentType": 5121, "count": count, "type": "VEC4"}
            | {"normalized": True},
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
    """An NPZ file with arrays by name, and the `version` of the format."""
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, version=np.int32(VERSION), **arrays)
    return buffer.getvalue()

"""Reads the surfaces of `psgn predict --surface`, NAME_surface.glb, for a page.

The file may come from anywhere, so its size and all its numbers are checked.
"""

import io
import pathlib
from typing import NamedTuple

import numpy as np
from PIL import Image

from psgn_jax.system.errors import UserError
from psgn_jax.system.untrusted import brief, message_line, one_line, parse_json, size_of

_MOST_BYTES, _MOST_VERTICES, _MOST_FACES, _MOST_PIXELS = 16 << 20, (1 << 16) - 1, 1 << 17, 2048
_TYPES = {5123: "<u2", 5125: "<u4", 5126: "<f4"}


class SurfaceFileError(UserError):
    """A file is not a surface of `psgn predict`, or is damaged."""


class TexturedMesh(NamedTuple):
    """A textured mesh in the frame of the points."""

    vertices: np.ndarray  # float32 [v, 3]
    normals: np.ndarray  # float32 [v, 3]
    uv: np.ndarray  # float32 [v, 2]; (0, 0) is the upper left corner of the texture
    faces: np.ndarray  # [f, 3], indices of vertices
    texture: np.ndarray  # uint8 [h, w, 3]


def read_surface(path: pathlib.Path) -> TexturedMesh:
    """The surface of a prediction's cloud, in the cloud's unit.

    A file in metres states the length of that unit (`unit` in the `extras` of its mesh).

    Raises:
      SurfaceFileError: the file is missing, of another kind or damaged.
    """
    try:
        if (size := size_of(path)) > _MOST_BYTES:
            raise ValueError(f"{size} bytes, expected at most {_MOST_BYTES}")
        return _parse(path.read_bytes())
    except Exception as error:  # damaged files raise errors of any type
        why = brief(message_line(error))
        raise SurfaceFileError(f"{one_line(path)} cannot be read as a surface: {why}") from None


def _parse(content: bytes) -> TexturedMesh:
    end = 20 + int.from_bytes(content[12:16], "little")
    marks = content[:4], content[16:20], content[end + 4 : end + 8]
    if marks != (b"glTF", b"JSON", b"BIN\0"):
        raise ValueError("expected a binary glTF file (.glb) with one buffer")
    document, binary = parse_json(content[20:end]), content[end + 8 :]

    def array(index: int, columns: int, most: int) -> np.ndarray:
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        if not 0 < (count := accessor["count"]) <= most:
            raise ValueError(f"{count} elements, expected 1 to {most}")
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        kind = _TYPES[accessor["componentType"]]
        return np.frombuffer(binary, kind, count * columns, start).reshape(count, columns)

    mesh = document["meshes"][0]
    part, unit = mesh["primitives"][0], mesh.get("extras", {}).get("unit", 1)
    vertices, normals, uv = (
        array(part["attributes"][name], columns, _MOST_VERTICES).astype(np.float32)
        for name, columns in (("POSITION", 3), ("NORMAL", 3), ("TEXCOORD_0", 2))
    )
    faces = array(part["indices"], 1, 3 * _MOST_FACES).reshape(-1, 3)
    if faces.dtype.kind != "u" or not len(vertices) == len(normals) == len(uv) > faces.max():
        raise ValueError(f"face with vertex {faces.max()}, expected less than {len(vertices)}")
    if not 1e-9 < unit < 1e9 or not all((np.abs(a) < 1e7).all() for a in (vertices, normals, uv)):
        raise ValueError("numbers that are not finite or above 1e7, or no unit")
    vertices /= np.float32(unit)
    view = document["bufferViews"][document["images"][0]["bufferView"]]
    picture = io.BytesIO(binary[view.get("byteOffset", 0) :][: view["byteLength"]])
    with Image.open(picture, formats=("JPEG", "PNG")) as image:
        if max(image.size) > _MOST_PIXELS:
            raise ValueError(f"texture {image.size}, expected at most {_MOST_PIXELS} pixels a side")
        texture = np.asarray(image.convert("RGB"))
    # In the file, y points up.
    return TexturedMesh(vertices[:, [2, 0, 1]], normals[:, [2, 0, 1]], uv, faces, texture)

"""Small glTF files, made from arrays."""

import base64
import json
import struct

import numpy as np

_CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], "f4")
TWO = np.array([0, 1, 2, 2, 1, 3], "u2")
CORNERS = np.array([[0, 1], [1, 1], [0, 0], [1, 0]], "f4")  # texture coordinates of the square


class Gltf:
    """The JSON of a file, and its buffer 0."""

    def __init__(self, **fields):
        self.json = {
            "asset": {"version": "2.0"}, "buffers": [{}], "bufferViews": [], "accessors": [],
        }  # fmt: skip
        self.json |= fields
        self.data = b""

    def bytes(self, data, **fields):
        """A new buffer view; returns its number."""
        self.data += bytes(-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **fields}
        self.data += data
        self.json["bufferViews"].append(view)
        return len(self.json["bufferViews"]) - 1

    def array(self, values, **fields):
        """A new accessor; returns its number."""
        values = np.asarray(values)
        values = values.astype("f4") if values.dtype == "f8" else values
        width = values.shape[1] if values.ndim == 2 else 1
        self.json["accessors"].append({
            "bufferView": self.bytes(values.tobytes()),
            "componentType": _CODES[values.dtype.str[1:]],
            "count": len(values), "type": _TYPES[width], **fields,
        })  # fmt: skip
        return len(self.json["accessors"]) - 1

    def square(self, indices=TWO, positions=SQUARE, **attributes):
        """A primitive of two triangles; `attributes` are arrays or numbers of accessors."""
        given = {"POSITION": positions, **attributes}
        given = {k: v if isinstance(v, int) else self.array(v) for k, v in given.items()}
        part = {"attributes": given}
        return part if indices is None else part | {"indices": self.array(indices)}

    def show(self, *meshes, **node):
        """Adds meshes, each a list of primitives in a node of its own; returns the file."""
        first = len(self.json.setdefault("meshes", []))
        self.json["meshes"] += [{"primitives": parts} for parts in meshes]
        nodes = self.json.setdefault("nodes", [])
        nodes.extend({"mesh": first + k, **node} for k in range(len(meshes)))
        return self

    def image(self, data, kind="image/png", **sampler):
        """Adds an image with its texture; returns the number of the texture."""
        images = self.json.setdefault("images", [])
        images.append({"bufferView": self.bytes(data), "mimeType": kind})
        samplers = self.json.setdefault("samplers", [])
        samplers.append(sampler)
        textures = self.json.setdefault("textures", [])
        textures.append({"source": len(images) - 1, "sampler": len(samplers) - 1})
        return len(textures) - 1

    def text(self, uri=None):
        """The file with its buffer in a data URI, or in the file `uri`."""
        inside = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        buffers = [{"uri": uri or inside, "byteLength": len(self.data)}, *self.json["buffers"][1:]]
        return json.dumps({**self.json, "buffers": buffers})

    def glb(self, fill=b" "):
        buffers = [{"byteLength": len(self.data)}, *self.json["buffers"][1:]]
        text = json.dumps({**self.json, "buffers": buffers}).encode()
        chunks = b""
        for kind, data, pad in ((b"JSON", text, fill), (b"BIN\0", self.data, b"\0")):
            data += pad * (4 - len(data) % 4)
            chunks += struct.pack("<I4s", len(data), kind) + data
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

"""The JSON, buffers, images and accessors of a glTF file."""

import binascii
import functools
import json
import struct
import urllib.parse
from collections.abc import Sequence
from typing import Any

import numpy as np

from data_gen.readers.model_files import DamagedError
from data_gen.readers.textures import Assets
from psgn_jax.system.untrusted import parse_json

DRACO = "KHR_draco_mesh_compression"
MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_EXPECTED = {int: "a whole number from 0", float: "a number", str: "a text", list: "a list"}


def _is(value: Any, kind: type) -> bool:
    """Whether a value of the JSON has a type of `_EXPECTED`."""
    if kind in (str, list):
        return isinstance(value, kind)
    number = type(value) in (int, float) and -1e38 <= value <= 1e38
    return number and (kind is float or (0 <= value < 1 << 53 and value == int(value)))


class Object:
    """An object of the JSON at a path such as `nodes[3]`. Errors name the path of a wrong field."""

    def __init__(self, fields: Any, path: str = "", index: int = -1) -> None:
        if not isinstance(fields, dict):
            raise DamagedError(f"{path or 'its JSON'} is not an object")
        self.fields, self.path, self.index = fields, path, index

    def __contains__(self, key: str) -> bool:
        return key in self.fields

    def _at(self, key: str) -> str:
        return f"{self.path}.{key}".lstrip(".")

    def _wrong(self, key: str, value: Any, expected: str) -> DamagedError:
        got = "nothing" if value is None else repr(value)[:40]
        return DamagedError(f"{self._at(key)}: got {got}, expected {expected}")

    def get(self, key: str, default: Any) -> Any:
        """A field of the default's type. If the default is a type, the field is required."""
        kind = default if isinstance(default, type) else type(default)
        if key not in self and kind is not default:
            return default
        value = self.fields.get(key)
        if not _is(value, kind):
            raise self._wrong(key, value, _EXPECTED[kind])
        return value if isinstance(value, kind) else kind(value)

    def values(self, key: str, kind: type) -> list[Any]:
        """A list of values of one type; [] if the field is missing."""
        found = self.get(key, [])
        if not all(_is(value, kind) for value in found):
            raise self._wrong(key, found, f"a list, each item {_EXPECTED[kind]}")
        return [kind(value) for value in found]

    def numbers(self, key: str, default: Sequence[float]) -> np.ndarray:
        """A list of as many numbers as the default has."""
        found = self.fields.get(key, default)
        right = isinstance(found, list) and len(found) == len(default)
        if not (right and all(_is(value, float) for value in found)):
            raise self._wrong(key, found, f"{len(default)} numbers")
        return np.array(found, np.float64)

    def object(self, key: str) -> "Object":
        """The object in a field; an empty object if the field is missing."""
        return Object(self.fields.get(key, {}), self._at(key))

    def extension(self, name: str) -> "Object | None":
        found = self.object("extensions")
        return found.object(name) if name in found else None

    def item(self, key: str, index: int) -> "Object":
        """An object of a list, which knows its index."""
        found = self.get(key, [])
        path = f"{self._at(key)}[{index}]"
        if index >= len(found):
            raise DamagedError(f"{path} does not exist, there are {len(found)}")
        return Object(found[index], path, index)

    def items(self, key: str) -> list["Object"]:
        return [self.item(key, index) for index in range(len(self.get(key, [])))]


def _json_and_chunk(data: bytes) -> tuple[Any, memoryview | None]:
    """The JSON of a file, and the binary chunk of a GLB. We ignore what follows."""
    text, chunk = memoryview(data), None
    if data[:4] == b"glTF":
        version, length = struct.unpack("<4xI4xI", data[:16].ljust(16))
        if version != 2:
            raise DamagedError(f"glTF {version}, expected 2.0")
        text, rest = text[20 : 20 + length], text[20 + length :]
        size = int.from_bytes(rest[:4], "little")
        if rest[4:8] == b"BIN\0":
            chunk = rest[8 : 8 + size]
        if len(text) < length or (chunk is not None and len(chunk) < size):
            what = f"a chunk ends after the last of its {len(data)} bytes"
            raise DamagedError(f"the file is cut: {what}")
    try:
        letters = bytes(text).rstrip(b"\0").decode("utf-8-sig", "replace")  # some pad with zeros
        return parse_json(letters, max_depth=64), chunk
    except json.JSONDecodeError as error:
        where = f"line {error.lineno}, column {error.colno}"
        raise DamagedError(f"its JSON is damaged in {where}") from None
    except ValueError as error:
        raise DamagedError(f"its JSON: {error}") from None


def as_floats(numbers: np.ndarray, normalised: bool) -> np.ndarray:
    """Numbers as float64; normalised integers from -1 or 0 to 1."""
    result = numbers.astype(np.float64)
    if normalised and numbers.dtype.kind != "f":
        result = np.maximum(result / np.iinfo(numbers.dtype).max, -1)
    return result


class Document:
    """A glTF file: its JSON `root`, and its buffers, loaded on first use."""

    def __init__(self, data: bytes, assets: Assets) -> None:
        tree, self._chunk = _json_and_chunk(data)
        self.root, self.assets = Object(tree), assets
        self._buffers: dict[int, memoryview] = {}
        version = self.root.object("asset").get("version", "without asset.version")
        if version.split(".")[0] != "2":
            raise DamagedError(f"glTF {version}, expected 2.0")

    def _contents(self, uri: str) -> bytes:
        """The data in a URI, or the content of the file that the URI names."""
        head, comma, text = uri.lstrip().partition(",")
        if comma and head[:5].lower() == "data:":
            self.assets.budget.charge(made=2 * len(text))
            raw = urllib.parse.unquote_to_bytes(text)
            try:
                return binascii.a2b_base64(raw + b"==") if head.lower().endswith(";base64") else raw
            except binascii.Error:
                raise DamagedError("the base64 text of a data URI is damaged") from None
        return self.assets.open(uri)

    def _buffer(self, index: int) -> memoryview:
        fields = self.root.item("buffers", index)
        if index in self._buffers:
            return self._buffers[index]
        if "uri" not in fields:
            if index or self._chunk is None:
                raise DamagedError(f"{fields.path} has neither a uri nor a binary chunk")
            return self._chunk
        self._buffers[index] = memoryview(self._contents(fields.get("uri", str)))
        return self._buffers[index]

    def view(self, index: int) -> memoryview:
        """The bytes of a buffer view, decompressed."""
        fields = self.root.item("bufferViews", index)
        packed = next((x for x in map(fields.extension, MESHOPT) if x), None)
        number = fields.get("buffer", int)
        if "uri" in self.root.item("buffers", number) or (number == 0 and self._chunk is not None):
            packed = None  # there is an uncompressed copy
        span = packed or fields
        data, start = self._buffer(span.get("buffer", int)), span.get("byteOffset", 0)
        stop = start + span.get("byteLength", int)
        if stop > len(data):
            raise DamagedError(f"{span.path} ends at byte {stop} of a buffer of {len(data)}")
        if not packed:
            return data[start:stop]
        made = packed.get("count", int) * packed.get("byteStride", int)
        self.assets.budget.charge(made=2 * made)
        return _by_meshopt(packed, data[start:stop])

    def image(self, fields: Object) -> bytes:
        if "bufferView" in fields:
            return bytes(self.view(fields.get("bufferView", int)))
        return self._contents(fields.get("uri", str))

    def _rows(self, start: Object, kind: Object, shape: tuple[int, int], stride: int) -> np.ndarray:
        """Numbers of the type in `kind`, from the buffer view and the offset in `start`."""
        code = _COMPONENTS.get(kind.get("componentType", int))
        if code is None:
            raise DamagedError(f"{kind.path} has an unknown componentType")
        dtype, (count, columns) = np.dtype(code), shape
        size = dtype.itemsize * columns
        if "bufferView" not in start:
            self.assets.budget.charge(made=count * size)
            return np.zeros(shape, dtype)
        data, first = self.view(start.get("bufferView", int)), start.get("byteOffset", 0)
        stride = stride or size
        if count and (stride < size or first + stride * (count - 1) + size > len(data)):
            raise DamagedError(f"{start.path} has more numbers than its buffer view")
        return np.ndarray(shape, dtype, data, first if count else 0, (stride, dtype.itemsize))

    def accessor(self, index: int, *widths: int) -> tuple[np.ndarray, bool]:
        """The numbers [count, columns] of an accessor, and whether they are normalised."""
        fields = self.root.item("accessors", index)
        columns, count = _COLUMNS.get(fields.get("type", str), 0), fields.get("count", int)
        if columns not in widths:
            raise DamagedError(f"{fields.path} has the wrong type {fields.get('type', str)[:20]!r}")
        stride = 0
        if "bufferView" in fields:
            view = self.root.item("bufferViews", fields.get("bufferView", int))
            stride = view.get("byteStride", 0)
        values = self._rows(fields, fields, (count, columns), stride)
        if "sparse" in fields:
            sparse = fields.object("sparse")
            rows, number = sparse.object("indices"), sparse.get("count", int)
            changed = self._rows(rows, rows, (number, 1), 0)[:, 0]
            if changed.dtype.kind != "u" or (number and changed.max() >= count):
                raise DamagedError(f"{rows.path} has rows that the accessor lacks")
            self.assets.budget.charge(made=values.nbytes)
            values = values.copy()
            values[changed] = self._rows(sparse.object("values"), fields, (number, columns), 0)
        return values, bool(fields.fields.get("normalized"))


# --- Compression: each package is optional ------------------------------------------------------

_NEEDED = "it needs {}: `pip install 'psgn-jax[gltf]'`"


def by_draco(packed: Object, data: memoryview) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The corners of the faces [3 f], and the attributes of a primitive."""
    try:
        import DracoPy
    except ImportError:
        raise DamagedError(_NEEDED.format(DRACO)) from None
    attributes = packed.object("attributes")
    names = {name: attributes.get(name, int) for name in attributes.fields}
    try:
        found: Any = DracoPy.decode(bytes(data))
        own = {k: np.asarray(found.get_attribute_by_unique_id(n)["data"]) for k, n in names.items()}
        return np.asarray(found.faces).ravel(), own
    except Exception:  # damaged data raise errors of any type
        raise DamagedError(f"{packed.path} is damaged") from None


_FILTERS = {
    "NONE": ("", range(257)),
    "OCTAHEDRAL": ("oct", (4, 8)),
    "QUATERNION": ("quat", (8,)),
    "EXPONENTIAL": ("exp", range(4, 257, 4)),
}
"""The filters: name in the package and possible strides."""


def _by_meshopt(packed: Object, data: memoryview) -> memoryview:
    """The decompressed bytes of a buffer view."""
    try:
        import meshoptimizer
    except ImportError:
        raise DamagedError(_NEEDED.format(MESHOPT[0])) from None
    count, stride = packed.get("count", int), packed.get("byteStride", int)
    mode = packed.get("mode", str)
    decoders = {
        "ATTRIBUTES": functools.partial(meshoptimizer.decode_vertex_buffer, dtype=f"V{stride}"),
        "TRIANGLES": meshoptimizer.decode_index_buffer,
        "INDICES": meshoptimizer.decode_index_sequence,
    }
    name, strides = _FILTERS.get(packed.get("filter", "NONE"), ("", ()))
    # The package checks the rest.
    if mode not in decoders or stride not in strides or (mode == "TRIANGLES" and count % 3):
        raise DamagedError(f"{packed.path}: this mode, filter, stride or count cannot be read")
    try:
        plain = decoders[mode](count, stride, bytes(data)).view(np.uint8)[: count * stride]
        if name:
            plain = getattr(meshoptimizer, f"decode_filter_{name}")(plain, count, stride)
    except (RuntimeError, ValueError):
        raise DamagedError(f"{packed.path} is damaged") from None
    return memoryview(plain)

"""The JSON, buffers, images and accessors of a glTF file."""

import binascii
import json
import re
import struct
import urllib.parse
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from data_gen.mesh import UnreadableModelError
from data_gen.readers.model_files import DamagedError, check_size
from data_gen.readers.textures import Assets
from psgn_jax.system.untrusted import parse_json

DRACO = "KHR_draco_mesh_compression"

MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")

_COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}

_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}

_MAX_BYTES = 512 << 20  # of all buffers of a file, and of an array that the file need not contain


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and -1e38 <= value <= 1e38


def _is_whole(value: Any) -> bool:
    return _is_number(value) and 0 <= value < 1 << 53 and value == int(value)


class Object:
    """An object of the JSON at a path such as `nodes[3]`. A wrong field is refused by its path."""

    def __init__(self, fields: Any, path: str = "", index: int = -1) -> None:
        if not isinstance(fields, dict):
            raise DamagedError(f"{path or 'its JSON'} is not an object")
        self.fields: dict[str, Any] = fields
        self.path, self.index = path, index

    def __contains__(self, key: str) -> bool:
        return key in self.fields

    def at(self, key: str) -> str:
        """The path of a field."""
        return f"{self.path}.{key}".lstrip(".")

    def _get(self, key: str, default: Any, right: Callable[[Any], bool], expected: str) -> Any:
        value = self.fields.get(key, default)
        if value is None or not right(value):
            got = "nothing" if value is None else repr(value)[:40]
            raise DamagedError(f"{self.at(key)}: got {got}, expected {expected}")
        return value

    def _list(
        self, key: str, right: Callable[[Any], bool] | None = None, of_what: str = ""
    ) -> list[Any]:
        """A list; empty if it is missing."""

        def is_right(value: Any) -> bool:
            return isinstance(value, list) and (right is None or all(map(right, value)))

        value: list[Any] = self._get(key, [], is_right, f"a list{of_what}")
        return value

    def whole(self, key: str, default: int | None = None) -> int:
        return int(self._get(key, default, _is_whole, "a whole number from 0"))

    def index_of(self, key: str) -> int:
        """A whole number; -1 if it is missing."""
        return self.whole(key) if key in self else -1

    def number(self, key: str, default: float) -> float:
        return float(self._get(key, default, _is_number, "a number"))

    def text(self, key: str, default: str | None = None) -> str:
        value: str = self._get(key, default, lambda v: isinstance(v, str), "a text")
        return value

    def wholes(self, key: str) -> list[int]:
        return [int(v) for v in self._list(key, _is_whole, " of whole numbers from 0")]

    def texts(self, key: str) -> list[str]:
        return self._list(key, lambda v: isinstance(v, str), " of texts")

    def numbers(self, key: str, default: Sequence[float] = ()) -> np.ndarray:
        """As many numbers as the default has; any number if that is empty."""
        values = self._list(key, _is_number, " of numbers") if key in self else default
        if len(default) not in (0, len(values)):
            raise DamagedError(
                f"{self.at(key)}: got {len(values)} numbers, expected {len(default)}"
            )
        return np.array(values, np.float64)

    def object(self, key: str) -> "Object":
        """The object in a field, without fields if it is missing."""
        return Object(self.fields.get(key, {}), self.at(key))

    def extension(self, name: str) -> "Object | None":
        found = self.object("extensions")
        return found.object(name) if name in found else None

    def item(self, key: str, index: int) -> "Object":
        """An object of a list, which knows its index."""
        values = self._list(key)
        if index >= len(values):
            raise DamagedError(f"{self.at(key)}[{index}] does not exist, there are {len(values)}")
        return Object(values[index], f"{self.at(key)}[{index}]", index)

    def items(self, key: str) -> list["Object"]:
        return [self.item(key, index) for index in range(len(self._list(key)))]


def _json_and_chunk(data: bytes) -> tuple[Any, memoryview | None]:
    """The JSON of a file, and the binary chunk of a GLB. What follows them is ignored."""
    text, chunk = memoryview(data), None
    if data[:4] == b"glTF":
        version, length, kind = struct.unpack("<4xI4xI4s", data[:20].ljust(20))
        if version != 2:
            raise DamagedError(f"glTF {version}, expected 2.0")
        if kind != b"JSON":
            raise DamagedError("its first chunk is not JSON")
        text, rest = text[20 : 20 + length], text[20 + length :]
        cut = len(text) < length
        if rest[4:8] == b"BIN\0":
            (length,) = struct.unpack("<I", rest[:4])
            chunk = rest[8 : 8 + length]
            cut = len(chunk) < length
        if cut:
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
    """A glTF file: its JSON `root`, and its buffers, which are loaded when they are needed."""

    def __init__(self, data: bytes, assets: Assets) -> None:
        tree, self._chunk = _json_and_chunk(data)
        self.root, self.assets = Object(tree), assets
        self._buffers: dict[int, memoryview] = {}
        version = self.root.object("asset").text("version", "without asset.version")
        if version.split(".")[0] != "2":
            raise DamagedError(f"glTF {version}, expected 2.0")

    def _contents(self, uri: str) -> bytes:
        """What a URI stands for: data in the URI, or a file."""
        head, comma, text = uri.partition(",")
        if comma and head[:5].lower() == "data:":
            raw = urllib.parse.unquote_to_bytes(text)
            try:
                return binascii.a2b_base64(raw + b"==") if head.lower().endswith(";base64") else raw
            except binascii.Error:
                raise DamagedError("the base64 text of a data URI is damaged") from None
        try:
            return self.assets.files.open(self.assets.base, uri)
        except FileNotFoundError:  # with a query, as in addresses of web pages
            return self.assets.files.open(self.assets.base, re.split("[?#]", uri)[0])

    def _buffer(self, index: int) -> memoryview:
        fields = self.root.item("buffers", index)
        if index in self._buffers:
            return self._buffers[index]
        if "uri" not in fields:
            if index or self._chunk is None:
                raise DamagedError(f"{fields.path} has neither a uri nor a binary chunk")
            return self._chunk
        uri = fields.text("uri")
        try:
            self._buffers[index] = memoryview(self._contents(uri))
        except FileNotFoundError:
            what = f"not readable as glTF: its file {uri[:100]!r} is missing"
            raise self.assets.files.refusal(what) from None
        except OSError as error:
            what = f"its file {uri[:100]!r} is not readable: {error.strerror}"
            raise UnreadableModelError(what) from error
        check_size("all its buffers", sum(map(len, self._buffers.values())), _MAX_BYTES)
        return self._buffers[index]

    def view(self, index: int) -> memoryview:
        """The bytes of a buffer view, decompressed."""
        fields = self.root.item("bufferViews", index)
        packed = next((x for x in map(fields.extension, MESHOPT) if x), None)
        number = fields.whole("buffer")
        if "uri" in self.root.item("buffers", number) or (number == 0 and self._chunk is not None):
            packed = None  # there is an uncompressed copy
        span = packed or fields
        data, start = self._buffer(span.whole("buffer")), span.whole("byteOffset", 0)
        stop = start + span.whole("byteLength")
        if stop > len(data):
            raise DamagedError(f"{span.path} ends at byte {stop} of a buffer of {len(data)}")
        found = data[start:stop]
        return memoryview(_by_meshopt(packed, found)) if packed else found

    def image(self, fields: Object) -> bytes:
        """The file of an image."""
        if "bufferView" in fields:
            return bytes(self.view(fields.whole("bufferView")))
        return self._contents(fields.text("uri"))

    def _rows(self, start: Object, kind: Object, shape: tuple[int, int], stride: int) -> np.ndarray:
        """Rows of numbers of a component type, from an offset in a buffer view."""
        code = _COMPONENTS.get(kind.whole("componentType"))
        if code is None:
            raise DamagedError(f"{kind.path} has an unknown componentType")
        dtype, (count, columns) = np.dtype(code), shape
        size = dtype.itemsize * columns
        if "bufferView" not in start:
            if count * size > _MAX_BYTES:
                raise DamagedError(f"{start.path} has {count} rows without data")
            return np.zeros(shape, dtype)
        data, first = self.view(start.whole("bufferView")), start.whole("byteOffset", 0)
        stride = stride or size
        if count and (stride < size or first + stride * (count - 1) + size > len(data)):
            raise DamagedError(f"{start.path} has more numbers than its buffer view")
        return np.ndarray(shape, dtype, data, first if count else 0, (stride, dtype.itemsize))

    def accessor(self, index: int, *widths: int) -> tuple[np.ndarray, bool]:
        """The numbers [count, columns] of an accessor, and whether they are normalised."""
        fields = self.root.item("accessors", index)
        columns, count = _COLUMNS.get(fields.text("type"), 0), fields.whole("count")
        if columns not in widths:
            raise DamagedError(f"{fields.path} has the wrong type {fields.text('type')[:20]!r}")
        stride = 0
        if "bufferView" in fields:
            view = self.root.item("bufferViews", fields.whole("bufferView"))
            stride = view.whole("byteStride", 0)
        values = self._rows(fields, fields, (count, columns), stride)
        if "sparse" in fields:
            sparse = fields.object("sparse")
            rows, number = sparse.object("indices"), sparse.whole("count")
            changed = self._rows(rows, rows, (number, 1), 0)[:, 0]
            if changed.dtype.kind != "u" or (number and changed.max() >= count):
                raise DamagedError(f"{rows.path} has rows that the accessor lacks")
            values = values.copy()
            values[changed] = self._rows(sparse.object("values"), fields, (number, columns), 0)
        return values, bool(fields.fields.get("normalized"))


# --- Compression: each package is optional ------------------------------------------------------


def _absent(extension: str) -> DamagedError:
    return DamagedError(f"it needs {extension}: `pip install 'psgn-jax[gltf]'`")


def by_draco(packed: Object, data: memoryview) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The corners of the faces [3 f], and the attributes of a primitive."""
    try:
        import DracoPy
    except ImportError:
        raise _absent(DRACO) from None
    attributes = packed.object("attributes")
    names = {name: attributes.whole(name) for name in attributes.fields}
    try:
        found: Any = DracoPy.decode(bytes(data))
        own = {k: np.asarray(found.get_attribute_by_unique_id(n)["data"]) for k, n in names.items()}
        return np.asarray(found.faces).ravel(), own
    except Exception:  # any type for damaged data
        raise DamagedError(f"{packed.path} is damaged") from None


_FILTERS = {
    "NONE": ("", range(257)),
    "OCTAHEDRAL": ("oct", (4, 8)),
    "QUATERNION": ("quat", (8,)),
    "EXPONENTIAL": ("exp", range(4, 257, 4)),
}
"""Name in the package and possible strides."""


def _by_meshopt(packed: Object, data: memoryview) -> bytes:
    """The bytes of a buffer view."""
    try:
        import meshoptimizer
    except ImportError:
        raise _absent(MESHOPT[0]) from None
    count, stride = packed.whole("count"), packed.whole("byteStride")
    mode = packed.text("mode")
    modes = {
        "ATTRIBUTES": stride % 4 == 0 and 0 < stride <= 256,
        "TRIANGLES": stride in (2, 4) and count % 3 == 0,
        "INDICES": stride in (2, 4),
    }
    name, strides = _FILTERS.get(packed.text("filter", "NONE"), ("", ()))
    if not modes.get(mode) or stride not in strides or count * stride > _MAX_BYTES:
        raise DamagedError(f"{packed.path}: this mode, filter, stride or count cannot be read")
    try:
        if mode == "ATTRIBUTES":
            rows = np.dtype(f"V{stride}")
            found = meshoptimizer.decode_vertex_buffer(count, stride, bytes(data), rows)
        elif mode == "TRIANGLES":
            found = meshoptimizer.decode_index_buffer(count, stride, bytes(data))
        else:
            found = meshoptimizer.decode_index_sequence(count, stride, bytes(data))
        plain = found.view(np.uint8)[: count * stride]
        if name:
            plain = getattr(meshoptimizer, f"decode_filter_{name}")(plain, count, stride)
    except (RuntimeError, ValueError):
        raise DamagedError(f"{packed.path} is damaged") from None
    return bytes(plain)

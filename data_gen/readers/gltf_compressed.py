"""Data of glTF files that Draco or meshoptimizer compressed; each package is optional."""

from typing import Any

import numpy as np

from data_gen.mesh import UnusableModelError
from data_gen.readers.gltf_json import Object, damaged

DRACO = "KHR_draco_mesh_compression"

MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")

_FILTERS = {"OCTAHEDRAL": "oct", "QUATERNION": "quat", "EXPONENTIAL": "exp"}


def _absent(extension: str) -> UnusableModelError:
    return damaged(f"it needs {extension}: `pip install 'psgn-jax[gltf]'`")


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
        raise damaged(f"{packed.path} is damaged") from None


def by_meshopt(packed: Object, data: memoryview, most: int) -> bytes:
    """The bytes of a buffer view, at most `most`."""
    try:
        import meshoptimizer
    except ImportError:
        raise _absent(MESHOPT[0]) from None
    count, stride = packed.whole("count"), packed.whole("byteStride")
    mode, filtered = packed.text("mode"), packed.text("filter", "NONE")
    modes = {
        "ATTRIBUTES": stride % 4 == 0 and 0 < stride <= 256,
        "TRIANGLES": stride in (2, 4) and count % 3 == 0,
        "INDICES": stride in (2, 4),
    }
    filters = {"OCTAHEDRAL": (4, 8), "QUATERNION": (8,), "EXPONENTIAL": range(4, 257, 4)}
    right = modes.get(mode) and stride in filters.get(filtered, [stride])
    if not right or filtered not in (*filters, "NONE") or count * stride > most:
        raise damaged(f"{packed.path}: this mode, filter, stride or count cannot be read")
    try:
        if mode == "ATTRIBUTES":
            rows = np.dtype(f"V{stride}")
            found = meshoptimizer.decode_vertex_buffer(count, stride, bytes(data), rows)
        elif mode == "TRIANGLES":
            found = meshoptimizer.decode_index_buffer(count, stride, bytes(data))
        else:
            found = meshoptimizer.decode_index_sequence(count, stride, bytes(data))
        plain = found.view(np.uint8)[: count * stride]
        if filtered in _FILTERS:
            undo = getattr(meshoptimizer, f"decode_filter_{_FILTERS[filtered]}")
            plain = undo(plain, count, stride)
    except (RuntimeError, ValueError):
        raise damaged(f"{packed.path} is damaged") from None
    return bytes(plain)

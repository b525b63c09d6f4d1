"""Reader of 3MF files: zip archives of XML."""

import functools
import io
from xml.etree.ElementTree import Element

import numpy as np

from data_gen.mesh import UnusableModelError
from data_gen.readers.collada import MAX_XML_BYTES, parsed_xml
from data_gen.readers.model_files import DamagedError, ZipFiles, numbers
from data_gen.readers.parts import Part, placed
from data_gen.readers.textures import Assets

_MOST_INSTANCES = 100_000  # an object may have several instances


def read_3mf(data: bytes, assets: Assets) -> list[Part]:
    """The triangles of a 3MF file. We do not read colours."""
    files = ZipFiles(io.BytesIO(data))
    objects: dict[tuple[str, str | None], Element] = {}
    stack: list[tuple[str, Element, np.ndarray]] = []
    for name in files.names:
        if name.endswith(".model"):
            root = parsed_xml(files.read(name, MAX_XML_BYTES))
            objects |= {(name, e.get("id")): e for e in root.iterfind("resources/object")}
            stack += [(name, item, np.eye(4)) for item in root.iterfind("build/item")]
            if any(element.get("pid") for element in root.iter()):
                assets.warn("colours and textures of 3MF not read")
    if not objects:
        raise DamagedError("it contains no .model file with objects")
    parts: list[Part] = []
    mesh_of, instances = functools.cache(_mesh), 0
    while stack:
        name, instance, matrix = stack.pop()
        instances += 1
        if instances > _MOST_INSTANCES:
            raise UnusableModelError(f"more than {_MOST_INSTANCES} instances of objects")
        if words := (instance.get("transform") or "").split():  # in the order of columns
            matrix = matrix @ np.vstack([numbers(words).reshape(4, 3).T, [0, 0, 0, 1]])
        paths = [v for k, v in instance.attrib.items() if k.endswith("}path")]
        path = (paths or [name])[0].lstrip("/")
        shape = objects.get((path, instance.get("objectid")))
        if shape is None:
            assets.warn("objects of 3MF missing", instance.get("objectid"))
            continue
        stack += [(path, inner, matrix) for inner in shape.iterfind("components/component")]
        mesh = mesh_of(shape)
        assets.add_faces(len(mesh.counts))
        if len(mesh.counts):
            parts.append(placed(mesh, matrix[None]))
    return parts


def _mesh(shape: Element) -> Part:
    """The triangles of an object."""
    rows = [[v.get(k) for k in "xyz"] for v in shape.iterfind("mesh/vertices/vertex")]
    found = shape.iterfind("mesh/triangles/triangle")
    index = numbers([[t.get(k) for k in ("v1", "v2", "v3")] for t in found], np.int64)
    if index.size and not 0 <= index.min() <= index.max() < len(rows):
        raise DamagedError("faces have missing vertices")
    return Part(numbers(rows).reshape(-1, 3), np.full(len(index), 3), index.ravel())

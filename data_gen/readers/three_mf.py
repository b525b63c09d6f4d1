"""Reader of 3MF files: zip archives of XML."""

import io
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from data_gen.mesh import UnusableModelError, check_face_count
from data_gen.parts import Part
from data_gen.readers.collada import MAX_XML_BYTES, parsed_xml
from data_gen.readers.model_files import ZipFiles
from data_gen.readers.textures import Assets

_MOST_PLACES = 100_000  # an object may be in several places


def read_3mf(data: bytes, assets: Assets) -> dict[str, Any]:
    """Arrays of the shapes in a 3MF file for `mesh.build_model`; colours are not read."""
    files = ZipFiles(io.BytesIO(data))
    objects: dict[tuple[str, str | None], Element] = {}
    stack: list[tuple[str, Element, np.ndarray]] = []
    for name in files.names:
        if name.endswith(".model"):
            root = parsed_xml(files.read(name, MAX_XML_BYTES), "3MF")
            objects |= {(name, e.get("id")): e for e in root.iterfind("resources/object")}
            stack += [(name, item, np.eye(4)) for item in root.iterfind("build/item")]
            if any(element.get("pid") for element in root.iter()):
                assets.warn("colours and textures of 3MF not read")
    if not objects:
        raise UnusableModelError("not readable as 3MF: it contains no .model file with objects")
    parts: list[Part] = []
    faces = places = 0
    while stack:
        name, place, matrix = stack.pop()
        places += 1
        if places > _MOST_PLACES:
            raise UnusableModelError(f"more than {_MOST_PLACES} places of objects")
        if words := (place.get("transform") or "").split():  # of rows, with a translation below
            own = np.array(words, np.float64).reshape(4, 3)
            matrix = np.column_stack([own, [0, 0, 0, 1]]) @ matrix
        path = next((v for k, v in place.attrib.items() if k.endswith("}path")), name).lstrip("/")
        shape = objects.get((path, place.get("objectid")))
        if shape is None:
            assets.warn("objects of 3MF missing", place.get("objectid"))
            continue
        stack += [(path, inner, matrix) for inner in shape.iterfind("components/component")]
        found = shape.findall("mesh/triangles/triangle")
        faces += len(found)
        check_face_count(faces, assets.max_faces)
        rows = [[v.get(k) for k in "xyz"] for v in shape.iterfind("mesh/vertices/vertex")]
        corners = np.array([[t.get(k) for k in ("v1", "v2", "v3")] for t in found], np.int64)
        if len(found):
            vertices = np.array(rows, np.float64) @ matrix[:3, :3] + matrix[3, :3]
            corners = corners[:, ::-1] if np.linalg.det(matrix) < 0 else corners
            parts.append(Part(vertices, np.full(len(corners), 3), corners.ravel()))
    return assets.arrays(parts)

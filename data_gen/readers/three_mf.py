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
    meshes: dict[Element, tuple[np.ndarray, np.ndarray]] = {}
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
        if shape not in meshes:
            meshes[shape] = _mesh(shape)
        vertices, corners = meshes[shape]
        faces += len(corners)
        check_face_count(faces, assets.max_faces)
        if len(corners):
            corners = corners[:, ::-1] if np.linalg.det(matrix) < 0 else corners
            placed = vertices @ matrix[:3, :3] + matrix[3, :3]
            parts.append(Part(placed, np.full(len(corners), 3), corners.ravel()))
    return assets.arrays(parts)


def _mesh(shape: Element) -> tuple[np.ndarray, np.ndarray]:
    """The vertices [V, 3] of an object that faces use, and its faces [F, 3]."""
    rows = [[v.get(k) for k in "xyz"] for v in shape.iterfind("mesh/vertices/vertex")]
    found = shape.iterfind("mesh/triangles/triangle")
    index = np.array([[t.get(k) for k in ("v1", "v2", "v3")] for t in found], np.int64)
    used, corners = np.unique(index, return_inverse=True)
    if len(used) and not 0 <= used[0] <= used[-1] < len(rows):
        raise UnusableModelError("not readable as 3MF: faces have missing vertices")
    return np.array(rows, np.float64).reshape(-1, 3)[used], corners.reshape(-1, 3)

"""Reader of 3MF files, over trimesh, which needs lxml and networkx for them."""

import io
import logging
from typing import Any

import numpy as np

from data_gen.mesh import UnusableModelError, check_face_count
from data_gen.parts import Part
from data_gen.readers.model_files import ZipFiles
from data_gen.readers.textures import Assets

_MAX_BYTES = 64 << 20


def read_3mf(data: bytes, assets: Assets) -> dict[str, Any]:
    """Arrays of the shapes in a 3MF file for `mesh.build_model`; colours are not read."""
    import trimesh

    files = ZipFiles(io.BytesIO(data))
    for name in files.names:
        text = files.read(name, _MAX_BYTES).replace(b"\0", b"")
        if b"<!ENTITY" in text:
            raise UnusableModelError("XML entities are refused")
        check_face_count(text.count(b"<triangle "), assets.max_faces)
        if name.endswith(".model") and b" pid=" in text:
            assets.warn("colours and textures of 3MF not read")
    log = logging.getLogger("trimesh.util")  # which all its modules use
    before, log.disabled = log.disabled, True
    try:
        scene = trimesh.load_scene(io.BytesIO(data), file_type="3mf", process=False)
    finally:
        log.disabled = before
    parts = []
    for node in scene.graph.nodes_geometry:
        matrix, geometry = scene.graph[node]
        mesh = scene.geometry[geometry]
        corners = np.asarray(mesh.faces, np.int64)
        if np.linalg.det(matrix[:3, :3]) < 0:
            corners = corners[:, ::-1]
        vertices = np.asarray(mesh.vertices) @ matrix[:3, :3].T + matrix[:3, 3]
        parts.append(Part(vertices, np.full(len(corners), 3), corners.ravel()))
    return assets.arrays(parts)

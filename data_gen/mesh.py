"""The mesh of all readers and catalogues: triangles, materials, normals.

Colours are display values (sRGB) in [0, 1], as in material files.
"""

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import scipy.sparse
import scipy.sparse.csgraph
from jaxtyping import Float, Int, UInt8

MAX_FACES = 400_000
"""Default of the largest number of faces. Reading an OBJ file takes 1 kB of memory per face."""

CREASE_DEGREES = 40.0

EXISTS = 0.1
"""Surface with a lower opacity is absent, such as holes in an alpha map; glass exists."""

# A face with a smaller area / extent^2 is degenerate: a line or a point.
_DEGENERATE = 1e-12

# Vertices nearer than this fraction of the extent are equal in the search for edges.
_WELD = 2.0**-20


class UnusableModelError(ValueError):
    """No sample can be made from a model; the message gives the reason.

    `status` is the model's status in `models.jsonl`.
    """

    status = "refused"


class UnreadableModelError(UnusableModelError):
    """A model's file is missing or not readable, perhaps on this machine only."""

    status = "unreadable"


GREY = (0.6, 0.6, 0.6)
"""Colour of models without colours."""


@dataclasses.dataclass(frozen=True, eq=False)
class Material:
    """The appearance of a surface (Blinn-Phong).

    Attributes:
      diffuse: RGB, a factor of the texture.
      specular: RGB of the highlight.
      shininess: exponent of the highlight.
      opacity: 1 = opaque; a factor of the texture's alpha.
      texture: RGBA, uint8 [H, W, 4], or None. It repeats; its first row is at v = 1.
      name: of the material in its file.
    """

    diffuse: tuple[float, float, float] = GREY
    specular: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shininess: float = 20.0
    opacity: float = 1.0
    texture: np.ndarray | None = None
    name: str = ""

    @functools.cached_property
    def has_alpha(self) -> bool:
        """Whether the texture has texels that are not opaque."""
        return self.texture is not None and bool((self.texture[..., 3] < 255).any())


@dataclasses.dataclass(frozen=True, eq=False)
class Model:
    """Triangles with materials.

    Attributes:
      vertices: float64.
      faces: int64, counter-clockwise seen from outside.
      normals: float32, a unit normal for each corner of each face.
      uv: float32, texture coordinates of the corners; 0 if the file has none.
      face_material: int64, index into `materials`.
      materials: at least one.
      parameters: of a procedural model, or further columns of an index.
      warnings: what is missing or wrong in the file, and what we used instead; see
        `kind_of_warning`.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    normals: Float[np.ndarray, "f 3 3"]
    uv: Float[np.ndarray, "f 3 2"]
    face_material: Int[np.ndarray, " f"]
    materials: tuple[Material, ...]
    parameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def corners(self) -> Float[np.ndarray, "f 3 3"]:
        return self.vertices[self.faces]

    @functools.cached_property
    def edges(self) -> Int[np.ndarray, "e 2"]:
        """The edges of the faces as pairs of vertices, each edge once."""
        one, two = self.faces.ravel(), np.roll(self.faces, -1, axis=1).ravel()
        key = np.unique(np.minimum(one, two) * len(self.vertices) + np.maximum(one, two))
        return np.stack(np.divmod(key, len(self.vertices)), axis=1)

    @functools.cached_property
    def has_alpha(self) -> np.ndarray:
        """`Material.has_alpha` of each material; thousands may share a texture."""
        of_texture = {id(m.texture): m for m in self.materials}
        known = {key: m.has_alpha for key, m in of_texture.items()}
        return np.array([known[id(m.texture)] for m in self.materials])

    def transformed(self, matrix: Float[np.ndarray, "3 3"]) -> "Model":
        """The model transformed by a matrix; we reverse its faces if the matrix mirrors."""
        determinant = np.linalg.det(matrix)
        if not np.isfinite(matrix).all() or determinant == 0:
            raise UnusableModelError(f"matrix: got {matrix.tolist()}, not invertible")
        # Normals transform with the inverse transpose.
        normals = unit_vectors(self.normals @ np.linalg.inv(matrix))
        turn = slice(None, None, -1 if determinant < 0 else 1)
        return dataclasses.replace(
            self,
            vertices=self.vertices @ matrix.T + 0.0,  # turns -0 into 0
            faces=self.faces[:, turn],
            normals=normals[:, turn].astype(np.float32),
            uv=self.uv[:, turn],
        )


def build_model(
    vertices: np.ndarray,
    faces: np.ndarray,
    *,
    materials: Sequence[Material] = (),
    face_material: np.ndarray | None = None,
    normals: np.ndarray | None = None,
    uv: np.ndarray | None = None,
    parameters: Mapping[str, Any] | None = None,
    warnings: Sequence[str] = (),
) -> Model:
    """Makes a `Model` from raw arrays.

    We drop unused vertices, and faces with indices out of range, without area or with a fully
    transparent material; warnings count these faces. `crease_normals` replaces normals that are
    missing, zero or not finite. We reverse a face if its normals point to its back.

    Args:
      vertices: [V, 3].
      faces: [F, 3].
      materials: () = a grey material.
      face_material: [F], None = 0.
      normals: of corners [F, 3, 3], or None.
      uv: of corners [F, 3, 2], or None.
      parameters: see `Model`.
      warnings: of the reader.

    Raises:
      UnusableModelError: no face is left, or a vertex is not finite.
    """
    notes = list(warnings)
    vertices = np.asarray(vertices, np.float64).reshape(-1, 3)
    faces = np.asarray(faces, np.int64).reshape(-1, 3)
    materials = tuple(materials) or (Material(),)
    owner = np.zeros(len(faces), np.int64) if face_material is None else np.asarray(face_material)

    keep = ((faces >= 0) & (faces < len(vertices))).all(axis=1)
    if not keep.all():
        notes.append(f"faces with missing vertices dropped: {int((~keep).sum())}")
    seen = np.array([m.opacity >= EXISTS for m in materials])[owner]
    if not seen[keep].all():
        notes.append(f"fully transparent faces dropped: {int((keep & ~seen).sum())}")
        if not seen[keep].any():
            clear = sorted({materials[k].name for k in owner})
            what = f"opacity 0 of material {', '.join(map(repr, clear[:3]))}"
            raise UnusableModelError(f"the mesh is empty: all faces are transparent, {what}")
    keep &= seen
    used = vertices[faces[keep]]
    if not np.isfinite(used).all():
        bad = int((~np.isfinite(used)).any(axis=2).sum())
        raise UnusableModelError(f"{bad} corners of faces have coordinates that are not finite")
    if len(used):
        # From edge vectors: products of positions far from the origin would lose all precision.
        extent = np.ptp(used.reshape(-1, 3), axis=0).max()
        cross = np.cross(used[:, 1] - used[:, 0], used[:, 2] - used[:, 0])
        flat = np.linalg.norm(cross, axis=1) <= _DEGENERATE * extent**2
        if flat.any():
            notes.append(f"degenerate faces dropped: {int(flat.sum())}")
            keep[np.flatnonzero(keep)[flat]] = False
    if not keep.any():
        raise UnusableModelError("the mesh is empty: no face has an area, expected at least one")

    faces, owner = faces[keep], owner[keep].astype(np.int64)
    index, flat_faces = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[index], flat_faces.reshape(-1, 3)
    uv = np.zeros((len(keep), 3, 2)) if uv is None else uv
    uv = np.nan_to_num(np.asarray(uv, np.float32).reshape(-1, 3, 2)[keep], posinf=0, neginf=0)
    if normals is None:
        normals = crease_normals(vertices, faces)
    else:
        normals = np.asarray(normals, np.float64).reshape(-1, 3, 3)[keep]
        normals = unit_vectors(np.nan_to_num(normals, posinf=0, neginf=0))
        over = (normals.sum(axis=1) * face_normals(vertices, faces)).sum(axis=1) < 0
        for corners in (faces, normals, uv):
            corners[over] = corners[over][:, ::-1]
        missing = (normals == 0).all(axis=2)
        if missing.any():
            if not missing.all():
                notes.append(f"corner normals missing or zero, recomputed: {int(missing.sum())}")
            normals = np.where(missing[..., None], crease_normals(vertices, faces), normals)
    normals = normals.astype(np.float32)
    return Model(vertices, faces, normals, uv, owner, materials, parameters or {}, tuple(notes))


def kind_of_warning(line: str) -> str:
    """The kind of a warning: the text before ": ", without names and numbers of the file."""
    return line.partition(": ")[0]


def unit_vectors(v: np.ndarray) -> np.ndarray:
    """The vectors scaled to length 1; zero vectors stay zero."""
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.where(length > 1e-12, v / np.maximum(length, 1e-30), 0)


def face_normals(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Float[np.ndarray, "f 3"]:
    """Unit normals of the faces, by the right-hand rule; 0 for a face without area."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    length = np.linalg.norm(cross, axis=1, keepdims=True)
    return cross / np.maximum(length, 1e-300)


def face_areas(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Float[np.ndarray, " f"]:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def weld(vertices: np.ndarray) -> np.ndarray:
    """A number for each vertex [V], equal for vertices within 2^-20 of the extent."""
    low = vertices.min(axis=0)
    extent = max(float((vertices.max(axis=0) - low).max()), 1e-300)
    cells = np.rint((vertices - low) / (extent * _WELD)).astype(np.int64)
    key = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
    return np.unique(key, return_inverse=True)[1].reshape(-1)


def crease_normals(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> Float[np.ndarray, "f 3 3"]:
    """Corner normals, smooth across flat edges and discontinuous at sharp edges.

    If the normals of two faces differ by less than `CREASE_DEGREES`, they share a normal at the
    ends of their common edge: the mean of their normals, weighted by the faces' angles at the
    vertex. Faces have a common edge if the positions of its ends are equal.
    """
    count = len(faces)
    corner = weld(vertices)[faces]
    normal = face_normals(vertices, faces)
    # For each edge, its two vertices in ascending order, and the corners of the face at them.
    ends = np.stack([corner.ravel(), np.roll(corner, -1, axis=1).ravel()])
    nodes = np.arange(3 * count).reshape(count, 3)
    nodes = np.stack([nodes.ravel(), np.roll(nodes, -1, axis=1).ravel()])
    order = np.where(ends[0] < ends[1], [[0], [1]], [[1], [0]])
    (low, high), nodes = (np.take_along_axis(a, order, axis=0) for a in (ends, nodes))
    key = low * (int(corner.max()) + 1) + high
    order = np.argsort(key, kind="stable")
    links: list[np.ndarray] = []
    limit = np.cos(np.radians(CREASE_DEGREES))
    # An edge of a manifold surface has two faces. At an edge with more faces, we compare each face
    # with the next three, so that the cost is linear in the number of faces.
    for offset in (1, 2, 3):
        one, two = order[:-offset], order[offset:]
        same = key[one] == key[two]
        one, two = one[same], two[same]
        smooth = (normal[one // 3] * normal[two // 3]).sum(axis=1) > limit
        one, two = one[smooth], two[smooth]
        links.append(np.stack([nodes[:, one].ravel(), nodes[:, two].ravel()]))
    rows, columns = np.concatenate(links, axis=1)
    ones, shape = np.ones(len(rows), np.int8), (3 * count, 3 * count)
    graph = scipy.sparse.coo_array((ones, (rows, columns)), shape)
    groups, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    triangle = vertices[faces]
    along = unit_vectors(np.roll(triangle, -1, axis=1) - triangle)
    back = -np.roll(along, 1, axis=1)
    angle = np.arccos(np.clip((along * back).sum(axis=2), -1, 1)).ravel()
    each = np.repeat(normal, 3, axis=0)
    total = np.stack([np.bincount(label, angle * each[:, k], groups) for k in range(3)], axis=1)
    result = unit_vectors(total)[label]
    lost = (result == 0).all(axis=1)
    result[lost] = each[lost]
    return result.reshape(count, 3, 3)


def faces_with_alpha(model: Model) -> Int[np.ndarray, " n"]:
    """Indices of the faces whose texture has alpha."""
    return np.flatnonzero(model.has_alpha[model.face_material])


def opacity_at(
    model: Model, face: Int[np.ndarray, " n"], weights: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, " n"]:
    """Opacity at points of faces, given by barycentric weights: material times nearest texel."""
    owner = model.face_material[face]
    result = np.array([m.opacity for m in model.materials])[owner]
    for index in np.flatnonzero(model.has_alpha):
        material, here = model.materials[index], np.flatnonzero(owner == index)
        uv = (model.uv[face[here]] * weights[here][..., None]).sum(axis=1)
        assert material.texture is not None
        result[here] *= texels(material.texture, uv)[:, 3] / 255.0
    return result


def texels(
    texture: UInt8[np.ndarray, "h w 4"], uv: Float[np.ndarray, "n 2"]
) -> UInt8[np.ndarray, "n 4"]:
    """The nearest texel at each coordinate. The texture repeats; its first row is at v = 1."""
    height, width = texture.shape[:2]
    wrapped = uv - np.floor(uv)
    column = np.minimum((wrapped[:, 0] * width).astype(np.int64), width - 1)
    row = np.minimum(((1 - wrapped[:, 1]) * height).astype(np.int64), height - 1)
    return texture[row, column]

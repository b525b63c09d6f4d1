"""The neutral mesh: flat arrays, materials, normals; and what is computed of it.

A `Model` is triangles with a material each. `build` makes one of raw arrays and cleans them,
`data_gen.loading` reads one from a file, `data_gen.catalogues` says where models come from.
`normalize` brings a model to the project's frame (`psgn_jax.data.schema`): +z up, +x the front,
origin on the ground under the object, unit = radius of the bounding hemisphere.

Colours are display values (sRGB) in [0, 1], as material files have them.
"""

import dataclasses
import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.ndimage
import scipy.sparse
import scipy.sparse.csgraph
from jaxtyping import Bool, Float, Int, UInt8

from psgn_jax.data import schema

MAX_FACES = 400_000
"""Default limit of a model's faces.

Reading an OBJ file takes about 1 kB of memory for each: 1 GB for a million.
"""

CREASE_DEGREES = 40.0
"""Default crease angle: faces that meet at a sharper edge do not share a normal there."""

EXISTS = 0.1
"""Opacity below which a surface does not exist: it is a hole of an alpha map, or nothing at all.

Window glass is far above it and part of the object."""

AXES = ("+x", "-x", "+y", "-y", "+z", "-z")
"""Names of directions, for `orient`."""

# Of the squared extent: a face with less area than this is a line or a point.
_DEGENERATE = 1e-12

# Vertices nearer than this part of the extent are one vertex when edges are looked for.
_WELD = 2.0**-20


class UnusableModelError(ValueError):
    """A model that no sample can be made of; the message says why."""


@dataclasses.dataclass(frozen=True, eq=False)
class Material:
    """How a surface looks (Blinn-Phong).

    Attributes:
      diffuse: RGB; multiplies the texture where there is one.
      specular: RGB of the highlight.
      shininess: exponent of the highlight.
      opacity: 1 = opaque; multiplies the texture's alpha.
      texture: uint8 [H, W, 4], RGBA, first row on top; repeated outside of [0, 1]^2. Its first
        row is at v = 1, its last at v = 0.
      name: of the material in its file.
    """

    diffuse: tuple[float, float, float] = (0.6, 0.6, 0.6)
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
      vertices: float64 [V, 3].
      faces: int64 [F, 3], counter-clockwise seen from outside.
      normals: float32 [F, 3, 3], a unit normal for each corner of each face.
      uv: float32 [F, 3, 2], texture coordinates of the corners; 0 where there are none.
      face_material: int64 [F], index into `materials`.
      materials: at least one.
      category: of the object, "" where unknown.
      model_id: name of the object, unique in its catalogue.
      parameters: what is known of how the model was made; a procedural one's hidden ones, too.
      warnings: what was missing or wrong and what stands in for it.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    normals: Float[np.ndarray, "f 3 3"]
    uv: Float[np.ndarray, "f 3 2"]
    face_material: Int[np.ndarray, " f"]
    materials: tuple[Material, ...]
    category: str = ""
    model_id: str = ""
    parameters: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Checks that the arrays fit together."""
        count = len(self.faces)
        for name, shape in {
            "vertices": (len(self.vertices), 3),
            "faces": (count, 3),
            "normals": (count, 3, 3),
            "uv": (count, 3, 2),
            "face_material": (count,),
        }.items():
            if getattr(self, name).shape != shape:
                raise ValueError(
                    f"model {name}: got shape {getattr(self, name).shape}, expected {shape}"
                )
        for name, limit in (("faces", len(self.vertices)), ("face_material", len(self.materials))):
            index = getattr(self, name)
            if count and not 0 <= index.min() <= index.max() < limit:
                raise ValueError(
                    f"model {name}: got indices {index.min()} to {index.max()}, expected 0 to "
                    f"{limit - 1}"
                )

    def corners(self) -> Float[np.ndarray, "f 3 3"]:
        """Positions of the faces' corners."""
        return self.vertices[self.faces]

    @functools.cached_property
    def edges(self) -> Int[np.ndarray, "e 2"]:
        """Pairs of vertices that a face has an edge between, each once."""
        faces = self.faces
        one = np.concatenate([faces[:, 0], faces[:, 1], faces[:, 2]])
        two = np.concatenate([faces[:, 1], faces[:, 2], faces[:, 0]])
        key = np.unique(np.minimum(one, two) * len(self.vertices) + np.maximum(one, two))
        return np.stack(np.divmod(key, len(self.vertices)), axis=1)

    def transformed(self, matrix: Float[np.ndarray, "3 4"]) -> "Model":
        """The model under `matrix[:, :3] @ vertex + matrix[:, 3]`; a mirroring turns faces over."""
        linear = np.asarray(matrix, np.float64)[:, :3]
        determinant = np.linalg.det(linear)
        if not np.isfinite(matrix).all() or determinant == 0:
            raise ValueError(
                f"matrix: got {np.asarray(matrix).tolist()}, expected an invertible one"
            )
        # Normals go with the inverse transpose.
        normals = _unit(self.normals @ np.linalg.inv(linear))
        turn = slice(None, None, -1 if determinant < 0 else 1)
        return dataclasses.replace(
            self,
            vertices=self.vertices @ linear.T + np.asarray(matrix)[:, 3],
            faces=self.faces[:, turn],
            normals=normals[:, turn].astype(np.float32),
            uv=self.uv[:, turn],
        )


# --- Making a model of raw arrays -------------------------------------------------------------


def build(
    vertices: np.ndarray,
    faces: np.ndarray,
    *,
    materials: Sequence[Material] = (),
    face_material: np.ndarray | None = None,
    normals: np.ndarray | None = None,
    uv: np.ndarray | None = None,
    category: str = "",
    model_id: str = "",
    parameters: Mapping[str, Any] | None = None,
    warnings: Sequence[str] = (),
    crease_degrees: float = CREASE_DEGREES,
    max_faces: int = MAX_FACES,
) -> Model:
    """Cleans raw arrays and completes them to a `Model`.

    Dropped: faces whose indices point outside, faces without area, faces of materials that are
    fully transparent, vertices that no face uses. Corner normals that are missing, zero or not
    finite are made by `crease_normals`; a face whose given normals point to its back is turned
    over. Everything dropped in number is told in the warnings.

    Args:
      vertices: [V, 3].
      faces: [F, 3].
      materials: none = one grey material.
      face_material: [F], None = all 0.
      normals: [F, 3, 3] for corners, or None.
      uv: [F, 3, 2] for corners, or None.
      category: see `Model`.
      model_id: see `Model`.
      parameters: see `Model`.
      warnings: see `Model`; more are added.
      crease_degrees: see `crease_normals`.
      max_faces: more are refused.

    Raises:
      UnusableModelError: no face is left, too many faces, vertices that are not finite.
    """
    notes = list(warnings)
    vertices = np.asarray(vertices, np.float64).reshape(-1, 3)
    faces = np.asarray(faces, np.int64).reshape(-1, 3)
    check_face_count(len(faces), max_faces)
    materials = tuple(materials) or (Material(),)
    owner = np.zeros(len(faces), np.int64) if face_material is None else np.asarray(face_material)

    keep = ((faces >= 0) & (faces < len(vertices))).all(axis=1)
    if not keep.all():
        notes.append(f"{int((~keep).sum())} faces with vertices that do not exist dropped")
    seen = np.array([m.opacity >= EXISTS for m in materials])[owner]
    if not seen[keep].all():
        notes.append(f"{int((keep & ~seen).sum())} fully transparent faces dropped")
    keep &= seen
    used = vertices[faces[keep]]
    if not np.isfinite(used).all():
        bad = int((~np.isfinite(used)).any(axis=2).sum())
        raise UnusableModelError(f"{bad} corners of faces have coordinates that are not finite")
    if len(used):
        # Centred: far from the origin the products below would lose all digits.
        extent = float(np.ptp(used.reshape(-1, 3), axis=0).max())
        cross = np.cross(used[:, 1] - used[:, 0], used[:, 2] - used[:, 0])
        flat = np.linalg.norm(cross, axis=1) <= _DEGENERATE * extent**2
        if flat.any():
            notes.append(f"{int(flat.sum())} degenerate faces dropped")
            keep[np.flatnonzero(keep)[flat]] = False
    if not keep.any():
        raise UnusableModelError("the mesh is empty: it has no face with an area")

    faces, owner = faces[keep], owner[keep].astype(np.int64)
    index, flat_faces = np.unique(faces, return_inverse=True)
    vertices, faces = vertices[index], flat_faces.reshape(-1, 3)
    if uv is None:
        texture_coordinates = np.zeros((len(faces), 3, 2), np.float32)
    else:
        texture_coordinates = np.nan_to_num(
            np.asarray(uv, np.float32).reshape(-1, 3, 2)[keep], posinf=0, neginf=0
        )
    given = None if normals is None else np.asarray(normals, np.float64).reshape(-1, 3, 3)[keep]
    if given is not None:
        given = _unit(np.nan_to_num(given, posinf=0, neginf=0))
        flat_normal = face_normals(vertices, faces)
        over = (given.sum(axis=1) * flat_normal).sum(axis=1) < 0
        faces[over] = faces[over][:, ::-1]
        given[over] = given[over][:, ::-1]
        texture_coordinates[over] = texture_coordinates[over][:, ::-1]
    if given is None:
        given = crease_normals(vertices, faces, crease_degrees)
    else:
        missing = (given == 0).all(axis=2)
        if missing.any():
            if not missing.all():
                notes.append(f"{int(missing.sum())} corner normals missing or zero, made anew")
            given = np.where(
                missing[..., None], crease_normals(vertices, faces, crease_degrees), given
            )
    return Model(
        vertices=vertices,
        faces=faces,
        normals=given.astype(np.float32),
        uv=texture_coordinates,
        face_material=owner,
        materials=materials,
        category=category,
        model_id=model_id,
        parameters=dict(parameters or {}),
        warnings=tuple(notes),
    )


def check_face_count(count: int, max_faces: int) -> None:
    """Refuses meshes with more than `max_faces` faces.

    Raises:
      UnusableModelError: there are more.
    """
    if count > max_faces:
        raise UnusableModelError(f"{count} faces are more than the limit of {max_faces}")


def _unit(v: np.ndarray) -> np.ndarray:
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
    """Areas of the faces."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2


def _weld(vertices: np.ndarray) -> np.ndarray:
    """A number [V] for each vertex, equal where positions are (to a 2^-20 of the extent)."""
    low = vertices.min(axis=0)
    extent = max(float((vertices.max(axis=0) - low).max()), 1e-300)
    cells = np.rint((vertices - low) / (extent * _WELD)).astype(np.int64)
    key = (cells[:, 0] << 42) | (cells[:, 1] << 21) | cells[:, 2]
    return np.unique(key, return_inverse=True)[1].reshape(-1)


def crease_normals(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    crease_degrees: float = CREASE_DEGREES,
) -> Float[np.ndarray, "f 3 3"]:
    """Corner normals that are smooth over flat edges and break at sharp ones.

    Two faces that share an edge (by position, whether or not they share vertices) and whose
    normals differ by less than `crease_degrees` share a normal at the edge's ends. A shared normal
    is the mean of the faces' normals, weighted by their angles at the vertex.

    Args:
      vertices: finite.
      faces: with an area.
      crease_degrees: 0 = flat shading, 180 = smooth everywhere.
    """
    count = len(faces)
    corner = _weld(vertices)[faces]
    normal = face_normals(vertices, faces)
    nodes = np.arange(3 * count).reshape(count, 3)
    start, end = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
    start_node, end_node = nodes.ravel(), np.roll(nodes, -1, axis=1).ravel()
    ordered = start < end
    low, high = np.where(ordered, start, end), np.where(ordered, end, start)
    low_node = np.where(ordered, start_node, end_node)
    high_node = np.where(ordered, end_node, start_node)
    key = low * (int(corner.max()) + 1) + high
    order = np.argsort(key, kind="stable")
    links: list[tuple[np.ndarray, np.ndarray]] = []
    limit = np.cos(np.radians(crease_degrees))
    # An edge of a proper surface has two faces. Where more meet, each is compared with the next
    # three, which finds the partners without a cost that grows with the square of their number.
    for offset in (1, 2, 3):
        one, two = order[:-offset], order[offset:]
        same = key[one] == key[two]
        one, two = one[same], two[same]
        smooth = (normal[one // 3] * normal[two // 3]).sum(axis=1) > limit
        one, two = one[smooth], two[smooth]
        links += [(low_node[one], low_node[two]), (high_node[one], high_node[two])]
    rows = np.concatenate([a for a, _ in links])
    columns = np.concatenate([b for _, b in links])
    graph = scipy.sparse.coo_array(
        (np.ones(len(rows), np.int8), (rows, columns)), shape=(3 * count, 3 * count)
    )
    groups, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    triangle = vertices[faces]
    along = _unit(np.roll(triangle, -1, axis=1) - triangle)
    back = -np.roll(along, 1, axis=1)
    angle = np.arccos(np.clip((along * back).sum(axis=2), -1, 1)).ravel()
    each = np.repeat(normal, 3, axis=0)
    total = np.stack([np.bincount(label, angle * each[:, k], groups) for k in range(3)], axis=1)
    result = _unit(total)[label]
    lost = (result == 0).all(axis=1)
    result[lost] = each[lost]
    return result.reshape(count, 3, 3)


def cut_ears(outline: np.ndarray) -> np.ndarray:
    """Triangulates a simple polygon [n, 2], counter-clockwise, by cutting ears: int [n - 2, 3].

    A polygon that crosses itself gives some triangles, as many.
    """
    rest = list(range(len(outline)))
    result = []

    def cross(o: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
        return float((a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]))

    while len(rest) > 3:
        best = 0
        for k in range(len(rest)):
            before, here, after = rest[k - 1], rest[k], rest[(k + 1) % len(rest)]
            a, b, c = outline[before], outline[here], outline[after]
            if cross(a, b, c) <= 0:
                continue
            others = [i for i in rest if i not in (before, here, after)]
            if not any(
                cross(a, b, p) >= 0 and cross(b, c, p) >= 0 and cross(c, a, p) >= 0
                for p in outline[others]
            ):
                best = k
                break
        result.append((rest[best - 1], rest[best], rest[(best + 1) % len(rest)]))
        del rest[best]
    return np.array([*result, tuple(rest)])


# --- The project's frame ----------------------------------------------------------------------


def axis_vector(name: str) -> Float[np.ndarray, " 3"]:
    """The unit vector of a direction of `AXES`.

    Raises:
      ValueError: there is no such direction.
    """
    if name not in AXES:
        raise ValueError(f"axis {name!r}: expected one of {list(AXES)}")
    vector = np.zeros(3)
    vector["xyz".index(name[1])] = 1 if name[0] == "+" else -1
    return vector


def orient(model: Model, up: str = "+y", front: str = "+z") -> Model:
    """Turns a model so that its `up` is +z and its `front` +x.

    Args:
      model: in its file's axes.
      up: one of `AXES`; +y is what OBJ and glTF mean.
      front: one of `AXES`, at right angles to `up`.
    """
    upward, forward = axis_vector(up), axis_vector(front)
    if upward @ forward != 0:
        raise ValueError(f"front {front!r}: expected a direction at right angles to up {up!r}")
    rotation = np.stack([forward, np.cross(upward, forward), upward])
    return model.transformed(np.concatenate([rotation, np.zeros((3, 1))], axis=1))


# Parts of faces smaller than this part of the extent are not divided further.
_SMALL = 0.001


def _faces_with_alpha(model: Model) -> Int[np.ndarray, " n"]:
    """Faces that may have holes."""
    alpha = np.array([m.has_alpha for m in model.materials])
    return np.flatnonzero(alpha[model.face_material])


def _texel_sums(material: Material) -> Int[np.ndarray, "h w"]:
    """How many texels above and left of each place exist."""
    texture = np.full((1, 1, 4), 255) if material.texture is None else material.texture
    exists = texture[..., 3] * (material.opacity / 255.0) >= EXISTS
    return np.pad(exists.cumsum(axis=0, dtype=np.int32).cumsum(axis=1), ((1, 0), (1, 0)))


def _existing_share(
    sums: Int[np.ndarray, "h w"], uv: Float[np.ndarray, "n 3 2"]
) -> Float[np.ndarray, " n"]:
    """Part of the texels that exist, of those in the bounding boxes of triangles."""
    size = np.array(sums.shape[::-1]) - 1
    places = uv * [1, -1] * size
    first = np.floor(places.min(axis=1) + 1e-4).astype(np.int64)
    count = np.ceil(places.max(axis=1) - 1e-4).astype(np.int64) - first
    count = np.clip(count, 1, size)
    first %= size

    def before(place: np.ndarray) -> np.ndarray:
        # Textures repeat.
        (columns, rows), (column, row) = (place // size).T, (place % size).T
        return (
            rows * columns * sums[-1, -1] + rows * sums[-1, column]
            + columns * sums[row, -1] + sums[row, column]
        )  # fmt: skip

    along, down = count * [1, 0], count * [0, 1]
    found = before(first + count) - before(first + along) - before(first + down) + before(first)
    return found / count.prod(axis=1)


def _existing_extremes(
    model: Model,
    faces: Int[np.ndarray, " n"],
    measure: Callable[[np.ndarray], np.ndarray],
    best: Float[np.ndarray, " k"],
) -> Float[np.ndarray, "m 3"]:
    """Existing points of faces at which measures exceed `best`: for each, the largest value.

    Faces are divided into four, again and again, where they exist in part and may hold a larger
    value. A divided part that is as small as `_SMALL` of the extent counts by its corners alone.

    Args:
      model: any.
      faces: that may have holes.
      measure: convex functions of points: [n, 3] to [n, k].
      best: values that are reached elsewhere.
    """
    extent = float(np.ptp(model.vertices, axis=0).max())
    best, chosen = best.copy(), np.full((len(best), 3), np.nan)
    weights = np.tile(np.eye(3), (len(faces), 1, 1))
    sums: dict[tuple[int, float], np.ndarray] = {}
    # From the corners of a triangle to those of its four parts.
    halves = (
        np.array(
            [
                [[2, 0, 0], [1, 1, 0], [1, 0, 1]],
                [[1, 1, 0], [0, 2, 0], [0, 1, 1]],
                [[1, 0, 1], [0, 1, 1], [0, 0, 2]],
                [[0, 1, 1], [1, 0, 1], [1, 1, 0]],
            ]
        )
        / 2
    )

    def reach(at: np.ndarray, points: np.ndarray, values: np.ndarray) -> None:
        reached = np.where(at.reshape(-1, 1), values.reshape(-1, len(best)), -np.inf)
        index = reached.argmax(axis=0)
        value = reached[index, np.arange(len(best))]
        better = value > best
        best[better] = value[better]
        chosen[better] = points.reshape(-1, 3)[index[better]]

    for _ in range(16):
        if not len(faces):
            break
        points = weights @ model.vertices[model.faces[faces]]
        values = measure(points.reshape(-1, 3)).reshape(len(faces), 3, -1)
        corner_exists = opacity_at(model, np.repeat(faces, 3), weights.reshape(-1, 3)) >= EXISTS
        reach(corner_exists, points, values)
        kept = (values.max(axis=1) > best + _SMALL / 2 * extent).any(axis=1)
        if not kept.any():
            break
        faces, weights, points, values = faces[kept], weights[kept], points[kept], values[kept]
        uv = weights @ model.uv[faces].astype(np.float64)
        share = np.zeros(len(faces))
        owner = model.face_material[faces]
        for number in np.unique(owner):
            material, own = model.materials[number], owner == number
            key = (id(material.texture), material.opacity)
            if key not in sums:
                sums[key] = _texel_sums(material)
            share[own] = _existing_share(sums[key], uv[own])
        reach(np.repeat(share == 1, 3), points, values)
        size = np.linalg.norm(points - np.roll(points, 1, axis=1), axis=2).max(axis=1)
        divided = (share > 0) & (share < 1) & (size > _SMALL * extent)
        faces = np.repeat(faces[divided], 4)
        weights = np.einsum("pij,njk->npik", halves, weights[divided]).reshape(-1, 3, 3)
    return np.unique(chosen[np.isfinite(chosen[:, 0])], axis=0)


def outline(
    model: Model, measure: Callable[[np.ndarray], np.ndarray] | None = None
) -> Float[np.ndarray, "n 3"]:
    """Points that stick out as far as what is drawn: all vertices, if no texture has alpha.

    With such textures, the vertices of the faces without them, and of the others the existing
    points with the largest measures.

    Args:
      model: any.
      measure: convex functions of points, [n, 3] to [n, k]; None = the extent in 260 directions,
        those of the axes among them.
    """
    faces = _faces_with_alpha(model)
    if not len(faces):
        return model.vertices
    if measure is None:
        turn = np.pi * (3 - np.sqrt(5)) * np.arange(254)
        height = (np.arange(254) + 0.5) / 127 - 1
        ring = np.sqrt(1 - height**2)
        spread = np.stack([ring * np.cos(turn), ring * np.sin(turn), height], axis=1)
        directions = np.concatenate([np.eye(3), -np.eye(3), spread]).T
        measure = lambda points: points @ directions  # noqa: E731
    whole = np.ones(len(model.faces), bool)
    whole[faces] = False
    points = model.vertices[np.unique(model.faces[whole])]
    best = np.full(measure(model.vertices[:1]).shape[1], -np.inf)
    if len(points):
        best = measure(points).max(axis=0)
    return np.concatenate([points, _existing_extremes(model, faces, measure, best)])


# A model is in stray parts if an empty gap takes this part of its extent, and what lies on either
# side is smaller than that. Of FlightGear's 494 models that load, one has a gap of over 0.6 (0.93;
# the next have 0.45 and 0.25), of 82 pieces of Sweet Home 3D none has more than 0.12.
_STRAY_GAP, _STRAY_SIZE = 0.6, 0.15


def _check_strays(model: Model) -> None:
    """Refuses models that consist of parts far from one another.

    Raises:
      UnusableModelError: names the smaller part.
    """
    corners = model.corners()
    low, high = corners.min(axis=1), corners.max(axis=1)
    extent = float((high.max(axis=0) - low.min(axis=0)).max())
    for axis in range(3):
        order = np.argsort(low[:, axis], kind="stable")
        reached = np.maximum.accumulate(high[order, axis])
        gaps = low[order[1:], axis] - reached[:-1]
        if not len(gaps) or gaps.max() <= _STRAY_GAP * extent:
            continue
        index = int(gaps.argmax()) + 1
        sizes = [
            np.ptp(corners[side].reshape(-1, 3), axis=0).max()
            for side in (order[:index], order[index:])
        ]
        if max(sizes) > _STRAY_SIZE * extent:
            continue
        sides = sorted((order[:index], order[index:]), key=lambda s: face_areas(
            model.vertices, model.faces[s]).sum())  # fmt: skip
        names = sorted({model.materials[i].name for i in model.face_material[sides[0]]} - {""})
        centre = ", ".join(f"{c:.3g}" for c in corners[sides[0]].mean(axis=(0, 1)))
        raise UnusableModelError(
            f"a stray part of {len(sides[0])} faces"
            + (f" (material {', '.join(names[:3])})" if names else "")
            + f" around ({centre}): {gaps.max() / extent:.0%} of the model's extent are empty "
            "between it and the rest"
        )


def normalize(model: Model) -> Model:
    """Moves and scales a model to the project's frame; its axes must be right already (`orient`).

    The lowest point comes to z = 0, the centre of the bounding box to x = y = 0, the farthest
    point to distance 1 from the origin: the radius of the bounding hemisphere is 1. Only what is
    drawn counts: what an alpha texture hides may lie outside. With alpha textures, the bounds are
    exact to 0.002 of the extent.

    Raises:
      UnusableModelError: the model has no extent, or one that overflows; or it has stray parts
        far away, beside which the object would be a dot.
    """
    _check_strays(model)
    points = outline(model, lambda points: np.concatenate([points, -points], axis=1))
    if not len(points):
        raise UnusableModelError("nothing of the surface exists: its textures are transparent")
    low, high = points.min(axis=0), points.max(axis=0)
    origin = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])

    def distance(points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points - origin, axis=1, keepdims=True)

    with np.errstate(over="ignore"):
        radius = float(distance(outline(model, distance)).max())
    if not (np.isfinite(radius) and radius > 0):
        raise UnusableModelError(f"the model's radius is {radius:g}")
    return dataclasses.replace(model, vertices=(model.vertices - origin) / radius)


# --- The surface ------------------------------------------------------------------------------


class SurfaceSample(NamedTuple):
    """Points of a surface: positions, unit normals, and the faces they lie on."""

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    face: Int[np.ndarray, " n"]


def opacity_at(
    model: Model, face: Int[np.ndarray, " n"], weights: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, " n"]:
    """Opacity at points of faces: the material's times the alpha of the nearest texel.

    Args:
      model: with textures.
      face: indices of faces.
      weights: barycentric coordinates of the points.
    """
    owner = model.face_material[face]
    result = np.array([m.opacity for m in model.materials])[owner]
    for index, material in enumerate(model.materials):
        if not material.has_alpha:
            continue
        here = np.flatnonzero(owner == index)
        uv = (model.uv[face[here]] * weights[here][..., None]).sum(axis=1)
        result[here] *= texels(material.texture, uv)[:, 3] / 255.0
    return result


def texels(
    texture: UInt8[np.ndarray, "h w 4"] | None, uv: Float[np.ndarray, "n 2"]
) -> UInt8[np.ndarray, "n 4"]:
    """The nearest texel at each coordinate; the texture repeats, its first row is at v = 1."""
    if texture is None:
        return np.full((len(uv), 4), 255, np.uint8)
    height, width = texture.shape[:2]
    wrapped = uv - np.floor(uv)
    column = np.minimum((wrapped[:, 0] * width).astype(np.int64), width - 1)
    row = np.minimum(((1 - wrapped[:, 1]) * height).astype(np.int64), height - 1)
    return texture[row, column]


# Cells along the extent in which the air around a model is looked for.
_AIR_CELLS = 96

# Surfaces nearer than this part of the extent, and parallel, are one.
_COINCIDENT = 1e-4
_PARALLEL = float(np.cos(np.radians(2.0)))

# Cells along an edge of the grid in which faces around a point are looked up, and entries in it.
_BINS = 32
# Faces are looked up by the direction of their plane as well, in steps of this.
_DIRECTIONS = 10
_MAX_BINNED = 3_000_000


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    result: np.ndarray = np.einsum("nd,nd->n", a, b)
    return result


class _Twins:
    """Which of the faces that lie on one another at a point stands for all of them."""

    def __init__(self, model: Model) -> None:
        self._model = model
        self._has_alpha = len(_faces_with_alpha(model)) > 0
        corners = model.corners()
        # Affine functions of a point for each face: its distance from the face's plane, and its
        # second and third barycentric coordinates there.
        origin, one, two = np.moveaxis(corners, 1, 0)
        one, two = one - origin, two - origin
        cross = np.cross(one, two)
        square = np.maximum(_dot(cross, cross), 1e-300)[:, None]
        normal = cross / np.sqrt(square)
        self._forms = np.stack(
            [normal, np.cross(two, cross) / square, np.cross(cross, one) / square], axis=1
        )
        self._offsets = -np.einsum("nij,nj->ni", self._forms, origin)
        low, high = corners.min(axis=1), corners.max(axis=1)
        self._low = low.min(axis=0)
        extent = float((high.max(axis=0) - self._low).max())
        self._tolerance = _COINCIDENT * extent
        for bins in (_BINS, 16, 8, 4, 2, 1):
            self._bins, self._scale = bins, bins / (extent * (1 + 1e-9))
            first = self._cell(low - self._tolerance)
            size = self._cell(high + self._tolerance) - first + 1
            count = size.prod(axis=1)
            if count.sum() <= _MAX_BINNED:
                break
        # Directions of planes. Steps and signs change where no model has planes in number.
        turned = np.where(normal @ [0.3713, 0.6137, 0.6969] < 0, -1, 1)[:, None] * normal
        step = np.floor((turned + 1) * (_DIRECTIONS / 2) + 0.371).astype(np.int64)
        self._direction = step @ ((_DIRECTIONS + 1) ** np.arange(3))
        # The faces of each cell and direction, one after another.
        owner, number = _repeat(count)
        x, rest = np.divmod(number, (size[:, 1] * size[:, 2])[owner])
        y, z = np.divmod(rest, size[owner, 2])
        key = self._key(first[owner] + np.stack([x, y, z], axis=1), owner)
        order = np.argsort(key, kind="stable")
        self._faces, key = owner[order], key[order]
        begin = np.flatnonzero(np.diff(key, prepend=-1))
        # A face alone in its place has no twin there.
        size_ = np.diff(begin, append=len(key))
        self._keys, self._start, self._count = (a[size_ > 1] for a in (key[begin], begin, size_))

    def _cell(self, points: np.ndarray) -> np.ndarray:
        scaled = np.floor((points - self._low) * self._scale).astype(np.int64)
        return scaled.clip(0, self._bins - 1)

    def _key(self, cell: np.ndarray, face: np.ndarray) -> np.ndarray:
        x, y, z = cell.T
        result: np.ndarray = ((x * self._bins + y) * self._bins + z) * (
            (_DIRECTIONS + 1) ** 3
        ) + self._direction[face]
        return result

    def first(
        self, points: Float[np.ndarray, "n 3"], face: Int[np.ndarray, " n"]
    ) -> tuple[Int[np.ndarray, " n"], Bool[np.ndarray, " n"]]:
        """For points of faces: the first existing face there, and whether another has its back."""
        result, both = face.copy(), np.zeros(len(face), bool)
        if not len(self._keys):
            return result, both
        key = self._key(self._cell(points), face)
        place = np.searchsorted(self._keys, key).clip(0, len(self._keys) - 1)
        count = np.where(self._keys[place] == key, self._count[place], 0)
        start = self._start[place]
        group = np.floor(np.cumsum(count) / _POINTS_AT_ONCE).astype(np.int64)
        for part in np.split(np.arange(len(points)), np.flatnonzero(np.diff(group)) + 1):
            owner, number = _repeat(count[part])
            owner = part[owner]
            other = self._faces[start[owner] + number]
            kept = other != face[owner]
            owner, other = owner[kept], other[kept]
            away, s, t = (
                np.einsum("nij,nj->in", self._forms[other], points[owner], optimize=False)
                + self._offsets[other].T
            )
            here = np.flatnonzero(
                (np.abs(away) <= self._tolerance) & (s >= 0) & (t >= 0) & (s + t <= 1)
            )
            owner, other, s, t = owner[here], other[here], s[here], t[here]
            cosine = _dot(self._forms[other, 0], self._forms[face[owner], 0])
            here = np.abs(cosine) > _PARALLEL
            if self._has_alpha:
                weights = np.stack([1 - s - t, s, t], axis=1)
                here &= opacity_at(self._model, other, weights) >= EXISTS
            owner, other, cosine = owner[here], other[here], cosine[here]
            np.minimum.at(result, owner, other)
            both[owner[cosine < 0]] = True
        return result, both


def _toward_air(
    model: Model, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]
) -> Int[np.ndarray, " n"]:
    """1 where air is in front of a surface and matter behind it, -1 the other way round, else 0.

    Air is found as in `solid_occupancy`. The first cell along the normal counts that the surface
    does not pass through, up to three cells away.
    """
    size = _AIR_CELLS
    low = model.vertices.min(axis=0)
    # As large as fits into the grid, with some air around.
    scale = (size - 4) / float(np.ptp(model.vertices, axis=0).max())
    corners = (model.vertices - low) * scale + [2, 2, 0]
    marked, _ = _mark_surface(corners, model.faces, model.edges, size)
    outside = np.pad(_outside(marked), 4, constant_values=True)
    marked = np.pad(marked, 4)
    sides = []
    for sign in (1, -1):
        side = np.zeros(len(points), np.int64)
        for distance in (1.0, 1.75, 2.5, 3.25):
            place = (points - low) * scale + [2, 2, 0] + sign * distance * normals
            cell = tuple((np.floor(place).astype(np.int64) + 4).clip(0, size + 7).T)
            side = np.where((side == 0) & ~marked[cell], np.where(outside[cell], 1, -1), side)
        sides.append(side)
    return np.sign(sides[0] - sides[1]) * (sides[0] * sides[1] == -1)


def sample_surface(model: Model, n: int, seed: int) -> SurfaceSample:
    """`n` points uniform by area on the surfaces that exist, with interpolated normals.

    Points that fall where the opacity is under `EXISTS`, such as the holes of an alpha map, are
    drawn again elsewhere. The draw is stratified by cumulated area, which covers the faces more
    evenly than independent points. The same seed gives the same points.

    Surfaces that lie on one another count once: a point is drawn again unless its face is the
    first of those there. Where these face both ways, the normal points to the air around the
    object, if there is any on one side alone. The normals of a connected part all turn over if
    it can be told of half of them, and nine tenths of these point inward.

    Args:
      model: any; the points are in its frame.
      n: number of points, at least 1.
      seed: of the draw.

    Returns:
      float32 points and normals [n, 3], and the faces [n].

    Raises:
      UnusableModelError: hardly any surface exists.
    """
    if n < 1:
        raise ValueError(f"number of points: got {n}, expected at least 1")
    rng = np.random.default_rng(seed)
    cumulated = np.cumsum(face_areas(model.vertices, model.faces))
    has_alpha = len(_faces_with_alpha(model)) > 0
    twins = _Twins(model)
    faces, weights, two_sided, count = [], [], [], 0
    for _ in range(200):
        missing = n - count
        at = (np.arange(missing) + rng.random(missing)) / missing * cumulated[-1]
        face = np.minimum(np.searchsorted(cumulated, at, side="right"), len(cumulated) - 1)
        # The square root makes the points uniform over the triangle.
        root, other = np.sqrt(rng.random(missing)), rng.random(missing)
        weight = np.stack([1 - root, root * (1 - other), root * other], axis=1)
        if has_alpha:
            exists = opacity_at(model, face, weight) >= EXISTS
            face, weight = face[exists], weight[exists]
        points = np.einsum("nk,nkd->nd", weight, model.vertices[model.faces[face]])
        first, both = twins.first(points, face)
        kept = first == face
        faces.append(face[kept])
        weights.append(weight[kept])
        two_sided.append(both[kept])
        count += int(kept.sum())
        if count == n:
            break
    else:
        raise UnusableModelError("hardly any of the surface exists: its textures are transparent")
    face, weight = np.concatenate(faces), np.concatenate(weights)
    points = np.einsum("nk,nkd->nd", weight, model.vertices[model.faces[face]])
    normals = _unit(np.einsum("nk,nkd->nd", weight, model.normals[face].astype(np.float64)))
    lost = (normals == 0).all(axis=1)
    flat = face_normals(model.vertices, model.faces[face])
    normals[lost] = flat[lost]
    normals[_inward(model, points, flat, face, np.concatenate(two_sided))] *= -1
    return SurfaceSample(points.astype(np.float32), normals.astype(np.float32), face)


def _inward(
    model: Model,
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    face: Int[np.ndarray, " n"],
    two_sided: Bool[np.ndarray, " n"],
) -> Bool[np.ndarray, " n"]:
    """Which points' normals point into the object, see `sample_surface`."""
    parts, open_ = _parts(model)
    a, b, c = np.moveaxis(model.vertices[model.faces] - model.vertices.mean(axis=0), 1, 0)
    volume = np.bincount(parts, _dot(a, np.cross(b, c)))
    # Closed parts with the right volume need no look.
    asked = two_sided | (open_ | (volume < 0))[parts[face]]
    result = np.zeros(len(face), bool)
    if not asked.any():
        return result
    index = np.flatnonzero(asked)
    side = _toward_air(model, points[index], normals[index])
    part, both = parts[face[index]], two_sided[index]
    inward = np.bincount(part[~both], side[~both] == -1, len(open_))
    told = np.bincount(part[~both], side[~both] != 0, len(open_))
    whole = np.bincount(part[~both], minlength=len(open_))
    over = (inward >= 0.9 * told) & (told >= 0.5 * whole) & (told > 0)
    result[index] = np.where(both, side == -1, over[part])
    return result


def _parts(model: Model) -> tuple[Int[np.ndarray, " f"], Bool[np.ndarray, " p"]]:
    """A number for each face, equal where faces are connected by edges walked in both directions.

    A part has one orientation. And which parts are open: an edge of theirs is walked but once.
    """
    corner = _weld(model.vertices)[model.faces].astype(np.int64)
    start, end = corner.ravel(), np.roll(corner, -1, axis=1).ravel()
    span = int(corner.max()) + 1
    forward, back = start * span + end, end * span + start
    order = np.argsort(forward, kind="stable")
    place = np.searchsorted(forward[order], back)
    place = place.clip(0, len(order) - 1)
    met = forward[order[place]] == back
    count = len(model.faces)
    owner = np.repeat(np.arange(count), 3)
    graph = scipy.sparse.coo_array(
        (np.ones(int(met.sum()), np.int8), (owner[met], order[place][met] // 3)),
        shape=(count, count),
    )
    number, label = scipy.sparse.csgraph.connected_components(graph, directed=False)
    return label, np.bincount(label[owner], ~met, number) > 0


# --- Occupancy --------------------------------------------------------------------------------

# Small cells along the edge of a cell of the grid. Odd: of two or four centres across a cell, the
# half that decides would be inside already where the surface is a quarter or an eighth short of
# the cell's middle, and flat objects would come out too thick.
_FINE = 3

# How far beside a triangle a line still counts as meeting it, in small cells. It is far above the
# rounding of coordinates, so that no line slips between two triangles that share an edge.
_TOLERANCE = 1e-6

# Meeting points with the lines of one axis, from above: seconds. Only a hostile model has more.
_MAX_POINTS = 10_000_000
_POINTS_AT_ONCE = 1_000_000

# Distance of the points that stand for an edge, in small cells.
_SPACING = 0.7


def _repeat(counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For `counts[i]` items of each i: the owners i, and the items' numbers from 0."""
    owner = np.repeat(np.arange(len(counts)), counts)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)


def _centres_between(low: np.ndarray, high: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    """The first cell whose centre lies in [low, high], and how many do; within the grid."""
    first = np.maximum(np.ceil(low - (0.5 + _TOLERANCE)), 0)
    last = np.minimum(np.floor(high + (_TOLERANCE - 0.5)), size - 1)
    return first, np.maximum(last - first + 1, 0).astype(np.int64)


def _bounds(values: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The least and the largest of each face's three values; faster than reductions."""
    a, b, c = (values[column] for column in faces.T)
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def _line_hits(
    corners: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], axis: int, size: int
) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Where triangles meet the lines along an axis through the centres of a grid's cells.

    Each triangle is cut into rows of lines and each row into lines. A triangle's border counts, so
    a line through a common edge meets at least one of the triangles there.

    Args:
      corners: positions, unit = the edge of a cell.
      faces: indices into `corners`.
      axis: along which the lines run.
      size: cells along an edge of the grid.

    Yields:
      Cells of the lines along the next two axes (in cyclic order), and the place on the line.

    Raises:
      UnusableModelError: that would be more than `_MAX_POINTS`.
    """
    u, v, w = (np.ascontiguousarray(corners[:, (axis + k) % 3]) for k in (1, 2, 0))
    first, rows = _centres_between(*_bounds(v, faces), size)
    rows *= _centres_between(*_bounds(u, faces), size)[1] > 0
    kept = np.flatnonzero(rows)
    faces, first, rows = faces[kept], first[kept], rows[kept]
    if not len(faces):
        return
    faces = np.take_along_axis(faces, v[faces].argsort(axis=1, kind="stable"), axis=1)
    low, middle, high = faces.T
    width = _centres_between(*_bounds(u, faces), size)[1]
    # The rows of a triangle are half as long as its width on average.
    bound = rows * (width / 2 + 1)
    if bound.sum() > _MAX_POINTS:
        raise UnusableModelError(
            f"the surface crosses {bound.sum():.2g} lines of cells, more than {_MAX_POINTS:.2g}: "
            "it is too much to voxelise"
        )
    group = np.floor(np.cumsum(bound) / _POINTS_AT_ONCE).astype(np.int64)
    for part in np.split(np.arange(len(faces)), np.flatnonzero(np.diff(group)) + 1):
        owner, number = _repeat(rows[part])
        owner = part[owner]
        row = first[owner] + number
        # Both ends of the row: on the edge from the lowest corner to the highest, and on the other.
        at = row + 0.5
        lower = at <= v[middle[owner]]
        begin = np.where(lower, low[owner], middle[owner])
        end = np.where(lower, middle[owner], high[owner])
        span = v[end] - v[begin]
        along = np.where(
            span > 0, np.clip((at - v[begin]) / np.where(span > 0, span, 1), 0, 1), lower
        )
        one_u, one_w = (c[begin] + along * (c[end] - c[begin]) for c in (u, w))
        begin, end = low[owner], high[owner]
        along = np.clip((at - v[begin]) / np.maximum(v[end] - v[begin], 1e-300), 0, 1)
        two_u, two_w = (c[begin] + along * (c[end] - c[begin]) for c in (u, w))
        over = one_u > two_u
        one_u, two_u = np.where(over, two_u, one_u), np.where(over, one_u, two_u)
        one_w, two_w = np.where(over, two_w, one_w), np.where(over, one_w, two_w)
        start, columns = _centres_between(one_u, two_u, size)
        slope = (two_w - one_w) / np.maximum(two_u - one_u, 1e-300)
        owner, number = _repeat(columns)
        column = start[owner] + number
        place = np.clip(
            one_w[owner] + (column + 0.5 - one_u[owner]) * slope[owner],
            np.minimum(one_w, two_w)[owner],
            np.maximum(one_w, two_w)[owner],
        )
        yield column.astype(np.int64), row[owner].astype(np.int64), place


def _edge_points(corners: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Points [n, 3] on edges [E, 2], at most `_SPACING` apart, and all corners."""
    along = corners[edges[:, 1]] - corners[edges[:, 0]]
    steps = np.ceil(np.sqrt(_dot(along, along)) / _SPACING).astype(np.int64)
    inner = np.flatnonzero(steps > 1)
    owner, number = _repeat(steps[inner] - 1)
    owner = inner[owner]
    part = (number + 1) / steps[owner]
    return np.concatenate([corners, corners[edges[owner, 0]] + part[:, None] * along[owner]])


def _mark_surface(
    corners: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    edges: Int[np.ndarray, "e 2"],
    size: int,
) -> tuple[Bool[np.ndarray, "n n n"], list[Bool[np.ndarray, "n n n"]]]:
    """Cells that a surface passes through, so that no air gets across it from cell to cell.

    Marked are the cells that contain
      - a point where the surface meets a line along an axis through the cells' centres, and
      - a point of an edge or a corner of a triangle, which keeps parts thinner than a cell.

    No leak: let the surface meet the segment between the centres of two cells with a common face.
    The segment lies on one of the lines, and in these two cells; so does the meeting point, and
    one of the two is marked. Air that steps from the centre of an unmarked cell to that of an
    unmarked neighbour has not crossed the surface, whatever the shape of the triangles. (A segment
    that lies in a triangle's plane is of no concern: where it leads inside of a closed surface, a
    segment beside it does so, too, through a triangle that is not parallel to it, and whose border
    the first segment touches at least.) Rounding moves a meeting point by far less than half a
    cell, which is what it would take to mark neither.

    Args:
      corners: positions, unit = the edge of a cell; the grid spans [0, size] on each axis. What
        sticks out is not marked.
      faces: indices into `corners`.
      edges: of the faces, indices into `corners`.
      size: cells along an edge of the grid.

    Returns:
      The marked cells, and for each axis whether the surface lies between the centre of a cell and
      that of the next.

    Raises:
      UnusableModelError: it would take minutes.
    """
    marked = np.zeros((size, size, size), bool)
    crossed = []
    strides = size ** np.arange(2, -1, -1)
    for axis in range(3):
        between = np.zeros((size, size, size), bool)
        step = strides[axis]
        for column, row, place in _line_hits(corners, faces, axis, size):
            line = column * strides[(axis + 1) % 3] + row * strides[(axis + 2) % 3]
            # A point on the grid's border belongs to the cell inside.
            cell = np.floor(place).astype(np.int64)
            cell[(place > -_TOLERANCE) & (place < 0)] = 0
            cell[(place >= size) & (place < size + _TOLERANCE)] = size - 1
            here = (cell >= 0) & (cell < size)
            marked.reshape(-1)[line[here] + cell[here] * step] = True
            cell = np.floor(place - 0.5).astype(np.int64)
            here = (cell >= 0) & (cell < size - 1)
            between.reshape(-1)[line[here] + cell[here] * step] = True
        crossed.append(between)
    cell = np.floor(_edge_points(corners, edges)).astype(np.int64)
    cell -= cell == size
    cell = cell[((cell >= 0) & (cell < size)).all(axis=1)]
    marked.reshape(-1)[cell @ strides] = True
    return marked, crossed


def _outside(blocked: np.ndarray) -> np.ndarray:
    """Cells that air reaches from the border; it passes through faces, and never from below."""
    padded = np.pad(~blocked, ((1, 1), (1, 1), (0, 1)), constant_values=True)
    label, _ = scipy.ndimage.label(padded)
    return (label == label[0, 0, -1])[1:-1, 1:-1, :-1]


def _with_border(
    outside: np.ndarray, marked: np.ndarray, crossed: Sequence[np.ndarray]
) -> np.ndarray:
    """Outside cells, and those marked cells whose centre is outside.

    That is so if a neighbour's centre is, and the surface does not lie between the two. Two steps:
    beyond lie marked cells with none but marked ones around.
    """
    for _ in range(2):
        reached = np.zeros_like(outside)
        for axis, between in enumerate(crossed):
            first = tuple(slice(None, -1) if k == axis else slice(None) for k in range(3))
            second = tuple(slice(1, None) if k == axis else slice(None) for k in range(3))
            free = ~between[first]
            reached[first] |= outside[second] & free
            reached[second] |= outside[first] & free
        outside = outside | (marked & reached)
    return outside


def _in_cells(fine: np.ndarray) -> np.ndarray:
    """How many of the small cells of each large cell [x, y, z] are true."""
    counts = fine.view(np.uint8)
    # Sums of slices, axis after axis: one reduction over three axes takes fifty times as long.
    for axis in range(3):
        first, *others = (counts[*[slice(None)] * axis, start::_FINE] for start in range(_FINE))
        counts = first.copy()
        for part in others:
            counts += part
    return counts


def solid_occupancy(
    model: Model, rotation: Float[np.ndarray, "3 3"], size: int = schema.OCCUPANCY_SIZE
) -> Bool[np.ndarray, "size size size"]:
    """Solid voxels of a model, which need not be watertight.

    The grid is the schema's: indexed [x, y, z], it covers [-1, 1] x [-1, 1] x [0, 2] of the frame
    that `rotation` turns the model into; cell (i, j, k) spans [-1 + 2 i / size, -1 + 2 (i+1) /
    size] in x, the same in y, and [2 k / size, 2 (k+1) / size] in z.

    The rule:
      1. The surface is marked in small cells of a third of the edge, without gaps
         (`_mark_surface`).
      2. Outside is what air reaches from the border without crossing it; it does not come through
         the ground, so an object without a bottom is solid. All else is inside. A marked small
         cell is inside or outside as its centre is.
      3. The same is done with the large cells: what is closed at their size (cracks and gaps under
         a cell) is solid, too.
      4. A cell is occupied if at least half of its small cells are inside.
      5. Thin parts are kept: a cell with small cells that are marked or inside is occupied as well
         if neither it nor any of its 26 neighbours is by 4. So is, of thin sheets and bars,
         everything that is a cell or more away from thicker parts.

    Args:
      model: in the project's frame, normalised. What sticks out of the grid is not counted.
      rotation: to the frame of the grid, such as the one that turns the model to its view.
      size: cells along an edge.

    Raises:
      UnusableModelError: the area is so large that marking it would take minutes.
    """
    fine = size * _FINE
    corners = (model.vertices @ np.asarray(rotation, np.float64).T + [1, 1, 0]) * (fine / 2)
    marked, crossed = _mark_surface(corners, model.faces, model.edges, fine)
    touched = _in_cells(marked) > 0
    # The flood runs in the part of the grid that the object fills, with air around it.
    if not touched.any():
        return touched
    large = [slice(int(i.min()), int(i.max()) + 1) for i in np.nonzero(touched)]
    large[2] = slice(0, large[2].stop)
    x, y, z = (slice(s.start * _FINE, s.stop * _FINE) for s in large)
    marked = marked[x, y, z]
    outside = _outside(marked)
    inside = ~_with_border(outside, marked, [c[x, y, z] for c in crossed])
    thick = ~_outside(touched) & ~touched
    thick[*large] |= _in_cells(inside) >= _FINE**3 // 2 + 1
    thin = np.zeros_like(touched)
    thin[*large] = _in_cells(~outside) > 0
    near = scipy.ndimage.maximum_filter(thick, size=3)
    return thick | (thin & ~near)

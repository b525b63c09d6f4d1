"""Parts of a model as files describe them, polygons with colours, and their arrays.

All readers of files end here, so that their polygons, colours and indices get the same treatment.
"""

import collections
import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from data_gen.mesh import Material, UnusableModelError, check_face_count
from data_gen.polygons import MOST_CORNERS, triangles


@dataclasses.dataclass
class Part:
    """Polygons, whose corners follow each other in all arrays.

    Attributes:
      vertices: [V, 3].
      counts: number of corners [P] of each polygon.
      corners: the vertices [C] of the polygons' corners, in order.
      materials: None = the file gives no material.
      owner: index [P] into `materials`; None = all 0.
      uv, normals: of the corners, [C, 2] and [C, 3], or None.
      colours: of the corners, display RGBA [C, 4] in [0, 1], or None.
    """

    vertices: np.ndarray
    counts: np.ndarray
    corners: np.ndarray
    materials: Sequence[Material | None] = (None,)
    owner: np.ndarray | None = None
    uv: np.ndarray | None = None
    normals: np.ndarray | None = None
    colours: np.ndarray | None = None


def joined(parts: Sequence[Part], warn: Callable[..., None], max_faces: int) -> dict[str, Any]:
    """The parts as the arrays of `mesh.build_model`.

    Polygons with less than three corners or with missing vertices are dropped with a warning. The
    colours of corners are averaged over each triangle and multiply the diffuse colour. They do not
    change a texture, which gives a warning.

    Raises:
      UnusableModelError: nothing is left, there are too many triangles, or a vertex is not finite.
    """
    blocks: dict[str, list[np.ndarray]] = collections.defaultdict(list)
    table: list[Material] = []
    offset = few = lost = 0
    check_face_count(sum(int(np.maximum(p.counts - 2, 0).sum()) for p in parts), max_faces)
    for part in parts:
        counts, corners = np.asarray(part.counts, np.int64), np.asarray(part.corners, np.int64)
        polygon = np.repeat(np.arange(len(counts)), counts)
        outside = (corners < 0) | (corners >= len(part.vertices))
        broken = np.bincount(polygon[outside], minlength=len(counts)) > 0
        few, lost = few + int((counts < 3).sum()), lost + int(broken[counts > 2].sum())
        keep = (counts > 2) & ~broken
        if not keep.any():
            continue
        owner = np.zeros(len(counts), np.int64) if part.owner is None else part.owner
        place = np.flatnonzero(keep[polygon])  # of the kept corners in the arrays of the part
        counts, corners, owner = counts[keep], corners[place], owner[keep]
        if not np.isfinite(part.vertices[corners]).all():
            raise UnusableModelError("vertices have coordinates that are not finite")
        if (many := counts > MOST_CORNERS).any():
            warn(f"polygons with more than {MOST_CORNERS} corners, bays may be filled", many.sum())
        triangle, polygon = triangles(counts, corners, part.vertices)
        fields = {"uv": 2, "normals": 3, "colours": 4}
        of_corners: dict[str, np.ndarray] = {}
        for field, width in fields.items():
            given = getattr(part, field)
            if given is not None:
                of_corners[field] = given[place][triangle]
            else:
                of_corners[field] = np.zeros((len(triangle), 3, width))
        used, owner = np.unique(owner[polygon], return_inverse=True)
        materials = [part.materials[index] for index in used]
        if part.colours is not None:
            _paint(of_corners["colours"].mean(axis=1), owner, materials, of_corners["uv"], warn)
        blocks["vertices"].append(np.asarray(part.vertices, np.float64))
        blocks["faces"].append(corners[triangle] + offset)
        blocks["normals"].append(of_corners["normals"])
        blocks["uv"].append(of_corners["uv"])
        blocks["face_material"].append(owner + len(table))
        table += [Material() if material is None else material for material in materials]
        offset += len(part.vertices)
    for number, what in ((few, "less than three corners"), (lost, "missing vertices")):
        if number:
            warn(f"faces with {what} dropped", number)
    if not blocks:
        why = "all faces have missing vertices" if lost else "no faces, expected at least one"
        raise UnusableModelError(f"the mesh is empty: {why}")
    arrays: dict[str, Any] = {name: np.concatenate(arrays) for name, arrays in blocks.items()}
    if not arrays["normals"].any():
        arrays["normals"] = None
    return {**arrays, "materials": table}


def _paint(
    colours: np.ndarray,
    owner: np.ndarray,
    materials: list[Material | None],
    uv: np.ndarray,
    warn: Callable[..., None],
) -> None:
    """Gives the faces of materials without texture their colours: changes `materials` and `uv`."""
    if not colours[:, 3].any():
        warn("alpha 0 in all colours, opaque is used")
        colours[:, 3] = 1
    for index in np.unique(owner):
        chosen = owner == index
        material = materials[index]
        if material is not None and material.texture is not None:
            if (colours[chosen] < 0.998).any():
                warn("colours of faces with a texture not used")
            continue
        levels = (255 * np.nan_to_num(colours[chosen]).clip(0, 1)).round().astype(np.uint8)
        painted, uv[chosen] = palette(levels)
        if material is not None:
            painted = dataclasses.replace(material, texture=painted.texture)
        materials[index] = painted


def picked(values: np.ndarray, index: np.ndarray) -> np.ndarray | None:
    """The rows of values at indices, 0 where there is no such row; None if there is none at all."""
    good = (index >= 0) & (index < len(values))
    if not good.any():
        return None
    return np.where(good[:, None], values[np.where(good, index, 0)], 0)


def rgba(colours: np.ndarray, white: float = 0) -> np.ndarray:
    """RGB or RGBA [n, 3 or 4] as RGBA in [0, 1]; white = 0: it is 1, or 255 if a value is above 1.

    Colours that are not numbers become grey.
    """
    colours = np.pad(
        colours[:, :4], ((0, 0), (0, max(4 - colours.shape[1], 0))), constant_values=np.nan
    )
    colours = colours / (white or (255 if (colours[:, :3] > 1).any() else 1))
    return np.where(np.isnan(colours), (*Material().diffuse, 1.0), colours)


def palette(colours: np.ndarray) -> tuple[Material, np.ndarray]:
    """A material and uv [F, 3, 2] that give each face its colour, uint8 [F, 4] to 5 bits."""
    key = (colours.astype(np.int64) >> 3) @ np.array([1 << 15, 1 << 10, 1 << 5, 1])
    distinct, first, index = np.unique(key, return_index=True, return_inverse=True)
    width = int(np.ceil(np.sqrt(len(distinct))))
    # Unused texels repeat the last colour: an opaque palette has no alpha, which is slow to handle.
    texture = np.pad(colours[first], ((0, width * width - len(distinct)), (0, 0)), mode="edge")
    column, row = index % width, index // width
    uv = np.stack([(column + 0.5) / width, 1 - (row + 0.5) / width], axis=1)
    return (
        Material(diffuse=(1.0, 1.0, 1.0), texture=texture.reshape(width, width, 4), name="colours"),
        np.repeat(uv[:, None], 3, axis=1),
    )

"""Parts, the result of all readers: polygons with colours. `joined` makes the arrays of a model.

So all formats share the treatment of polygons, textures and colours.
"""

import collections
import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from data_gen.mesh import GREY, Material, UnusableModelError
from data_gen.polygons import MOST_CORNERS, triangles
from data_gen.readers.textures import Assets, repeated
from psgn_jax.system.untrusted import one_line


@dataclasses.dataclass(frozen=True, eq=False)
class Look:
    """A material and its use.

    Attributes:
      material: may have a texture.
      uv_matrix: [2, 3], maps texture coordinates (u, v, 1) to those of the texture; None = equal.
      wraps: the texture outside [0, 1] along u and v: "repeat", "mirror" or "clamp".
      tinted: whether colours of faces multiply the texture; otherwise the texture hides them.
    """

    material: Material
    uv_matrix: np.ndarray | None = None
    wraps: tuple[str, str] = ("repeat", "repeat")
    tinted: bool = False


PLAIN = Look(Material())
WHITE = Look(Material(diffuse=(1.0, 1.0, 1.0), name="colours"))


@dataclasses.dataclass
class Part:
    """Polygons. The corners of all polygons follow each other in the arrays of corners.

    Attributes:
      vertices: positions [V, 3].
      counts: number of corners of each polygon [P].
      corners: index of the vertex of each corner [C].
      looks: materials; None = a plain one.
      owner: index into `looks` of each polygon [P]; None = 0.
      uv, normals: of each corner, [C, 2] and [C, 3], or None. The first row of images is at v = 1.
      colours: display RGBA of each corner [C, 4] in [0, 1], or None.
    """

    vertices: np.ndarray
    counts: np.ndarray
    corners: np.ndarray
    looks: Sequence[Look | None] = (None,)
    owner: np.ndarray | None = None
    uv: np.ndarray | None = None
    normals: np.ndarray | None = None
    colours: np.ndarray | None = None

    def polygons(self) -> np.ndarray:
        """The index of the polygon of each corner [C]."""
        return np.repeat(np.arange(len(self.counts)), self.counts)


# Colours above this are from 0 to 255; those from 0 to 1 may be a little above 1.
_LARGE = 10


def material(
    diffuse: ArrayLike, specular: ArrayLike, shininess: float, opacity: float,
    texture: np.ndarray | None, name: str,
) -> Material:  # fmt: skip
    """A material; we clip the values to their ranges."""
    both = np.array([diffuse, specular], np.float64)
    both /= np.where(both.max(axis=1, keepdims=True) > _LARGE, 255, 1)
    (r, g, b), (x, y, z) = np.fmin(np.fmax(both, 0), 1).tolist()  # 0 in place of NaN
    shininess, opacity = min(max(shininess, 1.0), 1000.0), min(max(opacity, 0.0), 1.0)
    return Material((r, g, b), (x, y, z), shininess, opacity, texture, one_line(name))


def transformed(part: Part, matrices: np.ndarray) -> Part:
    """The part transformed by a matrix for each vertex, [V, 4, 4], or for all, [1, 4, 4].

    We reverse polygons if the matrices of all their corners mirror.
    """
    if len(matrices) == 1 and len(part.vertices) > len(part.corners):  # parts may share an array
        there = (part.corners >= 0) & (part.corners < len(part.vertices))
        corners = np.where(there, part.corners, -1)
        used, corners[there] = np.unique(corners[there], return_inverse=True)
        part = dataclasses.replace(part, vertices=part.vertices[used], corners=corners)
    linear = matrices[:, :3, :3]
    determinants = np.linalg.det(linear)

    def of_corners(values: np.ndarray) -> np.ndarray:
        return values if len(values) == 1 else values[part.corners]

    vertices = np.einsum("vij,vj->vi", linear, part.vertices) + matrices[:, :3, 3]
    part = dataclasses.replace(part, vertices=vertices)
    if part.normals is not None:
        # The matrix of cofactors in place of the inverse, because the matrix may be singular.
        a, b, c = np.moveaxis(linear, 2, 0)
        turn = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=2)
        turn *= np.where(determinants < 0, -1, 1)[:, None, None]
        # By a power of 2, which changes no digit; normals of tiny parts would become 0.
        turn = np.ldexp(turn, -np.frexp(np.abs(turn).max(axis=(1, 2), keepdims=True))[1])
        part.normals = np.einsum("cij,cj->ci", of_corners(turn), part.normals)
    if (determinants < 0).any():
        first, polygon = np.cumsum(part.counts) - part.counts, part.polygons()
        kept = np.bincount(polygon, np.broadcast_to(of_corners(determinants >= 0), polygon.shape))
        order = np.arange(len(polygon))
        backward = (2 * first + part.counts - 1)[polygon] - order
        order = np.where(kept[polygon] > 0, order, backward)
        for name in ("corners", "uv", "normals", "colours"):
            if (values := getattr(part, name)) is not None:
                setattr(part, name, values[order])
    return part


def joined(parts: Sequence[Part], assets: Assets) -> dict[str, Any]:
    """The parts as arguments of `mesh.build_model`.

    We drop polygons with fewer than three corners or with missing vertices, with a warning.

    Raises:
      UnusableModelError: nothing is left, or there are too many triangles.
    """
    blocks: dict[str, list[np.ndarray]] = collections.defaultdict(list)
    numbers: dict[Look, int] = {}
    fields = {"uv": (2, 0.0), "normals": (3, 0.0), "colours": (4, 1.0)}  # columns, default
    for name in ("normals", "colours"):
        if all(getattr(part, name) is None for part in parts):
            del fields[name]
    offset = few = lost = 0
    total = sum(int(np.maximum(part.counts - 2, 0).sum()) for part in parts)
    # Without the faces that the reader has counted.
    assets.budget.charge(faces=max(total - assets.budget.spent["faces"], 0))
    for part in parts:
        counts, corners = part.counts, part.corners
        polygon = part.polygons()
        outside = (corners < 0) | (corners >= len(part.vertices))
        broken = np.bincount(polygon[outside], minlength=len(counts)) > 0
        few, lost = few + int((counts < 3).sum()), lost + int(broken[counts > 2].sum())
        keep = (counts > 2) & ~broken
        if not keep.any():
            continue
        kept = np.flatnonzero(keep[polygon])
        counts, corners = counts[keep], corners[kept]
        if (many := counts > MOST_CORNERS).any():
            what = f"polygons with more than {MOST_CORNERS} corners, bays may be filled"
            assets.warn(what, many.sum())
        triangle, polygon = triangles(counts, corners, part.vertices, assets.budget.charge)
        blocks["vertices"].append(part.vertices)
        blocks["faces"].append(corners[triangle] + offset)
        for name, (width, default) in fields.items():
            values = getattr(part, name)
            plain = np.full((*triangle.shape, width), default)
            blocks[name].append(plain if values is None else values[kept[triangle]])
        owner = np.zeros(len(keep), np.int64) if part.owner is None else part.owner
        used, owner = np.unique(owner[keep][polygon], return_inverse=True)
        default_look = PLAIN if part.colours is None else WHITE
        own = [part.looks[index] or default_look for index in used]
        own_numbers = [numbers.setdefault(look, len(numbers)) for look in own]
        blocks["owner"].append(np.array(own_numbers)[owner])
        offset += len(part.vertices)
    for number, what in ((few, "fewer than three corners"), (lost, "missing vertices")):
        if number:
            assets.warn(f"faces with {what} dropped", number)
    if not blocks:
        why = "all faces have missing vertices" if lost else "no faces, expected at least one"
        raise UnusableModelError(f"the mesh is empty: {why}")
    arrays = {name: np.concatenate(arrays) for name, arrays in blocks.items()}
    colours = arrays.pop("colours").mean(axis=1) if "colours" in arrays else None
    materials, owner = _dressed(list(numbers), arrays.pop("owner"), arrays["uv"], colours, assets)
    return {**arrays, "materials": materials, "face_material": owner}


def _dressed(
    looks: Sequence[Look],
    owner: np.ndarray,
    uv: np.ndarray,
    colours: np.ndarray | None,
    assets: Assets,
) -> tuple[Sequence[Material], np.ndarray]:
    """The materials, and the material of each face. It changes the coordinates `uv` in place.

    Colours of faces multiply the diffuse colour and the opacity.
    """
    result, table = np.empty_like(owner), list[Material]()
    faces = np.split(np.argsort(owner, kind="stable"), np.cumsum(np.bincount(owner))[:-1])
    for look, own in zip(looks, faces, strict=True):
        material, groups = look.material, np.zeros(len(own), np.int64)
        colour = np.ones((1, 4)) if colours is None else colours[own]
        if material.texture is not None:
            if look.uv_matrix is not None:
                uv[own] = uv[own] @ look.uv_matrix[:, :2].T + look.uv_matrix[:, 2]
            if look.wraps != ("repeat", "repeat"):
                texture, uv[own] = repeated(material.texture, np.nan_to_num(uv[own]), look.wraps)
                assets.budget.charge(made=4 * texture.nbytes)
                material = dataclasses.replace(material, texture=texture)
        variants = [material]
        if material.texture is None and (colour != 1).any():
            levels = (255 * np.nan_to_num(colour).clip(0, 1)).round().astype(np.uint8)
            texture, uv[own] = palette(levels)
            variants = [dataclasses.replace(material, texture=texture)]
        elif look.tinted and (colour != 1).any():
            steps, groups = np.unique(np.round(15 * colour), axis=0, return_inverse=True)
            variants = []
            for *rgb, alpha in (steps / 15).tolist():
                red, green, blue = (a * b for a, b in zip(rgb, material.diffuse, strict=True))
                variants.append(dataclasses.replace(
                    material, diffuse=(red, green, blue), opacity=alpha * material.opacity
                ))  # fmt: skip
        elif (colour < 0.998).any():
            assets.warn("colours of faces with a texture not used")
        result[own] = groups.ravel() + len(table)
        table += variants
    return assets.bounded(table), result


def picked(
    values: np.ndarray | None, index: np.ndarray, assets: Assets | None = None
) -> np.ndarray | None:
    """The rows of `values` at indices; 0 for a missing row, None if all rows are missing.

    Index -1 states that there is none. `assets` get a warning of others without a row.
    """
    if values is None:
        return None
    good = (index >= 0) & (index < len(values))
    if assets and (beyond := int((~good & (index != -1)).sum())):
        assets.warn("texture coordinates, normals or colours missing, 0 is used", beyond)
    if not good.any():
        return None
    return np.where(good[:, None], values[np.where(good, index, 0)], 0)


def rgba(colours: np.ndarray, assets: Assets) -> np.ndarray:
    """RGB or RGBA [n, 3 or 4], up to 1 or 255, as RGBA in [0, 1]; NaN becomes grey."""
    colours = np.pad(
        colours[:, :4], ((0, 0), (0, max(4 - colours.shape[1], 0))), constant_values=np.nan
    )
    large = colours > (1 if (np.nan_to_num(colours) % 1 == 0).all() else _LARGE)
    colours = colours / np.where([large.any()] * 3 + [large[:, 3].any()], 255, 1)
    if len(colours) and (colours[:, 3] == 0).all():  # some programs write no other alpha
        assets.warn("alpha 0 in all colours, opaque is used")
        colours[:, 3] = 1
    return np.where(np.isnan(colours), (*GREY, 1.0), colours).clip(0, 1)


def palette(colours: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A texture and uv [F, 3, 2] with the colours uint8 [F, 4] of faces, rounded to 5 bits."""
    key = (colours.astype(np.int64) >> 3) @ np.array([1 << 15, 1 << 10, 1 << 5, 1])
    distinct, first, index = np.unique(key, return_index=True, return_inverse=True)
    width = int(np.ceil(np.sqrt(len(distinct))))
    # Unused texels repeat the last colour, so that an opaque palette stays opaque, which is faster.
    texture = np.pad(colours[first], ((0, width * width - len(distinct)), (0, 0)), mode="edge")
    column, row = index % width, index // width
    uv = np.stack([(column + 0.5) / width, 1 - (row + 0.5) / width], axis=1)
    return texture.reshape(width, width, 4), np.repeat(uv[:, None], 3, axis=1)

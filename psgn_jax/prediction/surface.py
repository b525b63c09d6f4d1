"""A closed surface around a cloud, with the photo as its texture (**ours**).

A cloud has no surface of its own: we make one on a grid of voxels, in seven steps. With a camera,
the grid's axes are the image's columns and rows, at the object's depth, and the depth, so that a
column of voxels is a ray.

1. The density of the points, smoothed, is a solid where it is above a level. Other draws of the
   network take part in it: one cloud alone gives bumps.
2. Its signed distance is shifted so that the surface passes through the points. The shift varies
   with the place. It leaves thin parts a least thickness.
3. A second solid, of a coarser density, closed and filled, lies a little inside the points. The
   union has no holes in sparse sides.
4. With a mask, the object is moved sideways so that its outline is the mask's.
5. Pixels of the mask that are still empty get a thin part, at the depth of the nearest points.
6. The mask cuts the field, and separate parts are left out if they are small and hidden.
7. Marching cubes, smoothing (Taubin 1995) and edge collapses by quadric errors give the mesh.

docs/journal.md, 2026-11-28, has the measurements.
"""

import functools
import io
from typing import Any, NamedTuple

import numpy as np
from PIL import Image
from scipy import ndimage
from scipy.spatial import KDTree

from psgn_jax.data import camera
from psgn_jax.system.errors import UserError

VOXELS = 80
"""Voxels along the longest side of the cloud."""

FACES = 12_000
"""A mesh is simplified to this number of faces."""
MOST_FACES = 20_000

# Lengths in spacings: the median distance of a point to its sixth neighbour.
FINE, COARSE = 0.4, 0.8  # standard deviations of the densities
LEVEL = 0.45  # of a solid, relative to the density at the points
THINNEST = 0.2  # half thickness that the shift leaves
INSIDE = 0.9  # depth of the coarse solid below the points
ASIDE = 0.8  # largest sideways move

DRAWS = 0.7
"""Weight of the other draws in the density."""

MOST_OUTSIDE = 0.9
"""A mask is ignored if a larger part of the points projects outside of it."""
SMALL = 0.03
"""A separate part is left out if it has less of the largest one's voxels, and is hidden."""

_TEXTURE = 1024  # most pixels of the texture's sides
_MASK = 256  # of the mask's longer side
_FAR = 2.0  # voxels, at which the field is clipped


class SurfaceError(UserError):
    """A cloud has no surface."""


class ClosedMesh(NamedTuple):
    """A closed mesh."""

    vertices: np.ndarray  # float32 [v, 3], in the frame of the points
    faces: np.ndarray  # int32 [f, 3], counter-clockwise seen from outside


def surface_of(
    points: np.ndarray,
    seen: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
    draws: np.ndarray | None = None,
) -> ClosedMesh:
    """The closed surface of a cloud; the same input gives the same mesh.

    Args:
      points: [n, 3], without outliers, in any frame and unit.
      seen: mask bool [h, w], intrinsics [3, 3] and extrinsics [3, 4] (`data.schema`) of an image
        in which `points` are seen. None = nothing is cut, as for the clouds of records; so is a
        mask that shows less than a tenth of the points.
      draws: [m, 3], points of other clouds of the same object in the same frame.

    Raises:
      SurfaceError: the points are not finite, in less than 4 places, or the surface is empty.
    """
    points = np.asarray(points, np.float64)
    if points.ndim != 2 or points.shape[1:] != (3,) or not np.isfinite(points).all():
        raise SurfaceError(f"points {list(points.shape)}: expected finite numbers [n, 3]")
    outline = None if seen is None else _outline(points, *seen)
    view = _View(np.eye(3, 4), None)
    if outline:
        depth = camera.to_camera(points, outline.extrinsics)[:, 2].mean()
        view = _View(outline.extrinsics, float(depth))
    grid = _Grid.around(view.of(points), None if draws is None else view.of(draws))
    field = _field(grid)
    if outline and view.depth:
        field = _cut(field, grid, _inside(outline, view.depth, grid))
    field = _without_small_parts(np.clip(field, -_FAR, _FAR))
    if not (field > 0).any():
        raise SurfaceError(
            "the cloud's parts are too far apart, or its mask too thin, for a surface"
        )
    vertices, faces = _mesh(field)
    return ClosedMesh(view.back(vertices * grid.step + grid.low).astype(np.float32), faces)


class _View(NamedTuple):
    """Maps points to (column, row) at the depth of the object, in its unit, and depth."""

    extrinsics: np.ndarray
    depth: float | None  # None: a rigid map

    def of(self, points: np.ndarray) -> np.ndarray:
        seen = camera.to_camera(np.asarray(points, np.float64), self.extrinsics)
        if self.depth:
            seen[:, :2] *= self.depth / np.maximum(seen[:, 2:], 1e-6)
        return seen

    def back(self, seen: np.ndarray) -> np.ndarray:
        if self.depth:
            seen = np.column_stack([seen[:, :2] * seen[:, 2:] / self.depth, seen[:, 2]])
        return (seen - self.extrinsics[:, 3]) @ self.extrinsics[:, :3]


class _Grid(NamedTuple):
    """A grid of voxels, with points and all lengths in voxels."""

    low: np.ndarray  # of voxel (0, 0, 0), in the view
    step: float  # size of a voxel
    shape: tuple[int, ...]
    points: np.ndarray  # [n, 3]
    spacing: float
    at: np.ndarray  # [n + m, 3], points and draws
    weights: np.ndarray  # [n + m]

    @classmethod
    def around(cls, points: np.ndarray, draws: np.ndarray | None) -> "_Grid":
        different = np.unique(points, axis=0)
        if len(different) < 4:
            raise SurfaceError(f"{len(different)} different points; a surface needs at least 4")
        nearest = KDTree(different).query(different, [min(7, len(different))])[0]
        low, high = different.min(axis=0), different.max(axis=0)
        step = (high - low).max() / VOXELS
        spacing = np.clip(np.median(nearest), step, 12 * step)
        margin = int(np.ceil(1.5 * spacing / step)) + 3
        low = low - margin * step
        shape = 2 * np.ceil(((high - low) / step + margin + 1) / 2).astype(int)
        at, weights = (points - low) / step, np.ones(len(points))
        if draws is not None:
            others = (draws - low) / step
            others = others[((others > 1) & (others < shape - 2)).all(axis=1)]
            part = np.full(len(others), DRAWS * len(at) / max(len(others), 1))
            weights = np.concatenate([weights * (1 - DRAWS), part])
            at = np.concatenate([at, others])
        return cls(
            low, step, tuple(shape), (points - low) / step, float(spacing / step), at, weights
        )


def _smooth(field: np.ndarray, sigma: float) -> np.ndarray:
    return ndimage.gaussian_filter(field, sigma, truncate=3)


def _read(field: np.ndarray, at: np.ndarray) -> np.ndarray:
    return ndimage.map_coordinates(field, at.T, order=1)


def _splat(at: np.ndarray, weights: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """The sum of weights in each voxel (or pixel), spread linearly to the next ones."""
    whole = np.floor(at).astype(np.intp)
    part, total = at - whole, np.zeros(int(np.prod(shape)))
    for corner in np.ndindex(*(2,) * len(shape)):
        share = np.abs(1 - np.array(corner) - part).prod(axis=1) * weights
        flat = np.ravel_multi_index(tuple((whole + corner).T), shape)
        total += np.bincount(flat, share, minlength=len(total))
    return total.reshape(shape).astype(np.float32)


def _distance(inside: np.ndarray) -> np.ndarray:
    """The signed distance to the border in voxels, positive inside."""
    border = inside & ~ndimage.binary_erosion(inside)
    distance = ndimage.distance_transform_edt(~border).astype(np.float32)
    return np.where(inside, distance, -distance) + np.float32(0.5)


def _field(grid: _Grid) -> np.ndarray:
    """Steps 1 to 3: about the signed distance to the surface in voxels, positive inside."""
    wide = grid.spacing
    count = _splat(grid.points, np.ones(len(grid.points)), grid.shape)
    mass = _splat(grid.at, grid.weights, grid.shape)

    def solid(mass: np.ndarray, at: np.ndarray, sigma: float, closings: int) -> np.ndarray:
        density = _smooth(mass, max(1.2, sigma))
        inside = density > LEVEL * np.median(_read(density, at))
        if closings:
            inside = ndimage.binary_closing(inside, iterations=closings)
        return _distance(ndimage.binary_fill_holes(inside))

    near_sum = functools.partial(ndimage.gaussian_filter, truncate=2)
    counts = functools.cache(functools.partial(near_sum, count))

    def depths(field: np.ndarray, near: float, most: float) -> np.ndarray:
        """The mean depth of the points near each voxel."""
        deep = np.clip(_read(field, grid.points), -most * wide, most * wide)
        sigma = max(1.0, near * wide)
        total = near_sum(_splat(grid.points, deep, grid.shape), sigma)
        return (total + 1e-5 * np.median(deep)) / (counts(sigma) + 1e-5)

    def through(field: np.ndarray, near: float) -> np.ndarray:
        thickest = np.maximum(ndimage.maximum_filter(field, size=int(2 * wide) | 1), 0)
        return field - np.minimum(depths(field, near, 1.0), thickest - THINNEST * wide)

    fine = _smooth(solid(mass, grid.points, FINE * wide, 0), 0.7)
    fine = through(fine, 0.9)
    a, b, c = (n // 2 for n in grid.shape)  # half of the resolution suffices
    halved = mass.reshape(a, 2, b, 2, c, 2).sum(axis=(1, 3, 5))
    coarse = 2 * solid(halved, grid.points / 2 - 0.25, COARSE * wide / 2, 2)
    coarse = _smooth(coarse.repeat(2, 0).repeat(2, 1).repeat(2, 2), 1.2)
    coarse -= depths(coarse, 1.2, 1.5) + INSIDE * wide
    return through(_smooth(np.maximum(fine, coarse), 1.5), 1.2)


class _Outline(NamedTuple):
    """A mask, reduced to at most `_MASK` pixels a side, with a border of two, and its camera."""

    mask: np.ndarray
    intrinsics: np.ndarray
    extrinsics: np.ndarray


def _outline(
    points: np.ndarray, mask: np.ndarray, intrinsics: np.ndarray, extrinsics: np.ndarray
) -> _Outline | None:
    """The mask, reduced; None if it shows too few of the points."""
    intrinsics, extrinsics = (np.asarray(a, np.float64) for a in (intrinsics, extrinsics))
    pixels, depth = camera.project(points, intrinsics, extrinsics)
    if depth.min() < 1e-3 or camera.inside_mask(pixels, mask).mean() < 1 - MOST_OUTSIDE:
        return None
    factor = -(-max(mask.shape) // _MASK)
    padded = np.pad(mask, [(2 * factor, 2 * factor + -n % factor) for n in mask.shape])
    rows, columns = (n // factor for n in padded.shape)
    reduced = padded.reshape(rows, factor, columns, factor).mean(axis=(1, 3)) > 0.5
    moved = np.array([[1 / factor, 0, 2], [0, 1 / factor, 2], [0, 0, 1]]) @ intrinsics
    return _Outline(reduced, moved, extrinsics)


def _inside(outline: _Outline, depth: float, grid: _Grid) -> np.ndarray:
    """The signed distance of each column of voxels to the mask's border, in voxels."""
    pixel = grid.step / depth * outline.intrinsics[0, 0]
    distance = _smooth(_distance(outline.mask), 0.5 * max(1.0, pixel))
    column, row = (
        (grid.low[k] + grid.step * np.arange(grid.shape[k])) / depth * outline.intrinsics[k, k]
        + outline.intrinsics[k, 2]
        - 0.5
        for k in (0, 1)
    )
    at = np.meshgrid(column, row, indexing="ij")[::-1]
    return ndimage.map_coordinates(distance, at, order=1, mode="nearest") / pixel


def _cut(field: np.ndarray, grid: _Grid, inside: np.ndarray) -> np.ndarray:
    """Steps 4 to 6: the field, with the outline of a mask."""
    most = ASIDE * grid.spacing
    outline = _smooth(_distance(field.max(axis=2) > 0), 0.7)
    slope = np.stack(np.gradient(_smooth(outline, 1.0)))
    slope /= np.maximum(np.linalg.norm(slope, axis=0), 0.3)
    aside = np.clip(inside - outline, -most, most)
    aside *= np.clip(1 - np.maximum(inside, 0) / (2 * most), 0, 1) * (inside > -2)
    last = np.array(field.shape[:2])[:, None, None] - 1.001
    source = np.clip(np.indices(field.shape[:2]) + _smooth(aside, 2.0) * slope, 0, last)
    (i, j), (p, q) = source.astype(int), (source % 1).astype(np.float32)[..., None]
    field = (field[i, j] * (1 - p) + field[i + 1, j] * p) * (1 - q) + (
        field[i, j + 1] * (1 - p) + field[i + 1, j + 1] * p
    ) * q

    shape = field.shape[:2]
    columns = np.argwhere(inside > -2)
    away, nearest = KDTree(grid.points[:, :2]).query(columns, min(5, len(grid.points)))
    depth, near = np.full(shape, grid.points[:, 2].mean()), np.zeros(shape, np.bool_)
    depth[tuple(columns.T)] = np.median(grid.points[nearest, 2], axis=1)
    near[tuple(columns.T)] = away[:, 0] < 4 * grid.spacing
    depth = _smooth(ndimage.median_filter(depth, 7), 1.5)
    thick = np.minimum(np.minimum(inside, 0.5 * grid.spacing), max(0.7, THINNEST * grid.spacing))
    empty = (field.max(axis=2) < thick) & (inside > 0) & near
    steep = np.sqrt(1 + np.minimum(2, np.square(np.gradient(depth)).sum(axis=0)))
    behind = np.abs(np.arange(field.shape[2]) - depth[..., None]) / steep[..., None]
    thin = np.where(empty, thick, -_FAR)[..., None] - 0.7 * behind
    return np.minimum(np.maximum(field, thin), inside[..., None]).astype(np.float32)


def _without_small_parts(field: np.ndarray) -> np.ndarray:
    """Step 6; also clears the border, so that the surface is closed."""
    border = np.ones(field.shape, np.bool_)
    border[1:-1, 1:-1, 1:-1] = False
    field[border] = -_FAR
    parts, count = ndimage.label(field > 0)
    if count > 1:
        sizes = np.bincount(parts.ravel())[1:]
        large = np.concatenate([[False], sizes >= SMALL * sizes.max()])
        hidden = np.broadcast_to(large[parts].any(axis=2, keepdims=True), parts.shape)
        hidden_part = ndimage.mean(hidden, parts, np.arange(count + 1)) > 0.5
        field[~large[parts] & hidden_part[parts] & (parts > 0)] = -0.5
    return field


def _mesh(field: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Step 7: vertices in voxels, and faces."""
    import fast_simplification
    import trimesh
    from skimage.measure import marching_cubes

    for step in (1, 2, 3, 4):  # a coarser grid if a mesh is too large
        try:
            vertices, faces, _, _ = marching_cubes(field, 0.0, step_size=step)
        except RuntimeError:  # nothing is left on so coarse a grid
            break
        mesh = trimesh.Trimesh(vertices, faces[:, ::-1], process=False)
        trimesh.smoothing.filter_taubin(mesh, iterations=10)
        vertices, faces = fast_simplification.simplify(
            mesh.vertices.astype(np.float32), mesh.faces, target_count=min(FACES, len(faces) - 1)
        )
        for made in (trimesh.Trimesh(vertices, faces, process=False), mesh):
            if len(made.faces) <= MOST_FACES and made.is_volume:
                return np.asarray(made.vertices), np.asarray(made.faces, np.int32)
    raise SurfaceError("the cloud has no closed surface")


def textured(
    surface: ClosedMesh,
    image: np.ndarray,
    mask: np.ndarray,
    intrinsics: np.ndarray,
    extrinsics: np.ndarray,
) -> Any:
    """The surface as `trimesh.Trimesh`, with the image as its texture.

    A vertex has the texture coordinates of its projection, so that the texture goes through the
    object: its back shows what its front shows. Pixels outside the mask, and those on its border,
    have the colour of the nearest pixel inside.

    Args:
      surface: of `surface_of`.
      image: uint8 [h, w, 3]; mask: bool [h, w], True on the object.
      intrinsics, extrinsics: the camera of the image (`data.schema`).
    """
    import trimesh

    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    (top, bottom), (left, right) = ((at.min(), at.max() + 1) for at in (rows, columns))
    size = np.array([right - left, bottom - top])
    goal = np.maximum(1, np.rint(size * min(1, _TEXTURE / size.max()))).astype(int)
    cropped = Image.fromarray(image[top:bottom, left:right]).resize(goal, reducing_gap=2)
    inside = Image.fromarray(mask[top:bottom, left:right]).resize(goal, Image.Resampling.NEAREST)
    border = max(1.5, 0.008 * goal.max())
    distance = ndimage.distance_transform_edt(np.pad(np.asarray(inside), 1))[1:-1, 1:-1]
    thickest = ndimage.maximum_filter(distance, size=2 * int(border) + 1)
    outside = distance < np.minimum(border, 0.7 * thickest) + 1e-6
    nearest = ndimage.distance_transform_edt(outside, return_distances=False, return_indices=True)
    Image.fromarray(np.asarray(cropped)[tuple(nearest)]).save(
        file := io.BytesIO(), "JPEG", quality=90
    )
    pixels, _ = camera.project(surface.vertices.astype(np.float64), intrinsics, extrinsics)
    u, v = np.clip((pixels - (left, top)) / size, 0, 1).T
    material = trimesh.visual.material.PBRMaterial(
        baseColorTexture=Image.open(file), metallicFactor=0.0, roughnessFactor=1.0
    )
    look = trimesh.visual.TextureVisuals(uv=np.column_stack([u, 1 - v]), material=material)
    return trimesh.Trimesh(*surface, process=False, visual=look)


def glb(mesh: Any) -> bytes:
    """Binary glTF 2.0 of a mesh, with normals; +y points up, so (x, y, z) -> (y, z, x)."""
    turned = mesh.copy()
    # A copied image has lost its format, and would be stored as a larger PNG.
    turned.visual.material.baseColorTexture = mesh.visual.material.baseColorTexture
    turned.apply_transform(np.eye(4)[[1, 2, 0, 3]])
    normals = turned.vertex_normals.copy()
    normals[np.linalg.norm(normals, axis=1) < 0.5] = 0, 1, 0  # between faces without area
    turned.vertex_normals = normals
    return bytes(turned.export(file_type="glb", include_normals=True))

"""A prediction: clouds with their colours, page in a notebook, and place in the photo.

Points are in the project's frame (`data.schema`). `prediction.formats` writes them as files.
"""

import dataclasses
import functools
import html
import os
import pathlib
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from psgn_jax.data import camera, schema
from psgn_jax.data.framing import Framed
from psgn_jax.data.photo import Photo
from psgn_jax.prediction import formats, surface
from psgn_jax.prediction.draws import spread
from psgn_jax.system.files import write_atomic
from psgn_jax.system.untrusted import one_line
from psgn_jax.viewing import viewer

FC, DECONV = 0, 1

LEAST_HEIGHT = 0.5
"""A surface in metres has at least this share of its cloud's height."""

UNSEEN = (150, 150, 150)
"""Colour of a cloud without visible points."""

# Radius of the disc of a point, and largest distance of a visible point behind the nearest disc
# (unit). Compared with depth maps, for 1,024 points of the authors' surfaces, the precision of the
# visible points is 82 % and the recall 80 %.
_RADIUS, _DEPTH_TOLERANCE = 0.04, 0.08


class PhotoCamera(NamedTuple):
    """The camera of a photo, as OpenCV states it: x right, y down, z forward; no distortion.

    Attributes:
      intrinsics: float64 [3, 3], in pixels of the photo in its full size, upright. The principal
        point is the photo's middle. (0, 0) is the outer corner of the first pixel.
      extrinsics: float64 [3, 4], maps `unit * points` of the project's frame to the camera's.
      points: float64 [n, 3], the cloud in the camera's frame. They project exactly to where the
        prediction has them.
      unit: length of the cloud's unit, in metres if the object's height was given, else 1.
      error: largest distance between the projections of `points` and of the cloud moved by
        `extrinsics`, in pixels of a view of 192x256.
    """

    intrinsics: np.ndarray
    extrinsics: np.ndarray
    points: np.ndarray
    unit: float
    error: float


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class Prediction:
    """The clouds for an image.

    Attributes:
      points: float32 [k, n, 3] in the project's frame (+z up, +y image right, +x to the camera);
        unit = radius of the bounding hemisphere.
      colours: uint8 [k, n, 3], from the image (`colours_from_view`).
      mask: bool [h, w], the object in the image, which is reduced if it is large.
      warnings: probable problems, a line each.
      outlier: bool [k, n], whether a point lies apart from all others (`find_outliers`).
      seen: bool [k, n], whether a point is visible in the image.
      branch: uint8 [n], the branch that predicts a point, `FC` or `DECONV`.
      mask_from: the method that produced the mask, and how certain the mask network is.
      photo: the image as it was read.
      view: the framed view of the object, the input of the network, with the camera that projects
        `points` to it (`data.framing.Framed`).
      scale, shift: the network's points are `scale * points + shift` (`data.framing.normal_form`);
        1 and 0 without normal form.
      seconds: duration of each step.
      draws: float32 [d, n, 3], the first cloud and all draws, as the network predicted them;
        the first k became `points`. None without a random input.
    """

    points: NDArray[np.float32]
    colours: NDArray[np.uint8]
    mask: np.ndarray
    warnings: tuple[str, ...]
    outlier: np.ndarray
    seen: np.ndarray
    branch: np.ndarray
    mask_from: str
    photo: Photo
    view: Framed
    scale: float
    shift: np.ndarray
    seconds: dict[str, float]
    draws: np.ndarray | None = None

    @property
    def spread(self) -> np.ndarray | None:
        """How far each point of the first cloud varies, float32 [n] in the unit of `points`.

        It is the mean distance to the point's partners in the other draws (`prediction.draws`),
        small where the network is certain. None without a random input. The first access takes
        about a tenth of a second.
        """
        return None if self._spreads is None else self._spreads[0]

    @functools.cached_property
    def _spreads(self) -> np.ndarray | None:
        if self.draws is None:
            return None
        return np.asarray(spread(self.draws, len(self.points))) / np.float32(self.scale)

    def save(self, path: str | os.PathLike[str], sample: int = 0) -> None:
        """Writes a file; the suffix says which.

        .ply, .xyz, .obj and .glb have one cloud without its outliers; .npz has all arrays, for
        NumPy and `psgn view`; .html is a page on which the clouds can be turned.

        Raises:
          ValueError: another suffix, or there is no such sample.
        """
        suffix = pathlib.Path(path).suffix.lower().lstrip(".")
        if suffix == "npz":
            content: bytes | str = formats.npz(self.arrays())
        elif suffix == "html":
            content = viewer.document_of([self.case(pathlib.Path(path).stem)])
        elif suffix in formats.MAKERS:
            content = formats.MAKERS[suffix](*self._kept(sample))
        else:
            accepted = ", ".join(f".{name}" for name in (*formats.FORMATS, "html"))
            raise ValueError(f"{path}: accepted: a name that ends in {accepted}")
        write_atomic(path, content, sync=False)

    def to_trimesh(self, sample: int = 0) -> Any:
        """One cloud without its outliers as `trimesh.PointCloud`."""
        import trimesh

        points, colours = self._kept(sample)
        return trimesh.PointCloud(points, colors=colours)

    def surface(self, sample: int = 0, height: float | None = None) -> Any:
        """The closed surface of a cloud as `trimesh.Trimesh`, with the photo as its texture.

        It is in the frame of `points` (`prediction.surface`). The outline and the colours of the
        front are the photo's; depth, sides and back are the network's estimate. The first cloud's
        surface takes the other draws into account. `surface().export("chair.obj")` writes it in
        the formats of trimesh, with +z up.

        Args:
          sample: number of the cloud.
          height: height of the surface in metres; None keeps the cloud's unit.

        Raises:
          ValueError: no such sample, or a height that is out of range.
          SurfaceError: the cloud has no surface, or `height` is given and the surface is less than
            half as high as the cloud.
        """
        points, _ = self._kept(sample)
        _check_lengths(height=height)
        draws = None if self.draws is None or sample else self.draws[1:].reshape(-1, 3)
        intrinsics = np.linalg.inv(self.view.to_view) @ self.view.intrinsics
        seen = self.mask, intrinsics, self.view.extrinsics
        others = None if draws is None else (draws - self.shift) / self.scale
        mesh = surface.textured(surface.surface_of(points, seen, others), self.photo.image, *seen)
        if height is not None:
            if mesh.extents[2] < LEAST_HEIGHT * np.ptp(points[:, 2]):
                raise surface.SurfaceError(
                    "the surface lacks thin parts, and so has no height in metres; leave height out"
                )
            mesh.metadata["unit"] = float(height / mesh.extents[2])  # for `psgn view`
            mesh.apply_scale(mesh.metadata["unit"])
        return mesh

    def save_surface(
        self, path: str | os.PathLike[str], sample: int = 0, height: float | None = None
    ) -> None:
        """Writes `surface` as a GLB file, whose y-axis points up, as in all glTF files.

        Raises:
          ValueError: another suffix, or as `surface` does.
          SurfaceError: the cloud has no surface.
        """
        if pathlib.Path(path).suffix.lower() != ".glb":
            raise ValueError(f"{path}: accepted: a name that ends in .glb")
        write_atomic(path, surface.glb(self.surface(sample, height)), sync=False)

    def _kept(self, sample: int) -> tuple[np.ndarray, np.ndarray]:
        if not 0 <= sample < len(self.points):
            raise ValueError(f"sample={sample}: accepted: 0 to {len(self.points) - 1}")
        kept = ~self.outlier[sample]
        return self.points[sample][kept], self.colours[sample][kept]

    def __repr__(self) -> str:
        k, n, _ = self.points.shape
        clouds = f"{k} cloud{'s' * (k > 1)} of {n:,} points"
        return f"<{clouds}, {self.seen.mean():.0%} visible in the image, mask: {self.mask_from}>"

    def _repr_html_(self) -> str:
        """What a notebook shows: the page of `psgn view`, on which the cloud can be turned."""
        text = html.escape(viewer.document_of([self.case("")]))
        return f'<iframe srcdoc="{text}" style="width:100%;height:420px;border:0"></iframe>'

    def case(self, name: str) -> viewer.Case:
        """What a page shows."""
        return viewer.case_of(name, self.arrays())

    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays of an NPZ file.

        `photo` is the whole photo with at most 512 pixels a side; `to_view` [3, 3] maps its
        (column, row) to pixels of `image`, the view of the network. `spread` is [k, n]: a point of
        another cloud has the spread of its partner in the first one.
        """
        image = Image.fromarray(self.photo.image)
        if self.photo.alpha is not None:  # behind it, the colour of the renderings' background
            grey = Image.new("RGB", image.size, (schema.BACKGROUND_GREY,) * 3)
            image = Image.composite(image, grey, Image.fromarray(self.photo.alpha))
        image.thumbnail((512, 512), Image.Resampling.LANCZOS, reducing_gap=2)
        height, width = self.photo.image.shape[:2]
        enlarged = np.diag([width / image.width, height / image.height, 1.0])
        arrays = {n: getattr(self, n) for n in ("points", "colours", "outlier", "seen", "branch")}
        arrays |= {n: getattr(self.view, n) for n in ("image", "mask", "intrinsics", "extrinsics")}
        if self._spreads is not None:
            arrays["spread"] = self._spreads
        return arrays | {
            "photo": np.asarray(image),
            "to_view": (self.view.to_view @ enlarged).astype(np.float32),
        }

    @property
    def photo_intrinsics(self) -> np.ndarray:
        """float64 [3, 3], of the view's camera for the photo in its full size, upright.

        With the view's extrinsics, it projects the points exactly. Its principal point is not the
        middle of the photo.
        """
        (full_height, full_width), (height, width) = self.photo.size, self.photo.image.shape[:2]
        enlarged = np.diag([full_width / width, full_height / height, 1.0])
        return enlarged @ np.linalg.inv(self.view.to_view) @ self.view.intrinsics

    def camera(
        self, focal: float | None = None, height: float | None = None, sample: int = 0
    ) -> PhotoCamera:
        """The camera of the photo, and the cloud in front of it.

        We put each point on the ray of its pixel, so deep that the object keeps its size and depth.
        With the assumed focal length, this moves the cloud as a whole. Another one changes the
        cloud's perspective; `error` says how far a rigid move would be off.

        We assume the elevation of the training images, 20 degrees. On 332 renders from there, with
        their focal length and the object's height, the vertical is 1.0 degrees off at the median (9
        of 10: 2.8), the distance 7 % (31 %), and `error` is .5 (2.4) pixels; with the assumed focal
        length .2 (.7). For another elevation, the vertical is off by the difference.

        Args:
          focal: focal length in pixels of the photo in its full size; None = EXIF's, or without
            EXIF the training images', 400 pixels in a view of 192x256. EXIF's is wrong if the
            photo was cropped.
          height: height of the object in metres; None keeps the cloud's unit.
          sample: number of the cloud.

        Raises:
          ValueError: no such sample, a length that is out of range, or a focal length so short
            that the camera would be inside the object.
        """
        _check_lengths(focal=focal, height=height)
        kept, _ = self._kept(sample)
        points, own = self.points[sample].astype(np.float64), self.photo_intrinsics
        given, focal = focal, float(focal or self.photo.focal or own[0, 0])
        rows, columns = self.photo.size
        intrinsics = np.array([[focal, 0, columns / 2], [0, focal, rows / 2], [0, 0, 1.0]])
        unit = height / float(np.ptp(kept[:, 2])) if height else 1.0
        seen = camera.to_camera(points, self.view.extrinsics.astype(np.float64))
        # In both cameras, the axis is turned to the middle of the object.
        middle = camera.to_camera(kept, self.view.extrinsics).mean(axis=0, dtype=np.float64)
        straight = seen @ _turn_to_axis(middle).T
        depth = straight[:, 2] - np.linalg.norm(middle)
        to_rays = np.linalg.inv(intrinsics) @ own
        turn = _turn_to_axis(to_rays @ middle)
        rays = seen @ (turn @ to_rays).T
        across = rays[:, :2] / rays[:, 2:]
        # Least squares of the changes across the axis give the distance.
        distance = (across * (straight[:, :2] - across * depth[:, None])).sum() / (across**2).sum()
        depth += distance
        if not depth.min() > 0.05:
            if given is None:  # EXIF's length is wrong: the photo was cropped
                return self.camera(float(own[0, 0]), height, sample)
            raise ValueError(
                f"focal={focal:g}: the camera would be inside the object; the assumed length is "
                f"{own[0, 0]:.0f}"
            )
        placed = np.column_stack([across * depth[:, None], depth]) @ turn * unit
        extrinsics = _rigid(unit * points, placed)
        moved, _ = camera.project(unit * points, intrinsics, extrinsics)
        exact, _ = camera.project(points, own, self.view.extrinsics)
        pixel = camera.default_camera()[0][0, 0] / own[0, 0]
        error = np.linalg.norm(moved - exact, axis=1).max() * pixel
        return PhotoCamera(intrinsics, extrinsics, placed, unit, float(error))


def _check_lengths(**lengths: float | None) -> None:
    most = 1e6
    for name, value in lengths.items():
        is_number = isinstance(value, int | float | np.integer | np.floating)
        if value is not None and not (is_number and 1 / most <= value <= most):
            shown = one_line(value)
            raise ValueError(f"{name}={shown}: accepted: a number from {1 / most:g} to {most:g}")


def _turn_to_axis(direction: np.ndarray) -> np.ndarray:
    """The smallest rotation [3, 3] that turns a direction to +z."""
    return np.asarray(Rotation.align_vectors([0, 0, 1], direction)[0].as_matrix())


def _rigid(points: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """The rotation and translation [3, 4] that move points [n, 3] nearest to a goal."""
    middle, other = points.mean(axis=0), goal.mean(axis=0)
    rotation = Rotation.align_vectors(goal - other, points - middle)[0].as_matrix()
    return np.column_stack([rotation, other - rotation @ middle])


def colours_from_view(points: np.ndarray, view: Framed) -> tuple[np.ndarray, np.ndarray]:
    """Colours uint8 [n, 3] of points from the image, and whether they are visible, bool [n].

    Each point is a disc of radius .04 that faces the camera. It is visible if its pixel is on the
    mask and no disc is more than .08 in front of its centre. A hidden point has the colour of the
    nearest visible one; if none is visible, all have the colour `UNSEEN`.
    """
    # The constants were measured at this size.
    height, width = camera.VIEW_SIZE
    intrinsics = camera.scale_intrinsics(view.intrinsics, view.mask.shape, camera.VIEW_SIZE)
    pixels, depth = camera.project(points, intrinsics, view.extrinsics)
    front = np.isfinite(pixels).all(axis=1) & (depth > 1e-3)
    corner = np.floor(np.clip(np.where(front[:, None], pixels, -1), -width, 2 * width)).astype(int)
    reach = intrinsics[0, 0] * _RADIUS / np.maximum(depth, 1e-3)
    most = int(min(reach[front].max(initial=0), 64)) + 1
    across, down = (a.ravel() for a in np.mgrid[-most : most + 1, -most : most + 1])
    column, row = corner[:, :1] + across, corner[:, 1:] + down
    covered = front[:, None] & (across**2 + down**2 <= np.square(reach)[:, None])
    covered &= (column >= 0) & (column < width) & (row >= 0) & (row < height)
    nearest = np.full((height, width), np.inf)
    depths = np.broadcast_to(depth[:, None], covered.shape)
    np.minimum.at(nearest, (row[covered], column[covered]), depths[covered])
    seen = front & (corner >= 0).all(axis=1) & (corner < (width, height)).all(axis=1)
    column, row = np.clip(corner, 0, (width - 1, height - 1)).T
    at = row * view.mask.shape[0] // height, column * view.mask.shape[1] // width
    seen &= view.mask[at] & (depth <= nearest[row, column] + _DEPTH_TOLERANCE)
    colours = np.tile(np.array(UNSEEN, np.uint8), (len(points), 1))
    colours[seen] = view.image[at][seen]
    if seen.any():
        _, nearest_seen = KDTree(points[seen]).query(points[~seen])
        colours[~seen] = colours[seen][nearest_seen]
    return colours, seen


def find_outliers(points: np.ndarray) -> np.ndarray:
    """Points of a cloud [n, 3] that lie apart from all others: bool [n].

    The distance of an outlier to its fourth nearest neighbour is more than 5 times the median of
    the cloud (**ours**), or, if that is 0 because most points coincide, the median above 0.
    PLY, OBJ, XYZ and GLB files and the normal form omit outliers; metrics use all.
    """
    if len(points) < 5:
        return np.zeros(len(points), np.bool_)
    distance = KDTree(points).query(points, [5])[0][:, 0]  # the nearest is the point itself
    median = np.median(distance)
    if not median and distance.any():
        median = np.median(distance[distance > 0])
    return np.asarray(distance > 5 * median)

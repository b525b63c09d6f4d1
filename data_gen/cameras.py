"""Random cameras, placed so that the whole object is in the image.

We rotate the object from the project's frame (`psgn_jax.data.schema`) about the vertical axis by
minus the azimuth, into the view-aligned frame: the camera looks at it from +x.
"""

import dataclasses
import functools
from typing import Annotated, Any

import numpy as np
from jaxtyping import Bool, Float

from data_gen.mesh import UnusableModelError
from psgn_jax.config.structured import Bounds, Fraction, Within

_MARGIN_PIXELS = 1.0  # the object may not touch this border of the image
_STEP = 1.02  # factor of the distance until the object fits

Range = tuple[float, float]
"""(low, high) of a uniform distribution."""

Side = Annotated[int, Bounds(8, 4096)]


@dataclasses.dataclass(frozen=True)
class CameraSettings:
    """Ranges of uniformly drawn cameras; (a, a) is a fixed value.

    The defaults are the authors' camera, fitted to their silhouettes, with any azimuth.

    Attributes:
      image_size: (H, W) in pixels.
      azimuth: degrees from the object's front (+x) toward +y.
      elevation: degrees of the camera above the horizon, under 90.
      distance: from the camera to the origin along the optical axis, in units of the frame.
      focal: focal length in pixels for an image with 192 rows; proportional to the image height.
        The vertical field of view is 2 atan(96 / focal): 27 degrees for 400.
      roll: degrees about the optical axis; positive values turn the object clockwise.
      aim: height above the origin of the point that the camera looks at.
      keep_size: whether we multiply `distance` by focal / 400, so that the size of the object in
        the image does not depend on the focal length.
      off_centre: largest shift of the object along rows and columns of the image, as a fraction of
        the free space beside it.
    """

    image_size: tuple[Side, Side] = (192, 256)
    azimuth: Annotated[Range, Within(-720, 720)] = (0.0, 360.0)
    elevation: Annotated[Range, Within(-89, 89)] = (20.0, 20.0)
    distance: Annotated[Range, Within(1.05, 1000)] = (3.6, 3.6)
    focal: Annotated[Range, Within(10, 100_000)] = (400.0, 400.0)
    roll: Annotated[Range, Within(-360, 360)] = (0.0, 0.0)
    # In the authors' images the origin is 0.252 below the optical axis, at an elevation of 20.
    aim: Annotated[Range, Within(-10, 10)] = (0.26817, 0.26817)
    keep_size: bool = False
    off_centre: Fraction = 0.0


def turn_about_vertical(degrees: float) -> Float[np.ndarray, "3 3"]:
    """The rotation by `degrees` about +z, from +x toward +y."""
    cosine, sine = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])


@dataclasses.dataclass(frozen=True, eq=False)
class Camera:
    """A camera with parameters as in `CameraSettings`.

    `pan` are rotations of the camera in radians. They move the object right and down in the image.
    """

    image_size: tuple[int, int]
    azimuth: float
    elevation: float
    distance: float
    focal: float
    roll: float
    aim: float
    pan: tuple[float, float] = (0.0, 0.0)

    @functools.cached_property
    def intrinsics(self) -> Float[np.ndarray, "3 3"]:
        height, width = self.image_size
        pixels = self.focal * height / 192
        return np.array([[pixels, 0, width / 2], [0, pixels, height / 2], [0, 0, 1]])

    @functools.cached_property
    def extrinsics(self) -> Float[np.ndarray, "3 4"]:
        """Maps the view-aligned frame to the camera's frame (OpenCV)."""
        sine, cosine = np.sin(np.deg2rad(self.elevation)), np.cos(np.deg2rad(self.elevation))
        rows = [[0, 1, 0, 0], [sine, 0, -cosine, self.aim * cosine]]
        upright = np.array([*rows, [-cosine, 0, -sine, self.distance]])
        if self.pan != (0.0, 0.0):
            (right, right_part), (down, down_part) = ((np.cos(a), np.sin(a)) for a in self.pan)
            across = np.array([[right, 0, right_part], [0, 1, 0], [-right_part, 0, right]])
            along = np.array([[1, 0, 0], [0, down, down_part], [0, -down_part, down]])
            upright = along @ across @ upright
        # Clockwise in the image, because y points down in camera coordinates.
        return turn_about_vertical(self.roll) @ upright

    @functools.cached_property
    def rotation(self) -> Float[np.ndarray, "3 3"]:
        """Maps the model's frame to the view-aligned frame."""
        return turn_about_vertical(-self.azimuth)

    @property
    def position(self) -> Float[np.ndarray, " 3"]:
        """The camera's position in the view-aligned frame."""
        return -self.extrinsics[:, :3].T @ self.extrinsics[:, 3]

    def parameters(self) -> dict[str, float]:
        """The parameters for the record of a sample."""
        names = ("azimuth", "elevation", "distance", "focal", "roll")
        return {name: round(float(getattr(self, name)), 6) for name in names}


def project(
    points: Float[np.ndarray, "n 3"], camera: Camera
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
    """Column and row (not rounded) of points in the view-aligned frame, and their depth z."""
    inside = points @ camera.extrinsics[:, :3].T + camera.extrinsics[:, 3]
    z = inside[:, 2]
    safe = np.where(z > 0, z, np.nan)
    return (inside @ camera.intrinsics[:2].T) / safe[:, None], z


def in_frame(points: Float[np.ndarray, "n 3"], camera: Camera) -> Bool[np.ndarray, " n"]:
    """Whether points are in front of the camera and at least one pixel inside the image."""
    pixels, _ = project(points, camera)
    low, high = _MARGIN_PIXELS, np.array(camera.image_size[::-1]) - _MARGIN_PIXELS
    with np.errstate(invalid="ignore"):
        return np.all((pixels >= low) & (pixels <= high), axis=1)


def draw(
    rng: np.random.Generator, settings: CameraSettings, vertices: Float[np.ndarray, "n 3"]
) -> Camera:
    """Draws a camera for an object with these vertices in the model's frame.

    We move the camera back until the object fits into the image. The number of values drawn from
    `rng` does not depend on the settings: `off_centre` uses a child generator.

    Raises:
      UnusableModelError: the object does not fit into the image at any distance up to 1000.
    """
    names = ("azimuth", "elevation", "distance", "focal", "roll", "aim")
    parameters: dict[str, Any] = {}
    for name, share in zip(names, rng.random(6), strict=True):
        low, high = getattr(settings, name)
        parameters[name] = float(low + (high - low) * share)
    parameters["azimuth"] %= 360.0
    if settings.keep_size:
        parameters["distance"] = max(parameters["distance"] * parameters["focal"] / 400, 1.05)
    camera = Camera(settings.image_size, **parameters)
    turned = vertices @ camera.rotation.T
    while not in_frame(turned, camera).all():
        camera = dataclasses.replace(camera, distance=camera.distance * _STEP)
        if camera.distance > 1000:
            raise UnusableModelError("camera.focal: no distance up to 1000 shows all of the object")
    if settings.off_centre > 0:
        return _moved(rng.spawn(1)[0], settings.off_centre, turned, camera)
    return camera


def _moved(
    rng: np.random.Generator, most: float, turned: Float[np.ndarray, "n 3"], camera: Camera
) -> Camera:
    """The camera, rotated so that the object is at a random position in the image."""
    pixels, _ = project(turned, camera)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    size = np.array(camera.image_size[::-1], float)
    want = rng.uniform(-most, most, 2)
    # Shifts in pixels, rotated by minus the roll, because the pan precedes the roll.
    room = np.where(want > 0, size - _MARGIN_PIXELS - high, low - _MARGIN_PIXELS)
    shift = turn_about_vertical(-camera.roll)[:2, :2] @ (want * np.maximum(room, 0))
    for _ in range(12):
        right, down = np.arctan(shift / camera.intrinsics[0, 0]).tolist()
        moved = dataclasses.replace(camera, pan=(right, down))
        if in_frame(turned, moved).all():
            return moved
        shift = shift * 0.8
    return camera

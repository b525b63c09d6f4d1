"""Projection between the project's frame and the image, in numpy.

`psgn_jax.data.schema` defines the frame, the camera and the pixel centres.
"""

import numpy as np
from scipy import ndimage

VIEW_SIZE = (192, 256)
"""Height and width of the authors' images."""
DISTANCE = 3.6
"""Depth of the frame's origin in the authors' camera, along the optical axis (unit)."""


def default_camera(
    image_size: tuple[int, int] = VIEW_SIZE, *, tilt_degrees: float = 20.0
) -> tuple[np.ndarray, np.ndarray]:
    """Intrinsics float32 [3, 3] and extrinsics [3, 4] of the authors' camera.

    It was fitted to the silhouettes in their images, with an error of half a pixel. It looks from
    +x, down by `tilt_degrees`. The origin is at depth `DISTANCE`, 0.252 below the optical axis. The
    focal length is 400 pixels at 192x256 pixels.
    """
    intrinsics = np.array([[400.0, 0, 128.0], [0, 400.0, 96.0], [0, 0, 1]])
    sine, cosine = np.sin(np.deg2rad(tilt_degrees)), np.cos(np.deg2rad(tilt_degrees))
    extrinsics = np.array([[0, 1, 0, 0], [sine, 0, -cosine, 0.252], [-cosine, 0, -sine, DISTANCE]])
    return scale_intrinsics(intrinsics, VIEW_SIZE, image_size), extrinsics.astype(np.float32)


def scale_intrinsics(
    intrinsics: np.ndarray, old_size: tuple[int, int], new_size: tuple[int, int]
) -> np.ndarray:
    """Intrinsics after resizing an image from `old_size` to `new_size`, both (H, W)."""
    factor = np.array([new_size[1] / old_size[1], new_size[0] / old_size[0], 1.0])
    return (factor[:, None] * intrinsics).astype(np.float32)


def to_camera(points: np.ndarray, extrinsics: np.ndarray) -> np.ndarray:
    """Transforms points [n, 3] from the project's frame to the camera's frame."""
    return points @ extrinsics[:, :3].T + extrinsics[:, 3]


def turn_to_view(extrinsics: np.ndarray) -> np.ndarray:
    """Rotation [3, 3] about z that maps the image's right to +y.

    With `turn` of a camera in a frame whose +z is up, `points @ turn.T` are in the project's frame,
    and `extrinsics[:, :3] @ turn.T` is its rotation. ValueError if the camera is rolled on its
    side.
    """
    right = extrinsics[0, :2]
    length = float(np.linalg.norm(right))
    if not length > 0.1:
        raise ValueError("the camera is rolled on its side, expected a level image")
    x, y = right / length
    return np.array([[y, -x, 0], [x, y, 0], [0, 0, 1.0]])


def project(
    points: np.ndarray, intrinsics: np.ndarray, extrinsics: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pixels [n, 2], continuous (column, row), and depths [n] of points in the project's frame.

    Depths are along the optical axis. Where they are <= 0, pixels have no meaning or are infinite.
    """
    camera = to_camera(points, extrinsics)
    depth = camera[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        pixels = (camera @ intrinsics[:2].T) / depth[:, None]
    return pixels, depth


def back_project(depth: np.ndarray, intrinsics: np.ndarray, extrinsics: np.ndarray) -> np.ndarray:
    """Points float32 [n, 3] in the project's frame, one for each pixel with depth [H, W] > 0."""
    rows, columns = np.nonzero(depth > 0)
    z = depth[rows, columns].astype(np.float64)
    rays = np.stack([columns + 0.5, rows + 0.5, np.ones(len(rows))])
    camera = (np.linalg.inv(intrinsics.astype(np.float64)) @ rays) * z
    rotation, translation = extrinsics[:, :3].astype(np.float64), extrinsics[:, 3:]
    return (rotation.T @ (camera - translation)).T.astype(np.float32)


def inside_mask(pixels: np.ndarray, mask: np.ndarray, radius: int = 0) -> np.ndarray:
    """Whether each of `pixels` [n, 2] from `project` is within `radius` pixels of the mask.

    False for pixels that are not finite or more than `radius` outside the image.
    """
    # The border of the padding stays False, so clipped coordinates give False.
    near = ndimage.maximum_filter(np.pad(mask, radius + 1), 2 * radius + 1, mode="constant")
    finite = np.isfinite(pixels).all(axis=1)
    cells = np.floor(np.where(finite[:, None], pixels, -1e6)) + (radius + 1)
    columns = np.clip(cells[:, 0], 0, near.shape[1] - 1).astype(np.intp)
    rows = np.clip(cells[:, 1], 0, near.shape[0] - 1).astype(np.intp)
    return near[rows, columns] & finite

"""Draws clouds with numpy: points are small squares, and near points cover far ones.

A picture of one case has five panels: the input image; prediction and ground truth from the camera
of the image; prediction and ground truth from the side, rotated by 90 degrees about the vertical
axis. The colour of a point shows its height (blue at the ground, red at z = 1). Points farther from
the camera are darker.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from PIL import Image

from psgn_jax.data.camera import project

# Colour map from blue over green and yellow to red, at equal steps of height.
_COLOURS = np.array(
    [[49, 54, 149], [69, 144, 190], [102, 189, 99], [253, 190, 80], [215, 48, 39]], np.float64
)
_PANEL_HEIGHT = 192


def render_cloud(
    points: np.ndarray,
    intrinsics: np.ndarray,
    extrinsics: np.ndarray,
    size: tuple[int, int],
) -> np.ndarray:
    """Draws one cloud as seen by a camera; a point is a square with sides of 3 pixels.

    Args:
      points: [n, 3] in the project's frame; points that are not finite are skipped.
      intrinsics: [3, 3] in pixels of an image of `size`.
      extrinsics: [3, 4], from the project's frame to the camera's.
      size: (height, width) of the picture.

    Returns:
      uint8 [height, width, 3] on white.
    """
    finite = np.isfinite(points).all(axis=1)
    points = points[finite].astype(np.float64)
    pixels, depth = project(points, intrinsics, extrinsics)
    front = depth > 1e-3
    points, pixels, depth = points[front], pixels[front], depth[front]
    far_first = np.argsort(-depth, kind="stable")
    points, pixels, depth = points[far_first], pixels[far_first], depth[far_first]
    height, width = size
    position = np.clip(points[:, 2], 0, 1) * (len(_COLOURS) - 1)
    low = np.minimum(position.astype(int), len(_COLOURS) - 2)
    colour = _COLOURS[low] + (position - low)[:, None] * (_COLOURS[low + 1] - _COLOURS[low])
    centre = 0.5 * (depth.min() + depth.max()) if len(depth) else 0.0
    # Objects are about 2 units deep: brightness falls from 1 in front to .55 at the back.
    colour *= np.clip(0.8 - 0.25 * (depth - centre), 0.55, 1.0)[:, None]
    shade = colour.astype(np.uint8)
    picture = np.full((height, width, 3), 255, np.uint8)
    # Clip far-away pixels before the conversion to integers.
    corner = np.floor(np.clip(pixels, -1e6, 1e6)).astype(int)
    offsets = (-1, 0, 1)
    square = np.array([(dx, dy) for dx in offsets for dy in offsets])
    column = corner[:, None, 0] + square[None, :, 0]
    row = corner[:, None, 1] + square[None, :, 1]
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    flat = (row * width + column)[inside]
    # If several points cover a pixel, the last one is the nearest: keep the last one.
    order = np.broadcast_to(np.arange(len(points))[:, None], inside.shape)[inside]
    winner = np.full(height * width, -1)
    np.maximum.at(winner, flat, order)
    hit = winner >= 0
    picture.reshape(-1, 3)[hit] = shade[winner[hit]]
    return picture


def turned(extrinsics: np.ndarray, degrees: float) -> np.ndarray:
    """Extrinsics [3, 4] that show the object rotated by an angle about the vertical axis."""
    cosine, sine = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    return np.concatenate([extrinsics[:, :3] @ turn, extrinsics[:, 3:]], axis=1)


def render_case(
    image: np.ndarray,
    pred: np.ndarray,
    gt: np.ndarray,
    intrinsics: np.ndarray,
    extrinsics: np.ndarray,
) -> np.ndarray:
    """Draws the five panels of one case side by side, uint8 [h, 5 w, 3].

    Args:
      image: uint8 [H, W, 3], the input of the network.
      pred: [n, 3].
      gt: [m, 3].
      intrinsics: [3, 3] for `image`.
      extrinsics: [3, 4].
    """
    scale = max(1, round(_PANEL_HEIGHT / image.shape[0]))
    size = (image.shape[0] * scale, image.shape[1] * scale)
    enlarged = np.asarray(Image.fromarray(image).resize(size[::-1], Image.Resampling.BICUBIC))
    camera = np.diag([scale, scale, 1.0]) @ intrinsics
    side = turned(extrinsics, 90)
    # Show about as many true points as predicted ones, so that both clouds look equally dense.
    gt = gt[:: max(1, len(gt) // max(1, len(pred)))]
    clouds = [
        render_cloud(cloud, camera, view, size)
        for view in (extrinsics, side)
        for cloud in (pred, gt)
    ]
    return np.concatenate([enlarged, *clouds], axis=1)


def render_cases(batch: Mapping[str, Any], pred: np.ndarray, indices: Sequence[int]) -> np.ndarray:
    """Draws several samples of a batch, one below the other."""
    keys = ("points", "intrinsics", "extrinsics")
    return np.concatenate(
        [render_case(batch["image"][i], pred[i], *(batch[k][i] for k in keys)) for i in indices]
    )

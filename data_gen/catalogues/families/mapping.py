"""Texture mappings of the parts of a model.

The inputs of a mapping are faces of parts and the bounding boxes of these parts. Lengths are in
units of the model's radius, with the origin on the ground. Because a mapping depends on nothing
else, a hidden parameter of a part does not change the texture on the visible faces. Images are
upright and not mirrored for a viewer in front of the face. On a face that points up, the bottom of
the image is toward +x.
"""

import dataclasses
from typing import Protocol

import numpy as np
from jaxtyping import Float


class UVMapping(Protocol):
    """Texture coordinates [F, 3, 2] of the corners of faces.

    Args:
      corners: corners of the faces, in units of the model's radius.
      normals: normals of the faces.
      low, high: bounding box of the part of each face.
    """

    def __call__(
        self,
        corners: Float[np.ndarray, "f 3 3"],
        normals: Float[np.ndarray, "f 3"],
        low: Float[np.ndarray, "f 3"],
        high: Float[np.ndarray, "f 3"],
    ) -> Float[np.ndarray, "f 3 2"]:
        """See the class."""
        ...


# For the dominant axis of a normal: the axes of u and v, and the sign of u if the normal is
# positive. A face that looks up or down has v along -x.
_U, _V = np.array([1, 0, 1]), np.array([2, 2, 0])
_SIGN = np.array([1.0, -1.0, 1.0])


def _dominant(normals: np.ndarray) -> np.ndarray:
    """The axis of the largest component of each normal; the last one if several are equal."""
    return np.argmax(np.abs(normals) * [1, 1.001, 1.002], axis=1)


def _planar(
    corners: np.ndarray, normals: np.ndarray, axis: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates to the right and upward, seen along the axis of each face."""
    rows = np.arange(len(axis))
    facing = np.sign(normals[rows, axis])
    upright = axis < 2
    u = corners[rows, :, _U[axis]] * (_SIGN[axis] * np.where(upright, facing, 1.0))[:, None]
    v = corners[rows, :, _V[axis]] * np.where(upright, 1.0, -facing)[:, None]
    return u, v


@dataclasses.dataclass(frozen=True)
class Tiled:
    """Repeats the texture by box projection: in the coordinate plane nearest to each face.

    Attributes:
      tile: length of one repeat, in units of the model's radius.
      along_grain: whether u is along the longest side of the part; otherwise it is horizontal.
    """

    tile: float = 1.0
    along_grain: bool = False

    def __call__(
        self, corners: np.ndarray, normals: np.ndarray, low: np.ndarray, high: np.ndarray
    ) -> np.ndarray:
        """See `UVMapping`."""
        axis = _dominant(normals)
        u, v = _planar(corners, normals, axis)
        if self.along_grain:
            # The grain follows the longest side; on a tie between the height and a horizontal side,
            # the horizontal one wins.
            grain = np.argmax((high - low).round(6) * [1, 1, 0.999], axis=1)
            turned = (_V[axis] == grain)[:, None]
            u, v = np.where(turned, v, u), np.where(turned, u, v)
        return np.stack([u, v], axis=2) / self.tile


@dataclasses.dataclass(frozen=True)
class Fitted:
    """Stretches the texture over the part, projected along the axis nearest to each normal.

    Attributes:
      repeats: number of repeats in u and v.
      only: an axis, "x", "y" or "z", along which all faces are projected; "" = each face along the
        axis nearest to its normal.
    """

    repeats: tuple[float, float] = (1.0, 1.0)
    only: str = ""

    def __call__(
        self, corners: np.ndarray, normals: np.ndarray, low: np.ndarray, high: np.ndarray
    ) -> np.ndarray:
        """See `UVMapping`."""
        axis = _dominant(normals)
        seen = normals
        if self.only:
            axis = np.full(len(normals), "xyz".index(self.only))
            seen = np.ones_like(normals) if self.only == "z" else np.where(normals < 0, -1.0, 1.0)
        extent = np.maximum(high - low, 1e-9)
        inside = (corners - (low + high)[:, None] / 2) / extent[:, None]
        u, v = _planar(inside, seen, axis)
        # A margin of about half a texel, so that rounding does not reach the opposite edge.
        return np.stack([0.5 + 0.99 * u, 0.5 + 0.99 * v], axis=2) * self.repeats


@dataclasses.dataclass(frozen=True)
class Wrapped:
    """Wraps the texture around the vertical axis of the part, with its centre toward +x.

    Attributes:
      repeats: number of repeats around and upward.
      low: lower end of the texture, as a fraction of the height of the part.
      high: upper end of the texture, likewise.
    """

    repeats: tuple[int, float] = (1, 1.0)
    low: float = 0.0
    high: float = 1.0

    def __call__(
        self, corners: np.ndarray, normals: np.ndarray, low: np.ndarray, high: np.ndarray
    ) -> np.ndarray:
        """See `UVMapping`."""
        away = corners[..., :2] - (low + high)[:, None, :2] / 2
        middle = away.mean(axis=1)
        centre = np.arctan2(middle[:, 1], middle[:, 0])[:, None]
        # Angles relative to the centre of each face, so that no face spans the seam.
        angle = np.arctan2(away[..., 1], away[..., 0]) - centre
        angle = (angle + np.pi) % (2 * np.pi) - np.pi
        angle[np.hypot(away[..., 0], away[..., 1]) < 1e-9] = 0
        u = 0.5 + (centre + angle) / (2 * np.pi)
        v = (corners[..., 2] - low[:, None, 2]) / np.maximum(high - low, 1e-9)[:, None, 2]
        v = (v - self.low) / (self.high - self.low)
        flat = np.abs(normals[:, 2]) > 0.9
        if flat.any():
            extent = np.maximum((high - low)[flat, None, :2], 1e-9)
            u[flat], v[flat] = np.moveaxis(0.5 + away[flat] / extent, 2, 0)
        return np.stack([u * self.repeats[0], v * self.repeats[1]], axis=2)

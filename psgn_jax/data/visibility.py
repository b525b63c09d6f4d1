"""Decides which points of a surface are visible in a depth image, in numpy.

It runs in the loader, when a batch of an evaluation is made. A point P is **visible** if it is
within a tolerance t of a surface point that the depth image measured:

    |P - Q| <= t for some pixel with a depth, where Q is its back-projected centre

All other points are **hidden**.

- The depth image is that of the record, at its full size. The classes therefore do not depend on
  the image size of a network.
- Steep surfaces: neighbouring points Q are one pixel apart in the image, but (one pixel) / cos(a)
  apart on a surface tilted by the angle a. So t must be several pixels wide. In the authors' images
  .025 covers surfaces tilted by up to 80 degrees. Steeper surfaces have gaps, whose points count as
  hidden. Comparing the depth of P only with the depth of its own pixel would lose far more points.
- Silhouettes: a strip of width t behind an occluding contour counts as visible, and so does the
  back of a sheet thinner than t. Without normals these points cannot be told apart.
- Holes in the depth (of a sensor): points that are only seen through a hole are hidden.

The default of t, `config.eval.visible_tolerance` = .025, follows from the authors' data. Rounding
to their 8-bit lattice (steps of .0098) moves a point by up to .0085. The point is up to .0064 from
the nearest pixel centre at f = 400 and a distance of 3.6, and up to .01 on a surface tilted by 60
degrees. A camera error of half a pixel adds .0045. The visibility of synthetic convex solids is
known exactly. On these, t = .025 calls 4.4 % of the visible points hidden and 2.8 % of the hidden
points visible. That is 3.5 % of all points, the lowest rate of the values tried (.015: 6.1 %, .02:
4.3 %, .03: also 3.5 %, .04: 4.1 %).

*Predicted* points have no class. A point off the surface is neither visible nor occluded. If such a
point got the class of the nearest true point, its class would depend on its error.
"""

import numpy as np

from psgn_jax.data import camera


def visible_points(
    points: np.ndarray,
    depth: np.ndarray,
    intrinsics: np.ndarray,
    extrinsics: np.ndarray,
    tolerance: float,
) -> np.ndarray:
    """Returns whether each point is visible, by the rule of the module.

    Deliberately one function: each step removes points that the next step need not check.

    Args:
      points: [n, 3] in the project's frame.
      depth: [H, W] along the optical axis, unit of the frame; 0 (or not finite) = none.
      intrinsics: [3, 3] in pixels of `depth`.
      extrinsics: [3, 4].
      tolerance: t, in units.

    Returns:
      bool [n]; False for points that are not finite, behind the camera, or less than t in front of
      it.

    Raises:
      ValueError: the tolerance is not finite or not positive.
    """
    if not 0 < tolerance < np.inf:
        raise ValueError(f"tolerance: got {tolerance}, expected a finite distance > 0")
    inner = np.array(intrinsics, np.float64)  # a copy
    outer = np.asarray(extrinsics, np.float64)
    points = np.asarray(points, np.float64)
    finite = np.isfinite(points).all(axis=1)
    place = camera.to_camera(np.where(finite[:, None], points, 0), outer)
    visible = np.zeros(len(place), np.bool_)
    measured = np.isfinite(depth) & (depth > 0)
    if not measured.any():
        return visible
    # Crop to the pixels with a depth: the object is a small part of most images.
    rows, columns = (np.flatnonzero(measured.any(axis=axis)) for axis in (1, 0))
    part = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    depth, measured = depth[part], measured[part]
    inner[:2, 2] -= columns[0], rows[0]
    first, last = float(depth[measured].min()), float(depth[measured].max())
    z = place[:, 2]
    possible = (z > tolerance) & (z >= first - tolerance) & (z <= last + tolerance)
    left = np.flatnonzero(finite & possible)
    place = place[left]

    # How many pixels away a Q within t of P can be (`across`, `down`): with x = X / Z of P, the
    # difference of x is ((X - X') - x (Z - Z')) / Z', which is at most t sqrt(1 + x^2) / Z'. The
    # same holds for y.
    ray = place[:, :2] / place[:, 2:]
    change = tolerance * np.sqrt(1 + ray**2) / np.maximum(place[:, 2:] - tolerance, first)
    reach = np.stack([change @ np.abs(inner[0, :2]), change[:, 1] * inner[1, 1]], axis=1) + 0.5
    image = ray @ inner[:2, :2].T + inner[:2, 2]
    size = np.array(depth.shape[::-1])
    inside = ((image > -reach) & (image < size + reach)).all(axis=1)
    left, place, image = left[inside], place[inside], image[inside]
    if not len(left):
        return visible
    across, down = np.minimum(reach[inside].max(axis=0), size - 1).astype(int).tolist()
    # The window of a point outside the image is centred on the nearest pixel of the image. Every
    # pixel of the image is at least as near to this centre as to the point, so none is missed.
    cell = np.clip(np.floor(image).astype(np.intp), 0, size - 1)

    # Back-projected pixels in the camera's frame, at infinity where there is no depth, with a
    # margin as wide as the window.
    rows, columns = np.nonzero(measured)
    pixels = np.stack([columns + 0.5, rows + 0.5, np.ones(len(rows))], axis=1)
    width = depth.shape[1] + 2 * across
    surface = np.full((depth.shape[0] + 2 * down, width, 3), np.inf)
    surface[rows + down, columns + across] = (
        pixels @ np.linalg.inv(inner).T * depth[measured].astype(np.float64)[:, None]
    )
    surface = surface.reshape(-1, 3)

    index = (cell[:, 1] + down) * width + cell[:, 0] + across

    # A cheap and exact test: most hidden points are deeper than all depths in their window.
    z = surface[:, 2].reshape(-1, width)
    deepest = _window_max(np.where(z < np.inf, z, -np.inf), down, across).reshape(-1)
    near = place[:, 2] - deepest.take(index) <= tolerance
    left, place, index = left[near], place[near], index[near]

    # Nearest pixels first: they decide most of the visible points, which are then removed.
    offsets = [(i, j) for i in range(-down, down + 1) for j in range(-across, across + 1)]
    offsets.sort(key=lambda o: o[0] ** 2 + o[1] ** 2)
    for number, (i, j) in enumerate(offsets, 1):
        gap = place - surface.take(index + i * width + j, axis=0)
        visible[left] |= np.einsum("nk,nk->n", gap, gap) <= tolerance**2
        if number in (1, 9, 25):
            rest = ~visible[left]
            left, place, index = left[rest], place[rest], index[rest]
    return visible


def _window_max(plane: np.ndarray, down: int, across: int) -> np.ndarray:
    """Maximum of [H, W] over windows of +-`down` rows and +-`across` columns."""
    for axis, reach in enumerate((down, across)):
        plane = np.moveaxis(plane, axis, 0)
        widened = plane.copy()
        for shift in range(1, reach + 1):
            np.maximum(widened[shift:], plane[:-shift], out=widened[shift:])
            np.maximum(widened[:-shift], plane[shift:], out=widened[:-shift])
        plane = np.moveaxis(widened, 0, axis)
    return plane

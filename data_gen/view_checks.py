"""Checks of a rendered view: mask and depth against the surface points, and the brightness."""

from collections.abc import Mapping

import numpy as np
import scipy.ndimage
import scipy.spatial
from jaxtyping import Float

from data_gen import cameras
from data_gen.picture import Picture
from data_gen.settings import Settings

_NO_OBJECT = 1e6  # not NaN, which is not JSON


def check_view(
    picture: Picture,
    camera: cameras.Camera,
    points: Float[np.ndarray, "n 3"],
    tree: scipy.spatial.cKDTree,
) -> dict[str, float]:
    """Measurements of a view, which `objection_to` compares with the settings.

    Args:
      picture: the view.
      camera: its camera.
      points: points on the surface, in the view-aligned frame.
      tree: search tree of the points in the model's frame.

    Returns:
      coverage: fraction of the image that the mask covers; edge: number of mask pixels at the
      border of the image; luminance: mean of the pixels in the mask, 0 to 255; inside: fraction of
      the points that project into the mask dilated by one pixel; depth: median distance of
      back-projected pixels from the nearest point, 1e6 if the mask is empty; `before`: fraction of
      the points that lie in front of the visible surface.
    """
    mask = picture.mask
    height, width = mask.shape
    border = mask[0].sum() + mask[-1].sum() + mask[1:-1, 0].sum() + mask[1:-1, -1].sum()
    pixels, z = cameras.project(points, camera)
    cells = np.floor(pixels).astype(int)
    here = ((cells >= 0) & (cells < [width, height])).all(axis=1) & (z > 0)
    column, row = cells[here].T
    grown = scipy.ndimage.binary_dilation(mask, np.ones((3, 3)))
    # The smallest depth in 3 x 3 pixels, because points near a silhouette may project beside it.
    far = np.where(mask, picture.depth, np.inf)
    near = scipy.ndimage.minimum_filter(far, size=3)
    median = _NO_OBJECT
    rows, columns = np.nonzero(mask)
    if len(rows):
        some = slice(None, None, max(1, len(rows) // 400))
        rows, columns = rows[some], columns[some]
        k = camera.intrinsics
        rays = np.stack([columns + 0.5, rows + 0.5, np.ones(len(rows))]).T @ np.linalg.inv(k).T
        inside = rays * picture.depth[rows, columns][:, None] - camera.extrinsics[:, 3]
        world = inside @ camera.extrinsics[:, :3] @ camera.rotation
        median = float(np.median(tree.query(world)[0]))
    return {
        "coverage": round(float(mask.mean()), 5),
        "edge": int(border),
        "luminance": round(float(picture.image[mask].mean()) if mask.any() else 0.0, 2),
        "inside": round(float(grown[row, column].sum() / len(points)), 6),
        "depth": round(median, 5),
        "before": round(float((z[here] < near[row, column] - 0.02).mean()), 6),
    }


def objection_to(checks: Mapping[str, float], settings: Settings) -> str:
    """The reason why a view is refused, "" if it is accepted."""
    limits = settings.checks
    if checks["coverage"] < limits.coverage:
        return (
            f"the object covers {checks['coverage']:.5f} of the image, expected at least "
            f"{limits.coverage}"
        )
    if checks["edge"]:
        return f"{checks['edge']} pixels of the object touch the border of the image, expected none"
    if checks["inside"] < limits.inside:
        return (
            f"{checks['inside']:.4f} of the points project into the dilated mask, expected at "
            f"least {limits.inside}"
        )
    if not checks["depth"] <= limits.depth:
        return (
            f"the median distance of depth from points is {checks['depth']:.4f}, expected at most "
            f"{limits.depth}"
        )
    if checks["luminance"] < limits.luminance:
        return (
            f"the object's brightness is {checks['luminance']:.1f}, expected at least "
            f"{limits.luminance}"
        )
    return ""

"""Finds training objects with the shape of a validation or test object.

Two clouds have the same shape if, centred, scaled to the same mean square distance from their
centroids, and turned about the vertical axis and mirrored to fit best, they are no farther apart
than two samples of one surface, up to 20 %:

    mean |a - b(a)|^2 + mean |b - a(b)|^2 < 1.2 (mean |a - a'(a)|^2 + mean |b - b'(b)|^2)

where b(a) is the point of the other cloud nearest to a, and a'(a) the nearest other point of the
same cloud. We compare only pairs with similar descriptors: the histogram of distances from the
vertical axis and of heights, which turning and mirroring do not change.
"""

import numpy as np
from scipy.spatial import KDTree

# A cloud is compared with at most `_MOST` objects whose histograms differ by less than `_NEAR`
# (L1). For two samples of 16,384 points of one surface they differ by up to about .1.
_NEAR, _MOST = 0.15, 4
_MARGIN = 1.2
_RADII, _HEIGHTS = np.linspace(0, 3, 13), np.linspace(-3, 3, 19)
# The search compares every 32nd with every 8th point, for this many angles.
_SPARSE, _TREE, _ANGLES = 32, 8, 48


def normalised(points: np.ndarray) -> np.ndarray:
    """Points [n, 3], centred and scaled to a mean square distance of 1 from the centroid."""
    centred = points - points.mean(axis=0, dtype=np.float64)
    return centred / (np.sqrt((centred**2).sum(axis=1).mean()) or 1.0)


def descriptor(cloud: np.ndarray) -> np.ndarray:
    """The histogram of radius and height of a normalised cloud, with the sum 1."""
    radius = np.hypot(cloud[:, 0], cloud[:, 1])
    counts, _, _ = np.histogram2d(radius, cloud[:, 2], bins=[_RADII, _HEIGHTS])
    return counts.ravel() / len(cloud)


def aligned_distance(a: np.ndarray, b: np.ndarray) -> float:
    """Chamfer distance of two normalised clouds for the best rotation and mirroring of a."""
    sparse, tree = a[::_SPARSE], KDTree(b[::_TREE])
    found = [
        (_one_way(_turned(sparse * [1, sign, 1], angle), tree), sign, angle)
        for sign in (1, -1)
        for angle in np.arange(_ANGLES) * (2 * np.pi / _ANGLES)
    ]
    _, sign, angle = min(found)
    mirrored, tree = a * [1, sign, 1], KDTree(b)
    best = _one_way(_turned(mirrored[::4], angle), tree)
    step = np.pi / _ANGLES
    while step > 1e-3:
        for other in (angle - step, angle + step):
            distance = _one_way(_turned(mirrored[::4], other), tree)
            if distance < best:
                best, angle = distance, other
        step /= 2
    fitted = _turned(mirrored, angle)
    return _one_way(fitted, tree) + _one_way(b, KDTree(fitted))


def sampling_distance(cloud: np.ndarray) -> float:
    """Mean square distance of the distinct points of a cloud to their nearest neighbours."""
    distinct = np.unique(cloud, axis=0)
    distance, _ = KDTree(distinct).query(distinct, k=2)
    return float((distance[:, 1] ** 2).mean())


class HeldOut:
    """The shapes of objects for validation and tests."""

    def __init__(self, clouds: list[np.ndarray]) -> None:
        self._clouds = [normalised(cloud) for cloud in clouds]
        self._floors = [sampling_distance(cloud) for cloud in self._clouds]
        self._descriptors = np.array([descriptor(cloud) for cloud in self._clouds])

    def has(self, points: np.ndarray) -> bool:
        """Whether an object has the shape of these points [n, 3]."""
        if not self._clouds:
            return False
        cloud = normalised(points)
        difference = np.abs(self._descriptors - descriptor(cloud)).sum(axis=1)
        near = [i for i in np.argsort(difference)[:_MOST] if difference[i] < _NEAR]
        floor = sampling_distance(cloud) if len(near) else 0.0
        return any(
            aligned_distance(cloud, self._clouds[i]) < _MARGIN * (floor + self._floors[i])
            for i in near
        )


def _turned(points: np.ndarray, angle: float) -> np.ndarray:
    cosine, sine = np.cos(angle), np.sin(angle)
    return points @ np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]])


def _one_way(points: np.ndarray, tree: KDTree) -> float:
    distance, _ = tree.query(points)
    return float((distance**2).mean())

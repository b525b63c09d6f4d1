import jax
import numpy as np
import pytest

from psgn_jax.models import volumes
from psgn_jax.models.volumes import log_volume

splat = jax.jit(volumes.splat, static_argnames="size")


def naive_splat(points, size=32):
    """`splat` by loops over points and cells: the intersections with each point's cube."""
    grid, cells = np.zeros((size,) * 3), np.arange(size)
    for u in np.add(points, [1, 1, 0], dtype=np.float64) * size / 2:
        ends = [(np.minimum(cells + 1, x + 0.5), np.maximum(cells, x - 0.5)) for x in u]
        overlap = [np.clip(high - low, 0, 1) for high, low in ends]
        grid += np.einsum("i,j,k->ijk", *overlap)
    return np.minimum(grid, 1)


def test_splat_is_the_intersection_volume_also_at_and_beyond_the_border(rng):
    points = rng.uniform([-0.6, -0.6, 0.1], [0.6, 0.6, 1.3], (300, 3)).astype(np.float32)
    np.testing.assert_allclose(splat(points, size=8), naive_splat(points, 8), atol=1e-5)
    points = np.array([[-1, -1, 0], [1, 1, 2], [5, 0, 1], [-1e9, 0, 1], [0, 0, -0.2]], np.float32)
    grid = np.asarray(splat(points))
    assert grid[0, 0, 0] == pytest.approx(1 / 8)
    assert grid[31, 31, 31] == pytest.approx(1 / 8)
    assert grid.sum() == pytest.approx(1 / 4)
    points[2, 1] = np.nan
    assert np.isnan(splat(points)).all()
    assert splat(np.float32([[1 / 32, 1 / 32, 33 / 32]] * 5)).max() == 1  # clipped


def test_log_volume_is_in_cubic_units():
    occupancy = np.zeros((32, 32, 32), bool)
    assert log_volume(occupancy) == pytest.approx(np.log(1 / 16**3))
    occupancy[:16] = True
    assert log_volume(occupancy) == pytest.approx(np.log(4))

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import reference

from psgn_jax import losses


@pytest.mark.parametrize(("n", "k"), [(1, 1), (128, 20), (300, 300)])
def test_equals_the_naive_version(rng, n, k):
    points = rng.normal(size=(n, 3)).astype(np.float32)
    got = losses.farthest_point_indices(points, k)
    np.testing.assert_array_equal(got, reference.farthest_points(points, k))
    np.testing.assert_array_equal(losses.farthest_points(points, k), points[np.asarray(got)])


def test_ties_go_to_the_lowest_index_and_no_index_repeats():
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], np.float32)
    # The corner opposite to corner 0 is chosen first; all others are then equally far.
    np.testing.assert_array_equal(losses.farthest_point_indices(corners, 8)[:3], [0, 7, 1])
    points = np.repeat(np.eye(3, dtype=np.float32), 60, axis=0)
    assert sorted(losses.farthest_point_indices(points, 180).tolist()) == list(range(180))


def test_gradient_reaches_the_chosen_points_and_nan_shows(rng):
    points = rng.normal(size=(50, 3)).astype(np.float32)
    pulled = jax.grad(lambda p: losses.farthest_points(p, 5).sum())(jnp.asarray(points))
    chosen = np.flatnonzero(np.asarray(pulled).any(axis=1))
    np.testing.assert_array_equal(chosen, np.sort(losses.farthest_point_indices(points, 5)))
    points[3, 1] = np.nan
    assert jnp.isnan(jax.jit(losses.farthest_points, static_argnums=1)(points, 5)).all()

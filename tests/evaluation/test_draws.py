"""Metrics of several predictions, against slow float64 versions and known values."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import reference

from psgn_jax.evaluation import draws as lib
from psgn_jax.losses.chamfer import chamfer_sq_mean
from psgn_jax.prediction import sampling

quick_jit = functools.partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})


@pytest.fixture(scope="module")
def clouds():
    rng = np.random.default_rng(0)
    draws = rng.normal(size=(4, 12, 3)).astype(np.float32)
    truths = rng.normal(size=(3, 20, 3)).astype(np.float32)
    return draws, truths


@pytest.fixture(scope="module")
def cross(clouds):
    return quick_jit(lambda a, b: sampling.cross_distances(a, b, chamfer_sq_mean))(*clouds)


def test_distances_of_sets(clouds, cross):
    draws, truths = clouds
    np.testing.assert_allclose(cross, reference.cross_chamfer(draws, truths), rtol=1e-5)
    want = reference.minimum_matching_distance(draws, truths)
    np.testing.assert_allclose(lib.minimum_matching_distance(cross), want, rtol=1e-5)
    assert float(lib.coverage(cross)) == pytest.approx(reference.coverage(draws, truths))


def test_best_and_mean(clouds):
    draws, truths = clouds
    gt = truths[0]
    found = quick_jit(lambda d, g: lib.summarise_draws(d, g, {"cd": chamfer_sq_mean}))(draws, gt)
    want = reference.cross_chamfer(draws, truths[:1])[:, 0]
    np.testing.assert_allclose(found["cd_best_of_4"], want.min(), rtol=1e-5)
    np.testing.assert_allclose(found["cd_mean_of_4"], want.mean(), rtol=1e-5)


def test_mutual_difference(clouds, unchecked_annotations):
    draws, _ = clouds
    matrix = quick_jit(sampling.mutual_distances)(draws)
    np.testing.assert_allclose(matrix, reference.cross_chamfer(draws, draws), rtol=1e-5, atol=1e-7)
    want = reference.total_mutual_difference(draws)
    np.testing.assert_allclose(lib.total_mutual_difference(matrix), want, rtol=1e-5)
    for wrong in (np.zeros((1, 1), "f4"), np.zeros((2, 3), "f4")):
        with pytest.raises(ValueError, match=r"distances: got shape"):
            lib.total_mutual_difference(wrong)


def test_coverage_counts_truths_that_a_draw_is_nearest_to():
    matrix = jnp.array([[0.1, 0.5, 0.9], [0.2, 0.3, 0.9], [0.4, 0.1, 0.8]], jnp.float32)
    assert float(lib.coverage(matrix)) == pytest.approx(2 / 3)
    assert float(lib.minimum_matching_distance(matrix)) == pytest.approx((0.1 + 0.1 + 0.8) / 3)


@pytest.mark.parametrize(("k", "t"), [(1, 1), (5, 5), (8, 13)])
def test_wasserstein_is_that_of_the_quantiles(rng, k, t):
    a, b = rng.normal(size=k), rng.normal(size=t) * 2 + 1
    # The reference evaluates quantiles at 200,001 levels, so each jump may be off by one step.
    assert lib.wasserstein_1(a, b) == pytest.approx(reference.wasserstein_1(a, b), abs=2e-4)
    assert lib.wasserstein_1(a, a + 3) == pytest.approx(3)
    assert lib.wasserstein_1(a, np.repeat(a, 3)) == pytest.approx(0, abs=1e-12)
    assert lib.wasserstein_1(a, b) == pytest.approx(lib.wasserstein_1(b, a))


def test_wrong_samples_are_named(unchecked_annotations):
    with pytest.raises(ValueError, match=r"drawn: got \[\]"):
        lib.wasserstein_1(np.zeros(0), np.zeros(2))
    with pytest.raises(ValueError, match=r"true: got \[nan\]"):
        lib.wasserstein_1(np.zeros(1), np.full(1, np.nan))
    with pytest.raises(ValueError, match="expected low < high"):
        lib.range_coverage(np.zeros(2), 1, 1)


def test_coverage_of_a_range():
    assert lib.range_coverage(np.array([0.2, 0.7, 0.5]), 0.0, 1.0) == pytest.approx(0.5)
    assert lib.range_coverage(np.array([-1, 3.0]), 0.0, 1.0) == pytest.approx(1)
    assert lib.range_coverage(np.array([2, 3.0]), 0.0, 1.0) == 0
    assert lib.range_coverage(np.array([0.4]), 0.0, 1.0) == 0

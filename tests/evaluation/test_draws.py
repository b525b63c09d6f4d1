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
    assert float(lib.coverage(cross)) == pytest.approx(reference.coverage(draws, truths))


def test_best_and_mean(clouds):
    draws, truths = clouds
    gt = truths[0]
    found = quick_jit(lambda d, g: lib.summarise_draws(d, g, {"cd": chamfer_sq_mean}))(draws, gt)
    want = reference.cross_chamfer(draws, truths[:1])[:, 0]
    np.testing.assert_allclose(found["cd_best_of_4"], want.min(), rtol=1e-5)
    np.testing.assert_allclose(found["cd_mean_of_4"], want.mean(), rtol=1e-5)


def test_mutual_difference(clouds):
    draws, _ = clouds
    matrix = quick_jit(sampling.mutual_distances)(draws)
    np.testing.assert_allclose(matrix, reference.cross_chamfer(draws, draws), rtol=1e-5, atol=1e-7)
    want = reference.total_mutual_difference(draws)
    np.testing.assert_allclose(lib.total_mutual_difference(matrix), want, rtol=1e-5)


def test_coverage_counts_truths_that_a_draw_is_nearest_to():
    matrix = jnp.array([[0.1, 0.5, 0.9], [0.2, 0.3, 0.9], [0.4, 0.1, 0.8]], jnp.float32)
    assert float(lib.coverage(matrix)) == pytest.approx(2 / 3)

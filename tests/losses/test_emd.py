import itertools

import jax
import numpy as np
import pytest
from helpers import reference
from helpers.real_pairs import clouds

from psgn_jax import losses
from psgn_jax.evaluation import clouds as metrics_lib

N = 96
# Without `jit`, all tests share the solver, which is compiled once per size.
mean = losses.emd_mean
mean_and_grad = jax.value_and_grad(losses.emd_mean, argnums=(0, 1))


def test_equals_reference_within_the_gap(rng):
    a, b = clouds(rng, N, N)
    best = reference.emd_sum(a, b)
    matched = losses.matched_distances(a, b)
    total = float(matched.distance.sum())
    assert best * (1 - 1e-6) <= total <= best * (1 + float(matched.assignment.gap)) * (1 + 1e-6)
    by_index = np.linalg.norm(a - b[np.asarray(matched.assignment.index)], axis=1)
    np.testing.assert_allclose(matched.distance, by_index, rtol=1e-6)
    np.testing.assert_allclose(losses.emd_sum(a, b), total, rtol=1e-6)
    np.testing.assert_allclose(mean(a, b), total / N, rtol=1e-6)


def test_exact(rng):
    a, b = clouds(rng, 5, 5)
    found = losses.emd_exact(a, b)
    d = reference.distances(a, b)
    by_hand = min(d[np.arange(5), list(s)].sum() for s in itertools.permutations(range(5)))
    np.testing.assert_allclose(found.cost, by_hand, rtol=1e-12)
    np.testing.assert_allclose(reference.matching_cost(a, b, found.index), by_hand, rtol=1e-12)


def test_gradient_equals_directional_difference(rng):
    # The points of a are far apart and those of b near them. Small changes therefore do not change
    # the optimal bijection, and the auction finds it.
    a = 10 * np.stack(np.meshgrid(*[np.arange(5)] * 3), -1).reshape(-1, 3)[:N].astype(np.float64)
    b = (a + rng.normal(size=a.shape))[rng.permutation(N)]
    _, grads = mean_and_grad(a.astype(np.float32), b.astype(np.float32))
    u, v = rng.normal(size=(2, N, 3))
    h = 1e-5
    above, below = (reference.emd_sum(a + s * u, b + s * v) for s in (h, -h))
    got = np.vdot(grads[0], u) + np.vdot(grads[1], v)
    np.testing.assert_allclose(got, (above - below) / (2 * h * N), rtol=1e-4, atol=1e-5)


def test_a_second_call_compiles_nothing(rng, caplog):
    pair = clouds(rng, N, N)
    batch = losses.map_pairs(losses.emd_mean)
    for call in (lambda: losses.emd_mean(*pair), lambda: batch(*(x[None] for x in pair))):
        call()
        with jax.log_compiles():
            caplog.clear()
            call()
        assert not [r for r in caplog.records if "compilation" in r.getMessage()]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_with_64_bits(rng, dtype):
    a, b = (x.astype(dtype) for x in clouds(rng, 40, 40))
    with jax.enable_x64(True):
        value, grad = jax.jit(jax.value_and_grad(losses.emd_mean))(a, b)
        assert value.dtype == grad.dtype == dtype
        best = reference.emd_sum(a, b) / 40
        assert best * (1 - 1e-6) <= value <= best * 1.0101
        large = a * np.float64(1e50)  # beyond float32
        assert losses.chamfer_sq(large, large) == 0


def test_a_larger_truth_is_thinned_at_random(rng):
    a, b = clouds(rng, N, N)
    subset = metrics_lib.emd(a, np.concatenate([b, b + 100]))
    assert subset.emd > 10  # about half of the chosen points are from the distant copy

import jax
import numpy as np
import pytest

from psgn_jax import losses

CD, EMD = losses.chamfer_sq, losses.emd_sum


def case(rng, draws, n=24, m=24):
    return rng.normal(size=(draws, n, 3)).astype(np.float32), rng.normal(size=(m, 3)).astype("f4")


@pytest.mark.parametrize(("distance", "draws"), [(CD, 5), (EMD, 3)])
def test_value_and_gradient_are_those_of_the_nearest(rng, distance, draws):
    preds, gt = case(rng, draws)
    alone = jax.jit(jax.value_and_grad(distance, argnums=(0, 1)))
    want, want_grads = zip(*(alone(pred, gt) for pred in preds), strict=True)
    want = np.array(want)
    j = int(want.argmin())

    def value(preds, gt):
        best = losses.min_of_n(distance)(preds, gt)
        return best.value, best

    (_, best), grads = jax.jit(jax.value_and_grad(value, argnums=(0, 1), has_aux=True))(preds, gt)
    np.testing.assert_allclose(best.distances, want, rtol=1e-6)
    assert best.winner == j
    assert best.value == best.distances[j]
    np.testing.assert_allclose(grads[0][j], want_grads[j][0], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(grads[1], want_grads[j][1], rtol=1e-5, atol=1e-6)
    assert not np.delete(grads[0], j, axis=0).any()


def test_of_equally_near_draws_the_first_wins_and_a_nan_of_any_draw_shows(rng):
    preds, gt = case(rng, 1)
    preds = np.concatenate([preds + 3, preds, preds])
    grads = jax.jit(jax.grad(lambda preds: losses.min_of_n(CD)(preds, gt).value))(preds)
    assert np.abs(grads).max(axis=(1, 2)).astype(bool).tolist() == [False, True, False]
    preds, gt = case(rng, 3)
    min_of_n = jax.jit(losses.min_of_n(CD))
    preds[1, 5, 1] = np.nan
    best = min_of_n(preds, gt)
    assert np.isnan(best.value)
    assert best.winner == 1

"""`map_pairs` divides traced batches into parts, with the results of the whole batch."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from psgn_jax import losses
from psgn_jax.losses import batches


@pytest.mark.parametrize("num_pairs", [3, 17])
def test_parts_give_the_results_of_the_whole(num_pairs, rng, monkeypatch):
    a, b, w = (
        jnp.asarray(rng.normal(size=(num_pairs, *shape)), jnp.float32)
        for shape in ((5, 3), (7, 3), (2,))
    )

    def function(a, b, w):
        return {"cd": losses.chamfer_sq_mean(a, b) * w[0], "w": w}

    def total(a):
        return jnp.sum(losses.map_pairs(function)(a, b, w)["cd"])

    whole = losses.map_pairs(function)(a, b, w)
    monkeypatch.setattr(batches, "num_cores", lambda: 8)
    parts = jax.jit(lambda *args: losses.map_pairs(function)(*args))(a, b, w)
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-6), parts, whole)
    equations = jax.make_jaxpr(total)(a).eqns
    num_parts = sum(e.primitive.name == "scan" for e in equations)
    assert num_parts == max(1, min(4, num_pairs // 4))
    by_parts = jax.jit(jax.grad(total))(a)
    monkeypatch.setattr(batches, "num_cores", lambda: 1)
    np.testing.assert_allclose(by_parts, jax.grad(total)(a), rtol=1e-5)


def test_batches_of_two_sizes_are_refused():
    with pytest.raises(ValueError, match="got batches of 2, 3 pairs, expected the same number"):
        losses.map_pairs(losses.chamfer_sq_mean)(jnp.zeros((2, 5, 3)), jnp.zeros((3, 5, 3)))


def test_no_pairs(monkeypatch):
    monkeypatch.setattr(batches, "num_cores", lambda: 8)
    function = jax.jit(losses.map_pairs(losses.chamfer_sq_mean))
    assert function(jnp.zeros((0, 5, 3)), jnp.zeros((0, 7, 3))).shape == (0,)

"""`map_pairs` has the results of each pair, on a CPU and by the program of an accelerator."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from psgn_jax import losses
from psgn_jax.losses import mapping


@pytest.mark.parametrize("chosen", [0, 1])
def test_the_results_are_those_of_each_pair(chosen, rng, monkeypatch):
    choose = lambda *programs_and_arrays: programs_and_arrays[chosen](*programs_and_arrays[2:])  # noqa: E731
    monkeypatch.setattr(mapping, "per_platform", choose)
    arrays = [jnp.asarray(rng.normal(size=(4, *s)), jnp.float32) for s in ((5, 3), (7, 3), (2,))]

    def function(a, b, w):
        return {"cd": losses.chamfer_sq_mean(a, b) * w[0], "w": w}

    def total(a, mapped):
        return jnp.sum(mapped(a, *arrays[1:])["cd"])

    mapped = losses.map_pairs(function)
    pairs = [function(*pair) for pair in zip(*arrays, strict=True)]
    each = jax.tree.map(lambda *leaves: jnp.stack(leaves), *pairs)
    found = jax.jit(mapped)(*arrays)
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-6), found, each)
    gradients = [jax.grad(total)(arrays[0], m) for m in (mapped, jax.vmap(function))]
    np.testing.assert_allclose(*gradients, rtol=1e-5)


def test_no_pairs_give_no_losses():
    mapped = losses.map_pairs(losses.chamfer_sq_mean)
    assert mapped(jnp.zeros((0, 5, 3)), jnp.zeros((0, 7, 3))).shape == (0,)


@pytest.mark.parametrize(("function", "shapes", "most"), [
    (losses.assign, [(16384, 3)] * 2, 16e6),  # all distances would take 1 GB
    (jax.grad(lambda a, b: losses.map_pairs(losses.chamfer_sq_mean)(a, b).sum()),
     [(4, 1024, 3), (4, 16384, 3)], 16e6),  # those of one pair would take 64 MB
    (lambda points: losses.farthest_point_indices(points, 1024), [(16384, 3)], 2e6),  # 67 MB
])  # fmt: skip
def test_memory_is_linear(function, shapes, most):
    shapes = [jax.ShapeDtypeStruct(shape, jnp.float32) for shape in shapes]
    memory = jax.jit(function).lower(*shapes).compile().memory_analysis()
    assert memory.temp_size_in_bytes < most

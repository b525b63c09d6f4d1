import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import reference
from helpers.real_pairs import clouds
from helpers.refusals import refused

from psgn_jax import losses
from psgn_jax.losses import chamfer

NAMES = ["chamfer_sq", "chamfer_sq_mean", "chamfer_l1_mean", "chamfer_authors"]
# Sizes on both sides of the search's block (32) and tile boundaries.
SIZES = [(1, 1), (40, 1), (31, 32), (63, 65), (300, 1025)]


def check_nearest(a, b):
    for got, (x, y) in zip(losses.nearest_both(a, b), ((a, b), (b, a)), strict=True):
        squares = reference.pairwise_sq(x, y)
        want_sq = squares.min(axis=1)
        np.testing.assert_allclose(got.distance_sq, want_sq, rtol=2e-6, atol=0)
        # The index may differ where two points are equally near in float arithmetic.
        at_index = squares[np.arange(len(x)), np.asarray(got.index)]
        np.testing.assert_allclose(at_index, want_sq, rtol=2e-6, atol=0)


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_nearest_equals_reference(rng, n, m):
    check_nearest(*clouds(rng, n, m))


def test_nearest_at_any_scale_offset_and_distance(rng):
    # At the largest offsets few significant digits are left, and many points coincide.
    for scale, offset in ((1e-6, 0), (1e6, 0), (1, 1e3), (1, -1e6), (1e-3, 1e3)):
        check_nearest(*clouds(rng, 100, 210, scale, offset))
    # Neighbours at a distance of 1e-6 in a cloud of radius 1. The expansion |a|^2 - 2ab + |b|^2
    # would return errors of 1e-7.
    a, _ = clouds(rng, 500, 1)
    check_nearest(a, a[rng.permutation(500)] + np.float32(1e-6))


def test_ties_take_the_lowest_index(rng):
    grid = np.stack(np.meshgrid(*[np.arange(5)] * 3), -1).reshape(-1, 3).astype(np.float32)
    middle = grid[:90] + 0.5
    for a, b in ((middle, np.tile(grid, (2, 1))), (np.tile(grid, (2, 1)), middle), (grid, grid)):
        to_b, to_a = losses.nearest_both(a, b)
        squares = reference.pairwise_sq(a, b)
        np.testing.assert_array_equal(to_b.index, squares.argmin(axis=1))
        np.testing.assert_array_equal(to_a.index, squares.argmin(axis=0))


@pytest.mark.parametrize("name", NAMES)
def test_loss_and_gradient_equal_the_reference(rng, name):
    a, b = clouds(rng, 70, 33)
    slow = getattr(reference, name)
    value, grads = jax.value_and_grad(getattr(losses, name), argnums=(0, 1))(a, b)
    assert (value.shape, value.dtype) == ((), jnp.float32)
    np.testing.assert_allclose(value, slow(a, b), rtol=1e-5)
    u, v = clouds(rng, 70, 33)
    h = 1e-6  # so small that no point gets another neighbour
    a64, b64 = a.astype(np.float64), b.astype(np.float64)
    want = (slow(a64 + h * u, b64 + h * v) - slow(a64 - h * u, b64 - h * v)) / (2 * h)
    got = np.vdot(grads[0], u) + np.vdot(grads[1], v)
    np.testing.assert_allclose(got, want, rtol=1e-4, atol=1e-4 * abs(want))


def test_is_the_definition_also_in_the_tiles_of_an_accelerator(rng, monkeypatch):
    a, b = clouds(rng, 130, 200)
    both = (losses.chamfer_sq_mean, chamfer.chamfer_by_definition)
    fast, slow = (jax.jit(jax.value_and_grad(f, (0, 1)))(a, b) for f in both)
    jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-6, atol=1e-8), fast, slow)
    a, b = clouds(rng, 1100, 71)  # no other test traces this size
    monkeypatch.setattr(chamfer, "per_platform", lambda cpu, other, *arrays: other(*arrays))
    distances = np.square(a[:, None] - b).sum(-1)
    for axis, found in enumerate(losses.nearest_both(a, b)):
        np.testing.assert_allclose(found.distance_sq, distances.min(1 - axis), rtol=1e-5)
        np.testing.assert_array_equal(found.index, distances.argmin(1 - axis))


@pytest.mark.parametrize("name", ["chamfer_sq", "chamfer_l1_mean", "emd_mean"])
def test_coincident_points_have_zero_gradient(rng, name):
    a, _ = clouds(rng, 70, 1)
    value, grads = jax.value_and_grad(getattr(losses, name), argnums=(0, 1))(a, a[::-1])
    assert value == 0
    assert not np.any(grads)


@pytest.mark.filterwarnings("error")
def test_float64_of_numpy_needs_no_warning(rng):
    pred, gt = rng.random((20, 3)), rng.random((30, 3))
    single = losses.chamfer_sq(pred.astype(np.float32), gt.astype(np.float32))
    assert losses.chamfer_sq(pred, gt) == single
    assert losses.chamfer_sq(pred.astype(">f4"), gt.astype(">f8")) == single
    with refused(ValueError, "pred: point 0 of 20"):
        losses.chamfer_sq(1e300 * pred, gt)


@pytest.mark.parametrize("loss", [losses.chamfer_sq_mean, losses.emd_mean])
def test_bfloat16_is_computed_in_float32(rng, loss):
    a, b = (jnp.asarray(x, jnp.bfloat16) for x in clouds(rng, 70, 70))
    value, grad = jax.value_and_grad(loss)(a, b)
    assert value.dtype == jnp.float32
    assert grad.dtype == jnp.bfloat16
    assert value == loss(a.astype(jnp.float32), b.astype(jnp.float32))

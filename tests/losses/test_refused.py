import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.refusals import all_refused, refused

from psgn_jax import losses
from psgn_jax.evaluation import clouds as metrics

ONES = np.ones((4, 3), np.float32)


@pytest.mark.parametrize(("argument", "bad"), [("pred", np.inf), ("gt", np.nan)])
@pytest.mark.parametrize("loss", [losses.chamfer_sq_mean, losses.emd_mean])
def test_non_finite(loss, argument, bad, rng):
    good, pair = (rng.normal(size=(2, 96, 3)).astype(np.float32) for _ in range(2))
    pair[["pred", "gt"].index(argument)][33, 1] = bad
    with refused(ValueError, f"{argument}: point 33 of 96"):
        loss(*pair)
    assert np.isnan(jax.jit(loss)(*pair))
    # `grad` and `vmap` trace the values too. The other pairs of a batch are not affected.
    grads = jax.jit(jax.vmap(jax.grad(loss, argnums=(0, 1))))(*np.stack([pair, good], axis=1))
    for grad in grads:
        assert np.isnan(grad[0]).all()
        assert np.isfinite(grad[1]).all()
    # Every distance is NaN, and the bijection is that of no auction.
    for found in jax.jit(losses.nearest_both)(*pair):
        assert np.isnan(found.distance_sq).all()
    found = jax.jit(losses.assign)(*pair)
    np.testing.assert_array_equal(found.index, np.arange(96))
    assert (bool(found.converged), np.isnan(found.gap)) == (False, True)


@pytest.mark.usefixtures("unchecked_annotations")
def test_wrong_clouds():
    shapes = [np.ones(shape, np.float32) for shape in ((0, 3), (5, 2), (3,), (2, 5, 3))]
    calls = (losses.chamfer_sq_mean, losses.emd_mean)
    for call, x in itertools.product((*calls, *map(jax.jit, calls)), shapes):
        for name, pair in {"pred": (x, ONES), "gt": (ONES, x)}.items():
            with refused(ValueError, f"{name}: got float32[", "[n, 3]"):
                call(*pair)
    types = [(ONES.astype(np.uint8), "gt: got uint8[4, 3]"), (ONES.tolist(), "gt: got list")]
    all_refused(lambda x: losses.chamfer_sq(ONES, x), ValueError, types)
    for call in (losses.assign, jax.jit(losses.assign), losses.emd_mean, losses.emd_exact):
        with refused(ValueError, "gt: got 3 points", 4):
            call(ONES, ONES[:3])
    with refused(ValueError, "gt: got 3 points", "at least"):
        metrics.emd(ONES, ONES[:3])
    with refused(ValueError, "emd_exact", "traced"):
        jax.jit(losses.emd_exact)(ONES, ONES)


@pytest.mark.usefixtures("unchecked_annotations")
def test_wrong_options():
    table = [
        ({name: value}, f"{name}: got")
        for name in ("tolerance", "max_bids")
        for value in (-5, np.int64(-5), np.nan, "x", None if name == "tolerance" else [1], True)
    ]
    table += [({"max_bids": value}, "max_bids: got") for value in (2.5, 2**31, np.inf)]
    all_refused(lambda options: losses.assign(ONES, ONES, **options), ValueError, table)
    assert losses.assign(ONES, ONES, max_bids=np.float32(8), tolerance=np.inf).converged
    for function in (losses.emd_mean, losses.emd_sum):
        with refused(TypeError, f"{function.__name__}()", "'tolerence'"):
            function(ONES, ONES, tolerence=0.1)
    counts = [(count, f"num_samples: got {count}") for count in (0, 5, 2.5, "2")]
    all_refused(lambda count: losses.farthest_point_indices(ONES, count), ValueError, counts)
    with refused(ValueError, "points: point 0 of 4"):
        losses.farthest_points(np.nan * ONES, 2)


@pytest.mark.usefixtures("unchecked_annotations")
def test_wrong_batches_and_volumes():
    mapped, best = losses.map_pairs(losses.chamfer_sq_mean), losses.min_of_n(losses.chamfer_sq)
    solid = np.ones((2, 2), bool)
    table = [
        ((mapped, jnp.zeros((2, 5, 3)), jnp.zeros((3, 5, 3))), "2, 3 pairs"),
        ((mapped, ONES, ONES[:3]), "[4, 3] and [3, 3]"),
        ((best, ONES, ONES), "preds: got shape (4, 3)", "[draws, n, 3]"),
        ((best, ONES[None][:0], ONES), "preds: got shape (0, 4, 3)"),
        ((losses.soft_iou, solid.astype(np.uint8), solid), "pred: got uint8"),
        ((losses.iou, solid.astype(np.uint8), solid), "pred: got uint8"),
        ((losses.iou, jnp.zeros(3), jnp.zeros(4)), "(3,)", "(4,)"),
        ((losses.iou, solid, solid.astype(np.int32)), "gt: got int32"),
        ((losses.iou, solid, solid.astype(np.float32)), "gt: got float32", "bool"),
    ]
    all_refused(lambda call: call[0](*call[1:]), ValueError, table)

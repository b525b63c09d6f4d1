import jax
import jax.numpy as jnp
import numpy as np
import pytest

from psgn_jax import losses

iou, soft_iou = jax.jit(losses.iou, static_argnames="threshold"), jax.jit(losses.soft_iou)


def test_iou_counts_cells_and_soft_equals_hard_on_bits(rng):
    pred, gt = rng.random((8, 8, 8)).astype(np.float32), rng.random((8, 8, 8)) < 0.4
    for threshold in (0.1, 0.5, 0.9):
        inside = pred >= threshold
        want = (inside & gt).sum() / (inside | gt).sum()
        np.testing.assert_allclose(iou(pred, gt, threshold), want, rtol=1e-6)
    sweep = losses.iou_sweep(pred, gt)
    assert sweep.shape == (19,)
    assert iou(np.full(3, 0.5, np.float32), np.ones(3, bool), 0.5) == 1  # 0.5 is inside
    np.testing.assert_allclose(sweep[9], iou(pred, gt), rtol=1e-6)
    pred, gt = rng.random((2, 500)) < 0.3
    soft = soft_iou(pred.astype(np.float32), gt.astype(np.float32))
    np.testing.assert_allclose(soft, iou(pred.astype(np.float32), gt), rtol=1e-6)
    assert losses.soft_iou_loss(jnp.ones(4), jnp.ones(4)) == 0


def test_empty_volumes_and_nan():
    nothing, all_ = np.zeros(5, np.float32), np.ones(5, np.float32)
    assert soft_iou(nothing, nothing) == 1
    assert iou(nothing, np.zeros(5, bool)) == 1
    assert soft_iou(all_, nothing) == 0
    assert iou(nothing, np.ones(5, bool)) == 0
    assert np.isfinite(jax.jit(jax.grad(losses.soft_iou))(nothing, nothing)).all()
    pred = np.array([0.2, np.nan], np.float32)
    assert np.isnan(iou(pred, np.zeros(2, bool)))
    assert np.isnan(soft_iou(pred, np.ones(2, np.float32)))


@pytest.mark.usefixtures("unchecked_annotations")
def test_bits_and_many_cells(rng):
    solid = rng.random((4, 4, 4)) > 0.3
    assert iou(solid, solid) == 1
    assert soft_iou(solid, solid) == 1
    many = np.ones((64, 64, 64), np.float16)  # their number exceeds the range of float16
    assert soft_iou(many, many) == 1

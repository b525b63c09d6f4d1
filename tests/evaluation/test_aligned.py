import jax
import numpy as np
import pytest

from psgn_jax.evaluation import aligned
from psgn_jax.losses.chamfer import chamfer_sq_mean

metrics = jax.jit(aligned.aligned_metrics)


def surface(rng, count):
    """An ellipsoid with three different axes and a bump, so that the best alignment is unique."""
    points = rng.normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points *= [0.8, 0.5, 0.3]
    points[points[:, 0] > 0.5] += [0.0, 0.0, 0.2]
    return points.astype(np.float32)


@pytest.mark.parametrize(("scale", "shift"), [(1.1, (0.1, -0.05, 0.06)), (0.88, (-0.1, 0.1, 0))])
def test_a_moved_copy_comes_back(rng, scale, shift):
    gt = surface(rng, 600)
    pred = ((surface(rng, 600) - np.float32(shift)) / np.float32(scale)).astype(np.float32)
    result = metrics(pred, gt)
    floor = float(chamfer_sq_mean(surface(rng, 600), gt))
    assert float(result["aligned_cd_sq_radius2"]) < 1.15 * floor
    assert float(result["aligned_scale"]) == pytest.approx(scale, abs=0.03)


def test_the_scale_has_bounds_nothing_gets_worse_and_nan_shows(rng):
    gt = surface(rng, 600)
    for factor, want in ((0.5, 1.25), (2.0, 0.8)):
        result = metrics(np.float32(factor) * gt, gt)
        assert float(result["aligned_scale"]) == pytest.approx(want)
    for _ in range(3):
        pred = rng.normal(size=(600, 3)).astype(np.float32)
        assert metrics(pred, gt)["aligned_cd_sq_radius2"] <= chamfer_sq_mean(pred, gt)
    same = metrics(gt, gt)
    assert float(same["aligned_cd_sq_radius2"]) == 0
    assert float(same["aligned_scale"]) == 1
    pred = gt.copy()
    pred[3, 1] = np.nan
    assert np.isnan(float(metrics(pred, gt)["aligned_cd_sq_radius2"]))


def test_emd_of_the_aligned_prediction(rng):
    gt = surface(rng, 120)
    pred = (gt * np.float32(1.1) + np.float32([0.05, 0, 0])).astype(np.float32)
    result = jax.jit(lambda p, g: aligned.aligned_metrics(p, g, emd_tolerance=0.05))(pred, gt)
    assert float(result["aligned_emd_radius"]) < 0.02

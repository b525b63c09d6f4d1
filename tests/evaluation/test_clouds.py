import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import reference
from helpers.refusals import all_refused

from psgn_jax.evaluation import clouds as metrics_lib

SCORES = ("fscore", "precision", "recall")
NAMES = ("cd_sq_gt_to_pred_{}_radius2", "cd_l1_gt_to_pred_{}_radius", "recall_{}")


@pytest.fixture
def pair(rng):
    # Spacing near the threshold, so that the scores lie between 0 and 1.
    return tuple(rng.uniform(0, 0.1, (n, 3)).astype(np.float32) for n in (150, 210))


def test_metrics_equal_reference(pair):
    threshold = 0.02
    got = metrics_lib.evaluate_pair(*pair, threshold=threshold)
    assert 0 < metrics_lib.evaluate_pair(*pair)["fscore"] < got["fscore"] < 1
    want = {
        "cd_sq_radius2": reference.chamfer_sq_mean(*pair),
        "cd_sq_pred_to_gt_radius2": reference.chamfer_sq_pred_to_gt_mean(*pair),
        "cd_sq_gt_to_pred_radius2": reference.chamfer_sq_gt_to_pred_mean(*pair),
        "cd_l1_radius": reference.chamfer_l1_mean(*pair),
        **dict(zip(SCORES, reference.fscore(*pair, threshold), strict=True)),
    }
    for name, value in want.items():
        np.testing.assert_allclose(got[name], value, rtol=1e-5, err_msg=name)


@pytest.mark.usefixtures("unchecked_annotations")
def test_scores_of_equal_and_of_distant_clouds_and_wrong_thresholds(pair):
    def scores(pred, gt):
        got = metrics_lib.evaluate_pair(pred, gt)
        return tuple(got[name] for name in SCORES)

    cloud = pair[0]
    assert scores(cloud, cloud) == (1, 1, 1)
    assert scores(cloud, cloud + 5) == (0, 0, 0)
    gt = np.array([[0, 0, 0], [1, 0, 0]], np.float32)
    assert scores(gt[:1], gt)[1:] == (1, 0.5)
    wrong = [(threshold, "threshold: got") for threshold in (0, -1.0, float("nan"), float("inf"))]
    all_refused(lambda x: metrics_lib.evaluate_pair(*pair, threshold=x), ValueError, wrong)


def test_nan_is_never_a_score(pair):
    pred = pair[0].copy()
    pred[3] = np.nan
    visible = np.arange(len(pair[1])) < 50
    got = jax.jit(metrics_lib.evaluate_pair)(pred, pair[1], visible)
    for name in ("cd_sq_radius2", "cd_l1_radius", "precision", "fscore", *NAMES):
        assert jnp.isnan(got[name.format("hidden")]), name


@pytest.mark.parametrize("share", [0.3, 0, 1])
def test_visible_and_hidden_points_equal_reference(pair, rng, share):
    pred, gt = pair
    visible = rng.random(len(gt)) < share
    got = metrics_lib.evaluate_pair(pred, gt, visible, threshold=0.01)
    want = reference.by_visibility(pred, gt, visible, 0.01)
    for name in metrics_lib.VISIBILITY:
        values = [got[key.format(name)] for key in NAMES]
        np.testing.assert_allclose(values, want[name], rtol=1e-5)
    np.testing.assert_allclose(got["visible_share"], visible.mean(), rtol=1e-6)
    plain = metrics_lib.evaluate_pair(pred, gt, threshold=0.01)
    assert {k: got[k] for k in plain} == plain

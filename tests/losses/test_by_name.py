import jax
import jax.numpy as jnp
import numpy as np
from helpers.refusals import refused

from psgn_jax import losses
from psgn_jax.config.experiment import ConfigError, LossConfig
from psgn_jax.losses.by_name import chosen_points, configured_loss


def test_the_tolerance_reaches_the_loss_and_chosen_points_are_spread(rng):
    pred, gt = rng.normal(size=(2, 4, 3)).astype("f4")
    rough = configured_loss(LossConfig(name="emd_mean", emd_tolerance=1e3))(pred, gt)[0]
    assert rough == losses.emd_mean(pred, gt, tolerance=1e3) > losses.emd_mean(pred, gt)
    gt = jnp.arange(300.0).reshape(100, 3)
    chosen = np.asarray(chosen_points(gt, 50))
    assert len(np.unique(chosen[:, 0])) == 50
    assert 20 <= int((chosen[:, 0] < 150).sum()) <= 30
    np.testing.assert_array_equal(chosen_points(gt, 100), gt)


def test_a_sum_and_its_gradient_are_those_written_by_hand(rng):
    pred, gt = rng.normal(size=(4, 3)).astype("f4"), rng.normal(size=(20, 3)).astype("f4")

    def by_hand(pred, gt):
        return (
            losses.emd_mean(pred, chosen_points(gt, 4), tolerance=0.01)
            + 5 * losses.chamfer_sq_mean(pred, gt)
            + 0.5 * losses.chamfer_l1_mean(pred, chosen_points(gt, 12))
        )

    text = "emd_mean@4 + 5*chamfer_sq_mean + .5 * chamfer_l1_mean@12"
    loss = configured_loss(LossConfig(name=text))
    (value, terms), grad = jax.value_and_grad(loss, has_aux=True)(pred, gt)
    want, want_grad = jax.value_and_grad(by_hand)(pred, gt)
    np.testing.assert_allclose(value, want, rtol=1e-6)
    np.testing.assert_allclose(grad, want_grad, rtol=1e-5, atol=1e-7)
    assert set(terms) == {"chamfer_l1_mean", "chamfer_sq_mean", "emd_mean"}
    np.testing.assert_allclose(terms["chamfer_sq_mean"], losses.chamfer_sq_mean(pred, gt), 1e-6)
    alone = configured_loss(LossConfig(name="2e-1*chamfer_sq@12"))(pred, gt)[0]
    want = 0.2 * losses.chamfer_sq(pred, chosen_points(gt, 12))
    np.testing.assert_allclose(alone, want, rtol=1e-6)


def test_a_wrong_term_is_named():
    terms = {
        "hausdorff": ("'hausdorff'", "chamfer_sq"), "emd_mean + 5*chamfer": ("'5*chamfer'",),
        "emd_mean + ": ("''",), "emd_mean@0 + chamfer_sq": ("'emd_mean@0'",), "": (),
        "emd_mean@" + "9" * 5000: (), "x" * 5000: (), "emd_mean@4 + emd_mean@8": ("'emd_mean@8'",),
    }  # fmt: skip
    for text, names in terms.items():
        with refused(ConfigError, "loss.name=", *names) as caught:
            configured_loss(LossConfig(name=text))
        assert len(str(caught.value)) < 400

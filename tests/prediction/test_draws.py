import jax
import numpy as np
import pytest
from helpers import reference, standin
from helpers.obj_text import scene
from helpers.refusals import refused
from helpers.weights import random_params

from psgn_jax import tasks
from psgn_jax.config.experiment import ConfigError
from psgn_jax.evaluation.split import eval_batches
from psgn_jax.losses.chamfer import chamfer_sq_mean
from psgn_jax.models import networks
from psgn_jax.prediction import draws
from psgn_jax.prediction.predictor import Predictor
from psgn_jax.weights.run_folder import Trained

CONFIG = standin.config(data__image_size=(48, 64), model__random_size=3)
PHOTO, _ = scene(48, 64, (12, 36, 20, 48))


@pytest.fixture(scope="module")
def predictor():
    return Predictor(Trained(CONFIG, 7, random_params(CONFIG), {}, "runs/x"))


@pytest.fixture
def shuffled(rng):
    """Eight clouds of 40 far points, each moved a little, in different orders; and the moves."""
    base = np.stack(np.meshgrid(*[np.arange(4)] * 3), axis=-1).reshape(-1, 3)[:40] / 4
    moves = rng.normal(scale=0.02, size=(8, 40, 3)) * np.linspace(0, 1, 40)[:, None]
    orders = [rng.permutation(40) for _ in range(8)]
    clouds = np.stack([(base + move)[order] for move, order in zip(moves, orders, strict=True)])
    return clouds.astype(np.float32), base + moves, orders


@pytest.mark.parametrize("samples", [2, 3, 5])
def test_the_first_cloud_stays_then_come_those_that_differ_of_the_typical_half(rng, samples):
    clouds = rng.normal(size=(7, 30, 3)).astype(np.float32)
    d = np.array([[float(chamfer_sq_mean(a, b)) for b in clouds] for a in clouds])
    by_sum = [i for i in np.argsort(d.sum(axis=1)).tolist() if i]
    shown, left = [0], by_sum[: max(3, samples - 1)]
    while len(shown) < samples:
        shown.append(max(left, key=lambda i: d[i, shown].min()))
        left.remove(shown[-1])
    expected = shown + [i for i in by_sum if i not in shown]
    assert np.asarray(draws.ranked(clouds, samples)).tolist() == expected


def test_the_spread_is_that_of_matched_points(shuffled):
    clouds, places, orders = shuffled
    spread = np.asarray(draws.spread(clouds, 2))
    expected = np.linalg.norm(places[1:] - places[:1], axis=-1).mean(axis=0)
    np.testing.assert_allclose(spread[0], expected[orders[0]], atol=1e-6)
    np.testing.assert_allclose(spread[1], expected[orders[1]], atol=1e-6)


def test_the_first_cloud_and_its_spread_do_not_depend_on_how_many_are_asked_for(predictor):
    one, three = (predictor(PHOTO, samples=k) for k in (1, 3))
    np.testing.assert_array_equal(one.points[0], three.points[0])
    np.testing.assert_array_equal(predictor(PHOTO, samples=3).points, three.points)
    assert one.spread.shape == (one.points.shape[1],)
    # The 16 draws are the same ones in another order.
    np.testing.assert_allclose(one.spread, three.spread, rtol=1e-4)
    network = np.asarray(draws.spread(one.draws))[0]
    np.testing.assert_allclose(one.spread * one.scale, network, rtol=1e-5)
    assert three.arrays()["spread"].shape == three.points.shape[:2]


def test_the_first_cloud_is_that_of_zero_or_the_mean_of_the_draws(predictor):
    plain = {"refine": False, "normal_form": "no", "frame": "keep"}
    zero, mean = (predictor(PHOTO, first=first, **plain) for first in draws.FIRST)
    batch = {"image": zero.view.image[None], "mask": zero.view.mask[None]}
    network = networks.build(CONFIG.model), random_params(CONFIG), batch
    expected = networks.predict(CONFIG, *network, np.zeros((1, 3), np.float32))
    np.testing.assert_allclose(zero.points, expected, atol=1e-5)
    np.testing.assert_allclose(mean.points[0], zero.draws[1:].mean(axis=0), atol=1e-5)


def test_a_draw_depends_on_seed_sample_and_number_alone():
    config = standin.config()
    whole = np.asarray(draws.sample_latents(config, 0, 50, 40, 1))
    np.testing.assert_array_equal(draws.sample_latents(config, 4, 2, 3, 1), whole[4:6, :3])
    assert len(np.unique(whole)) > 0.99 * whole.size
    assert abs(whole.std() - 1) < 0.05


@pytest.mark.slow
def test_evaluation_with_draws():
    config = standin.config(**standin.TINY, model__fc_points=16, eval__emd_tolerance=0.05)
    model, params = networks.build(config.model), random_params(config)
    result = tasks.create(config).evaluate(params, draws=3)
    best, mean = (result.metrics[f"cd_sq_radius2_{what}_of_3"] for what in ("best", "mean"))
    assert (best < mean).all()
    assert (result.metrics["emd_radius_best_of_3"] < result.metrics["emd_radius_mean_of_3"]).all()
    _, second, *_ = eval_batches(config)
    r = draws.sample_latents(config, 4, 4, 3, config.seed)
    drawn = np.asarray(jax.jit(lambda r: networks.predict(config, model, params, second, r))(r))
    assert np.abs(drawn[:, 0] - drawn[:, 1]).max() > 1e-3
    want = reference.cross_chamfer(drawn[1], second["points"][1:2])
    np.testing.assert_allclose([best[5], mean[5]], [want.min(), want.mean()], rtol=1e-4)
    tmd = reference.total_mutual_difference(drawn[1])
    np.testing.assert_allclose(result.metrics["total_mutual_difference_radius2"][5], tmd, rtol=1e-3)
    plain = tasks.create(standin.config(model__random_size=0))
    with refused(ConfigError, "draws=3", "model.random_size=0"):
        plain.evaluate({}, draws=3)


def test_distances_and_differences_of_sets(rng):
    drawn = rng.normal(size=(4, 12, 3)).astype(np.float32)
    truths = rng.normal(size=(3, 20, 3)).astype(np.float32)
    cross = jax.jit(lambda a, b: draws.cross_distances(a, b, chamfer_sq_mean))(drawn, truths)
    np.testing.assert_allclose(cross, reference.cross_chamfer(drawn, truths), rtol=1e-5)
    assert float(draws.coverage(cross)) == pytest.approx(reference.coverage(drawn, truths))
    found = jax.jit(draws.total_mutual_difference)(drawn)
    np.testing.assert_allclose(found, reference.total_mutual_difference(drawn), rtol=1e-5)

"""Draws outside training depend on seed and sample, not on the batch; their spread is measured."""

import jax
import numpy as np
import pytest
from helpers import reference, standin
from helpers.refusals import refused
from helpers.weights import random_params

from psgn_jax import tasks
from psgn_jax.config.experiment import ConfigError
from psgn_jax.evaluation.split import eval_batches
from psgn_jax.losses.chamfer import chamfer_sq_mean
from psgn_jax.models import networks
from psgn_jax.prediction import sampling


def network(**changes):
    tiny = {"model__name": "vanilla", "model__widths": (4, 6, 8), "model__fc_points": 16}
    config = standin.config(**tiny, **changes)
    return config, networks.build(config.model), random_params(config)


def test_a_draw_depends_on_seed_sample_and_number_alone():
    config, _, _ = network()
    whole = np.asarray(sampling.sample_latents(config, 0, 50, 40, 1))
    np.testing.assert_array_equal(sampling.sample_latents(config, 4, 2, 3, 1), whole[4:6, :3])
    assert len(np.unique(whole)) > 0.99 * whole.size
    assert abs(whole.std() - 1) < 0.05


@pytest.mark.slow
def test_evaluation_with_draws():
    config, model, params = network(eval__emd_tolerance=0.05)
    result = tasks.create(config).evaluate(params, draws=3)
    best, mean = (result.metrics[f"cd_sq_radius2_{what}_of_3"] for what in ("best", "mean"))
    assert (best < mean).all()
    assert (result.metrics["emd_radius_best_of_3"] < result.metrics["emd_radius_mean_of_3"]).all()
    _, second, *_ = eval_batches(config)
    r = sampling.sample_latents(config, 4, 4, 3, config.seed)
    drawn = np.asarray(jax.jit(lambda r: networks.predict(config, model, params, second, r))(r))
    assert np.abs(drawn[:, 0] - drawn[:, 1]).max() > 1e-3
    want = reference.cross_chamfer(drawn[1], second["points"][1:2])
    np.testing.assert_allclose([best[5], mean[5]], [want.min(), want.mean()], rtol=1e-4)
    tmd = reference.total_mutual_difference(drawn[1])
    difference = result.metrics["total_mutual_difference_radius2"]
    np.testing.assert_allclose(difference[5], tmd, rtol=1e-3)
    plain = tasks.create(standin.config(model__random_size=0))
    with refused(ConfigError, "draws=3", "model.random_size=0"):
        plain.evaluate({}, draws=3)


def test_distances_and_differences_of_sets(rng):
    draws = rng.normal(size=(4, 12, 3)).astype(np.float32)
    truths = rng.normal(size=(3, 20, 3)).astype(np.float32)
    cross = jax.jit(lambda a, b: sampling.cross_distances(a, b, chamfer_sq_mean))(draws, truths)
    np.testing.assert_allclose(cross, reference.cross_chamfer(draws, truths), rtol=1e-5)
    assert float(sampling.coverage(cross)) == pytest.approx(reference.coverage(draws, truths))
    found = jax.jit(sampling.total_mutual_difference)(draws)
    np.testing.assert_allclose(found, reference.total_mutual_difference(draws), rtol=1e-5)

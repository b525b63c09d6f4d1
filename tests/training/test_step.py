import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import standin
from helpers.commands import python
from helpers.standin import TINY, VAE
from helpers.weights import random_params

from psgn_jax import tasks
from psgn_jax.config.experiment import OptimConfig
from psgn_jax.data import loader
from psgn_jax.losses.by_name import chosen_points
from psgn_jax.losses.chamfer import chamfer_sq, chamfer_sq_mean
from psgn_jax.losses.mapping import map_pairs
from psgn_jax.losses.min_of_n import min_of_n
from psgn_jax.models import networks
from psgn_jax.tasks import points
from psgn_jax.training import step

pytestmark = pytest.mark.usefixtures("keep_compiled")


@functools.cache
def compiled(config, devices):
    """The function that creates the state, the training step (both compiled once), and the mesh."""
    mesh = step.data_mesh(list(devices) if devices else None)
    create, train_step = step.create_training(config, tasks.create(config), mesh)
    return jax.jit(create), train_step, mesh


def run(config, steps, devices=None):
    """Trains from scratch; returns the state and the metrics of every step, as numpy."""
    create, train_step, mesh = compiled(config, tuple(devices) if devices else None)
    current = step.put_replicated(jax.tree.map(np.asarray, create()), mesh)
    plan = {"batch_size": config.train.batch_size, "seed": config.seed, "start_step": 0}
    history = []
    for _, batch in zip(range(steps), loader.train_batches(config.data, **plan), strict=False):
        placed = step.put_batch(batch, mesh, networks.input_keys(config))
        current, metrics = train_step(current, placed)
        history.append({k: float(v) for k, v in metrics.items() if not v.ndim})
    return jax.tree.map(np.asarray, current), history


def test_random_input_depends_on_seed_step_and_purpose():
    def draw(step, train, **changes):
        return networks.random_input(standin.config(**changes), step, 4, train=train)

    drawn = draw(7, True), draw(8, True), draw(7, False), draw(7, True, seed=4)
    assert len({each.tobytes() for each in map(np.asarray, drawn)}) == 4
    np.testing.assert_array_equal(draw(7, True), drawn[0])
    assert draw(0, True, model__random_size=0) is None
    assert draw(0, True, loss__min_of_n=2).shape == (4, 2, 3)
    assert draw(0, False, loss__min_of_n=2).shape == (4, 3)


def test_training_on_a_sum_logs_its_terms():
    name = "chamfer_l1_mean@20 + 5*chamfer_sq_mean"
    config = standin.config(**TINY, loss__name=name, loss__min_of_n=2, loss__l2="none")
    final, history = run(config, 2)
    assert (final.step, len(history)) == (2, 2)
    assert step.eval_params(final) is final.ema
    for entry in history:
        total = entry["loss_chamfer_l1_mean"] + 5 * entry["loss_chamfer_sq_mean"]
        assert entry["loss"] == pytest.approx(total, rel=1e-5)
        assert entry["loss_of_draws"] >= entry["loss"]


@pytest.mark.parametrize(("winner_points", "mean_weight"), [(0, 0.0), (5, 0.0), (5, 2.0)])
def test_the_loss_of_the_best_draw_and_its_gradient(winner_points, mean_weight):
    loss = {"loss__name": "chamfer_sq", "loss__min_of_n": 3, "loss__winner_points": winner_points}
    config = standin.config(**TINY, **loss, loss__mean_weight=mean_weight)
    task = tasks.create(config)
    model, params = task.model, random_params(config)
    batch = next(loader.train_batches(config.data, batch_size=4, seed=0, start_step=0))
    batch = {key: batch[key] for key in networks.input_keys(config)}
    r = networks.random_input(config, 0, 4, train=True)

    def value_and_grad(loss, params):
        return jax.jit(jax.value_and_grad(loss, has_aux=True))(params)

    def chooses(pred, gt):
        few = [chosen_points(cloud, winner_points) for cloud in (pred, gt)]
        return chamfer_sq_mean(*few) if winner_points else chamfer_sq(pred, gt)

    def plain(params):
        preds = networks.predict(config, model, params, batch, r)
        best = map_pairs(min_of_n(chooses))(preds, batch["points"])
        pred = preds[jnp.arange(4), best.winner]
        loss = jnp.mean(map_pairs(chamfer_sq)(pred, batch["points"]))
        first = jnp.mean(map_pairs(chamfer_sq_mean)(preds[:, 0], batch["points"]))
        return loss + mean_weight * first, best

    (want, want_best), want_grads = value_and_grad(plain, params)
    (have, best), grads = value_and_grad(lambda p: task.min_of_n_loss(p, batch, r), params)
    np.testing.assert_allclose(have, want, rtol=1e-6)
    np.testing.assert_array_equal(best.winner, want_best.winner)
    np.testing.assert_allclose(best.distances, want_best.distances, rtol=1e-5)
    assert len(np.unique(best.winner)) > 1
    scale = max(float(np.abs(g).max()) for g in jax.tree.leaves(want_grads))
    for have, want in zip(*map(jax.tree.leaves, (grads, want_grads)), strict=True):
        np.testing.assert_allclose(have, want, rtol=1e-3, atol=1e-5 * scale)


@pytest.mark.slow
def test_training_with_a_posterior():
    config = standin.config(optim__learning_rate=3e-3, loss__l2="none", **VAE)
    final, history = run(config, 8)
    assert set(final.params["posterior"]) == {"conv0", "conv1", "conv2", "hidden", "gaussian"}
    assert set(final.ema) == set(final.params)
    weights = [h["kl_weight"] for h in history]
    np.testing.assert_allclose(weights, 1e-2 * np.array([0, 0.25, 0.5, 0.75, 1, 1, 1, 1]))
    assert history[-1]["loss"] < history[0]["loss"]
    assert all(h["kl"] > 0 for h in history)
    moved = jax.tree.map(np.array_equal, compiled(config, None)[0]().params, final.params)
    assert not any(jax.tree.leaves(moved))  # gradients reach the generator and the posterior


def test_l2_of_the_authors_and_schedules():
    conv = {"kernel": jnp.full((3, 3, 2, 2), 2.0), "bias": jnp.ones(2)}
    fc = {"dense": {"kernel": jnp.full((4, 5), 3.0)}, "carry": {"kernel": jnp.full((2, 2), 1.0)}}
    want = 1e-5 * 36 * 4 / 2 + 1e-3 * 20 * 9 / 2 + 1e-4 * 4 / 2
    np.testing.assert_allclose(points.l2_authors({"conv": conv, "fc": fc}), want, rtol=1e-6)
    _, constant = step.optimizer(OptimConfig(learning_rate=2.0, warmup_steps=4), 100)
    assert [float(constant(s)) for s in (0, 2, 4, 99)] == [0, 1, 2, 2]
    falling = {"schedule": "cosine", "warmup_steps": 10, "final_fraction": 0.1}
    _, cosine = step.optimizer(OptimConfig(learning_rate=2.0, **falling), 110)
    np.testing.assert_allclose([cosine(5), cosine(10), cosine(60), cosine(110)], [1, 2, 1.1, 0.2])


EIGHT_DEVICES = """
import jax, numpy as np, pytest, runpy, sys
sys.path.insert(0, "tests")
from helpers import standin
from psgn_jax import tasks
from psgn_jax.config.experiment import ConfigError
from psgn_jax.training.loop import train
jax.config.update("jax_num_cpu_devices", 8)
here = runpy.run_path("tests/training/test_step.py")
assert len(jax.devices()) == 8
for kind in (standin.TINY | {"loss__min_of_n": 2}, standin.VAE):
    config = standin.config(**kind, optim__eps=1e-3)
    one, one_history = here["run"](config, 3, jax.devices()[:1])
    all_, all_history = here["run"](config, 3, jax.devices())
    for a, b, atol in (one_history, all_history, 1e-9), (one.params, all_.params, 1e-6):
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-5, atol=atol), a, b)
few = standin.config(**kind, train__batch_size=3, eval__batch_size=3)
assert len(tasks.create(few).evaluate(all_.params).names) == 11
with pytest.raises(ConfigError, match="train.batch_size=3: accepted: a multiple of the 8 devices"):
    train(few, sys.argv[1])
"""


@pytest.mark.slow
def test_eight_devices_give_the_same_numbers_as_one(tmp_path):
    """Training refuses a batch that they do not divide; an evaluation then uses one device."""
    flags = "--xla_backend_optimization_level=0"
    python(EIGHT_DEVICES, tmp_path / "refused", XLA_FLAGS=flags)
    assert not (tmp_path / "refused").exists()

"""Names lead to networks, losses and data; unknown ones list the choices."""

import jax.numpy as jnp
import pytest

from psgn_jax import registry
from psgn_jax.config import ConfigError, LossConfig, ModelConfig, parse


@pytest.mark.parametrize("name", list(registry.MODELS))
def test_every_model_can_be_built(name):
    model = registry.build_model(parse({"model": {"name": name}}).model)
    assert hasattr(model, "apply")


@pytest.mark.parametrize("name", list(registry.LOSSES))
def test_every_loss_is_a_number_of_one_pair(name):
    # A bijection wants equal sizes.
    others = 4 if name.startswith("emd") else 5
    value = registry.loss(LossConfig(name=name))(jnp.zeros((4, 3)), jnp.ones((others, 3)))
    assert value.shape == ()
    assert float(value) > 0


def test_options_reach_the_loss():
    config = LossConfig(name="emd_mean", emd_tolerance=0.25, emd_schedule="authors")
    assert registry.loss(config).keywords == {"tolerance": 0.25, "schedule": "authors"}


def test_data_source_has_the_three_functions():
    source = registry.data_source()
    assert all(hasattr(source, f) for f in ("train_batches", "eval_batches", "num_samples"))


def test_unknown_names_list_the_choices():
    with pytest.raises(ConfigError, match=r"did you mean 'two_branch'\? accepted: vanilla, two_b"):
        registry.build_model(ModelConfig(name="two_brunch"))
    with pytest.raises(ConfigError, match=r"loss.name='hausdorff' is unknown; accepted: chamf"):
        registry.loss(LossConfig(name="hausdorff"))


def test_entries_can_be_added(monkeypatch):
    monkeypatch.setitem(registry.MODELS, "own", lambda config: config.fc_points)
    assert registry.build_model(ModelConfig(name="own", fc_points=7)) == 7

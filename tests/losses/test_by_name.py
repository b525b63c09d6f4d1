"""Names lead to losses; an unknown one lists the choices."""

import jax.numpy as jnp
import pytest

from psgn_jax.config import ConfigError, LossConfig
from psgn_jax.losses.by_name import LOSSES, configured_loss


@pytest.mark.parametrize("name", list(LOSSES))
def test_every_loss_is_a_number_of_one_pair(name):
    # A bijection wants equal sizes.
    others = 4 if name.startswith("emd") else 5
    value = configured_loss(LossConfig(name=name))(jnp.zeros((4, 3)), jnp.ones((others, 3)))
    assert value.shape == ()
    assert float(value) > 0


def test_options_reach_the_loss():
    config = LossConfig(name="emd_mean", emd_tolerance=0.25, emd_schedule="authors")
    assert configured_loss(config).keywords == {"tolerance": 0.25, "schedule": "authors"}


def test_an_unknown_name_lists_the_choices():
    with pytest.raises(ConfigError, match=r"loss.name='hausdorff' is unknown; accepted: chamf"):
        configured_loss(LossConfig(name="hausdorff"))

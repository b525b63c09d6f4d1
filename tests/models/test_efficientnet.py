import jax
import jax.numpy as jnp
import numpy as np
import pytest

from psgn_jax.config.experiment import OptimConfig
from psgn_jax.models import efficientnet
from psgn_jax.models.cpu_convolution import plain_convolutions
from psgn_jax.training.from_config import optimizer

BLOCKS = len(efficientnet.BLOCKS)


def random_like(shapes, seed=0):
    rng = np.random.default_rng(seed)
    return jax.tree.map(lambda s: rng.normal(0, 0.1, s.shape).astype("f4"), shapes)


@pytest.fixture(scope="module")
def shapes():
    """Of the maps and the parameters."""
    network, image = efficientnet.EfficientNetLite0(), jnp.zeros((2, 192, 256, 3))
    return jax.eval_shape(lambda: network.init_with_output(jax.random.key(0), image))


def test_maps_and_parameters_of_the_published_network(shapes):
    maps, variables = shapes
    assert [m.shape[1:] for m in maps] == [
        (96, 128, 16), (48, 64, 24), (24, 32, 40), (12, 16, 112), (6, 8, 320)
    ]  # fmt: skip
    # 4,652,008 in the paper's table, less the head (413,440 and 1,281,000), less one of two
    # numbers of each normalised channel (18,448).
    leaves = jax.tree.leaves(variables)
    assert sum(leaf.size for leaf in leaves) == 4_652_008 - 413_440 - 1_281_000 - 18_448


def test_only_the_last_blocks_get_gradients(shapes, rng):
    x = rng.random((1, 32, 32, 3), np.float32)
    params = random_like(shapes[1]["params"])

    def total(params, trained):
        maps = efficientnet.EfficientNetLite0(trained).apply({"params": params}, x)
        return sum(map(jnp.sum, maps))

    for trained in (0, 2):
        with plain_convolutions():  # compiles faster
            gradients = jax.jit(jax.grad(total), static_argnums=1)(params, trained)
        changed = {n for n, tree in gradients.items() if any(map(np.any, jax.tree.leaves(tree)))}
        assert changed == {f"block{i}" for i in range(BLOCKS - trained, BLOCKS)}


def test_the_encoder_may_have_a_lower_rate():
    params = {"encoder": {efficientnet.NAME: jnp.ones(3), "bottleneck": jnp.ones(3)}}
    steps = {}
    for factor in (1.0, 0.1):
        rule = optimizer(OptimConfig(encoder_rate=factor), 10)
        steps[factor] = rule.update(params, rule.init(params), params)[0]["encoder"]
    full, reduced = steps[1.0], steps[0.1]
    np.testing.assert_array_equal(reduced["bottleneck"], full["bottleneck"])
    np.testing.assert_allclose(reduced[efficientnet.NAME], 0.1 * full[efficientnet.NAME])

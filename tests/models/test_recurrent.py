import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from psgn_jax.config.experiment import ModelConfig, VoxelConfig
from psgn_jax.models import networks, recurrent
from psgn_jax.models.recurrent import occupancy, unpool, voxel_cross_entropy


@pytest.mark.parametrize("size", [127, 128])
def test_sizes_of_the_published_network(size):
    network = networks.build_r2n2(ModelConfig(), VoxelConfig())
    views = jnp.zeros((3, 2, size, size, 3))
    out, variables = jax.eval_shape(network.init_with_output, jax.random.key(0), views)
    assert out.shape == (3, 32, 32, 32, 2)
    encoder = variables["params"]["encoder"]
    # After six poolings, 127 and 128 pixels become 3x3 cells with 256 channels.
    assert encoder["dense"]["kernel"].shape == (3 * 3 * 256, 1024)
    assert {n for n in encoder if "shortcut" in n} == {f"level{i}_shortcut" for i in (2, 3, 5)}
    assert sum(leaf.size for leaf in jax.tree.leaves(variables)) == 35_968_706


def test_unpooling_and_cross_entropy(rng):
    x = rng.normal(size=(2, 2, 2, 2, 3)).astype(np.float32)
    got = np.asarray(unpool(x))
    np.testing.assert_array_equal(got[:, ::2, ::2, ::2], x)
    assert np.count_nonzero(got) == np.count_nonzero(x)
    logits = 5 * rng.normal(size=(4, 4, 4, 2)).astype(np.float32)
    gt = rng.random((4, 4, 4)) < 0.3
    want = optax.softmax_cross_entropy_with_integer_labels(logits, gt.astype(int)).mean()
    np.testing.assert_allclose(voxel_cross_entropy(logits, gt), want, rtol=1e-5)
    np.testing.assert_allclose(occupancy(logits), jax.nn.softmax(logits)[..., 1], rtol=1e-5)
    far = jnp.full((1, 1, 1, 2), jnp.array([0.0, 200.0]))
    assert jnp.isfinite(voxel_cross_entropy(far, jnp.zeros((1, 1, 1), bool)))


def test_cell_against_the_equations(rng):
    """Compares one step with the equations in NumPy; the kernels ignore neighbouring cells."""
    cell = recurrent.VolumeCell(jnp.float32)
    x = rng.normal(size=(1, 6)).astype(np.float32)
    hidden = rng.normal(size=(1, 4, 4, 4, 5)).astype(np.float32)
    params = jax.jit(cell.init)(jax.random.key(0), x, hidden)
    centre = np.zeros((3, 3, 3, 1, 1), np.float32)
    centre[1, 1, 1] = 1
    for gate in params["params"].values():
        gate["grid"]["kernel"] = gate["grid"]["kernel"] * centre
    got = jax.jit(cell.apply)(params, x, hidden)

    def gate(name, h):
        p = jax.tree.map(np.asarray, params["params"][name])
        seen = (x[0] @ p["view"]["kernel"]).reshape(4, 4, 4, 5)
        return seen + h[0] @ p["grid"]["kernel"][1, 1, 1] + p["grid"]["bias"]

    def sigmoid(v):
        return 1 / (1 + np.exp(-v))

    u, r = sigmoid(gate("update", hidden)), sigmoid(gate("reset", hidden))
    new = np.tanh(gate("candidate", r[None] * hidden))
    np.testing.assert_allclose(got[0], u * hidden[0] + (1 - u) * new, rtol=1e-4, atol=1e-5)

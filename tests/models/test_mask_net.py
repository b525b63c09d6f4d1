"""The mask network: shapes, and the same result as an ONNX file."""

import jax
import numpy as np
import pytest

from psgn_jax.models.mask_net import MaskNet


@pytest.fixture(scope="module")
def params():
    """Drawn by NumPy, because compiling the initialisation of the network takes long."""
    image = np.zeros((1, 32, 32, 3), np.float32)
    shapes = jax.eval_shape(MaskNet().init, jax.random.key(0), image)["params"]
    rng = np.random.default_rng(0)

    def draw(leaf):
        scale = 0.05 if len(leaf.shape) == 1 else np.sqrt(2 / np.prod(leaf.shape[:-1]))
        return (scale * rng.standard_normal(leaf.shape)).astype(np.float32)

    return jax.tree.map(draw, shapes)


def test_the_onnx_file_gives_the_same_probabilities(params, rng):
    pytest.importorskip("onnxruntime")
    onnx_file = pytest.importorskip("psgn_jax.portable.onnx_file")
    from psgn_jax.portable.folder import session

    image = rng.integers(0, 256, (1, 96, 96, 3), dtype=np.uint8)
    stored = jax.tree.map(lambda x: x.astype(np.float16).astype(np.float32), params)
    run = jax.jit(lambda x: MaskNet().apply({"params": stored}, x / np.float32(255)))
    expected = np.asarray(run(image))
    assert expected.shape == (1, 48, 48)
    assert ((expected > 0) & (expected < 1)).all()
    found = session(onnx_file.mask_network_to_onnx(params, 96))({"image": image})
    np.testing.assert_allclose(found, expected, atol=1e-3)

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
    from psgn_jax.portable.network import InputSpec

    image = rng.integers(0, 256, (1, 96, 96, 3), dtype=np.uint8)
    stored = jax.tree.map(lambda x: x.astype(np.float16).astype(np.float32), params)

    def run(x, params=params):
        return MaskNet().apply({"params": params}, x / np.float32(255))

    expected = np.asarray(jax.jit(run)(image, stored))
    assert expected.shape == (1, 48, 48)
    assert ((expected > 0) & (expected < 1)).all()
    inputs = [InputSpec("image", "uint8", image.shape)]
    content = onnx_file.to_onnx(run, inputs, "probabilities", "float16", {})
    np.testing.assert_allclose(session(content)({"image": image}), expected, atol=1e-3)

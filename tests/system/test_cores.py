"""The number of cores and the compiler's options follow the machine."""

import jax
import jax.numpy as jnp
import numpy as np

from psgn_jax.system import cores


def test_xla_knows_the_option(monkeypatch, rng):
    monkeypatch.setattr(cores, "features_line", lambda: "flags : avx512_bf16")
    x = rng.normal(size=100).astype(np.float32)
    total = jax.jit(jnp.sum, compiler_options=cores.compiler_options())(x)
    np.testing.assert_allclose(total, x.sum(), rtol=1e-5)

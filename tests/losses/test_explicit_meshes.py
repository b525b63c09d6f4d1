"""Losses of batches on a mesh from `jax.make_mesh`, whose axes are explicit."""

import pathlib
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).resolve().parents[2]
CODE = """
import jax, numpy as np
from psgn_jax import losses
mesh = jax.make_mesh((DEVICES,), ("d",))
a, b = np.random.default_rng(0).normal(size=(2, 4, 20, 3)).astype(np.float32)
wanted = {f: np.array([f(*pair) for pair in zip(a, b)]) for f in
          (losses.chamfer_sq_mean, losses.emd_mean)}
gradients = {f: np.array([jax.grad(f)(*pair) for pair in zip(a, b)]) for f in wanted}
jax.set_mesh(mesh)
a, b = (jax.device_put(x, jax.NamedSharding(mesh, jax.P("d"))) for x in (a, b))
for f in wanted:
    for batched in (jax.vmap(f), losses.map_pairs(f)):
        np.testing.assert_allclose(jax.jit(batched)(a, b), wanted[f], rtol=1e-5)
        found = jax.jit(jax.grad(lambda x: batched(x, b).sum()))(a)
        np.testing.assert_allclose(found, gradients[f], rtol=1e-4, atol=1e-6)
    np.testing.assert_allclose(jax.vmap(f)(a, b), wanted[f], rtol=1e-5)  # without jit
    found = jax.grad(lambda x: jax.vmap(f)(x, b).sum())(a)
    np.testing.assert_allclose(found, gradients[f], rtol=1e-4, atol=1e-6)
"""


@pytest.mark.slow
@pytest.mark.parametrize("devices", [1, 2])
def test_values_and_gradients(devices):
    flags = (f"--xla_force_host_platform_device_count={devices}",
             "--xla_backend_optimization_level=0")  # fmt: skip
    environment = {"JAX_PLATFORMS": "cpu", "PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin"}
    done = subprocess.run(
        [sys.executable, "-c", CODE.replace("DEVICES", str(devices))], capture_output=True,
        text=True, timeout=600, env=environment | {"XLA_FLAGS": " ".join(flags)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-3000:]

"""oneDNN is called from several threads and while the interpreter ends; the rest is in
`test_cpu_convolution`."""

import concurrent.futures
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from psgn_jax.models import cpu_convolution, onednn

pytestmark = pytest.mark.skipif(onednn.library() is None, reason="oneDNN is not installed")


def test_no_routine_for_other_dtypes_and_geometries(rng):
    x = jnp.asarray(rng.normal(size=(2, 4, 4, 3)), jnp.float32)
    kernel = jnp.asarray(rng.normal(size=(3, 3, 3, 5)), jnp.float32)
    fits = onednn.Convolution(x.shape, kernel.shape, (2, 4, 4, 5), 1, ((1, 1), (1, 1)), "float32")
    assert onednn.forward(x, kernel, fits) is not None
    for other in (
        fits._replace(dtype="float64"),
        fits._replace(padding=((-1, 3), (1, 1))),
        fits._replace(y=(2, 3, 4, 5)),
    ):
        assert onednn.forward(x, kernel, other) is None


def test_threads(rng):
    x = jnp.asarray(rng.normal(size=(4, 24, 32, 8)), jnp.float32)
    kernel = jnp.asarray(rng.normal(size=(3, 3, 8, 8)), jnp.float32)

    @jax.jit
    def gradient(x):
        return jax.grad(lambda k: jnp.sum(jnp.sin(cpu_convolution.conv2d(x, k))))(kernel)

    expected = [np.asarray(gradient(x + i)) for i in range(8)]
    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda i: np.asarray(gradient(x + i)), range(8)))
    np.testing.assert_array_equal(found, expected)


ENDING = """
import jax, jax.numpy as jnp
from psgn_jax.models import cpu_convolution
x, kernel = jnp.ones((8, 96, 128, 8)), jnp.ones((3, 3, 8, 8))
@jax.jit
def many(x):
    for _ in range(30):
        x = cpu_convolution.conv2d(x, kernel)
    return x
many(x).block_until_ready()
many(x)  # still runs when the interpreter ends
"""


def test_interpreter_ends_during_a_call():
    done = subprocess.run(
        [sys.executable, "-c", ENDING], capture_output=True, text=True, timeout=120
    )
    assert (done.returncode, done.stderr) == (0, "")

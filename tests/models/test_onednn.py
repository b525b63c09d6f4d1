"""Tests of oneDNN with several threads, with odd arguments, and when the interpreter ends.

`test_cpu_convolution` tests the results.
"""

import concurrent.futures
import subprocess
import sys
import threading

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


def test_arguments_of_two_dtypes(rng):
    x = jnp.asarray(rng.normal(size=(2, 4, 4, 3)), jnp.float32)
    kernel = jnp.ones((3, 3, 3, 5), jnp.bfloat16)
    fits = onednn.Convolution(x.shape, kernel.shape, (2, 4, 4, 5), 1, ((1, 1), (1, 1)), "float32")
    assert onednn.forward(x, kernel, fits) is None


def test_eager_calls_compile_once(rng, caplog):
    x = jnp.asarray(rng.normal(size=(2, 5, 7, 3)), jnp.float32)
    kernel = jnp.asarray(rng.normal(size=(3, 3, 3, 6)), jnp.float32)
    cpu_convolution.conv2d(x, kernel)
    with jax.log_compiles(), caplog.at_level("DEBUG"):
        cpu_convolution.conv2d(x, kernel)
    assert not [r for r in caplog.records if "Finished XLA compilation" in r.getMessage()]


def test_an_error_of_the_library_reaches_the_caller(rng, monkeypatch):
    def fails(*_):
        raise onednn.OneDNNError("dnnl_primitive_execute", 1)

    x = jnp.asarray(rng.normal(size=(2, 6, 7, 3)), jnp.float32)
    kernel = jnp.asarray(rng.normal(size=(3, 3, 3, 6)), jnp.float32)
    monkeypatch.setattr(onednn._Primitive, "run", fails)
    with pytest.raises(Exception, match="dnnl_primitive_execute returned status 1"):
        cpu_convolution.conv2d(x, kernel).block_until_ready()


@pytest.mark.parametrize("name", ["/nowhere/libdnnl.so.3", "libc.so.6"])
def test_why_there_is_no_library(name, monkeypatch):
    monkeypatch.setattr(onednn, "_installed", lambda: iter([name]))
    monkeypatch.setattr(onednn, "_FILE", "libno_such_library.so.3")
    monkeypatch.setattr(onednn, "_load", onednn._load.__wrapped__)
    assert onednn.library() is None
    assert name.rsplit("/", 1)[-1] in onednn.why_not() or "dnnl_version" in onednn.why_not()


def test_threads_that_make_the_same_primitive(rng):
    x = jnp.asarray(rng.normal(size=(4, 9, 11, 8)), jnp.float32)
    kernel = jnp.asarray(rng.normal(size=(3, 3, 8, 8)), jnp.float32)
    barrier = threading.Barrier(8)

    def trace(_):
        barrier.wait()
        return np.asarray(jax.jit(lambda x: cpu_convolution.conv2d(x, kernel))(x))

    onednn._primitive.cache_clear()
    onednn._engine.cache_clear()
    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        found = list(pool.map(trace, range(8)))
    np.testing.assert_array_equal(found, [found[0]] * 8)


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

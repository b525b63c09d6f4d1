"""Convolutions by oneDNN and by blocks have the values and gradients of XLA in float64.

Those of XLA are compared with NumPy.
"""

import concurrent.futures
import functools
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers.commands import python
from helpers.refusals import refused

from psgn_jax.models import cpu_convolution, onednn
from psgn_jax.models.layers import convolve, convolve_transposed
from psgn_jax.system.errors import UserError

NEEDS_ONEDNN = pytest.mark.skipif(onednn.library()[0] is None, reason="oneDNN is not installed")


def make(size, c_in, c_out, taps, stride, transposed, seed=0, batch=2):
    rng = np.random.default_rng(seed)
    out = [stride * n if transposed else -(-n // stride) for n in size]
    shapes = (batch, *size, c_in), (*(taps,) * len(size), c_in, c_out), (batch, *out, c_out)
    return [rng.standard_normal(shape, np.float32) for shape in shapes]


def run(x, kernel, dy, stride, transposed):
    """The output and the gradients of both arguments."""
    function = convolve_transposed if transposed else convolve

    def all_three(x, kernel, dy):
        y, vjp = jax.vjp(lambda x, kernel: function(x, kernel, stride), x, kernel)
        return y, *vjp(dy)

    return jax.jit(all_three)(x, kernel, dy)


def reference(*arrays_and_case):
    *arrays, stride, transposed = arrays_and_case
    with jax.enable_x64(True), cpu_convolution.convolutions_for("export"):
        return jax.device_get(run(*(np.float64(a) for a in arrays), stride, transposed))


def by_numpy(x, kernel, stride, transposed=False):
    """The output as a sum over the taps of the kernel, with the SAME padding of TensorFlow."""
    size, taps = np.array(x.shape[1:-1]), np.array(kernel.shape[:-2])
    if transposed:  # zeros between the cells, then a convolution with stride 1
        before = np.where(stride > taps - 1, taps - 1, (taps + stride - 1) // 2)
        out, ends = stride * size, before + stride * (size - 1) + 1
        cells = [slice(a, b, stride) for a, b in zip(before, ends, strict=True)]
        padded, stride = np.zeros((len(x), *out + taps - 1, x.shape[-1])), 1
        padded[:, *cells] = x
    else:
        out = -(-size // stride)
        total = np.maximum((out - 1) * stride + taps - size, 0)
        before = total // 2
        padded = np.pad(x, [(0, 0), *zip(before, total - before, strict=True), (0, 0)])
    y = 0.0
    for tap in np.ndindex(*taps):
        ends = tap + (out - 1) * stride + 1
        y = y + padded[:, *map(slice, tap, ends, [stride] * len(out))] @ kernel[tap]
    return y


def assert_close(ours, expected, relative=3e-6):
    """Small errors relative to the largest number: the rounding depends on the largest terms."""
    for name, a, b in zip(("output", "dx", "dkernel"), ours, expected, strict=True):
        assert a.shape == b.shape, name
        error = np.abs(np.asarray(a, np.float64) - b).max() / np.abs(b).max()
        assert error < relative, (name, error)


CASES = {
    # size, input channels, output channels, kernel size, stride, transposed
    "narrow output": ((6, 8), 64, 3, 3, 1, False),
    "strided": ((8, 12), 16, 32, 3, 2, False),
    "strided, kernel of 5, odd size": ((5, 7), 24, 16, 5, 2, False),
    "strided by 3, kernel of 4": ((7, 10), 8, 8, 4, 3, False),
    "strided, one pixel": ((1, 1), 8, 8, 3, 2, False),
    "kernel smaller than the stride": ((7, 8), 8, 8, 1, 2, False),
    "transposed": ((3, 4), 64, 32, 5, 2, True),
    "transposed, kernel of 2": ((3, 3), 8, 16, 2, 2, True),
    "transposed, kernel smaller than the stride": ((3, 4), 8, 16, 2, 3, True),
    "volume": ((5, 6, 7), 3, 4, 3, 1, False),
    "volume, strided": ((8, 7, 10), 3, 4, 5, 2, False),
}


@functools.cache
def expected(name):
    """A case, its arrays, and the output and gradients of XLA."""
    arrays = make(*CASES[name])
    return CASES[name], arrays, reference(*arrays, *CASES[name][-2:])


@pytest.mark.parametrize("name", CASES)
def test_xla_is_numpys_sum_over_the_taps(name):
    """The gradients are compared along one random direction."""
    case, (x, kernel, dy), (y, dx, dkernel) = expected(name)
    moved, changed, _ = make(*case, seed=1)
    np.testing.assert_allclose(y, by_numpy(x, kernel, *case[-2:]), rtol=1e-5, atol=1e-5)
    slopes = np.vdot(dx, moved), np.vdot(dkernel, changed)
    along = by_numpy(moved, kernel, *case[-2:]), by_numpy(x, changed, *case[-2:])
    np.testing.assert_allclose(slopes, [np.vdot(dy, change) for change in along], rtol=1e-4)


@NEEDS_ONEDNN
@pytest.mark.parametrize("name", CASES)
def test_onednn_is_xla(name):
    case, arrays, wanted = expected(name)
    assert_close(run(*arrays, *case[-2:]), wanted)


@pytest.mark.parametrize("name", CASES)
def test_blocks_are_xlas_without_dilation(name, monkeypatch):
    case, arrays, wanted = expected(name)
    monkeypatch.setenv("PSGN_CONVOLUTIONS", "xla")
    with jax.enable_x64(True):
        wide = [np.float64(a) for a in arrays]
        assert_close(run(*wide, *case[-2:]), wanted, relative=1e-13)
        program = str(jax.make_jaxpr(run, static_argnums=(3, 4))(*wide, *case[-2:]))
    dilations = re.findall(r"[lr]hs_dilation=(\(.*?\))", program)
    assert set(dilations) == {"(1, 1)"}


@NEEDS_ONEDNN
def test_gradient_of_a_gradient():
    case = CASES["strided"]
    *arrays, dy = make(*case)

    def of_gradients(x, kernel):
        return sum(jnp.sum(jnp.sin(g)) for g in run(x, kernel, dy, *case[-2:])[1:])

    found = [jax.grad(of_gradients, (0, 1))(*arrays)]
    with cpu_convolution.convolutions_for("export"):
        found.append(jax.grad(of_gradients, (0, 1))(*arrays))
    for ours, expected in zip(*found, strict=True):
        assert np.abs(ours - expected).max() < 1e-4 * np.abs(expected).max()


@NEEDS_ONEDNN
def test_bfloat16():
    case = CASES["strided"]
    arrays = [jnp.asarray(a, jnp.bfloat16) for a in make(*case)]
    ours = run(*arrays, *case[-2:])
    assert all(a.dtype == jnp.bfloat16 for a in ours)
    assert_close(ours, reference(*arrays, *case[-2:]), relative=0.02)


def calls_onednn(function, *arguments):
    return "buffer_callback" in str(jax.make_jaxpr(function)(*arguments))


@NEEDS_ONEDNN
def test_where_onednn_is_used(monkeypatch):
    x, kernel, _ = make(*CASES["strided"])
    assert calls_onednn(lambda x: convolve(x, kernel), x)
    mesh = jax.sharding.Mesh(np.array(jax.devices()[:1]), ("data",))
    P = jax.sharding.PartitionSpec
    mapped = jax.shard_map(convolve, mesh=mesh, in_specs=(P("data"), P()), out_specs=P("data"))
    assert calls_onednn(mapped, x, kernel)
    for purpose in ("export", "storing"):
        with cpu_convolution.convolutions_for(purpose):
            assert not calls_onednn(lambda x: convolve(x, kernel), x)
    monkeypatch.setenv("PSGN_CONVOLUTIONS", "xla")
    assert not calls_onednn(lambda x: convolve(x, kernel), x)
    monkeypatch.delenv("PSGN_CONVOLUTIONS")
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    assert not calls_onednn(lambda x: convolve(x, kernel), x)


def test_wrong_environment(monkeypatch):
    monkeypatch.setattr(onednn, "library", lambda: (None, "the package is not installed"))
    x, kernel, _ = make(*CASES["strided"])
    assert not calls_onednn(lambda x: convolve(x, kernel), x)
    for value, name in (("jax", "onednn, xla"), ("onednn", "the package is not installed")):
        monkeypatch.setenv("PSGN_CONVOLUTIONS", value)
        with refused(UserError, f"PSGN_CONVOLUTIONS={value}", name):
            convolve(x, kernel)


@NEEDS_ONEDNN
def test_threads():
    x, kernel, _ = make((24, 32), 8, 8, 3, 1, False)

    @jax.jit
    def gradient(x):
        return jax.grad(lambda k: jnp.sum(jnp.sin(convolve(x, k))))(kernel)

    expected = [np.asarray(gradient(x + i)) for i in range(8)]
    with concurrent.futures.ThreadPoolExecutor(8) as pool:
        found = list(pool.map(lambda i: np.asarray(gradient(x + i)), range(8)))
    np.testing.assert_array_equal(found, expected)


DEVICES = """
import jax, jax.numpy as jnp, numpy as np
from jax.sharding import PartitionSpec as P
from psgn_jax.models import onednn
from psgn_jax.models.layers import convolve
jax.config.update("jax_num_cpu_devices", 2)
x = np.random.default_rng(0).normal(size=(4, 24, 32, 8)).astype("f")
kernel = np.random.default_rng(1).normal(size=(3, 3, 8, 8)).astype("f")
def loss(kernel, x):
    return jnp.sum(jnp.sin(convolve(x, kernel)))
def gradient(kernel, x):
    return jax.lax.psum(jax.grad(loss)(kernel, x), "data")
mesh = jax.sharding.Mesh(np.array(jax.devices()), ("data",))
specs = {"mesh": mesh, "in_specs": (P(), P("data")), "out_specs": P()}
step = jax.jit(jax.shard_map(gradient, check_vma=False, **specs))
found = np.asarray(step(kernel, x))
plain = jax.jit(jax.grad(loss))
assert "buffer_callback" not in str(jax.make_jaxpr(plain)(kernel, x))
np.testing.assert_allclose(found, plain(kernel, x), rtol=1e-4, atol=1e-4)
for _ in range(100):
    np.testing.assert_array_equal(step(kernel, x), found)
assert onednn._primitive.cache_info().currsize <= 20  # two a thread of XLA
"""
ENDING = """
import jax, jax.numpy as jnp
from psgn_jax.models.layers import convolve
x, kernel = jnp.ones((8, 96, 128, 8)), jnp.ones((3, 3, 8, 8))
@jax.jit
def many(x):
    for _ in range(30):
        x = convolve(x, kernel)
    return x
many(x).block_until_ready()
many(x)  # still runs when the interpreter ends
"""


@NEEDS_ONEDNN
@pytest.mark.parametrize("code", [DEVICES, ENDING], ids=["two devices", "end during a call"])
def test_in_a_process_of_its_own(code):
    assert python(code).stderr == ""

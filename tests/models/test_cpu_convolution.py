"""Values and gradients of every formulation are those of the definition in float64."""

import os
import pathlib
import subprocess
import sys

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from psgn_jax.models import cpu_convolution, onednn


@pytest.fixture(
    autouse=True,
    params=[
        "jax",
        pytest.param(
            "onednn",
            marks=pytest.mark.skipif(onednn.library() is None, reason="oneDNN is not installed"),
        ),
    ],
)
def formulation(request, monkeypatch):
    """Each test runs with this package's formulations and with oneDNN."""
    monkeypatch.setenv("PSGN_CONVOLUTIONS", request.param)
    jax.clear_caches()
    return request.param


def correlate(x, kernel, dy, stride):
    """VALID correlation by its definition in float64: y, and with dy the gradients dx, dkernel."""
    x, kernel = x.astype(np.float64), kernel.astype(np.float64)
    kh, kw = kernel.shape[:2]
    ho, wo = (1 + (n - k) // stride for n, k in zip(x.shape[1:3], (kh, kw), strict=True))
    y = np.zeros((x.shape[0], ho, wo, kernel.shape[3]))
    dx, dk = np.zeros_like(x), np.zeros_like(kernel)
    for i in range(kh):
        for j in range(kw):
            here = np.s_[:, i : i + stride * ho : stride, j : j + stride * wo : stride]
            y += x[here] @ kernel[i, j]
            if dy is not None:
                dx[here] += dy @ kernel[i, j].T
                dk[i, j] = np.einsum("bhwc,bhwo->co", x[here], dy)
    return y, dx, dk


def reference(x, kernel, dy, stride, transposed):
    """y, dx and dkernel of `conv2d` or `conv2d_transpose`, by `correlate`."""
    pads = []
    if transposed:
        dilated = np.zeros((x.shape[0], *(stride * (n - 1) + 1 for n in x.shape[1:3]), x.shape[3]))
        dilated[:, ::stride, ::stride] = x
        for k in kernel.shape[:2]:
            low = k - 1 if stride > k - 1 else -(-(k + stride - 2) // 2)
            pads.append((low, k + stride - 2 - low))
        step = 1
    else:
        dilated, step = x, stride
        for n, k in zip(x.shape[1:3], kernel.shape[:2], strict=True):
            pad = max(0, (-(-n // stride) - 1) * stride + k - n)
            pads.append((pad // 2, pad - pad // 2))
    h, w = dilated.shape[1:3]
    y, dx, dk = correlate(np.pad(dilated, [(0, 0), *pads, (0, 0)]), kernel, dy, step)
    dx = dx[:, pads[0][0] :, pads[1][0] :][:, :h, :w]
    return y, dx[:, ::stride, ::stride] if transposed else dx, dk


def make(seed, batch, h, w, c_in, c_out, size, stride, transposed):
    rng = np.random.default_rng(seed)
    if transposed:
        ho, wo = stride * h, stride * w
    else:
        ho, wo = -(-h // stride), -(-w // stride)
    shapes = (batch, h, w, c_in), (size, size, c_in, c_out), (batch, ho, wo, c_out)
    return [rng.standard_normal(shape, np.float32) for shape in shapes]


def run(x, kernel, dy, stride, transposed):
    function = cpu_convolution.conv2d_transpose if transposed else cpu_convolution.conv2d

    @jax.jit
    def all_three(x, kernel, dy):
        y, vjp = jax.vjp(lambda x, kernel: function(x, kernel, stride=stride), x, kernel)
        return y, *vjp(dy)

    return all_three(x, kernel, dy)


def assert_close(ours, expected, relative=3e-6):
    """Requires small errors relative to the largest number of an array.

    The rounding error of a sum of products depends on its largest terms.
    """
    for name, a, b in zip(("output", "dx", "dkernel"), ours, expected, strict=True):
        assert a.shape == b.shape, name
        error = np.abs(np.asarray(a, np.float64) - b).max() / np.abs(b).max()
        assert error < relative, (name, error)


CASES = {
    # batch, height, width, input channels, output channels, kernel size, stride, transposed
    "narrow input": (2, 6, 8, 4, 16, 3, 1, False),
    "narrow output": (2, 6, 8, 64, 3, 3, 1, False),
    "one channel": (1, 5, 6, 1, 1, 3, 1, False),
    "pairs of pixels": (2, 5, 12, 32, 32, 3, 1, False),
    "odd width": (2, 4, 7, 16, 24, 3, 1, False),
    "blocks of rows": (2, 48, 32, 16, 16, 3, 1, False),
    "blocks of two rows": (4, 6, 128, 64, 65, 3, 1, False),
    "wide": (2, 4, 6, 128, 96, 3, 1, False),
    "many channels": (1, 3, 4, 700, 640, 3, 1, False),
    "kernel of 5": (2, 9, 10, 8, 16, 5, 1, False),
    "kernel of 4": (2, 6, 7, 8, 16, 4, 1, False),
    "kernel of 1": (2, 6, 8, 16, 5, 1, 1, False),
    "one pixel": (3, 1, 1, 16, 16, 3, 1, False),
    "strided": (2, 8, 12, 16, 32, 3, 2, False),
    "strided, odd size": (2, 7, 9, 16, 32, 3, 2, False),
    "strided, many pixels": (4, 32, 64, 16, 32, 3, 2, False),
    "strided, kernel of 5": (2, 6, 8, 96, 64, 5, 2, False),
    "strided, kernel of 5, odd size": (1, 5, 7, 24, 16, 5, 2, False),
    "strided, one pixel": (1, 1, 1, 8, 8, 3, 2, False),
    "strided, many channels": (2, 6, 8, 128, 512, 5, 2, False),
    "kernel smaller than the stride": (2, 7, 8, 8, 8, 1, 2, False),
    "kernel of 2, stride of 3": (2, 8, 9, 8, 8, 2, 3, False),
    "stride of 3": (2, 8, 9, 8, 8, 3, 3, False),
    "transposed": (2, 3, 4, 64, 32, 5, 2, True),
    "transposed, kernel of 3": (2, 5, 4, 16, 16, 3, 2, True),
    "transposed, kernel of 2": (2, 3, 3, 8, 16, 2, 2, True),
    "transposed, stride of 1": (2, 5, 6, 16, 8, 3, 1, True),
}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
def test_is_the_definition(case):
    arrays = make(0, *case)
    assert_close(run(*arrays, *case[-2:]), reference(*arrays, *case[-2:]))


@pytest.mark.parametrize("case", [CASES["strided"], CASES["transposed"]], ids=["conv", "transpose"])
def test_plain_convolutions_elsewhere(case, monkeypatch):
    arrays = make(0, *case)
    here = run(*arrays, *case[-2:])
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    text = str(jax.make_jaxpr(lambda *a: run(*a, *case[-2:]))(*arrays))
    assert "custom_vjp" not in text
    assert_close(run(*arrays, *case[-2:]), [np.asarray(a, np.float64) for a in here])


@pytest.mark.parametrize("name", ["blocks of rows", "strided", "transposed"])
def test_bfloat16(name):
    case = CASES[name]
    arrays = [jnp.asarray(a, jnp.bfloat16) for a in make(0, *case)]
    ours = run(*arrays, *case[-2:])
    assert all(a.dtype == jnp.bfloat16 for a in ours)
    exact = [np.asarray(a, np.float64) for a in arrays]
    assert_close(ours, reference(*exact, *case[-2:]), relative=0.02)


def test_vmap_over_kernels_and_images():
    case = (2, 6, 8, 16, 16, 3, 1, False)
    x, kernel, dy = (np.stack(a) for a in zip(*(make(s, *case) for s in (0, 1)), strict=True))

    def gradients(x, kernel, dy):
        y, vjp = jax.vjp(cpu_convolution.conv2d, x, kernel)
        return y, *vjp(dy)

    many = jax.jit(jax.vmap(gradients))(x, kernel, dy)
    for s in (0, 1):
        assert_close([a[s] for a in many], reference(x[s], kernel[s], dy[s], 1, False))


def test_same_bits_twice():
    case = CASES["blocks of rows"]
    arrays = make(0, *case)
    first, second = run(*arrays, *case[-2:]), run(*arrays, *case[-2:])
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b)


def test_second_derivative():
    x, kernel, _ = make(0, 1, 4, 6, 4, 3, 3, 1, False)

    def norm_sq_of_gradient(kernel):
        return jnp.sum(jax.grad(lambda k: jnp.sum(cpu_convolution.conv2d(x, k) ** 2))(kernel) ** 2)

    step = 1e-2 * np.random.default_rng(1).standard_normal(kernel.shape, np.float32)
    slope = jnp.vdot(jax.grad(norm_sq_of_gradient)(kernel), step)
    change = norm_sq_of_gradient(kernel + step) - norm_sq_of_gradient(kernel - step)
    np.testing.assert_allclose(slope, change / 2, rtol=1e-2)


SHARDED = """
import re, sys
import jax, numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec as P
sys.path.insert(0, {tests!r})
import test_cpu_convolution as t
from psgn_jax.models import cpu_convolution
assert jax.device_count() == 8
mesh = Mesh(np.array(jax.devices()), ("data",))
split, whole = NamedSharding(mesh, P("data")), NamedSharding(mesh, P())
for case in ((16, 16, 64, 16, 16, 3, 1, False), (8, 6, 8, 16, 16, 5, 2, False),
             (8, 3, 4, 16, 8, 5, 2, True)):
    arrays = t.make(0, *case)
    function = cpu_convolution.conv2d_transpose if case[-1] else cpu_convolution.conv2d
    def all_three(x, kernel, dy):
        y, vjp = jax.vjp(lambda x, k: function(x, k, stride=case[-2]), x, kernel)
        return y, *vjp(dy)
    compiled = jax.jit(all_three, in_shardings=(split, whole, split),
                       out_shardings=(split, split, whole)).lower(*arrays).compile()
    t.assert_close(compiled(*arrays), t.reference(*arrays, *case[-2:]))
    text = compiled.as_text()
    moved = re.findall(r" (all-gather|all-to-all|collective-permute)[(-]", text)
    assert not moved, moved
    assert len(re.findall(r" all-reduce(?:-start)?\\(", text)) == 1, text
    assert " while(" not in text

# Within `jax.shard_map` XLA does not split the batch, so the faster loop over rows is used.
arrays = t.make(0, 16, 16, 64, 16, 16, 3, 1, False)
def kernel_gradient(x, kernel, dy):
    (gradient,) = jax.vjp(lambda k: cpu_convolution.conv2d(x, k), kernel)[1](dy)
    return jax.lax.psum(gradient, "data")
sharded = jax.shard_map(kernel_gradient, mesh=mesh, in_specs=(P("data"), P(), P("data")),
                        out_specs=P(), check_vma=False)
compiled = jax.jit(sharded).lower(*arrays).compile()
expected = t.reference(*arrays, 1, False)
t.assert_close((*expected[:2], compiled(*arrays)), expected)
assert " while(" in compiled.as_text()
print("sharded ok")
"""


def test_sharded_batch_moves_only_the_kernel_gradient():
    tests = str(pathlib.Path(__file__).parent)
    flags = "--xla_force_host_platform_device_count=8 --xla_backend_optimization_level=0"
    env = {**os.environ, "XLA_FLAGS": flags}
    done = subprocess.run(
        [sys.executable, "-c", SHARDED.format(tests=tests)],
        env=env,
        cwd=pathlib.Path(__file__).parents[2],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert "sharded ok" in done.stdout, done.stdout + done.stderr


def test_one_device_of_a_mesh_uses_onednn(formulation):
    mesh = jax.sharding.Mesh(np.array(jax.devices()[:1]), ("data",))
    P = jax.sharding.PartitionSpec
    x, kernel, _ = make(0, *CASES["strided"])
    mapped = jax.shard_map(
        cpu_convolution.conv2d, mesh=mesh, in_specs=(P("data"), P()), out_specs=P("data")
    )
    text = str(jax.make_jaxpr(mapped)(x, kernel))
    assert ("buffer_callback" in text) == (formulation == "onednn")


def test_environment_selects_the_formulation(formulation):
    x, kernel, _ = make(0, *CASES["strided"])
    text = str(jax.make_jaxpr(lambda k: cpu_convolution.conv2d(x, k, stride=2))(kernel))
    assert ("buffer_callback" in text) == (formulation == "onednn")


def test_one_image_is_computed_without_onednn_by_default(monkeypatch):
    monkeypatch.delenv("PSGN_CONVOLUTIONS")
    x, kernel, _ = make(0, *CASES["strided"])
    for images, called in ((x, onednn.library() is not None), (x[:1], False)):
        text = str(jax.make_jaxpr(lambda k, x=images: cpu_convolution.conv2d(x, k))(kernel))
        assert ("buffer_callback" in text) == called


@pytest.mark.parametrize(
    ("value", "message"),
    [("mkl", "'mkl': accepted: onednn, jax, xla"), ("onednn", "the library was not found")],
)
def test_environment_refuses(value, message, monkeypatch):
    monkeypatch.setenv("PSGN_CONVOLUTIONS", value)
    monkeypatch.setattr(onednn, "library", lambda: None)
    x, kernel, _ = make(0, *CASES["strided"])
    with pytest.raises(ValueError, match=message):
        cpu_convolution.conv2d(x, kernel)


def test_environment_switch_takes_xlas_own_convolutions(rng, monkeypatch):
    x = rng.normal(size=(1, 6, 8, 3)).astype(np.float32)
    kernel = rng.normal(size=(3, 3, 3, 20)).astype(np.float32)
    want = cpu_convolution.conv2d(x, kernel)
    # A new function each time, because JAX caches the traces of a function.
    assert "custom_vjp" in str(jax.make_jaxpr(lambda k: cpu_convolution.conv2d(x, k))(kernel))
    monkeypatch.setenv("PSGN_CONVOLUTIONS", "xla")
    assert "custom_vjp" not in str(jax.make_jaxpr(lambda k: cpu_convolution.conv2d(x, k))(kernel))
    np.testing.assert_allclose(cpu_convolution.conv2d(x, kernel), want, atol=1e-4)

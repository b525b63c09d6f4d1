"""The Pallas kernel of the nearest neighbours, interpreted on a CPU and lowered for CUDA."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import lowering, reference

from psgn_jax import losses
from psgn_jax.losses import chamfer
from psgn_jax.losses.kernels import chamfer as chamfer_kernel
from psgn_jax.losses.kernels import dispatch

search = jax.jit(functools.partial(chamfer_kernel.search, interpret=True))
# Sizes just below and above those of the tiles, and a cloud long enough for groups of chunks.
SIZES = [(1, 1), (1, 70), (31, 33), (100, 65), (40, chamfer_kernel._LONG + 1)]


@pytest.fixture
def interpreted(monkeypatch):
    """The losses use the kernel as on a GPU, but interpreted instead of compiled."""
    jax.clear_caches()
    monkeypatch.setenv("PSGN_KERNELS", "on")
    monkeypatch.setattr(chamfer, "select", lambda kernel, plain, *arrays: search(*arrays))
    yield
    jax.clear_caches()


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_equals_the_plain_search(rng, n, m):
    a, b = (rng.normal(size=(k, 3)).astype(np.float32) + 100 for k in (n, m))
    for got, want in zip(search(a, b), chamfer._search_both(a, b), strict=True):
        np.testing.assert_allclose(got, want, rtol=1e-6)


def test_ties_take_the_lowest_index():
    side = np.arange(17)
    grid = np.stack(np.meshgrid(side, side, side), -1).reshape(-1, 3).astype(np.float32)
    a, b = grid[:100] + 0.5, np.tile(grid, (2, 1))[:5000]
    _, to_b, _, to_a = search(a, b)
    np.testing.assert_array_equal(to_b, reference.nearest(a, b)[1])
    np.testing.assert_array_equal(to_a, reference.nearest(b, a)[1])


def test_vmap_is_each_pair_alone(rng):
    a, b = (rng.normal(size=(3, k, 3)).astype(np.float32) for k in (40, 70))
    batch = jax.jit(jax.vmap(search))(a, b)
    for i in range(3):
        for got, want in zip(batch, search(a[i], b[i]), strict=True):
            np.testing.assert_array_equal(got[i], want)


@pytest.mark.usefixtures("interpreted")
def test_loss_gradient_and_nan(rng):
    a, b = (rng.normal(size=(2, k, 3)).astype(np.float32) for k in (40, 70))
    batch = jax.jit(jax.vmap(jax.value_and_grad(losses.chamfer_sq_mean, argnums=(0, 1))))
    value, gradients = batch(a, b)
    want = [reference.chamfer_sq_mean(x, y) for x, y in zip(a, b, strict=True)]
    np.testing.assert_allclose(value, want, rtol=1e-5)

    def naive(a, b):
        d = jnp.square(a[:, :, None] - b[:, None]).sum(-1)
        return (d.min(2).mean(1) + d.min(1).mean(1)).sum()

    for got, expected in zip(gradients, jax.grad(naive, (0, 1))(a, b), strict=True):
        np.testing.assert_allclose(got, expected, atol=1e-6)
    a[0, 3, 1] = np.nan
    value, _ = batch(a, b)
    np.testing.assert_array_equal(np.isnan(value), [True, False])


@pytest.mark.parametrize("m", [1, 1000, 16384])
def test_lowers_for_cuda(m):
    calls = lowering.kernels(chamfer_kernel.search, ((1024, 3), "f"), ((m, 3), "f"))
    assert calls == ["chamfer_nearest"] * 2


def test_training_lowers_for_cuda_with_the_kernel_and_for_a_cpu_without(monkeypatch):
    jax.clear_caches()
    monkeypatch.setenv("PSGN_KERNELS", "on")
    loss = jax.grad(lambda a, b: jax.vmap(losses.chamfer_sq_mean)(a, b).sum())
    shapes = ((32, 1024, 3), "f"), ((32, 16384, 3), "f")
    assert lowering.kernels(loss, *shapes) == ["chamfer_nearest"] * 2
    a, b = np.zeros((2, 1, 3), np.float32), np.ones((2, 6, 3), np.float32)
    np.testing.assert_allclose(jax.jit(loss)(a, b), np.full_like(a, -4), rtol=1e-5)
    jax.clear_caches()


def test_shard_map_lowers_for_cuda(monkeypatch):
    jax.clear_caches()
    monkeypatch.setenv("PSGN_KERNELS", "on")
    mesh = jax.make_mesh((1,), ("data",), axis_types=(jax.sharding.AxisType.Auto,))
    spec = jax.sharding.PartitionSpec("data")

    @functools.partial(jax.shard_map, mesh=mesh, in_specs=(spec, spec), out_specs=spec)
    def local(a, b):
        return jax.grad(lambda a, b: jax.vmap(losses.chamfer_sq_mean)(a, b).sum())(a, b)

    shapes = ((4, 40, 3), "f"), ((4, 70, 3), "f")
    assert lowering.kernels(local, *shapes) == ["chamfer_nearest"] * 2
    jax.clear_caches()


def test_kernels_are_chosen_by_the_environment(monkeypatch):
    monkeypatch.setenv("PSGN_KERNELS", "on")
    assert dispatch.use_kernels()
    assert not dispatch.use_kernels(force=False)
    monkeypatch.setenv("PSGN_KERNELS", "off")
    assert not dispatch.use_kernels()
    assert dispatch.use_kernels(force=True)
    monkeypatch.setenv("PSGN_KERNELS", "yes")
    with pytest.raises(ValueError, match="PSGN_KERNELS: got 'yes', accepted: auto, on, off"):
        dispatch.use_kernels()


def test_by_default_the_plain_path_is_taken_and_said_once_on_a_gpu(monkeypatch):
    said = []
    monkeypatch.delenv("PSGN_KERNELS", raising=False)
    monkeypatch.setattr(dispatch.logging, "info", lambda *args: said.append(args))
    dispatch._say_plain.cache_clear()
    assert not dispatch.use_kernels()
    assert not said
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    assert not any(dispatch.use_kernels() for _ in range(2))
    assert len(said) == 1

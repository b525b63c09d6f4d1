"""The Pallas kernel of the auction, interpreted on a CPU and lowered for CUDA, without a GPU."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helpers import lowering
from scipy.optimize import linear_sum_assignment

from psgn_jax import losses
from psgn_jax.losses.kernels import auction as auction_kernel

TOLERANCE = 0.01


interpreted = jax.jit(functools.partial(auction_kernel.solve, interpret=True))


def solve(a, b, tolerance=TOLERANCE, budget=10**6):
    return interpreted(a, b, np.float32(tolerance), np.int32(budget))


def distances(a, b):
    return np.sqrt(np.square(np.float64(a)[:, None] - np.float64(b)[None]).sum(-1))


def clouds(rng, n, kind):
    b = rng.uniform(0, 0.5, (n, 3))
    if kind == "near":
        a = b[rng.permutation(n)] + rng.normal(0, 0.02, b.shape)
    elif kind == "far":
        a = rng.uniform(0, 0.5, (n, 3)) * [1, 0.1, 1]
    elif kind == "init":
        a = rng.normal(0, 5e-4, b.shape)
    elif kind == "dup":
        a, b = (
            rng.uniform(0, 0.5, (n, 3))[rng.integers(0, n // 4, n)],
            b[rng.integers(0, n // 4, n)],
        )
    elif kind == "grid":
        a, b = (np.round(x * 10) / 10 for x in (rng.uniform(0, 0.5, b.shape), b))
    else:
        a = b = np.full((n, 3), 0.3)
    return a.astype(np.float32), b.astype(np.float32)


def check(a, b, found, tolerance=TOLERANCE):
    n = len(a)
    owner, prices = np.asarray(found.owner), np.asarray(found.prices, np.float64)
    np.testing.assert_array_equal(np.sort(owner), np.arange(n))
    cost = distances(a, b)
    value = cost[owner, np.arange(n)].sum()
    best = cost[linear_sum_assignment(cost)].sum()
    dual = (cost + prices).min(axis=1).sum() - prices.sum()
    assert dual <= best * (1 + 1e-9)
    assert value <= (1 + tolerance) * best + 1e-6
    # The returned prices prove that the cost is within the tolerance.
    assert value - dual <= tolerance * dual + 1e-6


# 100 points, because the kernel pads sizes that are not a power of two.
@pytest.mark.parametrize("kind", ["near", "far", "init", "dup", "grid", "equal"])
def test_within_the_tolerance(rng, kind):
    for _ in range(3):
        a, b = clouds(rng, 100, kind)
        check(a, b, solve(a, b))


@pytest.mark.parametrize("n", [2, 33])
def test_small(rng, n):
    a, b = clouds(rng, n, "far")
    check(a, b, solve(a, b))


def test_one_point():
    found = solve(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))
    np.testing.assert_array_equal(found.owner, [0])


def test_smaller_tolerance_smaller_gap(rng):
    a, b = clouds(rng, 100, "far")
    check(a, b, solve(a, b, 1e-3), 1e-3)


def test_coincident_clouds_cost_nothing(rng):
    a, _ = clouds(rng, 100, "far")
    b = a[rng.permutation(100)]
    owner = np.asarray(solve(a, b).owner)
    np.testing.assert_array_equal(a[owner], b)


@pytest.mark.parametrize("budget", [0, 40, 300])
def test_a_spent_budget_leaves_a_matching(rng, budget):
    a, b = clouds(rng, 100, "far")
    found = solve(a, b, 0.0, budget)
    owner = np.asarray(found.owner)
    has = owner >= 0
    assert len(set(owner[has])) == has.sum()
    # In the last round all lanes still bid, which may exceed the budget.
    assert found.bids < budget + 8
    if budget == 0:
        np.testing.assert_array_equal(owner, np.arange(100))


def test_no_tolerance_ends(rng):
    a, b = clouds(rng, 33, "grid")
    found = solve(a, b, 0.0)
    check(a, b, found, 1e-3)


def test_nan_ends(rng):
    # The caller replaces non-finite coordinates, but the kernel must terminate even with a NaN.
    a, b = clouds(rng, 33, "far")
    a[3, 1] = np.nan
    assert solve(a, b, TOLERANCE, 2000).bids < 2008


def test_vmap_is_each_pair_alone(rng):
    pairs = [clouds(rng, 33, kind) for kind in ("near", "far", "dup")]
    a, b = (np.stack(x) for x in zip(*pairs, strict=True))
    batch = jax.vmap(solve, (0, 0))(a, b)
    for i, (x, y) in enumerate(pairs):
        for got, want in zip(batch, solve(x, y), strict=True):
            np.testing.assert_array_equal(got[i], want)


def test_same_bits_every_time(rng):
    a, b = clouds(rng, 100, "grid")
    for first, second in zip(solve(a, b), solve(a, b), strict=True):
        np.testing.assert_array_equal(first, second)


def test_too_many_points():
    a = jnp.zeros((auction_kernel.MAX_POINTS + 1, 3))
    with pytest.raises(ValueError, match="a: got 4097 points, expected at most 4096"):
        auction_kernel.solve(a, a, 0.01, 1)


@pytest.mark.parametrize("n", [2, 1000, auction_kernel.MAX_POINTS])
def test_lowers_for_cuda(n):
    points, scalar = (n, 3), ()
    calls = lowering.kernels(
        auction_kernel.solve, (points, "f"), (points, "f"), (scalar, "f"), (scalar, "i")
    )
    assert calls == ["auction"]


def test_lowers_for_cuda_in_a_batch():
    batch = jax.vmap(auction_kernel.solve, (0, 0, None, None))
    points = ((32, 1024, 3), "f")
    assert lowering.kernels(batch, points, points, ((), "f"), ((), "i")) == ["auction"]


@pytest.mark.parametrize(
    "kind", ["near", *(pytest.param(k, marks=pytest.mark.slow) for k in ("grid", "equal"))]
)
def test_the_certificate_is_that_of_the_plain_auction(rng, kind):
    a, b = clouds(rng, 100, kind)
    pair = jax.jit(lambda a, b: auction_kernel.solve_pair(a, b, TOLERANCE, 10**6, interpret=True))
    for scale in (1.0, 1e-6, 1e6):
        index, _, _, gap = pair(a * np.float32(scale), b * np.float32(scale))
        np.testing.assert_array_equal(np.sort(index), np.arange(100))
        cost = distances(a, b)
        best = cost[linear_sum_assignment(cost)].sum()
        assert cost[np.arange(100), index].sum() <= best * (1 + gap) + 1e-6
        assert gap <= TOLERANCE
    a[0] = np.nan
    index, _, bids, gap = pair(a, b)
    np.testing.assert_array_equal(index, np.arange(100))
    assert bids == 0
    assert np.isnan(gap)


def test_the_loss_lowers_for_cuda_with_the_kernel_and_for_a_cpu_without(monkeypatch):
    jax.clear_caches()
    monkeypatch.setenv("PSGN_KERNELS", "on")
    loss = jax.grad(lambda a, b: jax.vmap(losses.emd_mean)(a, b).sum())
    assert lowering.kernels(loss, *[((4, 100, 3), "f")] * 2) == ["auction"]
    a, b = np.zeros((2, 5, 3), np.float32), np.ones((2, 5, 3), np.float32)
    np.testing.assert_allclose(jax.jit(loss)(a, b), np.full_like(a, -0.2 / 3**0.5), rtol=1e-5)
    jax.clear_caches()

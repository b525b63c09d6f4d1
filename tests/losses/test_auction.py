import jax
import numpy as np
import pytest
from helpers import reference
from helpers.real_pairs import KINDS, authors_clouds, clouds, pairs_of

from psgn_jax import losses

solve = losses.assign  # without `jit`, it is compiled once per size
solve_map = jax.jit(losses.map_pairs(losses.assign))


def check(a, b, found, tolerance=0.01, *, converged=True):
    """Requires a bijection whose true gap is at most `gap`, which is at most the tolerance."""
    index = np.asarray(found.index)
    np.testing.assert_array_equal(np.sort(index), np.arange(len(a)))
    best, cost = reference.emd_sum(a, b), reference.matching_cost(a, b, index)
    gap = float(found.gap)
    assert cost <= best * (1 + gap) * (1 + 1e-12), (cost / best - 1, gap)
    assert bool(found.converged) == (gap <= tolerance)
    if converged:
        assert gap <= tolerance
    assert np.all(np.asarray(found.prices) >= 0)


@pytest.mark.parametrize(("n", "pairs"), [(384, 6), pytest.param(1024, 8, marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", KINDS)
def test_real_pairs(authors_batches, rng, kind, n, pairs):
    a, b = pairs_of(authors_clouds(authors_batches, pairs), kind, n, n, rng)
    found = solve_map(a, b)
    for i in range(len(a)):
        check(a[i], b[i], jax.tree.map(lambda x, i=i: x[i], found))


def test_any_tolerance_and_budget_and_prices_prove_the_gap(rng):
    a, b = clouds(rng, 128, 128)
    for tolerance in (0.1, 0.001):
        check(a, b, solve(a, b, tolerance=tolerance), tolerance)
    gaps = {}
    for max_bids in (0, 1, 64, 256, 1024):
        found = solve(a, b, tolerance=1e-4, max_bids=max_bids)
        check(a, b, found, 1e-4, converged=False)
        assert int(found.iterations) == max_bids  # the budget is used while the gap is too large
        assert not found.converged
        gaps[max_bids] = float(found.gap)
    assert gaps[64] > 2 * gaps[256] > 4 * gaps[1024]
    found = solve(a, b)
    jax.tree.map(np.testing.assert_array_equal, found, solve(a, b))  # the same bits every time
    lower = reference.emd_lower_bound(a, b, found.prices)
    cost = reference.matching_cost(a, b, found.index)
    assert cost / lower - 1 <= float(found.gap)
    # The part of the gap that covers rounding errors is small.
    assert cost / lower - 1 > float(found.gap) - 2e-3


def test_any_scale_and_offset_and_degenerate_clouds(rng):
    # A large offset leaves few significant digits: many points then coincide, or all of them.
    for scale, offset in ((1e-6, 0), (1e6, 0), (1, 1e3), (1, -1e6), (1e6, -1e12), (1e-6, 1e3)):
        a, b = clouds(rng, 128, 128, scale, offset)
        check(a, b, solve(a, b))
    for a, b in degenerate(rng).values():
        a, b = np.asarray(a, np.float32), np.asarray(b, np.float32)
        check(a, b, solve(a, b))


def lattice(rng, n):
    grid = np.stack(np.meshgrid(*[np.arange(6)] * 3), -1).reshape(-1, 3)
    return tuple(rng.permutation(grid)[:n] for _ in range(2))


def degenerate(rng):
    a, b = clouds(rng, 128, 128)
    ends = np.float32([[0, 0, 0], [1, 0, 0]])
    return {
        "two points": (0 * a, 0 * b + 1),
        "two places": (ends[rng.integers(0, 2, 128)], ends[rng.integers(0, 2, 128)]),
        "collinear lattice": tuple(rng.integers(0, 50, (128, 1)) * [1, 2, 3] for _ in range(2)),
        "planar": (a * [1, 1, 0], b * [1, 1, 0]), "same": (a, a),
        "permuted": (a, rng.permutation(a)), "lattice": lattice(rng, 128),
        "shifted lattice": tuple(x + d for x, d in zip(lattice(rng, 128), (0, 0.5), strict=True)),
        "duplicates": (a[rng.integers(0, 5, 128)], b[rng.integers(0, 7, 128)]),
        "far apart": (a, b + 1000), "first prediction": (a * 3e-4, b), "one point": (a[:1], b[:1]),
        "odd number": (a[:17], b[:17]),
        "outlier": (a, np.concatenate([b[:-1], b[-1:] + 300])),
    }  # fmt: skip


def test_more_points_than_the_table_of_distances_has(rng):
    a, b = clouds(rng, 1100, 1100)
    check(a, b, solve(a, b))

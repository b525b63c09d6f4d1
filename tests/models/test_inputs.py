import numpy as np
import pytest

from psgn_jax.models.networks import stack_channels


@pytest.fixture
def sample(rng):
    image = rng.integers(0, 256, (6, 8, 3), dtype=np.uint8)
    mask = rng.random((6, 8)) < 0.5
    depth = np.where(mask, rng.uniform(2.6, 4.6, (6, 8)), 0).astype(np.float32)
    return image, mask, depth


def test_rgb_and_background_mask(sample):
    image, mask, _ = sample
    x = np.asarray(stack_channels(image, mask, None, channels=("rgb", "mask")))
    assert x.shape == (6, 8, 4)
    assert x.dtype == np.float32
    np.testing.assert_allclose(x[mask][:, :3], image[mask] / 255, atol=1e-7)
    np.testing.assert_array_equal(x[~mask][:, :3], np.float32(191 / 255))
    np.testing.assert_array_equal(x[..., 3], ~mask)


def test_depth_counts_from_the_origin_and_says_where_it_is(sample):
    image, mask, depth = sample
    x = stack_channels(image, mask, depth, channels=("depth",))
    assert x.shape == (6, 8, 2)
    np.testing.assert_allclose(x[..., 0], np.where(mask, 3.6 - depth, 0), atol=1e-6)
    np.testing.assert_array_equal(x[..., 1], mask)
    assert np.abs(x).max() <= 1
    moved = stack_channels(image, mask, depth + 2 * mask, channels=("depth",), distance=5.6)
    np.testing.assert_allclose(moved, x, atol=1e-6)
    distances = np.array([3.6, 4.0], np.float32)  # one for each sample of a batch
    batch = [np.stack([a, a]) for a in sample]
    both = stack_channels(*batch, channels=("depth",), distance=distances)
    np.testing.assert_allclose((both[1] - both[0])[mask][:, 0], 0.4, atol=1e-6)
    np.testing.assert_array_equal(both[1][~mask], 0)


@pytest.mark.parametrize("hole", [0.0, -1.0, np.nan, np.inf])
def test_a_hole_is_neither_background_nor_a_surface_at_the_origin(sample, hole):
    image, _, _ = sample
    mask = np.ones((6, 8), bool)
    mask[0] = False
    depth = np.full((6, 8), 3.6, np.float32)
    depth[0] = 0
    depth[3, 4] = hole
    x = np.asarray(stack_channels(image, mask, depth, channels=("rgb", "mask", "depth")))
    assert np.isfinite(x).all()
    background, missing, surface = x[0, 4, 3:], x[3, 4, 3:], x[3, 5, 3:]
    assert background.tolist() == [1, 0, 0]
    assert missing.tolist() == [0, 0, 0]
    np.testing.assert_allclose(surface, [0, 0, 1], atol=1e-6)

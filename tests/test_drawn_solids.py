import numpy as np
import pytest
from helpers import drawn_solids as solids

from psgn_jax.data import schema
from psgn_jax.viewing import dataset as dataset_view


@pytest.mark.parametrize("category", solids.CATEGORIES)
def test_samples_are_valid_and_agree_with_their_images(category):
    for seed in range(6):
        rng = np.random.default_rng(seed)
        sample = solids.draw(
            solids.random_solid(category, rng), rng, image_size=(96, 128), num_points=8192
        )
        schema.validate(sample)
        found = dataset_view.check(sample)
        assert found.near == 1.0
        assert found.inside > 0.85
        assert found.depth_median < 0.02
        assert found.reach == pytest.approx(1, abs=1e-5)
        assert -1e-6 < found.lowest < 0.01
        assert (sample.image[~sample.mask] == schema.BACKGROUND_GREY).all()
        rows, columns = np.nonzero(sample.mask)
        assert 0 < rows.min() < rows.max() < 95
        assert 0 < columns.min() < columns.max() < 127


@pytest.mark.parametrize("category", solids.CATEGORIES)
def test_rays_end_on_the_surface_with_its_normal(category, rng):
    """A ray from far outside to a surface point that faces it ends there, unless hidden."""
    solid = solids.random_solid(category, rng)
    points, normals = solid.sample(rng, 2000)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-9)
    eye = np.array([5.0, 3.0, 4.0])
    t, found = solid.cast(eye, points - eye)
    # Something is hit, at the point or before, but for grazing rays.
    assert (t < 1 + 1e-4).mean() > 0.99
    facing = ((eye - points) * normals).sum(1) > 0.2
    direct = facing & (np.abs(t - 1) < 1e-4)
    assert direct.sum() > 0.3 * facing.sum()
    assert ((found * normals).sum(1)[direct] > 0.999).mean() > 0.99
    if category != "torus":  # convex: what faces the eye is seen
        assert direct.sum() == facing.sum()
    missed, _ = solid.cast(eye, np.array([[1.0, 0.5, 0.5], [0, 0, 1]]))
    assert np.isinf(missed).all()

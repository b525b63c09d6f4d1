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

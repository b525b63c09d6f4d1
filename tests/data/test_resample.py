import numpy as np
import pytest

from psgn_jax.data import resample


@pytest.mark.parametrize("factor", [0.71, 0.9, 1.0, 1.22])
def test_the_surroundings_of_the_object_are_enough(rng, factor):
    """The results for the window are those for the whole image, except for ties of rounding."""
    image = np.full((40, 56, 3), 191, np.uint8)
    mask = np.zeros((40, 56), np.bool_)
    mask[9:26, 12:31] = rng.random((17, 19)) < 0.8
    image[9:26, 12:31] = rng.integers(0, 256, (17, 19, 3))
    other = image.copy()
    other[4, 4] = 190  # with another pixel than grey, the whole image is computed
    source = 27.3 + (np.arange(56) + 0.5 - 27.3) / factor
    for function, arguments in (
        (resample.stretch, [source]),
        (resample.recrop, [factor, (-0.6, 2.9)]),
    ):
        got, want = (function(picture, mask, *arguments) for picture in (image, other))
        np.testing.assert_array_equal(got[1], want[1])
        difference = np.abs(got[0].astype(int) - want[0])
        assert difference.max() <= 1
        assert (difference > 0).mean() < 0.005

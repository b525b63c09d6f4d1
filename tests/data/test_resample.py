import numpy as np
import pytest

from psgn_jax.data import resample, schema


def _object(rng, position, colour):
    """An object on a background of one colour, with colours that also cover the mask's edge."""
    image = np.full((40, 56, 3), colour, np.uint8)
    mask = np.zeros((40, 56), np.bool_)
    rows, columns = np.s_[position : position + 17], np.s_[position + 3 : position + 22]
    mask[rows, columns] = rng.random((17, 19)) < 0.8
    image[rows, columns] = rng.integers(0, 256, (17, 19, 3))
    return image, mask


@pytest.mark.parametrize("position", [0, 9, 23])  # the first and the last touch the border
@pytest.mark.parametrize("colour", [schema.BACKGROUND_GREY, 90])
def test_the_surroundings_of_the_object_are_enough(rng, monkeypatch, position, colour):
    """The results for the window are those for the whole image, except for ties of rounding."""
    cases = []
    for factor in (0.71, 0.9, 1.0, 1.043, 1.22):
        image, mask = _object(rng, position, colour)
        source = 27.3 + (np.arange(56) + 0.5 - 27.3) / factor
        # Some pixels' centres have edges of pixels as their source for 0.9 and this offset.
        offset = (-0.6, 2.9) if factor == 0.9 else tuple(rng.uniform(-3, 3, 2).tolist())
        cases.append((resample.stretch, (image, mask, source)))
        cases.append((resample.recrop, (image, mask, factor, offset)))
    windows = [resample._window(*arguments[:2]) for _, arguments in cases]
    assert all((w is not None) == (position == 9 and colour != 90) for w in windows)
    quick = [function(*arguments) for function, arguments in cases]
    monkeypatch.setattr(resample, "_window", lambda image, mask: None)
    for (function, arguments), got in zip(cases, quick, strict=True):
        want = function(*arguments)
        np.testing.assert_array_equal(got[1], want[1])
        assert [x.dtype for x in got] == [x.dtype for x in want]
        difference = np.abs(got[0].astype(int) - want[0])
        assert difference.max() <= 1
        assert (difference > 0).mean() < 0.005

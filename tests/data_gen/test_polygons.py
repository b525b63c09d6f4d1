import numpy as np
import pytest

from data_gen.polygons import cut_ears


def areas(outlines):
    """The areas of polygons [..., n, 2], positive counter-clockwise."""
    x, y = np.moveaxis(outlines, -1, 0)
    return (x * np.roll(y, -1, axis=-1) - np.roll(x, -1, axis=-1) * y).sum(axis=-1) / 2


@pytest.mark.parametrize("corners", [4, 5, 9, 14])
def test_many_polygons_at_once_are_cut_as_each_alone(rng, corners):
    angle = (np.arange(corners) + 0.8 * rng.random((6, corners))) * 2 * np.pi / corners
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=2)
    stars = ring * rng.uniform(0.2, 1, (6, corners, 1))
    crossing_themselves = rng.normal(size=(6, corners, 2))
    for outlines in (stars, crossing_themselves, np.rint(stars * 3)):
        each = [cut_ears(outline[None])[0] for outline in outlines]
        np.testing.assert_array_equal(cut_ears(outlines), each)
    # The triangles of a star fill it and do not overlap.
    parts = areas(np.stack([star[cut_ears(star[None])[0]] for star in stars]))
    assert (parts > 0).all()
    np.testing.assert_allclose(parts.sum(axis=1), areas(stars))

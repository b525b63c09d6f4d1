import numpy as np
import pytest

from data_gen.polygons import cut_ears


def cut_one_by_one(outline):
    """Cuts the first ear again and again, testing every corner each time."""
    rest, result = list(range(len(outline))), []

    def cross(o, a, b):
        return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])

    def is_ear(k):
        own = rest[k - 1], rest[k], rest[(k + 1) % len(rest)]
        a, b, c = outline[list(own)]
        return cross(a, b, c) > 0 and not any(
            cross(a, b, p) >= 0 and cross(b, c, p) >= 0 and cross(c, a, p) >= 0
            for p in outline[[i for i in rest if i not in own]]
        )

    while len(rest) > 3:
        best = next((k for k in range(len(rest)) if is_ear(k)), 0)
        result.append((rest[best - 1], rest[best], rest[(best + 1) % len(rest)]))
        del rest[best]
    return [*result, tuple(rest)]


@pytest.mark.parametrize("kind", ["star-shaped", "crossing itself", "with corners in one place"])
def test_many_polygons_at_once_are_cut_as_each_alone(rng, kind):
    for corners in (4, 5, 9, 14):
        angle = np.sort(rng.random((6, corners)), axis=1) * 2 * np.pi
        ring = np.stack([np.cos(angle), np.sin(angle)], axis=2)
        outlines = ring * rng.uniform(0.2, 1, (6, corners, 1))
        if kind == "crossing itself":
            outlines = rng.normal(size=(6, corners, 2))
        if kind == "with corners in one place":
            outlines = np.rint(outlines * 3)
        expected = [cut_one_by_one(outline) for outline in outlines]
        np.testing.assert_array_equal(cut_ears(outlines), expected)

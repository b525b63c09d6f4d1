import numpy as np
import pytest

from data_gen.polygons import cut_ears, fan, strip, triangles, with_holes


def area(points, corners):
    a, b, c = (points[corners[:, k]] for k in range(3))
    (ux, uy), (vx, vy) = (b - a)[:, :2].T, (c - a)[:, :2].T
    return (ux * vy - uy * vx).sum() / 2, np.abs(ux * vy - uy * vx).sum() / 2


def comb(teeth):
    """A row of squares of edge 1, one apart, on a bar of height 1."""
    tooth = ((1, 1), (1, 2), (0, 2), (0, 1))
    top = [(x + dx, y) for x in range(2 * teeth - 2, -1, -2) for dx, y in tooth]
    return np.array([(0, 0), (2 * teeth - 1, 0), *top], float)


@pytest.mark.parametrize("times", [1, 3])
@pytest.mark.parametrize("teeth", [2, 12, 60])
def test_polygons_with_many_corners_are_not_filled(teeth, times):
    points = np.repeat(comb(teeth), times, axis=0)
    points = np.column_stack([points, np.zeros(len(points))])
    result, polygon = triangles(np.array([len(points)]), np.arange(len(points)), points, dict)
    assert len(result) == len(points) - 2
    assert not polygon.any()
    assert area(points, result) == pytest.approx((3 * teeth - 1, 3 * teeth - 1))


def test_many_polygons_are_cut_as_each_alone():
    outlines = np.stack([np.roll(comb(10), shift, axis=0) for shift in range(5)])
    alone = [cut_ears(outline[None])[0] for outline in outlines]
    np.testing.assert_array_equal(cut_ears(outlines), alone)


@pytest.mark.parametrize("turn", [1, -1])
def test_holes_in_any_direction(turn):
    def square(x, y, size):
        return np.array([(0, 0), (1, 0), (1, 1), (0, 1)], float) * size + (x, y)

    holes = [square(1, 1, 2)[::turn], square(6, 6, 1), square(6, 1, 1)[::-turn]]
    points = np.column_stack([np.concatenate([square(0, 0, 8), *holes]), np.zeros(16)])
    order = with_holes(points, [4, 4, 4, 4])
    result, _ = triangles(np.array([len(order)]), order, points, dict)
    assert area(points, order[result]) == pytest.approx((58, 58))


def test_strips_and_fans():
    assert strip(5).tolist() == [[0, 1, 2], [2, 1, 3], [2, 3, 4]]
    assert fan(5).tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4]]
    assert [len(shape(count)) for shape in (strip, fan) for count in (0, 2, 3)] == [0, 0, 1] * 2

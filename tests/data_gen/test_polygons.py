import numpy as np
import pytest

from data_gen.polygons import cut_ears


def test_ears_of_a_star():
    angle = np.arange(10) / 10 * 2 * np.pi
    star = (
        np.stack([np.cos(angle), np.sin(angle)], axis=1)
        * np.where(np.arange(10) % 2, 0.4, 1)[:, None]
    )
    triangles = star[cut_ears(star)]
    a, b = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    area = (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) / 2
    assert (area > 0).all()
    x, y = star.T
    assert area.sum() == pytest.approx((x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2)

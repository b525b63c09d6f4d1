import numpy as np
import pytest
from helpers.solid_models import model_of, squares

from data_gen.catalogues import shapes
from data_gen.frame import normalize
from data_gen.mesh import Material, UnusableModelError, build_model
from data_gen.surface import sample_surface


def test_samples_are_uniform_by_area():
    model = normalize(model_of(shapes.box(4, 2, 1)))
    points = sample_surface(model, 7000, 3)
    assert points.dtype == np.float32
    low, high = model.vertices.min(axis=0), model.vertices.max(axis=0)
    x, y, z = high - low
    for axis, area in enumerate((y * z, x * z, x * y)):
        for end in (low, high):
            side = points[np.abs(points[:, axis] - end[axis]) < 1e-6]
            share = area / (2 * (x * y + y * z + x * z))
            assert len(side) / 7000 == pytest.approx(share, abs=4e-3)
            # Points are uniform within a side, too.
            middle = np.where(np.arange(3) == axis, end, (low + high) / 2)
            np.testing.assert_allclose(side.mean(axis=0), middle, atol=0.04)


def test_holes_of_an_alpha_map_have_no_points_and_glass_has_some():
    texture = np.full((8, 8, 4), 255, np.uint8)
    texture[:4, :, 3] = 0  # the upper half: v > 1/2
    texture[6:, :4, 3] = 10  # nearly clear: lower left
    points = sample_surface(squares((0, 0.5, Material(texture=texture))), 4000, 0)
    assert len(points) == 4000
    assert points[:, 2].max() <= 0.5
    left = points[:, 1] < 0
    assert points[left, 2].min() >= 0.25
    assert left.mean() == pytest.approx(1 / 3, abs=0.03)
    glass = squares((0, 0.5, Material(texture=texture, opacity=0.3)))
    assert len(sample_surface(glass, 100, 0)) == 100
    texture[..., 3] = 0
    with pytest.raises(UnusableModelError):
        sample_surface(squares((0, 0.5, Material(texture=texture))), 100, 0)


def test_surfaces_that_lie_on_one_another_have_one_density():
    # Two squares; the left one lies there twice: as two triangles, and reversed as four.
    vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0], [0.5, 0.5, 0]]
    squares = [[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]]
    again = [[1, 0, 6], [2, 1, 6], [3, 2, 6], [0, 3, 6]]
    model = build_model(np.array(vertices), np.array(squares + again))
    points = sample_surface(model, 20_000, 0)
    left = (points[:, 0] < 1).mean()
    assert left / (1 - left) == pytest.approx(1, abs=0.05)

import numpy as np
import pytest
from helpers.solid_models import joined, model_of, squares

from data_gen.catalogues import solids
from data_gen.frame import normalize
from data_gen.mesh import Material, UnusableModelError, build_model, face_areas
from data_gen.surface import sample_surface


def test_samples_are_uniform_by_area():
    model = normalize(model_of(solids.box(4, 2, 1)))
    sample = sample_surface(model, 7000, 3)
    area = face_areas(model.vertices, model.faces)
    got = np.bincount(sample.face, minlength=len(area)) / 7000
    np.testing.assert_allclose(got, area / area.sum(), atol=2e-3)
    # Points are uniform within faces, too: their centroid is that of the face.
    for face in range(len(area)):
        points = sample.points[sample.face == face]
        np.testing.assert_allclose(points.mean(0), model.corners()[face].mean(0), atol=0.08)
    np.testing.assert_allclose(np.linalg.norm(sample.normals, axis=1), 1, atol=1e-5)
    assert sample.points.dtype == sample.normals.dtype == np.float32


def test_holes_of_an_alpha_map_have_no_points_and_glass_has_some():
    texture = np.full((8, 8, 4), 255, np.uint8)
    texture[:4, :, 3] = 0  # the upper half: v > 1/2
    texture[6:, :4, 3] = 10  # nearly clear: lower left
    sample = sample_surface(squares((0, 0.5, Material(texture=texture))), 4000, 0)
    assert len(sample.points) == 4000
    assert sample.points[:, 2].max() <= 0.5
    left = sample.points[:, 1] < 0
    assert sample.points[left, 2].min() >= 0.25
    assert left.mean() == pytest.approx(1 / 3, abs=0.03)
    glass = squares((0, 0.5, Material(texture=texture, opacity=0.3)))
    assert len(sample_surface(glass, 100, 0).points) == 100
    texture[..., 3] = 0
    with pytest.raises(UnusableModelError, match="almost all"):
        sample_surface(squares((0, 0.5, Material(texture=texture))), 100, 0)


def test_surfaces_that_lie_on_one_another_have_one_density():
    # Two squares; the left one lies there twice: as two triangles, and reversed as four.
    vertices = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [2, 0, 0], [2, 1, 0], [0.5, 0.5, 0]]
    squares = [[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]]
    again = [[1, 0, 6], [2, 1, 6], [3, 2, 6], [0, 3, 6]]
    model = build_model(np.array(vertices), np.array(squares + again))
    sample = sample_surface(model, 20_000, 0)
    left = (sample.points[:, 0] < 1).mean()
    assert left / (1 - left) == pytest.approx(1, abs=0.05)


def test_normals_point_outward_where_the_mesh_can_tell():
    ball = solids.ball(2, 2, 2, 24)
    back = ball.faces[:, ::-1]
    doubled = np.concatenate([back, ball.faces])
    open_below = back[ball.vertices[back][..., 2].max(axis=1) > -0.8]
    for faces in (doubled, back, open_below):
        sample = sample_surface(normalize(build_model(ball.vertices, faces)), 4000, 0)
        outward = sample.points - [0, 0, sample.points[:, 2].max() / 2]
        assert ((outward * sample.normals).sum(axis=1) > 0).mean() > 0.99
    inner, outer = solids.ball(1.4, 1.4, 1.4, 24), solids.ball(2, 2, 2, 24)
    vertices, faces = joined(outer, inner)
    faces[len(outer.faces) :] = faces[len(outer.faces) :, ::-1]
    model = build_model(vertices, faces)
    sample = sample_surface(model, 4000, 0)
    toward = np.where(np.linalg.norm(sample.points, axis=1) > 0.85, 1, -1)
    assert ((sample.points * sample.normals).sum(axis=1) * toward > 0).all()

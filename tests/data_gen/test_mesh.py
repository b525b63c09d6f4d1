import numpy as np
import pytest
from helpers.solid_models import cube, model_of, sphere

from data_gen.mesh import Material, UnusableModelError, build_model, face_normals


def normals_of(shape):
    """The normals of a solid's or a model's faces, for each corner."""
    return np.repeat(face_normals(shape.vertices, shape.faces)[:, None], 3, 1)


def test_build_drops_what_is_no_surface_and_refuses_what_it_cannot_use():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0], [9, 9, 9]], float)
    faces = np.array([[0, 1, 2], [0, 1, 3], [0, 0, 1], [0, 1, 7], [0, 2, -1], [1, 2, 4]])
    materials = [Material(), Material(opacity=0.0)]
    owner = np.array([0, 0, 0, 0, 0, 1])
    model = build_model(vertices, faces, materials=materials, face_material=owner)
    assert len(model.faces) == 1
    assert len(model.vertices) == 3
    assert any(w == "degenerate faces dropped: 2" for w in model.warnings)
    assert any("missing vertices" in w for w in model.warnings)
    for wrong in ((cube().vertices * np.inf, cube().faces), (np.zeros((3, 3)), [[0, 1, 2]])):
        with pytest.raises(UnusableModelError):
            build_model(*wrong)


def test_crease_normals_of_a_cube_are_flat_and_of_a_sphere_round():
    flat = model_of(cube())
    np.testing.assert_allclose(flat.normals, normals_of(flat), atol=1e-6)
    # Apart from the poles, where few faces meet, the normal is the direction from the centre,
    # whether or not faces share vertices.
    soup = sphere().vertices[sphere().faces].reshape(-1, 3)
    for model in (model_of(sphere()), build_model(soup, np.arange(len(soup)).reshape(-1, 3))):
        np.testing.assert_allclose(model.normals, model.corners(), atol=0.02)


def test_normals_are_made_kept_and_decide_which_side_is_outside():
    given = normals_of(cube())
    given[0] = 0
    given[1, 1] = np.nan
    given[2] *= 7
    model = model_of(cube(), normals=given)
    np.testing.assert_allclose(model.normals, normals_of(model), atol=1e-6)
    assert any(w == "corner normals missing or zero, recomputed: 4" for w in model.warnings)
    solid = cube()
    faces = solid.faces.copy()
    faces[3] = faces[3][::-1]
    model = build_model(solid.vertices, faces, normals=normals_of(solid))
    assert ((normals_of(model) * model.normals).sum(axis=2) > 0.99).all()

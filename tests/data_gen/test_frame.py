import dataclasses

import numpy as np
import pytest
from helpers.refusals import refused
from helpers.solid_models import cube, joined, model_of

from data_gen import frame
from data_gen.catalogues import shapes
from data_gen.frame import axis_vector, normalize, orient, outline, recentre
from data_gen.mesh import Material, UnusableModelError, build_model
from data_gen.surface import sample_surface

SHEET = shapes.Solid(
    np.array([[-2, 0, -1], [2, 0, -1], [2, 0, 3], [-2, 0, 3.0]]), np.array([[0, 1, 2], [0, 2, 3]])
)


def with_sheet(texture):
    """A cube and, as the last two faces, a sheet under a texture."""
    vertices, faces = joined(cube(0.5), SHEET)
    uv = np.zeros((14, 3, 2))
    uv[-2:] = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])[SHEET.faces]
    materials = [Material(), Material(texture=texture)]
    owner = np.repeat([0, 1], [12, 2])
    return build_model(vertices, faces, uv=uv, face_material=owner, materials=materials)


@pytest.mark.parametrize(("up", "front"), [("+y", "+z"), ("+z", "-y"), ("-x", "+y"), ("+y", "-z")])
def test_orient_turns_up_to_z_and_front_to_x(up, front):
    model = model_of(cube())
    axes = [axis_vector(up), axis_vector(front), np.cross(axis_vector(up), axis_vector(front))]
    turned = orient(dataclasses.replace(model, vertices=np.stack(axes)), up, front).vertices
    np.testing.assert_allclose(turned, [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-12)


def test_normalize_counts_only_what_is_drawn():
    size = 50, 133
    # A leaf of radius 0.7 on a transparent sheet that is larger and extends below the ground.
    v, u = ((np.arange(n) + 0.5) / n * 2 - 1 for n in size)
    texture = np.full((*size, 4), 255, np.uint8)
    texture[..., 3] = 255 * (u**2 + v[:, None] ** 2 < 0.49)
    texture[: size[0] // 2, : size[1] // 2, 3] = 0  # v > 1/2, u < 1/2
    model = with_sheet(texture)
    exists = texture[..., 3] > 0
    sample = sample_surface(model, 50_000, 0)
    low, high = sample.min(axis=0), sample.max(axis=0)
    origin = np.array([*(low + high)[:2] / 2, low[2]])
    radius = np.linalg.norm(sample - origin, axis=1).max()
    got = normalize(model)
    want = (model.vertices - origin) / radius
    np.testing.assert_allclose(got.vertices, want, atol=0.006)
    # The borders of texels are exact: here the lowest row that exists.
    row = np.flatnonzero(exists.any(axis=1)).max() + 1
    ground = min(3 - 4 * row / size[0], -0.25)
    assert got.vertices[-4, 2] * radius == pytest.approx(-1 - ground, abs=0.01)


def test_holes_that_are_too_fine_take_bounded_memory(monkeypatch):
    monkeypatch.setattr(frame, "_MOST_DIVIDED", 100)
    texture = np.zeros((64, 64, 4), np.uint8)
    texture[0, 0] = 255
    model = with_sheet(texture)
    sizes = []

    def measure(points):
        sizes.append(len(points))
        return points

    outline(dataclasses.replace(model, uv=3e4 * model.uv), measure)
    assert max(sizes) <= 3 * 4 * 100
    assert sum(sizes) > 3 * 100


def test_normalize_refuses_what_overflows_and_strays_by_name():
    with pytest.raises(UnusableModelError):
        normalize(dataclasses.replace(model_of(cube()), vertices=cube().vertices * 1e200))
    far = shapes.ball(0.1, 0.1, 0.1, 8).at(0, 20, 0.5)
    vertices, faces = joined(cube(), far)
    owner = (np.arange(len(faces)) >= 12).astype(int)
    materials = [Material(name="paint"), Material(name="marker")]
    model = build_model(vertices, faces, face_material=owner, materials=materials)
    with refused(UnusableModelError, "stray part", "marker", "20, 0.5"):
        normalize(model)
    # Two parts with a gap of half the extent are accepted.
    pair = joined(cube(), cube().at(2.5, 0, 0))
    assert len(normalize(build_model(*pair)).faces) == 24


def test_recentre_brings_the_mean_of_the_vertices_over_the_origin():
    # A cube next to a ball of the same size with many vertices.
    model = normalize(build_model(*joined(cube(), shapes.ball(1, 1, 1).at(2.5, 0, 0))))
    moved = recentre(model, "vertices")
    used = np.unique(moved.vertices[np.unique(moved.faces)], axis=0)
    np.testing.assert_allclose(used[:, :2].mean(axis=0), 0, atol=1e-12)
    assert used[:, 2].min() == pytest.approx(0, abs=1e-12)
    assert np.linalg.norm(used, axis=1).max() == pytest.approx(1)
    assert recentre(model, "bounds") is model

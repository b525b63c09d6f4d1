import numpy as np

from data_gen import scene, shading
from data_gen.lights import Lights
from data_gen.mesh import Material, build_model


def surfaces_of(material, uv=None):
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float)
    model = build_model(corners, np.array([[0, 1, 2]]), materials=[material], uv=uv)
    return scene.flatten(model)


def one_light(direction, **options):
    values = {
        "directions": np.array([direction], np.float32),
        "colours": np.full((1, 3), 0.8, np.float32),
        "sky": np.full(3, 0.1, np.float32),
        "ground": np.full(3, 0.05, np.float32),
        "specular": 1.0,
        "darkest": 0.0,
    }
    return Lights(**{**values, **options})


def shade(surfaces, light, normal, view, colour):
    row = np.zeros(1, np.int64)
    return shading.blinn_phong(
        surfaces, light, row, np.array([colour], np.float32), np.array([normal], np.float32),
        np.array([view], np.float32),
    )[0]  # fmt: skip


def test_blinn_phong_by_hand():
    surfaces = surfaces_of(Material(diffuse=(0.5,) * 3, specular=(0.3,) * 3, shininess=7.0))
    toward, view = np.array([0.6, 0, 0.8]), np.array([0, 0, 1.0])
    half = (toward + view) / np.linalg.norm(toward + view)
    want = 0.5 * (0.1 + 0.8 * 0.8) + 0.3 * 0.8 * half[2] ** 7
    got = shade(surfaces, one_light(toward), [0, 0, 1], view, [0.5] * 3)
    np.testing.assert_allclose(got, want, rtol=1e-5)
    # A surface that faces away from the light has only the ground's ambient light.
    got = shade(surfaces, one_light(toward), [0, 0, -1], -view, [0.5] * 3)
    np.testing.assert_allclose(got, 0.5 * 0.05, rtol=1e-5)


def test_black_is_lifted_and_white_clipped():
    surfaces = surfaces_of(Material())
    light = one_light([0, 0, 1.0], darkest=0.03)
    assert (shade(surfaces, light, [0, 0, 1], [0, 0, 1], [0] * 3) > 0.02).all()
    bright = one_light([0, 0, 1.0], colours=np.full((1, 3), 9, np.float32))
    np.testing.assert_array_equal(shade(surfaces, bright, [0, 0, 1], [0, 0, 1], [1] * 3), 1)


def test_textures_are_read_as_points_are():
    texture = np.zeros((2, 2, 4), np.uint8)
    texture[0, 0], texture[1, 1] = (255, 0, 0, 255), (0, 255, 0, 20)
    uv = np.array([[[0, 1], [1.2, 0.6], [0.4, -0.2]]], float) * 0.9 + 0.05
    surfaces = surfaces_of(Material(diffuse=(1, 1, 1), texture=texture), uv)
    weights = np.array([[0.9, 0.05, 0.05], [0.1, 0.45, 0.45]], np.float32)
    colour, opacity = shading.look_up(surfaces, np.zeros(2, np.int64), weights)
    np.testing.assert_allclose(colour[0], [1, 0, 0])
    np.testing.assert_allclose(opacity, [1, 0])  # an opacity under a tenth is a hole


def test_normals_face_the_viewer():
    surfaces = surfaces_of(Material())
    weights = np.full((2, 3), 1 / 3, np.float32)
    rays = np.array([[0, 0, -1], [0, 0, 1]], np.float32)
    normal = shading.shading_normals(surfaces, np.zeros(2, np.int64), weights, np.eye(3), rays)
    np.testing.assert_allclose(normal, -rays, atol=1e-6)

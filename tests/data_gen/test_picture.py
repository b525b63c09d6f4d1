import numpy as np

from data_gen import picture
from data_gen.lights import Lights
from data_gen.mesh import Material, build_model


def shade(material, normal, view, colour, *, light=0.8, darkest=0.0):
    """A surface of a colour under one light."""
    lights = Lights(
        directions=np.array([[0.6, 0, 0.8]], np.float32),
        colours=np.full((1, 3), light, np.float32),
        sky=np.full(3, 0.1, np.float32), ground=np.full(3, 0.05, np.float32),
        specular=1.0, darkest=darkest,
    )  # fmt: skip
    values = (np.full((1, 3), colour), np.array([normal]), np.array([view]))
    row = np.zeros(1, np.int64)
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float)
    arrays = picture.flatten(build_model(corners, np.array([[0, 1, 2]]), materials=[material]))
    return picture.blinn_phong(arrays, lights, row, *(v.astype(np.float32) for v in values))[0]


def test_blinn_phong_by_hand():
    material = Material(diffuse=(0.5,) * 3, specular=(0.3,) * 3, shininess=7.0)
    half = np.array([0.6, 0, 1.8]) / np.linalg.norm([0.6, 0, 1.8])
    want = 0.5 * (0.1 + 0.8 * 0.8) + 0.3 * 0.8 * half[2] ** 7
    np.testing.assert_allclose(shade(material, [0, 0, 1], [0, 0, 1], 0.5), want, rtol=1e-5)
    # A surface that faces away from the light has only the ground's ambient light.
    away = shade(material, [0, 0, -1], [0, 0, -1], 0.5)
    np.testing.assert_allclose(away, 0.5 * 0.05, rtol=1e-5)
    # Black is lifted and white clipped.
    assert (shade(Material(), [0, 0, 1], [0, 0, 1], 0.0, darkest=0.03) > 0.02).all()
    assert (shade(Material(), [0, 0, 1], [0, 0, 1], 1.0, light=9) == 1).all()

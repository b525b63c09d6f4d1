import numpy as np

from data_gen import lights
from data_gen.lights import LightSettings


def test_one_lamp_is_found_where_it_is():
    radiance = np.full((*lights.MAP_SIZE, 3), 0.01)
    toward = lights.directions_of(lights.MAP_SIZE)
    radiance[8, 20] = 100
    found = lights.reduce(radiance, LightSettings(count=1), ambient=0.3, exposure=1.0)
    assert found.directions[0] @ toward[8, 20] > 0.99
    black = lights.reduce(0 * radiance, LightSettings(), ambient=0.3, exposure=1.0)
    assert 0 < black.colours.max() < np.inf
    assert not lights.shrink(np.full((10, 20, 3), np.nan)).any()  # enlarged, and black


def test_exposure_is_the_brightness_of_white_in_full_light(rng):
    normals = lights.directions_of(lights.MAP_SIZE).reshape(-1, 3)
    normals = normals[(normals[:, 0] > -0.2) & (normals[:, 2] > -0.3)]
    for _ in range(3):
        radiance = lights.procedural_sky(rng)
        found = lights.reduce(radiance, LightSettings(), ambient=0.3, exposure=1.2)
        direct = np.clip(normals @ found.directions.T, 0, None) @ found.colours
        np.testing.assert_allclose(direct.mean(axis=1).max(), 1.2 * 0.7, rtol=1e-3)
        np.testing.assert_allclose(found.sky.mean(), 1.2 * 0.3, rtol=1e-3)
        assert (found.ground > 0).all()

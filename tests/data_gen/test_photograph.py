import dataclasses
import json

import numpy as np
import pytest
from helpers.solid_models import model_of, view

from data_gen import cameras, config, lights, settings, surroundings
from data_gen.catalogues import shapes
from data_gen.catalogues.entry import Entry
from data_gen.engine import Variant
from data_gen.mesh import Material
from data_gen.photograph import develop, trace
from data_gen.picture import Mesh, Scene, render
from data_gen.render_model import Context
from data_gen.settings import FilmSettings
from data_gen.surroundings import Surroundings
from psgn_jax.config import structured
from psgn_jax.data import camera as project_camera
from psgn_jax.data.codec import decode


def photo_settings(**changes):
    values = structured.to_dict(settings.parse(config.get_config("photo")))
    values |= {"views": 1, "num_points": 3000, "models_per_shard": 2}
    values["camera"]["image_size"] = (48, 64)
    values["image"]["rays"] = 4
    values["checks"] |= {"depth": 0.1, "inside": 0.8}
    for section, fields in changes.items():
        values[section] |= fields
    return settings.parse(values)


def test_mixed_light_takes_from_all_sources(started):
    maps = np.ones((1, *lights.DETAIL, 3), np.float32)
    chosen = lights.LightSettings(source="mixed", folder="given")
    camera = cameras.draw(np.random.default_rng(0), cameras.CameraSettings(), np.eye(3))
    toward = lights.directions_of((64, 128)).reshape(-1, 3)
    weight = lights.solid_angles((64, 128)).ravel() * np.maximum(toward[:, 2], 0)

    def drawn(seed, maps):
        return surroundings.draw(np.random.default_rng(seed), chosen, maps, camera, detail=True)

    kinds = set()
    for seed in range(10):
        around = drawn(seed, maps)
        kinds.add(around.kind)
        assert around.radiance.min() >= 0
        if around.kind in ("room", "studio"):  # without a lamp, objects have hardly any shadow
            light = lights.shrink(around.radiance, (64, 128)).mean(axis=-1).ravel() * weight
            near = toward @ toward[light.argsort()[-20:]].T > np.cos(np.deg2rad(15))
            assert (light @ near).max() > 0.35 * light.sum()
    assert kinds == {"room", "studio", "outdoors", "map"}
    assert "map" not in {drawn(seed, None).kind for seed in range(4)}


def test_contact_shadow_of_a_black_box(started):
    solid = shapes.box(0.8, 0.8, 0.8).at(z=0.4)
    mesh = Mesh(model_of(solid, materials=[Material(diffuse=(0, 0, 0))]))
    camera = view(elevation=40, distance=6, aim=0.2)
    around = Surroundings(np.ones((64, 128, 3)))
    light = lights.draw(np.random.default_rng(0), lights.LightSettings(), around.radiance)
    shown = Scene(mesh, camera, light)
    picture = render(shown)
    texture = np.full((4, 4, 3), 0.5, np.float32)
    ground = surroundings.Ground(texture, 1.0, 0.0, np.array([[-90.0, 0], [90, 0]]), 90.0, 30.0)
    radiance, opacity = trace(shown, picture, around, ground, rays=64, seed=0)
    assert (opacity > 0.99).all()
    places = np.array([[0.5, 0, 0], [0.8, 0, 0], [0, 1.5, 0]])
    columns, rows = cameras.project(places, camera)[0].T.astype(int)
    foot, near, far = radiance[rows, columns].mean(axis=-1) / 0.5
    # Near the foot of a wall, up to half of the sky is hidden; the wall is finite.
    assert 0.5 < foot < 0.8
    assert foot < near < far
    assert far == pytest.approx(1, abs=0.12)


def test_film_follows_its_settings(rng):
    light, weight = rng.uniform(0, 1, (24, 32, 3)).astype(np.float32) ** 2, np.ones((24, 32))
    still = FilmSettings(exposure=(0, 0), grain=(0, 0), vignette=(0, 0), blur=(0, 0))

    def take(**changes):
        film = dataclasses.replace(still, **changes)
        return develop(light, weight, film, np.random.default_rng(1), illuminant=np.ones(3))

    assert take(exposure=(-1.0, -1.0)).mean() < take().mean() - 10
    assert take(blur=(1.5, 1.5)).std() < 0.7 * take().std()
    assert take(vignette=(1.0, 1.0))[0, 0].mean() < take()[0, 0].mean()


def load_box():
    texture = np.full((8, 8, 4), 255, np.uint8)
    texture[::2, :, :3] = 60
    material = Material((0.8, 0.3, 0.1), specular=(0.4,) * 3, shininess=60.0, texture=texture)
    uv = np.tile(np.array([[0, 0], [1, 0], [0, 1]], float), (12, 1, 1))
    return model_of(shapes.box(0.8, 0.8, 0.8).at(z=0.4), materials=[material], uv=uv)


@pytest.mark.parametrize("elevation", [-20.0, 60.0])
def test_ground_and_surroundings_are_in_the_image_alone(here, elevation):
    def samples_of(chosen):
        context = Context(chosen, "test", Variant("scalar_rgb"), None)
        (result,) = here([(0, Entry("box", "", "train", load_box))], context)
        return result.records["train"]

    height = {"elevation": (elevation, elevation)}
    data = samples_of(photo_settings(camera=height))
    assert elevation < 0 or samples_of(photo_settings(camera=height)) == data
    plain = {"shading": "local", "background": "grey", "ground": "none", "rays": 16}
    without = photo_settings(camera=height, image=plain)
    for sample, other in zip(map(decode, data), map(decode, samples_of(without)), strict=True):
        for name in ("mask", "depth", "points", "intrinsics", "extrinsics"):
            np.testing.assert_array_equal(getattr(sample, name), getattr(other, name))
        assert json.loads(sample.extra) == json.loads(other.extra)
        outside = sample.image[~sample.mask]
        assert np.abs(outside.astype(int) - 191).mean() > 5
        assert outside.std() > 1
        # Camera and mask agree, also with roll and with the object off centre.
        pixels, _ = project_camera.project(sample.points, sample.intrinsics, sample.extrinsics)
        assert project_camera.inside_mask(pixels, sample.mask, 1).mean() > 0.99

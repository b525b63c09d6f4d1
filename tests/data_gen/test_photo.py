"""Pictures that look like photographs; rendered in scalar mode, skipped without Mitsuba."""

import dataclasses
import json

import numpy as np
import pytest
import scipy.spatial
from helpers.solid_models import model_of

from data_gen import config, engine, grounds, lights, scene, settings, surroundings
from data_gen.catalogues import solids
from data_gen.catalogues.entry import Entry
from data_gen.engine import Variant, has_mitsuba
from data_gen.environment_maps import NUM_SUNSKY
from data_gen.mesh import Material
from data_gen.photo import Light, develop
from data_gen.picture import Mesh
from data_gen.render_model import Context, render_model
from data_gen.scene import RayHits
from data_gen.settings import FilmSettings
from data_gen.surroundings import Surroundings
from psgn_jax.config import structured
from psgn_jax.data import camera as project_camera
from psgn_jax.data.codec import decode

needs_mitsuba = pytest.mark.skipif(not has_mitsuba(), reason="Mitsuba is not installed")


def photo_settings(**changes):
    values = structured.to_dict(settings.parse(config.get_config("photo")))
    values |= {"views": 1, "num_points": 3000, "models_per_shard": 2}
    values["camera"]["image_size"] = (48, 64)
    values["checks"] |= {"depth": 0.1, "inside": 0.8}
    for section, fields in changes.items():
        values[section] |= fields
    return settings.parse(values)


@pytest.mark.parametrize("kind", grounds.KINDS)
def test_grounds_are_reflectances_and_smooth_out(kind):
    ground = grounds.draw(np.random.default_rng(3), kind, Surroundings(np.ones((8, 16, 3))))
    again = grounds.draw(np.random.default_rng(3), kind, Surroundings(np.ones((8, 16, 3))))
    np.testing.assert_array_equal(ground.levels[0], again.levels[0])
    places = np.random.default_rng(0).uniform(-20, 20, (400, 2)).astype(np.float32)
    fine = ground.colour(places, np.full(400, 1e-3, np.float32))
    assert (fine >= 0).all()
    assert (fine <= 1).all()
    coarse = ground.colour(places, np.full(400, 1e3, np.float32))
    np.testing.assert_allclose(coarse, np.broadcast_to(ground.mean, coarse.shape), rtol=1e-4)
    assert coarse.std(axis=0).max() <= fine.std(axis=0).max()


@pytest.mark.parametrize("make", [surroundings.room, surroundings.studio, surroundings.outdoors])
def test_surroundings_are_light_of_which_one_lamp_gives_a_large_share(make):
    toward = lights.directions_of((64, 128)).reshape(-1, 3)
    weight = lights.solid_angles((64, 128)).ravel() * np.maximum(toward[:, 2], 0)
    for seed in range(3):
        found = make(np.random.default_rng(seed))
        assert found.radiance.shape == (*lights.DETAIL, 3)
        assert np.isfinite(found.radiance).all()
        assert found.radiance.min() >= 0
        assert found.radiance.max() > 0.1
        if make is not surroundings.outdoors:  # without a lamp, objects have hardly any shadow
            light = lights.shrink(found.radiance, (64, 128)).mean(axis=-1).ravel() * weight
            near = toward @ toward[light.argsort()[-20:]].T > np.cos(np.deg2rad(15))
            assert (light @ near).max() > 0.35 * light.sum()
    np.testing.assert_array_equal(found.radiance, make(np.random.default_rng(2)).radiance)


def test_mixed_light_takes_from_all_sources():
    maps = np.ones((NUM_SUNSKY + 1, *lights.DETAIL, 3), np.float32)
    chosen = lights.LightSettings(source="mixed", folder="given")

    def kinds(maps):
        seeds = map(np.random.default_rng, (0, 2, 4, 5))
        return {surroundings.draw(rng, chosen, maps)[1].kind for rng in seeds}

    assert kinds(maps) == {"room", "studio", "outdoors", "map"}
    assert "map" not in kinds(maps[:-1])


def box(half=0.4, height=0.8, colour=(0, 0, 0)):
    solid = solids.box(2 * half, 2 * half, height).at(z=height / 2)
    return scene.flatten(model_of(solid, materials=[Material(diffuse=colour)]))


def nowhere(origins, directions):
    count = len(origins)
    return RayHits(
        np.full(count, -1), np.zeros((count, 3), np.float32), np.full(count, np.inf, np.float32)
    )


def light_of(around, ground=None, cast=nowhere, rays=16):
    return Light(around, ground, box(), np.eye(3), cast, rays=rays, rng=np.random.default_rng(0))


def plain_ground(colour=0.5):
    level = np.full((1, 1, 3), colour, np.float32)
    return grounds.Ground((level,), 1.0, 0.0, (float("inf"),) * 2, 0.0)


def test_a_lamp_lights_by_the_cosine():
    toward = lights.directions_of((64, 128))
    lamp = np.array([0.6, 0, 0.8])
    radiance = 50.0 * (toward @ lamp > 0.99)[..., None].repeat(3, -1)
    light = light_of(Surroundings(radiance))
    normals = np.repeat(np.array([[0.6, 0, 0.8], [0, 0, 1], [-0.6, 0, -0.8]], np.float32), 64, 0)
    got = light.gather(np.zeros((192, 3), np.float32) + 5, normals, np.arange(192) % 16)
    means = got.reshape(3, 64, 3).mean(axis=(1, 2))
    assert means[0] == pytest.approx(50 * 2 * np.pi * 0.01 / np.pi, rel=0.1)
    assert means[1] / means[0] == pytest.approx(0.8, abs=0.04)
    assert means[2] == 0


@needs_mitsuba
def test_contact_shadow_of_a_black_box():
    engine.start("scalar_rgb")
    surfaces = box()
    light = Light(
        Surroundings(np.ones((64, 128, 3))), plain_ground(), surfaces, np.eye(3),
        Mesh(surfaces.corners).cast, rays=16, rng=np.random.default_rng(0),
    )  # fmt: skip
    places = np.array([[0.405, 0, 0], [0.8, 0, 0], [3.5, 0, 0]], np.float32).repeat(64, 0)
    up = np.tile(np.array([0, 0, 1], np.float32), (192, 1))
    lit = (
        light.gather(places, up, np.arange(192) % 16, far=True).reshape(3, 64, 3).mean(axis=(1, 2))
    )
    # At the foot of a wall, about half of the sky is hidden; the wall is finite.
    assert 0.48 < lit[0] < 0.65
    assert lit[0] < lit[1] < lit[2]
    assert lit[2] == pytest.approx(1, abs=0.04)
    # A surface that faces down gets the light of the ground.
    down = light.in_the_open(np.array([[0, 0, -1.0]], np.float32))
    assert down.mean() == pytest.approx(0.5 * 0.8, abs=0.05)


def test_film_is_repeatable_and_follows_its_settings():
    rng = np.random.default_rng(0)
    light = rng.uniform(0, 1, (24, 32, 3)).astype(np.float32) ** 2
    weight = np.ones((24, 32))
    still = FilmSettings(exposure=(0, 0), grain=(0, 0), vignette=(0, 0), blur=(0, 0))

    def take(chosen, seed=1):
        return develop(light, weight, chosen, np.random.default_rng(seed), illuminant=np.ones(3))

    np.testing.assert_array_equal(take(FilmSettings()), take(FilmSettings()))
    dark = dataclasses.replace(still, exposure=(-1.0, -1.0))
    assert take(dark).mean() < take(still).mean() - 10
    blurred = dataclasses.replace(still, blur=(1.5, 1.5))
    assert take(blurred).std() < 0.7 * take(still).std()
    corners = take(dataclasses.replace(still, vignette=(1.0, 1.0)))[0, 0].mean()
    assert corners < take(still)[0, 0].mean()


def load_box():
    texture = np.full((8, 8, 4), 255, np.uint8)
    texture[::2, :, :3] = 60
    material = Material((0.8, 0.3, 0.1), specular=(0.4,) * 3, shininess=60.0, texture=texture)
    uv = np.tile(np.array([[0, 0], [1, 0], [0, 1]], float), (12, 1, 1))
    return model_of(solids.box(0.8, 0.8, 0.8).at(z=0.4), materials=[material], uv=uv)


def samples_of(chosen):
    engine.start("scalar_rgb")
    entry = Entry("box", "", "train", load_box)
    context = Context(chosen, "test", Variant("scalar_rgb"), None)
    data, line = render_model(entry, context)
    assert line["status"] == "ok", line["reason"]
    return data


@needs_mitsuba
@pytest.mark.parametrize("elevation", [-20.0, 0.0, 60.0])
def test_ground_and_surroundings_are_in_the_image_alone(elevation):
    height = {"elevation": (elevation, elevation)}
    data = samples_of(photo_settings(camera=height))
    assert elevation or samples_of(photo_settings(camera=height)) == data
    without = photo_settings(
        camera=height,
        image={"shading": "local", "background": "grey", "ground": "none", "soft_edges": False},
    )
    for one, two in zip(data, samples_of(without), strict=True):
        sample, other = decode(one), decode(two)
        for name in ("mask", "depth", "points", "normals", "intrinsics", "extrinsics"):
            np.testing.assert_array_equal(getattr(sample, name), getattr(other, name))
        assert json.loads(sample.extra) == json.loads(other.extra)
        outside = sample.image[~sample.mask]
        assert np.abs(outside.astype(int) - 191).mean() > 5
        assert outside.std() > 1
        # Camera, mask and depth agree, also with roll and with the object off centre.
        pixels, _ = project_camera.project(sample.points, sample.intrinsics, sample.extrinsics)
        assert project_camera.inside_mask(pixels, sample.mask, 1).mean() > 0.99
        seen = project_camera.back_project(sample.depth, sample.intrinsics, sample.extrinsics)
        assert np.median(scipy.spatial.cKDTree(sample.points).query(seen)[0]) < 0.02

import dataclasses

import numpy as np
import pytest
from helpers.refusals import refused
from helpers.solid_models import view

from data_gen import cameras
from data_gen.cameras import CameraSettings
from data_gen.mesh import UnusableModelError
from psgn_jax.data import camera as project_camera


def hemisphere(rng, n=2000):
    points = rng.normal(size=(n, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    points[:, 2] = np.abs(points[:, 2])
    return points


def test_default_is_the_authors_camera(rng):
    drawn = cameras.draw(rng, CameraSettings(), hemisphere(rng))
    intrinsics, extrinsics = project_camera.default_camera()
    np.testing.assert_allclose(drawn.intrinsics, intrinsics)
    np.testing.assert_allclose(drawn.extrinsics, extrinsics, atol=1e-5)
    assert drawn.distance == 3.6


def test_azimuth_turns_the_object_toward_the_camera():
    made = view(30.0, size=(192, 256))
    toward = np.array([np.cos(np.deg2rad(30)), np.sin(np.deg2rad(30)), 0])
    np.testing.assert_allclose(made.rotation @ toward, [1, 0, 0], atol=1e-12)
    # In the view-aligned frame, the camera is in the plane y = 0.
    assert made.position[0] > 3
    assert made.position[1] == pytest.approx(0)
    # +y is to the image's right, +z up in the image.
    pixels, z = cameras.project(np.array([[0, 0, 0.3], [0, 0.1, 0.3], [0, 0, 0.4]]), made)
    assert pixels[1, 0] > pixels[0, 0]
    assert pixels[2, 1] < pixels[0, 1]
    assert (z > 0).all()


def test_the_camera_moves_back_until_the_object_fits(rng):
    points = hemisphere(rng)
    near = CameraSettings(image_size=(96, 96), distance=(1.2, 1.2), focal=(900, 900))
    drawn = cameras.draw(rng, dataclasses.replace(near, elevation=(0, 50), roll=(-45, 45)), points)
    assert drawn.distance > 5
    assert cameras.in_frame(points @ drawn.rotation.T, drawn).all()
    with refused(UnusableModelError, "camera.focal"):
        cameras.draw(rng, dataclasses.replace(near, focal=(1e5, 1e5)), points)


def test_size_in_the_image_is_kept_whatever_the_focal_length(rng):
    points = 0.7 * hemisphere(rng)
    extents = []
    for focal in (300.0, 900.0):
        chosen = CameraSettings(focal=(focal, focal), distance=(4, 4), keep_size=True)
        drawn = cameras.draw(np.random.default_rng(1), chosen, points)
        pixels, _ = cameras.project(points @ drawn.rotation.T, drawn)
        extents.append(np.ptp(pixels, axis=0))
        assert drawn.distance == pytest.approx(focal / 100)
    np.testing.assert_allclose(extents[0], extents[1], rtol=0.15)


def test_off_centre_moves_the_object_and_cuts_nothing_off(rng):
    points = 0.7 * hemisphere(rng)
    ranges = {"distance": (5, 5), "roll": (-20, 20), "aim": (0.3, 0.3), "elevation": (-5, 60)}
    chosen = CameraSettings(off_centre=1.0, **ranges)
    middles = []
    for seed in range(15):
        drawn = cameras.draw(np.random.default_rng(seed), chosen, points)
        turned = points @ drawn.rotation.T
        assert cameras.in_frame(turned, drawn).all()
        turn = drawn.extrinsics[:, :3]
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        middles.append(cameras.project(turned, drawn)[0].mean(axis=0))
        # The position of the camera is the same; only its direction changes.
        centred = dataclasses.replace(chosen, off_centre=0.0)
        still = cameras.draw(np.random.default_rng(seed), centred, points)
        np.testing.assert_allclose(drawn.position, still.position, atol=1e-9)
    assert (np.ptp(middles, axis=0) > [80, 40]).all()

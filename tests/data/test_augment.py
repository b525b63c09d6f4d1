import dataclasses

import numpy as np
import pytest
from helpers import drawn_solids as solids
from scipy.spatial.transform import Rotation

from psgn_jax.config.data import DataConfig, PhotoEffects
from psgn_jax.data import augment, camera, framing, schema

SIZE = 96, 128


def rolled(view):
    """A view by a camera in general position (its image is not redrawn)."""
    roll = Rotation.from_euler("z", 30, degrees=True).as_matrix()
    extrinsics = (roll @ view.extrinsics).astype(np.float32)
    extrinsics[:, 3] += np.float32([0.1, 0.2, 0])
    intrinsics = view.intrinsics.copy()
    intrinsics[0, 1], intrinsics[0, 2] = 2.0, 50.0
    return dataclasses.replace(view, intrinsics=intrinsics, extrinsics=extrinsics)


def assert_consistent(view):
    schema.check_camera(view.intrinsics, view.extrinsics)
    pixels, _ = camera.project(view.points, view.intrinsics, view.extrinsics)
    width = view.mask.shape[1]
    shown = (pixels[:, 0] > 0) & (pixels[:, 0] < width)
    assert camera.inside_mask(pixels, view.mask).mean() > 0.9
    assert camera.inside_mask(pixels, view.mask, 1)[shown].all()
    # Conversely, every pixel of the mask is near a point.
    rows, columns = np.nonzero(view.mask)
    centres = np.stack([columns, rows], 1)[::37] + 0.5
    gaps = np.linalg.norm(centres[:, None] - pixels, axis=2).min(axis=1)
    assert gaps.max() < 6
    surface = camera.back_project(view.depth, view.intrinsics, view.extrinsics)[::53]
    nearest = np.linalg.norm(surface[:, None] - view.points, axis=2).min(axis=1)
    assert np.median(nearest) < 0.03
    assert ((view.image != schema.BACKGROUND_GREY).any(2) <= view.mask).mean() > 0.98


def augmented(view, seed, **settings):
    return augment.augment(view, DataConfig(**settings), np.random.default_rng(seed), [seed])


@pytest.mark.parametrize(
    "change",
    [
        augment.flip,
        lambda view: augment.stretch(view, 0.7),
        lambda view: augment.stretch(augment.flip(view), 1.2),
        lambda view: augment.recrop(view, 0.8, (0, 0)),
        lambda view: augment.recrop(view, 1.0, (1, -8.5)),
        lambda view: augment.recrop(view, 0.93, (2.3, -3.1)),
        lambda view: augment.recrop(view, 1.0, (500, -500)),  # the object stays in the image
        lambda view: augment.recrop(view, 9.0, (3, 3)),
        lambda view: augment.recrop(view, 0.5, (-90, 90)),
        lambda view: augmented(
            view, 1, flip=True, stretch=0.2, zoom=0.05, shift=0.04, colour_jitter=0.2
        ),
    ],
)
def test_image_depth_points_and_camera_stay_consistent_and_holes_stay(change):
    assert_consistent(change(solids.view_of("cone", SIZE, seed=2)))
    view = solids.view_of("ellipsoid", SIZE)
    depth = view.depth.copy()
    rows, columns = np.nonzero(view.mask)
    depth[rows.mean().astype(int) :, : columns.mean().astype(int)] = 0
    changed = change(dataclasses.replace(view, depth=depth))
    measured = changed.depth > 0
    assert not (measured & ~changed.mask).any()
    # There are no new depth values, and the hole is about the same fraction of the object.
    assert set(changed.depth[measured]) <= set(depth[depth > 0])
    share, before = measured.sum() / changed.mask.sum(), (depth > 0).sum() / view.mask.sum()
    assert share == pytest.approx(before, abs=0.03)
    # The measured depths lie on the surface that the points sample.
    surface = camera.back_project(changed.depth, changed.intrinsics, changed.extrinsics)
    nearest = np.linalg.norm(surface[::7, None] - changed.points, axis=2).min(axis=1)
    assert np.median(nearest) < 0.02
    # The distance of the origin, which the network's depth channel is relative to, is the same.
    assert changed.extrinsics[2, 3] == view.extrinsics[2, 3]


def test_flip_and_recrop_change_the_projection_of_any_camera_as_they_say():
    view = rolled(solids.view_of("box", SIZE))
    before, depth = camera.project(view.points, view.intrinsics, view.extrinsics)
    factor, middle = 0.8, np.array([128, 96]) / 2
    for changed, want in (
        (augment.flip(view), before * [-1, 1] + [128, 0]),
        (augment.recrop(view, factor, (1, -3)), middle + factor * (before - middle) + [-3, 1]),
    ):
        schema.check_camera(changed.intrinsics, changed.extrinsics)
        after, depth_after = camera.project(changed.points, changed.intrinsics, changed.extrinsics)
        np.testing.assert_allclose(after, want, atol=1e-3)
        np.testing.assert_allclose(depth_after, depth, rtol=1e-5)
    np.testing.assert_array_equal(augment.stretch(view, 1.0).image, view.image)


def test_samples_of_rolled_cameras_are_not_stretched():
    view = rolled(solids.view_of("box", SIZE))
    assert augmented(view, 0, stretch=0.3) is view
    others = {"flip": True, "colour_jitter": 0.3, "zoom": 0.1, "shift": 0.1}
    one, two = augmented(view, 1, stretch=0.3, **others), augmented(view, 1, **others)
    np.testing.assert_array_equal(one.image, two.image)


def test_jitter_stays_on_the_object_and_effects_follow_the_configuration():
    view = solids.view_of("ellipsoid", SIZE)
    jittered = augment.colour_jitter(view, np.random.default_rng(1), 0.4)
    assert (jittered.image[~view.mask] == schema.BACKGROUND_GREY).all()
    assert (jittered.image[view.mask] != view.image[view.mask]).any()
    view = dataclasses.replace(solids.view_of("box", SIZE), depth=None)
    placed = augmented(view, 0, place=1.0)
    assert framing.rule_move_within(placed.mask).scale == pytest.approx(1, abs=0.05)
    noisy = augmented(view, 0, photo=PhotoEffects(noise=0.1))
    assert noisy.points is view.points
    assert (noisy.image != view.image).any()
    assert augmented(view, 0) is view

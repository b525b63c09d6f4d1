import dataclasses

import numpy as np
import pytest
from helpers import drawn_solids as solids

from psgn_jax.config.data import DataConfig
from psgn_jax.data import augment, camera, framing
from psgn_jax.data.resample import box_of


@pytest.mark.parametrize("numbers", [(0.88, 0, 0), (1, 14, 0), (0.9, -11, 14), (1.1, 8, 5)])
@pytest.mark.parametrize(("category", "size"), [("box", (192, 256)), ("cone", (96, 128))])
def test_points_stay_on_the_object(category, size, numbers):
    view = solids.view_of(category, size, seed=1)
    scale, *shift = numbers  # about the middle; in pixels of 192x256
    shift = (1 - scale) * np.array(size[::-1]) / 2 + np.array(shift) * size[0] / 192
    move = framing.Move(scale, *shift)
    moved = augment.follow(view, framing.keep_inside(move, view.mask))
    np.testing.assert_array_equal(moved.intrinsics, view.intrinsics)
    np.testing.assert_array_equal(moved.extrinsics, view.extrinsics)
    pixels, _ = camera.project(moved.points, moved.intrinsics, moved.extrinsics)
    assert camera.inside_mask(pixels, moved.mask, 1).mean() > 0.9
    # For these objects, the error of the move that `framing` states is at most 3.6 pixels.
    assert camera.inside_mask(pixels, moved.mask, 3).mean() > 0.999
    assert camera.inside_mask(pixels, moved.mask, 4).all()
    assert moved.mask.sum() == pytest.approx(scale**2 * view.mask.sum(), rel=0.05)
    # The depth map is moved too: its surface is near the moved points.
    surface = camera.back_project(moved.depth, moved.intrinsics, moved.extrinsics)[::97]
    nearest = np.linalg.norm(surface[:, None] - moved.points, axis=2).min(axis=1)
    assert np.median(nearest) < 0.03


@pytest.mark.parametrize("size", [(192, 256), (48, 64)])
def test_a_sample_is_placed_as_a_photo_is(size):
    view = solids.view_of("cylinder", size)
    placed = augment.place(view)
    want = framing.place(view.image, view.mask)
    pixel = 192 / size[0]
    box = np.array(box_of(placed.mask)) * pixel
    np.testing.assert_allclose(box, box_of(want.mask), atol=1.01 * pixel)
    if size == (192, 256):
        np.testing.assert_array_equal(placed.image, want.image)
        np.testing.assert_array_equal(placed.mask, want.mask)
    again = framing.rule_move_within(placed.mask)
    assert again.scale == pytest.approx(1, abs=4 / size[0])


def test_moves_keep_the_object_inside_and_tiny_objects_are_not_placed():
    mask = np.zeros((96, 128), bool)
    mask[20:60, 30:90] = True
    for move in (framing.Move(1, 90, 0), framing.Move(3, 0, 0), framing.Move(0.7, -50, 60)):
        corners = framing.keep_inside(move, mask).matrix() @ [[30, 90], [20, 60], [1, 1]]
        assert corners[:2].min() >= -1e-9
        assert (corners[:2].max(axis=1) <= [128 + 1e-9, 96 + 1e-9]).all()
    small = np.zeros((96, 128), bool)
    small[3:6, 3:6] = True
    assert framing.rule_move_within(small) is None
    sliver = np.zeros((96, 128), bool)
    sliver[66:71, 34:49] = True  # a plate seen edge-on, which the rule would enlarge by far
    assert framing.rule_move_within(sliver) is None


def test_reframe_scatters_as_configured_and_places_a_share():
    view = augment.place(dataclasses.replace(solids.view_of("box", (96, 128)), depth=None))
    scales, rows = [], []
    for seed in range(300):
        rng = np.random.default_rng(seed)
        moved = augment.reframe(view, rng, DataConfig(reframe_scale=0.1, reframe_shift=0.03))
        spread = np.ptp(moved.points, axis=0) / np.ptp(view.points, axis=0)
        scales.append(np.log(spread[0]))
        top, bottom, *_ = box_of(moved.mask)
        rows.append((top + bottom) / 2)
    # Clipping at two standard deviations reduces the standard deviation by 4 %.
    assert np.std(scales) == pytest.approx(0.96 * 0.1, abs=0.02)
    assert np.std(rows) == pytest.approx(0.96 * 0.03 * 96, abs=0.6)
    assert np.abs(scales).max() < 0.201
    view = solids.view_of("cone", (96, 128))
    some = DataConfig(place=0.3)
    results = [augment.reframe(view, np.random.default_rng(s), some) for s in range(60)]
    share = np.mean([result is not view for result in results])
    assert 0.15 < share < 0.45


def test_reframe_places_other_angles_as_if_seen_by_the_authors_camera():
    points = np.random.default_rng(1).uniform([-0.5, -0.6, 0], [0.5, 0.6, 0.5], (9000, 3))
    views = [seen_from(points.astype(np.float32), tilt) for tilt in (20.0, 50.0, -5.0)]
    # No share of placed views: other angles keep their image and points too.
    for view in views:
        assert augment.reframe(view, np.random.default_rng(0), DataConfig(place=0.0)) is view
    results = [augment.reframe(v, np.random.default_rng(2), DataConfig(place=1e-9)) for v in views]
    assert all(framing.has_authors_angle(moved.extrinsics) for moved in results)
    assert results[0] is views[0]
    for view, moved in zip(views[1:], results[1:], strict=True):
        # The image is placed by its mask, the points by their own projection.
        np.testing.assert_array_equal(moved.mask, augment.place(view).mask)
        top, bottom, left, right = framing.box_from_authors_angle(moved.points)
        rule = ((right - left) / 223) ** 4 + ((bottom - top) / 124) ** 4
        assert rule == pytest.approx(1, abs=0.15)
        assert (left + right) / 2 == pytest.approx(128, abs=3)
        pixels, _ = camera.project(moved.points, moved.intrinsics, moved.extrinsics)
        assert pixels.min() >= 0
        assert (pixels < moved.mask.shape[::-1]).all()
    # The points do not depend on the angle.
    np.testing.assert_allclose(results[1].points, results[2].points, atol=1e-5)
    with_depth = dataclasses.replace(views[1], depth=np.ones((192, 256), np.float32))
    kept = augment.reframe(with_depth, np.random.default_rng(2), DataConfig(place=1e-9))
    assert kept is with_depth


def seen_from(points, tilt):
    """Points as an object in the authors' camera with another tilt."""
    intrinsics, extrinsics = camera.default_camera(tilt_degrees=tilt)
    mask = np.zeros((192, 256), bool)
    columns, rows = camera.project(points, intrinsics, extrinsics)[0].astype(int).T
    for down in (-1, 0, 1):
        mask[rows + down, columns] = True
    image = np.where(mask[..., None], np.uint8(90), np.uint8(191)).repeat(3, axis=2)
    return augment.View(image, mask, None, points, intrinsics, extrinsics)

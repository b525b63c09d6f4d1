"""Spheres are drawn where the camera sees their points; near ones cover far ones; shadows."""

import numpy as np
import pytest
from PIL import Image

from psgn_jax.commands import spheres as spheres_command
from psgn_jax.data import camera
from psgn_jax.viewing import spheres

SIZE = (96, 128)
CAMERA = camera.default_camera(SIZE)
RED, BLUE = (220, 20, 20), (20, 20, 220)


def draw(points, colours, **options):
    return spheres.render(
        np.array(points, np.float32), np.array(colours, np.uint8), *CAMERA, SIZE, **options
    ).astype(int)


def test_a_sphere_is_where_its_point_projects_and_as_large():
    point = [0.1, 0.4, 0.5]
    picture = draw([point], [RED], radius=0.1, shadow=False)
    rows, columns = np.nonzero((picture < 250).any(axis=2))
    pixels, depth = camera.project(np.array([point]), *CAMERA)
    assert (columns.mean() + 0.5, rows.mean() + 0.5) == pytest.approx(tuple(pixels[0]), abs=0.6)
    radius = CAMERA[0][0, 0] * 0.1 / depth[0]
    assert len(rows) == pytest.approx(np.pi * radius**2, rel=0.25)
    top = picture[rows.min() + 2, int(pixels[0, 0])].sum()
    assert top > picture[rows.max() - 2, int(pixels[0, 0])].sum()


def test_the_near_one_hides_the_far_one_in_either_order():
    near, far = [0.5, 0, 0.5], [0.5 - 1.0, 0, 0.5 - np.tan(np.deg2rad(20))]
    for points, colours in (([near, far], [RED, BLUE]), ([far, near], [BLUE, RED])):
        picture = draw(points, colours, shadow=False, radius=0.08)
        pixels, _ = camera.project(np.array([near]), *CAMERA)
        colour = picture[int(pixels[0, 1]), int(pixels[0, 0])]
        assert colour[0] > colour[2] + 50


def test_the_shadow_lies_on_the_ground_below():
    cloud = np.random.default_rng(0).uniform((-0.2, -0.2, 0), (0.2, 0.2, 0.4), (400, 3))
    with_shadow = draw(cloud, [RED] * 400)
    without = draw(cloud, [RED] * 400, shadow=False)
    rows, _ = np.nonzero((with_shadow < without).any(axis=2))
    ground, _ = camera.project(np.zeros((1, 3)), *CAMERA)
    assert abs(rows.mean() - ground[0, 1]) < 10
    assert (with_shadow <= without).all()


def test_nothing_to_see_is_white_and_odd_points_are_left_out():
    assert (draw(np.zeros((0, 3)), np.zeros((0, 3))) == 255).all()
    odd = [[np.nan, 0, 0], [50, 0, 0], [0, 0, np.inf]]
    assert (draw(odd, [RED] * 3, shadow=False) == 255).all()


def test_colours():
    points = np.array([[0, 0, -1.0], [0, 0, 0], [0, 0, 1], [0, 0, np.nan]])
    by_height = spheres.colours_by_height(points)
    np.testing.assert_array_equal(by_height[0], by_height[1])
    assert (by_height[1] != by_height[2]).any()
    assert spheres.colours_by_branch(np.array([0, 1], np.uint8)).tolist() == [
        list(c) for c in spheres.BRANCH_COLOURS
    ]


@pytest.mark.slow
def test_the_command_on_predictions(rng, tmp_path):
    points = rng.uniform(-0.3, 0.3, (1, 50, 3)).astype(np.float32)
    arrays = {"image": np.full((*SIZE, 3), 191, np.uint8), "branch": np.arange(50) < 9}
    arrays |= {"points": points, "intrinsics": CAMERA[0], "extrinsics": CAMERA[1]}
    file, out, gif = (tmp_path / name for name in ("a.npz", "sheet.png", "turn.gif"))
    np.savez(file, **arrays)
    assert spheres_command.main([str(file), f"--out={out}", f"--turntable={gif}"]) == 0
    with Image.open(out) as page:
        assert page.size[0] > 500
    with Image.open(gif) as moving:
        assert moving.n_frames == 36
    assert spheres_command.main([str(tmp_path / "no.npz"), f"--out={out}"]) == 2


def test_a_film_that_browsers_play(rng, tmp_path, monkeypatch):
    av = pytest.importorskip("av")
    points = rng.uniform((-0.4, -0.4, 0), (0.4, 0.4, 0.8), (60, 3))
    path = tmp_path / "turn.mp4"
    spheres.turntable(points, np.array([RED] * 60, np.uint8), path, frames=6, size=(72, 96))
    assert [p.name for p in tmp_path.iterdir()] == ["turn.mp4"]
    with av.open(path) as film:
        (stream,) = film.streams
        assert (stream.codec_context.name, stream.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert stream.average_rate == 12.5
        frames = [frame.to_ndarray(format="rgb24").astype(int) for frame in film.decode(video=0)]
    assert len(frames) == 24
    assert frames[0].shape == (72, 96, 3)
    assert (np.abs(frames[1] - frames[0]).max(axis=2) > 40).mean() > 0.01
    assert np.abs(frames[6] - frames[0]).mean() < 3  # the second turn
    with pytest.raises(ValueError, match=r"ends with \.gif or \.mp4"):
        spheres.turntable(points, points, "turn.avi")
    monkeypatch.setattr(spheres.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ValueError, match="needs the extra 'video'"):
        spheres.turntable(points, points, path)

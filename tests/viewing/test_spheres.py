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
    cloud = np.array(points, np.float32), np.array(colours, np.uint8)
    return spheres.render(*cloud, *CAMERA, SIZE, **options).astype(int)


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


def test_the_near_one_hides_the_far_one_and_the_shadow_lies_below():
    near, far = [0.5, 0, 0.5], [0.5 - 1.0, 0, 0.5 - np.tan(np.deg2rad(20))]
    for points, colours in (([near, far], [RED, BLUE]), ([far, near], [BLUE, RED])):
        picture = draw(points, colours, shadow=False, radius=0.08)
        pixels, _ = camera.project(np.array([near]), *CAMERA)
        colour = picture[int(pixels[0, 1]), int(pixels[0, 0])]
        assert colour[0] > colour[2] + 50
    cloud = np.random.default_rng(0).uniform((-0.2, -0.2, 0), (0.2, 0.2, 0.4), (400, 3))
    with_shadow = draw(cloud, [RED] * 400)
    without = draw(cloud, [RED] * 400, shadow=False)
    rows, _ = np.nonzero((with_shadow < without).any(axis=2))
    ground, _ = camera.project(np.zeros((1, 3)), *CAMERA)
    assert abs(rows.mean() - ground[0, 1]) < 10
    assert (with_shadow <= without).all()


def test_the_command_on_predictions(rng, tmp_path, capsys):
    points = rng.uniform(-0.3, 0.3, (1, 50, 3)).astype(np.float32)
    arrays = {"image": np.full((*SIZE, 3), 191, np.uint8), "points": points}
    arrays |= {"branch": (np.arange(50) < 9).astype(np.uint8), "seen": np.ones((1, 50), bool)}
    arrays |= {"intrinsics": CAMERA[0], "extrinsics": CAMERA[1]}
    arrays |= {"photo": arrays["image"], "to_view": np.eye(3)}
    arrays |= {"colours": np.tile(np.array(RED, np.uint8), (1, 50, 1))}
    file, out, gif = (tmp_path / name for name in ("a.npz", "sheet.png", "turn.gif"))
    np.savez(file, **arrays)

    def red(*flags):
        assert spheres_command.main([str(file), f"--out={out}", *flags]) == 0
        with Image.open(out) as page:
            pixels = np.asarray(page.convert("RGB")).astype(int)
        return pixels.shape[1], ((pixels[..., 0] - pixels[..., 1:].max(axis=2)) > 60).sum()

    wide, by_photo = red(f"--turntable={gif}")
    assert by_photo > 500
    assert capsys.readouterr().out == f"1 case: {out}\nfilm: {gif}\n"
    with Image.open(gif) as moving:
        assert moving.n_frames == 36
    wider, _ = red("--branch")
    assert wider > wide
    assert red("--columns=1000000000")[0] == wide
    five = {name: arrays[name].repeat(5, 0) for name in ("points", "colours", "seen")}
    np.savez(file, **arrays | five)
    columns = [red(*flags)[0] for flags in ((), ("--clouds=2",))]
    # The image, and each cloud from two sides; the first file had one cloud.
    assert np.diff([wide, *columns[::-1]]).tolist() == [2 * (wide - 24) // 3, 4 * (wide - 24) // 3]
    np.savez(file, **arrays | {"seen": np.zeros((1, 50), bool)})
    assert red()[1] < by_photo / 10
    assert spheres_command.main([str(tmp_path / "no.npz"), f"--out={out}"]) == 2
    assert spheres_command.main([str(file), f"--out={out}", "--turntable=turn.avi"]) == 2
    assert "ends with .gif" in capsys.readouterr().err

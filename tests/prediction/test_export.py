"""Every format keeps the frame: axes, handedness and scale agree when trimesh reads it."""

import io

import numpy as np
import pytest
import trimesh

from psgn_jax.data import camera, framing
from psgn_jax.prediction import export

# A cloud that shows any exchange or mirroring of axes: the origin, one unit along +x (to the
# camera), two along +y (image right), three along +z (up).
POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3], [-0.125, 0.25, -0.5]], np.float32)
COLOURS = np.array([[0, 0, 0], [255, 0, 0], [0, 255, 0], [0, 0, 255], [10, 20, 30]], np.uint8)


@pytest.mark.parametrize("suffix", ["ply", "xyz", "obj", "npz", "glb"])
def test_axes_handedness_and_scale_come_back(tmp_path, suffix):
    files = export.write_clouds(tmp_path, "a", POINTS[None], COLOURS[None], (suffix,))
    assert [file.name for file in files] == [f"a.{suffix}"]
    if suffix == "npz":
        with np.load(files[0]) as archive:
            points, colours = archive["points"][0], archive["colours"][0]
    elif suffix == "obj":
        # trimesh drops vertices without faces. So the lines are read here, and trimesh reads a copy
        # with faces.
        rows = [line.split() for line in files[0].read_text().splitlines()]
        vertices = np.array([row[1:] for row in rows if row[0] == "v"], float)
        points, colours = vertices[:, :3], np.rint(vertices[:, 3:] * 255)
        assert [row[1:] for row in rows if row[0] == "p"] == [list("12345")]
        faces = files[0].read_text() + "f 1 2 3\nf 1 3 4\nf 1 4 5\n"
        mesh = trimesh.load(io.StringIO(faces), file_type="obj", process=False)
        np.testing.assert_allclose(mesh.vertices, POINTS, atol=1e-6)
    else:
        (cloud,) = trimesh.load(files[0], force="scene").geometry.values()
        axes = [2, 0, 1] if suffix == "glb" else [0, 1, 2]  # glTF's y axis points up
        points = np.asarray(cloud.vertices)[:, axes]
        colours = np.asarray(cloud.colors)[..., :3]
    np.testing.assert_allclose(points, POINTS, atol=1e-6)
    # The determinant is positive: not mirrored.
    assert np.linalg.det(points[1:4]) == pytest.approx(6)
    if suffix != "xyz":
        np.testing.assert_array_equal(colours, COLOURS)


def test_several_samples_have_a_file_each_and_one_archive(tmp_path):
    points = np.stack([POINTS, POINTS + 1])
    colours = np.stack([COLOURS, COLOURS])
    export.write_clouds(tmp_path, "b", points, colours, seen=np.ones((2, 5), bool))
    want = {"b.npz", *(f"b_{k}.{s}" for k in range(2) for s in ("ply", "xyz", "obj"))}
    assert {p.name for p in tmp_path.iterdir()} == want
    with np.load(tmp_path / "b.npz") as archive:
        assert archive["points"].shape == (2, 5, 3)
        assert archive["seen"].all()
    np.testing.assert_allclose(trimesh.load(tmp_path / "b_1.ply").vertices, POINTS + 1)


def view():
    """The left half of the image red, the right half blue."""
    image = np.zeros((192, 256, 3), np.uint8)
    image[:, :128], image[:, 128:] = (200, 0, 0), (0, 0, 200)
    mask = np.ones((192, 256), bool)
    return framing.Framed(image, mask, *camera.default_camera(), np.eye(3), True)


def test_seen_points_take_the_images_colours_and_hidden_ones_those_of_the_nearest():
    side = np.linspace(-0.4, 0.4, 24)
    y, z = (a.ravel() for a in np.meshgrid(side, side + 0.5))
    wall = np.stack([np.full_like(y, 0.3), y, z], axis=1)
    behind = wall * [-1, 0.6, 0.6] + [0, 0, 0.2]
    colours, seen = export.colours_from_view(np.concatenate([wall, behind]), view())
    assert seen[: len(wall)].all()
    assert not seen[len(wall) :].any()
    # +y is the image's right.
    assert (colours[: len(wall)][y > 0.02] == [0, 0, 200]).all()
    assert (colours[: len(wall)][y < -0.02] == [200, 0, 0]).all()
    nearest = np.linalg.norm(behind[:, None] - wall, axis=-1).argmin(axis=1)
    np.testing.assert_array_equal(colours[len(wall) :], colours[: len(wall)][nearest])
    outside = np.array([[100.0, 0, 0], [0, 50, 0], [0, 0, -40], [np.nan, 0, 0]])
    assert not export.colours_from_view(outside, view())[1].any()


def test_stray_points_are_found_and_left_out(tmp_path):
    rng = np.random.default_rng(0)
    body = rng.uniform(-0.5, 0.5, (300, 3)).astype(np.float32)
    cloud = np.concatenate([body, [[1.5, 0, 0], [0, -2, 0.3]]]).astype(np.float32)
    stray = export.stray_points(cloud)
    assert np.flatnonzero(stray).tolist() == [300, 301]
    assert not export.stray_points(np.zeros((3, 3), np.float32)).any()
    colours = np.zeros((1, 302, 3), np.uint8)
    formats = ("xyz", "npz")
    export.write_clouds(tmp_path, "a", cloud[None], colours, formats, drawn=~stray[None])
    assert len((tmp_path / "a.xyz").read_text().splitlines()) == 300
    assert np.load(tmp_path / "a.npz")["points"].shape == (1, 302, 3)

import io
import sys

import numpy as np
import pytest
import trimesh
from helpers.commands import PHOTOS
from helpers.refusals import all_refused, refused

import psgn_jax
from psgn_jax.data import camera, framing, photo
from psgn_jax.prediction.cloud import Prediction, colours_from_view, find_outliers
from psgn_jax.prediction.formats import read_prediction
from psgn_jax.viewing.viewer import FIELDS, case_of, document_of

# A cloud that shows any exchange or mirroring of axes: the origin, one unit along +x (to the
# camera), two along +y (image right), three along +z (up).
POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3], [-0.125, 0.25, -0.5]], np.float32)
COLOURS = np.array([[0, 0, 0], [255, 0, 0], [0, 255, 0], [0, 0, 255], [10, 20, 30]], np.uint8)


def prediction(points=POINTS[None], colours=COLOURS[None], **changes):
    k, n, _ = points.shape
    image, mask = np.full((192, 256, 3), 90, np.uint8), np.zeros((192, 256), bool)
    mask[60:150, 80:200] = True
    fields = {
        "points": points, "colours": colours, "mask": mask, "warnings": (),
        "outlier": np.zeros((k, n), bool), "seen": np.ones((k, n), bool),
        "branch": np.zeros(n, np.uint8), "mask_from": "given",
        "photo": photo.Photo(image, None, (192, 256)), "view": framing.place(image, mask),
        "scale": 1.0, "shift": np.zeros(3), "seconds": {},
    }  # fmt: skip
    return Prediction(**fields | changes)


@pytest.mark.parametrize("suffix", ["ply", "xyz", "obj", "npz", "glb"])
def test_axes_handedness_and_scale_come_back(tmp_path, suffix):
    file = tmp_path / f"a.{suffix}"
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(sys.modules, "trimesh", None)  # no format needs it
        prediction().save(file)
    if suffix == "npz":
        with np.load(file) as archive:
            points, colours = archive["points"][0], archive["colours"][0]
    elif suffix == "obj":
        # trimesh drops vertices without faces. So the lines are read here, and trimesh reads a copy
        # with faces.
        rows = [line.split() for line in file.read_text().splitlines()]
        vertices = np.array([row[1:] for row in rows if row[0] == "v"], float)
        points, colours = vertices[:, :3], np.rint(vertices[:, 3:] * 255)
        assert [row[1:] for row in rows if row[0] == "p"] == [list("12345")]
        faces = file.read_text() + "f 1 2 3\nf 1 3 4\nf 1 4 5\n"
        mesh = trimesh.load(io.StringIO(faces), file_type="obj", process=False)
        np.testing.assert_allclose(mesh.vertices, POINTS, atol=1e-6)
    else:
        (cloud,) = trimesh.load(file, force="scene").geometry.values()
        axes = [2, 0, 1] if suffix == "glb" else [0, 1, 2]  # glTF's y axis points up
        points = np.asarray(cloud.vertices)[:, axes]
        colours = np.asarray(cloud.colors)[..., :3]
    np.testing.assert_allclose(points, POINTS, atol=1e-6)
    # The determinant is positive: not mirrored.
    assert np.linalg.det(points[1:4]) == pytest.approx(6)
    # The colours of glTF are linear; trimesh rounds them to 8 bits.
    if suffix == "glb":
        linear = np.where(COLOURS > 10, ((COLOURS / 255 + 0.055) / 1.055) ** 2.4, COLOURS / 3294.6)
        np.testing.assert_allclose(colours, 255 * linear, atol=0.51)
    elif suffix != "xyz":
        np.testing.assert_array_equal(colours, COLOURS)


def test_samples_are_saved_by_number_and_shown_on_a_page(tmp_path):
    two = prediction(np.stack([POINTS, POINTS + 1]), np.stack([COLOURS, COLOURS]))
    two.save(tmp_path / "b.ply", sample=1)
    np.testing.assert_allclose(trimesh.load(tmp_path / "b.ply").vertices, POINTS + 1)
    two.save(tmp_path / "b.html")
    page = (tmp_path / "b.html").read_text()
    assert page.startswith("<!DOCTYPE html>")
    assert two._repr_html_().startswith('<iframe srcdoc="&lt;!DOCTYPE html&gt;')
    two.save(tmp_path / "b.npz")
    read = read_prediction(tmp_path / "b.npz", FIELDS)
    np.testing.assert_array_equal(read["points"], two.points)
    assert document_of([case_of("b", read)]) == page
    table = [(("a.ply", -1), "sample=-1"), (("car.stl", 0), "car.stl", ".ply")]
    all_refused(lambda given: prediction().save(tmp_path / given[0], given[1]), ValueError, table)
    with refused(ValueError, "car.obj", ".glb"):
        two.save_surface(tmp_path / "car.obj")


@pytest.mark.parametrize("middle", [(230, 330), (380, 90)])
def test_the_photos_camera(rng, middle):
    """The points project where the crop shows them, for any focal length; metres if asked."""
    image, mask = np.full((480, 640, 3), 90, np.uint8), np.zeros((480, 640), bool)
    mask[middle[0] - 60 : middle[0] + 60, middle[1] - 80 : middle[1] + 80] = True
    points = rng.uniform((-0.4, -0.5, 0), (0.4, 0.5, 0.7), (1, 200, 3)).astype(np.float32)
    cloud = prediction(
        points, rng.integers(0, 255, points.shape, np.uint8), mask=mask,
        photo=photo.Photo(image, None, (960, 1280)), view=framing.place(image, mask),
    )  # fmt: skip
    view = cloud.view
    exact, _ = camera.project(points[0], cloud.photo_intrinsics, view.extrinsics)
    crop, _ = camera.project(points[0], view.intrinsics, view.extrinsics)
    mapped = np.column_stack([exact / 2, np.ones(200)]) @ view.to_view.T
    np.testing.assert_allclose(mapped[:, :2], crop, atol=1e-3)
    pixel = 2 / view.to_view[0, 0]  # of the view, in pixels of the photo
    assumed = cloud.camera()
    assert assumed.intrinsics[0, 0] == pytest.approx(400 * pixel)
    for given in (assumed, cloud.camera(focal=300 * pixel), cloud.camera(focal=600 * pixel)):
        np.testing.assert_allclose(given.intrinsics[:2, 2], [640, 480])
        own = given.points @ given.intrinsics.T
        np.testing.assert_allclose(own[:, :2] / own[:, 2:], exact, atol=1e-3 * pixel)
        rigid, _ = camera.project(points[0], given.intrinsics, given.extrinsics)
        off = np.linalg.norm(rigid - exact, axis=1).max() / pixel
        assert off == pytest.approx(given.error, rel=1e-3)
        rotation = given.extrinsics[:, :3]
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-6)
        assert np.linalg.det(rotation) == pytest.approx(1, abs=1e-6)
        # The object keeps its size.
        assert np.ptp(given.points[:, 0]) == pytest.approx(1, rel=0.2)
    assert assumed.error < 1 or middle != (230, 330)  # a lens stretches what is at the side
    metres = cloud.camera(height=1.4)
    assert metres.unit == pytest.approx(1.4 / np.ptp(points[0, :, 2]))
    np.testing.assert_allclose(metres.points, metres.unit * assumed.points)
    moved = camera.to_camera(metres.unit * points[0], metres.extrinsics)
    assert np.abs(moved - metres.points).max() < 0.1 * metres.unit
    wrong = (np.nan, 0, -1, 1e300, 1e-300, "300")
    table = [({name: value}, f"{name}=") for value in wrong for name in ("focal", "height")]
    all_refused(lambda options: cloud.camera(**options), ValueError, table)
    assert np.isfinite(cloud.camera(focal=1e6, height=1e6).points).all()


def test_the_focal_length_of_exif_is_used_if_it_can_be_true():
    image = np.full((192, 256, 3), 90, np.uint8)
    for focal in (300, 3):
        cloud = prediction(photo=photo.Photo(image, None, (192, 256), focal=focal))
        used = focal if focal == 300 else cloud.photo_intrinsics[0, 0]
        assert cloud.camera().intrinsics[0, 0] == pytest.approx(used)
    with refused(ValueError, "focal=3"):
        cloud.camera(focal=3)


def test_seen_points_take_the_images_colours_and_hidden_ones_those_of_the_nearest():
    image = np.zeros((192, 256, 3), np.uint8)
    image[:, :128], image[:, 128:] = (200, 0, 0), (0, 0, 200)
    mask = np.ones((192, 256), bool)
    view = framing.Framed(image, mask, *camera.default_camera(), np.eye(3), True)
    side = np.linspace(-0.4, 0.4, 24)
    y, z = (a.ravel() for a in np.meshgrid(side, side + 0.5))
    wall = np.stack([np.full_like(y, 0.3), y, z], axis=1)
    behind = wall * [-1, 0.6, 0.6] + [0, 0, 0.2]
    colours, seen = colours_from_view(np.concatenate([wall, behind]), view)
    assert seen[: len(wall)].all()
    assert not seen[len(wall) :].any()
    # +y is the image's right.
    assert (colours[: len(wall)][y > 0.02] == [0, 0, 200]).all()
    assert (colours[: len(wall)][y < -0.02] == [200, 0, 0]).all()
    nearest = np.linalg.norm(behind[:, None] - wall, axis=-1).argmin(axis=1)
    np.testing.assert_array_equal(colours[len(wall) :], colours[: len(wall)][nearest])


def test_outliers_are_found_and_left_out(tmp_path):
    rng = np.random.default_rng(0)
    body = rng.uniform(-0.5, 0.5, (300, 3)).astype(np.float32)
    points = np.concatenate([body, [[1.5, 0, 0], [0, -2, 0.3]]]).astype(np.float32)
    outlier = find_outliers(points)
    assert np.flatnonzero(outlier).tolist() == [300, 301]
    assert not find_outliers(np.zeros((3, 3), np.float32)).any()
    assert not find_outliers(np.zeros((30, 3), np.float32)).any()
    collapsed = np.concatenate([np.zeros((400, 3), np.float32), points])  # most points coincide
    assert np.flatnonzero(find_outliers(collapsed)).tolist() == [700, 701]
    cloud = prediction(points[None], np.zeros((1, 302, 3), np.uint8), outlier=outlier[None])
    cloud.save(tmp_path / "a.xyz")
    np.testing.assert_allclose(np.loadtxt(tmp_path / "a.xyz"), body, atol=1e-6)
    np.testing.assert_array_equal(cloud.to_trimesh().vertices, body)
    cloud.save(tmp_path / "a.npz")
    assert np.load(tmp_path / "a.npz")["points"].shape == (1, 302, 3)


def outside(cloud, points=None):
    """The share of the points that do not project onto the mask."""
    points = cloud.points[0] if points is None else points
    pixels, _ = camera.project(points, cloud.view.intrinsics, cloud.view.extrinsics)
    return (~camera.inside_mask(pixels, cloud.view.mask, 1)).mean()


def test_the_network_predicts_right_side_up_and_clouds_are_fitted_to_the_mask():
    model = psgn_jax.load()
    for name in ("boat", "chair"):
        cloud = model(PHOTOS / f"{name}.jpg", normal_form="no", refine=False)
        points, height = cloud.points[0], [0, 0, cloud.points[..., 2].max()]
        assert outside(cloud) < 0.15
        assert outside(cloud, points * [1, -1, 1]) > outside(cloud) + 0.1
        assert outside(cloud, points * [1, 1, -1] + height) > outside(cloud) + 0.1
    placed = model(PHOTOS / "aeroplane.jpg", PHOTOS / "aeroplane_mask.png", normal_form="no")
    kept = model(placed.view.image, placed.view.mask, normal_form="no")
    assert placed.view.placed
    assert not kept.view.placed
    assert outside(kept) == outside(placed) == 0

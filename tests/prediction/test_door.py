"""`psgn_jax.load`: one door from Python, with paths, PIL images and arrays."""

import pathlib
import subprocess
import sys

import numpy as np
import pytest
import trimesh
from PIL import Image

import psgn_jax
from psgn_jax.data.camera import inside_mask, project

PHOTOS = pathlib.Path(__file__).resolve().parents[2] / "docs" / "photos"


@pytest.fixture(scope="module")
def model():
    return psgn_jax.load()


def test_paths_images_and_arrays_give_the_same_cloud(model):
    path, mask = PHOTOS / "chair.jpg", PHOTOS / "chair_mask.png"
    cloud = model(path, mask=str(mask))
    image, pixels = Image.open(path), np.array(Image.open(mask))
    given = pixels > 0 if pixels.dtype == bool else pixels > 127
    assert cloud.points.shape == (1, 1024, 3)
    np.testing.assert_array_equal(cloud.mask, given)
    for other in (given, given.astype(np.uint8), pixels, Image.open(mask)):
        np.testing.assert_array_equal(model(image, mask=other).points, cloud.points)
    np.testing.assert_array_equal(model(np.array(image), mask=given).points, cloud.points)


def test_points_are_moved_into_the_mask_unless_the_camera_is_doubtful(model):
    def outside(cloud):
        pixels, _ = project(cloud.points[0], cloud.view.intrinsics, cloud.view.extrinsics)
        return (~inside_mask(pixels, cloud.view.mask, 2)).mean()

    placed = model(PHOTOS / "aeroplane.jpg", PHOTOS / "aeroplane_mask.png", normal_form="no")
    kept = model(placed.view.image, placed.view.mask, normal_form="no")
    assert placed.view.placed
    assert not kept.view.placed
    assert outside(kept) == 0
    assert outside(placed) > 0.1
    few = model(PHOTOS / "boat.jpg", PHOTOS / "boat_mask.png", normal_form="no")
    assert few.view.placed
    assert outside(few) == 0


def test_a_cloud_is_saved_and_read(model, tmp_path):
    cloud = model(PHOTOS / "car.jpg", mask=PHOTOS / "car_mask.png")
    cloud.save(tmp_path / "car.ply")
    read = trimesh.load(tmp_path / "car.ply")
    np.testing.assert_allclose(read.vertices, cloud.points[0], atol=1e-5)
    np.testing.assert_array_equal(read.colors[:, :3], cloud.colours[0])
    np.testing.assert_array_equal(cloud.to_trimesh().vertices, cloud.points[0])
    with pytest.raises(ValueError, match=r"accepted: a name that ends in \.ply"):
        cloud.save(tmp_path / "car.stl")


def test_the_import_is_light():
    code = "import sys, psgn_jax; sys.exit('jax' in sys.modules or 'numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0

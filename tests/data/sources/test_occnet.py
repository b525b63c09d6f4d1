import dataclasses
import io
import zipfile

import numpy as np
import pytest
from helpers import shapenet_trees as trees

from psgn_jax import convert
from psgn_jax.data import camera
from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.sources import binvox, occnet, shapenet

CHAIR = "03001627"
NUM_VIEWS = len(trees.VIEWS)


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    root = trees.write_occnet(tmp_path_factory.mktemp("occnet"), {"train": ["a"]})
    return list(occnet.read_model(root, CHAIR, "a", max_views=NUM_VIEWS))


def test_silhouettes_are_those_of_the_pictures(samples):
    assert len(samples) == NUM_VIEWS
    for sample, view in zip(samples, trees.VIEWS, strict=True):
        truth = trees.silhouette(view)
        assert (sample.mask & truth).sum() / (sample.mask | truth).sum() > 0.97
        pixels, _ = camera.project(sample.points, sample.intrinsics, sample.extrinsics)
        assert camera.inside_mask(pixels, truth, 1).mean() > 0.995
        assert (sample.image[~sample.mask] == 191).all()


def test_frame_and_normals(samples):
    for sample, view in zip(samples, trees.VIEWS, strict=True):
        right = sample.extrinsics[0, :3]
        np.testing.assert_allclose(right, [0, 1, 0], atol=1e-6)
        assert sample.points.shape == sample.normals.shape == (16384, 3)
        _, rt = trees.published_camera(*view)
        to_shapenet = (rt[:, :3] @ trees.BLENDER_FROM_SHAPENET).T @ sample.extrinsics[:, :3]
        normals = sample.normals @ to_shapenet.T
        axis = np.abs(normals).argmax(axis=1)
        assert np.abs(normals)[np.arange(len(axis)), axis].min() > 0.999
        # Normals point outward: at the top of the object they point up.
        top = sample.points[:, 2] > sample.points[:, 2].max() - 1e-4
        assert (sample.normals[top, 2] > 0.99).mean() > 0.9


def test_volume_fits_the_points(samples):
    for sample in samples:
        cells, matrix = shapenet.grid_of_extra(sample.extra)
        index = (sample.points - matrix[:, 3]) @ np.linalg.inv(matrix[:, :3]).T
        padded = np.pad(cells, 2)
        near = np.zeros(len(index), bool)
        for step in np.ndindex(3, 3, 3):
            near |= padded[tuple((np.floor(index).astype(int) + step + 1).clip(0, 35).T)]
        assert near.mean() > 0.999
        assert sample.occupancy.any()


def test_conversion_and_damage(tmp_path, capsys):
    root = trees.write_occnet(tmp_path / "src")
    chair = root / CHAIR
    (chair / "a" / "img_choy2016" / "001.jpg").write_bytes(b"no picture")
    (chair / "b" / "pointcloud.npz").write_bytes(
        (chair / "b" / "pointcloud.npz").read_bytes()[:5000]
    )
    cameras = dict(np.load(chair / "c" / "img_choy2016" / "cameras.npz"))
    del cameras["world_mat_1"]
    cameras["camera_mat_2"] = np.eye(4)
    cameras["world_mat_3"], cameras["world_mat_0"] = cameras["world_mat_0"], cameras["world_mat_3"]
    np.savez(chair / "c" / "img_choy2016" / "cameras.npz", **cameras)
    trees.write_occnet(root, {"more": ["w"]})
    binvox.write(chair / "w" / "model.binvox", trees.voxels(16))
    (chair / "test.lst").write_text("d\nw\nmissing\n../c\nx\0y\na\n")
    (root / "somewhere").mkdir()
    target = tmp_path / "dst"
    command = ["occnet", str(root), str(target), "--views", "4", "--points", "400"]
    assert convert.main(command) == 1
    error = capsys.readouterr().err
    for message in (
        "a/img_choy2016/001.jpg: not a readable JPEG image",
        "b/pointcloud.npz: damaged, or not a file of arrays",
        "cameras.npz: no world_mat_1 [3, 4]",
        "cameras.npz: no camera_mat_2 [3, 3]",
        "c/img_choy2016/000.jpg: ",
        "w/model.binvox: dim 16, expected 32",
        "missing/pointcloud.npz: missing",
        "test.lst: '../c' is not the name of a model",
        "test.lst: 'x\\x00y' is not the name of a model",
        "test.lst: 'a' is listed a second time",
        "somewhere: not one of the 13",
    ):
        assert message in error
    assert [s.view for s in RecordReader(target, "train")] == [0, 2, 3]
    assert len(RecordReader(target, "test")) == 4
    assert convert.main([*command[:2], str(tmp_path / "strict"), "--strict"]) == 2


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scale": np.float64(1e300)}, "coordinates from"),
        ({"scale": np.float64(1e150)}, "coordinates from"),
        ({"loc": np.full(3, 1e300)}, "coordinates from"),
        ({"scale": np.float64(1e-300)}, "the object's radius is"),
        ({"points": np.full((60_000, 3), 0.25)}, "the object's radius is"),
    ],
)
def test_clouds_that_teach_nothing_are_refused(tmp_path, changes, message):
    root = trees.write_occnet(tmp_path, {"train": ["a"]})
    path = root / CHAIR / "a" / "pointcloud.npz"
    np.savez(path, **(dict(np.load(path)) | changes))
    with pytest.raises(ValueError, match=rf"pointcloud\.npz: {message}"):
        list(occnet.read_model(root, CHAIR, "a", max_views=1))


def test_views_with_an_empty_volume_are_left_out(tmp_path, capsys):
    root = trees.write_occnet(tmp_path / "src", {"train": ["a", "b"], "val": [], "test": []})
    grid = dataclasses.replace(trees.voxels(), solid=np.zeros((32, 32, 32), bool))
    binvox.write(root / CHAIR / "a" / "model.binvox", grid)
    command = ["occnet", str(root), str(tmp_path / "dst"), "--views", "2", "--points", "400"]
    assert convert.main(command) == 1
    assert f"{CHAIR}/a, view 1: the volume is empty" in capsys.readouterr().err
    assert len(RecordReader(tmp_path / "dst", "train")) == 2


def npz(path, members):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return path


def npy(array, **changes):
    file = io.BytesIO()
    np.lib.format.write_array(file, array, allow_pickle=True)
    data = file.getvalue()
    for old, new in changes.values():
        assert len(old) == len(new)
        data = data.replace(old, new)
    return data


def test_arrays_are_read_in_bounded_memory(tmp_path):
    good = npz(tmp_path / "good.npz", {"points.npy": npy(np.eye(3))})
    np.testing.assert_array_equal(occnet.read_npz(good, {"points": 9, "x": 1})["points"], np.eye(3))
    huge = npy(np.zeros((10, 3)), shape=(b"(10, 3)", b"(99, 9)"))
    hostile = {
        "objects": npy(np.array([{}, []], object)),
        "larger_than_said": npy(np.zeros((1000, 3))),
        "shape": huge,
        "bomb": bytes(50_000_000),
        "not_npy": b"hello",
        "negative": npy(np.zeros((10, 3)), shape=(b"(10, 3)", b"(-1, 3)")),
        "strings": npy(np.array(["abc"])),
    }
    for name, data in hostile.items():
        path = npz(tmp_path / f"{name}.npz", {"points.npy": data})
        with pytest.raises(ValueError, match="damaged, or not a file of arrays") as error:
            occnet.read_npz(path, {"points": 100})
        assert str(path) in str(error.value)

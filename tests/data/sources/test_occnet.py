import numpy as np
import pytest
from helpers import shapenet_trees as trees

from psgn_jax.commands import convert
from psgn_jax.data import camera
from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.sources import occnet

CHAIR = "03001627"
NUM_VIEWS = len(trees.VIEWS)


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    root = trees.write_occnet(tmp_path_factory.mktemp("occnet"), {"train": ["a"]})
    return list(map(occnet.open_model(root, CHAIR, "a", 16384), range(NUM_VIEWS)))


def test_silhouettes_and_frame(samples):
    for sample, view in zip(samples, trees.VIEWS, strict=True):
        truth = trees.silhouette(view)
        assert (sample.mask & truth).sum() / (sample.mask | truth).sum() > 0.97
        pixels, _ = camera.project(sample.points, sample.intrinsics, sample.extrinsics)
        assert camera.inside_mask(pixels, truth, 1).mean() > 0.995
        assert (sample.image[~sample.mask] == 191).all()
        right = sample.extrinsics[0, :3]
        np.testing.assert_allclose(right, [0, 1, 0], atol=1e-6)
        assert sample.points.shape == (16384, 3)
        assert trees.share_near_volume(sample) > 0.999


def test_conversion_and_damage(tmp_path, capsys):
    root = trees.write_occnet(tmp_path / "src")
    chair = root / CHAIR
    (chair / "a" / "img_choy2016" / "001.jpg").write_bytes(b"no picture")
    points = chair / "b" / "pointcloud.npz"
    points.write_bytes(points.read_bytes()[:5000])
    cameras = dict(np.load(chair / "c" / "img_choy2016" / "cameras.npz"))
    del cameras["world_mat_1"]
    cameras["camera_mat_2"] = np.eye(4)
    cameras["world_mat_3"], cameras["world_mat_0"] = cameras["world_mat_0"], cameras["world_mat_3"]
    np.savez(chair / "c" / "img_choy2016" / "cameras.npz", **cameras)
    trees.write_occnet(root, {"more": ["w", "s"]})
    scaled = dict(np.load(chair / "s" / "pointcloud.npz"), scale=np.zeros(0))
    np.savez(chair / "s" / "pointcloud.npz", **scaled)
    trees.write_binvox(chair / "w" / "model.binvox", trees.voxels(16))
    (chair / "test.lst").write_text("d\nw\ns\nmissing\n../c\nx\0y\na\n")
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
        "w/model.binvox: dim [16.0, 16.0, 16.0], expected 32",
        "missing/pointcloud.npz: No such file",
        "s/pointcloud.npz: loc [",
        "test.lst: '../c' is not the name of a model",
        "test.lst: 'x\\x00y' is not the name of a model",
        "test.lst: 'a' is listed a second time",
        "somewhere: no category, it has no train.lst, val.lst or test.lst",
    ):
        assert message in error
    assert [s.view for s in RecordReader(target, "train")] == [0, 2, 3]
    assert len(RecordReader(target, "test")) == 4


def test_own_categories_are_converted(tmp_path):
    splits = {"train": ["a"], "val": [], "test": []}
    root = trees.write_occnet(tmp_path / "src", splits, "my chairs")
    trees.write_occnet(root, splits, CHAIR)
    (root / CHAIR / "train.lst").write_bytes(b"\xef\xbb\xbfa\r\n")  # as by Windows programs
    command = ["occnet", str(root), str(tmp_path / "dst"), "--views=1", "--points=40"]
    assert convert.main(command) == 0
    records = RecordReader(tmp_path / "dst", "train")
    found = {(sample.category, sample.model_id) for sample in records}
    assert found == {("chair", f"{CHAIR}/a"), ("my chairs", "my chairs/a")}

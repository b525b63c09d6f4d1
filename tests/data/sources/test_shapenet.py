import dataclasses
import os

import numpy as np
import pytest
from helpers import shapenet_trees as trees
from helpers.refusals import all_refused, check_message, refused
from PIL import Image

from psgn_jax.commands import convert
from psgn_jax.data import camera
from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.doubts import fit
from psgn_jax.data.sources import occnet, r2n2, shapenet

CHAIR = "03001627"


def samples(root, module):
    read = module.open_model(root, CHAIR, "a", 16384)
    for number, view in enumerate(trees.VIEWS):
        yield read(number), trees.silhouette(view)


def overlap(mask, truth):
    return (mask & truth).sum() / (mask | truth).sum()


def assert_in_the_projects_frame(sample):
    assert sample.points.shape == (16384, 3)
    right, down, forward = sample.extrinsics[:, :3].astype(float)
    np.testing.assert_allclose(right, [0, 1, 0], atol=1e-6)
    assert down[2] < 0
    assert forward[0] < 0
    assert abs(forward[1]) < 1e-6
    assert fit(sample) > 0.99
    assert trees.share_near_volume(sample) > 0.999


def test_samples_of_r2n2(tmp_path):
    solid = shapenet.world_grid(trees.voxels())
    _, unit = shapenet.object_frame(shapenet.corners(solid), tmp_path)
    volume = solid.cells.sum() * (solid.edge / unit) ** 3
    for sample, truth in samples(trees.write_r2n2(tmp_path, names=("a",)), r2n2):
        assert_in_the_projects_frame(sample)
        np.testing.assert_array_equal(sample.mask, truth)
        projected = camera.project(sample.points, sample.intrinsics, sample.extrinsics)
        # The overlap is not higher, because half a voxel is 1.5 to 2.5 pixels.
        assert overlap(shapenet.drawn_mask(*projected, truth.shape), truth) > 0.8
        assert sample.category == "chair"
        assert abs(sample.points[:, 2].min()) < 1e-6
        assert 0.97 < np.linalg.norm(sample.points, axis=1).max() <= 1 + 1e-6
        assert sample.occupancy.sum() / 16**3 == pytest.approx(volume, rel=0.12)


def test_samples_of_occnet(tmp_path):
    for sample, truth in samples(trees.write_occnet(tmp_path, {"train": ["a"]}), occnet):
        assert_in_the_projects_frame(sample)
        assert overlap(sample.mask, truth) > 0.97
        pixels, _ = camera.project(sample.points, sample.intrinsics, sample.extrinsics)
        assert camera.inside_mask(pixels, truth, 1).mean() > 0.995
        assert (sample.image[~sample.mask] == 191).all()


def convert_damaged(layout, tree, target, capsys, messages):
    command = [layout, str(tree), str(target), "--views=4", "--points=300"]
    assert convert.main(command) == 1
    error = capsys.readouterr().err
    assert not [message for message in messages if message not in error]
    return error


def test_conversion_of_damaged_r2n2(tmp_path, capsys):
    tree, target = trees.write_r2n2(tmp_path / "src"), tmp_path / "dst"
    trees.write_r2n2(tree, names=("g", "h"))
    rendering, voxels = tree / "ShapeNetRendering" / CHAIR, tree / "ShapeNetVox32" / CHAIR
    (rendering / "a" / "rendering" / "01.png").unlink()
    os.mkfifo(rendering / "a" / "rendering" / "01.png")
    Image.new("RGB", (137, 137)).save(rendering / "a" / "rendering" / "02.png")
    rows = {name: rendering / name / "rendering" / "rendering_metadata.txt" for name in "beg"}
    rows["b"].write_text(
        "30.0 25.0 0 0.8 25\n200.5 x 0 0.7 25\n120 0.0 0 0.9 25\n97.0 30.0 0 0.65 25\n"
    )
    rows["e"].write_bytes(b"\xef\xbb\xbf" + rows["e"].read_bytes())  # as by Windows programs
    lines = rows["g"].read_text().splitlines()
    rows["g"].write_text("\n".join(lines[:1] + lines[2:]) + "\n")
    cut = voxels / "c" / "model.binvox"
    cut.write_bytes(cut.read_bytes()[:-20])
    trees.write_binvox(voxels / "d" / "model.binvox", trees.voxels(16))
    (tree / "ShapeNetRendering" / "04401089" / "x").mkdir(parents=True)
    (voxels / "f").mkdir()
    os.mkfifo(voxels / "f" / "model.binvox")
    messages = (
        "04401089: ", "a/rendering/01.png: ", "a/rendering/02.png: ",
        "b/rendering/rendering_metadata.txt: row 1: '200.5 x 0 0.7 25'",
        "b/rendering/02.png: ",  # turned by 180 degrees
        "g/rendering/rendering_metadata.txt: 3 rows", "c/model.binvox: ",
        "d/model.binvox: dim [16.0, 16.0, 16.0]", "f/model.binvox: ",
    )  # fmt: skip
    error = convert_damaged("r2n2", tree, target, capsys, messages)
    assert f"{len(messages)} files, models or views" in error
    train, test = (RecordReader(target, split) for split in ("train", "test"))
    kept = [(s.model_id[-1], s.view) for s in train]
    assert kept == [("a", 0), ("a", 3), ("b", 0), ("b", 3), *(("e", view) for view in range(4))]
    assert train[0].points.shape == (300, 3)
    assert [(s.model_id, s.view) for s in test] == [(f"{CHAIR}/h", view) for view in range(4)]


def test_conversion_of_damaged_occnet(tmp_path, capsys):
    root, target = trees.write_occnet(tmp_path / "src"), tmp_path / "dst"
    chair = root / CHAIR
    (chair / "a" / "img_choy2016" / "001.jpg").write_bytes(b"no picture")
    points = chair / "b" / "pointcloud.npz"
    points.write_bytes(points.read_bytes()[:5000])
    path = chair / "c" / "img_choy2016" / "cameras.npz"
    cameras = dict(np.load(path))
    del cameras["world_mat_1"]
    cameras["camera_mat_2"] = np.eye(4)
    cameras["world_mat_3"], cameras["world_mat_0"] = cameras["world_mat_0"], cameras["world_mat_3"]
    np.savez(path, **cameras)
    trees.write_occnet(root, {"more": ["w", "s"]})
    scaled = dict(np.load(chair / "s" / "pointcloud.npz"), scale=np.zeros(0))
    np.savez(chair / "s" / "pointcloud.npz", **scaled)
    trees.write_binvox(chair / "w" / "model.binvox", trees.voxels(16))
    (chair / "test.lst").write_text("d\nw\ns\nmissing\n../c\nx\0y\na\n")
    (root / "somewhere").mkdir()
    convert_damaged("occnet", root, target, capsys, (
        "a/img_choy2016/001.jpg: ", "b/pointcloud.npz: ", "cameras.npz: no world_mat_1 [3, 4]",
        "cameras.npz: no camera_mat_2 [3, 3]", "c/img_choy2016/000.jpg: ", "test.lst: 'a'",
        "w/model.binvox: dim [16.0, 16.0, 16.0]", "missing/pointcloud.npz: ", "test.lst: '../c'",
        "s/pointcloud.npz: loc [", "test.lst: 'x\\x00y'", "somewhere: ",
    ))  # fmt: skip
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


def test_a_wrong_sign_of_the_elevation_and_wrong_volumes_are_refused(tmp_path):
    tree = trees.write_r2n2(tmp_path, names=("a",))
    metadata = tree / "ShapeNetRendering" / CHAIR / "a" / "rendering" / "rendering_metadata.txt"
    metadata.write_text("\n".join(f"{a} {-e} 0 {r} 25" for a, e, r in trees.VIEWS))
    with refused(ValueError, "00.png", "elevation of 25", metadata.name):
        r2n2.open_model(tree, CHAIR, "a", 16384)(0)
    binvox = tree / "ShapeNetVox32" / CHAIR / "a" / "model.binvox"

    def opened(changes):
        trees.write_binvox(binvox, dataclasses.replace(trees.voxels(), **changes))
        r2n2.open_model(tree, CHAIR, "a", 16)

    all_refused(opened, ValueError, [
        ({"size": 1e300}, binvox, "coordinates"),
        ({"size": 1e-300}, binvox, "radius"),
        ({"low": np.full(3, 1e300)}, binvox, "coordinates"),
        ({"cells": np.zeros((32, 32, 32), bool)}, binvox, "empty"),
    ])  # fmt: skip


def test_absurd_numbers_are_refused_before_anything_is_read(tmp_path, capsys):
    for option, accepted in (("--points=1000000000", "[1, 1000000]"), ("--views=25", "1 to 24")):
        assert convert.main(["r2n2", str(tmp_path), str(tmp_path / "out"), option]) == 2
        check_message(capsys.readouterr().err, option, accepted)
    assert not (tmp_path / "out").exists()

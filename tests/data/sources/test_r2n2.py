import dataclasses

import numpy as np
import pytest
from helpers import shapenet_trees as trees
from helpers.refusals import all_refused, check_message, refused
from PIL import Image

from psgn_jax.commands import convert
from psgn_jax.data import camera
from psgn_jax.data.dataset import RecordReader
from psgn_jax.data.doubts import fit
from psgn_jax.data.sources import r2n2, shapenet

CHAIR = "03001627"
NUM_VIEWS = len(trees.VIEWS)


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    root = trees.write_r2n2(tmp_path_factory.mktemp("r2n2"), names=("a",))
    return list(map(r2n2.open_model(root, CHAIR, "a", 16384), range(NUM_VIEWS)))


def test_points_project_onto_the_published_pictures_in_the_projects_frame(samples):
    for sample, view in zip(samples, trees.VIEWS, strict=True):
        truth = trees.silhouette(view)
        np.testing.assert_array_equal(sample.mask, truth)
        pixels, depth = camera.project(sample.points, sample.intrinsics, sample.extrinsics)
        got = shapenet.drawn_mask(pixels, depth, truth.shape)
        # The overlap is not higher, because half a voxel is 1.5 to 2.5 pixels.
        assert (got & truth).sum() / (got | truth).sum() > 0.8
        assert fit(sample) > 0.99
        assert sample.category == "chair"
        assert sample.points.shape == (16384, 3)
        right, down, forward = sample.extrinsics[:, :3].astype(float)
        np.testing.assert_allclose(right, [0, 1, 0], atol=1e-6)
        assert down[2] < 0
        assert forward[0] < 0
        assert abs(forward[1]) < 1e-6
        assert abs(sample.points[:, 2].min()) < 1e-6
        assert 0.97 < np.linalg.norm(sample.points, axis=1).max() <= 1 + 1e-6


def test_volumes_agree(samples):
    solid = shapenet.world_grid(trees.voxels())
    _, unit = shapenet.object_frame(shapenet.corners(solid), "voxels")
    volume = solid.cells.sum() * (solid.edge / unit) ** 3
    for sample in samples:
        assert sample.occupancy.sum() / 16**3 == pytest.approx(volume, rel=0.12)
        assert trees.share_near_volume(sample) > 0.999


def damage(tree):
    """Damages b, c and others in different ways; returns what the messages must say."""
    rendering = tree / "ShapeNetRendering" / CHAIR
    voxels = tree / "ShapeNetVox32" / CHAIR
    (rendering / "a" / "rendering" / "01.png").unlink()
    Image.new("RGB", (137, 137)).save(rendering / "a" / "rendering" / "02.png")
    metadata = rendering / "b" / "rendering" / "rendering_metadata.txt"
    metadata.write_text(
        "30.0 25.0 0 0.8 25\n200.5 x 0 0.7 25\n120 0.0 0 0.9 25\n97.0 30.0 0 0.65 25\n"
    )
    metadata = rendering / "e" / "rendering" / "rendering_metadata.txt"
    metadata.write_bytes(b"\xef\xbb\xbf" + metadata.read_bytes())  # as by Windows programs
    trees.write_r2n2(tree, names=("g", "h"))
    metadata = rendering / "g" / "rendering" / "rendering_metadata.txt"
    rows = metadata.read_text().splitlines()
    metadata.write_text("\n".join(rows[:1] + rows[2:]) + "\n")
    cut = voxels / "c" / "model.binvox"
    cut.write_bytes(cut.read_bytes()[:-20])
    trees.write_binvox(voxels / "d" / "model.binvox", trees.voxels(16))
    (tree / "ShapeNetRendering" / "04401089" / "x").mkdir(parents=True)
    (voxels / "f").mkdir()
    return {
        "04401089: not one of the 13",
        "a/rendering/01.png: No such file",
        "a/rendering/02.png: not a readable PNG image (mode RGB, expected",
        "b/rendering/rendering_metadata.txt: row 1: '200.5 x 0 0.7 25' are not 5 numbers",
        "b/rendering/02.png: ",  # turned by 180 degrees
        "g/rendering/rendering_metadata.txt: 3 rows for 4 pictures",
        "c/model.binvox: cut off",
        "d/model.binvox: dim [16.0, 16.0, 16.0], expected 32",
        "f/model.binvox: No such file",
    }


def test_conversion_and_damage(tmp_path, capsys):
    tree, target = trees.write_r2n2(tmp_path / "src"), tmp_path / "dst"
    expected = damage(tree)
    command = ["r2n2", str(tree), str(target), "--views", str(NUM_VIEWS), "--points", "300"]
    assert convert.main(command) == 1
    error = capsys.readouterr().err
    for message in expected:
        assert message in error
    assert f"{len(expected)} files, models or views were left out" in error
    train = RecordReader(target, "train")
    kept = [(s.model_id[-1], s.view) for s in train]
    assert kept == [("a", 0), ("a", 3), ("b", 0), ("b", 3), *(("e", view) for view in range(4))]
    assert train[0].points.shape == (300, 3)
    test = RecordReader(target, "test")
    assert [(s.model_id, s.view) for s in test] == [(f"{CHAIR}/h", view) for view in range(4)]


def test_a_wrong_sign_of_the_elevation_and_wrong_volumes_are_refused(tmp_path):
    tree = trees.write_r2n2(tmp_path, names=("a",))
    metadata = tree / "ShapeNetRendering" / CHAIR / "a" / "rendering" / "rendering_metadata.txt"
    metadata.write_text("\n".join(f"{a} {-e} 0 {r} 25" for a, e, r in trees.VIEWS))
    read = r2n2.open_model(tree, CHAIR, "a", 16384)
    with refused(ValueError, "00.png", "elevation of 25", metadata.name):
        read(0)
    binvox = tree / "ShapeNetVox32" / CHAIR / "a" / "model.binvox"

    def opened(changes):
        trees.write_binvox(binvox, dataclasses.replace(trees.voxels(), **changes))
        r2n2.open_model(tree, CHAIR, "a", 16)

    all_refused(opened, ValueError, [
        ({"scale": 1e300}, binvox, "coordinates"),
        ({"scale": 1e-300}, binvox, "radius"),
        ({"translate": np.full(3, 1e300)}, binvox, "coordinates"),
        ({"solid": np.zeros((32, 32, 32), bool)}, binvox, "empty"),
    ])  # fmt: skip


def test_absurd_numbers_are_refused_before_anything_is_read(tmp_path, capsys):
    for option, accepted in (("--points=1000000000", "[1, 1000000]"), ("--views=25", "1 to 24")):
        assert convert.main(["r2n2", str(tmp_path), str(tmp_path / "out"), option]) == 2
        check_message(capsys.readouterr().err, option, accepted)
    assert not (tmp_path / "out").exists()

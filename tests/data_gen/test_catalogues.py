import collections
import errno
import gzip
import itertools
import os
import pickle
import struct

import numpy as np
import pytest
from helpers.obj_text import CUBE, FACES, zipped
from helpers.refusals import all_refused, check_message, refused

from data_gen.catalogues import sh3f
from data_gen.catalogues.entry import SPLITS, split_of
from data_gen.catalogues.open_catalogue import open_catalogue, parse_options
from data_gen.mesh import UnusableModelError
from data_gen.readers.model_files import FolderFiles, ZipFiles

BOX = CUBE + FACES


def test_splits_are_stable_and_of_the_sizes_asked_for():
    names = [f"model-{k}" for k in range(3000)]
    count = collections.Counter(split_of(n) for n in names)
    assert count["train"] == pytest.approx(2400, abs=80)
    assert count["test"] == pytest.approx(300, abs=60)
    # The splits must never change, because existing data sets depend on them.
    assert "".join(split_of(n)[1] for n in names[:12]) == "errrrraarrrr"
    assert {split_of(n, (0.0, 0.0, 1.0)) for n in names[:50]} == {"test"}
    with refused(ValueError, "0.5, 0.1, 0.1"):
        split_of("a", (0.5, 0.1, 0.1))


def test_a_wrong_source_is_told(write, tmp_path):
    (tmp_path / "empty").mkdir()
    bad = [write(f"{k}/bad.sh3f", c) for k, c in enumerate((b"", b"PK\x03\x04 nonsense"))]
    kinds = itertools.product(("folder", "shapenet", "sh3f"), ("nowhere", "empty"))
    table = [((kind, tmp_path / place), "source", place) for kind, place in kinds]
    table += [(("sh3f", path), path.name) for path in bad]
    table += [(("folder", bad[0].parent), "source", "sh3f")]
    all_refused(lambda arguments: open_catalogue(*arguments), ValueError, table)


def checked(catalogue):
    """The entries of a catalogue, which have the properties that every catalogue must have."""
    entries = catalogue.models
    assert len({e.model_id for e in entries}) == len(entries)
    assert {e.split for e in entries} <= set(SPLITS)
    for entry in entries[:3]:
        one, two = entry.load(), pickle.loads(pickle.dumps(entry)).load()
        np.testing.assert_array_equal(one.vertices, two.vertices)
        assert np.linalg.norm(one.vertices, axis=1).max() == pytest.approx(1)
    return entries


def proportions(entry):
    """The extents of a model, divided by the smallest one."""
    extent = np.ptp(entry.load().vertices, axis=0)
    return pytest.approx(extent / extent.min(), rel=1e-5)


def test_folder(trimesh, write, tmp_path, caplog, monkeypatch):
    for name in ("chairs/red/model.obj", "chairs/red/notes.txt", ".hidden/a.obj"):
        write(name, BOX)
    for name in ("c.zip", "d.tar.gz", "f.fbx"):
        write(name, b"")
    write("a.obj.gz", gzip.compress(BOX.encode()))
    trimesh.creation.box((1, 2, 3)).export(tmp_path / "top.STL")
    trimesh.creation.box((1, 2, 3)).export(tmp_path / "top.glb")
    entries = {e.model_id: e for e in checked(open_catalogue("folder", tmp_path))}
    categories = {name: e.category for name, e in entries.items()}
    others = dict.fromkeys(("a.obj.gz", "top.STL", "top.glb"), "")
    assert categories == {"chairs/red/model.obj": "chairs", **others}
    assert "1 .fbx, 1 .tar, 1 .zip" in caplog.text
    check_message(caplog.messages[-1], "several formats", "top")
    # In STL files, up is +z and the front is -y. In glTF files, up is +y and the front is +z.
    assert proportions(entries["top.STL"]) == [2, 1, 3]
    assert proportions(entries["top.glb"]) == [3, 1, 2]
    listed = os.scandir

    def closed(path):
        if path.endswith("red"):
            raise PermissionError(errno.EACCES, "not allowed", path)
        return listed(path)

    monkeypatch.setattr(os, "scandir", closed)
    assert len(open_catalogue("folder", tmp_path).models) == 3
    check_message(caplog.messages[-3], "chairs/red", "not allowed")
    monkeypatch.undo()
    turned = open_catalogue("folder", tmp_path, up="+z", front="+x").models
    assert proportions(next(e for e in turned if e.model_id == "top.glb")) == [1, 2, 3]
    table = (
        ({"up": "up"}, "'up'", "+z"), ({"up": "-x", "front": "+x"}, "front '+x'", "up '-x'"),
        ({"variants": -1}, "variants", "-1"),
        ({"variants": 2, "deviation": 1.5}, "deviation", "1.5"),
        ({"deviation": 0.3}, "deviation", "0.3", "without variants"),
    )  # fmt: skip
    all_refused(lambda options: open_catalogue("folder", tmp_path, **options), ValueError, table)


def test_folders_behind_links_are_entered_once_and_not_outside(write, tmp_path, caplog):
    for name in ("root/b/a.obj", "other/chairs/a.obj", "other/textures/x.png"):
        write(name, BOX)
    for link, target in {
        "root/a": "root/b", "root/b/up": "root", "root/more": "other", "root/z": "other/chairs",
        "other/self": "other", "other/root": "root",
    }.items():  # fmt: skip
        (tmp_path / link).symlink_to(tmp_path / target)
    (tmp_path / "root/x.png").symlink_to(tmp_path / "other/textures/x.png")
    inside = [e.model_id for e in checked(open_catalogue("folder", tmp_path / "root"))]
    assert inside == ["b/a.obj"]
    for part in ("more -> ", "z -> ", str(tmp_path / "other/chairs"), "linked"):
        assert part in caplog.text
    files = FolderFiles(tmp_path / "root")
    assert [files.find(name) for name in ("z/a.obj", "more/textures/x.png", "x.png")] == [None] * 3
    options = {"linked": (str(tmp_path / "other"),)}
    entries = checked(open_catalogue("folder", tmp_path / "root", **options))
    assert [e.model_id for e in entries] == ["b/a.obj", "z/a.obj"]
    assert len(entries[1].load().faces) == 12


def test_files_of_a_hub_are_links_to_its_blobs(write, tmp_path):
    write("hub/models--a/blobs/123", BOX)
    write("hub/models--a/refs/main", "1")
    write("secret.obj", BOX)
    snapshot = tmp_path / "hub/models--a/snapshots/1"
    snapshot.mkdir(parents=True)
    (snapshot / "a.obj").symlink_to("../../blobs/123")
    (snapshot / "b.obj").symlink_to(tmp_path / "secret.obj")
    first, second = open_catalogue("folder", snapshot).models
    assert len(first.load().faces) == 12
    with refused(UnusableModelError, "b.obj", "link"):
        second.load()
    (snapshot / "c.obj").symlink_to("c.obj")
    assert FolderFiles(snapshot).find("c.obj") is None


@pytest.mark.parametrize(
    ("layout", "extent"), [("model.obj", [3, 1, 2]), ("models/model_normalized.obj", [1, 3, 2])]
)
def test_shapenet(write, tmp_path, layout, extent):
    text = BOX.replace("v 1", "v 5").replace(" 1 -1\n", " 3 -1\n")
    for synset in ("02691156", "03001627"):
        for k in range(10):
            write(f"{synset}/{k:032x}/{layout}", text)
    write("taxonomy.json", "[]")
    (tmp_path / "02691156" / "empty").mkdir()
    entries = checked(open_catalogue("shapenet", tmp_path))
    assert len(entries) == 20
    assert {e.category for e in entries} == {"plane", "chair"}
    for category in ("plane", "chair"):
        splits = [e.split for e in entries if e.category == category]
        assert splits == ["train"] * 8 + ["test"] * 2
    assert proportions(entries[0]) == extent
    some = open_catalogue("shapenet", tmp_path, validation=0.5)
    count = collections.Counter(e.split for e in some.models)
    assert count["test"] == 4
    assert 0 < count["validation"] < 16


PROPERTIES = """\
id#1=me#chair
name#1=Gr\\u00fcner Stuhl
category#1=Chairs
model#1=/models/a/chair.obj
width#1=100
depth#1=50
height#1=200
id#2=me#chair
model#2=models/b/chair.obj
modelRotation#2=1 0 0 0 0 1 0 -1 0
width#2=100
depth#2=100
height#2: 300
name#3=gone
model#3=/models/c/gone.obj
name#4=traversal \\ud83d\\ude00
model#4=/../../../../etc/passwd.obj
name#5=bad numbers
model#5=/models/a/chair.obj
width#5=wide
modelRotation#5=1 2 3
model#6=/models/a/chair.obj
width#6=1e-200
depth#6=1e-200
height#6=1e-200
name#six=no number
"""


def make_library(path, properties=PROPERTIES, extra=()):
    files = {sh3f.PROPERTIES: properties.encode("latin-1")}
    files |= {"models/a/chair.obj": BOX, "models/b/chair.obj": BOX, **dict(extra)}
    path.write_bytes(zipped(files))
    return path


def test_sweet_home_and_its_properties(tmp_path):
    catalogue = open_catalogue("sh3f", make_library(tmp_path / "lib.sh3f"))
    entries = catalogue.models
    assert [e.model_id for e in entries[:2]] == ["lib/me#chair", "lib/me#chair-2"]
    assert len({e.model_id for e in entries}) == 6
    with refused(UnusableModelError, "matrix", "e-201"):
        entries[5].load()
    model = entries[0].load()
    assert entries[0].category == "Chairs"
    assert model.parameters["name"] == "Grüner Stuhl"
    # Depth is along x (the front), width along y.
    for number, extent in ((0, [1, 2, 4]), (1, [1, 1, 3]), (4, [1, 1, 1])):
        assert proportions(entries[number]) == extent
    for entry, file in zip(entries[2:4], ("gone.obj", "passwd.obj"), strict=True):
        with refused(UnusableModelError, file):
            entry.load()
    assert entries[3].model_id == "lib/traversal \U0001f600"
    (tmp_path / "a.sh3f").mkdir()
    assert len(open_catalogue("sh3f", tmp_path).models) == 6
    text = "a=1\nb : 2\nc 3\n! no\n  d\\ e=x\\\n   y\\u0041\\n\nempty=\n=nothing\nslash=\\\\\nlast"
    assert sh3f.parse_properties(text) == {
        "a": "1", "b": "2", "c": "3", "d e": "xyA\n", "empty": "", "": "nothing",
        "slash": "\\", "last": "",
    }  # fmt: skip


def test_bombs_and_damaged_members_are_refused_and_traversal_finds_nothing(tmp_path):
    vertices = b"v 0 0 0\n"
    bomb = [("b.obj", vertices * (4 << 20))]
    library = make_library(tmp_path / "bomb.sh3f", "model#1=/b.obj\n", bomb)
    (entry,) = open_catalogue("sh3f", library).models
    with refused(UnusableModelError, "zip bomb"):
        entry.load()
    path = make_library(tmp_path / "lib.sh3f", extra=[("liar.obj", vertices * 100_000)])
    size, stated = (struct.pack("<I", number) for number in (800_000, 64))
    assert path.read_bytes().count(size) == 2  # in the header and in the table of contents
    data = bytearray(path.read_bytes().replace(size, stated))
    at = data.find(b"models/a/chair.obj") + 30
    data[at : at + 20] = b"\xff" * 20
    path.write_bytes(data)
    with refused(UnusableModelError, "liar.obj"):
        ZipFiles(path).read("liar.obj", 1000)
    first, second, *_ = open_catalogue("sh3f", path).models
    with refused(UnusableModelError, "chair.obj"):
        first.load()
    assert len(second.load().faces) == 12
    files = ZipFiles(make_library(tmp_path / "lib.sh3f", extra=[("../evil.png", b"x")]))
    for name in ("../evil.png", "../../lib.sh3f", "/etc/passwd", "models/../../evil.png"):
        with pytest.raises(FileNotFoundError):
            files.open(name, "")
    assert files.open("../A/CHAIR.obj", "models/b") == BOX.encode()


def test_options_from_texts():
    assert parse_options("folder", ["up=+z", "max_faces=50", "fractions=0.5,0.5,0"]) == {
        "up": "+z", "max_faces": 50, "fractions": (0.5, 0.5, 0.0),
    }  # fmt: skip
    wrong = (["max_faces=many"], ["fractions=half"], ["upp=+z"], ["up"], ["up=+z", "up=+y"])
    table = ((pairs, f"option={pairs[-1]}") for pairs in wrong)
    all_refused(lambda pairs: parse_options("folder", pairs), ValueError, table)

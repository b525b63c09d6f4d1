import collections
import pickle
import re
import struct
import zipfile

import numpy as np
import pytest

from data_gen.catalogues import sh3f
from data_gen.catalogues.entry import SPLITS, split_of, unique_names
from data_gen.catalogues.open_catalogue import open_catalogue, parse_options
from data_gen.mesh import UnusableModelError
from data_gen.readers.model_files import ZipFiles

BOX = """\
v 0 0 0
v 1 0 0
v 1 1 0
v 0 1 0
v 0 0 1
v 1 0 1
v 1 1 1
v 0 1 1
f 4 3 2 1
f 5 6 7 8
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
"""


def test_splits_are_stable_and_of_the_sizes_asked_for():
    names = [f"model-{k}" for k in range(3000)]
    count = collections.Counter(split_of(n) for n in names)
    assert count["train"] == pytest.approx(2400, abs=80)
    assert count["test"] == pytest.approx(300, abs=60)
    # The splits must never change, because existing data sets depend on them.
    assert "".join(split_of(n)[1] for n in names[:12]) == "errrrraarrrr"
    assert {split_of(n, (0.0, 0.0, 1.0)) for n in names[:50]} == {"test"}
    assert {split_of(n, (1.0, 0.0, 0.0)) for n in names[:50]} == {"train"}
    with pytest.raises(ValueError, match="split fractions"):
        split_of("a", (0.5, 0.1, 0.1))


@pytest.mark.parametrize("name", ["folder", "shapenet", "sh3f"])
def test_a_missing_source_is_told(name, tmp_path):
    with pytest.raises(ValueError, match="source"):
        open_catalogue(name, tmp_path / "nowhere")
    with pytest.raises(ValueError, match="source"):
        open_catalogue(name, tmp_path)


def test_unique_names():
    assert unique_names(["a", "b", "a", "a", "a-2"]) == ["a", "b", "a-3", "a-4", "a-2"]


def check(catalogue):
    """Checks the properties that every catalogue must have; returns its entries."""
    entries = catalogue.models
    assert len({e.model_id for e in entries}) == len(entries)
    assert {e.split for e in entries} <= set(SPLITS)
    again = pickle.loads(pickle.dumps(entries))
    for entry, copy in zip(entries[:3], again, strict=False):
        one, two = entry.load(), copy.load()
        np.testing.assert_array_equal(one.vertices, two.vertices)
        assert one.model_id == entry.model_id
        assert one.category == entry.category
        np.testing.assert_allclose(np.linalg.norm(one.vertices, axis=1).max(), 1)
    return entries


def test_folder(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    (tmp_path / "chairs" / "red").mkdir(parents=True)
    (tmp_path / "chairs" / "red" / "model.obj").write_text(BOX)
    (tmp_path / "chairs" / "red" / "notes.txt").write_text("no mesh")
    (tmp_path / ".hidden").mkdir()
    (tmp_path / ".hidden" / "a.obj").write_text(BOX)
    trimesh.creation.box((1, 2, 3)).export(tmp_path / "top.STL")
    trimesh.creation.box((1, 2, 3)).export(tmp_path / "top.glb")
    catalogue = open_catalogue("folder", tmp_path)
    entries = check(catalogue)
    assert {(e.model_id, e.category) for e in entries} == {
        ("chairs/red/model.obj", "chairs"),
        ("top.STL", ""),
        ("top.glb", ""),
    }
    by_name = {e.model_id: e.load() for e in entries}
    # In STL files, up is +z and the front is -y. In glTF files, up is +y and the front is +z.
    np.testing.assert_allclose(
        np.ptp(by_name["top.STL"].vertices, axis=0)[2],
        3 * by_name["top.STL"].vertices[:, 1].max() * 2,
        rtol=1e-5,
    )
    extent = np.ptp(by_name["top.glb"].vertices, axis=0)
    np.testing.assert_allclose(extent / extent[1], [3, 1, 2], rtol=1e-5)
    turned = open_catalogue("folder", tmp_path, up="+z", front="+x")
    extent = np.ptp({e.model_id: e for e in turned.models}["top.glb"].load().vertices, axis=0)
    np.testing.assert_allclose(extent / extent[0], [1, 2, 3], rtol=1e-5)
    with pytest.raises(ValueError, match="axis 'up'"):
        open_catalogue("folder", tmp_path, up="up")


def shapenet_tree(root, layout):
    for synset in ("02691156", "03001627"):
        for k in range(10):
            file = root / synset / f"{k:032x}" / layout
            file.parent.mkdir(parents=True)
            file.write_text(
                "v 0 0 0\nv 3 0 0\nv 0 2 0\nv 0 0 1\nf 1 2 3\nf 1 3 4\nf 1 2 4\nf 2 3 4\n"
            )
    (root / "taxonomy.json").write_text("[]")
    (root / "02691156" / "empty").mkdir()


@pytest.mark.parametrize(
    ("layout", "extent"), [("model.obj", [3, 1, 2]), ("models/model_normalized.obj", [1, 3, 2])]
)
def test_shapenet(tmp_path, layout, extent):
    shapenet_tree(tmp_path, layout)
    entries = check(open_catalogue("shapenet", tmp_path))
    assert len(entries) == 20
    assert {e.category for e in entries} == {"plane", "chair"}
    for category in ("plane", "chair"):
        splits = [e.split for e in entries if e.category == category]
        assert splits == ["train"] * 8 + ["test"] * 2
    got = np.ptp(entries[0].load().vertices, axis=0)
    np.testing.assert_allclose(got / got.min(), extent, rtol=1e-6)
    some = open_catalogue("shapenet", tmp_path, validation=0.5)
    count = collections.Counter(e.split for e in some.models)
    assert count["test"] == 4
    assert 0 < count["validation"] < 16


PROPERTIES = """\
# a comment
id=library
id#1=me#chair
name#1=Gr\\u00fcner Stuhl
category#1=Chairs
model#1=/models/a/chair.obj
width#1=100
depth#1=50
height#1=200

id#2=me#chair
name#2=turned
category#2=Chairs
model#2=models/b/chair.obj
modelRotation#2=1 0 0 0 0 1 0 -1 0
width#2=100
depth#2=100
height#2: 300
name#3=gone
model#3=/models/c/gone.obj
name#4=traversal
model#4=/../../../../etc/passwd.obj
name#5=bad numbers
model#5=/models/a/chair.obj
width#5=wide
modelRotation#5=1 2 3
name#six=no number
"""


def make_library(path, properties=PROPERTIES, extra=()):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(sh3f.PROPERTIES, properties.encode("latin-1"))
        archive.writestr("models/a/chair.obj", BOX)
        archive.writestr("models/b/chair.obj", BOX)
        for name, data in extra:
            archive.writestr(name, data)
    return path


def test_sweet_home(tmp_path):
    catalogue = open_catalogue("sh3f", make_library(tmp_path / "lib.sh3f"))
    entries = catalogue.models
    assert [e.model_id for e in entries[:2]] == ["lib/me#chair", "lib/me#chair-2"]
    assert len({e.model_id for e in entries}) == 5
    model = entries[0].load()
    assert model.category == "Chairs"
    assert model.parameters["name"] == "Grüner Stuhl"
    # Depth is along x (the front), width along y.
    extent = np.ptp(model.vertices, axis=0)
    np.testing.assert_allclose(extent / extent[0], [1, 2, 4])
    extent = np.ptp(entries[1].load().vertices, axis=0)
    np.testing.assert_allclose(extent / extent[0], [1, 1, 3])
    for entry in entries[2:4]:
        with pytest.raises(UnusableModelError, match="missing"):
            entry.load()
    extent = np.ptp(entries[4].load().vertices, axis=0)
    np.testing.assert_allclose(extent / extent[0], [1, 1, 1])
    assert len(open_catalogue("sh3f", tmp_path).models) == 5


def test_properties():
    text = "a=1\nb : 2\nc 3\n! no\n  d\\ e=x\\\n   y\\u0041\\n\nempty=\n=nothing\nslash=\\\\\nlast"
    assert sh3f.parse_properties(text) == {
        "a": "1", "b": "2", "c": "3", "d e": "xyA\n", "empty": "", "": "nothing",
        "slash": "\\", "last": "",
    }  # fmt: skip


def test_a_zip_bomb_is_not_opened(tmp_path):
    bomb = b"v 0 0 0\n" * (4 << 20)
    path = make_library(
        tmp_path / "bomb.sh3f", "name#1=b\nmodel#1=/bomb.obj\n", [("bomb.obj", bomb)]
    )
    assert path.stat().st_size < 200_000
    (entry,) = open_catalogue("sh3f", path).models
    with pytest.raises(UnusableModelError, match="zip bomb"):
        entry.load()


def test_a_member_that_lies_about_its_size_is_cut_off(tmp_path):
    path = make_library(tmp_path / "lie.sh3f", extra=[("liar.obj", b"v 0 0 0\n" * 100_000)])
    data = bytearray(path.read_bytes())
    for signature, offset in ((b"PK\x01\x02", 24), (b"PK\x03\x04", 22)):
        at = -1
        while (at := data.find(signature, at + 1)) != -1:
            if b"liar.obj" in data[at : at + 60]:
                data[at + offset : at + offset + 4] = struct.pack("<I", 64)
    path.write_bytes(data)
    files = ZipFiles(path)
    with pytest.raises(UnusableModelError, match=r"damaged|more bytes"):
        files.read("liar.obj", 1000)


def test_traversal_finds_nothing(tmp_path):
    files = ZipFiles(make_library(tmp_path / "lib.sh3f", extra=[("../evil.png", b"x")]))
    for name in ("../evil.png", "../../lib.sh3f", "/etc/passwd", "models/../../evil.png"):
        with pytest.raises(FileNotFoundError):
            files.open("", name)
    assert files.open("models/b", "../A/CHAIR.obj").startswith(b"v 0 0 0")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 nonsense", b"x" * 5000])
def test_a_damaged_library_is_told(tmp_path, content):
    path = tmp_path / "bad.sh3f"
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"bad\.sh3f"):
        open_catalogue("sh3f", path)


def test_a_damaged_member_is_refused_for_that_model_alone(tmp_path):
    path = make_library(tmp_path / "lib.sh3f")
    data = bytearray(path.read_bytes())
    at = data.find(b"models/a/chair.obj") + 30
    data[at : at + 20] = b"\xff" * 20
    path.write_bytes(data)
    entries = list(open_catalogue("sh3f", path).models)
    with pytest.raises(UnusableModelError, match="damaged"):
        entries[0].load()
    assert len(entries[1].load().faces) == 12


def test_options_from_texts():
    parse = parse_options
    assert parse("folder", ["up=+z", "max_faces=50", "fractions=0.5,0.5,0"]) == {
        "up": "+z", "max_faces": 50, "fractions": (0.5, 0.5, 0.0),
    }  # fmt: skip
    assert parse("shapenet", ["validation=0.1"]) == {"validation": 0.1}
    for wrong in ("max_faces=many", "fractions=half", "upp=+z", "up"):
        with pytest.raises(ValueError, match=re.escape(f"option={wrong}: expected")):
            parse("folder", [wrong])
    with pytest.raises(ValueError, match="up is given twice"):
        parse("folder", ["up=+z", "up=+y"])


def test_files_of_other_catalogues_are_pointed_to(tmp_path):
    (tmp_path / "lib.sh3f").write_bytes(b"PK")
    with pytest.raises(ValueError, match=r"contains no mesh, .*; catalogue sh3f reads"):
        open_catalogue("folder", tmp_path)

import os

import free_set
import numpy as np
import pytest
from helpers.obj_text import CUBE, FACES
from helpers.refusals import all_refused, refused

from data_gen.catalogues.open_catalogue import open_catalogue


def test_families_of_near_duplicates():
    families = {
        "montserrathse": ["Houses/MontserratHse2Green.ac", "Houses/MontserratHse3White.ac"],
        "p406": ["cars/p406/p406.glb", "cars/p406/p406-lod7.glb"],
        "f-15": ["Aircraft/F-15-lowpoly.ac", "F-15"],
        "scooter": ["Scopia/Scopia#scooter", "Scopia/Scopia#scooter2"],
        "7": ["7/7.ac"],
        "lemon": ["fruit/lemon-2/scene.gltf", "lemon/models/model_normalized.obj", "lemon.glb"],
        "model": ["model.obj", "Model-2.obj"],
    }
    for family, names in families.items():
        assert {free_set.family_of(name) for name in names} == {family}


def small(name="chairs", **changes):
    values = {
        "catalogue": "procedural", "views": 2, "source": "chair=30,lamp=10",
        "licences": (free_set.Licence("CC0-1.0", "^lamp", "L"), free_set.Licence("MIT", "", "M")),
        **changes,
    }  # fmt: skip
    return free_set.Source(name, **values)


def test_a_larger_part_holds_a_smaller_one():
    whole = free_set.select(small(), "")
    assert len(whole.models) == 40
    parts = [{e.model_id for e in free_set.select(small(), "", f).models} for f in (0, 0.1, 0.5)]
    assert [len(p) for p in parts] == [3, 4, 20]
    assert parts[0] < parts[1] < parts[2]
    rest = free_set.select(small(exclude="^lamp", families=True), "")
    assert len(rest.models) == 30
    # All chairs are in one family and therefore in one split, unlike in the catalogue's own splits.
    assert len({e.split for e in rest.models}) == 1
    assert len({e.split for e in free_set.select(small(), "").models}) == 3
    with refused(ValueError, "chairs"):
        free_set.select(small(exclude=".*"), "")


INDEX = """file,category,licence,author,repository,commit
a/chair-1.obj,chair,CC0-1.0,Ann,ann/things,abc
a/chair-2.obj,chair,CC-BY-3.0,Ann,ann/things,abc
b/rock.obj,rock,GPL-2.0,Bob,bob/rocks,def
b/own.obj,,all rights reserved,Bob,,
"""


@pytest.fixture
def meshes(write, tmp_path):
    """A folder of packages with meshes of several licences."""
    for name in ("a/chair-1", "a/chair-2", "b/rock", "b/own"):
        write(f"meshes/{name}.obj", CUBE + FACES)
    write("meshes/index.csv", INDEX)
    return tmp_path


def test_meshes_are_divided_by_the_licence_in_their_index(meshes, caplog):
    collections, copyleft = (free_set.SOURCES[name] for name in ("collections", "copyleft"))
    models = free_set.select(collections, meshes).models
    assert [e.model_id for e in models] == ["a/chair-1.obj", "a/chair-2.obj"]
    assert len({e.split for e in models}) == 1  # near duplicates
    assert models[0].category == "chair"
    assert models[0].load().parameters["licence"] == "CC0-1.0"
    assert [e.model_id for e in free_set.select(copyleft, meshes).models] == ["b/rock.obj"]
    good = {"status": "ok", "reason": "", "split": "train", "samples": 1}
    lines = {"collections": [{**good, "model_id": e.model_id} for e in models]}
    text = free_set.write_table(meshes, free_set.plan([collections]), str(meshes), lines)
    assert "| 2 | 2 | 0 | CC-BY-3.0 (1); CC0-1.0 (1) | Ann |" in text
    assert free_set.with_meshes([collections, copyleft], meshes) == [collections, copyleft]
    (meshes / "meshes/index.csv").write_text(INDEX.replace("GPL-2.0", "MIT"))
    assert free_set.with_meshes([collections, copyleft], meshes) == [collections]
    assert "'all rights reserved'" in caplog.text
    assert free_set.missing([collections], meshes) == []
    (meshes / "meshes/a/chair-2.obj").unlink()
    (line,) = free_set.missing([collections], meshes)
    assert line.startswith("git clone https://github.com/ann/things && git -C things checkout abc")
    assert line.endswith(f"# 1 files of {meshes / 'meshes/a'}")


def test_a_grey_mesh_gets_a_material_and_a_damaged_index_is_named(meshes):
    def opened(text=INDEX):
        (meshes / "meshes/index.csv").write_text(text)
        return open_catalogue("indexed", meshes / "meshes", licences=("GPL*",)).models

    (entry,) = opened()
    assert entry.find_file() == meshes / "meshes/b/rock.obj"
    rock = entry.load()
    assert rock.materials[0].texture is not None or np.ptp(rock.materials[0].diffuse) > 0
    table = (
        ("name\n", "index.csv", "line 1", "`file`"),
        ("file,category\na.obj\n", "index.csv", "line 2", "2 values"),
        ("file\na.obj\na.obj\n", "index.csv", "line 3", "'a.obj'"),
        ("file\n", "index.csv"),
        ("file,licence\na.obj,MIT\n", "index.csv", "'GPL*'", "'MIT'"),
    )
    all_refused(opened, ValueError, table)
    (meshes / "meshes/index.csv").unlink()
    os.mkfifo(meshes / "meshes/index.csv")
    with refused(ValueError, "index.csv", "pipe"):
        open_catalogue("indexed", meshes / "meshes")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize("mark", [",", ";", "\t"])
def test_an_index_as_windows_programs_write_it(tmp_path, encoding, mark):
    lines = ["File,Category ,Author", "a\\Stühle\\x.obj,chair,É", '"b; c.obj",mug,', ",,", ""]
    text = "\r\n".join(lines).replace(",", mark)
    (tmp_path / "index.csv").write_bytes(text.encode(encoding))
    first, second = open_catalogue("indexed", tmp_path).models
    assert (first.model_id, first.category) == ("a/Stühle/x.obj", "chair")
    assert (second.model_id, second.category) == ("b; c.obj", "mug")


def test_a_share_of_the_views_goes_to_another_preset(caplog):
    chosen = [small(views=8), small("more", views=3)]
    both = {"photo": 0.25, "angles": 0.5}
    for fractions, parts in (
        ({}, [("chairs", 8), ("more", 3)]),
        ({"photo": 0.1}, [("chairs", 7), ("photo/chairs", 1), ("more", 3)]),
        ({"photo": 0.25}, [("chairs", 6), ("photo/chairs", 2), ("more", 2), ("photo/more", 1)]),
        (both, [("chairs", 2), ("photo/chairs", 2), ("angles/chairs", 4),
                ("photo/more", 1), ("angles/more", 2)]),
        ({"level": 1}, [("level/chairs", 8), ("level/more", 3)]),
    ):  # fmt: skip
        assert [(p.folder, p.views) for p in free_set.plan(chosen, fractions)] == parts
    assert caplog.messages == ["--photo=0.1 of 3 views is none: more"]
    assert len({free_set.settings_of(p).seed for p in free_set.plan(chosen, both)}) == 3
    (level,) = free_set.plan([small(views=3)], {"level": 1})
    assert free_set.settings_of(level).camera.elevation == (-8, 10)
    with refused(ValueError, "fractions"):
        free_set.plan(chosen, {"photo": 0.6, "angles": 0.5})


def test_what_is_wrong_is_said_before_the_work(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(free_set, "exit_on_signals", lambda: None)
    for arguments, *names in (
        ([], "--packages"),
        (["--packages=/nowhere", "--out=x"], "apt-get download sweethome3d-furniture"),
        (["--packages=.", "--out=x", "--sources=cats"], "'cats'"),
        (["--packages=.", "--out=/dev/null", "--sources=procedural"], "--out=/dev/null"),
        (["--packages=.", "--out=x", "--fraction=2"], "fraction"),
        (["--packages=.", "--out=x", "cats"], "'cats'"),
    ):
        assert free_set.main(arguments) == 2
        said = capsys.readouterr()
        assert (said.out, [name for name in names if name not in said.err]) == ("", []), said.err
    assert not (tmp_path / "x").exists()

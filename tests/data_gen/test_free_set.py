"""The set of free packages: catalogues of aircraft and cars, choice of models, splits and table."""

import gzip
import json
import pathlib

import numpy as np
import pytest
from ac3d_files import CUBE, MATERIALS, SIDES, cube, obj, read, write
from helpers.commands import psgn_each
from PIL import Image

from data_gen.catalogues import torcs
from data_gen.catalogues.by_name import open_catalogue
from data_gen.mesh import UnusableModelError
from data_gen.readers.ac3d import find_assimp
from data_gen.sets import free

needs_assimp = pytest.mark.skipif(not find_assimp(), reason="assimp is not installed")


# --- Aircraft and cars ------------------------------------------------------------------------


def paint(path, colour):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", (2, 2), colour).save(path)


@pytest.fixture
def aircraft(tmp_path):
    root = tmp_path / "Aircraft"
    for name in ("A320/Models/A320", "A320/Models/light-cone", "Cub/Cub"):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        write(root / f"{name}.ac", cube(lines=['texture "paint.png"']))
    (root / "A320/main.xml").write_text("<PropertyList><path>Models/A320.ac</path></PropertyList>")
    for number, name in enumerate(["Alfa", "Bravo", "Charlie", "Delta"]):
        paint(root / f"A320/Textures/{name}/paint.png", (number, 0, 0))
        (root / f"A320/A320-{name}.xml").write_text(
            '<PropertyList include="main.xml">'
            f"<texture-path>Textures/{name}</texture-path></PropertyList>"
        )
    paint(tmp_path / "secret/paint.png", (255, 0, 0))
    (root / "Cub/up.xml").write_text(
        "<PropertyList><path>Cub.ac</path><texture-path>../../secret</texture-path></PropertyList>"
    )
    (root / "Cub/bad.xml").write_text("<PropertyList>")
    return root


@needs_assimp
def test_aircraft_wear_some_of_their_liveries(aircraft):
    catalogue = open_catalogue("flightgear", aircraft, liveries=2)
    first, second, plain = catalogue.models
    assert first.model_id == "A320/Models/A320.ac:Alfa"
    assert second.model_id == "A320/Models/A320.ac:Charlie"
    assert first.split == second.split
    assert [e.load().materials[0].texture[0, 0, 0] for e in (first, second)] == [0, 2]
    assert plain.model_id == "Cub/Cub.ac"
    assert any("missing" in w for w in plain.load().warnings)
    with pytest.raises(ValueError, match="liveries"):
        open_catalogue("flightgear", aircraft, liveries=0)


CAR = """<?xml version="1.0"?>
<!DOCTYPE params SYSTEM "../../params.dtd">
<params>
<section name="Graphic Objects"><attstr name="3d wheel directory" val="round"/></section>
<section name="Front Axle"><attnum name="xpos" val="1.5" unit="m"/></section>
<section name="Rear Axle"><attnum name="xpos" val="-1"/></section>
{wheels}
</params>"""

WHEEL = """<section name="{end} {side} Wheel"><attnum name="ypos" val="{y}" unit="m"/>
<attnum name="rim diameter" val="20" unit="in"/><attnum name="tire width" val="200" unit="mm"/>
<attnum name="tire height-width ratio" val="0.5"/></section>"""

WHEELS = "".join(
    WHEEL.format(end=end, side=side, y=y)
    for end in ("Front", "Rear")
    for side, y in (("Right", -0.8), ("Left", 0.8))
)


PARAMETERS = CAR.format(wheels=WHEELS)


def make_cars(root, parameters=PARAMETERS):
    body = [(4 * x - 2, 0.2 + y, z - 0.5) for x, y, z in CUBE]
    wheel = [(x - 0.5, y - 0.5, z - 0.5) for x, y, z in CUBE]
    for name, points in (
        ("cars/a/a", body),
        ("cars/a/a-lod1", body),
        ("wheels/round/wheel0", wheel),
    ):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        write(
            root / f"{name}.acc",
            obj(
                points=points, faces=SIDES, lines=['texture "p.png" base', 'texture "q.png" tiled']
            ),
        )
    paint(root / "cars/a/p.png", (9, 9, 9))
    (root / "cars/a/a.xml").write_text(parameters)
    return root


@needs_assimp
def test_cars_stand_on_their_wheels(tmp_path):
    (entry,) = open_catalogue("torcs", make_cars(tmp_path)).models
    assert (entry.model_id, entry.category) == ("cars/a/a.acc", "car")
    model = entry.load()
    assert len(model.faces) == 60
    scale = 4 / np.ptp(model.vertices[model.faces[:12]].reshape(-1, 3)[:, 0])
    radius = 0.254 + 0.1
    places = []
    for number in range(1, 5):
        wheel = model.vertices[model.faces[12 * number : 12 * number + 12]].reshape(-1, 3) * scale
        np.testing.assert_allclose(np.ptp(wheel, axis=0), [2 * radius, 0.2, 2 * radius], rtol=1e-5)
        places.append((wheel.min(axis=0) + wheel.max(axis=0)) / 2)
        assert wheel[:, 2].min() == pytest.approx(0, abs=1e-6)  # the car stands on its wheels
    front = np.array(places)[:, 0] - np.array(places)[:, 0].mean()
    np.testing.assert_allclose(front, [1.25, 1.25, -1.25, -1.25], rtol=1e-5)
    np.testing.assert_allclose(np.array(places)[:, 1], [-0.8, 0.8, -0.8, 0.8], rtol=1e-5)
    assert model.materials[0].texture[0, 0].tolist() == [9, 9, 9, 255]


@needs_assimp
@pytest.mark.parametrize(
    "parameters", ["", "<params>", CAR.format(wheels=""), CAR.replace("1.5", "x")]
)
def test_a_car_without_its_parameters_has_no_wheels(tmp_path, parameters):
    (entry,) = open_catalogue("torcs", make_cars(tmp_path, parameters)).models
    model = entry.load()
    assert len(model.faces) == 12
    assert any("no wheels" in w for w in model.warnings)


def test_parameters_read_no_other_file():
    text = CAR.format(wheels=WHEELS).replace(
        '<!DOCTYPE params SYSTEM "../../params.dtd">',
        '<!DOCTYPE params [<!ENTITY x SYSTEM "/etc/hostname">]>',
    ).replace("round", "&x;../../..")  # fmt: skip
    folder, places = torcs.wheel_places(text.encode())
    assert folder == torcs._WHEELS
    assert len(places) == 4
    with pytest.raises(UnusableModelError, match="rim diameter"):
        torcs.wheel_places(text.replace('val="20"', 'val="nan"').encode())


@needs_assimp
def test_wakes_are_no_part_of_a_ship(tmp_path):
    wake = cube(lines=["loc 9 0 0"]).replace('name "été"', 'name "Wake"')
    foam = cube(lines=["loc 9 9 0", 'texture "foam\\\\wake_big.png"'])
    awake = cube(lines=['texture "awake.png"']).replace('name "été"', 'name "wakefield"')
    arrays, notes = read(write(tmp_path / "a.ac", cube(), wake, foam, awake))
    assert len(arrays["faces"]) == 24
    assert [n for n in notes if "left out" in n] == ["a ship's wake or a painted shadow left out"]


@needs_assimp
def test_objects_that_an_exporter_left_out_are_a_warning(tmp_path):
    text = f"AC3Db\n{MATERIALS}{obj('world', kids=[cube(), cube()])}\n"
    (tmp_path / "a.ac").write_text(text.replace("kids 2", "kids 4"))
    arrays, notes = read(tmp_path / "a.ac")
    assert len(arrays["faces"]) == 24
    assert notes == ["2 objects are missing, compared with the counts in the file"]


# --- Choice, splits, table --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("names", "family"),
    [
        (["A320/Models/A320.ac:AirFrance", "A320/Models/A320.ac:ANA"], "a320"),
        (["Houses/MontserratHse2Green.ac", "Houses/MontserratHse3White.ac"], "montserrathse"),
        (["Agriculture/farmhouse2-white.ac", "Agriculture/farmhouse4.ac"], "farmhouse"),
        (["cars/p406/p406.acc", "cars/p406/p406-lod7.acc"], "p406"),
        (["Aircraft/F-15-lowpoly.ac", "F-15"], "f-15"),
        (["Scopia/Scopia#scooter", "Scopia/Scopia#scooter2"], "scooter"),
        (["733/Models/733.ac"], "733"),
        (["7/7.ac"], "7"),
    ],
)  # fmt: skip
def test_families_of_near_duplicates(names, family):
    assert {free.family_of(n) for n in names} == {family}


def small(name="chairs", **changes):
    values = {
        "catalogue": "procedural", "views": 2, "place": "chair=30,lamp=10",
        "licences": (free.Licence("CC0-1.0", "^lamp", "L"), free.Licence("MIT", "", "M")),
        **changes,
    }  # fmt: skip
    return free.Source(name, **values)


def test_a_larger_part_holds_a_smaller_one():
    whole = free.select(small(), "")
    assert len(whole.models) == 40
    parts = [{e.model_id for e in free.select(small(), "", f).models} for f in (0, 0.1, 0.5)]
    assert [len(p) for p in parts] == [3, 4, 20]
    assert parts[0] < parts[1] < parts[2]
    rest = free.select(small(exclude="^lamp"), "")
    assert len(rest.models) == 30
    # All chairs are in one family and therefore in one split, unlike in the catalogue's own splits.
    assert len({e.split for e in rest.models}) == 1
    assert len({e.split for e in free.select(small(families=""), "").models}) == 3
    with pytest.raises(ValueError, match="no model is left"):
        free.select(small(exclude=""".*"""), "")


def test_missing_packages_are_said_with_the_commands(tmp_path):
    known = list(free.SOURCES.values())
    lines = free.missing(known, tmp_path)
    assert "apt-get download torcs-data" in lines
    assert f"dpkg-deb -x torcs-data_*.deb {tmp_path / 'torcs-data'}" in lines
    for source in known:
        if source.package != free.MESHES:
            path = pathlib.Path(source.path(tmp_path))
            path.parent.mkdir(parents=True, exist_ok=True)
            path.touch()
    assert free.missing([s for s in known if s.package != free.MESHES], tmp_path) == []


def test_all_packages_have_licences_with_holders():
    for source in free.SOURCES.values():
        if source.package != free.MESHES:
            (first,) = source.licences_of(["anything"], "")
            assert first.name
            assert all(x.holders for x in source.licences if x.name != "see the package")


INDEX = """file,category,licence,author,repository,commit
a/chair-1.obj,chair,CC0-1.0,Ann,ann/things,abc
a/chair-2.obj,chair,CC-BY-3.0,Ann,ann/things,abc
b/rock.obj,rock,GPL-2.0,Bob,bob/rocks,def
b/own.obj,,all rights reserved,Bob,,
"""


@pytest.fixture
def meshes(tmp_path):
    """A folder of packages with meshes of several licences."""
    for name in ("a/chair-1", "a/chair-2", "b/rock", "b/own"):
        path = tmp_path / "meshes" / f"{name}.obj"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(
            "v 0 0 0\nv 1 0 0\nv 0 1 0.4\nv 0 0 1\nf 1 2 3\nf 1 3 4\nf 2 3 4\nf 1 2 4\n"
        )
    (tmp_path / "meshes/index.csv").write_text(INDEX)
    return tmp_path


def test_meshes_are_divided_by_the_licence_in_their_index(meshes):
    collections, copyleft = (free.SOURCES[name] for name in ("collections", "copyleft"))
    models = free.select(collections, meshes).models
    assert [e.model_id for e in models] == ["a/chair-1.obj", "a/chair-2.obj"]
    assert len({e.split for e in models}) == 1  # near duplicates
    assert models[0].category == "chair"
    assert models[0].load().parameters["licence"] == "CC0-1.0"
    assert [e.model_id for e in free.select(copyleft, meshes).models] == ["b/rock.obj"]
    good = {"status": "ok", "reason": "", "split": "train", "samples": 1}
    lines = {"collections": [{**good, "model_id": e.model_id} for e in models]}
    text = free.write_table(meshes, free.plan([collections]), str(meshes), lines)
    assert "| collections | meshes | 2 | 2 | 0 | CC-BY-3.0 (1); CC0-1.0 (1) | Ann |" in text


def test_missing_meshes_are_said_with_their_repositories(meshes):
    chosen = [free.SOURCES["collections"]]
    assert free.missing(chosen, meshes) == []
    (meshes / "meshes/a/chair-2.obj").unlink()
    (meshes / "meshes/b/rock.obj").unlink()
    (line,) = free.missing(chosen, meshes)
    assert line.startswith("git clone https://github.com/ann/things && git -C things checkout abc")
    assert line.endswith(f"# 1 files of {meshes / 'meshes/a'}")
    (meshes / "meshes/index.csv").unlink()
    (line,) = free.missing(chosen, meshes)
    assert "an index of your own meshes, with the columns file, category, licence" in line


def test_a_grey_mesh_gets_a_material_and_a_damaged_index_is_named(meshes):
    catalogue = open_catalogue("indexed", meshes / "meshes", licences=("GPL*",))
    (rock,) = (entry.load() for entry in catalogue.models)
    assert rock.materials[0].texture is not None or np.ptp(rock.materials[0].diffuse) > 0
    for text, message in (
        ("name\n", "line 1: expected a heading with a column `file`"),
        ("file,category\na.obj\n", "line 2: expected 2 values"),
        ("file\na.obj\na.obj\n", "line 3: 'a.obj' is listed twice"),
        ("file\n", "it lists no such model"),
    ):
        (meshes / "meshes/index.csv").write_text(text)
        with pytest.raises(ValueError, match=message):
            open_catalogue("indexed", meshes / "meshes")


def test_a_share_of_the_views_goes_to_another_preset():
    chosen = [small(views=8), small("more", views=3)]
    assert [(p.folder, p.preset, p.views) for p in free.plan(chosen, {"photo": 0.25})] == [
        ("chairs", "authors", 6), ("photo/chairs", "photo", 2),
        ("more", "authors", 2), ("photo/more", "photo", 1),
    ]  # fmt: skip
    assert [p.folder for p in free.plan(chosen, {"photo": 1})] == ["photo/chairs", "photo/more"]
    assert [p.folder for p in free.plan(chosen)] == ["chairs", "more"]
    both = free.plan(chosen, {"photo": 0.25, "angles": 0.5})
    assert [(p.folder, p.views) for p in both] == [
        ("chairs", 2), ("photo/chairs", 2), ("angles/chairs", 4),
        ("photo/more", 1), ("angles/more", 2),
    ]  # fmt: skip
    assert len({free.settings_of(p).seed for p in both}) == 3
    (level,) = free.plan([small(views=3)], {"level": 1})
    assert (level.folder, level.views) == ("level/chairs", 3)
    assert free.settings_of(level).camera.elevation == (-8, 10)
    halves = free.plan([small(views=3)], {"photo": 0.5, "angles": 0.5})
    assert [(p.folder, p.views) for p in halves] == [("photo/chairs", 2), ("angles/chairs", 1)]
    with pytest.raises(ValueError, match=r"--photo=0\.6, --angles=0\.5: expected a sum"):
        free.plan(chosen, {"photo": 0.6, "angles": 0.5})


def test_the_table(tmp_path):
    documents = tmp_path / "thing/usr/share/doc/thing"
    documents.mkdir(parents=True)
    (documents / "copyright").write_text("All of it is free.")
    with gzip.open(documents / "changelog.Debian.gz", "wb") as out:
        out.write(b"thing (1:2.3-4) unstable; urgency=low\n")
    parts = free.plan([small(package="thing")], {"photo": 0.5})
    good = {"status": "ok", "reason": "", "split": "train"}
    bad = {"status": "refused", "split": "train", "samples": 0}
    first = [
        {**good, "model_id": "chair-1", "samples": 2}, {**good, "model_id": "lamp-1", "samples": 2},
        {**bad, "model_id": "lamp-2", "reason": "file 'a.png' has 12 bytes"},
        {**bad, "model_id": "lamp-3", "reason": "file 'b.png' has 3 bytes"},
    ]  # fmt: skip
    second = [{**good, "model_id": "chair-1", "samples": 1}]
    lines = {"chairs": first, "photo/chairs": second}
    text = free.write_table(tmp_path, parts, str(tmp_path), lines)
    assert "| chairs | thing 1:2.3-4 | 2 | 5 | 2 | CC0-1.0 (1); MIT (1) |" in text
    assert "chairs: 2 x file ... has N bytes" in text
    (row,) = json.loads((tmp_path / "sources.json").read_text())
    assert row["licences"]["MIT"] == {"models": 1, "holders": ["M"]}
    assert row["folders"] == ["chairs", "photo/chairs"]
    assert (tmp_path / "SOURCES.md").read_text() == text
    assert (tmp_path / "licences/thing.txt").read_text() == "All of it is free."


# --- The command ------------------------------------------------------------------------------


def test_what_is_wrong_is_said_before_the_work(tmp_path):
    cases = (
        ([], "--packages is missing"),
        (["--packages=/nowhere", "--out=x"], "apt-get download torcs-data"),
        (["--packages=.", "--out=x", "--sources=cats"], "got 'cats'"),
        (["--packages=.", "--out=x", "--fraction=2"], "fraction"),
        (["--packages=.", "--out=x", "cats"], "unexpected argument 'cats'"),
    )
    arguments = [["free-set", *arguments] for arguments, _ in cases]
    found = psgn_each(*arguments, cwd=tmp_path, imports=["data_gen.catalogues.by_name"])
    for done, (_, message) in zip(found, cases, strict=True):
        assert (done.returncode, done.stdout, message in done.stderr) == (2, "", True), done.stderr
        assert "Traceback" not in done.stderr
    assert not (tmp_path / "x").exists()

import re

import numpy as np
import pytest
from ac3d_files import CUBE, MATERIALS, SIDES, cube, obj, read, write
from PIL import Image

from data_gen.catalogues.by_name import open_catalogue
from data_gen.mesh import UnusableModelError
from data_gen.readers import ac3d
from data_gen.readers.ac3d import read_outline
from data_gen.readers.textures import Assets

needs_assimp = pytest.mark.skipif(not ac3d.find_assimp(), reason="assimp is not installed")


@needs_assimp
def test_objects_stand_where_their_parents_put_them(tmp_path):
    # A quarter turn about z: x to y.
    turn = "rot 0 -1 0 1 0 0 0 0 1"
    inner = cube(lines=["loc 0 0 5"])
    middle = cube(lines=["loc 10 0 0", turn], kids=[inner])
    group = obj("group", lines=["loc 100 0 0"], kids=[middle, cube(lines=["loc 0 7 0"])])
    arrays, _ = read(write(tmp_path / "a.ac", group))
    corners = arrays["vertices"][arrays["faces"]].reshape(3, 12, 3, 3)
    low, high = corners.min(axis=(1, 2)), corners.max(axis=(1, 2))
    # Rotation before translation; children inherit both, also from objects with faces.
    np.testing.assert_allclose(low, [[109, 0, 0], [109, 0, 5], [100, 7, 0]], atol=1e-6)
    np.testing.assert_allclose(high - low, 1, atol=1e-6)
    outward = np.cross(corners[..., 1, :] - corners[..., 0, :], corners[..., 2, :] -
                       corners[..., 0, :])  # fmt: skip
    middle_of = corners.mean(axis=2) - ((low + high) / 2)[:, None]
    assert ((outward * middle_of).sum(axis=-1) > 0).all()


@needs_assimp
def test_materials_textures_and_their_coordinates(tmp_path):
    pixels = np.zeros((2, 2, 3), np.uint8)
    pixels[0] = 255
    (tmp_path / "Bilder").mkdir()
    Image.fromarray(pixels).save(tmp_path / "Bilder" / "dach.rgb", format="SGI")
    square = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    face = [[(0, 0, 0), (1, 1, 0), (2, 1, 1), (3, 0, 1)]]
    textured = obj(
        points=square, faces=face, flags=0x20,
        lines=['texture "Bilder\\dach.rgb"', "texrep 2 3", "texoff 0.5 0.25"],
    )  # fmt: skip
    plain = obj(points=square, faces=face, mat=1, lines=["loc 0 0 1"])
    other = obj(points=square, faces=face, lines=["loc 0 0 2", 'texture "gone.png"'])
    arrays, notes = read(write(tmp_path / "a.ac", textured, plain, other))
    assert len(arrays["faces"]) == 6  # a two-sided surface has no separate faces for its back
    one, two, three = (arrays["materials"][arrays["face_material"][k]] for k in (0, 2, 4))
    assert one.texture is not None
    assert one.texture[0, 0].tolist() == [255] * 4
    assert (one.diffuse, one.opacity, one.shininess, one.name) == ((1, 0, 0), 1, 64, "rouge é")
    assert (two.texture, two.diffuse, two.opacity) == (None, (0, 0, 1), 0.25)
    assert three.texture is None
    assert notes == ["texture 'gone.png' is missing; the plain colour is used instead"]
    place = arrays["vertices"][arrays["faces"][:2]].reshape(-1, 3)[:, :2]
    np.testing.assert_allclose(
        arrays["uv"][:2].reshape(-1, 2), place * [2, 3] + [0.5, 0.25], atol=1e-6
    )


@needs_assimp
def test_concave_polygons_and_lines(tmp_path):
    ell = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (1.9, 2, 0), (1.9, 0.1, 0), (0, 0.1, 0)]
    line = obj(points=ell, faces=[(0, 1, 2)], flags=0x02)
    arrays, _ = read(write(tmp_path / "a.ac", obj(points=ell, faces=[tuple(range(6))]), line))
    assert len(arrays["faces"]) == 4
    a, b, c = (arrays["vertices"][arrays["faces"][:, k]] for k in range(3))
    assert np.cross(b - a, c - a)[:, 2].sum() / 2 == pytest.approx(0.39, abs=1e-5)
    assert (np.cross(b - a, c - a)[:, 2] >= 0).all()


@needs_assimp
def test_each_object_has_its_crease_angle(tmp_path):
    path = write(tmp_path / "a.ac", cube(lines=["crease 120"]), cube(lines=["crease 45"]))
    arrays, _ = read(path)
    flat = [np.ptp(n, axis=0).max() < 1e-6 for n in arrays["normals"]]
    assert not any(flat[:12])
    assert all(flat[12:])


@needs_assimp
def test_catalogue(tmp_path):
    (tmp_path / "Boote").mkdir()
    # Extents of 3 along x (the front is -x), 2 along y (up) and 1 along z.
    points = [(-3 * x, 2 * y, z) for x, y, z in CUBE]
    faces = [s[::-1] for s in SIDES]
    write(tmp_path / "Boote" / "Kähne.AC", obj(points=points, faces=faces))
    (tmp_path / "bad.ac").write_bytes(b"AC3Db\nOBJECT world\nkids 3\n")
    catalogue = open_catalogue("ac3d", tmp_path)
    first, second = catalogue.models
    assert (first.model_id, first.category) == ("Boote/Kähne.AC", "Boote")
    model = first.load()
    extent = np.ptp(model.vertices, axis=0)
    np.testing.assert_allclose(extent / extent[1], [3, 1, 2], rtol=1e-5)
    assert (second.model_id, second.category) == ("bad.ac", "")
    with pytest.raises(UnusableModelError, match="truncated"):
        second.load()
    with pytest.raises(ValueError, match="axis 'up'"):
        open_catalogue("ac3d", tmp_path, up="up")
    with pytest.raises(ValueError, match="source"):
        open_catalogue("ac3d", tmp_path / "nowhere")


def good():
    return f"AC3Db\n{MATERIALS}{obj('world', kids=[cube(), cube()])}\n"


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda t: "", "does not begin"),
        (lambda t: "AC3Db\n", "no objects"),
        (lambda t: t.replace("numvert 8", "numvert 999999999"), "numvert 999999999, more than"),
        (lambda t: t.replace("numsurf 6", "numsurf 4294967295"), "numsurf .*more than"),
        (lambda t: t.replace("numsurf 6", "numsurf 7"), "surfaces are missing"),
        (lambda t: t.replace("refs 4", "refs 999999999"), "refs .*more than"),
        (lambda t: t.replace("refs 4", "refs -4"), "refs b'-4'"),
        (lambda t: t.replace("numvert 8", "numvert 9"), "24 numbers, expected 27"),
        (lambda t: t.replace("kids 2", "kids 99999999999999999999"), "kids"),
        (lambda t: t.replace("kids 2", "kids 3"), "objects are missing"),
        (lambda t: t.replace("1 1 1\n", "1 nan 1\n"), "not finite"),
        (lambda t: t.replace("1 1 1\n", "1 1e999 1\n"), "not finite"),
        (lambda t: t.replace("1 1 1\n", "1 one 1\n"), "numvert"),
        (lambda t: t.replace('name "été"', "loc 1 2", 1), "loc"),
        (lambda t: t[: len(t) // 2], "truncated|without a kids|missing|numbers"),
        (lambda t: "AC3Db\n" + "OBJECT group\nkids 1\n" * 5000 + t[6:], "levels"),
    ],
)
def test_bad_files_are_refused_before_assimp_sees_them(change, match):
    text = change(good())
    assert text != good()
    with pytest.raises(UnusableModelError, match=match):
        read_outline(text.encode())


def test_every_torn_file_is_refused():
    text = good().encode()
    assert len(read_outline(text)) == 3
    last = text.rindex(b"kids 0")
    for stop in range(0, last, 61):
        with pytest.raises(UnusableModelError):
            read_outline(text[:stop])


def test_faces_are_counted_before_they_are_read():
    with pytest.raises(UnusableModelError, match="limit of 20"):
        read_outline(good().encode(), Assets(None, max_faces=20))
    # Text in the data of an object is not read as a statement.
    free = good().replace('name "été"', "data 16\nkids 7\nkids 70\n ", 1)
    assert len(read_outline(free.encode())) == 3


@needs_assimp
@pytest.mark.parametrize(
    "change",
    [
        lambda t: t.replace("mat 0", "mat 77"),
        lambda t: re.sub(r"(?m)^7 0 0$", "4000000000 0 0", t),
        lambda t: re.sub(r"(?m)^MATERIAL.*\n", "", t),
        lambda t: t.replace("SURF 0x00", "SURF zzz"),
    ],
)
def test_wrong_numbers_do_no_harm(change, tmp_path):
    path = tmp_path / "a.ac"
    path.write_text(change(good()))
    try:
        arrays, _ = read(path)
    except UnusableModelError:
        return
    assert arrays["faces"].max() < len(arrays["vertices"])
    assert np.isfinite(arrays["vertices"]).all()


def test_without_assimp_the_catalogue_says_what_to_install(tmp_path, monkeypatch):
    write(tmp_path / "a.ac", cube())
    monkeypatch.setattr(ac3d, "find_assimp", lambda: "")
    with pytest.raises(ValueError, match=r"psgn-jax\[render\]"):
        open_catalogue("ac3d", tmp_path)


def flat(size=1.0, tilt=0.3):
    """A tilted square."""
    points = [(x * size, y * size, tilt * y * size) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
    return obj(points=points, faces=[(0, 1, 2, 3)])


@needs_assimp
def test_non_objects_are_refused_with_a_reason(tmp_path):
    for folder in ("Weather", "Models/Effects", "Aircraft"):
        (tmp_path / folder).mkdir(parents=True)
    write(tmp_path / "Weather" / "cloud.ac", cube())
    write(tmp_path / "Models" / "Effects" / "taxilamp.ac", cube())
    write(tmp_path / "Aircraft" / "billboard.ac", flat())
    write(tmp_path / "Aircraft" / "RedLight10.ac", cube())
    write(tmp_path / "Aircraft" / "strobe-2.ac", cube())
    write(tmp_path / "Aircraft" / "lighthouse.ac", cube())
    write(tmp_path / "Aircraft" / "street-light.ac", *[cube() for _ in range(9)])
    catalogue = open_catalogue("ac3d", tmp_path)
    reasons = {}
    for entry in catalogue.models:
        try:
            entry.load()
            reasons[entry.model_id.removeprefix("Aircraft/")] = ""
        except UnusableModelError as error:
            reasons[entry.model_id.removeprefix("Aircraft/")] = str(error)
    assert reasons == {
        "RedLight10.ac": "no object: its name ('light') and its 12 faces are those of a light or "
        "smoke",
        "billboard.ac": "no object: it is flat, like a billboard or a decal",
        "lighthouse.ac": "",
        "strobe-2.ac": "no object: its name ('strobe') and its 12 faces are those of a light or "
        "smoke",
        "street-light.ac": "",
    }

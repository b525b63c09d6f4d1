import contextlib

import numpy as np
import pytest
from helpers.looks import BLUE, RED, colours
from helpers.obj_text import CUBE, FACES, QUADS, RED_BLUE, png
from helpers.refusals import all_refused, check_message

from data_gen.mesh import UnusableModelError, kind_of_warning
from data_gen.readers import textures
from data_gen.readers.load import load_model
from data_gen.readers.model_files import FolderFiles
from data_gen.readers.obj import _blocks, read_obj


@pytest.mark.parametrize("line", ["v {} 0 0", "vt {} 0", "vn {} 0 0"])
def test_a_number_that_overflows_is_refused_or_left_out(write, line):
    """Without a warning of NumPy, which tests make an error."""
    for number in ("1e154", "1e155", "1e300"):
        lines = ["v 1 0 0", "v 0 1 0", "v 0 0 1", "vt 0 0", "vn 0 0 1", line.format(number)]
        path = write("a.obj", "\n".join([*lines, "v 0 0 0", "f 1/1/1 2/2/2 3/1/1 4/1/1"]))
        with contextlib.suppress(UnusableModelError):
            assert np.isfinite(load_model(path).vertices).all()


@pytest.mark.parametrize(
    "face",
    ["f 1 2 3", "f 1/1 2/2 3/3", "f 1//1 2//1 3//1", "f 1/1/1 2/2/1 3/3/1",
     "f -3/-3/-1 -2/-2/-1 -1/-1/-1", "f 1/ 2/2 3//1", "f  1 \\\n 2 3 # a comment"],
)  # fmt: skip
def test_every_form_of_a_corner(write, face):
    head = "v 0 0 0 1 0 0\nv 1 0 0 1 0 0\nv 0 1 0 1 0 0\nvt 0 0\nvt 1 0 0\nvt 0 1\nvn 0 0 1\n"
    model = load_model(write("a.obj", head + face + "\n"))
    assert len(model.faces) == 1
    np.testing.assert_allclose(model.normals, [[[1, 0, 0]] * 3], atol=1e-6)


def test_blocks_of_lines_do_not_change_the_arrays(tmp_path, monkeypatch):
    lines = []
    for k in range(60):  # corners in all forms, continued lines, both ends of a line
        lines += [f"v {np.cos(k)} {np.sin(k)} {k}", f"vt {k} 0", "vn 0 0 1", f"usemtl {k % 2}"]
        forms = ("f 1 2 3", "f -1/-1 -2/-2 -3/-3", "f 1//1 \\\n-1//-1 2//2", "f 1/1/1 2/2 -1")
        lines += [forms[k % 4]] * (k > 2)
    text = "\n".join(lines[:150]) + "\r\n" + "\r\n".join(lines[150:])
    (whole,) = read_obj(text.encode(), textures.Assets(FolderFiles(tmp_path)))
    assert len(whole.counts) == 57
    np.testing.assert_array_equal(whole.corners[:9], [0, 1, 3, 0, 1, 2, 5, 4, 3])
    monkeypatch.setattr(_blocks, "__defaults__", (64,))
    (parts,) = read_obj(text.encode(), textures.Assets(FolderFiles(tmp_path)))
    for key in ("vertices", "corners", "counts", "uv", "normals", "owner"):
        np.testing.assert_array_equal(getattr(parts, key), getattr(whole, key))


def test_what_is_not_read_is_named(write):
    write("m.mtl", "newmtl a\nmap_Bump x.png\n")
    write("red.mtl", "newmtl a\nmap_Kd x.png\n")
    write("x.png", png((255, 0, 0)))
    painted = CUBE.replace("\n", " 1 0 0\n") + "vt 0 0\n" + "usemtl a\nf 1/1 2/1 3/1\n"
    for text, *words in (
        (CUBE + FACES + "f 1 2 9\n", "missing vertices", 1),
        (CUBE + FACES + "l 1 2 3\np 1\n", "lines"),
        (CUBE + FACES + "curv 0 1 1 2\n", "curves"),
        (f"mtllib m.mtl\n{CUBE}usemtl a\n{FACES}", "map_bump"),
        (f"mtllib red.mtl\n{painted}", "colours of faces with a texture"),
        (f"mtllib red.mtl\n{CUBE}vt 0 0\nusemtl a\nf 1/1 2/9 3/8\n", "coordinates", 2),
        (f"{CUBE}vn 1 0 0\nvn 1.#QNAN -1.#IND00 -nan(ind)\nf 1//1 2//2 3//2\n", "normals", 2),
    ):
        (line,) = load_model(write("a.obj", text)).warnings
        check_message(line, *words)


def test_materials_and_missing_files(write):
    materials = {
        "red paint": "Kd 1 0 0\nKs .5 .5 .5\nNs 80\nTr 0.6",
        "picture": "Kd 0 0 0\nmap_Kd some folder\\my picture.png",
        "leaf": "map_Kd my picture.png\nmap_d holes.png",
        "no picture": "Kd 0 0 0\nmap_Kd gone.jpg",
        "plain": "Kd .1 .2 .3\nmap_Kd gone.jpg",
    }
    write("my picture.png", png((10, 20, 30)))
    write("holes.png", png(0, mode="L"))
    write("m.mtl", "".join(f"newmtl {name}\n{text}\n" for name, text in materials.items()))
    names = [*materials, "nothing"]
    body = "".join(f"usemtl {n}\nf {side}\n" for n, side in zip(names, QUADS, strict=True))
    model = load_model(write("a.obj", f"mtllib m.mtl\nmtllib gone.mtl\n{CUBE}{body}"))
    by_name = {m.name: m for m in model.materials}
    red = by_name["red paint"]
    assert (red.diffuse, red.specular, red.shininess) == ((1, 0, 0), (0.5, 0.5, 0.5), 80)
    assert red.opacity == pytest.approx(0.4)
    assert by_name["picture"].diffuse == (1, 1, 1)
    assert by_name["picture"].texture[0, 0].tolist() == [10, 20, 30, 255]
    assert by_name["leaf"].texture[0, 0].tolist() == [10, 20, 30, 0]
    assert by_name["no picture"].texture is None
    assert by_name["no picture"].diffuse == (0.6, 0.6, 0.6)
    assert by_name["plain"].diffuse == (0.1, 0.2, 0.3)
    assert len(model.warnings) == len({kind_of_warning(w) for w in model.warnings}) == 4
    for word in ("'nothing'", "gone.mtl", "gone.jpg", "'picture', 'leaf'"):
        assert word in " ".join(model.warnings)


@pytest.mark.parametrize("name", ["looks/c.mtl", r".\my chair.mtl", r"looks\my chair.mtl"])
def test_textures_beside_the_material_file_and_byte_order_marks(write, name):
    mark, place = "\ufeff", name.replace("\\", "/")
    beside = place.rpartition("/")[0]
    write(place, f"{mark}newmtl a\nmap_Kd x.png\nnewmtl b\nmap_Kd y.png\n")
    write(f"{beside}/x.png", png((1, 2, 3)))
    write("y.png", png((4, 5, 6)))
    faces = "vt 0 0\n" + "".join(f"f {' '.join(f'{k}/1' for k in q.split())}\n" for q in QUADS)
    body = f"{CUBE}usemtl a\n{faces}usemtl b\n{faces}mtllib {name}\n"
    model = load_model(write("a.obj", mark + body))
    texels = [material.texture[0, 0, :3].tolist() for material in model.materials]
    assert (texels, model.warnings) == ([[1, 2, 3], [4, 5, 6]], ())
    assert len(model.vertices) == 8


def test_mtl_names_and_comments(write):
    """Names that differ in bytes stay apart, and comments after names do not matter."""
    for encoding, names in (
        ("latin-1", ("tür", "töt")),
        ("gbk", ("椅子", "桌子")),
        ("big5", ("椅", "許")),
        ("utf-8", ("a", "ä")),
    ):
        text = "".join(f"newmtl {n}\nKd {k} 0 {1 - k}\n" for k, n in enumerate(names))
        write("m.mtl", text.encode(encoding))
        faces = "".join(f"usemtl {n}\nf {q}\n" for n, q in zip(names, QUADS, strict=False))
        model = load_model(write("a.obj", ("mtllib m.mtl\n" + CUBE + faces).encode(encoding)))
        assert [m.diffuse for m in model.materials] == [BLUE, RED]
        assert model.warnings == ()
        assert all(m.name.isprintable() for m in model.materials)
    write("m.mtl", "newmtl a b  # 1\nKd 1 0 0\nnewmtl M #2\nKd 0 0 1 # 3\n")
    faces = f"usemtl a b\nf {QUADS[0]}\nusemtl M #2\nf {QUADS[1]} # 4\n"
    model = load_model(write("a.obj", f"mtllib m.mtl # 0\n{CUBE}{faces}"))
    assert (colours(model), model.warnings) == ([RED] * 2 + [BLUE] * 2, ())


@pytest.mark.parametrize(
    ("statement", "shown"),
    [
        ("map_Kd x.png", RED), ("map_Kd -s 3 1 1 x.png", BLUE), ("map_Kd -o .5 0 0 x.png", BLUE),
        ("map_Kd -clamp on -mm 0 1 -bm 1 -s 1 1 1 x.png", RED), ("map_Ka x.png", RED),
        ("map_Kd -s 5 1 1 x.png", RED), ("map_Kd -clamp on -s 5 1 1 x.png", BLUE),
        ("map_Kd -mm 0 .5 x.png", (0.5, 0, 0)), ("map_Kd \\\n x.png", RED),
        ("map_Kd -colorspace sRGB x.png", RED), ("Kd 51 102 204", (0.2, 0.4, 0.8)),
        ("map_Kd -blendu on -texres 9 -imfchan l -boost 1 -t 0 0 0 x.png", RED),
    ],
)  # fmt: skip
def test_mtl_options_of_textures(write, statement, shown):
    write("x.png", RED_BLUE)
    write("m.mtl", f"newmtl a\n{statement}\n")
    text = f"mtllib m.mtl\nvt .25 .5\n{CUBE}usemtl a\nf 1/1 2/1 3/1\nf 4/1 5/1 6/1\n"
    model = load_model(write("a.obj", text))
    np.testing.assert_allclose(colours(model), [shown] * 2, atol=0.01)
    assert model.warnings == ()


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-8-sig"])
@pytest.mark.parametrize("end", ["\n", "\r", "\r\n"])
def test_encodings_and_line_ends(write, encoding, end):
    text = CUBE + "f 4 3 \\\n2 1\n" + FACES
    data = text.replace("\n", end).encode(encoding)
    assert len(load_model(write("a.obj", data)).faces) == 14


def test_obj_files_that_are_refused(write):
    table = (
        ("", "empty"),
        (CUBE, "8 points"),
        (CUBE + "f 1 2 99", "vertices"),
        (CUBE + "l 1 2", "8 points", "1 lines"),
        (CUBE + "f 0 1 2", "index 0"),
        (CUBE.replace("v 1 1 1", "v nan 1 1") + FACES, "finite"),
        (CUBE + "f 1 2 x", "number"),
        (CUBE + f"f 1 2 {10**23}", "number"),
        (CUBE + FACES * 5000, "60000 faces", "limit of 1000"),
        (CUBE + "f 1\n" * 2000, "2000 faces"),
    )
    read = lambda text: load_model(write("a.obj", text), max_faces=1000)  # noqa: E731
    all_refused(read, UnusableModelError, table)

import numpy as np
import pytest
from helpers.looks import BLUE, GREY, RED, area, colours
from helpers.obj_text import png
from helpers.refusals import all_refused, check_message, refused

from data_gen.mesh import UnusableModelError
from data_gen.readers.load import load_model

SQUARE = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
HALVES = [(0, 1, 2), (0, 2, 3)]
RGB = "uchar red,uchar green,uchar blue"


def rows(*columns):
    return [" ".join(map(str, row)) for row in columns]


def ply(vertices=(), faces=(), properties="", of_faces="", head="", more="", form="ascii"):
    """A file of lines of numbers; other properties follow x, y, z and the corners of faces."""
    vertices = vertices or rows(*SQUARE)
    faces = rows(*((3, *f) for f in HALVES)) if faces == () else faces
    lines = ["ply", f"format {form} 1.0", *head.split("|"), f"element vertex {len(vertices)}"]
    lines += [f"property float {c}" for c in "xyz"]
    lines += [f"property {p}" for p in properties.split(",")] if properties else []
    if faces:
        lines += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    lines += [f"property {p}" for p in of_faces.split(",")] if of_faces else []
    text = "\n".join([*filter(None, lines), *filter(None, more.split("|")), "end_header", ""])
    return text + ("\n".join([*vertices, *faces, ""]) if form == "ascii" else "")


def with_each(lines, text):
    return [f"{line} {text}" for line in lines]


STRIPS = "element tristrips 1|property list int int vertex_indices"
PLAIN, TRIANGLES = rows(*SQUARE), rows(*((3, *f) for f in HALVES))


@pytest.mark.parametrize("form", ["binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize("mixed", [False, True])
def test_ply_binary(write, form, mixed):
    order = "<" if "little" in form else ">"
    faces = [(0, 1, 2, 3)] if mixed else []
    data = ply(faces=["-"] * (2 + mixed), of_faces="list uchar float texcoord", form=form).encode()
    data += np.array(SQUARE, f"{order}f4").tobytes()
    for face in HALVES + faces:
        data += bytes([len(face)]) + np.array(face, f"{order}i4").tobytes() + b"\6"
        data += np.arange(6, dtype=f"{order}f4").tobytes()
    model = load_model(write("a.ply", data))
    assert len(model.faces) == 2 + 2 * mixed
    assert area(model) == pytest.approx(1 + mixed)
    assert any("texcoord" in w for w in model.warnings) == mixed  # 6 numbers for 4 corners
    check_message(load_model(write("a.ply", data + b"abc")).warnings[0], "after the data", 3)
    for cut in (3, 60):
        with refused(UnusableModelError, "face", 2 + mixed):
            load_model(write("a.ply", data[:-cut]))
    # After a carriage return, the first byte of the data may be that of a line feed.
    head, _, body = data.partition(b"end_header\n")
    for first in (b"\x0a\x0a\x0a\x0a", b"\0\0\0\0"):
        old_mac = head.replace(b"\n", b"\r") + b"end_header\r" + first + body[4:]
        assert len(load_model(write("a.ply", old_mac)).faces) == 2 + 2 * mixed


@pytest.mark.parametrize(
    ("properties", "more", "shown"),
    [
        (RGB, "255 0 0", RED),
        ("float red,float green,float blue", "1 0 0", RED),
        ("float red,float green,float blue", "255.0 0 0", RED),
        ("double r,double g,double b", "0 0 1", BLUE),
        ("float red,float green,float blue", "1.02 0 0", RED),
        ("ushort red,ushort green,ushort blue", "65535 0 0", RED),
        ("short red,short green,short blue", "255 0 0", RED),
        (f"{RGB},float alpha", "255 0 0 1", RED),
        ("uchar diffuse_red,uchar diffuse_green,uchar diffuse_blue", "0 0 255", BLUE),
        (f"float s,float t,{RGB}", "0 0 255 0 0", RED),
        ("float s,float t", "0 0", GREY),
    ],
)
def test_ply_colours(write, properties, more, shown):
    path = write("a.ply", ply(with_each(PLAIN, more), properties=properties))
    assert colours(load_model(path)) == [shown] * 2


def test_ply_several_textures(write):
    write("red.png", png((255, 0, 0)))
    write("blue one.png", png((0, 0, 255)))
    head = "comment TextureFile red.png|comment TextureFile blue%20one.png"
    wedges, number = "list uchar float texcoord", "list uchar float texcoord,int texnumber"
    faces = [f"{face} 6 0 0 1 0 1 1 {k}" for k, face in enumerate(TRIANGLES)]
    some = [face[:-2] for face in faces]
    strips = ply(faces=some, head="comment TextureFile red.png", of_faces=wedges, more=STRIPS)
    for text, shown in (
        (ply(faces=faces, head=head, of_faces=number), [RED, BLUE]),
        (ply(faces=[faces[0], faces[1][:-1] + "-1"], head=head, of_faces=number), [RED, GREY]),
        (ply(faces=[faces[0], f"{TRIANGLES[1]} 0 1"], head=head, of_faces=number), [RED, GREY]),
        (strips + "4 0 1 3 2\n", [RED, RED, GREY, GREY]),
        (ply(faces=some, head=head, of_faces=wedges), [RED, RED]),
    ):
        model = load_model(write("a.ply", text))
        assert colours(model) == shown
    check_message(model.warnings[0], "texnumber")


def test_ply_what_is_not_read_is_named(write):
    red, red_faces = with_each(PLAIN, "255 0 0"), with_each(TRIANGLES, "255 0 0")
    assert colours(load_model(write("a.ply", ply(faces=red_faces, of_faces=RGB)))) == [RED] * 2
    for text, *words in (
        (ply(faces=["3 0 1 2", "3 0 2 9"]), "missing vertices"),
        (ply(red, red_faces, RGB, RGB), "colours of faces beside"),
        (ply(with_each(red, "0"), properties=f"{RGB},uchar alpha"), "alpha 0"),
        (ply(more="element edge 1|property int vertex1") + "0\n", "edge"),
        (ply().replace("\n", "\r") + "more\r", "after the data"),
    ):
        (line,) = load_model(write("a.ply", text)).warnings
        check_message(line, *words)


def test_ply_headers_and_strips(write):
    text = ply(head="comment Jürgen|obj_info a|").replace("element", "\n  element ")
    text = text.encode("latin-1")
    blank = text.replace(b"0 1 0\n", b"0 1 0\n\n \n")
    other = text.replace(b"indices", b"index")
    for data in (text, b"\xef\xbb\xbf" + text, text.replace(b"\n", b"\r\n"), blank, other):
        model = load_model(write("a.ply", data))
        assert (area(model), model.warnings) == (1, ())
    lost = ply(head="Created by Blender3D")
    assert load_model(write("a.ply", lost)).warnings[0].startswith("lines of the header not read")
    empty = ply(faces=with_each(TRIANGLES, "0"), of_faces="list uchar float texcoord")
    assert load_model(write("a.ply", empty)).warnings == ()
    points = rows(*((k // 2, k % 2, 0) for k in range(8)))
    strips = ply(points, faces=[], more=STRIPS) + "9 0 1 2 3 4 -1 4 5 7\n"
    model = load_model(write("a.ply", strips))
    assert len(model.faces) == 4
    both = ply(points, ["3 0 1 2 255 0 0"], of_faces=RGB, more=STRIPS) + "4 4 5 6 7\n"
    assert colours(load_model(write("b.ply", both))) == [RED, GREY, GREY]
    assert len({tuple(n) for n in model.normals[:3, 0].round(3)}) == 1  # the same side of a strip
    table = (
        (ply(faces=[]), "4 points", "faces"),
        (ply().replace("float z", "float w"), "x, y and z"),
        ("x" + ply(), "ply"),
        (ply().replace("end_header", ""), "end_header"),
        (ply().replace("face 2", "face 999999999"), "999999999 faces", "400000"),
        (ply().replace("vertex 4", "vertex 999999999"), "vertex"),
        (ply().replace("0 0 0", "a 0 0"), "number"),
        (ply().replace("\n1 0 0", "\n1 0"), "vertex"),
        (ply(with_each(PLAIN, "256 0 0"), properties=RGB), "red"),
        (ply().replace("float z", "float"), "property float"),
        (ply(more="element face 2"), "element face 2"),
        (ply(faces=["-1 0 1 2"]), "-1.0"),
    )
    all_refused(lambda text: load_model(write("a.ply", text)), UnusableModelError, table)

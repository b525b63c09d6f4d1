import pytest
from helpers.looks import BLUE, GREY, RED, area, colours
from helpers.refusals import all_refused, check_message

from data_gen.mesh import UnusableModelError
from data_gen.readers.load import load_model

POINTS = ["0 0 0", "1 0 0", "1 1 0", "0 1 0"]
FACES = ["3 0 1 2", "3 0 2 3"]
U = [(0, 0), (3, 0), (3, 3), (2, 3), (2, 1), (1, 1), (1, 3), (0, 3)]


def off(points=POINTS, faces=FACES, head="OFF\n", after=("", "")):
    lines = [f"{p} {after[0]}" for p in points]
    lines += [f"{face} {after[1]}" for face in faces]
    return head + f"{len(points)} {len(faces)} 0\n" + "\n".join([*lines, ""])


@pytest.mark.parametrize(
    ("head", "after", "shown"),
    [
        ("OFF\n", ("", ""), GREY),
        ("COFF\n", ("1 0 0 1", ""), RED),
        ("COFF\n", ("0 0 255", ""), BLUE),
        ("NOFF\n", ("0 0 1", ""), GREY),
        ("NCOFF\n", ("0 0 1 255 0 0 255", ""), RED),
        ("CNOFF\n", ("0 0 1 1.0 0 0 1", "3 0 1"), RED),
        ("STOFF\n", ("0.5 0.5", ""), GREY),
        ("STCNOFF\n", ("0 0 1 0 0 1 1 0.5 0.5", ""), BLUE),
        ("OFF\n", ("", "255 0 0"), RED),
        ("OFF\n", ("", "0 0 1.0 0.5"), BLUE),
        ("OFF ", ("", ""), GREY),
        ("OFF", ("", ""), GREY),  # as in some files of ModelNet
        ("", ("", ""), GREY),
        ("# a\n\n OFF # b\n# c\n", ("# d", "# e"), GREY),
        ("\ufeffOFF\r\n", ("", ""), GREY),
    ],
)
def test_off_headers_and_colours(write, head, after, shown):
    model = load_model(write("a.off", off(head=head, after=after)))
    assert (area(model), colours(model)) == (1, [shown] * 2)


def test_off_polygons_free_form_and_refusals(write):
    model = load_model(write("a.off", off([f"{x} {y} 0" for x, y in U], ["8 0 1 2 3 4 5 6 7"])))
    assert area(model) == pytest.approx(7 / 9)
    assert len(load_model(write("a.off", off(faces=["4 0 1 2 3", "3 0 1 2"]))).faces) == 3
    assert area(load_model(write("a.off", " ".join(off().split())))) == 1
    assert area(load_model(write("a.off", off().replace("4 2 0\n", "4\n2\n0\n")))) == 1
    for text, word in (
        (off(head="COFF\n", after=("255 0 0", "0 0 1")), "colours of faces beside"),
        (off(head="COFF\n", after=("255 0 0 0", "")), "alpha 0"),
        (off(after=("", "3")), "colour map"),
        (off().replace("\n", "\r") + "1 2\r", "after the data"),
    ):
        (line,) = load_model(write("a.off", text)).warnings
        check_message(line, word)
    table = (
        (off(head="4OFF\n"), "4OFF"),
        (off(head="nOFF\n3\n"), "nOFF"),
        ("OFF BINARY\n", "binary"),
        (off([p[2:] for p in POINTS]), "2 announced, 1"),
        (off().rpartition("3 0")[0], "faces: 2 announced, 1"),
        (off(faces=[]).replace("0 1 0", ""), "vertices: 4 announced, 3"),
        (off().replace("4 2 0", "4 999999999 0"), "999999999 faces", "400000"),
        (off(faces=["3 0 1 x"]), "number"),
        (off(["0 0 0", "1 0 0 9", *POINTS[2:]]), "vertices"),
        (off(faces=["-3 0 1 2"]), "number"),
        ("OFF\nabc\n", "vertices"),
        ("abc\n", "OFF"),
    )
    all_refused(lambda text: load_model(write("a.off", text)), UnusableModelError, table)

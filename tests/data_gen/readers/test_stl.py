import numpy as np
import pytest
from helpers.looks import BLUE, GREY, RED, area, colours
from helpers.refusals import all_refused, check_message

from data_gen.mesh import UnusableModelError
from data_gen.readers.load import load_model

FACETS = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]], float)


def text(facets=FACETS, name="a"):
    lines = [f"solid {name}"]
    for facet in facets:
        corners = [f"vertex {x} {y} {z}" for x, y, z in facet]
        lines += ["facet normal 0 0 1", "outer loop", *corners, "endloop", "endfacet"]
    return "\n".join([*lines, f"endsolid {name}", ""])


def binary(facets=FACETS, words=(0, 0), head=b"", count=None):
    kind = [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("word", "<u2")]
    rows = np.zeros(len(facets), kind)
    rows["corners"], rows["word"] = facets, words
    number = len(facets) if count is None else count
    return head.ljust(80, b"\0") + number.to_bytes(4, "little") + rows.tobytes()


@pytest.mark.parametrize(
    "content",
    [
        text(), binary(), "\ufeff" + text(), text().encode("utf-16"), text().upper(),
        text().replace("\n", "\r"), text().replace("\n", " "), text().partition("\n")[2],
        text(name="x" * 5000), text(name="vertex 1 2 3"), text(FACETS[:1]) + text(FACETS[1:]),
        text() + "; vertex 1 2 3\n\0\0", "\n\n  " + text(),
        binary(head=b"solid a\nfacet normal vertex"), binary(head=b"vertex 1 2 3 ".ljust(80, b"x")),
    ],
)  # fmt: skip
def test_stl_text_and_binary(write, content):
    model = load_model(write("a.stl", content))
    assert (len(model.faces), area(model), model.warnings) == (2, 1, ())


def test_stl_counts_and_refusals(write):
    (line,) = load_model(write("a.stl", binary() + b"abc")).warnings
    check_message(line, "after the data", 3)
    model = load_model(write("a.stl", binary(count=0)))
    assert (len(model.faces), len(model.warnings)) == (2, 1)
    table = (
        (text().rpartition("endsolid")[0], "cut off", "endsolid"),
        (text() + text().rpartition("endsolid")[0], "cut off", "endsolid"),
        (text().rpartition("facet normal")[0], "cut off", "endsolid"),
        (binary(count=3), "3 announced, 2"),
        (binary(count=5_000_000), "5000000 faces", "400000"),
        (text().replace("vertex 0.0 1.0 0.0\n", ""), "2 facets", "5 corners"),
        (text()[::-1].replace("endloop"[::-1], "", 1)[::-1], "2 facets", "6 corners"),
        (text().replace("1.0", "1,0"), "number"),
        (text().replace("vertex 1.0", "vertex nan"), "finite"),
        ("solid a\nendsolid a\n", "facets"),
        (binary(FACETS[:0], (), head=b"a"), "no faces"),
        (binary(count=1)[:100], "1 announced, 0"),
    )
    all_refused(lambda content: load_model(write("a.stl", content)), UnusableModelError, table)


def word(red, green, blue, top):
    return top << 15 | red << 10 | green << 5 | blue


@pytest.mark.parametrize(
    ("words", "head", "shown"),
    [
        ((word(31, 0, 0, 1), word(0, 0, 31, 1)), b"", [RED, BLUE]),
        ((word(31, 0, 0, 1), word(0, 0, 31, 0)), b"", [RED, GREY]),
        ((word(31, 0, 0, 0), 0), b"", [GREY, GREY]),
        ((word(0, 0, 31, 0), word(0, 0, 0, 1)), b"COLOR=\x00\x00\xff\xff", [RED, BLUE]),
        ((0, 0), b"abc COLOR=\xff\x00\x00\xff,MATERIAL=", [RED, RED]),
    ],
)
def test_stl_colours_of_viscam_and_magics(write, words, head, shown):
    model = load_model(write("a.stl", binary(words=words, head=head)))
    assert colours(model) == shown
    assert not model.materials[0].has_alpha  # texels of its palette that are not used

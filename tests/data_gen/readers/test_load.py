import bz2
import gzip
import lzma
import random
import re

import pytest
from helpers.obj_text import CUBE, FACES, zipped
from helpers.refusals import all_refused
from helpers.xml_models import dae, primitive

from data_gen.mesh import UnusableModelError
from data_gen.readers import load
from data_gen.readers.load import READERS, load_model

OBJ = CUBE + FACES


@pytest.mark.parametrize("kind", sorted(READERS))
def test_reasons(write, kind):
    table = (
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:00\n", "git lfs pull"),
        (b"/annex/objects/MD5E-s1--a.obj\n", "git annex get"),
        (b"\n <!DOCTYPE HTML><html>", "web page"),
        (b"", "empty"),
        (bytes(1000), "zeros"),
        (gzip.compress(OBJ.encode()), "gzip"),
        (bz2.compress(OBJ.encode()), "bzip2"),
        (lzma.compress(OBJ.encode()), "xz"),
        (zipped({"a.obj": OBJ}), {"zae": ".dae", "3mf": "3MF"}.get(kind, "zip")),
    )
    all_refused(lambda data: load_model(write(f"a.{kind}", data)), UnusableModelError, table)


def test_other_suffixes_are_named(write):
    table = (("xyzzy", "'xyzzy'", *READERS), ("", "''", *READERS))
    all_refused(lambda kind: load_model(write(f"a.{kind}", OBJ)), UnusableModelError, table)


def test_reasons_of_compressed_files(write, monkeypatch):
    monkeypatch.setattr(load, "MAX_FILE_BYTES", 10_000)
    for texts in ((OBJ,), (CUBE, FACES)):
        members = b"".join(gzip.compress(text.encode()) for text in texts)
        assert len(load_model(write("a.obj.gz", members)).faces) == 12
    table = (
        (gzip.compress(OBJ.encode())[:-20], "cut off"),
        (b"abc", "gzip"),
        (gzip.compress(bytes(20_000)), "10001 bytes", "10000"),
    )
    all_refused(lambda data: load_model(write("a.obj.gz", data)), UnusableModelError, table)


# Words of Python and its libraries, which a reason must not have.
PYTHON = r"\w+(Error|Exception)\b|object has no|<_io|NoneType|literal|not convert|out of bounds"


def broken(data, rng):
    """The bytes cut off, or with some of them changed, removed, repeated or inserted."""
    place, more = rng.randrange(len(data)), rng.randbytes(rng.randrange(1, 9))
    stop = place + rng.randrange(1, 40)
    match rng.randrange(5):
        case 0:
            return data[:place]
        case 1:
            return data[:place] + more + data[place + len(more) :]
        case 2:
            return data[:place] + data[stop:]
        case 3:
            return data[:stop] + data[place:]
    return data[:place] + bytes(rng.choices(b"0123456789.-e ", k=3)) + data[place + 3 :]


@pytest.mark.parametrize("kind", ["obj", "ply", "ascii.ply", "off", "stl", "ascii.stl", "dae"])
def test_broken_files_are_refused_or_read(trimesh, write, kind):
    box, ending = trimesh.creation.box(), kind.rpartition(".")[2]
    box.visual.vertex_colors = [255, 0, 0, 255]
    if kind == "dae":
        points, corners = (" ".join(map(str, a.ravel())) for a in (box.vertices, box.faces))
        data = dae(primitive("triangles", f"<p>{corners}</p>", points))
    elif kind == "ascii.stl":
        data = trimesh.exchange.stl.export_stl_ascii(box).encode()
    elif kind == "ascii.ply":
        data = trimesh.exchange.ply.export_ply(box, encoding="ascii")
    else:
        data = box.export(file_type=kind)
    data = data if isinstance(data, bytes) else data.encode()
    rng, reasons = random.Random(0), []
    for _ in range(120):
        path = write(f"a.{ending}", broken(data, rng))
        try:
            load_model(path)
        except UnusableModelError as error:
            reasons.append(str(error))
    assert len(reasons) > 20
    assert [reason for reason in reasons if re.search(PYTHON, reason)] == []

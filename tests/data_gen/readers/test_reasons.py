import bz2
import gzip
import io
import lzma
import zipfile

import pytest
from helpers.obj_text import CUBE, FACES
from helpers.refusals import all_refused

from data_gen.mesh import UnusableModelError
from data_gen.readers import load
from data_gen.readers.load import READERS, load_model

OBJ = CUBE + FACES


def zipped(text):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        archive.writestr("a.obj", text)
    return stream.getvalue()


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
        (zipped(OBJ), {"zae": ".dae", "3mf": "3MF"}.get(kind, "zip")),
    )
    all_refused(lambda data: load_model(write(f"a.{kind}", data)), UnusableModelError, table)


def test_other_suffixes_are_named(write):
    table = (("xyzzy", "'xyzzy'", *READERS), ("", "''", *READERS))
    all_refused(lambda kind: load_model(write(f"a.{kind}", OBJ)), UnusableModelError, table)


def test_reasons_of_compressed_files(write, monkeypatch):
    monkeypatch.setattr(load, "MAX_FILE_BYTES", 10_000)
    assert len(load_model(write("a.obj.gz", gzip.compress(OBJ.encode()))).faces) == 12
    table = (
        (gzip.compress(OBJ.encode())[:-20], "cut off"),
        (b"abc", "gzip"),
        (gzip.compress(bytes(20_000)), "10001 bytes", "10000"),
    )
    all_refused(lambda data: load_model(write("a.obj.gz", data)), UnusableModelError, table)

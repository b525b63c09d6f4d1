import bz2
import gzip
import io
import lzma
import re
import zipfile

import pytest
from helpers.obj_text import CUBE, FACES

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
    for words, content in {
        "it is a Git LFS pointer": b"version https://git-lfs.github.com/spec/v1\noid sha256:00\n",
        "it is a pointer of git-annex": b"/annex/objects/MD5E-s1--a.obj\n",
        "it is a web page": b"\n <!DOCTYPE HTML><html>",
        "it is empty": b"",
        "contains only zeros": bytes(1000),
        "compressed by gzip": gzip.compress(OBJ.encode()),
        "compressed by bzip2": bz2.compress(OBJ.encode()),
        "compressed by xz": lzma.compress(OBJ.encode()),
        "compressed by zip|no .dae file|not readable as 3MF": zipped(OBJ),
    }.items():
        with pytest.raises(UnusableModelError, match=words):
            load_model(write(f"a.{kind}", content))


def test_other_suffixes_are_named(write):
    for kind in ("xyzzy", ""):
        with pytest.raises(UnusableModelError, match=f"format '{kind}': expected one of"):
            load_model(write(f"a.{kind}", OBJ))


def test_reasons_of_files_beside_a_model(write):
    pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:00\n"
    write("m.mtl", pointer)
    write("n.mtl", "newmtl a\nmap_Kd x.png\n")
    write("x.png", pointer)
    model = load_model(write("a.obj", f"mtllib m.mtl n.mtl\nusemtl a\n{OBJ}"))
    assert [line.partition(": ")[0] for line in model.warnings] == [
        "material files not readable",
        "textures not readable, the plain colour is used",
    ]
    assert all("it is a Git LFS pointer" in line for line in model.warnings)


def test_reasons_have_no_words_of_python(write, monkeypatch):
    def broken(data, assets):
        raise UnboundLocalError("cannot access local variable 'access'")

    monkeypatch.setitem(load.READERS, "obj", broken)
    with pytest.raises(UnusableModelError) as caught:
        load_model(write("a.obj", OBJ))
    assert str(caught.value) == "not readable as OBJ: the file is damaged"
    assert not re.search(r"\w+Error", str(caught.value))


def test_reasons_of_compressed_files(write, monkeypatch):
    monkeypatch.setattr(load, "MAX_FILE_BYTES", 10_000)
    assert len(load_model(write("a.obj.gz", gzip.compress(OBJ.encode()))).faces) == 12
    for words, content in {
        "cut off": gzip.compress(OBJ.encode())[:-20],
        "not readable as gzip": b"abc",
        "gzip file: 10001 bytes are more than the limit": gzip.compress(bytes(20_000)),
    }.items():
        with pytest.raises(UnusableModelError, match=words):
            load_model(write("a.obj.gz", content))

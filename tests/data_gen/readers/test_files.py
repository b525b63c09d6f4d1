import pytest
from helpers.obj_text import CUBE, FACES, png

from data_gen.mesh import UnusableModelError
from data_gen.readers import files as reader_files
from data_gen.readers.files import FolderFiles
from data_gen.readers.load import load_model


@pytest.mark.parametrize(
    "name", ["../secret.png", "/etc/hostname", "C:\\x\\secret.png", "..\\secret.png"]
)
def test_nothing_outside_of_the_root_is_read(write, tmp_path, name):
    write("secret.png", png((255, 0, 0)))
    write("root/m.mtl", f"newmtl a\nmap_Kd {name}\n")
    write("root/a.obj", f"mtllib m.mtl\n{CUBE}usemtl a\n{FACES}")
    model = load_model(tmp_path / "root" / "a.obj")
    assert model.materials[0].texture is None
    assert any("missing" in w for w in model.warnings)


def test_a_reference_may_go_up_inside_the_root(write, tmp_path):
    write("images/x.PNG", png((1, 2, 3)))
    write("models/m.mtl", "newmtl a\nmap_Kd ../images/X.png\n")
    write("models/a.obj", f"mtllib m.mtl\n{CUBE}usemtl a\n{FACES}")
    model = load_model("models/a.obj", FolderFiles(tmp_path))
    assert model.materials[0].texture is not None


def test_a_large_file_is_refused(write, monkeypatch):
    monkeypatch.setattr(reader_files, "MAX_FILE_BYTES", 100)
    with pytest.raises(UnusableModelError, match="more than the limit of 100"):
        load_model(write("a.obj", CUBE + FACES))

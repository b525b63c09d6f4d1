import os
import unicodedata

import pytest
from helpers.obj_text import CUBE, FACES, png
from helpers.refusals import all_refused, refused

from data_gen.mesh import UnusableModelError
from data_gen.readers import model_files
from data_gen.readers.load import load_model
from data_gen.readers.model_files import FolderFiles


@pytest.mark.parametrize(
    "name", ["../secret.png", "/etc/hostname", "C:\\x\\secret.png", "..\\secret.png"]
)
def test_nothing_outside_of_the_root_is_read(write, tmp_path, name):
    write("secret.png", png((255, 0, 0)))
    write("root/m.mtl", f"newmtl a\nmap_Kd {name}\n")
    model = load_model(write("root/a.obj", f"mtllib m.mtl\n{CUBE}usemtl a\n{FACES}"))
    assert model.materials[0].texture is None
    assert any("missing" in w for w in model.warnings)
    assert FolderFiles(tmp_path / "root").find(name) is None


def test_names_may_go_up_inside_the_root_and_need_not_be_ascii(write, tmp_path):
    write("images/x.PNG", png((1, 2, 3)))
    write("Stühle/größe.mtl", "newmtl Öl\nKd 1 0 0\nmap_Kd ../images/X.png\n")
    of_a_mac = unicodedata.normalize("NFD", "größe.mtl")
    write("Stühle/стул 椅子.obj", f"mtllib {of_a_mac}\n{CUBE}usemtl Öl\n{FACES}")
    model = load_model("Stühle/стул 椅子.obj", FolderFiles(tmp_path))
    assert model.materials[0].texture is not None


def test_links_that_lead_out_are_not_followed(write, tmp_path):
    secret = write("secret.png", png((255, 0, 0)))
    write("root/in.png", png((0, 255, 0)))
    (tmp_path / "root" / "out.png").symlink_to(secret)
    (tmp_path / "root" / "linked.png").symlink_to("in.png")
    write("root/m.mtl", "newmtl a\nmap_Kd out.png\nnewmtl b\nmap_Kd linked.png\n")
    write("root/a.obj", f"mtllib m.mtl\n{CUBE}usemtl a\n{FACES}usemtl b\n{FACES}")
    model = load_model("a.obj", FolderFiles(tmp_path / "root"))
    assert model.materials[0].texture is None
    assert model.materials[1].texture[0, 0].tolist() == [0, 255, 0, 255]
    (tmp_path / "root" / "b.obj").symlink_to(write("b.obj", CUBE + FACES))
    with refused(UnusableModelError, "b.obj", "link"):
        load_model("b.obj", FolderFiles(tmp_path / "root"))
    # The file that the caller names and the root may be links.
    assert len(load_model(tmp_path / "root" / "b.obj").faces) == 12
    (tmp_path / "link").symlink_to(tmp_path / "root")
    assert load_model("a.obj", FolderFiles(tmp_path / "link")).materials[1].texture is not None


def test_what_is_no_file_or_too_large_is_refused(tmp_path, write, monkeypatch):
    os.mkfifo(tmp_path / "a.obj")
    (tmp_path / "b.obj").mkdir()
    table = [("a.obj", "a.obj", "pipe"), ("b.obj", "b.obj", "folder")]
    table += [(name, "missing") for name in ("none.obj", "x" * 5000 + ".obj", "a\0.obj")]
    all_refused(lambda name: load_model(name, FolderFiles(tmp_path)), UnusableModelError, table)
    monkeypatch.setattr(model_files, "MAX_FILE_BYTES", 100)
    with refused(UnusableModelError, "c.obj", "100"):
        load_model(write("c.obj", CUBE + FACES))


def test_textures_of_robots_are_beside_the_folder_of_meshes(write, tmp_path):
    write("cup/materials/textures/texture.png", png((255, 0, 0)))
    write("cup/meshes/model.mtl", "newmtl a\nmap_Kd texture.png\n")
    write("cup/meshes/model.obj", f"mtllib model.mtl\n{CUBE}usemtl a\n{FACES}")
    model = load_model("cup/meshes/model.obj", FolderFiles(tmp_path))
    assert model.materials[0].texture[0, 0].tolist() == [255, 0, 0, 255]

import numpy as np
import pytest
from helpers.obj_text import CUBE, FACES, QUADS, picture, png, png_header
from PIL import Image

from data_gen.readers import textures
from data_gen.readers.load import load_model
from data_gen.readers.model_files import Budget
from data_gen.readers.textures import decode_texture


def test_large_textures_are_not_decoded_or_reduced(write, monkeypatch):
    write("big.png", png_header(30_000, 30_000))
    write("m.mtl", "newmtl a\nKd .2 .4 .6\nmap_Kd big.png\n")
    model = load_model(write("a.obj", f"mtllib m.mtl\n{CUBE}usemtl a\n{FACES}"))
    assert model.materials[0].texture is None
    assert model.materials[0].diffuse == (0.2, 0.4, 0.6)
    assert "more pixels than the limit" in model.warnings[0]
    large = picture(Image.new("RGB", (4000, 2000), (200, 100, 50)), "JPEG")
    monkeypatch.setattr(textures, "MAX_DECODED_PIXELS", 1_000_000)
    texture = decode_texture(large, Budget(), 512)
    assert texture.shape == (256, 512, 4)
    np.testing.assert_allclose(texture[0, 0], [200, 100, 50, 255], atol=4)


@pytest.mark.parametrize("mode", ["1", "L", "LA", "P", "RGB", "RGBA", "I;16", "CMYK"])
def test_modes_of_pictures(mode):
    white = picture(Image.new("L", (300, 200), 255).convert(mode), "TIFF")
    texture = decode_texture(white, Budget(), 100)
    assert texture.shape == (67, 100, 4)
    assert texture.dtype == np.uint8


@pytest.mark.parametrize("order", "<>")
def test_grey_of_16_bits(order):
    grey = picture(np.full((2, 2), 128 << 8, f"{order}u2"), "TIFF")
    assert decode_texture(grey, Budget())[0, 0].tolist() == [127, 127, 127, 255]


@pytest.mark.parametrize("alpha", [0, 255])
def test_a_texture_without_alpha_of_its_own_is_opaque(write, alpha):
    write("dark.png", png((9, 0, 0, alpha), mode="RGBA"))
    write("m.mtl", "newmtl a\nmap_Kd dark.png\nmap_d dark.png\n")
    model = load_model(write("a.obj", f"mtllib m.mtl\nvt 0 0\n{CUBE}usemtl a\nf 1/1 2/1 3/1\n"))
    assert model.materials[0].texture[0, 0].tolist() == [9, 0, 0, 255]
    assert any("alpha 0" in line for line in model.warnings) == (alpha == 0)


def test_many_textures_share_a_budget(write, monkeypatch):
    monkeypatch.setattr(textures, "_MAX_TEXELS", 5000)
    names = [f"t{k}" for k in range(6)]
    for name in names:
        write(f"{name}.png", png((1, 2, 3), (64, 64)))
    write("m.mtl", "".join(f"newmtl {n}\nmap_Kd {n}.png\n" for n in names))
    body = "".join(f"usemtl {n}\nf {q}\n" for n, q in zip(names, QUADS, strict=True))
    model = load_model(write("a.obj", f"mtllib m.mtl\n{CUBE}{body}"))
    assert sum(m.texture.shape[0] * m.texture.shape[1] for m in model.materials) <= 5000
    assert any("textures reduced" in w for w in model.warnings)
    # A texture of several materials counts once.
    write("m.mtl", "".join(f"newmtl {n}\nmap_Kd t0.png\n" for n in names))
    model = load_model(write("a.obj", f"mtllib m.mtl\n{CUBE}{body}"))
    assert not any("reduced" in w for w in model.warnings)
    assert {m.texture.shape for m in model.materials} == {(64, 64, 4)}

import io
import json
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from data_gen.mesh import Material, UnusableModelError, face_areas, face_normals, texels
from data_gen.readers import files as reader_files
from data_gen.readers import obj, textures
from data_gen.readers.files import FolderFiles
from data_gen.readers.load import load_model
from data_gen.readers.notes import Notes
from data_gen.readers.obj import _blocks, read_obj
from data_gen.readers.textures import bounded, decode_texture
from data_gen.surface import sample_surface

CUBE = """\
v -1 -1 -1
v 1 -1 -1
v 1 1 -1
v -1 1 -1
v -1 -1 1
v 1 -1 1
v 1 1 1
v -1 1 1
"""
QUADS = ["4 3 2 1", "5 6 7 8", "1 2 6 5", "2 3 7 6", "3 4 8 7", "4 1 5 8"]
FACES = "".join(f"f {q}\n" for q in QUADS)


def png(colour, size=(4, 4), mode="RGB"):
    stream = io.BytesIO()
    Image.new(mode, size, colour).save(stream, "PNG")
    return stream.getvalue()


@pytest.fixture
def write(tmp_path):
    def write(name, content):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return write


def test_a_plain_cube(write):
    model = load_model(write("cube.obj", CUBE + FACES))
    assert len(model.faces) == 12
    assert model.warnings == ()
    assert model.model_id == "cube.obj"
    outward = model.corners().mean(1) - model.vertices.mean(0)
    assert ((outward * face_normals(model.vertices, model.faces)).sum(1) > 0).all()
    np.testing.assert_allclose(np.linalg.norm(model.vertices, axis=1).max(), 1)


def test_y_is_up_and_z_the_front(write):
    text = "v 0 0 0\nv 1 0 0\nv 0 5 0\nv 0 0 2\nf 1 2 3\nf 1 3 4\nf 1 2 4\nf 2 3 4\n"
    extent = np.ptp(load_model(write("a.obj", text)).vertices, axis=0)
    np.testing.assert_allclose(extent / extent[1], [2, 1, 5])
    extent = np.ptp(load_model(write("a.obj", text), up="+z", front="+x").vertices, axis=0)
    np.testing.assert_allclose(extent / extent[0], [1, 5, 2])


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


def test_negative_indices_count_from_where_they_stand(write):
    one = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\n"
    two = "v 0 0 1\nv 1 0 1\nv 0 1 1\nf -3 -2 -1\n"
    model = load_model(write("a.obj", one + two))
    assert len(model.vertices) == 6


def test_a_concave_polygon_is_not_filled(write):
    # An L of area 3 in a square of area 4, started at every corner.
    outline = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
    for start in range(6):
        turned = outline[start:] + outline[:start]
        text = "".join(f"v {x} {y} 0\n" for x, y in turned) + "f 1 2 3 4 5 6\n"
        model = load_model(write("l.obj", text))
        extent = np.ptp(model.vertices, axis=0).max()
        area = face_areas(model.vertices, model.faces).sum() * 4 / extent**2
        assert area == pytest.approx(3)


def test_materials(write):
    mtl = """\
newmtl red paint
Kd 1 0 0
Ks .5 .5 .5
Ns 80
illum 2
newmtl glass
Kd 0 0 1
d 0.3
newmtl clear
Tr 0.6
newmtl picture
Kd 0 0 0
map_Kd -s 1 1 1 -o 0.5 some folder\\my picture.png
newmtl leaf
map_Kd my picture.png
map_d holes.png
"""
    names = ["red paint", "glass", "clear", "picture", "leaf", "nothing"]
    body = "".join(f"usemtl {n}\nf {q}\n" for n, q in zip(names, QUADS, strict=True))
    write("my picture.png", png((10, 20, 30)))
    write("holes.png", png(0, mode="L"))
    write("things.mtl", mtl)
    model = load_model(write("a.obj", "mtllib things.mtl\n" + CUBE + body))
    by_name = {m.name: m for m in model.materials}
    assert by_name["red paint"].diffuse == (1, 0, 0)
    assert by_name["red paint"].specular == (0.5, 0.5, 0.5)
    assert by_name["red paint"].shininess == 80
    assert by_name["glass"].opacity == pytest.approx(0.3)
    assert by_name["clear"].opacity == pytest.approx(0.4)
    assert by_name["picture"].diffuse == (1, 1, 1)
    assert by_name["picture"].texture[0, 0].tolist() == [10, 20, 30, 255]
    assert by_name["leaf"].texture[0, 0].tolist() == [10, 20, 30, 0]
    assert list(model.warnings) == ["material 'nothing' is missing; grey stands in"]
    sample = sample_surface(model, 500, 0)
    names_of_points = {model.materials[i].name for i in model.face_material[sample.face]}
    assert names_of_points == set(names) - {"leaf"}


def test_missing_files_are_replaced_with_a_warning(write):
    mtl = "newmtl a\nKd 0 0 0\nmap_Kd ../../../../etc/passwd\n"
    mtl += "newmtl b\nKd .1 .2 .3\nmap_Kd gone.jpg\n"
    write("m.mtl", mtl)
    text = f"mtllib m.mtl\nmtllib gone.mtl\n{CUBE}usemtl a\n{FACES}usemtl b\n{FACES}"
    model = load_model(write("a.obj", text))
    assert model.materials[0].texture is None
    assert model.materials[0].diffuse == (0.6, 0.6, 0.6)
    assert model.materials[1].diffuse == (0.1, 0.2, 0.3)
    assert len(model.warnings) == 3
    assert all("missing" in w for w in model.warnings)


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


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("", "empty"),
        ("v 0 0 0\n", "empty"),
        (CUBE, "empty"),
        (CUBE + "f 1 2 99\n", "empty"),
        (CUBE.replace("v 1 1 1", "v nan 1 1") + FACES, "not finite"),
        (CUBE.replace("v 1 1 1", "v 1 inf 1") + FACES, "not finite"),
        (CUBE + "f 1 2 x\n", "not readable"),
        ("v 1 2 abc\n" + CUBE + FACES, "not readable"),
        (CUBE + "f 1 2 99999999999999999999999\n", "not readable"),
        ("v 0 0 0\nv 0 0 0\nv 0 0 0\nf 1 2 3\n", "empty"),
    ],
)
def test_obj_files_that_are_refused(write, text, match):
    with pytest.raises(UnusableModelError, match=match):
        load_model(write("a.obj", text))


def test_a_truncated_obj_keeps_what_is_whole(write):
    text = CUBE + FACES
    for cut in range(len(CUBE) + 20, len(text), 7):
        try:
            model = load_model(write("a.obj", text[:cut]))
        except UnusableModelError:
            continue
        assert 2 <= len(model.faces) <= 12


def test_too_many_faces_are_refused_before_they_are_built(write):
    text = CUBE + FACES * 5000
    with pytest.raises(UnusableModelError, match="limit of 1000 faces"):
        load_model(write("a.obj", text), max_faces=1000)


def stl(count, triangles=()):
    body = b"".join(struct.pack("<12fH", 0, 0, 1, *np.ravel(t), 0) for t in triangles)
    return b"\0" * 80 + struct.pack("<I", count) + body


HEADERS = {
    "a.stl": stl(5_000_000),
    "a.ply": b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    b"property float z\nelement face 5000000\nproperty list uchar int vertex_indices\nend_header\n",
    "a.off": b"OFF\n3 5000000 0\n",
    "a.gltf": json.dumps(
        {"asset": {"version": "2.0"}, "nodes": [{"mesh": 0}] * 100,
         "accessors": [{"count": 200_000}],
         "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}]}
    ).encode(),
}  # fmt: skip


@pytest.mark.parametrize("name", HEADERS)
def test_too_many_faces_are_refused_by_the_header(write, name):
    with pytest.raises(UnusableModelError, match="more than the limit"):
        load_model(write(name, HEADERS[name]))


@pytest.mark.parametrize(
    "name", ["a.stl", "a.ply", "a.off", "a.glb", "a.gltf", "a.obj", "a.xyzzy", "a"]
)
@pytest.mark.parametrize("content", [b"", b"\0" * 100, b"\xff\xfe nonsense \n" * 20])
def test_nonsense_is_refused(write, name, content):
    with pytest.raises(UnusableModelError):
        load_model(write(name, content))


@pytest.mark.parametrize("kind", ["stl", "ply", "off", "glb", "obj"])
def test_formats_agree(write, tmp_path, kind):
    trimesh = pytest.importorskip("trimesh")
    mesh = trimesh.creation.icosphere(2)
    path = tmp_path / f"ball.{kind}"
    mesh.export(path)
    model = load_model(path, up="+y", front="+z")
    assert len(model.faces) == 320
    # A ball on the ground: its top is the farthest point.
    np.testing.assert_allclose(model.vertices[:, 2].max(), 1, atol=0.02)
    np.testing.assert_allclose(model.normals, (model.corners() - [0, 0, 0.5]) * 2, atol=0.1)
    data = path.read_bytes()
    for cut in (len(data) // 3, len(data) // 2, len(data) - 10):
        try:
            load_model(write(f"cut.{kind}", data[:cut]))
        except UnusableModelError:
            continue


def test_glb_scene_with_materials(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    scene = trimesh.Scene()
    pbr = trimesh.visual.material.PBRMaterial
    for place, (factor, mode) in enumerate(
        (([255, 0, 0, 255], "OPAQUE"), ([0, 0, 255, 128], "BLEND"))
    ):
        box = trimesh.creation.box()
        box.visual = trimesh.visual.TextureVisuals(
            uv=np.zeros((8, 2)), material=pbr(baseColorFactor=factor, alphaMode=mode)
        )
        mirror = np.diag([-1.0, 1, 1, 1]) if place else np.eye(4)
        mirror[0, 3] = 3 * place
        scene.add_geometry(box, transform=mirror)
    path = tmp_path / "two.glb"
    scene.export(path)
    model = load_model(path)
    assert len(model.faces) == 24
    assert sorted(round(m.opacity, 1) for m in model.materials) == [0.5, 1.0]
    for owner in (0, 1):  # the mirrored box is not inside out
        faces = model.faces[model.face_material == owner]
        corners = model.vertices[faces]
        outward = corners.mean(1) - corners.mean((0, 1))
        assert (outward * face_normals(model.vertices, faces)).sum(1).min() > 0


def test_vertex_colours_become_a_palette(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.box()
    box.visual.face_colors = np.repeat([[255, 0, 0, 255], [0, 255, 0, 255]], 6, axis=0)
    path = tmp_path / "box.ply"
    box.export(path)
    model = load_model(path)
    colours = texels(model.materials[0].texture, model.uv[:, 0])
    assert {tuple(c[:3]) for c in colours.tolist()} <= {(255, 0, 0), (0, 255, 0)}


def test_textures_are_reduced():
    stream = io.BytesIO()
    Image.new("RGB", (3000, 100), (9, 8, 7)).save(stream, "PNG")
    texture = decode_texture(stream.getvalue(), 1000)
    assert texture.shape == (33, 1000, 4)
    assert texture[5, 5].tolist() == [9, 8, 7, 255]


def huge_png(side):
    """A PNG that says it has side x side pixels, of some kilobytes."""

    def chunk(kind, body):
        return (
            struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
        )

    packer = zlib.compressobj(9)
    row = b"\0" * (1 + side // 8 + 1)
    body = packer.compress(row * 200) + packer.flush()
    head = struct.pack(">IIBBBBB", side, side, 1, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", body) + chunk(b"IEND", b"")


def test_a_texture_of_30000_pixels_is_not_decoded(write):
    write("big.png", huge_png(30_000))
    write("m.mtl", "newmtl a\nKd .2 .4 .6\nmap_Kd big.png\n")
    model = load_model(write("a.obj", f"mtllib m.mtl\n{CUBE}usemtl a\n{FACES}"))
    assert model.materials[0].texture is None
    assert model.materials[0].diffuse == (0.2, 0.4, 0.6)
    assert "30000 x 30000 pixels" in model.warnings[0]


def test_a_large_jpeg_is_reduced_while_it_is_decoded(monkeypatch):
    stream = io.BytesIO()
    Image.new("RGB", (4000, 2000), (200, 100, 50)).save(stream, "JPEG")
    monkeypatch.setattr(textures, "MAX_DECODED_PIXELS", 1_000_000)
    texture = decode_texture(stream.getvalue(), 512)
    assert texture.shape == (256, 512, 4)
    np.testing.assert_allclose(texture[0, 0], [200, 100, 50, 255], atol=4)


@pytest.mark.parametrize("mode", ["1", "L", "LA", "P", "RGB", "RGBA", "I;16", "CMYK"])
def test_modes_of_pictures(mode):
    stream = io.BytesIO()
    Image.new("L", (300, 200), 255).convert(mode).save(stream, "TIFF")
    texture = decode_texture(stream.getvalue(), 100)
    assert texture.shape == (67, 100, 4)
    assert texture.dtype == np.uint8


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


def test_a_name_that_is_not_ascii(write):
    write("Stühle/größe.mtl", "newmtl Öl\nKd 1 0 0\n")
    path = write("Stühle/стул 椅子.obj", f"mtllib größe.mtl\n{CUBE}usemtl Öl\n{FACES}")
    model = load_model(path)
    assert model.materials[0].diffuse == (1, 0, 0)
    assert model.model_id == "стул 椅子.obj"


def test_a_large_file_is_refused(write, monkeypatch):
    monkeypatch.setattr(reader_files, "MAX_FILE_BYTES", 100)
    with pytest.raises(UnusableModelError, match="more than the limit of 100"):
        load_model(write("a.obj", CUBE + FACES))


COLLADA = """\
<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset><unit meter="1"/><up_axis>Y_UP</up_axis></asset>
  <library_images><image id="i"><init_from>bild.png</init_from></image></library_images>
  <library_effects><effect id="e"><profile_COMMON>
    <newparam sid="s"><surface type="2D"><init_from>i</init_from></surface></newparam>
    <newparam sid="p"><sampler2D><source>s</source></sampler2D></newparam>
    <technique sid="common"><phong><diffuse><texture texture="p" texcoord="UV"/></diffuse></phong>
    </technique></profile_COMMON></effect></library_effects>
  <library_materials><material id="m" name="m"><instance_effect url="#e"/></material>
  </library_materials>
  <library_geometries><geometry id="g"><mesh>
    <source id="v"><float_array id="va" count="12">0 0 0 4 0 0 4 1 0 0 1 2</float_array>
      <technique_common><accessor source="#va" count="4" stride="3"><param name="X" type="float"/>
      <param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common>
    </source>
    <source id="t"><float_array id="ta" count="8">0 0 1 0 1 1 0 1</float_array>
      <technique_common><accessor source="#ta" count="4" stride="2"><param name="S" type="float"/>
      <param name="T" type="float"/></accessor></technique_common></source>
    <vertices id="vs"><input semantic="POSITION" source="#v"/></vertices>
    <triangles count="2" material="mat"><input semantic="VERTEX" source="#vs" offset="0"/>
      <input semantic="TEXCOORD" source="#t" offset="1" set="0"/>
      <p>0 0 1 1 2 2 0 0 2 2 3 3</p></triangles></mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="w"><node id="n"><instance_geometry url="#g">
    <bind_material><technique_common><instance_material symbol="mat" target="#m">
    <bind_vertex_input semantic="UV" input_semantic="TEXCOORD" input_set="0"/>
    </instance_material></technique_common></bind_material></instance_geometry></node>
  </visual_scene></library_visual_scenes>
  <scene><instance_visual_scene url="#w"/></scene>
</COLLADA>
"""


def test_collada(tmp_path):
    pytest.importorskip("trimesh")
    pytest.importorskip("collada")
    (tmp_path / "a.dae").write_text(COLLADA)
    Image.fromarray(np.full((2, 2, 3), (10, 200, 30), np.uint8)).save(tmp_path / "bild.png")
    model = load_model(tmp_path / "a.dae")
    assert len(model.faces) == 2
    extent = np.ptp(model.vertices, axis=0)
    np.testing.assert_allclose(extent / extent[2], [2, 4, 1], rtol=1e-5)
    texture = model.materials[model.face_material[0]].texture
    assert texture is not None
    assert texture[0, 0].tolist() == [10, 200, 30, 255]
    assert model.uv.max() == 1
    (tmp_path / "torn.dae").write_text(COLLADA[:-400])
    with pytest.raises(UnusableModelError, match="not readable as dae"):
        load_model(tmp_path / "torn.dae")
    (tmp_path / "bomb.dae").write_text(
        COLLADA.replace("<COLLADA", '<!DOCTYPE a [<!ENTITY b "bbbb">]><COLLADA', 1)
    )
    with pytest.raises(UnusableModelError, match="entities"):
        load_model(tmp_path / "bomb.dae")


# --- The OBJ reader's arrays against a plain reading, line by line ------------------------------


def plain_obj(text):
    """Positions of the triangles' corners [n, 3, 3] and their texture coordinates, convex faces."""
    rows = {"v": [], "vt": [], "vn": []}
    corners = []
    for line in text.replace("\r\n", "\n").replace("\\\n", " ").split("\n"):
        key, *words = line.split("#")[0].split() or [""]
        if key in rows:
            rows[key].append([float(w) for w in words])
        elif key == "f" and len(words) >= 3:
            parts = [[int(p or 0) for p in w.split("/")] + [0, 0] for w in words]
            parts = [
                [i - 1 if i > 0 else len(rows[k]) + i if i else None
                 for i, k in zip(p[:3], rows, strict=True)]
                for p in parts
            ]  # fmt: skip
            corners += [(parts[0], parts[k], parts[k + 1]) for k in range(1, len(parts) - 1)]

    def of(face, column, key, count):
        return [
            rows[key][c[column]][:count] if c[column] is not None else [0] * count for c in face
        ]

    return (
        np.array([of(f, 0, "v", 3) for f in corners]),
        np.array([of(f, 1, "vt", 2) for f in corners]),
        np.array([of(f, 2, "vn", 3) for f in corners]),
    )


def random_obj(seed, forms, end="\n"):
    """An OBJ file of random convex fans, statements in any order, corners in the given forms."""
    rng = np.random.default_rng(seed)
    lines = ["# made up", "o thing", ""]
    count = [0, 0, 0]
    for _ in range(40):
        for _ in range(int(rng.integers(4, 9))):
            # Points on an arc: every polygon of them in order is convex.
            angle = count[0] * 0.11
            lines.append(f"v {np.cos(angle):.6f}  {np.sin(angle):.6g} {rng.random():.3e}")
            lines.append(f"\tvt {rng.random():.4f} -{rng.random():.4f} 0.0")
            lines.append(f"vn 0 {rng.random()} 1")
            count = [c + 1 for c in count]
        lines.append(str(rng.choice(["s off", "g part", "usemtl a", "usemtl b c", "", "#f 1 2 3"])))
        for _ in range(int(rng.integers(1, 4))):
            start = int(rng.integers(0, count[0] - 4))
            index = range(start + 1, start + 1 + int(rng.integers(3, 5)))
            form = str(rng.choice(forms))
            words = [form.format(i, n=i - count[0] - 1) for i in index]
            lines.append("f " + " ".join(words) + str(rng.choice(["", " ", "\t"])))
    return end.join([*lines, ""])


@pytest.mark.parametrize(
    "forms",
    [["{0}"], ["{0}/{0}"], ["{0}//{0}"], ["{0}/{0}/{0}"], ["{n}/{n}/{n}"], ["{n}"], ["{0}/{0}/"],
     ["{0}/{0}/{0}", "{0}//{0}"], ["{0}", "{0}/{0}/{0}", "{n}//{n}", "{0}/{n}"]],
)  # fmt: skip
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_arrays_are_those_of_a_reading_line_by_line(write, monkeypatch, forms, end):
    monkeypatch.setattr(obj, "triangles", fans)
    for seed, size in enumerate([1 << 22, 900, 64]):  # blocks end anywhere between lines
        monkeypatch.setattr(_blocks, "__defaults__", (size,))
        text = random_obj(seed, forms, end)
        positions, uv, normals = plain_obj(text)
        path = write("a.obj", text)
        files = FolderFiles(path.parent)
        arrays = read_obj(text.encode(), files, "", 64, 9999, Notes())
        np.testing.assert_array_equal(arrays["vertices"][arrays["faces"]], positions)
        for name, expected in (("uv", uv), ("normals", normals)):
            found = arrays[name] if arrays[name] is not None else np.zeros_like(expected)
            np.testing.assert_array_equal(found, expected)


def fans(counts, corners, vertices):
    """As `polygons.triangles`, every polygon as a fan."""
    start = np.cumsum(counts) - counts
    pairs = [(s, k) for s, n in zip(start, counts, strict=True) for k in range(1, n - 1)]
    polygon = np.repeat(np.arange(len(counts)), counts - 2)
    return np.array([(s, s + k, s + k + 1) for s, k in pairs]), polygon


def test_unusual_lines(write):
    text = """\
v 0 0 0 0.1 0.2 0.3 # with a colour
v 1 0 0
v 1 1 0 1.0
v 0 1
vertex 9 9 9
v
vt
f
f 1 2
usemtl
usemtl  two words\x20
f 1 2 3 4 # f 1 2 3
fo 1 2 3
f 4 3 \\
 2 1"""
    model = load_model(write("a.obj", text))
    assert len(model.faces) == 4
    assert [m.name for m in model.materials] == ["two words"]
    assert "2 faces with less" not in " ".join(model.warnings)
    assert any("1 faces with less than three corners" in w for w in model.warnings)


def test_materials_that_share_a_texture_are_counted_once(monkeypatch):
    texture = np.zeros((64, 64, 4), np.uint8)
    monkeypatch.setattr(textures, "_MAX_TEXELS", 64 * 64)
    notes = Notes()
    shared = [Material(texture=texture) for _ in range(5)]
    assert bounded(shared, notes)[3].texture is texture
    assert not notes.lines
    other = Material(texture=np.zeros((128, 64, 4), np.uint8))
    result = bounded([*shared, other, Material()], notes)
    assert len({id(m.texture) for m in result[:5]}) == 1
    assert sum(t.size // 4 for t in {id(m.texture): m.texture for m in result[:6]}.values()) <= 4096
